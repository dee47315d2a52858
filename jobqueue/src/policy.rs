//! The limits that decide transitions.

use std::time::Duration;

/// The limits that decide the queue's transitions; [`limits`] has the defaults.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// How long a lease lives without renewal.
    pub lease: Duration,
    /// How long a lease is prolonged while its progress stands still, once its first view is done.
    pub stall: Duration,
    /// How long a lease is prolonged at all.
    pub deadline: Duration,
    /// Different workers on which a job fails before it is quarantined.
    pub workers_failed_max: u32,
    /// Failures after which a job is quarantined in a farm of fewer workers than that.
    pub failures_max: u32,
    /// Lost leases after which a job is quarantined.
    pub leases_lost_max: u32,
    /// The most leases of one worker.
    pub leases_per_worker_max: u32,
    /// Different jobs that a worker fails in a row before it is blocked.
    pub jobs_failed_max: u32,
    /// How long it then is.
    pub block: Duration,
    /// The first completions of an identity that another has to render again, whatever the draw
    /// says: those of a newcomer. 0 where nothing tells who is who.
    pub probation: u32,
    /// Completions of each identity that are drawn when no other work is left, for another to render
    /// again: a liar that waited until it was trusted is found before the set is finished.
    pub audits: u32,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            lease: limits::LEASE,
            stall: limits::STALL,
            deadline: limits::JOB_DEADLINE,
            workers_failed_max: limits::WORKERS_FAILED_MAX,
            failures_max: limits::FAILURES_MAX,
            leases_lost_max: limits::LEASES_LOST_MAX,
            leases_per_worker_max: limits::protocol::LEASES_PER_WORKER_MAX,
            jobs_failed_max: limits::JOBS_FAILED_MAX,
            block: limits::BLOCK,
            probation: 0,
            audits: 0,
        }
    }
}
