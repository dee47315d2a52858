//! Workers that have nothing to do.

use super::{Database, PostgresJobStore, PresenceLimits, make, tokens, worker};
use crate::testing::{Server, client, run, schema_in};
use imagestore::blobs::Blobs;
use jobqueue::Policy;
use jobstore::{JobStore, JobStoreContext};
use std::{path::Path, sync::Arc, time::Duration};
use tokio::{
    task::JoinSet,
    time::{sleep, timeout},
};

const WORKERS: u32 = 300;

/// How long statements are counted, seconds.
const COUNTED: u32 = 10;

/// Statements a second of a coordinator with this many idle workers, at most.
const STATEMENTS_MAX: u32 = 50;

/// Asks for work as a call does that waits: again whenever there may be some.
async fn wait_for_work(
    job_store: Arc<PostgresJobStore>,
    context: Arc<JobStoreContext>,
    number: u32,
) {
    // Not all at once.
    sleep(Duration::from_millis(100 * u64::from(number))).await;
    loop {
        let work = context.work.wait();
        let leased = job_store.claim(worker(number), &tokens(1)).await.unwrap();
        assert!(leased.jobs.is_empty());
        let wait = limits::protocol::LEASE_WAIT_MAX;
        drop(timeout(wait, work.woken()).await);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn hundreds_of_idle_workers_cost_a_few_statements() {
    let settings = "-c shared_preload_libraries=pg_stat_statements";
    let server = tokio::task::spawn_blocking(|| Server::start(settings));
    let server = server.await.unwrap();
    let url = schema_in(&server.url(), 0).await;
    make(&url, 10).await;
    // A second rendering that only others than those who are there could do.
    run(
        &url,
        "CREATE EXTENSION pg_stat_statements; \
         UPDATE jobs SET stage = 'completed', renderer = 'w', judge_wanted = material = 4; \
         UPDATE tallies SET pending = 0, completed = 10, checks = 1 WHERE shard = 0; \
         UPDATE jobs SET stage = 'leased' WHERE material = 3; \
         INSERT INTO leases SELECT 3, int8send(1) || int8send(1), int8send(9) || int8send(9), \
             'elsewhere', now_ms(), now_ms() + 600000, 0, now_ms()",
    )
    .await;
    let blobs = Blobs::new(Path::new("/nowhere"));
    let context = Arc::new(JobStoreContext::new(blobs, |_, _| {}));
    let job_store = Arc::new(PostgresJobStore::new(
        Database::new(&url).unwrap(),
        Policy::default(),
        PresenceLimits::default(),
        Arc::new(()),
        Arc::clone(&context),
    ));
    let mut around = JoinSet::new();
    for number in 0..WORKERS {
        job_store.admit(worker(number), "w").await.unwrap();
        let (job_store, context) = (Arc::clone(&job_store), Arc::clone(&context));
        around.spawn(wait_for_work(job_store, context, number));
    }
    // As a coordinator does, and its health besides.
    let sweeping = Arc::clone(&job_store);
    around.spawn(async move {
        loop {
            sweeping.expire().await.unwrap();
            sweeping.publish_overview().await.unwrap();
            sleep(limits::SWEEP_INTERVAL_MAX).await;
        }
    });
    sleep(Duration::from_millis(100 * u64::from(WORKERS))).await;
    let client = client(&url).await;
    let counted = "SELECT sum(calls)::bigint FROM pg_stat_statements";
    let before: i64 = client.query_one(counted, &[]).await.unwrap().get(0);
    sleep(Duration::from_secs(COUNTED.into())).await;
    let after: i64 = client.query_one(counted, &[]).await.unwrap().get(0);
    around.shutdown().await;
    let a_second = (after - before) as f64 / f64::from(COUNTED);
    println!("{WORKERS} idle workers: {a_second:.1} statements a second");
    assert!(a_second < f64::from(STATEMENTS_MAX), "{a_second}");
}
