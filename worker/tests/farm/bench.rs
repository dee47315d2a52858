//! A store, coordinators and workers for a test.

use crate::cheap_image::{cheap_image, small_specification};
use coordinator::{Coordinator, Options, RunningCoordinator};
use dataset::{Digest, ErrorStatistics, PixelStatistics, SampledMaterial, Specification};
use datastore::verify::{Checks, verify};
use datastore::{ReadOnlyStore, Store};
use imagestore::validation::decode;
use jobqueue::Policy;
use proto::{
    ControlClient, FarmClient,
    client::{Credentials, with_deadline},
};
use std::{
    collections::HashMap,
    net::SocketAddr,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};
use tokio::{sync::watch, task::JoinHandle};
use tonic::Status;
use worker::{Render, RenderFailure, RenderedView, Summary, Worker, WorkerError};

/// A lease short enough to wait for.
pub const SHORT_LEASE: Duration = Duration::from_millis(300);

pub struct Bench {
    folder: tempfile::TempDir,
    pub specification: Specification,
    pub policy: Policy,
    pub redundant_per_million: u32,
    pub disk_reserve_bytes: u64,
    pub staged_bytes_max: u64,
    pub rendered: Arc<AtomicU64>,
}

pub struct CheapRenderer<B> {
    specification: Specification,
    rendered: Arc<AtomicU64>,
    behaviour: B,
}

/// What a test's renderer does with a material's view beside making its image.
pub trait Behaviour: Fn(u32, u32) -> Result<(), RenderFailure> + Send + Sync + 'static {}

impl<B: Fn(u32, u32) -> Result<(), RenderFailure> + Send + Sync + 'static> Behaviour for B {}

impl<B> CheapRenderer<B> {
    pub fn new(specification: &Specification, rendered: Arc<AtomicU64>, behaviour: B) -> Self {
        Self {
            specification: specification.clone(),
            rendered,
            behaviour,
        }
    }
}

impl<B: Behaviour> Render for CheapRenderer<B> {
    fn render(&self, material: &SampledMaterial, view: u32) -> Result<RenderedView, RenderFailure> {
        (self.behaviour)(material.index, view)?;
        self.rendered.fetch_add(1, Ordering::Relaxed);
        let exr = cheap_image(&self.specification, material.index, view);
        Ok(rendered(&self.specification, view, exr))
    }
}

/// What a worker has of an image that it rendered.
pub fn rendered(specification: &Specification, view: u32, exr: Vec<u8>) -> RenderedView {
    let pixels = decode(&exr, specification).unwrap().pixels;
    RenderedView {
        exr,
        statistics: statistics(),
        pixels: PixelStatistics::of(specification, view, pixels.iter().copied()).unwrap(),
    }
}

pub fn statistics() -> ErrorStatistics {
    ErrorStatistics {
        mean: 1e-4,
        p95: 2e-4,
        max: 3e-4,
        within_target: 1.0,
        samples: 4096,
        evaluations: 7,
    }
}

pub fn cheap(_: u32, _: u32) -> Result<(), RenderFailure> {
    Ok(())
}

pub fn slow(_: u32, _: u32) -> Result<(), RenderFailure> {
    thread::sleep(Duration::from_millis(60));
    Ok(())
}

/// A worker at work.
pub struct WorkerAtWork {
    pub stop: watch::Sender<bool>,
    task: JoinHandle<Result<Summary, WorkerError>>,
}

impl WorkerAtWork {
    pub async fn summary(self) -> Summary {
        self.outcome().await.unwrap()
    }

    pub async fn outcome(self) -> Result<Summary, WorkerError> {
        self.task.await.unwrap()
    }
}

impl Bench {
    pub fn new(materials: u32) -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            specification: small_specification(materials),
            policy: Policy::default(),
            redundant_per_million: 0,
            disk_reserve_bytes: 0,
            staged_bytes_max: limits::STAGED_BYTES_MAX,
            rendered: Arc::default(),
        }
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn rendered(&self) -> u64 {
        self.rendered.load(Ordering::Relaxed)
    }

    pub async fn coordinator(&self) -> RunningCoordinator {
        let listen = Options::default().listen;
        self.coordinator_on(listen).await
    }

    pub async fn coordinator_on(&self, listen: SocketAddr) -> RunningCoordinator {
        let store = Store::open_or_create(self.path(), &self.specification).unwrap();
        let options = Options {
            listen,
            policy: self.policy,
            redundant_per_million: self.redundant_per_million,
            disk_reserve_bytes: self.disk_reserve_bytes,
            staged_bytes_max: self.staged_bytes_max,
            ..Options::default()
        };
        Coordinator::start(store, options).await.unwrap()
    }

    pub fn control(&self, url: &str) -> ControlClient {
        proto::client::control(url, &Credentials::default()).unwrap()
    }

    pub fn worker(&self, url: &str, behaviour: impl Behaviour) -> WorkerAtWork {
        let rendered = Arc::clone(&self.rendered);
        let rendering = move |specification: &Specification| {
            CheapRenderer::new(specification, rendered, behaviour)
        };
        self.worker_called("", url, rendering)
    }

    /// A worker with a name, or with the default one where it is empty, and a renderer.
    pub fn worker_called<R: Render>(
        &self,
        name: &str,
        url: &str,
        renderer: impl FnOnce(&Specification) -> R + Send + 'static,
    ) -> WorkerAtWork {
        let url = url.to_owned();
        let name = name.to_owned();
        let (stop, stopping) = watch::channel(false);
        let task = tokio::spawn(async move {
            let mut options = worker::Options {
                threads: 1,
                connect_max: Duration::from_secs(5),
                ..worker::Options::default()
            };
            if !name.is_empty() {
                options.name = name;
            }
            let prepare = move |specification: &Specification| Ok(renderer(specification));
            Worker::connect(&[url], options, prepare)
                .await?
                .run(stopping)
                .await
        });
        WorkerAtWork { stop, task }
    }

    /// Every completed material's digests, in order; the store has to be sound.
    pub fn digests(&self) -> Vec<Digest> {
        let store = ReadOnlyStore::open(self.path()).unwrap();
        let checks = Checks::without_renderer(store.specification().materials, 1);
        let report = verify(&store, &checks, &|_| ()).unwrap();
        assert_eq!(report.faults, []);
        (0..store.specification().materials)
            .flat_map(|material| store.completion(material).unwrap().unwrap().views)
            .map(|view| view.digest)
            .collect()
    }

    /// What the store of an undisturbed run has.
    pub fn expected_digests(&self) -> Vec<Digest> {
        let views = self.specification.views.len() as u32;
        (0..self.specification.materials)
            .flat_map(|material| (0..views).map(move |view| (material, view)))
            .map(|(material, view)| Digest::of(&cheap_image(&self.specification, material, view)))
            .collect()
    }
}

/// A worker in single steps.
#[derive(Clone)]
pub struct Puppet {
    pub client: FarmClient,
    pub id: Vec<u8>,
    /// Tokens of what it leased, by material.
    pub held: HashMap<u32, Vec<u8>>,
    specification: Specification,
}

impl Puppet {
    pub async fn register(bench: &Bench, url: &str) -> Self {
        Self::called("puppet", bench, url).await
    }

    pub async fn called(name: &str, bench: &Bench, url: &str) -> Self {
        let mut client = proto::client::farm(url, &Credentials::default()).unwrap();
        let message = proto::RegisterRequest {
            name: name.to_owned(),
            renderer_version: dataset::RENDERER_VERSION.to_owned(),
            specification_hash: bench.specification.hash().as_bytes().to_vec(),
            worker_id: Vec::new(),
            resolves_disputes: false,
        };
        let answer = client.register(with_deadline(message)).await.unwrap();
        Self {
            client,
            id: answer.into_inner().worker_id,
            held: HashMap::new(),
            specification: bench.specification.clone(),
        }
    }

    pub async fn lease(&mut self, jobs_max: u32) -> proto::LeaseResponse {
        self.try_lease(jobs_max).await.unwrap()
    }

    pub async fn try_lease(&mut self, jobs_max: u32) -> Result<proto::LeaseResponse, Status> {
        let message = proto::LeaseRequest {
            worker_id: self.id.clone(),
            jobs_max,
            wait_ms: 0,
        };
        let answer = self.client.lease(with_deadline(message)).await?;
        let leased = answer.into_inner();
        let held = leased.jobs.iter();
        self.held
            .extend(held.map(|job| (job.material, job.token.clone())));
        Ok(leased)
    }

    pub async fn lease_one(&mut self) -> proto::Job {
        let mut jobs = self.lease(1).await.jobs;
        assert_eq!(jobs.len(), 1);
        jobs.remove(0)
    }

    pub fn images(&self, material: u32) -> Vec<Vec<u8>> {
        (0..self.specification.views.len() as u32)
            .map(|view| cheap_image(&self.specification, material, view))
            .collect()
    }

    /// Says that it is at work on `material`, with `views_done` views rendered.
    pub async fn renew(
        &mut self,
        token: &[u8],
        material: u32,
        views_done: u32,
    ) -> proto::RenewResponse {
        let message = proto::RenewRequest {
            worker_id: self.id.clone(),
            renewals: vec![proto::Renewal {
                token: token.to_vec(),
                material,
                views_done,
            }],
        };
        let answer = self.client.renew(with_deadline(message)).await;
        answer.unwrap().into_inner()
    }

    /// Sends an image under the lease that it has of the material, if any.
    pub async fn put(
        &mut self,
        material: u32,
        digest: Digest,
        data: Vec<u8>,
    ) -> Result<(), Status> {
        let token = self.held.get(&material).cloned().unwrap_or_default();
        self.put_under(token, material, digest, data).await
    }

    pub async fn put_under(
        &mut self,
        token: Vec<u8>,
        material: u32,
        digest: Digest,
        data: Vec<u8>,
    ) -> Result<(), Status> {
        let message = proto::PutBlobRequest {
            digest: digest.as_bytes().to_vec(),
            size: data.len() as u64,
            data: data.into(),
            token,
            material,
        };
        self.client.put_blob(with_deadline(message)).await?;
        Ok(())
    }

    pub async fn put_all(&mut self, material: u32) {
        for bytes in self.images(material) {
            self.put(material, Digest::of(&bytes), bytes).await.unwrap();
        }
    }

    pub async fn complete(
        &mut self,
        token: &[u8],
        material: u32,
    ) -> Result<proto::CompleteResponse, Status> {
        let images = self.images(material);
        self.complete_with(token, material, &images).await
    }

    pub async fn complete_with(
        &mut self,
        token: &[u8],
        material: u32,
        images: &[Vec<u8>],
    ) -> Result<proto::CompleteResponse, Status> {
        let message = completion(token, material, images);
        let answer = self.client.complete(with_deadline(message)).await?;
        Ok(answer.into_inner())
    }

    /// Completes with images that were not sent before.
    pub async fn complete_bringing(
        &mut self,
        token: &[u8],
        material: u32,
        images: &[Vec<u8>],
    ) -> Result<proto::CompleteResponse, Status> {
        let mut message = completion(token, material, images);
        for (view, image) in message.views.iter_mut().zip(images) {
            view.image = image.clone().into();
        }
        let answer = self.client.complete(with_deadline(message)).await?;
        Ok(answer.into_inner())
    }
}

fn completion(token: &[u8], material: u32, images: &[Vec<u8>]) -> proto::CompleteRequest {
    let statistics = statistics();
    let views = images.iter().map(|bytes| proto::View {
        digest: Digest::of(bytes).as_bytes().to_vec(),
        size: bytes.len() as u64,
        statistics: Some(proto::ErrorStatistics {
            mean: statistics.mean,
            p95: statistics.p95,
            max: statistics.max,
            within_target: statistics.within_target,
            samples: statistics.samples,
            evaluations: statistics.evaluations,
        }),
        ..proto::View::default()
    });
    proto::CompleteRequest {
        token: token.to_vec(),
        material,
        views: views.collect(),
        seconds: 0.5,
    }
}
