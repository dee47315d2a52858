//! Which process has a store in a folder open. The process writes its number and its address into
//! the store's lock file. Only the lock itself keeps others out; the text tells people who holds it,
//! and commands where the store is served.

use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use std::{
    fmt,
    fs::File,
    io::{self, Read, Seek, SeekFrom, Write},
    path::Path,
};

/// The most that a lock file says, bytes.
const BYTES_MAX: u64 = 4096;

/// Who has a store open.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    /// The process.
    pub process: u32,
    /// Where it serves the store.
    pub url: String,
}

impl Holder {
    /// This process, which serves a store at a URL.
    pub fn here(url: String) -> Self {
        let process = std::process::id();
        Self { process, url }
    }

    /// Says in the lock file of a store that it has it open.
    pub fn announce(&self, mut lock: &File) -> io::Result<()> {
        let text = serde_json::to_vec(self)?;
        lock.set_len(0)?;
        lock.seek(SeekFrom::Start(0))?;
        lock.write_all(&text)
    }

    /// Who has the store in a folder open; `None` where nobody has, or does not say so.
    pub fn of(store: &Path) -> Option<Self> {
        let path = store.join("lock");
        // Opening a pipe would wait for its other end.
        if !path.is_file() {
            return None;
        }
        let lock = File::open(path).ok()?;
        if flock(&lock, FlockOperation::NonBlockingLockShared).is_ok() {
            // What it says is of somebody who is gone.
            return None;
        }
        let mut text = Vec::new();
        lock.take(BYTES_MAX).read_to_end(&mut text).ok()?;
        serde_json::from_slice(&text).ok()
    }
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "process {}, which serves it at {}",
            self.process, self.url
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_holder_counts_for_as_long_as_it_holds() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        assert_eq!(Holder::of(folder.path()), None);
        let lock = File::create(&path).unwrap();
        flock(&lock, FlockOperation::NonBlockingLockExclusive).unwrap();
        assert_eq!(Holder::of(folder.path()), None, "it says nothing yet");
        for url in ["http://127.0.0.1:40001", "http://127.0.0.1:7"] {
            let holder = Holder::here(url.to_owned());
            holder.announce(&lock).unwrap();
            assert_eq!(Holder::of(folder.path()), Some(holder));
        }
        drop(lock);
        assert_eq!(Holder::of(folder.path()), None);
        std::fs::write(&path, "no JSON").unwrap();
        let lock = File::options().write(true).open(&path).unwrap();
        flock(&lock, FlockOperation::NonBlockingLockExclusive).unwrap();
        assert_eq!(Holder::of(folder.path()), None);
    }
}
