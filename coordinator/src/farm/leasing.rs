//! Workers come, lease, renew, fail and go.

use super::{
    Farm, FarmError, State,
    events::{Event, EventKind},
    random,
};
use crate::{
    commit::NotDurable,
    limits,
    queue::{Changes, JobState, Mode},
    token::{Token, WorkerId},
};
use dataset::{Digest, RENDERER_VERSION};
use proto::limits::{JOBS_PER_CALL_MAX, LEASE_WAIT_MAX};
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// What a worker that asks for work is told.
#[derive(Debug, Default)]
pub(crate) struct Leased {
    pub jobs: Vec<(Token, u32)>,
    /// Nothing is left to do, now or later.
    pub finished: bool,
    /// The farm is being drained.
    pub draining: bool,
    /// Why this worker gets nothing.
    pub barred: Option<String>,
}

impl Farm {
    pub fn register(
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
            Some(worker) => worker,
            None => WorkerId::from_bytes(random()?),
        };
        let mut state = self.shared.lock();
        let now = self.shared.now();
        if !state.roster.register(worker, name.clone(), now) {
            return Err(FarmError::TooManyWorkers(limits::WORKERS_MAX));
        }
        state.queue.admit(worker, &name);
        // A worker of another name may be what a second rendering waits for.
        self.shared.work.notify_waiters();
        self.shared.publish(&state);
        drop(state);
        let event = Event::new(EventKind::Registered).worker(name);
        self.tell(event.text(format!("as {worker}")));
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
        loop {
            // Listening begins before looking, so that nothing is missed in between.
            let work = self.shared.work.notified();
            tokio::pin!(work);
            work.as_mut().enable();
            let (name, changes, pending) = {
                let mut state = self.shared.lock();
                let now = self.shared.now();
                if !state.roster.heard_of(worker, now) {
                    return Err(FarmError::UnknownWorker(worker));
                }
                if *stopping.borrow() {
                    return Ok(Leased::default());
                }
                if let Some(answer) = nothing_to_wait_for(&state) {
                    return Ok(answer);
                }
                let changes = state.queue.claim(worker, &tokens, now);
                let name = state.roster.name(worker);
                let pending = self.submit(&changes);
                (name, changes, pending)
            };
            if let Some(pending) = pending {
                pending.durable().await?;
                let jobs: Vec<(Token, u32)> = tokens
                    .iter()
                    .zip(&changes.jobs)
                    .map(|(token, change)| (*token, change.material))
                    .collect();
                self.metrics.note_leases(jobs.len());
                self.tell_leased(&name, &jobs);
                return Ok(Leased {
                    jobs,
                    ..Leased::default()
                });
            }
            tokio::select! {
                woken = timeout_at(deadline, work) => if woken.is_err() {
                    return Ok(self.waited_in_vain(&name));
                },
                _ = stopping.wait_for(|stopping| *stopping) => {}
            }
        }
    }

    /// Prolongs leases; returns the materials whose lease is lost.
    pub fn renew(&self, worker: WorkerId, renewals: &[(Token, u32, u32)]) -> Vec<u32> {
        let mut state = self.shared.lock();
        let now = self.shared.now();
        state.roster.heard_of(worker, now);
        renewals
            .iter()
            .filter(|(token, material, views_done)| {
                !state.queue.renew(*material, *token, *views_done, now)
            })
            .map(|(_, material, _)| *material)
            .collect()
    }

    /// Records that a holder could not render its material. True when it is set aside now.
    pub async fn fail(
        &self,
        token: Token,
        material: u32,
        error: String,
    ) -> Result<bool, FarmError> {
        let (changes, name, pending) = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            let holder = state.queue.holder(material);
            let name = holder.map(|holder| holder.name.clone());
            let changes = state.queue.fail(material, token, &error, now)?;
            state.failures += 1;
            let pending = self.submit(&changes);
            self.after(&state, &changes);
            (changes, name.unwrap_or_default(), pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        let event = Event::new(EventKind::Failed).material(material);
        self.tell(event.worker(name).lease(token).text(error));
        Ok(self.tell_troubles(&changes).contains(&material))
    }

    /// Lets a worker go; returns how many leases went back.
    pub async fn deregister(&self, worker: WorkerId) -> Result<u32, FarmError> {
        let (name, released, pending) = {
            let mut state = self.shared.lock();
            let changes = state.queue.release(worker, self.shared.now());
            let name = state.roster.remove(worker);
            state.queue.dismiss(worker);
            let pending = self.submit(&changes);
            self.after(&state, &changes);
            self.shared.publish(&state);
            (name, changes.jobs.len() as u32, pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        if let Some(name) = name {
            let event = Event::new(EventKind::Left).worker(name);
            self.tell(event.text(format!("handing back {released}")));
        }
        Ok(released)
    }

    /// Takes back leases that ran out, lifts bars that did, and drops images that nobody
    /// completed. Returns how long it can be before the next call.
    pub async fn sweep(&self) -> Result<Duration, NotDurable> {
        let (changes, lost, pending, pause) = {
            let mut state = self.shared.lock();
            let now = self.shared.now();
            let (changes, lost) = state.queue.expire(now);
            state.leases_lost += lost.len() as u64;
            state.staging.drop_old(now, &self.blobs);
            let State { queue, roster, .. } = &mut *state;
            let forgotten = roster.forget_absent(now, |worker| queue.holds(worker));
            for worker in &forgotten {
                queue.dismiss(*worker);
            }
            let pending = self.submit(&changes);
            self.after(&state, &changes);
            if !forgotten.is_empty() {
                self.shared.publish(&state);
            }
            let next = state.queue.next_expiry().unwrap_or(Duration::MAX);
            // Leases that are handed out during the pause run out no sooner than this.
            let longest = limits::SWEEP_INTERVAL_MAX.min(self.policy.lease);
            let pause = next.saturating_sub(now).min(longest);
            (changes, lost, pending, pause)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        for lease in lost {
            let event = Event::new(EventKind::LeaseLost).material(lease.material);
            self.tell(event.worker(lease.holder.name).lease(lease.holder.token));
        }
        self.tell_troubles(&changes);
        Ok(pause)
    }

    fn waited_in_vain(&self, name: &str) -> Leased {
        let state = self.shared.lock();
        let bar = state.queue.bar_of(name);
        Leased {
            barred: bar.map(|bar| bar.reason.clone()),
            ..Leased::default()
        }
    }

    fn tell_leased(&self, name: &str, jobs: &[(Token, u32)]) {
        for (token, material) in jobs {
            let event = Event::new(EventKind::Leased).material(*material);
            self.tell(event.worker(name).lease(token));
        }
    }

    /// Tells of workers that were barred and jobs that were set aside; returns the latter.
    pub(super) fn tell_troubles(&self, changes: &Changes) -> Vec<u32> {
        let mut set_aside = Vec::new();
        for change in &changes.jobs {
            if change.record.state == JobState::SetAside {
                set_aside.push(change.material);
                self.tell(Event::new(EventKind::SetAside).material(change.material));
            }
        }
        for change in &changes.workers {
            if let Some(bar) = &change.record.bar {
                let event = Event::new(EventKind::Barred).worker(&change.name);
                self.tell(event.text(&bar.reason));
            }
        }
        set_aside
    }
}

fn nothing_to_wait_for(state: &State) -> Option<Leased> {
    let finished = state.queue.is_finished();
    let draining = state.queue.mode() == Mode::Draining;
    (finished || draining).then(|| Leased {
        finished,
        draining,
        ..Leased::default()
    })
}
