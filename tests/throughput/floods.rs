//! Honest workers at work while somebody floods the coordinator: `tests/floods.sh`.
//!
//! Each flood is measured beside the same load without it, in one process after another on the same
//! machine: jobs a second, and how long a lease takes.

use super::{
    Coordinator, Uploads, find_room, raise_open_files, register, sorted, uploads, work_until,
};
use bytes::Bytes;
use dataset::{Digest, IMAGE_BLOCK_LINES, Specification, image_file_header, image_line_bytes};
use imagestore::validation::expected_headers;
use proto::{
    FarmClient,
    client::{self, Credentials, with_deadline},
};
use std::{
    fs,
    future::Future,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{runtime::Runtime, task::JoinSet, time::sleep};
use tonic::Code;

/// Honest workers, each of which needs half a second a job.
const WORKERS: usize = 100;
const PAUSE: Duration = Duration::from_millis(500);

/// How long each load is measured.
const MEASURED: Duration = Duration::from_secs(20);

/// What a flood may cost: a fifth of the jobs a second, and 99 of 100 leases within this.
const LOSS_MAX: f64 = 0.2;
const LEASE_P99_MAX_MS: f64 = 200.0;

/// Callers that flood at one time.
const FLOODERS: usize = 8;

/// What the honest workers came to.
struct Figures {
    jobs_per_second: f64,
    lease_p99_ms: f64,
}

fn specification(materials: u32, side: u32, views: usize) -> Specification {
    let mut specification = Specification::preset();
    specification.materials = materials;
    (specification.image.width, specification.image.height) = (side, side);
    specification.views.truncate(views);
    specification
}

/// Measures honest workers with and without a flood, of a store of its own each.
fn beside_a_flood<F>(
    what: &str,
    specification: &Specification,
    flood: impl Fn(String, Specification, usize) -> F,
) where
    F: Future<Output = ()> + Send + 'static,
{
    raise_open_files();
    // More than the workers do in the time.
    let jobs = (WORKERS as u128 * MEASURED.as_millis() / PAUSE.as_millis()) as u32 + 2000;
    let mut some = specification.clone();
    some.materials = specification.materials.min(jobs);
    let uploads = uploads(&some);
    let quiet = measured(specification, &uploads, |_| Vec::<F>::new());
    let flooded = measured(specification, &uploads, |url| {
        let floods =
            (0..FLOODERS).map(|number| flood(url.to_owned(), specification.clone(), number));
        floods.collect()
    });
    let loss = 1.0 - flooded.jobs_per_second / quiet.jobs_per_second;
    println!(
        "{what}: {:.1} jobs/s without and {:.1} with it ({:.1} percent fewer), p99 of a lease \
         {:.1} and {:.1} ms",
        quiet.jobs_per_second,
        flooded.jobs_per_second,
        100.0 * loss,
        quiet.lease_p99_ms,
        flooded.lease_p99_ms
    );
    assert!(loss < LOSS_MAX, "{loss}");
    assert!(flooded.lease_p99_ms < LEASE_P99_MAX_MS);
}

fn measured<F: Future<Output = ()> + Send + 'static>(
    specification: &Specification,
    uploads: &Uploads,
    flood: impl FnOnce(&str) -> Vec<F>,
) -> Figures {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("spec.toml"), specification.to_toml()).unwrap();
    let coordinator = Coordinator::start(folder.path());
    let runtime = Runtime::new().unwrap();
    let (seen, seconds) = runtime.block_on(async {
        let mut floods = JoinSet::new();
        for one in flood(&coordinator.url) {
            floods.spawn(one);
        }
        // The flood first, so that it has what it can get.
        sleep(Duration::from_secs(2)).await;
        let registered = register(0..WORKERS, &coordinator.url, specification).await;
        let began = Instant::now();
        let until = began + MEASURED;
        let mut working = JoinSet::new();
        for (number, client, worker_id) in registered {
            let uploads = Arc::clone(uploads);
            working.spawn(async move {
                sleep(PAUSE * number as u32 / WORKERS as u32).await;
                work_until(client, worker_id, uploads, PAUSE, Some(until)).await
            });
        }
        let seen = working.join_all().await;
        floods.shutdown().await;
        (seen, began.elapsed().as_secs_f64())
    });
    drop(runtime);
    coordinator.stop();
    let done: usize = seen.iter().map(|seen| seen.completions.len()).sum();
    let leases = sorted(seen.iter().flat_map(|seen| &seen.leases));
    Figures {
        jobs_per_second: done as f64 / seconds,
        lease_p99_ms: super::at(&leases, 99),
    }
}

/// Lists jobs with as many overlapping ranges as a call may have, without end.
async fn list_jobs(url: String, _: Specification, _: usize) {
    let mut control = client::control(&url, &Credentials::default()).unwrap();
    let ranges = 0..limits::protocol::RANGES_PER_CALL_MAX as u32;
    let ranges = ranges.map(|number| proto::MaterialRange {
        first: number * 7,
        last: u32::MAX - number,
    });
    let selection = proto::JobSelection {
        ranges: ranges.collect(),
        states: vec![
            proto::JobState::Cancelled.into(),
            proto::JobState::Completed.into(),
        ],
    };
    let mut from = 0;
    loop {
        let message = proto::ListJobsRequest {
            selection: Some(selection.clone()),
            from,
            jobs_max: limits::protocol::JOBS_LISTED_MAX,
        };
        let page = control.list_jobs(with_deadline(message)).await;
        from = page.unwrap().into_inner().next.unwrap_or(0);
    }
}

/// Leases as much as a worker may, and sends images for it without end, and without completing any.
async fn stage(url: String, specification: Specification, number: usize) {
    let registered = register([1000 + number].into_iter(), &url, &specification).await;
    let Some((_, mut client, worker_id)) = registered.into_iter().next() else {
        return;
    };
    let message = proto::LeaseRequest {
        worker_id,
        jobs_max: limits::protocol::JOBS_PER_CALL_MAX,
        wait_ms: 0,
    };
    let leased = client.lease(with_deadline(message)).await.unwrap();
    let jobs = leased.into_inner().jobs;
    let mut seed = number as u64;
    loop {
        for job in &jobs {
            seed += 1;
            let image = raw_image(&specification, job.material, 0, seed);
            // With a lease, and as in former times without.
            for token in [job.token.clone(), vec![7; 16]] {
                let message = proto::PutBlobRequest {
                    digest: Digest::of(&image).as_bytes().to_vec(),
                    size: image.len() as u64,
                    data: image.clone(),
                    token,
                    material: job.material,
                };
                drop(client.put_blob(with_deadline(message)).await);
            }
            sleep(Duration::from_millis(20)).await;
        }
    }
}

/// An image of noise that is not compressed, as the renderer would store it.
fn raw_image(specification: &Specification, material: u32, view: usize, seed: u64) -> Bytes {
    let headers = expected_headers(specification, specification.hash(), material);
    let mut file = image_file_header(specification, &headers[view]);
    let lines = specification.image.height;
    let blocks = lines.div_ceil(IMAGE_BLOCK_LINES);
    let line_bytes = image_line_bytes(specification);
    let begin = file.len() as u64 + u64::from(blocks) * 8;
    let place = |block: u32| u64::from(block * IMAGE_BLOCK_LINES) * line_bytes;
    for block in 0..blocks {
        file.extend((begin + u64::from(block) * 8 + place(block)).to_le_bytes());
    }
    let mut bits = seed;
    for block in 0..blocks {
        let first = block * IMAGE_BLOCK_LINES;
        let size = u64::from(IMAGE_BLOCK_LINES.min(lines - first)) * line_bytes;
        file.extend(first.to_le_bytes());
        file.extend((size as u32).to_le_bytes());
        for _ in 0..size / 2 {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            // Positive and finite.
            file.extend(((bits >> 48) as u16 % 0x7c00).to_le_bytes());
        }
    }
    file.into()
}

#[test]
#[ignore = "a measurement: tests/floods.sh runs it"]
fn a_reader_with_4096_ranges_over_a_million_materials() {
    let specification = specification(1_000_000, 16, 1);
    beside_a_flood("ListJobs flood", &specification, list_jobs);
}

#[test]
#[ignore = "a measurement: tests/floods.sh runs it"]
fn somebody_stages_and_never_completes() {
    let specification = specification(20_000, 128, 2);
    beside_a_flood("staging flood", &specification, stage);
}

/// Delivers one material of 100 MB: finds room, sends image after image, completes.
async fn deliver(mut client: FarmClient, worker_id: Vec<u8>, specification: Specification) {
    let message = proto::LeaseRequest {
        worker_id,
        jobs_max: 1,
        wait_ms: 0,
    };
    let leased = client.lease(with_deadline(message)).await.unwrap();
    let job = leased.into_inner().jobs.swap_remove(0);
    find_room(&mut client, &job, &[]).await;
    let mut views = Vec::new();
    for view in 0..specification.views.len() {
        let seed = u64::from(job.material) << 8 | view as u64;
        let data = raw_image(&specification, job.material, view, seed);
        let digest = Digest::of(&data).as_bytes().to_vec();
        let size = data.len() as u64;
        let message = proto::PutBlobRequest {
            digest: digest.clone(),
            size,
            data,
            token: job.token.clone(),
            material: job.material,
        };
        loop {
            match client.put_blob(with_deadline(message.clone())).await {
                Ok(_) => break,
                Err(status) => assert_eq!(status.code(), Code::ResourceExhausted, "{status}"),
            }
            sleep(Duration::from_secs(1)).await;
        }
        views.push(proto::View {
            digest,
            size,
            statistics: Some(proto::ErrorStatistics::default()),
            ..proto::View::default()
        });
    }
    let message = proto::CompleteRequest {
        token: job.token,
        material: job.material,
        views,
        seconds: 1.0,
    };
    let done = client.complete(with_deadline(message)).await.unwrap();
    assert!(done.into_inner().missing.is_empty());
}

#[test]
#[ignore = "a measurement: tests/floods.sh runs it"]
fn all_of_28_workers_with_100_mb_a_material_complete() {
    let specification = specification(28, 1100, 14);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("spec.toml"), specification.to_toml()).unwrap();
    let coordinator = Coordinator::start(folder.path());
    let began = Instant::now();
    Runtime::new().unwrap().block_on(async {
        let registered = register(0..28, &coordinator.url, &specification).await;
        let mut delivering = JoinSet::new();
        for (_, client, worker_id) in registered {
            delivering.spawn(deliver(client, worker_id, specification.clone()));
        }
        delivering.join_all().await;
    });
    let seconds = began.elapsed().as_secs_f64();
    let peak = coordinator.process.memory_bytes("VmHWM").unwrap();
    coordinator.stop();
    let store = datastore::ReadOnlyStore::open(&folder.path().join("store")).unwrap();
    assert_eq!(store.materials_missing(), 0);
    println!(
        "28 workers with 100 MB a material: all complete in {seconds:.1} s, coordinator {} MB at \
         its peak",
        peak >> 20
    );
}
