//! Files among the images that nothing names: of completions that were cut short, or replaced.

use crate::{
    blobs::{Entry, Name},
    file_error::FileError,
    store::{ReadOnlyStore, Store, StoreError},
};
use std::{collections::HashSet, path::PathBuf};

/// A file that no completed material names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unnamed {
    /// Where it is.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Whether its name is that of an image, or of an upload: others were put there by somebody
    /// else, and stay.
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
    let mut found = Vec::new();
    store.blobs.for_each(&mut |Entry { path, bytes, name }| {
        let is_named = matches!(&name, Name::Image(digest) if named.contains(digest));
        if !is_named {
            found.push(Unnamed {
                path,
                bytes,
                is_image: name != Name::Other,
            });
        }
    })?;
    found.sort();
    Ok(found)
}

/// Removes the unnamed images of a store that is open for writing, so that nobody is about to name
/// them, and returns them.
pub fn remove_unnamed(store: &Store) -> Result<Vec<Unnamed>, StoreError> {
    let mut removed = unnamed(&ReadOnlyStore::open(store.path())?)?;
    removed.retain(|file| file.is_image);
    let paths: Vec<PathBuf> = removed.iter().map(|file| file.path.clone()).collect();
    store.blobs.remove(&paths)?;
    Ok(removed)
}
