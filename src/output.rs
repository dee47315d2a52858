//! Files that a command writes for the person who called it.

use crate::failure::BadInput;
use anyhow::Context;
use std::fs;
use std::path::Path;

/// Makes the folder that `--out` names, before the work and not after it.
pub fn make_folder(path: &Path) -> anyhow::Result<()> {
    if fs::metadata(path).is_ok_and(|there| !there.is_dir()) {
        return Err(BadInput(format!("--out {}: this is not a folder", path.display())).into());
    }
    fs::create_dir_all(path).with_context(|| format!("cannot write to {}", path.display()))
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
