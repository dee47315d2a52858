//! A network that can be hurt: forwards TCP connections, late, out of order or not at all.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// How long the far end of an overtaken connection stays open, for what arrives late to be heard.
const OVERTAKEN_LINGER: Duration = Duration::from_secs(2);

/// A proxy before an address.
pub struct Proxy {
    pub address: String,
    state: Arc<State>,
}

/// Both ends of a connection.
struct Joined {
    client: TcpStream,
    server: TcpStream,
    fate: Arc<Fate>,
}

/// What became of one connection.
#[derive(Default)]
struct Fate {
    // Bytes vanish, and nobody is told.
    dead: AtomicBool,
    // The client has another connection by now; what it said on this one still arrives.
    overtaken: AtomicBool,
}

#[derive(Default)]
struct State {
    delay_ms: AtomicU64,
    // Bytes vanish, as behind a pulled cable; connections stay.
    silent: AtomicBool,
    refusing: AtomicBool,
    // Pieces on their way to the server.
    waiting: AtomicU64,
    late_pieces: AtomicU64,
    open: Mutex<Vec<Joined>>,
    // Kept open: a stream that is dropped is closed.
    dead: Mutex<Vec<Joined>>,
}

impl Proxy {
    pub fn before(target: &str) -> Self {
        Self::before_all(&[target.to_owned()])
    }

    /// A balancer: each connection goes to the next of the targets that takes it.
    pub fn before_all(targets: &[String]) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("an address");
        let address = listener.local_addr().expect("an address").to_string();
        let state = Arc::<State>::default();
        let (shared, mut targets) = (Arc::clone(&state), targets.to_vec());
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if shared.refusing.load(Ordering::Relaxed) {
                    continue;
                }
                targets.rotate_left(1);
                let mut reached = targets.iter().map(TcpStream::connect);
                if let Some(server) = reached.find_map(Result::ok) {
                    shared.join(client, server);
                }
            }
        });
        Self { address, state }
    }

    /// Every piece waits so long, in each direction.
    pub fn delay(&self, delay: Duration) {
        let delay_ms = delay.as_millis() as u64;
        self.state.delay_ms.store(delay_ms, Ordering::Relaxed);
    }

    /// Resets every connection and takes no new ones, until told otherwise. What waits is lost.
    pub fn cut(&self, cut: bool) {
        self.state.refusing.store(cut, Ordering::Relaxed);
        if cut {
            for joined in self.state.open.lock().expect("streams").drain(..) {
                for stream in [&joined.client, &joined.server] {
                    // It may have ended by itself.
                    let _ = stream.shutdown(Shutdown::Both);
                }
            }
        }
    }

    /// Swallows all bytes without a word, until told otherwise.
    pub fn swallow(&self, swallow: bool) {
        self.state.silent.store(swallow, Ordering::Relaxed);
    }

    /// Swallows all bytes of the connections that there are, for ever; new ones work.
    pub fn deaden(&self) {
        for joined in self.state.open.lock().expect("streams").drain(..) {
            joined.fate.dead.store(true, Ordering::Relaxed);
            self.state.dead.lock().expect("streams").push(joined);
        }
    }

    /// Resets every client, and what waits of its words arrives all the same: later than what it
    /// says next, on a new connection, without delay.
    pub fn overtake(&self) {
        for joined in self.state.open.lock().expect("streams").drain(..) {
            joined.fate.overtaken.store(true, Ordering::Relaxed);
            let _ = joined.client.shutdown(Shutdown::Both);
        }
        self.delay(Duration::ZERO);
    }

    /// Pieces that wait to be sent on to the server.
    pub fn waiting(&self) -> u64 {
        self.state.waiting.load(Ordering::Relaxed)
    }

    /// Pieces that arrived after their client had gone.
    pub fn late_pieces(&self) -> u64 {
        self.state.late_pieces.load(Ordering::Relaxed)
    }
}

impl State {
    fn join(self: &Arc<Self>, client: TcpStream, server: TcpStream) {
        let twin = |stream: &TcpStream| stream.try_clone().expect("a twin");
        let fate = Arc::<Fate>::default();
        for (from, to, to_server) in [(&client, &server, true), (&server, &client, false)] {
            let (from, to) = (twin(from), twin(to));
            let (state, fate) = (Arc::clone(self), Arc::clone(&fate));
            thread::spawn(move || state.forward(from, to, to_server, &fate));
        }
        let joined = Joined {
            client,
            server,
            fate,
        };
        self.open.lock().expect("streams").push(joined);
    }

    fn forward(&self, mut from: TcpStream, mut to: TcpStream, to_server: bool, fate: &Fate) {
        let mut piece = [0; 16 << 10];
        while let Ok(bytes @ 1..) = from.read(&mut piece) {
            let delay = Duration::from_millis(self.delay_ms.load(Ordering::Relaxed));
            self.waiting.fetch_add(to_server.into(), Ordering::Relaxed);
            thread::sleep(delay);
            self.waiting.fetch_sub(to_server.into(), Ordering::Relaxed);
            if self.silent.load(Ordering::Relaxed) || fate.dead.load(Ordering::Relaxed) {
                continue;
            }
            if to.write_all(&piece[..bytes]).is_err() {
                break;
            }
            if to_server && fate.overtaken.load(Ordering::Relaxed) {
                self.late_pieces.fetch_add(1, Ordering::Relaxed);
            }
        }
        if to_server && fate.overtaken.load(Ordering::Relaxed) {
            thread::sleep(OVERTAKEN_LINGER);
        }
        // The end of a dead connection is not heard of either.
        if !fate.dead.load(Ordering::Relaxed) {
            let _ = to.shutdown(Shutdown::Both);
        }
    }
}
