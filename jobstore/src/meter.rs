//! Whom a job store tells how long its work took.

use std::time::Duration;

/// Is told how long it took to make things durable. Called by the threads that do.
pub trait Meter: Send + Sync {
    /// A batch of images was published under their names.
    fn note_publication(&self, time: Duration);

    /// A batch of this many transitions became durable.
    fn note_commit(&self, time: Duration, transitions: usize);
}

/// Notes nothing.
impl Meter for () {
    fn note_publication(&self, _: Duration) {}

    fn note_commit(&self, _: Duration, _: usize) {}
}
