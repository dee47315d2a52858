//! What commands write into a database beside coordinators at work: one command at a time, under a
//! lock of their own, and each change alone, as an operator's.

use super::{
    Amendment, Database, DatabaseError,
    connecting::query,
    fault::Fault,
    locked_jobs::{LockMode, LockedJobs},
    rows::{json, number},
};
use deadpool_postgres::{ClientWrapper, Object};
use jobqueue::{Changes, Completion, JobChange, JobRecord, JobState, Policy, RedundantRender};
use std::{collections::HashMap, time::Instant};
use tokio::time::sleep;

/// A session that holds the lock of commands that write.
pub struct MaintenanceSession {
    pub(super) client: ClientWrapper,
    database: Database,
}

impl MaintenanceSession {
    /// Takes the lock of commands that write; none where another one has it.
    pub async fn begin(database: &Database) -> Result<Option<Self>, DatabaseError> {
        let begun = async {
            // Out of the pool: the lock is this connection's, and ends with it.
            let client = Object::take(database.connection().await?);
            let started = Instant::now();
            loop {
                let statement = include_str!("sql/lock_maintenance.sql");
                let row = client.query_one(statement, &[]).await?;
                if row.get(0) {
                    let database = database.clone();
                    return Ok(Some(Self { client, database }));
                }
                // The session of a process that just ended can outlive it by a moment.
                if started.elapsed() > limits::LEDGER_LOCK_WAIT {
                    return Ok(None);
                }
                sleep(limits::DATABASE_LOCK_PAUSE).await;
            }
        };
        begun.await.map_err(|fault: Fault| database.away(fault))
    }

    pub(super) fn away(&self, fault: Fault) -> DatabaseError {
        self.database.away(fault)
    }

    /// Records completions, all or none; of each says whether it was recorded. Whoever calls has
    /// put their images under their names. A lease of such a job ends.
    pub async fn amend(
        &mut self,
        amendments: &[Amendment<'_>],
    ) -> Result<Vec<bool>, DatabaseError> {
        let amended = amend(&mut self.client, amendments).await;
        amended.map_err(|fault| self.away(fault))
    }

    /// Keeps every transaction of every coordinator waiting until [`MaintenanceSession::admit`],
    /// and counts the leases that there are.
    pub async fn exclude(&mut self) -> Result<u32, DatabaseError> {
        let excluded = async {
            let statement = include_str!("sql/exclude.sql");
            self.client.query_one(statement, &[]).await?;
            let statement = include_str!("sql/leases_counted.sql");
            number(self.client.query_one(statement, &[]).await?.get(0))
        };
        excluded.await.map_err(|fault| self.away(fault))
    }

    /// Lets the others go on.
    pub async fn admit(&mut self) -> Result<(), DatabaseError> {
        let statement = include_str!("sql/admit_others.sql");
        let admitted = self.client.query_one(statement, &[]).await;
        admitted
            .map(|_| ())
            .map_err(|error| self.away(error.into()))
    }
}

async fn amend(
    client: &mut ClientWrapper,
    amendments: &[Amendment<'_>],
) -> Result<Vec<bool>, Fault> {
    let materials = amendments.iter();
    let materials = materials.map(|amendment| i64::from(amendment.completion.material));
    let mut materials: Vec<i64> = materials.collect();
    materials.sort_unstable();
    let transaction = client.transaction().await?;
    let mut locked =
        LockedJobs::begin(&transaction, LockMode::Exclusive, Policy::default()).await?;
    locked.lock_jobs(&transaction, &materials).await?;
    let statement = include_str!("sql/completions_of.sql");
    let rows = query(&transaction, statement, &[&materials]).await?;
    let recorded = rows.iter().map(|row| {
        let completion: Completion = json(row.get(1), "completion")?;
        Ok((number(row.get(0))?, completion))
    });
    let recorded: HashMap<u32, Completion> = recorded.collect::<Result<_, Fault>>()?;
    let mut changes = Changes::default();
    let mut completions = Vec::new();
    let mut done = Vec::with_capacity(amendments.len());
    for Amendment { completion, before } in amendments {
        let material = completion.material;
        let job = locked.queue.job(material);
        // What was recorded of a job that is not complete counts no more.
        let counts = job.is_some_and(|job| matches!(job.state, JobState::Completed { .. }));
        let now = recorded.get(&material).filter(|_| counts);
        let as_known = job.is_some() && now == *before;
        done.push(as_known);
        let Some(job) = job.filter(|_| as_known) else {
            continue;
        };
        let state = JobState::Completed {
            fingerprint: completion.fingerprint(),
            worker: completion.worker.clone(),
            redundant: RedundantRender::None,
        };
        let record = JobRecord {
            state,
            ..job.clone()
        };
        changes.jobs.push(JobChange { material, record });
        completions.push(*completion);
    }
    locked.write(&transaction, &changes, &completions).await?;
    transaction.commit().await?;
    Ok(done)
}
