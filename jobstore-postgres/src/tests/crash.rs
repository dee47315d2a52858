//! The server is killed during work.

use super::{
    PresenceLimits, assert_tallies, delivery, is_unavailable, job_store, make, tokens, worker,
};
use crate::testing::{Server, client, schema_in};
use jobqueue::Policy;
use jobstore::JobStoreError;
use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::{task::JoinSet, time::sleep};

/// The materials that the database has as complete, with what was rendered.
async fn completed(url: &str) -> BTreeSet<u32> {
    let client = client(url).await;
    let rows = client
        .query(
            "SELECT material FROM jobs JOIN completions USING (material) WHERE stage = 'completed'",
            &[],
        )
        .await
        .unwrap();
    let materials = rows.iter().map(|row| row.get::<_, i64>(0) as u32);
    materials.collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_acknowledged_survives_the_death_of_the_server() {
    let mut server = tokio::task::spawn_blocking(|| Server::start("-c fsync=on"))
        .await
        .unwrap();
    let url = schema_in(&server.url(), 0).await;
    make(&url, 100_000).await;
    let job_store = job_store(
        &url,
        Policy::default(),
        PresenceLimits::default(),
        Arc::default(),
    );
    let acknowledged = Arc::<Mutex<BTreeSet<u32>>>::default();
    let mut working = JoinSet::new();
    for number in 0..4 {
        let job_store = Arc::clone(&job_store);
        let acknowledged = Arc::clone(&acknowledged);
        working.spawn(async move {
            let id = worker(number);
            job_store.admit(id, &format!("w{number}")).await.unwrap();
            loop {
                let one = async {
                    let leased = job_store.claim(id, &tokens(2)).await?;
                    for (token, material) in leased.jobs {
                        job_store.complete(delivery(material, token)).await?;
                        acknowledged.lock().unwrap().insert(material);
                    }
                    Ok::<(), JobStoreError>(())
                };
                if let Err(error) = one.await {
                    assert!(is_unavailable(&error), "{error:?}");
                    sleep(Duration::from_millis(50)).await;
                }
            }
        });
    }
    let mut before = 0;
    for _ in 0..3 {
        let grown = async {
            while acknowledged.lock().unwrap().len() < before + 20 {
                sleep(Duration::from_millis(10)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(60), grown)
            .await
            .unwrap();
        server.kill();
        let away = job_store.publish_overview().await.unwrap_err();
        assert!(is_unavailable(&away), "{away:?}");
        server.restart();
        server.wait();
        before = acknowledged.lock().unwrap().len();
    }
    working.shutdown().await;

    let acknowledged = acknowledged.lock().unwrap().clone();
    let completed = completed(&url).await;
    assert!(acknowledged.is_subset(&completed), "acknowledged and lost");
    assert_tallies(&url).await;
}
