//! Files among the images that nothing names: of completions that were cut short, or replaced.

use crate::{ReadOnlyStore, StoreError, WritableStore};
use dataset::Digest;
use imagestore::{
    FileError,
    blobs::{Blobs, Entry, Name},
};
use std::{collections::HashSet, path::PathBuf};

/// A file that no completed material names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unnamed {
    /// Where it is.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// What it is called.
    pub name: Name,
}

impl Unnamed {
    /// Whether its name is that of an image, or of an upload: others were put there by somebody
    /// else, and stay.
    pub fn is_image(&self) -> bool {
        self.name != Name::Other
    }
}

/// Lists what is unnamed, by path. Beside a coordinator at work some of it may be about to be
/// named.
pub fn unnamed(store: &ReadOnlyStore) -> Result<Vec<Unnamed>, FileError> {
    let named = named(store)?;
    let mut found = Vec::new();
    store.blobs.for_each(&mut |Entry { path, bytes, name }| {
        if !is_named(&name, &named) {
            found.push(Unnamed { path, bytes, name });
        }
    })?;
    found.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(found)
}

/// Removes unnamed images that nobody is about to name, and returns them.
///
/// A store in a folder that is open for writing has no coordinator. In a database what is unnamed
/// is listed beside coordinators, which may take minutes, and then looked at again and removed
/// while they wait.
pub fn remove_unnamed(store: &mut WritableStore) -> Result<Vec<Unnamed>, StoreError> {
    let mut found = unnamed(&store.read()?)?;
    found.retain(Unnamed::is_image);
    match store {
        WritableStore::Folder(store) => remove(&store.blobs, found),
        WritableStore::Database(writer) => {
            let name = writer.name();
            writer.undisturbed(|blobs| {
                let named = named(&ReadOnlyStore::open(name)?)?;
                found.retain(|file| !is_named(&file.name, &named));
                remove(blobs, found)
            })
        }
    }
}

fn remove(blobs: &Blobs, files: Vec<Unnamed>) -> Result<Vec<Unnamed>, StoreError> {
    let paths: Vec<PathBuf> = files.iter().map(|file| file.path.clone()).collect();
    blobs.remove(&paths)?;
    Ok(files)
}

fn named(store: &ReadOnlyStore) -> Result<HashSet<Digest>, FileError> {
    let mut named = HashSet::new();
    for material in store.materials_complete() {
        if let Some(completion) = store.completion(material)? {
            named.extend(completion.views.iter().map(|view| view.digest));
        }
    }
    Ok(named)
}

fn is_named(name: &Name, named: &HashSet<Digest>) -> bool {
    matches!(name, Name::Image(digest) if named.contains(digest))
}
