//! What changes many jobs, or a worker's history: each alone.

use super::{
    Shared,
    connecting::{execute, query},
    fault::Fault,
    locked_jobs::{LockMode, LockedJobs, number, stage_name},
};
use jobqueue::{
    BlockCause, Changes, Mode, Selection, Stage, WorkerChange,
    token::{Token, WorkerId},
};
use jobstore::{Failed, JobStoreError, JobsOrder};
use std::sync::atomic::Ordering;
use tokio_postgres::types::ToSql;

/// Runs a transition alone: the body adds the jobs that it needs to the part, makes the transition,
/// and gives an answer and what changed.
macro_rules! exclusively {
    ($shared:expr, |$transaction:ident, $locked:ident| $body:expr) => {{
        let outcome = $crate::fault::attempt!({
            let mut connection = $shared.database.connection().await?;
            let transaction = connection.transaction().await?;
            let mut locked =
                LockedJobs::begin(&transaction, LockMode::Exclusive, $shared.policy).await?;
            let (outcome, changes) = {
                let $transaction = &transaction;
                let $locked = &mut locked;
                $body
            };
            locked.write(&transaction, &changes, &[]).await?;
            transaction.commit().await?;
            Ok((outcome, changes))
        });
        outcome.map(|(outcome, changes)| {
            $shared.after(&changes);
            outcome
        })
    }};
}
pub(super) use exclusively;

impl Shared {
    pub async fn fail(
        &self,
        material: u32,
        token: Token,
        error: &str,
    ) -> Result<Failed, JobStoreError> {
        let failed = exclusively!(self, |transaction, locked| {
            locked
                .lock_jobs(transaction, &[i64::from(material)])
                .await?;
            let holder = locked.queue.holder(material);
            let worker = holder.map(|holder| holder.name.clone()).unwrap_or_default();
            locked.add_workers(transaction, &[&worker]).await?;
            locked.add_all_of(transaction, &[&worker], false).await?;
            let changes = locked.queue.fail(material, token, error, locked.now)?;
            let failed = Failed {
                worker,
                changes: changes.clone(),
            };
            (failed, changes)
        });
        let failed = failed?;
        self.context.failures.fetch_add(1, Ordering::Relaxed);
        self.publish_overview().await?;
        Ok(failed)
    }

    pub async fn release(&self, worker: WorkerId) -> Result<Changes, JobStoreError> {
        let id = worker.to_message();
        let id = &id;
        exclusively!(self, |transaction, locked| {
            let statement = include_str!("sql/held_by_worker.sql");
            let held = query(transaction, statement, &[id]).await?;
            let mut held: Vec<i64> = held.iter().map(|row| row.get(0)).collect();
            held.sort_unstable();
            locked.lock_jobs(transaction, &held).await?;
            let changes = locked.queue.release(worker, locked.now);
            execute(transaction, include_str!("sql/leave.sql"), &[id]).await?;
            (changes.clone(), changes)
        })
    }

    pub async fn release_all(&self) -> Result<Changes, JobStoreError> {
        exclusively!(self, |transaction, locked| {
            let held = query(transaction, include_str!("sql/held.sql"), &[]).await?;
            let held: Vec<i64> = held.iter().map(|row| row.get(0)).collect();
            locked.lock_jobs(transaction, &held).await?;
            let changes = locked.queue.release_all(locked.now);
            (changes.clone(), changes)
        })
    }

    /// Goes through the jobs page by page, each in a transaction of its own.
    pub async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Changes, JobStoreError> {
        let stages: &[Stage] = match order {
            JobsOrder::Retry => &[Stage::Quarantined, Stage::Cancelled],
            JobsOrder::Cancel => &[Stage::Pending, Stage::Leased, Stage::Quarantined],
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
            let page = exclusively!(self, |transaction, locked| {
                let most = limits::DATABASE_PAGE_MAX;
                let statement = include_str!("sql/selected.sql");
                let parameters: &[&(dyn ToSql + Sync)] = &[&from, stages, firsts, lasts, &most];
                let rows = query(transaction, statement, parameters).await?;
                let materials: Vec<i64> = rows.iter().map(|row| row.get(0)).collect();
                locked.lock_jobs(transaction, &materials).await?;
                let chosen = materials.iter().map(|material| number(*material));
                let chosen = chosen.collect::<Result<Vec<u32>, Fault>>()?;
                let now = locked.now;
                let changes = match order {
                    JobsOrder::Retry => locked.queue.retry(chosen, now),
                    JobsOrder::Cancel => locked.queue.cancel(chosen, now),
                    JobsOrder::Prioritize(priority) => {
                        locked.queue.prioritize(chosen, priority, now)
                    }
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
        self.publish_overview().await?;
        Ok(all)
    }

    /// Draws what is to be audited, where no job waits or is under way.
    pub async fn draw_audits(&self, seed: u64) -> Result<Changes, JobStoreError> {
        let seed = seed as i64;
        let count = i64::from(self.policy.audits);
        exclusively!(self, |transaction, locked| {
            let due = query(transaction, include_str!("sql/audits_due.sql"), &[]).await?;
            let due: Vec<String> = due.iter().map(|row| row.get(0)).collect();
            let names: Vec<&str> = due.iter().map(String::as_str).collect();
            locked.add_workers(transaction, &names).await?;
            let mut changes = Changes::default();
            for by in &due {
                let statement = include_str!("sql/drawn.sql");
                let drawn = query(transaction, statement, &[by, &seed, &count]).await?;
                let drawn: Vec<i64> = drawn.iter().map(|row| row.get(0)).collect();
                locked.lock_jobs(transaction, &drawn).await?;
                let drawn = drawn.iter().map(|material| number(*material));
                let drawn = drawn.collect::<Result<Vec<u32>, Fault>>()?;
                changes.extend(locked.queue.audit(by, &drawn, locked.now));
            }
            (changes.clone(), changes)
        })
    }

    pub async fn set_mode(&self, mode: Mode) -> Result<Changes, JobStoreError> {
        let changes = exclusively!(self, |_transaction, locked| {
            let changes = locked.queue.set_mode(mode);
            (changes.clone(), changes)
        });
        let changes = changes?;
        self.publish_overview().await?;
        Ok(changes)
    }

    pub async fn block(
        &self,
        name: &str,
        cause: BlockCause,
        reason: String,
    ) -> Result<Changes, JobStoreError> {
        let reason = &reason;
        let changes = exclusively!(self, |transaction, locked| {
            locked.add_workers(transaction, &[name]).await?;
            let vouched = cause == BlockCause::Disagreement;
            locked.add_all_of(transaction, &[name], vouched).await?;
            let changes = locked.queue.block(name, cause, reason.clone(), locked.now);
            (changes.clone(), changes)
        });
        let changes = changes?;
        self.publish_overview().await?;
        Ok(changes)
    }

    pub async fn unblock(&self, name: &str) -> Result<Option<WorkerChange>, JobStoreError> {
        let change = exclusively!(self, |transaction, locked| {
            locked.add_workers(transaction, &[name]).await?;
            let change = locked.queue.unblock(name);
            let changes = Changes {
                workers: change.iter().cloned().collect(),
                ..Changes::default()
            };
            (change, changes)
        });
        let change = change?;
        self.publish_overview().await?;
        Ok(change)
    }
}
