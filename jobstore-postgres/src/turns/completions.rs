//! Completions: the queue decides of each what it comes to.

use crate::{connecting::query, fault::Fault, locked_jobs::LockedJobs};
use deadpool_postgres::Transaction;
use jobqueue::{Changes, Completion, JobRecord, JobState, Policy, RedundantRender, identity};
use jobstore::{Decision, Delivery, JobStoreContext, JobStoreError};
use std::collections::BTreeSet;
use tokio_postgres::Row;

/// What is known before the queue decides.
pub(super) struct Completing {
    /// The materials whose completion may change more than they themselves, and has to wait.
    alone: BTreeSet<u32>,
    /// Others run at the same time: of all holders but those above, a completion changes nothing that
    /// is kept of them, which `failing.sql` found out.
    beside: bool,
}

/// What completions came to.
#[derive(Default)]
pub(super) struct Completed {
    /// None where it has to be done alone.
    pub answers: Vec<Option<Result<Decision, JobStoreError>>>,
    pub changes: Changes,
    /// Those whose images are their job's now.
    pub recorded: Vec<Completion>,
}

impl Completed {
    pub fn recorded(&self) -> Vec<&Completion> {
        self.recorded.iter().collect()
    }
}

impl Completing {
    /// Beside other transactions.
    pub fn beside(locked: &LockedJobs, failing: &[Row], deliveries: &[&Delivery]) -> Self {
        let failing: BTreeSet<&str> = failing.iter().map(|row| row.get(0)).collect();
        let materials = deliveries
            .iter()
            .map(|delivery| delivery.completion.material);
        let alone = materials.filter(|material| {
            let job = locked.queue.job(*material);
            job.is_some_and(|job| needs_exclusive(job, &failing))
        });
        Self {
            alone: alone.collect(),
            beside: true,
        }
    }

    /// While no other runs: adds all that may change.
    pub async fn alone(
        transaction: &Transaction<'_>,
        locked: &mut LockedJobs,
        delivery: &Delivery,
    ) -> Result<Self, Fault> {
        widen(transaction, locked, delivery).await?;
        Ok(Self {
            alone: BTreeSet::new(),
            beside: false,
        })
    }

    /// Completes jobs that are locked.
    pub fn complete(
        &self,
        locked: &mut LockedJobs,
        deliveries: &[&Delivery],
        context: &JobStoreContext,
    ) -> Completed {
        let mut completed = Completed::default();
        for delivery in deliveries {
            let material = delivery.completion.material;
            let answer = if self.alone.contains(&material) {
                None
            } else {
                if self.beside {
                    locked.add_known_holder(material);
                }
                Some(complete_one(locked, delivery, context, &mut completed))
            };
            completed.answers.push(answer);
        }
        completed
    }
}

fn complete_one(
    locked: &mut LockedJobs,
    delivery: &Delivery,
    context: &JobStoreContext,
    completed: &mut Completed,
) -> Result<Decision, JobStoreError> {
    let Delivery {
        token,
        completion,
        check,
    } = delivery;
    let material = completion.material;
    locked.check(material)?;
    let fingerprint = completion.fingerprint();
    let queue = &mut locked.queue;
    if queue.would_record(material, *token, fingerprint)
        && context.staging().awaits_publication(completion)
    {
        return Err(JobStoreError::Unpublished(material));
    }
    let holder = queue.holder(material).cloned();
    let (verdict, changes) = queue.complete(material, *token, fingerprint, *check, locked.now)?;
    completed.changes.extend(changes.clone());
    if verdict.records()
        && let Some(holder) = &holder
    {
        completed.recorded.push(Completion {
            worker: holder.name.clone(),
            ..completion.clone()
        });
    }
    Ok(Decision {
        verdict,
        holder,
        changes,
    })
}

/// The names of those who hold these jobs and of whom a completion changes what is kept.
pub(super) async fn failing(
    transaction: &Transaction<'_>,
    materials: &[i64],
    policy: &Policy,
) -> Result<Vec<Row>, Fault> {
    if materials.is_empty() {
        return Ok(Vec::new());
    }
    let statement = include_str!("../sql/failing.sql");
    let (probation, audits) = (i64::from(policy.probation), policy.audits > 0);
    query(transaction, statement, &[&materials, &probation, &audits]).await
}

/// Whether a job's completion may change more than the job.
fn needs_exclusive(job: &JobRecord, failing: &BTreeSet<&str>) -> bool {
    let holder = job.state.holder();
    let third = matches!(
        &job.state,
        JobState::Completed { redundant: RedundantRender::Disputed(dispute), .. } if dispute.holder.is_some()
    );
    third || holder.is_some_and(|holder| failing.contains(holder.name.as_str()))
}

/// Adds what a completion may change besides its job: the histories of everybody who had a hand in
/// it, and where one of them may turn out to have lied, all that whoever answers for it holds and
/// vouches for.
async fn widen(
    transaction: &Transaction<'_>,
    locked: &mut LockedJobs,
    delivery: &Delivery,
) -> Result<(), Fault> {
    let Some(job) = locked.queue.job(delivery.completion.material) else {
        return Ok(());
    };
    let mut suspects: BTreeSet<String> = BTreeSet::new();
    if let JobState::Completed {
        worker,
        redundant: RedundantRender::Disputed(dispute),
        ..
    } = &job.state
    {
        let names = [worker, &dispute.worker];
        suspects.extend(names.map(|name| identity::identity(name).to_owned()));
    }
    let mut names = suspects.clone();
    names.extend(job.state.holder().map(|holder| holder.name.clone()));
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    locked.add_workers(transaction, &names).await?;
    let suspects: Vec<&str> = suspects.iter().map(String::as_str).collect();
    locked.add_all_of(transaction, &suspects, true).await
}
