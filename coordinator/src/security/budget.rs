//! Bytes of messages under way, of all calls together.
//!
//! Most of the budget is for long messages, as uploads are: where there are too many, the next one
//! is refused and tried again later. The rest is for short ones, as those are that ask how things
//! stand or block a worker. Where that is full too, a short message has the longest one put out that
//! is still arriving. So nobody keeps an operator out by sending uploads that never end.
//!
//! A message says in its first bytes how long it will be. One that says too little counts as long as
//! soon as more than `SHORT_MESSAGE_BYTES_MAX` of it has arrived.

use limits::{LONG_MESSAGES_BYTES_MAX, MESSAGES_BYTES_MAX, SHORT_MESSAGE_BYTES_MAX};
use std::{
    collections::BTreeMap,
    future::Future,
    pin::pin,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    task::Context,
};
use tokio::sync::oneshot;

/// What the messages of all calls have taken.
#[derive(Clone, Default)]
pub(super) struct Budget(Arc<Mutex<Held>>);

#[derive(Default)]
struct Held {
    bytes: usize,
    messages: u64,
    /// Those that are still arriving, by their bytes and number. Dropping what stands here puts a
    /// message out.
    arriving: BTreeMap<(usize, u64), oneshot::Sender<()>>,
}

/// What one message has taken; it goes back when this is dropped, which is when the call has read
/// and answered it.
pub(super) struct Share {
    budget: Budget,
    bytes: Mutex<usize>,
}

/// A message of which more may arrive.
pub(super) struct Arriving {
    number: u64,
    share: Arc<Share>,
    put_out: oneshot::Receiver<()>,
    /// How long it says that it will be, bytes; 0 until that is known.
    announced: usize,
}

impl Budget {
    /// A message that has taken nothing yet.
    pub fn message(&self) -> (Arriving, Arc<Share>) {
        let (keep, put_out) = oneshot::channel();
        let mut held = lock(&self.0);
        held.messages += 1;
        let number = held.messages;
        held.arriving.insert((0, number), keep);
        let share = Arc::new(Share {
            budget: self.clone(),
            bytes: Mutex::new(0),
        });
        let arriving = Arriving {
            number,
            share: Arc::clone(&share),
            put_out,
            announced: 0,
        };
        (arriving, share)
    }
}

impl Held {
    /// Makes room for a message of which `own` bytes will have arrived, `more` of them new, and which is
    /// `long` in the end, as far as it is known. Returns whether there is room.
    fn make_room(&mut self, own: usize, more: usize, long: usize) -> bool {
        if long > SHORT_MESSAGE_BYTES_MAX {
            return self.bytes + more <= LONG_MESSAGES_BYTES_MAX;
        }
        while self.bytes + more > MESSAGES_BYTES_MAX {
            let Some(longest) = self.arriving.last_entry() else {
                return false;
            };
            let (bytes, _) = *longest.key();
            if bytes <= own {
                return false;
            }
            longest.remove();
            self.bytes -= bytes;
        }
        true
    }
}

impl Arriving {
    /// It says that it will be so long.
    pub fn announce(&mut self, bytes: usize) {
        self.announced = bytes;
    }

    /// Takes so many more bytes, or none where there is no room. Returns whether it took them.
    pub fn take(&mut self, more: usize) -> bool {
        let mut bytes = lock(&self.share.bytes);
        let mut held = lock(&self.share.budget.0);
        let own = *bytes + more;
        let Some(keep) = held.arriving.remove(&(*bytes, self.number)) else {
            return false;
        };
        let room = held.make_room(own, more, own.max(self.announced));
        if room {
            held.bytes += more;
            *bytes = own;
        }
        held.arriving.insert((*bytes, self.number), keep);
        room
    }

    /// Whether it was put out for a shorter one. If not, the task is woken when it is.
    pub fn poll_put_out(&mut self, context: &mut Context<'_>) -> bool {
        self.put_out.is_terminated() || pin!(&mut self.put_out).poll(context).is_ready()
    }
}

impl Drop for Arriving {
    /// Nothing more of it arrives: it is no longer put out for another.
    fn drop(&mut self) {
        let mut bytes = lock(&self.share.bytes);
        let mut held = lock(&self.share.budget.0);
        if held.arriving.remove(&(*bytes, self.number)).is_none() {
            // Put out: what it had taken is taken by others.
            *bytes = 0;
        }
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let bytes = *lock(&self.bytes);
        lock(&self.budget.0).bytes -= bytes;
    }
}

/// Holds a lock; whoever panicked with it left numbers that are whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*, sample::Index};
    use std::task::Waker;

    fn taken(budget: &Budget) -> usize {
        lock(&budget.0).bytes
    }

    #[test]
    fn a_share_goes_back_to_the_budget_when_the_call_is_done() {
        let budget = Budget::default();
        let (mut message, share) = budget.message();
        assert!(message.take(LONG_MESSAGES_BYTES_MAX));
        drop(message);
        let (mut next, _share) = budget.message();
        assert!(!next.take(SHORT_MESSAGE_BYTES_MAX + 1));
        drop(share);
        assert!(next.take(SHORT_MESSAGE_BYTES_MAX + 1));
        drop((next, _share));
        assert_eq!(taken(&budget), 0);
    }

    #[test]
    fn what_has_arrived_whole_is_not_put_out() {
        let budget = Budget::default();
        let (mut whole, _whole) = budget.message();
        assert!(whole.take(LONG_MESSAGES_BYTES_MAX));
        drop(whole);
        let rest = MESSAGES_BYTES_MAX - LONG_MESSAGES_BYTES_MAX;
        let shorts: Vec<_> = (0..rest / SHORT_MESSAGE_BYTES_MAX)
            .map(|_| {
                let mut short = budget.message();
                assert!(short.0.take(SHORT_MESSAGE_BYTES_MAX));
                short
            })
            .collect();
        let (mut same, _same) = budget.message();
        assert!(!same.take(SHORT_MESSAGE_BYTES_MAX), "nothing is longer");
        let (mut shorter, _shorter) = budget.message();
        assert!(shorter.take(SHORT_MESSAGE_BYTES_MAX - 1));
        let mut context = Context::from_waker(Waker::noop());
        let out = shorts
            .into_iter()
            .filter_map(|(mut short, _share)| short.poll_put_out(&mut context).then_some(()));
        assert_eq!(out.count(), 1);
    }

    /// Thousands of long ones that begin at once keep nobody out, and put nobody out.
    #[test]
    fn the_beginnings_of_long_messages_put_nobody_out() {
        let budget = Budget::default();
        let (mut nearly_whole, _nearly_whole) = budget.message();
        assert!(nearly_whole.take(LONG_MESSAGES_BYTES_MAX - SHORT_MESSAGE_BYTES_MAX));
        let beginnings: Vec<_> = (0..4_000)
            .map(|_| {
                let mut beginning = budget.message();
                beginning.0.announce(6 << 20);
                while beginning.0.take(1 << 14) {}
                beginning
            })
            .collect();
        let mut context = Context::from_waker(Waker::noop());
        assert!(!nearly_whole.poll_put_out(&mut context));
        assert!(taken(&budget) <= LONG_MESSAGES_BYTES_MAX);
        let (mut short, _short) = budget.message();
        assert!(short.take(SHORT_MESSAGE_BYTES_MAX));
        drop((short, _short, beginnings));
        assert!(nearly_whole.take(SHORT_MESSAGE_BYTES_MAX));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        /// Messages that take all they can get, in pieces of any size, and stay, or are given up
        /// and come again: the budget holds, and a shorter message finds room at any time.
        #[test]
        fn whoever_takes_all_there_is_leaves_room_for_short_messages(
            count in 1_usize..3000,
            takes in vec((any::<Index>(), 14_u32..27, any::<bool>()), 1..3000),
        ) {
            const SHORTEST: usize = 1 << 14;
            let budget = Budget::default();
            let mut greedy: Vec<_> = (0..count).map(|_| budget.message()).collect();
            for (which, bits, comes_again) in takes {
                let which = which.index(count);
                // Short ones are the more dangerous: they have others put out.
                while greedy[which].0.take(1 << bits) {}
                prop_assert!(taken(&budget) <= MESSAGES_BYTES_MAX);
                let (mut short, _share) = budget.message();
                prop_assert!(short.take(SHORTEST - 1));
                if comes_again {
                    greedy[which] = budget.message();
                }
            }
            drop(greedy);
            prop_assert_eq!(taken(&budget), 0);
        }
    }
}
