//! Several coordinators at one database at once.

use super::{Presence, assert_tallies, board, delivery, make, tokens, worker};
use crate::testing::{client, fresh_schema};
use jobqueue::{Policy, Verdict};
use jobstore::{Board, Renewal};
use std::{
    collections::HashMap,
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::task::JoinSet;

const MATERIALS: u32 = 400;

/// One worker's day at one of the coordinators: it claims, renews, fails, hands back, is silent and
/// completes, and tells everything twice.
async fn work(boards: Vec<Arc<dyn Board>>, number: u32, recorded: Arc<Mutex<HashMap<u32, u32>>>) {
    let id = worker(number);
    let name = format!("w{number}");
    boards[0].admit(id, &name).await.unwrap();
    let mut step = number;
    loop {
        step += 1;
        let board = &boards[step as usize % boards.len()];
        let leased = board.claim(id, &tokens(3)).await.unwrap();
        if leased.finished {
            return;
        }
        if leased.jobs.is_empty() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        for (token, material) in leased.jobs {
            step += 1;
            let board = &boards[step as usize % boards.len()];
            let renewal = Renewal {
                token,
                material,
                views_done: 1,
            };
            board.renew(&[renewal]).await.unwrap();
            if step.is_multiple_of(37) {
                drop(board.fail(material, token, "no light").await);
                continue;
            }
            if step.is_multiple_of(41) {
                // Silent: the lease runs out.
                continue;
            }
            let other = &boards[(step as usize + 1) % boards.len()];
            let delivery = delivery(material, token);
            let (one, two) =
                tokio::join!(board.complete(delivery.clone()), other.complete(delivery));
            for answer in [one, two] {
                if matches!(answer, Ok(judged) if judged.verdict == Verdict::Recorded) {
                    *recorded.lock().unwrap().entry(material).or_default() += 1;
                }
            }
        }
        if step.is_multiple_of(13) {
            board.release(id).await.unwrap();
            board.admit(id, &name).await.unwrap();
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
    let boards: Vec<Arc<dyn Board>> = (0..3)
        .map(|_| board(&url, policy, Presence::default(), Arc::default()))
        .collect();
    let recorded = Arc::<Mutex<HashMap<u32, u32>>>::default();
    let mut working = JoinSet::new();
    for number in 0..9 {
        working.spawn(work(boards.clone(), number, Arc::clone(&recorded)));
    }
    let mut sweeping = JoinSet::new();
    for board in boards.clone() {
        sweeping.spawn(async move {
            loop {
                board.expire().await.unwrap();
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
