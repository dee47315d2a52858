//! Why there is no manifest.

use std::io;
use thiserror::Error;

/// Why there is no manifest.
#[derive(Debug, Error)]
pub enum ManifestError {
    /// The Parquet encoder failed.
    #[error("cannot write Parquet: {0}")]
    Parquet(#[from] ::parquet::errors::ParquetError),
    /// The manifest cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}
