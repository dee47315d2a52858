//! Stores without a network: what is accepted as an image, what a damaged store recovers, what
//! `verify` finds, what `export` writes.

mod acceptance;
mod cheap_image;
mod complete_store;
mod export;
mod recovery;
mod verify;
