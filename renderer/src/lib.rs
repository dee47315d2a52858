//! One view to one image with its measured error: reflectance, geometry, light transport,
//! sampling, film and EXR. Knows nothing of farms.
//!
//! An image is a function of the specification, the material and the view alone: every number
//! comes from + - * / and sqrt in 64 bits and from the transcendental functions of one library
//! compiled in, and no sum depends on the schedule of threads.

mod aov;
pub mod bsdf;
mod exr_file;
pub mod film;
pub mod geometry;
pub mod hybrid;
mod numerics;
mod parallel;
pub mod path;
mod phase_time;
pub mod query;
pub mod reflectance;
mod render;
mod rounding;
pub mod sampler;
pub mod scene;
pub mod vector;
pub mod warp;

pub use exr_file::{ExrError, decode as decode_exr, encode as encode_exr};
pub use numerics::instructions::Instructions;
pub use phase_time::PhaseTime;
pub use render::{Discretization, RenderError, Renderer, Rendering};
