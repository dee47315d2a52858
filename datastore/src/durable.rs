//! Files that are there whole or not at all.

use imagestore::FileError;
use std::{
    fs::{self, File},
    io::Write,
    path::Path,
};

/// Writes beside, syncs, renames, syncs the folder: there is the file before or the file after.
pub(super) fn write_durably(path: &Path, content: &[u8]) -> Result<(), FileError> {
    let beside = path.with_added_extension("new");
    File::create(&beside)
        .and_then(|mut file| {
            file.write_all(content)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&beside, path))
        .and_then(|()| match path.parent() {
            Some(folder) => File::open(folder)?.sync_all(),
            None => Ok(()),
        })
        .map_err(FileError::new("write", path))
}
