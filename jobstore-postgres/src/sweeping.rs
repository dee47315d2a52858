//! Looking for leases that ran out: one coordinator at a time, and only while somebody looked all
//! along.
//!
//! Whoever looks notes when. Where the note is old no coordinator was there, or no database, and
//! nobody could renew: then all leases, and blocks over failures, get their full time again.

use super::{
    Shared,
    connecting::{execute, query},
    fault::{Fault, attempt},
    locked_jobs::{LockMode, LockedJobs, lock},
    operating::exclusively,
    rows::{ms, no_farm, time},
};
use deadpool_postgres::Transaction;
use jobqueue::{Changes, LostLease};
use jobstore::{Expired, JobStoreError};
use std::{collections::BTreeSet, sync::atomic::Ordering, time::Duration};

impl Shared {
    pub async fn expire(&self) -> Result<Expired, JobStoreError> {
        let mut all = Expired::default();
        while attempt!(self.sweep_once().await)? {
            let (changes, lost) = self.take_back().await?;
            let taken = lost.len() as i64;
            let counted = &self.context.leases_lost;
            counted.fetch_add(lost.len() as u64, Ordering::Relaxed);
            all.changes.extend(changes);
            all.lost.extend(lost);
            if taken < limits::DATABASE_PAGE_MAX {
                break;
            }
        }
        let overview = self.publish_overview().await?;
        let counts = overview.counts;
        // Other coordinators give work back as well, and nobody tells.
        let offered = counts.pending + counts.redundant + counts.disputed;
        // A block may have ended.
        let for_all = overview.finished || !all.changes.workers.is_empty();
        self.wake(if for_all {
            usize::MAX
        } else {
            offered as usize
        });
        Ok(all)
    }

    /// Notes that somebody looked; whether something ran out that is ours to take back.
    async fn sweep_once(&self) -> Result<bool, Fault> {
        let mut connection = self.database.connection().await?;
        let transaction = connection.transaction().await?;
        let leads = query(&transaction, include_str!("sql/lead.sql"), &[]).await?;
        if !leads.first().is_some_and(|row| row.get(0)) {
            return Ok(false);
        }
        let rows = query(&transaction, include_str!("sql/sweep.sql"), &[]).await?;
        let row = rows.first().ok_or_else(no_farm)?;
        let (before, now) = (time(row.get(0)), time(row.get(1)));
        let gap = now.saturating_sub(before) > self.gap_max();
        if gap {
            self.give_full_time(&transaction, now).await?;
        }
        execute(&transaction, include_str!("sql/swept.sql"), &[&ms(now)]).await?;
        let after = ms(self.presence.forgotten_after);
        execute(
            &transaction,
            include_str!("sql/forget_absent.sql"),
            &[&after],
        )
        .await?;
        let over: bool = row.get(2);
        transaction.commit().await?;
        Ok(over && !gap)
    }

    async fn give_full_time(
        &self,
        transaction: &Transaction<'_>,
        now: Duration,
    ) -> Result<(), Fault> {
        lock(transaction, LockMode::Exclusive).await?;
        let expires = ms(now + self.policy.lease.min(self.policy.deadline));
        let statement = include_str!("sql/prolong_leases.sql");
        let leases = execute(transaction, statement, &[&ms(now), &expires]).await?;
        let ends = ms(now + self.policy.block);
        execute(
            transaction,
            include_str!("sql/prolong_blocks.sql"),
            &[&ends],
        )
        .await?;
        if leases > 0 {
            tracing::info!(
                leases,
                "nobody looked after the leases for a while: they get their full time again"
            );
        }
        Ok(())
    }

    async fn take_back(&self) -> Result<(Changes, Vec<LostLease>), JobStoreError> {
        exclusively!(self, |transaction, locked| {
            let now = ms(locked.now);
            let statement = include_str!("sql/expired.sql");
            let most = limits::DATABASE_PAGE_MAX;
            let over = query(transaction, statement, &[&now, &most]).await?;
            let materials: BTreeSet<i64> = over.iter().map(|row| row.get(0)).collect();
            let materials: Vec<i64> = materials.into_iter().collect();
            locked.lock_jobs(transaction, &materials).await?;
            let statement = include_str!("sql/blocks_ended.sql");
            let ended = query(transaction, statement, &[&now]).await?;
            let mut names: BTreeSet<&str> = over.iter().map(|row| row.get(1)).collect();
            names.extend(ended.iter().map(|row| row.get::<_, &str>(0)));
            let names: Vec<&str> = names.into_iter().collect();
            locked.add_workers(transaction, &names).await?;
            let (changes, lost) = locked.queue.expire(locked.now);
            ((changes.clone(), lost), changes)
        })
    }
}
