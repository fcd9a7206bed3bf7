//! Bounds on viewers' connections: number, queue of each, time without reading or asking.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep};

/// Connections at a time; a browser has up to six.
const CONNECTIONS: usize = 64;
/// Connections that wait to be taken.
const BACKLOG: u32 = 64;
/// What the kernel keeps for a viewer that does not read, bytes: a few pictures, so that one that reads slowly sees
/// recent ones.
const SEND_BUFFER_BYTES: u32 = 32 << 10;
/// A connection over which nothing went for so long is closed.
const IDLE: Duration = Duration::from_secs(30);
/// After a connection could not be accepted (no more files).
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);

/// Accepts viewers.
pub struct Guard {
    listener: TcpListener,
    places: Arc<Semaphore>,
}

impl Guard {
    /// Listens on `address`; inside a runtime.
    pub fn listen(address: SocketAddr) -> io::Result<Guard> {
        let socket = if address.is_ipv4() {
            TcpSocket::new_v4()?
        } else {
            TcpSocket::new_v6()?
        };
        // A server that is started again listens at once.
        socket.set_reuseaddr(true)?;
        socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
        socket.bind(address)?;
        Ok(Guard {
            listener: socket.listen(BACKLOG)?,
            places: Arc::new(Semaphore::new(CONNECTIONS)),
        })
    }
}

impl Listener for Guard {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            let place = Arc::clone(&self.places).acquire_owned().await;
            if let (Ok(place), Ok((stream, address))) = (place, self.listener.accept().await) {
                let connection = Connection {
                    stream,
                    stalled: Stalled::default(),
                    idle: Box::pin(tokio::time::sleep(IDLE)),
                    _place: place,
                };
                return (connection, address);
            }
            tokio::time::sleep(ACCEPT_PAUSE).await;
        }
    }
    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Whether a viewer has not taken what was sent to it: it is sent nothing more until it has.
#[derive(Clone, Debug, Default)]
pub struct Stalled(Arc<AtomicBool>);

impl Stalled {
    /// It has not.
    pub fn is_so(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl Connected<IncomingStream<'_, Guard>> for Stalled {
    fn connect_info(stream: IncomingStream<'_, Guard>) -> Stalled {
        stream.io().stalled.clone()
    }
}

/// The connection of a viewer.
pub struct Connection {
    stream: TcpStream,
    stalled: Stalled,
    idle: Pin<Box<Sleep>>,
    _place: OwnedSemaphorePermit,
}

impl Connection {
    /// Closes a connection over which nothing goes.
    fn watch<T>(&mut self, cx: &mut Context<'_>, done: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if done.is_ready() {
            self.idle.as_mut().reset(Instant::now() + IDLE);
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
        self.stalled.0.store(written.is_pending(), Ordering::Relaxed);
        self.watch(cx, written)
    }
    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }
    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
