//! A few threads for many short pieces of work that block.
//!
//! Waking a thread for each small image costs as much as the image: a thread that is awake goes on
//! as long as anything waits. The threads are those of the runtime that are meant to be blocked, and
//! each is held only while there is work.
//!
//! They are given little ahead, and what is done makes room only once its asker has had its turn
//! among the runtime's tasks. So where there is more to do than the cores can, as with a thousand
//! workers, it is here that calls wait, in their order, and not before those that are quickly
//! answered: leases, renewals, completions.

use crate::limits;
use std::{
    collections::VecDeque,
    panic::{self, AssertUnwindSafe},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};
use tokio::{
    sync::{Semaphore, oneshot},
    task,
};

type Work = Box<dyn FnOnce() + Send>;

/// At most so many threads at work.
#[derive(Clone)]
pub(crate) struct Hands {
    most: usize,
    state: Arc<Mutex<State>>,
    // What may be with the threads, or done and its asker not told.
    room: Arc<Semaphore>,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Work>,
    busy: usize,
}

/// The work was not done, or panicked.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Interrupted;

impl Hands {
    pub fn new(most: usize) -> Self {
        Self {
            most,
            state: Arc::default(),
            room: Arc::new(Semaphore::new(most * limits::WORK_AHEAD)),
        }
    }

    /// Does a piece of work after all that were given before. Once begun it ends, even when nobody
    /// waits for it any more; one that nobody waits for is not begun. Has to be called inside a
    /// runtime.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Interrupted> {
        // Nobody closes it.
        let _place = self.room.acquire().await.map_err(|_| Interrupted)?;
        let (answer, answered) = oneshot::channel();
        let work = move || {
            if !answer.is_closed() {
                // Whoever asked may go meanwhile.
                drop(answer.send(work()));
            }
        };
        let another = {
            let mut state = self.lock();
            state.waiting.push_back(Box::new(work));
            let another = state.busy < self.most;
            state.busy += usize::from(another);
            another
        };
        if another {
            let hands = self.clone();
            task::spawn_blocking(move || hands.work());
        }
        answered.await.map_err(|_| Interrupted)
    }

    fn work(&self) {
        loop {
            let work = {
                let mut state = self.lock();
                let Some(work) = state.waiting.pop_front() else {
                    state.busy -= 1;
                    return;
                };
                work
            };
            // The panic has been told where it happened, and whoever asked gets no answer.
            drop(panic::catch_unwind(AssertUnwindSafe(work)));
        }
    }

    // Nothing that runs under the lock panics.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{sync::mpsc, time::Duration};
    use tokio::task::JoinSet;

    #[tokio::test]
    async fn all_work_is_done_by_so_many_threads_at_most() {
        let hands = Hands::new(3);
        let at_work = Arc::new(Mutex::new((0_usize, 0_usize)));
        let mut all = JoinSet::new();
        for number in 0..200_u64 {
            let (hands, at_work) = (hands.clone(), Arc::clone(&at_work));
            all.spawn(async move {
                let work = move || {
                    {
                        let mut at_work = at_work.lock().unwrap();
                        at_work.0 += 1;
                        at_work.1 = at_work.1.max(at_work.0);
                    }
                    std::thread::sleep(Duration::from_millis(1));
                    at_work.lock().unwrap().0 -= 1;
                    number
                };
                assert_eq!(hands.run(work).await, Ok(number));
            });
        }
        all.join_all().await;
        let (left, most) = *at_work.lock().unwrap();
        assert_eq!(left, 0);
        assert!((2..=3).contains(&most), "{most} at one time");
        // A thread lets go a moment after its last answer.
        while hands.lock().busy > 0 {
            task::yield_now().await;
        }
    }

    #[tokio::test]
    async fn little_is_given_ahead() {
        let hands = Hands::new(1);
        let (release, released) = mpsc::channel::<()>();
        let released = Arc::new(Mutex::new(released));
        let mut all = JoinSet::new();
        for _ in 0..3 * limits::WORK_AHEAD {
            let (hands, released) = (hands.clone(), Arc::clone(&released));
            all.spawn(async move {
                let work = move || released.lock().unwrap().recv().is_ok();
                assert_eq!(hands.run(work).await, Ok(true));
            });
        }
        while hands.room.available_permits() > 0 {
            task::yield_now().await;
        }
        // Everybody has had a turn since, and was given nothing.
        task::yield_now().await;
        assert!(hands.lock().waiting.len() <= limits::WORK_AHEAD);
        for _ in 0..3 * limits::WORK_AHEAD {
            release.send(()).unwrap();
        }
        all.join_all().await;
    }

    #[tokio::test]
    async fn a_panic_costs_its_own_work_alone_and_what_nobody_waits_for_is_not_begun() {
        let hands = Hands::new(1);
        let (release, released) = mpsc::channel::<()>();
        let (begun, mut has_begun) = oneshot::channel();
        let held = {
            let hands = hands.clone();
            task::spawn(async move {
                let work = move || {
                    begun.send(()).unwrap();
                    released.recv().unwrap();
                };
                hands.run(work).await
            })
        };
        (&mut has_begun).await.unwrap();
        let (told, tells) = mpsc::channel();
        let abandoned = {
            let hands = hands.clone();
            let told = told.clone();
            task::spawn(async move { hands.run(move || told.send("abandoned")).await })
        };
        while hands.lock().waiting.is_empty() {
            task::yield_now().await;
        }
        abandoned.abort();
        assert!(abandoned.await.unwrap_err().is_cancelled());
        release.send(()).unwrap();
        assert_eq!(held.await.unwrap(), Ok(()));
        let panics = hands.run(|| -> u8 { panic!("a piece of work that panics on purpose") });
        assert_eq!(panics.await, Err(Interrupted));
        let after = hands.run(move || told.send("after").is_ok());
        assert_eq!(after.await, Ok(true));
        assert_eq!(tells.try_iter().collect::<Vec<_>>(), ["after"]);
    }
}
