//! Answers that their readers have not taken yet.
//!
//! A peer can ask and read nothing. Its answers then wait in memory, 64 calls on each of its connections,
//! and nothing in HTTP/2 ends that: a peer that reads no answer may still answer pings. So all answers
//! that wait have a bound together. For one more the peer goes that has the most waiting. An honest
//! worker asks for a mesh part by part, and the bound has room for one part a connection, so whoever goes
//! has asked for more than a worker does. Each answer also has a deadline, by which its peer has read it
//! or goes.
//!
//! A peer goes as strangers do, with its connection: only that gives back what waits for it, and a status
//! would wait behind the rest. An honest client connects and asks again.
//!
//! Bytes count from when they are encoded until the connection has written them or is gone. They own
//! their room, so it does not matter who holds them in between.

use super::strangers::Peer;
use bytes::Bytes;
use http_body::{Frame, SizeHint};
use std::{
    cmp::Reverse,
    collections::{BTreeMap, HashMap},
    mem,
    pin::{Pin, pin},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    sync::watch,
    time::{Instant, sleep},
};
use tonic::{Status, body::Body};

/// What waits to be read, of all peers.
#[derive(Clone, Default)]
pub(crate) struct Unread(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    /// The number of the next piece.
    next: u64,
    bytes: usize,
    by_peer: HashMap<u64, Waiting>,
    /// How many have been put out and are not told of yet.
    put_out: usize,
}

/// What waits for one peer.
struct Waiting {
    peer: Peer,
    bytes: usize,
    /// By which time each piece has to be read, where it has to.
    deadlines: BTreeMap<u64, Option<Instant>>,
}

/// A piece of an answer, which counts until it is dropped.
struct Piece {
    data: Bytes,
    number: u64,
    peer: u64,
    unread: Unread,
}

/// An answer whose pieces count.
pub(crate) struct Counted {
    pub body: Body,
    pub unread: Unread,
    pub peer: Peer,
    /// How long a piece may wait; `None` for an answer that goes on as slowly as its caller likes.
    pub wait_max: Option<Duration>,
}

impl Unread {
    // Nothing that runs under the lock panics half way through a change.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The same bytes, which count as unread until they are dropped.
    fn count(&self, peer: &Peer, data: Bytes, wait_max: Option<Duration>) -> Bytes {
        let deadline = wait_max.map(|wait| Instant::now() + wait);
        let (piece, gone) = {
            let mut state = self.lock();
            let number = state.next;
            state.next += 1;
            state.bytes += data.len();
            let waiting = state.by_peer.entry(peer.number());
            let waiting = waiting.or_insert_with(|| Waiting {
                peer: peer.clone(),
                bytes: 0,
                deadlines: BTreeMap::new(),
            });
            waiting.bytes += data.len();
            waiting.deadlines.insert(number, deadline);
            let piece = Piece {
                data,
                number,
                peer: peer.number(),
                unread: self.clone(),
            };
            (piece, state.make_room())
        };
        for waiting in gone {
            waiting.peer.put_out();
        }
        Bytes::from_owner(piece)
    }

    /// Puts out whoever has left an answer unread for too long. Tells how many went since the last time: a
    /// flood must not fill the log.
    fn put_out_late(&self) {
        let now = Instant::now();
        let (late, connections) = {
            let mut state = self.lock();
            let late = state.by_peer.iter().filter(|(_, waiting)| {
                let mut deadlines = waiting.deadlines.values().flatten();
                deadlines.any(|deadline| *deadline <= now)
            });
            let late: Vec<u64> = late.map(|(peer, _)| *peer).collect();
            let late = late.iter().filter_map(|peer| state.take(*peer));
            let late: Vec<Waiting> = late.collect();
            (late, mem::take(&mut state.put_out))
        };
        if connections > 0 {
            tracing::warn!(connections, "closed, because their peers read no answers");
        }
        for waiting in late {
            waiting.peer.put_out();
        }
    }

    /// Looks for late readers until the coordinator stops.
    pub async fn watch(self, mut stopping: watch::Receiver<bool>) -> Result<(), String> {
        loop {
            tokio::select! {
                () = sleep(limits::UNREAD_INTERVAL) => self.put_out_late(),
                _ = stopping.wait_for(|stopping| *stopping) => return Ok(()),
            }
        }
    }
}

impl State {
    /// Takes those with the most waiting until the rest is within the bound. What they had counts no more,
    /// though it takes a moment until it is gone.
    fn make_room(&mut self) -> Vec<Waiting> {
        let mut gone = Vec::new();
        while self.bytes > limits::UNREAD_BYTES_MAX {
            let most = self.by_peer.iter();
            // Of several with as much, the one that was there first: an honest one soon has nothing.
            let most = most.max_by_key(|(peer, waiting)| (waiting.bytes, Reverse(**peer)));
            let most = most.map(|(peer, _)| *peer);
            let Some(waiting) = most.and_then(|peer| self.take(peer)) else {
                break;
            };
            gone.push(waiting);
        }
        gone
    }

    /// Takes one who is to be put out.
    fn take(&mut self, peer: u64) -> Option<Waiting> {
        let waiting = self.by_peer.remove(&peer)?;
        self.bytes -= waiting.bytes;
        self.put_out += 1;
        Some(waiting)
    }
}

impl AsRef<[u8]> for Piece {
    fn as_ref(&self) -> &[u8] {
        &self.data
    }
}

impl Drop for Piece {
    fn drop(&mut self) {
        let mut state = self.unread.lock();
        // Of a peer that was put out it counts no more.
        let Some(waiting) = state.by_peer.get_mut(&self.peer) else {
            return;
        };
        if waiting.deadlines.remove(&self.number).is_none() {
            return;
        }
        waiting.bytes -= self.data.len();
        let was_last = waiting.deadlines.is_empty();
        state.bytes -= self.data.len();
        if was_last {
            state.by_peer.remove(&self.peer);
        }
    }
}

impl http_body::Body for Counted {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let polled = pin!(&mut self.body).poll_frame(context);
        polled.map_ok(|frame| {
            frame.map_data(|data| self.unread.count(&self.peer, data, self.wait_max))
        })
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use super::super::strangers::{Strangers, Visit};
    use super::*;
    use futures_util::future::poll_fn;
    use limits::{UNREAD_BYTES_MAX, UNREAD_WAIT_MAX, protocol::MESH_BYTES_PER_CALL};
    use std::net::Ipv4Addr;
    use tokio::time::timeout;

    fn visits<const N: usize>() -> [Visit; N] {
        let strangers = Strangers::new(N, Duration::MAX, N);
        let address = Ipv4Addr::LOCALHOST.into();
        std::array::from_fn(|_| {
            let visit = strangers.let_in(address);
            visit.peer.introduce();
            visit
        })
    }

    fn part(unread: &Unread, visit: &Visit) -> Bytes {
        let data = Bytes::from(vec![7; MESH_BYTES_PER_CALL]);
        unread.count(&visit.peer, data, Some(UNREAD_WAIT_MAX))
    }

    async fn is_put_out(visit: &mut Visit) -> bool {
        let end = poll_fn(|context| visit.poll_end(context));
        timeout(Duration::ZERO, end).await.is_ok()
    }

    #[tokio::test(start_paused = true)]
    async fn who_has_the_most_waiting_makes_room_for_who_has_little() {
        let unread = Unread::default();
        let [mut honest, mut greedy, mut greedier] = visits();
        let parts = UNREAD_BYTES_MAX / MESH_BYTES_PER_CALL;
        let first = part(&unread, &honest);
        let half =
            |visit, count| -> Vec<Bytes> { (0..count).map(|_| part(&unread, visit)).collect() };
        let less = half(&greedy, parts / 2 - 1);
        let more = half(&greedier, parts / 2);
        assert_eq!(unread.lock().bytes, UNREAD_BYTES_MAX);
        assert!(!is_put_out(&mut greedier).await);
        // A part more, and one is put out whose parts count no more, dropped or not.
        let second = part(&unread, &honest);
        assert!(is_put_out(&mut greedier).await);
        assert!(!is_put_out(&mut honest).await && !is_put_out(&mut greedy).await);
        let left = (2 + less.len()) * MESH_BYTES_PER_CALL;
        assert_eq!(unread.lock().bytes, left);
        drop(more);
        assert_eq!(unread.lock().bytes, left);
        drop((first, second, less));
        assert_eq!(unread.lock().bytes, 0);
        assert!(unread.lock().by_peer.is_empty());
    }

    #[tokio::test(start_paused = true)]
    async fn an_answer_has_to_be_read_in_time() {
        let unread = Unread::default();
        let [mut slow, mut deaf, mut watcher] = visits();
        let (_stop, stopping) = watch::channel(false);
        let watching = tokio::spawn(unread.clone().watch(stopping));
        let never = part(&unread, &deaf);
        let event = Bytes::from_static(b"an event");
        let event = unread.count(&watcher.peer, event, None);
        // The bytes of a part over 16 kbit/s, one part after another.
        for _ in 0..4 {
            let read = part(&unread, &slow);
            sleep(Duration::from_secs(32)).await;
            drop(read);
        }
        assert!(!is_put_out(&mut slow).await && !is_put_out(&mut watcher).await);
        assert!(is_put_out(&mut deaf).await);
        drop((never, event));
        assert_eq!(unread.lock().bytes, 0);
        assert!(!watching.is_finished());
    }
}
