//! The part of Embree's C interface that this renderer needs, loaded at run time.
//!
//! Embree builds a hierarchy over the bounds of our primitives and calls back for those that a
//! ray may meet. It computes no hit: `crate::geometry` does, on the 64-bit ray. Embree 4.3 is the
//! oldest that fits, because from there on `RTCHit` is larger.
//!
//! The source of every declaration is Embree's API documentation and its public headers, versions
//! 4.3 and 4.4.
#![allow(
    unsafe_code,
    reason = "a C library is called, and calls back through raw pointers"
)]

mod abi;
mod callbacks;
mod device;
mod error;
mod library;
mod query;
mod scene;

pub use device::{Isa, UnknownIsa};
pub use error::EmbreeError;
pub(crate) use library::check_named;
pub(crate) use scene::Scene;
