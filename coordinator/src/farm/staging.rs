//! Room for the images of jobs that are under way: reserved by their leases, given back when those
//! end.

use super::{Farm, FarmError};
use futures_util::{StreamExt, stream};
use imagestore::{
    blobs::StagedFile,
    staging::{Credential, Holder, LeaseOf, Sender},
};
use jobqueue::{Changes, Refusal, Selection, token::WorkerId};
use jobstore::JobStoreError;
use std::time::Duration;
use tokio::{
    task,
    time::{Instant, sleep},
};

impl Farm {
    /// Who has a lease.
    ///
    /// # Errors
    /// [`Refusal::LeaseLost`] where it is not current, and where the jobs cannot be looked at.
    pub(super) async fn lease_holder(&self, lease: LeaseOf) -> Result<WorkerId, FarmError> {
        let LeaseOf { material, token } = lease;
        let one = Selection::new(vec![(material, material)], Vec::new());
        let page = self.job_store.jobs(material, 1, &one).await?;
        let Some((_, job, _)) = page.jobs.first() else {
            return Err(JobStoreError::from(Refusal::UnknownMaterial(material)).into());
        };
        match job.state.holder() {
            Some(holder) if holder.token == token => Ok(holder.worker),
            _ => Err(JobStoreError::from(Refusal::LeaseLost(material)).into()),
        }
    }

    /// Reserves room for all images of a job, waiting up to `wait` for it.
    ///
    /// # Errors
    /// [`FarmError::StagingFull`] where there is none by then; the job keeps its place in line.
    /// As of [`Farm::lease_holder`].
    pub(super) async fn reserve(
        &self,
        lease: LeaseOf,
        credential: Credential,
        wait: Duration,
    ) -> Result<Sender, FarmError> {
        if let Some(sender) = self.context.staging().sender(lease) {
            return Ok(sender);
        }
        let worker = Some(self.lease_holder(lease).await?);
        let holder = Holder { credential, worker };
        let sender = Sender { lease, holder };
        let bytes = self.job_bytes_max(lease.material);
        let deadline = Instant::now() + wait;
        loop {
            let now = self.shared.now();
            if self.context.staging().reserve(sender, bytes, now) {
                return Ok(sender);
            }
            if Instant::now() >= deadline || *self.stopping.borrow() {
                return Err(FarmError::StagingFull(lease.material));
            }
            sleep(limits::STAGING_PAUSE).await;
        }
    }

    /// The most that the images of a material can have together, bytes.
    fn job_bytes_max(&self, material: u32) -> u64 {
        let expected = self.expected(material);
        expected.headers.len() as u64 * expected.bytes_max
    }

    /// Drops the images of leases that changes ended. The changes may be older than a job's current
    /// lease, whose images may be arriving; so each lease is looked up before its room ends.
    pub(super) async fn drop_ended(&self, changes: &Changes) {
        let mut doubtful = Vec::new();
        {
            let staging = self.context.staging();
            for change in &changes.jobs {
                let holder = change.record.state.holder();
                let current = holder.map(|holder| holder.token);
                let leases = staging.leases_of(change.material);
                doubtful.extend(leases.filter(|lease| Some(lease.token) != current));
            }
        }
        self.end_lapsed(doubtful).await;
    }

    /// Ends the room of those leases that are over.
    async fn end_lapsed(&self, leases: Vec<LeaseOf>) {
        let looked = stream::iter(leases).map(|lease| async move {
            let holder = self.lease_holder(lease).await;
            let over = matches!(holder, Err(FarmError::JobStore(JobStoreError::Refused(_))));
            over.then_some(lease)
        });
        let looked = looked.buffer_unordered(limits::STAGED_LEASES_CHECKED_AT_ONCE);
        let ended: Vec<Option<LeaseOf>> = looked.collect().await;
        let ended: Vec<LeaseOf> = ended.into_iter().flatten().collect();
        self.end_staging(&ended);
    }

    /// Ends the room of leases.
    pub(super) fn end_staging(&self, ended: &[LeaseOf]) {
        let now = self.shared.now();
        let mut files = Vec::new();
        for lease in ended {
            files.extend(self.context.staging().end(*lease, now));
        }
        self.discard(files);
    }

    /// Drops what leases had staged that ended without this coordinator's doing, and what others
    /// wait for too long.
    pub(super) async fn tend_staging(&self, now: Duration) {
        let unchecked = self.context.staging().take_unchecked(now);
        self.end_lapsed(unchecked).await;
        let stalled = self.context.staging().take_stalled(now);
        if !stalled.is_empty() {
            let images = stalled.len();
            tracing::warn!(images, "images that came too slowly make room for others");
        }
        self.discard(stalled);
    }

    /// Removes files of staging, whose unlinking nobody waits for.
    pub(super) fn discard(&self, files: Vec<StagedFile>) {
        if files.is_empty() {
            return;
        }
        let blobs = self.context.blobs.clone();
        task::spawn_blocking(move || files.iter().for_each(|file| blobs.discard(file)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{metrics::Metrics, options::Options, supervision::Supervisor};
    use dataset::{RENDERER_VERSION, Specification};
    use datastore::Store;
    use jobqueue::{JobChange, JobRecord};
    use std::sync::Arc;
    use tokio::sync::watch;

    /// Changes older than a job's current lease leave that lease its room. This happens when a job is
    /// leased for its second rendering before the coordinator has handled its first completion.
    #[tokio::test]
    async fn old_news_of_a_job_leave_the_room_of_its_next_lease() {
        let folder = tempfile::tempdir().unwrap();
        let mut specification = Specification::preset();
        specification.materials = 1;
        let hash = specification.hash();
        let store = Store::open_or_create(folder.path(), &specification).unwrap();
        let (_stop, stopping) = watch::channel(false);
        let mut supervisor = Supervisor::new(stopping.clone());
        let (options, metrics) = (Options::default(), Arc::<Metrics>::default());
        let farm = Farm::start(store.into(), &options, metrics, stopping, &mut supervisor);
        let (farm, _lock) = farm.await.unwrap();
        let name = "a".to_owned();
        let registered = farm.register(None, name, RENDERER_VERSION, hash);
        let worker = registered.await.unwrap();
        let leased = farm.lease(worker, 1, Duration::ZERO).await.unwrap();
        let (token, material) = leased.jobs[0];
        let lease = LeaseOf { material, token };
        farm.reserve(lease, None, Duration::ZERO).await.unwrap();

        let old_news = Changes {
            jobs: vec![JobChange {
                material: lease.material,
                record: JobRecord::default(),
            }],
            ..Changes::default()
        };
        farm.drop_ended(&old_news).await;
        assert!(farm.context.staging().sender(lease).is_some());
        farm.deregister(worker).await.unwrap();
        assert!(farm.context.staging().sender(lease).is_none());
    }
}
