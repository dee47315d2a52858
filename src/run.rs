//! `brdfarm run`: coordinator and workers in one process.

use crate::dataset_command::{show, verify};
use crate::plural::count;
use crate::progress::{self, FarmProgress};
use crate::runtime::Runtime;
use crate::shutdown::Stopped;
use crate::{cores, heap, pages, plan, shutdown, specification, store_name};
use clap::Args;
use coordinator::{Coordinator, Progress, RunningCoordinator};
use datastore::{AnyStore, BlobsPlace, ReadOnlyStore, StoreName};
use export::manifest::{Format, export};
use jobqueue::Policy;
use renderer::geometry::BackendChoice;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tokio::task::JoinSet;
use worker::{RenderFailure, RendererBackend, Worker, WorkerError};

/// Materials on the contact sheet that a run ends with.
const SHEET_MATERIALS_MAX: u32 = 12;

/// Render a dataset on this machine, check it, write its manifest and a contact sheet
///
/// Coordinator and workers run in this one process.
///
/// Give the same command again to resume where it was stopped. If nothing is left to do, it says so.
/// A larger --materials adds materials to the store.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    specification: specification::SetOptions,
    /// The store: a folder with images, labels and ledger, or a PostgreSQL database with labels and
    /// ledger, which others may use too. Its password comes from PGPASSWORD or a password file
    #[arg(long, default_value = "store", value_name = store_name::VALUE,
          value_parser = store_name::parser())]
    store: StoreName,
    /// Where to keep images instead of in that folder: s3://BUCKET/PREFIX, gs://BUCKET/PREFIX or
    /// az://CONTAINER/PREFIX; if --store is a database, also a folder. Keys and endpoints come from the
    /// environment, such as AWS_ACCESS_KEY_ID. The store remembers the place
    #[arg(long, value_name = "URL|DIR")]
    blobs: Option<BlobsPlace>,
    /// Number of workers, each rendering one material at a time; 0 takes one for each core
    #[arg(long, default_value_t = 0, value_name = "N",
          value_parser = clap::value_parser!(u64).range(..=cores::COUNT_MAX))]
    workers: u64,
    /// What intersects rays with the scene: auto, native or embree. The images are the same
    #[arg(long, default_value = "auto")]
    backend: BackendChoice,
    /// How long one material may take. A view cannot be interrupted: if it takes longer, the run ends
    /// with an error
    #[arg(long, default_value_t = limits::JOB_DEADLINE.as_secs(), value_name = "SECONDS",
          value_parser = clap::value_parser!(u64).range(1..=31_536_000))]
    job_deadline_seconds: u64,
    /// Space to keep free on the disk of the store, MiB. With less, nothing new is accepted until there
    /// is space again
    #[arg(long, default_value_t = limits::DISK_RESERVE_BYTES >> 20, value_name = "MIB",
          value_parser = clap::value_parser!(u64).range(..=1 << 30))]
    disk_reserve_mib: u64,
    /// Serve pages for a browser at this address of this machine, such as 127.0.0.1:7118: the run, the
    /// last images, and all materials
    #[arg(long, value_name = "IP:PORT")]
    web: Option<SocketAddr>,
    /// How to say how far the run is
    #[arg(long, value_enum, default_value = "text")]
    progress: progress::Style,
}

/// Failures after which a material is quarantined.
const LOCAL_FAILURES_MAX: u32 = 3;

/// What rendering came to.
struct Rendered {
    progress: Progress,
    images_before: u64,
    elapsed: Duration,
    stopped: bool,
}

/// Renders, checks and sums up.
pub fn execute(options: &Options) -> anyhow::Result<()> {
    // Lives to the end: it is what listens for somebody asking the process to stop.
    let runtime = Runtime::new()?;
    let kept = || store_name::kept_specification(&options.store, &runtime);
    let specification = options.specification.load(kept)?;
    Coordinator::check(&specification, &options.for_coordinator())?;
    if let Some(serving) = options.for_web() {
        serving.check()?;
    }
    let blobs = options.blobs.as_ref();
    let store = store_name::open_or_create(&options.store, &specification, blobs, &runtime)?;
    let workers = cores::count(options.workers);
    let rendered = runtime.block_on(render(options, store, workers))?;

    let progress = rendered.progress;
    let images = progress.images - rendered.images_before;
    if rendered.stopped {
        return Err(Stopped(format!(
            "stopped with {} of {} materials complete: the same command resumes",
            progress.counts.completed, progress.counts.materials
        ))
        .into());
    }
    anyhow::ensure!(
        progress.counts.quarantined == 0,
        "{} of {} materials quarantined after repeated failures (--log warn says why): {}",
        progress.counts.quarantined,
        progress.counts.materials,
        match &options.store {
            StoreName::Folder(_) => "the same command tries them again",
            StoreName::Database(_) => "start a coordinator, then `brdfarm jobs retry`",
        }
    );
    let mut out = io::stdout();
    if images == 0 {
        writeln!(
            out,
            "nothing to do: {} of {} complete",
            count(progress.images, "image"),
            count(progress.counts.materials, "material")
        )?;
    } else {
        let seconds = rendered.elapsed.as_secs_f64();
        writeln!(
            out,
            "rendered {} in {seconds:.1} s: {:.1} images/s with {}, {:.1} MB",
            count(images, "image"),
            images as f64 / seconds,
            count(workers as u64, "worker"),
            progress.bytes_received as f64 / 1e6
        )?;
    }
    heap::give_back();
    let store = ReadOnlyStore::open(&options.store)?;
    if images > 0 {
        verify::check(&store, specification.materials, cores::count(0))?;
    }
    sum_up(&store, &mut out)
}

/// Writes the manifest and the contact sheet if they are missing or out of date, and says where
/// everything is: in the store's folder, or in this one.
fn sum_up(store: &ReadOnlyStore, out: &mut impl Write) -> anyhow::Result<()> {
    let path = store.name().folder().unwrap_or(Path::new(""));
    // The sheet comes first: its pixels are one large piece of memory, which the system has back before
    // the manifest takes small ones.
    let materials = store.specification().materials.min(SHEET_MATERIALS_MAX);
    let sheet = path.join("contact-sheet.png");
    let materials: Vec<u32> = (0..materials).collect();
    let views: Vec<u32> = (0..store.specification().views.len() as u32).collect();
    show::write_sheet(store, &materials, &views, 0.0, &sheet)?;
    heap::give_back();
    let manifest = path.join("manifest.parquet");
    // A store that was asked for more before holds more than this run wanted.
    let exported = export(store, Format::Parquet, true, &manifest)?;
    writeln!(out, "store          {}", store.name())?;
    writeln!(
        out,
        "manifest       {} ({} rows)",
        manifest.display(),
        exported.rows
    )?;
    writeln!(out, "contact sheet  {}", sheet.display())?;
    Ok(())
}

impl Options {
    fn for_web(&self) -> Option<web::Options> {
        Some(web::Options {
            listen: self.web?,
            security: Default::default(),
            insecure: false,
        })
    }

    fn for_coordinator(&self) -> coordinator::Options {
        coordinator::Options {
            // The workers of an earlier run were part of its process, and nobody else knew its address.
            keep_leases: false,
            disk_reserve_bytes: self.disk_reserve_mib << 20,
            // All workers share one machine, so a second rendering could repeat its error.
            redundant_per_million: 0,
            policy: Policy {
                deadline: Duration::from_secs(self.job_deadline_seconds),
                failures_max: LOCAL_FAILURES_MAX,
                // Nobody else is there to do the work of a worker that is blocked.
                jobs_failed_max: u32::MAX,
                ..Policy::default()
            },
            ..coordinator::Options::default()
        }
    }
}

async fn render(options: &Options, store: AnyStore, workers: usize) -> anyhow::Result<Rendered> {
    let mut asked = shutdown::flag("finishing the views under way")?;
    let specification = store.specification().clone();
    let views = specification.views.len() as u64;
    let coordinator = Coordinator::start(store, options.for_coordinator()).await?;
    let pages = pages::serve(&options.store, &coordinator, options.for_web()).await?;
    if let Some(pages) = &pages {
        writeln!(io::stderr(), "pages at {}", pages.url())?;
    }
    let before = *coordinator.progress().borrow();
    let started = Instant::now();
    if before.is_finished() {
        coordinator.shutdown().await;
        return Ok(Rendered {
            progress: before,
            images_before: before.images,
            elapsed: started.elapsed(),
            stopped: false,
        });
    }
    let images = u64::from(before.counts.materials) * views;
    let left = images.saturating_sub(before.images);
    let cores = cores::count(0).min(workers.max(1));
    writeln!(
        io::stderr(),
        "{}",
        plan::line(&specification, left, Some(cores))
    )?;
    let bar = FarmProgress::new(options.progress, images, before.images);
    let (stop, stopping) = watch::channel(false);
    let name = match &options.store {
        StoreName::Folder(_) => "local".to_owned(),
        // Others work on it as well, and are told apart by their names.
        StoreName::Database(_) => worker::Options::default().name,
    };
    let mut working = JoinSet::new();
    for index in 0..workers {
        let url = coordinator.url();
        let worker_options = worker::Options {
            name: format!("{name}-{index}"),
            threads: (cores::count(0) / workers).max(1),
            ..worker::Options::default()
        };
        working.spawn(work(url, worker_options, options.backend, stopping.clone()));
    }
    let outcome = attend(&coordinator, &mut working, &bar, &mut asked, pages.as_ref()).await;
    stop.send_replace(true);
    while working.join_next().await.is_some() {}
    bar.clear();
    let progress = *coordinator.progress().borrow();
    for (material, errors) in coordinator.quarantined().await? {
        tracing::warn!(material, ?errors, "quarantined");
    }
    if let Some(pages) = pages {
        pages.shutdown().await;
    }
    coordinator.shutdown().await;
    Ok(Rendered {
        progress,
        images_before: before.images,
        elapsed: started.elapsed(),
        stopped: outcome?,
    })
}

async fn work(
    url: String,
    options: worker::Options,
    backend: BackendChoice,
    stopping: watch::Receiver<bool>,
) -> Result<(), WorkerError> {
    let worker = Worker::connect(&[url], options, move |specification| {
        RendererBackend::new(specification, backend)
            .map_err(|error| RenderFailure(error.to_string()))
    })
    .await?;
    worker.run(stopping).await.map(|_| ())
}

/// Shows how far the farm is until it is finished (false) or somebody asks it to stop (true).
async fn attend(
    coordinator: &RunningCoordinator,
    working: &mut JoinSet<Result<(), WorkerError>>,
    bar: &FarmProgress,
    asked: &mut watch::Receiver<bool>,
    pages: Option<&web::RunningServer>,
) -> anyhow::Result<bool> {
    let mut progress = coordinator.progress();
    let finished = coordinator.wait_until_finished();
    tokio::pin!(finished);
    loop {
        tokio::select! {
            outcome = &mut finished => {
                // The set is complete, whoever reads that.
                let _ = bar.show(&outcome?);
                return Ok(false);
            }
            () = shutdown::raised(asked) => return Ok(true),
            why = pages::failed(pages) => anyhow::bail!(why),
            Ok(()) = progress.changed() => {
                if bar.show(&progress.borrow_and_update()).is_err() {
                    shutdown::note_reader_gone();
                    return Ok(true);
                }
            }
            Some(ended) = working.join_next() => ended??,
        }
    }
}
