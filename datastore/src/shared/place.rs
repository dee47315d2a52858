//! Where the images of a shared store are.

use imagestore::{FileError, blobs::Blobs, bucket::BucketUrl};
use std::{
    fmt, fs,
    path::{Path, PathBuf},
    str::FromStr,
};

/// Where the images of a shared store are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BlobsPlace {
    /// A folder that all coordinators reach.
    Folder(PathBuf),
    /// A place in a bucket, to which workers send images themselves.
    Bucket(BucketUrl),
}

impl FromStr for BlobsPlace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if BucketUrl::is_meant(text) {
            text.parse().map(Self::Bucket)
        } else {
            Ok(Self::Folder(text.into()))
        }
    }
}

impl BlobsPlace {
    /// The same with a folder that is there, by a name that means it from everywhere.
    pub(super) fn made(&self) -> Result<Self, FileError> {
        let Self::Folder(folder) = self else {
            return Ok(self.clone());
        };
        fs::create_dir_all(folder).map_err(FileError::new("make", folder))?;
        let folder = fs::canonicalize(folder).map_err(FileError::new("find", folder))?;
        Ok(Self::Folder(folder))
    }

    /// The images for those who only read; touches nothing and asks nobody yet.
    pub fn for_readers(&self) -> Result<Blobs, FileError> {
        match self {
            Self::Folder(folder) => Ok(Blobs::new(folder)),
            // Of this machine's files it needs none.
            Self::Bucket(url) => Blobs::in_bucket(Path::new("."), url),
        }
    }
}

impl fmt::Display for BlobsPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => folder.display().fmt(f),
            Self::Bucket(url) => url.fmt(f),
        }
    }
}
