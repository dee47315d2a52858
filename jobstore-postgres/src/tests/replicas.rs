//! Several coordinators at one database at once.

use super::{PresenceLimits, assert_tallies, delivery, job_store, make, tokens, worker};
use crate::testing::{client, fresh_schema};
use jobqueue::{Policy, Verdict};
use jobstore::{JobStore, Renewal};
use std::{
    collections::HashMap,
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::task::JoinSet;

const MATERIALS: u32 = 400;

/// One worker's day at one of the coordinators: it claims, renews, fails, hands back, is silent and
/// completes, and tells everything twice.
async fn work(
    job_stores: Vec<Arc<dyn JobStore>>,
    number: u32,
    recorded: Arc<Mutex<HashMap<u32, u32>>>,
) {
    let id = worker(number);
    let name = format!("w{number}");
    job_stores[0].admit(id, &name).await.unwrap();
    let mut step = number;
    loop {
        step += 1;
        let job_store = &job_stores[step as usize % job_stores.len()];
        let leased = job_store.claim(id, &tokens(3)).await.unwrap();
        if leased.finished {
            return;
        }
        if leased.jobs.is_empty() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        for (token, material) in leased.jobs {
            step += 1;
            let job_store = &job_stores[step as usize % job_stores.len()];
            let renewal = Renewal {
                token,
                material,
                views_done: 1,
            };
            job_store.renew(&[renewal]).await.unwrap();
            if step.is_multiple_of(37) {
                drop(job_store.fail(material, token, "no light").await);
                continue;
            }
            if step.is_multiple_of(41) {
                // Silent: the lease runs out.
                continue;
            }
            let other = &job_stores[(step as usize + 1) % job_stores.len()];
            let delivery = delivery(material, token);
            let (one, two) = tokio::join!(
                job_store.complete(delivery.clone()),
                other.complete(delivery)
            );
            for answer in [one, two] {
                if matches!(answer, Ok(decision) if decision.verdict == Verdict::Recorded) {
                    *recorded.lock().unwrap().entry(material).or_default() += 1;
                }
            }
        }
        if step.is_multiple_of(13) {
            job_store.release(id).await.unwrap();
            job_store.admit(id, &name).await.unwrap();
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn three_coordinators_complete_every_job_once() {
    let url = fresh_schema().await;
    make(&url, MATERIALS).await;
    let policy = Policy {
        lease: Duration::from_secs(2),
        failures_max: u32::MAX,
        workers_failed_max: u32::MAX,
        leases_lost_max: u32::MAX,
        jobs_failed_max: u32::MAX,
        ..Policy::default()
    };
    let job_stores: Vec<Arc<dyn JobStore>> = (0..3)
        .map(|_| job_store(&url, policy, PresenceLimits::default(), Arc::default()))
        .collect();
    let recorded = Arc::<Mutex<HashMap<u32, u32>>>::default();
    let mut working = JoinSet::new();
    for number in 0..9 {
        working.spawn(work(job_stores.clone(), number, Arc::clone(&recorded)));
    }
    let mut sweeping = JoinSet::new();
    for job_store in job_stores.clone() {
        sweeping.spawn(async move {
            loop {
                job_store.expire().await.unwrap();
                tokio::time::sleep(Duration::from_millis(200)).await;
            }
        });
    }
    let ended = async { while working.join_next().await.is_some_and(|end| end.is_ok()) {} };
    tokio::time::timeout(Duration::from_secs(120), ended)
        .await
        .unwrap();
    sweeping.shutdown().await;

    let recorded = recorded.lock().unwrap().clone();
    assert_eq!(recorded.len(), MATERIALS as usize);
    assert!(recorded.values().all(|times| *times == 1), "{recorded:?}");
    assert_tallies(&url).await;
    let left = client(&url).await;
    let left = left
        .query_one(
            "SELECT count(*) FILTER (WHERE stage <> 'completed'), (SELECT count(*) FROM leases), \
             (SELECT count(*) FROM completions) FROM jobs",
            &[],
        )
        .await
        .unwrap();
    assert_eq!(
        (left.get(0), left.get(1), left.get(2)),
        (0_i64, 0_i64, i64::from(MATERIALS))
    );
}
