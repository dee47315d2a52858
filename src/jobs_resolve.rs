//! `brdfarm jobs resolve`: renders disputed materials on this machine, which decides the disputes.

use crate::connection::CoordinatorOptions;
use crate::plural::count;
use crate::runtime::Runtime;
use crate::shutdown::Stopped;
use crate::{cores, shutdown};
use clap::Args;
use renderer::geometry::BackendChoice;
use std::io::{self, Write};
use worker::{RenderFailure, RendererBackend, Summary, Worker};

/// Decide disputes: materials that two workers rendered differently
///
/// Renders every disputed material on this machine. A worker that delivered something else is blocked,
/// and everything that only it has confirmed is rendered again by others. Needs an operator's token.
#[derive(Debug, Args)]
pub struct Resolve {
    #[command(flatten)]
    coordinator: CoordinatorOptions,
    /// Threads to render with; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    threads: u64,
}

/// Does it.
pub fn execute(options: &Resolve) -> anyhow::Result<()> {
    let runtime = Runtime::new()?;
    let summary = runtime.block_on(resolve(options))?;
    writeln!(
        io::stdout(),
        "{} decided; `brdfarm workers list` shows which workers are blocked",
        count(summary.materials, "material")
    )?;
    // A lost lease is no failure: an earlier decision has settled its dispute.
    anyhow::ensure!(
        summary.failures == 0,
        "{} could not be rendered",
        count(summary.failures, "material")
    );
    Ok(())
}

async fn resolve(options: &Resolve) -> anyhow::Result<Summary> {
    let worker_options = worker::Options {
        threads: cores::count(options.threads),
        credentials: options.coordinator.credentials()?,
        resolves_disputes: true,
        ..worker::Options::default()
    };
    let urls = [options.coordinator.url()];
    let connecting = Worker::connect(&urls, worker_options, |specification| {
        RendererBackend::new(specification, BackendChoice::Auto)
            .map_err(|error| RenderFailure(error.to_string()))
    });
    let mut asked = shutdown::flag("finishing the views under way")?;
    let worker = tokio::select! {
        worker = connecting => worker?,
        () = shutdown::raised(&mut asked) => {
            return Err(Stopped("stopped before the coordinator answered".to_owned()).into());
        }
    };
    let summary = worker.run(asked.clone()).await?;
    if *asked.borrow() {
        return Err(Stopped("stopped: the same command resumes".to_owned()).into());
    }
    Ok(summary)
}
