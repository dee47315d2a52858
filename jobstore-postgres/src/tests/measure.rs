//! How fast it is with three million jobs, and whether it stays small: `tests/postgres.sh measure`.

use super::{PresenceLimits, job_store, make, tokens, worker};
use crate::testing::{Server, client, schema_in};
use dataset::Digest;
use jobqueue::{Completion, Policy, token::Token};
use jobstore::{Delivery, JobStore, Renewal};
use std::{
    env,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicI64, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};
use tokio::task::JoinSet;

const MATERIALS: u32 = 3_000_000;

/// As many as the paper's; BRDFARM_MEASURE_VIEWS takes another number.
const VIEWS: u32 = 14;

/// What one transaction of plain SQL claims or completes.
const PLAIN_BATCH: i64 = 64;

/// Leases that are held and renewed all along, as by this many workers.
const HELD: usize = 960;

/// Nobody pays for what those before left behind.
const SWEPT: &str = "VACUUM jobs, leases, tallies, images, completions";

fn seconds(name: &str, default: u64) -> Duration {
    let given = env::var(name).map(|given| given.parse().expect("seconds"));
    Duration::from_secs(given.unwrap_or(default))
}

fn views() -> &'static u32 {
    static GIVEN: OnceLock<u32> = OnceLock::new();
    GIVEN.get_or_init(|| {
        let given = env::var("BRDFARM_MEASURE_VIEWS").map(|given| given.parse().expect("views"));
        given.unwrap_or(VIEWS)
    })
}

fn completion(material: u32) -> Completion {
    let of_view = |view: u32| {
        let image = [material.to_be_bytes(), view.to_be_bytes()].concat();
        Completion::sample(material, &image).views.remove(0)
    };
    Completion {
        views: (0..*views()).map(of_view).collect(),
        ..Completion::sample(material, &[])
    }
}

fn delivery(material: u32, token: Token) -> Delivery {
    Delivery {
        token,
        completion: completion(material),
        check: false,
    }
}

/// Claims and completes one job after another.
async fn work(job_store: Arc<dyn JobStore>, number: u32, done: Arc<AtomicU64>) {
    let id = worker(number);
    job_store.admit(id, &format!("w{number}")).await.unwrap();
    loop {
        let leased = job_store.claim(id, &tokens(1)).await.unwrap();
        for (token, material) in leased.jobs {
            let delivery = delivery(material, token);
            let fingerprint = delivery.completion.fingerprint();
            let standing = job_store.standing(material, token, fingerprint);
            standing.await.unwrap();
            job_store.complete(delivery).await.unwrap();
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

/// Where plain SQL begins; clients begin at 0.
const PLAIN_FIRST: i64 = 1_000_000;

/// Writes what claims and completions write, a batch at a time, and looks at nothing: the most that
/// the database gives. `next` is the first material that no connection has taken.
async fn plain(url: String, next: Arc<AtomicI64>, done: Arc<AtomicU64>) {
    let mut client = client(&url).await;
    let claim = client
        .prepare(
            "WITH claimed AS ( \
                 UPDATE jobs SET stage = 'leased', record = repeat('x', 150) \
                 WHERE material = ANY ($1) RETURNING material) \
             INSERT INTO leases SELECT material, int8send(material) || int8send(0), \
                 int8send(7) || int8send(0), 'plain', 0, 9223372036854775807, 0, 0 FROM claimed",
        )
        .await
        .unwrap();
    let complete = client
        .prepare(
            "WITH completed AS ( \
                 UPDATE jobs SET stage = 'completed', renderer = 'plain', record = repeat('y', 150) \
                 WHERE material = ANY ($1)), \
             ended AS (DELETE FROM leases WHERE material = ANY ($1)), \
             told AS (INSERT INTO completions SELECT * FROM unnest($1::bigint[], $2::text[])) \
             INSERT INTO images \
             SELECT digest, material, view, 5 FROM unnest($3::bytea[], $4::bigint[], $5::integer[]) \
                 AS of_material (digest, material, view)",
        )
        .await
        .unwrap();
    let tally = "UPDATE tallies SET pending = pending WHERE shard = pg_backend_pid() % 64";
    loop {
        let begin = next.fetch_add(PLAIN_BATCH, Ordering::Relaxed);
        assert!(
            begin + PLAIN_BATCH <= i64::from(MATERIALS),
            "measure for a shorter time"
        );
        let materials: Vec<i64> = (begin..begin + PLAIN_BATCH).collect();
        let completions: Vec<Completion> = materials
            .iter()
            .map(|material| completion(*material as u32))
            .collect();
        let texts: Vec<String> = completions
            .iter()
            .map(|completion| serde_json::to_string(completion).unwrap())
            .collect();
        let mut images: Vec<(Digest, i64, i32)> = Vec::new();
        for completion in &completions {
            let material = i64::from(completion.material);
            let views = (0..).zip(&completion.views);
            images.extend(views.map(|(view, image)| (image.digest, material, view)));
        }
        let digests: Vec<&[u8]> = images.iter().map(|image| &image.0.as_bytes()[..]).collect();
        let numbers: Vec<i64> = images.iter().map(|image| image.1).collect();
        let views: Vec<i32> = images.iter().map(|image| image.2).collect();
        let claiming = client.transaction().await.unwrap();
        claiming.execute(&claim, &[&materials]).await.unwrap();
        claiming.batch_execute(tally).await.unwrap();
        claiming.commit().await.unwrap();
        let completing = client.transaction().await.unwrap();
        completing
            .execute(&complete, &[&materials, &texts, &digests, &numbers, &views])
            .await
            .unwrap();
        completing.batch_execute(tally).await.unwrap();
        completing.commit().await.unwrap();
        done.fetch_add(PLAIN_BATCH as u64, Ordering::Relaxed);
    }
}

/// Plain SQL with this many connections, a second.
async fn measure_plain(url: &str, clients: usize, next: &Arc<AtomicI64>, time: Duration) {
    crate::testing::run(url, SWEPT).await;
    let done = Arc::<AtomicU64>::default();
    let mut working = JoinSet::new();
    for _ in 0..clients {
        working.spawn(plain(url.to_owned(), Arc::clone(next), Arc::clone(&done)));
    }
    let began = Instant::now();
    tokio::time::sleep(time).await;
    let rate = done.load(Ordering::Relaxed) as f64 / began.elapsed().as_secs_f64();
    println!("plain SQL, {clients} connections: {rate:.0} claims and as many completions a second");
    assert!(
        working.try_join_next().is_none(),
        "a connection ended before its time"
    );
    working.shutdown().await;
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
    let plain_next = Arc::new(AtomicI64::new(PLAIN_FIRST));
    for clients in [1, 2] {
        measure_plain(&url, clients, &plain_next, each).await;
    }
    for (clients, time) in [(1, each), (4, each), (16, each), (64, each), (64, long)] {
        crate::testing::run(&url, SWEPT).await;
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
    measure_plain(&url, 2, &plain_next, each).await;
    around.shutdown().await;
}
