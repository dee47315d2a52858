//! Files that are there whole or not at all.

pub use imagestore::FileError;

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

/// Bytes that reach a file at one time: shards are large, and what is put into them comes in small
/// pieces.
const WRITE_BYTES: usize = 256 << 10;

/// The name that a file has until it is whole.
pub fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    name.into()
}

/// For `map_err`: puts action and path to what the system said.
pub fn unable(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> FileError + use<> {
    let path = path.to_owned();
    move |source| FileError {
        action,
        path,
        source,
    }
}

/// Has `write` write a file, which appears under its name when it is whole and durable. What is no
/// plain file, such as a device or a pipe, is written to directly: a rename would replace it.
///
/// # Errors
/// That of `write`, or that the file cannot be written. Whatever had its name before is still
/// there.
pub fn write_whole<T, E: From<FileError>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<T, E>,
) -> Result<T, E> {
    let fill = |place: &Path| -> Result<(File, T), E> {
        let file = File::create(place).map_err(unable("write", path))?;
        let mut writer = BufWriter::with_capacity(WRITE_BYTES, file);
        let written = write(&mut writer)?;
        let file = writer
            .into_inner()
            .map_err(|error| unable("write", path)(error.into_error()))?;
        Ok((file, written))
    };
    if fs::symlink_metadata(path).is_ok_and(|there| !there.is_file()) {
        return Ok(fill(path)?.1);
    }
    let beside = beside(path);
    let written = fill(&beside).and_then(|(file, written)| {
        file.sync_all()
            .and_then(|()| fs::rename(&beside, path))
            .map_err(unable("write", path))?;
        Ok(written)
    });
    if written.is_err() {
        // The error that counts is the one before.
        let _ = fs::remove_file(&beside);
    }
    written
}

/// Writes bytes as [`write_whole`] does.
///
/// # Errors
/// When the file cannot be written. Whatever had its name before is still there.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_whole(path, |file| {
        file.write_all(bytes).map_err(unable("write", path))
    })
}

/// Syncs a folder, so that names that were given in it survive a power loss.
///
/// # Errors
/// When the system would not.
pub fn sync_folder(path: &Path) -> Result<(), FileError> {
    File::open(path)
        .and_then(|folder| folder.sync_all())
        .map_err(unable("sync", path))
}
