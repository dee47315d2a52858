//! Which jobs an operator means.

use super::record::{JobRecord, JobState, RedundantRender};

/// Where a job stands, in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Waiting for a worker.
    Pending,
    /// With a worker.
    Leased,
    /// Done.
    Completed,
    /// Done twice, with different images.
    Disputed,
    /// Given up after too many failures.
    Quarantined,
    /// Not wanted any more.
    Cancelled,
}

/// Jobs by material and by stage; everything unless something is asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    // First and last of each range, ordered; none touches another.
    ranges: Vec<(u32, u32)>,
    stages: Vec<Stage>,
}

impl Selection {
    /// The jobs in any of `ranges`, each by its first and last material, that are in any of
    /// `stages`. No range stands for all, and so does no stage.
    pub fn new(mut ranges: Vec<(u32, u32)>, stages: Vec<Stage>) -> Self {
        ranges.sort_unstable();
        let mut merged: Vec<(u32, u32)> = Vec::with_capacity(ranges.len());
        for (first, last) in ranges {
            match merged.last_mut() {
                Some((_, end)) if first <= end.saturating_add(1) => *end = last.max(*end),
                _ => merged.push((first, last)),
            }
        }
        Self {
            ranges: merged,
            stages,
        }
    }

    /// The same in some of its stages; `None` where it has none of them.
    pub fn only(&self, stages: &[Stage]) -> Option<Self> {
        let stages = stages.iter().filter(|stage| self.has_stage(**stage));
        let stages: Vec<Stage> = stages.copied().collect();
        (!stages.is_empty()).then(|| Self {
            ranges: self.ranges.clone(),
            stages,
        })
    }

    /// The stages; none stands for all.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Its ranges, as far as they are within one.
    pub fn within(&self, from: u32, to: u32) -> Vec<(u32, u32)> {
        if from > to {
            return Vec::new();
        }
        if self.ranges.is_empty() {
            return vec![(from, to)];
        }
        let begin = self.ranges.partition_point(|(_, last)| *last < from);
        let ranges = self.ranges[begin..].iter();
        let ranges = ranges.take_while(|(first, _)| *first <= to);
        ranges
            .map(|(first, last)| (*first.max(&from), *last.min(&to)))
            .collect()
    }

    /// The first material from one on that is in a range.
    pub fn first_from(&self, from: u32) -> Option<u32> {
        if self.ranges.is_empty() {
            return Some(from);
        }
        let next = self.ranges.partition_point(|(_, last)| *last < from);
        self.ranges.get(next).map(|(first, _)| from.max(*first))
    }

    /// Whether a material is in a range.
    pub fn has_material(&self, material: u32) -> bool {
        self.first_from(material) == Some(material)
    }

    /// Whether it has jobs of a stage.
    pub fn has_stage(&self, stage: Stage) -> bool {
        self.stages.is_empty() || self.stages.contains(&stage)
    }

    /// Whether it has this job.
    pub fn contains(&self, material: u32, job: &JobRecord) -> bool {
        self.has_stage(job.state.stage()) && self.has_material(material)
    }
}

impl JobState {
    /// Where the job stands, in one word.
    pub fn stage(&self) -> Stage {
        match self {
            Self::Pending => Stage::Pending,
            Self::Leased(_) => Stage::Leased,
            Self::Completed { redundant, .. } => match redundant {
                RedundantRender::Disputed(_) => Stage::Disputed,
                _ => Stage::Completed,
            },
            Self::Quarantined => Stage::Quarantined,
            Self::Cancelled => Stage::Cancelled,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn merged_ranges_have_what_the_ranges_had(
            ranges in prop::collection::vec((0_u32..40, 0_u32..12), 0..9),
            from in 0_u32..60,
            to in 0_u32..60,
        ) {
            let ranges: Vec<_> = ranges.iter().map(|(first, more)| (*first, first + more)).collect();
            let selection = Selection::new(ranges.clone(), Vec::new());
            let had = |material: u32| {
                ranges.is_empty()
                    || ranges.iter().any(|(first, last)| (*first..=*last).contains(&material))
            };
            for material in 0..60 {
                prop_assert_eq!(selection.has_material(material), had(material));
            }
            let first = (from..100).find(|material| had(*material));
            prop_assert_eq!(selection.first_from(from), first);
            let within = selection.within(from, to);
            let within: Vec<u32> = within.into_iter().flat_map(|(a, b)| a..=b).collect();
            let expected: Vec<u32> = (from..=to).filter(|material| had(*material)).collect();
            prop_assert_eq!(within, expected);
        }
    }
}
