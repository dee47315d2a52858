//! `brdfarm coordinator serve`: the coordinator alone.

use crate::connection::security;
use crate::coordinator_health;
use crate::plural::count;
use crate::runtime::Runtime;
use crate::{open_files, pages, plan, shutdown, specification, store_name};
use clap::{Args, Subcommand};
use coordinator::Coordinator;
use coordinator::security::Security;
use datastore::{AnyStore, BlobsPlace, StoreName};
use jobqueue::Policy;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// What a coordinator can be told.
#[derive(Debug, Subcommand)]
pub enum Command {
    Serve(Options),
    Health(coordinator_health::Options),
}

/// Hand out jobs to workers and keep what they render
///
/// Serves until it is asked to stop or, with --exit-when-complete, until the dataset is complete. An
/// existing store is resumed; a larger --materials grows it.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SetOptions,
    /// The store: a folder with images, labels and ledger, or, for any number of coordinators, a
    /// PostgreSQL database with labels and ledger. Its password comes from PGPASSWORD or a password
    /// file
    #[arg(long, default_value = "store", value_name = store_name::VALUE,
          value_parser = store_name::parser())]
    store: StoreName,
    /// Where to keep images instead of in that folder: s3://BUCKET/PREFIX, gs://BUCKET/PREFIX or
    /// az://CONTAINER/PREFIX, to which workers upload directly; if --store is a database, also a folder
    /// that all coordinators reach. Keys and endpoints come from the environment, such as
    /// AWS_ACCESS_KEY_ID. The store remembers the place
    #[arg(long, value_name = "URL|DIR")]
    blobs: Option<BlobsPlace>,
    /// The address to listen on; port 0 takes a free one. Prints the URL for workers
    #[arg(long, default_value = "127.0.0.1:7117", value_name = "IP:PORT")]
    listen: SocketAddr,
    /// A folder with certificate.pem, key.pem and tokens, and with client-authority.pem if clients
    /// must show a certificate. `brdfarm credentials` makes it
    #[arg(long, value_name = "DIR")]
    credentials: Option<PathBuf>,
    /// Allow an address that other machines can reach, without encryption and without tokens
    #[arg(long)]
    insecure: bool,
    /// Serve Prometheus metrics at http://IP:PORT/metrics, to everyone who can reach it
    #[arg(long, value_name = "IP:PORT")]
    metrics: Option<SocketAddr>,
    /// Serve pages for a browser at this address: the farm, the last images, materials, jobs and
    /// workers. With --credentials they are encrypted and ask for the token of a reader or an operator
    #[arg(long, value_name = "IP:PORT")]
    web: Option<SocketAddr>,
    /// How long a worker may be silent before its job is given to another worker
    #[arg(long, default_value_t = limits::LEASE.as_secs(), value_name = "SECONDS",
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    lease_seconds: u64,
    /// How long one material may take before it is given to another worker
    #[arg(long, default_value_t = limits::JOB_DEADLINE.as_secs(), value_name = "SECONDS",
          value_parser = clap::value_parser!(u64).range(1..=31_536_000))]
    job_deadline_seconds: u64,
    /// Space to keep free on the disk of the store, MiB. With less, nothing new is accepted until there
    /// is space again
    #[arg(long, default_value_t = limits::DISK_RESERVE_BYTES >> 20, value_name = "MIB",
          value_parser = clap::value_parser!(u64).range(..=1 << 30))]
    disk_reserve_mib: u64,
    /// Percentage of materials rendered a second time by another worker. If images or statistics
    /// differ, a third worker decides and the liar is blocked. With credentials, the first materials of
    /// each and a few of each at the end are rendered again as well. 0 trusts every worker
    #[arg(long, default_value_t = f64::from(limits::REDUNDANT_PER_MILLION) / 1e4,
          value_name = "PERCENT", value_parser = percent)]
    check_percent: f64,
    /// End once every material is complete
    #[arg(long)]
    exit_when_complete: bool,
}

/// Serves.
pub fn execute(command: &Command) -> anyhow::Result<()> {
    let options = match command {
        Command::Serve(options) => options,
        Command::Health(options) => return coordinator_health::execute(options),
    };
    let for_coordinator = options.for_coordinator()?;
    let runtime = Runtime::new()?;
    let kept = || store_name::kept_specification(&options.store, &runtime);
    let specification = options.specification.load(kept)?;
    Coordinator::check(&specification, &for_coordinator)?;
    if let Some(serving) = options.for_web(&for_coordinator) {
        serving.check()?;
    }
    let blobs = options.blobs.as_ref();
    let store = store_name::open_or_create(&options.store, &specification, blobs, &runtime)?;
    runtime.block_on(serve(options, for_coordinator, store))
}

impl Options {
    fn for_web(&self, coordinator: &coordinator::Options) -> Option<web::Options> {
        Some(web::Options {
            listen: self.web?,
            security: coordinator.security.clone(),
            insecure: self.insecure,
        })
    }

    fn for_coordinator(&self) -> anyhow::Result<coordinator::Options> {
        Ok(coordinator::Options {
            listen: self.listen,
            security: match &self.credentials {
                Some(folder) => security(folder)?,
                None => Security::default(),
            },
            insecure: self.insecure,
            metrics: self.metrics,
            policy: Policy {
                lease: Duration::from_secs(self.lease_seconds),
                deadline: Duration::from_secs(self.job_deadline_seconds),
                ..Policy::default()
            },
            disk_reserve_bytes: self.disk_reserve_mib << 20,
            redundant_per_million: (self.check_percent * 1e4).round() as u32,
            ..coordinator::Options::default()
        })
    }
}

fn percent(text: &str) -> Result<f64, String> {
    let percent = text.parse().ok();
    percent
        .filter(|percent| (0.0..=100.0).contains(percent))
        .ok_or_else(|| "a percentage is a number from 0 to 100".to_owned())
}

async fn serve(
    options: &Options,
    for_coordinator: coordinator::Options,
    store: AnyStore,
) -> anyhow::Result<()> {
    open_files::raise();
    let mut asked = shutdown::flag("finishing the calls under way")?;
    let specification = store.specification().clone();
    let serving = options.for_web(&for_coordinator);
    let coordinator = Coordinator::start(store, for_coordinator).await?;
    let pages = pages::serve(&options.store, &coordinator, serving).await?;
    let there = *coordinator.progress().borrow();
    let views = specification.views.len() as u64;
    let left = (u64::from(there.counts.materials) * views).saturating_sub(there.images);
    if left > 0 {
        writeln!(io::stderr(), "{}", plan::line(&specification, left, None))?;
    }
    let mut addresses = format!("listening on {}\n", coordinator.url());
    if let Some(pages) = &pages {
        addresses.push_str(&format!("pages at {}\n", pages.url()));
    }
    // At once: whoever reads the first line may read no more.
    io::stdout().write_all(addresses.as_bytes())?;
    let outcome = tokio::select! {
        () = shutdown::raised(&mut asked) => Ok(()),
        error = coordinator.failed() => Err(error.into()),
        why = pages::failed(pages.as_ref()) => Err(anyhow::anyhow!(why)),
        finished = coordinator.wait_until_finished(), if options.exit_when_complete => {
            coordinator.wait_for_workers_to_leave().await;
            finished.map_err(anyhow::Error::from).and_then(|progress| {
                anyhow::ensure!(
                    progress.counts.disputed == 0,
                    "{} rendered differently by two workers, and no third worker is left to \
                     decide: serve again, then give `brdfarm jobs resolve`",
                    count(progress.counts.disputed, "material")
                );
                anyhow::ensure!(
                    progress.counts.quarantined == 0,
                    "{} of {} quarantined after repeated failures",
                    progress.counts.quarantined,
                    count(progress.counts.materials, "material")
                );
                Ok(())
            })
        }
    };
    let progress = *coordinator.progress().borrow();
    if let Some(pages) = pages {
        pages.shutdown().await;
    }
    coordinator.shutdown().await;
    let told = writeln!(
        io::stdout(),
        "{} of {} complete, {} in {}",
        progress.counts.completed,
        count(progress.counts.materials, "material"),
        count(progress.images, "image"),
        options.store,
    );
    // A failure counts even where nobody reads the summary any more.
    outcome?;
    Ok(told?)
}
