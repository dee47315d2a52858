//! What people do to the queue: retry, cancel, prioritise, pause, resume, drain, bar, unbar.

use super::{
    Bar, BarCause, Changes, Check, JobChange, JobRecord, JobState, Mode, Queue, WorkerChange,
};
use std::time::Duration;

impl Queue {
    /// Gives jobs that were set aside or cancelled another chance, with their history wiped. Jobs
    /// in other states are left alone.
    pub fn retry(&mut self, materials: impl IntoIterator<Item = u32>, now: Duration) -> Changes {
        self.change_each(materials, now, |job| match job.state {
            JobState::SetAside | JobState::Cancelled => Some(JobRecord {
                priority: job.priority,
                ..JobRecord::default()
            }),
            _ => None,
        })
    }

    /// The same for all that were set aside.
    pub fn retry_set_aside(&mut self, now: Duration) -> Changes {
        self.retry(self.set_aside.clone(), now)
    }

    /// Gives up jobs that are not done; their holders hear of it at their next renewal. Jobs in
    /// other states are left alone.
    pub fn cancel(&mut self, materials: impl IntoIterator<Item = u32>, now: Duration) -> Changes {
        self.change_each(materials, now, |job| match job.state {
            JobState::Pending | JobState::Leased(_) | JobState::SetAside => Some(JobRecord {
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

    /// Gives a worker no more work and takes back what it holds. Of one that delivered wrong
    /// images, everything that nobody else has rendered the same goes back to the queue.
    pub fn bar(&mut self, name: &str, cause: BarCause, reason: String, now: Duration) -> Changes {
        let bar = Bar { cause, reason };
        let bar_ends = now + self.policy.bar;
        let mut changes = Changes {
            workers: vec![self.workers.set_bar(name, bar, bar_ends)],
            ..Changes::default()
        };
        let held = self.leases.keys().copied();
        let held = held.filter(|material| {
            let holder = self.holder(*material);
            holder.is_some_and(|holder| holder.name == name)
        });
        let held: Vec<u32> = held.collect();
        changes.extend(self.hand_back(held, now));
        if cause == BarCause::Disagreement {
            changes.extend(self.disown(name, now));
        }
        changes
    }

    /// Lets a worker work again, if it is barred.
    pub fn unbar(&mut self, name: &str) -> Option<WorkerChange> {
        self.workers.lift_bar(name)
    }

    /// Takes from the set what only this worker vouches for.
    fn disown(&mut self, name: &str, now: Duration) -> Changes {
        let mut changes = Changes::default();
        let materials: Vec<u32> = self.jobs.from(0).map(|(material, _)| material).collect();
        for material in materials {
            let JobState::Completed {
                fingerprint,
                worker,
                check,
            } = self.jobs[material].state.clone()
            else {
                continue;
            };
            let state = match check {
                Check::Agreed => continue,
                _ if worker == name => {
                    changes.retracted.push(material);
                    JobState::Pending
                }
                // Its contradiction counts for nothing; somebody else has to look.
                Check::Disputed(dispute) if dispute.worker == name => JobState::Completed {
                    fingerprint,
                    worker,
                    check: Check::Due,
                },
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
