//! Group commit: what makes a store's transitions durable, many at a time.
//!
//! Two threads. One gives images their names (synced before and after); the other appends
//! completions to the log (synced) and writes the ledger (flushed and synced), and only then does
//! anybody hear of it. Images are published before their completion is judged, so that a lease,
//! which has none, waits for no image's sync. One that was staged anew since, as when a worker
//! sends it again, is published with the transition.
//!
//! Architecture invariant: what was acknowledged is durable, and the ledger names no image that is
//! not.

use crate::{
    completion_log::{CompletionLog, Entry, Retraction},
    group::{Failure, Group, Pace, Pending},
    ledger::{Ledger, LedgerError},
    meter::Meter,
};
use imagestore::{
    FileError,
    blobs::{Blobs, StagedFile},
};
use jobqueue::{Changes, Completion};
use std::{sync::Arc, time::Instant};
use tokio::sync::watch;

/// What one submission makes durable.
#[derive(Debug, Default)]
pub struct Transition {
    pub changes: Changes,
    pub completion: Option<Completion>,
    /// The images of the completion that are not published yet.
    pub images: Vec<StagedFile>,
}

/// Makes transitions of one store durable.
pub struct Committer {
    publications: Group<Vec<StagedFile>>,
    transitions: Group<Transition>,
    failure: watch::Receiver<Option<String>>,
}

impl Committer {
    /// Starts both threads. `published` is called after each batch of publications with its images,
    /// and `committed` after each batch of transitions with those that it published itself.
    pub fn start(
        blobs: Blobs,
        log: CompletionLog,
        ledger: Arc<dyn Ledger>,
        metrics: Arc<dyn Meter>,
        published: impl Fn(&[StagedFile]) + Send + 'static,
        committed: impl Fn(&[StagedFile]) + Send + 'static,
    ) -> Result<Self, FileError> {
        let failure = Failure::none_yet();
        let told = failure.subscribe();
        let pace = Pace {
            most: limits::COMMIT_BATCH_MAX,
            interval: limits::COMMIT_INTERVAL,
        };
        let images = blobs.clone();
        let noted = Arc::clone(&metrics);
        let publications = Group::start(
            "publication",
            pace,
            failure.clone(),
            move |batch: Vec<Vec<StagedFile>>| {
                let began = Instant::now();
                let batch = batch.concat();
                images.publish(batch.iter())?;
                noted.note_publication(began.elapsed());
                published(&batch);
                Ok::<_, FileError>(())
            },
        )?;
        let mut writer = Writer { blobs, log, ledger };
        let transitions = Group::start("group commit", pace, failure, move |transitions| {
            let began = Instant::now();
            let count = transitions.len();
            let batch = Batch::of(transitions);
            if !batch.changes.is_empty() {
                writer.write(&batch)?;
                metrics.note_commit(began.elapsed(), count);
            }
            committed(&batch.images);
            Ok::<_, LedgerError>(())
        })?;
        Ok(Self {
            publications,
            transitions,
            failure: told,
        })
    }

    /// Writes where it is asked to.
    #[cfg(test)]
    pub fn without_thread(blobs: Blobs, log: CompletionLog, ledger: Arc<dyn Ledger>) -> Self {
        let images = blobs.clone();
        let publish = move |batch: Vec<Vec<StagedFile>>| images.publish(batch.iter().flatten());
        let mut writer = Writer { blobs, log, ledger };
        let write = move |transitions| writer.write(&Batch::of(transitions));
        Self {
            publications: Group::without_thread(publish),
            transitions: Group::without_thread(write),
            failure: Failure::none_yet().subscribe(),
        }
    }

    /// Gives staged images their names; never waits.
    pub fn publish(&self, images: Vec<StagedFile>) -> Pending {
        self.publications.submit(images)
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

    /// Accepts nothing more and returns when all that was submitted is durable. Blocks.
    pub fn close(&self) {
        self.publications.close();
        self.transitions.close();
    }
}

struct Writer {
    blobs: Blobs,
    log: CompletionLog,
    ledger: Arc<dyn Ledger>,
}

/// What becomes durable together.
#[derive(Default)]
struct Batch {
    changes: Changes,
    completions: Vec<Completion>,
    images: Vec<StagedFile>,
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
        self.images.extend(transition.images);
    }
}

impl Writer {
    fn write(&mut self, batch: &Batch) -> Result<(), LedgerError> {
        self.blobs.publish(batch.images.iter())?;
        self.log.append_entries(&batch.lines)?;
        self.ledger.apply(&batch.changes, &batch.completions)?;
        self.ledger.sync()
    }
}
