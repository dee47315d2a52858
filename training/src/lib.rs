//! The training step: networks that estimate the ten parameters of a material from two photographs,
//! after Vidaurre et al., "BRDF Estimation of Complex Materials with Nested Learning" (WACV 2019).
//!
//! | module | what |
//! | --- | --- |
//! | [`data`] | pairs of rectified images and labels, from an export |
//! | [`pixels`] | from linear pixels to a network's input |
//! | [`labels`] | parameters as bins: targets, loss, readings |
//! | [`network`] | the paper's networks |
//! | [`device`] | where networks are computed |
//! | [`variant`] | what is trained: the paper's variants and two controls |
//! | [`fit`] | the training itself, with checkpoints |
//! | [`estimation`] | one material from two photographs |
//! | [`evaluation`] | how far an estimate is from the truth |
//! | [`model`] | the result, written, read and applied |
//!
//! This crate alone names burn, the framework of the networks.

pub mod data;
pub mod device;
mod error;
pub mod estimation;
pub mod evaluation;
pub mod fit;
mod keystream;
pub mod labels;
pub mod model;
pub mod network;
pub mod pixels;
pub mod variant;

pub use error::TrainingError;
