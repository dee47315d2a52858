//! What leaves a store, made and read by real programs.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

mod again;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../datastore/tests/store/cheap_image.rs"]
mod cheap_image;
mod clients;
mod curved;
#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../folder/mod.rs"]
mod folder;
mod killed;
mod meshes;
#[path = "../readers/mod.rs"]
mod readers;
mod rectified;
mod small;
mod upkeep;
#[path = "../workplace/mod.rs"]
mod workplace;
