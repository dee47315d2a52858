use crate::{
    bench::{Behaviour, Bench, CheapRenderer, Puppet, WorkerAtWork, cheap, slow},
    cheap_image::Cheap,
};
use coordinator::RunningCoordinator;
use dataset::{SampledMaterial, Specification};
use proto::{ControlClient, Event, JobState, client::with_deadline};
use std::{sync::Arc, time::Duration};
use tokio::time::timeout;
use tonic::Code;
use worker::{Render, RenderFailure, RenderedView};

fn named(
    bench: &Bench,
    name: &str,
    coordinator: &RunningCoordinator,
    behaviour: impl Behaviour,
) -> WorkerAtWork {
    let rendered = Arc::clone(&bench.rendered);
    let renderer =
        move |specification: &Specification| CheapRenderer::new(specification, rendered, behaviour);
    bench.worker_called(name, &coordinator.url(), renderer)
}

async fn job(control: &mut ControlClient, material: u32) -> proto::JobDetail {
    let range = proto::MaterialRange {
        first: material,
        last: material,
    };
    let message = proto::ListJobsRequest {
        selection: Some(proto::JobSelection {
            ranges: vec![range],
            states: Vec::new(),
        }),
        from: 0,
        jobs_max: 1,
    };
    let answer = control.list_jobs(with_deadline(message)).await.unwrap();
    answer.into_inner().jobs.remove(0)
}

async fn workers(control: &mut ControlClient) -> Vec<proto::WorkerDetail> {
    let message = with_deadline(proto::ListWorkersRequest {});
    control
        .list_workers(message)
        .await
        .unwrap()
        .into_inner()
        .workers
}

fn selected(first: u32, last: u32) -> Option<proto::JobSelection> {
    Some(proto::JobSelection {
        ranges: vec![proto::MaterialRange { first, last }],
        states: Vec::new(),
    })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_fails_everything_is_blocked_and_the_others_finish() {
    let bench = Bench::new(12);
    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    let dark = |_, _| Err(RenderFailure("no light".to_owned()));
    let broken = named(&bench, "broken", &coordinator, dark);
    let mut progress = coordinator.progress();
    let failed = progress.wait_for(|progress| progress.failures == 3);
    timeout(Duration::from_secs(10), failed)
        .await
        .unwrap()
        .unwrap();
    let blocked = workers(&mut control).await;
    assert_eq!(blocked[0].name, "broken");
    assert!(
        blocked[0].barred.contains("3 different materials"),
        "{blocked:?}"
    );
    assert_eq!(blocked[0].failures_in_a_row.len(), 3);
    assert_eq!(blocked[0].failures_in_a_row[0].error, "view 0: no light");

    let sound = named(&bench, "sound", &coordinator, cheap);
    let finished = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(
        (finished.counts.completed, finished.counts.quarantined),
        (12, 0)
    );
    assert_eq!(finished.failures, 3);
    sound.summary().await;
    broken.summary().await;
    let failed = job(&mut control, 0).await;
    assert_eq!(failed.failures.len(), 1, "its errors are kept");
    assert_eq!(failed.failures[0].worker, "broken");

    let unblock = || {
        with_deadline(proto::UnbarWorkerRequest {
            name: "broken".to_owned(),
        })
    };
    control.unbar_worker(unblock()).await.unwrap();
    assert_eq!(
        control.unbar_worker(unblock()).await.unwrap_err().code(),
        Code::NotFound
    );
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_is_quarantined_after_failing_on_three_workers_and_retried_on_request() {
    let bench = Bench::new(4);
    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    let cursed = |material, _| match material {
        2 => Err(RenderFailure("cursed".to_owned())),
        _ => {
            std::thread::sleep(Duration::from_millis(30));
            Ok(())
        }
    };
    let names = ["a", "b", "c"];
    let working = names.map(|name| named(&bench, name, &coordinator, cursed));
    let finished = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(
        (finished.counts.completed, finished.counts.quarantined),
        (3, 1)
    );
    for worker in working {
        worker.summary().await;
    }
    let failed = job(&mut control, 2).await;
    assert_eq!(failed.state(), JobState::SetAside);
    let mut on: Vec<&str> = failed
        .failures
        .iter()
        .map(|failure| &*failure.worker)
        .collect();
    on.sort_unstable();
    assert_eq!(on, names, "once on each");
    assert!(
        workers(&mut control)
            .await
            .iter()
            .all(|worker| worker.barred.is_empty())
    );

    let message = proto::RetryJobsRequest {
        selection: selected(0, 3),
    };
    let answer = control.retry_jobs(with_deadline(message)).await.unwrap();
    let changed = answer.into_inner().changed;
    assert_eq!(
        (changed.len(), changed[0].first, changed[0].last),
        (1, 2, 2)
    );
    let worker = named(&bench, "d", &coordinator, cheap);
    let finished = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(finished.counts.completed, 4);
    worker.summary().await;
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_an_operator_orders_outlives_a_restart() {
    let bench = Bench::new(10);
    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    let mut puppet = Puppet::called("lazy", &bench, &coordinator.url()).await;
    let held = puppet.lease(2).await.jobs;
    assert_eq!(held[1].material, 1);
    let message = proto::CancelJobsRequest {
        selection: selected(1, 3),
    };
    let answer = control.cancel_jobs(with_deadline(message)).await.unwrap();
    assert_eq!(answer.into_inner().changed[0].last, 3);
    let message = proto::PrioritizeJobsRequest {
        selection: selected(7, 8),
        priority: 5,
    };
    control
        .prioritize_jobs(with_deadline(message))
        .await
        .unwrap();
    let message = proto::BarWorkerRequest {
        name: "lazy".to_owned(),
        reason: "it is lazy".to_owned(),
    };
    let answer = control.bar_worker(with_deadline(message)).await.unwrap();
    assert_eq!(answer.into_inner().leases_taken_back, 1);
    let mut other = Puppet::called("other", &bench, &coordinator.url()).await;
    let pause = with_deadline(proto::PauseRequest {});
    assert!(!control.pause(pause).await.unwrap().into_inner().repeated);
    assert!(other.lease(1).await.jobs.is_empty());
    coordinator.shutdown().await;

    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    let status = control.status(with_deadline(proto::StatusRequest {})).await;
    let status = status.unwrap().into_inner();
    assert_eq!(status.mode(), proto::Mode::Paused);
    let counts = status.counts.unwrap();
    assert_eq!(
        (counts.cancelled, counts.pending, counts.workers_barred),
        (3, 7, 1)
    );
    let mut lazy = Puppet::called("lazy", &bench, &coordinator.url()).await;
    let mut other = Puppet::called("other", &bench, &coordinator.url()).await;
    assert!(other.lease(1).await.jobs.is_empty(), "still paused");
    control
        .resume(with_deadline(proto::ResumeRequest {}))
        .await
        .unwrap();
    let refused = lazy.lease(1).await;
    assert!(refused.jobs.is_empty());
    assert_eq!(refused.barred, "it is lazy");
    let jobs = other.lease(3).await.jobs;
    let order: Vec<u32> = jobs.iter().map(|job| job.material).collect();
    assert_eq!(order, [7, 8, 0], "priority first, cancelled never");

    control
        .drain(with_deadline(proto::DrainRequest {}))
        .await
        .unwrap();
    assert!(other.lease(1).await.draining);
    other.put_all(7).await;
    let answer = other.complete(&jobs[0].token, 7).await.unwrap();
    assert!(answer.missing.is_empty(), "what is held is finished");
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drained_farm_s_workers_leave_with_their_work_delivered() {
    let bench = Bench::new(40);
    let coordinator = bench.coordinator().await;
    let worker = bench.worker(&coordinator.url(), slow);
    let mut progress = coordinator.progress();
    let begun = progress.wait_for(|progress| progress.counts.completed >= 1);
    begun.await.unwrap();
    let mut control = bench.control(&coordinator.url());
    control
        .drain(with_deadline(proto::DrainRequest {}))
        .await
        .unwrap();
    let summary = worker.summary().await;
    let counts = coordinator.progress().borrow().counts;
    assert_eq!(u64::from(counts.completed), summary.materials);
    assert_eq!((counts.leased, summary.lost), (0, 0));
    assert!(counts.pending > 30);
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_that_takes_too_long_is_given_to_another_worker() {
    let mut bench = Bench::new(2);
    bench.policy.deadline = Duration::from_millis(400);
    let coordinator = bench.coordinator().await;
    let wedged = named(&bench, "wedged", &coordinator, |_, _| {
        std::thread::sleep(Duration::from_secs(3));
        Ok(())
    });
    let failed = timeout(Duration::from_secs(2), wedged.outcome())
        .await
        .unwrap();
    let error = failed.unwrap_err().to_string();
    assert!(error.contains("start this worker again"), "{error}");
    let sound = named(&bench, "sound", &coordinator, cheap);
    let finished = coordinator.wait_until_finished().await.unwrap();
    assert_eq!((finished.counts.completed, finished.failures), (2, 1));
    sound.summary().await;
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_happens_can_be_watched_and_images_fetched() {
    let bench = Bench::new(1);
    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    let watching = control.watch_events(proto::WatchEventsRequest {}).await;
    let mut watching = watching.unwrap().into_inner();
    let worker = named(&bench, "seen", &coordinator, cheap);
    coordinator.wait_until_finished().await.unwrap();
    worker.summary().await;
    let mut seen: Vec<Event> = Vec::new();
    while seen.last().is_none_or(|event| event.kind != "left") {
        let event = timeout(Duration::from_secs(5), watching.message()).await;
        seen.push(event.unwrap().unwrap().unwrap());
    }
    let kinds: Vec<&str> = seen.iter().map(|event| &*event.kind).collect();
    assert_eq!(kinds, ["registered", "leased", "completed", "left"]);
    assert!(seen.iter().all(|event| event.worker == "seen"));
    assert_eq!(seen[1].lease.len(), 8);
    assert_eq!(seen[1].lease, seen[2].lease);

    let digest = bench.expected_digests()[1];
    let fetch = |digest: dataset::Digest| {
        with_deadline(proto::GetBlobRequest {
            digest: digest.as_bytes().to_vec(),
        })
    };
    let image = control.get_blob(fetch(digest)).await.unwrap().into_inner();
    assert_eq!(dataset::Digest::of(&image.data), digest);
    let other = dataset::Digest::of(b"other");
    let refused = control.get_blob(fetch(other)).await.unwrap_err();
    assert_eq!(refused.code(), Code::NotFound);
    coordinator.shutdown().await;
}

/// Renders one view in five a little too bright.
struct Liar(Specification);

impl Render for Liar {
    fn render(&self, material: &SampledMaterial, view: u32) -> Result<RenderedView, RenderFailure> {
        let mut image = Cheap::new(&self.0, material.index, view);
        if (material.index * 3 + view).is_multiple_of(5) {
            image.value += 1.0 / 16.0;
        }
        std::thread::sleep(Duration::from_millis(2));
        Ok(crate::bench::rendered(&self.0, view, image.encode()))
    }
}

/// Must show 8: the liar is blocked, and the set is what an undisturbed run's is.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_lies_is_found_out_and_its_work_rendered_again() {
    let mut bench = Bench::new(60);
    bench.redundant_per_million = 200_000;
    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    let lie = |specification: &Specification| Liar(specification.clone());
    let liar = bench.worker_called("liar", &coordinator.url(), lie);
    // It gets a good start.
    let mut progress = coordinator.progress();
    let begun = progress.wait_for(|progress| progress.counts.completed >= 15);
    timeout(Duration::from_secs(20), begun)
        .await
        .unwrap()
        .unwrap();
    let honest = ["a", "b"].map(|name| named(&bench, name, &coordinator, slow));
    let finished = timeout(Duration::from_secs(60), coordinator.wait_until_finished());
    let finished = finished.await.unwrap().unwrap();
    assert_eq!(finished.counts.completed, 60);
    assert_eq!(finished.counts.disputed + finished.counts.redundant, 0);
    for worker in honest {
        worker.summary().await;
    }
    let all = workers(&mut control).await;
    for worker in &all {
        assert_eq!(worker.barred.is_empty(), worker.name != "liar", "{all:#?}");
    }
    liar.summary().await;
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
    // Not even a lost ledger brings the lies back.
    std::fs::remove_dir_all(bench.path().join("ledger")).unwrap();
    let coordinator = bench.coordinator().await;
    assert_eq!(coordinator.progress().borrow().counts.completed, 60);
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}
