//! Completions: whether one counts, and what a second or a third one says of the first.

use super::{BlockCause, Changes, Dispute, Failure, Fingerprint, JobState, Queue, RedundantRender};
use crate::{
    identity::{self, is_operator},
    token::Token,
};
use std::time::Duration;
use thiserror::Error;

/// Why a worker's word about a job counts for nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// There is no such job.
    #[error("there is no material {0} in this set")]
    UnknownMaterial(u32),
    /// The token is not the current lease's.
    #[error("the lease of material {0} is lost: its token is not the current one")]
    LeaseLost(u32),
    /// Completed before, with other images or statistics.
    #[error(
        "material {0} was completed before with other images or statistics: one of the two renderers \
         is not deterministic"
    )]
    Conflict(u32),
}

/// Where a completion stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// The token is the current lease's: it counts.
    Current {
        /// Its images would become the job's.
        records: bool,
    },
    /// The same was recorded before: nothing changes.
    Repeated,
}

/// What a completion came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The job's first: its images are the job's now.
    Recorded,
    /// The same was recorded before.
    Repeated,
    /// A second worker rendered the same.
    Agreed,
    /// A second worker rendered something else.
    Disputed,
    /// A third worker, or the operator, rendered what the first did: the second, named here, is
    /// blocked.
    Upheld(String),
    /// A third worker, or the operator, rendered what the second did: its images are the job's now,
    /// and the first, named here, is blocked.
    Overturned(String),
    /// The operator rendered something else than both: its images are the job's now, and both are
    /// blocked.
    Ruled([String; 2]),
    /// Three workers rendered three different things: the job is quarantined.
    Undecided,
}

impl Verdict {
    /// Whether the images of this completion are the job's now.
    pub fn records(&self) -> bool {
        matches!(self, Self::Recorded | Self::Overturned(_) | Self::Ruled(_))
    }

    /// Who is found to have delivered something wrong.
    pub fn liars(&self) -> &[String] {
        match self {
            Self::Upheld(liar) | Self::Overturned(liar) => std::slice::from_ref(liar),
            Self::Ruled(liars) => liars,
            Self::Recorded | Self::Repeated | Self::Agreed | Self::Disputed | Self::Undecided => {
                &[]
            }
        }
    }
}

impl Queue {
    /// Where a completion of `material` under `token` stands.
    pub fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Fingerprint,
    ) -> Result<Standing, Refusal> {
        let state = self.state(material);
        let state = state.ok_or(Refusal::UnknownMaterial(material))?;
        if state.holder().is_some_and(|holder| holder.token == token) {
            let records = takes_images(state, fingerprint);
            return Ok(Standing::Current { records });
        }
        let JobState::Completed {
            fingerprint: kept,
            redundant,
            ..
        } = state
        else {
            return Err(Refusal::LeaseLost(material));
        };
        let contradicted = match redundant {
            RedundantRender::Disputed(dispute) => Some(dispute.fingerprint),
            _ => None,
        };
        let repeats = |known: Fingerprint| known.agrees_with(fingerprint);
        if repeats(*kept) || contradicted.is_some_and(repeats) {
            Ok(Standing::Repeated)
        } else {
            Err(Refusal::Conflict(material))
        }
    }

    /// Whether a completion would make its images the job's, as things stand.
    pub fn would_record(&self, material: u32, token: Token, fingerprint: Fingerprint) -> bool {
        let standing = self.standing(material, token, fingerprint);
        standing == Ok(Standing::Current { records: true })
    }

    /// Completes a job, or its second or third rendering. `redundant` asks for a second rendering of
    /// a first one; one of a newcomer is rendered again in any case.
    ///
    /// Architecture invariant: a completion counts only with the current lease's token. A lease
    /// whose time is over but which nobody has taken back is still current.
    pub fn complete(
        &mut self,
        material: u32,
        token: Token,
        fingerprint: Fingerprint,
        redundant: bool,
        now: Duration,
    ) -> Result<(Verdict, Changes), Refusal> {
        if self.standing(material, token, fingerprint)? == Standing::Repeated {
            return Ok((Verdict::Repeated, Changes::default()));
        }
        let records = self.would_record(material, token, fingerprint);
        let state = self.jobs[material].state.clone();
        let Some(name) = state.holder().map(|holder| holder.name.clone()) else {
            unreachable!("current, so there is a holder");
        };
        let mut changes = Changes::default();
        changes.workers.extend(self.workers.note_success(&name));
        let (verdict, decision) = match state {
            JobState::Completed {
                fingerprint: first,
                worker,
                redundant: RedundantRender::Disputed(second),
            } => {
                let first = (first, worker);
                self.third_opinion(material, first, second, (fingerprint, name), now)
            }
            JobState::Completed {
                fingerprint: first,
                worker,
                ..
            } => {
                let first = (first, worker);
                self.second_opinion(material, first, (fingerprint, name), now)
            }
            _ => {
                let noted = self.workers.note_first_rendering(&name, &self.policy);
                let redundant = if redundant || noted.on_probation {
                    RedundantRender::Due
                } else {
                    RedundantRender::None
                };
                let mut changes = self.completed(material, (fingerprint, name), redundant, now);
                changes.workers.extend(noted.change);
                (Verdict::Recorded, changes)
            }
        };
        changes.extend(decision);
        debug_assert_eq!(records, verdict.records(), "{verdict:?}");
        Ok((verdict, changes))
    }

    fn second_opinion(
        &mut self,
        material: u32,
        first: (Fingerprint, String),
        second: (Fingerprint, String),
        now: Duration,
    ) -> (Verdict, Changes) {
        if first.0.agrees_with(second.0) {
            let changes = self.completed(material, first, RedundantRender::Agreed, now);
            return (Verdict::Agreed, changes);
        }
        let dispute = Dispute {
            fingerprint: second.0,
            worker: second.1,
            holder: None,
        };
        let changes = self.completed(material, first, RedundantRender::Disputed(dispute), now);
        (Verdict::Disputed, changes)
    }

    fn third_opinion(
        &mut self,
        material: u32,
        first: (Fingerprint, String),
        second: Dispute,
        third: (Fingerprint, String),
        now: Duration,
    ) -> (Verdict, Changes) {
        let by = if is_operator(&third.1) {
            "the operator rendered"
        } else {
            "two others rendered"
        };
        let (truth, verdict) = if third.0.agrees_with(first.0) {
            (first, Verdict::Upheld(second.worker))
        } else if third.0.agrees_with(second.fingerprint) {
            (third, Verdict::Overturned(first.1))
        } else if is_operator(&third.1) {
            (third, Verdict::Ruled([first.1, second.worker]))
        } else {
            return self.undecided(material, [first.1, second.worker, third.1], now);
        };
        let mut changes = self.completed(material, truth, RedundantRender::Agreed, now);
        for liar in verdict.liars() {
            let reason = format!(
                "{by} material {material} to other images or statistics than {liar} delivered"
            );
            let liar = identity::identity(liar);
            changes.extend(self.block(liar, BlockCause::Disagreement, reason, now));
        }
        (verdict, changes)
    }

    /// Three workers rendered three different things: the renderer is to blame, or a liar.
    fn undecided(
        &mut self,
        material: u32,
        [first, second, third]: [String; 3],
        now: Duration,
    ) -> (Verdict, Changes) {
        let error =
            format!("{first}, {second} and {third} rendered three different sets of images");
        let failure = Failure {
            worker: third,
            error,
        };
        self.jobs[material].failures.push(failure);
        let mut changes = Changes::default();
        let change = self.transition(material, JobState::Quarantined, now);
        changes.jobs.push(change);
        changes.retracted.push(material);
        (Verdict::Undecided, changes)
    }

    pub(super) fn completed(
        &mut self,
        material: u32,
        (fingerprint, worker): (Fingerprint, String),
        redundant: RedundantRender,
        now: Duration,
    ) -> Changes {
        let state = JobState::Completed {
            fingerprint,
            worker,
            redundant,
        };
        let mut changes = Changes::default();
        changes.jobs.push(self.transition(material, state, now));
        changes
    }
}

/// Whether a completion of a job in this state makes its images the job's.
fn takes_images(state: &JobState, fingerprint: Fingerprint) -> bool {
    match state {
        JobState::Completed {
            fingerprint: first,
            redundant: RedundantRender::Disputed(second),
            ..
        } => {
            let rules = second.holder.as_ref();
            let rules = rules.is_some_and(|holder| is_operator(&holder.name));
            let agrees = fingerprint.agrees_with(second.fingerprint);
            (agrees || rules) && !fingerprint.agrees_with(*first)
        }
        JobState::Completed { .. } => false,
        _ => true,
    }
}
