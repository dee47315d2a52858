//! Bytes of messages under way, of all calls together.
//!
//! Long messages, as large uploads are, have room of their own, and so have short ones, as those are that ask how
//! things stand, block a worker or bring a small image. Of either room a credential may have a multiple of what is left
//! free. So one cannot take all of it. Several can, one after the other: then a message of a credential that has far
//! less puts out the longest of the credential that has the most. A short one also puts out a longer short one of its
//! own credential. What else finds no room is refused, and tried again later.
//!
//! So nobody keeps an operator out by sending messages that never end, and whoever has little under way loses nothing.
//! Where there are no credentials, all share what one may have.
//!
//! A message says in its first bytes how long it will be. One that says too little counts as long as
//! soon as more than `SHORT_MESSAGE_BYTES_MAX` of it has arrived.

use limits::{
    LONG_MESSAGES_BYTES_MAX, MESSAGES_SHARE_OF_FREE, SHORT_MESSAGE_BYTES_MAX,
    SHORT_MESSAGES_BYTES_MAX,
};
use std::{
    collections::{BTreeMap, HashMap},
    future::Future,
    pin::pin,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    task::Context,
};
use tokio::sync::oneshot;

/// A credential has far less than another where this many times as much would not be more. Chosen.
const FAR_LESS: usize = 4;

/// The name of a credential; none where nobody has to show one.
pub(super) type Credential = Option<Arc<str>>;

/// What the messages of all calls have taken.
#[derive(Clone, Default)]
pub(super) struct Budget(Arc<Mutex<Rooms>>);

#[derive(Default)]
struct Rooms {
    messages: u64,
    short: Room,
    long: Room,
}

/// What messages of a kind have taken.
#[derive(Default)]
struct Room {
    bytes: usize,
    by_credential: HashMap<Credential, Holding>,
}

/// What those of one credential have taken.
#[derive(Default)]
struct Holding {
    bytes: usize,
    /// How many have taken something.
    messages: usize,
    /// Those that are still arriving, by their bytes and number. Dropping what stands here puts a
    /// message out.
    arriving: BTreeMap<(usize, u64), oneshot::Sender<()>>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Short,
    Long,
}

/// What one message has taken; it goes back when this is dropped, which is when the call has read
/// and answered it.
pub(super) struct Share {
    budget: Budget,
    credential: Credential,
    taken: Mutex<Taken>,
}

#[derive(Clone, Copy)]
struct Taken {
    bytes: usize,
    kind: Kind,
}

/// A message of which more may arrive.
pub(super) struct Arriving {
    number: u64,
    share: Arc<Share>,
    /// What puts it out where it is dropped, while it has taken nothing.
    keep: Option<oneshot::Sender<()>>,
    put_out: oneshot::Receiver<()>,
    /// How long it says that it will be, bytes; 0 until that is known.
    announced: usize,
}

impl Budget {
    /// A message that has taken nothing yet.
    pub fn message(&self, credential: Credential) -> (Arriving, Arc<Share>) {
        let (keep, put_out) = oneshot::channel();
        let mut rooms = lock(&self.0);
        rooms.messages += 1;
        let share = Arc::new(Share {
            budget: self.clone(),
            credential,
            taken: Mutex::new(Taken {
                bytes: 0,
                kind: Kind::Short,
            }),
        });
        let arriving = Arriving {
            number: rooms.messages,
            share: Arc::clone(&share),
            keep: Some(keep),
            put_out,
            announced: 0,
        };
        (arriving, share)
    }
}

impl Rooms {
    fn of(&mut self, kind: Kind) -> &mut Room {
        match kind {
            Kind::Short => &mut self.short,
            Kind::Long => &mut self.long,
        }
    }
}

impl Kind {
    /// Of a message of so many bytes, as far as they are known.
    fn of(bytes: usize) -> Self {
        if bytes > SHORT_MESSAGE_BYTES_MAX {
            Self::Long
        } else {
            Self::Short
        }
    }

    fn bytes_max(self) -> usize {
        match self {
            Self::Short => SHORT_MESSAGES_BYTES_MAX,
            Self::Long => LONG_MESSAGES_BYTES_MAX,
        }
    }
}

impl Room {
    /// Whether a credential may have a message of so many bytes. Its only one it may have wherever there is room.
    fn fits(&self, kind: Kind, credential: &Credential, bytes: usize) -> bool {
        let Some(free) = kind.bytes_max().checked_sub(self.bytes + bytes) else {
            return false;
        };
        let held = self
            .by_credential
            .get(credential)
            .map_or(0, |has| has.bytes);
        held == 0 || held + bytes <= MESSAGES_SHARE_OF_FREE * free
    }

    /// Makes room for a message of which `bytes` will have arrived, and which has `size` bytes in the end, as far as
    /// that is known. Returns whether there is room.
    fn make_room(
        &mut self,
        kind: Kind,
        credential: &Credential,
        bytes: usize,
        size: usize,
    ) -> bool {
        while !self.fits(kind, credential, bytes) {
            let is_put_out = match self.who_has_far_more(credential, size) {
                Some(other) => self.put_out_longest(&other, 0),
                None => kind == Kind::Short && self.put_out_longest(credential, bytes),
            };
            if !is_put_out {
                return false;
            }
        }
        true
    }

    /// Who has the most, if that is far more than a credential has with a message of this size. Whoever has only one
    /// message under way keeps it.
    fn who_has_far_more(&self, credential: &Credential, size: usize) -> Option<Credential> {
        let held = self
            .by_credential
            .get(credential)
            .map_or(0, |has| has.bytes);
        let far_more = FAR_LESS * (held + size);
        self.by_credential
            .iter()
            .filter(|(name, has)| {
                *name != credential && has.messages > 1 && !has.arriving.is_empty()
            })
            .max_by_key(|(_, has)| has.bytes)
            .filter(|(_, has)| has.bytes >= far_more)
            .map(|(name, _)| name.clone())
    }

    /// Puts out the longest message of a credential that is still arriving and longer than `bytes`. Returns whether
    /// there was one.
    fn put_out_longest(&mut self, credential: &Credential, bytes: usize) -> bool {
        let Some(holding) = self.by_credential.get_mut(credential) else {
            return false;
        };
        let Some(longest) = holding.arriving.last_entry() else {
            return false;
        };
        let (longest_bytes, number) = *longest.key();
        if longest_bytes <= bytes {
            return false;
        }
        self.remove(credential, longest_bytes, Some(number));
        true
    }

    /// Takes so many bytes for a message, which is arriving under this number.
    fn insert(
        &mut self,
        credential: &Credential,
        (bytes, number): (usize, u64),
        keep: oneshot::Sender<()>,
    ) {
        let holding = self.by_credential.entry(credential.clone()).or_default();
        holding.bytes += bytes;
        holding.messages += 1;
        holding.arriving.insert((bytes, number), keep);
        self.bytes += bytes;
    }

    /// Takes back what a message has, which is arriving under this `number` or has arrived. Returns what puts it out,
    /// or nothing where it is not there: it was put out.
    fn remove(
        &mut self,
        credential: &Credential,
        bytes: usize,
        number: Option<u64>,
    ) -> Option<oneshot::Sender<()>> {
        let holding = self.by_credential.get_mut(credential)?;
        let keep = match number {
            Some(number) => Some(holding.arriving.remove(&(bytes, number))?),
            None => None,
        };
        holding.bytes -= bytes;
        holding.messages -= 1;
        if holding.messages == 0 {
            self.by_credential.remove(credential);
        }
        self.bytes -= bytes;
        keep
    }

    /// A message has arrived whole, and is no longer put out for another. Returns whether it was not before.
    fn arrive(&mut self, credential: &Credential, bytes: usize, number: u64) -> bool {
        let holding = self.by_credential.get_mut(credential);
        holding.is_some_and(|holding| holding.arriving.remove(&(bytes, number)).is_some())
    }
}

impl Arriving {
    /// It says that it will be so long.
    pub fn announce(&mut self, bytes: usize) {
        self.announced = bytes;
    }

    /// Takes so many more bytes, or none where there is no room. Returns whether it took them.
    pub fn take(&mut self, more: usize) -> bool {
        let credential = &self.share.credential;
        let mut taken = lock(&self.share.taken);
        let mut rooms = lock(&self.share.budget.0);
        let keep = match self.keep.take() {
            Some(keep) => keep,
            None => {
                let room = rooms.of(taken.kind);
                match room.remove(credential, taken.bytes, Some(self.number)) {
                    Some(keep) => keep,
                    None => return false,
                }
            }
        };
        let bytes = taken.bytes + more;
        let size = bytes.max(self.announced);
        let kind = Kind::of(size);
        let fits = rooms.of(kind).make_room(kind, credential, bytes, size);
        if fits {
            *taken = Taken { bytes, kind };
        }
        if taken.bytes > 0 {
            let room = rooms.of(taken.kind);
            room.insert(credential, (taken.bytes, self.number), keep);
        } else {
            self.keep = Some(keep);
        }
        fits
    }

    /// Whether it was put out for a shorter one. If not, the task is woken when it is.
    pub fn poll_put_out(&mut self, context: &mut Context<'_>) -> bool {
        self.put_out.is_terminated() || pin!(&mut self.put_out).poll(context).is_ready()
    }
}

impl Drop for Arriving {
    /// Nothing more of it arrives: it is no longer put out for another.
    fn drop(&mut self) {
        let mut taken = lock(&self.share.taken);
        let mut rooms = lock(&self.share.budget.0);
        let room = rooms.of(taken.kind);
        if !room.arrive(&self.share.credential, taken.bytes, self.number) {
            // Put out: what it had taken is taken by others. Or it has taken nothing.
            taken.bytes = 0;
        }
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let Taken { bytes, kind } = *lock(&self.taken);
        if bytes > 0 {
            let mut rooms = lock(&self.budget.0);
            rooms.of(kind).remove(&self.credential, bytes, None);
        }
    }
}

/// Holds a lock; whoever panicked with it left numbers that are whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use limits::MESSAGES_BYTES_MAX;
    use proptest::{collection::vec, prelude::*, sample::Index};
    use std::task::Waker;

    fn taken(budget: &Budget) -> usize {
        let rooms = lock(&budget.0);
        for room in [&rooms.short, &rooms.long] {
            let held = room.by_credential.values().map(|has| has.bytes);
            assert_eq!(room.bytes, held.sum::<usize>());
        }
        rooms.short.bytes + rooms.long.bytes
    }

    fn named(name: usize) -> Credential {
        Some(name.to_string().into())
    }

    fn is_put_out(message: &mut Arriving) -> bool {
        message.poll_put_out(&mut Context::from_waker(Waker::noop()))
    }

    /// What one credential takes of a room where it is alone.
    fn share_of_one(room: usize) -> usize {
        room / (1 + MESSAGES_SHARE_OF_FREE) * MESSAGES_SHARE_OF_FREE
    }

    #[test]
    fn a_share_goes_back_to_the_budget_when_the_call_is_done() {
        let budget = Budget::default();
        let (mut message, share) = budget.message(None);
        assert!(message.take(LONG_MESSAGES_BYTES_MAX));
        drop(message);
        let (mut next, _share) = budget.message(None);
        assert!(!next.take(SHORT_MESSAGE_BYTES_MAX + 1));
        drop(share);
        assert!(next.take(SHORT_MESSAGE_BYTES_MAX + 1));
        drop((next, _share));
        assert_eq!(taken(&budget), 0);
        assert!(lock(&budget.0).long.by_credential.is_empty());
    }

    #[test]
    fn what_has_arrived_whole_is_not_put_out() {
        let budget = Budget::default();
        let mut shorts: Vec<_> = (0..share_of_one(SHORT_MESSAGES_BYTES_MAX)
            / SHORT_MESSAGE_BYTES_MAX)
            .map(|_| {
                let mut short = budget.message(None);
                assert!(short.0.take(SHORT_MESSAGE_BYTES_MAX));
                short
            })
            .collect();
        let (mut same, _same) = budget.message(None);
        assert!(!same.take(SHORT_MESSAGE_BYTES_MAX), "nothing is longer");
        let (mut shorter, _shorter) = budget.message(None);
        assert!(shorter.take(SHORT_MESSAGE_BYTES_MAX - 1));
        let out = shorts
            .iter_mut()
            .filter_map(|short| is_put_out(&mut short.0).then_some(()));
        assert_eq!(out.count(), 1);
        let arrived: Vec<_> = shorts.into_iter().map(|(_, share)| share).collect();
        drop(shorter);
        let (mut shortest, _shortest) = budget.message(None);
        assert!(
            !shortest.take(SHORT_MESSAGE_BYTES_MAX - 2),
            "all others have arrived"
        );
        drop((arrived, _same, _shorter, _shortest));
        assert_eq!(taken(&budget), 0);
    }

    /// Thousands of long ones that begin at once keep nobody out, and put nobody out.
    #[test]
    fn the_beginnings_of_long_messages_put_nobody_out() {
        let budget = Budget::default();
        let (mut nearly_whole, _nearly_whole) = budget.message(named(0));
        assert!(nearly_whole.take(6 << 20));
        let beginnings: Vec<_> = (0..4_000)
            .map(|_| {
                let mut beginning = budget.message(named(0));
                beginning.0.announce(6 << 20);
                while beginning.0.take(1 << 14) {}
                beginning
            })
            .collect();
        assert!(!is_put_out(&mut nearly_whole));
        assert!(taken(&budget) <= share_of_one(LONG_MESSAGES_BYTES_MAX));
        let (mut short, _short) = budget.message(named(0));
        assert!(short.take(SHORT_MESSAGE_BYTES_MAX));
        drop((short, _short, beginnings));
        assert!(nearly_whole.take(SHORT_MESSAGE_BYTES_MAX));
    }

    /// Some credentials, one after the other, fill all the room that they get with messages of one size, which never
    /// end. Whoever comes with another credential finds room for an upload and a short message, and loses neither.
    #[test]
    fn messages_of_others_put_nobody_out() {
        for attackers in [1, 3, 10] {
            for bytes in [1 << 10, 1 << 14, 200 << 10, 6 << 20] {
                let budget = Budget::default();
                let (mut upload, _upload) = budget.message(named(0));
                upload.announce(8 << 20);
                assert!(upload.take(1 << 20));
                let mut flood = Vec::new();
                for attacker in 1..=attackers {
                    loop {
                        let mut message = budget.message(named(attacker));
                        message.0.announce(bytes);
                        let took = message.0.take(bytes);
                        flood.push(message);
                        if !took {
                            break;
                        }
                    }
                }
                assert!(taken(&budget) <= MESSAGES_BYTES_MAX);
                let mut short = budget.message(named(0));
                assert!(short.0.take(12 << 10), "{attackers} with {bytes}");
                for _ in 0..6 {
                    assert!(upload.take(1 << 20), "{attackers} with {bytes}");
                }
                assert!(!is_put_out(&mut upload) && !is_put_out(&mut short.0));
                drop((upload, _upload, short, flood));
                assert_eq!(taken(&budget), 0);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        /// Messages of some credentials that take all they can get, in pieces of any size, and stay, or arrive, or are
        /// given up and come again: the budget holds, and a shorter message finds room at any time.
        #[test]
        fn whoever_takes_all_there_is_leaves_room_for_short_messages(
            count in 1_usize..3000,
            credentials in 1_usize..5,
            takes in vec((any::<Index>(), 14_u32..27, 0_u32..3), 1..3000),
        ) {
            const SHORTEST: usize = 1 << 14;
            let budget = Budget::default();
            let message = |which: usize| budget.message(named(which % credentials));
            let mut greedy: Vec<_> = (0..count).map(message).collect();
            let mut arrived = Vec::new();
            for (which, bits, then) in takes {
                let which = which.index(count);
                // Short ones are the more dangerous: they have others put out.
                while greedy[which].0.take(1 << bits) {}
                prop_assert!(taken(&budget) <= MESSAGES_BYTES_MAX);
                let (mut short, _share) = message(which);
                prop_assert!(short.take(SHORTEST - 1));
                match then {
                    0 => greedy[which] = message(which),
                    1 if arrived.len() < 8 => {
                        arrived.push(std::mem::replace(&mut greedy[which], message(which)).1);
                    }
                    _ => {}
                }
            }
            drop((greedy, arrived));
            prop_assert_eq!(taken(&budget), 0);
        }
    }
}
