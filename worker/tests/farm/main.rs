//! Coordinator and workers over real sockets. Images come from a cheap, deterministic maker, so
//! that what is tested is the farm.

#[path = "../../../coordinator/tests/store/cheap_image.rs"]
mod cheap_image;

mod bench;
mod completion;
mod leases;
mod measure;
mod refusals;
mod restarts;
