//! How fast it is with three million jobs, and whether it stays small: `tests/postgres.sh measure`.

use super::{PresenceLimits, delivery, job_store, make, tokens, worker};
use crate::testing::{Server, client, schema_in};
use jobqueue::Policy;
use jobstore::{JobStore, Renewal};
use std::{
    env,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};
use tokio::task::JoinSet;

const MATERIALS: u32 = 3_000_000;

/// Leases that are held and renewed all along, as by so many workers.
const HELD: usize = 960;

fn seconds(name: &str, default: u64) -> Duration {
    let given = env::var(name).map(|given| given.parse().expect("seconds"));
    Duration::from_secs(given.unwrap_or(default))
}

/// Claims, renews and completes one job after another.
async fn work(job_store: Arc<dyn JobStore>, number: u32, done: Arc<AtomicU64>) {
    let id = worker(number);
    job_store.admit(id, &format!("w{number}")).await.unwrap();
    loop {
        // As a coordinator does at each call: who is never heard of is forgotten.
        assert!(job_store.name(id).await.unwrap().is_some());
        let leased = job_store.claim(id, &tokens(1)).await.unwrap();
        for (token, material) in leased.jobs {
            job_store.complete(delivery(material, token)).await.unwrap();
            done.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Renews leases once a third of their time, as workers do.
async fn hold(job_store: Arc<dyn JobStore>, renewed: Arc<AtomicU64>) {
    let id = worker(1_000);
    job_store.admit(id, "holder").await.unwrap();
    let mut renewals = Vec::new();
    while renewals.len() < HELD {
        let leased = job_store.claim(id, &tokens(64)).await.unwrap();
        assert!(!leased.jobs.is_empty());
        renewals.extend(leased.jobs.into_iter().map(|(token, material)| Renewal {
            token,
            material,
            views_done: 0,
        }));
    }
    loop {
        for held in renewals.chunks_mut(16) {
            for renewal in &mut *held {
                renewal.views_done += 1;
            }
            assert!(
                job_store
                    .renew(held)
                    .await
                    .unwrap()
                    .iter()
                    .all(|renewed| *renewed)
            );
            renewed.fetch_add(held.len() as u64, Ordering::Relaxed);
            // 960 leases in 20 seconds.
            tokio::time::sleep(Duration::from_millis(333)).await;
        }
    }
}

async fn told(url: &str) -> String {
    let client = client(url).await;
    let tables = client
        .query(
            "SELECT relname::text, n_live_tup, n_dead_tup, pg_total_relation_size(relid) / 1048576, \
                 n_tup_upd, n_tup_hot_upd \
             FROM pg_stat_user_tables WHERE schemaname = current_schema() \
                 AND relname IN ('jobs', 'leases', 'tallies', 'sweeps') ORDER BY relname",
            &[],
        )
        .await
        .unwrap();
    let tables = tables.iter().map(|row| {
        let number = |column| row.get::<_, i64>(column);
        format!(
            "{}: {} live, {} dead, {} MB, {} of {} updates in place",
            row.get::<_, String>(0),
            number(1),
            number(2),
            number(3),
            number(5),
            number(4)
        )
    });
    tables.collect::<Vec<_>>().join("\n    ")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "minutes: tests/postgres.sh measure"]
async fn three_million_jobs() {
    let each = seconds("BRDFARM_MEASURE_SECONDS", 30);
    let long = seconds("BRDFARM_SOAK_SECONDS", 0);
    let settings = "-c fsync=on -c shared_buffers=512MB -c max_wal_size=4GB";
    let server = tokio::task::spawn_blocking(|| Server::start(settings))
        .await
        .unwrap();
    let url = schema_in(&server.url(), 0).await;
    let began = Instant::now();
    make(&url, MATERIALS).await;
    println!(
        "{MATERIALS} jobs made in {:.1} s",
        began.elapsed().as_secs_f64()
    );
    crate::testing::run(&url, "VACUUM ANALYZE jobs").await;
    let policy = Policy {
        leases_per_worker_max: 2 * HELD as u32,
        ..Policy::default()
    };
    let job_store = job_store(&url, policy, PresenceLimits::default(), Arc::default());
    let mut around = JoinSet::new();
    let renewed = Arc::<AtomicU64>::default();
    around.spawn(hold(Arc::clone(&job_store), Arc::clone(&renewed)));
    let sweeping = Arc::clone(&job_store);
    around.spawn(async move {
        loop {
            sweeping.expire().await.unwrap();
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    });
    for (clients, time) in [(1, each), (4, each), (16, each), (16, long)] {
        let done = Arc::<AtomicU64>::default();
        let mut working = JoinSet::new();
        for number in 0..clients {
            working.spawn(work(Arc::clone(&job_store), number, Arc::clone(&done)));
        }
        let began = Instant::now();
        let mut done_before = 0;
        while began.elapsed() < time {
            let pause = (time - began.elapsed()).min(Duration::from_secs(60));
            tokio::time::sleep(pause).await;
            let done_now = done.load(Ordering::Relaxed);
            assert!(done_now > done_before, "nobody works any more");
            done_before = done_now;
            let rate = done_now as f64 / began.elapsed().as_secs_f64();
            println!(
                "{clients} clients, {:.0} s: {rate:.0} claims and as many completions a second; \
                 {} renewals so far\n    {}",
                began.elapsed().as_secs_f64(),
                renewed.load(Ordering::Relaxed),
                told(&url).await
            );
        }
        working.shutdown().await;
    }
    around.shutdown().await;
}
