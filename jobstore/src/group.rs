//! A thread that makes things durable, many at a time.
//!
//! What is submitted becomes durable in the order it was. A batch is everything that waits when the
//! batch before is done, so the number of syncs does not grow with the number of workers.
//!
//! After an error nothing more is written or acknowledged, here or by another group of the same
//! store: after a failed sync nobody knows what is on the disk, and the next start finds out.

use imagestore::FileError;
use std::{
    fmt::Display,
    io,
    panic::{self, AssertUnwindSafe},
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};
use thiserror::Error;
use tokio::sync::{oneshot, watch};

/// The store can no longer be written, or the coordinator is stopping: the transition may or may
/// not be durable.
#[derive(Clone, Debug, Error)]
#[error("the coordinator no longer writes to its store{}", .0.as_ref().map(|why| format!(": {why}")).unwrap_or_default())]
pub struct NotDurable(pub Option<String>);

/// Why a store can no longer be written, once that is so. The threads of the store's groups hold
/// it, and nobody else: whoever waits for it learns also that all of them ended.
#[derive(Clone, Debug)]
pub struct Failure(Arc<watch::Sender<Option<String>>>);

impl Failure {
    pub fn none_yet() -> Self {
        Self(Arc::new(watch::channel(None).0))
    }

    pub fn subscribe(&self) -> watch::Receiver<Option<String>> {
        self.0.subscribe()
    }

    fn happened(&self) -> bool {
        self.0.borrow().is_some()
    }

    fn publish(&self, error: &dyn Display) {
        tracing::error!(%error, "the store cannot be written: nothing more is accepted");
        self.0.send_replace(Some(error.to_string()));
    }
}

/// How batches follow each other.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// The most that one holds.
    pub most: usize,
    /// The least time from the beginning of one to that of the next: batches of a few cost nearly
    /// as much as those of many. What comes after a rest of so long waits for nothing.
    pub interval: Duration,
}

/// The thread's address.
pub struct Group<T> {
    submissions: Mutex<Option<Address<T>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    failure: watch::Receiver<Option<String>>,
}

enum Address<T> {
    Thread(mpsc::Sender<Submission<T>>),
    /// Whoever submits writes.
    #[cfg(test)]
    Here(Box<dyn FnMut(Vec<T>) -> bool + Send>),
}

struct Submission<T> {
    item: T,
    durable: oneshot::Sender<()>,
}

/// Something under way to durability.
pub struct Pending {
    durable: Option<oneshot::Receiver<()>>,
    failure: watch::Receiver<Option<String>>,
}

impl<T: Send + 'static> Group<T> {
    /// Starts the thread. `write` makes a batch durable.
    pub fn start<E: Display>(
        name: &str,
        pace: Pace,
        failure: Failure,
        mut write: impl FnMut(Vec<T>) -> Result<(), E> + Send + 'static,
    ) -> Result<Self, FileError> {
        let (submissions, waiting) = mpsc::channel();
        let told = failure.subscribe();
        let thread = thread::Builder::new()
            .name(name.to_owned())
            .spawn(move || {
                // sled can panic over a damaged page; that is a failure to write like any other.
                let run = AssertUnwindSafe(|| run(&waiting, pace, &failure, &mut write));
                match panic::catch_unwind(run) {
                    Ok(Ok(())) => {}
                    Ok(Err(error)) => failure.publish(&error),
                    Err(_) => failure.publish(&"writing failed"),
                }
            })
            .map_err(|source| FileError {
                action: "start a thread of",
                path: "the store".into(),
                source: io::Error::other(source),
            })?;
        Ok(Self {
            submissions: Mutex::new(Some(Address::Thread(submissions))),
            thread: Mutex::new(Some(thread)),
            failure: told,
        })
    }

    /// Writes each thing where it is submitted: a test of many small ones would spend its time on
    /// waking the thread.
    #[cfg(test)]
    pub fn without_thread<E>(
        mut write: impl FnMut(Vec<T>) -> Result<(), E> + Send + 'static,
    ) -> Self {
        let write = move |batch| write(batch).is_ok();
        Self {
            submissions: Mutex::new(Some(Address::Here(Box::new(write)))),
            thread: Mutex::new(None),
            failure: Failure::none_yet().subscribe(),
        }
    }

    /// Hands something over. Never waits.
    pub fn submit(&self, item: T) -> Pending {
        let (durable, receiver) = oneshot::channel();
        let sent = match &mut *lock(&self.submissions) {
            Some(Address::Thread(thread)) => thread.send(Submission { item, durable }).is_ok(),
            #[cfg(test)]
            Some(Address::Here(write)) => write(vec![item]) && durable.send(()).is_ok(),
            None => false,
        };
        Pending {
            durable: sent.then_some(receiver),
            failure: self.failure.clone(),
        }
    }

    /// Accepts nothing more and returns when all that was submitted is durable. Blocks.
    pub fn close(&self) {
        drop(lock(&self.submissions).take());
        let thread = lock(&self.thread).take();
        if let Some(thread) = thread {
            // Its panics are caught and told inside.
            drop(thread.join());
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pending {
    /// Waits until it is durable.
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

fn run<T, E>(
    waiting: &mpsc::Receiver<Submission<T>>,
    pace: Pace,
    failure: &Failure,
    write: &mut impl FnMut(Vec<T>) -> Result<(), E>,
) -> Result<(), E> {
    let mut began: Option<Instant> = None;
    while let Ok(first) = waiting.recv() {
        if let Some(began) = began {
            thread::sleep(pace.interval.saturating_sub(began.elapsed()));
        }
        began = Some(Instant::now());
        if failure.happened() {
            return Ok(());
        }
        let more = waiting.try_iter().take(pace.most - 1);
        let submissions = std::iter::once(first).chain(more);
        let (batch, waiters): (Vec<T>, Vec<_>) = submissions
            .map(|submission| (submission.item, submission.durable))
            .unzip();
        write(batch)?;
        for waiter in waiters {
            // Whoever asked may have gone; what was written stands.
            let _ = waiter.send(());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT_ONCE: Pace = Pace {
        most: 3,
        interval: Duration::ZERO,
    };

    #[tokio::test]
    async fn what_waits_is_written_together_and_in_order() {
        let (tell, told) = mpsc::channel();
        let (release, released) = mpsc::channel::<()>();
        let group = Group::start(
            "test",
            AT_ONCE,
            Failure::none_yet(),
            move |batch: Vec<u32>| {
                tell.send(batch).unwrap();
                released.recv()
            },
        );
        let group = group.unwrap();
        let first = group.submit(0);
        assert_eq!(told.recv().unwrap(), [0]);
        let pending: Vec<Pending> = (1..=4).map(|number| group.submit(number)).collect();
        for _ in 0..3 {
            release.send(()).unwrap();
        }
        first.durable().await.unwrap();
        for pending in pending {
            pending.durable().await.unwrap();
        }
        assert_eq!(
            told.try_iter().collect::<Vec<_>>(),
            [vec![1, 2, 3], vec![4]]
        );
        group.close();
        let late = group.submit(5).durable().await;
        assert!(matches!(late, Err(NotDurable(None))));
    }

    #[tokio::test]
    async fn a_batch_begins_an_interval_after_the_one_before() {
        let pace = Pace {
            most: 3,
            interval: Duration::from_millis(200),
        };
        let nothing = |_: Vec<()>| Ok::<_, String>(());
        let group = Group::start("test", pace, Failure::none_yet(), nothing).unwrap();
        group.submit(()).durable().await.unwrap();
        let began = Instant::now();
        group.submit(()).durable().await.unwrap();
        group.submit(()).durable().await.unwrap();
        assert!(began.elapsed() > pace.interval);
    }

    #[tokio::test]
    async fn after_a_failure_no_group_of_the_store_writes() {
        let failure = Failure::none_yet();
        let full = |_: Vec<()>| Err("no space left");
        let failing = Group::start("failing", AT_ONCE, failure.clone(), full).unwrap();
        let (tell, told) = mpsc::channel();
        let other = move |batch: Vec<u32>| tell.send(batch);
        let other = Group::start("other", AT_ONCE, failure.clone(), other).unwrap();
        let error = failing.submit(()).durable().await.unwrap_err();
        assert_eq!(error.0.as_deref(), Some("no space left"));
        let error = other.submit(1).durable().await.unwrap_err();
        assert_eq!(error.0.as_deref(), Some("no space left"));
        assert!(
            told.recv_timeout(Duration::from_secs(10)).is_err(),
            "it wrote"
        );
    }

    #[tokio::test]
    async fn a_panic_is_a_failure() {
        let panics =
            |_: Vec<()>| -> Result<(), String> { panic!("a write that panics on purpose") };
        let group = Group::start("panics", AT_ONCE, Failure::none_yet(), panics).unwrap();
        assert!(group.submit(()).durable().await.is_err());
    }
}
