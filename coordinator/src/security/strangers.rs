//! Connections whose peers have not shown a token yet.
//!
//! A peer can finish its handshake and then keep silent, so that it costs a place and nothing else.
//! Such a stranger has until a deadline to make a call that is authorised, and there is room for so
//! many. Who comes when all of it is taken gets in nevertheless: the stranger who has been there
//! longest goes, and of those from addresses that have shown a token none before the others. An
//! honest client makes its first call at once. Those that have shown a token have places of their
//! own, which no stranger takes.

use futures_util::task::AtomicWaker;
use std::{
    collections::{BTreeMap, HashSet, VecDeque},
    net::IpAddr,
    pin::Pin,
    sync::{
        Arc, Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore},
    time::{Sleep, sleep},
};

/// All who have shown no token, and places for those who have.
#[derive(Clone)]
pub(crate) struct Strangers(Arc<Shared>);

struct Shared {
    strangers_max: usize,
    stay: Duration,
    places: Arc<Semaphore>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    // The longest there has the lowest number.
    next: u64,
    from_anywhere: BTreeMap<u64, Peer>,
    from_known_addresses: BTreeMap<u64, Peer>,
    // Addresses that have shown a token, the oldest first.
    known: HashSet<IpAddr>,
    by_age: VecDeque<IpAddr>,
}

/// The other end of a connection. It goes with every call.
#[derive(Clone)]
pub struct Peer(Arc<PeerState>);

struct PeerState {
    number: u64,
    address: IpAddr,
    strangers: Strangers,
    // From its first authorised call on.
    place: OnceLock<OwnedSemaphorePermit>,
    is_put_out: AtomicBool,
    // Also where it has shown a token.
    has_to_go: AtomicBool,
    waker: AtomicWaker,
}

/// A connection's visit: it ends when the visit is dropped.
pub(crate) struct Visit {
    pub peer: Peer,
    // None once the peer has shown a token.
    deadline: Option<Pin<Box<Sleep>>>,
}

impl Strangers {
    /// Room for `strangers_max` strangers, each for `stay`, and for `known_max` others.
    pub fn new(strangers_max: usize, stay: Duration, known_max: usize) -> Self {
        Self(Arc::new(Shared {
            strangers_max,
            stay,
            places: Arc::new(Semaphore::new(known_max)),
            state: Mutex::default(),
        }))
    }

    // Nothing that runs under the lock panics half way through a change.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets somebody in, in place of somebody else if need be.
    pub fn let_in(&self, address: IpAddr) -> Visit {
        let mut state = self.lock();
        let strangers = state.from_anywhere.len() + state.from_known_addresses.len();
        if strangers >= self.0.strangers_max {
            let longest = state.from_anywhere.pop_first();
            let longest = longest.or_else(|| state.from_known_addresses.pop_first());
            if let Some((_, peer)) = longest {
                peer.0.is_put_out.store(true, Ordering::Release);
                peer.0.waker.wake();
            }
        }
        let number = state.next;
        state.next += 1;
        let peer = Peer(Arc::new(PeerState {
            number,
            address,
            strangers: self.clone(),
            place: OnceLock::new(),
            is_put_out: AtomicBool::new(false),
            has_to_go: AtomicBool::new(false),
            waker: AtomicWaker::new(),
        }));
        let waiting = if state.known.contains(&address) {
            &mut state.from_known_addresses
        } else {
            &mut state.from_anywhere
        };
        waiting.insert(number, peer.clone());
        Visit {
            peer,
            deadline: Some(Box::pin(sleep(self.0.stay))),
        }
    }
}

impl State {
    fn forget(&mut self, number: u64) {
        self.from_anywhere.remove(&number);
        self.from_known_addresses.remove(&number);
    }

    fn remember(&mut self, address: IpAddr) {
        if !self.known.insert(address) {
            return;
        }
        self.by_age.push_back(address);
        if self.by_age.len() > limits::KNOWN_ADDRESSES_MAX
            && let Some(oldest) = self.by_age.pop_front()
        {
            self.known.remove(&oldest);
        }
    }
}

impl Peer {
    /// What tells it from the others.
    pub(crate) fn number(&self) -> u64 {
        self.0.number
    }

    /// Closes its connection, whatever it has shown.
    pub(crate) fn put_out(&self) {
        self.0.has_to_go.store(true, Ordering::Release);
        self.0.waker.wake();
    }

    /// Notes that the peer made a call that is authorised: it is no stranger any more, if there is a
    /// place for it.
    pub fn introduce(&self) {
        let peer = &self.0;
        if peer.place.get().is_some() {
            return;
        }
        let places = Arc::clone(&peer.strangers.0.places);
        let Ok(place) = places.try_acquire_owned() else {
            tracing::warn!("too many connections are open: one with a token has to go");
            return;
        };
        // Another call of the same peer may have been first; its place is as good.
        if peer.place.set(place).is_ok() {
            let mut state = peer.strangers.lock();
            state.forget(peer.number);
            state.remember(peer.address);
        }
    }
}

impl Visit {
    /// Ready when the peer has to go, with the reason.
    pub fn poll_end(&mut self, context: &mut Context<'_>) -> Poll<&'static str> {
        let peer = &self.peer.0;
        peer.waker.register(context.waker());
        if peer.has_to_go.load(Ordering::Acquire) {
            return Poll::Ready("answers were not read in time");
        }
        let Some(deadline) = &mut self.deadline else {
            return Poll::Pending;
        };
        if peer.place.get().is_some() {
            self.deadline = None;
            return Poll::Pending;
        }
        let why = "no call was authorised in time";
        if peer.is_put_out.load(Ordering::Acquire) {
            return Poll::Ready(why);
        }
        deadline.as_mut().poll(context).map(|()| why)
    }
}

impl Drop for Visit {
    fn drop(&mut self) {
        let peer = &self.peer.0;
        peer.strangers.lock().forget(peer.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::future::poll_fn;
    use std::net::Ipv4Addr;
    use tokio::time::{Instant, timeout};

    const STAY: Duration = Duration::from_secs(10);

    fn address(number: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, number).into()
    }

    /// Whether a peer has to go within a time.
    async fn ends_within(visit: &mut Visit, wait: Duration) -> bool {
        let end = poll_fn(|context| visit.poll_end(context));
        timeout(wait, end).await.is_ok()
    }

    #[tokio::test(start_paused = true)]
    async fn a_stranger_has_until_the_deadline_and_a_caller_with_a_token_stays() {
        let strangers = Strangers::new(4, STAY, 4);
        let mut silent = strangers.let_in(address(1));
        let mut known = strangers.let_in(address(1));
        known.peer.introduce();
        let began = Instant::now();
        assert!(ends_within(&mut silent, 2 * STAY).await);
        assert_eq!(began.elapsed(), STAY);
        assert!(!ends_within(&mut known, 100 * STAY).await);
    }

    #[tokio::test(start_paused = true)]
    async fn who_comes_new_gets_in_and_those_of_unknown_addresses_go_first() {
        let strangers = Strangers::new(3, STAY, 2);
        let now = Duration::ZERO;
        strangers.let_in(address(9)).peer.introduce();
        let mut familiar = strangers.let_in(address(9));
        let mut flood: Vec<Visit> = (0..100).map(|n| strangers.let_in(address(n % 7))).collect();
        assert!(!ends_within(&mut familiar, now).await);
        let mut left = 0;
        for visit in &mut flood {
            left += usize::from(!ends_within(visit, now).await);
        }
        assert_eq!(left, 2);
        // Whoever shows a token in time has a place that no flood takes.
        familiar.peer.introduce();
        flood.extend((0..100).map(|n| strangers.let_in(address(n % 7))));
        assert!(!ends_within(&mut familiar, 100 * STAY).await);
        drop(flood);
        assert_eq!(strangers.lock().from_anywhere.len(), 0);
        // The places of those who left are free.
        drop(familiar);
        for _ in 0..5 {
            let mut visit = strangers.let_in(address(1));
            visit.peer.introduce();
            assert!(!ends_within(&mut visit, 2 * STAY).await);
        }
    }
}
