//! The suite over the job store in this process.

use super::{MATERIALS, POLICY, Place, follow, operation, runs};
use crate::{
    JobStore, JobStoreContext, LocalJobStore, Overview,
    completion_log::CompletionLog,
    ledger::{BlobPlace, Ledger, LedgerError, SledLedger, memory::MemoryLedger},
};
use dataset::Digest;
use imagestore::blobs::Blobs;
use jobqueue::{Changes, Completion, Queue};
use proptest::prelude::*;
use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    time::Duration,
};
use tempfile::TempDir;

/// Job stores in this process over one ledger.
struct LocalPlace {
    ledger: Kept,
    folder: TempDir,
    now: Arc<Mutex<Duration>>,
}

enum Kept {
    Memory(Arc<MemoryLedger>),
    Sled(PathBuf),
}

/// A sync after every operation takes most of the time and shows nothing: nothing is cut short.
struct SyncedAtTheEnd(SledLedger);

impl Ledger for SyncedAtTheEnd {
    fn contents(&self) -> Result<Changes, LedgerError> {
        self.0.contents()
    }

    fn apply(&self, changes: &Changes, completions: &[Completion]) -> Result<(), LedgerError> {
        self.0.apply(changes, completions)
    }

    fn sync(&self) -> Result<(), LedgerError> {
        Ok(())
    }

    fn completion(&self, material: u32) -> Result<Option<Completion>, LedgerError> {
        self.0.completion(material)
    }

    fn blob(&self, digest: &Digest) -> Result<Option<BlobPlace>, LedgerError> {
        self.0.blob(digest)
    }
}

impl Drop for SyncedAtTheEnd {
    fn drop(&mut self) {
        self.0.sync().unwrap();
    }
}

impl LocalPlace {
    fn new(ledger: impl FnOnce(&Path) -> Kept) -> Box<Self> {
        // The completion log is synced, which takes time on a disk and proves nothing here.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() {
            tempfile::tempdir_in(memory)
        } else {
            tempfile::tempdir()
        };
        let folder = folder.unwrap();
        Box::new(Self {
            ledger: ledger(folder.path()),
            folder,
            now: Arc::default(),
        })
    }
}

#[async_trait::async_trait]
impl Place for LocalPlace {
    async fn open(&mut self, overview: Arc<Mutex<Overview>>) -> Arc<dyn JobStore> {
        let ledger: Arc<dyn Ledger> = match &self.ledger {
            Kept::Memory(ledger) => Arc::clone(ledger) as Arc<dyn Ledger>,
            Kept::Sled(path) => Arc::new(SyncedAtTheEnd(SledLedger::open(path).unwrap().0)),
        };
        let mut queue = Queue::new(MATERIALS, POLICY);
        queue.restore(ledger.contents().unwrap(), *self.now.lock().unwrap());
        let (log, _) = CompletionLog::open(&self.folder.path().join("completions.log")).unwrap();
        let context = JobStoreContext::new(Blobs::new(self.folder.path()), move |_, now| {
            *overview.lock().unwrap() = now;
        });
        let clock = Arc::clone(&self.now);
        Arc::new(LocalJobStore::without_thread(
            queue,
            log,
            ledger,
            Arc::new(context),
            Box::new(move || *clock.lock().unwrap()),
        ))
    }

    async fn set_time(&mut self, now: Duration) {
        *self.now.lock().unwrap() = now;
    }

    fn knows_next_expiry(&self) -> bool {
        true
    }
}

proptest! {
    // 512 runs of 200 to 300 operations: 100,000 and more.
    #![proptest_config(runs(512))]

    #[test]
    fn the_job_store_in_memory_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        follow(LocalPlace::new(|_| Kept::Memory(Arc::default())), operations);
    }
}

proptest! {
    #![proptest_config(runs(24))]

    #[test]
    fn the_job_store_over_sled_does_what_the_model_does(
        operations in prop::collection::vec(operation(), 200..300)
    ) {
        follow(LocalPlace::new(|path| Kept::Sled(path.join("ledger"))), operations);
    }
}
