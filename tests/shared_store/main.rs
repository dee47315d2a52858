//! Stores in a PostgreSQL database: what commands do with them, beside coordinators at work.

mod commands;
mod place;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../process/mod.rs"]
mod process;
#[allow(dead_code, reason = "the coordinator's own tests use the rest")]
#[allow(clippy::unwrap_used, reason = "a panic here is a failed test")]
#[path = "../../coordinator/src/postgres/tests/server.rs"]
mod server;
