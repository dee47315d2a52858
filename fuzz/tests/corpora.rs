//! Every input that is kept, through its target.

#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a panic here is a failed test, which says of which input"
)]

use std::{
    fs,
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
};

/// A target writes what it is given to files of its own, as fuzzers run one target on one thread.
fn alone() -> MutexGuard<'static, ()> {
    static TARGETS: Mutex<()> = Mutex::new(());
    TARGETS.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
fn what_is_sound_is_accepted() {
    let _alone = alone();
    let seeds = fuzz::seeds();
    for (number, (name, bytes)) in seeds.iter().enumerate() {
        assert!(fuzz::run(name, bytes), "seed {number}, of {name}");
    }
    for (name, _) in fuzz::TARGETS {
        assert!(
            seeds.iter().any(|(of, _)| *of == name),
            "{name} has no seed"
        );
    }
}

/// Writes the seeds to where a fuzzer takes them from: `fuzz/run.sh` calls it.
#[test]
#[ignore = "makes files for fuzz/run.sh"]
fn write_seeds() {
    let folder = std::env::var("BRDFARM_SEEDS").expect("BRDFARM_SEEDS names a folder");
    for (number, (name, bytes)) in fuzz::seeds().iter().enumerate() {
        let folder = Path::new(&folder).join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(format!("seed-{number}")), bytes).unwrap();
    }
}

/// Inputs are kept small: what they show does not need more.
const INPUT_BYTES_MAX: u64 = 16 << 10;

#[test]
fn no_input_that_is_kept_fails() {
    let _alone = alone();
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (name, target) in fuzz::TARGETS {
        for input in fs::read_dir(corpus.join(name)).unwrap() {
            let path = input.unwrap().path();
            assert!(
                fs::metadata(&path).unwrap().len() <= INPUT_BYTES_MAX,
                "{path:?}"
            );
            // Of a panic below this says where it comes from.
            eprintln!("{}", path.display());
            target(&fs::read(&path).unwrap());
        }
    }
    let kept = fs::read_dir(&corpus).unwrap().count();
    assert_eq!(kept, fuzz::TARGETS.len(), "a corpus without a target");
}
