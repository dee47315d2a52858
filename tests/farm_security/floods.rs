//! Too much of everything: messages that are too large, connections that say nothing, uploads that
//! never end.

use crate::place::{Guest, MEMORY_MAX, coordinator, memory_bytes, status, succeed};
use http_body::{Frame, SizeHint};
use proto::client::{self, Credentials, with_deadline};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::fs;
use std::net::TcpStream;
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tokio::task::JoinSet;
use tokio::time::{Sleep, sleep};
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint};
use tonic::{Code, Status, body::Body};
use tower::{Service, ServiceExt};

#[tokio::test]
async fn messages_that_are_too_large_are_refused_unread() {
    let directory = tempfile::tempdir().expect("a directory");
    let (coordinator, url) = coordinator(directory.path(), "store", "");
    let nobody = Credentials::default();
    let farm = client::farm(&url, &nobody).expect("a client");
    let mut farm = farm.max_encoding_message_size(64 << 20);
    for _ in 0..3 {
        let data = vec![0; 16 << 20];
        let message = proto::PutBlobRequest {
            digest: vec![0; 32],
            size: data.len() as u64,
            data: data.into(),
            ..proto::PutBlobRequest::default()
        };
        let refused = farm.put_blob(with_deadline(message)).await.unwrap_err();
        assert_eq!(refused.code(), Code::OutOfRange, "{refused}");
    }
    let message = proto::FindMissingBlobsRequest {
        digests: vec![vec![0; 32]; 5000],
        ..proto::FindMissingBlobsRequest::default()
    };
    let refused = farm
        .find_missing_blobs(with_deadline(message))
        .await
        .unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
    let control = client::control(&url, &nobody).expect("a client");
    let mut control = control.max_encoding_message_size(64 << 20);
    let message = proto::BarWorkerRequest {
        name: "x".repeat(1 << 20),
        reason: "y".to_owned(),
    };
    let refused = control
        .bar_worker(with_deadline(message))
        .await
        .unwrap_err();
    assert_eq!(refused.code(), Code::OutOfRange, "{refused}");
    assert!(
        memory_bytes(&coordinator) < MEMORY_MAX,
        "{}",
        memory_bytes(&coordinator)
    );
    assert_eq!(status(&url, &nobody).await.expect("an answer"), 2);
}

fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit {
        current: limit.maximum,
        ..limit
    };
    setrlimit(Resource::Nofile, raised).expect("open files");
}

#[tokio::test]
async fn ten_thousand_silent_connections_keep_nobody_out() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    raise_open_files();
    let (coordinator, url) = coordinator(directory, "store", "");
    let address = url.trim_start_matches("http://").to_owned();
    let mut silent = Vec::new();
    while silent.len() < 10_000 {
        let Ok(stream) = TcpStream::connect(&address) else {
            panic!("{} connections are all that this system has", silent.len());
        };
        silent.push(stream);
        if silent.len().is_multiple_of(2500) {
            let answer = status(&url, &Credentials::default()).await;
            assert_eq!(
                answer.expect("an answer"),
                2,
                "with {} of them",
                silent.len()
            );
        }
    }
    let work = format!("worker connect {url} --backend native");
    assert!(succeed(directory, &work).contains("28 images"));
    assert!(
        memory_bytes(&coordinator) < MEMORY_MAX,
        "{}",
        memory_bytes(&coordinator)
    );
}

/// An upload that says how much it is going to send, sends most of it, and then a byte at a time,
/// for ever.
struct Unfinished {
    at_once: usize,
    sent: usize,
    announced: u32,
    pause: Pin<Box<Sleep>>,
}

/// What it sends in one piece, bytes.
const PIECE: usize = 64 << 10;

impl http_body::Body for Unfinished {
    type Data = tonic::codegen::Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Status>>> {
        if self.sent == 0 {
            // The frame of a gRPC message: not compressed, and so long.
            let mut begin = vec![0];
            begin.extend(self.announced.to_be_bytes());
            self.sent = begin.len();
            return Poll::Ready(Some(Ok(Frame::data(begin.into()))));
        }
        if self.sent < self.at_once {
            self.sent += PIECE;
            return Poll::Ready(Some(Ok(Frame::data(vec![0; PIECE].into()))));
        }
        if self.pause.as_mut().poll(context).is_pending() {
            return Poll::Pending;
        }
        self.pause = Box::pin(sleep(Duration::from_secs(1)));
        Poll::Ready(Some(Ok(Frame::data(vec![0].into()))))
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::default()
    }
}

/// Sends an upload that slows down after so many bytes and never ends, and returns how it is refused.
async fn unfinished(url: &str, credentials: &Credentials, at_once: usize, announced: u32) -> Code {
    let mut channel = Endpoint::from_shared(url.to_owned()).expect("a URL");
    if let Some(authority) = &credentials.authority {
        let tls = ClientTlsConfig::new().ca_certificate(Certificate::from_pem(authority));
        channel = channel.tls_config(tls).expect("an authority");
    }
    let mut channel = channel.connect().await.expect("a connection");
    let body = Unfinished {
        at_once,
        sent: 0,
        announced,
        pause: Box::pin(sleep(Duration::ZERO)),
    };
    let mut request = http::Request::post("/brdfarm.v1.Farm/PutBlob")
        .header("content-type", "application/grpc")
        .header("te", "trailers");
    if let Some(token) = &credentials.token {
        request = request.header("authorization", format!("Bearer {}", token.trim()));
    }
    let request = request.body(Body::new(body)).expect("a request");
    let channel = channel.ready().await.expect("a connection");
    let answer = channel.call(request).await.expect("an answer");
    Status::from_header_map(answer.headers()).map_or(Code::Ok, |status| status.code())
}

/// 120 uploads of 6 MiB and 400 of 192 KiB that never end are 795 MiB, more than all messages may
/// take together.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn uploads_that_never_end_are_put_out_and_take_bounded_memory() {
    const LONG: usize = 120;
    const SHORT: usize = 400;
    const UPLOADS: usize = LONG + SHORT;
    /// What all messages may take together, and what a coordinator takes beside, bytes.
    const UNFINISHED_MEMORY_MAX: u64 = (512 << 20) + MEMORY_MAX;
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let (coordinator, url) = coordinator(directory, "store", "");
    let mut uploads = JoinSet::new();
    for number in 0..UPLOADS {
        let url = url.clone();
        let at_once = if number < LONG { 6 << 20 } else { 192 << 10 };
        let nobody = Credentials::default();
        uploads.spawn(async move { unfinished(&url, &nobody, at_once, 7 << 20).await });
    }
    let mut codes = Vec::new();
    let mut memory_max = 0;
    while let Some(code) = uploads.join_next().await {
        codes.push(code.expect("no panic"));
        memory_max = memory_max.max(memory_bytes(&coordinator));
        if codes.len() < LONG / 2 {
            // Others are still sending, and hold all that they can get.
            let answer = status(&url, &Credentials::default()).await;
            assert_eq!(answer.expect("an answer"), 2);
        }
    }
    let refused = |code| codes.iter().filter(|found| **found == code).count();
    let (surplus, slow) = (
        refused(Code::ResourceExhausted),
        refused(Code::DeadlineExceeded),
    );
    assert_eq!(surplus + slow, UPLOADS, "{codes:?}");
    assert!(surplus > 0, "there was room for all of them");
    assert!(slow > 0, "nobody was put out for being slow");
    assert!(memory_max < UNFINISHED_MEMORY_MAX, "{memory_max}");
    let work = format!("worker connect {url} --backend native");
    assert!(succeed(directory, &work).contains("28 images"));
}

/// What a folder of `keys` lets its owner show.
fn credentials(directory: &Path, folder: &str) -> Credentials {
    let folder = directory.join("keys").join(folder);
    let read = |name: &str| fs::read(folder.join(name)).expect("readable");
    Credentials {
        token: Some(String::from_utf8(read("token")).expect("text")),
        authority: Some(read("authority.pem")),
        identity: None,
    }
}

/// Short and long messages that never end fill all the room that a worker's credential gets, again and again. A worker
/// with another credential does all the work meanwhile.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_flood_of_one_credential_takes_no_room_from_another() {
    const LONG: usize = 70;
    const SHORT: usize = 600;
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    raise_open_files();
    succeed(directory, "credentials keys");
    succeed(directory, "credentials keys --worker mallory");
    let (coordinator, url) = coordinator(directory, "store", "--credentials keys/coordinator");
    let mallory = credentials(directory, "workers/mallory");
    let refused = Arc::new(AtomicUsize::new(0));
    let mut flood = JoinSet::new();
    for number in 0..LONG + SHORT {
        let (url, mallory, refused) = (url.clone(), mallory.clone(), Arc::clone(&refused));
        flood.spawn(async move {
            let (at_once, announced) = match number < LONG {
                true => (6 << 20, 7 << 20),
                false => (192 << 10, 200 << 10),
            };
            loop {
                let code = unfinished(&url, &mallory, at_once, announced).await;
                if code == Code::ResourceExhausted {
                    refused.fetch_add(1, Ordering::Relaxed);
                }
                sleep(Duration::from_millis(500)).await;
            }
        });
    }
    let began = Instant::now();
    while refused.load(Ordering::Relaxed) < LONG {
        assert!(began.elapsed() < Duration::from_secs(60), "there was room");
        sleep(Duration::from_millis(100)).await;
    }
    let work = format!("worker connect {url} --credentials keys/worker --backend native");
    let worked = tokio::task::spawn_blocking({
        let directory = directory.to_owned();
        move || succeed(&directory, &work)
    });
    let worked = worked.await.expect("no panic");
    assert!(worked.contains("28 images; 0 failed"), "{worked}");
    flood.abort_all();
    assert!(memory_bytes(&coordinator) < (512 << 20) + MEMORY_MAX);
}

/// Connections that finish their TLS handshake, begin HTTP/2 and then make no call.
async fn strangers(url: &str, authority: &[u8], count: usize) -> Vec<Channel> {
    let mut tried = JoinSet::new();
    let tls = ClientTlsConfig::new().ca_certificate(Certificate::from_pem(authority));
    let endpoint = Endpoint::from_shared(url.to_owned()).expect("a URL");
    let endpoint = endpoint.tls_config(tls).expect("an authority");
    let mut open = Vec::new();
    for _ in 0..count {
        let endpoint = endpoint.clone();
        tried.spawn(async move { endpoint.connect().await });
        if tried.len() >= 64 {
            let connected = tried.join_next().await.expect("some").expect("no panic");
            open.extend(connected.ok());
        }
    }
    let rest = tried.join_all().await;
    open.extend(rest.into_iter().flatten());
    open
}

/// Strangers fill all room that there is for them, again and again: somebody with a token gets in,
/// and whoever has shown one stays.
async fn strangers_keep_nobody_out(count: usize) {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    raise_open_files();
    succeed(directory, "credentials keys");
    let (coordinator, url) = coordinator(directory, "store", "--credentials keys/coordinator");
    let reader = credentials(directory, "reader");
    let mut known = client::control(&url, &reader).expect("a client");
    let ask = || with_deadline(proto::StatusRequest {});
    known.status(ask()).await.expect("an answer");

    let authority = reader.authority.clone().expect("an authority");
    let open = strangers(&url, &authority, count).await;
    println!("{} of {count} handshakes were answered", open.len());
    assert!(open.len() > limits::STRANGERS_MAX);
    // One that never called before, beside the strangers.
    let began = Instant::now();
    let leased = Guest::leasing(&url, &credentials(directory, "worker")).await;
    let admitted = began.elapsed();
    println!("a new worker was admitted and had its lease after {admitted:?}");
    assert!(admitted < Duration::from_secs(10));
    known.status(ask()).await.expect("the connection is open");
    leased.leave().await;
    // And in the midst of them.
    let more = tokio::spawn({
        let (url, authority) = (url.clone(), authority.clone());
        async move { strangers(&url, &authority, count).await }
    });
    let work = format!("worker connect {url} --credentials keys/worker --backend native");
    let worked = tokio::task::spawn_blocking({
        let directory = directory.to_owned();
        move || succeed(&directory, &work)
    });
    assert!(worked.await.expect("no panic").contains("28 images"));
    more.abort();
    assert!(memory_bytes(&coordinator) < MEMORY_MAX);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn handshakes_without_a_call_keep_nobody_out() {
    strangers_keep_nobody_out(limits::STRANGERS_MAX + 200).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "tests/floods.sh runs it"]
async fn four_thousand_handshakes_without_a_call_keep_nobody_out() {
    strangers_keep_nobody_out(4095).await;
}
