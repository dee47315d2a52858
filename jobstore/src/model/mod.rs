//! The suite of every job store: random operations, and after each the answers, the states and the
//! durable records that a simple model has. A restarted job store goes on where the one before
//! ended.

mod bench;
mod blocks;
mod checks;
mod job;
#[cfg(test)]
mod local;
mod operation;

pub use operation::{Operation, operation};

use super::{JobStore, Overview};
use bench::Bench;
use jobqueue::{Policy, identity::full_name, token::WorkerId};
use proptest::prelude::ProptestConfig;
use std::{
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::runtime;

/// Jobs of a store under test.
pub const MATERIALS: u32 = 12;
const WORKERS: u8 = 5;
/// The worker that is the operator.
const OPERATOR: u8 = 4;
/// Limits small enough to be met by a few operations.
pub const POLICY: Policy = Policy {
    lease: Duration::from_secs(10),
    stall: Duration::from_secs(25),
    deadline: Duration::from_secs(60),
    workers_failed_max: 3,
    failures_max: 5,
    leases_lost_max: 4,
    leases_per_worker_max: 5,
    jobs_failed_max: 3,
    block: Duration::from_secs(40),
    probation: 2,
    audits: 2,
};

/// Where job stores are opened, each over what the one before kept.
#[async_trait::async_trait]
pub trait Place: Send {
    /// Opens a job store; the one before is gone.
    async fn open(&mut self, overview: Arc<Mutex<Overview>>) -> Arc<dyn JobStore>;

    /// Tells the job store the time.
    async fn set_time(&mut self, now: Duration);

    /// Whether an operation is told when to look for leases that ran out again.
    fn knows_next_expiry(&self) -> bool;
}

fn id(number: u8) -> WorkerId {
    WorkerId::from_bytes([number; 16])
}

/// One without a credential, two of one, one of another, and the operator.
fn name(number: u8) -> String {
    let credential = match number {
        1 | 2 => Some("lab"),
        3 => Some("guest"),
        OPERATOR => Some(jobqueue::identity::OPERATOR),
        _ => None,
    };
    full_name(credential, &format!("w{number}"))
}

/// Who answers for a worker: the first with the same credential.
fn answers(number: u8) -> u8 {
    if number == 2 { 1 } else { number }
}

/// Does operations on a new job store, and checks it after each.
pub fn follow(place: Box<dyn Place>, operations: Vec<Operation>) {
    let runtime = runtime::Builder::new_current_thread().enable_all().build();
    runtime.unwrap().block_on(async {
        let mut bench = Bench::new(place).await;
        for operation in operations {
            bench.apply(operation).await;
            bench.check().await;
        }
        bench.job_store().close();
    });
}

/// Settings of a test of `cases` runs.
pub fn runs(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}
