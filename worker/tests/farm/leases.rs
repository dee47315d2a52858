use crate::bench::{Bench, Puppet, SHORT_LEASE, cheap, slow};
use proto::client::with_deadline;
use std::time::Duration;
use tokio::time::{Instant, sleep, timeout};
use tonic::Code;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_lost_lease_goes_to_another_worker_and_its_late_completion_does_not_count() {
    let mut bench = Bench::new(3);
    bench.policy.lease = SHORT_LEASE;
    let coordinator = bench.coordinator().await;
    let mut silent = Puppet::register(&bench, &coordinator.url()).await;
    let lost = silent.lease_one().await;
    assert_eq!(lost.material, 0);
    silent.put_all(0).await;
    let mut progress = coordinator.progress();
    let expired = progress.wait_for(|progress| progress.leases_lost == 1);
    let expired = timeout(4 * SHORT_LEASE, expired).await;
    assert_eq!(expired.unwrap().unwrap().counts.pending, 3);

    // Nobody holds it: the old token is worth nothing all the same.
    let late = silent.complete(&lost.token, 0).await.unwrap_err();
    assert_eq!(late.code(), Code::FailedPrecondition);
    // Somebody else does.
    let mut other = Puppet::register(&bench, &coordinator.url()).await;
    let taken = other.lease_one().await;
    assert_eq!(taken.material, 0);
    let late = silent.complete(&lost.token, 0).await.unwrap_err();
    assert_eq!(late.code(), Code::FailedPrecondition);
    assert_eq!(coordinator.progress().borrow().counts.completed, 0);

    let answer = other.complete(&taken.token, 0).await.unwrap();
    assert_eq!(
        answer.missing.len(),
        3,
        "what was staged died with its lease"
    );
    other.put_all(0).await;
    let answer = other.complete(&taken.token, 0).await.unwrap();
    assert!(answer.missing.is_empty() && !answer.repeated);
    // Done: the same again is no error and changes nothing, whoever says it.
    for token in [&lost.token, &taken.token] {
        let answer = silent.complete(token, 0).await.unwrap();
        assert!(answer.missing.is_empty() && answer.repeated);
    }
    // Other images of it are.
    let mut others = silent.images(0);
    others.swap(0, 1);
    let conflict = silent.complete_with(&taken.token, 0, &others).await;
    assert_eq!(conflict.unwrap_err().code(), Code::AlreadyExists);

    let worker = bench.worker(&coordinator.url(), cheap);
    coordinator.wait_until_finished().await.unwrap();
    assert_eq!(worker.summary().await.materials, 2);
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn renewal_keeps_a_lease_that_takes_longer_than_its_time() {
    let mut bench = Bench::new(2);
    bench.policy.lease = Duration::from_millis(120);
    let coordinator = bench.coordinator().await;
    // Three views of 60 ms, and the second job waits for the first.
    let worker = bench.worker(&coordinator.url(), slow);
    let progress = coordinator.wait_until_finished().await.unwrap();
    assert_eq!(progress.leases_lost, 0);
    assert_eq!(worker.summary().await.lost, 0);
    assert_eq!(bench.rendered(), 6);
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn renewal_without_progress_ends_and_says_so() {
    let mut bench = Bench::new(1);
    bench.policy.lease = SHORT_LEASE;
    bench.policy.stall = 2 * SHORT_LEASE;
    let coordinator = bench.coordinator().await;
    let mut wedged = Puppet::register(&bench, &coordinator.url()).await;
    let job = wedged.lease_one().await;
    let started = Instant::now();
    // One view is done and no other ever is. Before the first, a job may wait behind another.
    let renewals = async {
        while wedged.renew(&job.token, 0, 1).await.lost != [0] {
            sleep(SHORT_LEASE / 4).await;
        }
    };
    timeout(Duration::from_secs(30), renewals).await.unwrap();
    assert!(started.elapsed() > SHORT_LEASE, "renewal worked at first");
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_worker_that_stops_hands_its_leases_back_at_once() {
    let bench = Bench::new(40);
    let coordinator = bench.coordinator().await;
    let worker = bench.worker(&coordinator.url(), slow);
    let mut progress = coordinator.progress();
    progress
        .wait_for(|progress| progress.counts.completed >= 1)
        .await
        .unwrap();
    worker.stop.send(true).unwrap();
    let summary = worker.summary().await;
    let progress = *coordinator.progress().borrow();
    assert_eq!(u64::from(progress.counts.completed), summary.materials);
    assert_eq!(progress.counts.leased, 0);
    assert_eq!(progress.failures + progress.leases_lost, 0);
    assert!(progress.counts.pending > 30);
    coordinator.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_call_for_work_waits_for_it() {
    let bench = Bench::new(1);
    let coordinator = bench.coordinator().await;
    let mut holder = Puppet::register(&bench, &coordinator.url()).await;
    holder.lease_one().await;
    let mut waiting = Puppet::register(&bench, &coordinator.url()).await;
    assert!(waiting.lease(1).await.jobs.is_empty());
    let message = proto::LeaseRequest {
        worker_id: waiting.id.clone(),
        jobs_max: 1,
        wait_ms: 20_000,
    };
    let mut client = waiting.client.clone();
    let call = tokio::spawn(async move { client.lease(with_deadline(message)).await });
    sleep(Duration::from_millis(100)).await;
    assert!(!call.is_finished());
    let message = proto::DeregisterRequest {
        worker_id: holder.id.clone(),
    };
    let answer = holder.client.deregister(with_deadline(message)).await;
    assert_eq!(answer.unwrap().into_inner().released, 1);
    let answer = timeout(Duration::from_secs(5), call).await.unwrap();
    assert_eq!(answer.unwrap().unwrap().into_inner().jobs.len(), 1);
    coordinator.shutdown().await;
}
