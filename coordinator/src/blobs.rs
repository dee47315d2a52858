//! The blob store: images as files that are named by their BLAKE3 digest.
//!
//! `blobs/ab/<64 digits>.exr` holds what is complete; `staging/` holds what was uploaded and
//! awaits its completion, under names that a restart forgets. Nothing that came over the network
//! becomes part of a path: paths are made of parsed digests and of numbers counted here.
//!
//! The files are written through `std::fs` because durability is in the details: one `syncfs`
//! before and one after the renames of a whole batch (the local backend of the `object_store`
//! crate syncs neither file nor folder). A store in a bucket goes behind this same type.

use crate::file_error::FileError;
use dataset::{Digest, blob_path};
use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

/// The images of one store. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Blobs {
    root: PathBuf,
    staging: PathBuf,
    staged: Arc<AtomicU64>,
}

/// An uploaded image that is not durable yet. Whoever holds it decides: [`Blobs::publish`] or
/// [`Blobs::discard`].
#[derive(Clone, Debug)]
pub struct StagedFile {
    /// Its digest, which was checked.
    pub digest: Digest,
    path: PathBuf,
}

impl Blobs {
    /// The images of the store in `root`; touches nothing.
    pub fn new(root: &Path) -> Self {
        Self::staged_in(root, root.join("staging"))
    }

    /// The same, with uploads staged in a folder on the same file system that nobody else stages
    /// in.
    pub fn staged_in(root: &Path, staging: PathBuf) -> Self {
        Self {
            root: root.to_owned(),
            staging,
            staged: Arc::default(),
        }
    }

    /// Makes the folders and drops what a process before this one staged. Only for the process
    /// that holds the store's lock.
    pub fn prepare(&self) -> Result<(), FileError> {
        let staging = self.staging.clone();
        match fs::remove_dir_all(&staging) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(FileError::new("clear", &staging)(error));
            }
            _ => {}
        }
        for folder in [staging, self.root.join("blobs")] {
            fs::create_dir_all(&folder).map_err(FileError::new("make", &folder))?;
        }
        Ok(())
    }

    /// Writes an image into staging, without syncing.
    pub fn stage(&self, digest: Digest, bytes: &[u8]) -> Result<StagedFile, FileError> {
        let number = self.staged.fetch_add(1, Ordering::Relaxed);
        let path = self.staging.join(format!("{number}.exr"));
        let written = File::create_new(&path).and_then(|mut file| file.write_all(bytes));
        if let Err(error) = written {
            // The error that counts is the first; a leftover is cleared at the next start.
            drop(fs::remove_file(&path));
            return Err(FileError::new("write", &path)(error));
        }
        Ok(StagedFile { digest, path })
    }

    /// Drops a staged image.
    pub fn discard(&self, staged: &StagedFile) {
        if let Err(error) = fs::remove_file(&staged.path) {
            tracing::warn!(path = %staged.path.display(), %error, "cannot remove a staged image");
        }
    }

    /// Gives a batch of staged images their names, durably: when this returns, a power loss takes
    /// none of them. The bytes are synced before they get their name, so a name never stands for
    /// part of an image.
    pub fn publish<'a>(
        &self,
        staged: impl Iterator<Item = &'a StagedFile> + Clone,
    ) -> Result<(), FileError> {
        if staged.clone().next().is_none() {
            return Ok(());
        }
        self.sync()?;
        for file in staged {
            let path = self.path(&file.digest);
            let mut renamed = fs::rename(&file.path, &path);
            // There are 256 folders, so nearly always it is there.
            if let (Err(error), Some(folder)) = (&renamed, path.parent())
                && error.kind() == io::ErrorKind::NotFound
            {
                fs::create_dir_all(folder).map_err(FileError::new("make", folder))?;
                renamed = fs::rename(&file.path, &path);
            }
            renamed.map_err(FileError::new("rename to", &path))?;
        }
        self.sync()
    }

    /// Syncs the file system that the store is on.
    pub fn sync(&self) -> Result<(), FileError> {
        File::open(&self.root)
            .and_then(|root| Ok(rustix::fs::syncfs(root)?))
            .map_err(FileError::new("sync the file system of", &self.root))
    }

    /// Room on the file system that the store is on, bytes.
    pub fn free_bytes(&self) -> Result<u64, FileError> {
        let asked = rustix::fs::statvfs(&self.root);
        let system = asked.map_err(|error| FileError::new("look at", &self.root)(error.into()))?;
        Ok(system.f_bavail * system.f_frsize)
    }

    /// Where an image is or would be.
    pub fn path(&self, digest: &Digest) -> PathBuf {
        self.root.join(blob_path(digest))
    }

    /// The size of an image in bytes; `None` where it is missing.
    pub fn size(&self, digest: &Digest) -> Result<Option<u64>, FileError> {
        let path = self.path(digest);
        match fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => Ok(Some(metadata.len())),
            Ok(_) => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(FileError::new("read", &path)(error)),
        }
    }

    /// Reads an image that should have `bytes` bytes, and at most one more: a file that grew shows,
    /// and costs no memory. Checks nothing; `verify` does.
    pub fn read(&self, digest: &Digest, bytes: u64) -> Result<Vec<u8>, FileError> {
        let path = self.path(digest);
        // Room for all of it, so that it is read at once; sizes that no image has are not believed.
        let room = bytes.min(proto::limits::BLOB_BYTES_MAX) + 1;
        let mut content = Vec::with_capacity(room as usize);
        File::open(&path)
            .and_then(|file| file.take(bytes + 1).read_to_end(&mut content))
            .map_err(FileError::new("read", &path))?;
        Ok(content)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn staged_becomes_published_and_a_restart_forgets_the_rest() {
        let folder = tempfile::tempdir().unwrap();
        let blobs = Blobs::new(folder.path());
        blobs.prepare().unwrap();
        let digests: Vec<Digest> = (0..3).map(|i| Digest::of(&[i])).collect();
        let staged: Vec<StagedFile> = (0..3u8)
            .map(|i| blobs.stage(digests[i as usize], &[i; 9]).unwrap())
            .collect();
        assert_eq!(blobs.size(&digests[0]).unwrap(), None);
        blobs.publish(staged[..1].iter()).unwrap();
        blobs.discard(&staged[1]);
        assert_eq!(blobs.size(&digests[0]).unwrap(), Some(9));
        assert_eq!(blobs.read(&digests[0], 9).unwrap(), [0; 9]);
        assert_eq!(blobs.read(&digests[0], 4).unwrap().len(), 5);

        let staging = folder.path().join("staging");
        assert_eq!(fs::read_dir(&staging).unwrap().count(), 1);
        Blobs::new(folder.path()).prepare().unwrap();
        assert_eq!(fs::read_dir(&staging).unwrap().count(), 0);
        assert_eq!(blobs.size(&digests[0]).unwrap(), Some(9));
        assert!(blobs.publish(staged[2..].iter()).is_err(), "it was cleared");
    }
}
