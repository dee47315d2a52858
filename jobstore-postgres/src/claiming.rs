//! Workers come, claim, renew and go.

use super::{
    Shared,
    connecting::{execute, query},
    fault::{Fault, attempt},
    locked_jobs::{LockMode, LockedJobs, json, lock, lock_leases, mode, ms, no_farm, number, time},
};
use deadpool_postgres::Transaction;
use jobqueue::{
    Holder, JobRecord, JobState, Mode, WorkerChange, WorkerRecord,
    token::{Token, WorkerId},
};
use jobstore::{JobStoreError, Leased, Renewal};
use std::collections::HashMap;
use tokio_postgres::Row;

impl Shared {
    pub async fn admit(&self, worker: WorkerId, name: &str) -> Result<(), JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let worker = worker.to_message();
            execute(
                &transaction,
                include_str!("sql/admit.sql"),
                &[&worker, &name],
            )
            .await?;
            transaction.commit().await?;
            Ok(())
        })?;
        // A worker of another name may be what a second rendering waits for.
        self.context.work.notify_waiters();
        Ok(())
    }

    /// The name of a worker, and a note that it called.
    pub async fn name(&self, worker: WorkerId) -> Result<Option<String>, JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let worker = worker.to_message();
            let rows = query(&transaction, include_str!("sql/name.sql"), &[&worker]).await?;
            let Some(row) = rows.first() else {
                return Ok(None);
            };
            if time(row.get(1)) >= limits::WORKER_ABSENT / 3 {
                execute(&transaction, include_str!("sql/seen.sql"), &[&worker]).await?;
            }
            let name = row.get(0);
            transaction.commit().await?;
            Ok(Some(name))
        })
    }

    pub async fn dismiss(&self, workers: &[WorkerId]) -> Result<(), JobStoreError> {
        let workers: Vec<Vec<u8>> = workers.iter().map(|worker| worker.to_message()).collect();
        let after = ms(self.presence.dismissed_after);
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let statement = include_str!("sql/dismiss.sql");
            execute(&transaction, statement, &[&workers, &after]).await?;
            transaction.commit().await?;
            Ok(())
        })
    }

    pub async fn claim(&self, worker: WorkerId, tokens: &[Token]) -> Result<Leased, JobStoreError> {
        let mut answer_lost = false;
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            lock(&transaction, LockMode::Shared).await?;
            if answer_lost {
                let leased = claimed_before(&transaction, worker, tokens).await?;
                if !leased.jobs.is_empty() {
                    return Ok(leased);
                }
            }
            answer_lost = true;
            let leased = self.claim_once(&transaction, worker, tokens).await?;
            transaction.commit().await?;
            Ok(leased)
        })
    }

    async fn claim_once(
        &self,
        transaction: &Transaction<'_>,
        worker: WorkerId,
        tokens: &[Token],
    ) -> Result<Leased, Fault> {
        let id = worker.to_message();
        let rows = query(transaction, include_str!("sql/asker.sql"), &[&id]).await?;
        let asker = rows.first().ok_or_else(no_farm)?;
        let mode = mode(asker.get(0))?;
        let record: Option<&str> = asker.get(3);
        let record: Option<WorkerRecord> = record.map(|text| json(text, "worker")).transpose()?;
        let name: Option<&str> = asker.get(2);
        let barred = record.as_ref().and_then(|record| record.bar.as_ref());
        let barred = barred.map(|bar| bar.reason.clone());
        let held: i64 = asker.get(4);
        let room = i64::from(self.policy.leases_per_worker_max) - held;
        let wanted = room.clamp(0, tokens.len() as i64);
        if let Some(name) = name
            && mode == Mode::Running
            && barred.is_none()
            && wanted > 0
        {
            let mut locked = LockedJobs::new(self.policy, mode, time(asker.get(1)));
            locked.queue.admit(worker, name);
            if let Some(record) = record {
                let name = name.to_owned();
                locked
                    .queue
                    .add_worker(WorkerChange { name, record }, locked.now);
            }
            let mut found = 0;
            for statement in [
                include_str!("sql/to_judge.sql"),
                include_str!("sql/fresh.sql"),
                include_str!("sql/again.sql"),
            ] {
                if found < wanted {
                    let rows = query(transaction, statement, &[&name, &(wanted - found)]).await?;
                    found += rows.len() as i64;
                    locked.add(&rows)?;
                }
            }
            if found > 0 {
                let tokens = &tokens[..wanted as usize];
                let changes = locked.queue.claim(worker, tokens, locked.now);
                locked.write(transaction, &changes, &[]).await?;
                let materials = changes.jobs.iter().map(|change| change.material);
                return Ok(Leased {
                    jobs: tokens.iter().copied().zip(materials).collect(),
                    ..Leased::default()
                });
            }
        }
        let finished = is_finished(transaction).await?;
        let draining = mode == Mode::Draining;
        let told = !finished && !draining && name.is_some();
        Ok(Leased {
            jobs: Vec::new(),
            finished,
            draining,
            barred: barred.filter(|_| told),
        })
    }

    pub async fn renew(&self, renewals: &[Renewal]) -> Result<Vec<bool>, JobStoreError> {
        let materials = renewals.iter().map(|renewal| i64::from(renewal.material));
        let materials: Vec<i64> = materials.collect();
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let mut locked = LockedJobs::begin(&transaction, LockMode::Shared, self.policy).await?;
            let leases = lock_leases(&transaction, &materials).await?;
            for (material, (token, (worker, name), lease)) in leases {
                // Whatever else the job is, for its holder it is leased.
                let holder = Holder {
                    token,
                    worker,
                    name,
                };
                let record = JobRecord {
                    state: JobState::Leased(holder),
                    ..JobRecord::default()
                };
                locked.queue.add_job(material, record, Some(lease));
            }
            let now = locked.now;
            let renewed = renewals.iter().map(|renewal| {
                let Renewal {
                    token,
                    material,
                    views_done,
                } = *renewal;
                locked.queue.renew(material, token, views_done, now)
            });
            let renewed: Vec<bool> = renewed.collect();
            write_renewed(&transaction, &locked, renewals).await?;
            transaction.commit().await?;
            Ok(renewed)
        })
    }
}

async fn write_renewed(
    transaction: &Transaction<'_>,
    locked: &LockedJobs,
    renewals: &[Renewal],
) -> Result<(), Fault> {
    let leases = renewals.iter().filter_map(|renewal| {
        let lease = locked.queue.lease(renewal.material)?;
        Some((renewal.material, (renewal.token, lease)))
    });
    // By material: no row is written twice.
    let leases: HashMap<u32, _> = leases.collect();
    let leases: Vec<_> = leases.into_iter().collect();
    let materials: Vec<i64> = leases.iter().map(|lease| i64::from(lease.0)).collect();
    let tokens: Vec<Vec<u8>> = leases.iter().map(|lease| lease.1.0.to_message()).collect();
    let expires: Vec<i64> = leases.iter().map(|lease| ms(lease.1.1.expires)).collect();
    let views = leases.iter().map(|lease| i64::from(lease.1.1.views_done));
    let views: Vec<i64> = views.collect();
    let progressed: Vec<i64> = leases
        .iter()
        .map(|lease| ms(lease.1.1.progressed))
        .collect();
    execute(
        transaction,
        include_str!("sql/renew_leases.sql"),
        &[&materials, &tokens, &expires, &views, &progressed],
    )
    .await?;
    Ok(())
}

/// What a claim got whose answer was lost.
async fn claimed_before(
    transaction: &Transaction<'_>,
    worker: WorkerId,
    tokens: &[Token],
) -> Result<Leased, Fault> {
    let names: Vec<Vec<u8>> = tokens.iter().map(|token| token.to_message()).collect();
    let statement = include_str!("sql/claimed_before.sql");
    let rows = query(transaction, statement, &[&worker.to_message(), &names]).await?;
    let jobs = rows.iter().map(|row: &Row| {
        let token = Token::from_message(row.get(1));
        let token = token.ok_or_else(|| Fault::damaged("a lease has no token"))?;
        Ok((token, number(row.get(0))?))
    });
    Ok(Leased {
        jobs: jobs.collect::<Result<_, Fault>>()?,
        ..Leased::default()
    })
}

/// Whether nothing is left to do, now or later.
pub(super) async fn is_finished(transaction: &Transaction<'_>) -> Result<bool, Fault> {
    let rows = query(transaction, include_str!("sql/finished.sql"), &[]).await?;
    Ok(rows.first().is_some_and(|row| row.get(0)))
}
