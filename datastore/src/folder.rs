//! A store in a folder, open for the one process that writes.

use super::{
    StoreError,
    identity::{
        acquire, check_bucket, check_vacant, create, grow, log_path, open_blobs, read_specification,
    },
    mesh_file,
};
use dataset::{Digest, Specification};
use imagestore::{
    FileError,
    blobs::{Blobs, Claimed, sync_file_system},
    bucket::BucketUrl,
};
use jobqueue::{Changes, Completion, JobChange, JobRecord, JobState, RedundantRender};
use jobstore::{Recovered, ledger::Ledger, recover};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

/// A store in a folder, open for writing; no other process has it so.
pub struct Store {
    path: PathBuf,
    specification: Specification,
    specification_hash: Digest,
    materials_asked: u32,
    pub(crate) blobs: Blobs,
    pub(crate) state: Recovered,
    // Held for as long as the store is open.
    lock: File,
}

impl Store {
    /// Opens the store in a folder, or makes one, for a specification.
    pub fn open_or_create(path: &Path, specification: &Specification) -> Result<Self, StoreError> {
        Self::open_or_create_in(path, specification, None)
    }

    /// The same, with images in a bucket. Where none is given a new store keeps them itself, and
    /// one that is there knows where they are.
    pub fn open_or_create_in(
        path: &Path,
        specification: &Specification,
        bucket: Option<&BucketUrl>,
    ) -> Result<Self, StoreError> {
        fs::create_dir_all(path).map_err(FileError::new("make", path))?;
        if matches!(read_specification(path), Err(StoreError::Absent(_))) {
            // Before the lock, which would leave a file behind in a folder of somebody else.
            check_vacant(path)?;
        }
        let lock = acquire(path)?;
        let kept = match read_specification(path) {
            Err(StoreError::Absent(_)) => {
                create(path, specification, bucket)?;
                mesh_file::load(path, specification.clone())?
            }
            kept => {
                let kept = kept?;
                check_bucket(path, bucket)?;
                let kept = grow(path, kept, specification)?;
                mesh_file::load_or_restore(path, kept, specification)?
            }
        };
        Self::open_locked(path, kept, specification.materials, lock)
    }

    /// Opens a store that is there, with the specification it was made with.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        // Before the lock, which would leave a file behind where there is no store.
        read_specification(path)?;
        let lock = acquire(path)?;
        let kept = mesh_file::load(path, read_specification(path)?)?;
        let materials = kept.materials;
        Self::open_locked(path, kept, materials, lock)
    }

    fn open_locked(
        path: &Path,
        specification: Specification,
        materials_asked: u32,
        lock: File,
    ) -> Result<Self, StoreError> {
        let (blobs, place) = open_blobs(path)?;
        if let Some(place) = place
            && blobs.claim(&place.owner)? == Claimed::Others
        {
            return Err(StoreError::ForeignBucket(place.url));
        }
        blobs.prepare()?;
        let views = specification.views.len();
        let state = recover(&path.join("ledger"), &log_path(path), &blobs, views)?;
        // New folders and files are as durable as what will be put into them.
        sync_file_system(path)?;
        Ok(Self {
            path: path.to_owned(),
            specification_hash: specification.hash(),
            specification,
            materials_asked,
            blobs,
            state,
            lock,
        })
    }

    /// The specification of the store in a folder, if there is one, with its mesh.
    pub fn kept_specification(path: &Path) -> Result<Option<Specification>, StoreError> {
        match read_specification(path) {
            Err(StoreError::Absent(_)) => Ok(None),
            kept => mesh_file::load(path, kept?).map(Some),
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The specification; its number of materials is the largest ever asked for.
    pub fn specification(&self) -> &Specification {
        &self.specification
    }

    /// The specification's hash.
    pub fn specification_hash(&self) -> Digest {
        self.specification_hash
    }

    /// How many materials are wanted now: those from 0 to one less.
    pub fn materials_asked(&self) -> u32 {
        self.materials_asked
    }

    /// The images.
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    /// What had to be mended when the store was opened.
    pub fn recovery(&self) -> &jobstore::Recovery {
        &self.state.recovery
    }

    /// What the ledger says of a completed material; the log may say something else where either
    /// was changed by hand.
    pub fn completion_in_ledger(&self, material: u32) -> Result<Option<Completion>, StoreError> {
        Ok(self.state.ledger.completion(material)?)
    }

    /// Puts images and completions into the store, durably, in the order of a commit: images first,
    /// then the log, then the ledger. What was there of the same name is replaced. Whoever calls
    /// has checked them.
    pub fn put(
        &mut self,
        completions: &[Completion],
        images: &[(Digest, Vec<u8>)],
    ) -> Result<(), StoreError> {
        self.blobs.put(images)?;
        if completions.is_empty() {
            return Ok(());
        }
        self.state.log.append(completions)?;
        let jobs = completions
            .iter()
            .map(|completion| JobChange {
                material: completion.material,
                record: JobRecord {
                    state: JobState::Completed {
                        fingerprint: completion.fingerprint(),
                        worker: completion.worker.clone(),
                        redundant: RedundantRender::None,
                    },
                    ..JobRecord::default()
                },
            })
            .collect();
        let changes = Changes {
            jobs,
            ..Changes::default()
        };
        self.state.ledger.apply(&changes, completions)?;
        Ok(self.state.ledger.sync()?)
    }

    /// The images, everything else that is kept, and the lock.
    pub fn into_parts(self) -> (Blobs, Recovered, File) {
        (self.blobs, self.state, self.lock)
    }
}
