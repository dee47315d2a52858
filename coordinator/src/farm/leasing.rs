//! Workers come, lease, renew, fail and go.

use super::{
    Farm, FarmError,
    events::{Event, EventKind},
    random,
};
use dataset::{Digest, RENDERER_VERSION};
use imagestore::staging::LeaseOf;
use jobqueue::{
    Changes, JobState,
    identity::identity,
    token::{Token, WorkerId},
};
use jobstore::{Failed, JobStoreError, Leased, Overview, Renewal, Waiter};
use limits::protocol::{JOBS_PER_CALL_MAX, LEASE_WAIT_MAX};
use std::{collections::HashSet, time::Duration};
use tokio::time::{Instant, timeout_at};

impl Farm {
    pub async fn register(
        &self,
        known: Option<WorkerId>,
        name: String,
        renderer_version: &str,
        specification_hash: Digest,
    ) -> Result<WorkerId, FarmError> {
        if renderer_version != RENDERER_VERSION {
            return Err(FarmError::Incompatible(format!(
                "this worker renders with version {renderer_version:?} and the dataset needs \
                 version {RENDERER_VERSION:?}: install the brdfarm that the coordinator runs"
            )));
        }
        if specification_hash != self.specification_hash {
            return Err(FarmError::Incompatible(format!(
                "this worker reads the specification as {specification_hash} and the coordinator \
                 as {}: install the brdfarm that the coordinator runs",
                self.specification_hash
            )));
        }
        let worker = match known {
            Some(worker) => {
                // An id that leaked is no way to work in somebody else's name.
                let before = self.job_store.name(worker).await?;
                if before.is_some_and(|before| identity(&before) != identity(&name)) {
                    return Err(FarmError::NotItsId(worker));
                }
                worker
            }
            None => WorkerId::from_bytes(random()?),
        };
        self.enroll(worker)?;
        self.job_store.admit(worker, &name).await?;
        let event = Event::new(EventKind::Registered).worker(name);
        self.emit(event.text(format!("as {worker}")));
        Ok(worker)
    }

    /// Leases up to `jobs_max` jobs, waiting up to `wait` for the first.
    pub async fn lease(
        &self,
        worker: WorkerId,
        jobs_max: u32,
        wait: Duration,
    ) -> Result<Leased, FarmError> {
        let deadline = Instant::now() + wait.min(LEASE_WAIT_MAX);
        let tokens = (0..jobs_max.min(JOBS_PER_CALL_MAX))
            .map(|_| Ok(Token::from_bytes(random()?)))
            .collect::<Result<Vec<Token>, FarmError>>()?;
        let mut stopping = self.stopping.clone();
        self.hear_of(worker).await?;
        // The wake-up that led to this look: where it finds nothing others are woken.
        let mut woken: Option<Waiter> = None;
        loop {
            // Listening begins before looking, so that nothing is missed in between.
            let waiter = self.context.work.wait();
            if *stopping.borrow() {
                return Ok(Leased::default());
            }
            // Nothing is rendered that could not be taken in.
            self.context.blobs.check_room()?;
            let leased = self.job_store.claim(worker, &tokens).await?;
            let Some(name) = &leased.name else {
                self.shared.lock().presence.remove(worker);
                return Err(FarmError::UnknownWorker(worker));
            };
            if !leased.jobs.is_empty() {
                self.metrics.note_leases(leased.jobs.len());
                self.tell_leased(name, &leased.jobs);
                waiter.used();
                if let Some(woken) = woken {
                    woken.used();
                }
                return Ok(leased);
            }
            if leased.finished || leased.draining {
                return Ok(leased);
            }
            drop(woken);
            tokio::select! {
                rung = timeout_at(deadline, waiter.woken()) => if rung.is_err() {
                    return Ok(leased);
                },
                _ = stopping.wait_for(|stopping| *stopping) => {}
            }
            woken = Some(waiter);
            self.hear_of(worker).await?;
        }
    }

    /// Prolongs leases; returns the materials whose lease is lost.
    pub async fn renew(
        &self,
        worker: WorkerId,
        renewals: &[Renewal],
    ) -> Result<Vec<u32>, FarmError> {
        self.shared
            .lock()
            .presence
            .heard_of(worker, self.shared.now());
        let renewed = self.job_store.renew(renewals).await?;
        let lost = renewals.iter().zip(renewed);
        let lost = lost.filter(|(_, renewed)| !renewed);
        Ok(lost.map(|(renewal, _)| renewal.material).collect())
    }

    /// Records that a holder could not render its material. True when it is quarantined now.
    pub async fn fail(
        &self,
        token: Token,
        material: u32,
        error: String,
    ) -> Result<bool, FarmError> {
        let Failed { worker, changes } = self.job_store.fail(material, token, &error).await?;
        self.end_staging(&[LeaseOf { material, token }]);
        self.drop_ended(&changes).await;
        let event = Event::new(EventKind::Failed).material(material);
        self.emit(event.worker(worker).lease(token).text(error));
        Ok(self.tell_troubles(&changes).contains(&material))
    }

    /// Lets a worker go; returns how many leases went back.
    pub async fn deregister(&self, worker: WorkerId) -> Result<u32, FarmError> {
        let name = self.job_store.name(worker).await?;
        let changes = self.job_store.release(worker).await?;
        self.drop_ended(&changes).await;
        let released = changes.jobs.len() as u32;
        {
            let mut state = self.shared.lock();
            state.presence.remove(worker);
            self.publish(&state);
        }
        if let Some(name) = name {
            let event = Event::new(EventKind::Left).worker(name);
            self.emit(event.text(format!("handing back {released}")));
        }
        Ok(released)
    }

    /// Takes back leases that ran out, lifts blocks that did, forgets workers that are gone, and
    /// drops images whose lease is over. Returns how long it can be before the next call.
    pub async fn sweep(&self) -> Result<Duration, JobStoreError> {
        let now = self.shared.now();
        self.tend_staging(now).await;
        let expired = self.job_store.expire().await?;
        self.drop_ended(&expired.changes).await;
        self.draw_audits().await?;
        self.forget_absent(now).await?;
        for lease in expired.lost {
            let event = Event::new(EventKind::LeaseLost).material(lease.material);
            self.emit(event.worker(lease.holder.name).lease(lease.holder.token));
        }
        self.tell_troubles(&expired.changes);
        // Leases that are handed out during the pause run out no sooner than this.
        let longest = limits::SWEEP_INTERVAL_MAX.min(self.policy.lease);
        Ok(expired.next.unwrap_or(longest).min(longest))
    }

    /// Where no job waits or is under way: has some completions of each identity rendered again.
    async fn draw_audits(&self) -> Result<(), JobStoreError> {
        let Overview {
            counts, finished, ..
        } = self.shared.lock().overview;
        let busy = counts.pending + counts.leased > 0;
        if self.policy.audits == 0 || finished || busy {
            return Ok(());
        }
        let seed = match random() {
            Ok(bytes) => u64::from_ne_bytes(bytes),
            Err(error) => {
                tracing::warn!(%error, "completions to be audited are drawn later");
                return Ok(());
            }
        };
        let drawn = self.job_store.draw_audits(seed).await?;
        for change in &drawn.jobs {
            let event = Event::new(EventKind::Audited).material(change.material);
            self.emit(event.text("another worker renders it again before the set is finished"));
        }
        Ok(())
    }

    /// Forgets workers that were not heard of for long and hold nothing.
    async fn forget_absent(&self, now: Duration) -> Result<(), JobStoreError> {
        let absent = self.shared.lock().presence.absent(now);
        if absent.is_empty() {
            return Ok(());
        }
        let workers = self.job_store.workers().await?;
        let holding = workers.sessions.iter().filter(|session| session.held > 0);
        let holding: HashSet<WorkerId> = holding.map(|session| session.worker).collect();
        let idle = absent
            .into_iter()
            .filter(|worker| !holding.contains(worker));
        let idle: Vec<WorkerId> = idle.collect();
        if idle.is_empty() {
            return Ok(());
        }
        {
            let mut state = self.shared.lock();
            for worker in &idle {
                state.presence.remove(*worker);
            }
        }
        self.job_store.dismiss(&idle).await
    }

    /// Notes that a worker called. One that this process has not heard of is looked up: it may have
    /// registered with another.
    async fn hear_of(&self, worker: WorkerId) -> Result<(), FarmError> {
        let now = self.shared.now();
        if self.shared.lock().presence.heard_of(worker, now) {
            return Ok(());
        }
        match self.job_store.name(worker).await? {
            Some(_) => self.enroll(worker),
            None => Err(FarmError::UnknownWorker(worker)),
        }
    }

    fn enroll(&self, worker: WorkerId) -> Result<(), FarmError> {
        let mut state = self.shared.lock();
        let now = self.shared.now();
        if !state.presence.register(worker, now) {
            return Err(FarmError::TooManyWorkers(limits::WORKERS_MAX));
        }
        self.publish(&state);
        Ok(())
    }

    fn tell_leased(&self, name: &str, jobs: &[(Token, u32)]) {
        for (token, material) in jobs {
            let event = Event::new(EventKind::Leased).material(*material);
            self.emit(event.worker(name).lease(token));
        }
    }

    /// Tells of workers that were blocked and jobs that were quarantined; returns the latter.
    pub(super) fn tell_troubles(&self, changes: &Changes) -> Vec<u32> {
        let mut quarantined = Vec::new();
        for change in &changes.jobs {
            if change.record.state == JobState::Quarantined {
                quarantined.push(change.material);
                self.emit(Event::new(EventKind::Quarantined).material(change.material));
            }
        }
        for change in &changes.workers {
            if let Some(block) = &change.record.block {
                let event = Event::new(EventKind::Blocked).worker(&change.name);
                self.emit(event.text(&block.reason));
            }
        }
        quarantined
    }
}
