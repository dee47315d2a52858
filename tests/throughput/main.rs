//! Workers that render nothing against one coordinator: the program itself in a process of its own,
//! real gRPC over real sockets, one connection a worker, real images that are uploaded, checked and
//! made durable.
//!
//! A worker does nothing but lease, upload and complete, one job after another; small images come
//! with the completion, as from real workers. Without a pause the
//! coordinator never waits for work: what is measured is its capacity, and latencies are those
//! under the heaviest load that this many workers can make. With a pause for each job, as long as
//! rendering it would take, latencies are those of a farm at work.
//!
//! `tests/throughput.sh` runs the measurements in release, where they have their marks to meet.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#![allow(clippy::print_stdout, reason = "the figures are what this run is for")]

#[path = "../../datastore/tests/store/cheap_image.rs"]
#[allow(dead_code, reason = "others use the rest")]
mod cheap_image;
mod costs;
mod floods;
mod memory;
mod metrics;
mod pages;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../process/mod.rs"]
mod process;

use bytes::Bytes;
use cheap_image::cheap_image;
use dataset::{Digest, Specification};
use datastore::ReadOnlyStore;
use limits::protocol::IMAGES_BROUGHT_BYTES_MAX;
use metrics::{bucket_ms, told};
use process::Process;
use proto::{
    FarmClient,
    client::{Credentials, with_deadline, with_deadline_after},
};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::{
    fs,
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    path::Path,
    process::Command,
    sync::{Arc, Barrier},
    thread,
    time::{Duration, Instant},
};
use tokio::{runtime, task::JoinSet};

/// Jobs a second that a coordinator is to complete, made durable before they are acknowledged.
const JOBS_PER_SECOND_MIN: f64 = 2000.0;

/// What 99 of 100 calls for a lease are to stay under, as their caller sees it.
const LEASE_P99_MAX_MS: f64 = 100.0;

/// How long a coordinator may take to end.
const PATIENCE: Duration = Duration::from_secs(60);

/// How long a worker asks to wait for a job.
const WAIT: Duration = Duration::from_secs(1);

/// Over how long workers begin, one after another: a farm's did not all begin at one instant.
const RAMP: Duration = Duration::from_secs(1);

/// Threads that the workers are shared out among. A call is handed from task to task half a dozen
/// times at the worker's side, and each time queues behind everything else that its thread has to do:
/// with one thread for all, that is longer than the coordinator takes.
const DRIVERS: usize = 8;

/// The unit of time in `/proc`, the same on every Linux.
const TICKS_PER_SECOND: f64 = 100.0;

/// A measurement.
struct Load {
    workers: usize,
    jobs: u32,
    views: usize,
    side: u32,
    /// What a job takes a worker between its lease and its first upload.
    pause: Duration,
    /// Whether the store stays when all is measured.
    keeps_store: bool,
    /// At how many completed jobs the coordinator's memory is told.
    memory_at: &'static [usize],
}

/// What came of it.
struct Figures {
    jobs_per_second: f64,
    lease_p99_ms: f64,
}

/// By material and view.
type Uploads = Arc<Vec<Vec<proto::PutBlobRequest>>>;

/// What a worker saw.
#[derive(Default)]
struct Seen {
    leases: Vec<Duration>,
    uploads: Vec<Duration>,
    completions: Vec<Duration>,
}

/// Processor time and memory of a process, as the system counts them.
struct Usage {
    seconds: f64,
    memory_bytes: u64,
}

#[test]
fn a_few_simulated_workers_share_the_work_fairly() {
    simulate(&Load {
        workers: 20,
        jobs: 400,
        views: 2,
        side: 16,
        pause: Duration::ZERO,
        keeps_store: false,
        memory_at: &[],
    });
}

#[test]
#[ignore = "a measurement: tests/throughput.sh runs it"]
fn a_thousand_workers_and_jobs_of_one_small_image() {
    let figures = simulate(&Load {
        workers: 1000,
        jobs: 40_000,
        views: 1,
        side: 16,
        pause: Duration::ZERO,
        keeps_store: true,
        memory_at: &[],
    });
    println!(
        "mark: {:.0} jobs/s of {JOBS_PER_SECOND_MIN}, p99 of a lease {:.1} ms of \
         {LEASE_P99_MAX_MS}",
        figures.jobs_per_second, figures.lease_p99_ms
    );
    assert!(figures.jobs_per_second >= JOBS_PER_SECOND_MIN);
    assert!(figures.lease_p99_ms <= LEASE_P99_MAX_MS);
}

#[test]
#[ignore = "a measurement: tests/throughput.sh runs it"]
fn a_thousand_workers_and_jobs_as_the_preset_has_them() {
    simulate(&Load {
        workers: 1000,
        jobs: 3000,
        views: 14,
        side: 128,
        pause: Duration::ZERO,
        keeps_store: true,
        memory_at: &[],
    });
}

#[test]
#[ignore = "a measurement: tests/throughput.sh runs it"]
fn a_thousand_workers_that_need_a_second_a_job() {
    let figures = simulate(&Load {
        workers: 1000,
        jobs: 20_000,
        views: 1,
        side: 16,
        pause: Duration::from_secs(1),
        keeps_store: true,
        memory_at: &[],
    });
    println!(
        "mark: p99 of a lease {:.1} ms of {LEASE_P99_MAX_MS} at {:.0} jobs/s",
        figures.lease_p99_ms, figures.jobs_per_second
    );
    assert!(figures.lease_p99_ms <= LEASE_P99_MAX_MS);
}

#[test]
#[ignore = "a measurement: tests/memory.sh runs it"]
fn memory_while_thousands_of_materials_of_14_images_are_completed() {
    memory_over(9_000, 14);
}

#[test]
#[ignore = "a measurement: tests/memory.sh runs it"]
fn memory_while_a_million_materials_of_one_image_are_completed() {
    // `run` adds 60 to them, and a set has a million at most.
    memory_over(999_940, 1);
}

fn memory_over(jobs: u32, views: usize) {
    simulate(&Load {
        workers: 200,
        jobs,
        views,
        side: 8,
        pause: Duration::ZERO,
        keeps_store: true,
        memory_at: &[
            600, 2_100, 3_800, 9_000, 30_000, 100_000, 300_000, 600_000, 999_000,
        ],
    });
}

fn simulate(load: &Load) -> Figures {
    raise_open_files();
    // ext4 looks at every file's number that was freed within minutes before it gives one out: a
    // measurement right after another's folder was removed measures that, so they stay until the
    // script has run all.
    let folder = tempfile::Builder::new()
        .disable_cleanup(load.keeps_store)
        .tempdir()
        .unwrap();
    let mut specification = Specification::preset();
    specification.materials = load.jobs;
    (specification.image.width, specification.image.height) = (load.side, load.side);
    specification.views.truncate(load.views);
    fs::write(folder.path().join("spec.toml"), specification.to_toml()).unwrap();
    // Images are made before the clock starts.
    let uploads = uploads(&specification);
    let coordinator = Coordinator::start(folder.path());
    let pages_bytes = pages::open(&coordinator.pages_address, pages::wanted());

    let own_before = usage("self").seconds;
    let log = folder.path().join("store/completions.log");
    let (elapsed, seen) = memory::told(&coordinator.process, &log, load.memory_at, || {
        work_all(load, &coordinator.url, &specification, &uploads)
    });
    let own = usage("self").seconds - own_before;
    let its = usage(&coordinator.process.id().to_string());
    let metrics = coordinator.metrics();
    coordinator.stop();
    if pages::wanted() > 0 {
        let told = pages_bytes.load(std::sync::atomic::Ordering::Relaxed) >> 20;
        println!("{} pages were told {told} MB", pages::wanted());
    }

    let store = ReadOnlyStore::open(&folder.path().join("store")).unwrap();
    assert_eq!(
        store.materials_missing(),
        0,
        "all that was acknowledged is there"
    );
    let shares: Vec<usize> = seen.iter().map(|seen| seen.completions.len()).collect();
    let (fewest, most) = (shares.iter().min().unwrap(), shares.iter().max().unwrap());
    // Jobs that are rendered twice for a check are on top.
    let done: usize = shares.iter().sum();
    assert!(done >= load.jobs as usize);
    assert!(*fewest > 0, "a worker starved");
    let jobs_per_second = done as f64 / elapsed;
    let Load {
        workers,
        views,
        side,
        ..
    } = load;
    println!(
        "{workers} workers, {done} jobs of {views} images of {side} x {side} in {elapsed:.1} s: \
         {jobs_per_second:.0} leases and completions/s, {:.0} images/s",
        jobs_per_second * *views as f64
    );
    let lease_p99_ms = tell_calls(&metrics, &seen);
    println!(
        "  {fewest} to {most} jobs a worker; coordinator {:.1} core seconds and {} MB at its peak, \
         all workers {own:.1} core seconds",
        its.seconds,
        its.memory_bytes >> 20
    );
    Figures {
        jobs_per_second,
        lease_p99_ms,
    }
}

/// Tells how long calls took, as workers and as the coordinator saw them, and what the coordinator
/// did for them. Returns what 99 of 100 leases stayed under, in milliseconds.
fn tell_calls(metrics: &str, seen: &[Seen]) -> f64 {
    let mut lease_p99_ms = 0.0;
    for (call, rpc, times) in [
        (
            "lease",
            "Lease",
            sorted(seen.iter().flat_map(|seen| &seen.leases)),
        ),
        (
            "upload",
            "PutBlob",
            sorted(seen.iter().flat_map(|seen| &seen.uploads)),
        ),
        (
            "completion",
            "Complete",
            sorted(seen.iter().flat_map(|seen| &seen.completions)),
        ),
    ] {
        // Small images come with the completion.
        if times.is_empty() {
            continue;
        }
        println!(
            "  {call:<10} p50 {:6.1} ms, p99 {:6.1} ms, longest {:6.1} ms; inside the coordinator \
             p50 under {:.0} ms, p99 under {:.0} ms",
            at(&times, 50),
            at(&times, 99),
            at(&times, 100),
            bucket_ms(metrics, rpc, 0.50),
            bucket_ms(metrics, rpc, 0.99),
        );
        if call == "lease" {
            lease_p99_ms = at(&times, 99);
        }
    }
    let [commits, publications] = ["ledger_commit", "publication"].map(|what| told(metrics, what));
    println!("  {commits}; {publications}");
    lease_p99_ms
}

/// Of every material the uploads of its images, ready to be sent.
fn uploads(specification: &Specification) -> Uploads {
    let views = specification.views.len() as u32;
    let made = |material, view| {
        let bytes = cheap_image(specification, material, view);
        proto::PutBlobRequest {
            digest: Digest::of(&bytes).as_bytes().to_vec(),
            size: bytes.len() as u64,
            data: bytes.into(),
            token: Vec::new(),
            material,
        }
    };
    let materials = 0..specification.materials;
    let materials = materials.map(|material| (0..views).map(|view| made(material, view)).collect());
    Arc::new(materials.collect())
}

/// Runs all workers until nothing is left; returns how long that took, and what each saw.
fn work_all(
    load: &Load,
    url: &str,
    specification: &Specification,
    uploads: &Uploads,
) -> (f64, Vec<Seen>) {
    let all_registered = Barrier::new(DRIVERS + 1);
    thread::scope(|scope| {
        let drivers: Vec<_> = (0..DRIVERS)
            .map(|driver| {
                let all_registered = &all_registered;
                scope.spawn(move || {
                    let runtime = runtime::Builder::new_current_thread()
                        .enable_all()
                        .build()
                        .unwrap();
                    runtime.block_on(async {
                        let numbers = (driver..load.workers).step_by(DRIVERS);
                        let registered = register(numbers, url, specification).await;
                        all_registered.wait();
                        work_together(load, registered, uploads).await
                    })
                })
            })
            .collect();
        all_registered.wait();
        let began = Instant::now();
        let seen = drivers
            .into_iter()
            .flat_map(|driver| driver.join().unwrap());
        let seen = seen.collect();
        (began.elapsed().as_secs_f64(), seen)
    })
}

/// Workers by number, each with its connection and the id it was given.
async fn register(
    numbers: impl Iterator<Item = usize>,
    url: &str,
    specification: &Specification,
) -> Vec<(usize, FarmClient, Vec<u8>)> {
    let mut registered = Vec::new();
    for number in numbers {
        let mut client = proto::client::farm(url, &Credentials::default()).unwrap();
        let message = proto::RegisterRequest {
            name: format!("simulated-{number}"),
            renderer_version: dataset::RENDERER_VERSION.to_owned(),
            specification_hash: specification.hash().as_bytes().to_vec(),
            worker_id: Vec::new(),
            resolves_disputes: false,
        };
        let answer = client.register(with_deadline(message)).await.unwrap();
        registered.push((number, client, answer.into_inner().worker_id));
    }
    registered
}

async fn work_together(
    load: &Load,
    registered: Vec<(usize, FarmClient, Vec<u8>)>,
    uploads: &Uploads,
) -> Vec<Seen> {
    let mut working = JoinSet::new();
    for (number, client, worker_id) in registered {
        let late = load.pause.max(RAMP) * number as u32 / load.workers as u32;
        let uploads = Arc::clone(uploads);
        let pause = load.pause;
        working.spawn(async move {
            tokio::time::sleep(late).await;
            work_until(client, worker_id, uploads, pause, None).await
        });
    }
    working.join_all().await
}

/// Works until nothing is left, or until a time.
async fn work_until(
    mut client: FarmClient,
    worker_id: Vec<u8>,
    uploads: Uploads,
    pause: Duration,
    until: Option<Instant>,
) -> Seen {
    let mut seen = Seen::default();
    while until.is_none_or(|until| Instant::now() < until) {
        let message = proto::LeaseRequest {
            worker_id: worker_id.clone(),
            jobs_max: 1,
            wait_ms: WAIT.as_millis() as u64,
        };
        let asked = Instant::now();
        let leased = client.lease(with_deadline_after(message, WAIT)).await;
        let leased = leased.unwrap().into_inner();
        if leased.finished {
            return seen;
        }
        for job in leased.jobs {
            seen.leases.push(asked.elapsed());
            tokio::time::sleep(pause).await;
            let uploads = &uploads[job.material as usize];
            let bytes: u64 = uploads.iter().map(|upload| upload.size).sum();
            // As real workers do.
            let brings = bytes <= IMAGES_BROUGHT_BYTES_MAX;
            if !brings {
                find_room(&mut client, &job, uploads).await;
            }
            let mut views = Vec::new();
            for upload in uploads {
                let mut image = Bytes::new();
                if brings {
                    image = upload.data.clone();
                } else {
                    let asked = Instant::now();
                    let upload = proto::PutBlobRequest {
                        token: job.token.clone(),
                        ..upload.clone()
                    };
                    client.put_blob(with_deadline(upload)).await.unwrap();
                    seen.uploads.push(asked.elapsed());
                }
                views.push(proto::View {
                    md5: Vec::new(),
                    digest: upload.digest.clone(),
                    size: upload.size,
                    statistics: Some(proto::ErrorStatistics::default()),
                    image,
                    pixels: Some(proto::PixelStatistics::default()),
                });
            }
            let message = proto::CompleteRequest {
                token: job.token,
                material: job.material,
                views,
                seconds: 0.1,
            };
            let asked = Instant::now();
            let done = client.complete(with_deadline(message)).await.unwrap();
            assert!(done.into_inner().missing.is_empty());
            seen.completions.push(asked.elapsed());
        }
    }
    seen
}

/// Asks for room for a job's images until there is some.
async fn find_room(client: &mut FarmClient, job: &proto::Job, uploads: &[proto::PutBlobRequest]) {
    let message = proto::FindMissingBlobsRequest {
        digests: uploads.iter().map(|upload| upload.digest.clone()).collect(),
        token: job.token.clone(),
        material: job.material,
    };
    loop {
        let found = client.find_missing_blobs(with_deadline(message.clone()));
        match found.await {
            Ok(_) => return,
            Err(status) => assert_eq!(status.code(), tonic::Code::ResourceExhausted, "{status}"),
        }
    }
}

/// A coordinator, the program itself.
struct Coordinator {
    process: Process,
    url: String,
    metrics_address: String,
    pages_address: String,
}

impl Coordinator {
    fn start(folder: &Path) -> Self {
        // Ports that were free a moment ago.
        let free = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
        let [metrics_address, pages_address] =
            [0, 1].map(|index: usize| free[index].local_addr().unwrap().to_string());
        drop(free);
        let mut command = Command::new(env!("CARGO_BIN_EXE_brdfarm"));
        command
            .current_dir(folder)
            .args(["coordinator", "serve", "--spec", "spec.toml"])
            .args(["--listen", "127.0.0.1:0", "--metrics", &metrics_address]);
        if pages::wanted() > 0 {
            command.args(["--web", &pages_address]);
        }
        let (process, url) = Process::serving(&mut command).unwrap();
        Self {
            process,
            url,
            metrics_address,
            pages_address,
        }
    }

    fn metrics(&self) -> String {
        let mut stream = TcpStream::connect(&self.metrics_address).unwrap();
        let request = "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    fn stop(self) {
        self.process.signal("TERM");
        assert!(self.process.ended(PATIENCE).success());
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

fn usage(process: &str) -> Usage {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    // The name, in parentheses, can hold anything; user and system time are the 12th and the 13th
    // after it.
    let fields: Vec<&str> = stat
        .rsplit(')')
        .next()
        .unwrap()
        .split_whitespace()
        .collect();
    let ticks: u64 = fields[11..13]
        .iter()
        .map(|field| field.parse::<u64>().unwrap())
        .sum();
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let peak = status
        .lines()
        .find(|line| line.starts_with("VmHWM:"))
        .unwrap();
    let kilobytes: u64 = peak.split_whitespace().nth(1).unwrap().parse().unwrap();
    Usage {
        seconds: ticks as f64 / TICKS_PER_SECOND,
        memory_bytes: kilobytes << 10,
    }
}

/// A connection a worker, and the system's first limit is low.
fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    setrlimit(Resource::Nofile, raised).unwrap();
}
