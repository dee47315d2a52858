//! Several coordinators over one database and one bucket: all of them, the database and the workers
//! killed again and again in one run. Halfway one coordinator is lost for good.
//!
//! Half of the workers know every coordinator, the others a balancer in front of them.

use crate::harness::{Draws, Harness, Process, patience, seed, wait_for};
use crate::postgres;
use crate::proxy::Proxy;
use crate::s3;
use dataset::Digest;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::path::PathBuf;
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// Longer than a process takes to do something on a machine with more workers than cores.
const LEASE_SECONDS: u32 = 4;

struct Size {
    materials: u32,
    samples: u32,
    replicas: usize,
    workers: usize,
    kills_min: u32,
    /// The longest time between two kills; ten times as much once enough were killed.
    pause_ms: u64,
    /// How long whoever was killed is away, at the most.
    away_ms: u64,
}

/// Short enough for every test run.
#[test]
fn random_kills_of_coordinators_and_their_database_lose_and_change_nothing() {
    campaign(&Size {
        materials: 6,
        samples: 64,
        replicas: 2,
        workers: 3,
        kills_min: 5,
        pause_ms: 600,
        away_ms: 1000,
    });
}

/// At least 50 kills in one run of 60 materials: `tests/campaign.sh`.
#[test]
#[ignore = "takes minutes: tests/campaign.sh runs it"]
fn campaign_of_fifty_kills_of_three_coordinators_and_their_database() {
    campaign(&Size {
        materials: 60,
        samples: 256,
        replicas: 3,
        workers: 6,
        kills_min: 50,
        pause_ms: 1500,
        away_ms: 2000,
    });
}

/// Whoever is first to look into the empty place is held until the other has said whose it is.
#[test]
fn coordinators_started_at_one_instant_claim_one_place() {
    let mut harness = Harness::new(2, 16);
    let bucket = s3::Server::start(&harness.path().join("s3"));
    harness.environment = bucket.environment();
    let database = postgres::Server::start("");
    bucket.hold_listing();
    let (harness, database) = (&harness, &database);
    thread::scope(|scope| {
        for number in 0..2 {
            scope.spawn(move || {
                let mut command = replica(harness, database, number, "127.0.0.1:0");
                let serving = Process::serving(&mut command);
                assert!(serving.is_some(), "{}", log(harness, number));
            });
        }
    });
    assert_eq!(bucket.counts()["PUT"].requests, 1);
}

/// A coordinator, which comes back on its address like one that a supervisor starts again.
struct Replica {
    address: String,
    process: Option<Process>,
    // When it is started again; `None` where it never is.
    back_at: Option<Instant>,
}

struct Cluster {
    workers: Vec<Process>,
    replicas: Vec<Replica>,
    balancer: Proxy,
    harness: Harness,
    bucket: s3::Server,
    database: postgres::Server,
    database_back_at: Option<Instant>,
    runtime: Runtime,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Victim {
    Database,
    Replica,
    Worker,
}

impl Cluster {
    fn start(size: &Size) -> Self {
        let mut harness = Harness::new(size.materials, size.samples);
        let bucket = s3::Server::start(&harness.path().join("s3"));
        harness.environment = bucket.environment();
        harness.lease_seconds = LEASE_SECONDS;
        let database = postgres::Server::start("-c fsync=on");
        let replicas = (0..size.replicas).map(|number| {
            let mut command = replica(&harness, &database, number, "127.0.0.1:0");
            let Some((process, url)) = Process::serving(&mut command) else {
                panic!("replica {number} does not start: {}", log(&harness, number));
            };
            Replica {
                address: url.rsplit('/').next().expect("a part").to_owned(),
                process: Some(process),
                back_at: Some(Instant::now()),
            }
        });
        let replicas: Vec<Replica> = replicas.collect();
        let addresses: Vec<String> = replicas.iter().map(|one| one.address.clone()).collect();
        let mut cluster = Self {
            workers: Vec::new(),
            replicas,
            balancer: Proxy::before_all(&addresses),
            harness,
            bucket,
            database,
            database_back_at: None,
            runtime: Runtime::new().expect("a runtime"),
        };
        cluster.workers = (0..size.workers)
            .map(|number| cluster.worker(number))
            .collect();
        cluster
    }

    fn worker(&self, number: usize) -> Process {
        let name = format!("w{number}");
        if number.is_multiple_of(2) {
            let all = self.replicas.iter().map(|replica| replica.address.as_str());
            self.harness.worker_of(&name, &all.collect::<Vec<_>>())
        } else {
            self.harness.worker(&name, &self.balancer.address)
        }
    }

    /// Rows of the database; `None` while it is away.
    fn rows(&self, query: &str) -> Option<Vec<tokio_postgres::Row>> {
        let url = self.database.url();
        self.runtime.block_on(async {
            let connected = tokio_postgres::connect(&url, tokio_postgres::NoTls).await;
            let (client, connection) = connected.ok()?;
            let connection = tokio::spawn(connection);
            let rows = client.query(query, &[]).await.ok();
            connection.abort();
            rows
        })
    }

    fn completed(&self) -> Option<BTreeSet<u64>> {
        let rows = self.rows("SELECT material FROM jobs WHERE stage = 'completed'")?;
        let materials = rows.iter().map(|row| row.get::<_, i64>(0) as u64);
        Some(materials.collect())
    }

    /// Starts again what was killed and has been away for long enough. Nobody else may have ended.
    fn tend(&mut self) {
        let now = Instant::now();
        if self.database_back_at.is_some_and(|at| at <= now) {
            self.database.restart();
            self.database_back_at = None;
        }
        for number in 0..self.replicas.len() {
            let ended = self.replicas[number]
                .process
                .as_mut()
                .is_some_and(Process::has_ended);
            if ended {
                // It may give up when it starts and the database is away, and at no other time.
                let said = fs::read_to_string(served(&self.harness, number));
                assert_eq!(
                    said.ok().as_deref(),
                    Some(""),
                    "replica {number} ended: {}",
                    log(&self.harness, number)
                );
                self.replicas[number].process = None;
            }
            let replica_now = &self.replicas[number];
            if replica_now.process.is_none() && replica_now.back_at.is_some_and(|at| at <= now) {
                let address = &replica_now.address;
                let mut command = replica(&self.harness, &self.database, number, address);
                let out = File::create(served(&self.harness, number)).expect("a file");
                self.replicas[number].process = Some(Process::spawn(command.stdout(out)));
            }
        }
    }

    /// Kills one of a kind; says whether there was one.
    fn kill(&mut self, victim: Victim, away_ms: u64, draws: &mut Draws) -> bool {
        let number = draws.below(60) as usize;
        let back_at = Instant::now() + Duration::from_millis(draws.below(away_ms));
        match victim {
            Victim::Database => {
                if self.database_back_at.is_some() || !self.database.is_ready() {
                    return false;
                }
                self.database.kill();
                self.database_back_at = Some(back_at);
            }
            Victim::Replica => {
                let count = self.replicas.len();
                let replica = &mut self.replicas[number % count];
                let Some(mut process) = replica.process.take() else {
                    return false;
                };
                replica.back_at = Some(back_at);
                if process.has_ended() {
                    return false;
                }
                process.kill();
            }
            Victim::Worker => {
                let number = number % self.workers.len();
                let mut worker = self.workers.remove(number);
                let ended = worker.has_ended();
                worker.kill();
                self.workers.insert(number, self.worker(number));
                return !ended;
            }
        }
        true
    }

    /// What the database and the bucket hold is what an undisturbed run makes.
    fn expect_undisturbed(&self, materials: u32) {
        let harness = &self.harness;
        harness.succeed("run --spec spec.toml --store undisturbed --backend native");
        let log = harness.path().join("undisturbed/completions.log");
        let log = fs::read_to_string(log).expect("a log");
        let entries = log.lines().map(|line| {
            let (_, json) = line.split_once(' ').expect("a checksum");
            images(json)
        });
        let expected: BTreeMap<u64, Value> = entries.collect();
        assert_eq!(expected.len(), materials as usize);
        let rows = self
            .rows("SELECT completion FROM completions")
            .expect("rows");
        let found: BTreeMap<u64, Value> = rows.iter().map(|row| images(row.get(0))).collect();
        assert_eq!(rows.len(), expected.len());
        assert_eq!(found, expected);

        let rows = self.rows("SELECT digest, material, view FROM images");
        let rows = rows.expect("rows");
        let places = rows.iter().map(|row| {
            let digest = row.get::<_, &[u8]>(0).try_into().expect("32 bytes");
            let view = (row.get::<_, i64>(1), row.get::<_, i32>(2));
            (view, Digest::from_bytes(digest))
        });
        let named: BTreeMap<_, Digest> = places.collect();
        let count = 14 * materials as usize;
        assert_eq!((rows.len(), named.len()), (count, count), "each image once");
        let objects = self.bucket.objects("a/set/blobs");
        let bytes = objects
            .iter()
            .map(|path| fs::read(path).expect("an object"));
        let stored: Vec<Digest> = bytes.map(|bytes| Digest::of(&bytes)).collect();
        let (named, once): (BTreeSet<_>, BTreeSet<_>) = (
            named.into_values().collect(),
            stored.iter().copied().collect(),
        );
        assert_eq!(once, named);
        assert_eq!(stored.len(), count);
    }
}

/// The material of a completion, and all that is known of its images.
fn images(completion: &str) -> (u64, Value) {
    let mut completion: Value = serde_json::from_str(completion).expect("JSON");
    let material = completion["material"].as_u64().expect("a completion");
    assert_eq!(completion["views"].as_array().map(Vec::len), Some(14));
    (material, completion["views"].take())
}

fn replica(
    harness: &Harness,
    database: &postgres::Server,
    number: usize,
    address: &str,
) -> Command {
    let arguments = format!(
        "coordinator serve --spec spec.toml --store {} --blobs s3://farm/a/set --listen {address} \
         --lease-seconds {} --check-percent 0",
        database.url(),
        harness.lease_seconds,
    );
    let errors = File::options()
        .create(true)
        .append(true)
        .open(harness.path().join(format!("replica{number}.log")))
        .expect("a log");
    let mut command = harness.command(env!("CARGO_BIN_EXE_brdfarm"), &arguments);
    command.envs(harness.environment.clone()).stderr(errors);
    command
}

/// What a coordinator said on standard output: nothing until it serves.
fn served(harness: &Harness, number: usize) -> PathBuf {
    harness.path().join(format!("replica{number}.out"))
}

fn log(harness: &Harness, number: usize) -> String {
    fs::read_to_string(harness.path().join(format!("replica{number}.log"))).unwrap_or_default()
}

/// One of each kind first, then at random, one or all kinds at once.
fn next_victims(killed: u32, draws: &mut Draws) -> &'static [Victim] {
    match (killed, draws.below(12)) {
        (0, _) | (3.., 0..2) => &[Victim::Database],
        (1, _) | (3.., 2..6) => &[Victim::Replica],
        (2, _) | (3.., 6..11) => &[Victim::Worker],
        _ => &[Victim::Worker, Victim::Replica, Victim::Database],
    }
}

/// Every coordinator that serves says that the set is complete, and it is that of an undisturbed run. Returns how many
/// completions were acknowledged: no material to two workers.
fn expect_complete(cluster: &mut Cluster, size: &Size) -> usize {
    let serving = |cluster: &mut Cluster, number: usize| {
        cluster.tend();
        cluster.harness.address = cluster.replicas[number].address.clone();
        cluster.harness.status()["finished"] == true
    };
    for number in 1..size.replicas {
        wait_for("the end of the set", || serving(cluster, number));
        let status = cluster.harness.status();
        assert_eq!(
            (
                &status["completed"],
                &status["set_aside"],
                &status["disputed"]
            ),
            (&size.materials.into(), &0.into(), &0.into())
        );
    }
    for worker in cluster.workers.drain(..) {
        assert_eq!(worker.ended(patience()).code(), Some(0));
    }
    let acknowledged = cluster.harness.acknowledged();
    let told: BTreeSet<u64> = acknowledged.iter().copied().collect();
    assert_eq!(
        told.len(),
        acknowledged.len(),
        "a material was acknowledged to two workers"
    );
    cluster.expect_undisturbed(size.materials);
    acknowledged.len()
}

fn campaign(size: &Size) {
    let began = Instant::now();
    let mut draws = Draws(seed());
    let mut cluster = Cluster::start(size);
    let mut kills = BTreeMap::<Victim, u32>::new();
    let mut completed = BTreeSet::new();
    while completed.len() < size.materials as usize {
        // At a random instant, or sooner where the set would be complete before enough were killed.
        let killed: u32 = kills.values().sum();
        let slower = if killed < size.kills_min { 1 } else { 10 };
        let pause_ms = slower * draws.below(size.pause_ms);
        let until = Instant::now() + Duration::from_millis(pause_ms);
        let due = ((killed + 1) * size.materials / (size.kills_min + 2)) as usize;
        loop {
            assert!(began.elapsed() < patience(), "the set is never complete");
            cluster.tend();
            let acknowledged = cluster.harness.acknowledged();
            if let Some(now) = cluster.completed() {
                for material in acknowledged {
                    assert!(
                        now.contains(&material),
                        "material {material} was acknowledged and is gone"
                    );
                }
                completed = now;
            }
            if 2 * completed.len() >= size.materials as usize {
                cluster.replicas[0].back_at = None;
                cluster.replicas[0].process = None;
            }
            if Instant::now() >= until || completed.len() >= due {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        for victim in next_victims(killed, &mut draws) {
            if cluster.kill(*victim, size.away_ms, &mut draws) {
                *kills.entry(*victim).or_default() += 1;
            }
        }
    }
    let acknowledged = expect_complete(&mut cluster, size);
    let killed: u32 = kills.values().sum();
    println!(
        "campaign: {killed} kills ({kills:?}) with {} coordinators and {} workers, {} materials and \
         {} images complete, each once, equal to an undisturbed run's; {} completions \
         acknowledged, 0 lost; 0 quarantined; {:.0} s",
        size.replicas,
        size.workers,
        size.materials,
        14 * size.materials,
        acknowledged,
        began.elapsed().as_secs_f64()
    );
    assert!(
        killed >= size.kills_min,
        "only {killed} kills before the set was complete"
    );
}
