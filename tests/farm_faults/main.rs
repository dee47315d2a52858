//! Faults, done to real processes: kill, freeze, cut, delay, fill.
//!
//! Every run that draws at random prints its seed; `BRDFARM_SEED` repeats it.

#![allow(
    clippy::print_stdout,
    reason = "seeds and counts are what these runs are for"
)]

mod bucket;
mod bucket_scale;
mod campaign;
mod faults;
mod harness;
mod liar;
mod power;
mod proxy;
mod s3;
