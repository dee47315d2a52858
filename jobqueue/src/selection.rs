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
    // First and last of each range, ordered by the first. Ranges may overlap.
    ranges: Vec<(u32, u32)>,
    stages: Vec<Stage>,
}

impl Selection {
    /// The jobs in any of `ranges`, each by its first and last material, that are in any of
    /// `stages`. No range stands for all, and so does no stage.
    pub fn new(mut ranges: Vec<(u32, u32)>, stages: Vec<Stage>) -> Self {
        ranges.sort_unstable();
        Self { ranges, stages }
    }

    /// Whether it has jobs of a stage.
    pub fn has_stage(&self, stage: Stage) -> bool {
        self.stages.is_empty() || self.stages.contains(&stage)
    }

    /// First and last material of each range, ordered by the first; none stands for all.
    pub fn ranges(&self) -> &[(u32, u32)] {
        &self.ranges
    }

    /// Whether it has this job.
    pub fn contains(&self, material: u32, job: &JobRecord) -> bool {
        let before = self.ranges.partition_point(|(first, _)| *first <= material);
        // Any of the ranges that begin before can reach this far.
        let in_range = || {
            self.ranges[..before]
                .iter()
                .any(|(_, last)| material <= *last)
        };
        self.has_stage(job.state.stage()) && (self.ranges.is_empty() || in_range())
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
