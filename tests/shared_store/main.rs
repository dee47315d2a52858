//! Stores in a PostgreSQL database: what commands do with them, beside coordinators at work; and
//! stores copied into others.

#![allow(
    clippy::print_stdout,
    reason = "seeds and counts are what these runs are for"
)]

#[allow(dead_code, reason = "the coordinator's own tests use the rest")]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#[path = "../../datastore/tests/store/cheap_image.rs"]
mod cheap_image;
mod commands;
#[allow(dead_code, reason = "the coordinator's own tests use the rest")]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#[path = "../../datastore/tests/store/complete_store.rs"]
mod complete_store;
mod contents;
#[path = "../draws/mod.rs"]
mod draws;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../folder/mod.rs"]
mod folder;
mod health;
mod interruption;
mod migration;
mod place;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../process/mod.rs"]
mod process;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../s3/mod.rs"]
mod s3;
mod scale;
#[allow(dead_code, reason = "the coordinator's own tests use the rest")]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#[path = "../../jobstore-postgres/src/testing.rs"]
mod server;
