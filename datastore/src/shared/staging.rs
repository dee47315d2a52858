//! Where a coordinator stages uploads, beside others that share the folder of images.

use imagestore::FileError;
use rustix::fs::{FlockOperation, flock};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

/// Makes a folder to stage uploads in, locked, and removes those that nobody has locked any more.
pub(super) fn make_staging(root: &Path) -> Result<(PathBuf, File), FileError> {
    let staging = root.join("staging");
    fs::create_dir_all(&staging).map_err(FileError::new("make", &staging))?;
    for entry in fs::read_dir(&staging).map_err(FileError::new("list", &staging))? {
        let path = entry.map_err(FileError::new("list", &staging))?.path();
        if path.extension().is_none_or(|extension| extension != "lock") {
            continue;
        }
        let Ok(lock) = File::open(&path) else {
            continue;
        };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok() {
            // Somebody else may be clearing it as well.
            drop(fs::remove_dir_all(path.with_extension("")));
            drop(fs::remove_file(&path));
        }
    }
    let mut number = [0; 8];
    getrandom::fill(&mut number)
        .map_err(|error| FileError::new("name a folder in", &staging)(error.into()))?;
    let own = staging.join(format!("{:016x}", u64::from_be_bytes(number)));
    let path = own.with_extension("lock");
    let lock = File::create_new(&path).map_err(FileError::new("make", &path))?;
    flock(&lock, FlockOperation::NonBlockingLockExclusive)
        .map_err(|error| FileError::new("lock", &path)(error.into()))?;
    Ok((own, lock))
}
