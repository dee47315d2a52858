//! Looking through the jobs a part at a time, so that whoever holds the queue's lock holds it for
//! less than a millisecond, however many jobs there are and however few are looked for.

use super::{Queue, Selection, Stage};
use std::iter;

/// What was found among some of the jobs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Look {
    /// Jobs of the selection, in order.
    pub materials: Vec<u32>,
    /// Where to look on. Nothing may be found there.
    pub next: Option<u32>,
}

impl Queue {
    /// Looks at jobs from a material on until it has found `found_max` of a selection, or looked at
    /// `looks_max`.
    pub fn look(
        &self,
        from: u32,
        selection: &Selection,
        found_max: usize,
        looks_max: usize,
    ) -> Look {
        let mut look = Look::default();
        for (looks, material) in self.candidates(from, selection).enumerate() {
            if looks == looks_max || look.materials.len() == found_max {
                look.next = Some(material);
                break;
            }
            let job = self.jobs.get(material);
            if job.is_some_and(|job| selection.contains(material, job)) {
                look.materials.push(material);
            }
        }
        look
    }

    /// Materials from one on among which are all of a selection: by stage, where the queue lists
    /// them by stage, and else by range.
    fn candidates<'a>(
        &'a self,
        from: u32,
        selection: &'a Selection,
    ) -> Box<dyn Iterator<Item = u32> + 'a> {
        let stages = selection.stages();
        let listed = |stage: &Stage| !matches!(stage, Stage::Pending | Stage::Completed);
        if !stages.is_empty() && stages.iter().all(listed) {
            let mut next = Some(from);
            return Box::new(iter::from_fn(move || {
                let at = next?;
                let listed = stages.iter().filter_map(|stage| self.listed(*stage, at));
                let first = listed.min()?;
                next = first.checked_add(1);
                Some(first)
            }));
        }
        let Some(last) = self.jobs.len().checked_sub(1) else {
            return Box::new(iter::empty());
        };
        let ranges = selection.within(from, last as u32);
        Box::new(ranges.into_iter().flat_map(|(first, last)| first..=last))
    }

    /// The first job from a material on that may be of a stage.
    fn listed(&self, stage: Stage, at: u32) -> Option<u32> {
        let list = match stage {
            Stage::Leased => return self.leases.range(at..).next().map(|(first, _)| *first),
            Stage::Disputed => &self.disputed,
            Stage::Quarantined => &self.quarantined,
            Stage::Cancelled => &self.cancelled,
            Stage::Pending | Stage::Completed => return None,
        };
        list.range(at..).next().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Policy, token::Token, token::WorkerId};
    use std::time::{Duration, Instant};

    fn all_looks(queue: &Queue, selection: &Selection, looks_max: usize) -> Vec<u32> {
        let mut found = Vec::new();
        let mut from = Some(0);
        while let Some(start) = from {
            let look = queue.look(start, selection, 3, looks_max);
            assert!(look.materials.len() <= 3);
            assert!(look.next.is_none_or(|next| next > start));
            found.extend(look.materials);
            from = look.next;
        }
        found
    }

    #[test]
    fn parts_together_find_what_a_whole_look_would() {
        let mut queue = Queue::new(200, Policy::default());
        let worker = WorkerId::from_bytes([1; 16]);
        queue.admit(worker, "w");
        let tokens: Vec<Token> = (0..20).map(|n| Token::from_bytes([n; 16])).collect();
        queue.claim(worker, &tokens, Duration::ZERO);
        queue.cancel((50..90).step_by(3), Duration::ZERO);
        let stages = [
            vec![],
            vec![Stage::Leased],
            vec![Stage::Cancelled, Stage::Leased],
            vec![Stage::Cancelled, Stage::Pending],
            vec![Stage::Quarantined],
        ];
        let ranges = [
            vec![],
            vec![(0, 0), (5, 30), (7, 9), (31, 60), (80, u32::MAX)],
            vec![(500, 600)],
        ];
        for stages in stages {
            for ranges in &ranges {
                let selection = Selection::new(ranges.clone(), stages.clone());
                let whole = queue.selected(&selection);
                for looks_max in [1, 4, 1000] {
                    assert_eq!(all_looks(&queue, &selection, looks_max), whole);
                }
            }
        }
    }

    /// Nobody holds the queue's lock for long, whatever a reader asks for.
    #[test]
    fn no_look_at_a_million_jobs_takes_long() {
        let queue = Queue::new(1_000_000, Policy::default());
        let overlapping = (0..4096).map(|n| (n * 100, 1_000_000 - n)).collect();
        let rare = Selection::new(Vec::new(), vec![Stage::Quarantined]);
        let nowhere = Selection::new(overlapping, vec![Stage::Completed]);
        let mut fastest = Duration::MAX;
        for _ in 0..20 {
            let began = Instant::now();
            let look = queue.look(0, &nowhere, 1000, limits::JOBS_LOOKED_AT_MAX);
            fastest = fastest.min(began.elapsed());
            assert!(look.materials.is_empty());
            assert_eq!(look.next, Some(limits::JOBS_LOOKED_AT_MAX as u32));
        }
        // What a debug build takes ten times as long for.
        let most = Duration::from_millis(if cfg!(debug_assertions) { 10 } else { 1 });
        assert!(fastest < most, "{fastest:?}");
        assert_eq!(queue.look(0, &rare, 1000, 1), Look::default());
    }
}
