use crate::{
    bench::{Bench, cheap, slow},
    cheap_image::cheap_image,
};
use dataset::specification::Pixel;
use datastore::ReadOnlyStore;
use datastore::verify::{Checks, verify};
use limits::protocol::IMAGES_BROUGHT_BYTES_MAX;
use renderer::geometry::BackendChoice;
use tokio::sync::watch;
use worker::{RenderFailure, RendererBackend, Worker};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_workers_complete_a_set_with_every_image_once() {
    let bench = Bench::new(20);
    let coordinator = bench.coordinator().await;
    let workers = [0, 1].map(|_| bench.worker(&coordinator.url(), slow));
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(progress.counts.completed, 20);
    assert_eq!(progress.images, 60);
    let mut materials = Vec::new();
    for worker in workers {
        let summary = worker.summary().await;
        assert_eq!(summary.images, 3 * summary.materials);
        assert_eq!(summary.failures + summary.lost, 0);
        materials.push(summary.materials);
    }
    assert_eq!(materials.iter().sum::<u64>(), 20);
    assert!(
        materials.iter().all(|materials| *materials > 0),
        "both work: {materials:?}"
    );
    assert_eq!(bench.rendered(), 60);
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

/// Together they are more than a completion may bring along.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn large_images_are_sent_one_by_one() {
    let mut bench = Bench::new(2);
    (
        bench.specification.image.width,
        bench.specification.image.height,
    ) = (1024, 512);
    bench.specification.image.pixel = Pixel::Float;
    let bytes: usize = (0..3)
        .map(|view| cheap_image(&bench.specification, 0, view).len())
        .sum();
    assert!(bytes as u64 > IMAGES_BROUGHT_BYTES_MAX, "{bytes} bytes");
    let coordinator = bench.coordinator().await;
    let worker = bench.worker(&coordinator.url(), cheap);
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(progress.counts.completed, 2);
    assert_eq!(worker.summary().await.failures, 0);
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_set_grows_without_rendering_anything_again() {
    let mut bench = Bench::new(4);
    for materials in [4, 9, 9, 6] {
        bench.specification.materials = materials;
        let coordinator = bench.coordinator().await;
        let worker = bench.worker(&coordinator.url(), cheap);
        let progress = coordinator.wait_until_finished().await.unwrap();
        assert_eq!(progress.counts.completed, materials);
        worker.summary().await;
        coordinator.shutdown().await;
    }
    assert_eq!(bench.rendered(), 27);
    bench.specification.materials = 9;
    assert_eq!(bench.digests(), bench.expected_digests());
}

fn fails_on_one(material: u32, view: u32) -> Result<(), RenderFailure> {
    match (material, view) {
        (2, 1) => Err(RenderFailure("the bulb is broken".to_owned())),
        (3, 2) => panic!("a test's renderer panics"),
        _ => Ok(()),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_cannot_be_rendered_is_quarantined_with_its_errors_and_can_be_retried() {
    let mut bench = Bench::new(5);
    // There is one worker: what it fails goes back to it.
    bench.policy.failures_max = 3;
    let coordinator = bench.coordinator().await;
    let worker = bench.worker(&coordinator.url(), fails_on_one);
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(
        (progress.counts.completed, progress.counts.quarantined),
        (3, 2)
    );
    assert_eq!(progress.failures, 6);
    assert_eq!(worker.summary().await.failures, 6);
    let quarantined = coordinator.quarantined().await.unwrap();
    let bulb = vec!["view 1: the bulb is broken".to_owned(); 3];
    let panicked = vec!["view 2: the renderer panicked".to_owned(); 3];
    assert_eq!(quarantined, [(2, bulb), (3, panicked)]);
    coordinator.shutdown().await;
    let store = ReadOnlyStore::open(bench.path()).unwrap();
    assert_eq!(store.materials_missing(), 2);

    let coordinator = bench.coordinator().await;
    let worker = bench.worker(&coordinator.url(), cheap);
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(progress.counts.completed, 5);
    worker.summary().await;
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_renderer_s_images_are_what_the_coordinator_accepts() {
    let mut bench = Bench::new(2);
    bench.specification.integrator.samples_per_pixel = 16;
    let coordinator = bench.coordinator().await;
    let prepare = |specification: &dataset::Specification| {
        RendererBackend::new(specification, BackendChoice::Native)
            .map_err(|error| RenderFailure(error.to_string()))
    };
    let options = worker::Options::default();
    let worker = Worker::connect(&[coordinator.url()], options, prepare).await;
    let (_stop, stopping) = watch::channel(false);
    let summary = worker.unwrap().run(stopping).await.unwrap();
    assert_eq!((summary.materials, summary.failures), (2, 0));
    coordinator.shutdown().await;
    let store = ReadOnlyStore::open(bench.path()).unwrap();
    let checks = Checks::without_renderer(store.specification().materials, 1);
    let report = verify(&store, &checks, &|_| ()).unwrap();
    assert_eq!(report.faults, []);
    assert_eq!(report.images_sound, 6);
}
