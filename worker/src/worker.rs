//! The worker: registers, then leases, renders and delivers until there is nothing left to do.

use crate::{
    connection::{CallError, Connection},
    delivery::{Delivered, deliver, report_failure},
    fetched_mesh::with_mesh,
    job::{Held, Job, RenderedJob, Unrendered, render_views},
    render::{Render, RenderFailure},
    upload::Uploader,
};
use dataset::{RENDERER_VERSION, Specification};
use proto::{
    DeregisterRequest, GetDatasetRequest, LeaseRequest, LeaseResponse, RegisterRequest,
    RegisterResponse, RenewRequest, Renewal, client::Credentials,
};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering},
    },
    time::Duration,
};
use thiserror::Error;
use tokio::{
    sync::{Semaphore, watch},
    task::{JoinSet, spawn_blocking},
    time::{Instant, sleep, sleep_until, timeout},
};
use tonic::Code;
use tracing::{Instrument, info_span};

/// How a worker works.
#[derive(Clone, Debug)]
pub struct Options {
    /// What the farm knows it by: failures and blocks are counted by name.
    pub name: String,
    /// What it shows to the coordinator, and whom it believes.
    pub credentials: Credentials,
    /// Threads that render; 0 takes one for each of the machine's.
    pub threads: usize,
    /// Whether it renders what is disputed and nothing else, and decides it: with an operator's token.
    pub resolves_disputes: bool,
    /// Whether to leave when nothing is left to do, rather than to wait for the set to grow.
    pub leave_when_finished: bool,
    /// How long the coordinator may be away before the worker gives up.
    pub away_max: Duration,
    /// How long the first connection is tried for.
    pub connect_max: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            name: default_name(),
            credentials: Credentials::default(),
            threads: 0,
            resolves_disputes: false,
            leave_when_finished: true,
            away_max: limits::worker::AWAY_MAX,
            connect_max: limits::worker::CONNECT_MAX,
        }
    }
}

/// The machine's name and the process's number.
fn default_name() -> String {
    let system = rustix::system::uname();
    let machine = system.nodename().to_string_lossy().into_owned();
    format!("{machine}-{}", std::process::id())
}

/// Why a worker does not work, or no longer.
#[derive(Debug, Error)]
pub enum WorkerError {
    /// The URL names no coordinator.
    #[error("{0}")]
    Url(String),
    /// The coordinator cannot be reached.
    #[error("cannot work for {url}: {reason}")]
    Away {
        /// Where it should be.
        url: String,
        /// For how long, and what the network said.
        reason: String,
    },
    /// The coordinator does not want this worker.
    #[error("the coordinator refuses this worker: {0}")]
    Refused(String),
    /// The coordinator sent a specification that cannot be read.
    #[error("the coordinator's specification cannot be read: {0}")]
    Specification(String),
    /// The coordinator sent something else than the mesh that its specification names.
    #[error("the coordinator's mesh cannot be used: {0}; ask whoever runs the coordinator")]
    Mesh(String),
    /// This machine cannot render the dataset.
    #[error("the renderer cannot start: {0}")]
    Renderer(RenderFailure),
    /// A view takes longer than a whole job may, and its thread cannot be stopped.
    #[error(
        "material {material} was not rendered within {} s and cannot be interrupted: start this \
         worker again",
        .deadline.as_secs()
    )]
    Wedged {
        /// What is being rendered.
        material: u32,
        /// How long a job may take.
        deadline: Duration,
    },
    /// The system would not start the threads.
    #[error("the rendering threads cannot start: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// What a worker did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Materials completed.
    pub materials: u64,
    /// Images in them.
    pub images: u64,
    /// Materials that could not be rendered, or whose images were refused.
    pub failures: u64,
    /// Materials whose lease was lost.
    pub lost: u64,
    /// Time spent rendering what was completed.
    pub rendering: Duration,
}

/// A worker that a coordinator has admitted.
pub struct Worker {
    urls: String,
    options: Options,
    connection: Connection,
    id: Vec<u8>,
    lease: Duration,
    deadline: Duration,
    specification: Arc<Specification>,
    render: Arc<dyn Render>,
    uploader: Uploader,
    pool: Arc<rayon::ThreadPool>,
    // One job renders at a time, with all threads.
    rendering: Arc<Semaphore>,
    held: Held,
    tally: Tally,
}

#[derive(Default)]
struct Tally {
    materials: AtomicU64,
    images: AtomicU64,
    failures: AtomicU64,
    lost: AtomicU64,
    rendering_us: AtomicU64,
}

impl Worker {
    /// Asks a coordinator for its dataset, prepares the renderer that `prepare` makes for it, and
    /// registers. `urls` are the coordinators of one farm, at least one: where one does not answer,
    /// the next is asked. Has to be called inside a runtime.
    ///
    /// # Errors
    /// When no coordinator is to be reached in time, when it refuses this worker (the sentence
    /// says what to install), and when the renderer cannot start.
    pub async fn connect<R: Render>(
        urls: &[String],
        options: Options,
        prepare: impl FnOnce(&Specification) -> Result<R, RenderFailure> + Send + 'static,
    ) -> Result<Self, WorkerError> {
        let named = urls.join(", ");
        let failed = |error: CallError| WorkerError::of(&named, error);
        let connection = Connection::new(urls, &options.credentials, options.away_max);
        let connection = connection.map_err(WorkerError::Url)?;
        let dataset = connection
            .patient_for(options.connect_max)
            .call(GetDatasetRequest {}, async |mut client, request| {
                client.get_dataset(request).await
            })
            .await
            .map_err(failed)?;
        let specification = Specification::from_json(&dataset.specification_json)
            .map_err(|error| WorkerError::Specification(error.to_string()))?;
        // Before the mesh is fetched and the renderer prepared: a worker that is not wanted should hear so
        // at once.
        let registered = register(&connection, &options, &[], &specification).await;
        let RegisterResponse {
            worker_id,
            lease_ms,
            deadline_ms,
        } = registered.map_err(failed)?;
        // Kept as long as the worker: a coordinator that it registers with again has the same.
        let specification = with_mesh(&connection, specification, failed).await?;
        let specification = Arc::new(specification);
        let prepared = Arc::clone(&specification);
        let render = spawn_blocking(move || prepare(&prepared))
            .await
            .unwrap_or_else(|_| Err(RenderFailure("it panicked".to_owned())))
            .map_err(WorkerError::Renderer)?;
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(options.threads)
            .thread_name(|index| format!("render {index}"))
            .build()?;
        Ok(Self {
            urls: named,
            options,
            connection,
            id: worker_id,
            lease: Duration::from_millis(lease_ms),
            deadline: Duration::from_millis(deadline_ms),
            specification,
            render: Arc::new(render),
            uploader: Uploader::default(),
            pool: Arc::new(pool),
            rendering: Arc::new(Semaphore::new(1)),
            held: Held::default(),
            tally: Tally::default(),
        })
    }

    /// Works until nothing is left to do, or until `shutdown` becomes true (or its sender goes):
    /// then what is rendered is still delivered, and the rest is handed back.
    ///
    /// # Errors
    /// When the coordinator is away for too long, or refuses the worker.
    pub async fn run(self, mut shutdown: watch::Receiver<bool>) -> Result<Summary, WorkerError> {
        let worker = Arc::new(self);
        let (stop, stopping) = watch::channel(false);
        let mut slots = JoinSet::new();
        for _ in 0..limits::worker::JOBS_HELD {
            slots.spawn(slot(Arc::clone(&worker), stopping.clone()));
        }
        let mut renewal = JoinSet::new();
        renewal.spawn(renew_for_ever(Arc::clone(&worker)));

        let mut result = Ok(());
        let mut cut_off = None;
        loop {
            tokio::select! {
                ended = slots.join_next() => match ended {
                    None => break,
                    Some(Ok(Ok(()))) => {}
                    Some(Ok(Err(stopped))) => {
                        let wedged = matches!(stopped, Stopped::Wedged(_));
                        result = Err(worker.error(stopped));
                        stop.send_replace(true);
                        if wedged {
                            // Whatever waits for the rendering threads waits in vain.
                            slots.shutdown().await;
                        }
                    }
                    Some(Err(error)) => tracing::error!(%error, "a job ended badly"),
                },
                () = raised(&mut shutdown), if cut_off.is_none() => {
                    stop.send_replace(true);
                    cut_off = Some(Instant::now() + limits::worker::STOP_GRACE);
                }
                () = sleep_until(cut_off.unwrap_or_else(Instant::now)), if cut_off.is_some() => {
                    tracing::warn!("deliveries under way are cut off");
                    slots.shutdown().await;
                }
            }
        }
        renewal.shutdown().await;
        worker.leave().await;
        result.map(|()| worker.tally.summary())
    }

    async fn lease(&self) -> Result<LeaseResponse, CallError> {
        let message = LeaseRequest {
            worker_id: self.id.clone(),
            jobs_max: 1,
            wait_ms: limits::worker::LEASE_WAIT.as_millis() as u64,
        };
        loop {
            let leased = self
                .connection
                .call_and_wait(
                    message.clone(),
                    limits::worker::LEASE_WAIT,
                    async |mut client, request| client.lease(request).await,
                )
                .await;
            match leased {
                // A coordinator that restarted knows the leases and not the worker.
                Err(CallError::Refused(status)) if status.code() == Code::NotFound => {
                    let options = &self.options;
                    register(&self.connection, options, &self.id, &self.specification).await?;
                }
                leased => return leased,
            }
        }
    }

    async fn work(
        self: &Arc<Self>,
        job: &Arc<Job>,
        stopping: &watch::Receiver<bool>,
    ) -> Result<(), Stopped> {
        let rendered = match self.render(job, stopping).await {
            Ok(rendered) => rendered,
            Err(Unrendered::Interrupted) => {
                if job.lost.load(Ordering::Relaxed) {
                    self.tally.lost.fetch_add(1, Ordering::Relaxed);
                }
                return Ok(());
            }
            Err(Unrendered::Failed(RenderFailure(reason))) => {
                self.tally.failures.fetch_add(1, Ordering::Relaxed);
                return Ok(report_failure(&self.connection, job, reason).await?);
            }
            Err(Unrendered::Wedged) => {
                self.tally.failures.fetch_add(1, Ordering::Relaxed);
                let reason = format!("it took more than {} s", self.deadline.as_secs());
                // Tried once: this worker is of no more use.
                let line = self.connection.patient_for(Duration::ZERO);
                drop(report_failure(&line, job, reason).await);
                return Err(Stopped::Wedged(job.material));
            }
        };
        match deliver(&self.connection, &self.uploader, job, &rendered).await? {
            Delivered::Recorded => {
                tracing::info!(seconds = rendered.time.as_secs_f64(), "completed");
                self.tally.completed(&rendered);
            }
            Delivered::Lost => {
                self.tally.lost.fetch_add(1, Ordering::Relaxed);
            }
            Delivered::Refused => {
                self.tally.failures.fetch_add(1, Ordering::Relaxed);
            }
        }
        Ok(())
    }

    async fn render(
        self: &Arc<Self>,
        job: &Arc<Job>,
        stopping: &watch::Receiver<bool>,
    ) -> Result<RenderedJob, Unrendered> {
        let permit = Arc::clone(&self.rendering).acquire_owned().await;
        let Ok(permit) = permit else {
            unreachable!("the semaphore is never closed");
        };
        let worker = Arc::clone(self);
        let rendered_job = Arc::clone(job);
        let stopping = stopping.clone();
        let rendered = spawn_blocking(move || {
            let _permit = permit;
            let material = worker.specification.material(rendered_job.material);
            let views = worker.specification.views.len() as u32;
            let render = worker.render.as_ref();
            let stopped = || *stopping.borrow();
            worker
                .pool
                .install(|| render_views(render, &rendered_job, &material, views, stopped))
        });
        match timeout(self.deadline, rendered).await {
            Ok(Ok(rendered)) => rendered,
            Ok(Err(_)) => {
                let reason = "the rendering threads failed".to_owned();
                Err(Unrendered::Failed(RenderFailure(reason)))
            }
            Err(_) => Err(Unrendered::Wedged),
        }
    }

    async fn renew(&self) {
        let jobs = self.held.all();
        if jobs.is_empty() {
            return;
        }
        let message = RenewRequest {
            worker_id: self.id.clone(),
            renewals: jobs
                .iter()
                .map(|job| Renewal {
                    token: job.token.clone(),
                    material: job.material,
                    views_done: job.views_done.load(Ordering::Relaxed),
                })
                .collect(),
        };
        // Impatient: the next renewal is due soon, and a coordinator that is away takes no leases
        // back.
        let renewed = self
            .connection
            .patient_for(self.lease / (2 * limits::worker::RENEWALS_PER_LEASE))
            .call(message, async |mut client, request| {
                client.renew(request).await
            })
            .await;
        match renewed {
            Ok(answer) => {
                let lost = |job: &&Arc<Job>| answer.lost.contains(&job.material);
                for job in jobs.iter().filter(lost) {
                    job.lost.store(true, Ordering::Relaxed);
                }
            }
            Err(error) => tracing::warn!(%error, "leases could not be renewed"),
        }
    }

    async fn leave(&self) {
        let message = DeregisterRequest {
            worker_id: self.id.clone(),
        };
        let line = self.connection.patient_for(Duration::ZERO);
        let left = line.call(message, async |mut client, request| {
            client.deregister(request).await
        });
        // Should it not arrive, the leases run out instead.
        match timeout(limits::worker::LEAVE_DEADLINE, left).await {
            Ok(Ok(answer)) => tracing::info!(handed_back = answer.released, "left"),
            Ok(Err(error)) => tracing::debug!(%error, "left without a word"),
            Err(_) => tracing::debug!("left without a word"),
        }
    }
}

/// Leases and works off one job after another.
async fn slot(worker: Arc<Worker>, mut stopping: watch::Receiver<bool>) -> Result<(), Stopped> {
    let mut blocked = String::new();
    loop {
        let mut stopped = stopping.clone();
        let leased = tokio::select! {
            leased = worker.lease() => leased?,
            _ = stopped.wait_for(|stopping| *stopping) => return Ok(()),
        };
        if leased.barred != blocked {
            blocked = leased.barred;
            if blocked.is_empty() {
                tracing::info!("the coordinator lets this worker work again");
            } else {
                tracing::warn!(
                    reason = blocked,
                    "the coordinator gives this worker no work"
                );
            }
        }
        if leased.draining {
            return Ok(());
        }
        if leased.finished {
            if worker.options.leave_when_finished {
                return Ok(());
            }
            tokio::select! {
                () = sleep(limits::worker::IDLE_PAUSE) => {}
                _ = stopping.wait_for(|stopping| *stopping) => return Ok(()),
            }
        }
        for proto::Job { token, material } in leased.jobs {
            let span = info_span!("job", material, lease = %short(&token));
            let job = Arc::new(Job {
                token,
                material,
                views_done: AtomicU32::new(0),
                lost: AtomicBool::new(false),
            });
            worker.held.add(Arc::clone(&job));
            span.in_scope(|| tracing::debug!("leased"));
            let worked = worker.work(&job, &stopping).instrument(span).await;
            worker.held.remove(&job);
            worked?;
        }
        if *stopping.borrow() {
            return Ok(());
        }
    }
}

async fn renew_for_ever(worker: Arc<Worker>) {
    let interval = worker.lease / limits::worker::RENEWALS_PER_LEASE;
    loop {
        sleep(interval).await;
        worker.renew().await;
    }
}

async fn register(
    connection: &Connection,
    options: &Options,
    known: &[u8],
    specification: &Specification,
) -> Result<RegisterResponse, CallError> {
    let message = RegisterRequest {
        name: options.name.clone(),
        renderer_version: RENDERER_VERSION.to_owned(),
        specification_hash: specification.hash().as_bytes().to_vec(),
        worker_id: known.to_vec(),
        resolves_disputes: options.resolves_disputes,
    };
    connection
        .call(message, async |mut client, request| {
            client.register(request).await
        })
        .await
}

/// As the coordinator's log names the lease: enough to tell one from another, too few to use.
fn short(token: &[u8]) -> String {
    token
        .iter()
        .take(4)
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

impl Tally {
    fn completed(&self, rendered: &RenderedJob) {
        let images = rendered.views.len() as u64;
        let time_us = rendered.time.as_micros() as u64;
        self.materials.fetch_add(1, Ordering::Relaxed);
        self.images.fetch_add(images, Ordering::Relaxed);
        self.rendering_us.fetch_add(time_us, Ordering::Relaxed);
    }

    fn summary(&self) -> Summary {
        Summary {
            materials: self.materials.load(Ordering::Relaxed),
            images: self.images.load(Ordering::Relaxed),
            failures: self.failures.load(Ordering::Relaxed),
            lost: self.lost.load(Ordering::Relaxed),
            rendering: Duration::from_micros(self.rendering_us.load(Ordering::Relaxed)),
        }
    }
}

/// Why a slot works no longer.
enum Stopped {
    Call(CallError),
    Wedged(u32),
}

impl From<CallError> for Stopped {
    fn from(error: CallError) -> Self {
        Self::Call(error)
    }
}

impl Worker {
    fn error(&self, stopped: Stopped) -> WorkerError {
        match stopped {
            Stopped::Call(error) => WorkerError::of(&self.urls, error),
            Stopped::Wedged(material) => WorkerError::Wedged {
                material,
                deadline: self.deadline,
            },
        }
    }
}

impl WorkerError {
    fn of(url: &str, error: CallError) -> Self {
        match error {
            CallError::Refused(status) => Self::Refused(status.message().to_owned()),
            CallError::Away(..) | CallError::BucketAway(..) => Self::Away {
                url: url.to_owned(),
                reason: error.to_string(),
            },
        }
    }
}

/// Waits until the flag is true or its sender is gone. Lets go of the flag's lock at once, which
/// would keep a future that holds it from moving between threads.
async fn raised(flag: &mut watch::Receiver<bool>) {
    drop(flag.wait_for(|raised| *raised).await);
}
