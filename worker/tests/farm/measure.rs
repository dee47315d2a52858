use crate::bench::{Bench, Puppet};
use dataset::Digest;
use std::time::Instant;

async fn measure(views: usize, width: u32, clients: usize, jobs: u32) {
    let mut bench = Bench::new(jobs);
    bench.specification = dataset::Specification::preset();
    bench.specification.materials = jobs;
    bench.specification.views.truncate(views);
    bench.specification.image.width = width;
    bench.specification.image.height = width;
    let coordinator = bench.coordinator().await;
    let mut puppets = Vec::new();
    for _ in 0..clients {
        puppets.push(Puppet::register(&bench, &coordinator.url()).await);
    }
    // images made before
    let images: std::sync::Arc<Vec<Vec<Vec<u8>>>> =
        std::sync::Arc::new((0..jobs).map(|m| puppets[0].images(m)).collect());
    let bytes: usize = images[0].iter().map(Vec::len).sum();
    let started = Instant::now();
    let mut set = tokio::task::JoinSet::new();
    for mut puppet in puppets {
        let images = images.clone();
        set.spawn(async move {
            loop {
                let leased = puppet.lease(1).await;
                if leased.jobs.is_empty() {
                    return;
                }
                for job in leased.jobs {
                    let mine = &images[job.material as usize];
                    for image in mine {
                        puppet.put(Digest::of(image), image.clone()).await.unwrap();
                    }
                    puppet
                        .complete_with(&job.token, job.material, mine)
                        .await
                        .unwrap();
                }
            }
        });
    }
    while set.join_next().await.is_some() {}
    let seconds = started.elapsed().as_secs_f64();
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(progress.counts.completed, jobs);
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap();
    eprintln!(
        "{views} views of {width}px ({} KB a job), {clients} clients: {:.0} completions/s, {:.1} MB/s, {line}",
        bytes / 1000,
        f64::from(jobs) / seconds,
        bytes as f64 * f64::from(jobs) / seconds / 1e6
    );
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn measure_all() {
    measure(1, 16, 1, 300).await;
    measure(1, 16, 64, 3000).await;
    measure(1, 16, 256, 6000).await;
    measure(14, 128, 16, 200).await;
}
