//! `cargo run --release -p simulation -- KIND`: what a farm would do. docs/scaling.md has what came
//! of it.

#![allow(
    clippy::print_stdout,
    reason = "the figures are what this program is for"
)]

use anyhow::{Context, Result};
use clap::{Parser, ValueEnum};
use limits::protocol::IMAGES_BROUGHT_BYTES_MAX;
use simulation::{
    costs::{BYTES_PER_PIXEL, IMAGE_SECONDS},
    farm::{Farm, Images, Rendering, Store},
    simulate,
};
use std::{
    io::{self, Write},
    time::Duration,
};

/// Simulates a farm of brdfarm and says what keeps it from more jobs a second
///
/// Jobs change hands by the real queue's transitions; what everything costs was measured with few
/// clients (simulation/src/costs.rs).
#[derive(Parser)]
struct Options {
    /// What is simulated
    #[arg(value_enum)]
    kind: Kind,
    /// Workers
    #[arg(long)]
    workers: Option<usize>,
    /// Cores of each worker
    #[arg(long)]
    worker_cores: Option<usize>,
    /// Materials of the set
    #[arg(long)]
    materials: Option<u32>,
    /// Images of a material
    #[arg(long)]
    views: Option<usize>,
    /// Side of a square image, pixels; how long it renders grows with its pixels
    #[arg(long)]
    side: Option<u32>,
    /// Processor time of a material, seconds, the same for all
    #[arg(long)]
    job_seconds: Option<f64>,
    /// Coordinators
    #[arg(long)]
    coordinators: Option<usize>,
    /// Cores of each coordinator
    #[arg(long)]
    coordinator_cores: Option<usize>,
    /// Connections that each coordinator lets in
    #[arg(long)]
    connections_max: Option<usize>,
    /// Cores of the database's machine
    #[arg(long)]
    database_cores: Option<usize>,
    /// Images in a bucket
    #[arg(long)]
    bucket: bool,
    /// Mean time between two deaths of a worker, seconds
    #[arg(long)]
    worker_dies_every: Option<f64>,
    /// When the first coordinator dies, seconds
    #[arg(long)]
    coordinator_dies_at: Option<f64>,
    /// When measuring begins, seconds
    #[arg(long)]
    warm_up: Option<f64>,
    /// When the simulation ends, seconds
    #[arg(long)]
    seconds: Option<f64>,
    /// Everything that is drawn at random follows from it
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Kind {
    /// Workers before one coordinator with a folder
    Files,
    /// Workers before several coordinators with PostgreSQL
    Postgres,
    /// tests/throughput.sh: 1,000 workers on the coordinator's two cores, one small image a job
    Throughput,
    /// The same, where each job takes a second
    ThroughputSecond,
    /// The same, with the preset's 14 images a job and no pause
    ThroughputPreset,
    /// tests/postgres.sh measure: 64 clients, the database on the same two cores
    PostgresMeasure,
}

impl Kind {
    fn farm(self) -> Farm {
        match self {
            Self::Files => Farm::of_workers(1_000),
            Self::Postgres => Farm {
                store: Store::Postgres { cores: Some(16) },
                coordinators: 2,
                ..Farm::of_workers(1_000)
            },
            Self::Throughput => Farm::of_throughput(40_000, 1, 16, Duration::ZERO),
            Self::ThroughputSecond => Farm::of_throughput(20_000, 1, 16, Duration::from_secs(1)),
            Self::ThroughputPreset => Farm::of_throughput(3_000, 14, 128, Duration::ZERO),
            Self::PostgresMeasure => Farm::of_postgres_measure(64, 14),
        }
    }
}

impl Options {
    fn farm(&self) -> Result<Farm> {
        let mut farm = self.kind.farm();
        set(&mut farm.workers.count, self.workers);
        set(&mut farm.workers.cores, self.worker_cores);
        set(&mut farm.materials, self.materials);
        set(&mut farm.coordinators, self.coordinators);
        set(&mut farm.coordinator_cores, self.coordinator_cores);
        set(&mut farm.connections_max, self.connections_max);
        if let Some(cores) = self.database_cores {
            farm.store = Store::Postgres { cores: Some(cores) };
        }
        if self.bucket {
            farm.images = Images::Bucket;
        }
        self.set_jobs(&mut farm)?;
        farm.workers.dies_every = seconds(self.worker_dies_every)?;
        farm.coordinator_dies_at = seconds(self.coordinator_dies_at)?;
        set(&mut farm.warm_up, seconds(self.warm_up)?);
        set(&mut farm.ends, seconds(self.seconds)?);
        farm.seed = self.seed;
        Ok(farm)
    }

    fn set_jobs(&self, farm: &mut Farm) -> Result<()> {
        set(&mut farm.views, self.views);
        set(
            &mut farm.pixels,
            self.side.map(|side| side.saturating_mul(side)),
        );
        let Rendering::LogNormal { sigma, .. } = farm.rendering else {
            return Ok(());
        };
        let bytes = farm.views as f64 * f64::from(farm.pixels) * BYTES_PER_PIXEL;
        farm.brings_images = bytes <= IMAGES_BROUGHT_BYTES_MAX as f64;
        let pixels = f64::from(farm.pixels) / f64::from(128 * 128);
        farm.rendering = match seconds(self.job_seconds)? {
            Some(time) => Rendering::Fixed(time),
            None => Rendering::LogNormal {
                mean_seconds: farm.views as f64 * pixels * IMAGE_SECONDS,
                sigma,
            },
        };
        Ok(())
    }
}

fn set<T>(value: &mut T, given: Option<T>) {
    if let Some(given) = given {
        *value = given;
    }
}

fn seconds(given: Option<f64>) -> Result<Option<Duration>> {
    let time = |seconds: f64| {
        Duration::try_from_secs_f64(seconds).with_context(|| format!("{seconds} s is no time"))
    };
    given.map(time).transpose()
}

fn main() -> Result<()> {
    let options = Options::parse();
    let (figures, _) = simulate(options.farm()?)?;
    let mut out = io::stdout().lock();
    if options.json {
        let mut json = serde_json::to_value(&figures)?;
        json["bottleneck"] = figures.bottleneck().into();
        writeln!(out, "{json:#}")?;
    } else {
        writeln!(out, "{figures}")?;
    }
    Ok(())
}
