//! What changes many jobs, or a worker's history: each alone.

use super::{
    Shared,
    connecting::{execute, query},
    fault::Fault,
    locked_jobs::{LockMode, LockedJobs},
    rows::number,
    window::{Window, is_apart, last_material, stages},
};
use deadpool_postgres::Transaction;
use jobqueue::{
    BlockCause, Changes, Mode, Selection, WorkerChange,
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

    /// Goes through the jobs window by window, each in a transaction of its own: others have their
    /// turn in between.
    pub async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Changes, JobStoreError> {
        let mut all = Changes::default();
        let Some(selection) = &selection.only(order.stages()) else {
            return Ok(all);
        };
        let mut from = Some(0);
        while let Some(start) = from {
            let page = exclusively!(self, |transaction, locked| {
                let window = next_window(transaction, selection, start).await?;
                let (next, materials) = match window {
                    Some(window) => lock_window(transaction, locked, window).await?,
                    None => (None, Vec::new()),
                };
                let now = locked.now;
                let changes = match order {
                    JobsOrder::Retry => locked.queue.retry(materials, now),
                    JobsOrder::Cancel => locked.queue.cancel(materials, now),
                    JobsOrder::Prioritize(priority) => {
                        locked.queue.prioritize(materials, priority, now)
                    }
                };
                ((changes.clone(), next), changes)
            });
            let (changes, next) = page?;
            all.extend(changes);
            from = next;
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
        self.wake(usize::MAX);
        self.publish_overview().await?;
        Ok(change)
    }
}

/// The first part of a selection from a material on in which jobs may be.
async fn next_window(
    transaction: &Transaction<'_>,
    selection: &Selection,
    mut from: u32,
) -> Result<Option<Window>, Fault> {
    if is_apart(selection) {
        let statement = include_str!("sql/page_apart.sql");
        let parameters: [&(dyn ToSql + Sync); 3] = [&stages(selection), &i64::from(from), &1_i64];
        let rows = query(transaction, statement, &parameters).await?;
        let Some(first) = rows.first() else {
            return Ok(None);
        };
        from = number(first.get(0))?;
    }
    let last = last_material(transaction).await?;
    Ok(last.and_then(|last| Window::of(selection, from, last)))
}

/// Locks the jobs of a window; returns where the next window begins, and the jobs.
async fn lock_window(
    transaction: &Transaction<'_>,
    locked: &mut LockedJobs,
    window: Window,
) -> Result<(Option<u32>, Vec<u32>), Fault> {
    let Window {
        firsts,
        lasts,
        stages,
        next,
    } = window;
    let statement = include_str!("sql/selected.sql");
    let rows = query(transaction, statement, &[&firsts, &lasts, &stages]).await?;
    let materials: Vec<i64> = rows.iter().map(|row| row.get(0)).collect();
    locked.lock_jobs(transaction, &materials).await?;
    let chosen = materials.iter().map(|material| number(*material));
    Ok((next, chosen.collect::<Result<_, Fault>>()?))
}
