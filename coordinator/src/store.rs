//! A store: one folder with everything that is known of one dataset.
//!
//! ```text
//! store.json           version of the layout, of the renderer, hash of the specification
//! specification.json   the whole specification; its presence makes the folder a store
//! completions.log      one line a completed material
//! ledger/              jobs, completions, index of images
//! blobs/ab/...exr      images by digest, unless they are in a bucket
//! staging/             uploads under way
//! lock                 held by the one process that writes
//! ```
//!
//! The specification's hash leaves out its name and its number of materials, which change no
//! image: a store can grow. It knows the largest number ever asked for; asking for fewer leaves it
//! at that, and only means that whoever asks wants no more than those now.

use crate::{
    acceptance::{Rejection, check_digest},
    blobs::{Blobs, Claimed, sync_file_system},
    bucket::BucketUrl,
    completion::Completion,
    completion_log::Completions,
    file_error::FileError,
    ledger::{Ledger, LedgerError},
    limits,
    queue::{Changes, Check, JobChange, JobRecord, JobState},
    recovery::{Recovered, recover},
};
use dataset::{CompletedView, Digest, RENDERER_VERSION, Specification};
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Version of the layout of a store.
const LAYOUT: u32 = 1;

/// Why a store cannot be used.
#[derive(Debug, Error)]
pub enum StoreError {
    /// There is no store.
    #[error("there is no store in {}: it has no specification.json", .0.display())]
    Absent(PathBuf),
    /// There is no store, and something else is in the folder.
    #[error(
        "{} is no store, since it has no specification.json, and holds {found:?}: choose an empty \
         or a new folder",
        path.display()
    )]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// The first thing found in it.
        found: String,
    },
    /// Another process writes to it.
    #[error(
        "another coordinator is using the store {}: wait until it ends, or choose another store",
        .0.display()
    )]
    Locked(PathBuf),
    /// It holds another dataset.
    #[error(
        "the store {} holds another dataset: its specification has the hash {found}, the one \
         given has {given}; choose another store, or the specification it was made with",
        path.display()
    )]
    Specification {
        /// The store.
        path: PathBuf,
        /// The hash of the store's specification.
        found: Digest,
        /// The hash of the specification given.
        given: Digest,
    },
    /// It was made by another renderer, whose images are not the same.
    #[error(
        "the store {} was made with renderer version {found}, and this is version \
         {RENDERER_VERSION}: continue with the program that made it, or choose another store",
        path.display()
    )]
    Renderer {
        /// The store.
        path: PathBuf,
        /// The version that made it.
        found: String,
    },
    /// A file of it cannot be understood.
    #[error("{} is damaged: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Its images are somewhere else than was asked for.
    #[error(
        "the store {} keeps its images in {found}, not in {given}: leave the option out, or choose \
         another store",
        path.display()
    )]
    OtherBlobs {
        /// The store.
        path: PathBuf,
        /// Where it keeps them.
        found: String,
        /// Where they were to be.
        given: BucketUrl,
    },
    /// The place in the bucket is not this store's.
    #[error(
        "{0} belongs to another store, or holds something else: choose another prefix for the \
         images of this one"
    )]
    ForeignBucket(BucketUrl),
    /// The ledger cannot be used.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The system would not do what was asked.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Why the file of a completed image is not as it was.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ImageFault {
    /// It is absent.
    #[error("the image is missing")]
    Missing,
    /// The system would not read it.
    #[error("it cannot be read: {0}")]
    Unreadable(String),
    /// It has another size.
    #[error("it has {} than its {bytes} bytes", if *.more { "more" } else { "fewer" })]
    Size {
        /// The size recorded.
        bytes: u64,
        /// Whether the file is larger.
        more: bool,
    },
    /// It has another digest.
    #[error(transparent)]
    Digest(Rejection),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Identity {
    layout: u32,
    renderer_version: String,
    specification_hash: Digest,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bucket: Option<BucketPlace>,
}

/// Where images are that the store does not keep itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BucketPlace {
    url: BucketUrl,
    /// What the store is called there: drawn at random when it was made.
    owner: String,
}

/// A store open for writing; no other process has it so.
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
                specification.clone()
            }
            kept => {
                let kept = kept?;
                check_bucket(path, bucket)?;
                grow(path, kept, specification)?
            }
        };
        Self::open_locked(path, kept, specification.materials, lock)
    }

    /// Opens a store that is there, with the specification it was made with.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        // Before the lock, which would leave a file behind where there is no store.
        read_specification(path)?;
        let lock = acquire(path)?;
        let kept = read_specification(path)?;
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

    /// What had to be mended when the store was opened.
    pub fn recovery(&self) -> &crate::Recovery {
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
                        check: Check::None,
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

    pub(crate) fn into_parts(self) -> (Blobs, Recovered, File) {
        (self.blobs, self.state, self.lock)
    }
}

/// A store open for reading, beside a coordinator at work or without one. Shows what was complete
/// when it was opened.
#[derive(Debug)]
pub struct ReadOnlyStore {
    path: PathBuf,
    specification: Specification,
    specification_hash: Digest,
    completions: Option<Completions>,
    pub(crate) blobs: Blobs,
}

impl ReadOnlyStore {
    /// Opens the store in a folder.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let specification = read_specification(path)?;
        let completions = match Completions::open(&log_path(path)) {
            Err(error) if error.source.kind() == io::ErrorKind::NotFound => None,
            completions => Some(completions?),
        };
        Ok(Self {
            path: path.to_owned(),
            specification_hash: specification.hash(),
            specification,
            completions,
            blobs: open_blobs(path)?.0,
        })
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

    /// A material's completion, if it is complete.
    pub fn completion(&self, material: u32) -> Result<Option<Completion>, FileError> {
        match &self.completions {
            Some(completions) => completions.get(material),
            None => Ok(None),
        }
    }

    /// Whether a material is complete, as far as its line of the log was whole when the store was
    /// opened. Reads nothing.
    pub fn is_complete(&self, material: u32) -> bool {
        self.completions
            .as_ref()
            .is_some_and(|completions| completions.contains(material))
    }

    /// How many of the specification's materials are not complete.
    pub fn materials_missing(&self) -> u32 {
        let complete = self.completions.iter().flat_map(Completions::materials);
        let materials = self.specification.materials;
        materials - complete.filter(|material| *material < materials).count() as u32
    }

    /// How many lines of the completion log are damaged. Opening the store for writing adds what
    /// they said again where the ledger knows it.
    pub fn log_lines_damaged(&self) -> u64 {
        self.completions
            .as_ref()
            .map_or(0, |completions| completions.bad_line_count)
    }

    /// The completed materials, in order, those too that nobody wants any more.
    pub fn materials_complete(&self) -> impl Iterator<Item = u32> {
        self.completions.iter().flat_map(Completions::materials)
    }

    /// Reads an image as it was completed, and checks its size and digest.
    ///
    /// # Errors
    /// Says what is wrong with its file.
    pub fn read_image(&self, image: &CompletedView) -> Result<Vec<u8>, ImageFault> {
        check_read(image, self.blobs.read(&image.digest, image.bytes))
    }

    /// The same for the images of one material: those in a bucket are read at one time.
    pub fn read_images<'a>(
        &'a self,
        images: &'a [CompletedView],
    ) -> impl Iterator<Item = Result<Vec<u8>, ImageFault>> + 'a {
        let named = images.iter().map(|image| (image.digest, image.bytes));
        let read = self.blobs.read_each(named.collect());
        let read = images.iter().zip(read);
        read.map(|(image, read)| check_read(image, read))
    }

    /// Where an image is, for people: a path, or a URL.
    pub fn image_path(&self, digest: &Digest) -> PathBuf {
        self.blobs.path(digest)
    }

    /// Whether the images are files of this machine, which can be linked to.
    pub fn has_files(&self) -> bool {
        self.blobs.objects().is_none()
    }
}

/// What was read as an image, if it is that image.
fn check_read(
    image: &CompletedView,
    read: Result<Vec<u8>, FileError>,
) -> Result<Vec<u8>, ImageFault> {
    let bytes = read.map_err(|error| match error.source.kind() {
        io::ErrorKind::NotFound => ImageFault::Missing,
        _ => ImageFault::Unreadable(error.source.to_string()),
    })?;
    if bytes.len() as u64 != image.bytes {
        return Err(ImageFault::Size {
            bytes: image.bytes,
            more: bytes.len() as u64 > image.bytes,
        });
    }
    check_digest(&bytes, image.digest).map_err(ImageFault::Digest)?;
    Ok(bytes)
}

fn log_path(store: &Path) -> PathBuf {
    store.join("completions.log")
}

fn acquire(store: &Path) -> Result<File, StoreError> {
    let path = store.join("lock");
    let file = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        .map_err(FileError::new("open", &path))?;
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(file),
        Err(rustix::io::Errno::WOULDBLOCK) => Err(StoreError::Locked(store.to_owned())),
        Err(error) => Err(FileError::new("lock", &path)(error.into()).into()),
    }
}

/// Refuses a folder that holds anything but what a making that was cut short leaves behind. A store
/// that lost its specification is such a folder: nothing says what its images are.
fn check_vacant(path: &Path) -> Result<(), StoreError> {
    const LEFT_BEHIND: [&str; 5] = [
        "lock",
        "lost+found",
        "specification.json.new",
        "store.json",
        "store.json.new",
    ];
    let unreadable = |error| FileError::new("read", path)(error);
    for entry in fs::read_dir(path).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        if !LEFT_BEHIND.iter().any(|left| name == *left) {
            return Err(StoreError::Occupied {
                path: path.to_owned(),
                found: name.to_string_lossy().into_owned(),
            });
        }
    }
    Ok(())
}

/// The identity goes first: the folder is a store from the moment it has a specification.
fn create(
    path: &Path,
    specification: &Specification,
    bucket: Option<&BucketUrl>,
) -> Result<(), StoreError> {
    let place = |url: &BucketUrl| {
        let mut owner = [0; 16];
        getrandom::fill(&mut owner)
            .map_err(|error| FileError::new("name", path)(io::Error::other(error)))?;
        Ok::<_, FileError>(BucketPlace {
            url: url.clone(),
            owner: owner.iter().map(|byte| format!("{byte:02x}")).collect(),
        })
    };
    let identity = Identity {
        layout: LAYOUT,
        renderer_version: RENDERER_VERSION.to_owned(),
        specification_hash: specification.hash(),
        bucket: bucket.map(place).transpose()?,
    };
    let json = serde_json::to_string_pretty(&identity)
        .map_err(|error| damaged(&path.join("store.json"), error))?;
    write_durably(&path.join("store.json"), json.as_bytes())?;
    write_specification(path, specification)
}

/// Where the images of a store are. Asks no bucket yet.
fn open_blobs(path: &Path) -> Result<(Blobs, Option<BucketPlace>), StoreError> {
    let place = read_identity(path)?.bucket;
    let blobs = match &place {
        None => Blobs::new(path),
        Some(place) => Blobs::in_bucket(path, &place.url)?,
    };
    Ok((blobs, place))
}

fn check_bucket(path: &Path, given: Option<&BucketUrl>) -> Result<(), StoreError> {
    let found = read_identity(path)?.bucket.map(|place| place.url);
    match given {
        Some(given) if found.as_ref() != Some(given) => Err(StoreError::OtherBlobs {
            path: path.to_owned(),
            found: found.map_or("its own folder".to_owned(), |url| url.to_string()),
            given: given.clone(),
        }),
        _ => Ok(()),
    }
}

fn grow(
    path: &Path,
    mut kept: Specification,
    given: &Specification,
) -> Result<Specification, StoreError> {
    if kept.hash() != given.hash() {
        return Err(StoreError::Specification {
            path: path.to_owned(),
            found: kept.hash(),
            given: given.hash(),
        });
    }
    if given.materials > kept.materials {
        kept.materials = given.materials;
        write_specification(path, &kept)?;
    }
    Ok(kept)
}

fn write_specification(store: &Path, specification: &Specification) -> Result<(), StoreError> {
    let json = specification.to_json();
    Ok(write_durably(
        &store.join("specification.json"),
        json.as_bytes(),
    )?)
}

fn read_specification(store: &Path) -> Result<Specification, StoreError> {
    let path = store.join("specification.json");
    let json = match read_bounded(&path) {
        Err(StoreError::File(FileError { source, .. }))
            if matches!(
                source.kind(),
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
            ) =>
        {
            return Err(StoreError::Absent(store.to_owned()));
        }
        json => json?,
    };
    let specification = Specification::from_json(&json).map_err(|error| damaged(&path, error))?;
    let identity = read_identity(store)?;
    let path = store.join("store.json");
    if identity.layout != LAYOUT {
        let reason = format!(
            "the store has layout {}, and this program knows layout {LAYOUT}",
            identity.layout
        );
        return Err(damaged(&path, reason));
    }
    if identity.renderer_version != RENDERER_VERSION {
        return Err(StoreError::Renderer {
            path: store.to_owned(),
            found: identity.renderer_version,
        });
    }
    let hash = specification.hash();
    if identity.specification_hash != hash {
        let reason = format!(
            "it names a specification of hash {}, but specification.json has {hash}",
            identity.specification_hash
        );
        return Err(damaged(&path, reason));
    }
    Ok(specification)
}

fn read_identity(store: &Path) -> Result<Identity, StoreError> {
    let path = store.join("store.json");
    serde_json::from_str(&read_bounded(&path)?).map_err(|error| damaged(&path, error))
}

fn read_bounded(path: &Path) -> Result<String, StoreError> {
    let mut text = String::new();
    File::open(path)
        .and_then(|file| {
            file.take(limits::SPECIFICATION_BYTES_MAX)
                .read_to_string(&mut text)
        })
        .map_err(FileError::new("read", path))?;
    Ok(text)
}

/// Writes beside, syncs, renames, syncs the folder: there is the file before or the file after.
fn write_durably(path: &Path, content: &[u8]) -> Result<(), FileError> {
    let beside = path.with_extension("json.new");
    File::create(&beside)
        .and_then(|mut file| {
            file.write_all(content)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&beside, path))
        .and_then(|()| match path.parent() {
            Some(folder) => File::open(folder)?.sync_all(),
            None => Ok(()),
        })
        .map_err(FileError::new("write", path))
}

fn damaged(path: &Path, reason: impl ToString) -> StoreError {
    StoreError::Damaged {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}
