//! Peers that ask for a mesh and read nothing: over real sockets, in HTTP/2 written by hand, because
//! every client that there is reads.

use crate::place::{brdfarm, status, succeed};
use crate::process::Process;
use limits::{UNREAD_BYTES_MAX, protocol};
use proto::client::{self, Credentials, with_deadline};
use std::collections::VecDeque;
use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};
use tokio::task::spawn_blocking;

const SPECIFICATION: &str = r#"
name = "unread"
materials = 1
[image]
width = 16
height = 16
[sample]
shape = "mesh"
mesh = "tent.obj"
[integrator]
kind = "path"
samples_per_pixel = 16
"#;

/// The file of the mesh, bytes: two faces, and a comment.
const MESH_BYTES: usize = 24 << 20;

/// Connections that read nothing, at one time: what they ask for takes 800 MiB.
const DEAF: usize = 200;

/// What a coordinator takes for a byte that waits, at most: its buffers are larger than what is in them.
const MEMORY_PER_UNREAD: f64 = 1.5;

/// What a coordinator takes beside, for the calls of a few hundred connections and for those that are just
/// being closed, bytes.
const MEMORY_BESIDE: u64 = 256 << 20;

/// How long an honest worker may take for the mesh and its material beside the flood.
const WORK_MAX: Duration = Duration::from_secs(8);

/// A line of 1 Mbit/s, and the parts of a mesh that are fetched over it.
const SLOW_BYTES_PER_SECOND: usize = 125_000;
const SLOW_PARTS: usize = 8;

/// A coordinator of a dataset whose mesh is large, and the mesh's file.
fn coordinator(directory: &Path) -> (Process, String, Vec<u8>) {
    let mut mesh = b"v -1 -1 0\nv 0 -1 1\nv 1 -1 0\nv -1 1 0\nv 0 1 1\nv 1 1 0\n\
                     f 1 2 5 4\nf 2 3 6 5\n"
        .to_vec();
    let mut line = 0;
    while mesh.len() < MESH_BYTES {
        mesh.extend_from_slice(format!("# comment {line}\n").as_bytes());
        line += 1;
    }
    fs::write(directory.join("tent.obj"), &mesh).expect("written");
    fs::write(directory.join("spec.toml"), SPECIFICATION).expect("written");
    let arguments = "coordinator serve --spec spec.toml --store store --listen 127.0.0.1:0";
    let mut command = brdfarm(directory, arguments);
    let (process, url) = Process::serving(&mut command).expect("a coordinator");
    (process, url, mesh)
}

/// A frame of HTTP/2.
fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let mut frame = (payload.len() as u32).to_be_bytes()[1..].to_vec();
    frame.extend([kind, flags]);
    frame.extend(stream.to_be_bytes());
    frame.extend(payload);
    frame
}

/// What a peer says that makes as many calls of `GetMesh` as a connection has, for the first part each.
/// `window` is how much of an answer it takes before it says that there is room for more, which it never
/// does.
fn calls(window: u32) -> Vec<u8> {
    const SETTINGS: u8 = 4;
    const WINDOW_UPDATE: u8 = 8;
    const HEADERS: u8 = 1;
    const DATA: u8 = 0;
    const END_HEADERS: u8 = 4;
    const END_STREAM: u8 = 1;
    let mut said = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec();
    let initial_window_size = [&[0, 4][..], &window.to_be_bytes()].concat();
    said.extend(frame(SETTINGS, 0, 0, &initial_window_size));
    // The connection has room for all of it.
    said.extend(frame(WINDOW_UPDATE, 0, 0, &(1_u32 << 30).to_be_bytes()));
    // `:method: POST` and `:scheme: http` of HPACK's own table, the others spelled out.
    let mut headers = vec![0x83, 0x86];
    let path = "/brdfarm.v1.Farm/GetMesh";
    for (name, value) in [
        (&[0x04][..], path),
        (&[0x01], "localhost"),
        (&[0x0f, 0x10], "application/grpc"),
        (b"\0\x02te", "trailers"),
    ] {
        headers.extend(name);
        headers.push(value.len() as u8);
        headers.extend(value.as_bytes());
    }
    // A message of gRPC that is empty: not compressed, no bytes.
    let message = [0; 5];
    for call in 0..protocol::CALLS_PER_CONNECTION_MAX as u32 {
        said.extend(frame(HEADERS, END_HEADERS, 2 * call + 1, &headers));
        said.extend(frame(DATA, END_STREAM, 2 * call + 1, &message));
    }
    said
}

/// Opens connections that read nothing, as many at one time as [`DEAF`], until it is told to end. Of four
/// one has room for whole answers, which then wait behind its socket; the others take one byte of each.
fn flood(address: &str, ended: &AtomicBool, opened: &AtomicUsize) {
    let kinds = [1 << 30, 1, 1, 1].map(calls);
    let mut open = VecDeque::new();
    while !ended.load(Ordering::Relaxed) {
        let mut stream = TcpStream::connect(address).expect("a connection");
        let number = opened.load(Ordering::Relaxed);
        // An error means that it was put out already.
        let _ = stream.write_all(&kinds[number % kinds.len()]);
        open.push_back(stream);
        if open.len() > DEAF {
            open.pop_front();
            sleep(Duration::from_millis(10));
        }
        opened.fetch_add(1, Ordering::Relaxed);
    }
}

/// Answers the pings of a connection, and nothing else that comes: tells when the coordinator closed it.
/// `None` where it is open at `until`.
fn answering_pings(mut stream: TcpStream, until: Instant) -> Option<Instant> {
    const PING: u8 = 6;
    const ACK: u8 = 1;
    let patience = until.saturating_duration_since(Instant::now());
    stream.set_read_timeout(Some(patience)).expect("a timeout");
    loop {
        let mut head = [0; 9];
        let mut payload = Vec::new();
        let read = stream.read_exact(&mut head).and_then(|()| {
            let length = u32::from_be_bytes([0, head[0], head[1], head[2]]);
            payload.resize(length as usize, 0);
            stream.read_exact(&mut payload)
        });
        match read {
            Err(error) if error.kind() == ErrorKind::WouldBlock => return None,
            Err(_) => return Some(Instant::now()),
            Ok(()) if head[3] == PING && head[4] & ACK == 0 => {
                // An error means that it is closed, which reading tells.
                let _ = stream.write_all(&frame(PING, ACK, 0, &payload));
            }
            Ok(()) => {}
        }
    }
}

/// A slow line to an address, for one connection: returns its own address.
fn slow_line(to: &str) -> String {
    const STEP: Duration = Duration::from_millis(40);
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let to = to.to_owned();
    thread::spawn(move || {
        let (mut client, _) = listener.accept().expect("a connection");
        let mut server = TcpStream::connect(to).expect("a connection");
        let mut asks = client.try_clone().expect("a socket");
        let mut asked = server.try_clone().expect("a socket");
        thread::spawn(move || std::io::copy(&mut asks, &mut asked));
        let mut piece = vec![0; SLOW_BYTES_PER_SECOND * STEP.as_millis() as usize / 1000];
        while let Ok(read @ 1..) = server.read(&mut piece) {
            if client.write_all(&piece[..read]).is_err() {
                break;
            }
            sleep(STEP.mul_f64(read as f64 / piece.len() as f64));
        }
    });
    format!("http://{address}")
}

/// Fetches the last parts of a mesh over a slow line, one after another as a worker does.
async fn last_parts(url: &str, mesh: &[u8]) -> Vec<u8> {
    let line = slow_line(url.trim_start_matches("http://"));
    let mut farm = client::farm(&line, &Credentials::default()).expect("a client");
    let begin = mesh.len() - SLOW_PARTS * protocol::MESH_BYTES_PER_CALL;
    let mut bytes = Vec::new();
    while begin + bytes.len() < mesh.len() {
        let offset = (begin + bytes.len()) as u64;
        let message = proto::GetMeshRequest { offset };
        let part = farm.get_mesh(with_deadline(message)).await;
        bytes.extend_from_slice(&part.expect("a part").into_inner().bytes);
    }
    bytes
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_reads_no_answers_holds_bounded_memory_and_keeps_nobody_out() {
    let directory = tempfile::tempdir().expect("a directory");
    let directory = directory.path();
    let (coordinator, url, mesh) = coordinator(directory);
    let before = coordinator.memory_bytes("VmRSS").expect("it runs");
    // From here on the most is counted anew.
    fs::write(format!("/proc/{}/clear_refs", coordinator.id()), "5").expect("written");

    let (ended, opened) = (Arc::new(AtomicBool::new(false)), Arc::default());
    let flooding = spawn_blocking({
        let address = url.trim_start_matches("http://").to_owned();
        let (ended, opened) = (Arc::clone(&ended), Arc::clone(&opened));
        move || flood(&address, &ended, &opened)
    });
    while opened.load(Ordering::Relaxed) < DEAF {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let began = Instant::now();
    let working = spawn_blocking({
        let (directory, url) = (directory.to_owned(), url.clone());
        move || {
            let work = format!("worker connect {url} --backend native");
            (succeed(&directory, &work), began.elapsed())
        }
    });
    let slow = last_parts(&url, &mesh).await;
    let slowly = began.elapsed();
    let (worked, worked_for) = working.await.expect("no panic");
    ended.store(true, Ordering::Relaxed);
    flooding.await.expect("no panic");

    let most = coordinator.memory_bytes("VmHWM").expect("it runs");
    println!(
        "{} connections read nothing: {} MiB before, at most {} MiB with them; a worker took {worked_for:?}, \
         and {SLOW_PARTS} parts over a slow line {slowly:?}",
        opened.load(Ordering::Relaxed),
        before >> 20,
        most >> 20,
    );
    assert!(worked.contains("14 images"), "{worked}");
    assert!(worked_for < WORK_MAX, "{worked_for:?}");
    let line_takes = slow.len() as f64 / SLOW_BYTES_PER_SECOND as f64;
    assert!(
        slowly.as_secs_f64() > 0.8 * line_takes,
        "{slowly:?} is not slow"
    );
    assert!(mesh.ends_with(&slow), "other bytes");
    let unread = (MEMORY_PER_UNREAD * UNREAD_BYTES_MAX as f64) as u64;
    assert!(most < before + unread + MEMORY_BESIDE, "{} MiB", most >> 20);
    assert_eq!(
        status(&url, &Credentials::default())
            .await
            .expect("an answer"),
        1
    );
}

/// One peer answers pings, so that its connection is alive, and one reads nothing at all: neither keeps
/// its answers for longer than they may wait.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "waits for the deadline of answers: tests/floods.sh runs it"]
async fn who_reads_no_answers_is_put_out_in_time() {
    let directory = tempfile::tempdir().expect("a directory");
    let (coordinator, url, _mesh) = coordinator(directory.path());
    let address = url.trim_start_matches("http://").to_owned();
    let saying = |window| {
        let mut stream = TcpStream::connect(&address).expect("a connection");
        stream.write_all(&calls(window)).expect("written");
        stream
    };
    let before = sockets(&coordinator);
    let (alive, _deaf) = (saying(1), saying(1 << 30));
    let began = Instant::now();
    let until = began + limits::UNREAD_WAIT_MAX + Duration::from_secs(20);
    let closed = spawn_blocking(move || answering_pings(alive, until)).await;
    let stayed = closed.expect("no panic").expect("it was closed") - began;
    println!("a connection that answers pings and reads nothing was closed after {stayed:?}");
    assert!(stayed > limits::UNREAD_WAIT_MAX - Duration::from_secs(1));
    assert!(stayed < limits::UNREAD_WAIT_MAX + Duration::from_secs(5));
    // The other end of one that reads nothing shows in the coordinator alone.
    let deadline = Instant::now() + Duration::from_secs(5);
    while sockets(&coordinator) > before {
        assert!(Instant::now() < deadline, "the other is open");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    let answer = status(&url, &Credentials::default()).await;
    assert_eq!(answer.expect("an answer"), 1);
}

/// How many sockets a process has open.
fn sockets(process: &Process) -> usize {
    let open = fs::read_dir(format!("/proc/{}/fd", process.id())).expect("it runs");
    let links = open.filter_map(|entry| fs::read_link(entry.ok()?.path()).ok());
    links
        .filter(|link| link.to_string_lossy().starts_with("socket:"))
        .count()
}
