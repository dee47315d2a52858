//! What leaves a store, and how it comes back, without a renderer.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

#[allow(dead_code, reason = "other tests use the rest")]
#[path = "../../../datastore/tests/store/cheap_image.rs"]
mod cheap_image;
#[path = "../../../datastore/tests/store/complete_store.rs"]
mod complete_store;
mod earlier;
mod layouts;
mod manifest;
#[path = "../../../datastore/tests/store/mesh_specification.rs"]
mod mesh_specification;
mod meshes;
mod rectify;
mod round_trip;
