//! The job store on a real server.

#![allow(clippy::print_stdout, reason = "measurements are for people")]

mod crash;
mod damage;
mod encryption;
mod idle;
mod maintenance;
mod measure;
mod model;
mod pages;
mod panics;
mod plans;
mod replicas;

use super::{Database, Identity, PostgresJobStore, PresenceLimits};
use imagestore::blobs::Blobs;
use jobqueue::{
    Completion, Policy,
    token::{Token, WorkerId},
};
use jobstore::{Delivery, JobStore, JobStoreContext, JobStoreError, Overview};
use std::{
    path::Path,
    sync::{Arc, Mutex},
};

/// Makes a database of this many materials.
async fn make(url: &str, materials: u32) {
    let database = Database::new(url).unwrap();
    assert_eq!(database.open().await.unwrap(), None);
    let identity = Identity {
        renderer_version: "test".to_owned(),
        specification_hash: vec![7; 32],
        specification: "{}".to_owned(),
        blobs: "/nowhere".to_owned(),
        migrating_from: None,
    };
    database.make(&identity, None, materials).await.unwrap();
    assert_eq!(database.open().await.unwrap(), Some(identity));
}

/// A coordinator's job store over it.
fn job_store(
    url: &str,
    policy: Policy,
    presence: PresenceLimits,
    overview: Arc<Mutex<Overview>>,
) -> Arc<dyn JobStore> {
    let context = JobStoreContext::new(Blobs::new(Path::new("/nowhere")), move |_, now| {
        *overview.lock().unwrap() = now;
    });
    Arc::new(PostgresJobStore::new(
        Database::new(url).unwrap(),
        policy,
        presence,
        Arc::new(()),
        Arc::new(context),
    ))
}

fn delivery(material: u32, token: Token) -> Delivery {
    Delivery {
        token,
        completion: Completion::sample(material, &material.to_be_bytes()),
        check: false,
    }
}

fn worker(number: u32) -> WorkerId {
    WorkerId::from_bytes(u128::from(number).to_be_bytes())
}

fn tokens(count: usize) -> Vec<Token> {
    let token = |_| {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes).unwrap();
        Token::from_bytes(bytes)
    };
    (0..count).map(token).collect()
}

fn is_unavailable(error: &JobStoreError) -> bool {
    matches!(error, JobStoreError::Unavailable(_))
}

/// That the counts, which every transaction keeps, are those of the rows.
async fn assert_tallies(url: &str) {
    let client = crate::testing::client(url).await;
    let differ = client
        .query_one(
            "SELECT (SELECT (sum(pending), sum(leased), sum(completed), sum(disputed), \
                 sum(set_aside), sum(cancelled), sum(pending + leased + completed + disputed + \
                 set_aside + cancelled))::text FROM tallies), \
             (SELECT (count(*) FILTER (WHERE stage = 'pending'), \
                 count(*) FILTER (WHERE stage = 'leased'), \
                 count(*) FILTER (WHERE stage = 'completed'), \
                 count(*) FILTER (WHERE stage = 'disputed'), \
                 count(*) FILTER (WHERE stage = 'set_aside'), \
                 count(*) FILTER (WHERE stage = 'cancelled'), count(*))::text FROM jobs)",
            &[],
        )
        .await
        .unwrap();
    let (tallied, counted): (String, String) = (differ.get(0), differ.get(1));
    assert_eq!(tallied, counted);
}
