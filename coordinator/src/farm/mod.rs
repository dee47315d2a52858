//! What a coordinator does, without the network: one operation a call of the protocol.
//!
//! The state is behind one lock, which is held for microseconds and never over a wait. An operation
//! changes the state and submits the change to the commit thread under the lock, then waits without
//! it until the change is durable, and only then answers.

mod completing;
mod error;
mod images;

pub(crate) use completing::Outcome;
pub(crate) use error::FarmError;

use crate::{
    blobs::Blobs,
    commit::{Committer, NotDurable, Pending, Transition},
    file_error::FileError,
    ledger::Ledger,
    limits,
    queue::{Change, Counts, JobState, Policy, Queue},
    roster::Roster,
    running::Options,
    staging::Staging,
    store::Store,
    token::{Token, WorkerId},
};
use dataset::{Digest, RENDERER_VERSION, Specification};
use proto::limits::{LEASE_WAIT_MAX, TOKEN_BYTES};
use std::{
    fs::File,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use tokio::{
    sync::{Notify, Semaphore, watch},
    time::{Instant, timeout_at},
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
}

impl Progress {
    /// Whether nothing is left to do: every material is complete or set aside.
    pub fn is_finished(&self) -> bool {
        self.counts.pending + self.counts.leased == 0
    }
}

struct State {
    queue: Queue,
    staging: Staging,
    roster: Roster,
    bytes_received: u64,
    failures: u64,
    leases_lost: u64,
}

struct Shared {
    state: Mutex<State>,
    // Somebody who waits for work should look again.
    work: Notify,
    progress: watch::Sender<Progress>,
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
    ledger: Arc<Ledger>,
    blobs: Blobs,
    uploads: Arc<Semaphore>,
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
        });
    }
}

impl Farm {
    /// The farm over a store. The file returned is the store's lock: let go of it last.
    pub fn start(
        store: Store,
        options: &Options,
        stopping: watch::Receiver<bool>,
    ) -> Result<(Self, File), FileError> {
        let specification = store.specification().clone();
        let specification_hash = store.specification_hash();
        let mut queue = Queue::new(store.materials_asked(), options.policy);
        let (blobs, state, lock) = store.into_parts();
        for change in state.jobs {
            queue.restore(change, Duration::ZERO);
        }
        let mut changes = Vec::new();
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
            }),
            work: Notify::new(),
            progress: watch::channel(Progress::default()).0,
            views: specification.views.len() as u64,
            started: Instant::now(),
        });
        let ledger = Arc::new(state.ledger);
        let committed = Arc::clone(&shared);
        let committer = Committer::start(
            blobs.clone(),
            state.log,
            Arc::clone(&ledger),
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

    /// Materials set aside with their errors, the first few, and how far the farm is.
    pub fn status(&self) -> (Progress, Vec<(u32, Vec<String>)>) {
        let state = self.shared.lock();
        self.shared.publish(&state);
        let set_aside = state
            .queue
            .set_aside()
            .take(proto::limits::SET_ASIDE_LISTED_MAX)
            .map(|(material, job)| (material, job.errors.clone()))
            .collect();
        (*self.shared.progress.borrow(), set_aside)
    }

    pub fn register(
        &self,
        known: Option<WorkerId>,
        name: String,
        renderer_version: &str,
        specification_hash: Digest,
    ) -> Result<WorkerId, FarmError> {
        if renderer_version != RENDERER_VERSION {
            return Err(FarmError::Incompatible(format!(
                "this worker renders with version {renderer_version:?} and the dataset needs \
                 version {RENDERER_VERSION:?}: install the brdfarm that the coordinator runs"
            )));
        }
        if specification_hash != self.specification_hash {
            return Err(FarmError::Incompatible(format!(
                "this worker reads the specification as {specification_hash} and the coordinator \
                 as {}: install the brdfarm that the coordinator runs",
                self.specification_hash
            )));
        }
        let worker = match known {
            Some(worker) => worker,
            None => WorkerId::from_bytes(random()?),
        };
        let mut state = self.shared.lock();
        if !state
            .roster
            .register(worker, name.clone(), self.shared.now())
        {
            return Err(FarmError::TooManyWorkers(limits::WORKERS_MAX));
        }
        self.shared.publish(&state);
        tracing::info!(%worker, name, "a worker registered");
        Ok(worker)
    }

    /// Leases up to `jobs_max` jobs, waiting up to `wait` for the first. With them comes whether
    /// nothing is left to do.
    pub async fn lease(
        &self,
        worker: WorkerId,
        jobs_max: u32,
        wait: Duration,
    ) -> Result<(Vec<(Token, u32)>, bool), FarmError> {
        let deadline = Instant::now() + wait.min(LEASE_WAIT_MAX);
        let tokens = (0..jobs_max.min(proto::limits::JOBS_PER_CALL_MAX))
            .map(|_| Ok(Token::from_bytes(random()?)))
            .collect::<Result<Vec<Token>, FarmError>>()?;
        let mut stopping = self.stopping.clone();
        loop {
            // Listening begins before looking, so that nothing is missed in between.
            let work = self.shared.work.notified();
            tokio::pin!(work);
            work.as_mut().enable();
            let (leased, pending) = {
                let mut state = self.shared.lock();
                let now = self.shared.now();
                if !state.roster.heard_of(worker, now) {
                    return Err(FarmError::UnknownWorker(worker));
                }
                if *stopping.borrow() {
                    return Ok((Vec::new(), false));
                }
                if state.queue.is_finished() {
                    return Ok((Vec::new(), true));
                }
                let changes = state.queue.claim(worker, &tokens, now);
                let leased: Vec<(Token, u32)> = tokens
                    .iter()
                    .zip(&changes)
                    .map(|(token, change)| (*token, change.material))
                    .collect();
                (leased, self.submit_changes(changes))
            };
            if let Some(pending) = pending {
                pending.durable().await?;
                return Ok((leased, false));
            }
            tokio::select! {
                woken = timeout_at(deadline, work) => if woken.is_err() {
                    return Ok((Vec::new(), false));
                },
                _ = stopping.wait_for(|stopping| *stopping) => {}
            }
        }
    }

    /// Prolongs leases; returns the materials whose lease is lost.
    pub fn renew(&self, worker: WorkerId, renewals: &[(Token, u32, u32)]) -> Vec<u32> {
        let mut state = self.shared.lock();
        let now = self.shared.now();
        state.roster.heard_of(worker, now);
        renewals
            .iter()
            .filter(|(token, material, views_done)| {
                !state.queue.renew(*material, *token, *views_done, now)
            })
            .map(|(_, material, _)| *material)
            .collect()
    }

    /// Records that a holder could not render its material. True when it is set aside now.
    pub async fn fail(
        &self,
        token: Token,
        material: u32,
        error: String,
    ) -> Result<bool, FarmError> {
        let (set_aside, pending) = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            let change = state.queue.fail(material, token, error, now)?;
            state.failures += 1;
            let set_aside = change.record.state == JobState::SetAside;
            self.after_change(&state);
            (set_aside, self.submit_changes(vec![change]))
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(set_aside)
    }

    /// Lets a worker go; returns how many leases went back.
    pub async fn deregister(&self, worker: WorkerId) -> Result<u32, FarmError> {
        let (released, pending) = {
            let mut state = self.shared.lock();
            let changes = state.queue.release(worker, self.shared.now());
            state.roster.remove(worker);
            self.after_change(&state);
            self.shared.publish(&state);
            (changes.len() as u32, self.submit_changes(changes))
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(released)
    }

    /// Takes back leases that ran out and drops images that nobody completed. Returns how long it
    /// can be before the next call.
    pub async fn sweep(&self) -> Result<Duration, NotDurable> {
        let (pending, pause) = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            let changes = state.queue.expire(now);
            for Change { material, record } in &changes {
                let set_aside = record.state == JobState::SetAside;
                tracing::warn!(material, set_aside, "a lease ran out");
            }
            state.leases_lost += changes.len() as u64;
            state.staging.drop_old(now, &self.blobs);
            let State { queue, roster, .. } = &mut *state;
            roster.forget_absent(now, |worker| queue.holds(worker));
            if !changes.is_empty() {
                self.after_change(&state);
            }
            let next = state.queue.next_expiry().unwrap_or(Duration::MAX);
            // Leases that are handed out during the pause run out no sooner than this.
            let longest = limits::SWEEP_INTERVAL_MAX.min(self.policy.lease);
            let pause = next.saturating_sub(now).min(longest);
            (self.submit_changes(changes), pause)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(pause)
    }

    fn submit_changes(&self, changes: Vec<Change>) -> Option<Pending> {
        (!changes.is_empty()).then(|| {
            self.committer.submit(Transition {
                changes,
                ..Transition::default()
            })
        })
    }

    /// Wakes those who wait for a lease when there may be one, or never will be again.
    fn after_change(&self, state: &State) {
        let counts = state.queue.counts();
        if counts.pending > 0 || state.queue.is_finished() {
            self.shared.work.notify_waiters();
        }
    }
}

fn random() -> Result<[u8; TOKEN_BYTES], FarmError> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes).map_err(FarmError::Random)?;
    Ok(bytes)
}
