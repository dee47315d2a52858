//! What a bucket costs: `tests/object-storage.sh`.

use crate::cheap_image;
use crate::harness::{Harness, Process, patience};
use crate::s3::{BUCKET, Server, UPLOAD};
use bytes::Bytes;
use dataset::{
    CompletedView, Digest, ErrorStatistics, PixelStatistics, SampledMaterial, Specification,
    blob_path,
};
use futures_util::{StreamExt, TryStreamExt, stream};
use jobqueue::Completion;
use jobstore::completion_log::CompletionLog;
use object_store::aws::AmazonS3Builder;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt};
use std::fs;
use std::process::Stdio;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};
use tokio::sync::watch;
use worker::{Render, RenderFailure, RenderedView, Worker};

/// Materials of the synthetic store, unless BRDFARM_SCALE_MATERIALS says otherwise: 126,000 images.
const MATERIALS: u32 = 9000;

/// Peak memory that a command may take, MiB.
const MEMORY_MIB_MAX: u64 = 512;

/// How much longer uploads may take than a plain client's. What comes after them, a look and a copy
/// on the server for each, is told beside.
const RATIO_MAX: f64 = 1.3;

const STATISTICS: ErrorStatistics = ErrorStatistics {
    mean: 0.0,
    p95: 0.0,
    max: 0.0,
    within_target: 1.0,
    samples: 1,
    evaluations: 1,
};

fn materials() -> u32 {
    let asked = std::env::var("BRDFARM_SCALE_MATERIALS").ok();
    asked.map_or(MATERIALS, |asked| asked.parse().expect("a number"))
}

/// Runs a command to its end; says how long it took, what the server was asked and how much memory
/// it had at most, MiB.
fn measure(harness: &Harness, server: &Server, images: u64, arguments: &str) {
    server.forget_counts();
    let began = Instant::now();
    let mut command = harness.command(env!("CARGO_BIN_EXE_brdfarm"), arguments);
    command.envs(harness.environment.clone());
    let mut process = Process::spawn(command.stdout(Stdio::null()));
    let mut peak_bytes = 0;
    while !process.has_ended() {
        peak_bytes = process.memory_bytes("VmHWM").unwrap_or(peak_bytes);
        thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(
        process.ended(patience()).code(),
        Some(0),
        "brdfarm {arguments}"
    );
    let asked: Vec<String> = server
        .counts()
        .iter()
        .map(|(kind, count)| format!("{kind} {:.3}", count.requests as f64 / images as f64))
        .collect();
    println!(
        "{arguments}\n    {:.1} s, {} MiB, requests an image: {}",
        began.elapsed().as_secs_f64(),
        peak_bytes >> 20,
        asked.join(", ")
    );
    assert!(peak_bytes >> 20 <= MEMORY_MIB_MAX, "{arguments}");
}

/// A complete store of small images, its objects put under the server by hand.
fn synthetic(materials: u32) -> (Harness, Server) {
    let mut harness = Harness::new(materials, 16);
    let server = Server::start(&harness.path().join("s3"));
    harness.environment = server.environment();
    harness.options = format!("--blobs s3://{BUCKET}/set");
    harness.start();
    harness.kill_coordinator();
    let specification = Specification::load(&harness.path().join("spec.toml")).expect("valid");
    let root = harness.path().join("s3").join(BUCKET).join("set");
    for number in 0..256 {
        fs::create_dir_all(root.join(format!("blobs/{number:02x}"))).expect("a folder");
    }
    let make = |material: u32| {
        let views = (0..specification.views.len() as u32).map(|view| {
            let image = cheap_image::cheap_image(&specification, material, view);
            let digest = Digest::of(&image);
            fs::write(root.join(blob_path(&digest)), &image).expect("written");
            CompletedView {
                digest,
                bytes: image.len() as u64,
                statistics: STATISTICS,
                pixels: None,
            }
        });
        Completion {
            material,
            views: views.collect(),
            seconds: 1.0,
            worker: "nobody".to_owned(),
        }
    };
    let (mut log, _) =
        CompletionLog::open(&harness.store().join("completions.log")).expect("a log");
    for first in (0..materials).step_by(200) {
        let made: Vec<Completion> = (first..materials.min(first + 200)).map(make).collect();
        log.append(&made).expect("appended");
    }
    (harness, server)
}

#[test]
#[ignore = "takes minutes: tests/object-storage.sh runs it"]
fn a_large_bucket_takes_bounded_memory() {
    let materials = materials();
    let images = u64::from(materials) * 14;
    let (harness, server) = synthetic(materials);
    println!("{images} images");
    let measure = |arguments: &str| measure(&harness, &server, images, arguments);
    measure("dataset verify --store farm");
    measure("dataset gc --store farm");
    measure("dataset export shards --store farm --layout webdataset");
    measure(&format!(
        "dataset export s3://{BUCKET}/out --store farm --layout webdataset"
    ));
    // Opens the store for writing, whose ledger knows nothing yet: it is rebuilt from the log.
    measure("dataset gc --store farm --delete");
}

/// Renders nothing: images are bytes that no compressor shrinks.
struct Bytes14 {
    bytes: usize,
}

impl Render for Bytes14 {
    fn render(&self, material: &SampledMaterial, view: u32) -> Result<RenderedView, RenderFailure> {
        Ok(RenderedView {
            exr: image(material.index, view, self.bytes),
            statistics: STATISTICS,
            pixels: PixelStatistics::default(),
        })
    }
}

fn image(material: u32, view: u32, bytes: usize) -> Vec<u8> {
    let mut key = [0; 8];
    key[..4].copy_from_slice(&material.to_le_bytes());
    key[4..].copy_from_slice(&view.to_le_bytes());
    let mut image = vec![0; bytes];
    blake3::Hasher::new()
        .update(&key)
        .finalize_xof()
        .fill(&mut image);
    image
}

#[test]
#[ignore = "takes a minute: tests/object-storage.sh runs it"]
fn uploads_keep_up_with_a_plain_client() {
    for (bytes, materials) in [(36_000, 60), (1 << 20, 12)] {
        let mut harness = Harness::new(materials, 16);
        let server = Server::start(&harness.path().join("s3"));
        harness.environment = server.environment();
        harness.options = format!("--blobs s3://{BUCKET}/set");
        harness.start();
        let runtime = tokio::runtime::Runtime::new().expect("a runtime");
        let url = format!("http://{}", harness.address);
        let total = u64::from(materials) * 14 * bytes as u64;

        let plain = plain_seconds(&runtime, &server, materials, bytes);
        server.forget_counts();
        let began = Instant::now();
        runtime.block_on(async {
            let (_stop, stopping) = watch::channel(false);
            let options = worker::Options::default();
            Worker::connect(&[url], options, move |_| Ok(Bytes14 { bytes }))
                .await
                .expect("admitted")
                .run(stopping)
                .await
                .expect("done");
        });
        let farm = began.elapsed().as_secs_f64();
        let counts = server.counts();
        let uploads = counts[UPLOAD];
        assert_eq!(uploads.bytes_in, total);
        let others = counts.iter().filter(|(kind, _)| **kind != UPLOAD);
        let elsewhere: u64 = others.map(|(_, count)| count.bytes_in).sum();
        // Lists of keys to remove, and the note of whose place it is.
        assert!(elsewhere < total / 20, "{elsewhere} of {total} bytes");
        println!(
            "{} images of {bytes} bytes: a plain client {:.1} MB/s, a farm {:.1} MB/s, ratio {:.2}; \
             uploads alone {:.1} MB/s, ratio {:.2}",
            materials * 14,
            total as f64 / 1e6 / plain,
            total as f64 / 1e6 / farm,
            farm / plain,
            total as f64 / 1e6 / uploads.seconds(),
            uploads.seconds() / plain,
        );
        let images = f64::from(materials * 14);
        for (kind, count) in &counts {
            println!(
                "    {kind}: {:.2} requests an image, some under way for {:.1} s of {farm:.1}",
                count.requests as f64 / images,
                count.seconds()
            );
        }
        assert!(uploads.seconds() / plain <= RATIO_MAX);
    }
}

/// How long the crate `object_store` takes to put the same bytes, as many at one time.
fn plain_seconds(
    runtime: &tokio::runtime::Runtime,
    server: &Server,
    materials: u32,
    bytes: usize,
) -> f64 {
    // Whoever was first to choose stays.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let mut builder = AmazonS3Builder::new().with_bucket_name(BUCKET);
    for (key, value) in server.environment() {
        let key = key.to_ascii_lowercase().parse().expect("an option");
        builder = builder.with_config(key, value);
    }
    let store: Arc<dyn ObjectStore> = Arc::new(builder.build().expect("a client"));
    let images: Vec<(Key, Bytes)> = (0..materials)
        .flat_map(|material| (0..14).map(move |view| (material, view)))
        .map(|(material, view)| {
            let key = Key::from(format!("plain/{material}/{view}"));
            (key, Bytes::from(image(material, view, bytes)))
        })
        .collect();
    let began = Instant::now();
    runtime.block_on(async {
        let puts = images.into_iter().map(|(key, bytes)| {
            let store = Arc::clone(&store);
            async move { store.put(&key, bytes.into()).await }
        });
        let puts = stream::iter(puts).buffer_unordered(limits::worker::UPLOADS_AT_ONCE);
        puts.try_collect::<Vec<_>>().await.expect("written");
    });
    began.elapsed().as_secs_f64()
}
