//! Group commit: what makes a store's transitions durable, many at a time.
//!
//! A thread appends completions to the log (synced) and writes the ledger (flushed and synced), and
//! only then does anybody hear of it. Images have their names by then (`publisher`), so that a
//! lease, which has none, waits for no image's sync.
//!
//! Architecture invariant: what was acknowledged is durable, and the ledger names no image that is
//! not.

use crate::{
    completion_log::{CompletionLog, Entry, Retraction},
    group::{Failure, Group, Pace, Pending},
    ledger::{Ledger, LedgerError},
    meter::Meter,
};
use imagestore::{FileError, room::Room};
use jobqueue::{Changes, Completion};
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Instant,
};
use tokio::sync::watch;

/// What one submission makes durable.
#[derive(Debug, Default)]
pub struct Transition {
    pub changes: Changes,
    pub completion: Option<Completion>,
}

/// Makes transitions of one store durable.
pub struct Committer {
    transitions: Group<Transition>,
    failure: watch::Receiver<Option<String>>,
    closing: Arc<AtomicBool>,
}

impl Committer {
    /// Starts the thread. `committed` is called after each batch.
    pub fn start(
        log: CompletionLog,
        ledger: Arc<dyn Ledger>,
        room: Room,
        metrics: Arc<dyn Meter>,
        committed: impl Fn() + Send + 'static,
    ) -> Result<Self, FileError> {
        let failure = Failure::none_yet();
        let told = failure.subscribe();
        let pace = Pace {
            most: limits::COMMIT_BATCH_MAX,
            interval: limits::COMMIT_INTERVAL,
        };
        let mut writer = Writer { log, ledger };
        let closing = Arc::<AtomicBool>::default();
        let closed = Arc::clone(&closing);
        let transitions = Group::start("group commit", pace, failure, move |transitions| {
            let began = Instant::now();
            let count = transitions.len();
            let batch = Batch::of(transitions);
            if !batch.changes.is_empty() {
                wait_for_room(&room, &closed)?;
                writer.write(&batch)?;
                metrics.note_commit(began.elapsed(), count);
            }
            committed();
            Ok::<_, LedgerError>(())
        })?;
        Ok(Self {
            transitions,
            failure: told,
            closing,
        })
    }

    /// Writes where it is asked to.
    #[cfg(test)]
    pub fn without_thread(log: CompletionLog, ledger: Arc<dyn Ledger>) -> Self {
        let mut writer = Writer { log, ledger };
        let write = move |transitions| writer.write(&Batch::of(transitions));
        Self {
            transitions: Group::without_thread(write),
            failure: Failure::none_yet().subscribe(),
            closing: Arc::default(),
        }
    }

    /// Hands a transition over; never waits. Whoever calls holds the lock over the state that the
    /// transition changed, so that the order here is the order there.
    pub fn submit(&self, transition: Transition) -> Pending {
        self.transitions.submit(transition)
    }

    /// Why the store can no longer be written, once that is so.
    pub fn failure(&self) -> watch::Receiver<Option<String>> {
        self.failure.clone()
    }

    /// Accepts nothing more and returns when all that was submitted is durable, or the disk is
    /// full. Blocks.
    pub fn close(&self) {
        self.closing.store(true, Ordering::Relaxed);
        self.transitions.close();
    }
}

/// Waits while the disk is full; not when the store is being closed.
fn wait_for_room(room: &Room, closing: &AtomicBool) -> Result<(), FileError> {
    let mut told = false;
    while let Err(error) = room.for_records() {
        if closing.load(Ordering::Relaxed) {
            return Err(error);
        }
        if !told {
            tracing::error!(%error, "nothing is recorded");
            told = true;
        }
        thread::sleep(limits::DISK_FULL_INTERVAL);
    }
    if told {
        tracing::info!("there is room on the disk again");
    }
    Ok(())
}

struct Writer {
    log: CompletionLog,
    ledger: Arc<dyn Ledger>,
}

/// What becomes durable together.
#[derive(Default)]
struct Batch {
    changes: Changes,
    completions: Vec<Completion>,
    // In the order of the transitions: of a completion and its retraction the later counts.
    lines: Vec<Entry>,
}

impl Batch {
    fn of(transitions: Vec<Transition>) -> Self {
        let mut batch = Self::default();
        for transition in transitions {
            batch.add(transition);
        }
        batch
    }

    fn add(&mut self, transition: Transition) {
        let retracted = transition.changes.retracted.iter();
        let retracted = retracted.map(|material| Retraction {
            retracted: *material,
        });
        self.lines.extend(retracted.map(Entry::Retracted));
        if let Some(completion) = transition.completion {
            self.lines.push(Entry::Completed(completion.clone()));
            self.completions.push(completion);
        }
        self.changes.extend(transition.changes);
    }
}

impl Writer {
    fn write(&mut self, batch: &Batch) -> Result<(), LedgerError> {
        self.log.append_entries(&batch.lines)?;
        self.ledger.apply(&batch.changes, &batch.completions)?;
        self.ledger.sync()
    }
}
