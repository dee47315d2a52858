//! A part of the queue: read, locked, changed by the queue's own transitions, written.

use super::{
    connecting::{execute, query},
    fault::Fault,
    rows::{json, mode, ms, no_farm, number, record, text, time},
    writing::{end_leases, write_completions, write_images, write_jobs, write_leases, write_mode},
};
use deadpool_postgres::Transaction;
use futures_util::try_join;
use jobqueue::{
    BlockCause, Changes, Completion, JobRecord, JobState, Lease, Mode, Policy, Queue,
    RedundantRender, WorkerChange, WorkerRecord,
    identity::identity,
    token::{Token, WorkerId},
};
use jobstore::JobStoreError;
use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};
use tokio_postgres::Row;

/// Some jobs, locked, and the moment at which that was so.
pub(super) struct LockedJobs {
    pub queue: Queue,
    pub now: Duration,
    policy: Policy,
    before: BTreeMap<u32, JobRecord>,
    // Jobs whose rows make no sense, and why. They are not in the queue.
    unreadable: BTreeMap<u32, String>,
}

/// Rows that are locked.
pub(super) struct LockedRows {
    jobs: Vec<Row>,
    leases: BTreeMap<u32, HeldLease>,
}

/// A lease, and whose it is.
pub(super) struct HeldLease {
    pub token: Token,
    pub worker: WorkerId,
    pub name: String,
    pub lease: Lease,
}

/// Others of its kind run beside it, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LockMode {
    Shared,
    Exclusive,
}

impl LockedJobs {
    /// Takes the lock of all transactions and begins with no job.
    pub async fn begin(
        transaction: &Transaction<'_>,
        lock_mode: LockMode,
        policy: Policy,
    ) -> Result<Self, Fault> {
        lock(transaction, lock_mode).await?;
        let rows = query(transaction, include_str!("sql/farm.sql"), &[]).await?;
        let farm = rows.first().ok_or_else(no_farm)?;
        let mode = mode(farm.get(0))?;
        Ok(Self::new(policy, mode, time(farm.get(1))))
    }

    pub fn new(policy: Policy, mode: Mode, now: Duration) -> Self {
        Self {
            queue: Queue::of_some(policy, mode),
            now,
            policy,
            before: BTreeMap::new(),
            unreadable: BTreeMap::new(),
        }
    }

    pub fn policy(&self) -> Policy {
        self.policy
    }

    /// The materials of the jobs that are locked.
    pub fn known(&self) -> Vec<i64> {
        self.before.keys().copied().map(i64::from).collect()
    }

    /// That the row of a job made sense, where it is there.
    pub fn check(&self, material: u32) -> Result<(), JobStoreError> {
        match self.unreadable.get(&material) {
            Some(why) => Err(Fault::damaged(why).of_material(material)),
            None => Ok(()),
        }
    }

    /// Adds locked jobs that have no lease, those that can be read; returns the others.
    pub fn add(&mut self, rows: &[Row]) -> Result<Vec<u32>, Fault> {
        let mut unreadable = Vec::new();
        for row in rows {
            let material = number(row.get(0))?;
            if !self.add_job(material, record(row.get(1)), None) {
                unreadable.push(material);
            }
        }
        Ok(unreadable)
    }

    /// Adds a job, if it makes sense.
    fn add_job(
        &mut self,
        material: u32,
        record: Result<JobRecord, Fault>,
        lease: Option<Lease>,
    ) -> bool {
        let whole = record.and_then(|record| {
            if record.state.holder().is_some() == lease.is_some() {
                Ok(record)
            } else {
                Err(Fault::damaged(
                    "its record and its lease contradict each other",
                ))
            }
        });
        match whole {
            Ok(record) => {
                self.queue.add_job(material, record.clone(), lease);
                self.before.insert(material, record);
                true
            }
            Err(fault) => {
                let why = fault.of_material(material).to_string();
                tracing::error!(material, why, "a job is passed over");
                self.unreadable.insert(material, why);
                false
            }
        }
    }

    /// Locks jobs and their leases, in their order, and adds them. Those there are not, or that
    /// make no sense, are passed over.
    pub async fn lock_jobs(
        &mut self,
        transaction: &Transaction<'_>,
        materials: &[i64],
    ) -> Result<(), Fault> {
        let rows = lock_rows(transaction, materials, &[]).await?;
        self.add_locked(rows)?;
        Ok(())
    }

    /// Adds jobs that are locked with their leases; returns all leases.
    pub fn add_locked(&mut self, rows: LockedRows) -> Result<BTreeMap<u32, HeldLease>, Fault> {
        for row in &rows.jobs {
            let material = number(row.get(0))?;
            let lease = rows.leases.get(&material).map(|held| held.lease.clone());
            self.add_job(material, record(row.get(1)), lease);
        }
        Ok(rows.leases)
    }

    /// Tells the queue that whoever answers for the holder of a job is no newcomer and that its work
    /// is to be audited anyway. The rest of its history is not known here: what the queue does to the
    /// job must not change it.
    pub fn add_known_holder(&mut self, material: u32) {
        let Some(holder) = self.queue.holder(material) else {
            return;
        };
        let name = identity(&holder.name).to_owned();
        let record = WorkerRecord {
            probation: self.policy.probation,
            audit_due: self.policy.audits > 0,
            ..WorkerRecord::default()
        };
        let known = WorkerChange { name, record };
        self.queue.add_worker(known, self.now);
    }

    /// Adds the histories of workers and of whoever answers for them. Only for who runs alone.
    pub async fn add_workers(
        &mut self,
        transaction: &Transaction<'_>,
        names: &[&str],
    ) -> Result<(), Fault> {
        let statement = include_str!("sql/workers_of_names.sql");
        for row in query(transaction, statement, &[&names]).await? {
            let record = json(row.get(1), "worker")?;
            let block_ends: Option<i64> = row.get(2);
            let name = row.get(0);
            let block_ends = time(block_ends.unwrap_or_default());
            self.queue
                .add_worker(WorkerChange { name, record }, block_ends);
        }
        Ok(())
    }

    /// Adds all jobs that workers of these full names or identities hold, and where `vouched` those
    /// that these identities vouch for or contradict. Only for who runs alone.
    pub async fn add_all_of(
        &mut self,
        transaction: &Transaction<'_>,
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

    /// Writes what changed, and what was completed.
    pub async fn write(
        &self,
        transaction: &Transaction<'_>,
        changes: &Changes,
        completions: &[&Completion],
    ) -> Result<(), Fault> {
        if changes.is_empty() {
            return Ok(());
        }
        let jobs = changes.jobs.iter();
        let jobs: BTreeMap<u32, &JobRecord> = jobs
            .map(|change| (change.material, &change.record))
            .collect();
        // No two of them write the same rows, so that they may be under way together. The last is
        // what transactions of connections that share a shard wait for.
        try_join!(
            write_jobs(transaction, &jobs),
            self.write_leases(transaction, &jobs),
            self.write_workers(transaction, changes),
            write_mode(transaction, changes.mode),
            write_completions(transaction, completions),
            write_images(transaction, completions),
            self.tally(transaction, &jobs),
        )?;
        Ok(())
    }

    async fn write_leases(
        &self,
        transaction: &Transaction<'_>,
        jobs: &BTreeMap<u32, &JobRecord>,
    ) -> Result<(), Fault> {
        let mut ended = Vec::new();
        let mut held = Vec::new();
        for (material, record) in jobs {
            let number = i64::from(*material);
            match (record.state.holder(), self.queue.lease(*material)) {
                (Some(holder), Some(lease)) => held.push((number, holder, lease)),
                _ => {
                    let before = self.before.get(material);
                    if before.is_some_and(|before| before.state.holder().is_some()) {
                        ended.push(number);
                    }
                }
            }
        }
        try_join!(
            end_leases(transaction, &ended),
            write_leases(transaction, &held)
        )?;
        Ok(())
    }

    async fn write_workers(
        &self,
        transaction: &Transaction<'_>,
        changes: &Changes,
    ) -> Result<(), Fault> {
        let workers = changes.workers.iter();
        let workers: BTreeMap<&str, &WorkerRecord> = workers
            .map(|change| (change.name.as_str(), &change.record))
            .collect();
        let (forgotten, kept): (Vec<_>, Vec<_>) = workers
            .into_iter()
            .partition(|(_, record)| **record == WorkerRecord::default());
        let forgotten: Vec<&str> = forgotten.into_iter().map(|(name, _)| name).collect();
        if !forgotten.is_empty() {
            let statement = include_str!("sql/forget_workers.sql");
            execute(transaction, statement, &[&forgotten]).await?;
        }
        if kept.is_empty() {
            return Ok(());
        }
        let names: Vec<&str> = kept.iter().map(|(name, _)| *name).collect();
        let blocked: Vec<bool> = kept
            .iter()
            .map(|(_, record)| record.block.is_some())
            .collect();
        let failing = kept
            .iter()
            .map(|(_, record)| !record.failures_in_a_row.is_empty());
        let failing: Vec<bool> = failing.collect();
        let ends = kept.iter().map(|(name, record)| {
            let cause = record.block.as_ref().map(|block| block.cause);
            let ends = (cause == Some(BlockCause::Failures)).then(|| self.queue.block_end(name));
            ends.flatten().map(ms)
        });
        let ends: Vec<Option<i64>> = ends.collect();
        let audits: Vec<bool> = kept.iter().map(|(_, record)| record.audit_due).collect();
        let probation = kept.iter().map(|(_, record)| i64::from(record.probation));
        let probation: Vec<i64> = probation.collect();
        let records = kept.iter().map(|(_, record)| text(record));
        let records = records.collect::<Result<Vec<String>, Fault>>()?;
        execute(
            transaction,
            include_str!("sql/write_workers.sql"),
            &[
                &names,
                &blocked,
                &failing,
                &ends,
                &records,
                &(limits::WORKER_RECORDS_MAX as i64),
                &audits,
                &probation,
            ],
        )
        .await?;
        Ok(())
    }

    async fn tally(
        &self,
        transaction: &Transaction<'_>,
        jobs: &BTreeMap<u32, &JobRecord>,
    ) -> Result<(), Fault> {
        let mut tally = [0_i64; 7];
        for (material, record) in jobs {
            if let Some(before) = self.before.get(material) {
                count(&mut tally, before, -1);
                count(&mut tally, record, 1);
            }
        }
        if tally == [0; 7] {
            return Ok(());
        }
        let [
            pending,
            leased,
            completed,
            disputed,
            quarantined,
            cancelled,
            checks,
        ] = &tally;
        execute(
            transaction,
            include_str!("sql/tally.sql"),
            &[
                pending,
                leased,
                completed,
                disputed,
                quarantined,
                cancelled,
                checks,
            ],
        )
        .await?;
        Ok(())
    }
}

/// Takes the lock of all transactions.
pub(super) async fn lock(transaction: &Transaction<'_>, lock_mode: LockMode) -> Result<(), Fault> {
    let statement = match lock_mode {
        LockMode::Shared => include_str!("sql/lock_shared.sql"),
        LockMode::Exclusive => include_str!("sql/lock_exclusive.sql"),
    };
    query(transaction, statement, &[]).await?;
    Ok(())
}

/// Locks jobs and their leases, and leases of other jobs. All leases are locked in their order after
/// all jobs in theirs, so that no two transactions wait for each other.
pub(super) async fn lock_rows(
    transaction: &Transaction<'_>,
    materials: &[i64],
    of_others: &[i64],
) -> Result<LockedRows, Fault> {
    let leases: BTreeSet<i64> = materials.iter().chain(of_others).copied().collect();
    let leases: Vec<i64> = leases.into_iter().collect();
    let (jobs, leases) = try_join!(
        lock_jobs(transaction, materials),
        lock_leases(transaction, &leases)
    )?;
    Ok(LockedRows { jobs, leases })
}

async fn lock_jobs(transaction: &Transaction<'_>, materials: &[i64]) -> Result<Vec<Row>, Fault> {
    if materials.is_empty() {
        return Ok(Vec::new());
    }
    let statement = include_str!("sql/jobs_locked.sql");
    query(transaction, statement, &[&materials]).await
}

/// Locks leases, in their order. One whose row makes no sense is none.
async fn lock_leases(
    transaction: &Transaction<'_>,
    materials: &[i64],
) -> Result<BTreeMap<u32, HeldLease>, Fault> {
    if materials.is_empty() {
        return Ok(BTreeMap::new());
    }
    let statement = include_str!("sql/leases_locked.sql");
    let rows = query(transaction, statement, &[&materials]).await?;
    let lease = |row: &Row| {
        let lease = HeldLease {
            token: Token::from_message(row.get(1))?,
            worker: WorkerId::from_message(row.get(2))?,
            name: row.get(3),
            lease: Lease {
                claimed: time(row.get(4)),
                expires: time(row.get(5)),
                views_done: number(row.get(6)).ok()?,
                progressed: time(row.get(7)),
            },
        };
        Some((number(row.get(0)).ok()?, lease))
    };
    Ok(rows.iter().filter_map(lease).collect())
}

fn count(tally: &mut [i64; 7], job: &JobRecord, by: i64) {
    tally[job.state.stage() as usize] += by;
    if let JobState::Completed {
        redundant: RedundantRender::Due | RedundantRender::Leased(_),
        ..
    } = job.state
    {
        tally[6] += by;
    }
}
