//! What is kept of jobs and workers when nobody is at work: what a copy of a store copies.

use jobqueue::{Completion, JobRecord, Mode, WorkerRecord, unleased};
use std::collections::BTreeMap;

/// A job with a history, without its lease.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The material's index.
    pub material: u32,
    /// Its history.
    pub record: JobRecord,
    /// What was delivered, where it counts.
    pub completion: Option<Completion>,
}

/// Some of the jobs, in the order of materials.
#[derive(Debug)]
pub struct Page {
    /// Those that have a history.
    pub entries: Vec<Entry>,
    /// Where the next page begins.
    pub next: Option<u32>,
}

/// What is kept of workers, and whether work is handed out.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptFarm {
    /// The workers that have a history, by name.
    pub workers: BTreeMap<String, WorkerRecord>,
    /// Whether work is handed out.
    pub mode: Mode,
}

impl Entry {
    /// How many images its completion names.
    pub fn images(&self) -> u64 {
        let views = self.completion.iter().map(|done| done.views.len() as u64);
        views.sum()
    }
}

impl Page {
    /// Of jobs as they are recorded: leases go, and jobs that have no history then.
    pub fn new(jobs: Vec<Entry>, next: Option<u32>) -> Self {
        let entries = jobs.into_iter().map(|mut entry| {
            entry.record.state = unleased(entry.record.state);
            entry
        });
        let entries = entries.filter(|entry| entry.record != JobRecord::default());
        Self {
            entries: entries.collect(),
            next,
        }
    }
}
