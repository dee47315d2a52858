//! Stores without a network: what is accepted as an image, what a damaged store recovers, what
//! `verify` finds.

#![allow(clippy::unwrap_used, reason = "a panic here is a failed test")]

mod acceptance;
mod cheap_image;
mod complete_store;
mod recovery;
mod verify;
