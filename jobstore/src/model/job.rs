//! What the model knows of a job and of a worker, told in the plainest way: no indices, every
//! question answered by a search.

use super::{POLICY, id, name};
use jobqueue::{BlockCause, Dispute, Fingerprint, Holder, JobState, RedundantRender, token::Token};
use std::{collections::BTreeSet, time::Duration};

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ModelJob {
    pub lease: Option<ModelLease>,
    // Who says what the job's images are, first, second and third.
    pub opinions: Vec<(Fingerprint, u8)>,
    pub redundant_wanted: bool,
    pub quarantined: bool,
    pub cancelled: bool,
    pub priority: i32,
    pub failed_on: Vec<u8>,
    pub leases_lost: u32,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct ModelLease {
    pub token: Token,
    pub worker: u8,
    pub claimed: Duration,
    pub expires: Duration,
    pub views_done: u32,
    pub progressed: Duration,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ModelWorker {
    pub present: bool,
    pub failed_in_a_row: Vec<u32>,
    pub failures: u64,
    pub leases_lost: u64,
    // When it ends, where it ends.
    pub block: Option<(BlockCause, Option<Duration>)>,
    // These are kept for whoever answers for it: why all it answers for are blocked, how many of
    // their completions were looked at because they were new, and whether an audit is due.
    pub distrusted: bool,
    pub probation: u32,
    pub audit_due: bool,
}

impl ModelJob {
    pub fn is_pending(&self) -> bool {
        self.lease.is_none() && self.opinions.is_empty() && !self.quarantined && !self.cancelled
    }

    pub fn is_disputed(&self) -> bool {
        self.opinions.len() == 2 && self.opinions[0].0 != self.opinions[1].0
    }

    pub fn is_completed(&self) -> bool {
        !self.opinions.is_empty() && !self.is_disputed()
    }

    pub fn wants_opinion(&self) -> bool {
        self.lease.is_none()
            && (self.is_disputed() || self.opinions.len() == 1 && self.redundant_wanted)
    }

    pub fn hopeless(&self) -> bool {
        let workers: BTreeSet<u8> = self.failed_on.iter().copied().collect();
        workers.len() as u32 >= POLICY.workers_failed_max
            || self.failed_on.len() as u32 >= POLICY.failures_max
            || self.leases_lost >= POLICY.leases_lost_max
    }
}

/// The record that a job of the model has.
pub(super) fn state(model: &ModelJob) -> JobState {
    let holder = model.lease.as_ref().map(|lease| Holder {
        token: lease.token,
        worker: id(lease.worker),
        name: name(lease.worker),
    });
    match (&model.opinions[..], holder) {
        ([], _) if model.quarantined => JobState::Quarantined,
        ([], _) if model.cancelled => JobState::Cancelled,
        ([], None) => JobState::Pending,
        ([], Some(holder)) => JobState::Leased(holder),
        ([(fingerprint, by), rest @ ..], holder) => JobState::Completed {
            fingerprint: *fingerprint,
            worker: name(*by),
            redundant: match (rest, holder) {
                ([], Some(holder)) => RedundantRender::Leased(holder),
                ([], None) if model.redundant_wanted => RedundantRender::Due,
                ([], None) => RedundantRender::None,
                ([(other, by), ..], holder) if other != fingerprint => {
                    RedundantRender::Disputed(Dispute {
                        fingerprint: *other,
                        worker: name(*by),
                        holder,
                    })
                }
                _ => RedundantRender::Agreed,
            },
        },
    }
}
