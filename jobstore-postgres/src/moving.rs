//! A database from which, or into which, a store is copied: nobody else changes it meanwhile.

use super::{
    DatabaseError, Identity, Live, MeshBytes,
    connecting::{execute, query},
    fault::Fault,
    listing::worker,
    locked_jobs::{LockMode, LockedJobs},
    maintenance::MaintenanceSession,
    rows::{json, mode, ms, no_farm, number, record},
    schema,
};
use jobqueue::{Changes, JobChange, Policy, WorkerChange};
use jobstore::kept::{Entry, KeptFarm, Page};
use tokio_postgres::Row;

impl MaintenanceSession {
    /// Keeps coordinators from starting, and all transactions of those that run waiting, for as
    /// long as this session lives; says who was at work.
    pub async fn freeze(&mut self) -> Result<Live, DatabaseError> {
        let live = self.freeze_once().await.map_err(|fault| self.away(fault))?;
        self.exclude().await?;
        Ok(live)
    }

    async fn freeze_once(&mut self) -> Result<Live, Fault> {
        let statement = include_str!("sql/lock_migration.sql");
        self.client.query_one(statement, &[]).await?;
        let after = ms(limits::WORKER_ABSENT);
        let statement = include_str!("sql/live.sql");
        let row = self.client.query_one(statement, &[&after]).await?;
        Ok(Live {
            workers: number(row.get(0))?,
            leases: number(row.get(1))?,
        })
    }

    /// Makes the database about a dataset of this many materials, as [`super::Database::make`] does.
    pub async fn make(
        &mut self,
        identity: &Identity,
        mesh: Option<MeshBytes<'_>>,
        materials: u32,
    ) -> Result<(), DatabaseError> {
        let made = async {
            let transaction = self.client.transaction().await?;
            schema::make(&transaction, identity, mesh, materials).await?;
            Ok(transaction.commit().await?)
        };
        made.await.map_err(|fault: Fault| self.away(fault))
    }

    /// How many jobs are complete, be they disputed or not.
    pub async fn completed(&mut self) -> Result<u32, DatabaseError> {
        let completed = async {
            let statement = include_str!("sql/completed.sql");
            number(self.client.query_one(statement, &[]).await?.get(0))
        };
        completed.await.map_err(|fault| self.away(fault))
    }

    /// Jobs with a record from one on, as many as fit a page, without their leases.
    pub async fn entries(&mut self, from: u32, most: usize) -> Result<Page, DatabaseError> {
        let page = self.entries_once(from, most).await;
        page.map_err(|fault| self.away(fault))
    }

    async fn entries_once(&mut self, from: u32, most: usize) -> Result<Page, Fault> {
        let transaction = self.client.transaction().await?;
        let statement = include_str!("sql/entries.sql");
        let rows = query(&transaction, statement, &[&i64::from(from), &(most as i64)]).await?;
        let next = match rows.last() {
            Some(last) if rows.len() == most => number(last.get(0))?.checked_add(1),
            _ => None,
        };
        let entries = rows.iter().map(entry).collect::<Result<Vec<_>, Fault>>()?;
        Ok(Page::new(entries, next))
    }

    /// Writes records and completions over those that are there, all or none.
    pub async fn write_entries(&mut self, entries: &[Entry]) -> Result<(), DatabaseError> {
        let written = self.write_entries_once(entries).await;
        written.map_err(|fault| self.away(fault))
    }

    async fn write_entries_once(&mut self, entries: &[Entry]) -> Result<(), Fault> {
        let transaction = self.client.transaction().await?;
        let mut locked =
            LockedJobs::begin(&transaction, LockMode::Exclusive, Policy::default()).await?;
        let materials: Vec<i64> = entries
            .iter()
            .map(|entry| i64::from(entry.material))
            .collect();
        locked.lock_jobs(&transaction, &materials).await?;
        let jobs = entries.iter().map(|entry| JobChange {
            material: entry.material,
            record: entry.record.clone(),
        });
        let changes = Changes {
            jobs: jobs.collect(),
            ..Changes::default()
        };
        let completions: Vec<_> = entries
            .iter()
            .filter_map(|entry| entry.completion.as_ref())
            .collect();
        locked.write(&transaction, &changes, &completions).await?;
        Ok(transaction.commit().await?)
    }

    /// What is kept of workers, and whether work is handed out.
    pub async fn kept_farm(&mut self) -> Result<KeptFarm, DatabaseError> {
        let farm = self.kept_farm_once().await;
        farm.map_err(|fault| self.away(fault))
    }

    async fn kept_farm_once(&mut self) -> Result<KeptFarm, Fault> {
        let transaction = self.client.transaction().await?;
        let rows = query(&transaction, include_str!("sql/workers.sql"), &[]).await?;
        let workers = rows.iter().map(worker).collect::<Result<_, Fault>>()?;
        let rows = query(&transaction, include_str!("sql/farm.sql"), &[]).await?;
        let farm = rows.first().ok_or_else(no_farm)?;
        Ok(KeptFarm {
            workers,
            mode: mode(farm.get(0))?,
        })
    }

    /// Writes what is kept of workers over what is there, and the mode. Blocks over failures get
    /// their full time again.
    pub async fn write_farm(&mut self, farm: &KeptFarm) -> Result<(), DatabaseError> {
        let written = self.write_farm_once(farm).await;
        written.map_err(|fault| self.away(fault))
    }

    async fn write_farm_once(&mut self, farm: &KeptFarm) -> Result<(), Fault> {
        let transaction = self.client.transaction().await?;
        let policy = Policy::default();
        let mut locked = LockedJobs::begin(&transaction, LockMode::Exclusive, policy).await?;
        let ends = locked.now + policy.block;
        let workers = farm.workers.iter().map(|(name, record)| WorkerChange {
            name: name.clone(),
            record: record.clone(),
        });
        let workers: Vec<WorkerChange> = workers.collect();
        for change in &workers {
            locked.queue.add_worker(change.clone(), ends);
        }
        let changes = Changes {
            workers,
            mode: Some(farm.mode),
            ..Changes::default()
        };
        locked.write(&transaction, &changes, &[]).await?;
        Ok(transaction.commit().await?)
    }

    /// Notes that the whole of a copy is there: the database is a store like any other.
    pub async fn note_migrated(&mut self) -> Result<(), DatabaseError> {
        let noted = async {
            let transaction = self.client.transaction().await?;
            execute(&transaction, include_str!("sql/migrated.sql"), &[]).await?;
            Ok(transaction.commit().await?)
        };
        noted.await.map_err(|fault: Fault| self.away(fault))
    }
}

fn entry(row: &Row) -> Result<Entry, Fault> {
    let completion: Option<&str> = row.get(2);
    Ok(Entry {
        material: number(row.get(0))?,
        record: record(row.get(1))?,
        completion: completion
            .map(|text| json(text, "completion"))
            .transpose()?,
    })
}
