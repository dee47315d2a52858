//! What a job store needs of the farm around it: staged images, and whom to tell.

use super::Overview;
use imagestore::{
    blobs::{Blobs, StagedFile},
    staging::Staging,
};
use std::sync::{Mutex, MutexGuard, PoisonError, atomic::AtomicU64};
use tokio::sync::Notify;

type Changed = dyn Fn(&JobStoreContext, Overview) + Send + Sync;

/// Shared by a job store and its farm. A job store counts before it tells how the jobs stand, so
/// that what is told and what is counted agree.
pub struct JobStoreContext {
    /// The images.
    pub blobs: Blobs,
    /// Somebody who waits for work should look again.
    pub work: Notify,
    /// Bytes of images completed since the start.
    pub bytes_received: AtomicU64,
    /// Failures that workers reported since the start.
    pub failures: AtomicU64,
    /// Leases that ran out since the start.
    pub leases_lost: AtomicU64,
    staging: Mutex<Staging>,
    changed: Box<Changed>,
}

impl JobStoreContext {
    /// `changed` is told how the jobs stand whenever that may have changed.
    pub fn new(blobs: Blobs, changed: impl Fn(&Self, Overview) + Send + Sync + 'static) -> Self {
        Self {
            blobs,
            work: Notify::new(),
            bytes_received: AtomicU64::new(0),
            failures: AtomicU64::new(0),
            leases_lost: AtomicU64::new(0),
            staging: Mutex::default(),
            changed: Box::new(changed),
        }
    }

    // Nothing that runs under the lock panics half way through a change.
    /// The staged images, locked.
    pub fn staging(&self) -> MutexGuard<'_, Staging> {
        self.staging.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets images that have been published.
    pub fn forget(&self, images: &[StagedFile]) {
        if !images.is_empty() {
            self.staging().forget(images);
        }
    }

    /// Tells how the jobs stand.
    pub fn publish(&self, overview: Overview) {
        (self.changed)(self, overview);
    }
}
