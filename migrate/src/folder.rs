//! A store in a folder that holds still.

use super::{Entry, FrozenStore, KeptFarm, MigrationError, PAGE_JOBS, Page};
use dataset::Specification;
use datastore::{BlobsPlace, Store, StoreError, StoreName};
use imagestore::{FileError, blobs::Blobs};
use jobqueue::{Changes, JobChange, JobRecord, JobState, WorkerChange, WorkerRecord};
use jobstore::{
    completion_log::{CompletionLog, Completions, Entry as Line, Retraction},
    ledger::{Ledger, LedgerError, SledLedger},
};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Path, PathBuf},
};

pub struct Folder {
    name: StoreName,
    path: PathBuf,
    specification: Specification,
    blobs: Blobs,
    ledger: SledLedger,
    log: CompletionLog,
    logged: Completions,
    // As they were when the ledger was opened.
    jobs: BTreeMap<u32, JobRecord>,
    farm: KeptFarm,
    lock: File,
}

impl Folder {
    /// One to copy from. Ledger and log agree, which opening a store takes care of.
    pub fn source(path: &Path) -> Result<(Self, Specification, BlobsPlace), MigrationError> {
        let store = Store::open(path)?;
        let specification = store.specification().clone();
        let place = match store.blobs().objects() {
            None => BlobsPlace::Folder(path.to_owned()),
            Some(objects) => BlobsPlace::Bucket(objects.bucket().url().clone()),
        };
        let (blobs, state, lock) = store.into_parts();
        let logged = Completions::open(&datastore::log_path(path))?;
        let (jobs, farm) = sorted(state.kept);
        let folder = Self {
            name: StoreName::Folder(path.to_owned()),
            path: path.to_owned(),
            specification: specification.clone(),
            blobs,
            ledger: state.ledger,
            log: state.log,
            logged,
            jobs,
            farm,
            lock,
        };
        Ok((folder, specification, place))
    }

    /// One to copy into.
    pub fn target(
        path: &Path,
        specification: &Specification,
        blobs: Option<&BlobsPlace>,
        from: &str,
    ) -> Result<Self, MigrationError> {
        let bucket = match blobs {
            None => None,
            Some(BlobsPlace::Bucket(url)) => Some(url),
            Some(BlobsPlace::Folder(folder)) => {
                return Err(StoreError::BlobsApart(folder.clone()).into());
            }
        };
        let (blobs, lock) = datastore::begin_copy(path, specification, bucket, from)?;
        let directory = path.join("ledger");
        let opened = match SledLedger::open(&directory) {
            // It can be torn where the copy was cut short; what it said is read from the source.
            Err(LedgerError::Damaged(_)) => {
                let removed = fs::remove_dir_all(&directory);
                removed.map_err(FileError::new("clear", &directory))?;
                SledLedger::open(&directory)?
            }
            opened => opened?,
        };
        Self::with(path, specification.clone(), blobs, opened, lock)
    }

    fn with(
        path: &Path,
        specification: Specification,
        blobs: Blobs,
        (ledger, kept): (SledLedger, Changes),
        lock: File,
    ) -> Result<Self, MigrationError> {
        let (log, logged) = CompletionLog::open(&datastore::log_path(path))?;
        let (jobs, farm) = sorted(kept);
        Ok(Self {
            name: StoreName::Folder(path.to_owned()),
            path: path.to_owned(),
            specification,
            blobs,
            ledger,
            log,
            logged,
            jobs,
            farm,
            lock,
        })
    }
}

fn sorted(kept: Changes) -> (BTreeMap<u32, JobRecord>, KeptFarm) {
    let jobs = kept.jobs.into_iter();
    let workers = kept.workers.into_iter();
    let workers = workers.filter(|worker| worker.record != WorkerRecord::default());
    let farm = KeptFarm {
        workers: workers.map(|worker| (worker.name, worker.record)).collect(),
        mode: kept.mode.unwrap_or_default(),
    };
    (jobs.map(|job| (job.material, job.record)).collect(), farm)
}

impl FrozenStore for Folder {
    fn name(&self) -> &StoreName {
        &self.name
    }

    fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    fn completed(&mut self) -> Result<u32, MigrationError> {
        let jobs = self.jobs.values();
        let completed = jobs.filter(|job| matches!(job.state, JobState::Completed { .. }));
        Ok(completed.count() as u32)
    }

    fn page(&mut self, from: u32) -> Result<Page, MigrationError> {
        let mut jobs = self.jobs.range(from..);
        let page = jobs.by_ref().take(PAGE_JOBS).map(|(material, record)| {
            let completion = match record.state {
                JobState::Completed { .. } => self.logged.get(*material)?,
                _ => None,
            };
            Ok(Entry {
                material: *material,
                record: record.clone(),
                completion,
            })
        });
        let page = page.collect::<Result<_, FileError>>()?;
        Ok(Page::new(page, jobs.next().map(|(material, _)| *material)))
    }

    fn farm(&mut self) -> Result<KeptFarm, MigrationError> {
        Ok(self.farm.clone())
    }

    // The log, then the ledger, as in every commit.
    fn write(&mut self, entries: &[Entry]) -> Result<(), MigrationError> {
        let mut lines = Vec::new();
        let mut changes = Changes::default();
        let mut completions = Vec::new();
        for Entry {
            material,
            record,
            completion,
        } in entries
        {
            let logged = self.logged.get(*material)?;
            match completion {
                Some(completion) if logged.as_ref() != Some(completion) => {
                    lines.push(Line::Completed(completion.clone()));
                }
                None if logged.is_some() => lines.push(Line::Retracted(Retraction {
                    retracted: *material,
                })),
                _ => {}
            }
            completions.extend(completion.clone());
            changes.jobs.push(JobChange {
                material: *material,
                record: record.clone(),
            });
        }
        self.log.append_entries(&lines)?;
        self.ledger.apply(&changes, &completions)?;
        Ok(self.ledger.sync()?)
    }

    fn write_farm(&mut self, farm: &KeptFarm) -> Result<(), MigrationError> {
        let workers = farm.workers.iter().map(|(name, record)| WorkerChange {
            name: name.clone(),
            record: record.clone(),
        });
        let changes = Changes {
            workers: workers.collect(),
            mode: Some(farm.mode),
            ..Changes::default()
        };
        self.ledger.apply(&changes, &[])?;
        Ok(self.ledger.sync()?)
    }

    fn reopen(self: Box<Self>) -> Result<Box<dyn FrozenStore>, MigrationError> {
        let Self {
            path,
            specification,
            blobs,
            ledger,
            lock,
            ..
        } = *self;
        drop(ledger);
        let opened = SledLedger::open(&path.join("ledger"))?;
        let folder = Self::with(&path, specification, blobs, opened, lock)?;
        Ok(Box::new(folder))
    }

    fn finish(self: Box<Self>) -> Result<(), MigrationError> {
        // The lock goes last.
        let Self {
            path,
            specification,
            lock,
            ..
        } = *self;
        datastore::end_copy(&path, &specification)?;
        drop(lock);
        Ok(())
    }
}
