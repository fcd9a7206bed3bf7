//! Limits on viewers' connections: number, backlog, idle time.
//!
//! When all places are taken, a new connection replaces the one that has been silent the longest. Connections without
//! a complete request are replaced first, so they keep no viewer out.

use std::{
    future::Future,
    io,
    net::SocketAddr,
    pin::Pin,
    sync::{
        Arc, Weak,
        atomic::{AtomicBool, AtomicI64, Ordering},
    },
    task::{Context, Poll},
    time::Duration,
};

use alight_transport::clock::steady_ns;
use axum::{
    extract::connect_info::Connected,
    serve::{IncomingStream, Listener},
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::{TcpListener, TcpSocket, TcpStream},
    sync::oneshot,
    time::{Instant, Sleep},
};

/// Maximum number of connections; a browser opens up to six.
const CONNECTIONS: usize = 64;
/// Maximum number of connections that wait to be accepted.
const BACKLOG: u32 = 64;
/// Kernel's send buffer for a viewer that does not read, bytes: a few pictures, so that a slow reader sees recent
/// ones.
const SEND_BUFFER_BYTES: u32 = 32 << 10;
/// Idle time after which a connection is closed, and limit for completing its first request.
const IDLE: Duration = Duration::from_secs(30);
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);

pub struct Guard {
    listener: TcpListener,
    places: Vec<Place>,
}

struct Place {
    peer: Weak<State>,
    close: oneshot::Sender<()>,
}

impl Guard {
    /// Listens on `address`; needs a tokio runtime.
    pub fn listen(address: SocketAddr) -> io::Result<Guard> {
        let socket = if address.is_ipv4() {
            TcpSocket::new_v4()?
        } else {
            TcpSocket::new_v6()?
        };
        // A restarted server can listen without waiting for the old connections to time out.
        socket.set_reuseaddr(true)?;
        socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
        socket.bind(address)?;
        Ok(Guard {
            listener: socket.listen(BACKLOG)?,
            places: Vec::with_capacity(CONNECTIONS),
        })
    }
    /// Gives a place to a connection, closing another if all are taken.
    fn seat(&mut self, stream: TcpStream) -> Connection {
        self.places.retain(|p| p.peer.strong_count() > 0);
        if self.places.len() >= CONNECTIONS {
            let order = |p: &Place| p.peer.upgrade().map(|s| s.order());
            let all = self.places.iter().enumerate();
            if let Some((k, _)) = all.min_by_key(|(_, p)| order(p)) {
                let _ended = self.places.swap_remove(k).close.send(());
            }
        }
        let peer = ViewerPeer::default();
        peer.0.active_ns.store(steady_ns(), Ordering::Relaxed);
        let (close, closed) = oneshot::channel();
        self.places.push(Place {
            peer: Arc::downgrade(&peer.0),
            close,
        });
        Connection {
            stream,
            peer,
            closed: Some(closed),
            idle: Box::pin(tokio::time::sleep(IDLE)),
        }
    }
}

impl Listener for Guard {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            if let Ok((stream, address)) = self.listener.accept().await {
                return (self.seat(stream), address);
            }
            tokio::time::sleep(ACCEPT_PAUSE).await;
        }
    }
    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

#[derive(Debug, Default)]
struct State {
    stalled: AtomicBool,
    asked: AtomicBool,
    active_ns: AtomicI64,
}

impl State {
    /// Order of closing, smallest first: connections without a request first, then by length of silence.
    fn order(&self) -> (bool, i64) {
        (
            self.asked.load(Ordering::Relaxed),
            self.active_ns.load(Ordering::Relaxed),
        )
    }
}

#[derive(Clone, Debug, Default)]
pub struct ViewerPeer(Arc<State>);

impl ViewerPeer {
    /// The viewer has not read the last picture, and is sent no other until it has.
    pub fn is_stalled(&self) -> bool {
        self.0.stalled.load(Ordering::Relaxed)
    }
    pub fn has_asked(&self) {
        self.0.asked.store(true, Ordering::Relaxed);
    }
}

impl Connected<IncomingStream<'_, Guard>> for ViewerPeer {
    fn connect_info(stream: IncomingStream<'_, Guard>) -> ViewerPeer {
        stream.io().peer.clone()
    }
}

pub struct Connection {
    stream: TcpStream,
    peer: ViewerPeer,
    /// Signalled when its place is given to another connection.
    closed: Option<oneshot::Receiver<()>>,
    idle: Pin<Box<Sleep>>,
}

impl Connection {
    /// Closes an idle connection, or one whose place was given to another.
    fn watch<T>(&mut self, cx: &mut Context<'_>, done: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        let closed = self.closed.as_mut();
        if closed.is_none_or(|c| Pin::new(c).poll(cx).is_ready()) {
            self.closed = None;
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        }
        if done.is_ready() {
            let state = &self.peer.0;
            state.active_ns.store(steady_ns(), Ordering::Relaxed);
            if state.asked.load(Ordering::Relaxed) {
                self.idle.as_mut().reset(Instant::now() + IDLE);
            }
            return done;
        }
        self.idle
            .as_mut()
            .poll(cx)
            .map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let read = Pin::new(&mut self.stream).poll_read(cx, buffer);
        self.watch(cx, read)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.peer.0.stalled.store(written.is_pending(), Ordering::Relaxed);
        self.watch(cx, written)
    }
    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }
    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
