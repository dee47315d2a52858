//! Who waits, and for what.

use super::{Asked, Claim, Request, StandingOf};
use jobqueue::Standing;
use jobstore::{Decision, Delivery, JobStoreError, Leased, Renewal};
use std::{collections::BTreeSet, time::Duration};
use tokio::{
    sync::{Notify, mpsc::UnboundedReceiver},
    task::yield_now,
    time::{Instant, sleep_until},
};

/// Those who are answered ask again at once: before the next transaction begins they are let run, so
/// that they come along.
const YIELDS: usize = 32;

/// Those who ask for jobs.
pub(super) struct ClaimsWaiting {
    waiting: UnboundedReceiver<Asked<Claim, Leased>>,
    // Until then they wait for each other.
    from: Instant,
}

impl ClaimsWaiting {
    pub fn new(waiting: UnboundedReceiver<Asked<Claim, Leased>>) -> Self {
        let from = Instant::now();
        Self { waiting, from }
    }

    /// Has claims wait where there is no work: many idle workers cost as little as one.
    pub fn pause(&mut self, found_work: bool, pause: Duration) {
        let pause = if found_work { Duration::ZERO } else { pause };
        self.from = Instant::now() + pause;
    }

    /// All who wait, as soon as anybody does. `offered` says that there may be work again.
    pub async fn next(&mut self, offered: &Notify) -> Option<Batch> {
        let_run().await;
        tokio::select! {
            () = sleep_until(self.from) => {}
            () = offered.notified() => {}
        }
        let claims = all(&mut self.waiting).await?;
        Some(Batch {
            claims,
            ..Batch::default()
        })
    }
}

/// Those who ask for anything else.
pub(super) struct OthersWaiting {
    waiting: UnboundedReceiver<Request>,
}

impl OthersWaiting {
    pub fn new(waiting: UnboundedReceiver<Request>) -> Self {
        Self { waiting }
    }

    /// All who wait, as soon as anybody does.
    pub async fn next(&mut self) -> Option<Batch> {
        let_run().await;
        let mut batch = Batch::default();
        for request in all(&mut self.waiting).await? {
            match request {
                Request::Standing(asked) => batch.standings.push(asked),
                Request::Renew(asked) => batch.renewals.push(asked),
                Request::Complete(asked) => batch.completions.push(asked),
            }
        }
        Some(batch)
    }
}

async fn let_run() {
    for _ in 0..YIELDS {
        yield_now().await;
    }
}

/// All that wait, one at least, or none where nobody will ask any more.
async fn all<Waiting>(waiting: &mut UnboundedReceiver<Waiting>) -> Option<Vec<Waiting>> {
    let mut all = Vec::new();
    let received = waiting
        .recv_many(&mut all, limits::DATABASE_BATCH_MAX)
        .await;
    (received > 0).then_some(all)
}

/// What one transaction is asked.
#[derive(Default)]
pub(super) struct Batch {
    standings: Vec<Asked<StandingOf, Standing>>,
    claims: Vec<Asked<Claim, Leased>>,
    renewals: Vec<Asked<Vec<Renewal>, Vec<bool>>>,
    completions: Vec<Asked<Delivery, Decision>>,
}

/// The same, without those who wait.
pub(super) struct Questions<'a> {
    pub standings: Vec<&'a StandingOf>,
    pub claims: Vec<&'a Claim>,
    pub renewals: Vec<&'a [Renewal]>,
    pub completions: Vec<&'a Delivery>,
}

/// What it answers, in the order of the questions.
pub(super) struct Answers {
    pub standings: Vec<Result<Standing, JobStoreError>>,
    pub claims: Vec<Result<Leased, JobStoreError>>,
    pub renewals: Vec<Vec<bool>>,
    /// None where it has to be recorded alone.
    pub completions: Vec<Option<Result<Decision, JobStoreError>>>,
}

impl Answers {
    /// False when somebody asked for work and nobody got any.
    pub fn found_work(&self) -> bool {
        let mut claims = self.claims.iter();
        self.claims.is_empty()
            || claims.any(|leased| leased.as_ref().is_ok_and(|leased| !leased.jobs.is_empty()))
    }
}

impl Batch {
    pub fn len(&self) -> usize {
        self.standings.len() + self.claims.len() + self.renewals.len() + self.completions.len()
    }

    pub fn questions(&self) -> Questions<'_> {
        let renewals = self.renewals.iter();
        Questions {
            standings: self.standings.iter().map(|asked| &asked.question).collect(),
            claims: self.claims.iter().map(|asked| &asked.question).collect(),
            renewals: renewals.map(|asked| &asked.question[..]).collect(),
            completions: self
                .completions
                .iter()
                .map(|asked| &asked.question)
                .collect(),
        }
    }

    /// One batch for each question.
    pub fn split(self) -> Vec<Self> {
        let standings = self.standings.into_iter().map(|asked| Self {
            standings: vec![asked],
            ..Self::default()
        });
        let renewals = self.renewals.into_iter().map(|asked| Self {
            renewals: vec![asked],
            ..Self::default()
        });
        let completions = self.completions.into_iter().map(|asked| Self {
            completions: vec![asked],
            ..Self::default()
        });
        let claims = self.claims.into_iter().map(|asked| Self {
            claims: vec![asked],
            ..Self::default()
        });
        let others = standings.chain(renewals).chain(completions);
        others.chain(claims).collect()
    }

    /// Answers everybody; returns the completions that have to be recorded alone.
    pub fn tell(self, answers: Answers) -> Vec<Asked<Delivery, Decision>> {
        tell(self.standings, answers.standings);
        tell(self.claims, answers.claims);
        tell(
            self.renewals,
            answers.renewals.into_iter().map(Ok).collect(),
        );
        let mut alone = Vec::new();
        for (asked, answer) in self.completions.into_iter().zip(answers.completions) {
            match answer {
                // Whoever asked may have gone.
                Some(answer) => drop(asked.answer.send(answer)),
                None => alone.push(asked),
            }
        }
        alone
    }

    /// Tells everybody the same.
    pub fn refuse(self, error: JobStoreError) {
        // Where there is but one it hears what happened in full.
        let mut first = Some(error);
        let why = first.as_ref().map(ToString::to_string).unwrap_or_default();
        let mut refusal = || {
            first
                .take()
                .unwrap_or(JobStoreError::Unavailable(why.clone()))
        };
        for asked in self.standings {
            let _ = asked.answer.send(Err(refusal()));
        }
        for asked in self.claims {
            let _ = asked.answer.send(Err(refusal()));
        }
        for asked in self.renewals {
            let _ = asked.answer.send(Err(refusal()));
        }
        for asked in self.completions {
            let _ = asked.answer.send(Err(refusal()));
        }
    }
}

fn tell<Question, Answer>(
    asked: Vec<Asked<Question, Answer>>,
    answers: Vec<Result<Answer, JobStoreError>>,
) {
    for (asked, answer) in asked.into_iter().zip(answers) {
        // Whoever asked may have gone.
        let _ = asked.answer.send(answer);
    }
}

impl Questions<'_> {
    /// The materials of completions, once each and in order.
    pub fn completed(&self) -> Vec<i64> {
        let materials = self.completions.iter();
        let materials: BTreeSet<u32> = materials
            .map(|delivery| delivery.completion.material)
            .collect();
        materials.into_iter().map(i64::from).collect()
    }

    /// The materials of renewals, once each and in order.
    pub fn renewed(&self) -> Vec<i64> {
        let renewals = self.renewals.iter().copied().flatten();
        let materials: BTreeSet<u32> = renewals.map(|renewal| renewal.material).collect();
        materials.into_iter().map(i64::from).collect()
    }
}
