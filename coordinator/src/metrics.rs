//! What the farm counts and measures, for Prometheus.

use crate::report::Report;
use axum::{Router, http::header::CONTENT_TYPE, routing::get};
use jobstore::Meter;
use prometheus_client::{
    encoding::text::encode,
    metrics::{
        counter::Counter,
        family::Family,
        gauge::Gauge,
        histogram::{Histogram, exponential_buckets},
    },
    registry::{Registry, Unit},
};
use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};
use tokio::net::TcpListener;

/// What Prometheus calls the format.
const FORMAT: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

type Label = [(&'static str, &'static str); 1];

/// All measures of one coordinator. Gauges are set when they are asked for.
pub(crate) struct Metrics {
    registry: Registry,
    jobs: Family<Label, Gauge>,
    workers: Gauge,
    images: Gauge,
    images_per_second: Gauge<f64, AtomicU64>,
    store_bytes: Gauge<f64, AtomicU64>,
    store_free_bytes: Gauge<f64, AtomicU64>,
    failures: Counter,
    leases_lost: Counter,
    leases: Counter,
    received_bytes: Counter,
    calls: Family<Label, Histogram>,
    refusals: Family<Label, Counter>,
    render_seconds: Histogram,
    upload_seconds: Histogram,
    publication_seconds: Histogram,
    commit_seconds: Histogram,
    commit_transitions: Histogram,
}

impl Default for Metrics {
    fn default() -> Self {
        // 0.25 ms to 16 s; 50 ms to 14 h.
        let short = || Histogram::new(exponential_buckets(0.000_25, 2.0, 17));
        let long = || Histogram::new(exponential_buckets(0.05, 2.0, 20));
        let mut metrics = Self {
            registry: Registry::with_prefix("brdfarm"),
            jobs: Family::default(),
            workers: Gauge::default(),
            images: Gauge::default(),
            images_per_second: Gauge::default(),
            store_bytes: Gauge::default(),
            store_free_bytes: Gauge::default(),
            failures: Counter::default(),
            leases_lost: Counter::default(),
            leases: Counter::default(),
            received_bytes: Counter::default(),
            calls: Family::new_with_constructor(|| {
                Histogram::new(exponential_buckets(0.000_25, 2.0, 18))
            }),
            refusals: Family::default(),
            render_seconds: long(),
            upload_seconds: short(),
            publication_seconds: short(),
            commit_seconds: short(),
            commit_transitions: Histogram::new(exponential_buckets(1.0, 2.0, 11)),
        };
        metrics.register();
        metrics
    }
}

impl Metrics {
    fn register(&mut self) {
        let Self { registry, .. } = self;
        registry.register("jobs", "Materials by state", self.jobs.clone());
        registry.register("workers", "Workers heard of lately", self.workers.clone());
        registry.register(
            "images",
            "Images of completed materials",
            self.images.clone(),
        );
        let help = "Images completed a second, over the last minute";
        registry.register("images_per_second", help, self.images_per_second.clone());
        let help =
            "Bytes of images in the store: of those completed at the start and of those since";
        let store = self.store_bytes.clone();
        registry.register_with_unit("store", help, Unit::Bytes, store);
        let help = "Room on the store's file system";
        let free = self.store_free_bytes.clone();
        registry.register_with_unit("store_free", help, Unit::Bytes, free);
        let help = "Failures that workers reported since the start";
        registry.register("worker_failures", help, self.failures.clone());
        let help = "Leases that ran out since the start";
        registry.register("leases_lost", help, self.leases_lost.clone());
        registry.register("leases", "Leases handed out", self.leases.clone());
        let help = "Bytes of completed images";
        let received = self.received_bytes.clone();
        registry.register_with_unit("received", help, Unit::Bytes, received);
        let help = "How long calls took, leases (Lease) with their waiting";
        registry.register_with_unit("call", help, Unit::Seconds, self.calls.clone());
        let help = "Calls that were answered with an error, by gRPC code";
        registry.register("errors", help, self.refusals.clone());
        let help = "How long workers rendered one material";
        registry.register_with_unit("render", help, Unit::Seconds, self.render_seconds.clone());
        let help = "How long images took from their arrival until they were checked and written";
        let seconds = self.upload_seconds.clone();
        registry.register_with_unit("upload", help, Unit::Seconds, seconds);
        let help = "How long it took to make a batch of images durable under their names";
        let seconds = self.publication_seconds.clone();
        registry.register_with_unit("publication", help, Unit::Seconds, seconds);
        let help = "How long it took to make a batch of transitions durable";
        let seconds = self.commit_seconds.clone();
        registry.register_with_unit("ledger_commit", help, Unit::Seconds, seconds);
        let help = "Transitions that became durable together";
        let transitions = self.commit_transitions.clone();
        registry.register("ledger_commit_transitions", help, transitions);
    }

    pub fn note_leases(&self, count: usize) {
        self.leases.inc_by(count as u64);
    }

    pub fn note_completion(&self, bytes: u64, render_seconds: f64) {
        self.received_bytes.inc_by(bytes);
        self.render_seconds.observe(render_seconds);
    }

    pub fn note_upload(&self, time: Duration) {
        self.upload_seconds.observe(time.as_secs_f64());
    }

    /// Notes a call by its path and, where it was refused, the gRPC code.
    pub fn note_call(&self, path: &str, time: Duration, refused: Option<tonic::Code>) {
        let call = call_name(path);
        let calls = self.calls.get_or_create(&[("call", call)]);
        calls.observe(time.as_secs_f64());
        if let Some(code) = refused {
            self.refusals
                .get_or_create(&[("code", code_name(code))])
                .inc();
        }
    }

    /// Everything, as Prometheus reads it.
    pub fn text(&self, report: &Report, free_bytes: u64) -> String {
        let progress = &report.progress;
        let counts = progress.counts;
        for (state, number) in [
            ("pending", counts.pending),
            ("leased", counts.leased),
            ("completed", counts.completed),
            ("disputed", counts.disputed),
            ("set_aside", counts.quarantined),
            ("cancelled", counts.cancelled),
            ("to_check", counts.redundant),
        ] {
            let gauge = self.jobs.get_or_create(&[("state", state)]);
            gauge.set(number.into());
        }
        self.workers.set(progress.workers.into());
        self.images.set(progress.images as i64);
        // They only grow, and are counted where they happen.
        let counted = [
            (&self.failures, progress.failures),
            (&self.leases_lost, progress.leases_lost),
        ];
        for (counter, count) in counted {
            counter.inner().store(count, Ordering::Relaxed);
        }
        self.images_per_second.set(report.images_per_second);
        self.store_bytes.set(report.store_bytes as f64);
        self.store_free_bytes.set(free_bytes as f64);
        let mut text = String::new();
        if encode(&mut text, &self.registry).is_err() {
            unreachable!("writing to a string does not fail");
        }
        text
    }
}

impl Meter for Metrics {
    fn note_publication(&self, time: Duration) {
        self.publication_seconds.observe(time.as_secs_f64());
    }

    fn note_commit(&self, time: Duration, transitions: usize) {
        self.commit_seconds.observe(time.as_secs_f64());
        self.commit_transitions.observe(transitions as f64);
    }
}

/// Serves `text` at /metrics until it is dropped.
pub(crate) async fn serve(
    listener: TcpListener,
    text: impl Fn() -> String + Send + Sync + 'static,
) -> io::Result<()> {
    let text = Arc::new(text);
    let answer = move || async move { ([(CONTENT_TYPE, FORMAT)], text()) };
    axum::serve(listener, Router::new().route("/metrics", get(answer))).await
}

/// The last part of a path that is known; paths come from outside, and every name costs memory.
fn call_name(path: &str) -> &'static str {
    const CALLS: [&str; 25] = [
        "GetDataset",
        "GetMesh",
        "Register",
        "Lease",
        "Renew",
        "FindMissingBlobs",
        "GetUploadUrls",
        "PutBlob",
        "Complete",
        "Fail",
        "Deregister",
        "Status",
        "ListJobs",
        "ListWorkers",
        "WatchEvents",
        "GetBlob",
        "RetryJobs",
        "CancelJobs",
        "PrioritizeJobs",
        "Pause",
        "Resume",
        "Drain",
        "BarWorker",
        "UnbarWorker",
        "Check",
    ];
    let name = path.rsplit('/').next().unwrap_or_default();
    let known = CALLS.iter().find(|call| **call == name);
    known.copied().unwrap_or("other")
}

fn code_name(code: tonic::Code) -> &'static str {
    use tonic::Code;
    match code {
        Code::InvalidArgument => "invalid_argument",
        Code::NotFound => "not_found",
        Code::AlreadyExists => "already_exists",
        Code::PermissionDenied => "permission_denied",
        Code::ResourceExhausted => "resource_exhausted",
        Code::FailedPrecondition => "failed_precondition",
        Code::OutOfRange => "out_of_range",
        Code::Unimplemented => "unimplemented",
        Code::Internal => "internal",
        Code::Unavailable => "unavailable",
        Code::DataLoss => "data_loss",
        Code::Unauthenticated => "unauthenticated",
        Code::DeadlineExceeded => "deadline_exceeded",
        Code::Cancelled => "cancelled",
        Code::Ok | Code::Unknown | Code::Aborted => "other",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_noted_is_told() {
        let metrics = Metrics::default();
        metrics.note_leases(3);
        metrics.note_completion(500, 2.5);
        metrics.note_upload(Duration::from_millis(1));
        metrics.note_publication(Duration::from_millis(9));
        metrics.note_commit(Duration::from_millis(4), 20);
        let second = Duration::from_secs(1);
        metrics.note_call("/brdfarm.v1.Farm/PutBlob", second, None);
        let refused = Some(tonic::Code::PermissionDenied);
        metrics.note_call("/anything/at/all", second, refused);
        let report = Report {
            images_per_second: 1.5,
            store_bytes: 9,
            ..Report::default()
        };
        let text = metrics.text(&report, 7);
        for line in [
            "brdfarm_leases_total 3",
            "brdfarm_received_bytes_total 500",
            "brdfarm_images_per_second 1.5",
            "brdfarm_store_bytes 9.0",
            "brdfarm_store_free_bytes 7.0",
            "brdfarm_jobs{state=\"pending\"} 0",
            "brdfarm_render_seconds_count 1",
            "brdfarm_upload_seconds_count 1",
            "brdfarm_publication_seconds_count 1",
            "brdfarm_ledger_commit_seconds_count 1",
            "brdfarm_call_seconds_count{call=\"PutBlob\"} 1",
            "brdfarm_call_seconds_count{call=\"other\"} 1",
            "brdfarm_errors_total{code=\"permission_denied\"} 1",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
    }
}
