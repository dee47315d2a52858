//! Stores without a network: what is accepted as an image, what a damaged store recovers, what
//! `verify` finds, what `repair` mends.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

#[allow(dead_code, reason = "other crates' tests use the rest")]
mod cheap_image;
mod cheap_renderer;
mod complete_store;
mod mesh;
mod mesh_specification;
mod recovery;
mod repair;
mod validation;
mod verify;
