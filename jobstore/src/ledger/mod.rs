//! The ledger: jobs, workers' histories, completions and the index of images.
//!
//! [`SledLedger`] is the one of a store on one machine. Whatever implements [`Ledger`] is tested by
//! the same suite: the queue's model test runs over every ledger, restarts it at random, and
//! expects what it was told.

#[cfg(test)]
pub mod memory;
mod sled;

pub use sled::SledLedger;

use dataset::Digest;
use imagestore::FileError;
use jobqueue::{Changes, Completion};
use std::path::PathBuf;
use thiserror::Error;

/// Why the ledger cannot be used.
#[derive(Debug, Error)]
pub enum LedgerError {
    /// What it holds is damaged. It can be rebuilt.
    #[error("the ledger is damaged: {0}")]
    Damaged(String),
    /// Another process has it open.
    #[error("another process has the ledger {} open", .0.display())]
    Locked(PathBuf),
    /// The system would not do what was asked; the ledger may be sound.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Which image a digest names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlobPlace {
    /// The material's index.
    pub material: u32,
    /// The view's index.
    pub view: u32,
    /// The image's size.
    pub bytes: u64,
}

/// What keeps the queue's changes. All calls block.
pub trait Ledger: Send + Sync {
    /// Everything it keeps of the queue: every job and every worker that has a record, once.
    fn contents(&self) -> Result<Changes, LedgerError>;

    /// Writes changes and completions, all or nothing; durable after [`Ledger::sync`]. Later
    /// changes replace earlier ones.
    fn apply(&self, changes: &Changes, completions: &[Completion]) -> Result<(), LedgerError>;

    /// Makes durable what was applied.
    ///
    /// Architecture invariant: what was acknowledged is durable.
    fn sync(&self) -> Result<(), LedgerError>;

    /// The last completion of a material, whether or not it still counts.
    fn completion(&self, material: u32) -> Result<Option<Completion>, LedgerError>;

    /// Which image has this digest, if any was ever recorded.
    fn blob(&self, digest: &Digest) -> Result<Option<BlobPlace>, LedgerError>;
}
