//! A real S3 server, `s3s-fs` with its signatures checked, that can be hurt and counts.

mod pages;

use crate::folder::files_below;
use bytes::Bytes;
use http_body_util::BodyExt;
use hyper::body::Incoming;
use hyper::header::{CONTENT_LENGTH, ETAG, HeaderValue};
use hyper::service::service_fn;
use hyper::{Method, Request};
use hyper_util::rt::{TokioIo, TokioTimer};
use pages::PagedFiles;
use s3s::auth::SimpleAuth;
use s3s::service::{S3Service, S3ServiceBuilder};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::runtime::{self, Runtime};
use tokio::sync::Notify;

const KEY: &str = "brdfarm-test";
const SECRET: &str = "not-a-secret";

/// The one bucket.
pub const BUCKET: &str = "farm";

/// Requests of one kind, and bytes of their bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    pub requests: u64,
    pub bytes_in: u64,
    pub bytes_out: u64,
    busy: Duration,
    /// How many are under way, and since when some are.
    under_way: u32,
    since: Option<Instant>,
}

impl Count {
    /// How long at least one was under way.
    pub fn seconds(&self) -> f64 {
        self.busy.as_secs_f64()
    }
}

/// A server that ends with its test.
pub struct Server {
    pub address: String,
    root: PathBuf,
    state: Arc<State>,
    _runtime: Runtime,
}

#[derive(Default)]
struct State {
    counts: Mutex<BTreeMap<&'static str, Count>>,
    // Connections are closed without a word.
    down: AtomicBool,
    // Uploads of which a byte is flipped, or half is lost, before the server has them.
    flips: AtomicU32,
    cuts: AtomicU32,
    // Entity tags say nothing of the content, as Azure's.
    opaque_tags: AtomicBool,
    removal_milliseconds: AtomicU32,
    // The next listing waits for the next object.
    hold_listing: AtomicBool,
    written: Notify,
}

impl Server {
    /// Serves what is in a folder, on a free port.
    pub fn start(root: &Path) -> Self {
        fs::create_dir_all(root.join(BUCKET)).expect("a bucket");
        let service = {
            let mut builder = S3ServiceBuilder::new(PagedFiles::new(root));
            builder.set_auth(SimpleAuth::from_single(KEY, SECRET));
            builder.build()
        };
        let runtime = runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()
            .expect("a runtime");
        let listener = runtime
            .block_on(TcpListener::bind("127.0.0.1:0"))
            .expect("a port");
        let address = listener.local_addr().expect("an address").to_string();
        let state = Arc::<State>::default();
        runtime.spawn(accept(listener, service, Arc::clone(&state)));
        Self {
            address,
            root: root.to_owned(),
            state,
            _runtime: runtime,
        }
    }

    /// Where the server is, and with which keys.
    pub fn environment(&self) -> Vec<(&'static str, String)> {
        vec![
            ("AWS_ENDPOINT_URL", format!("http://{}", self.address)),
            ("AWS_ALLOW_HTTP", "true".to_owned()),
            ("AWS_ACCESS_KEY_ID", KEY.to_owned()),
            ("AWS_SECRET_ACCESS_KEY", SECRET.to_owned()),
            ("AWS_REGION", "us-east-1".to_owned()),
        ]
    }

    /// Closes every connection without a word, until told otherwise.
    pub fn down(&self, down: bool) {
        self.state.down.store(down, Ordering::Relaxed);
    }

    /// The next uploads come with a byte flipped.
    pub fn flip_uploads(&self, count: u32) {
        self.state.flips.store(count, Ordering::Relaxed);
    }

    /// Of the next uploads half is lost.
    pub fn cut_uploads(&self, count: u32) {
        self.state.cuts.store(count, Ordering::Relaxed);
    }

    /// From now on entity tags are no MD5s.
    pub fn tell_no_md5(&self) {
        self.state.opaque_tags.store(true, Ordering::Relaxed);
    }

    /// From now on a request to remove objects waits for so long first.
    pub fn remove_after(&self, milliseconds: u32) {
        let state = &self.state;
        state
            .removal_milliseconds
            .store(milliseconds, Ordering::Relaxed);
    }

    /// The next listing is made only after the next object was written.
    pub fn hold_listing(&self) {
        self.state.hold_listing.store(true, Ordering::Relaxed);
    }

    /// What was asked so far, by kind.
    pub fn counts(&self) -> BTreeMap<&'static str, Count> {
        self.state.counts.lock().expect("counts").clone()
    }

    pub fn forget_counts(&self) {
        self.state.counts.lock().expect("counts").clear();
    }

    /// The files of all objects, by key.
    pub fn objects(&self, prefix: &str) -> Vec<PathBuf> {
        // A server makes folders for the objects that it has.
        let folder = self.root.join(BUCKET).join(prefix);
        if folder.exists() {
            files_below(&folder)
        } else {
            Vec::new()
        }
    }
}

async fn accept(listener: TcpListener, service: S3Service, state: Arc<State>) {
    while let Ok((stream, _)) = listener.accept().await {
        if state.down.load(Ordering::Relaxed) {
            continue;
        }
        let (service, state) = (service.clone(), Arc::clone(&state));
        tokio::spawn(async move {
            let answer =
                service_fn(move |request| answer(service.clone(), Arc::clone(&state), request));
            let http = hyper::server::conn::http1::Builder::new()
                .timer(TokioTimer::new())
                .serve_connection(TokioIo::new(stream), answer);
            // Whoever was on the other side noticed.
            drop(http.await);
        });
    }
}

async fn answer(
    service: S3Service,
    state: Arc<State>,
    request: Request<Incoming>,
) -> io::Result<s3s::HttpResponse> {
    if state.down.load(Ordering::Relaxed) {
        return Err(io::Error::other("the server is down"));
    }
    let kind = kind(&request);
    let bytes_in = length(request.headers());
    let take = |count: &AtomicU32| {
        let taken = count.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1));
        kind == UPLOAD && taken.is_ok()
    };
    let (flip, cut) = (take(&state.flips), take(&state.cuts));
    let (head, body) = request.into_parts();
    let body = if flip || cut {
        let mut bytes = body
            .collect()
            .await
            .map_err(io::Error::other)?
            .to_bytes()
            .to_vec();
        let middle = bytes.len() / 2;
        if flip {
            bytes[middle] ^= 1;
        } else {
            bytes.truncate(middle);
        }
        s3s::Body::from(Bytes::from(bytes))
    } else {
        s3s::Body::from(body)
    };
    let request = Request::from_parts(head, body);
    {
        let mut counts = state.counts.lock().expect("counts");
        let count = counts.entry(kind).or_default();
        count.under_way += 1;
        count.since.get_or_insert_with(Instant::now);
    }
    wait_if_told(kind, &state).await;
    let response = service.call(request).await;
    let mut response = response.map_err(|error| io::Error::other(format!("{error:?}")))?;
    if kind == "PUT" {
        state.written.notify_waiters();
    }
    if state.opaque_tags.load(Ordering::Relaxed)
        && let Some(tag) = response.headers_mut().get_mut(ETAG)
    {
        *tag = HeaderValue::from_static("\"0x8DD0C5F5E0B1A2C\"");
    }
    let mut counts = state.counts.lock().expect("counts");
    let count = counts.entry(kind).or_default();
    count.requests += 1;
    count.under_way = count.under_way.saturating_sub(1);
    if count.under_way == 0
        && let Some(since) = count.since.take()
    {
        count.busy += since.elapsed();
    }
    count.bytes_in += bytes_in;
    if kind != "HEAD" {
        count.bytes_out += length(response.headers());
    }
    drop(counts);
    Ok(response)
}

/// Waits as long as requests of this kind are to wait.
async fn wait_if_told(kind: &str, state: &State) {
    if kind == "DELETE" {
        let wait = state.removal_milliseconds.load(Ordering::Relaxed);
        tokio::time::sleep(Duration::from_millis(wait.into())).await;
    }
    let written = state.written.notified();
    if kind == "LIST" && state.hold_listing.swap(false, Ordering::Relaxed) {
        written.await;
    }
}

/// A PUT by somebody who has no key, only a URL.
pub const UPLOAD: &str = "PUT by URL";

fn kind(request: &Request<Incoming>) -> &'static str {
    let query = request.uri().query().unwrap_or_default();
    let signed_url = query.contains("X-Amz-Signature=");
    match *request.method() {
        Method::PUT if signed_url => UPLOAD,
        Method::PUT if request.headers().contains_key("x-amz-copy-source") => "COPY",
        Method::PUT => "PUT",
        Method::HEAD => "HEAD",
        Method::GET if query.contains("list-type=") => "LIST",
        Method::GET if signed_url => "GET by URL",
        Method::GET => "GET",
        Method::POST if query.contains("delete") => "DELETE",
        Method::POST => "POST",
        Method::DELETE => "DELETE",
        _ => "other",
    }
}

fn length(headers: &hyper::HeaderMap) -> u64 {
    let length = headers
        .get(CONTENT_LENGTH)
        .and_then(|length| length.to_str().ok());
    length
        .and_then(|length| length.parse().ok())
        .unwrap_or_default()
}
