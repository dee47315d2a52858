//! Files that a command writes for the person who called it.

use crate::failure::BadInput;
use anyhow::Context;
use std::fs;
use std::path::{Path, PathBuf};

/// Writes a file that is there whole or not at all: beside its place first. What is no plain file,
/// such as a device, is written to directly, since a rename would replace it.
pub fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let plain = fs::symlink_metadata(path).map_or(true, |there| there.is_file());
    let written = if plain {
        let beside = beside(path);
        let written = fs::write(&beside, bytes).and_then(|()| fs::rename(&beside, path));
        if written.is_err() {
            // The error that counts is the one before.
            let _ = fs::remove_file(&beside);
        }
        written
    } else {
        fs::write(path, bytes)
    };
    written.with_context(|| format!("cannot write {}", path.display()))
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    name.into()
}

/// The lower-case ending of the file's name that `option` gives, which has to be one of `known`.
pub fn ending<'a>(option: &str, path: &Path, known: &[&'a str]) -> Result<&'a str, BadInput> {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let found = known
        .iter()
        .find(|known| ending.as_deref() == Some((**known).as_ref()));
    found.copied().ok_or_else(|| {
        BadInput(format!(
            "{option} {}: the name has to end in .{}",
            path.display(),
            known.join(" or .")
        ))
    })
}
