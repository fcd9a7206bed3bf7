//! Open end of a byte link: a socket, a serial port or a boat's bus.

use core::task::{Context, Poll, Waker};
use std::{
    fs::{File, OpenOptions},
    future::Future,
    io::{self, ErrorKind, Read, Write},
    net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket},
    os::{fd::AsRawFd, unix::fs::OpenOptionsExt},
    path::Path,
    time::Duration,
};

use alight_transport::readiness::watched;
use rustix::{
    fs::{FlockOperation, OFlags, flock},
    io::Errno,
    termios::{ControlModes, OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr},
};
use tokio::{
    io::{Interest, unix::AsyncFd},
    time::timeout,
};

use crate::{
    config::link_url::LinkUrl,
    io::{
        can,
        peer::{LinkPeer, Speaks},
        web_socket::{self, SocketEnding},
    },
};

/// Timeout of a TCP connection, including the name lookup.
const CONNECT: Duration = Duration::from_millis(300);
pub const BOTH: Interest = Interest::READABLE.add(Interest::WRITABLE);

/// Open end with a non-blocking descriptor: reads wait in tokio, writes never wait.
pub enum Open {
    Udp {
        socket: AsyncFd<UdpSocket>,
        peer: LinkPeer,
    },
    Listening(LinkListener),
    Tcp(AsyncFd<TcpStream>, Option<LinkListener>),
    Serial(AsyncFd<File>),
    /// Interface and its name; yields one line per frame, sends nothing.
    Can(AsyncFd<File>, String),
    /// Signal K server, which yields one line per message, and the reason why it ended; sends nothing.
    Lines(AsyncFd<File>, SocketEnding),
}

/// Listener for one connection, optionally from a single address only.
pub struct LinkListener {
    pub socket: AsyncFd<TcpListener>,
    from: Option<IpAddr>,
}

pub enum LinkReceived {
    /// Number of bytes in the buffer, and the sender of a datagram.
    Bytes(usize, Option<SocketAddr>),
    Peer(TcpStream),
    Foreign(SocketAddr),
}

/// Tries `io` at once, and again whenever the descriptor becomes ready.
async fn when_ready<T: AsRawFd, R>(
    fd: &AsyncFd<T>,
    interest: Interest,
    mut io: impl FnMut(&T) -> io::Result<R>,
) -> io::Result<R> {
    match io(fd.get_ref()) {
        Err(e) if e.kind() == ErrorKind::WouldBlock => fd.async_io(interest, io).await,
        done => done,
    }
}

impl Open {
    pub async fn receive(&self, buffer: &mut [u8]) -> io::Result<LinkReceived> {
        match self {
            Open::Udp { socket, .. } => when_ready(socket, Interest::READABLE, |s| s.recv_from(buffer))
                .await
                .map(|(n, from)| LinkReceived::Bytes(n, Some(from))),
            Open::Listening(l) => when_ready(&l.socket, Interest::READABLE, TcpListener::accept)
                .await
                .map(|(stream, by)| {
                    let foreign = l.from.is_some_and(|from| from != by.ip().to_canonical());
                    if foreign {
                        LinkReceived::Foreign(by)
                    } else {
                        LinkReceived::Peer(stream)
                    }
                }),
            Open::Tcp(stream, _) => when_ready(stream, Interest::READABLE, |mut s| ended(s.read(buffer)))
                .await
                .map(|n| LinkReceived::Bytes(n, None)),
            Open::Serial(port) => when_ready(port, Interest::READABLE, |mut s| ended(s.read(buffer)))
                .await
                .map(|n| LinkReceived::Bytes(n, None)),
            Open::Can(socket, interface) => {
                let mut frame = [0; can::FRAME];
                let read = when_ready(socket, Interest::READABLE, |mut s| ended(s.read(&mut frame))).await;
                read.map_err(|e| can::broken(interface, e))?;
                let line = can::line(interface, &frame);
                let room = buffer.get_mut(..line.len()).unwrap_or_default();
                room.copy_from_slice(line.as_bytes().get(..room.len()).unwrap_or_default());
                Ok(LinkReceived::Bytes(room.len(), None))
            }
            Open::Lines(lines, ending) => {
                when_ready(lines, Interest::READABLE, |mut s| ended(s.read(buffer)))
                    .await
                    .map(|n| LinkReceived::Bytes(n, None))
                    .map_err(|e| ending.reason(e))
            }
        }
    }
    pub fn received_already(&self, buffer: &mut [u8]) -> Option<io::Result<LinkReceived>> {
        let mut context = Context::from_waker(Waker::noop());
        match core::pin::pin!(self.receive(buffer)).poll(&mut context) {
            Poll::Ready(received) => Some(received),
            Poll::Pending => None,
        }
    }
    /// Waits until a stream accepts bytes, writes as many as it accepts, and returns their number.
    pub async fn drain(&self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Open::Tcp(stream, _) => when_ready(stream, Interest::WRITABLE, |mut s| s.write(bytes)).await,
            Open::Serial(port) => when_ready(port, Interest::WRITABLE, |mut s| s.write(bytes)).await,
            Open::Udp { .. } | Open::Listening(_) | Open::Can(..) | Open::Lines(..) => Ok(bytes.len()),
        }
    }
    pub fn write_now(&self, bytes: &[u8]) -> Option<io::Result<usize>> {
        match self {
            Open::Udp { socket, peer, .. } => Some(socket.get_ref().send_to(bytes, peer.address()?)),
            Open::Tcp(stream, _) => Some(stream.get_ref().write(bytes)),
            Open::Serial(port) => Some(port.get_ref().write(bytes)),
            Open::Listening(_) | Open::Can(..) | Open::Lines(..) => None,
        }
    }
}

pub async fn open(url: LinkUrl, speaks: Option<Speaks>) -> io::Result<Open> {
    match &url {
        LinkUrl::UdpIn(host, from) => udp(resolve(host).await?, LinkPeer::listening(*from, speaks)),
        LinkUrl::UdpOut(host) => {
            let to = resolve(host).await?;
            let any: SocketAddr = if to.is_ipv4() {
                ([0; 4], 0).into()
            } else {
                ([0_u16; 8], 0).into()
            };
            udp(any, LinkPeer::fixed(to))
        }
        LinkUrl::TcpIn(host, from) => {
            let listener = TcpListener::bind(resolve(host).await?)?;
            listener.set_nonblocking(true)?;
            Ok(Open::Listening(LinkListener {
                socket: watched(listener, Interest::READABLE)?,
                from: *from,
            }))
        }
        LinkUrl::TcpOut(host) => {
            let connect = async { tokio::net::TcpStream::connect(resolve(host).await?).await };
            let stream = timeout(CONNECT, connect).await??.into_std()?;
            stream.set_nodelay(true)?;
            Ok(Open::Tcp(watched(stream, BOTH)?, None))
        }
        LinkUrl::Serial(path, baud) => serial(path, *baud)
            .and_then(|port| watched(port, BOTH))
            .map(Open::Serial),
        LinkUrl::Can(interface) => {
            let socket = watched(can::open(interface)?, Interest::READABLE)?;
            Ok(Open::Can(socket, interface.clone()))
        }
        LinkUrl::SignalK(host, token) => {
            let (lines, ending) = web_socket::lines(host, token.as_deref()).await?;
            Ok(Open::Lines(watched(lines, Interest::READABLE)?, ending))
        }
    }
}

fn udp(at: SocketAddr, peer: LinkPeer) -> io::Result<Open> {
    let socket = UdpSocket::bind(at)?;
    socket.set_nonblocking(true)?;
    Ok(Open::Udp {
        socket: watched(socket, BOTH)?,
        peer,
    })
}

fn ended(read: io::Result<usize>) -> io::Result<usize> {
    match read {
        Ok(0) => Err(io::Error::new(
            ErrorKind::UnexpectedEof,
            "the other end closed the link",
        )),
        other => other,
    }
}

pub async fn resolve(host: &str) -> io::Result<SocketAddr> {
    tokio::net::lookup_host(host)
        .await?
        .next()
        .ok_or_else(|| io::Error::new(ErrorKind::NotFound, format!("{host} has no address")))
}

/// Opens a serial port for raw bytes, exclusively: two readers would each receive a part of every message.
pub fn serial(path: &Path, baud: u32) -> io::Result<File> {
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let port = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path)
        // A port locked by TIOCEXCL below is busy for every user except root.
        .map_err(|e| match e.kind() {
            ErrorKind::ResourceBusy => in_use(),
            _ => e,
        })?;
    // Excludes Alight's own programs, even as root; TIOCEXCL excludes any other program that opens the port later.
    flock(&port, FlockOperation::NonBlockingLockExclusive).map_err(|e| match e {
        Errno::WOULDBLOCK => in_use(),
        e => e.into(),
    })?;
    ioctl_tiocexcl(&port)?;
    let mut line = tcgetattr(&port)?;
    line.make_raw();
    line.set_speed(baud)?;
    line.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    line.control_modes -= ControlModes::CRTSCTS | ControlModes::HUPCL;
    tcsetattr(&port, OptionalActions::Now, &line)?;
    Ok(port)
}

fn in_use() -> io::Error {
    io::Error::new(
        ErrorKind::ResourceBusy,
        "another program has this port open: end it, or give each its own port",
    )
}
