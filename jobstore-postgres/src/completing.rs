//! Completions: those of one process wait for each other and become durable together.
//!
//! For a batch, in this order: the jobs are locked and the queue decides, images get their names
//! (synced before and after), the database is written and commits, and only then does anybody hear
//! of it. What may touch more than its own job, a third opinion or the end of a row of failures,
//! is done by itself, alone.

use super::{
    Shared,
    connecting::query,
    fault::{Fault, attempt},
    locked_jobs::{LockMode, LockedJobs, number, record},
};
use dataset::Digest;
use imagestore::blobs::StagedFile;
use jobqueue::{
    Changes, Check, Completion, JobRecord, JobState, Mode, Queue, Refusal, Standing, Verdict,
    token::Token,
};
use jobstore::{Delivery, JobStoreError, Judged};
use std::{
    collections::BTreeSet,
    sync::{Arc, atomic::Ordering},
    time::{Duration, Instant},
};
use tokio::{
    sync::{mpsc, oneshot},
    task,
};

type Answer = Result<Judged, JobStoreError>;

struct Waiting {
    delivery: Delivery,
    answer: oneshot::Sender<Answer>,
}

/// The address of whoever records completions; it ends with this.
pub(super) struct Completions(mpsc::UnboundedSender<Waiting>);

impl Completions {
    pub fn start(shared: Arc<Shared>) -> Self {
        let (sender, mut receiver) = mpsc::unbounded_channel();
        task::spawn(async move {
            let mut batch = Vec::new();
            let most = limits::DATABASE_BATCH_MAX;
            while receiver.recv_many(&mut batch, most).await > 0 {
                shared.record(std::mem::take(&mut batch)).await;
            }
        });
        Self(sender)
    }

    pub async fn submit(&self, delivery: Delivery) -> Answer {
        let (answer, answered) = oneshot::channel();
        // Nobody records any more when the runtime is about to end.
        let waiting = Waiting { delivery, answer };
        self.0
            .send(waiting)
            .map_err(|_| JobStoreError::Interrupted)?;
        answered.await.map_err(|_| JobStoreError::Interrupted)?
    }
}

/// What a batch came to: an answer for each, or the word that it has to be done alone.
struct Recorded {
    answers: Vec<Option<Result<Judged, Refusal>>>,
    changes: Changes,
}

impl Shared {
    pub async fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Digest,
    ) -> Result<Standing, JobStoreError> {
        let number = i64::from(material);
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let rows = query(&transaction, include_str!("sql/job.sql"), &[&number]).await?;
            let mut queue = Queue::of_some(self.policy, Mode::Running);
            if let Some(row) = rows.first() {
                queue.add_job(material, record(row.get(0))?, None);
            }
            Ok(queue.standing(material, token, fingerprint)?)
        })
    }

    /// Records a batch and answers everybody.
    async fn record(&self, batch: Vec<Waiting>) {
        let deliveries: Vec<&Delivery> = batch.iter().map(|waiting| &waiting.delivery).collect();
        let began = Instant::now();
        let recorded = self.record_all(&deliveries, LockMode::Shared).await;
        self.metrics.note_commit(began.elapsed(), batch.len());
        let mut recorded = match recorded {
            Ok(recorded) => recorded.answers,
            Err(error) => {
                let why = error.to_string();
                for waiting in batch {
                    // Whoever asked may have gone.
                    let _ = waiting
                        .answer
                        .send(Err(JobStoreError::Unavailable(why.clone())));
                }
                return;
            }
        };
        for (waiting, answer) in batch.into_iter().zip(recorded.drain(..)) {
            let answer = match answer {
                Some(answer) => answer.map_err(JobStoreError::from),
                None => self.record_alone(&waiting.delivery).await,
            };
            let _ = waiting.answer.send(answer);
        }
    }

    async fn record_alone(&self, delivery: &Delivery) -> Answer {
        let mut recorded = self.record_all(&[delivery], LockMode::Exclusive).await?;
        match recorded.answers.pop().flatten() {
            Some(answer) => Ok(answer?),
            None => Err(JobStoreError::Interrupted),
        }
    }

    async fn record_all(
        &self,
        deliveries: &[&Delivery],
        lock_mode: LockMode,
    ) -> Result<Recorded, JobStoreError> {
        let recorded = attempt!(self.record_once(deliveries, lock_mode).await)?;
        self.after(&recorded.changes);
        Ok(recorded)
    }

    async fn record_once(
        &self,
        deliveries: &[&Delivery],
        lock_mode: LockMode,
    ) -> Result<Recorded, Fault> {
        let mut connection = self.database.connection().await?;
        let transaction = connection.transaction().await?;
        let mut locked = LockedJobs::begin(&transaction, lock_mode, self.policy).await?;
        let materials = deliveries
            .iter()
            .map(|delivery| delivery.completion.material);
        let materials: BTreeSet<i64> = materials.map(i64::from).collect();
        let materials: Vec<i64> = materials.into_iter().collect();
        locked.lock_jobs(&transaction, &materials).await?;
        let mut alone: BTreeSet<u32> = BTreeSet::new();
        if lock_mode == LockMode::Shared {
            alone = needs_exclusive(&transaction, &locked, deliveries).await?;
        } else {
            widen(&transaction, &mut locked, deliveries).await?;
        }

        let mut recorded = Recorded {
            answers: Vec::new(),
            changes: Changes::default(),
        };
        let mut completions: Vec<Completion> = Vec::new();
        for delivery in deliveries {
            let Delivery {
                token,
                completion,
                check,
            } = delivery;
            let material = completion.material;
            if alone.contains(&material) {
                recorded.answers.push(None);
                continue;
            }
            let holder = locked.queue.holder(material).cloned();
            let fingerprint = completion.fingerprint();
            let judged = locked
                .queue
                .complete(material, *token, fingerprint, *check, locked.now);
            let judged = judged.map(|(verdict, changes)| {
                recorded.changes.extend(changes.clone());
                if let (Verdict::Recorded | Verdict::Overturned(_), Some(holder)) =
                    (&verdict, &holder)
                {
                    completions.push(Completion {
                        worker: holder.name.clone(),
                        ..completion.clone()
                    });
                }
                Judged {
                    verdict,
                    holder,
                    changes,
                }
            });
            recorded.answers.push(Some(judged));
        }
        if !recorded.changes.is_empty() {
            self.publish(&completions).await?;
            let completions: Vec<&Completion> = completions.iter().collect();
            locked
                .write(&transaction, &recorded.changes, &completions)
                .await?;
        }
        // Where nothing changed nothing was written, and somebody else's commit is durable before
        // its rows are seen.
        transaction.commit().await?;
        let bytes = completions.iter().map(Completion::bytes).sum();
        self.context
            .bytes_received
            .fetch_add(bytes, Ordering::Relaxed);
        Ok(recorded)
    }

    /// Gives the images of completions their names, durably. A transaction that fails after this
    /// leaves images that nothing names.
    async fn publish(&self, completions: &[Completion]) -> Result<(), Fault> {
        let images: Vec<StagedFile> = {
            let mut staging = self.context.staging();
            let images = completions.iter();
            images
                .flat_map(|completion| staging.begin_publishing(completion))
                .collect()
        };
        if images.is_empty() {
            return Ok(());
        }
        let context = Arc::clone(&self.context);
        let published = task::spawn_blocking(move || {
            let published = context.blobs.publish(images.iter());
            match published {
                Ok(()) => context.forget(&images),
                Err(_) => context.staging().not_published(&images),
            }
            published
        });
        let published = published.await.map_err(|_| Fault::Interrupted)?;
        published.map_err(Fault::File)
    }
}

/// The jobs whose completion may change more than they themselves.
async fn needs_exclusive(
    transaction: &deadpool_postgres::Transaction<'_>,
    locked: &LockedJobs,
    deliveries: &[&Delivery],
) -> Result<BTreeSet<u32>, Fault> {
    let materials = deliveries
        .iter()
        .map(|delivery| delivery.completion.material);
    let materials: BTreeSet<u32> = materials.collect();
    let jobs = materials.iter();
    let jobs = jobs.filter_map(|material| Some((*material, locked.queue.job(*material)?)));
    let jobs: Vec<(u32, &JobRecord)> = jobs.collect();
    let holders = jobs.iter().filter_map(|(_, job)| job.state.holder());
    let names: BTreeSet<&str> = holders.map(|holder| holder.name.as_str()).collect();
    let names: Vec<&str> = names.into_iter().collect();
    let failing = query(transaction, include_str!("sql/failing.sql"), &[&names]).await?;
    let failing: BTreeSet<&str> = failing.iter().map(|row| row.get(0)).collect();
    let alone = jobs.iter().filter(|(_, job)| {
        let holder = job.state.holder();
        let third = matches!(
            &job.state,
            JobState::Completed { check: Check::Disputed(dispute), .. } if dispute.holder.is_some()
        );
        third || holder.is_some_and(|holder| failing.contains(holder.name.as_str()))
    });
    Ok(alone.map(|(material, _)| *material).collect())
}

/// Adds what a completion may change besides its job: the histories of everybody who had a hand in
/// it, and where one of them may turn out to have lied, all that one holds and vouches for.
async fn widen(
    transaction: &deadpool_postgres::Transaction<'_>,
    locked: &mut LockedJobs,
    deliveries: &[&Delivery],
) -> Result<(), Fault> {
    let mut names: BTreeSet<String> = BTreeSet::new();
    let mut suspects: BTreeSet<String> = BTreeSet::new();
    for delivery in deliveries {
        let Some(job) = locked.queue.job(delivery.completion.material) else {
            continue;
        };
        names.extend(job.state.holder().map(|holder| holder.name.clone()));
        if let JobState::Completed {
            worker,
            check: Check::Disputed(dispute),
            ..
        } = &job.state
        {
            suspects.extend([worker.clone(), dispute.worker.clone()]);
        }
    }
    names.extend(suspects.iter().cloned());
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    locked.add_workers(transaction, &names).await?;
    let suspects: Vec<&str> = suspects.iter().map(String::as_str).collect();
    locked.add_all_of(transaction, &suspects, true).await
}

impl LockedJobs {
    /// Adds all jobs that workers of these names hold, and where `vouched` those that they vouch
    /// for or contradict. Only for who runs alone.
    pub async fn add_all_of(
        &mut self,
        transaction: &deadpool_postgres::Transaction<'_>,
        names: &[&str],
        vouched: bool,
    ) -> Result<(), Fault> {
        if names.is_empty() {
            return Ok(());
        }
        let statement = include_str!("sql/held_by_names.sql");
        let mut rows = query(transaction, statement, &[&names]).await?;
        if vouched {
            let statement = include_str!("sql/vouched.sql");
            rows.extend(query(transaction, statement, &[&names]).await?);
        }
        let mut materials: BTreeSet<i64> = BTreeSet::new();
        for row in &rows {
            if self.queue.job(number(row.get(0))?).is_none() {
                materials.insert(row.get(0));
            }
        }
        let materials: Vec<i64> = materials.into_iter().collect();
        self.lock_jobs(transaction, &materials).await
    }
}

impl Shared {
    /// Wakes those who wait for a lease when there may be one.
    pub(super) fn after(&self, changes: &Changes) {
        if changes.offer_work() {
            self.context.work.notify_waiters();
        }
    }

    /// How long a pause without a look for leases that ran out may be before nobody was there to
    /// renew them with.
    pub(super) fn gap_max(&self) -> Duration {
        let longest = limits::SWEEP_GAP_MAX;
        (self.policy.lease / 4).clamp(3 * limits::SWEEP_INTERVAL_MAX, longest)
    }
}
