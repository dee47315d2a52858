//! The operations of a job store, each handed to whoever does it.

use super::{Database, turns::Turns};
use dataset::Digest;
use jobqueue::{
    BlockCause, Changes, Fingerprint, Mode, Policy, Selection, Standing, WorkerChange,
    token::{Token, WorkerId},
};
use jobstore::{
    Decision, Delivery, Expired, Failed, JobStore, JobStoreContext, JobStoreError, JobsOrder,
    JobsPage, Leased, Meter, Renewal, Workers, ledger::BlobPlace,
};
use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};
use tokio::sync::{Notify, watch};

/// When workers that are not heard of count as gone, and how often idle ones are looked after.
#[derive(Clone, Copy, Debug)]
pub struct PresenceLimits {
    /// How long those who ask for work wait for each other after there was none.
    pub idle_pause: Duration,
    /// Before whoever knew it may dismiss it.
    pub dismissed_after: Duration,
    /// Before anybody forgets it.
    pub forgotten_after: Duration,
}

impl Default for PresenceLimits {
    fn default() -> Self {
        Self {
            dismissed_after: limits::WORKER_ABSENT,
            forgotten_after: 4 * limits::WORKER_ABSENT,
            idle_pause: limits::DATABASE_IDLE_PAUSE,
        }
    }
}

/// One coordinator's hold on the jobs in a database.
pub struct PostgresJobStore {
    shared: Arc<Shared>,
    turns: Turns,
    failure: watch::Sender<Option<String>>,
}

pub(super) struct Shared {
    pub(super) database: Database,
    pub(super) policy: Policy,
    pub(super) presence: PresenceLimits,
    pub(super) context: Arc<JobStoreContext>,
    pub(super) metrics: Arc<dyn Meter>,
    // Held from the look to the telling: nothing older is told after what was told.
    pub(super) telling: tokio::sync::Mutex<()>,
    // There may be work again.
    pub(super) offered: Notify,
    // Materials whose records cannot be read: nobody is given them.
    pub(super) unreadable: Mutex<BTreeSet<i64>>,
}

impl Shared {
    /// Wakes those who wait for a lease when there may be one.
    pub(super) fn after(&self, changes: &Changes) {
        let all = changes.mode.is_some();
        self.wake(if all {
            usize::MAX
        } else {
            changes.jobs_offered()
        });
    }

    /// Wakes one waiting caller for each of this many jobs.
    pub(super) fn wake(&self, jobs: usize) {
        if jobs > 0 {
            self.offered.notify_one();
            self.context.work.offer(jobs);
        }
    }

    /// How long a pause without a look for leases that ran out may be before nobody was there to
    /// renew them with.
    pub(super) fn gap_max(&self) -> Duration {
        let longest = limits::SWEEP_GAP_MAX;
        (self.policy.lease / 4).clamp(3 * limits::SWEEP_INTERVAL_MAX, longest)
    }

    /// Materials whose records cannot be read.
    pub(super) fn unreadable(&self) -> Vec<i64> {
        let unreadable = self.unreadable.lock();
        let unreadable = unreadable.unwrap_or_else(PoisonError::into_inner);
        unreadable.iter().copied().collect()
    }

    pub(super) fn pass_over(&self, materials: Vec<u32>) {
        let unreadable = self.unreadable.lock();
        let mut unreadable = unreadable.unwrap_or_else(PoisonError::into_inner);
        unreadable.extend(materials.into_iter().map(i64::from));
    }
}

/// A job store over a database whose schema is there, with the usual limits. Has to be called inside
/// a runtime.
///
/// # Errors
/// When the database does not answer.
pub async fn job_store(
    database: Database,
    policy: Policy,
    metrics: Arc<dyn Meter>,
    context: Arc<JobStoreContext>,
) -> Result<Arc<dyn JobStore>, JobStoreError> {
    let presence = PresenceLimits::default();
    let job_store = PostgresJobStore::new(database, policy, presence, metrics, context);
    job_store.publish_overview().await?;
    Ok(Arc::new(job_store))
}

impl PostgresJobStore {
    /// A job store over a database whose schema is there. Has to be called inside a runtime.
    pub fn new(
        database: Database,
        policy: Policy,
        presence: PresenceLimits,
        metrics: Arc<dyn Meter>,
        context: Arc<JobStoreContext>,
    ) -> Self {
        let shared = Arc::new(Shared {
            database,
            policy,
            presence,
            context,
            metrics,
            telling: tokio::sync::Mutex::default(),
            offered: Notify::new(),
            unreadable: Mutex::default(),
        });
        let failure = watch::channel(None).0;
        Self {
            turns: Turns::start(Arc::clone(&shared), failure.clone()),
            shared,
            failure,
        }
    }
}

#[async_trait::async_trait]
impl JobStore for PostgresJobStore {
    async fn admit(&self, worker: WorkerId, name: &str) -> Result<(), JobStoreError> {
        self.shared.admit(worker, name).await
    }

    async fn name(&self, worker: WorkerId) -> Result<Option<String>, JobStoreError> {
        self.shared.name(worker).await
    }

    async fn dismiss(&self, workers: &[WorkerId]) -> Result<(), JobStoreError> {
        self.shared.dismiss(workers).await
    }

    async fn claim(&self, worker: WorkerId, tokens: &[Token]) -> Result<Leased, JobStoreError> {
        self.turns.claim(worker, tokens).await
    }

    async fn renew(&self, renewals: &[Renewal]) -> Result<Vec<bool>, JobStoreError> {
        self.turns.renew(renewals).await
    }

    async fn standing(
        &self,
        material: u32,
        token: Token,
        fingerprint: Fingerprint,
    ) -> Result<Standing, JobStoreError> {
        self.turns.standing(material, token, fingerprint).await
    }

    async fn complete(&self, delivery: Delivery) -> Result<Decision, JobStoreError> {
        self.turns.complete(delivery).await
    }

    async fn fail(
        &self,
        material: u32,
        token: Token,
        error: &str,
    ) -> Result<Failed, JobStoreError> {
        self.shared.fail(material, token, error).await
    }

    async fn release(&self, worker: WorkerId) -> Result<Changes, JobStoreError> {
        self.shared.release(worker).await
    }

    async fn release_all(&self) -> Result<Changes, JobStoreError> {
        self.shared.release_all().await
    }

    async fn expire(&self) -> Result<Expired, JobStoreError> {
        self.shared.expire().await
    }

    async fn draw_audits(&self, seed: u64) -> Result<Changes, JobStoreError> {
        self.shared.draw_audits(seed).await
    }

    async fn order(
        &self,
        order: JobsOrder,
        selection: &Selection,
    ) -> Result<Changes, JobStoreError> {
        self.shared.order(order, selection).await
    }

    async fn set_mode(&self, mode: Mode) -> Result<Changes, JobStoreError> {
        self.shared.set_mode(mode).await
    }

    async fn block(
        &self,
        name: &str,
        cause: BlockCause,
        reason: String,
    ) -> Result<Changes, JobStoreError> {
        self.shared.block(name, cause, reason).await
    }

    async fn unblock(&self, name: &str) -> Result<Option<WorkerChange>, JobStoreError> {
        self.shared.unblock(name).await
    }

    async fn jobs(
        &self,
        from: u32,
        jobs_max: usize,
        selection: &Selection,
    ) -> Result<JobsPage, JobStoreError> {
        self.shared.jobs(from, jobs_max, selection).await
    }

    async fn workers(&self) -> Result<Workers, JobStoreError> {
        self.shared.workers().await
    }

    async fn places(&self, digests: &[Digest]) -> Result<Vec<Option<BlobPlace>>, JobStoreError> {
        self.shared.places(digests).await
    }

    async fn contents(&self) -> Result<Changes, JobStoreError> {
        self.shared.contents().await
    }

    async fn publish_overview(&self) -> Result<(), JobStoreError> {
        self.shared.publish_overview().await.map(|_| ())
    }

    // Every operation answers when it is durable.
    async fn settled(&self) -> Result<(), JobStoreError> {
        Ok(())
    }

    // The database comes back, or stays away; only a defect of this program is for good.
    fn failure(&self) -> watch::Receiver<Option<String>> {
        self.failure.subscribe()
    }

    fn close(&self) {
        self.shared.database.close();
    }
}
