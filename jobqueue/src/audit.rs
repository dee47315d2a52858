//! Audits: completions drawn when all other work is done, for another to render again.
//!
//! A draw when a completion arrives says nothing of what its worker will do later, and a share of a
//! hundredth finds a liar of sixty materials in half of all cases. A draw at the end is over all that
//! an identity delivered: where a share f of it is wrong, n draws miss with (1 - f)^n. The draws are
//! made after the images are, so nobody can know which.

use super::{Changes, JobState, Queue, RedundantRender, identity::identity};
use std::{collections::BTreeMap, time::Duration};

impl Queue {
    /// Where no job waits or is under way: draws completions of each identity whose work is to be
    /// audited, for others to render again. `seed` is random. Looks at every job.
    pub fn draw_audits(&mut self, seed: u64, now: Duration) -> Changes {
        let due = self.audits_due();
        if due.is_empty() {
            return Changes::default();
        }
        let mut alone: BTreeMap<&str, Vec<u32>> = BTreeMap::new();
        for (material, job) in self.jobs.from(0) {
            if let Some(worker) = vouches_alone(&job.state) {
                alone.entry(identity(worker)).or_default().push(material);
            }
        }
        let count = self.policy.audits as usize;
        let drawn = due.into_iter().map(|by| {
            let among = alone.get(by.as_str());
            let drawn = among.map(|among| draw(among, count, seed));
            (by, drawn.unwrap_or_default())
        });
        let drawn: Vec<(String, Vec<u32>)> = drawn.collect();
        let mut changes = Changes::default();
        for (by, drawn) in drawn {
            changes.extend(self.audit(&by, &drawn, now));
        }
        changes
    }

    /// Identities whose work is to be audited, where no job waits or is under way; empty else.
    pub fn audits_due(&self) -> Vec<String> {
        if !self.pending.is_empty() || !self.leases.is_empty() {
            return Vec::new();
        }
        self.workers.audits_due().map(str::to_owned).collect()
    }

    /// Has others render these completions of an identity again, those that it alone vouches for, and
    /// notes that it was audited.
    pub fn audit(&mut self, by: &str, drawn: &[u32], now: Duration) -> Changes {
        let mut changes = Changes {
            workers: vec![self.workers.note_audit(by)],
            ..Changes::default()
        };
        for material in drawn {
            let state = self.state(*material);
            let vouched = state.and_then(vouches_alone);
            let Some(worker) = vouched.filter(|worker| identity(worker) == by) else {
                continue;
            };
            let worker = worker.to_owned();
            if let Some(JobState::Completed { fingerprint, .. }) = state {
                let rendered = (*fingerprint, worker);
                changes.extend(self.completed(*material, rendered, RedundantRender::Due, now));
            }
        }
        changes
    }
}

/// Who rendered a completed job that nobody else was asked about.
fn vouches_alone(state: &JobState) -> Option<&str> {
    match state {
        JobState::Completed {
            worker,
            redundant: RedundantRender::None,
            ..
        } => Some(worker),
        _ => None,
    }
}

/// Draws up to `count` of `among` by `seed` alone, each choice as likely as any other.
fn draw(among: &[u32], count: usize, seed: u64) -> Vec<u32> {
    let mut keyed: Vec<(u64, u32)> = among
        .iter()
        .map(|material| (scramble(seed ^ scramble(u64::from(*material))), *material))
        .collect();
    keyed.sort_unstable();
    keyed.truncate(count);
    keyed.into_iter().map(|(_, material)| material).collect()
}

/// SplitMix64's finaliser (Steele, Lea, Flood 2014): a bijection that mixes well.
fn scramble(bits: u64) -> u64 {
    let bits = bits.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}
