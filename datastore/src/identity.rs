//! What makes a folder a store: which dataset it is of, and where its images are.

use super::{StoreError, durable::write_durably, mesh_file};
use crate::{CopyError, Holder};
use dataset::{Digest, RENDERER_VERSION, Specification, specification::Differences};
use imagestore::{
    FileError,
    blobs::{Blobs, Claimed, sync_file_system},
    bucket::BucketUrl,
};
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use std::{
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
    thread,
    time::Instant,
};

/// Version of the layout of a store.
const LAYOUT: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Identity {
    layout: u32,
    renderer_version: String,
    specification_hash: Digest,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bucket: Option<BucketPlace>,
}

/// What a folder says that is half of a copy.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Copy {
    from: String,
    specification_hash: Digest,
}

/// Where images are that the store does not keep itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BucketPlace {
    pub url: BucketUrl,
    /// What the store is called there: drawn at random when it was made.
    pub owner: String,
}

/// The completion log of the store in a folder.
pub fn log_path(store: &Path) -> PathBuf {
    store.join("completions.log")
}

pub(super) fn acquire(store: &Path) -> Result<File, StoreError> {
    let path = store.join("lock");
    let file = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(&path)
        .map_err(FileError::new("open", &path))?;
    let started = Instant::now();
    loop {
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {
                // What the holder before said of itself is no longer true.
                file.set_len(0).map_err(FileError::new("empty", &path))?;
                return Ok(file);
            }
            // A process that was being started when the last holder closed it has it until it
            // begins.
            Err(rustix::io::Errno::WOULDBLOCK) if started.elapsed() < limits::STORE_LOCK_WAIT => {
                thread::sleep(limits::STORE_LOCK_PAUSE);
            }
            Err(rustix::io::Errno::WOULDBLOCK) => {
                return Err(StoreError::Locked {
                    path: store.to_owned(),
                    holder: Holder::of(store),
                });
            }
            Err(error) => return Err(FileError::new("lock", &path)(error.into()).into()),
        }
    }
}

/// Refuses a folder that holds anything but what a making that was cut short leaves behind. A store
/// that lost its specification is such a folder: nothing says what its images are.
pub(super) fn check_vacant(path: &Path) -> Result<(), StoreError> {
    const LEFT_BEHIND: [&str; 6] = [
        "lock",
        "lost+found",
        "migration.json.new",
        "specification.json.new",
        "store.json",
        "store.json.new",
    ];
    let unreadable = |error| FileError::new("read", path)(error);
    for entry in fs::read_dir(path).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        if !LEFT_BEHIND.iter().any(|left| name == *left) && !mesh_file::is_left_behind(&name) {
            return Err(StoreError::Occupied {
                path: path.to_owned(),
                found: name.to_string_lossy().into_owned(),
            });
        }
    }
    Ok(())
}

/// The mesh goes first, then the identity: the folder is a store from the moment it has a specification.
pub(super) fn create(
    path: &Path,
    specification: &Specification,
    bucket: Option<&BucketUrl>,
) -> Result<(), StoreError> {
    mesh_file::write(path, specification)?;
    write_identity(path, specification, bucket)?;
    write_specification(path, specification)
}

fn write_identity(
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
    Ok(write_durably(&path.join("store.json"), json.as_bytes())?)
}

/// Makes a folder half of a copy of another store, or goes on with one that is; what its images
/// are, and its lock.
pub fn begin_copy(
    path: &Path,
    specification: &Specification,
    bucket: Option<&BucketUrl>,
    from: &str,
) -> Result<(Blobs, File), StoreError> {
    fs::create_dir_all(path).map_err(FileError::new("make", path))?;
    check_target(path, specification, from)?;
    let lock = acquire(path)?;
    // Somebody may have had it until now.
    let begun = check_target(path, specification, from)?;
    if !begun {
        let copy = Copy {
            from: from.to_owned(),
            specification_hash: specification.hash(),
        };
        let json = serde_json::to_vec_pretty(&copy);
        let json = json.map_err(|error| damaged(&copy_path(path), error))?;
        write_durably(&copy_path(path), &json)?;
    }
    if !begun || !path.join("store.json").exists() {
        mesh_file::write(path, specification)?;
        write_identity(path, specification, bucket)?;
    }
    check_bucket(path, bucket)?;
    let (blobs, place) = open_blobs(path)?;
    if let Some(place) = place
        && blobs.claim(&place.owner)? == Claimed::Others
    {
        // As if nothing had been tried: another place may do.
        for file in [path.join("store.json"), copy_path(path)] {
            fs::remove_file(&file).map_err(FileError::new("remove", &file))?;
        }
        return Err(StoreError::ForeignBucket(place.url));
    }
    blobs.prepare()?;
    Ok((blobs, lock))
}

/// Makes the copy a store.
pub fn end_copy(path: &Path, specification: &Specification) -> Result<(), StoreError> {
    sync_file_system(path)?;
    write_specification(path, specification)?;
    let marker = copy_path(path);
    let removed = fs::remove_file(&marker).and_then(|()| File::open(path)?.sync_all());
    Ok(removed.map_err(FileError::new("remove", &marker))?)
}

/// Whether a folder is half of this copy already; else it is empty.
fn check_target(
    path: &Path,
    specification: &Specification,
    from: &str,
) -> Result<bool, StoreError> {
    let name = path.display().to_string();
    if let Some(copy) = read_copy(path)? {
        let given_hash = specification.hash();
        if copy.from == from && copy.specification_hash == given_hash {
            return Ok(true);
        }
        let found = (&*copy.from, copy.specification_hash);
        return Err(CopyError::other(name, found, (from, given_hash)).into());
    }
    match read_specification(path) {
        Err(StoreError::Absent(_)) => check_vacant(path).map(|()| false),
        _ => Err(CopyError::Taken(name).into()),
    }
}

fn copy_path(store: &Path) -> PathBuf {
    store.join("migration.json")
}

fn read_copy(store: &Path) -> Result<Option<Copy>, StoreError> {
    let path = copy_path(store);
    match read_bounded(&path) {
        Err(StoreError::File(error)) if is_absent(&error.source) => Ok(None),
        json => {
            let copy = serde_json::from_str(&json?).map_err(|error| damaged(&path, error));
            copy.map(Some)
        }
    }
}

fn is_absent(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
    )
}

/// Where the images of a store are. Asks no bucket yet.
pub(super) fn open_blobs(path: &Path) -> Result<(Blobs, Option<BucketPlace>), StoreError> {
    let place = read_identity(path)?.bucket;
    let blobs = match &place {
        None => Blobs::new(path),
        Some(place) => Blobs::in_bucket(path, &place.url)?,
    };
    Ok((blobs, place))
}

pub(super) fn check_bucket(path: &Path, given: Option<&BucketUrl>) -> Result<(), StoreError> {
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

pub(super) fn grow(
    path: &Path,
    mut kept: Specification,
    given: &Specification,
) -> Result<Specification, StoreError> {
    if kept.hash() != given.hash() {
        return Err(StoreError::Specification {
            path: path.to_owned(),
            differences: Differences::between(&kept, given),
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

/// The specification of a store; the mesh that it names is not loaded ([`mesh_file::load`]).
pub(super) fn read_specification(store: &Path) -> Result<Specification, StoreError> {
    if let Some(copy) = read_copy(store)? {
        let (name, from) = (store.display().to_string(), copy.from);
        return Err(CopyError::Half { name, from }.into());
    }
    let path = store.join("specification.json");
    let json = match read_bounded(&path) {
        Err(StoreError::File(error)) if is_absent(&error.source) => {
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

fn damaged(path: &Path, reason: impl ToString) -> StoreError {
    StoreError::Damaged {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_holder_that_says_nothing_is_not_taken_for_the_one_before() {
        let folder = tempfile::tempdir().unwrap();
        let before = acquire(folder.path()).unwrap();
        let url = "http://127.0.0.1:40001".to_owned();
        Holder::here(url).announce(&before).unwrap();
        assert!(Holder::of(folder.path()).is_some());
        drop(before);
        let _repairing = acquire(folder.path()).unwrap();
        assert_eq!(Holder::of(folder.path()), None);
    }

    #[test]
    fn a_lock_is_waited_for_and_then_refused() {
        let folder = tempfile::tempdir().unwrap();
        let held = acquire(folder.path()).unwrap();
        let refused = acquire(folder.path());
        assert!(matches!(refused, Err(StoreError::Locked { .. })));
        let ending = thread::spawn(move || {
            thread::sleep(limits::STORE_LOCK_WAIT / 4);
            drop(held);
        });
        assert!(acquire(folder.path()).is_ok());
        ending.join().unwrap();
    }
}
