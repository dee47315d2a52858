//! A store: everything that is known of one dataset, in a folder or in a database.
//!
//! | module | what |
//! | --- | --- |
//! | `holder` | who has a folder's store open, and where it is served |
//! | `name` | which store is meant: a folder, or a PostgreSQL database |
//! | `identity` | what makes a folder a store, and whose images it has |
//! | `mesh_file` | the mesh of its sample, where that is one |
//! | `folder` | a store in a folder, open for the one process that writes |
//! | [`shared`] | a store in a database, which any number of coordinators have open |
//! | `reading` | either kind, as it was when it was opened |
//! | `writable` | either kind, open for a command that mends or fills it |
//! | `any_store` | either kind, open for a coordinator |
//! | [`verify`] | every image present, intact and what it says it is |
//! | [`repair`] | what `verify` finds is rendered again |
//! | [`garbage`] | files among the images that nothing names |
//!
//! In a folder:
//!
//! ```text
//! store.json           version of the layout, of the renderer, hash of the specification
//! specification.json   the whole specification; its presence makes the folder a store
//! DIGEST.mesh          the mesh of the sample, where that is one; written before the specification
//! completions.log      one line a completed material
//! ledger/              jobs, completions, index of images
//! blobs/ab/...exr      images by digest, unless they are in a bucket
//! staging/             uploads under way
//! lock                 held by the one process that writes
//! migration.json       while it is an unfinished copy: what of
//! ```
//!
//! The specification's hash leaves out its name and its number of materials, which change no
//! image: a store can grow. It knows the largest number ever asked for; asking for fewer leaves it
//! at that, and only means that whoever asks wants no more than those now.

mod any_store;
mod copy_error;
mod durable;
mod folder;
pub mod garbage;
mod holder;
mod identity;
mod mesh_file;
mod name;
mod reading;
pub mod repair;
pub mod shared;
pub mod verify;
mod writable;

pub use any_store::AnyStore;
pub use copy_error::CopyError;
pub use folder::Store;
pub use holder::Holder;
pub use identity::{begin_copy, end_copy, log_path};
pub use name::StoreName;
pub use reading::check_read;
pub use reading::{ImageFault, ReadOnlyStore};
pub use shared::{BlobsPlace, SharedStore, SharedStoreError};
pub use writable::WritableStore;

use dataset::{
    Digest, RENDERER_VERSION,
    specification::{Differences, SpecificationError},
};
use imagestore::{FileError, bucket::BucketUrl};
use jobstore::ledger::LedgerError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a store cannot be used.
#[derive(Debug, Error)]
pub enum StoreError {
    /// There is no store.
    #[error("there is no store in {}: it has no specification.json", .0.display())]
    Absent(PathBuf),
    /// There is no store, and something else is in the folder.
    #[error(
        "{} is not a store, because it has no specification.json, and holds {found:?}: choose an empty \
         or a new folder",
        path.display()
    )]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// The first thing found in it.
        found: String,
    },
    /// Another process writes to it.
    #[error(
        "the store {} is in use by {}: wait until it ends, or choose another store",
        path.display(),
        holder.as_ref().map_or("another process".to_owned(), Holder::to_string)
    )]
    Locked {
        /// The store.
        path: PathBuf,
        /// Who, where it says so.
        holder: Option<Holder>,
    },
    /// It holds another dataset.
    #[error(
        "the store {} holds another dataset ({differences}): choose another store, or the \
         specification it was made with",
        path.display()
    )]
    Specification {
        /// The store.
        path: PathBuf,
        /// What the given specification has otherwise.
        differences: Differences,
    },
    /// It was made by another renderer, whose images are not the same.
    #[error(
        "the store {} was made with renderer version {found}, and this is version \
         {RENDERER_VERSION}: continue with the program that made it, or choose another store",
        path.display()
    )]
    Renderer {
        /// The store.
        path: PathBuf,
        /// The version that made it.
        found: String,
    },
    /// A file of it cannot be understood.
    #[error("{} is damaged: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The mesh of its sample is missing or damaged.
    #[error(
        "{reason}; put back the file {file_name}, the mesh that the dataset was made with: its BLAKE3 \
         digest is its name; or give the specification again, beside its mesh: `brdfarm run --spec FILE`"
    )]
    Mesh {
        /// What its file is called.
        file_name: String,
        /// What is wrong with it.
        reason: Box<SpecificationError>,
    },
    /// A store was to be made for a specification whose mesh is named only.
    #[error(
        "the specification names the mesh {0}, which is not loaded: read the specification from a \
         file that has {0}.mesh beside it"
    )]
    MeshNotLoaded(Digest),
    /// Its images are somewhere else than was asked for.
    #[error(
        "the store {} keeps its images in {found}, not in {given}: leave the option out, or choose \
         another store",
        path.display()
    )]
    OtherBlobs {
        /// The store.
        path: PathBuf,
        /// Where it keeps them.
        found: String,
        /// Where they were to be.
        given: BucketUrl,
    },
    /// Its images were to be in a folder of their own.
    #[error(
        "a store in a folder has its images there, or in a bucket: choose s3://BUCKET/PREFIX \
         instead of {}, or leave the option out",
        .0.display()
    )]
    BlobsApart(PathBuf),
    /// The place in the bucket is not this store's.
    #[error(
        "{0} belongs to another store, or holds something else: choose another prefix for the \
         images of this one"
    )]
    ForeignBucket(BucketUrl),
    /// It is half of a copy, or none can be made there.
    #[error(transparent)]
    Copy(#[from] CopyError),
    /// It is in a database, which cannot be used for it.
    #[error(transparent)]
    Shared(#[from] SharedStoreError),
    /// The ledger cannot be used.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The system would not do what was asked.
    #[error(transparent)]
    File(#[from] FileError),
}
