//! Images as files of the store's own folder.
//!
//! They are written through `std::fs` because durability is in the details: one `syncfs` before
//! and one after the renames of a whole batch (the local backend of the `object_store` crate syncs
//! neither file nor folder). Nothing that came over the network becomes part of a path: paths are
//! made of parsed digests and of numbers counted here.

use super::{Entry, Name, StagedFile};
use crate::FileError;
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

/// The images of a store that keeps them itself.
#[derive(Clone, Debug)]
pub(super) struct Folder {
    root: PathBuf,
    staging: PathBuf,
    staged: Arc<AtomicU64>,
}

impl Folder {
    pub fn new(root: &Path) -> Self {
        Self::staged_in(root, root.join("staging"))
    }

    pub fn staged_in(root: &Path, staging: PathBuf) -> Self {
        Self {
            root: root.to_owned(),
            staging,
            staged: Arc::default(),
        }
    }

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

    pub fn publish_each(
        &self,
        groups: &[Vec<StagedFile>],
    ) -> Result<Vec<Result<(), FileError>>, FileError> {
        sync_file_system(&self.root)?;
        let named = groups
            .iter()
            .map(|files| files.iter().try_for_each(|file| self.name(file)));
        let named = named.collect();
        sync_file_system(&self.root)?;
        Ok(named)
    }

    /// Gives a staged image its name; syncs nothing.
    fn name(&self, file: &StagedFile) -> Result<(), FileError> {
        let path = self.path(&file.digest);
        let mut renamed = fs::rename(&file.path, &path);
        // There are 256 folders, so nearly always it is there.
        if let (Err(error), Some(folder)) = (&renamed, path.parent())
            && error.kind() == io::ErrorKind::NotFound
        {
            fs::create_dir_all(folder).map_err(FileError::new("make", folder))?;
            renamed = fs::rename(&file.path, &path);
        }
        // A completion that is reported twice at one time publishes its images twice.
        if renamed.is_err() && !file.path.exists() && path.exists() {
            return Ok(());
        }
        renamed.map_err(FileError::new("rename to", &path))
    }

    pub fn path(&self, digest: &Digest) -> PathBuf {
        self.root.join(blob_path(digest))
    }

    pub fn size(&self, digest: &Digest) -> Result<Option<u64>, FileError> {
        let path = self.path(digest);
        match fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => Ok(Some(metadata.len())),
            Ok(_) => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(FileError::new("read", &path)(error)),
        }
    }

    pub fn read(&self, digest: &Digest, bytes: u64) -> Result<Vec<u8>, FileError> {
        let path = self.path(digest);
        // Room for all of it, so that it is read at once; sizes that no image has are not believed.
        let room = bytes.min(limits::protocol::BLOB_BYTES_MAX) + 1;
        let mut content = Vec::with_capacity(room as usize);
        File::open(&path)
            .and_then(|file| file.take(bytes + 1).read_to_end(&mut content))
            .map_err(FileError::new("read", &path))?;
        Ok(content)
    }

    pub fn for_each(&self, look: &mut dyn FnMut(Entry)) -> Result<(), FileError> {
        let mut folders = vec![self.root.join("blobs")];
        while let Some(folder) = folders.pop() {
            let entries = match fs::read_dir(&folder) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                entries => entries.map_err(FileError::new("list", &folder))?,
            };
            for entry in entries {
                let path = entry.map_err(FileError::new("list", &folder))?.path();
                let metadata =
                    fs::symlink_metadata(&path).map_err(FileError::new("read", &path))?;
                if metadata.is_dir() {
                    folders.push(path);
                    continue;
                }
                let stem = path.file_stem().and_then(|stem| stem.to_str());
                let digest: Option<Digest> = stem.and_then(|stem| stem.parse().ok());
                let name = match digest {
                    Some(digest) if self.path(&digest) == path => Name::Image(digest),
                    _ => Name::Other,
                };
                let bytes = metadata.len();
                look(Entry { path, bytes, name });
            }
        }
        Ok(())
    }

    pub fn remove(&self, paths: &[PathBuf]) -> Result<(), FileError> {
        for path in paths {
            fs::remove_file(path).map_err(FileError::new("remove", path))?;
        }
        Ok(())
    }
}

/// Syncs the file system that a folder is on.
pub fn sync_file_system(folder: &Path) -> Result<(), FileError> {
    File::open(folder)
        .and_then(|folder| Ok(rustix::fs::syncfs(folder)?))
        .map_err(FileError::new("sync the file system of", folder))
}
