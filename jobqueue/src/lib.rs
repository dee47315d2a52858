//! The jobs' state machine: one job a material.
//!
//! Plain data and transitions: no sockets, no clock (every transition that depends on time is told
//! the time since the start), no input or output, no random numbers. A transition that changes
//! what has to outlive the process returns it as [`Changes`]; whoever calls makes them durable, in
//! the order of the transitions, before it tells anybody.
//!
//! ```text
//!            claim                complete
//! pending ----------> leased ----------------> completed: redundant render none, or due
//!    ^                  |                          |  claim by another
//!    |  release, expire, fail                      v
//!    +------------------+-----> quarantined    redundant render leased --> agreed
//!    |                                             |  other images
//!    +--- retry --- quarantined, cancelled         v
//!    +--- the third says that the first lied --- disputed --- a third decides
//! ```
//!
//! Invariant: a lease ends for its holder only by a transition that also takes its token, so at
//! any time at most one token can complete a job, and a token once taken never can again.

mod audit;
mod completion;
mod consensus;
mod fingerprint;
pub mod identity;
mod leasing;
mod looking;
mod operating;
mod policy;
mod record;
mod records;
mod selection;
pub mod token;
mod workers;

pub use completion::Completion;
pub use consensus::{Refusal, Standing, Verdict};
pub use fingerprint::Fingerprint;
pub use leasing::{Lease, LostLease, unleased};
pub use looking::Look;
pub use policy::Policy;
pub use record::{
    Block, BlockCause, Changes, Dispute, Failure, Holder, JobChange, JobRecord, JobState, Mode,
    RedundantRender, WorkerChange, WorkerFailure, WorkerRecord,
};
pub use selection::{Selection, Stage};

use crate::{identity::is_operator, token::WorkerId};
use records::Records;
use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};
use workers::Workers;

/// How many jobs are in which state; the first six after `materials` add up to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// All jobs.
    pub materials: u32,
    /// Waiting for a worker.
    pub pending: u32,
    /// With a worker.
    pub leased: u32,
    /// Done.
    pub completed: u32,
    /// Done twice, with different images.
    pub disputed: u32,
    /// Given up after too many failures.
    pub quarantined: u32,
    /// Not wanted any more.
    pub cancelled: u32,
    /// Of the completed, those that wait to be rendered a second time, or are being so.
    pub redundant: u32,
}

/// The queue. Of equal priority the lowest material is handed out first, so that a set completes
/// from its start.
#[derive(Clone, Debug)]
pub struct Queue {
    policy: Policy,
    mode: Mode,
    jobs: Records,
    pending: BTreeSet<(Reverse<i32>, u32)>,
    quarantined: BTreeSet<u32>,
    cancelled: BTreeSet<u32>,
    // Completed, and somebody else has to render them again.
    redundant_due: BTreeSet<u32>,
    redundant_leased: u32,
    disputed: BTreeSet<u32>,
    completed: u32,
    leases: BTreeMap<u32, Lease>,
    // When leases run out, soonest first.
    expiries: BTreeSet<(Duration, u32)>,
    // Who holds what; no entry is empty.
    holdings: BTreeMap<WorkerId, BTreeSet<u32>>,
    workers: Workers,
}

impl Queue {
    /// A queue of `materials` pending jobs.
    pub fn new(materials: u32, policy: Policy) -> Self {
        Self {
            policy,
            mode: Mode::default(),
            jobs: Records::All(vec![JobRecord::default(); materials as usize]),
            pending: (0..materials)
                .map(|material| (Reverse(0), material))
                .collect(),
            quarantined: BTreeSet::new(),
            cancelled: BTreeSet::new(),
            redundant_due: BTreeSet::new(),
            redundant_leased: 0,
            disputed: BTreeSet::new(),
            completed: 0,
            leases: BTreeMap::new(),
            expiries: BTreeSet::new(),
            holdings: BTreeMap::new(),
            workers: Workers::default(),
        }
    }

    /// A queue of no job, to be given those that a transition touches: a database that keeps the
    /// jobs runs the transitions on parts of the queue.
    pub fn of_some(policy: Policy, mode: Mode) -> Self {
        Self {
            mode,
            jobs: Records::Some(BTreeMap::new()),
            ..Self::new(0, policy)
        }
    }

    /// Adds a job to a queue of some, with its lease if it has one.
    pub fn add_job(&mut self, material: u32, record: JobRecord, lease: Option<Lease>) {
        self.jobs[material] = JobRecord::default();
        self.pending.insert((Reverse(0), material));
        self.put(material, record, Duration::ZERO);
        if let Some(lease) = lease
            && let Some(known) = self.leases.get_mut(&material)
        {
            self.expiries.remove(&(known.expires, material));
            self.expiries.insert((lease.expires, material));
            *known = lease;
        }
    }

    /// Adds a worker's history to a queue of some, and when a block over failures ends.
    pub fn add_worker(&mut self, worker: WorkerChange, block_ends: Duration) {
        self.workers.restore(worker, block_ends);
    }

    /// The lease of a job, if it has one.
    pub fn lease(&self, material: u32) -> Option<&Lease> {
        self.leases.get(&material)
    }

    /// When the block of a worker that failed too often ends.
    pub fn block_end(&self, name: &str) -> Option<Duration> {
        self.workers.block_end(name)
    }

    /// Takes over what a ledger kept; jobs beyond the queue are passed over. Leases and blocks get
    /// their full time again: while the coordinator was away nobody could renew them.
    pub fn restore(&mut self, kept: Changes, now: Duration) {
        for JobChange { material, record } in kept.jobs {
            if self.jobs.get(material).is_some() {
                self.put(material, record, now);
            }
        }
        for worker in kept.workers {
            self.workers.restore(worker, now + self.policy.block);
        }
        self.mode = kept.mode.unwrap_or(self.mode);
    }

    /// Notes that a worker is there, under this name; it can claim jobs from now on.
    pub fn admit(&mut self, worker: WorkerId, name: &str) {
        self.workers.admit(worker, name);
    }

    /// Notes that a worker that holds nothing is gone.
    pub fn dismiss(&mut self, worker: WorkerId) {
        self.workers.dismiss(worker);
    }

    /// How many jobs are in which state.
    pub fn counts(&self) -> Counts {
        let redundant = self.redundant_due.len() as u32 + self.redundant_leased;
        let third_opinions = self.disputed.iter();
        let third_opinions = third_opinions.filter(|material| self.leases.contains_key(material));
        let other_leases = self.redundant_leased + third_opinions.count() as u32;
        Counts {
            materials: self.jobs.len() as u32,
            pending: self.pending.len() as u32,
            leased: self.leases.len() as u32 - other_leases,
            completed: self.completed,
            disputed: self.disputed.len() as u32,
            quarantined: self.quarantined.len() as u32,
            cancelled: self.cancelled.len() as u32,
            redundant,
        }
    }

    /// Whether nothing is left to do, now or later. A second or third rendering that nobody present
    /// can do is not waited for: what is disputed then waits for the operator.
    pub fn is_finished(&self) -> bool {
        let mut decisions = self.disputed.iter().chain(&self.redundant_due);
        self.pending.is_empty()
            && self.leases.is_empty()
            && !decisions.any(|material| {
                let mut able = self.workers.able();
                able.any(|name| self.may_rerender(name, *material))
            })
            && self.workers.audits_due().next().is_none()
    }

    /// Whether a worker of this name has nothing more to do: the operator is only there for what is
    /// disputed.
    pub fn is_finished_for(&self, name: &str) -> bool {
        self.is_finished() || (is_operator(name) && self.disputed.is_empty())
    }

    /// Whether work is handed out.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether `worker` holds a lease.
    pub fn holds(&self, worker: WorkerId) -> bool {
        self.holdings.contains_key(&worker)
    }

    /// How many leases `worker` holds.
    pub fn held(&self, worker: WorkerId) -> u32 {
        self.holdings.get(&worker).map_or(0, BTreeSet::len) as u32
    }

    /// Who holds the lease of a job, if anybody.
    pub fn holder(&self, material: u32) -> Option<&Holder> {
        self.state(material)?.holder()
    }

    /// How many views of a leased job are rendered, as its holder last said.
    pub fn views_done(&self, material: u32) -> Option<u32> {
        Some(self.lease(material)?.views_done)
    }

    /// Why a worker of this full name gets no work, if it or its identity is blocked.
    pub fn block_of(&self, name: &str) -> Option<&Block> {
        self.workers.block(name)
    }

    /// Workers with a history, by name.
    pub fn worker_records(&self) -> impl Iterator<Item = (&str, &WorkerRecord)> {
        self.workers.records()
    }

    /// A job, if there is such a material.
    pub fn job(&self, material: u32) -> Option<&JobRecord> {
        self.jobs.get(material)
    }

    /// The jobs from a material on, in order.
    pub fn jobs_from(&self, from: u32) -> impl Iterator<Item = (u32, &JobRecord)> {
        self.jobs.from(from)
    }

    /// The materials of a selection, in order. Looks at every job.
    #[cfg(test)]
    fn selected(&self, selection: &Selection) -> Vec<u32> {
        let jobs = self.jobs_from(0);
        let selected = jobs.filter(|(material, job)| selection.contains(*material, job));
        selected.map(|(material, _)| material).collect()
    }

    /// Everybody who is there, with their names.
    pub fn sessions(&self) -> impl Iterator<Item = (WorkerId, &str)> {
        self.workers.sessions()
    }

    /// The name of a worker that is there.
    pub fn name(&self, worker: WorkerId) -> Option<&str> {
        self.workers.name(worker)
    }

    fn state(&self, material: u32) -> Option<&JobState> {
        Some(&self.jobs.get(material)?.state)
    }

    fn transition(&mut self, material: u32, state: JobState, now: Duration) -> JobChange {
        let mut record = self.jobs[material].clone();
        record.state = state;
        self.put(material, record.clone(), now);
        JobChange { material, record }
    }

    // The one place where the indices over the jobs change.
    fn put(&mut self, material: u32, record: JobRecord, now: Duration) {
        self.unlist(material);
        match &record.state {
            JobState::Pending => {
                self.pending.insert((Reverse(record.priority), material));
            }
            JobState::Leased(_) => {}
            JobState::Completed { redundant, .. } => match redundant {
                RedundantRender::Disputed(_) => {
                    self.disputed.insert(material);
                }
                redundant => {
                    self.completed += 1;
                    match redundant {
                        RedundantRender::Due => {
                            self.redundant_due.insert(material);
                        }
                        RedundantRender::Leased(_) => self.redundant_leased += 1,
                        _ => {}
                    }
                }
            },
            JobState::Quarantined => {
                self.quarantined.insert(material);
            }
            JobState::Cancelled => {
                self.cancelled.insert(material);
            }
        }
        if let Some(holder) = record.state.holder() {
            let expires = now + self.policy.lease.min(self.policy.deadline);
            let lease = Lease {
                claimed: now,
                expires,
                views_done: 0,
                progressed: now,
            };
            self.leases.insert(material, lease);
            self.expiries.insert((expires, material));
            let held = self.holdings.entry(holder.worker).or_default();
            held.insert(material);
        }
        self.jobs[material] = record;
    }

    fn unlist(&mut self, material: u32) {
        let job = &self.jobs[material];
        match &job.state {
            JobState::Pending => {
                self.pending.remove(&(Reverse(job.priority), material));
            }
            JobState::Leased(_) => {}
            JobState::Completed { redundant, .. } => {
                if !self.disputed.remove(&material) {
                    self.completed -= 1;
                }
                self.redundant_due.remove(&material);
                if matches!(redundant, RedundantRender::Leased(_)) {
                    self.redundant_leased -= 1;
                }
            }
            JobState::Quarantined => {
                self.quarantined.remove(&material);
            }
            JobState::Cancelled => {
                self.cancelled.remove(&material);
            }
        }
        if let Some(lease) = self.leases.remove(&material) {
            self.expiries.remove(&(lease.expires, material));
        }
        if let Some(holder) = job.state.holder()
            && let Some(held) = self.holdings.get_mut(&holder.worker)
        {
            held.remove(&material);
            if held.is_empty() {
                self.holdings.remove(&holder.worker);
            }
        }
    }
}
