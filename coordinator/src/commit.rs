//! Group commit: one thread that makes transitions durable, many at a time.
//!
//! Transitions are submitted in the order they happened, and become durable in that order. A batch
//! is everything that waits when the batch before is done, so the number of syncs does not grow
//! with the number of workers. For a batch, in this order: images get their names (synced before
//! and after), completions are appended to the log (synced), the ledger is written (flushed and
//! synced), and only then does anybody hear of it.
//!
//! Architecture invariant: what was acknowledged is durable. After an error nothing more is written
//! or acknowledged, because after a failed sync nobody knows what is on the disk; the next start
//! finds out.

use crate::{
    blobs::{Blobs, StagedFile},
    completion::Completion,
    completion_log::{CompletionLog, Entry, Retraction},
    file_error::FileError,
    ledger::{Ledger, LedgerError},
    limits,
    metrics::Metrics,
    queue::Changes,
};
use std::{
    io,
    panic::{self, AssertUnwindSafe},
    sync::{Arc, Mutex, PoisonError, mpsc},
    thread::{self, JoinHandle},
    time::Instant,
};
use thiserror::Error;
use tokio::sync::{oneshot, watch};

/// The store can no longer be written, or the coordinator is stopping: the transition may or may
/// not be durable.
#[derive(Clone, Debug, Error)]
#[error("the coordinator no longer writes to its store{}", .0.as_ref().map(|why| format!(": {why}")).unwrap_or_default())]
pub struct NotDurable(pub Option<String>);

/// What one submission makes durable.
#[derive(Debug, Default)]
pub(crate) struct Transition {
    pub changes: Changes,
    pub completion: Option<Completion>,
    /// The images of the completion that are not in the store yet.
    pub images: Vec<StagedFile>,
}

struct Submission {
    transition: Transition,
    durable: oneshot::Sender<()>,
}

/// The commit thread's address.
pub(crate) struct Committer {
    submissions: Mutex<Option<Address>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    failure: watch::Receiver<Option<String>>,
}

enum Address {
    Thread(mpsc::Sender<Submission>),
    /// Whoever submits writes.
    #[cfg(test)]
    Here(Box<Writer>),
}

/// A transition under way to durability.
pub(crate) struct Pending {
    durable: Option<oneshot::Receiver<()>>,
    failure: watch::Receiver<Option<String>>,
}

impl Committer {
    /// Starts the thread. `durable` is called after each batch with the images it published.
    pub fn start(
        blobs: Blobs,
        log: CompletionLog,
        ledger: Arc<dyn Ledger>,
        metrics: Arc<Metrics>,
        durable: impl Fn(&[StagedFile]) + Send + 'static,
    ) -> Result<Self, FileError> {
        let (submissions, waiting) = mpsc::channel();
        let (failed, failure) = watch::channel(None);
        let mut writer = Writer {
            blobs,
            log,
            ledger,
            metrics,
        };
        let thread = thread::Builder::new()
            .name("group commit".to_owned())
            .spawn(move || {
                // sled can panic over a damaged page; that is a failure to write like any other.
                let run = AssertUnwindSafe(|| run(&waiting, &mut writer, &durable));
                let result = panic::catch_unwind(run)
                    .unwrap_or_else(|_| Err(LedgerError::Damaged("writing failed".to_owned())));
                if let Err(error) = result {
                    tracing::error!(%error, "the store cannot be written: nothing more is accepted");
                    failed.send_replace(Some(error.to_string()));
                }
            })
            .map_err(|source| FileError {
                action: "start the commit thread of",
                path: "the store".into(),
                source: io::Error::other(source),
            })?;
        Ok(Self {
            submissions: Mutex::new(Some(Address::Thread(submissions))),
            thread: Mutex::new(Some(thread)),
            failure,
        })
    }

    /// Writes each transition where it is submitted: a test of many small ones would spend its
    /// time on waking the thread.
    #[cfg(test)]
    pub fn without_thread(blobs: Blobs, log: CompletionLog, ledger: Arc<dyn Ledger>) -> Self {
        let writer = Writer {
            blobs,
            log,
            ledger,
            metrics: Arc::default(),
        };
        Self {
            submissions: Mutex::new(Some(Address::Here(Box::new(writer)))),
            thread: Mutex::new(None),
            failure: watch::channel(None).1,
        }
    }

    /// Hands a transition over; never waits. Whoever calls holds the lock over the state that the
    /// transition changed, so that the order here is the order there.
    pub fn submit(&self, transition: Transition) -> Pending {
        let (durable, receiver) = oneshot::channel();
        let submission = Submission {
            transition,
            durable,
        };
        let submissions = self.submissions.lock();
        let sent = match &mut *submissions.unwrap_or_else(PoisonError::into_inner) {
            Some(Address::Thread(thread)) => thread.send(submission).is_ok(),
            #[cfg(test)]
            Some(Address::Here(writer)) => {
                let mut batch = Batch::default();
                batch.add(submission.transition);
                writer.write(&batch).is_ok() && submission.durable.send(()).is_ok()
            }
            None => false,
        };
        Pending {
            durable: sent.then_some(receiver),
            failure: self.failure.clone(),
        }
    }

    /// Why the store can no longer be written, once that is so.
    pub fn failure(&self) -> watch::Receiver<Option<String>> {
        self.failure.clone()
    }

    /// Accepts nothing more and returns when all that was submitted is durable. Blocks.
    pub fn close(&self) {
        let submissions = self.submissions.lock();
        drop(submissions.unwrap_or_else(PoisonError::into_inner).take());
        let thread = self.thread.lock();
        let thread = thread.unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            // Its panics are caught and told inside.
            drop(thread.join());
        }
    }
}

impl Pending {
    /// Waits until the transition is durable.
    pub async fn durable(self) -> Result<(), NotDurable> {
        if let Some(durable) = self.durable
            && durable.await.is_ok()
        {
            return Ok(());
        }
        // The thread drops what waits before it says why; both happen without a wait.
        let mut failure = self.failure;
        let why = match failure.wait_for(Option::is_some).await {
            Ok(why) => why.clone(),
            Err(_) => None,
        };
        Err(NotDurable(why))
    }
}

struct Writer {
    blobs: Blobs,
    log: CompletionLog,
    ledger: Arc<dyn Ledger>,
    metrics: Arc<Metrics>,
}

fn run(
    waiting: &mpsc::Receiver<Submission>,
    writer: &mut Writer,
    durable: &impl Fn(&[StagedFile]),
) -> Result<(), LedgerError> {
    while let Ok(first) = waiting.recv() {
        let more = waiting.try_iter().take(limits::COMMIT_BATCH_MAX - 1);
        let mut waiters = Vec::new();
        let mut batch = Batch::default();
        for submission in std::iter::once(first).chain(more) {
            batch.add(submission.transition);
            waiters.push(submission.durable);
        }
        if !batch.changes.is_empty() {
            let began = Instant::now();
            writer.write(&batch)?;
            writer.metrics.note_commit(began.elapsed(), waiters.len());
        }
        durable(&batch.images);
        for waiter in waiters {
            // Whoever asked may have gone; the transition stands.
            let _ = waiter.send(());
        }
    }
    Ok(())
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
