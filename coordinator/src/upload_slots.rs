//! Runs short pieces of blocking work, a few at a time.
//!
//! Work begins in the order of the requests. A slot is released only after the caller of the finished
//! work has been polled. So if there is more work than the cores can do, as with a thousand workers,
//! uploads wait here, and calls that are answered quickly (leases, renewals, completions) do not wait
//! behind them.

use std::sync::Arc;
use tokio::{sync::Semaphore, task};

/// A limit on the pieces of work that run at one time, on the runtime's threads for blocking work.
pub(crate) struct UploadSlots {
    free: Arc<Semaphore>,
}

/// The work was not done, or panicked.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Interrupted;

impl UploadSlots {
    pub fn new(most: usize) -> Self {
        Self {
            free: Arc::new(Semaphore::new(most)),
        }
    }

    /// Does a piece of work after all that were asked for before. Once begun it ends, even when
    /// nobody waits for it any more; one that nobody waits for is not begun. Has to be called
    /// inside a runtime.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Interrupted> {
        let free = Arc::clone(&self.free);
        // Nobody closes it.
        let hand = Arc::new(free.acquire_owned().await.map_err(|_| Interrupted)?);
        // Free again when the work is done and its asker knows it, or is gone.
        let held = Arc::clone(&hand);
        let done = task::spawn_blocking(move || {
            let _held = held;
            work()
        });
        done.await.map_err(|_| Interrupted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        sync::{Mutex, mpsc},
        thread,
        time::Duration,
    };
    use tokio::{sync::oneshot, task::JoinSet};

    #[tokio::test]
    async fn all_work_is_done_so_many_pieces_at_one_time() {
        let slots = Arc::new(UploadSlots::new(3));
        let at_work = Arc::new(Mutex::new((0_usize, 0_usize)));
        let mut all = JoinSet::new();
        for number in 0..200_u64 {
            let (slots, at_work) = (Arc::clone(&slots), Arc::clone(&at_work));
            all.spawn(async move {
                let work = move || {
                    {
                        let mut at_work = at_work.lock().unwrap();
                        at_work.0 += 1;
                        at_work.1 = at_work.1.max(at_work.0);
                    }
                    thread::sleep(Duration::from_millis(1));
                    at_work.lock().unwrap().0 -= 1;
                    number
                };
                assert_eq!(slots.run(work).await, Ok(number));
            });
        }
        all.join_all().await;
        let (left, most) = *at_work.lock().unwrap();
        assert_eq!(left, 0);
        assert!((2..=3).contains(&most), "{most} at one time");
    }

    #[tokio::test]
    async fn the_next_begins_when_the_asker_has_had_its_turn() {
        let slots = Arc::new(UploadSlots::new(1));
        let (tell, told) = mpsc::channel();
        let (release, released) = mpsc::channel::<()>();
        let first = {
            let (slots, tell) = (Arc::clone(&slots), tell.clone());
            let work = move || {
                // Work that is done at once may be done before its asker's turn is over.
                released.recv().unwrap();
                tell.send(1)
            };
            task::spawn(async move { slots.run(work).await })
        };
        let second = {
            let slots = Arc::clone(&slots);
            task::spawn(async move { slots.run(move || tell.send(2)).await })
        };
        // Both ask; this thread, the runtime's only one, then gives nobody a turn.
        task::yield_now().await;
        release.send(()).unwrap();
        assert_eq!(told.recv(), Ok(1));
        let next = told.recv_timeout(Duration::from_millis(100));
        assert_eq!(next, Err(mpsc::RecvTimeoutError::Timeout));
        first.await.unwrap().unwrap().unwrap();
        second.await.unwrap().unwrap().unwrap();
        assert_eq!(told.recv(), Ok(2));
    }

    #[tokio::test]
    async fn a_panic_costs_its_own_work_alone_and_what_nobody_waits_for_is_not_begun() {
        let slots = Arc::new(UploadSlots::new(1));
        let (release, released) = mpsc::channel::<()>();
        let (begun, has_begun) = oneshot::channel();
        let held = {
            let slots = Arc::clone(&slots);
            task::spawn(async move {
                let work = move || {
                    begun.send(()).unwrap();
                    released.recv().unwrap();
                };
                slots.run(work).await
            })
        };
        has_begun.await.unwrap();
        let (told, tells) = mpsc::channel();
        let abandoned = {
            let slots = Arc::clone(&slots);
            let told = told.clone();
            task::spawn(async move { slots.run(move || told.send("abandoned")).await })
        };
        task::yield_now().await;
        abandoned.abort();
        assert!(abandoned.await.unwrap_err().is_cancelled());
        // What is begun keeps its place when nobody waits for it any more.
        held.abort();
        assert!(held.await.unwrap_err().is_cancelled());
        assert_eq!(slots.free.available_permits(), 0);
        release.send(()).unwrap();
        let panics = slots.run(|| -> u8 { panic!("a piece of work that panics on purpose") });
        assert_eq!(panics.await, Err(Interrupted));
        let after = slots.run(move || told.send("after").is_ok());
        assert_eq!(after.await, Ok(true));
        assert_eq!(tells.try_iter().collect::<Vec<_>>(), ["after"]);
    }
}
