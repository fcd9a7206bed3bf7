//! Bytes to and from an autopilot or a sensor: UDP, TCP, serial, and lines of a boat's bus, on tokio. A broken link is reopened after a pause that
//! doubles up to a bound, in a task of its own: neither a name that is looked up nor a peer that does not answer holds up
//! who reads and writes.

use core::task::{Context, Poll, Waker};
use std::fs::{File, OpenOptions};
use std::future::Future;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::Duration;

use alight_shared::transport::readiness::watched;
use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until, timeout};

use crate::config::link_url::LinkUrl;
use crate::exit::{CliError, Doing};
use crate::io::can;
use crate::io::peer::{Peer, Speaks};
use crate::io::web_socket;

/// First pause before a link is opened again; doubles with each failure.
const INITIAL_BACKOFF: Duration = Duration::from_millis(100);
/// Longest pause.
const MAX_BACKOFF: Duration = Duration::from_secs(2);
/// A TCP connection has this long to come about, its name included.
const CONNECT: Duration = Duration::from_millis(300);
/// Most reads at once: a flood must not delay the set-points.
const MAX_READS: usize = 64;
/// Longest datagram, or part of a stream, bytes.
const MAX_READ_BYTES: usize = 2048;

/// Reads and writes are waited for.
const BOTH: Interest = Interest::READABLE.add(Interest::WRITABLE);

/// An open end. Descriptors are non-blocking; reads wait in tokio, writes do not wait.
enum Open {
    Udp {
        socket: AsyncFd<UdpSocket>,
        peer: Peer,
    },
    Listening(Listener),
    /// TCP, and the listener that accepted it.
    Tcp(AsyncFd<TcpStream>, Option<Listener>),
    Serial(AsyncFd<File>),
    /// A CAN interface and its name: a line a frame. Nothing is sent.
    Can(AsyncFd<File>, String),
    /// A Signal K server: a line a message. Nothing is sent.
    Lines(AsyncFd<File>),
}

/// Accepts one connection, where an address is named from there only.
struct Listener {
    socket: AsyncFd<TcpListener>,
    from: Option<IpAddr>,
}

/// What an open end receives.
enum Received {
    /// Bytes in the buffer, and who sent a datagram.
    Bytes(usize, Option<SocketAddr>),
    /// A connection.
    Peer(TcpStream),
    /// One from another address than it may come from; it is closed.
    Foreign(SocketAddr),
}

/// Tries `io` at once, and again whenever the descriptor may be ready.
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
    async fn receive(&self, buffer: &mut [u8]) -> io::Result<Received> {
        match self {
            Open::Udp { socket, .. } => when_ready(socket, Interest::READABLE, |s| s.recv_from(buffer))
                .await
                .map(|(n, from)| Received::Bytes(n, Some(from))),
            Open::Listening(l) => when_ready(&l.socket, Interest::READABLE, TcpListener::accept)
                .await
                .map(|(stream, by)| {
                    let foreign = l.from.is_some_and(|from| from != by.ip().to_canonical());
                    if foreign {
                        Received::Foreign(by)
                    } else {
                        Received::Peer(stream)
                    }
                }),
            Open::Tcp(stream, _) => when_ready(stream, Interest::READABLE, |mut s| ended(s.read(buffer)))
                .await
                .map(|n| Received::Bytes(n, None)),
            Open::Serial(port) => when_ready(port, Interest::READABLE, |mut s| ended(s.read(buffer)))
                .await
                .map(|n| Received::Bytes(n, None)),
            Open::Can(socket, interface) => {
                let mut frame = [0; can::FRAME];
                when_ready(socket, Interest::READABLE, |mut s| ended(s.read(&mut frame))).await?;
                let line = can::line(interface, &frame);
                let room = buffer.get_mut(..line.len()).unwrap_or_default();
                room.copy_from_slice(line.as_bytes().get(..room.len()).unwrap_or_default());
                Ok(Received::Bytes(room.len(), None))
            }
            Open::Lines(lines) => when_ready(lines, Interest::READABLE, |mut s| ended(s.read(buffer)))
                .await
                .map(|n| Received::Bytes(n, None)),
        }
    }
    /// What has come already.
    fn received_already(&self, buffer: &mut [u8]) -> Option<io::Result<Received>> {
        let mut context = Context::from_waker(Waker::noop());
        match core::pin::pin!(self.receive(buffer)).poll(&mut context) {
            Poll::Ready(received) => Some(received),
            Poll::Pending => None,
        }
    }
    /// Writes a part of a stream's bytes as soon as the line takes some.
    async fn drain(&self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Open::Tcp(stream, _) => when_ready(stream, Interest::WRITABLE, |mut s| s.write(bytes)).await,
            Open::Serial(port) => when_ready(port, Interest::WRITABLE, |mut s| s.write(bytes)).await,
            Open::Udp { .. } | Open::Listening(_) | Open::Can(..) | Open::Lines(_) => Ok(bytes.len()),
        }
    }
    /// Writes what can be written now; None while there is nobody to write to.
    fn write_now(&self, bytes: &[u8]) -> Option<io::Result<usize>> {
        match self {
            Open::Udp { socket, peer, .. } => Some(socket.get_ref().send_to(bytes, peer.address()?)),
            Open::Tcp(stream, _) => Some(stream.get_ref().write(bytes)),
            Open::Serial(port) => Some(port.get_ref().write(bytes)),
            Open::Listening(_) | Open::Can(..) | Open::Lines(_) => None,
        }
    }
}

/// A link to an autopilot or a sensor.
pub struct ByteLink {
    url: LinkUrl,
    /// Who may be the peer of a UDP link.
    speaks: Option<Speaks>,
    open: Option<Open>,
    /// Opening is under way.
    opening: Option<JoinHandle<io::Result<Open>>>,
    next_try: Instant,
    backoff: Duration,
    opened: u32,
    unsent: u64,
    /// The rest of a message of which the line took a part: nothing is sent before it.
    rest: Vec<u8>,
    last_error: Option<String>,
}

/// What ended a wait.
enum Event {
    Received(io::Result<Received>),
    Drained(io::Result<usize>),
}

impl ByteLink {
    #[cfg(test)]
    pub async fn new(url: LinkUrl) -> Result<ByteLink, CliError> {
        ByteLink::with_peer(url, None).await
    }
    /// A link to `url`; over UDP its peer is the first that `speaks`. What can be known to be wrong at once is refused: a
    /// port that is taken, a host that has no address; a peer that is not there yet is waited for.
    pub async fn with_peer(url: LinkUrl, speaks: Option<Speaks>) -> Result<ByteLink, CliError> {
        let doing = || format!("opening {url}");
        let open = match &url {
            LinkUrl::UdpIn(..) | LinkUrl::UdpOut(_) | LinkUrl::TcpIn(..) => {
                Some(open(url.clone(), speaks.clone()).await.doing(doing())?)
            }
            LinkUrl::TcpOut(host) | LinkUrl::SignalK(host, _) => {
                resolve(host).await.doing(doing())?;
                None
            }
            LinkUrl::Serial(..) | LinkUrl::Can(_) => None,
        };
        Ok(ByteLink {
            url,
            speaks,
            open,
            opening: None,
            next_try: Instant::now(),
            backoff: INITIAL_BACKOFF,
            opened: 0,
            unsent: 0,
            rest: Vec::new(),
            last_error: None,
        })
    }
    /// Times that the link was opened again.
    pub fn opened(&self) -> u32 {
        self.opened
    }
    /// Datagrams that were left out because another than the peer sent them.
    pub fn foreign(&self) -> u64 {
        match &self.open {
            Some(Open::Udp { peer, .. }) => peer.foreign(),
            Some(Open::Listening(_) | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(_))
            | None => 0,
        }
    }
    /// The same, and who sent the newest; None without any.
    pub fn strangers(&self) -> Option<(u64, SocketAddr)> {
        match &self.open {
            Some(Open::Udp { peer, .. }) => Some((peer.foreign(), peer.newest_stranger()?)),
            Some(Open::Listening(_) | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(_))
            | None => None,
        }
    }
    /// Messages that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.unsent
    }
    /// Why it could not be opened, once for each new reason.
    pub fn last_error(&mut self) -> Option<String> {
        self.last_error.take()
    }

    /// Waits for bytes and gives all that are there to `take`. Returns without any after a connection, an end or a
    /// failure. A wait that is given up loses nothing.
    pub async fn read(&mut self, mut take: impl FnMut(&[u8])) {
        let Some(open) = &self.open else {
            return self.reopen().await;
        };
        let mut buffer = [0_u8; MAX_READ_BYTES];
        let event = tokio::select! {
            biased;
            drained = open.drain(&self.rest), if !self.rest.is_empty() => Event::Drained(drained),
            received = open.receive(&mut buffer) => Event::Received(received),
        };
        match event {
            Event::Drained(Ok(n)) => drop(self.rest.drain(..n.min(self.rest.len()))),
            Event::Drained(Err(e)) => self.failed(&e),
            Event::Received(received) => {
                let mut more = self.received(received, &buffer, &mut take);
                for _ in 1..MAX_READS {
                    let Some(open) = self.open.as_ref().filter(|_| more) else {
                        break;
                    };
                    let Some(received) = open.received_already(&mut buffer) else {
                        break;
                    };
                    more = self.received(received, &buffer, &mut take);
                }
            }
        }
    }
    /// Takes what came; false when the open end has changed.
    fn received(
        &mut self,
        received: io::Result<Received>,
        buffer: &[u8],
        take: &mut impl FnMut(&[u8]),
    ) -> bool {
        match received {
            Ok(Received::Bytes(n, from)) => {
                let bytes = buffer.get(..n).unwrap_or_default();
                if from.is_none_or(|from| self.is_from_peer(from, bytes)) {
                    take(bytes);
                }
                true
            }
            Ok(Received::Peer(stream)) => {
                let ready = stream
                    .set_nonblocking(true)
                    .and_then(|()| stream.set_nodelay(true))
                    .and_then(|()| watched(stream, BOTH));
                if let (Ok(stream), Some(Open::Listening(listener))) = (ready, self.open.take()) {
                    self.open = Some(Open::Tcp(stream, Some(listener)));
                    self.opened += 1;
                }
                false
            }
            Ok(Received::Foreign(by)) => {
                self.last_error = Some(format!("{}: a connection of {by} is refused", self.url));
                false
            }
            // An answer to what we sent: no listener there yet.
            Err(e) if matches!(e.kind(), ErrorKind::ConnectionRefused | ErrorKind::Interrupted) => true,
            Err(e) => {
                self.failed(&e);
                false
            }
        }
    }
    fn is_from_peer(&mut self, from: SocketAddr, datagram: &[u8]) -> bool {
        match &mut self.open {
            Some(Open::Udp { peer, .. }) => peer.takes(Instant::now(), from, datagram),
            Some(Open::Listening(_) | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(_))
            | None => true,
        }
    }

    /// Opens the link when it is due.
    async fn reopen(&mut self) {
        if self.opening.is_none() {
            sleep_until(self.next_try).await;
        }
        let opening = self
            .opening
            .get_or_insert_with(|| tokio::spawn(open(self.url.clone(), self.speaks.clone())));
        let opened = opening.await.map_err(io::Error::other).flatten();
        self.opening = None;
        match opened {
            Ok(open) => {
                self.open = Some(open);
                self.opened += 1;
                self.backoff = INITIAL_BACKOFF;
            }
            Err(e) => self.wait(&e),
        }
    }
    fn wait(&mut self, why: &io::Error) {
        self.last_error = Some(format!("{}: {why}; trying again", self.url));
        self.next_try = Instant::now() + self.backoff;
        self.backoff = (2 * self.backoff).min(MAX_BACKOFF);
    }
    /// The link broke: a listener stays open, the rest is reopened.
    fn failed(&mut self, why: &io::Error) {
        self.rest.clear();
        self.open = match self.open.take() {
            Some(Open::Tcp(_, Some(listener))) => Some(Open::Listening(listener)),
            Some(
                Open::Udp { .. }
                | Open::Listening(_)
                | Open::Tcp(_, None)
                | Open::Serial(_)
                | Open::Can(..)
                | Open::Lines(_),
            )
            | None => None,
        };
        if self.open.is_none() {
            self.wait(why);
        }
    }

    /// Sends one message, whole or not at all. What the line does not take now is lost and counted: a set-point must not be
    /// late. A line that took a part gets the rest before anything else.
    pub fn write(&mut self, message: &[u8]) {
        if !self.rest.is_empty() {
            let rest = core::mem::take(&mut self.rest);
            match self.put(&rest) {
                Ok(n) => self.rest = rest.get(n..).unwrap_or_default().to_vec(),
                Err(e) if e.kind() == ErrorKind::WouldBlock => self.rest = rest,
                Err(e) => self.not_sent(&e),
            }
        }
        if !self.rest.is_empty() {
            self.unsent += 1;
            return;
        }
        match self.put(message) {
            Ok(n) => self.rest = message.get(n..).unwrap_or_default().to_vec(),
            Err(e) => {
                self.unsent += 1;
                self.not_sent(&e);
            }
        }
    }
    /// Writes what the line takes now: all where there is nobody, nothing where it is full.
    fn put(&self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.open.as_ref().and_then(|open| open.write_now(bytes));
        written.unwrap_or(Ok(bytes.len()))
    }
    /// A full buffer or an absent peer passes; a broken stream does not.
    fn not_sent(&mut self, why: &io::Error) {
        let harmless = matches!(
            why.kind(),
            ErrorKind::WouldBlock | ErrorKind::ConnectionRefused | ErrorKind::NetworkUnreachable
        );
        if !harmless {
            self.failed(why);
        }
    }
}

/// Opens one end.
async fn open(url: LinkUrl, speaks: Option<Speaks>) -> io::Result<Open> {
    match &url {
        LinkUrl::UdpIn(host, from) => udp(resolve(host).await?, Peer::listening(*from, speaks)),
        LinkUrl::UdpOut(host) => {
            let to = resolve(host).await?;
            let any: SocketAddr = if to.is_ipv4() {
                ([0; 4], 0).into()
            } else {
                ([0_u16; 8], 0).into()
            };
            udp(any, Peer::fixed(to))
        }
        LinkUrl::TcpIn(host, from) => {
            let listener = TcpListener::bind(resolve(host).await?)?;
            listener.set_nonblocking(true)?;
            Ok(Open::Listening(Listener {
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
            let lines = web_socket::lines(host, token.as_deref()).await?;
            Ok(Open::Lines(watched(lines, Interest::READABLE)?))
        }
    }
}

fn udp(at: SocketAddr, peer: Peer) -> io::Result<Open> {
    let socket = UdpSocket::bind(at)?;
    socket.set_nonblocking(true)?;
    Ok(Open::Udp {
        socket: watched(socket, BOTH)?,
        peer,
    })
}

/// A read of nothing is the end of a stream.
fn ended(read: io::Result<usize>) -> io::Result<usize> {
    match read {
        Ok(0) => Err(io::Error::new(
            ErrorKind::UnexpectedEof,
            "the other end closed the link",
        )),
        other => other,
    }
}

async fn resolve(host: &str) -> io::Result<SocketAddr> {
    tokio::net::lookup_host(host)
        .await?
        .next()
        .ok_or_else(|| io::Error::new(ErrorKind::NotFound, format!("{host} has no address")))
}

/// Opens a serial port for bytes as they are, and for this program alone: two readers of one line would each
/// receive a part of every message.
fn serial(path: &Path, baud: u32) -> io::Result<File> {
    // Reads do not wait, and the port does not become this process's terminal.
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let port = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path)
        // What TIOCEXCL below answers to everybody but root.
        .map_err(|e| match e.kind() {
            ErrorKind::ResourceBusy => in_use(),
            _ => e,
        })?;
    // Between our own programs, root's included; then against any other that opens it later.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads until `enough` bytes have come.
    async fn read_at_least(link: &mut ByteLink, enough: usize) -> Vec<u8> {
        let mut all = Vec::new();
        let reading = async {
            while all.len() < enough {
                link.read(|b| all.extend_from_slice(b)).await;
            }
        };
        let _late = timeout(Duration::from_secs(5), reading).await;
        all
    }

    /// Reads for as long as `of` takes.
    async fn reading<F: Future>(link: &mut ByteLink, of: F) -> F::Output {
        let mut of = core::pin::pin!(of);
        loop {
            tokio::select! {
                done = &mut of => return done,
                () = link.read(|_| {}) => {}
            }
        }
    }

    fn port(link: &ByteLink) -> SocketAddr {
        match &link.open {
            Some(Open::Udp { socket, .. }) => socket.get_ref().local_addr().unwrap(),
            Some(Open::Listening(listener)) => listener.socket.get_ref().local_addr().unwrap(),
            _ => panic!("not listening"),
        }
    }

    #[tokio::test]
    async fn udp_link_with_a_second_peer() {
        let mut link = ByteLink::new(LinkUrl::UdpIn("127.0.0.1:0".into(), None))
            .await
            .unwrap();
        let at = port(&link);
        let [first, second] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        first.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
        link.write(b"nobody there");
        first.send_to(b"one", at).unwrap();
        assert_eq!(read_at_least(&mut link, 3).await, b"one");
        second.send_to(b"two", at).unwrap();
        first.send_to(b"three", at).unwrap();
        assert_eq!(read_at_least(&mut link, 5).await, b"three");
        link.write(b"answer");
        let mut buffer = [0; 16];
        assert_eq!(first.recv(&mut buffer).unwrap(), 6);
        assert_eq!(link.foreign(), 1);
    }

    #[tokio::test]
    async fn udp_link_whose_first_sender_speaks_another_language() {
        let speaks: Speaks = std::sync::Arc::new(|datagram| datagram.starts_with(b"$GP"));
        let url = LinkUrl::UdpIn("127.0.0.1:0".into(), None);
        let mut link = ByteLink::with_peer(url, Some(speaks)).await.unwrap();
        let at = port(&link);
        let [wind, receiver] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        for _ in 0..3 {
            wind.send_to(b"$WIMWV", at).unwrap();
            receiver.send_to(b"$GPGGA", at).unwrap();
        }
        assert_eq!(read_at_least(&mut link, 18).await, b"$GPGGA$GPGGA$GPGGA");
        assert_eq!(link.strangers(), Some((3, wind.local_addr().unwrap())));
    }

    #[tokio::test]
    async fn connection_from_another_address() {
        let url = LinkUrl::TcpIn("127.0.0.1:0".into(), Some([10, 0, 0, 7].into()));
        let mut link = ByteLink::new(url).await.unwrap();
        let mut stranger = TcpStream::connect(port(&link)).unwrap();
        link.read(|_| {}).await;
        let why = link.last_error().unwrap();
        assert!(why.contains("is refused") && link.opened() == 0, "{why}");
        assert!(matches!(link.open, Some(Open::Listening(_))));
        assert!(matches!(stranger.read(&mut [0; 1]), Ok(0) | Err(_)), "closed");
    }

    /// A pseudo-terminal and its path.
    fn terminal() -> (std::os::fd::OwnedFd, String) {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let line = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&line).unwrap();
        unlockpt(&line).unwrap();
        let path = ptsname(&line, Vec::new()).unwrap().into_string().unwrap();
        (line, path)
    }

    #[tokio::test]
    async fn serial_port_open_in_another_program() {
        let (_line, path) = terminal();
        let first = serial(Path::new(&path), 115_200).unwrap();
        // A lock belongs to the open file, so this program opens it like another one.
        let url: LinkUrl = format!("serial://{path}:115200").parse().unwrap();
        let mut second = ByteLink::new(url).await.unwrap();
        second.read(|_| {}).await;
        let why = second.last_error().unwrap();
        assert!(why.contains("another program has this port open"), "{why}");
        assert_eq!(second.opened(), 0);
        // It is taken over once it is free; a pseudo-terminal, unlike a port, stays exclusive, which binds all but root.
        drop(first);
        if !rustix::process::geteuid().is_root() {
            return;
        }
        second.read(|_| {}).await;
        assert_eq!((second.opened(), second.last_error()), (1, None));
    }

    #[tokio::test]
    async fn messages_through_a_full_line_are_whole() {
        let (line, path) = terminal();
        let url: LinkUrl = format!("serial://{path}:115200").parse().unwrap();
        let mut link = ByteLink::new(url).await.unwrap();
        link.read(|_| {}).await;
        assert_eq!(link.opened(), 1, "{:?}", link.last_error());
        // More than the line holds: some are lost whole, one waits with its rest.
        const MESSAGE: usize = 250;
        let messages: Vec<Vec<u8>> = (0..200_u8).map(|k| vec![k; MESSAGE]).collect();
        for message in &messages {
            link.write(message);
        }
        assert!(link.unsent() > 0);
        let reader = File::from(line);
        let read = tokio::task::spawn_blocking(move || {
            let mut all = Vec::new();
            let mut buffer = [0; 4096];
            while !all.ends_with(&[250; MESSAGE]) {
                let n = (&reader).read(&mut buffer).unwrap();
                all.extend_from_slice(&buffer[..n]);
            }
            all
        });
        let mut last = tokio::time::interval(Duration::from_millis(5));
        let mut read = core::pin::pin!(read);
        let all = loop {
            tokio::select! {
                all = &mut read => break all.unwrap(),
                () = link.read(|_| {}) => {}
                _ = last.tick() => link.write(&[250; MESSAGE]),
            }
        };
        assert_eq!(all.len() % MESSAGE, 0);
        for message in all.chunks(MESSAGE) {
            assert!(message.iter().all(|b| *b == message[0]), "half a message");
        }
    }

    #[tokio::test]
    async fn tcp_link_reconnects_after_the_peer_closed() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = LinkUrl::TcpOut(listener.local_addr().unwrap().to_string());
        let mut link = ByteLink::new(url).await.unwrap();
        for round in 1..=3 {
            let (other, _) = reading(&mut link, listener.accept()).await.unwrap();
            other.try_write(b"hello").unwrap();
            assert_eq!(read_at_least(&mut link, 5).await, b"hello");
            link.write(b"yes");
            other.readable().await.unwrap();
            let mut buffer = [0; 8];
            assert_eq!(
                (other.try_read(&mut buffer).unwrap(), &buffer[..3]),
                (3, &b"yes"[..])
            );
            assert_eq!(link.opened(), round);
            drop(other);
            link.read(|_| {}).await;
            assert!(link.open.is_none() && link.last_error().is_some());
        }
    }

    #[tokio::test]
    #[ignore = "needs a virtual CAN interface: ip link add vcan0 type vcan; ip link set vcan0 up"]
    async fn frames_of_a_can_interface() {
        let mut link = ByteLink::new("can://vcan0".parse().unwrap()).await.unwrap();
        link.read(|_| {}).await;
        assert_eq!((link.opened(), link.last_error()), (1, None));
        let id: can_socket::ExtendedId = 0x09f8_0115_u32.try_into().unwrap();
        let bus = can_socket::CanSocket::bind("vcan0").unwrap();
        for k in 0..100_u8 {
            bus.send(&can_socket::CanFrame::new(id, [k; 8])).unwrap();
        }
        let line = |k: u8| format!("vcan0 09F80115#{}\n", format!("{k:02X}").repeat(8));
        let all: String = (0..100).map(line).collect();
        assert_eq!(
            String::from_utf8(read_at_least(&mut link, all.len()).await).unwrap(),
            all
        );
    }

    #[tokio::test]
    async fn signalk_server_that_is_restarted() {
        use futures_util::SinkExt;
        use tokio_tungstenite::{accept_async, tungstenite::Message};

        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = LinkUrl::SignalK(listener.local_addr().unwrap().to_string(), None);
        let mut link = ByteLink::new(url).await.unwrap();
        for round in 1..=2 {
            let accept = async { accept_async(listener.accept().await.unwrap().0).await.unwrap() };
            let mut server = reading(&mut link, accept).await;
            server.send(Message::text("{\"a\":\n1}")).await.unwrap();
            server.send(Message::text("{}")).await.unwrap();
            assert_eq!(read_at_least(&mut link, 12).await, b"{\"a\": 1}\n{}\n");
            assert_eq!(link.opened(), round);
            link.write(b"nothing is sent to it");
            drop(server);
            link.read(|_| {}).await;
            assert!(link.open.is_none() && link.last_error().is_some());
        }
    }

    #[tokio::test]
    async fn link_backoff_doubles_up_to_a_bound() {
        let absent = LinkUrl::Serial("/nonexistent/tty".into(), 57600);
        let mut link = ByteLink::new(absent).await.unwrap();
        let (mut tries, mut waited) = (Vec::new(), Duration::ZERO);
        while waited < Duration::from_secs(20) {
            // It is due at once.
            link.next_try = Instant::now();
            link.read(|_| {}).await;
            assert!(link.last_error().is_some());
            let pause = link.next_try.duration_since(Instant::now());
            assert!(pause <= MAX_BACKOFF);
            waited += pause;
            tries.push(pause);
        }
        assert!(tries.len() <= 16, "{tries:?}");
    }

    #[tokio::test]
    async fn link_refuses_a_port_in_use() {
        let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
        let url = LinkUrl::UdpIn(taken.local_addr().unwrap().to_string(), None);
        let Err(e) = ByteLink::new(url).await else {
            panic!("bound twice")
        };
        assert!(e.0.contains("opening udpin://127.0.0.1:"), "{e}");
    }
}
