//! What outlives the process of a job.

use crate::token::{Token, WorkerId};
use dataset::Digest;
use serde::{Deserialize, Serialize};

/// Where a job stands.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waiting for a worker.
    #[default]
    Pending,
    /// With a worker, who alone knows the token.
    Leased {
        /// Names the lease.
        token: Token,
        /// Who holds it.
        worker: WorkerId,
    },
    /// Done.
    Completed {
        /// The digest of all its images' digests, which tells a repeated completion from another.
        fingerprint: Digest,
    },
    /// Given up after too many failures.
    SetAside,
}

/// A job as the ledger keeps it. A job without a record is pending and has no history.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobRecord {
    /// Where it stands.
    pub state: JobState,
    /// What workers reported, oldest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<String>,
    /// Leases that ran out.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub leases_lost: u32,
}

/// A job's new record: durable before anybody hears of the transition that made it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// Whose.
    pub material: u32,
    /// What replaces the record before.
    pub record: JobRecord,
}

fn is_zero(number: &u32) -> bool {
    *number == 0
}
