//! Faults, done to real processes: kill, freeze, cut, delay, reorder, fill, corrupt, lie, hang.
//!
//! README.md beside this file says which defence each fault meets, and how its test fails without.
//!
//! Every run that draws at random prints its seed; `BRDFARM_SEED` repeats it.

#![allow(
    clippy::print_stdout,
    reason = "seeds and counts are what these runs are for"
)]

mod bad_workers;
mod bucket;
mod bucket_scale;
mod campaign;
#[path = "../../datastore/tests/store/cheap_image.rs"]
#[allow(dead_code, reason = "other tests use all of it")]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
mod cheap_image;
mod corruption;
#[path = "../draws/mod.rs"]
mod draws;
mod faults;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../folder/mod.rs"]
mod folder;
mod harness;
mod liar;
mod network;
#[allow(dead_code, reason = "other tests use the rest")]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#[path = "../../jobstore-postgres/src/testing.rs"]
mod postgres;
mod power;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../process/mod.rs"]
mod process;
mod proxy;
mod replicas;
#[path = "../s3/mod.rs"]
mod s3;
mod signed_urls;
