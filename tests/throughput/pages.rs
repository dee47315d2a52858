//! Pages in a browser that are open all along, as many as `BRDFARM_PAGES` says: what do they cost the
//! farm?

use std::env;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

/// How many pages are open.
pub fn wanted() -> usize {
    let count = env::var("BRDFARM_PAGES").ok();
    count.map_or(0, |count| count.parse().expect("BRDFARM_PAGES is a number"))
}

/// Opens pages, each of which reads what it is told until the farm ends. Returns the bytes read.
pub fn open(address: &str, count: usize) -> Arc<AtomicU64> {
    let bytes = Arc::new(AtomicU64::new(0));
    for _ in 0..count {
        let mut stream = TcpStream::connect(address).unwrap();
        let request = "GET /live HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let bytes = Arc::clone(&bytes);
        thread::spawn(move || {
            let mut read = [0; 1 << 16];
            while let Ok(count @ 1..) = stream.read(&mut read) {
                bytes.fetch_add(count as u64, Ordering::Relaxed);
            }
        });
    }
    bytes
}
