//! What is recorded of jobs and workers, without leases, on both sides of a copy.

use super::{FrozenStore, Migrated, MigrationError};
use datastore::StoreName;
use jobqueue::{JobRecord, JobState};
use jobstore::kept::{Entry, Page};
use std::collections::BTreeMap;

/// The entries of a page that the target does not have so. What only the target has, of a source
/// that was changed since, becomes a job without a history.
pub(super) fn missing(
    page: &Page,
    first: u32,
    target: &mut dyn FrozenStore,
    from: &StoreName,
    migrated: &mut Migrated,
) -> Result<Vec<Entry>, MigrationError> {
    let mut there: BTreeMap<u32, Entry> = BTreeMap::new();
    let mut next = Some(first);
    while let Some(start) = next.filter(|start| page.next.is_none_or(|end| *start < end)) {
        let found = target.page(start)?;
        there.extend(found.entries.into_iter().map(|job| (job.material, job)));
        next = found.next;
    }
    if let Some(end) = page.next {
        there.split_off(&end);
    }
    let mut missing = Vec::new();
    for entry in &page.entries {
        let material = entry.material;
        let complete = matches!(entry.record.state, JobState::Completed { .. });
        if complete != entry.completion.is_some() {
            let name = from.clone();
            return Err(MigrationError::NoCompletion { name, material });
        }
        migrated.jobs += 1;
        migrated.materials += u64::from(complete);
        if there.remove(&material).as_ref() == Some(entry) {
            migrated.images += entry.images();
        } else {
            missing.push(entry.clone());
        }
    }
    missing.extend(there.into_keys().map(|material| Entry {
        material,
        record: JobRecord::default(),
        completion: None,
    }));
    missing.sort_by_key(|entry| entry.material);
    Ok(missing)
}

/// Reads all records of both and compares them.
pub(super) fn compare(
    source: &mut dyn FrozenStore,
    target: &mut dyn FrozenStore,
) -> Result<(), MigrationError> {
    let (from, to) = (source.name().clone(), target.name().clone());
    let differs = |what: String| MigrationError::Differs {
        from: from.clone(),
        to: to.clone(),
        what,
    };
    let (mut ours, mut theirs) = (Entries::new(source), Entries::new(target));
    loop {
        match (ours.next()?, theirs.next()?) {
            (None, None) => break,
            (Some(one), Some(other)) if one == other => {}
            (Some(one), other) => {
                let other = other.map_or(one.material, |other| other.material);
                return Err(differs(format!("material {}", one.material.min(other))));
            }
            (None, Some(other)) => return Err(differs(format!("material {}", other.material))),
        }
    }
    if source.farm()? != target.farm()? {
        return Err(differs("workers, or whether work is handed out".to_owned()));
    }
    Ok(())
}

/// The jobs of a store, page by page.
pub(super) struct Entries<'a> {
    store: &'a mut dyn FrozenStore,
    page: std::vec::IntoIter<Entry>,
    next: Option<u32>,
}

impl<'a> Entries<'a> {
    pub fn new(store: &'a mut dyn FrozenStore) -> Self {
        Self {
            store,
            page: Vec::new().into_iter(),
            next: Some(0),
        }
    }

    pub fn next(&mut self) -> Result<Option<Entry>, MigrationError> {
        loop {
            if let Some(entry) = self.page.next() {
                return Ok(Some(entry));
            }
            let Some(first) = self.next else {
                return Ok(None);
            };
            let page = self.store.page(first)?;
            (self.page, self.next) = (page.entries.into_iter(), page.next);
        }
    }
}
