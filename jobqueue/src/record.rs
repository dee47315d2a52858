//! What of the queue outlives the process.

use crate::{
    Fingerprint,
    token::{Token, WorkerId},
};
use serde::{Deserialize, Serialize};

/// Who holds a lease.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Holder {
    /// Names the lease; the worker alone knows it.
    pub token: Token,
    /// The worker's registration.
    pub worker: WorkerId,
    /// The worker's name.
    pub name: String,
}

/// Where a job stands.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waiting for a worker.
    #[default]
    Pending,
    /// With a worker.
    Leased(Holder),
    /// Done.
    Completed {
        /// Tells a repeated completion from another.
        fingerprint: Fingerprint,
        /// The name of the worker whose images they are.
        worker: String,
        /// Whether somebody else has rendered the same.
        #[serde(rename = "check")]
        #[serde(default, skip_serializing_if = "RedundantRender::is_none")]
        redundant: RedundantRender,
    },
    /// Given up after too many failures: quarantined.
    #[serde(rename = "set_aside")]
    Quarantined,
    /// Not wanted any more, by an operator's word.
    Cancelled,
}

/// What a second worker said of a completed job.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RedundantRender {
    /// Nobody is asked.
    #[default]
    None,
    /// A worker of another name has to render it again.
    Due,
    /// One is at it.
    Leased(Holder),
    /// It rendered the same.
    Agreed,
    /// It rendered something else: a third has to decide.
    Disputed(Dispute),
}

/// Two workers that delivered different images, or different statistics, of the same job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dispute {
    /// What the second worker delivered.
    pub fingerprint: Fingerprint,
    /// The second worker's name.
    pub worker: String,
    /// The third, if one is at it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holder: Option<Holder>,
}

/// A failure of a job that a worker reported.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Failure {
    /// The worker's name.
    pub worker: String,
    /// What it said.
    pub error: String,
}

/// A job as the ledger keeps it. A job without a record is pending and has no history.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobRecord {
    /// Where it stands.
    pub state: JobState,
    /// Higher goes first; 0 unless an operator said otherwise.
    #[serde(default, skip_serializing_if = "is_default")]
    pub priority: i32,
    /// What workers reported, oldest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<Failure>,
    /// Leases that ran out.
    #[serde(default, skip_serializing_if = "is_default")]
    pub leases_lost: u32,
}

/// Why a worker gets no work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BlockCause {
    /// It failed several jobs in a row; it is tried again after a while.
    Failures,
    /// It delivered images that two others contradict.
    Disagreement,
    /// An operator said so.
    Operator,
}

/// A worker that gets no work, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// The kind of reason.
    pub cause: BlockCause,
    /// The reason as a sentence.
    pub reason: String,
}

/// A failure that a worker reported.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkerFailure {
    /// The job.
    pub material: u32,
    /// What the worker said.
    pub error: String,
}

/// The history of a worker, by its full name, or of an [identity](crate::identity), as the ledger
/// keeps it. Who has no record has no history.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WorkerRecord {
    /// The last failure of each job that it failed since it last completed one, oldest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failures_in_a_row: Vec<WorkerFailure>,
    /// Failures it ever reported.
    #[serde(default, skip_serializing_if = "is_default")]
    pub failures: u64,
    /// Leases it ever let run out.
    #[serde(default, skip_serializing_if = "is_default")]
    pub leases_lost: u64,
    /// Whether it is blocked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "bar")]
    pub block: Option<Block>,
    /// Of an identity: how many of its completions were sent to another because it was on probation.
    #[serde(default, skip_serializing_if = "is_default")]
    pub probation: u32,
    /// Of an identity: some of its completions are still to be drawn for an audit. Work that was
    /// audited and has grown since is audited again.
    #[serde(default, skip_serializing_if = "is_default")]
    pub audit_due: bool,
}

/// Whether work is handed out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// It is.
    #[default]
    Running,
    /// Workers finish what they hold and wait.
    Paused,
    /// Workers finish what they hold and leave.
    Draining,
}

/// A job's new record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobChange {
    /// Whose.
    pub material: u32,
    /// What replaces the record before.
    pub record: JobRecord,
}

/// A worker's new record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkerChange {
    /// Whose.
    pub name: String,
    /// What replaces the record before.
    pub record: WorkerRecord,
}

/// What a transition changed: durable before anybody hears of it. Later entries replace earlier
/// ones of the same job or worker.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Jobs.
    pub jobs: Vec<JobChange>,
    /// Workers, and identities.
    pub workers: Vec<WorkerChange>,
    /// The mode.
    pub mode: Option<Mode>,
    /// Materials whose completion no longer counts.
    pub retracted: Vec<u32>,
}

impl JobState {
    /// Who holds the job's lease, be it of the job itself, of its redundant render or of a dispute.
    pub fn holder(&self) -> Option<&Holder> {
        match self {
            Self::Leased(holder) => Some(holder),
            Self::Completed { redundant, .. } => match redundant {
                RedundantRender::Leased(holder) => Some(holder),
                RedundantRender::Disputed(dispute) => dispute.holder.as_ref(),
                RedundantRender::None | RedundantRender::Due | RedundantRender::Agreed => None,
            },
            Self::Pending | Self::Quarantined | Self::Cancelled => None,
        }
    }

    /// Whether the job's images are there and nobody contradicts them.
    pub fn is_completed(&self) -> bool {
        matches!(self, Self::Completed { redundant, .. } if !matches!(redundant, RedundantRender::Disputed(_)))
    }
}

impl RedundantRender {
    fn is_none(&self) -> bool {
        *self == Self::None
    }
}

impl JobRecord {
    /// Whether a worker of this full name has failed the job.
    pub fn failed_on(&self, name: &str) -> bool {
        self.failures.iter().any(|failure| failure.worker == name)
    }

    /// On how many workers the job failed, by name.
    pub fn workers_failed(&self) -> usize {
        let mut names: Vec<&str> = self
            .failures
            .iter()
            .map(|failure| failure.worker.as_str())
            .collect();
        names.sort_unstable();
        names.dedup();
        names.len()
    }
}

impl Changes {
    /// Whether nothing changed.
    pub fn is_empty(&self) -> bool {
        self.jobs.is_empty() && self.workers.is_empty() && self.mode.is_none()
    }

    /// Adds what changed after.
    pub fn extend(&mut self, later: Self) {
        self.jobs.extend(later.jobs);
        self.workers.extend(later.workers);
        self.mode = later.mode.or(self.mode);
        self.retracted.extend(later.retracted);
    }

    /// How many jobs there may be after this for those who wait for work.
    pub fn jobs_offered(&self) -> usize {
        let offered = |change: &JobChange| match &change.record.state {
            JobState::Pending => true,
            JobState::Completed { redundant, .. } => match redundant {
                RedundantRender::Due => true,
                RedundantRender::Disputed(dispute) => dispute.holder.is_none(),
                _ => false,
            },
            _ => false,
        };
        self.jobs.iter().filter(|change| offered(change)).count()
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}
