//! Files among the images that nothing names: of completions that were cut short, or replaced.

use crate::{
    file_error::FileError,
    store::{ReadOnlyStore, Store, StoreError},
};
use dataset::{Digest, blob_path};
use std::{collections::HashSet, fs, io, path::PathBuf};

/// A file that no completed material names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unnamed {
    /// Where it is.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Whether its name is that of an image: others were put there by somebody else, and stay.
    pub is_image: bool,
}

/// Lists what is unnamed, by path. Beside a coordinator at work some of it may be about to be
/// named.
pub fn unnamed(store: &ReadOnlyStore) -> Result<Vec<Unnamed>, FileError> {
    let mut named = HashSet::new();
    for material in store.materials_complete() {
        if let Some(completion) = store.completion(material)? {
            named.extend(completion.views.iter().map(|view| view.digest));
        }
    }
    let root = store.path().join("blobs");
    let mut found = Vec::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        let entries = match fs::read_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            entries => entries.map_err(FileError::new("list", &folder))?,
        };
        for entry in entries {
            let path = entry.map_err(FileError::new("list", &folder))?.path();
            let metadata = fs::symlink_metadata(&path).map_err(FileError::new("read", &path))?;
            if metadata.is_dir() {
                folders.push(path);
                continue;
            }
            let stem = path.file_stem().and_then(|stem| stem.to_str());
            let digest: Option<Digest> = stem.and_then(|stem| stem.parse().ok());
            let is_image =
                digest.is_some_and(|digest| store.path().join(blob_path(&digest)) == path);
            if is_image && digest.is_some_and(|digest| named.contains(&digest)) {
                continue;
            }
            found.push(Unnamed {
                path,
                bytes: metadata.len(),
                is_image,
            });
        }
    }
    found.sort();
    Ok(found)
}

/// Removes the unnamed images of a store that is open for writing, so that nobody is about to name
/// them, and returns them.
pub fn remove_unnamed(store: &Store) -> Result<Vec<Unnamed>, StoreError> {
    let mut removed = unnamed(&ReadOnlyStore::open(store.path())?)?;
    removed.retain(|file| file.is_image);
    for file in &removed {
        fs::remove_file(&file.path).map_err(FileError::new("remove", &file.path))?;
    }
    Ok(removed)
}
