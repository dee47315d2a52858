//! Why a store is not copied.

use datastore::{
    BlobsPlace, ImageFault, SharedStoreError, StoreError, StoreName, shared::DatabaseError,
};
use imagestore::FileError;
use jobstore::ledger::LedgerError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a store was not copied, or not all of it. The same call goes on where it can.
#[derive(Debug, Error)]
pub enum MigrationError {
    /// Source and target are one.
    #[error("{0} cannot become a copy of itself")]
    Same(StoreName),
    /// The images of both would be in one place.
    #[error("the images of {name} are in {place}: those of a copy need a place of their own")]
    SamePlace {
        /// The source.
        name: StoreName,
        /// Where its images are.
        place: Box<BlobsPlace>,
    },
    /// Somebody is at work on the source.
    #[error(
        "{name} is at work (workers heard of lately: {workers}; leases: {leases}): stop workers and \
         coordinators, wait two minutes, and try again"
    )]
    AtWork {
        /// The source.
        name: StoreName,
        /// Workers that were heard of lately.
        workers: u32,
        /// Leases that have not run out.
        leases: u32,
    },
    /// An image of the source is not what is recorded.
    #[error(
        "material {material}, view {view}, {}: {fault}; `brdfarm dataset repair`, then the same \
         command again",
        path.display()
    )]
    Image {
        /// The material's index.
        material: u32,
        /// The view's index.
        view: u32,
        /// Where it is.
        path: PathBuf,
        /// What is wrong.
        fault: ImageFault,
    },
    /// A job of the source is complete, and nothing is recorded of it.
    #[error(
        "{name} has no record of the images of material {material}, which is complete: `brdfarm \
         dataset verify` says more"
    )]
    NoCompletion {
        /// The source.
        name: StoreName,
        /// The material's index.
        material: u32,
    },
    /// An image that was written does not read back.
    #[error("the copy of material {material}, view {view}, {}: {fault}", path.display())]
    Copy {
        /// The material's index.
        material: u32,
        /// The view's index.
        view: u32,
        /// Where it is.
        path: PathBuf,
        /// What is wrong.
        fault: ImageFault,
    },
    /// The records of both are not the same in the end.
    #[error("{to} does not have what {from} has of {what}: something else wrote to one of them")]
    Differs {
        /// The source.
        from: StoreName,
        /// The target.
        to: StoreName,
        /// Of what.
        what: String,
    },
    /// A store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The ledger of one in a folder cannot.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl From<SharedStoreError> for MigrationError {
    fn from(error: SharedStoreError) -> Self {
        Self::Store(error.into())
    }
}

impl From<DatabaseError> for MigrationError {
    fn from(error: DatabaseError) -> Self {
        SharedStoreError::from(error).into()
    }
}
