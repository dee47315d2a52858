//! Faults, done to real processes: kill, freeze, cut, delay, fill.
//!
//! Every run that draws at random prints its seed; `BRDFARM_SEED` repeats it.

#![allow(
    clippy::print_stdout,
    reason = "seeds and counts are what these runs are for"
)]

mod campaign;
mod faults;
mod harness;
mod power;
mod proxy;
