//! How much memory a process takes while a store's log of completions grows.

use crate::process::Process;
use std::{
    fs::{self, File},
    io::Read,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

/// How often the log is looked at.
const INTERVAL: Duration = Duration::from_millis(20);

/// Does `work`, and tells how much memory `process` has when the log has each of `marks` lines.
pub fn told<T>(process: &Process, log: &Path, marks: &[usize], work: impl FnOnce() -> T) -> T {
    let done = AtomicBool::new(false);
    let pid = process.id();
    thread::scope(|scope| {
        scope.spawn(|| watch(pid, log, marks, &done));
        let worked = work();
        done.store(true, Ordering::Relaxed);
        worked
    })
}

fn watch(pid: u32, log: &Path, marks: &[usize], done: &AtomicBool) {
    let mut lines = Lines::default();
    for mark in marks {
        loop {
            // In this order: what is done when the lines are counted is counted.
            let last = done.load(Ordering::Relaxed);
            let counted = lines.count(log);
            if counted >= *mark {
                println!("  {mark:>9} completed: {} MiB", resident_bytes(pid) >> 20);
                break;
            }
            if last {
                return;
            }
            thread::sleep(INTERVAL);
        }
    }
}

/// How many lines a file has that others append to.
#[derive(Default)]
struct Lines {
    file: Option<File>,
    count: usize,
}

impl Lines {
    fn count(&mut self, path: &Path) -> usize {
        if self.file.is_none() {
            self.file = File::open(path).ok();
        }
        let Some(file) = &mut self.file else {
            return 0;
        };
        let mut block = vec![0; 1 << 20];
        loop {
            let read = file.read(&mut block).unwrap();
            if read == 0 {
                return self.count;
            }
            let ends = block[..read].iter().filter(|byte| **byte == b'\n');
            self.count += ends.count();
        }
    }
}

fn resident_bytes(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:"));
    let kilobytes: u64 = line
        .and_then(|line| line.split_whitespace().nth(1))
        .unwrap()
        .parse()
        .unwrap();
    kilobytes << 10
}
