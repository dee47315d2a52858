//! What people see of the farm and do to it.

use super::{
    Farm, FarmError,
    events::{Event, EventKind},
    images::blobs_away,
};
use crate::{presence::is_present, report::Report};
use dataset::Digest;
use jobqueue::{
    BlockCause, JobState, Mode, RedundantRender, Selection, Stage, WorkerRecord, identity,
};
use jobstore::{JobsOrder, JobsPage, Workers, ledger::BlobPlace};
use limits::protocol::{EVENT_READERS_MAX, QUARANTINED_LISTED_MAX, WORKERS_LISTED_MAX};
use std::{collections::BTreeMap, time::Duration};
use tokio::{sync::broadcast, task};

/// What is known of the workers of one name.
#[derive(Debug, Default)]
pub(crate) struct WorkerReport {
    pub sessions: u32,
    pub leases: u32,
    pub completed: u64,
    pub silent: Option<Duration>,
    pub record: WorkerRecord,
}

/// Who contradicts whom.
#[derive(Debug)]
pub(crate) struct DisputeReport {
    pub material: u32,
    pub worker: String,
    pub contradicted_by: String,
}

impl Farm {
    pub fn report(&self) -> Report {
        let state = self.shared.lock();
        self.publish(&state);
        let now = self.shared.now();
        let progress = *self.shared.progress.borrow();
        Report {
            progress,
            mode: state.overview.mode,
            workers_blocked: state.overview.workers_blocked,
            images_per_second: state.images_completed.per_second(now),
            store_bytes: state.bytes_before.saturating_add(progress.bytes_received),
            up: now,
        }
    }

    /// The same, with the jobs as they stand at this moment.
    pub async fn fresh_report(&self) -> Result<Report, FarmError> {
        self.job_store.publish_overview().await?;
        Ok(self.report())
    }

    /// What Prometheus is told.
    pub fn metrics_text(&self) -> String {
        let report = self.report();
        let free = self.context.blobs.room().free_bytes().unwrap_or(0);
        self.metrics.text(&report, free)
    }

    /// Materials quarantined, the first few, with their errors.
    pub async fn quarantined(&self) -> Result<Vec<(u32, Vec<String>)>, FarmError> {
        let quarantined = Selection::new(Vec::new(), vec![Stage::Quarantined]);
        let page = self.jobs(0, QUARANTINED_LISTED_MAX, &quarantined).await?;
        let jobs = page.jobs.into_iter();
        let told = jobs.map(|(material, job, _)| {
            let errors = job.failures.into_iter().map(|failure| failure.error);
            (material, errors.collect())
        });
        Ok(told.collect())
    }

    /// Materials that two workers delivered differently, the first few.
    pub async fn disputed(&self) -> Result<Vec<DisputeReport>, FarmError> {
        let disputed = Selection::new(Vec::new(), vec![Stage::Disputed]);
        let page = self.jobs(0, QUARANTINED_LISTED_MAX, &disputed).await?;
        let told = page.jobs.into_iter().filter_map(|(material, job, _)| {
            let JobState::Completed {
                worker,
                redundant: RedundantRender::Disputed(dispute),
                ..
            } = job.state
            else {
                return None;
            };
            Some(DisputeReport {
                material,
                worker,
                contradicted_by: dispute.worker,
            })
        });
        Ok(told.collect())
    }

    /// The first `jobs_max` jobs of a selection from `from` on.
    pub async fn jobs(
        &self,
        from: u32,
        jobs_max: usize,
        selection: &Selection,
    ) -> Result<JobsPage, FarmError> {
        Ok(self.job_store.jobs(from, jobs_max, selection).await?)
    }

    /// Does one thing to all jobs of a selection; returns those that it changed.
    pub async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Vec<u32>, FarmError> {
        let changes = self.job_store.order(order, selection).await?;
        self.drop_ended(&changes).await;
        let (kind, text) = match order {
            JobsOrder::Retry => (EventKind::Retried, String::new()),
            JobsOrder::Cancel => (EventKind::Cancelled, String::new()),
            JobsOrder::Prioritize(priority) => (EventKind::Prioritized, format!("to {priority}")),
        };
        for change in &changes.jobs {
            self.emit(Event::new(kind).material(change.material).text(&text));
        }
        Ok(changes.jobs.iter().map(|change| change.material).collect())
    }

    /// Hands out work or not. True when it was so before.
    pub async fn set_mode(&self, mode: Mode) -> Result<bool, FarmError> {
        let changes = self.job_store.set_mode(mode).await?;
        let changed = changes.mode.is_some();
        if changed {
            let text = match mode {
                Mode::Running => "running",
                Mode::Paused => "paused",
                Mode::Draining => "draining",
            };
            self.emit(Event::new(EventKind::Mode).text(text));
        }
        Ok(!changed)
    }

    /// What an operator means by a name: a worker's full name, or that of a credential.
    fn meant(&self, name: &str) -> String {
        match &self.tokens {
            Some(tokens) if tokens.knows_worker(name) => identity::full_name(Some(name), ""),
            _ => name.to_owned(),
        }
    }

    /// Gives a worker, or all of a credential, no more work. Returns how many leases were taken back.
    pub async fn block(&self, name: &str, reason: String) -> Result<u32, FarmError> {
        let changes = self
            .job_store
            .block(&self.meant(name), BlockCause::Operator, reason)
            .await?;
        self.drop_ended(&changes).await;
        self.tell_troubles(&changes);
        Ok(changes.jobs.len() as u32)
    }

    pub async fn unblock(&self, name: &str) -> Result<(), FarmError> {
        if self.job_store.unblock(&self.meant(name)).await?.is_none() {
            return Err(FarmError::NotBlocked(name.to_owned()));
        }
        self.emit(Event::new(EventKind::Unblocked).worker(name));
        Ok(())
    }

    /// Workers by name, those that are there before those that only have a history.
    pub async fn workers(&self) -> Result<Vec<(String, WorkerReport)>, FarmError> {
        let Workers { records, sessions } = self.job_store.workers().await?;
        let mut workers: BTreeMap<String, WorkerReport> = BTreeMap::new();
        {
            let state = self.shared.lock();
            let now = self.shared.now();
            for session in sessions {
                let report = workers.entry(session.name).or_default();
                report.leases += session.held;
                // Another coordinator of this dataset may be the one that it calls.
                let Some(member) = state.presence.member(session.worker) else {
                    report.sessions += 1;
                    continue;
                };
                let silent = now.saturating_sub(member.seen);
                report.sessions += u32::from(is_present(member, now));
                report.completed += member.completed;
                report.silent = Some(report.silent.map_or(silent, |other| other.min(silent)));
            }
        }
        for (name, record) in records {
            workers.entry(name).or_default().record = record;
        }
        let mut workers: Vec<(String, WorkerReport)> = workers.into_iter().collect();
        workers.sort_by_key(|(_, report)| report.sessions == 0);
        workers.truncate(WORKERS_LISTED_MAX);
        Ok(workers)
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
        let place = self.job_store.places(&[digest]).await?.pop().flatten();
        let Some(BlobPlace { bytes, .. }) = place else {
            return Err(FarmError::UnknownBlob(digest));
        };
        let blobs = self.context.blobs.clone();
        let read = task::spawn_blocking(move || {
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
}
