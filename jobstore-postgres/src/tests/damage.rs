//! Rows that make no sense.

use super::{PresenceLimits, delivery, job_store, make, tokens, worker};
use crate::testing::{fresh_schema, run};
use jobqueue::{Policy, Verdict};
use jobstore::{JobStoreError, Renewal};
use std::sync::Arc;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_damaged_row_keeps_nobody_else_from_working() {
    let url = fresh_schema().await;
    make(&url, 6).await;
    let policy = Policy::default();
    let job_store = job_store(&url, policy, PresenceLimits::default(), Arc::default());
    job_store.admit(worker(1), "w").await.unwrap();
    let leased = job_store.claim(worker(1), &tokens(3)).await.unwrap().jobs;
    assert_eq!(
        leased.iter().map(|job| job.1).collect::<Vec<_>>(),
        [0, 1, 2]
    );
    // A record cut short, a job whose lease is gone, and a pending one that is next.
    run(
        &url,
        "UPDATE jobs SET record = '{' WHERE material IN (0, 3); \
         DELETE FROM leases WHERE material = 1",
    )
    .await;
    let complete = |number: usize| job_store.complete(delivery(number as u32, leased[number].0));
    let (cut, torn, whole) = tokio::join!(complete(0), complete(1), complete(2));
    assert_eq!(whole.unwrap().verdict, Verdict::Recorded);
    let said = [cut, torn].map(|answer| match answer {
        Err(JobStoreError::Ledger(error)) => error.to_string(),
        other => panic!("{other:?}"),
    });
    assert!(
        said[0].contains("the record of material 0: "),
        "{}",
        said[0]
    );
    assert!(
        said[1].contains("the record of material 1: its record and its lease"),
        "{}",
        said[1]
    );

    // The next one is passed over, again and again.
    for next in [4, 5] {
        let jobs = job_store.claim(worker(1), &tokens(1)).await.unwrap().jobs;
        let [(token, material)] = jobs[..] else {
            panic!("{jobs:?}");
        };
        assert_eq!(material, next);
        let renewal = Renewal {
            token,
            material,
            views_done: 1,
        };
        assert_eq!(job_store.renew(&[renewal]).await.unwrap(), [true]);
        job_store.complete(delivery(material, token)).await.unwrap();
    }
    let left = job_store.claim(worker(1), &tokens(1)).await.unwrap();
    assert!(left.jobs.is_empty() && !left.finished);

    // A worker whose history is damaged is told; the others are not.
    run(&url, "UPDATE jobs SET record = NULL WHERE material = 3").await;
    job_store.admit(worker(2), "odd").await.unwrap();
    run(
        &url,
        "INSERT INTO workers VALUES ('odd', false, false, NULL, 'x')",
    )
    .await;
    let [one, two] = [tokens(1), tokens(1)];
    let (odd, even) = tokio::join!(
        job_store.claim(worker(2), &one),
        job_store.claim(worker(1), &two)
    );
    assert!(matches!(odd, Err(JobStoreError::Ledger(_))), "{odd:?}");
    even.unwrap();
}
