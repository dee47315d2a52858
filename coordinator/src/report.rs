//! How the farm is, and how far.

use jobqueue::{Counts, Mode};
use std::time::Duration;

/// How far a coordinator is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Materials by state.
    pub counts: Counts,
    /// Images of completed materials.
    pub images: u64,
    /// Bytes of the images completed since the start.
    pub bytes_received: u64,
    /// Workers heard of lately.
    pub workers: u32,
    /// Failures reported by workers since the start.
    pub failures: u64,
    /// Leases that ran out since the start.
    pub leases_lost: u64,
    /// Whether nothing is left to do, now or later.
    pub finished: bool,
}

impl Progress {
    /// Whether nothing is left to do: every material is complete, quarantined or cancelled, and every
    /// second rendering that can be had is done.
    pub fn is_finished(&self) -> bool {
        self.finished
    }
}

/// How the farm is.
#[derive(Debug, Default)]
pub(crate) struct Report {
    pub progress: Progress,
    pub mode: Mode,
    pub workers_blocked: u32,
    pub images_per_second: f64,
    pub store_bytes: u64,
    pub up: Duration,
}
