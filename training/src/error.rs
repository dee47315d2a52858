//! Why training, evaluation or estimation failed.

use export::file::FileError;
use export::manifest::read::ReadError;
use std::path::Path;
use thiserror::Error;

/// What went wrong.
#[derive(Debug, Error)]
pub enum TrainingError {
    /// The input is wrong: another file or another option would help.
    #[error("{0}")]
    Input(String),
    /// The manifest of an export cannot be read.
    #[error(transparent)]
    Manifest(#[from] ReadError),
    /// The system would not read or write a file.
    #[error(transparent)]
    File(#[from] FileError),
    /// The loss or a gradient is not finite.
    #[error(
        "{what} is not finite at step {step} of {stage}, with materials {materials:?}: the last \
         checkpoint stays; try a smaller learning rate"
    )]
    Diverged {
        /// The loss or the gradient.
        what: &'static str,
        /// Which network was being trained.
        stage: String,
        /// The step, counted from 0.
        step: u64,
        /// The materials of the batch.
        materials: Vec<u32>,
    },
    /// The renderer failed.
    #[error("rendering an estimate again: {0}")]
    Render(String),
    /// The framework failed.
    #[error("the network's weights: {0}")]
    Weights(String),
}

/// Why input is wrong, with its place.
pub(crate) fn bad_input(path: &Path, reason: impl std::fmt::Display) -> TrainingError {
    TrainingError::Input(format!("{}: {reason}", path.display()))
}
