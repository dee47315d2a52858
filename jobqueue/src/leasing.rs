//! Handing jobs out, and taking them back.

use super::{
    BlockCause, Changes, Dispute, Failure, Holder, JobState, Mode, Policy, Queue, RedundantRender,
    Refusal,
};
use crate::{
    identity::{identity, is_operator},
    token::{Token, WorkerId},
};
use std::time::Duration;

/// The times of a lease, on the clock that transitions are told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// When it was handed out.
    pub claimed: Duration,
    /// When it runs out.
    pub expires: Duration,
    /// How many views are rendered, as its holder last said.
    pub views_done: u32,
    /// When it last said that there were more.
    pub progressed: Duration,
}

impl Lease {
    /// When it ends whatever its holder says. Until the first view is done it does not stand still:
    /// it may wait in its worker behind another.
    fn ends(&self, policy: &Policy) -> Duration {
        let deadline = self.claimed + policy.deadline;
        match self.views_done {
            0 => deadline,
            _ => deadline.min(self.progressed + policy.stall),
        }
    }
}

/// A lease that was taken back from its holder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LostLease {
    /// The job.
    pub material: u32,
    /// Who held it.
    pub holder: Holder,
}

impl Queue {
    /// Leases jobs to `worker`, one for each of `tokens` while there are jobs for it and it has
    /// room. Jobs come in the order of the tokens.
    ///
    /// Disputes go first and redundant renders next, so that a worker that lies is found early; the
    /// operator gets disputes and nothing else. A job goes back to a worker that failed it only when
    /// nobody else is there to try.
    pub fn claim(&mut self, worker: WorkerId, tokens: &[Token], now: Duration) -> Changes {
        let mut changes = Changes::default();
        let Some(name) = self.workers.name(worker).map(str::to_owned) else {
            return changes;
        };
        if self.mode != Mode::Running || self.workers.block(&name).is_some() {
            return changes;
        }
        let room = self.policy.leases_per_worker_max;
        let room = room.saturating_sub(self.held(worker)) as usize;
        let materials = self.claimable(&name, room.min(tokens.len()));
        for (material, token) in materials.into_iter().zip(tokens) {
            let holder = Holder {
                token: *token,
                worker,
                name: name.clone(),
            };
            let state = self.jobs[material].state.clone();
            let change = self.transition(material, leased(state, holder), now);
            changes.jobs.push(change);
        }
        changes
    }

    /// Prolongs a lease to its full time from now, but never past the time that a stalled job, or
    /// any job, is allowed. False when the token is not the current one, or that time is over: the
    /// holder can stop working on it.
    pub fn renew(&mut self, material: u32, token: Token, views_done: u32, now: Duration) -> bool {
        let current = self.holder(material).map(|holder| holder.token);
        if current != Some(token) {
            return false;
        }
        let Some(lease) = self.leases.get_mut(&material) else {
            return false;
        };
        if views_done > lease.views_done {
            lease.views_done = views_done;
            lease.progressed = now;
        }
        let ends = lease.ends(&self.policy);
        self.expiries.remove(&(lease.expires, material));
        lease.expires = (now + self.policy.lease).min(ends);
        self.expiries.insert((lease.expires, material));
        now < ends
    }

    /// Records a failure that the holder reports: back to the queue, or quarantined at the limit. It
    /// counts against the worker too, and may block it.
    pub fn fail(
        &mut self,
        material: u32,
        token: Token,
        error: &str,
        now: Duration,
    ) -> Result<Changes, Refusal> {
        let state = self.state(material);
        let state = state.ok_or(Refusal::UnknownMaterial(material))?;
        let holder = state.holder().filter(|holder| holder.token == token);
        let holder = holder.ok_or(Refusal::LeaseLost(material))?.clone();
        self.jobs[material].failures.push(Failure {
            worker: holder.name.clone(),
            error: error.to_owned(),
        });
        let mut changes = self.requeue(material, now);
        let jobs_max = self.policy.jobs_failed_max;
        let noted = self
            .workers
            .note_failure(&holder.name, material, error, jobs_max);
        let (worker, too_many) = noted;
        changes.workers.push(worker);
        if too_many {
            let reason = format!("it failed {jobs_max} different materials in a row");
            changes.extend(self.block(&holder.name, BlockCause::Failures, reason, now));
        }
        Ok(changes)
    }

    /// Takes back every lease of a worker that leaves; counts against nobody.
    pub fn release(&mut self, worker: WorkerId, now: Duration) -> Changes {
        let held = self.holdings.get(&worker).cloned().unwrap_or_default();
        self.hand_back(held, now)
    }

    /// Takes back every lease, where nobody can be left who holds one; counts against nobody.
    pub fn release_all(&mut self, now: Duration) -> Changes {
        let held: Vec<u32> = self.leases.keys().copied().collect();
        self.hand_back(held, now)
    }

    /// Takes back every lease whose time is over, and lifts blocks whose time is.
    pub fn expire(&mut self, now: Duration) -> (Changes, Vec<LostLease>) {
        let over = self.expiries.iter();
        let over = over.take_while(|(expires, _)| *expires <= now);
        let over: Vec<u32> = over.map(|(_, material)| *material).collect();
        let mut changes = Changes::default();
        let mut lost = Vec::new();
        for material in over {
            let Some(holder) = self.holder(material).cloned() else {
                unreachable!("what expires is leased");
            };
            self.jobs[material].leases_lost += 1;
            changes.extend(self.requeue(material, now));
            changes
                .workers
                .push(self.workers.note_lost_lease(&holder.name));
            lost.push(LostLease { material, holder });
        }
        changes.workers.extend(self.workers.lift_ended_blocks(now));
        (changes, lost)
    }

    /// When the next lease runs out or the next block ends, if any does.
    pub fn next_expiry(&self) -> Option<Duration> {
        let lease = self.expiries.first().map(|(expires, _)| *expires);
        lease.into_iter().chain(self.workers.next_block_end()).min()
    }

    /// What a worker of this name may be given, the most urgent first.
    fn claimable(&self, name: &str, count: usize) -> Vec<u32> {
        let decision = self.disputed.iter().chain(&self.redundant_due).copied();
        let decision = decision.filter(|material| self.may_rerender(name, *material));
        if is_operator(name) {
            return decision.take(count).collect();
        }
        let fresh = self.pending.iter().map(|(_, material)| *material);
        let fresh = fresh.filter(|material| !self.jobs[*material].failed_on(name));
        let mut materials: Vec<u32> = decision.chain(fresh).take(count).collect();
        if materials.len() < count {
            let again = self.pending.iter().map(|(_, material)| *material);
            let again = again.filter(|material| {
                let job = &self.jobs[*material];
                job.failed_on(name) && self.renderers().all(|other| job.failed_on(other))
            });
            materials.extend(again.take(count - materials.len()));
        }
        materials
    }

    /// Whether a worker of this name can say something new of a completed job: one opinion for each
    /// identity, and the operator's on disputes.
    pub(super) fn may_rerender(&self, name: &str, material: u32) -> bool {
        let job = &self.jobs[material];
        let JobState::Completed {
            worker, redundant, ..
        } = &job.state
        else {
            return false;
        };
        let asked = identity(name);
        let other = match redundant {
            RedundantRender::Due => !is_operator(name),
            RedundantRender::Disputed(dispute) => {
                dispute.holder.is_none() && identity(&dispute.worker) != asked
            }
            RedundantRender::None | RedundantRender::Leased(_) | RedundantRender::Agreed => false,
        };
        other && identity(worker) != asked && !job.failed_on(name)
    }

    /// Names of those who are there to render jobs.
    fn renderers(&self) -> impl Iterator<Item = &str> {
        self.workers.able().filter(|name| !is_operator(name))
    }

    /// Takes a lease back after a failure or a silence.
    fn requeue(&mut self, material: u32, now: Duration) -> Changes {
        let job = &self.jobs[material];
        let hopeless = job.workers_failed() as u32 >= self.policy.workers_failed_max
            || job.failures.len() as u32 >= self.policy.failures_max
            || job.leases_lost >= self.policy.leases_lost_max;
        let mut changes = Changes::default();
        let state = match (unleased(job.state.clone()), hopeless) {
            (JobState::Pending, true) => JobState::Quarantined,
            // A redundant render that cannot be had is done without; images that two workers
            // contradict each other about are not.
            (
                JobState::Completed {
                    redundant: RedundantRender::Disputed(_),
                    ..
                },
                true,
            ) => {
                changes.retracted.push(material);
                JobState::Quarantined
            }
            (
                JobState::Completed {
                    fingerprint,
                    worker,
                    ..
                },
                true,
            ) => JobState::Completed {
                fingerprint,
                worker,
                redundant: RedundantRender::None,
            },
            (state, _) => state,
        };
        changes.jobs.push(self.transition(material, state, now));
        changes
    }

    pub(super) fn hand_back(
        &mut self,
        held: impl IntoIterator<Item = u32>,
        now: Duration,
    ) -> Changes {
        let mut changes = Changes::default();
        for material in held {
            let state = unleased(self.jobs[material].state.clone());
            changes.jobs.push(self.transition(material, state, now));
        }
        changes
    }
}

/// A job's state with a lease.
fn leased(state: JobState, holder: Holder) -> JobState {
    match state {
        JobState::Completed {
            fingerprint,
            worker,
            redundant,
        } => {
            let redundant = match redundant {
                RedundantRender::Disputed(dispute) => RedundantRender::Disputed(Dispute {
                    holder: Some(holder),
                    ..dispute
                }),
                _ => RedundantRender::Leased(holder),
            };
            JobState::Completed {
                fingerprint,
                worker,
                redundant,
            }
        }
        _ => JobState::Leased(holder),
    }
}

/// A leased job's state without its lease.
pub fn unleased(state: JobState) -> JobState {
    match state {
        JobState::Leased(_) => JobState::Pending,
        JobState::Completed {
            fingerprint,
            worker,
            redundant,
        } => {
            let redundant = match redundant {
                RedundantRender::Leased(_) => RedundantRender::Due,
                RedundantRender::Disputed(dispute) => RedundantRender::Disputed(Dispute {
                    holder: None,
                    ..dispute
                }),
                redundant => redundant,
            };
            JobState::Completed {
                fingerprint,
                worker,
                redundant,
            }
        }
        state => state,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_secs(3600);

    /// Renews every 20 s from one time to another; when the lease was lost, if it was.
    fn renewed(
        queue: &mut Queue,
        token: Token,
        views: u32,
        times: [Duration; 2],
    ) -> Option<Duration> {
        let mut now = times[0];
        while now < times[1] {
            let lost = queue.expire(now).1;
            if !lost.is_empty() || !queue.renew(0, token, views, now) {
                return Some(now);
            }
            now += Duration::from_secs(20);
        }
        None
    }

    #[test]
    fn a_job_that_waits_behind_a_slow_one_is_kept_and_one_that_stands_still_is_not() {
        let mut queue = Queue::new(1, Policy::default());
        let worker = WorkerId::from_bytes([1; 16]);
        let token = Token::from_bytes([2; 16]);
        queue.admit(worker, "w");
        assert_eq!(queue.claim(worker, &[token], Duration::ZERO).jobs.len(), 1);
        assert_eq!(
            renewed(&mut queue, token, 0, [Duration::ZERO, 3 * HOUR]),
            None
        );
        // Its turn came.
        let stalled = renewed(&mut queue, token, 1, [3 * HOUR, 6 * HOUR]).unwrap();
        assert!((4 * HOUR..=4 * HOUR + Duration::from_secs(60)).contains(&stalled));

        let again = Token::from_bytes([3; 16]);
        queue.expire(5 * HOUR);
        assert_eq!(queue.claim(worker, &[again], 5 * HOUR).jobs.len(), 1);
        let ended = renewed(&mut queue, again, 0, [5 * HOUR, 20 * HOUR]).unwrap();
        assert!((11 * HOUR..=11 * HOUR + Duration::from_secs(60)).contains(&ended));
    }
}
