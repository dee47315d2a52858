//! What people see of the farm and do to it.

use super::{
    Farm, FarmError, Progress,
    events::{Event, EventKind},
    images::blobs_away,
};
use crate::{
    ledger::BlobPlace,
    queue::{BarCause, Changes, JobRecord, Mode, Queue, WorkerRecord},
    roster::is_present,
};
use dataset::Digest;
use proto::limits::{EVENT_READERS_MAX, SET_ASIDE_LISTED_MAX, WORKERS_LISTED_MAX};
use std::{collections::BTreeMap, sync::Arc, time::Duration};
use tokio::{sync::broadcast, task};

/// Which jobs an operation changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Changed {
    Retried,
    Cancelled,
    Prioritized(i32),
}

/// What is known of the workers of one name.
#[derive(Debug, Default)]
pub(crate) struct WorkerReport {
    pub sessions: u32,
    pub leases: u32,
    pub completed: u64,
    pub silent: Option<Duration>,
    pub record: WorkerRecord,
}

/// How the farm is.
#[derive(Debug)]
pub(crate) struct Report {
    pub progress: Progress,
    pub mode: Mode,
    pub workers_barred: u32,
    pub images_per_second: f64,
    pub up: Duration,
}

impl Farm {
    pub fn report(&self) -> Report {
        let state = self.shared.lock();
        self.shared.publish(&state);
        let now = self.shared.now();
        let records = state.queue.worker_records();
        let barred = records.filter(|(_, record)| record.bar.is_some());
        Report {
            progress: *self.shared.progress.borrow(),
            mode: state.queue.mode(),
            workers_barred: barred.count() as u32,
            images_per_second: state.images_completed.per_second(now),
            up: now,
        }
    }

    /// What Prometheus is told.
    pub fn metrics_text(&self) -> String {
        let report = self.report();
        let free = self.blobs.free_bytes().unwrap_or(0);
        self.metrics
            .text(&report.progress, report.images_per_second, free)
    }

    /// Materials set aside, the first few, with their errors.
    pub fn set_aside(&self) -> Vec<(u32, Vec<String>)> {
        let state = self.shared.lock();
        let set_aside = state.queue.set_aside().take(SET_ASIDE_LISTED_MAX);
        set_aside
            .map(|(material, job)| {
                let errors = job.failures.iter().map(|failure| failure.error.clone());
                (material, errors.collect())
            })
            .collect()
    }

    /// The first `jobs_max` jobs from `from` on that are wanted, with the views that a leased one
    /// has done, and where the next page begins.
    pub fn jobs(
        &self,
        from: u32,
        jobs_max: usize,
        wanted: impl Fn(u32, &JobRecord) -> bool,
    ) -> (Vec<(u32, JobRecord, u32)>, Option<u32>) {
        let state = self.shared.lock();
        let materials = state.queue.counts().materials;
        let mut jobs = Vec::new();
        for material in from..materials {
            let Some(job) = state.queue.job(material) else {
                break;
            };
            if !wanted(material, job) {
                continue;
            }
            if jobs.len() == jobs_max {
                return (jobs, Some(material));
            }
            let views_done = state.queue.views_done(material).unwrap_or(0);
            jobs.push((material, job.clone(), views_done));
        }
        (jobs, None)
    }

    /// Does one thing to all jobs that are wanted; returns those that it changed.
    pub async fn change_jobs(
        &self,
        change: Changed,
        wanted: impl Fn(u32, &JobRecord) -> bool,
    ) -> Result<Vec<u32>, FarmError> {
        let changes = self.operate(|queue, now| {
            let materials = 0..queue.counts().materials;
            let materials: Vec<u32> = materials
                .filter(|material| {
                    queue
                        .job(*material)
                        .is_some_and(|job| wanted(*material, job))
                })
                .collect();
            match change {
                Changed::Retried => queue.retry(materials, now),
                Changed::Cancelled => queue.cancel(materials, now),
                Changed::Prioritized(priority) => queue.prioritize(materials, priority, now),
            }
        });
        let changes = changes.await?;
        let (kind, text) = match change {
            Changed::Retried => (EventKind::Retried, String::new()),
            Changed::Cancelled => (EventKind::Cancelled, String::new()),
            Changed::Prioritized(priority) => (EventKind::Prioritized, format!("to {priority}")),
        };
        for change in &changes.jobs {
            self.tell(Event::new(kind).material(change.material).text(&text));
        }
        Ok(changes.jobs.iter().map(|change| change.material).collect())
    }

    /// Hands out work or not. True when it was so before.
    pub async fn set_mode(&self, mode: Mode) -> Result<bool, FarmError> {
        let changes = self.operate(|queue, _| queue.set_mode(mode)).await?;
        let changed = changes.mode.is_some();
        if changed {
            let text = match mode {
                Mode::Running => "running",
                Mode::Paused => "paused",
                Mode::Draining => "draining",
            };
            self.tell(Event::new(EventKind::Mode).text(text));
        }
        Ok(!changed)
    }

    /// Gives a worker no more work. Returns how many leases were taken back.
    pub async fn bar(&self, name: &str, reason: String) -> Result<u32, FarmError> {
        let bar = |queue: &mut Queue, now| queue.bar(name, BarCause::Operator, reason, now);
        let changes = self.operate(bar).await?;
        self.tell_troubles(&changes);
        Ok(changes.jobs.len() as u32)
    }

    pub async fn unbar(&self, name: &str) -> Result<(), FarmError> {
        let unbar = |queue: &mut Queue, _| Changes {
            workers: queue.unbar(name).into_iter().collect(),
            ..Changes::default()
        };
        let changes = self.operate(unbar).await?;
        if changes.is_empty() {
            return Err(FarmError::NotBarred(name.to_owned()));
        }
        self.tell(Event::new(EventKind::Unbarred).worker(name));
        Ok(())
    }

    /// Workers by name, those that are there before those that only have a history.
    pub fn workers(&self) -> Vec<(String, WorkerReport)> {
        let state = self.shared.lock();
        let now = self.shared.now();
        let mut workers: BTreeMap<String, WorkerReport> = BTreeMap::new();
        for (worker, member) in state.roster.members() {
            let report = workers.entry(member.name.clone()).or_default();
            let silent = now.saturating_sub(member.seen);
            report.sessions += u32::from(is_present(member, now));
            report.leases += state.queue.held(worker);
            report.completed += member.completed;
            report.silent = Some(report.silent.map_or(silent, |other| other.min(silent)));
        }
        for (name, record) in state.queue.worker_records() {
            workers.entry(name.to_owned()).or_default().record = record.clone();
        }
        drop(state);
        let mut workers: Vec<(String, WorkerReport)> = workers.into_iter().collect();
        workers.sort_by_key(|(_, report)| report.sessions == 0);
        workers.truncate(WORKERS_LISTED_MAX);
        workers
    }

    /// What happens from now on.
    pub fn watch(&self) -> Result<broadcast::Receiver<Event>, FarmError> {
        if self.shared.events.readers() >= EVENT_READERS_MAX {
            return Err(FarmError::TooManyReaders(EVENT_READERS_MAX));
        }
        Ok(self.shared.events.watch())
    }

    /// An image of a completed material.
    pub async fn blob(&self, digest: Digest) -> Result<Vec<u8>, FarmError> {
        let ledger = Arc::clone(&self.ledger);
        let blobs = self.blobs.clone();
        let read = task::spawn_blocking(move || {
            let Some(BlobPlace { bytes, .. }) = ledger.blob(&digest)? else {
                return Err(FarmError::UnknownBlob(digest));
            };
            let size = blobs.size(&digest);
            if size.map_err(|error| blobs_away(&blobs, error))? != Some(bytes) {
                return Err(FarmError::UnknownBlob(digest));
            }
            let data = blobs.read(&digest, bytes);
            let data = data.map_err(|error| blobs_away(&blobs, error))?;
            // Bytes that are not what they are called never leave as if they were.
            if Digest::of(&data) != digest {
                return Err(FarmError::DamagedBlob(digest));
            }
            Ok(data)
        });
        read.await.map_err(|_| FarmError::Interrupted)?
    }

    /// Changes the queue, durably.
    async fn operate(
        &self,
        change: impl FnOnce(&mut Queue, Duration) -> Changes,
    ) -> Result<Changes, FarmError> {
        let (changes, pending) = {
            let mut state = self.shared.lock();
            let changes = change(&mut state.queue, self.shared.now());
            let pending = self.submit(&changes);
            self.after(&state, &changes);
            (changes, pending)
        };
        match pending {
            Some(pending) => pending.durable().await?,
            // What was so before may still be on its way to the disk.
            None => self.settled().await?,
        }
        Ok(changes)
    }
}
