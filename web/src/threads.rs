//! Threads for what blocks, a few at one time: the runtime has a bounded number of them, and the
//! coordinator in the same process needs them too.

use crate::problem::Problem;
use std::sync::Arc;
use tokio::{sync::Semaphore, task::spawn_blocking};

/// Work that blocks, so much at one time, and so many who wait for it.
pub struct Threads {
    at_once: Arc<Semaphore>,
    waiting: Arc<Semaphore>,
}

impl Threads {
    /// So many at one time, and so many in all.
    pub fn new(at_once: usize, waiting_max: usize) -> Self {
        Self {
            at_once: Arc::new(Semaphore::new(at_once)),
            waiting: Arc::new(Semaphore::new(waiting_max)),
        }
    }

    /// Does work that blocks when its turn comes. Once begun it goes on, and keeps its turn, even if
    /// whoever asked for it leaves.
    ///
    /// # Errors
    /// That of the work, or that too many wait.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let Ok(place) = Arc::clone(&self.waiting).try_acquire_owned() else {
            return Err(Problem::busy("too many ask for this at one time"));
        };
        let Ok(turn) = Arc::clone(&self.at_once).acquire_owned().await else {
            unreachable!("the semaphore is never closed");
        };
        let done = spawn_blocking(move || {
            let _until_done = (place, turn);
            work()
        });
        let done = done.await;
        done.map_err(|_| Problem::broken("it was interrupted: the log says why"))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{sync::mpsc, time::Duration};
    use tokio::time::timeout;

    /// A patient reader asks and leaves, again and again: no more threads are taken than there are.
    #[tokio::test]
    async fn whoever_leaves_makes_no_room_before_the_work_is_done() {
        let threads = Threads::new(1, 2);
        let (begun, has_begun) = mpsc::channel();
        let (release, released) = mpsc::channel::<()>();
        let work = move || {
            begun.send(()).unwrap();
            released.recv().unwrap();
            Ok(())
        };
        let moment = Duration::from_millis(20);
        assert!(timeout(moment, threads.run(work)).await.is_err());
        has_begun.recv().unwrap();
        assert!(timeout(moment, threads.run(|| Ok(1))).await.is_err());
        release.send(()).unwrap();
        assert_eq!(threads.run(|| Ok(2)).await, Ok(2));
        let broken: Result<(), Problem> = threads.run(|| panic!("on purpose")).await;
        assert!(broken.unwrap_err().sentence.contains("interrupted"));
        assert_eq!(threads.run(|| Ok(3)).await, Ok(3));
    }

    #[tokio::test]
    async fn too_many_are_refused() {
        let threads = Threads::new(1, 1);
        let (release, released) = mpsc::channel::<()>();
        let first = threads.run(move || {
            released.recv().unwrap();
            Ok(())
        });
        let mut first = std::pin::pin!(first);
        assert!(
            timeout(Duration::from_millis(20), first.as_mut())
                .await
                .is_err()
        );
        let refused = threads.run(|| Ok(())).await.unwrap_err();
        assert!(refused.sentence.starts_with("too many"), "{refused:?}");
        release.send(()).unwrap();
        assert_eq!(first.await, Ok(()));
    }
}
