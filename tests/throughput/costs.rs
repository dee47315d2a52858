//! What calls cost: processor time of a coordinator and of its callers, a call and a batch, with so
//! few clients that nobody waits for a core. These are the service times of `simulation/`, which
//! predicts from them what a thousand clients get.

use super::{
    Coordinator, DRIVERS, TICKS_PER_SECOND, Uploads, raise_open_files, register, uploads, usage,
};
use dataset::Specification;
use limits::protocol::IMAGES_BROUGHT_BYTES_MAX;
use proto::{
    FarmClient,
    client::{with_deadline, with_deadline_after},
};
use std::{
    fs,
    sync::Barrier,
    thread,
    time::{Duration, Instant},
};
use tokio::{runtime, task::JoinSet};

/// Renewals that each client sends.
const RENEWALS: usize = 300;

/// How long a client asks to wait for a job; there always is one.
const WAIT: Duration = Duration::from_secs(1);

/// What clients do together, one after another.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Lease,
    Renew,
    Find,
    Complete,
}

const PHASES: [Phase; 4] = [Phase::Lease, Phase::Renew, Phase::Find, Phase::Complete];

struct Measured {
    clients: usize,
    jobs_each: usize,
    views: usize,
    side: u32,
}

#[test]
#[ignore = "a measurement: tests/throughput.sh costs runs it"]
fn what_calls_cost() {
    for (clients, jobs_each) in [(1, 200), (8, 200), (64, 100)] {
        measure(&Measured {
            clients,
            jobs_each,
            views: 1,
            side: 16,
        });
    }
    for (clients, jobs_each) in [(1, 100), (8, 50), (32, 30)] {
        measure(&Measured {
            clients,
            jobs_each,
            views: 14,
            side: 128,
        });
    }
}

fn measure(measured: &Measured) {
    raise_open_files();
    let folder = tempfile::Builder::new().disable_cleanup(true).tempdir();
    let folder = folder.unwrap();
    let mut specification = Specification::preset();
    specification.materials = (measured.clients * measured.jobs_each) as u32;
    specification.views.truncate(measured.views);
    (specification.image.width, specification.image.height) = (measured.side, measured.side);
    fs::write(folder.path().join("spec.toml"), specification.to_toml()).unwrap();
    let uploads = uploads(&specification);
    let coordinator = Coordinator::start(folder.path());
    let Measured {
        clients,
        views,
        side,
        ..
    } = measured;
    println!("{clients} clients, jobs of {views} images of {side} x {side}");
    let barrier = Barrier::new(DRIVERS.min(*clients) + 1);
    thread::scope(|scope| {
        for driver in 0..DRIVERS.min(*clients) {
            let (barrier, uploads, specification) = (&barrier, &uploads, &specification);
            let url = &coordinator.url;
            scope.spawn(move || drive(driver, measured, barrier, url, specification, uploads));
        }
        barrier.wait();
        for phase in PHASES {
            let before = Totals::read(&coordinator);
            barrier.wait();
            barrier.wait();
            let after = Totals::read(&coordinator);
            after.tell(&before, phase, measured);
        }
    });
    coordinator.stop();
}

/// A thread's share of the clients.
fn drive(
    driver: usize,
    measured: &Measured,
    barrier: &Barrier,
    url: &str,
    specification: &Specification,
    uploads: &Uploads,
) {
    let runtime = runtime::Builder::new_current_thread().enable_all().build();
    runtime.unwrap().block_on(async {
        let numbers = (driver..measured.clients).step_by(DRIVERS);
        let registered = register(numbers, url, specification).await;
        let mut clients: Vec<Client> = registered
            .into_iter()
            .map(|(_, farm, id)| Client {
                farm,
                id,
                jobs: Vec::new(),
                uploads: Uploads::clone(uploads),
            })
            .collect();
        barrier.wait();
        for phase in PHASES {
            barrier.wait();
            let mut all = JoinSet::new();
            for client in clients.drain(..) {
                all.spawn(client.does(phase, measured.jobs_each));
            }
            clients = all.join_all().await;
            barrier.wait();
        }
    });
}

struct Client {
    farm: FarmClient,
    id: Vec<u8>,
    jobs: Vec<proto::Job>,
    uploads: Uploads,
}

impl Client {
    async fn does(mut self, phase: Phase, jobs: usize) -> Self {
        match phase {
            Phase::Lease => self.lease(jobs).await,
            Phase::Renew => self.renew().await,
            Phase::Find => self.find().await,
            Phase::Complete => self.complete().await,
        }
        self
    }

    async fn lease(&mut self, jobs: usize) {
        while self.jobs.len() < jobs {
            let message = proto::LeaseRequest {
                worker_id: self.id.clone(),
                jobs_max: 1,
                wait_ms: WAIT.as_millis() as u64,
            };
            let leased = self.farm.lease(with_deadline_after(message, WAIT)).await;
            self.jobs.extend(leased.unwrap().into_inner().jobs);
        }
    }

    async fn renew(&mut self) {
        for views_done in 0..RENEWALS {
            let job = &self.jobs[views_done % self.jobs.len()];
            let message = proto::RenewRequest {
                worker_id: self.id.clone(),
                renewals: vec![proto::Renewal {
                    token: job.token.clone(),
                    material: job.material,
                    views_done: 0,
                }],
            };
            let renewed = self.farm.renew(with_deadline(message)).await.unwrap();
            assert!(renewed.into_inner().lost.is_empty());
        }
    }

    async fn find(&mut self) {
        for job in &self.jobs {
            let uploads = &self.uploads[job.material as usize];
            let digests = uploads.iter().map(|upload| upload.digest.clone());
            let message = proto::FindMissingBlobsRequest {
                digests: digests.collect(),
                ..Default::default()
            };
            let found = self.farm.find_missing_blobs(with_deadline(message)).await;
            assert_eq!(found.unwrap().into_inner().missing.len(), uploads.len());
        }
    }

    async fn complete(&mut self) {
        for job in self.jobs.drain(..) {
            let uploads = &self.uploads[job.material as usize];
            let bytes: u64 = uploads.iter().map(|upload| upload.size).sum();
            assert!(
                bytes <= IMAGES_BROUGHT_BYTES_MAX,
                "they come with the completion"
            );
            let views = uploads.iter().map(|upload| proto::View {
                md5: Vec::new(),
                digest: upload.digest.clone(),
                size: upload.size,
                statistics: Some(proto::ErrorStatistics::default()),
                image: upload.data.clone(),
                pixels: Some(proto::PixelStatistics::default()),
            });
            let message = proto::CompleteRequest {
                token: job.token,
                material: job.material,
                views: views.collect(),
                seconds: 0.1,
            };
            let done = self.farm.complete(with_deadline(message)).await.unwrap();
            assert!(done.into_inner().missing.is_empty());
        }
    }
}

/// What was used so far, seconds and counts.
struct Totals {
    at: Instant,
    coordinator: f64,
    committing: f64,
    callers: f64,
    kernel: f64,
    commits: f64,
    commit_seconds: f64,
    transitions: f64,
    publications: f64,
    publication_seconds: f64,
}

impl Totals {
    fn read(coordinator: &Coordinator) -> Self {
        let metrics = coordinator.metrics();
        let metric = |name: &str| {
            let line = metrics.lines().find(|line| line.starts_with(name));
            line.and_then(|line| line.rsplit(' ').next())
                .map_or(0.0, |value| value.parse().unwrap())
        };
        let pid = coordinator.process.id();
        Self {
            at: Instant::now(),
            coordinator: usage(&pid.to_string()).seconds,
            committing: thread_seconds(pid, "group commit"),
            callers: usage("self").seconds,
            kernel: kernel_seconds(),
            commits: metric("brdfarm_ledger_commit_seconds_count"),
            commit_seconds: metric("brdfarm_ledger_commit_seconds_sum"),
            transitions: metric("brdfarm_ledger_commit_transitions_sum"),
            publications: metric("brdfarm_publication_seconds_count"),
            publication_seconds: metric("brdfarm_publication_seconds_sum"),
        }
    }

    fn tell(&self, before: &Self, phase: Phase, measured: &Measured) {
        let calls = match phase {
            Phase::Lease | Phase::Find | Phase::Complete => measured.clients * measured.jobs_each,
            Phase::Renew => measured.clients * RENEWALS,
        };
        let elapsed = (self.at - before.at).as_secs_f64();
        if elapsed < 0.005 {
            return;
        }
        let calls = calls as f64;
        let us = |seconds: f64| seconds * 1e6 / calls;
        let coordinator = self.coordinator - before.coordinator;
        let committing = self.committing - before.committing;
        let callers = self.callers - before.callers;
        let kernel = self.kernel - before.kernel;
        let commits = self.commits - before.commits;
        let publications = self.publications - before.publications;
        println!(
            "  {phase:?}: {calls} calls in {elapsed:.2} s; a call: coordinator {:.0} us (of it \
             group commit {:.0}), callers {:.0}, the kernel's threads {:.0}",
            us(coordinator),
            us(committing),
            us(callers),
            us(kernel),
        );
        let transitions = self.transitions - before.transitions;
        let commit_seconds = self.commit_seconds - before.commit_seconds;
        let publication_seconds = self.publication_seconds - before.publication_seconds;
        println!(
            "    {commits} commits of {:.1} transitions, {:.2} ms each, of it {:.2} on a core; \
             {publications} publications, {:.2} ms each",
            transitions / commits.max(1.0),
            commit_seconds / commits.max(1.0) * 1e3,
            committing / commits.max(1.0) * 1e3,
            publication_seconds / publications.max(1.0) * 1e3,
        );
    }
}

/// Processor time of a process's threads of this name.
fn thread_seconds(pid: u32, name: &str) -> f64 {
    let threads = fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    let folders = threads.map(|thread| thread.unwrap().path());
    let named = folders.filter(|folder| {
        fs::read_to_string(folder.join("comm")).is_ok_and(|found| found.trim() == name)
    });
    let nanoseconds = named.filter_map(|folder| {
        let statistics = fs::read_to_string(folder.join("schedstat")).ok()?;
        statistics.split(' ').next()?.parse::<f64>().ok()
    });
    nanoseconds.sum::<f64>() * 1e-9
}

/// Processor time of the kernel's own threads: file system, disk. Other work on the machine counts
/// as well.
fn kernel_seconds() -> f64 {
    let processes = fs::read_dir("/proc").unwrap();
    let statistics =
        processes.filter_map(|process| fs::read_to_string(process.ok()?.path().join("stat")).ok());
    let ticks = statistics.filter_map(|text| {
        // After the name come state and parent; the kernel's threads are children of the second
        // process. User and system time are the 12th and the 13th.
        let fields: Vec<&str> = text.rsplit(')').next()?.split_whitespace().collect();
        let is_kernel = *fields.get(1)? == "2";
        let ticks = |index: usize| fields.get(index)?.parse::<f64>().ok();
        is_kernel.then(|| Some(ticks(11)? + ticks(12)?)).flatten()
    });
    ticks.sum::<f64>() / TICKS_PER_SECOND
}
