//! Why nothing was exported.

use crate::{manifest::error::ManifestError, rectify::RectifyError};
use dataset::condition::Condition;
use datastore::StoreName;
use imagestore::FileError;
use std::path::PathBuf;
use thiserror::Error;

/// Why nothing was exported, or not all of it.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The dataset is not complete.
    #[error(
        "{missing} of the {materials} materials wanted of {store} are not complete: finish them \
         with `brdfarm run`, or pass --partial to export the others"
    )]
    Incomplete {
        /// The store.
        store: StoreName,
        /// Materials that are not complete.
        missing: u32,
        /// Materials that are wanted.
        materials: u32,
    },
    /// Nothing is left.
    #[error("no material of the set satisfies `{0}`")]
    NoMaterial(Condition),
    /// A view is wanted that the specification does not have.
    #[error("there is no view {view}: there are {count}, counted from 0")]
    NoSuchView {
        /// The view wanted.
        view: u32,
        /// How many there are.
        count: usize,
    },
    /// Nothing is left to export.
    #[error("nothing to export: no complete material is in the split and the views wanted")]
    Nothing,
    /// A material was completed with another number of views.
    #[error("material {0} has views that the specification does not have: verify the store")]
    Views(u32),
    /// An image of the store cannot be exported.
    #[error("{}: {reason}: verify the store", path.display())]
    Image {
        /// The image's file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The folder to export to holds something else.
    #[error("{} holds {found}: choose an empty or a new folder", folder.display())]
    Occupied {
        /// The folder.
        folder: PathBuf,
        /// What is there.
        found: String,
    },
    /// The folder to export to holds another export.
    #[error(
        "{} holds {found}: replace it with --overwrite, or choose another folder",
        folder.display()
    )]
    OtherExport {
        /// The folder.
        folder: PathBuf,
        /// Which export is there.
        found: String,
    },
    /// Only exports in folders are replaced.
    #[error(
        "{} holds {found}, and an export in a bucket is not replaced: remove its objects first, or \
         choose another prefix",
        place.display()
    )]
    OtherExportInBucket {
        /// The place in the bucket.
        place: PathBuf,
        /// Which export is there.
        found: String,
    },
    /// Another table of observability is there, or something else.
    #[error("{} holds {found}: remove it, or choose another --out", path.display())]
    OtherTable {
        /// The table, or the folder of its parts.
        path: PathBuf,
        /// What is there.
        found: String,
    },
    /// A part of a table was damaged or removed meanwhile.
    #[error("{}: this part is damaged or missing: run the same command again", .0.display())]
    Part(PathBuf),
    /// The disk has too little room.
    #[error(
        "the export needs up to {needed_bytes} bytes, and {} has {free_bytes} free: make room, \
         choose another disk or fewer views",
        folder.display()
    )]
    DiskFull {
        /// The folder.
        folder: PathBuf,
        /// Bytes that are still to be written, at most.
        needed_bytes: u64,
        /// Bytes free.
        free_bytes: u64,
    },
    /// The sample cannot be rectified.
    #[error(transparent)]
    Rectify(#[from] RectifyError),
    /// A product of an image or a plot could not be encoded.
    #[error("cannot encode {what}: {reason}")]
    Encode {
        /// Of what kind.
        what: &'static str,
        /// What the encoder said.
        reason: String,
    },
    /// A manifest cannot be written.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

impl ExportError {
    /// For `map_err`: what an encoder said.
    pub(crate) fn encode<E: ToString>(what: &'static str) -> impl FnOnce(E) -> Self {
        move |error| Self::Encode {
            what,
            reason: error.to_string(),
        }
    }
}
