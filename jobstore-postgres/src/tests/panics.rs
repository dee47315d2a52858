//! A panic of the task that records.

use super::{Database, PostgresJobStore, PresenceLimits, make, tokens, worker};
use crate::testing::fresh_schema;
use imagestore::blobs::Blobs;
use jobqueue::Policy;
use jobstore::{JobStore, JobStoreContext, JobStoreError, Meter};
use std::{path::Path, sync::Arc, time::Duration};

struct Panicking;

impl Meter for Panicking {
    fn note_publication(&self, _: Duration) {}

    fn note_commit(&self, _: Duration, _: usize) {
        panic!("a panic on purpose");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_panic_of_the_task_that_records_is_a_failure_of_the_store() {
    let url = fresh_schema().await;
    make(&url, 2).await;
    let context = JobStoreContext::new(Blobs::new(Path::new("/nowhere")), |_, _| {});
    let job_store = PostgresJobStore::new(
        Database::new(&url).unwrap(),
        Policy::default(),
        PresenceLimits::default(),
        Arc::new(Panicking),
        Arc::new(context),
    );
    job_store.admit(worker(1), "w").await.unwrap();
    let claimed = job_store.claim(worker(1), &tokens(1)).await;
    assert!(
        matches!(claimed, Err(JobStoreError::Interrupted)),
        "{claimed:?}"
    );
    let mut failure = job_store.failure();
    let why = failure.wait_for(Option::is_some).await.unwrap();
    assert!(why.as_deref().unwrap().contains("panicked"), "{why:?}");
    let after = job_store.claim(worker(1), &tokens(1)).await;
    assert!(matches!(after, Err(JobStoreError::Interrupted)));
}
