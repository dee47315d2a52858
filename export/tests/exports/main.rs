//! What leaves a store, and how it comes back, without a renderer.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

#[path = "../../../coordinator/tests/store/cheap_image.rs"]
mod cheap_image;
#[path = "../../../coordinator/tests/store/complete_store.rs"]
mod complete_store;
mod layouts;
mod manifest;
mod rectify;
mod round_trip;
