//! What people do to the queue: retry, cancel, prioritise, pause, resume, drain, block, unblock.

use super::{
    Block, BlockCause, Changes, JobChange, JobRecord, JobState, Mode, Queue, RedundantRender,
    WorkerChange, identity::means,
};
use std::time::Duration;

impl Queue {
    /// Gives jobs that were quarantined or cancelled another chance, with their history wiped. Jobs
    /// in other states are left alone.
    pub fn retry(&mut self, materials: impl IntoIterator<Item = u32>, now: Duration) -> Changes {
        self.change_each(materials, now, |job| match job.state {
            JobState::Quarantined | JobState::Cancelled => Some(JobRecord {
                priority: job.priority,
                ..JobRecord::default()
            }),
            _ => None,
        })
    }

    /// The same for all that were quarantined.
    pub fn retry_quarantined(&mut self, now: Duration) -> Changes {
        self.retry(self.quarantined.clone(), now)
    }

    /// Gives up jobs that are not done; their holders hear of it at their next renewal. Jobs in
    /// other states are left alone.
    pub fn cancel(&mut self, materials: impl IntoIterator<Item = u32>, now: Duration) -> Changes {
        self.change_each(materials, now, |job| match job.state {
            JobState::Pending | JobState::Leased(_) | JobState::Quarantined => Some(JobRecord {
                state: JobState::Cancelled,
                ..job.clone()
            }),
            JobState::Completed { .. } | JobState::Cancelled => None,
        })
    }

    /// Says how soon jobs that wait are handed out: higher first. Jobs in other states are left
    /// alone.
    pub fn prioritize(
        &mut self,
        materials: impl IntoIterator<Item = u32>,
        priority: i32,
        now: Duration,
    ) -> Changes {
        self.change_each(materials, now, |job| {
            let waits = job.state == JobState::Pending && job.priority != priority;
            waits.then(|| JobRecord {
                priority,
                ..job.clone()
            })
        })
    }

    /// Hands work out or not.
    pub fn set_mode(&mut self, mode: Mode) -> Changes {
        let changed = mode != self.mode;
        self.mode = mode;
        Changes {
            mode: changed.then_some(mode),
            ..Changes::default()
        }
    }

    /// Gives a worker, or everybody whom an [identity](crate::identity) answers for, no more work and
    /// takes back what they hold. Of an identity that delivered something wrong, everything that
    /// nobody else has rendered the same goes back to the queue.
    pub fn block(
        &mut self,
        name: &str,
        cause: BlockCause,
        reason: String,
        now: Duration,
    ) -> Changes {
        let block = Block { cause, reason };
        let block_ends = now + self.policy.block;
        let mut changes = Changes {
            workers: vec![self.workers.set_block(name, block, block_ends)],
            ..Changes::default()
        };
        let held = self.leases.keys().copied();
        let held = held.filter(|material| {
            let holder = self.holder(*material);
            holder.is_some_and(|holder| means(name, &holder.name))
        });
        let held: Vec<u32> = held.collect();
        changes.extend(self.hand_back(held, now));
        if cause == BlockCause::Disagreement {
            changes.extend(self.disown(name, now));
        }
        changes
    }

    /// Lets a worker work again, if it is blocked.
    pub fn unblock(&mut self, name: &str) -> Option<WorkerChange> {
        self.workers.lift_block(name)
    }

    /// Takes from the set what only this worker or identity vouches for.
    fn disown(&mut self, name: &str, now: Duration) -> Changes {
        let mut changes = Changes::default();
        let materials: Vec<u32> = self.jobs.from(0).map(|(material, _)| material).collect();
        for material in materials {
            let JobState::Completed {
                fingerprint,
                worker,
                redundant,
            } = self.jobs[material].state.clone()
            else {
                continue;
            };
            let state = match redundant {
                RedundantRender::Agreed => continue,
                _ if means(name, &worker) => {
                    changes.retracted.push(material);
                    JobState::Pending
                }
                // Its contradiction counts for nothing; somebody else has to look.
                RedundantRender::Disputed(dispute) if means(name, &dispute.worker) => {
                    JobState::Completed {
                        fingerprint,
                        worker,
                        redundant: RedundantRender::Due,
                    }
                }
                _ => continue,
            };
            changes.jobs.push(self.transition(material, state, now));
        }
        changes
    }

    fn change_each(
        &mut self,
        materials: impl IntoIterator<Item = u32>,
        now: Duration,
        change: impl Fn(&JobRecord) -> Option<JobRecord>,
    ) -> Changes {
        let mut changes = Changes::default();
        for material in materials {
            if let Some(record) = self.job(material).and_then(&change) {
                self.put(material, record.clone(), now);
                let change = JobChange { material, record };
                changes.jobs.push(change);
            }
        }
        changes
    }
}
