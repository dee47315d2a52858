//! Opening the ledger so that it and the completion log say the same.
//!
//! Architecture invariant: the ledger is derivable. What the log has and the ledger lacks is added
//! to the ledger, provided the images are there; what the ledger has and the log lacks is appended
//! to the log; a ledger that will not open is moved aside, not deleted, and derived anew.

use crate::{
    completion_log::{CompletionLog, Completions},
    ledger::{Ledger, LedgerError, SledLedger},
};
use dataset::Digest;
use imagestore::{FileError, blobs::Blobs};
use jobqueue::{Changes, Completion, JobChange, JobRecord, JobState, RedundantRender};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// What opening a store mended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovery {
    /// Where a ledger went that would not open.
    pub ledger_moved_aside: Option<PathBuf>,
    /// Completions that the ledger lacked and the log had.
    pub completions_recovered: u32,
    /// Materials whose completion is known, but not all of its images are there: they are rendered
    /// again.
    pub materials_reopened: u32,
    /// Completions that the log lacked and the ledger had.
    pub log_lines_restored: u32,
    /// Damaged lines of the log.
    pub log_lines_damaged: u64,
    /// Bytes of a torn last line that were cut off.
    pub log_bytes_cut: u64,
}

/// A store's state, open and agreeing with itself.
pub struct Recovered {
    /// The index of jobs, completions and images.
    pub ledger: SledLedger,
    /// The log, open for more.
    pub log: CompletionLog,
    /// The jobs and workers that are kept.
    pub kept: Changes,
    /// Of the images of completed materials.
    pub image_bytes: u64,
    /// What had to be mended.
    pub recovery: Recovery,
}

/// Opens ledger and log of a store whose materials have `views` images each.
pub fn recover(
    ledger_path: &Path,
    log_path: &Path,
    blobs: &Blobs,
    views: usize,
) -> Result<Recovered, LedgerError> {
    let (mut log, logged) = CompletionLog::open(log_path)?;
    let mut recovery = Recovery {
        log_lines_damaged: logged.bad_line_count,
        log_bytes_cut: logged.torn_bytes,
        ..Recovery::default()
    };
    let (ledger, mut kept) = match SledLedger::open(ledger_path) {
        Err(LedgerError::Damaged(reason)) => {
            let aside = move_aside(ledger_path)?;
            tracing::warn!(reason, aside = %aside.display(), "the ledger is moved aside");
            recovery.ledger_moved_aside = Some(aside);
            SledLedger::open(ledger_path)?
        }
        opened => opened?,
    };
    let mut jobs: BTreeMap<u32, JobRecord> = std::mem::take(&mut kept.jobs)
        .into_iter()
        .map(|change| (change.material, change.record))
        .collect();
    recover_from_log(&ledger, &logged, blobs, views, &mut jobs, &mut recovery)?;
    let restored = restore_log(&ledger, &mut log, &logged, &mut jobs, &mut recovery)?;
    let completed = jobs.iter().filter(|(_, job)| is_completed(Some(job)));
    let image_bytes = completed
        .filter_map(|(material, _)| logged.image_bytes(*material))
        .fold(restored, u64::saturating_add);
    report(&recovery, &logged);
    kept.jobs = jobs
        .into_iter()
        .map(|(material, record)| JobChange { material, record })
        .collect();
    Ok(Recovered {
        ledger,
        log,
        kept,
        image_bytes,
        recovery,
    })
}

fn recover_from_log(
    ledger: &SledLedger,
    logged: &Completions,
    blobs: &Blobs,
    views: usize,
    jobs: &mut BTreeMap<u32, JobRecord>,
    recovery: &mut Recovery,
) -> Result<(), LedgerError> {
    for material in logged.materials() {
        if is_completed(jobs.get(&material)) {
            continue;
        }
        let Some(completion) = logged.get(material)? else {
            continue;
        };
        if completion.views.len() != views || !has_images(&completion, blobs)? {
            recovery.materials_reopened += 1;
            continue;
        }
        let record = JobRecord {
            state: JobState::Completed {
                fingerprint: completion.fingerprint(),
                worker: completion.worker.clone(),
                redundant: RedundantRender::None,
            },
            ..jobs.remove(&material).unwrap_or_default()
        };
        jobs.insert(material, record.clone());
        ledger.apply(&one(material, record), &[completion])?;
        recovery.completions_recovered += 1;
    }
    ledger.sync()
}

/// Returns the bytes of the images of what was restored.
fn restore_log(
    ledger: &SledLedger,
    log: &mut CompletionLog,
    logged: &Completions,
    jobs: &mut BTreeMap<u32, JobRecord>,
    recovery: &mut Recovery,
) -> Result<u64, LedgerError> {
    let mut bytes: u64 = 0;
    let completed = jobs.iter_mut().filter(|(_, job)| is_completed(Some(job)));
    for (material, job) in completed {
        if logged.contains(*material) {
            continue;
        }
        match ledger.completion(*material)? {
            Some(completion) => {
                log.append([&completion])?;
                bytes = bytes.saturating_add(completion.bytes());
                recovery.log_lines_restored += 1;
            }
            None => {
                job.state = JobState::Pending;
                let (material, record) = (*material, job.clone());
                ledger.apply(&one(material, record), &[])?;
                recovery.materials_reopened += 1;
            }
        }
    }
    ledger.sync()?;
    Ok(bytes)
}

fn one(material: u32, record: JobRecord) -> Changes {
    Changes {
        jobs: vec![JobChange { material, record }],
        ..Changes::default()
    }
}

fn is_completed(job: Option<&JobRecord>) -> bool {
    job.is_some_and(|job| matches!(job.state, JobState::Completed { .. }))
}

fn has_images(completion: &Completion, blobs: &Blobs) -> Result<bool, FileError> {
    let digests: Vec<Digest> = completion.views.iter().map(|view| view.digest).collect();
    let sizes = blobs.sizes(&digests)?;
    let recorded = completion.views.iter().map(|view| Some(view.bytes));
    Ok(sizes.into_iter().eq(recorded))
}

fn move_aside(ledger_path: &Path) -> Result<PathBuf, FileError> {
    let free = (1..)
        .map(|number| ledger_path.with_extension(format!("broken-{number}")))
        .find(|path| !path.exists());
    let Some(aside) = free else {
        unreachable!("numbers do not run out");
    };
    fs::rename(ledger_path, &aside).map_err(FileError::new("move aside", ledger_path))?;
    Ok(aside)
}

fn report(recovery: &Recovery, logged: &Completions) {
    if recovery.log_lines_damaged > 0 {
        let lines = &logged.bad_lines;
        let count = recovery.log_lines_damaged;
        tracing::warn!(count, ?lines, "lines of the completion log are damaged");
    }
    if recovery.log_bytes_cut > 0 {
        let bytes = recovery.log_bytes_cut;
        tracing::warn!(bytes, "a torn last line of the completion log is cut off");
    }
    let Recovery {
        completions_recovered: recovered,
        materials_reopened: reopened,
        log_lines_restored: restored,
        ..
    } = *recovery;
    if recovered + reopened + restored > 0 {
        tracing::warn!(
            recovered,
            reopened,
            restored,
            "ledger and completion log agree again"
        );
    }
}
