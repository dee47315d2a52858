//! What a coordinator does, without the network: one operation a call of the protocol.
//!
//! Jobs are the board's. What is kept here is of this process alone: who called lately, images that
//! wait for their completion, figures. It is behind locks that are held for microseconds and never
//! over a wait.

mod completing;
mod error;
mod events;
mod images;
mod leasing;
mod operating;
mod uploads;

pub(crate) use completing::{BroughtImage, Outcome};
pub(crate) use error::FarmError;
pub(crate) use events::Event;
pub(crate) use operating::WorkerReport;
pub(crate) use uploads::Md5;

use crate::{
    hands::Hands, metrics::Metrics, options::Options, rate::Rate, report::Progress, roster::Roster,
};
use dataset::{Digest, Specification};
use datastore::{AnyStore, SharedStore, Store};
use events::Events;
use imagestore::blobs::Blobs;
use jobqueue::{Policy, Queue, Selection, Stage};
use jobstore::{Board, BoardError, JobsOrder, LocalBoard, Overview, Surroundings};
use jobstore_postgres::{PostgresBoard, Presence};
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
    roster: Roster,
    // Of the images of completed materials at the start.
    bytes_before: u64,
    images_completed: Rate,
    // Images whose objects a completion under way is giving their names.
    settling: HashSet<Digest>,
}

struct Shared {
    state: Mutex<State>,
    progress: watch::Sender<Progress>,
    events: Events,
    views: u64,
    started: Instant,
}

/// A coordinator's state and operations.
pub(crate) struct Farm {
    pub specification: Specification,
    pub specification_hash: Digest,
    pub policy: Policy,
    shared: Arc<Shared>,
    board: Arc<dyn Board>,
    surroundings: Arc<Surroundings>,
    uploads: Hands,
    checks_per_million: u32,
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

    fn publish(&self, state: &State, surroundings: &Surroundings) {
        let Overview {
            counts, finished, ..
        } = state.overview;
        self.progress.send_replace(Progress {
            counts,
            images: u64::from(counts.completed) * self.views,
            bytes_received: surroundings.bytes_received.load(Ordering::Relaxed),
            workers: state.roster.present(self.now()),
            failures: surroundings.failures.load(Ordering::Relaxed),
            leases_lost: surroundings.leases_lost.load(Ordering::Relaxed),
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
    ) -> Result<(Self, Option<File>), FarmError> {
        let specification = store.specification().clone();
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                overview: Overview::default(),
                roster: Roster::default(),
                bytes_before: 0,
                images_completed: Rate::default(),
                settling: HashSet::new(),
            }),
            progress: watch::channel(Progress::default()).0,
            events: Events::new(),
            views: specification.views.len() as u64,
            started: Instant::now(),
        });
        let (board, surroundings, lock) = match store {
            AnyStore::Own(store) => own_board(*store, options, &metrics, &shared).await?,
            AnyStore::Shared(store) => shared_board(*store, options, &metrics, &shared).await?,
        };
        let farm = Self {
            specification_hash: specification.hash(),
            specification,
            policy: options.policy,
            shared,
            board,
            surroundings,
            uploads: Hands::new(uploads_at_once()),
            checks_per_million: options.checks_per_million,
            metrics,
            stopping,
        };
        Ok((farm, lock))
    }

    pub fn progress(&self) -> watch::Receiver<Progress> {
        self.shared.progress.subscribe()
    }

    pub fn failure(&self) -> watch::Receiver<Option<String>> {
        self.board.failure()
    }

    /// Waits until all that happened so far is durable.
    pub async fn settled(&self) -> Result<(), BoardError> {
        self.board.settled().await
    }

    /// Ends when everything under way is durable. Blocks.
    pub fn close(&self) {
        self.board.close();
    }

    fn publish(&self, state: &State) {
        self.shared.publish(state, &self.surroundings);
    }

    fn tell(&self, event: Event) {
        self.shared.events.tell(event);
    }
}

/// Checking an image keeps a core busy: more at one time than there are cores only hold up leases
/// and completions. Two at least, as one may be waiting for the disk.
fn uploads_at_once() -> usize {
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    cores.clamp(2, limits::UPLOADS_AT_ONCE_MAX)
}

/// A board, what it shares with its farm, and the lock of its store.
type Opened = (Arc<dyn Board>, Arc<Surroundings>, Option<File>);

async fn own_board(
    store: Store,
    options: &Options,
    metrics: &Arc<Metrics>,
    shared: &Arc<Shared>,
) -> Result<Opened, FarmError> {
    let mut queue = Queue::new(store.materials_asked(), options.policy);
    let (blobs, recovered, lock) = store.into_parts();
    queue.restore(recovered.kept, Duration::ZERO);
    shared.lock().bytes_before = recovered.image_bytes;
    let surroundings = surroundings(blobs, shared);
    let started = shared.started;
    let board = LocalBoard::start(
        queue,
        recovered.log,
        Arc::new(recovered.ledger),
        Arc::<Metrics>::clone(metrics),
        Arc::clone(&surroundings),
        Box::new(move || started.elapsed()),
    )?;
    if options.retry_set_aside {
        let set_aside = Selection::new(Vec::new(), vec![Stage::SetAside]);
        board.order(JobsOrder::Retry, &set_aside).await?;
    }
    if !options.keep_leases {
        board.release_all().await?;
    }
    Ok((Arc::new(board), surroundings, Some(lock)))
}

async fn shared_board(
    store: SharedStore,
    options: &Options,
    metrics: &Arc<Metrics>,
    shared: &Arc<Shared>,
) -> Result<Opened, FarmError> {
    let surroundings = surroundings(store.blobs, shared);
    let board = PostgresBoard::new(
        store.database,
        options.policy,
        Presence::default(),
        Arc::<Metrics>::clone(metrics),
        Arc::clone(&surroundings),
    );
    board.look().await?;
    Ok((Arc::new(board), surroundings, store.staging_lock))
}

fn surroundings(blobs: Blobs, shared: &Arc<Shared>) -> Arc<Surroundings> {
    let told = Arc::clone(shared);
    Arc::new(Surroundings::new(blobs, move |around, overview| {
        let mut state = told.lock();
        state.overview = overview;
        told.publish(&state, around);
    }))
}

fn random<const BYTES: usize>() -> Result<[u8; BYTES], FarmError> {
    let mut bytes = [0; BYTES];
    getrandom::fill(&mut bytes).map_err(FarmError::Random)?;
    Ok(bytes)
}
