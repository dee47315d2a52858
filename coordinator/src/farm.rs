//! What a coordinator does, without the network: one operation a call of the protocol.
//!
//! The state is behind one lock, which is held for microseconds and never over a wait. An operation
//! changes the state and submits the change to the commit thread under the lock, then waits without
//! it until the change is durable, and only then answers.

use crate::{
    acceptance::{self, Rejection},
    blobs::Blobs,
    commit::{Committer, NotDurable, Pending, Transition},
    completion::Completion,
    file_error::FileError,
    ledger::{BlobPlace, Ledger, LedgerError},
    limits,
    queue::{Change, Counts, JobState, Policy, Queue, Refusal, Standing},
    roster::Roster,
    staging::{StagedImage, Staging},
    store::Store,
    token::{Token, WorkerId},
};
use dataset::{Digest, ImageHeader, RENDERER_VERSION, Specification};
use proto::limits::{LEASE_WAIT_MAX, TOKEN_BYTES};
use std::{
    fs::File,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use thiserror::Error;
use tokio::{
    sync::{Notify, Semaphore, watch},
    task,
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

/// Why an operation was not done.
#[derive(Debug, Error)]
pub(crate) enum FarmError {
    #[error(transparent)]
    Refused(#[from] Refusal),
    #[error("view {view}: {reason}")]
    Image { view: u32, reason: Rejection },
    #[error(transparent)]
    Rejected(#[from] Rejection),
    #[error("{0}")]
    Invalid(String),
    #[error("{0}")]
    Incompatible(String),
    #[error("worker {0} is not registered here: register (again)")]
    UnknownWorker(WorkerId),
    #[error("{0} workers are registered, and no more are admitted")]
    TooManyWorkers(usize),
    #[error("{0} bytes of images await their completion, and no more are taken: try again later")]
    StagingFull(u64),
    #[error(transparent)]
    NotDurable(#[from] NotDurable),
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    #[error("the system gives no random numbers: {0}")]
    Random(getrandom::Error),
    #[error("the operation was interrupted")]
    Interrupted,
}

/// What became of a completion.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Recorded,
    Repeated,
    Missing(Vec<Digest>),
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
        policy: Policy,
        retry_set_aside: bool,
        stopping: watch::Receiver<bool>,
    ) -> Result<(Self, File), FileError> {
        let specification = store.specification().clone();
        let specification_hash = store.specification_hash();
        let mut queue = Queue::new(store.materials_asked(), policy);
        let (blobs, state, lock) = store.into_parts();
        for change in state.jobs {
            queue.restore(change, Duration::ZERO);
        }
        let retried = if retry_set_aside {
            queue.retry_set_aside(Duration::ZERO)
        } else {
            Vec::new()
        };
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
            changes: retried,
            ..Transition::default()
        });
        shared.publish(&shared.lock());
        let farm = Self {
            specification,
            specification_hash,
            policy,
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

    /// Which of the digests are neither staged nor in the store.
    pub async fn find_missing(&self, digests: Vec<Digest>) -> Result<Vec<Digest>, FarmError> {
        let unstaged: Vec<Digest> = {
            let state = self.shared.lock();
            digests
                .into_iter()
                .filter(|digest| !state.staging.contains(digest))
                .collect()
        };
        let places = self.stored(unstaged).await?;
        Ok(places
            .into_iter()
            .filter(|(_, place)| place.is_none())
            .map(|(digest, _)| digest)
            .collect())
    }

    /// Takes an image in, unless it is here: checks digest, layout and every pixel.
    pub async fn put_blob(
        &self,
        digest: Digest,
        size: u64,
        data: impl AsRef<[u8]> + Send + 'static,
    ) -> Result<(), FarmError> {
        let received = data.as_ref().len() as u64;
        if received != size {
            return Err(FarmError::Invalid(format!(
                "the image was sent as {size} bytes and has {received}"
            )));
        }
        if size > proto::limits::BLOB_BYTES_MAX {
            return Err(FarmError::Invalid(format!(
                "the image has {size} bytes, more than {}",
                proto::limits::BLOB_BYTES_MAX
            )));
        }
        let permit = Arc::clone(&self.uploads).acquire_owned().await;
        let permit = permit.map_err(|_| FarmError::Interrupted)?;
        if self.find_missing(vec![digest]).await?.is_empty() {
            return Ok(());
        }
        let shared = Arc::clone(&self.shared);
        let blobs = self.blobs.clone();
        let film = self.specification.image.clone();
        // The task runs to its end even when the caller goes away, so what it reserves it also
        // gives back.
        task::spawn_blocking(move || {
            let _permit = permit;
            if !shared.lock().staging.reserve(size) {
                return Err(FarmError::StagingFull(limits::STAGED_BYTES_MAX));
            }
            let bytes = data.as_ref();
            let staged = acceptance::check_digest(bytes, digest)
                .and_then(|()| acceptance::inspect(bytes, &film))
                .map_err(FarmError::from)
                .and_then(|header| Ok((header, blobs.stage(digest, bytes)?)));
            let mut state = shared.lock();
            match staged {
                Ok((header, file)) => {
                    let image = StagedImage {
                        file,
                        bytes: size,
                        header,
                        since: shared.now(),
                        publishing: false,
                    };
                    state.staging.insert(image, &blobs);
                    Ok(())
                }
                Err(error) => {
                    state.staging.release(size);
                    Err(error)
                }
            }
        })
        .await
        .map_err(|_| FarmError::Interrupted)?
    }

    /// Records a completion, durably, if its token is the current lease's and every image is here
    /// and is what it should be. Who rendered it is filled in here.
    pub async fn complete(
        &self,
        token: Token,
        completion: Completion,
    ) -> Result<Outcome, FarmError> {
        self.check_completion(&completion)?;
        let unstaged = self.unstaged_images(token, &completion)?;
        let stored = self.stored(unstaged).await?;
        let (outcome, pending) = self.record(token, completion, &stored)?;
        pending.durable().await?;
        Ok(outcome)
    }

    fn unstaged_images(
        &self,
        token: Token,
        completion: &Completion,
    ) -> Result<Vec<Digest>, FarmError> {
        let state = self.shared.lock();
        let fingerprint = completion.fingerprint();
        match state
            .queue
            .standing(completion.material, token, fingerprint)?
        {
            Standing::Repeated => Ok(Vec::new()),
            Standing::Current => {
                let digests = completion.views.iter().map(|view| view.digest);
                Ok(digests
                    .filter(|digest| !state.staging.contains(digest))
                    .collect())
            }
        }
    }

    /// The transition itself, all under one lock. Even where nothing is recorded something is
    /// submitted: the first of two equal completions may still be on its way to the disk, and the
    /// second has to wait for it.
    fn record(
        &self,
        token: Token,
        mut completion: Completion,
        stored: &[(Digest, Option<BlobPlace>)],
    ) -> Result<(Outcome, Pending), FarmError> {
        let material = completion.material;
        let fingerprint = completion.fingerprint();
        let headers =
            acceptance::expected_headers(&self.specification, self.specification_hash, material);
        let mut state = self.shared.lock();
        let nothing = || self.committer.submit(Transition::default());
        if state.queue.standing(material, token, fingerprint)? == Standing::Repeated {
            return Ok((Outcome::Repeated, nothing()));
        }
        let mut missing = Vec::new();
        for (header, view) in headers.iter().zip(&completion.views) {
            let place = BlobPlace {
                material,
                view: header.view,
                bytes: view.bytes,
            };
            if let Some(image) = state.staging.get(&view.digest) {
                check_image(image, view.bytes, header).map_err(|reason| FarmError::Image {
                    view: header.view,
                    reason,
                })?;
            } else if !stored.contains(&(view.digest, Some(place))) {
                missing.push(view.digest);
            }
        }
        if !missing.is_empty() {
            return Ok((Outcome::Missing(missing), nothing()));
        }
        if let Some(worker) = state.queue.holder(material) {
            completion.worker = state.roster.name(worker);
        }
        let now = self.shared.now();
        let change = state.queue.complete(material, token, fingerprint, now)?;
        state.bytes_received += completion.bytes();
        let images = completion
            .views
            .iter()
            .filter_map(|view| state.staging.begin_publishing(&view.digest))
            .collect();
        self.after_change(&state);
        let pending = self.committer.submit(Transition {
            changes: change.into_iter().collect(),
            completion: Some(completion),
            images,
        });
        Ok((Outcome::Recorded, pending))
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

    fn check_completion(&self, completion: &Completion) -> Result<(), FarmError> {
        let (expected, found) = (self.specification.views.len(), completion.views.len());
        if found != expected {
            return Err(FarmError::Invalid(format!(
                "a material has {expected} views, and {found} were reported"
            )));
        }
        let mut numbers = completion.views.iter().flat_map(|view| {
            let statistics = &view.statistics;
            [
                statistics.mean,
                statistics.p95,
                statistics.max,
                statistics.within_target,
            ]
        });
        let sane = |number: f64| number.is_finite() && number >= 0.0;
        if !sane(completion.seconds) || !numbers.all(sane) {
            return Err(FarmError::Invalid(
                "a time or an error statistic is negative or not finite".to_owned(),
            ));
        }
        Ok(())
    }

    /// Of images that are not staged, which are in the store: known to the ledger, and on the disk
    /// with the right size.
    async fn stored(
        &self,
        digests: Vec<Digest>,
    ) -> Result<Vec<(Digest, Option<BlobPlace>)>, FarmError> {
        if digests.is_empty() {
            return Ok(Vec::new());
        }
        let ledger = Arc::clone(&self.ledger);
        let blobs = self.blobs.clone();
        task::spawn_blocking(move || {
            digests
                .into_iter()
                .map(|digest| {
                    let place = match ledger.blob(&digest)? {
                        Some(place) if blobs.size(&digest)? == Some(place.bytes) => Some(place),
                        _ => None,
                    };
                    Ok((digest, place))
                })
                .collect()
        })
        .await
        .map_err(|_| FarmError::Interrupted)?
    }
}

fn check_image(image: &StagedImage, bytes: u64, expected: &ImageHeader) -> Result<(), Rejection> {
    if image.bytes != bytes {
        return Err(Rejection::Identity {
            what: "size in bytes",
            found: image.bytes.to_string(),
            expected: bytes.to_string(),
        });
    }
    acceptance::check_identity(&image.header, expected)
}

fn random() -> Result<[u8; TOKEN_BYTES], FarmError> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes).map_err(FarmError::Random)?;
    Ok(bytes)
}
