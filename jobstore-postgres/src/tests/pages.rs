//! How long a page of three million jobs takes: `tests/postgres.sh pages`.

use super::{PresenceLimits, job_store, make};
use crate::testing::{Server, run, schema_in};
use jobqueue::{Policy, Selection, Stage};
use jobstore::JobStore;
use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng},
};
use std::{sync::Arc, time::Instant};

const MATERIALS: u32 = 3_000_000;

/// Where pages begin, drawn.
const BEGINNINGS: usize = 100;

/// As many as a page in a browser shows.
const JOBS: usize = limits::web::JOBS_A_PAGE as usize;

/// A set at work: half is done, a thousand are leased where the done ones end, and few have trouble.
const AT_WORK: &str = "\
    UPDATE jobs SET stage = 'completed', renderer = 'w' || material % 50 WHERE material < 1500000; \
    UPDATE jobs SET stage = 'leased' WHERE material BETWEEN 1500000 AND 1500999; \
    INSERT INTO leases SELECT material, '\\x00', int8send(material % 50), 'w' || material % 50, \
        0, 0, 0, 0 FROM jobs WHERE stage = 'leased'; \
    UPDATE jobs SET stage = 'set_aside' WHERE material % 300007 = 5; \
    UPDATE jobs SET stage = 'cancelled' WHERE material % 30011 = 7";

/// The longest and the median time of pages, ms, and how many calls the longest search made.
async fn measure(job_store: &dyn JobStore, stages: Vec<Stage>) -> (f64, f64, usize) {
    let selection = Selection::new(Vec::new(), stages);
    let mut random = ChaCha8Rng::seed_from_u64(17);
    let mut times = Vec::new();
    let mut calls_max = 0;
    for beginning in 0..BEGINNINGS {
        let mut from = match beginning {
            0 => 0,
            _ => random.next_u32() % MATERIALS,
        };
        let mut found = 0;
        for calls in 1.. {
            let began = Instant::now();
            let page = job_store.jobs(from, JOBS, &selection).await.unwrap();
            times.push(began.elapsed().as_secs_f64() * 1e3);
            found += page.jobs.len();
            calls_max = calls_max.max(calls);
            match page.next {
                Some(next) if found < JOBS => from = next,
                _ => break,
            }
        }
    }
    times.sort_by(f64::total_cmp);
    (times[times.len() - 1], times[times.len() / 2], calls_max)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "minutes: tests/postgres.sh pages"]
async fn pages_of_three_million_jobs() {
    let settings = "-c fsync=off -c shared_buffers=512MB -c max_wal_size=4GB";
    let server = tokio::task::spawn_blocking(|| Server::start(settings))
        .await
        .unwrap();
    let url = schema_in(&server.url(), 0).await;
    make(&url, MATERIALS).await;
    for statement in AT_WORK.split("; ") {
        run(&url, statement).await;
    }
    run(&url, "VACUUM ANALYZE").await;
    let (policy, presence) = (Policy::default(), PresenceLimits::default());
    let job_store = job_store(&url, policy, presence, Arc::default());
    let all = [
        ("all", Vec::new()),
        ("pending", vec![Stage::Pending]),
        ("leased", vec![Stage::Leased]),
        ("completed", vec![Stage::Completed]),
        ("quarantined", vec![Stage::Quarantined]),
        ("cancelled", vec![Stage::Cancelled]),
    ];
    for (name, stages) in all {
        let (longest, median, calls) = measure(&*job_store, stages).await;
        println!(
            "{name}: a call takes {median:.1} ms in the median and {longest:.1} ms at most; \
             a page takes {calls} at most"
        );
    }
}
