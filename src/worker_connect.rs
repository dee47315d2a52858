//! `brdfarm worker connect`: a worker of a coordinator elsewhere.

use crate::shutdown;
use clap::{Args, Subcommand};
use renderer::geometry::BackendChoice;
use std::io::{self, Write};
use worker::{RenderFailure, RendererBackend, Summary, Worker};

/// What a worker can be told.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render for a coordinator until nothing is left to do
    Connect(Options),
}

/// Leases materials, renders their views and delivers the images.
///
/// Asked to stop (Ctrl-C, SIGTERM) it delivers what is rendered and hands back the rest; asked
/// again it ends at once, and the coordinator gives its work to others when its leases run out.
#[derive(Debug, Args)]
pub struct Options {
    /// The coordinator, as in http://127.0.0.1:7117
    #[arg(value_name = "URL")]
    url: String,
    /// What logs and the coordinator call this worker, where it is not its process
    #[arg(long)]
    name: Option<String>,
    /// Threads to render with; 0 takes every core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// How rays are traced, which changes no byte: auto, native, embree
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    /// Stay when nothing is left to do, for a set that may grow
    #[arg(long)]
    stay: bool,
}

/// Works.
pub fn execute(Command::Connect(options): &Command) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new()?;
    let summary = runtime.block_on(work(options))?;
    writeln!(
        io::stdout(),
        "{} materials, {} images; {} failed, {} lost to others",
        summary.materials,
        summary.images,
        summary.failures,
        summary.lost
    )?;
    Ok(())
}

async fn work(options: &Options) -> anyhow::Result<Summary> {
    let defaults = worker::Options::default();
    let worker_options = worker::Options {
        name: options.name.clone().unwrap_or(defaults.name),
        threads: options.threads,
        leave_when_finished: !options.stay,
        ..defaults
    };
    let backend = options.backend;
    let connecting = Worker::connect(&options.url, worker_options, move |specification| {
        RendererBackend::new(specification, backend)
            .map_err(|error| RenderFailure(error.to_string()))
    });
    let worker = tokio::select! {
        worker = connecting => worker?,
        asked = shutdown::requested() => {
            asked?;
            anyhow::bail!("stopped before the coordinator answered");
        }
    };
    let (stop, stopping) = shutdown::flag();
    let working = worker.run(stopping);
    tokio::pin!(working);
    tokio::select! {
        summary = &mut working => return Ok(summary?),
        asked = shutdown::requested() => asked?,
    }
    stop.send_replace(true);
    tokio::select! {
        summary = &mut working => Ok(summary?),
        asked = shutdown::requested() => {
            asked?;
            anyhow::bail!("stopped at once: unfinished work goes to others when its lease runs out");
        }
    }
}
