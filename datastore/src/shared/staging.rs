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
    // It gets the name that others look for when it is locked, or one of them would take it for
    // left behind.
    let new = own.with_extension("new");
    let lock = File::create_new(&new).map_err(FileError::new("make", &new))?;
    flock(&lock, FlockOperation::NonBlockingLockExclusive)
        .map_err(|error| FileError::new("lock", &new)(error.into()))?;
    fs::rename(&new, &path).map_err(FileError::new("rename to", &path))?;
    Ok((own, lock))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    #[test]
    fn coordinators_that_start_together_leave_each_others_locks() {
        let folder = tempfile::tempdir().unwrap();
        let start = || {
            let (own, lock) = make_staging(folder.path()).unwrap();
            fs::create_dir(&own).unwrap();
            (own, lock)
        };
        // One that died.
        let (left, lock) = start();
        drop(lock);
        let held: Vec<(PathBuf, File)> = thread::scope(|scope| {
            let starts = (0..8).map(|_| scope.spawn(|| [(); 40].map(|()| start())));
            let starts: Vec<_> = starts.collect();
            let started = starts.into_iter().flat_map(|start| start.join().unwrap());
            started.collect()
        });
        assert!(!left.exists());
        for (own, _lock) in &held {
            assert!(own.is_dir() && own.with_extension("lock").is_file());
        }
    }
}
