//! The job store: every transition of the queue, made durable.
//!
//! The farm knows the jobs through this trait alone. [`LocalJobStore`] keeps the queue in memory,
//! its changes in a [`crate::ledger`], and belongs to one process. Whatever implements [`JobStore`]
//! runs the transitions of [`jobqueue`] and no others, and is tested by one suite, `model`: random
//! operations against a simple model, with restarts.
//!
//! | module | what |
//! | --- | --- |
//! | `local` | the store of one process: the queue in memory, its changes in a ledger |
//! | `commit`, `group` | what makes its transitions durable, many at a time |
//! | [`ledger`] | jobs, completions and the index of images, in sled |
//! | [`completion_log`] | one checksummed line a completed material, from which a ledger is rebuilt |
//! | `publisher` | staged images get their names before their completion is recorded |
//! | `recovery` | ledger and log brought to agree |
//! | `work` | workers that wait for a job |
//! | [`kept`] | what a copy of a store copies |
//!
//! Architecture invariant: an operation answers when what it changed is durable. Equal operations
//! repeated give equal answers, so whoever lost an answer asks again.

mod commit;
pub mod completion_log;
mod context;
mod group;
pub mod kept;
pub mod ledger;
mod local;
mod meter;
#[cfg(any(test, feature = "conformance"))]
#[allow(clippy::unwrap_used, reason = "a suite of tests")]
pub mod model;
mod publisher;
mod recovery;
mod work;

pub use context::JobStoreContext;
pub use group::NotDurable;
pub use local::LocalJobStore;
pub use meter::Meter;
pub use publisher::{PublishError, Publisher};
pub use recovery::{Recovered, Recovery, recover};
pub use work::{Waiter, Work};

use crate::ledger::{BlobPlace, LedgerError};
use dataset::Digest;
use imagestore::FileError;
use jobqueue::{
    BlockCause, Changes, Completion, Counts, Fingerprint, Holder, JobRecord, LostLease, Mode,
    Refusal, Selection, Stage, Standing, Verdict, WorkerChange, WorkerRecord,
    token::{Token, WorkerId},
};
use std::time::Duration;
use thiserror::Error;
use tokio::sync::watch;

/// Why an operation was not done.
#[derive(Debug, Error)]
pub enum JobStoreError {
    /// The queue does not allow it.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The store is no longer written, or the coordinator is stopping: the change may or may not be
    /// durable.
    #[error(transparent)]
    NotDurable(#[from] NotDurable),
    /// The ledger cannot be read or written.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The completion names a staged image that has no name yet: publish it first.
    #[error("an image of material {0} is not published yet")]
    Unpublished(u32),
    /// The database is out of reach, for this reason.
    #[error("the database is away: {0}")]
    Unavailable(String),
    /// Whoever was to answer is gone: the change may or may not be durable.
    #[error("the operation was interrupted")]
    Interrupted,
}

/// How the jobs stand together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overview {
    /// Jobs by state.
    pub counts: Counts,
    /// Whether work is handed out.
    pub mode: Mode,
    /// Workers that are blocked now.
    pub workers_blocked: u32,
    /// Nothing is left to do, now or later.
    pub finished: bool,
}

/// What a worker that asks for work is told.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Leased {
    /// The leases, each with its material.
    pub jobs: Vec<(Token, u32)>,
    /// What the worker calls itself; none where it is not registered.
    pub name: Option<String>,
    /// Nothing is left to do, now or later.
    pub finished: bool,
    /// The farm is being drained.
    pub draining: bool,
    /// Why this worker gets nothing.
    pub blocked: Option<String>,
}

/// A lease that its holder wants prolonged.
#[derive(Clone, Copy, Debug)]
pub struct Renewal {
    /// The lease.
    pub token: Token,
    /// What it is of.
    pub material: u32,
    /// Views that its holder has rendered.
    pub views_done: u32,
}

/// A completion whose images have been looked at.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// The lease under which it was rendered.
    pub token: Token,
    /// Who rendered it is filled in by the job store.
    pub completion: Completion,
    /// Whether a first rendering is to be followed by a second.
    pub check: bool,
}

/// What became of a completion.
#[derive(Debug, PartialEq, Eq)]
pub struct Decision {
    /// What it was found to be.
    pub verdict: Verdict,
    /// Who held the lease.
    pub holder: Option<Holder>,
    /// What changed in the queue.
    pub changes: Changes,
}

/// What became of a report of failure.
#[derive(Debug, PartialEq, Eq)]
pub struct Failed {
    /// The name of the worker that held the lease.
    pub worker: String,
    /// What changed in the queue.
    pub changes: Changes,
}

/// What a look for leases that ran out found.
#[derive(Debug, Default)]
pub struct Expired {
    /// What changed in the queue.
    pub changes: Changes,
    /// The leases that ran out.
    pub lost: Vec<LostLease>,
    /// How long it is until the next lease or block runs out, as far as this process knows.
    pub next: Option<Duration>,
}

/// What an operator does to a selection of jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobsOrder {
    /// Gives jobs that were quarantined or cancelled another chance.
    Retry,
    /// Takes jobs that are not complete out of the work.
    Cancel,
    /// Gives jobs this priority: higher ones are handed out first.
    Prioritize(i32),
}

impl JobsOrder {
    /// The stages of jobs that it can be done to.
    pub fn stages(self) -> &'static [Stage] {
        match self {
            Self::Retry => &[Stage::Quarantined, Stage::Cancelled],
            Self::Cancel => &[Stage::Pending, Stage::Leased, Stage::Quarantined],
            Self::Prioritize(_) => &[Stage::Pending],
        }
    }
}

/// A page of the jobs of a selection. It may be short, or empty, and not the last: as many jobs are
/// looked at as a call may.
#[derive(Debug, Default)]
pub struct JobsPage {
    /// Material, record, and the views that a leased one has done.
    pub jobs: Vec<(u32, JobRecord, u32)>,
    /// Where the next page begins, unless this is the last.
    pub next: Option<u32>,
}

/// The workers.
#[derive(Debug, Default)]
pub struct Workers {
    /// Those with a history, by name.
    pub records: Vec<(String, WorkerRecord)>,
    /// Those that are registered.
    pub sessions: Vec<Session>,
}

/// A worker's registration.
#[derive(Debug)]
pub struct Session {
    /// Its id.
    pub worker: WorkerId,
    /// What it calls itself.
    pub name: String,
    /// How many leases it holds.
    pub held: u32,
}

/// The jobs of one dataset, and what the farm does to them.
#[async_trait::async_trait]
pub trait JobStore: Send + Sync {
    /// Notes that a worker is there, under this full name; it can claim jobs from now on.
    async fn admit(&self, worker: WorkerId, name: &str) -> Result<(), JobStoreError>;

    /// The name of a worker that is there.
    async fn name(&self, worker: WorkerId) -> Result<Option<String>, JobStoreError>;

    /// Notes that workers are gone, those of them that hold nothing.
    async fn dismiss(&self, workers: &[WorkerId]) -> Result<(), JobStoreError>;

    /// Leases jobs to a worker, one for each token while there are jobs for it. The tokens of jobs
    /// come in the order of the tokens given.
    async fn claim(&self, worker: WorkerId, tokens: &[Token]) -> Result<Leased, JobStoreError>;

    /// Prolongs leases; of each says whether its holder may go on.
    async fn renew(&self, renewals: &[Renewal]) -> Result<Vec<bool>, JobStoreError>;

    /// Where a completion with this fingerprint would stand.
    async fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Fingerprint,
    ) -> Result<Standing, JobStoreError>;

    /// Completes a job, or its second or third rendering. Refuses what would record a staged image
    /// that is not published.
    async fn complete(&self, delivery: Delivery) -> Result<Decision, JobStoreError>;

    /// Records a failure that the holder of a lease reports.
    async fn fail(&self, material: u32, token: Token, error: &str)
    -> Result<Failed, JobStoreError>;

    /// Takes back every lease of a worker that leaves, which is gone then.
    async fn release(&self, worker: WorkerId) -> Result<Changes, JobStoreError>;

    /// Takes back every lease, where nobody can be left who holds one.
    async fn release_all(&self) -> Result<Changes, JobStoreError>;

    /// Takes back every lease whose time is over, and lifts blocks whose time is.
    async fn expire(&self) -> Result<Expired, JobStoreError>;

    /// Where no job waits or is under way: draws completions of each identity whose work is to be
    /// audited, for others to render again. `seed` is random.
    async fn draw_audits(&self, seed: u64) -> Result<Changes, JobStoreError>;

    /// Does one thing to the jobs of a selection that it can be done to, some at a time: others go on
    /// in between.
    async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Changes, JobStoreError>;

    /// Hands work out or not.
    async fn set_mode(&self, mode: Mode) -> Result<Changes, JobStoreError>;

    /// Gives the worker of this full name, or everybody whom this identity answers for, no more work
    /// and takes back what they hold.
    async fn block(
        &self,
        name: &str,
        cause: BlockCause,
        reason: String,
    ) -> Result<Changes, JobStoreError>;

    /// Lets the worker of this full name, or those of this identity, work again, if it is blocked.
    async fn unblock(&self, name: &str) -> Result<Option<WorkerChange>, JobStoreError>;

    /// The first jobs of a selection from a material on, `jobs_max` at most.
    async fn jobs(
        &self,
        from: u32,
        jobs_max: usize,
        selection: &Selection,
    ) -> Result<JobsPage, JobStoreError>;

    /// Everybody who is there, and everybody who has a history.
    async fn workers(&self) -> Result<Workers, JobStoreError>;

    /// Which images have these digests, in their order; none where none was ever recorded.
    async fn places(&self, digests: &[Digest]) -> Result<Vec<Option<BlobPlace>>, JobStoreError>;

    /// Everything that is kept of the queue: every job and every worker that has a record, once.
    async fn contents(&self) -> Result<Changes, JobStoreError>;

    /// Tells the context how the jobs stand now.
    async fn publish_overview(&self) -> Result<(), JobStoreError>;

    /// Waits until all that happened so far is durable.
    async fn settled(&self) -> Result<(), JobStoreError>;

    /// Why nothing can be recorded any more, once that is so.
    fn failure(&self) -> watch::Receiver<Option<String>>;

    /// Ends when everything under way is durable. Blocks.
    fn close(&self);
}
