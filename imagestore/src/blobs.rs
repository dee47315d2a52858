//! The blob store: images named by their BLAKE3 digest, as files of the store or in a bucket.
//!
//! `blobs/ab/<64 digits>.exr` holds what is complete. What was uploaded and awaits its completion
//! lies in `staging/`: in a folder under names that a restart forgets, in a bucket under names that
//! its lease gives, so that any coordinator finds it.
//!
//! Files come through the coordinator, which checks them before it stages them; objects of a bucket
//! come from the workers themselves (the coordinator's `farm/uploads.rs`).

mod folder;
mod objects;

pub use folder::sync_file_system;
pub use objects::Objects;
pub use objects::{Claimed, staging_key};

use crate::{
    FileError,
    bucket::{Bucket, BucketUrl},
    room::Room,
};
use dataset::Digest;
use folder::Folder;
use std::{
    io,
    path::{Path, PathBuf},
};

/// The images of one store. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Blobs {
    room: Room,
    place: Place,
}

#[derive(Clone, Debug)]
enum Place {
    Folder(Folder),
    Bucket(Objects),
}

/// An uploaded image that is not durable yet. Whoever holds it decides: [`Blobs::publish`] or
/// [`Blobs::discard`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StagedFile {
    /// Its digest, which was checked.
    pub digest: Digest,
    path: PathBuf,
}

/// Something that lies among the images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Where it is.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// What its name makes of it.
    pub name: Name,
}

/// What the name of a file or an object makes of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Name {
    /// An image that is complete.
    Image(Digest),
    /// Uploaded into a bucket, and its material not complete when it came.
    Upload,
    /// Put there by somebody else.
    Other,
}

impl Blobs {
    /// The images of the store in `root`, as its files; touches nothing.
    pub fn new(root: &Path) -> Self {
        Self {
            room: Room::all_of(root),
            place: Place::Folder(Folder::new(root)),
        }
    }

    /// The same, with uploads staged in a folder on the same file system that nobody else stages
    /// in.
    pub fn staged_in(root: &Path, staging: PathBuf) -> Self {
        Self {
            room: Room::all_of(root),
            place: Place::Folder(Folder::staged_in(root, staging)),
        }
    }

    /// The images of the store in `root`, which are in a bucket; asks nobody yet.
    ///
    /// # Errors
    /// When the environment makes no sense of it.
    pub fn in_bucket(root: &Path, url: &BucketUrl) -> Result<Self, FileError> {
        Ok(Self {
            room: Room::all_of(root),
            place: Place::Bucket(Objects::new(Bucket::open(url)?)),
        })
    }

    /// The bucket that they are in, if they are.
    pub fn objects(&self) -> Option<&Objects> {
        match &self.place {
            Place::Folder(_) => None,
            Place::Bucket(objects) => Some(objects),
        }
    }

    /// Makes the folders and drops what a process before this one staged. Only for the process
    /// that holds the store's lock. What was uploaded into a bucket stays for its lease to
    /// complete.
    pub fn prepare(&self) -> Result<(), FileError> {
        match &self.place {
            Place::Folder(folder) => folder.prepare(),
            Place::Bucket(_) => Ok(()),
        }
    }

    /// Makes sure that a bucket's place is this store's, which is called `owner`.
    pub fn claim(&self, owner: &str) -> Result<Claimed, FileError> {
        match &self.place {
            Place::Folder(_) => Ok(Claimed::Ours),
            Place::Bucket(objects) => objects.claim(owner),
        }
    }

    /// Writes an image into a folder's staging, without syncing. Images for a bucket are never
    /// staged here.
    pub fn stage(&self, digest: Digest, bytes: &[u8]) -> Result<StagedFile, FileError> {
        self.folder().stage(digest, bytes)
    }

    /// Drops a staged image, if it is still there.
    pub fn discard(&self, staged: &StagedFile) {
        if let Err(error) = std::fs::remove_file(&staged.path)
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(path = %staged.path.display(), %error, "cannot remove a staged image");
        }
    }

    /// Gives staged images their names, durably: when this returns, a power loss takes none of them.
    /// The bytes are synced before they get their name, so a name never stands for part of an image.
    /// Each group, such as a material's images, has an answer of its own.
    ///
    /// # Errors
    /// When the file system does not sync: then nobody knows what of any group is on the disk.
    pub fn publish_each(
        &self,
        groups: &[Vec<StagedFile>],
    ) -> Result<Vec<Result<(), FileError>>, FileError> {
        self.folder().publish_each(groups)
    }

    /// Gives staged images their names, durably.
    pub fn publish(&self, staged: Vec<StagedFile>) -> Result<(), FileError> {
        if staged.is_empty() {
            return Ok(());
        }
        self.publish_each(&[staged])?.into_iter().collect()
    }

    /// Puts images that were checked under their names, durably, whatever was there before.
    pub fn put(&self, images: &[(Digest, Vec<u8>)]) -> Result<(), FileError> {
        match &self.place {
            Place::Folder(folder) => {
                let staged = images
                    .iter()
                    .map(|(digest, bytes)| folder.stage(*digest, bytes))
                    .collect::<Result<Vec<_>, FileError>>()?;
                self.publish(staged)
            }
            Place::Bucket(objects) => objects.put(images),
        }
    }

    /// The same images, of whose folder's file system `bytes` stay free.
    #[must_use]
    pub fn keeping_free(self, bytes: u64) -> Self {
        Self {
            room: self.room.keeping(bytes),
            ..self
        }
    }

    /// Room on the file system that the store's folder is on.
    pub fn room(&self) -> &Room {
        &self.room
    }

    /// Whether another image may come.
    ///
    /// # Errors
    /// [`io::ErrorKind::StorageFull`] when the folder's file system is full. A bucket says so
    /// itself.
    pub fn check_room(&self) -> Result<(), FileError> {
        match &self.place {
            Place::Folder(_) => self.room.for_images(),
            Place::Bucket(_) => Ok(()),
        }
    }

    /// Where an image is or would be, for people: a path, or a URL.
    pub fn path(&self, digest: &Digest) -> PathBuf {
        match &self.place {
            Place::Folder(folder) => folder.path(digest),
            Place::Bucket(objects) => objects.path(digest),
        }
    }

    /// The sizes of images in bytes; `None` where one is missing.
    pub fn sizes(&self, digests: &[Digest]) -> Result<Vec<Option<u64>>, FileError> {
        match &self.place {
            Place::Folder(folder) => digests.iter().map(|digest| folder.size(digest)).collect(),
            Place::Bucket(objects) => objects.sizes(digests),
        }
    }

    /// The size of an image in bytes; `None` where it is missing.
    pub fn size(&self, digest: &Digest) -> Result<Option<u64>, FileError> {
        match &self.place {
            Place::Folder(folder) => folder.size(digest),
            Place::Bucket(objects) => Ok(objects.sizes(&[*digest])?[0]),
        }
    }

    /// Reads an image that should have `bytes` bytes, and at most one more: a file that grew shows,
    /// and costs no memory. Checks nothing; `verify` does.
    pub fn read(&self, digest: &Digest, bytes: u64) -> Result<Vec<u8>, FileError> {
        match &self.place {
            Place::Folder(folder) => folder.read(digest, bytes),
            Place::Bucket(objects) => {
                let mut read = objects.read(&[(*digest, bytes)]);
                read.swap_remove(0)
            }
        }
    }

    /// Reads images one after another as they are asked for; those in a bucket several at a time,
    /// and all before the first is handed out, so that nobody waits for each. Meant for the images
    /// of one material.
    pub fn read_each<'a>(
        &'a self,
        images: Vec<(Digest, u64)>,
    ) -> Box<dyn Iterator<Item = Result<Vec<u8>, FileError>> + 'a> {
        match &self.place {
            Place::Folder(folder) => {
                let images = images.into_iter();
                Box::new(images.map(|(digest, bytes)| folder.read(&digest, bytes)))
            }
            Place::Bucket(objects) => Box::new(objects.read(&images).into_iter()),
        }
    }

    /// Tells everything that lies among the images, and uploads that a bucket has.
    pub fn for_each(&self, look: &mut dyn FnMut(Entry)) -> Result<(), FileError> {
        match &self.place {
            Place::Folder(folder) => folder.for_each(look),
            Place::Bucket(objects) => objects.for_each(look),
        }
    }

    /// Removes what lies there.
    pub fn remove(&self, paths: &[PathBuf]) -> Result<(), FileError> {
        match &self.place {
            Place::Folder(folder) => folder.remove(paths),
            Place::Bucket(objects) => objects.remove(paths),
        }
    }

    fn folder(&self) -> &Folder {
        match &self.place {
            Place::Folder(folder) => folder,
            Place::Bucket(_) => unreachable!("nothing is staged here for a bucket"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

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
        blobs.publish(staged[..1].to_vec()).unwrap();
        blobs
            .publish(staged[..1].to_vec())
            .expect("somebody did it before");
        blobs.discard(&staged[1]);
        assert_eq!(blobs.size(&digests[0]).unwrap(), Some(9));
        assert_eq!(blobs.read(&digests[0], 9).unwrap(), [0; 9]);
        assert_eq!(blobs.read(&digests[0], 4).unwrap().len(), 5);

        let staging = folder.path().join("staging");
        assert_eq!(fs::read_dir(&staging).unwrap().count(), 1);
        Blobs::new(folder.path()).prepare().unwrap();
        assert_eq!(fs::read_dir(&staging).unwrap().count(), 0);
        assert_eq!(blobs.size(&digests[0]).unwrap(), Some(9));
        assert!(
            blobs.publish(staged[2..].to_vec()).is_err(),
            "it was cleared"
        );
    }
}
