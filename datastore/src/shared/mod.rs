//! A store of several coordinators: jobs, labels and leases in a PostgreSQL database, images in a
//! bucket, or in a folder that all of them reach.
//!
//! The database says what the dataset is and where its images are. For images in a folder a
//! coordinator stages uploads in a folder of its own, which it keeps locked; what one that died
//! left behind is cleared by the next that starts.
//!
//! Commands read it as it was at one instant, and block nobody. Commands that write take turns
//! (`writing.rs`). Both block their thread: a command has nothing else to do.

mod identity;
mod kept_mesh;
mod place;
mod reading;
mod staging;
mod writing;

use crate::CopyError;
use dataset::{Digest, RENDERER_VERSION, Specification, specification::Differences};
use identity::{check, check_target, known};
use imagestore::{
    FileError,
    blobs::{Blobs, Claimed},
    bucket::BucketUrl,
};
use jobstore_postgres::{Database, Identity, MaintenanceSession, is_database};
use staging::make_staging;
use std::{fs::File, path::Path};
use thiserror::Error;
use tokio::{runtime, task};

pub use jobstore_postgres::DatabaseError;
pub use place::BlobsPlace;
pub use reading::{load_mesh, read, snapshot};
pub use writing::SharedWriter;

/// Why a shared store cannot be used.
#[derive(Debug, Error)]
pub enum SharedStoreError {
    /// The database cannot be used.
    #[error(transparent)]
    Database(#[from] DatabaseError),
    /// There is no store in it.
    #[error(
        "there is no store in {0}: `brdfarm coordinator serve`, `run` and `dataset import` make one"
    )]
    Absent(String),
    /// It is half of a copy, or none can be made there.
    #[error(transparent)]
    Copy(#[from] CopyError),
    /// Another command writes to it.
    #[error("another command is writing to {0}: wait until it ends")]
    Locked(String),
    /// Somebody may be about to name an image.
    #[error(
        "{leases} of the materials of {name} are with workers, whose images may be named at any \
         moment: `brdfarm pause`, wait until none is (a coordinator takes back what is lost), and \
         try again"
    )]
    Leased {
        /// The database.
        name: String,
        /// How many.
        leases: u32,
    },
    /// It holds another dataset.
    #[error(
        "{name} holds another dataset ({differences}): choose another database, or the \
         specification it was made with"
    )]
    Specification {
        /// The database.
        name: String,
        /// What the given specification has otherwise.
        differences: Differences,
    },
    /// It was made by another renderer, whose images are not the same.
    #[error(
        "{name} was made with renderer version {found}, and this is version {RENDERER_VERSION}: \
         continue with the program that made it, or choose another database"
    )]
    Renderer {
        /// The database.
        name: String,
        /// The version that made it.
        found: String,
    },
    /// The mesh of its sample is missing or damaged.
    #[error(
        "the mesh of the dataset in {name} {reason}: restore the table meshes from a backup of the \
         database, or give the specification again, beside its mesh ({digest}.mesh, which every export \
         of the dataset has beside specification.toml): `brdfarm run --spec FILE`"
    )]
    Mesh {
        /// The database.
        name: String,
        /// By what the specification names it.
        digest: Digest,
        /// What is wrong with it.
        reason: String,
    },
    /// A store was to be made for a specification whose mesh is named only.
    #[error(
        "the specification names the mesh {0}, which is not loaded: read the specification from a \
         file that has {0}.mesh beside it"
    )]
    MeshNotLoaded(Digest),
    /// Nobody said where the images are to be.
    #[error("{0} is a new store: say where its images are to be, by --blobs")]
    BlobsUnknown(String),
    /// Its images are elsewhere.
    #[error("the images of {name} are in {found}, not in {given}")]
    Blobs {
        /// The database.
        name: String,
        /// Where they are.
        found: Box<BlobsPlace>,
        /// What was given.
        given: Box<BlobsPlace>,
    },
    /// The place in the bucket is another store's.
    #[error("{0} has the images of another store: choose another prefix")]
    ForeignBucket(BucketUrl),
    /// It cannot be understood.
    #[error("{name} is damaged: {reason}")]
    Damaged {
        /// The database.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The system would not do what was asked.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A store that any number of coordinators have open.
pub struct SharedStore {
    /// Where the jobs are.
    pub database: Database,
    pub(crate) specification: Specification,
    /// The images.
    pub blobs: Blobs,
    /// Held for as long as the store is open, where images are in a folder: what is staged there is
    /// somebody's.
    pub staging_lock: Option<File>,
}

impl SharedStore {
    /// Whether the name of a store is that of a shared one.
    pub fn is_named_by(name: &str) -> bool {
        is_database(name)
    }

    /// Opens the store in a database, or makes one, for a specification. Asking for more materials
    /// than before grows it; fewer are never wanted again. `blobs` is where the images are: needed
    /// where the store is new, and else the place that it was made with.
    ///
    /// Has to be called inside a runtime.
    pub async fn open_or_create(
        url: &str,
        specification: &Specification,
        blobs: Option<&BlobsPlace>,
    ) -> Result<Self, SharedStoreError> {
        let database = Database::new(url)?;
        let given = blobs.map(BlobsPlace::made).transpose()?;
        // What is read after the writing decides: somebody else may write at the same time.
        let (kept, place) = loop {
            let kept = database.open().await?;
            let (wanted, place) = match &kept {
                Some(kept) => check(database.name(), kept, specification, given.clone())?,
                None => {
                    let unknown = || SharedStoreError::BlobsUnknown(database.name().to_owned());
                    (specification.clone(), given.clone().ok_or_else(unknown)?)
                }
            };
            let identity = Identity {
                renderer_version: RENDERER_VERSION.to_owned(),
                specification_hash: wanted.hash().as_bytes().to_vec(),
                specification: wanted.to_json(),
                blobs: place.to_string(),
                migrating_from: None,
            };
            if kept.as_ref() == Some(&identity) {
                break (wanted, place);
            }
            let mesh = match kept {
                None => kept_mesh::bytes(&wanted)?,
                Some(_) => None,
            };
            database.make(&identity, mesh, wanted.materials).await?;
        };
        let loaded = kept_mesh::load_or_restore(&database, kept, specification).await?;
        Self::in_place(database, loaded, place).await
    }

    /// Opens the store that is there.
    ///
    /// Has to be called inside a runtime.
    pub async fn open(url: &str) -> Result<Self, SharedStoreError> {
        let (database, specification, place) = Self::kept(url).await?;
        Self::in_place(database, specification, place).await
    }

    /// The specification of the store that is there, if one is.
    ///
    /// Has to be called inside a runtime.
    pub async fn kept_specification(url: &str) -> Result<Option<Specification>, SharedStoreError> {
        match Self::kept(url).await {
            Err(SharedStoreError::Absent(_)) => Ok(None),
            kept => Ok(Some(kept?.1)),
        }
    }

    /// What is there: the database, its specification and the place of its images.
    async fn kept(url: &str) -> Result<(Database, Specification, BlobsPlace), SharedStoreError> {
        let database = Database::new(url)?;
        // First without a change: a database that is something else stays what it is.
        match database.snapshot().await {
            Err(DatabaseError::Older(_)) => {}
            looked => drop(known(database.name(), looked?)?),
        }
        let (specification, place) = known(database.name(), database.open().await?)?;
        let specification = kept_mesh::load(&database, specification).await?;
        Ok((database, specification, place))
    }

    /// Makes a database half of a copy of another store, or goes on with one that is. Nobody else
    /// changes it for as long as the session lives that comes with it.
    ///
    /// Has to be called inside a runtime.
    pub async fn begin_copy(
        url: &str,
        specification: &Specification,
        blobs: Option<&BlobsPlace>,
        from: &str,
    ) -> Result<(Self, MaintenanceSession), SharedStoreError> {
        let database = Database::new(url)?;
        let name = database.name().to_owned();
        let given = blobs.map(BlobsPlace::made).transpose()?;
        check_target(&name, database.open().await?.as_ref(), specification, from)?;
        let maintenance = MaintenanceSession::begin(&database).await?;
        let mut maintenance = maintenance.ok_or_else(|| SharedStoreError::Locked(name.clone()))?;
        maintenance.freeze().await?;
        // Somebody may have had it until now.
        let kept = database.snapshot().await?;
        check_target(&name, kept.as_ref(), specification, from)?;
        let found = kept.map(|kept| kept.blobs.parse::<BlobsPlace>());
        let found = found
            .transpose()
            .map_err(|reason| SharedStoreError::Damaged {
                name: name.clone(),
                reason,
            })?;
        let place = match (found, given) {
            (Some(found), Some(given)) if found != given => {
                return Err(SharedStoreError::Blobs {
                    name,
                    found: Box::new(found),
                    given: Box::new(given),
                });
            }
            (Some(place), _) | (None, Some(place)) => place,
            (None, None) => return Err(SharedStoreError::BlobsUnknown(name)),
        };
        let identity = Identity {
            renderer_version: RENDERER_VERSION.to_owned(),
            specification_hash: specification.hash().as_bytes().to_vec(),
            specification: specification.to_json(),
            blobs: place.to_string(),
            migrating_from: Some(from.to_owned()),
        };
        let mesh = kept_mesh::bytes(specification)?;
        // A place of somebody else's is refused before the database says that it is this one's.
        let store = Self::in_place(database, specification.clone(), place).await?;
        maintenance
            .make(&identity, mesh, specification.materials)
            .await?;
        Ok((store, maintenance))
    }

    async fn in_place(
        database: Database,
        specification: Specification,
        place: BlobsPlace,
    ) -> Result<Self, SharedStoreError> {
        let (blobs, staging_lock) = match place {
            BlobsPlace::Folder(folder) => {
                let (staging, lock) = make_staging(&folder)?;
                (Blobs::staged_in(&folder, staging), Some(lock))
            }
            BlobsPlace::Bucket(url) => {
                let blobs = claimed_bucket(url, database.name().to_owned()).await?;
                (blobs, None)
            }
        };
        blobs.prepare()?;
        Ok(Self {
            database,
            specification,
            blobs,
            staging_lock,
        })
    }

    /// The database, without a password.
    pub fn name(&self) -> &str {
        self.database.name()
    }

    /// The specification; its number of materials is the largest ever asked for.
    pub fn specification(&self) -> &Specification {
        &self.specification
    }
}

/// For threads that wait for a database.
pub fn waiting_runtime() -> Result<runtime::Runtime, FileError> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build();
    runtime.map_err(FileError::new("wait for", Path::new("a database")))
}

/// The images of a store of this name in a bucket.
async fn claimed_bucket(url: BucketUrl, owner: String) -> Result<Blobs, SharedStoreError> {
    let claimed = task::spawn_blocking(move || {
        // Of this machine's files it needs none.
        let blobs = Blobs::in_bucket(Path::new("."), &url)?;
        match blobs.claim(&owner)? {
            Claimed::Others => Err(SharedStoreError::ForeignBucket(url)),
            _ => Ok(blobs),
        }
    });
    claimed
        .await
        .unwrap_or_else(|error| std::panic::resume_unwind(error.into_panic()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use jobstore_postgres::testing::fresh_schema;
    use std::fs;

    fn specification(materials: u32) -> Specification {
        let mut specification = Specification::preset();
        specification.materials = materials;
        specification
    }

    #[tokio::test]
    async fn a_shared_store_is_one_dataset_with_its_images_in_one_place() {
        let url = fresh_schema().await;
        let images = tempfile::tempdir().unwrap();
        let place = BlobsPlace::Folder(images.path().to_owned());
        let open = |materials, blobs| {
            let url = url.clone();
            async move { SharedStore::open_or_create(&url, &specification(materials), blobs).await }
        };
        let error = open(4, None).await.err().unwrap();
        assert!(
            matches!(error, SharedStoreError::BlobsUnknown(_)),
            "{error}"
        );
        let one = open(4, Some(&place)).await.unwrap();
        // Beside the first, and more of it.
        let two = open(9, None).await.unwrap();
        assert_eq!(two.specification().materials, 9);
        assert_eq!(open(2, None).await.unwrap().specification().materials, 9);

        let other_folder = tempfile::tempdir().unwrap();
        let elsewhere = BlobsPlace::Folder(other_folder.path().to_owned());
        let error = open(4, Some(&elsewhere)).await.err().unwrap();
        assert!(matches!(error, SharedStoreError::Blobs { .. }), "{error}");
        let mut other = specification(4);
        other.image.width /= 2;
        let error = SharedStore::open_or_create(&url, &other, None).await;
        let error = error.err().unwrap();
        assert!(
            matches!(error, SharedStoreError::Specification { .. }),
            "{error}"
        );

        // What one stages is safe from the others; what is left of one that is gone is not.
        let digest = Digest::of(b"image");
        let staged = one.blobs.stage(digest, b"image").unwrap();
        drop(two.blobs.stage(digest, b"image").unwrap());
        drop(two);
        let three = open(4, None).await.unwrap();
        one.blobs.publish(vec![staged]).unwrap();
        assert_eq!(three.blobs.size(&digest).unwrap(), Some(5));
        let folders = fs::read_dir(images.path().join("staging")).unwrap();
        assert_eq!(folders.count(), 4, "a folder and a lock for each of two");
    }
}
