//! The jobs' state machine: one job a material.
//!
//! Plain data and transitions: no sockets, no clock (every transition that depends on time is told
//! the time since the start), no input or output. A transition that changes what has to outlive
//! the process returns it as [`Change`]s; whoever calls makes them durable, in the order of the
//! transitions, before it tells anybody.
//!
//! ```text
//!            claim                complete
//! pending ----------> leased ----------------> completed
//!    ^                  |
//!    |  release, expire, fail (fewer than the limit)
//!    +------------------+-----> set aside (fail or expire, at the limit)
//! ```
//!
//! Invariant: a lease ends for its holder only by a transition that also takes its token, so at
//! any time at most one token can complete a job, and a token once taken never can again.

#[cfg(test)]
mod model;
mod record;

pub use record::{Change, JobRecord, JobState};

use crate::token::{Token, WorkerId};
use dataset::Digest;
use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};
use thiserror::Error;

/// The limits that decide the queue's transitions; [`crate::limits`] has the defaults.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// How long a lease lives without renewal.
    pub lease: Duration,
    /// How long a lease is prolonged while its progress stands still.
    pub stall: Duration,
    /// Failures after which a job is set aside.
    pub failures_max: u32,
    /// Lost leases after which a job is set aside.
    pub leases_lost_max: u32,
    /// The most leases of one worker.
    pub leases_per_worker_max: u32,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            lease: crate::limits::LEASE,
            stall: crate::limits::STALL,
            failures_max: crate::limits::FAILURES_MAX,
            leases_lost_max: crate::limits::LEASES_LOST_MAX,
            leases_per_worker_max: proto::limits::LEASES_PER_WORKER_MAX,
        }
    }
}

/// Why a worker's word about a job counts for nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// There is no such job.
    #[error("there is no material {0} in this set")]
    UnknownMaterial(u32),
    /// The token is not the current lease's.
    #[error("the lease of material {0} is lost: its token is not the current one")]
    LeaseLost(u32),
    /// Completed before, with other digests.
    #[error(
        "material {0} was completed before with other digests: one of the two renderers is not \
         deterministic"
    )]
    Conflict(u32),
}

/// Where a completion stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// The token is the current lease's: it counts.
    Current,
    /// The same was recorded before: nothing changes.
    Repeated,
}

/// How many jobs are in which state.
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
    /// Given up after too many failures.
    pub set_aside: u32,
}

#[derive(Clone, Debug)]
struct Lease {
    expires: Duration,
    views_done: u32,
    progressed: Duration,
}

/// The queue. Jobs are handed out lowest material first, so that a set completes from its start.
#[derive(Clone, Debug)]
pub struct Queue {
    policy: Policy,
    jobs: Vec<JobRecord>,
    pending: BTreeSet<u32>,
    set_aside: BTreeSet<u32>,
    leases: BTreeMap<u32, Lease>,
    // When leases run out, soonest first.
    expiries: BTreeSet<(Duration, u32)>,
    // Who holds what; no entry is empty.
    holdings: BTreeMap<WorkerId, BTreeSet<u32>>,
    completed: u32,
}

impl Queue {
    /// A queue of `materials` pending jobs.
    pub fn new(materials: u32, policy: Policy) -> Self {
        Self {
            policy,
            jobs: vec![JobRecord::default(); materials as usize],
            pending: (0..materials).collect(),
            set_aside: BTreeSet::new(),
            leases: BTreeMap::new(),
            expiries: BTreeSet::new(),
            holdings: BTreeMap::new(),
            completed: 0,
        }
    }

    /// Puts a job into the state that a ledger kept; a record of a material beyond the queue is
    /// passed over. Leases get their full time again: while the coordinator was away nobody could
    /// renew them.
    pub fn restore(&mut self, change: Change, now: Duration) {
        if (change.material as usize) < self.jobs.len() {
            self.put(change.material, change.record, now);
        }
    }

    /// Leases pending jobs to `worker`, one for each of `tokens` while there are jobs and the
    /// worker has room.
    pub fn claim(&mut self, worker: WorkerId, tokens: &[Token], now: Duration) -> Vec<Change> {
        let held = self.holdings.get(&worker).map_or(0, BTreeSet::len) as u32;
        let room = self.policy.leases_per_worker_max.saturating_sub(held);
        let tokens = tokens.iter().copied().take(room as usize);
        let claims: Vec<(u32, Token)> = self.pending.iter().copied().zip(tokens).collect();
        claims
            .into_iter()
            .map(|(material, token)| {
                self.transition(material, JobState::Leased { token, worker }, now)
            })
            .collect()
    }

    /// Prolongs a lease to its full time from now, but never past the time that a stalled job is
    /// allowed. False when the token is not the current one, or the job has stalled: the holder
    /// can stop working on it.
    pub fn renew(&mut self, material: u32, token: Token, views_done: u32, now: Duration) -> bool {
        let Some(JobState::Leased { token: current, .. }) = self.state(material) else {
            return false;
        };
        if *current != token {
            return false;
        }
        let Some(lease) = self.leases.get_mut(&material) else {
            return false;
        };
        if views_done > lease.views_done {
            lease.views_done = views_done;
            lease.progressed = now;
        }
        let stalled = lease.progressed + self.policy.stall;
        self.expiries.remove(&(lease.expires, material));
        lease.expires = (now + self.policy.lease).min(stalled);
        self.expiries.insert((lease.expires, material));
        now < stalled
    }

    /// Where a completion of `material` under `token` stands.
    pub fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Digest,
    ) -> Result<Standing, Refusal> {
        match self.state(material) {
            None => Err(Refusal::UnknownMaterial(material)),
            Some(JobState::Leased { token: current, .. }) if *current == token => {
                Ok(Standing::Current)
            }
            Some(JobState::Completed { fingerprint: kept }) if *kept == fingerprint => {
                Ok(Standing::Repeated)
            }
            Some(JobState::Completed { .. }) => Err(Refusal::Conflict(material)),
            Some(_) => Err(Refusal::LeaseLost(material)),
        }
    }

    /// Completes a job. `None` when the same was recorded before.
    ///
    /// Architecture invariant: a completion counts only with the current lease's token. A lease
    /// whose time is over but which nobody has taken back is still current.
    pub fn complete(
        &mut self,
        material: u32,
        token: Token,
        fingerprint: Digest,
        now: Duration,
    ) -> Result<Option<Change>, Refusal> {
        match self.standing(material, token, fingerprint)? {
            Standing::Repeated => Ok(None),
            Standing::Current => {
                let state = JobState::Completed { fingerprint };
                Ok(Some(self.transition(material, state, now)))
            }
        }
    }

    /// Records a failure that the holder reports: back to the queue, or set aside at the limit.
    pub fn fail(
        &mut self,
        material: u32,
        token: Token,
        error: String,
        now: Duration,
    ) -> Result<Change, Refusal> {
        match self.state(material) {
            None => Err(Refusal::UnknownMaterial(material)),
            Some(JobState::Leased { token: current, .. }) if *current == token => {
                self.jobs[material as usize].errors.push(error);
                Ok(self.requeue(material, now))
            }
            Some(_) => Err(Refusal::LeaseLost(material)),
        }
    }

    /// Takes back every lease of a worker that leaves; counts against nobody.
    pub fn release(&mut self, worker: WorkerId, now: Duration) -> Vec<Change> {
        let held: Vec<u32> = self
            .holdings
            .get(&worker)
            .map_or_else(Vec::new, |held| held.iter().copied().collect());
        held.into_iter()
            .map(|material| self.transition(material, JobState::Pending, now))
            .collect()
    }

    /// Takes back every lease, where nobody can be left who holds one; counts against nobody.
    pub fn release_all(&mut self, now: Duration) -> Vec<Change> {
        let holders: Vec<WorkerId> = self.holdings.keys().copied().collect();
        holders
            .into_iter()
            .flat_map(|worker| self.release(worker, now))
            .collect()
    }

    /// Takes back every lease whose time is over.
    pub fn expire(&mut self, now: Duration) -> Vec<Change> {
        let over: Vec<u32> = self
            .expiries
            .iter()
            .take_while(|(expires, _)| *expires <= now)
            .map(|(_, material)| *material)
            .collect();
        over.into_iter()
            .map(|material| {
                self.jobs[material as usize].leases_lost += 1;
                self.requeue(material, now)
            })
            .collect()
    }

    /// Gives jobs that were set aside another chance, with their history wiped.
    pub fn retry_set_aside(&mut self, now: Duration) -> Vec<Change> {
        let materials: Vec<u32> = self.set_aside.iter().copied().collect();
        materials
            .into_iter()
            .map(|material| {
                let job = &mut self.jobs[material as usize];
                job.errors.clear();
                job.leases_lost = 0;
                self.transition(material, JobState::Pending, now)
            })
            .collect()
    }

    /// When the next lease runs out, if any is held.
    pub fn next_expiry(&self) -> Option<Duration> {
        self.expiries.first().map(|(expires, _)| *expires)
    }

    /// How many jobs are in which state.
    pub fn counts(&self) -> Counts {
        Counts {
            materials: self.jobs.len() as u32,
            pending: self.pending.len() as u32,
            leased: self.leases.len() as u32,
            completed: self.completed,
            set_aside: self.set_aside.len() as u32,
        }
    }

    /// Whether nothing is left to do, now or later.
    pub fn is_finished(&self) -> bool {
        self.pending.is_empty() && self.leases.is_empty()
    }

    /// Whether `worker` holds a lease.
    pub fn holds(&self, worker: WorkerId) -> bool {
        self.holdings.contains_key(&worker)
    }

    /// Who holds the lease of a job, if anybody.
    pub fn holder(&self, material: u32) -> Option<WorkerId> {
        match self.state(material)? {
            JobState::Leased { worker, .. } => Some(*worker),
            _ => None,
        }
    }

    /// Jobs that were set aside, lowest first, with what is known of each.
    pub fn set_aside(&self) -> impl Iterator<Item = (u32, &JobRecord)> {
        self.set_aside
            .iter()
            .map(|material| (*material, &self.jobs[*material as usize]))
    }

    fn state(&self, material: u32) -> Option<&JobState> {
        Some(&self.jobs.get(material as usize)?.state)
    }

    fn requeue(&mut self, material: u32, now: Duration) -> Change {
        let job = &self.jobs[material as usize];
        let hopeless = job.errors.len() as u32 >= self.policy.failures_max
            || job.leases_lost >= self.policy.leases_lost_max;
        let state = if hopeless {
            JobState::SetAside
        } else {
            JobState::Pending
        };
        self.transition(material, state, now)
    }

    fn transition(&mut self, material: u32, state: JobState, now: Duration) -> Change {
        let mut record = self.jobs[material as usize].clone();
        record.state = state;
        self.put(material, record.clone(), now);
        Change { material, record }
    }

    // The one place where the indices over the jobs change.
    fn put(&mut self, material: u32, record: JobRecord, now: Duration) {
        match &self.jobs[material as usize].state {
            JobState::Pending => {
                self.pending.remove(&material);
            }
            JobState::Leased { worker, .. } => {
                if let Some(lease) = self.leases.remove(&material) {
                    self.expiries.remove(&(lease.expires, material));
                }
                if let Some(held) = self.holdings.get_mut(worker) {
                    held.remove(&material);
                    if held.is_empty() {
                        self.holdings.remove(worker);
                    }
                }
            }
            JobState::Completed { .. } => self.completed -= 1,
            JobState::SetAside => {
                self.set_aside.remove(&material);
            }
        }
        match &record.state {
            JobState::Pending => {
                self.pending.insert(material);
            }
            JobState::Leased { worker, .. } => {
                let expires = now + self.policy.lease;
                self.leases.insert(
                    material,
                    Lease {
                        expires,
                        views_done: 0,
                        progressed: now,
                    },
                );
                self.expiries.insert((expires, material));
                self.holdings.entry(*worker).or_default().insert(material);
            }
            JobState::Completed { .. } => self.completed += 1,
            JobState::SetAside => {
                self.set_aside.insert(material);
            }
        }
        self.jobs[material as usize] = record;
    }
}
