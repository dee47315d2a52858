//! What a coordinator does, without the network: one operation a call of the protocol.
//!
//! Jobs are the job store's. What is kept here is of this process alone: who called lately, images
//! that wait for their completion, figures. It is behind locks that are held for microseconds and
//! never over a wait.

mod completing;
mod error;
mod events;
mod images;
mod leasing;
mod operating;
mod staging;
mod uploads;

pub(crate) use completing::{Outcome, RenderedImage, RenderedMaterial};
pub(crate) use error::FarmError;
pub(crate) use events::Event;
pub(crate) use operating::WorkerReport;
pub(crate) use uploads::Md5;

use crate::{
    metrics::Metrics, options::Options, presence::Presence, rate::Rate, report::Progress,
    security::Tokens, supervision::Supervisor, upload_slots::UploadSlots,
};
use dataset::{Digest, Specification};
use datastore::{AnyStore, SharedStore, Store};
use events::Events;
use futures_util::FutureExt;
use imagestore::{blobs::Blobs, inspector::Inspector};
use jobqueue::{Policy, Queue, Selection, Stage};
use jobstore::{
    JobStore, JobStoreContext, JobStoreError, JobsOrder, LocalJobStore, Overview, Publisher,
};
use std::{
    collections::HashSet,
    fs::File,
    num::NonZero,
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::Ordering},
    thread,
    time::Duration,
};
use tokio::{sync::watch, time::Instant};

struct State {
    overview: Overview,
    presence: Presence,
    // Of the images of completed materials at the start.
    bytes_before: u64,
    images_completed: Rate,
    // Images whose objects a completion under way is giving their names.
    settling: HashSet<Digest>,
}

struct Shared {
    state: Mutex<State>,
    progress: watch::Sender<Progress>,
    // Has a receiver for each completion whose uploads are not removed yet.
    clearing: watch::Sender<()>,
    events: Events,
    views: u64,
    started: Instant,
}

/// A coordinator's state and operations.
pub(crate) struct Farm {
    pub specification: Arc<Specification>,
    pub specification_hash: Digest,
    pub policy: Policy,
    shared: Arc<Shared>,
    job_store: Arc<dyn JobStore>,
    context: Arc<JobStoreContext>,
    publisher: Publisher,
    uploads: UploadSlots,
    inspector: Arc<Inspector>,
    redundant_per_million: u32,
    // None where anybody may call anything.
    tokens: Option<Tokens>,
    metrics: Arc<Metrics>,
    stopping: watch::Receiver<bool>,
}

impl Shared {
    // Nothing that runs under the lock panics half way through a change.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }

    fn publish(&self, state: &State, context: &JobStoreContext) {
        let Overview {
            counts, finished, ..
        } = state.overview;
        self.progress.send_replace(Progress {
            counts,
            images: u64::from(counts.completed) * self.views,
            bytes_received: context.bytes_received.load(Ordering::Relaxed),
            workers: state.presence.present(self.now()),
            failures: context.failures.load(Ordering::Relaxed),
            leases_lost: context.leases_lost.load(Ordering::Relaxed),
            finished,
        });
    }
}

impl Farm {
    /// The farm over a store. The file returned is the store's lock: let go of it last.
    pub async fn start(
        store: AnyStore,
        options: &Options,
        metrics: Arc<Metrics>,
        stopping: watch::Receiver<bool>,
        supervisor: &mut Supervisor,
    ) -> Result<(Self, Option<File>), FarmError> {
        let specification = Arc::new(store.specification().clone());
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                overview: Overview::default(),
                presence: Presence::default(),
                bytes_before: 0,
                images_completed: Rate::default(),
                settling: HashSet::new(),
            }),
            progress: watch::channel(Progress::default()).0,
            clearing: watch::channel(()).0,
            events: Events::new(),
            views: specification.views.len() as u64,
            started: Instant::now(),
        });
        let (job_store, context, lock) = match store {
            AnyStore::Own(store) => own_job_store(*store, options, &metrics, &shared).await?,
            AnyStore::Shared(store) => shared_job_store(*store, options, &metrics, &shared).await?,
        };
        let meter = Arc::<Metrics>::clone(&metrics);
        let (publisher, publishing) = Publisher::new(Arc::clone(&context), meter);
        supervisor.spawn_helper("publisher", publishing.map(Ok));
        let farm = Self {
            specification_hash: specification.hash(),
            inspector: Arc::new(Inspector::new(Arc::clone(&specification))),
            specification,
            policy: options.queue_policy(),
            shared,
            job_store,
            context,
            publisher,
            uploads: UploadSlots::new(uploads_at_once()),
            redundant_per_million: options.redundant_share(),
            tokens: options.security.tokens.clone(),
            metrics,
            stopping,
        };
        Ok((farm, lock))
    }

    pub fn progress(&self) -> watch::Receiver<Progress> {
        self.shared.progress.subscribe()
    }

    pub fn failure(&self) -> watch::Receiver<Option<String>> {
        self.job_store.failure()
    }

    /// Whether the next call would be answered.
    pub async fn probe(&self) -> Result<(), JobStoreError> {
        self.context.blobs.check_room()?;
        self.job_store.publish_overview().await
    }

    /// Waits until all that happened so far is durable.
    pub async fn settled(&self) -> Result<(), JobStoreError> {
        self.job_store.settled().await
    }

    /// Ends when everything under way is durable. Blocks.
    pub fn close(&self) {
        self.job_store.close();
    }

    fn publish(&self, state: &State) {
        self.shared.publish(state, &self.context);
    }

    fn emit(&self, event: Event) {
        self.shared.events.emit(event);
    }
}

/// Checking an image keeps a core busy: more at one time than there are cores only hold up leases
/// and completions. Two at least, as one may be waiting for the disk.
fn uploads_at_once() -> usize {
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    cores.clamp(2, limits::UPLOADS_AT_ONCE_MAX)
}

/// A job store, what it shares with its farm, and the lock of its store.
type Opened = (Arc<dyn JobStore>, Arc<JobStoreContext>, Option<File>);

async fn own_job_store(
    store: Store,
    options: &Options,
    metrics: &Arc<Metrics>,
    shared: &Arc<Shared>,
) -> Result<Opened, FarmError> {
    let mut queue = Queue::new(store.materials_asked(), options.queue_policy());
    let (blobs, recovered, lock) = store.into_parts();
    queue.restore(recovered.kept, Duration::ZERO);
    shared.lock().bytes_before = recovered.image_bytes;
    let context = context(blobs, options, shared);
    let started = shared.started;
    let job_store = LocalJobStore::start(
        queue,
        recovered.log,
        Arc::new(recovered.ledger),
        Arc::<Metrics>::clone(metrics),
        Arc::clone(&context),
        Box::new(move || started.elapsed()),
    )?;
    if options.retry_quarantined {
        let quarantined = Selection::new(Vec::new(), vec![Stage::Quarantined]);
        job_store.order(JobsOrder::Retry, &quarantined).await?;
    }
    if !options.keep_leases {
        job_store.release_all().await?;
    }
    Ok((Arc::new(job_store), context, Some(lock)))
}

async fn shared_job_store(
    store: SharedStore,
    options: &Options,
    metrics: &Arc<Metrics>,
    shared: &Arc<Shared>,
) -> Result<Opened, FarmError> {
    let context = context(store.blobs, options, shared);
    let job_store = jobstore_postgres::job_store(
        store.database,
        options.queue_policy(),
        Arc::<Metrics>::clone(metrics),
        Arc::clone(&context),
    );
    Ok((job_store.await?, context, store.staging_lock))
}

fn context(blobs: Blobs, options: &Options, shared: &Arc<Shared>) -> Arc<JobStoreContext> {
    let told = Arc::clone(shared);
    let blobs = blobs.keeping_free(options.disk_reserve_bytes);
    let context = JobStoreContext::new(blobs, move |around, overview| {
        let mut state = told.lock();
        state.overview = overview;
        told.publish(&state, around);
    });
    Arc::new(context.staging_at_most(options.staged_bytes_max))
}

fn random<const BYTES: usize>() -> Result<[u8; BYTES], FarmError> {
    let mut bytes = [0; BYTES];
    getrandom::fill(&mut bytes).map_err(FarmError::Random)?;
    Ok(bytes)
}
