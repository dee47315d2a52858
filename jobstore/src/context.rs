//! What a job store needs of the farm around it: staged images, and whom to tell.

use super::{Overview, work::Work};
use imagestore::{
    blobs::{Blobs, StagedFile},
    staging::Staging,
};
use jobqueue::Completion;
use std::sync::{
    Mutex, MutexGuard, PoisonError,
    atomic::{AtomicU64, Ordering},
};

type Changed = dyn Fn(&JobStoreContext, Overview) + Send + Sync;

/// Shared by a job store and its farm. A job store counts before it tells how the jobs stand, so
/// that what is told and what is counted agree.
pub struct JobStoreContext {
    /// The images.
    pub blobs: Blobs,
    /// Those who wait for work.
    pub work: Work,
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
            work: Work::default(),
            bytes_received: AtomicU64::new(0),
            failures: AtomicU64::new(0),
            leases_lost: AtomicU64::new(0),
            staging: Mutex::default(),
            changed: Box::new(changed),
        }
    }

    /// The same, with room for staged images of `bytes_max` bytes together.
    #[must_use]
    pub fn staging_at_most(self, bytes_max: u64) -> Self {
        Self {
            staging: Mutex::new(Staging::of(bytes_max)),
            ..self
        }
    }

    // Nothing that runs under the lock panics half way through a change.
    /// The staged images, locked.
    pub fn staging(&self) -> MutexGuard<'_, Staging> {
        self.staging.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes that a completion is recorded: its images are the job's now, and no longer staged.
    pub fn note_recorded(&self, completion: &Completion) {
        self.staging().forget_published(completion);
        self.bytes_received
            .fetch_add(completion.bytes(), Ordering::Relaxed);
    }

    /// Drops staged images, which are to be sent again, with their files.
    pub fn drop_staged(&self, files: &[StagedFile]) {
        self.staging().forget(files);
        for file in files {
            self.blobs.discard(file);
        }
    }

    /// Tells how the jobs stand.
    pub fn publish(&self, overview: Overview) {
        (self.changed)(self, overview);
    }
}
