//! Panics of the tasks that claim and record.

use super::{Database, PostgresJobStore, PresenceLimits, make, tokens, worker};
use crate::testing::fresh_schema;
use imagestore::blobs::Blobs;
use jobqueue::Policy;
use jobstore::{JobStore, JobStoreContext, JobStoreError, Meter, Renewal};
use std::{path::Path, sync::Arc, time::Duration};

struct Panicking;

impl Meter for Panicking {
    fn note_publication(&self, _: Duration) {}

    fn note_commit(&self, _: Duration, _: usize) {
        panic!("a panic on purpose");
    }
}

async fn panicking() -> PostgresJobStore {
    let url = fresh_schema().await;
    make(&url, 2).await;
    let context = JobStoreContext::new(Blobs::new(Path::new("/nowhere")), |_, _| {});
    PostgresJobStore::new(
        Database::new(&url).unwrap(),
        Policy::default(),
        PresenceLimits::default(),
        Arc::new(Panicking),
        Arc::new(context),
    )
}

async fn assert_failed(job_store: &PostgresJobStore, task: &str) {
    let mut failure = job_store.failure();
    let why = failure.wait_for(Option::is_some).await.unwrap();
    let why = why.as_deref().unwrap();
    assert!(why.contains(task) && why.contains("panicked"), "{why}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_panic_of_the_task_that_claims_is_a_failure_of_the_store() {
    let job_store = panicking().await;
    job_store.admit(worker(1), "w").await.unwrap();
    let claimed = job_store.claim(worker(1), &tokens(1)).await;
    assert!(
        matches!(claimed, Err(JobStoreError::Interrupted)),
        "{claimed:?}"
    );
    assert_failed(&job_store, "claims jobs").await;
    let after = job_store.claim(worker(1), &tokens(1)).await;
    assert!(matches!(after, Err(JobStoreError::Interrupted)));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_panic_of_a_task_that_records_is_a_failure_of_the_store() {
    let job_store = panicking().await;
    let renewal = Renewal {
        token: tokens(1)[0],
        material: 0,
        views_done: 0,
    };
    let renewed = job_store.renew(&[renewal]).await;
    assert!(
        matches!(renewed, Err(JobStoreError::Interrupted)),
        "{renewed:?}"
    );
    assert_failed(&job_store, "records what workers do").await;
}
