//! 1,000 workers that render nothing, over real gRPC, against one coordinator process-wide: leases
//! and completions a second, latencies, memory, starvation.
//!
//! `tests/throughput.sh` runs it in release, where it has its mark to meet.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#![allow(clippy::print_stdout, reason = "the figures are what this run is for")]

#[path = "../../coordinator/tests/store/cheap_image.rs"]
mod cheap_image;

use cheap_image::{cheap_image, small_specification};
use coordinator::{Coordinator, Options, Store};
use dataset::{Digest, Specification};
use proto::{
    FarmClient,
    client::{Credentials, with_deadline},
};
use std::{
    fs,
    sync::Arc,
    time::{Duration, Instant},
};

/// Connections; each carries the calls of several workers.
const CONNECTIONS: usize = 50;

/// What one simulated worker saw.
#[derive(Default)]
struct Seen {
    leases: Vec<Duration>,
    completions: Vec<Duration>,
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_few_simulated_workers_share_the_work_fairly() {
    simulate(20, 400).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "a measurement: tests/throughput.sh runs it"]
async fn a_thousand_simulated_workers() {
    simulate(1000, 20_000).await;
}

async fn simulate(workers: usize, materials: u32) {
    let folder = tempfile::tempdir().unwrap();
    let mut specification = small_specification(materials);
    specification.views.truncate(1);
    let store = Store::open_or_create(folder.path(), &specification).unwrap();
    let options = Options {
        checks_per_million: 0,
        ..Options::default()
    };
    let coordinator = Coordinator::start(store, options).await.unwrap();
    let connections: Vec<FarmClient> = (0..CONNECTIONS.min(workers))
        .map(|_| proto::client::farm(&coordinator.url(), &Credentials::default()).unwrap())
        .collect();
    let specification = Arc::new(specification);
    // Images are made before the clock starts.
    let made = Arc::clone(&specification);
    let images: Vec<Vec<u8>> = (0..materials)
        .map(|material| cheap_image(&made, material, 0))
        .collect();
    let images = Arc::new(images);
    let began = Instant::now();
    let mut working = tokio::task::JoinSet::new();
    for number in 0..workers {
        let client = connections[number % connections.len()].clone();
        let (specification, images) = (Arc::clone(&specification), Arc::clone(&images));
        working.spawn(work(number, client, specification, images));
    }
    let seen = working.join_all().await;
    let elapsed = began.elapsed().as_secs_f64();
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(
        (progress.counts.completed, progress.leases_lost),
        (materials, 0)
    );
    coordinator.shutdown().await;

    let shares: Vec<usize> = seen.iter().map(|seen| seen.completions.len()).collect();
    let (fewest, most) = (shares.iter().min().unwrap(), shares.iter().max().unwrap());
    assert!(*fewest > 0, "a worker starved");
    let leases = sorted(seen.iter().flat_map(|seen| &seen.leases));
    let completions = sorted(seen.iter().flat_map(|seen| &seen.completions));
    println!(
        "{workers} workers, {materials} jobs in {elapsed:.1} s: {:.0} completions/s; lease p50 \
         {:.1} ms, p99 {:.1} ms; completion p50 {:.1} ms, p99 {:.1} ms; {fewest} to {most} jobs a \
         worker; {} MB of memory, clients and all",
        f64::from(materials) / elapsed,
        at(&leases, 50),
        at(&leases, 99),
        at(&completions, 50),
        at(&completions, 99),
        memory() >> 20
    );
}

async fn work(
    number: usize,
    mut client: FarmClient,
    specification: Arc<Specification>,
    images: Arc<Vec<Vec<u8>>>,
) -> Seen {
    let message = proto::RegisterRequest {
        name: format!("simulated-{number}"),
        renderer_version: dataset::RENDERER_VERSION.to_owned(),
        specification_hash: specification.hash().as_bytes().to_vec(),
        worker_id: Vec::new(),
    };
    let registered = client.register(with_deadline(message)).await.unwrap();
    let worker_id = registered.into_inner().worker_id;
    let mut seen = Seen::default();
    loop {
        let message = proto::LeaseRequest {
            worker_id: worker_id.clone(),
            jobs_max: 1,
            wait_ms: 1000,
        };
        let asked = Instant::now();
        let leased = client
            .lease(with_deadline(message))
            .await
            .unwrap()
            .into_inner();
        if leased.finished {
            return seen;
        }
        for job in leased.jobs {
            seen.leases.push(asked.elapsed());
            let image = &images[job.material as usize];
            let digest = Digest::of(image).as_bytes().to_vec();
            let message = proto::PutBlobRequest {
                digest: digest.clone(),
                size: image.len() as u64,
                data: image.clone().into(),
            };
            client.put_blob(with_deadline(message)).await.unwrap();
            let view = proto::View {
                digest,
                size: image.len() as u64,
                md5: Vec::new(),
                statistics: Some(proto::ErrorStatistics::default()),
            };
            let message = proto::CompleteRequest {
                token: job.token,
                material: job.material,
                views: vec![view],
                seconds: 0.1,
            };
            let asked = Instant::now();
            let done = client.complete(with_deadline(message)).await.unwrap();
            assert!(done.into_inner().missing.is_empty());
            seen.completions.push(asked.elapsed());
        }
    }
}

fn sorted<'a>(times: impl Iterator<Item = &'a Duration>) -> Vec<f64> {
    let mut times: Vec<f64> = times.map(|time| time.as_secs_f64() * 1e3).collect();
    times.sort_by(f64::total_cmp);
    times
}

fn at(sorted: &[f64], percent: usize) -> f64 {
    sorted[(sorted.len() - 1) * percent / 100]
}

/// Bytes that this process has, as the system counts them.
fn memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find(|line| line.starts_with("VmHWM:"))
        .unwrap();
    line.split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<u64>()
        .unwrap()
        << 10
}
