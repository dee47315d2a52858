//! A store on the command line: a folder, or a PostgreSQL database.

use crate::failure::BadInput;
use clap::builder::{PathBufValueParser, TypedValueParser};
use dataset::Specification;
use datastore::{AnyStore, BlobsPlace, SharedStore, Store, StoreError, StoreName};
use tokio::runtime::Runtime;

/// What stands for it in a command's help.
pub const VALUE: &str = "DIR|postgres://USER@HOST/DATABASE";

/// Reads it.
pub fn parser() -> impl TypedValueParser<Value = StoreName> {
    PathBufValueParser::new().map(StoreName::new)
}

/// The specification of the store that is there, if one is.
pub fn kept_specification(
    name: &StoreName,
    runtime: &Runtime,
) -> anyhow::Result<Option<Specification>> {
    Ok(match name {
        StoreName::Database(url) => runtime.block_on(SharedStore::kept_specification(url))?,
        StoreName::Folder(path) => Store::kept_specification(path)?,
    })
}

/// The specification of a store that has to be there.
pub fn specification_of(name: &StoreName) -> anyhow::Result<Specification> {
    let runtime = Runtime::new()?;
    let kept = kept_specification(name, &runtime)?;
    Ok(kept.ok_or_else(|| BadInput(format!("--store {name}: there is no store")))?)
}

/// Opens a store for a coordinator, or makes one. Has to be called outside of `runtime`: a store in
/// a folder may have its images in a bucket, and waits for that.
pub fn open_or_create(
    name: &StoreName,
    specification: &Specification,
    blobs: Option<&BlobsPlace>,
    runtime: &Runtime,
) -> anyhow::Result<AnyStore> {
    match name {
        StoreName::Database(url) => {
            let opening = SharedStore::open_or_create(url, specification, blobs);
            Ok(runtime.block_on(opening)?.into())
        }
        StoreName::Folder(path) => {
            let bucket = match blobs {
                None => None,
                Some(BlobsPlace::Bucket(url)) => Some(url),
                Some(BlobsPlace::Folder(folder)) => {
                    return Err(StoreError::BlobsApart(folder.clone()).into());
                }
            };
            Ok(Store::open_or_create_in(path, specification, bucket)?.into())
        }
    }
}
