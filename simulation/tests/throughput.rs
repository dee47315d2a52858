//! What 1,000 workers get from one coordinator, beside what `tests/throughput.sh` measured on the
//! machine whose service times are in `costs`. Those were measured with 64 clients at most;
//! docs/scaling.md says what that is worth.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

use simulation::{farm::Farm, simulate};
use std::time::Duration;

/// The prediction is off by less than a fifth.
fn within_a_fifth(farm: Farm, measured: f64) {
    let materials = farm.materials;
    let (figures, queue) = simulate(farm).unwrap();
    assert_eq!(queue.counts().completed, materials);
    let off = figures.jobs_per_second / measured - 1.0;
    assert!(off.abs() < 0.2, "{off:+.2} of {measured}\n{figures}");
}

#[test]
fn jobs_of_one_small_image() {
    // Runs on an idle machine gave 4,279 to 4,634.
    within_a_fifth(Farm::of_throughput(40_000, 1, 16, Duration::ZERO), 4_290.0);
}

#[test]
fn jobs_that_take_a_second() {
    let second = Duration::from_secs(1);
    within_a_fifth(Farm::of_throughput(20_000, 1, 16, second), 892.0);
}

#[test]
fn jobs_as_the_preset_has_them() {
    within_a_fifth(Farm::of_throughput(3_000, 14, 128, Duration::ZERO), 413.0);
}
