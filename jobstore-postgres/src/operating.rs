//! What changes many jobs, or a worker's history: each alone.

use super::{
    Shared,
    connecting::{execute, query},
    fault::Fault,
    part::{Part, Way, number, stage_name},
};
use jobqueue::{
    BarCause, Changes, Mode, Selection, Stage, WorkerChange,
    token::{Token, WorkerId},
};
use jobstore::{BoardError, Failed, JobsOrder};
use std::sync::atomic::Ordering;
use tokio_postgres::types::ToSql;

/// Runs a transition alone: the body adds the jobs that it needs to the part, makes the transition,
/// and gives an answer and what changed.
macro_rules! alone {
    ($shared:expr, |$transaction:ident, $part:ident| $body:expr) => {{
        let outcome = $crate::fault::attempt!({
            let mut connection = $shared.database.connection().await?;
            let transaction = connection.transaction().await?;
            let mut part = Part::begin(&transaction, Way::Alone, $shared.policy).await?;
            let (outcome, changes) = {
                let $transaction = &transaction;
                let $part = &mut part;
                $body
            };
            part.write(&transaction, &changes, &[]).await?;
            transaction.commit().await?;
            Ok((outcome, changes))
        });
        outcome.map(|(outcome, changes)| {
            $shared.after(&changes);
            outcome
        })
    }};
}
pub(super) use alone;

impl Shared {
    pub async fn fail(
        &self,
        material: u32,
        token: Token,
        error: &str,
    ) -> Result<Failed, BoardError> {
        let failed = alone!(self, |transaction, part| {
            part.lock_jobs(transaction, &[i64::from(material)]).await?;
            let holder = part.queue.holder(material);
            let worker = holder.map(|holder| holder.name.clone()).unwrap_or_default();
            part.add_workers(transaction, &[&worker]).await?;
            part.add_all_of(transaction, &[&worker], false).await?;
            let changes = part.queue.fail(material, token, error, part.now)?;
            let failed = Failed {
                worker,
                changes: changes.clone(),
            };
            (failed, changes)
        });
        let failed = failed?;
        self.surroundings.failures.fetch_add(1, Ordering::Relaxed);
        self.look().await?;
        Ok(failed)
    }

    pub async fn release(&self, worker: WorkerId) -> Result<Changes, BoardError> {
        let id = worker.to_message();
        let id = &id;
        alone!(self, |transaction, part| {
            let statement = include_str!("sql/held_by_worker.sql");
            let held = query(transaction, statement, &[id]).await?;
            let mut held: Vec<i64> = held.iter().map(|row| row.get(0)).collect();
            held.sort_unstable();
            part.lock_jobs(transaction, &held).await?;
            let changes = part.queue.release(worker, part.now);
            execute(transaction, include_str!("sql/leave.sql"), &[id]).await?;
            (changes.clone(), changes)
        })
    }

    pub async fn release_all(&self) -> Result<Changes, BoardError> {
        alone!(self, |transaction, part| {
            let held = query(transaction, include_str!("sql/held.sql"), &[]).await?;
            let held: Vec<i64> = held.iter().map(|row| row.get(0)).collect();
            part.lock_jobs(transaction, &held).await?;
            let changes = part.queue.release_all(part.now);
            (changes.clone(), changes)
        })
    }

    /// Goes through the jobs page by page, each in a transaction of its own.
    pub async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Changes, BoardError> {
        let stages: &[Stage] = match order {
            JobsOrder::Retry => &[Stage::SetAside, Stage::Cancelled],
            JobsOrder::Cancel => &[Stage::Pending, Stage::Leased, Stage::SetAside],
            JobsOrder::Prioritize(_) => &[Stage::Pending],
        };
        let stages = stages.iter().filter(|stage| selection.has_stage(**stage));
        let stages: Vec<&str> = stages.map(|stage| stage_name(*stage)).collect();
        let ranges = selection.ranges();
        let firsts: Vec<i64> = ranges.iter().map(|(first, _)| i64::from(*first)).collect();
        let lasts: Vec<i64> = ranges.iter().map(|(_, last)| i64::from(*last)).collect();
        let (stages, firsts, lasts) = (&stages, &firsts, &lasts);
        let mut all = Changes::default();
        let mut from = 0_i64;
        loop {
            let page = alone!(self, |transaction, part| {
                let most = limits::DATABASE_PAGE_MAX;
                let statement = include_str!("sql/selected.sql");
                let parameters: &[&(dyn ToSql + Sync)] = &[&from, stages, firsts, lasts, &most];
                let rows = query(transaction, statement, parameters).await?;
                let materials: Vec<i64> = rows.iter().map(|row| row.get(0)).collect();
                part.lock_jobs(transaction, &materials).await?;
                let chosen = materials.iter().map(|material| number(*material));
                let chosen = chosen.collect::<Result<Vec<u32>, Fault>>()?;
                let now = part.now;
                let changes = match order {
                    JobsOrder::Retry => part.queue.retry(chosen, now),
                    JobsOrder::Cancel => part.queue.cancel(chosen, now),
                    JobsOrder::Prioritize(priority) => part.queue.prioritize(chosen, priority, now),
                };
                let full = materials.len() as i64 == most;
                let next = materials.last().filter(|_| full).map(|last| last + 1);
                ((changes.clone(), next), changes)
            });
            let (changes, next) = page?;
            all.extend(changes);
            match next {
                Some(next) => from = next,
                None => break,
            }
        }
        self.look().await?;
        Ok(all)
    }

    pub async fn set_mode(&self, mode: Mode) -> Result<Changes, BoardError> {
        let changes = alone!(self, |_transaction, part| {
            let changes = part.queue.set_mode(mode);
            (changes.clone(), changes)
        });
        let changes = changes?;
        self.look().await?;
        Ok(changes)
    }

    pub async fn bar(
        &self,
        name: &str,
        cause: BarCause,
        reason: String,
    ) -> Result<Changes, BoardError> {
        let reason = &reason;
        let changes = alone!(self, |transaction, part| {
            part.add_workers(transaction, &[name]).await?;
            let vouched = cause == BarCause::Disagreement;
            part.add_all_of(transaction, &[name], vouched).await?;
            let changes = part.queue.bar(name, cause, reason.clone(), part.now);
            (changes.clone(), changes)
        });
        let changes = changes?;
        self.look().await?;
        Ok(changes)
    }

    pub async fn unbar(&self, name: &str) -> Result<Option<WorkerChange>, BoardError> {
        let change = alone!(self, |transaction, part| {
            part.add_workers(transaction, &[name]).await?;
            let change = part.queue.unbar(name);
            let changes = Changes {
                workers: change.iter().cloned().collect(),
                ..Changes::default()
            };
            (change, changes)
        });
        let change = change?;
        self.look().await?;
        Ok(change)
    }
}
