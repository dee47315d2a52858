//! Coordinator and workers over real sockets. Images come from a cheap, deterministic maker, so
//! that what is tested is the farm.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

#[path = "../../../datastore/tests/store/cheap_image.rs"]
mod cheap_image;

mod bench;
mod completion;
mod disk;
mod leases;
mod mesh;
#[path = "../../../datastore/tests/store/mesh_specification.rs"]
mod mesh_specification;
mod operation;
mod refusals;
mod restarts;
mod staging;
