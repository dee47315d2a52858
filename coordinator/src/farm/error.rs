//! Why an operation of the farm was not done.

use dataset::Digest;
use imagestore::{FileError, validation::Rejection};
use jobqueue::token::WorkerId;
use jobstore::JobStoreError;
use thiserror::Error;

/// Why an operation was not done.
#[derive(Debug, Error)]
pub(crate) enum FarmError {
    #[error(transparent)]
    JobStore(#[from] JobStoreError),
    #[error("view {view}: {reason}")]
    Image { view: u32, reason: Rejection },
    #[error(transparent)]
    Rejected(#[from] Rejection),
    #[error("{0}")]
    Invalid(String),
    #[error("{0}")]
    Incompatible(String),
    #[error("worker {0} is not registered here: register (again)")]
    UnknownWorker(WorkerId),
    #[error("worker {0} is registered with another credential: register without an id")]
    NotItsId(WorkerId),
    #[error("{0} workers are registered, and no more are admitted")]
    TooManyWorkers(usize),
    #[error(
        "there is no room for the images of material {0} beside those that others are sending: try \
         again later"
    )]
    StagingFull(u32),
    #[error("images are to be sent to the URLs of GetUploadUrls: this farm keeps them in a bucket")]
    ByUrl,
    #[error("this farm takes images itself: send them with PutBlob")]
    NotByUrl,
    #[error("the bucket does not answer: {0}")]
    Bucket(FileError),
    #[error("no worker called {0:?} is blocked")]
    NotBlocked(String),
    #[error("the store has no image {0}")]
    UnknownBlob(Digest),
    #[error("image {0} is damaged: `brdfarm dataset verify` tells more")]
    DamagedBlob(Digest),
    #[error("{0} readers watch events, and no more are admitted")]
    TooManyReaders(usize),
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the system gives no random numbers: {0}")]
    Random(getrandom::Error),
    #[error("the operation was interrupted")]
    Interrupted,
}
