//! What is read without changing anything.

use super::{
    Shared,
    connecting::query,
    fault::{Fault, attempt},
    rows::{job, json, mode, no_farm, number},
    turns::is_finished,
    window::{Window, is_apart, last_material, stages},
};
use dataset::Digest;
use deadpool_postgres::Transaction;
use jobqueue::{Changes, JobChange, WorkerChange};
use jobqueue::{Counts, Selection, WorkerRecord, token::WorkerId};
use jobstore::{JobStoreError, JobsPage, Overview, Session, Workers, ledger::BlobPlace};
use std::collections::HashMap;
use tokio_postgres::Row;

impl Shared {
    /// How the jobs stand, told to the context as well.
    pub async fn publish_overview(&self) -> Result<Overview, JobStoreError> {
        let _telling = self.telling.lock().await;
        let overview = attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let rows = query(&transaction, include_str!("sql/overview.sql"), &[]).await?;
            let row = rows.first().ok_or_else(no_farm)?;
            let mut counted = [0_u32; 7];
            for (column, count) in counted.iter_mut().enumerate() {
                *count = number(row.get(column))?;
            }
            let [
                pending,
                leased,
                completed,
                disputed,
                quarantined,
                cancelled,
                redundant,
            ] = counted;
            let materials = counted[..6].iter().sum();
            let blocked: i64 = row.get(8);
            Ok(Overview {
                counts: Counts {
                    materials,
                    pending,
                    leased,
                    completed,
                    disputed,
                    quarantined,
                    cancelled,
                    redundant,
                },
                mode: mode(row.get(7))?,
                workers_blocked: number(blocked)?,
                finished: is_finished(&transaction).await?,
            })
        })?;
        self.context.publish(overview);
        Ok(overview)
    }

    pub async fn jobs(
        &self,
        from: u32,
        jobs_max: usize,
        selection: &Selection,
    ) -> Result<JobsPage, JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let mut page = JobsPage {
                jobs: Vec::new(),
                next: Some(from),
            };
            if is_apart(selection) {
                page_apart(&transaction, &mut page, jobs_max, selection).await?;
                return Ok(page);
            }
            let Some(last) = last_material(&transaction).await? else {
                return Ok(JobsPage::default());
            };
            for _ in 0..limits::DATABASE_WINDOWS_PER_CALL {
                let (Some(from), true) = (page.next, page.jobs.len() < jobs_max) else {
                    break;
                };
                let Some(window) = Window::of(selection, from, last) else {
                    page.next = None;
                    break;
                };
                add_window(&transaction, &mut page, jobs_max, window).await?;
            }
            Ok(page)
        })
    }

    pub async fn workers(&self) -> Result<Workers, JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let sessions = query(&transaction, include_str!("sql/sessions.sql"), &[]).await?;
            let workers = query(&transaction, include_str!("sql/workers.sql"), &[]).await?;
            let sessions = sessions.iter().map(|row| {
                let worker = WorkerId::from_message(row.get(0));
                Ok(Session {
                    worker: worker.ok_or_else(|| Fault::damaged("a session has no worker"))?,
                    name: row.get(1),
                    held: number(row.get(2))?,
                })
            });
            Ok(Workers {
                records: workers.iter().map(worker).collect::<Result<_, Fault>>()?,
                sessions: sessions.collect::<Result<_, Fault>>()?,
            })
        })
    }

    pub async fn places(
        &self,
        digests: &[Digest],
    ) -> Result<Vec<Option<BlobPlace>>, JobStoreError> {
        let wanted: Vec<&[u8]> = digests
            .iter()
            .map(|digest| &digest.as_bytes()[..])
            .collect();
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let rows = query(&transaction, include_str!("sql/places.sql"), &[&wanted]).await?;
            let places = rows.iter().map(|row| {
                let view: i32 = row.get(2);
                let bytes: i64 = row.get(3);
                let place = BlobPlace {
                    material: number(row.get(1))?,
                    view: number(i64::from(view))?,
                    bytes: u64::try_from(bytes).map_err(Fault::damaged)?,
                };
                Ok((row.get(0), place))
            });
            let places: HashMap<&[u8], BlobPlace> = places.collect::<Result<_, Fault>>()?;
            let found = wanted.iter().map(|digest| places.get(digest).copied());
            Ok(found.collect())
        })
    }

    pub async fn contents(&self) -> Result<Changes, JobStoreError> {
        attempt!({
            let mut connection = self.database.connection().await?;
            let transaction = connection.transaction().await?;
            let farm = query(&transaction, include_str!("sql/farm.sql"), &[]).await?;
            let jobs = query(&transaction, include_str!("sql/records.sql"), &[]).await?;
            let workers = query(&transaction, include_str!("sql/workers.sql"), &[]).await?;
            let jobs = jobs.iter().map(|row| {
                let (material, record) = job(row)?;
                Ok(JobChange { material, record })
            });
            let workers = workers.iter().map(|row| {
                let (name, record) = worker(row)?;
                Ok(WorkerChange { name, record })
            });
            Ok(Changes {
                jobs: jobs.collect::<Result<_, Fault>>()?,
                workers: workers.collect::<Result<_, Fault>>()?,
                mode: Some(mode(farm[0].get(0))?),
                retracted: Vec::new(),
            })
        })
    }
}

/// Adds the jobs of a window to a page, and says where the next begins.
async fn add_window(
    transaction: &Transaction<'_>,
    page: &mut JobsPage,
    jobs_max: usize,
    window: Window,
) -> Result<(), Fault> {
    // One more, to know where the next page begins.
    let most = (jobs_max - page.jobs.len()) as i64 + 1;
    let Window {
        firsts,
        lasts,
        stages,
        next,
    } = window;
    let statement = include_str!("sql/page.sql");
    let rows = query(transaction, statement, &[&firsts, &lasts, &stages, &most]).await?;
    page.next = next;
    for row in &rows {
        let (material, job) = job(row)?;
        if page.jobs.len() == jobs_max {
            page.next = Some(material);
            break;
        }
        page.jobs.push((material, job, number(row.get(2))?));
    }
    Ok(())
}

/// Makes a page of jobs that the database lists apart.
async fn page_apart(
    transaction: &Transaction<'_>,
    page: &mut JobsPage,
    jobs_max: usize,
    selection: &Selection,
) -> Result<(), Fault> {
    let from = i64::from(page.next.take().unwrap_or(0));
    let most = i64::from(limits::DATABASE_WINDOW_MATERIALS);
    let statement = include_str!("sql/page_apart.sql");
    let rows = query(transaction, statement, &[&stages(selection), &from, &most]).await?;
    for row in &rows {
        let (material, job) = job(row)?;
        if page.jobs.len() == jobs_max {
            page.next = Some(material);
            return Ok(());
        }
        if selection.has_material(material) {
            page.jobs.push((material, job, number(row.get(2))?));
        }
        page.next = material.checked_add(1);
    }
    if (rows.len() as i64) < most {
        page.next = None;
    }
    Ok(())
}

pub(super) fn worker(row: &Row) -> Result<(String, WorkerRecord), Fault> {
    Ok((row.get(0), json(row.get(1), "worker")?))
}
