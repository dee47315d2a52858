//! A store of either kind, open for a command that mends or fills it.

use super::{ReadOnlyStore, Store, StoreError, StoreName};
use crate::{BlobsPlace, shared::SharedWriter};
use dataset::{Digest, Specification};
use jobqueue::Completion;
use jobstore_postgres::Amendment;

/// A store open for writing: a folder, which nobody else has then, or a database, beside
/// coordinators at work but no other command that writes. One in a database cannot be opened, or
/// used, inside a runtime.
pub enum WritableStore {
    /// In a folder, with two records of each completion, its log and its ledger.
    Folder(Box<Store>),
    /// In a database, with one.
    Database(Box<SharedWriter>),
}

impl WritableStore {
    /// Opens a store that is there.
    pub fn open(name: impl Into<StoreName>) -> Result<Self, StoreError> {
        match name.into() {
            StoreName::Folder(path) => Ok(Store::open(&path)?.into()),
            StoreName::Database(url) => Ok(Self::Database(Box::new(SharedWriter::open(&url)?))),
        }
    }

    /// Opens the store for a specification, or makes one, with its images in `blobs`: a store in a
    /// folder keeps them itself where that is not given, one in a database has to be told.
    pub fn open_or_create(
        name: impl Into<StoreName>,
        specification: &Specification,
        blobs: Option<&BlobsPlace>,
    ) -> Result<Self, StoreError> {
        match name.into() {
            StoreName::Folder(path) => {
                let bucket = match blobs {
                    None => None,
                    Some(BlobsPlace::Bucket(url)) => Some(url),
                    Some(BlobsPlace::Folder(folder)) => {
                        return Err(StoreError::BlobsApart(folder.clone()));
                    }
                };
                Ok(Store::open_or_create_in(&path, specification, bucket)?.into())
            }
            StoreName::Database(url) => {
                let writer = SharedWriter::open_or_create(&url, specification, blobs)?;
                Ok(Self::Database(Box::new(writer)))
            }
        }
    }

    /// Records completions of materials that were not complete, with their images, durably; of each
    /// says whether it was recorded: somebody else may have completed it since. Whoever calls has
    /// checked them.
    pub fn add(
        &mut self,
        completions: &[Completion],
        images: &[(Digest, Vec<u8>)],
    ) -> Result<Vec<bool>, StoreError> {
        match self {
            Self::Folder(store) => {
                store.put(completions, images)?;
                Ok(vec![true; completions.len()])
            }
            Self::Database(writer) => {
                writer.put_images(images)?;
                let amendments: Vec<Amendment<'_>> = completions
                    .iter()
                    .map(|completion| Amendment {
                        completion,
                        before: None,
                    })
                    .collect();
                Ok(writer.amend(&amendments)?)
            }
        }
    }

    /// Replaces what is recorded of a complete material, where it changes, and puts images of it
    /// under their names, all durably. Whether the record could be replaced: where it is no longer
    /// `before`, it stays.
    pub fn mend(
        &mut self,
        before: &Completion,
        after: &Completion,
        images: &[(Digest, Vec<u8>)],
    ) -> Result<bool, StoreError> {
        match self {
            Self::Folder(store) => {
                let changed = if before == after {
                    &[]
                } else {
                    std::slice::from_ref(after)
                };
                store.put(changed, images)?;
                Ok(true)
            }
            Self::Database(writer) => {
                writer.put_images(images)?;
                if before == after {
                    return Ok(true);
                }
                let amendment = Amendment {
                    completion: after,
                    before: Some(before),
                };
                Ok(writer.amend(&[amendment])? == [true])
            }
        }
    }

    /// What there is, for reading.
    pub fn read(&self) -> Result<ReadOnlyStore, StoreError> {
        match self {
            Self::Folder(store) => ReadOnlyStore::open(store.path()),
            Self::Database(writer) => ReadOnlyStore::open(writer.name()),
        }
    }
}

impl From<Store> for WritableStore {
    fn from(store: Store) -> Self {
        Self::Folder(Box::new(store))
    }
}
