//! What is simulated: a farm by its numbers.

use crate::costs::Costs;
use anyhow::{Result, ensure};
use jobqueue::Policy;
use std::time::Duration;

/// How long a material takes a worker's core.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rendering {
    /// Always the same.
    Fixed(Duration),
    /// Lognormal: the mean, and the standard deviation of its logarithm.
    LogNormal {
        /// The mean, seconds.
        mean_seconds: f64,
        /// The standard deviation of the logarithm.
        sigma: f64,
    },
}

/// Where the jobs are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Store {
    /// In a folder of the only coordinator, by group commit.
    Files,
    /// In PostgreSQL, on a machine of this many cores, or on the coordinator's own where there is
    /// none.
    Postgres {
        /// Cores of the database's machine.
        cores: Option<usize>,
    },
}

/// Where the images are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Images {
    /// In a folder: they pass through a coordinator.
    Folder,
    /// In a bucket: workers send them there.
    Bucket,
    /// Nowhere: only jobs are recorded, as `tests/postgres.sh measure` does.
    None,
}

/// Who works.
#[derive(Clone, Debug)]
pub struct Workers {
    /// How many.
    pub count: usize,
    /// Cores of each: one job renders on all of them.
    pub cores: usize,
    /// Jobs that each holds at one time: one renders while others wait or are delivered.
    pub jobs_held: usize,
    /// Images that each sends at one time.
    pub uploads_at_once: usize,
    /// Whether they ask which images are missing before they deliver.
    pub asks_missing: bool,
    /// Whether they run on the coordinator's machine, on this many threads, and take its cores.
    pub threads_beside_coordinator: Option<usize>,
    /// How often each dies: the mean time between two deaths. It is back after a minute.
    pub dies_every: Option<Duration>,
    /// Over how long they begin, one after another.
    pub ramp: Duration,
}

/// A farm.
#[derive(Clone, Debug)]
pub struct Farm {
    /// Who works.
    pub workers: Workers,
    /// How many materials there are.
    pub materials: u32,
    /// Images of each.
    pub views: usize,
    /// Pixels of each image.
    pub pixels: u32,
    /// Whether a job's images come along with its completion.
    pub brings_images: bool,
    /// How long a material renders.
    pub rendering: Rendering,
    /// Coordinators.
    pub coordinators: usize,
    /// Cores of each.
    pub coordinator_cores: usize,
    /// Connections that each lets in.
    pub connections_max: usize,
    /// Where the jobs are kept.
    pub store: Store,
    /// Where the images are kept.
    pub images: Images,
    /// From a worker to a coordinator and back.
    pub round_trip: Duration,
    /// From a coordinator to the database and back.
    pub database_round_trip: Duration,
    /// Of a million completed materials, how many are rendered a second time.
    pub redundant_per_million: u32,
    /// When the first coordinator dies for good, if it does.
    pub coordinator_dies_at: Option<Duration>,
    /// When measuring begins.
    pub warm_up: Duration,
    /// When the simulation ends, if the set is not complete before.
    pub ends: Duration,
    /// The limits of the queue.
    pub policy: Policy,
    /// What everything costs.
    pub costs: Costs,
    /// Everything that is drawn at random follows from it.
    pub seed: u64,
}

impl Farm {
    /// Real workers of one core with the paper's jobs, before one coordinator with files.
    pub fn of_workers(count: usize) -> Self {
        Self {
            workers: Workers {
                count,
                cores: 1,
                jobs_held: limits::worker::JOBS_HELD,
                uploads_at_once: limits::worker::UPLOADS_AT_ONCE,
                asks_missing: true,
                threads_beside_coordinator: None,
                dies_every: None,
                ramp: Duration::from_secs(10),
            },
            materials: 1_000_000,
            views: 14,
            pixels: 128 * 128,
            brings_images: true,
            rendering: Rendering::LogNormal {
                mean_seconds: 14.0 * crate::costs::IMAGE_SECONDS,
                sigma: crate::costs::MATERIAL_SIGMA,
            },
            coordinators: 1,
            coordinator_cores: 16,
            connections_max: limits::CONNECTIONS_MAX.min(limits::WORKERS_MAX),
            store: Store::Files,
            images: Images::Folder,
            round_trip: Duration::from_micros(500),
            database_round_trip: Duration::from_micros(200),
            redundant_per_million: limits::REDUNDANT_PER_MILLION,
            coordinator_dies_at: None,
            warm_up: Duration::from_secs(20),
            ends: Duration::from_secs(60),
            policy: Policy::default(),
            costs: Costs::measured(),
            seed: 0,
        }
    }

    /// `tests/throughput.sh`: 1,000 workers that render nothing on the two cores of their
    /// coordinator, from the first job to the last.
    pub fn of_throughput(materials: u32, views: usize, side: u32, pause: Duration) -> Self {
        let mut farm = Self::of_workers(1_000);
        farm.workers.jobs_held = 1;
        farm.workers.uploads_at_once = 1;
        farm.workers.asks_missing = false;
        farm.workers.threads_beside_coordinator = Some(8);
        farm.workers.ramp = pause.max(Duration::from_secs(1));
        Self {
            materials,
            views,
            pixels: side * side,
            rendering: Rendering::Fixed(pause),
            coordinator_cores: 2,
            round_trip: Duration::ZERO,
            warm_up: Duration::ZERO,
            ends: Duration::from_secs(3600),
            ..farm
        }
    }

    /// `tests/postgres.sh measure`: clients without a network, the database on the same two cores.
    pub fn of_postgres_measure(clients: usize, views: usize) -> Self {
        let mut farm = Self::of_throughput(1_000_000, views, 1, Duration::ZERO);
        farm.workers.count = clients;
        farm.workers.threads_beside_coordinator = None;
        Self {
            store: Store::Postgres { cores: None },
            images: Images::None,
            database_round_trip: Duration::ZERO,
            redundant_per_million: 0,
            warm_up: Duration::from_secs(2),
            ends: Duration::from_secs(12),
            ..farm
        }
    }

    /// Upload slots of a coordinator.
    pub fn upload_slots(&self) -> usize {
        self.coordinator_cores.clamp(2, limits::UPLOADS_AT_ONCE_MAX)
    }

    /// Whether such a farm can be.
    ///
    /// # Errors
    /// When a number makes no sense, or several coordinators have one folder.
    pub fn check(&self) -> Result<()> {
        ensure!(self.workers.count > 0, "there are no workers");
        ensure!(self.workers.cores > 0, "a worker has a core at least");
        ensure!(
            self.workers.jobs_held > 0 && self.workers.uploads_at_once > 0,
            "a worker holds one job and sends one image at a time at least"
        );
        ensure!(self.views > 0, "a material has a view at least");
        ensure!(self.coordinators > 0, "there is no coordinator");
        ensure!(
            self.coordinators == 1 || self.store != Store::Files,
            "several coordinators need --store postgres: a folder belongs to one"
        );
        ensure!(
            self.coordinator_dies_at.is_none() || self.coordinators > 1,
            "when the only coordinator dies nobody works: take --coordinators 2 or more"
        );
        ensure!(
            self.warm_up < self.ends,
            "measuring begins after {:?} and ends after {:?}: nothing is measured",
            self.warm_up,
            self.ends
        );
        if let Rendering::LogNormal {
            mean_seconds,
            sigma,
        } = self.rendering
        {
            ensure!(
                mean_seconds > 0.0 && mean_seconds < 1e6 && (0.0..10.0).contains(&sigma),
                "a material renders {mean_seconds} s in the mean, with a sigma of {sigma}: take 0 \
                 to a million seconds, and a sigma from 0 to 10"
            );
        }
        Ok(())
    }
}
