//! What blocks and hopeless jobs do to the model.

use super::{POLICY, answers, bench::Bench};
use jobqueue::BlockCause;
use std::collections::BTreeSet;

impl Bench {
    /// Blocks a worker in the model; returns which jobs that changes.
    pub(super) fn block(&mut self, worker: u8, cause: BlockCause) -> BTreeSet<u32> {
        let ends = (cause == BlockCause::Failures).then_some(self.now + POLICY.block);
        self.workers[worker as usize].block = Some((cause, ends));
        self.take_from(|other| other == worker, cause)
    }

    /// Blocks whoever answers for a worker in the model; returns which jobs that changes.
    pub(super) fn distrust(&mut self, worker: u8) -> BTreeSet<u32> {
        let liar = answers(worker);
        match liar {
            0 => self.workers[0].block = Some((BlockCause::Disagreement, None)),
            _ => self.workers[liar as usize].distrusted = true,
        }
        self.take_from(|other| answers(other) == liar, BlockCause::Disagreement)
    }

    /// Takes from workers what they hold, and what only they vouch for if they lied.
    fn take_from(&mut self, from: impl Fn(u8) -> bool, cause: BlockCause) -> BTreeSet<u32> {
        let mut touched = BTreeSet::new();
        for (material, job) in (0..).zip(&mut self.jobs) {
            if job.lease.as_ref().is_some_and(|lease| from(lease.worker)) {
                job.lease = None;
                touched.insert(material);
            }
            if cause != BlockCause::Disagreement {
                continue;
            }
            let agreed = job.opinions.len() == 2 && !job.is_disputed();
            let delivered = job.opinions.first().is_some_and(|(_, by)| from(*by));
            if delivered && !agreed {
                job.opinions.clear();
                job.lease = None;
                touched.insert(material);
            } else if job.is_disputed() && from(job.opinions[1].1) {
                job.opinions.pop();
                job.redundant_wanted = true;
                job.lease = None;
                touched.insert(material);
            }
        }
        touched
    }

    /// Takes a job from its holder. A hopeless one is not handed out again.
    pub(super) fn back_to_the_queue(&mut self, material: u32) {
        let job = self.job(material);
        job.lease = None;
        if job.hopeless() {
            if job.is_disputed() || job.opinions.is_empty() {
                job.opinions.clear();
                job.quarantined = true;
            } else {
                job.redundant_wanted = false;
            }
        }
    }
}
