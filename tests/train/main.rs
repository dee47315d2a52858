//! `brdfarm train`, `evaluate` and `dataset observability` as a person uses them: on what was
//! rendered, killed and resumed, and on what is wrong.
#![cfg(feature = "training")]
#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

mod camera;
mod estimate;
mod faults;
mod observability;
mod pairs;
#[path = "../readers/mod.rs"]
mod readers;
mod resumed;
#[path = "../workplace/mod.rs"]
mod workplace;
