//! The jobs' records: of a whole set, or of those that a database was asked for.

use super::record::JobRecord;
use std::{
    collections::BTreeMap,
    ops::{Index, IndexMut},
};

/// Records by material.
#[derive(Clone, Debug)]
pub(super) enum Records {
    All(Vec<JobRecord>),
    Some(BTreeMap<u32, JobRecord>),
}

impl Records {
    pub fn len(&self) -> usize {
        match self {
            Self::All(records) => records.len(),
            Self::Some(records) => records.len(),
        }
    }

    pub fn get(&self, material: u32) -> Option<&JobRecord> {
        match self {
            Self::All(records) => records.get(material as usize),
            Self::Some(records) => records.get(&material),
        }
    }

    /// The records from a material on, in order.
    pub fn from(&self, first: u32) -> Box<dyn Iterator<Item = (u32, &JobRecord)> + '_> {
        match self {
            Self::All(records) => {
                let records = records.get(first as usize..).unwrap_or_default();
                Box::new((first..).zip(records))
            }
            Self::Some(records) => {
                let records = records.range(first..);
                Box::new(records.map(|(material, record)| (*material, record)))
            }
        }
    }
}

impl Index<u32> for Records {
    type Output = JobRecord;

    fn index(&self, material: u32) -> &JobRecord {
        match self {
            Self::All(records) => &records[material as usize],
            Self::Some(records) => &records[&material],
        }
    }
}

impl IndexMut<u32> for Records {
    fn index_mut(&mut self, material: u32) -> &mut JobRecord {
        match self {
            Self::All(records) => &mut records[material as usize],
            Self::Some(records) => records.entry(material).or_default(),
        }
    }
}
