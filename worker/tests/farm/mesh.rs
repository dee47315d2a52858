//! A dataset whose sample is a mesh: workers fetch it, and believe no coordinator.

use crate::{
    bench::{Bench, CheapRenderer, Puppet, cheap},
    mesh_specification::mesh_specification,
};
use bytes::Bytes;
use dataset::{RENDERER_VERSION, Specification, specification::SampleMesh};
use limits::protocol::MESH_BYTES_PER_CALL;
use proto::client::{Credentials, with_deadline};
use std::{
    net::SocketAddr,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};
use tokio::{net::TcpListener, sync::watch};
use tokio_stream::wrappers::TcpListenerStream;
use tonic::{Code, Request, Response, Status, transport::Server};
use worker::{Worker, WorkerError};

/// A mesh whose file takes three calls.
fn large_mesh(materials: u32) -> Specification {
    let mut specification = mesh_specification(materials, 1.0);
    let mut bytes = specification.sample.loaded_mesh().unwrap().bytes().to_vec();
    while bytes.len() < 2 * MESH_BYTES_PER_CALL + 1000 {
        bytes.extend_from_slice(b"# nothing but a comment, of which there are many\n");
    }
    specification.sample.mesh = Some(SampleMesh::of_bytes(bytes).unwrap());
    specification
}

fn bytes(specification: &Specification) -> Bytes {
    let mesh = specification.sample.loaded_mesh().unwrap();
    Bytes::copy_from_slice(mesh.bytes())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_has_the_mesh_of_its_coordinator() {
    let mut bench = Bench::new(2);
    bench.specification = large_mesh(2);
    let expected = bytes(&bench.specification);
    let coordinator = bench.coordinator().await;
    let rendered = Arc::clone(&bench.rendered);
    let renderer = move |specification: &Specification| {
        assert_eq!(bytes(specification), expected);
        CheapRenderer::new(specification, rendered, cheap)
    };
    let worker = bench.worker_called("", &coordinator.url(), renderer);
    assert_eq!(worker.summary().await.materials, 2);
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_tells_what_it_has_of_a_mesh() {
    let mut bench = Bench::new(1);
    let ask = |url: String, offset| async move {
        let mut client = proto::client::farm(&url, &Credentials::default()).unwrap();
        let request = with_deadline(proto::GetMeshRequest { offset });
        let answer = client.get_mesh(request).await;
        answer.map(Response::into_inner)
    };
    let coordinator = bench.coordinator().await;
    let none = ask(coordinator.url(), 0).await.unwrap_err();
    assert_eq!(none.code(), Code::NotFound);
    assert!(none.message().contains("is not a mesh"), "{none}");
    coordinator.shutdown().await;

    bench = Bench::new(1);
    bench.specification = large_mesh(1);
    let whole = bytes(&bench.specification);
    let coordinator = bench.coordinator().await;
    let part = MESH_BYTES_PER_CALL;
    for begin in [0, 7, part, 2 * part, whole.len() - 1] {
        let answer = ask(coordinator.url(), begin as u64).await.unwrap();
        let end = (begin + part).min(whole.len());
        assert_eq!(answer.bytes, whole.slice(begin..end), "{begin}");
        assert_eq!(answer.total_bytes, whole.len() as u64);
    }
    for offset in [whole.len() as u64, 1 << 40, u64::MAX] {
        let beyond = ask(coordinator.url(), offset).await.unwrap_err();
        assert_eq!(beyond.code(), Code::OutOfRange);
        assert!(beyond.message().contains(&offset.to_string()), "{beyond}");
    }
    // Whoever asks for it is a worker like any other.
    Puppet::register(&bench, &coordinator.url()).await;
    coordinator.shutdown().await;
}

type Answer<T> = Result<Response<T>, Status>;
type Part = fn(&Bytes, usize) -> (Bytes, u64);

/// A coordinator that has no work, and answers for its mesh what a test wants.
struct Scripted {
    specification: Specification,
    part: Part,
    parts: Arc<AtomicU64>,
    registrations: Arc<AtomicU64>,
    leases: AtomicU64,
}

fn honest(mesh: &Bytes, offset: usize) -> (Bytes, u64) {
    let end = (offset + MESH_BYTES_PER_CALL).min(mesh.len());
    (mesh.slice(offset..end), mesh.len() as u64)
}

#[tonic::async_trait]
impl proto::Farm for Scripted {
    async fn get_dataset(
        &self,
        _: Request<proto::GetDatasetRequest>,
    ) -> Answer<proto::GetDatasetResponse> {
        Ok(Response::new(proto::GetDatasetResponse {
            specification_json: self.specification.to_json(),
            specification_hash: self.specification.hash().as_bytes().to_vec(),
            renderer_version: RENDERER_VERSION.to_owned(),
            materials: 1,
        }))
    }

    async fn get_mesh(
        &self,
        request: Request<proto::GetMeshRequest>,
    ) -> Answer<proto::GetMeshResponse> {
        self.parts.fetch_add(1, Ordering::Relaxed);
        let mesh = bytes(&self.specification);
        let offset = request.into_inner().offset as usize;
        let (bytes, total_bytes) = (self.part)(&mesh, offset);
        Ok(Response::new(proto::GetMeshResponse { bytes, total_bytes }))
    }

    async fn register(
        &self,
        _: Request<proto::RegisterRequest>,
    ) -> Answer<proto::RegisterResponse> {
        self.registrations.fetch_add(1, Ordering::Relaxed);
        Ok(Response::new(proto::RegisterResponse {
            worker_id: vec![1; 16],
            lease_ms: 60_000,
            deadline_ms: 600_000,
        }))
    }

    /// At first as one that restarted, which knows nobody.
    async fn lease(&self, _: Request<proto::LeaseRequest>) -> Answer<proto::LeaseResponse> {
        if self.leases.fetch_add(1, Ordering::Relaxed) < 2 {
            return Err(Status::not_found("who?"));
        }
        Ok(Response::new(proto::LeaseResponse {
            finished: true,
            ..proto::LeaseResponse::default()
        }))
    }

    async fn renew(&self, _: Request<proto::RenewRequest>) -> Answer<proto::RenewResponse> {
        Err(Status::unimplemented("renew"))
    }

    async fn find_missing_blobs(
        &self,
        _: Request<proto::FindMissingBlobsRequest>,
    ) -> Answer<proto::FindMissingBlobsResponse> {
        Err(Status::unimplemented("find"))
    }

    async fn get_upload_urls(
        &self,
        _: Request<proto::GetUploadUrlsRequest>,
    ) -> Answer<proto::GetUploadUrlsResponse> {
        Err(Status::unimplemented("urls"))
    }

    async fn put_blob(&self, _: Request<proto::PutBlobRequest>) -> Answer<proto::PutBlobResponse> {
        Err(Status::unimplemented("put"))
    }

    async fn complete(
        &self,
        _: Request<proto::CompleteRequest>,
    ) -> Answer<proto::CompleteResponse> {
        Err(Status::unimplemented("complete"))
    }

    async fn fail(&self, _: Request<proto::FailRequest>) -> Answer<proto::FailResponse> {
        Err(Status::unimplemented("fail"))
    }

    async fn deregister(
        &self,
        _: Request<proto::DeregisterRequest>,
    ) -> Answer<proto::DeregisterResponse> {
        Ok(Response::new(proto::DeregisterResponse::default()))
    }
}

struct Outcome {
    worker: Result<(), WorkerError>,
    parts: u64,
    registrations: u64,
}

/// What a worker does with a coordinator whose answers for its mesh are these.
async fn with(part: Part) -> Outcome {
    let (parts, registrations) = (Arc::default(), Arc::default());
    let farm = Scripted {
        specification: large_mesh(1),
        part,
        parts: Arc::clone(&parts),
        registrations: Arc::clone(&registrations),
        leases: AtomicU64::new(0),
    };
    let listener = TcpListener::bind(SocketAddr::from(([127, 0, 0, 1], 0))).await;
    let listener = listener.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let serving = Server::builder()
        .add_service(proto::farm_server(farm))
        .serve_with_incoming(TcpListenerStream::new(listener));
    let serving = tokio::spawn(serving);
    let options = worker::Options {
        threads: 1,
        connect_max: Duration::from_secs(5),
        ..worker::Options::default()
    };
    let prepare = |specification: &Specification| {
        assert!(specification.sample.loaded_mesh().is_some());
        Ok(CheapRenderer::new(specification, Arc::default(), cheap))
    };
    let (_stop, stopping) = watch::channel(false);
    let worker = match Worker::connect(&[url], options, prepare).await {
        Ok(worker) => worker.run(stopping).await.map(|_| ()),
        Err(error) => Err(error),
    };
    serving.abort();
    Outcome {
        worker,
        parts: parts.load(Ordering::Relaxed),
        registrations: registrations.load(Ordering::Relaxed),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_mesh_is_fetched_once_whoever_asks_to_register_again() {
    let outcome = with(honest).await;
    outcome.worker.unwrap();
    assert_eq!(outcome.parts, 3);
    assert!(outcome.registrations > 1, "{}", outcome.registrations);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_that_lies_about_its_mesh_is_left() {
    let lies: [(Part, &str, u64); 9] = [
        (
            |mesh, offset| (honest(mesh, offset).0, 1 << 40),
            "at most",
            1,
        ),
        (
            |mesh, offset| (honest(mesh, offset).0, u64::MAX),
            "at most",
            1,
        ),
        (
            |mesh, offset| (honest(mesh, offset).0, (mesh.len() - offset / 2) as u64),
            "and now has",
            2,
        ),
        (
            |mesh, _| (Bytes::new(), mesh.len() as u64),
            "has 0 bytes",
            1,
        ),
        (|_, _| (Bytes::new(), 0), "has 0 bytes", 1),
        (
            |mesh, offset| (mesh.slice(offset..=offset), mesh.len() as u64),
            "has 1 bytes",
            1,
        ),
        (
            |mesh, offset| (mesh.slice(offset..), mesh.len() as u64),
            "not 65536",
            1,
        ),
        (
            |mesh, offset| {
                (
                    Bytes::from(vec![b'#'; honest(mesh, offset).0.len()]),
                    mesh.len() as u64,
                )
            },
            "the mesh that was given is",
            3,
        ),
        (
            |mesh, offset| (mesh.slice(..mesh.len().min(1000 - offset)), 1000),
            "the mesh that was given is",
            1,
        ),
    ];
    for (part, reason, parts) in lies {
        let outcome = with(part).await;
        let error = outcome.worker.unwrap_err();
        assert!(matches!(error, WorkerError::Mesh(_)), "{error}");
        assert!(error.to_string().contains(reason), "{reason}: {error}");
        assert_eq!(outcome.parts, parts, "{error}");
    }
}
