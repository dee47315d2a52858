//! Workers that wait for a job, woken one for each job that there may be for them.
//!
//! A job is not for everybody: its own renderer cannot render it again, and whoever failed it comes
//! last. So one that was woken and found nothing wakes two that have not looked since, and they two
//! each: where the job is for one of a thousand, that one looks after ten rounds, and where it is
//! for anybody one looks and the others sleep. A wake-up that its worker does not use, because its
//! call ended, goes on to others in the same way.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
};
use tokio::sync::Notify;

/// How many are woken by one that looked and found nothing.
const PASSED_ON_TO: usize = 2;

/// All who wait.
#[derive(Clone, Default)]
pub struct Work(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    // How often there was something to look for.
    offers: u64,
    next: u64,
    // In the order in which they came.
    waiting: BTreeMap<u64, Waiting>,
}

struct Waiting {
    // Offers before it looked.
    since: u64,
    bell: Arc<Bell>,
}

#[derive(Default)]
struct Bell {
    rings: Notify,
    // For which offer it was rung.
    offer: OnceLock<u64>,
}

/// Somebody who waits; from when this is made nothing is missed. One who was woken has this drop
/// before or after the next look: what it did not use goes on to others.
pub struct Waiter {
    work: Work,
    number: u64,
    bell: Arc<Bell>,
    used: bool,
}

impl Work {
    // Nothing that runs under the lock panics half way through a change.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins to wait. Look for work after this.
    pub fn wait(&self) -> Waiter {
        let bell = Arc::<Bell>::default();
        let mut state = self.lock();
        let number = state.next;
        state.next += 1;
        let waiting = Waiting {
            since: state.offers,
            bell: Arc::clone(&bell),
        };
        state.waiting.insert(number, waiting);
        drop(state);
        Waiter {
            work: self.clone(),
            number,
            bell,
            used: false,
        }
    }

    /// This many jobs may be available: wakes as many callers.
    pub fn offer(&self, jobs: usize) {
        if jobs == 0 {
            return;
        }
        let mut state = self.lock();
        state.offers += 1;
        let offer = state.offers;
        state.ring(jobs, offer);
    }

    /// Something changed for everybody: wakes all.
    pub fn offer_to_all(&self) {
        self.offer(usize::MAX);
    }
}

impl State {
    /// Wakes those who came first and have not looked since an offer.
    fn ring(&mut self, most: usize, offer: u64) {
        for _ in 0..most {
            let Some(first) = self.waiting.first_entry() else {
                return;
            };
            if first.get().since >= offer {
                return;
            }
            let bell = first.remove().bell;
            // It is rung once: it is no longer among those who wait.
            let _ = bell.offer.set(offer);
            bell.rings.notify_one();
        }
    }
}

impl Waiter {
    /// Waits until there may be work.
    pub async fn woken(&self) {
        self.bell.rings.notified().await;
    }

    /// Notes that the wake-up, if there was one, led to work or to the end.
    pub fn used(mut self) {
        self.used = true;
    }
}

impl Drop for Waiter {
    fn drop(&mut self) {
        let mut state = self.work.lock();
        state.waiting.remove(&self.number);
        if let (Some(offer), false) = (self.bell.offer.get(), self.used) {
            state.ring(PASSED_ON_TO, *offer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        sync::atomic::{AtomicUsize, Ordering},
        time::Duration,
    };
    use tokio::{task::JoinSet, time::sleep};

    /// Workers that look as calls do, and find something where `finds` says so.
    fn idle(
        work: &Work,
        looks: &Arc<AtomicUsize>,
        finds: impl Fn(usize) -> bool + Clone + Send + 'static,
    ) -> JoinSet<usize> {
        let mut workers = JoinSet::new();
        for number in 0..1000 {
            let (work, looks, finds) = (work.clone(), Arc::clone(looks), finds.clone());
            workers.spawn(async move {
                let mut woken: Option<Waiter> = None;
                loop {
                    let waiter = work.wait();
                    looks.fetch_add(1, Ordering::Relaxed);
                    if finds(number) {
                        waiter.used();
                        if let Some(woken) = woken {
                            woken.used();
                        }
                        return number;
                    }
                    drop(woken);
                    waiter.woken().await;
                    woken = Some(waiter);
                }
            });
        }
        workers
    }

    async fn settled() {
        sleep(Duration::from_millis(50)).await;
    }

    #[tokio::test(start_paused = true)]
    async fn one_job_that_is_for_anybody_wakes_one() {
        let (work, looks) = (Work::default(), Arc::default());
        let jobs = Arc::new(AtomicUsize::new(0));
        let left = Arc::clone(&jobs);
        let take = move |_| {
            let order = Ordering::Relaxed;
            left.fetch_update(order, order, |jobs| jobs.checked_sub(1))
                .is_ok()
        };
        let mut workers = idle(&work, &looks, take);
        settled().await;
        assert_eq!(looks.swap(0, Ordering::Relaxed), 1000);
        for offered in [1, 3] {
            jobs.store(offered, Ordering::Relaxed);
            work.offer(offered);
            for _ in 0..offered {
                workers.join_next().await.unwrap().unwrap();
            }
            settled().await;
            assert_eq!(looks.swap(0, Ordering::Relaxed), offered);
        }
        work.offer_to_all();
        settled().await;
        assert_eq!(looks.swap(0, Ordering::Relaxed), 996);
    }

    #[tokio::test(start_paused = true)]
    async fn a_job_that_is_for_one_of_a_thousand_reaches_it() {
        let (work, looks) = (Work::default(), Arc::default());
        let is_there = Arc::new(AtomicUsize::new(0));
        let found = Arc::clone(&is_there);
        let able = move |number| number == 777 && found.load(Ordering::Relaxed) == 1;
        let mut workers = idle(&work, &looks, able);
        settled().await;
        is_there.store(1, Ordering::Relaxed);
        looks.store(0, Ordering::Relaxed);
        work.offer(1);
        assert_eq!(workers.join_next().await.unwrap().unwrap(), 777);
        settled().await;
        // Those who were woken beside it went on waking others; nobody looked twice.
        assert!((2..=1000).contains(&looks.load(Ordering::Relaxed)));
    }

    #[tokio::test(start_paused = true)]
    async fn a_wake_up_whose_call_ended_goes_to_another() {
        let work = Work::default();
        let [gone, first, second] = [(); 3].map(|()| work.wait());
        work.offer(1);
        drop(gone);
        first.woken().await;
        second.woken().await;
        assert!(work.lock().waiting.is_empty());
    }
}
