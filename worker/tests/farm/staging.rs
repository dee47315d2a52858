//! Room for images on their way: who has it, and how long.

use crate::bench::{Bench, Puppet, SHORT_LEASE, rendered};
use crate::cheap_image::noisy_image;
use dataset::{Digest, SampledMaterial, Specification};
use imagestore::validation::{expected_headers, image_bytes_max};
use proto::client::with_deadline;
use std::{fs, time::Duration};
use tokio::{
    task::JoinSet,
    time::{sleep, timeout},
};
use tonic::Code;
use worker::{Render, RenderFailure, RenderedView};

/// Renders images that do not compress.
struct Noisy(Specification);

impl Render for Noisy {
    fn render(&self, material: &SampledMaterial, view: u32) -> Result<RenderedView, RenderFailure> {
        let exr = noisy_image(&self.0, material.index, view);
        Ok(rendered(&self.0, view, exr))
    }
}

fn staged(bench: &Bench) -> usize {
    fs::read_dir(bench.path().join("staging")).unwrap().count()
}

async fn nothing_is_staged(bench: &Bench) {
    let gone = async {
        while staged(bench) > 0 {
            sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(Duration::from_secs(10), gone).await.unwrap();
}

/// The most that one material's images can have, bytes.
fn job_bytes_max(specification: &Specification) -> u64 {
    let headers = expected_headers(specification, specification.hash(), 0);
    let sizes = headers.iter();
    let sizes = sizes.map(|header| image_bytes_max(specification, header));
    sizes.sum()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn images_are_taken_only_under_the_lease_of_their_material() {
    let bench = Bench::new(3);
    let coordinator = bench.coordinator().await;
    let mut puppet = Puppet::register(&bench, &coordinator.url()).await;
    let job = puppet.lease_one().await;
    let other = puppet.lease_one().await;
    let image = puppet.images(0).swap_remove(0);
    let digest = Digest::of(&image);
    for (token, material, code, what) in [
        (Vec::new(), 0, Code::InvalidArgument, "names none"),
        (vec![7; 16], 0, Code::FailedPrecondition, "is lost"),
        (other.token.clone(), 0, Code::FailedPrecondition, "is lost"),
        (job.token.clone(), 9, Code::InvalidArgument, "material 9"),
        // A sound image, and of another material than the lease.
        (other.token.clone(), 1, Code::InvalidArgument, "Some(0)"),
    ] {
        let put = puppet.put_under(token, material, digest, image.clone());
        let refused = put.await.unwrap_err();
        assert_eq!(refused.code(), code, "{refused}");
        assert!(refused.message().contains(what), "{refused}");
    }
    assert_eq!(staged(&bench), 0);
    puppet.put(0, digest, image).await.unwrap();
    assert_eq!(staged(&bench), 1);
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_staged_dies_with_its_lease_however_that_ends() {
    let mut bench = Bench::new(6);
    bench.policy.lease = 4 * SHORT_LEASE;
    let coordinator = bench.coordinator().await;
    let mut control = bench.control(&coordinator.url());
    for end in ["expiry", "failure", "leave", "cancel", "block"] {
        let mut puppet = Puppet::called(end, &bench, &coordinator.url()).await;
        let job = puppet.lease_one().await;
        puppet.put_all(job.material).await;
        assert_eq!(staged(&bench), 3, "{end}");
        match end {
            "failure" => {
                let message = proto::FailRequest {
                    token: job.token,
                    material: job.material,
                    error: "no light".to_owned(),
                };
                puppet.client.fail(with_deadline(message)).await.unwrap();
            }
            "leave" => {
                let message = proto::DeregisterRequest {
                    worker_id: puppet.id,
                };
                let left = puppet.client.deregister(with_deadline(message)).await;
                left.unwrap();
            }
            "cancel" => {
                let ranges = vec![proto::MaterialRange {
                    first: job.material,
                    last: job.material,
                }];
                let selection = Some(proto::JobSelection {
                    ranges,
                    states: Vec::new(),
                });
                let message = proto::CancelJobsRequest { selection };
                control.cancel_jobs(with_deadline(message)).await.unwrap();
            }
            "block" => {
                let message = proto::BarWorkerRequest {
                    name: end.to_owned(),
                    reason: "a test".to_owned(),
                };
                control.bar_worker(with_deadline(message)).await.unwrap();
            }
            _ => {}
        }
        nothing_is_staged(&bench).await;
    }
    coordinator.shutdown().await;
}

/// 28 workers whose jobs' images are, together, eight times what there is room for: all complete.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn workers_whose_images_do_not_fit_together_wait_for_each_other() {
    const WORKERS: u32 = 28;
    let mut bench = Bench::new(WORKERS);
    // Too large to come along with the completion.
    (
        bench.specification.image.width,
        bench.specification.image.height,
    ) = (192, 96);
    bench.staged_bytes_max = job_bytes_max(&bench.specification) * 7 / 2;
    let coordinator = bench.coordinator().await;
    let url = coordinator.url();
    let workers: Vec<_> = (0..WORKERS)
        .map(|number| {
            let render = |specification: &Specification| Noisy(specification.clone());
            bench.worker_called(&format!("w{number}"), &url, render)
        })
        .collect();
    let finished = timeout(Duration::from_secs(60), coordinator.wait_until_finished()).await;
    assert_eq!(finished.unwrap().unwrap().counts.completed, WORKERS);
    let mut rendered = 0;
    for worker in workers {
        rendered += worker.summary().await.materials;
    }
    assert_eq!(rendered, u64::from(WORKERS));
    coordinator.shutdown().await;
    assert_eq!(bench.digests().len(), 3 * WORKERS as usize);
}

/// Somebody leases what there is and fills all room that this gets him, without end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_stages_and_never_completes_keeps_nobody_from_completing() {
    let mut bench = Bench::new(60);
    (
        bench.specification.image.width,
        bench.specification.image.height,
    ) = (192, 96);
    bench.staged_bytes_max = job_bytes_max(&bench.specification) * 8;
    let coordinator = bench.coordinator().await;
    let url = coordinator.url();
    let mut flood = JoinSet::new();
    let mut puppet = Puppet::called("flood", &bench, &url).await;
    let jobs = puppet.lease(30).await.jobs;
    assert_eq!(jobs.len(), 30);
    for job in jobs {
        let mut puppet = puppet.clone();
        let specification = bench.specification.clone();
        flood.spawn(async move {
            loop {
                for view in 0..3 {
                    let image = noisy_image(&specification, job.material, view);
                    let put = puppet.put(job.material, Digest::of(&image), image);
                    drop(put.await);
                }
                sleep(Duration::from_millis(100)).await;
            }
        });
    }
    sleep(Duration::from_millis(500)).await;
    let render = |specification: &Specification| Noisy(specification.clone());
    let workers = [1, 2].map(|number| bench.worker_called(&format!("w{number}"), &url, render));
    let mut progress = coordinator.progress();
    let done = progress.wait_for(|progress| progress.counts.completed == 30);
    timeout(Duration::from_secs(30), done)
        .await
        .unwrap()
        .unwrap();
    flood.shutdown().await;
    for worker in workers {
        worker.stop.send_replace(true);
        worker.summary().await;
    }
    coordinator.shutdown().await;
}
