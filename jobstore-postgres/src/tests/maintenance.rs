//! Commands that write beside coordinators.

use super::{PresenceLimits, assert_tallies, delivery, job_store, make, tokens, worker};
use crate::testing::fresh_schema;
use crate::{Amendment, Database, MaintenanceSession};
use jobqueue::{JobState, Policy, Refusal, Selection};
use jobstore::JobStoreError;
use std::sync::Arc;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_command_records_only_where_what_it_knew_still_holds() {
    let url = fresh_schema().await;
    make(&url, 4).await;
    let job_store = job_store(
        &url,
        Policy::default(),
        PresenceLimits::default(),
        Arc::default(),
    );
    job_store.admit(worker(1), "w").await.unwrap();
    let leased = job_store.claim(worker(1), &tokens(2)).await.unwrap();
    let [(first, 0), (second, 1)] = leased.jobs[..] else {
        panic!("{leased:?}");
    };
    job_store.complete(delivery(0, first)).await.unwrap();

    let database = Database::new(&url).unwrap();
    let mut maintenance = MaintenanceSession::begin(&database).await.unwrap().unwrap();
    let rendered = |material| delivery(material, first).completion;
    let mut kept = rendered(0);
    kept.worker = "w".to_owned();
    let mut mended = kept.clone();
    mended.views[0].statistics.max = 0.0;
    let imported = [rendered(1), rendered(2), rendered(7)];
    let amend = |completion, before| Amendment { completion, before };
    let done = maintenance
        .amend(&[
            amend(&mended, Some(&mended)),
            amend(&imported[0], None),
            amend(&imported[1], None),
            amend(&imported[2], None),
        ])
        .await
        .unwrap();
    assert_eq!(done, [false, true, true, false], "0 is not so, 7 is no job");
    let done = maintenance.amend(&[amend(&mended, Some(&kept))]).await;
    assert_eq!(done.unwrap(), [true]);
    // What is complete is not imported again.
    let done = maintenance.amend(&[amend(&imported[0], None)]).await;
    assert_eq!(done.unwrap(), [false]);

    let jobs = job_store.jobs(0, 9, &Selection::default()).await;
    let jobs = jobs.unwrap().jobs;
    let complete = jobs.iter().map(|(_, job, _)| job.state.is_completed());
    assert_eq!(complete.collect::<Vec<_>>(), [true, true, true, false]);
    // The lease of what came in meanwhile is over; its holder brought the same.
    job_store.complete(delivery(1, second)).await.unwrap();
    let mut other = delivery(1, second);
    other.completion.views[0].digest = dataset::Digest::of(b"other");
    let refused = job_store.complete(other).await.unwrap_err();
    let conflict = Refusal::Conflict(1);
    assert!(matches!(refused, JobStoreError::Refused(found) if found == conflict));
    assert!(matches!(jobs[3].1.state, JobState::Pending));
    assert_tallies(&url).await;

    assert_eq!(maintenance.exclude().await.unwrap(), 0);
    let claim = tokio::spawn({
        let job_store = Arc::clone(&job_store);
        async move { job_store.claim(worker(1), &tokens(1)).await }
    });
    // While others are kept out nobody gets work.
    tokio::time::sleep(std::time::Duration::from_millis(300)).await;
    assert!(!claim.is_finished());
    maintenance.admit().await.unwrap();
    assert_eq!(claim.await.unwrap().unwrap().jobs.len(), 1);
}
