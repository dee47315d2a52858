//! Draws one case after another, in as many threads as rayon would take.

use crate::case::Case;
use crate::examine::{Effort, Finding, Kind, Outcome, examine, seconds};
use rustix::time::ClockId;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{
    Mutex,
    atomic::{AtomicBool, AtomicU64, Ordering},
};
use std::thread;
use std::time::Duration;

/// After this many processor seconds a case counts as unbounded; it ends the process.
const PATIENCE_SECONDS: f64 = 120.0;

/// The exit code then. The shell script goes on with the next draw.
const UNBOUNDED: i32 = 86;

/// Counts of a search.
#[derive(Debug, Default)]
pub struct Summary {
    pub drawn: u64,
    pub hybrid: u64,
    pub compared: usize,
    pub coarse: usize,
    /// Cases that failed, by the first kind of their failures.
    pub failed: BTreeMap<Kind, u64>,
    pub slowest: (f64, u64),
}

impl Summary {
    fn add(&mut self, index: u64, outcome: &Outcome) {
        self.drawn += 1;
        self.hybrid += u64::from(outcome.hybrid);
        self.compared += outcome.compared;
        self.coarse += outcome.coarse;
        if outcome.seconds > self.slowest.0 {
            self.slowest = (outcome.seconds, index);
        }
        if let Some(kind) = outcome.findings.iter().map(|finding| finding.kind).min() {
            *self.failed.entry(kind).or_default() += 1;
        }
    }

    /// Draws in which a pixel was off by more than it states.
    pub fn failures(&self) -> u64 {
        self.failed.values().sum()
    }

    /// One line of names and numbers, which `tests/scenes.sh` adds up.
    pub fn print(&self) {
        let count = |kind| self.failed.get(&kind).copied().unwrap_or_default();
        let (seconds, index) = self.slowest;
        println!(
            "counts: drawn {} hybrid {} path {} pixels {} coarse {} reference {} resolution {} \
             accuracy {} traced {} broken {} slowest {seconds:.1} of {index}",
            self.drawn,
            self.hybrid,
            self.drawn - self.hybrid,
            self.compared,
            self.coarse,
            count(Kind::Reference),
            count(Kind::Resolution),
            count(Kind::Accuracy),
            count(Kind::Path),
            count(Kind::Broken),
        );
    }
}

/// What each thread is at, since which processor time of the process.
type Underway = Mutex<BTreeMap<u64, f64>>;

fn process_seconds() -> f64 {
    seconds(ClockId::ProcessCPUTime)
}

/// Draws a case by seed and index.
pub type Draw = fn(u64, u64) -> Case;

/// Examines draws `first` to `first + count - 1`, and prints what failed.
pub fn search(draw: Draw, seed: u64, [first, count]: [u64; 2], effort: Effort) -> Summary {
    let next = AtomicU64::new(first);
    let summary = Mutex::new(Summary::default());
    let underway = Underway::default();
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| watch(draw, seed, &underway, &done, &summary));
        let workers: Vec<_> = (0..rayon::current_num_threads())
            .map(|_| {
                scope.spawn(|| {
                    // A pool of one thread each: its processor time is the case's.
                    let pool = rayon::ThreadPoolBuilder::new()
                        .num_threads(1)
                        .build()
                        .expect("a thread");
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        if index >= first + count {
                            break;
                        }
                        let case = draw(seed, index);
                        lock(&underway).insert(index, process_seconds());
                        let outcome = pool.install(|| guarded(&case, effort));
                        lock(&underway).remove(&index);
                        report(index, &case, &outcome);
                        lock(&summary).add(index, &outcome);
                    }
                })
            })
            .collect();
        for worker in workers {
            worker.join().expect("panics are caught");
        }
        done.store(true, Ordering::Relaxed);
    });
    summary.into_inner().expect("panics are caught")
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().expect("panics are caught")
}

/// A panic of the renderer is a finding.
fn guarded(case: &Case, effort: Effort) -> Outcome {
    catch_unwind(AssertUnwindSafe(|| examine(case, effort))).unwrap_or_else(|_| Outcome {
        findings: vec![Finding {
            kind: Kind::Broken,
            pixel: [0; 2],
            found: [0.0; 3],
            expected: [0.0; 3],
            spread: 0.0,
            stated: 0.0,
            limit: 0.0,
            excess: 0.0,
            note: ": a panic".to_owned(),
        }],
        ..Outcome::default()
    })
}

fn report(index: u64, case: &Case, outcome: &Outcome) {
    if outcome.findings.is_empty() {
        return;
    }
    let mut text = format!("--- draw {index}\n");
    for finding in &outcome.findings {
        text += &format!("{finding}\n");
    }
    println!("{text}{}", case.reproduction());
}

/// Ends the process when a case takes too long: no thread can be stopped.
fn watch(draw: Draw, seed: u64, underway: &Underway, done: &AtomicBool, summary: &Mutex<Summary>) {
    // The other threads' draws take processor time, too.
    let patience = PATIENCE_SECONDS * rayon::current_num_threads() as f64;
    while !done.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(100));
        let late: Vec<u64> = lock(underway)
            .iter()
            .filter(|(_, start)| process_seconds() - **start > patience)
            .map(|(index, _)| *index)
            .collect();
        for index in &late {
            println!(
                "--- draw {index}\nUnbounded: not done after {PATIENCE_SECONDS} processor seconds"
            );
            println!("{}", draw(seed, *index).reproduction());
        }
        if !late.is_empty() {
            lock(summary).print();
            let underway: Vec<u64> = lock(underway).keys().copied().collect();
            println!("not done: {underway:?}");
            let last = underway.last().copied().unwrap_or_default();
            println!("go on with draw {}", last + 1);
            std::process::exit(UNBOUNDED);
        }
    }
}
