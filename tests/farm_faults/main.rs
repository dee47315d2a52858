//! Faults, done to real processes: kill, freeze, cut, delay, fill.
//!
//! Every run that draws at random prints its seed; `BRDFARM_SEED` repeats it.

mod campaign;
mod faults;
mod harness;
mod proxy;
