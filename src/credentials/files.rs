//! Folders and files that only their owner can read.

use anyhow::Context;
use std::fs::{self, DirBuilder, OpenOptions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::Path;

/// A folder that only its owner can look into.
pub fn make_folder(path: &Path) -> anyhow::Result<()> {
    let unable = || format!("cannot make {}", path.display());
    DirBuilder::new()
        .mode(0o700)
        .create(path)
        .with_context(unable)
}

/// A new file that only its owner can read.
pub fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    let mut options = OpenOptions::new();
    let file = options.write(true).create_new(true).mode(0o600).open(path);
    let written = file.and_then(|mut file| {
        file.write_all(text.as_bytes())?;
        file.sync_all()
    });
    written.with_context(|| format!("cannot write {}", path.display()))
}

/// Puts a file in the place of one that may be there: whoever reads it meanwhile has one or the other.
pub fn replace(path: &Path, text: &str) -> anyhow::Result<()> {
    let beside = path.with_extension("new");
    // What an earlier call left that was killed.
    let _ = fs::remove_file(&beside);
    write(&beside, text)?;
    fs::rename(&beside, path).with_context(|| format!("cannot write {}", path.display()))
}

/// Reads a file of this folder.
pub fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
}

/// Adds to a file of this folder.
pub fn append(path: &Path, text: &str) -> anyhow::Result<()> {
    let file = OpenOptions::new().append(true).open(path);
    let written = file.and_then(|mut file| file.write_all(text.as_bytes()));
    written.with_context(|| format!("cannot write {}", path.display()))
}
