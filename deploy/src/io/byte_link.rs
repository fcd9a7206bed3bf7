//! Bytes to and from an autopilot or a sensor: UDP, TCP, serial. Waits for nothing but a connection; a broken
//! link is reopened after a pause that doubles up to a bound.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::Duration;

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr};

use crate::exit::{CliError, Doing};
use crate::io::link_url::LinkUrl;

/// First pause before a link is opened again, ns; doubles with each failure.
const INITIAL_BACKOFF_NS: i64 = 100_000_000;
/// Longest pause, ns.
const MAX_BACKOFF_NS: i64 = 2_000_000_000;
/// A TCP connection has this long to come about.
const CONNECT: Duration = Duration::from_millis(300);
/// A UDP peer that sends nothing for this long may be replaced by another, ns.
const PEER_TIMEOUT_NS: i64 = 5_000_000_000;
/// Most reads at once: a flood must not delay the set-points.
const MAX_READS: usize = 64;

/// An open end.
enum Open {
    Udp {
        socket: UdpSocket,
        /// The peer, and when it was received last, ns; fixed where we connect.
        other: Option<(SocketAddr, i64)>,
        fixed: bool,
    },
    Listening(TcpListener),
    /// TCP, and the listener that accepted it.
    Tcp(TcpStream, Option<TcpListener>),
    Serial(File),
}

/// A link to an autopilot or a sensor.
pub struct ByteLink {
    url: LinkUrl,
    open: Option<Open>,
    next_try_ns: i64,
    backoff_ns: i64,
    opened: u32,
    unsent: u64,
    last_error: Option<String>,
}

impl ByteLink {
    /// A link to `url`. What can be known to be wrong at once is refused: a port that is taken, a host
    /// that has no address; a peer that is not there yet is waited for.
    pub fn new(url: LinkUrl, now_ns: i64) -> Result<ByteLink, CliError> {
        let mut link = ByteLink {
            url,
            open: None,
            next_try_ns: now_ns,
            backoff_ns: INITIAL_BACKOFF_NS,
            opened: 0,
            unsent: 0,
            last_error: None,
        };
        match link.url {
            LinkUrl::UdpIn(_) | LinkUrl::UdpOut(_) | LinkUrl::TcpIn(_) => {
                link.open = Some(link.connect().doing(format_args!("opening {}", link.url))?);
            }
            LinkUrl::TcpOut(ref host) => {
                resolve(host).doing(format_args!("opening {}", link.url))?;
            }
            LinkUrl::Serial(_, _) => {}
        }
        Ok(link)
    }
    /// Times that the link was opened again.
    pub fn opened(&self) -> u32 {
        self.opened
    }
    /// Messages that could not be sent.
    pub fn unsent(&self) -> u64 {
        self.unsent
    }
    /// Why it could not be opened, once for each new reason.
    pub fn last_error(&mut self) -> Option<String> {
        self.last_error.take()
    }
    /// Where it listens (UDP).
    #[cfg(test)]
    fn local(&self) -> SocketAddr {
        match &self.open {
            Some(Open::Udp { socket, .. }) => socket.local_addr().unwrap(),
            Some(Open::Listening(listener)) => listener.local_addr().unwrap(),
            _ => panic!("not listening"),
        }
    }

    fn connect(&self) -> io::Result<Open> {
        match &self.url {
            LinkUrl::UdpIn(host) => {
                let socket = UdpSocket::bind(resolve(host)?)?;
                socket.set_nonblocking(true)?;
                Ok(Open::Udp {
                    socket,
                    other: None,
                    fixed: false,
                })
            }
            LinkUrl::UdpOut(host) => {
                let to = resolve(host)?;
                let any = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                let socket = UdpSocket::bind(any)?;
                socket.set_nonblocking(true)?;
                Ok(Open::Udp {
                    socket,
                    other: Some((to, 0)),
                    fixed: true,
                })
            }
            LinkUrl::TcpIn(host) => {
                let listener = TcpListener::bind(resolve(host)?)?;
                listener.set_nonblocking(true)?;
                Ok(Open::Listening(listener))
            }
            LinkUrl::TcpOut(host) => {
                let stream = TcpStream::connect_timeout(&resolve(host)?, CONNECT)?;
                stream.set_nodelay(true)?;
                stream.set_nonblocking(true)?;
                Ok(Open::Tcp(stream, None))
            }
            LinkUrl::Serial(path, baud) => serial(path, *baud).map(Open::Serial),
        }
    }

    /// Reopens what is closed, when it is due.
    fn reconnect_when_due(&mut self, now_ns: i64) {
        if self.open.is_some() || now_ns < self.next_try_ns {
            return;
        }
        match self.connect() {
            Ok(open) => {
                self.open = Some(open);
                self.opened += 1;
                self.backoff_ns = INITIAL_BACKOFF_NS;
            }
            Err(e) => self.wait(now_ns, &e),
        }
    }
    fn wait(&mut self, now_ns: i64, why: &io::Error) {
        self.last_error = Some(format!("{}: {why}; trying again", self.url));
        self.next_try_ns = now_ns + self.backoff_ns;
        self.backoff_ns = (2 * self.backoff_ns).min(MAX_BACKOFF_NS);
    }
    /// The link broke: a listener stays open, the rest is reopened.
    fn disconnect(&mut self, now_ns: i64, why: &io::Error) {
        self.open = match self.open.take() {
            Some(Open::Tcp(_, Some(listener))) => Some(Open::Listening(listener)),
            Some(Open::Udp { .. } | Open::Listening(_) | Open::Tcp(_, None) | Open::Serial(_)) | None => None,
        };
        if self.open.is_none() {
            self.wait(now_ns, why);
        }
    }

    /// Gives the bytes that arrived to `take`; true when there were some.
    pub fn read(&mut self, now_ns: i64, mut take: impl FnMut(&[u8])) -> bool {
        self.reconnect_when_due(now_ns);
        let mut any = false;
        let mut buffer = [0_u8; 2048];
        for _ in 0..MAX_READS {
            let Some(open) = &mut self.open else { break };
            let got = match open {
                Open::Udp { socket, other, fixed } => match socket.recv_from(&mut buffer) {
                    Ok((n, from)) => {
                        let free = other.is_none_or(|(_, at)| now_ns - at > PEER_TIMEOUT_NS);
                        if *fixed {
                            // An answer from elsewhere is none.
                            Ok(if other.is_some_and(|(to, _)| to == from) {
                                n
                            } else {
                                0
                            })
                        } else if free || other.is_some_and(|(to, _)| to == from) {
                            *other = Some((from, now_ns));
                            Ok(n)
                        } else {
                            Ok(0)
                        }
                    }
                    // No listener there yet (an ICMP answer to what we sent).
                    Err(e) if e.kind() == ErrorKind::ConnectionRefused => Ok(0),
                    Err(e) => Err(e),
                },
                Open::Listening(listener) => match listener.accept() {
                    Ok((stream, _)) => {
                        let ready = stream
                            .set_nonblocking(true)
                            .and_then(|()| stream.set_nodelay(true))
                            .is_ok();
                        if let (true, Some(Open::Listening(listener))) = (ready, self.open.take()) {
                            self.open = Some(Open::Tcp(stream, Some(listener)));
                            self.opened += 1;
                        }
                        continue;
                    }
                    Err(e) => Err(e),
                },
                Open::Tcp(stream, _) => ended(stream.read(&mut buffer)),
                Open::Serial(port) => ended(port.read(&mut buffer)),
            };
            match got {
                Ok(n) => {
                    take(buffer.get(..n).unwrap_or_default());
                    any = true;
                }
                Err(e) if e.kind() == ErrorKind::WouldBlock => break,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => {
                    self.disconnect(now_ns, &e);
                    break;
                }
            }
        }
        any
    }
    /// Sends one message; what cannot be sent now is lost and counted: a set-point must not be late.
    pub fn write(&mut self, now_ns: i64, bytes: &[u8]) {
        let sent = match &mut self.open {
            Some(Open::Udp { socket, other, .. }) => match other {
                Some((to, _)) => socket.send_to(bytes, *to).map(|_| ()),
                None => return,
            },
            Some(Open::Tcp(stream, _)) => stream.write_all(bytes),
            Some(Open::Serial(port)) => port.write_all(bytes),
            Some(Open::Listening(_)) | None => return,
        };
        if let Err(e) = sent {
            self.unsent += 1;
            // A full buffer or an absent peer passes; a broken stream does not.
            let harmless = matches!(
                e.kind(),
                ErrorKind::WouldBlock | ErrorKind::ConnectionRefused | ErrorKind::NetworkUnreachable
            );
            if !harmless {
                self.disconnect(now_ns, &e);
            }
        }
    }
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

fn resolve(host: &str) -> io::Result<SocketAddr> {
    host.to_socket_addrs()?
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

    /// Reads until `enough` or many turns passed: loopback delivers at once.
    fn read_at_least(link: &mut ByteLink, now_ns: i64, enough: usize) -> Vec<u8> {
        let mut all = Vec::new();
        for _ in 0..2000 {
            link.read(now_ns, |b| all.extend_from_slice(b));
            if all.len() >= enough {
                break;
            }
            crate::process::supervisor::pause(Duration::from_millis(1));
        }
        all
    }

    #[test]
    fn udp_link_answers_its_first_peer_only_until_that_falls_silent() {
        let mut link = ByteLink::new(
            "udpin://127.0.0.1:0"
                .parse()
                .unwrap_or(LinkUrl::UdpIn("127.0.0.1:0".into())),
            0,
        )
        .unwrap();
        let at = link.local();
        let (first, second) = (
            UdpSocket::bind("127.0.0.1:0").unwrap(),
            UdpSocket::bind("127.0.0.1:0").unwrap(),
        );
        for s in [&first, &second] {
            s.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
        }
        link.write(1, b"nobody there");
        first.send_to(b"one", at).unwrap();
        assert_eq!(read_at_least(&mut link, 2, 3), b"one");
        second.send_to(b"two", at).unwrap();
        first.send_to(b"three", at).unwrap();
        assert_eq!(read_at_least(&mut link, 3, 5), b"three");
        link.write(4, b"answer");
        let mut buffer = [0; 16];
        assert_eq!(first.recv(&mut buffer).unwrap(), 6);
        // The first fell silent.
        second.send_to(b"four", at).unwrap();
        assert_eq!(read_at_least(&mut link, PEER_TIMEOUT_NS + 4, 4), b"four");
    }

    #[test]
    fn serial_port_open_in_another_program() {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let line = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&line).unwrap();
        unlockpt(&line).unwrap();
        let path = ptsname(&line, Vec::new()).unwrap().into_string().unwrap();
        let first = serial(Path::new(&path), 115_200).unwrap();
        // A lock belongs to the open file, so this program opens it like another one.
        let url: LinkUrl = format!("serial://{path}:115200").parse().unwrap();
        let mut second = ByteLink::new(url, 0).unwrap();
        second.read(0, |_| {});
        let why = second.last_error().unwrap();
        assert!(why.contains("another program has this port open"), "{why}");
        assert_eq!(second.opened(), 0);
        // It is taken over once it is free; a pseudo-terminal, unlike a port, stays exclusive, which binds all but root.
        drop(first);
        if !rustix::process::geteuid().is_root() {
            return;
        }
        second.read(INITIAL_BACKOFF_NS, |_| {});
        assert_eq!((second.opened(), second.last_error()), (1, None));
    }

    #[test]
    fn tcp_link_reconnects_after_the_peer_closed() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = LinkUrl::TcpOut(listener.local_addr().unwrap().to_string());
        let mut link = ByteLink::new(url, 0).unwrap();
        let mut now_ns = 0;
        for round in 1..=3 {
            link.read(now_ns, |_| {});
            let (mut other, _) = listener.accept().unwrap();
            other.write_all(b"hello").unwrap();
            assert_eq!(read_at_least(&mut link, now_ns, 5), b"hello");
            link.write(now_ns, b"yes");
            let mut buffer = [0; 3];
            other.read_exact(&mut buffer).unwrap();
            assert_eq!((&buffer, link.opened()), (b"yes", round));
            drop(other);
            for _ in 0..2000 {
                link.read(now_ns, |_| {});
                if link.open.is_none() {
                    break;
                }
                crate::process::supervisor::pause(Duration::from_millis(1));
            }
            assert!(link.open.is_none() && link.last_error().is_some());
            now_ns += MAX_BACKOFF_NS;
        }
    }

    #[test]
    fn link_backoff_doubles_up_to_a_bound() {
        let mut link = ByteLink::new(LinkUrl::Serial("/nonexistent/tty".into(), 57600), 0).unwrap();
        let mut tries = Vec::new();
        for ms in 0..20_000 {
            link.read(ms * 1_000_000, |_| {});
            if link.last_error().is_some() {
                tries.push(ms);
            }
        }
        assert!(tries.len() <= 16, "{tries:?}");
        assert!(tries.windows(2).all(|w| w[1] - w[0] <= 2000));
    }

    #[test]
    fn link_refuses_a_port_in_use() {
        let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
        let url = LinkUrl::UdpIn(taken.local_addr().unwrap().to_string());
        let Err(e) = ByteLink::new(url, 0) else {
            panic!("bound twice")
        };
        assert!(e.0.contains("opening udpin://127.0.0.1:"), "{e}");
    }
}
