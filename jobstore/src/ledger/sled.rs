//! The ledger of one machine, in sled.
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
//! | `workers` | name | [`WorkerRecord`] as JSON |
//! | `farm` | `mode` | [`Mode`] as JSON |

use super::{BlobPlace, Ledger, LedgerError};
use dataset::Digest;
use imagestore::FileError;
use jobqueue::{Changes, Completion, JobChange, JobRecord, Mode, WorkerChange, WorkerRecord};
use serde::{Serialize, de::DeserializeOwned};
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

/// The ledger of one store, open.
pub struct SledLedger {
    database: sled::Db,
    jobs: sled::Tree,
    completions: sled::Tree,
    blobs: sled::Tree,
    workers: sled::Tree,
    farm: sled::Tree,
    directory: PathBuf,
}

/// The key of the mode in the tree `farm`.
const MODE: &[u8] = b"mode";

impl SledLedger {
    /// Opens a ledger, or begins one, and reads all it keeps of the queue, lowest material first.
    pub fn open(directory: &Path) -> Result<(Self, Changes), LedgerError> {
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

    fn open_once(directory: &Path) -> Result<(Self, Changes), LedgerError> {
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
            workers: database.open_tree("workers").map_err(failed)?,
            farm: database.open_tree("farm").map_err(failed)?,
            directory: directory.to_owned(),
            database,
        };
        let contents = ledger.contents()?;
        ledger.sync()?;
        Ok((ledger, contents))
    }

    fn failed(&self, action: &'static str, error: sled::Error) -> LedgerError {
        LedgerError::of(error, action, &self.directory)
    }

    fn json<T: Serialize>(&self, value: &T) -> Result<Vec<u8>, LedgerError> {
        let failed = FileError::new("write", &self.directory);
        Ok(serde_json::to_vec(value).map_err(|error| failed(error.into()))?)
    }

    fn entries<K, R: DeserializeOwned>(
        &self,
        tree: &sled::Tree,
        what: &str,
        key: impl Fn(&[u8]) -> Option<K>,
    ) -> Result<Vec<(K, R)>, LedgerError> {
        tree.iter()
            .map(|entry| {
                let (name, value) = entry.map_err(|error| self.failed("read", error))?;
                let record = serde_json::from_slice(&value).ok();
                key(&name)
                    .zip(record)
                    .ok_or_else(|| LedgerError::Damaged(format!("a {what} cannot be read")))
            })
            .collect()
    }
}

impl Ledger for SledLedger {
    fn contents(&self) -> Result<Changes, LedgerError> {
        let material = |key: &[u8]| Some(u32::from_be_bytes(key.try_into().ok()?));
        let name = |key: &[u8]| String::from_utf8(key.to_vec()).ok();
        let jobs = self.entries::<_, JobRecord>(&self.jobs, "job", material)?;
        let workers = self.entries::<_, WorkerRecord>(&self.workers, "worker", name)?;
        let modes = self.entries::<(), Mode>(&self.farm, "mode", |_| Some(()))?;
        Ok(Changes {
            jobs: jobs
                .into_iter()
                .map(|(material, record)| JobChange { material, record })
                .collect(),
            workers: workers
                .into_iter()
                .map(|(name, record)| WorkerChange { name, record })
                .collect(),
            mode: modes.first().map(|(_, mode)| *mode),
            retracted: Vec::new(),
        })
    }

    fn apply(&self, changes: &Changes, completions: &[Completion]) -> Result<(), LedgerError> {
        let jobs = changes.jobs.iter();
        let jobs = jobs
            .map(|change| Ok((change.material.to_be_bytes(), self.json(&change.record)?)))
            .collect::<Result<Vec<_>, LedgerError>>()?;
        let workers = changes.workers.iter();
        let workers = workers
            .map(|change| {
                let kept = change.record != WorkerRecord::default();
                let value = kept.then(|| self.json(&change.record)).transpose()?;
                Ok((change.name.as_bytes(), value))
            })
            .collect::<Result<Vec<_>, LedgerError>>()?;
        let mode = changes.mode.map(|mode| self.json(&mode)).transpose()?;
        let completed = completions.iter();
        let completed = completed
            .map(|completion| Ok((completion.material.to_be_bytes(), self.json(completion)?)))
            .collect::<Result<Vec<_>, LedgerError>>()?;
        let trees = (
            &self.jobs,
            &self.completions,
            &self.blobs,
            &self.workers,
            &self.farm,
        );
        trees
            .transaction(
                |(job_tree, completion_tree, blob_tree, worker_tree, farm_tree)| {
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
                    for (name, value) in &workers {
                        match value {
                            Some(value) => worker_tree.insert(*name, value.as_slice())?,
                            None => worker_tree.remove(*name)?,
                        };
                    }
                    if let Some(mode) = &mode {
                        farm_tree.insert(MODE, mode.as_slice())?;
                    }
                    Ok::<(), ConflictableTransactionError<()>>(())
                },
            )
            .map_err(|error| match error {
                TransactionError::Storage(error) => self.failed("write", error),
                TransactionError::Abort(()) => unreachable!("nothing here aborts"),
            })
    }

    // The flush moves what sled buffers into its file; the sync, on the file itself, moves the
    // file to the disk.
    fn sync(&self) -> Result<(), LedgerError> {
        self.database
            .flush()
            .map_err(|error| self.failed("flush", error))?;
        let path = self.directory.join("db");
        File::open(&path)
            .and_then(|file| file.sync_all())
            .map_err(FileError::new("sync", &path))?;
        Ok(())
    }

    fn completion(&self, material: u32) -> Result<Option<Completion>, LedgerError> {
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

    fn blob(&self, digest: &Digest) -> Result<Option<BlobPlace>, LedgerError> {
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
    use jobqueue::{
        Block, BlockCause, Failure, Holder, JobState, RedundantRender,
        token::{Token, WorkerId},
    };
    use std::fs;

    fn completion(material: u32) -> Completion {
        Completion {
            worker: "w".to_owned(),
            ..Completion::sample(material, &material.to_be_bytes())
        }
    }

    fn a_lease_after_a_failure() -> JobChange {
        JobChange {
            material: 258,
            record: JobRecord {
                state: JobState::Leased(Holder {
                    token: Token::from_bytes([1; 16]),
                    worker: WorkerId::from_bytes([2; 16]),
                    name: "w".to_owned(),
                }),
                priority: -3,
                failures: vec![Failure {
                    worker: "v".to_owned(),
                    error: "no light".to_owned(),
                }],
                leases_lost: 2,
            },
        }
    }

    #[test]
    fn what_is_synced_is_there_when_the_ledger_opens_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ledger");
        let (ledger, contents) = SledLedger::open(&path).unwrap();
        assert_eq!(contents, Changes::default());
        let leased = a_lease_after_a_failure();
        let completed = JobChange {
            material: 3,
            record: JobRecord {
                state: JobState::Completed {
                    fingerprint: completion(3).fingerprint(),
                    worker: "w".to_owned(),
                    redundant: RedundantRender::Due,
                },
                ..JobRecord::default()
            },
        };
        let blocked = WorkerChange {
            name: "v".to_owned(),
            record: WorkerRecord {
                failures: 3,
                block: Some(Block {
                    cause: BlockCause::Operator,
                    reason: "dust".to_owned(),
                }),
                ..WorkerRecord::default()
            },
        };
        let cleared = WorkerChange {
            name: "w".to_owned(),
            record: WorkerRecord::default(),
        };
        let changes = Changes {
            jobs: vec![leased.clone(), completed.clone()],
            workers: vec![blocked.clone(), cleared],
            mode: Some(Mode::Draining),
            retracted: Vec::new(),
        };
        ledger.apply(&changes, &[completion(3)]).unwrap();
        ledger.sync().unwrap();
        drop(ledger);

        let (ledger, contents) = SledLedger::open(&path).unwrap();
        let expected = Changes {
            jobs: vec![completed, leased],
            workers: vec![blocked],
            ..changes
        };
        assert_eq!(contents, expected);
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
    fn a_record_that_cannot_be_read_is_damage_not_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ledger");
        for (tree, key, value) in [
            ("jobs", &b"key"[..], &b"{}"[..]),
            ("jobs", &[0, 0, 0, 1], b"noise"),
            ("workers", b"w", b"noise"),
            ("workers", b"\xff", b"{}"),
            ("farm", MODE, b"\"asleep\""),
        ] {
            let database = sled::open(&path).unwrap();
            let tree = database.open_tree(tree).unwrap();
            tree.clear().unwrap();
            tree.insert(key, value).unwrap();
            database.flush().unwrap();
            drop((tree, database));
            let error = SledLedger::open(&path).err().unwrap();
            assert!(matches!(error, LedgerError::Damaged(_)), "{error}");
            fs::remove_dir_all(&path).unwrap();
        }
    }
}
