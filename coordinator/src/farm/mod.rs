//! What a coordinator does, without the network: one operation a call of the protocol.
//!
//! The state is behind one lock, which is held for microseconds and never over a wait. An operation
//! changes the state and submits the change to the commit thread under the lock, then waits without
//! it until the change is durable, and only then answers.

mod completing;
mod error;
mod events;
mod images;
mod leasing;
mod operating;
mod uploads;

pub(crate) use completing::Outcome;
pub(crate) use error::FarmError;
pub(crate) use events::Event;
pub(crate) use operating::{Changed, WorkerReport};
pub(crate) use uploads::Md5;

use crate::{
    blobs::Blobs,
    commit::{Committer, NotDurable, Pending, Transition},
    file_error::FileError,
    ledger::Ledger,
    limits,
    metrics::Metrics,
    queue::{Changes, Counts, Policy, Queue},
    rate::Rate,
    roster::Roster,
    running::Options,
    staging::Staging,
    store::Store,
};
use dataset::{Digest, Specification};
use events::Events;
use std::{
    collections::HashSet,
    fs::File,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use tokio::{
    sync::{Notify, Semaphore, watch},
    time::Instant,
};

/// How far a coordinator is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Materials by state.
    pub counts: Counts,
    /// Images of completed materials.
    pub images: u64,
    /// Bytes of the images completed since the start.
    pub bytes_received: u64,
    /// Workers heard of lately.
    pub workers: u32,
    /// Failures reported by workers since the start.
    pub failures: u64,
    /// Leases that ran out since the start.
    pub leases_lost: u64,
    /// Whether nothing is left to do, now or later.
    pub finished: bool,
}

impl Progress {
    /// Whether nothing is left to do: every material is complete, set aside or cancelled, and every
    /// second rendering that can be had is done.
    pub fn is_finished(&self) -> bool {
        self.finished
    }
}

struct State {
    queue: Queue,
    staging: Staging,
    roster: Roster,
    bytes_received: u64,
    failures: u64,
    leases_lost: u64,
    images_completed: Rate,
    // Images whose objects a completion under way is giving their names.
    settling: HashSet<Digest>,
}

struct Shared {
    state: Mutex<State>,
    // Somebody who waits for work should look again.
    work: Notify,
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
    committer: Committer,
    ledger: Arc<dyn Ledger>,
    blobs: Blobs,
    uploads: Arc<Semaphore>,
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

    fn publish(&self, state: &State) {
        let counts = state.queue.counts();
        self.progress.send_replace(Progress {
            counts,
            images: u64::from(counts.completed) * self.views,
            bytes_received: state.bytes_received,
            workers: state.roster.present(self.now()),
            failures: state.failures,
            leases_lost: state.leases_lost,
            finished: state.queue.is_finished(),
        });
    }
}

impl Farm {
    /// The farm over a store. The file returned is the store's lock: let go of it last.
    pub fn start(
        store: Store,
        options: &Options,
        metrics: Arc<Metrics>,
        stopping: watch::Receiver<bool>,
    ) -> Result<(Self, File), FileError> {
        let specification = store.specification().clone();
        let specification_hash = store.specification_hash();
        let mut queue = Queue::new(store.materials_asked(), options.policy);
        let (blobs, state, lock) = store.into_parts();
        queue.restore(state.kept, Duration::ZERO);
        let mut changes = Changes::default();
        if options.retry_set_aside {
            changes.extend(queue.retry_set_aside(Duration::ZERO));
        }
        if !options.keep_leases {
            changes.extend(queue.release_all(Duration::ZERO));
        }
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                queue,
                staging: Staging::default(),
                roster: Roster::default(),
                bytes_received: 0,
                failures: 0,
                leases_lost: 0,
                images_completed: Rate::default(),
                settling: HashSet::new(),
            }),
            work: Notify::new(),
            progress: watch::channel(Progress::default()).0,
            events: Events::new(),
            views: specification.views.len() as u64,
            started: Instant::now(),
        });
        let ledger: Arc<dyn Ledger> = Arc::new(state.ledger);
        let committed = Arc::clone(&shared);
        let committer = Committer::start(
            blobs.clone(),
            state.log,
            Arc::clone(&ledger),
            Arc::clone(&metrics),
            move |images| {
                let mut state = committed.lock();
                state.staging.published(images);
                committed.publish(&state);
            },
        )?;
        committer.submit(Transition {
            changes,
            ..Transition::default()
        });
        shared.publish(&shared.lock());
        let farm = Self {
            specification,
            specification_hash,
            policy: options.policy,
            shared,
            committer,
            ledger,
            blobs,
            uploads: Arc::new(Semaphore::new(limits::UPLOADS_AT_ONCE_MAX)),
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
        self.committer.failure()
    }

    /// Waits until all that happened so far is durable.
    pub async fn settled(&self) -> Result<(), NotDurable> {
        self.committer.submit(Transition::default()).durable().await
    }

    /// Ends the commit thread when everything submitted is durable. Blocks.
    pub fn close(&self) {
        self.committer.close();
    }

    /// Submits changes, if there are any. Has to be called under the lock that they were made
    /// under.
    fn submit(&self, changes: &Changes) -> Option<Pending> {
        (!changes.is_empty()).then(|| {
            self.committer.submit(Transition {
                changes: changes.clone(),
                ..Transition::default()
            })
        })
    }

    /// Wakes those who wait for a lease when there may be one, or never will be again.
    fn after(&self, state: &State, changes: &Changes) {
        if changes.offer_work() || state.queue.is_finished() {
            self.shared.work.notify_waiters();
        }
    }

    fn tell(&self, event: Event) {
        self.shared.events.tell(event);
    }
}

fn random<const BYTES: usize>() -> Result<[u8; BYTES], FarmError> {
    let mut bytes = [0; BYTES];
    getrandom::fill(&mut bytes).map_err(FarmError::Random)?;
    Ok(bytes)
}
