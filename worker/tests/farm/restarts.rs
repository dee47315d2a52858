use crate::bench::{Bench, Puppet, cheap, slow};
use std::{
    fs,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};
use tokio::time::sleep;
use worker::WorkerError;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_finished_set_is_not_rendered_again_even_without_its_ledger_or_log() {
    let bench = Bench::new(5);
    for round in 0..4 {
        match round {
            2 => fs::remove_dir_all(bench.path().join("ledger")).unwrap(),
            3 => fs::remove_file(bench.path().join("completions.log")).unwrap(),
            _ => {}
        }
        let coordinator = bench.coordinator().await;
        let worker = bench.worker(&coordinator.url(), cheap);
        let progress = coordinator.wait_until_finished().await.unwrap();
        assert_eq!(progress.counts.completed, 5, "round {round}");
        worker.summary().await;
        coordinator.shutdown().await;
        assert_eq!(bench.rendered(), 15, "round {round}");
        assert_eq!(bench.digests(), bench.expected_digests());
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_lease_outlives_the_coordinator_and_its_images_are_asked_for_again() {
    let bench = Bench::new(2);
    let coordinator = bench.coordinator().await;
    let address = coordinator.local_addr();
    let mut puppet = Puppet::register(&bench, &coordinator.url()).await;
    let job = puppet.lease_one().await;
    puppet.put_all(0).await;
    coordinator.shutdown().await;

    let coordinator = bench.coordinator_on(address).await;
    assert_eq!(coordinator.progress().borrow().counts.leased, 1);
    let answer = puppet.complete(&job.token, 0).await.unwrap();
    assert_eq!(answer.missing.len(), 3, "staging is forgotten");
    puppet.put_all(0).await;
    let answer = puppet.complete(&job.token, 0).await.unwrap();
    assert!(answer.missing.is_empty() && !answer.repeated);
    coordinator.shutdown().await;

    let coordinator = bench.coordinator_on(address).await;
    assert_eq!(coordinator.progress().borrow().counts.completed, 1);
    let answer = puppet.complete(&job.token, 0).await.unwrap();
    assert!(answer.missing.is_empty() && answer.repeated);
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_keeps_its_work_while_the_coordinator_is_away() {
    let bench = Bench::new(8);
    let coordinator = bench.coordinator().await;
    let address = coordinator.local_addr();
    let open = Arc::new(AtomicBool::new(false));
    let gate = Arc::clone(&open);
    let worker = bench.worker(&coordinator.url(), move |material, _| {
        while material >= 3 && !gate.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    });
    let mut progress = coordinator.progress();
    progress
        .wait_for(|progress| progress.counts.completed == 3 && progress.counts.leased == 2)
        .await
        .unwrap();
    coordinator.shutdown().await;
    open.store(true, Ordering::Relaxed);
    // Long enough to render all that is held, and to find nobody to give it to.
    sleep(Duration::from_millis(500)).await;

    let coordinator = bench.coordinator_on(address).await;
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(progress.counts.completed, 8);
    assert_eq!(progress.failures + progress.leases_lost, 0);
    let summary = worker.summary().await;
    assert_eq!((summary.materials, summary.lost), (8, 0));
    assert_eq!(bench.rendered(), 24, "nothing was rendered twice");
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn restarts_in_the_middle_change_nothing() {
    let bench = Bench::new(30);
    let coordinator = bench.coordinator().await;
    let address = coordinator.local_addr();
    let workers = [0, 1].map(|_| bench.worker(&coordinator.url(), slow));
    let mut running = Some(coordinator);
    for _ in 0..3 {
        sleep(Duration::from_millis(300)).await;
        running.take().unwrap().shutdown().await;
        running = Some(bench.coordinator_on(address).await);
    }
    let coordinator = running.unwrap();
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(
        (progress.counts.completed, progress.counts.quarantined),
        (30, 0)
    );
    for worker in workers {
        worker.summary().await;
    }
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_finds_nobody_says_where_it_looked() {
    let bench = Bench::new(1);
    let coordinator = bench.coordinator().await;
    let url = coordinator.url();
    coordinator.shutdown().await;
    let error = worker::Worker::connect::<Never>(
        std::slice::from_ref(&url),
        worker::Options {
            connect_max: Duration::from_millis(300),
            ..worker::Options::default()
        },
        |_| unreachable!("nobody sent a specification"),
    )
    .await
    .err()
    .unwrap();
    assert!(matches!(error, WorkerError::Away { .. }), "{error}");
    assert!(error.to_string().contains(&url), "{error}");
}

enum Never {}

impl worker::Render for Never {
    fn render(
        &self,
        _: &dataset::SampledMaterial,
        _: u32,
    ) -> Result<worker::RenderedView, worker::RenderFailure> {
        match *self {}
    }
}
