//! Room on the file system of a store, some of which stays free.
//!
//! A write that fails for want of room can tear a record, and sled answers nothing any more after
//! one. So nobody waits for that: with less room than the reserve no image is taken in and no job
//! handed out, and a little below it no record is written. What comes between is for the records of
//! images that were taken in before. Whoever waits goes on when there is room again.

use crate::FileError;
use std::{
    io,
    path::{Path, PathBuf},
};

/// The file system of a store, and what stays free on it.
#[derive(Clone, Debug)]
pub struct Room {
    root: PathBuf,
    reserve_bytes: u64,
}

impl Room {
    /// All of the file system that `root` is on.
    pub fn all_of(root: &Path) -> Self {
        Self {
            root: root.to_owned(),
            reserve_bytes: 0,
        }
    }

    /// The same file system, of which `bytes` stay free.
    #[must_use]
    pub fn keeping(self, bytes: u64) -> Self {
        Self {
            reserve_bytes: bytes,
            ..self
        }
    }

    /// What is free, bytes.
    ///
    /// # Errors
    /// When the system does not say.
    pub fn free_bytes(&self) -> Result<u64, FileError> {
        let asked = rustix::fs::statvfs(&self.root);
        let system = asked.map_err(|error| FileError::new("look at", &self.root)(error.into()))?;
        Ok(system.f_bavail * system.f_frsize)
    }

    /// Whether an image may be written.
    ///
    /// # Errors
    /// [`io::ErrorKind::StorageFull`] when less is free than has to stay.
    pub fn for_images(&self) -> Result<(), FileError> {
        self.leaving(self.reserve_bytes)
    }

    /// Whether the records of images that are there may be written.
    ///
    /// # Errors
    /// As of [`Room::for_images`], with less.
    pub fn for_records(&self) -> Result<(), FileError> {
        let reserve = self.reserve_bytes;
        self.leaving(reserve.saturating_sub(limits::DISK_RESERVE_FOR_RECORDS_BYTES))
    }

    fn leaving(&self, bytes: u64) -> Result<(), FileError> {
        const MIB: u64 = 1 << 20;
        if bytes == 0 {
            return Ok(());
        }
        let free = self.free_bytes()?;
        if free >= bytes {
            return Ok(());
        }
        let full = format!(
            "the disk is full: {} MiB are free there and {} have to stay free (--disk-reserve-mib); \
             make room, and it goes on",
            free / MIB,
            bytes.div_ceil(MIB)
        );
        let full = io::Error::new(io::ErrorKind::StorageFull, full);
        Err(FileError::new("write to", &self.root)(full))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reserve_refuses_images_first_and_records_then() {
        let folder = tempfile::tempdir().unwrap();
        let room = Room::all_of(folder.path());
        room.for_images().unwrap();
        let free = room.free_bytes().unwrap();
        let records = limits::DISK_RESERVE_FOR_RECORDS_BYTES;
        let little = room.clone().keeping(free + records / 2);
        let error = little.for_images().unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::StorageFull);
        assert!(error.to_string().contains("disk is full"), "{error}");
        little.for_records().unwrap();
        let none = room.keeping(free + 2 * records);
        none.for_records().unwrap_err();
    }
}
