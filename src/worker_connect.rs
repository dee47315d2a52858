//! `brdfarm worker connect`: a worker of a coordinator elsewhere.

use crate::connection::CredentialOptions;
use crate::plural::count;
use crate::runtime::Runtime;
use crate::shutdown::Stopped;
use crate::{cores, shutdown};
use clap::{Args, Subcommand};
use renderer::geometry::BackendChoice;
use std::io::{self, Write};
use worker::{RenderFailure, RendererBackend, Summary, Worker};

/// What a worker can be told.
#[derive(Debug, Subcommand)]
pub enum Command {
    Connect(Options),
}

/// Render for a coordinator until nothing is left to do
///
/// Leases materials, renders their views and delivers the images. Waits half a minute for a
/// coordinator that does not answer yet, and an hour for one that stops answering.
///
/// When asked to stop (Ctrl-C, SIGTERM) it delivers what is rendered and hands back the rest. When
/// asked again it ends at once, and the coordinator gives its jobs to others when their leases expire.
#[derive(Debug, Args)]
pub struct Options {
    /// The coordinator, as in http://127.0.0.1:7117; or several coordinators of one farm. If one fails,
    /// the worker turns to the next
    #[arg(value_name = "URL", required = true)]
    urls: Vec<String>,
    /// The worker's name. Failures and blocks are counted for it, so choose one that stays the same
    /// when the worker restarts [default: the machine's name and the process's number]
    #[arg(long)]
    name: Option<String>,
    /// Threads to render with; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
    /// What intersects rays with the scene: auto, native or embree. The images are the same
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    #[command(flatten)]
    credentials: CredentialOptions,
    /// Stay connected when nothing is left to do, for a set that may grow
    #[arg(long)]
    stay: bool,
}

/// Works.
pub fn execute(Command::Connect(options): &Command) -> anyhow::Result<()> {
    let runtime = Runtime::new()?;
    let summary = runtime.block_on(work(options));
    let summary = summary?;
    writeln!(
        io::stdout(),
        "{}, {}; {} failed, {} lost to others",
        count(summary.materials, "material"),
        count(summary.images, "image"),
        summary.failures,
        summary.lost
    )?;
    Ok(())
}

async fn work(options: &Options) -> anyhow::Result<Summary> {
    let defaults = worker::Options::default();
    let worker_options = worker::Options {
        name: options.name.clone().unwrap_or(defaults.name),
        threads: cores::count(options.threads),
        leave_when_finished: !options.stay,
        credentials: options.credentials.load()?,
        ..defaults
    };
    let backend = options.backend;
    let connecting = Worker::connect(&options.urls, worker_options, move |specification| {
        RendererBackend::new(specification, backend)
            .map_err(|error| RenderFailure(error.to_string()))
    });
    let mut asked = shutdown::flag("finishing the views under way")?;
    let worker = tokio::select! {
        worker = connecting => worker?,
        () = shutdown::raised(&mut asked) => {
            return Err(Stopped("stopped before the coordinator answered".to_owned()).into());
        }
    };
    Ok(worker.run(asked).await?)
}
