//! The completion log of a store.

use dataset::Digest;
use jobqueue::Completion;
use jobstore::completion_log::{CompletionLog, Completions};
use std::{fs, sync::LazyLock};
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

/// Reads a log, mends its end and appends to it. A line that begins with `=` gets the checksum of
/// what follows, which no fuzzer guesses.
pub fn completion_log(bytes: &[u8]) -> bool {
    let path = FOLDER.path().join("completions.log");
    let log = with_checksums(bytes);
    fs::write(&path, &log).unwrap();
    let found = Completions::open(&path).unwrap();
    assert_eq!(found.whole_bytes + found.torn_bytes, log.len() as u64);
    let materials: Vec<u32> = found.materials().collect();
    for material in &materials {
        let completion = found.get(*material).unwrap().unwrap();
        assert_eq!(completion.material, *material);
        completion.fingerprint();
    }

    let (mut appended, again) = CompletionLog::open(&path).unwrap();
    assert!(again.materials().eq(materials.iter().copied()));
    let new = Completion {
        material: u32::MAX,
        views: Vec::new(),
        seconds: 0.5,
        worker: "w".to_owned(),
    };
    appended.append([&new]).unwrap();
    let after = Completions::open(&path).unwrap();
    assert_eq!(after.torn_bytes, 0);
    assert_eq!(after.bad_line_count, found.bad_line_count);
    assert_eq!(after.get(u32::MAX).unwrap(), Some(new));
    assert!(materials.iter().all(|material| after.contains(*material)));
    !materials.is_empty()
}

fn with_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut log = Vec::new();
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        match line.strip_prefix(b"=") {
            Some(line) => {
                let json = line.strip_suffix(b"\n").unwrap_or(line);
                log.extend(&Digest::of(json).to_string().as_bytes()[..16]);
                log.push(b' ');
                log.extend(line);
            }
            None => log.extend(line),
        }
    }
    log
}
