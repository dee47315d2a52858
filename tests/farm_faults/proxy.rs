//! A network that can be hurt: forwards TCP connections, slowly or not at all.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// A proxy before an address.
pub struct Proxy {
    pub address: String,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    delay_ms: AtomicU64,
    // Bytes vanish, as behind a pulled cable; connections stay.
    silent: AtomicBool,
    refusing: AtomicBool,
    open: Mutex<Vec<TcpStream>>,
}

impl Proxy {
    pub fn before(target: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("an address");
        let address = listener.local_addr().expect("an address").to_string();
        let state = Arc::<State>::default();
        let (shared, target) = (Arc::clone(&state), target.to_owned());
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                if shared.refusing.load(Ordering::Relaxed) {
                    continue;
                }
                let Ok(server) = TcpStream::connect(&target) else {
                    continue;
                };
                shared.join(&client, &server);
            }
        });
        Self { address, state }
    }

    /// Every piece waits so long, in each direction.
    pub fn delay(&self, delay: Duration) {
        let delay_ms = delay.as_millis() as u64;
        self.state.delay_ms.store(delay_ms, Ordering::Relaxed);
    }

    /// Resets every connection and takes no new ones, until told otherwise.
    pub fn cut(&self, cut: bool) {
        self.state.refusing.store(cut, Ordering::Relaxed);
        if cut {
            for stream in self.state.open.lock().expect("streams").drain(..) {
                // It may have ended by itself.
                let _ = stream.shutdown(Shutdown::Both);
            }
        }
    }

    /// Swallows all bytes without a word, until told otherwise.
    pub fn swallow(&self, swallow: bool) {
        self.state.silent.store(swallow, Ordering::Relaxed);
    }
}

impl State {
    fn join(self: &Arc<Self>, client: &TcpStream, server: &TcpStream) {
        let twin = |stream: &TcpStream| stream.try_clone().expect("a twin");
        self.open
            .lock()
            .expect("streams")
            .extend([twin(client), twin(server)]);
        for (from, to) in [(client, server), (server, client)] {
            let (from, to, state) = (twin(from), twin(to), Arc::clone(self));
            thread::spawn(move || state.forward(from, to));
        }
    }

    fn forward(&self, mut from: TcpStream, mut to: TcpStream) {
        let mut piece = [0; 16 << 10];
        while let Ok(bytes @ 1..) = from.read(&mut piece) {
            thread::sleep(Duration::from_millis(self.delay_ms.load(Ordering::Relaxed)));
            if self.silent.load(Ordering::Relaxed) {
                continue;
            }
            if to.write_all(&piece[..bytes]).is_err() {
                break;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
    }
}
