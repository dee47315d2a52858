//! How an export is laid out, what it is made of, and what products are called in it.

use crate::product::{Encoding, Kind};
use dataset::Split;

/// How an export is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// A folder for each material with a file for each view.
    Files {
        /// Images are hard links to the store's, which has to be on the same file system. Whoever
        /// changes such a file changes the store. Not for images in a bucket, nor into one.
        links: bool,
    },
    /// Tar shards, a sample for each material.
    WebDataset,
    /// Parquet shards, a row for each image.
    HuggingFace,
}

/// A part of an export that is there whole or not at all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unit {
    /// Relative to the export: a shard, or the folder of a material.
    pub path: String,
    /// The split of all its materials.
    pub split: Split,
    /// Its materials, in order.
    pub materials: Vec<u32>,
    /// Its size, at most.
    pub bytes_max: u64,
}

impl Layout {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Files { .. } => "files",
            Self::WebDataset => "webdataset",
            Self::HuggingFace => "huggingface",
        }
    }

    /// The file that holds an image, given the path of its unit.
    pub(super) fn image_path(self, unit: &str, view: u32) -> String {
        match self {
            Self::Files { .. } => format!("{unit}/v{view:02}.exr"),
            Self::WebDataset | Self::HuggingFace => unit.to_owned(),
        }
    }
}

/// The column of a product.
pub(crate) fn column_name(kind: Kind) -> &'static str {
    match (kind.encoding, kind.rectified) {
        (Encoding::Exr, false) => "exr",
        (Encoding::Npy, false) => "npy",
        (Encoding::Png, false) => "preview",
        (Encoding::Exr, true) => "rectified_exr",
        (Encoding::Npy, true) => "rectified_npy",
        (Encoding::Png, true) => "rectified_preview",
    }
}
