//! Accepting connections, of which a stranger can open any number.
//!
//! A connection counts once its peer has spoken: until then it is one of a bounded number,
//! of which the longest silent half are closed when there are too many, and all after a while.
//! Honest clients speak at once, so they get through however many are silent. Who has spoken is a
//! stranger until a call is authorised (`strangers`).

use super::strangers::{Strangers, Visit};
use std::{
    collections::VecDeque,
    io,
    net::SocketAddr,
    pin::Pin,
    task::{Context, Poll},
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::{TcpListener, TcpSocket, TcpStream},
    sync::mpsc,
    task::{AbortHandle, JoinSet},
    time::{sleep, timeout},
};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::server::Connected;

pub use super::strangers::Peer;

/// How an HTTP/2 connection without TLS begins.
const PREFACE_BYTES: usize = 24;

/// A connection whose peer has spoken.
pub struct Connection {
    stream: TcpStream,
    visit: Visit,
}

/// Listens on an address. The system's own queue is made long: where it overflows an honest client
/// waits a second for its next try.
pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // A coordinator that starts again takes the address of the one before at once.
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(limits::ACCEPT_QUEUE_MAX)
}

/// Accepts connections for ever. With `preface` peers have to have sent that of HTTP/2, not only a
/// first byte.
pub fn open(listener: TcpListener, preface: bool) -> ReceiverStream<Result<Connection, io::Error>> {
    let (admitted, connections) = mpsc::channel(1);
    tokio::spawn(accept(listener, preface, admitted));
    ReceiverStream::new(connections)
}

async fn accept(
    listener: TcpListener,
    preface: bool,
    admitted: mpsc::Sender<Result<Connection, io::Error>>,
) {
    let strangers = Strangers::new(
        limits::STRANGERS_MAX,
        limits::STRANGER_STAY,
        limits::CONNECTIONS_MAX,
    );
    let mut silent = JoinSet::new();
    let mut handles: VecDeque<AbortHandle> = VecDeque::new();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            Some(_) = silent.join_next() => continue,
            () = admitted.closed() => return,
        };
        let (stream, address) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::debug!(%error, "a connection could not be accepted");
                sleep(limits::ACCEPT_PAUSE).await;
                continue;
            }
        };
        if handles.len() >= limits::SILENT_CONNECTIONS_MAX {
            handles.retain(|handle| !handle.is_finished());
            // Half at once, so that a flood costs little for each of its connections.
            let surplus = handles
                .len()
                .saturating_sub(limits::SILENT_CONNECTIONS_MAX / 2);
            handles.drain(..surplus).for_each(|longest| longest.abort());
        }
        let welcome = welcome(stream, preface);
        let admitted = admitted.clone();
        let strangers = strangers.clone();
        handles.push_back(silent.spawn(async move {
            // Whoever is too slow is put out without a word.
            let Ok(Some(stream)) = timeout(limits::SILENCE_MAX, welcome).await else {
                return;
            };
            let visit = strangers.let_in(address.ip());
            // An error means that nobody serves any more.
            let _ = admitted.send(Ok(Connection { stream, visit })).await;
        }));
    }
}

/// Waits until a peer has spoken.
async fn welcome(stream: TcpStream, preface: bool) -> Option<TcpStream> {
    let wanted = if preface { PREFACE_BYTES } else { 1 };
    let mut begin = [0; PREFACE_BYTES];
    while let Ok(seen) = stream.peek(&mut begin).await {
        if seen == 0 {
            return None;
        }
        if seen >= wanted {
            // Small messages are not to wait for more; where this fails they merely do.
            let _ = stream.set_nodelay(true);
            return Some(stream);
        }
        // What was seen stays readable, so waiting for more has to be done by the clock.
        sleep(limits::ACCEPT_PAUSE).await;
    }
    None
}

impl Connection {
    /// Who is at the other end.
    pub fn peer(&self) -> Peer {
        self.visit.peer.clone()
    }

    /// An error where the peer has to go. Writing asks as well as reading: while a write waits for its
    /// peer HTTP/2 may not read.
    fn check_end(&mut self, context: &mut Context<'_>) -> io::Result<()> {
        match self.visit.poll_end(context) {
            Poll::Ready(why) => Err(io::Error::new(io::ErrorKind::TimedOut, why)),
            Poll::Pending => Ok(()),
        }
    }
}

impl Connected for Connection {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        self.peer()
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.check_end(context)?;
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.check_end(context)?;
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.check_end(context)?;
        Pin::new(&mut self.stream).poll_write_vectored(context, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}
