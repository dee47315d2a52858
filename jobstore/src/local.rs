//! The job store of one process: the queue in memory, its changes in a ledger, by group commit.
//!
//! The queue is behind one lock, which is held for microseconds and never over a wait. An operation
//! changes the queue and submits the change to the commit thread under the lock, then waits without
//! it until the change is durable, and only then answers.

use super::{
    Decision, Delivery, Expired, Failed, JobStore, JobStoreContext, JobStoreError, JobsOrder,
    JobsPage, Leased, Overview, Renewal, Session, Workers,
};
use crate::{
    commit::{Committer, Transition},
    completion_log::CompletionLog,
    group::Pending,
    ledger::{BlobPlace, Ledger},
    meter::Meter,
};
use dataset::Digest;
use imagestore::FileError;
use jobqueue::{
    BlockCause, Changes, Fingerprint, JobRecord, Look, Mode, Queue, Selection, Standing,
    WorkerChange,
    token::{Token, WorkerId},
};
use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError, atomic::Ordering},
    time::Duration,
};
use tokio::{sync::watch, task};

/// Tells the time since the start.
pub type Clock = Box<dyn Fn() -> Duration + Send + Sync>;

/// A queue, and the thread that makes its changes durable.
pub struct LocalJobStore {
    queue: Arc<Mutex<Queue>>,
    committer: Committer,
    ledger: Arc<dyn Ledger>,
    context: Arc<JobStoreContext>,
    clock: Clock,
}

fn lock(queue: &Mutex<Queue>) -> MutexGuard<'_, Queue> {
    // Nothing that runs under the lock panics half way through a change.
    queue.lock().unwrap_or_else(PoisonError::into_inner)
}

fn overview(queue: &Queue) -> Overview {
    let records = queue.worker_records();
    let blocked = records.filter(|(_, record)| record.block.is_some());
    Overview {
        counts: queue.counts(),
        mode: queue.mode(),
        workers_blocked: blocked.count() as u32,
        finished: queue.is_finished(),
    }
}

impl LocalJobStore {
    /// Starts the commit thread over a queue that holds what `ledger` kept.
    pub fn start(
        queue: Queue,
        log: CompletionLog,
        ledger: Arc<dyn Ledger>,
        metrics: Arc<dyn Meter>,
        context: Arc<JobStoreContext>,
        clock: Clock,
    ) -> Result<Self, FileError> {
        let queue = Arc::new(Mutex::new(queue));
        let committed = Arc::clone(&queue);
        let around = Arc::clone(&context);
        let room = context.blobs.room().clone();
        let committer = Committer::start(log, Arc::clone(&ledger), room, metrics, move || {
            let overview = overview(&lock(&committed));
            around.publish(overview);
        })?;
        let job_store = Self {
            queue,
            committer,
            ledger,
            context,
            clock,
        };
        job_store.publish(&job_store.lock());
        Ok(job_store)
    }

    /// A job store without a thread of its own, which tells its context only when it is asked to
    /// look.
    #[cfg(test)]
    pub fn without_thread(
        queue: Queue,
        log: CompletionLog,
        ledger: Arc<dyn Ledger>,
        context: Arc<JobStoreContext>,
        clock: Clock,
    ) -> Self {
        Self {
            queue: Arc::new(Mutex::new(queue)),
            committer: Committer::without_thread(log, Arc::clone(&ledger)),
            ledger,
            context,
            clock,
        }
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        lock(&self.queue)
    }

    /// Tells how the jobs stand, under their lock: nothing older is told after it.
    fn publish(&self, queue: &Queue) {
        self.context.publish(overview(queue));
    }

    fn now(&self) -> Duration {
        (self.clock)()
    }

    /// Submits changes, if there are any. Has to be called under the lock that they were made
    /// under.
    fn submit(&self, changes: &Changes) -> Option<Pending> {
        (!changes.is_empty()).then(|| {
            self.committer.submit(Transition {
                changes: changes.clone(),
                ..Transition::default()
            })
        })
    }

    /// Wakes those who wait for a lease when there may be one, or never will be again.
    fn after(&self, queue: &Queue, changes: &Changes) {
        if queue.is_finished() || changes.mode.is_some() {
            self.context.work.offer_to_all();
        } else {
            self.context.work.offer(changes.jobs_offered());
        }
    }

    /// Does one thing to a few jobs of a selection from a material on; returns where to go on.
    fn order_some(
        &self,
        order: JobsOrder,
        from: u32,
        selection: &Selection,
    ) -> (Changes, Option<u32>) {
        let mut queue = self.lock();
        let now = self.now();
        let (some, looks) = (limits::JOBS_ORDERED_AT_ONCE_MAX, limits::JOBS_LOOKED_AT_MAX);
        let Look { materials, next } = queue.look(from, selection, some, looks);
        let changes = match order {
            JobsOrder::Retry => queue.retry(materials, now),
            JobsOrder::Cancel => queue.cancel(materials, now),
            JobsOrder::Prioritize(priority) => queue.prioritize(materials, priority, now),
        };
        // Whoever asked waits for what is submitted last.
        drop(self.submit(&changes));
        self.after(&queue, &changes);
        (changes, next)
    }

    /// Adds a few jobs of a selection to a list, from a material on; returns where to go on.
    fn list_some(
        &self,
        from: u32,
        jobs_max: usize,
        selection: &Selection,
        jobs: &mut Vec<(u32, JobRecord, u32)>,
    ) -> Option<u32> {
        let queue = self.lock();
        let some = limits::JOBS_ORDERED_AT_ONCE_MAX.min(jobs_max - jobs.len());
        let look = queue.look(from, selection, some, limits::JOBS_LOOKED_AT_MAX);
        for material in look.materials {
            if let Some(job) = queue.job(material) {
                let views_done = queue.views_done(material).unwrap_or(0);
                jobs.push((material, job.clone(), views_done));
            }
        }
        look.next
    }

    /// Changes the queue, durably.
    async fn operate(
        &self,
        change: impl FnOnce(&mut Queue, Duration) -> Changes + Send,
    ) -> Result<Changes, JobStoreError> {
        let (changes, pending) = {
            let mut queue = self.lock();
            let changes = change(&mut queue, self.now());
            let pending = self.submit(&changes);
            self.after(&queue, &changes);
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

#[async_trait::async_trait]
impl JobStore for LocalJobStore {
    async fn admit(&self, worker: WorkerId, name: &str) -> Result<(), JobStoreError> {
        let mut queue = self.lock();
        queue.admit(worker, name);
        self.publish(&queue);
        Ok(())
    }

    async fn name(&self, worker: WorkerId) -> Result<Option<String>, JobStoreError> {
        Ok(self.lock().name(worker).map(str::to_owned))
    }

    async fn dismiss(&self, workers: &[WorkerId]) -> Result<(), JobStoreError> {
        let mut queue = self.lock();
        for worker in workers {
            if !queue.holds(*worker) {
                queue.dismiss(*worker);
            }
        }
        self.publish(&queue);
        Ok(())
    }

    async fn claim(&self, worker: WorkerId, tokens: &[Token]) -> Result<Leased, JobStoreError> {
        // A lease that cannot be recorded would run out before its holder hears of it.
        self.context.blobs.room().for_records()?;
        let (leased, pending) = {
            let mut queue = self.lock();
            let name = queue.name(worker).map(str::to_owned);
            let finished = match &name {
                Some(name) => queue.is_finished_for(name),
                None => queue.is_finished(),
            };
            let draining = queue.mode() == Mode::Draining;
            if finished || draining {
                return Ok(Leased {
                    name,
                    finished,
                    draining,
                    ..Leased::default()
                });
            }
            let changes = queue.claim(worker, tokens, self.now());
            let pending = self.submit(&changes);
            let materials = changes.jobs.iter().map(|change| change.material);
            let block = name.as_ref().and_then(|name| queue.block_of(name));
            let leased = Leased {
                jobs: tokens.iter().copied().zip(materials).collect(),
                blocked: block.map(|block| block.reason.clone()),
                name,
                ..Leased::default()
            };
            (leased, pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(leased)
    }

    async fn renew(&self, renewals: &[Renewal]) -> Result<Vec<bool>, JobStoreError> {
        let mut queue = self.lock();
        let now = self.now();
        let renewed = renewals.iter().map(|renewal| {
            let Renewal {
                token,
                material,
                views_done,
            } = *renewal;
            queue.renew(material, token, views_done, now)
        });
        Ok(renewed.collect())
    }

    async fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Fingerprint,
    ) -> Result<Standing, JobStoreError> {
        Ok(self.lock().standing(material, token, fingerprint)?)
    }

    // Even where nothing changes something is submitted: the first of two equal completions may
    // still be on its way to the disk, and the second has to wait for it.
    async fn complete(&self, delivery: Delivery) -> Result<Decision, JobStoreError> {
        let Delivery {
            token,
            mut completion,
            check,
        } = delivery;
        let material = completion.material;
        let fingerprint = completion.fingerprint();
        let (decision, pending) = {
            let mut queue = self.lock();
            if queue.would_record(material, token, fingerprint)
                && self.context.staging().awaits_publication(&completion)
            {
                return Err(JobStoreError::Unpublished(material));
            }
            let holder = queue.holder(material).cloned();
            let (verdict, changes) =
                queue.complete(material, token, fingerprint, check, self.now())?;
            let mut transition = Transition {
                changes: changes.clone(),
                ..Transition::default()
            };
            if verdict.records()
                && let Some(holder) = &holder
            {
                self.context.note_recorded(&completion);
                completion.worker.clone_from(&holder.name);
                transition.completion = Some(completion);
            }
            self.after(&queue, &changes);
            let pending = self.committer.submit(transition);
            let decision = Decision {
                verdict,
                holder,
                changes,
            };
            (decision, pending)
        };
        pending.durable().await?;
        Ok(decision)
    }

    async fn fail(
        &self,
        material: u32,
        token: Token,
        error: &str,
    ) -> Result<Failed, JobStoreError> {
        let (failed, pending) = {
            let mut queue = self.lock();
            let holder = queue.holder(material);
            let worker = holder.map(|holder| holder.name.clone());
            let changes = queue.fail(material, token, error, self.now())?;
            self.context.failures.fetch_add(1, Ordering::Relaxed);
            let pending = self.submit(&changes);
            self.after(&queue, &changes);
            let failed = Failed {
                worker: worker.unwrap_or_default(),
                changes,
            };
            (failed, pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(failed)
    }

    async fn release(&self, worker: WorkerId) -> Result<Changes, JobStoreError> {
        let (changes, pending) = {
            let mut queue = self.lock();
            let changes = queue.release(worker, self.now());
            queue.dismiss(worker);
            let pending = self.submit(&changes);
            self.after(&queue, &changes);
            self.publish(&queue);
            (changes, pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(changes)
    }

    async fn release_all(&self) -> Result<Changes, JobStoreError> {
        self.operate(Queue::release_all).await
    }

    async fn expire(&self) -> Result<Expired, JobStoreError> {
        let (expired, pending) = {
            let mut queue = self.lock();
            let now = self.now();
            let (changes, lost) = queue.expire(now);
            let lost_count = &self.context.leases_lost;
            lost_count.fetch_add(lost.len() as u64, Ordering::Relaxed);
            let pending = self.submit(&changes);
            self.after(&queue, &changes);
            if !changes.workers.is_empty() {
                // A block may have ended.
                self.context.work.offer_to_all();
            }
            let next = queue.next_expiry();
            let expired = Expired {
                changes,
                lost,
                next: next.map(|next| next.saturating_sub(now)),
            };
            (expired, pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(expired)
    }

    async fn draw_audits(&self, seed: u64) -> Result<Changes, JobStoreError> {
        let (changes, pending) = {
            let mut queue = self.lock();
            let changes = queue.draw_audits(seed, self.now());
            let pending = self.submit(&changes);
            self.after(&queue, &changes);
            (changes, pending)
        };
        if let Some(pending) = pending {
            pending.durable().await?;
        }
        Ok(changes)
    }

    async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Changes, JobStoreError> {
        let mut all = Changes::default();
        let selection = selection.only(order.stages());
        let mut from = selection.as_ref().map(|_| 0);
        while let (Some(start), Some(selection)) = (from, &selection) {
            let (changes, next) = self.order_some(order, start, selection);
            all.extend(changes);
            from = next;
            task::yield_now().await;
        }
        // What is submitted last is durable last; what was so before may still be on its way.
        self.settled().await?;
        Ok(all)
    }

    async fn set_mode(&self, mode: Mode) -> Result<Changes, JobStoreError> {
        self.operate(|queue, _| queue.set_mode(mode)).await
    }

    async fn block(
        &self,
        name: &str,
        cause: BlockCause,
        reason: String,
    ) -> Result<Changes, JobStoreError> {
        self.operate(|queue, now| queue.block(name, cause, reason, now))
            .await
    }

    async fn unblock(&self, name: &str) -> Result<Option<WorkerChange>, JobStoreError> {
        let changes = self.operate(|queue, _| Changes {
            workers: queue.unblock(name).into_iter().collect(),
            ..Changes::default()
        });
        let change = changes.await?.workers.pop();
        self.context.work.offer_to_all();
        Ok(change)
    }

    async fn jobs(
        &self,
        from: u32,
        jobs_max: usize,
        selection: &Selection,
    ) -> Result<JobsPage, JobStoreError> {
        let mut page = JobsPage {
            jobs: Vec::new(),
            next: Some(from),
        };
        for _ in 0..limits::JOBS_LOOKS_PER_CALL {
            let (Some(from), true) = (page.next, page.jobs.len() < jobs_max) else {
                break;
            };
            page.next = self.list_some(from, jobs_max, selection, &mut page.jobs);
            task::yield_now().await;
        }
        Ok(page)
    }

    async fn workers(&self) -> Result<Workers, JobStoreError> {
        let queue = self.lock();
        let records = queue.worker_records();
        let sessions = queue.sessions();
        Ok(Workers {
            records: records
                .map(|(name, record)| (name.to_owned(), record.clone()))
                .collect(),
            sessions: sessions
                .map(|(worker, name)| Session {
                    worker,
                    name: name.to_owned(),
                    held: queue.held(worker),
                })
                .collect(),
        })
    }

    async fn places(&self, digests: &[Digest]) -> Result<Vec<Option<BlobPlace>>, JobStoreError> {
        let ledger = Arc::clone(&self.ledger);
        let digests = digests.to_vec();
        let places = task::spawn_blocking(move || {
            let places = digests.iter().map(|digest| ledger.blob(digest));
            places.collect::<Result<Vec<_>, _>>()
        });
        match places.await {
            Ok(places) => Ok(places?),
            Err(_) => Err(JobStoreError::Interrupted),
        }
    }

    async fn contents(&self) -> Result<Changes, JobStoreError> {
        Ok(self.ledger.contents()?)
    }

    async fn publish_overview(&self) -> Result<(), JobStoreError> {
        self.publish(&self.lock());
        Ok(())
    }

    async fn settled(&self) -> Result<(), JobStoreError> {
        let nothing = self.committer.submit(Transition::default());
        Ok(nothing.durable().await?)
    }

    fn failure(&self) -> watch::Receiver<Option<String>> {
        self.committer.failure()
    }

    fn close(&self) {
        self.committer.close();
    }
}
