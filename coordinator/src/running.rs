//! Starting and stopping a coordinator.

use crate::{
    farm::Farm,
    health,
    metrics::{self, Metrics},
    options::Options,
    report::Progress,
    security::{
        Security,
        admission::{self, Connection},
        guard::Guard,
        unread::Unread,
    },
    service::{ControlService, FarmService},
    supervision::Supervisor,
};
use dataset::{
    Specification,
    specification::{Image, Pixel},
};
use datastore::{AnyStore, Holder};
use imagestore::FileError;
use jobstore::JobStoreError;
use std::{
    error::Error as _,
    fs::File,
    io,
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr},
    sync::Arc,
};
use thiserror::Error;
use tokio::{
    net::TcpListener,
    sync::watch,
    task::spawn_blocking,
    time::{sleep, timeout},
};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{self, Certificate, Server, ServerTlsConfig, server::Router};
use tower::layer::util::{Identity, Stack};

/// Why a coordinator does not serve, or serves no longer.
#[derive(Debug, Error)]
pub enum CoordinatorError {
    /// The address is for others to reach, and nothing protects it.
    #[error(
        "{0} can be reached from other machines, and nothing protects it: pass --credentials, which \
         `brdfarm credentials` makes, or listen on a loopback address, or pass --insecure where the \
         network itself is trusted"
    )]
    Exposed(SocketAddr),
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// An image may be larger than a message.
    #[error(
        "an image of {width} x {height} pixels can have {bytes} bytes, more than the {max} that a \
         worker can send: lower image.width or image.height",
        max = limits::protocol::BLOB_BYTES_MAX
    )]
    ImageTooLarge {
        /// Pixels a row.
        width: u32,
        /// Rows.
        height: u32,
        /// The most that such an image has.
        bytes: u64,
    },
    /// The certificate or its key cannot be used.
    #[error("the certificate, its key or the client authority cannot be used: {0}")]
    Certificate(String),
    /// The store can no longer be written.
    #[error("the store can no longer be written: {0}")]
    Store(String),
    /// A part of it stopped working.
    #[error("the coordinator cannot go on: {0}")]
    Part(String),
    /// The system would not do what was asked.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A coordinator at work. Dropping it stops it at once; [`RunningCoordinator::shutdown`] lets calls
/// under way end.
pub struct RunningCoordinator {
    address: SocketAddr,
    scheme: &'static str,
    farm: Arc<Farm>,
    supervisor: Supervisor,
    stop: watch::Sender<bool>,
    // The last to go: whoever gets the lock next finds a store that nobody writes.
    lock: Option<File>,
}

/// The services of a coordinator without its network and what protects it: calls are made in this
/// process. Nothing sweeps leases that ran out.
pub struct Services<F, C> {
    /// For workers.
    pub farm: F,
    /// For people.
    pub control: C,
    _supervisor: Supervisor,
    _stop: watch::Sender<bool>,
    // The last to go, as in RunningCoordinator.
    _lock: Option<File>,
}

/// Starts a coordinator over a store.
pub struct Coordinator;

impl Coordinator {
    /// Whether a dataset can be served so; asked before a store is made for it.
    ///
    /// # Errors
    /// When the address is exposed without consent, or an image may not fit a message.
    pub fn check(specification: &Specification, options: &Options) -> Result<(), CoordinatorError> {
        let closed = options.security.is_closed() || options.insecure;
        if !options.listen.ip().is_loopback() && !closed {
            return Err(CoordinatorError::Exposed(options.listen));
        }
        check_image_size(&specification.image)
    }

    /// The services over `store`, to be called without a network; fuzzing does so.
    ///
    /// # Errors
    /// When the store cannot be worked with.
    pub async fn services(
        store: impl Into<AnyStore>,
        options: &Options,
    ) -> Result<Services<impl proto::Farm, impl proto::Control>, CoordinatorError> {
        let (stop, stopping) = watch::channel(false);
        let mut supervisor = Supervisor::new(stopping.clone());
        let metrics = Arc::default();
        let (farm, lock) = Farm::start(store.into(), options, metrics, stopping, &mut supervisor)
            .await
            .map_err(|error| CoordinatorError::Store(error.to_string()))?;
        let farm = Arc::new(farm);
        Ok(Services {
            farm: FarmService {
                farm: Arc::clone(&farm),
            },
            control: ControlService { farm },
            _supervisor: supervisor,
            _stop: stop,
            _lock: lock,
        })
    }

    /// Serves `store` until [`RunningCoordinator::shutdown`]. Has to be called inside a runtime.
    pub async fn start(
        store: impl Into<AnyStore>,
        options: Options,
    ) -> Result<RunningCoordinator, CoordinatorError> {
        let store = store.into();
        Self::check(store.specification(), &options)?;
        let listen = options.listen;
        let unable = |source| CoordinatorError::Listen {
            address: listen,
            source,
        };
        let listener = admission::listen(listen).map_err(unable)?;
        let address = listener.local_addr().map_err(unable)?;
        let metrics = Arc::<Metrics>::default();
        let unread = Unread::default();
        let mut server = server(&options.security, unread.clone(), Arc::clone(&metrics))?;
        let metrics_listener = match options.metrics {
            Some(address) => Some(
                TcpListener::bind(address)
                    .await
                    .map_err(|source| CoordinatorError::Listen { address, source })?,
            ),
            None => None,
        };
        let connections = admission::open(listener, options.security.tls.is_none());
        let scheme = match options.security.tls {
            Some(_) => "https",
            None => "http",
        };
        let url = format!("{scheme}://{}", reached_here(address));
        let is_own = matches!(store, AnyStore::Own(_));
        let (stop, stopping) = watch::channel(false);
        let mut supervisor = supervisor(&options, stopping.clone());
        let (farm, lock) = Farm::start(store, &options, metrics, stopping.clone(), &mut supervisor)
            .await
            .map_err(|error| CoordinatorError::Store(error.to_string()))?;
        let farm = Arc::new(farm);
        if let Some(lock) = lock.as_ref().filter(|_| is_own)
            && let Err(error) = Holder::here(url).announce(lock)
        {
            tracing::warn!(%error, "`brdfarm status --store` will not find this coordinator");
        }
        if let Some(listener) = metrics_listener {
            let metrics = serve_metrics(Arc::clone(&farm), listener, stopping.clone());
            supervisor.spawn("metrics", metrics);
        }
        let (health, health_service) = tonic_health::server::health_reporter();
        health::say(&health, true).await;
        let watching = health::watch(health, Arc::clone(&farm), stopping.clone());
        supervisor.spawn("health", watching);
        let server = serve(
            server.add_service(health_service),
            Arc::clone(&farm),
            connections,
            stopping.clone(),
        );
        supervisor.spawn("server", server);
        supervisor.spawn("unread", unread.watch(stopping.clone()));
        supervisor.spawn("sweep", sweep(Arc::clone(&farm), stopping));
        tracing::info!(%address, "the coordinator listens");
        Ok(RunningCoordinator {
            address,
            scheme,
            farm,
            supervisor,
            stop,
            lock,
        })
    }
}

impl RunningCoordinator {
    /// The service for people, for a caller in this process. Checks no role.
    pub fn control(&self) -> ControlService {
        ControlService {
            farm: Arc::clone(&self.farm),
        }
    }

    /// The address it listens on.
    pub fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// The URL that workers on this machine connect to.
    pub fn url(&self) -> String {
        format!("{}://{}", self.scheme, self.address)
    }

    /// How far it is, now and whenever that changes.
    pub fn progress(&self) -> watch::Receiver<Progress> {
        self.farm.progress()
    }

    /// Waits until nothing is left to do, and all of it is durable.
    pub async fn wait_until_finished(&self) -> Result<Progress, CoordinatorError> {
        let mut progress = self.farm.progress();
        tokio::select! {
            _ = progress.wait_for(Progress::is_finished) => {}
            error = self.failed() => return Err(error),
        }
        let settled = self.farm.settled().await;
        settled.map_err(|error| CoordinatorError::Store(error.to_string()))?;
        Ok(*self.farm.progress().borrow())
    }

    /// Waits until every worker has taken leave, or for as long as [`limits::LEAVE_GRACE`]: workers
    /// that learn that nothing is left to do leave, and would look in vain for a coordinator that
    /// went first.
    pub async fn wait_for_workers_to_leave(&self) {
        let mut progress = self.farm.progress();
        let left = progress.wait_for(|progress| progress.workers == 0);
        if timeout(limits::LEAVE_GRACE, left).await.is_err() {
            tracing::warn!("some workers did not take leave");
        }
    }

    /// Waits until the store can no longer be written, or a part of the coordinator stops working;
    /// either takes a fault.
    pub async fn failed(&self) -> CoordinatorError {
        let mut of_store = self.farm.failure();
        let mut of_part = self.supervisor.failure();
        tokio::select! {
            why = of_store.wait_for(Option::is_some) => CoordinatorError::Store(match why {
                Ok(why) => why.clone().unwrap_or_default(),
                Err(_) => "it is closed".to_owned(),
            }),
            // The supervisor is ours.
            Ok(why) = of_part.wait_for(Option::is_some) => {
                CoordinatorError::Part(why.clone().unwrap_or_default())
            }
        }
    }

    /// Materials quarantined, the first few, with their errors.
    pub async fn quarantined(&self) -> Result<Vec<(u32, Vec<String>)>, CoordinatorError> {
        let quarantined = self.farm.quarantined().await;
        quarantined.map_err(|error| CoordinatorError::Store(error.to_string()))
    }

    /// Takes no more calls, lets those under way end, makes everything durable and lets go of the
    /// store.
    pub async fn shutdown(self) {
        let Self {
            farm,
            supervisor,
            stop,
            lock,
            ..
        } = self;
        stop.send_replace(true);
        if !supervisor.end(limits::STOP_GRACE).await {
            tracing::warn!("calls under way were cut off");
        }
        let cleared = timeout(limits::STOP_GRACE, farm.uploads_cleared());
        if cleared.await.is_err() {
            tracing::warn!("uploads that are no longer needed stay");
        }
        let closed = spawn_blocking(move || {
            farm.close();
            drop(farm);
        });
        if closed.await.is_err() {
            tracing::error!("closing the store failed");
        }
        drop(lock);
        tracing::info!("the coordinator stopped");
    }
}

type GuardedServer = Server<Stack<Guard, Identity>>;

type GuardedRouter = Router<Stack<Guard, Identity>>;

#[cfg(not(test))]
fn supervisor(_: &Options, stopping: watch::Receiver<bool>) -> Supervisor {
    Supervisor::new(stopping)
}

#[cfg(test)]
fn supervisor(options: &Options, stopping: watch::Receiver<bool>) -> Supervisor {
    Supervisor::with_panic_in(stopping, options.panics)
}

fn server(
    security: &Security,
    unread: Unread,
    metrics: Arc<Metrics>,
) -> Result<GuardedServer, CoordinatorError> {
    let mut server = Server::builder()
        .concurrency_limit_per_connection(limits::protocol::CALLS_PER_CONNECTION_MAX)
        .max_concurrent_streams(limits::protocol::CALLS_PER_CONNECTION_MAX as u32)
        .http2_max_header_list_size(limits::HEADER_BYTES_MAX)
        .http2_keepalive_interval(Some(limits::protocol::KEEPALIVE_INTERVAL))
        .http2_keepalive_timeout(Some(limits::protocol::KEEPALIVE_TIMEOUT))
        .timeout(limits::protocol::LEASE_WAIT_MAX + limits::protocol::CALL_DEADLINE);
    if let Some(tls) = &security.tls {
        let identity = transport::Identity::from_pem(&tls.certificate, &tls.key);
        let mut config = ServerTlsConfig::new()
            .identity(identity)
            .timeout(limits::SILENCE_MAX);
        if let Some(authority) = &tls.client_authority {
            config = config.client_ca_root(Certificate::from_pem(authority));
        }
        server = server.tls_config(config).map_err(|error| {
            let cause = error.source().map(|cause| format!(": {cause}"));
            CoordinatorError::Certificate(format!("{error}{}", cause.unwrap_or_default()))
        })?;
    }
    Ok(server.layer(Guard::new(security.tokens.clone(), unread, metrics)))
}

/// Where this machine reaches an address that may stand for all of its own.
fn reached_here(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

async fn serve(
    server: GuardedRouter,
    farm: Arc<Farm>,
    connections: ReceiverStream<Result<Connection, io::Error>>,
    mut stopping: watch::Receiver<bool>,
) -> Result<(), String> {
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(proto::DESCRIPTORS)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1();
    let reflection = match reflection {
        Ok(reflection) => reflection,
        Err(error) => unreachable!("the descriptors were compiled with the program: {error}"),
    };
    let stop = async move {
        // An error means that the coordinator was dropped: stop as well.
        drop(stopping.wait_for(|stopping| *stopping).await);
    };
    let for_workers = FarmService {
        farm: Arc::clone(&farm),
    };
    let served = server
        .add_service(reflection)
        .add_service(proto::farm_server(for_workers))
        .add_service(proto::control_server(ControlService { farm }))
        .serve_with_incoming_shutdown(connections, stop)
        .await;
    served.map_err(|error| error.to_string())
}

async fn serve_metrics(
    farm: Arc<Farm>,
    listener: TcpListener,
    mut stopping: watch::Receiver<bool>,
) -> Result<(), String> {
    tokio::select! {
        served = metrics::serve(listener, move || farm.metrics_text()) => {
            served.map_err(|error| error.to_string())
        }
        _ = stopping.wait_for(|stopping| *stopping) => Ok(()),
    }
}

async fn sweep(farm: Arc<Farm>, mut stopping: watch::Receiver<bool>) -> Result<(), String> {
    loop {
        let pause = match farm.sweep().await {
            Ok(pause) => pause,
            // The store says itself why nothing can be recorded any more.
            Err(JobStoreError::NotDurable(error)) => {
                drop(stopping.wait_for(|stopping| *stopping).await);
                return Err(error.to_string());
            }
            Err(error) => {
                tracing::warn!(%error, "leases that ran out cannot be looked for");
                limits::SWEEP_INTERVAL_MAX
            }
        };
        tokio::select! {
            () = sleep(pause) => {}
            _ = stopping.wait_for(|stopping| *stopping) => return Ok(()),
        }
    }
}

fn check_image_size(image: &Image) -> Result<(), CoordinatorError> {
    let Image { width, height, .. } = *image;
    let sample_bytes = match image.pixel {
        Pixel::Half => 2,
        Pixel::Float => 4,
    };
    // What does not compress is stored as it is.
    let pixels = u64::from(width) * u64::from(height);
    let bytes = 3 * sample_bytes * pixels + limits::IMAGE_OVERHEAD_BYTES_MAX;
    if bytes > limits::protocol::BLOB_BYTES_MAX {
        return Err(CoordinatorError::ImageTooLarge {
            width,
            height,
            bytes,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use datastore::Store;

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_panic_in_any_task_ends_the_coordinator_with_its_reason() {
        for task in [
            "publisher",
            "metrics",
            "health",
            "server",
            "unread",
            "sweep",
        ] {
            let folder = tempfile::tempdir().unwrap();
            let mut specification = Specification::preset();
            specification.materials = 2;
            let store = Store::open_or_create(folder.path(), &specification).unwrap();
            let options = Options {
                metrics: Some(([127, 0, 0, 1], 0).into()),
                panics: Some(task),
                ..Options::default()
            };
            let coordinator = Coordinator::start(store, options).await.unwrap();
            let failed = timeout(limits::STOP_GRACE, coordinator.failed()).await;
            let said = failed.expect(task).to_string();
            let why = "it panicked: a panic that a test asked for";
            assert_eq!(said, format!("the coordinator cannot go on: {task}: {why}"));
            let waited = coordinator.wait_until_finished().await;
            assert!(matches!(waited, Err(CoordinatorError::Part(_))));
            coordinator.shutdown().await;
        }
    }
}
