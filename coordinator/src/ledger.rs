//! The ledger: jobs, completions and the index of images, in sled.
//!
//! sled 0.34 as measured: `flush` alone is not durable on Linux (it issues `sync_file_range`), and
//! `flush` followed by a sync of the file named `db` is. A damaged ledger can make `open` panic,
//! so it runs inside `catch_unwind`. Values stay small and change seldom: sled reclaims nothing.
//!
//! | tree | key | value |
//! | --- | --- | --- |
//! | `jobs` | material, 4 bytes big-endian | [`JobRecord`] as JSON |
//! | `completions` | the same | [`Completion`] as JSON |
//! | `blobs` | digest, 32 bytes | [`BlobPlace`]: 4, 4 and 8 bytes, big-endian |

use crate::{
    completion::Completion,
    file_error::FileError,
    limits,
    queue::{Change, JobRecord},
};
use dataset::Digest;
use sled::{
    Transactional,
    transaction::{ConflictableTransactionError, TransactionError},
};
use std::{
    fs::File,
    io,
    panic::{self, AssertUnwindSafe},
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};
use thiserror::Error;

/// Why the ledger cannot be used.
#[derive(Debug, Error)]
pub enum LedgerError {
    /// What it holds is damaged. It can be rebuilt.
    #[error("the ledger is damaged: {0}")]
    Damaged(String),
    /// Another process has it open.
    #[error("another process has the ledger {} open", .0.display())]
    Locked(PathBuf),
    /// The system would not do what was asked; the ledger may be sound.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Which image a digest names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlobPlace {
    /// The material's index.
    pub material: u32,
    /// The view's index.
    pub view: u32,
    /// The image's size.
    pub bytes: u64,
}

/// The ledger of one store, open.
pub struct Ledger {
    database: sled::Db,
    jobs: sled::Tree,
    completions: sled::Tree,
    blobs: sled::Tree,
    directory: PathBuf,
}

impl Ledger {
    /// Opens a ledger, or begins one, and reads all jobs, lowest material first.
    pub fn open(directory: &Path) -> Result<(Self, Vec<Change>), LedgerError> {
        let started = Instant::now();
        loop {
            let opened = panic::catch_unwind(AssertUnwindSafe(|| Self::open_once(directory)));
            match opened {
                // The lock of a process that just ended can outlive it by a moment.
                Ok(Err(LedgerError::Locked(_))) if started.elapsed() < limits::LEDGER_LOCK_WAIT => {
                    thread::sleep(Duration::from_millis(50));
                }
                Ok(result) => return result,
                Err(_) => return Err(LedgerError::Damaged("reading it failed badly".to_owned())),
            }
        }
    }

    fn open_once(directory: &Path) -> Result<(Self, Vec<Change>), LedgerError> {
        let failed = |error| LedgerError::of(error, "open", directory);
        let database = sled::Config::new()
            .path(directory)
            .cache_capacity(limits::LEDGER_CACHE_BYTES)
            .flush_every_ms(None)
            .open()
            .map_err(failed)?;
        let ledger = Self {
            jobs: database.open_tree("jobs").map_err(failed)?,
            completions: database.open_tree("completions").map_err(failed)?,
            blobs: database.open_tree("blobs").map_err(failed)?,
            directory: directory.to_owned(),
            database,
        };
        let jobs = ledger
            .jobs
            .iter()
            .map(|entry| {
                let (key, value) = entry.map_err(failed)?;
                let record = serde_json::from_slice::<JobRecord>(&value).ok();
                let (Ok(material), Some(record)) = (key.as_ref().try_into(), record) else {
                    return Err(LedgerError::Damaged("a job cannot be read".to_owned()));
                };
                let material = u32::from_be_bytes(material);
                Ok(Change { material, record })
            })
            .collect::<Result<Vec<Change>, LedgerError>>()?;
        ledger.sync()?;
        Ok((ledger, jobs))
    }

    /// Writes changes and completions in one transaction; durable after [`Ledger::sync`].
    pub fn apply(&self, changes: &[Change], completions: &[Completion]) -> Result<(), LedgerError> {
        let json = |error: serde_json::Error| {
            FileError::new("write", &self.directory)(io::Error::from(error))
        };
        let jobs = changes
            .iter()
            .map(|change| {
                let value = serde_json::to_vec(&change.record).map_err(json)?;
                Ok((change.material.to_be_bytes(), value))
            })
            .collect::<Result<Vec<_>, FileError>>()?;
        let completed = completions
            .iter()
            .map(|completion| {
                let value = serde_json::to_vec(completion).map_err(json)?;
                Ok((completion.material.to_be_bytes(), value))
            })
            .collect::<Result<Vec<_>, FileError>>()?;
        (&self.jobs, &self.completions, &self.blobs)
            .transaction(|(job_tree, completion_tree, blob_tree)| {
                for (key, value) in &jobs {
                    job_tree.insert(key, value.as_slice())?;
                }
                for (key, value) in &completed {
                    completion_tree.insert(key, value.as_slice())?;
                }
                for completion in completions {
                    for (number, view) in (0..).zip(&completion.views) {
                        let place = BlobPlace {
                            material: completion.material,
                            view: number,
                            bytes: view.bytes,
                        };
                        blob_tree.insert(view.digest.as_bytes(), &place.encode())?;
                    }
                }
                Ok::<(), ConflictableTransactionError<()>>(())
            })
            .map_err(|error| match error {
                TransactionError::Storage(error) => self.failed("write", error),
                TransactionError::Abort(()) => unreachable!("nothing here aborts"),
            })
    }

    /// Makes durable what was applied.
    ///
    /// Architecture invariant: what was acknowledged is durable. The flush moves what sled buffers
    /// into its file; the sync, on the file itself, moves the file to the disk.
    pub fn sync(&self) -> Result<(), LedgerError> {
        self.database
            .flush()
            .map_err(|error| self.failed("flush", error))?;
        let path = self.directory.join("db");
        File::open(&path)
            .and_then(|file| file.sync_all())
            .map_err(FileError::new("sync", &path))?;
        Ok(())
    }

    /// A material's completion.
    pub fn completion(&self, material: u32) -> Result<Option<Completion>, LedgerError> {
        let value = self
            .completions
            .get(material.to_be_bytes())
            .map_err(|error| self.failed("read", error))?;
        value
            .map(|value| {
                serde_json::from_slice(&value).map_err(|error| {
                    LedgerError::Damaged(format!("the completion of material {material}: {error}"))
                })
            })
            .transpose()
    }

    /// Which image of a completed material has this digest, if any.
    pub fn blob(&self, digest: &Digest) -> Result<Option<BlobPlace>, LedgerError> {
        let value = self
            .blobs
            .get(digest.as_bytes())
            .map_err(|error| self.failed("read", error))?;
        value
            .map(|value| {
                BlobPlace::decode(&value)
                    .ok_or_else(|| LedgerError::Damaged(format!("the place of image {digest}")))
            })
            .transpose()
    }

    fn failed(&self, action: &'static str, error: sled::Error) -> LedgerError {
        LedgerError::of(error, action, &self.directory)
    }
}

impl LedgerError {
    fn of(error: sled::Error, action: &'static str, directory: &Path) -> Self {
        match error {
            sled::Error::Io(error) if error.to_string().contains("could not acquire lock") => {
                Self::Locked(directory.to_owned())
            }
            // A truncated file ends before sled expects it to.
            sled::Error::Io(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
                FileError::new(action, directory)(error).into()
            }
            error => Self::Damaged(error.to_string()),
        }
    }
}

impl BlobPlace {
    fn encode(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..4].copy_from_slice(&self.material.to_be_bytes());
        bytes[4..8].copy_from_slice(&self.view.to_be_bytes());
        bytes[8..].copy_from_slice(&self.bytes.to_be_bytes());
        bytes
    }

    fn decode(value: &[u8]) -> Option<Self> {
        let (material, rest) = value.split_first_chunk()?;
        let (view, bytes) = rest.split_first_chunk()?;
        Some(Self {
            material: u32::from_be_bytes(*material),
            view: u32::from_be_bytes(*view),
            bytes: u64::from_be_bytes(bytes.try_into().ok()?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::queue::JobState;
    use crate::token::{Token, WorkerId};
    use dataset::{CompletedView, ErrorStatistics};

    fn completion(material: u32) -> Completion {
        let digest = Digest::of(&material.to_be_bytes());
        let statistics = ErrorStatistics {
            mean: 0.1,
            p95: 0.2,
            max: 0.3,
            within_target: 0.9,
            samples: 64,
            evaluations: 7,
        };
        Completion {
            material,
            views: vec![CompletedView {
                digest,
                bytes: 5,
                statistics,
            }],
            seconds: 0.25,
            worker: "w".to_owned(),
        }
    }

    #[test]
    fn what_is_synced_is_there_when_the_ledger_opens_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ledger");
        let (ledger, jobs) = Ledger::open(&path).unwrap();
        assert!(jobs.is_empty());
        let leased = Change {
            material: 258,
            record: JobRecord {
                state: JobState::Leased {
                    token: Token::from_bytes([1; 16]),
                    worker: WorkerId::from_bytes([2; 16]),
                },
                errors: vec!["no light".to_owned()],
                leases_lost: 2,
            },
        };
        let completed = Change {
            material: 3,
            record: JobRecord {
                state: JobState::Completed {
                    fingerprint: completion(3).fingerprint(),
                },
                ..JobRecord::default()
            },
        };
        let changes = [leased.clone(), completed.clone()];
        ledger.apply(&changes, &[completion(3)]).unwrap();
        ledger.sync().unwrap();
        drop(ledger);

        let (ledger, jobs) = Ledger::open(&path).unwrap();
        assert_eq!(jobs, [completed, leased]);
        assert_eq!(ledger.completion(3).unwrap(), Some(completion(3)));
        assert_eq!(ledger.completion(258).unwrap(), None);
        let digest = completion(3).views[0].digest;
        let place = BlobPlace {
            material: 3,
            view: 0,
            bytes: 5,
        };
        assert_eq!(ledger.blob(&digest).unwrap(), Some(place));
        assert_eq!(ledger.blob(&Digest::of(b"other")).unwrap(), None);
    }

    #[test]
    fn a_job_that_cannot_be_read_is_damage_not_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ledger");
        for (key, value) in [(&b"key"[..], &b"{}"[..]), (&[0, 0, 0, 1], b"noise")] {
            let database = sled::open(&path).unwrap();
            let jobs = database.open_tree("jobs").unwrap();
            jobs.clear().unwrap();
            jobs.insert(key, value).unwrap();
            database.flush().unwrap();
            drop((jobs, database));
            let error = Ledger::open(&path).err().unwrap();
            assert!(matches!(error, LedgerError::Damaged(_)), "{error}");
        }
    }
}
