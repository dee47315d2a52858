//! `brdfarm coordinator serve`: the coordinator alone.

use crate::plural::count;
use crate::{shutdown, specification};
use clap::{Args, Subcommand};
use coordinator::{Coordinator, Policy, Store};
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// What a coordinator can be told.
#[derive(Debug, Subcommand)]
pub enum Command {
    Serve(Options),
}

/// Hand out jobs to workers and keep what they render
///
/// Serves until it is asked to stop, or until the dataset is complete with --exit-when-complete. A
/// store that exists is resumed; asking for more materials grows it.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SetOptions,
    /// The folder that images, labels and ledger live in
    #[arg(long, default_value = "store", value_name = "DIR")]
    store: PathBuf,
    /// Where to listen; port 0 takes a free one. The URL for workers is printed
    #[arg(long, default_value = "127.0.0.1:7117", value_name = "IP:PORT")]
    listen: SocketAddr,
    /// Allow an address that other machines reach, without encryption and without tokens
    #[arg(long)]
    insecure: bool,
    /// How long a worker may be silent before its work is given to others
    #[arg(long, default_value_t = coordinator::limits::LEASE.as_secs(), value_name = "SECONDS",
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    lease_seconds: u64,
    /// How long one material may take before it is given to another worker
    #[arg(long, default_value_t = coordinator::limits::JOB_DEADLINE.as_secs(), value_name = "SECONDS",
          value_parser = clap::value_parser!(u64).range(1..=31_536_000))]
    job_deadline_seconds: u64,
    /// Percent of the materials that a second worker renders again, to the same bytes or somebody
    /// is barred
    #[arg(long, default_value_t = f64::from(coordinator::limits::CHECKS_PER_MILLION) / 1e4,
          value_name = "PERCENT", value_parser = percent)]
    check_percent: f64,
    /// End once every material is complete
    #[arg(long)]
    exit_when_complete: bool,
}

/// Serves.
pub fn execute(Command::Serve(options): &Command) -> anyhow::Result<()> {
    let specification = options.specification.load()?;
    Coordinator::check(&specification, &options.for_coordinator())?;
    let store = Store::open_or_create(&options.store, &specification)?;
    let runtime = tokio::runtime::Runtime::new()?;
    runtime.block_on(serve(options, store))
}

impl Options {
    fn for_coordinator(&self) -> coordinator::Options {
        coordinator::Options {
            listen: self.listen,
            insecure: self.insecure,
            policy: Policy {
                lease: Duration::from_secs(self.lease_seconds),
                deadline: Duration::from_secs(self.job_deadline_seconds),
                ..Policy::default()
            },
            checks_per_million: (self.check_percent * 1e4).round() as u32,
            ..coordinator::Options::default()
        }
    }
}

fn percent(text: &str) -> Result<f64, String> {
    let percent = text.parse().ok();
    percent
        .filter(|percent| (0.0..=100.0).contains(percent))
        .ok_or_else(|| "a number from 0 to 100 is wanted".to_owned())
}

async fn serve(options: &Options, store: Store) -> anyhow::Result<()> {
    let mut asked = shutdown::flag()?;
    let coordinator = Coordinator::start(store, options.for_coordinator()).await?;
    writeln!(io::stdout(), "listening on {}", coordinator.url())?;
    let outcome = tokio::select! {
        () = shutdown::raised(&mut asked) => Ok(()),
        error = coordinator.failed() => Err(error.into()),
        finished = coordinator.wait_until_finished(), if options.exit_when_complete => {
            coordinator.wait_for_workers_to_leave().await;
            finished.map_err(anyhow::Error::from).and_then(|progress| {
                anyhow::ensure!(
                    progress.counts.set_aside == 0,
                    "{} of {} failed too often and were set aside",
                    progress.counts.set_aside,
                    count(progress.counts.materials, "material")
                );
                Ok(())
            })
        }
    };
    let progress = *coordinator.progress().borrow();
    coordinator.shutdown().await;
    writeln!(
        io::stdout(),
        "{} of {} complete, {} in {}",
        progress.counts.completed,
        count(progress.counts.materials, "material"),
        count(progress.images, "image"),
        options.store.display()
    )?;
    outcome
}
