//! A ledger that lives as long as its process, for tests: the plainest that keeps the contract.

use super::{BlobPlace, Ledger, LedgerError};
use dataset::Digest;
use jobqueue::{Changes, Completion, JobChange, JobRecord, Mode, WorkerChange, WorkerRecord};
use std::{
    collections::{BTreeMap, HashMap},
    sync::Mutex,
};

/// A ledger in memory, for tests.
#[derive(Default)]
pub struct MemoryLedger(Mutex<Kept>);

#[derive(Default)]
struct Kept {
    jobs: BTreeMap<u32, JobRecord>,
    workers: BTreeMap<String, WorkerRecord>,
    mode: Option<Mode>,
    completions: HashMap<u32, Completion>,
    blobs: HashMap<Digest, BlobPlace>,
}

impl Ledger for MemoryLedger {
    fn contents(&self) -> Result<Changes, LedgerError> {
        let kept = self.0.lock().unwrap();
        let jobs = kept.jobs.clone().into_iter();
        let workers = kept.workers.clone().into_iter();
        Ok(Changes {
            jobs: jobs
                .map(|(material, record)| JobChange { material, record })
                .collect(),
            workers: workers
                .map(|(name, record)| WorkerChange { name, record })
                .collect(),
            mode: kept.mode,
            retracted: Vec::new(),
        })
    }

    fn apply(&self, changes: &Changes, completions: &[Completion]) -> Result<(), LedgerError> {
        let mut kept = self.0.lock().unwrap();
        for change in &changes.jobs {
            kept.jobs.insert(change.material, change.record.clone());
        }
        for change in &changes.workers {
            kept.workers
                .insert(change.name.clone(), change.record.clone());
        }
        kept.workers
            .retain(|_, record| *record != WorkerRecord::default());
        kept.mode = changes.mode.or(kept.mode);
        for completion in completions {
            for (view, image) in (0..).zip(&completion.views) {
                let place = BlobPlace {
                    material: completion.material,
                    view,
                    bytes: image.bytes,
                };
                kept.blobs.insert(image.digest, place);
            }
            kept.completions
                .insert(completion.material, completion.clone());
        }
        Ok(())
    }

    fn sync(&self) -> Result<(), LedgerError> {
        Ok(())
    }

    fn completion(&self, material: u32) -> Result<Option<Completion>, LedgerError> {
        Ok(self.0.lock().unwrap().completions.get(&material).cloned())
    }

    fn blob(&self, digest: &Digest) -> Result<Option<BlobPlace>, LedgerError> {
        Ok(self.0.lock().unwrap().blobs.get(digest).copied())
    }
}
