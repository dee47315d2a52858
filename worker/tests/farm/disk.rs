//! A disk that fills up while a farm is at work, and has room again. What fills it is a file.

use crate::bench::{Bench, Puppet, cheap};
use dataset::Digest;
use imagestore::room::Room;
use limits::DISK_RESERVE_FOR_RECORDS_BYTES;
use std::{
    fs::{self, File},
    io::Write,
    path::Path,
    time::Duration,
};
use tokio::time::{sleep, timeout};
use tonic::{Code, Status};

/// Others write to this disk too while the test runs: no step is nearer than this to a limit.
const MARGIN_BYTES: u64 = DISK_RESERVE_FOR_RECORDS_BYTES / 2;

/// Takes room until less than `free` is left.
fn fill(path: &Path, free: u64) {
    let mut file = File::create(path).unwrap();
    let room = Room::all_of(path);
    let block = vec![1; 4 << 20];
    while room.free_bytes().unwrap() > free {
        file.write_all(&block).unwrap();
        file.sync_data().unwrap();
    }
}

fn expect_full<T: std::fmt::Debug>(answer: Result<T, Status>) {
    let status = answer.unwrap_err();
    assert_eq!(status.code(), Code::ResourceExhausted, "{status:?}");
    assert!(status.message().contains("the disk is full"), "{status:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_full_disk_takes_nothing_new_keeps_what_came_and_goes_on_when_there_is_room() {
    let mut bench = Bench::new(4);
    let free = Room::all_of(bench.path()).free_bytes().unwrap();
    bench.disk_reserve_bytes = free - MARGIN_BYTES;
    let coordinator = bench.coordinator().await;
    let url = coordinator.url();
    let mut worker = Puppet::register(&bench, &url).await;
    let jobs = worker.lease(3).await.jobs;
    worker.put_all(0).await;
    worker.put_all(1).await;

    // Too little for images, and enough for records.
    let first = bench.path().join("first");
    fill(&first, bench.disk_reserve_bytes - MARGIN_BYTES);
    expect_full(worker.try_lease(1).await);
    let image = worker.images(2).swap_remove(0);
    expect_full(worker.put(2, Digest::of(&image), image).await);
    worker.complete(&jobs[0].token, 0).await.unwrap();
    let kept = coordinator.progress().borrow().counts;
    assert_eq!((kept.completed, kept.leased), (1, 2));

    // Not even for those.
    let second = bench.path().join("second");
    let records = bench.disk_reserve_bytes - DISK_RESERVE_FOR_RECORDS_BYTES;
    fill(&second, records - MARGIN_BYTES);
    let (token, mut late) = (jobs[1].token.clone(), worker.clone());
    let completing = tokio::spawn(async move { late.complete(&token, 1).await });
    sleep(Duration::from_secs(1)).await;
    assert!(!completing.is_finished(), "it was recorded");
    let renewed = worker.renew(&jobs[2].token, 2, 1).await;
    assert!(renewed.lost.is_empty(), "what writes nothing is answered");

    for file in [first, second] {
        fs::remove_file(file).unwrap();
    }
    let completed = timeout(Duration::from_secs(30), completing).await;
    completed.unwrap().unwrap().unwrap();
    worker.put_all(2).await;
    worker.complete(&jobs[2].token, 2).await.unwrap();
    let last = bench.worker(&url, cheap);
    coordinator.wait_until_finished().await.unwrap();
    assert_eq!(last.summary().await.materials, 1);
    coordinator.shutdown().await;
    assert_eq!(bench.digests(), bench.expected_digests());
}

/// A worker waits for room as for a coordinator that is away.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_coordinator_that_begins_on_a_full_disk_waits_for_room_and_can_be_stopped() {
    let mut bench = Bench::new(2);
    let free = Room::all_of(bench.path()).free_bytes().unwrap();
    // Far more than the test beside this one takes and gives back.
    bench.disk_reserve_bytes = free + (8 << 30);
    let coordinator = bench.coordinator().await;
    let mut early = Puppet::register(&bench, &coordinator.url()).await;
    expect_full(early.try_lease(1).await);
    let worker = bench.worker(&coordinator.url(), cheap);
    sleep(Duration::from_secs(1)).await;
    assert_eq!(coordinator.progress().borrow().counts.pending, 2);
    worker.stop.send(true).unwrap();
    assert_eq!(worker.summary().await.materials, 0);
    coordinator.shutdown().await;
}
