//! Claims, renewals and completions: those of all who wait, in one short transaction.
//!
//! A task takes whatever waits when the transaction before is done, so statements, locks and
//! commits do not grow with the number of workers. Claims have a task of their own and everything
//! else has three: one connection is one process of the server, which leaves half of two cores idle.
//! An error belongs to its item: where a transaction fails over what it was asked, everybody is
//! asked for alone.
//!
//! What may touch more than its own job, a third opinion or the end of a row of failures, is done
//! by itself, under the exclusive lock.

mod claims;
mod completions;
mod renewals;
mod requests;

use super::{
    Shared,
    connecting::{prepare, query},
    fault::{Fault, attempt},
    locked_jobs::{LockMode, LockedJobs, lock, lock_rows},
    rows::{mode, no_farm, number, record, time},
};
use claims::Claim;
pub(super) use claims::is_finished;
use completions::Completing;
use deadpool_postgres::Transaction;
use futures_util::{FutureExt, try_join};
use jobqueue::{
    Completion, Fingerprint, Mode, Queue, Standing,
    token::{Token, WorkerId},
};
use jobstore::{Decision, Delivery, JobStoreError, Leased, Renewal};
use requests::{Answers, Batch, ClaimsWaiting, OthersWaiting, Questions};
use std::{
    collections::BTreeMap,
    panic::AssertUnwindSafe,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    sync::{Mutex, mpsc, oneshot, watch},
    task,
};

/// What is under way at one time.
const HOT: [&str; 7] = [
    include_str!("sql/lock_shared.sql"),
    include_str!("sql/counts.sql"),
    include_str!("sql/jobs_locked.sql"),
    include_str!("sql/leases_locked.sql"),
    include_str!("sql/failing.sql"),
    include_str!("sql/jobs.sql"),
    include_str!("sql/askers.sql"),
];

/// Tasks that record what workers do: while one waits for its commit to be durable, another writes.
const RECORDERS: usize = 3;

/// Where a completion would stand.
pub(super) struct StandingOf {
    material: u32,
    token: Token,
    fingerprint: Fingerprint,
}

/// A question, and who waits for the answer.
struct Asked<Question, Answer> {
    question: Question,
    answer: oneshot::Sender<Result<Answer, JobStoreError>>,
}

/// What can be asked besides claims.
enum Request {
    Standing(Asked<StandingOf, Standing>),
    Renew(Asked<Vec<Renewal>, Vec<bool>>),
    Complete(Asked<Delivery, Decision>),
}

/// The addresses of the tasks; they end with this.
pub(super) struct Turns {
    claims: mpsc::UnboundedSender<Asked<Claim, Leased>>,
    others: mpsc::UnboundedSender<Request>,
}

impl Turns {
    /// Starts the tasks. Where one panics `failure` says so.
    pub fn start(shared: Arc<Shared>, failure: watch::Sender<Option<String>>) -> Self {
        let (claims, claims_waiting) = mpsc::unbounded_channel();
        let (others, others_waiting) = mpsc::unbounded_channel();
        let claimed = claim_all(Arc::clone(&shared), ClaimsWaiting::new(claims_waiting));
        spawn(claimed, "claims jobs", failure.clone());
        let waiting = Arc::new(Mutex::new(OthersWaiting::new(others_waiting)));
        for _ in 0..RECORDERS {
            let recorded = record_all(Arc::clone(&shared), Arc::clone(&waiting));
            spawn(recorded, "records what workers do", failure.clone());
        }
        Self { claims, others }
    }

    pub async fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Fingerprint,
    ) -> Result<Standing, JobStoreError> {
        let question = StandingOf {
            material,
            token,
            fingerprint,
        };
        ask(&self.others, question, Request::Standing).await
    }

    pub async fn claim(&self, worker: WorkerId, tokens: &[Token]) -> Result<Leased, JobStoreError> {
        let tokens = tokens.to_vec();
        ask(&self.claims, Claim { worker, tokens }, |asked| asked).await
    }

    pub async fn renew(&self, renewals: &[Renewal]) -> Result<Vec<bool>, JobStoreError> {
        ask(&self.others, renewals.to_vec(), Request::Renew).await
    }

    pub async fn complete(&self, delivery: Delivery) -> Result<Decision, JobStoreError> {
        ask(&self.others, delivery, Request::Complete).await
    }
}

async fn ask<Question, Answer, Sent>(
    address: &mpsc::UnboundedSender<Sent>,
    question: Question,
    request: impl FnOnce(Asked<Question, Answer>) -> Sent,
) -> Result<Answer, JobStoreError> {
    let (answer, answered) = oneshot::channel();
    // Nobody records any more when the runtime is about to end.
    address
        .send(request(Asked { question, answer }))
        .map_err(|_| JobStoreError::Interrupted)?;
    answered.await.map_err(|_| JobStoreError::Interrupted)?
}

fn spawn(
    task: impl Future<Output = ()> + Send + 'static,
    does: &'static str,
    failure: watch::Sender<Option<String>>,
) {
    task::spawn(async move {
        if AssertUnwindSafe(task).catch_unwind().await.is_err() {
            failure.send_replace(Some(format!("the task that {does} panicked")));
        }
    });
}

async fn claim_all(shared: Arc<Shared>, mut waiting: ClaimsWaiting) {
    while let Some(batch) = waiting.next(&shared.offered).await {
        let found_work = shared.turn(batch).await;
        waiting.pause(found_work, shared.presence.idle_pause);
    }
}

async fn record_all(shared: Arc<Shared>, waiting: Arc<Mutex<OthersWaiting>>) {
    loop {
        let batch = waiting.lock().await.next().await;
        let Some(batch) = batch else { return };
        shared.turn(batch).await;
    }
}

impl Shared {
    /// Answers everybody. False when somebody asked for work and nobody got any.
    async fn turn(&self, batch: Batch) -> bool {
        let began = Instant::now();
        let count = batch.len();
        let answered = self.answer(&batch.questions()).await;
        self.metrics.note_commit(began.elapsed(), count);
        match answered {
            Ok(answers) => {
                let found_work = answers.found_work();
                for asked in batch.tell(answers) {
                    let recorded = self.record_alone(&asked.question).await;
                    // Whoever asked may have gone.
                    let _ = asked.answer.send(recorded);
                }
                found_work
            }
            Err(JobStoreError::Ledger(error)) if count > 1 => {
                tracing::error!(%error, "a transaction failed: what it was asked is done one by one");
                let mut found_work = false;
                for single in batch.split() {
                    found_work |= Box::pin(self.turn(single)).await;
                }
                found_work
            }
            Err(error) => {
                batch.refuse(error);
                true
            }
        }
    }

    async fn answer(&self, questions: &Questions<'_>) -> Result<Answers, JobStoreError> {
        let mut answer_lost = false;
        attempt!({
            let asked_again = std::mem::replace(&mut answer_lost, true);
            self.answer_once(questions, asked_again).await
        })
    }

    /// One transaction. `asked_again` where the one before may have committed.
    async fn answer_once(
        &self,
        questions: &Questions<'_>,
        asked_again: bool,
    ) -> Result<Answers, Fault> {
        let mut connection = self.database.connection().await?;
        let transaction = connection.transaction().await?;
        prepare(&transaction, &HOT).await?;
        let (materials, renewed) = (questions.completed(), questions.renewed());
        let (_, counts, rows, failing, standings, askers) = try_join!(
            lock(&transaction, LockMode::Shared),
            Counts::read(&transaction),
            lock_rows(&transaction, &materials, &renewed),
            completions::failing(&transaction, &materials, &self.policy),
            self.standings(&transaction, &questions.standings),
            claims::askers(&transaction, &questions.claims),
        )?;
        let mut locked = LockedJobs::new(self.policy, counts.mode, counts.now);
        let leases = locked.add_locked(rows)?;

        let renewals = renewals::renew(&transaction, &locked, leases, &questions.renewals).await?;
        let completing = Completing::beside(&locked, &failing, &questions.completions);
        let mut completed = completing.complete(&mut locked, &questions.completions, &self.context);
        let mut changes = std::mem::take(&mut completed.changes);
        let claims = claims::Claims {
            shared: self,
            transaction: &transaction,
            counts,
            asked_again,
        };
        let askers = claims.read(&askers);
        let mut leased = claims
            .claim(&mut locked, &questions.claims, askers, &mut changes)
            .await?;
        locked
            .write(&transaction, &changes, &completed.recorded())
            .await?;
        claims.note_finished(&mut leased).await?;
        // Where nothing changed nothing was written, and somebody else's commit is durable before
        // its rows are seen.
        transaction.commit().await?;
        self.note_recorded(&completed.recorded);
        self.after(&changes);
        Ok(Answers {
            standings,
            claims: leased,
            renewals,
            completions: completed.answers,
        })
    }

    /// Records what may touch more than its own job.
    async fn record_alone(&self, delivery: &Delivery) -> Result<Decision, JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let mut locked =
                LockedJobs::begin(&transaction, LockMode::Exclusive, self.policy).await?;
            let material = i64::from(delivery.completion.material);
            locked.lock_jobs(&transaction, &[material]).await?;
            let completing = Completing::alone(&transaction, &mut locked, delivery).await?;
            let mut completed = completing.complete(&mut locked, &[delivery], &self.context);
            locked
                .write(&transaction, &completed.changes, &completed.recorded())
                .await?;
            transaction.commit().await?;
            self.note_recorded(&completed.recorded);
            self.after(&completed.changes);
            Ok(completed.answers.pop().flatten())
        })?
        .unwrap_or(Err(JobStoreError::Interrupted))
    }

    fn note_recorded(&self, completions: &[Completion]) {
        for completion in completions {
            self.context.note_recorded(completion);
        }
    }

    async fn standings(
        &self,
        transaction: &Transaction<'_>,
        asked: &[&StandingOf],
    ) -> Result<Vec<Result<Standing, JobStoreError>>, Fault> {
        if asked.is_empty() {
            return Ok(Vec::new());
        }
        let materials: Vec<i64> = asked.iter().map(|asked| asked.material.into()).collect();
        let rows = query(transaction, include_str!("sql/jobs.sql"), &[&materials]).await?;
        let mut records = BTreeMap::new();
        for row in rows {
            records.insert(number(row.get(0))?, record(row.get(1)));
        }
        let standing = |asked: &&StandingOf| {
            let mut queue = Queue::of_some(self.policy, Mode::Running);
            match records.get(&asked.material) {
                Some(Ok(record)) => queue.add_job(asked.material, record.clone(), None),
                Some(Err(fault)) => return Err(fault.of_material(asked.material)),
                None => {}
            }
            Ok(queue.standing(asked.material, asked.token, asked.fingerprint)?)
        };
        Ok(asked.iter().map(standing).collect())
    }
}

/// How the farm stands as a transaction begins.
#[derive(Clone, Copy)]
struct Counts {
    mode: Mode,
    now: Duration,
    pending: i64,
    /// Jobs that another rendering is or will be wanted of.
    redundant: i64,
}

impl Counts {
    async fn read(transaction: &Transaction<'_>) -> Result<Self, Fault> {
        let rows = query(transaction, include_str!("sql/counts.sql"), &[]).await?;
        let row = rows.first().ok_or_else(no_farm)?;
        Ok(Self {
            mode: mode(row.get(0))?,
            now: time(row.get(1)),
            pending: row.get(2),
            redundant: row.get(3),
        })
    }
}
