//! Byte link to an autopilot or a sensor: UDP, TCP, serial, and lines of a boat's bus, on tokio. A separate
//! task reopens a broken link, so neither a name lookup nor a silent peer delays readers and writers.

use std::{
    io::{self, ErrorKind},
    net::SocketAddr,
    time::Duration,
};

use alight_transport::readiness::watched;
use tokio::{
    task::JoinHandle,
    time::{Instant, sleep_until},
};

use crate::{
    config::link_url::LinkUrl,
    exit::{CliError, Doing},
    io::{
        link_end::{BOTH, LinkReceived, Open, open, resolve},
        peer::Speaks,
    },
};

/// Delay before a link is first reopened; doubles with each failure.
const INITIAL_BACKOFF: Duration = Duration::from_millis(100);
const MAX_BACKOFF: Duration = Duration::from_secs(2);
/// Maximum number of consecutive reads: a flood must not delay the set-points.
const MAX_READS: usize = 16;
/// Maximum length of a datagram, or of one read from a stream, bytes.
const MAX_READ_BYTES: usize = 2048;
pub const MAX_AT_ONCE: usize = MAX_READS * MAX_READ_BYTES;

pub struct ByteLink {
    url: LinkUrl,
    speaks: Option<Speaks>,
    open: Option<Open>,
    opening: Option<JoinHandle<io::Result<Open>>>,
    next_try: Instant,
    backoff: Duration,
    opened: u32,
    unsent: u64,
    /// Rest of a partly sent message, which is sent before anything else.
    rest: Vec<u8>,
    last_error: Option<String>,
}

enum Event {
    Received(io::Result<LinkReceived>),
    Drained(io::Result<usize>),
}

impl ByteLink {
    #[cfg(test)]
    pub async fn new(url: LinkUrl) -> Result<ByteLink, CliError> {
        ByteLink::with_peer(url, None).await
    }
    /// Link to `url`; over UDP its peer is the first sender accepted by `speaks`. An occupied port or an unknown host
    /// is an error; an absent peer is not.
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
        Ok(ByteLink::begun(url, speaks, open))
    }
    /// One of several links: an unknown host name is not an error but is looked up again until it resolves, so that
    /// the other links continue.
    pub async fn of_several(url: LinkUrl, speaks: Option<Speaks>) -> Result<ByteLink, CliError> {
        match &url {
            LinkUrl::UdpOut(_) | LinkUrl::TcpOut(_) | LinkUrl::SignalK(..) => {
                Ok(ByteLink::begun(url, speaks, None))
            }
            LinkUrl::UdpIn(..) | LinkUrl::TcpIn(..) | LinkUrl::Serial(..) | LinkUrl::Can(_) => {
                ByteLink::with_peer(url, speaks).await
            }
        }
    }
    fn begun(url: LinkUrl, speaks: Option<Speaks>, open: Option<Open>) -> ByteLink {
        ByteLink {
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
        }
    }
    /// Whether sent data reach a receiver, as far as the system knows.
    pub fn is_open(&self) -> bool {
        match &self.open {
            Some(Open::Udp { .. } | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(..)) => {
                true
            }
            Some(Open::Listening(_)) | None => false,
        }
    }
    pub fn opened(&self) -> u32 {
        self.opened
    }
    /// Number of dropped datagrams from foreign senders.
    pub fn foreign(&self) -> u64 {
        match &self.open {
            Some(Open::Udp { peer, .. }) => peer.foreign(),
            Some(Open::Listening(_) | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(..))
            | None => 0,
        }
    }
    /// Number of dropped datagrams, and the newest sender; None if none was dropped.
    pub fn foreign_senders(&self) -> Option<(u64, SocketAddr)> {
        match &self.open {
            Some(Open::Udp { peer, .. }) => Some((peer.foreign(), peer.newest_foreign()?)),
            Some(Open::Listening(_) | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(..))
            | None => None,
        }
    }
    pub fn unsent(&self) -> u64 {
        self.unsent
    }
    /// New reason why the link could not be opened; each reason is returned once.
    pub fn last_error(&mut self) -> Option<String> {
        self.last_error.take()
    }

    /// Waits for bytes and passes all of them to `take`. Also returns, without bytes, after a connection, an end of
    /// stream or a failure. Cancelling the wait loses nothing.
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
    /// Handles an event of the link, passing the peer's bytes to `take`. Returns whether to continue reading.
    fn received(
        &mut self,
        received: io::Result<LinkReceived>,
        buffer: &[u8],
        take: &mut impl FnMut(&[u8]),
    ) -> bool {
        match received {
            Ok(LinkReceived::Bytes(n, from)) => {
                // A link that breaks as soon as it opens counts as a failure to open.
                self.backoff = INITIAL_BACKOFF;
                let bytes = buffer.get(..n).unwrap_or_default();
                if from.is_none_or(|from| self.is_from_peer(from, bytes)) {
                    take(bytes);
                }
                true
            }
            Ok(LinkReceived::Peer(stream)) => {
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
            Ok(LinkReceived::Foreign(by)) => {
                self.last_error = Some(format!("{}: a connection from {by} is rejected", self.url));
                false
            }
            // ICMP reply to sent data while nothing listens at the destination.
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
            Some(Open::Listening(_) | Open::Tcp(..) | Open::Serial(_) | Open::Can(..) | Open::Lines(..))
            | None => true,
        }
    }

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
            }
            Err(e) => self.wait(&e),
        }
    }
    fn wait(&mut self, why: &io::Error) {
        self.last_error = Some(format!("{}: {why}; trying again", self.url));
        self.next_try = Instant::now() + self.backoff;
        self.backoff = (2 * self.backoff).min(MAX_BACKOFF);
    }
    /// Handles a broken link: a listener stays open, any other link is reopened.
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
                | Open::Lines(..),
            )
            | None => None,
        };
        if self.open.is_none() {
            self.wait(why);
        }
    }

    /// Sends one message in full or not at all. If the line cannot accept it now, it is dropped and counted, because
    /// a late set-point is worse than none. The rest of a partly sent message goes first.
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
    /// Number of bytes that the line accepts now: all if there is no peer, none if the line is full.
    fn put(&self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.open.as_ref().and_then(|open| open.write_now(bytes));
        written.unwrap_or(Ok(bytes.len()))
    }
    /// A full buffer or an absent peer is temporary; a broken stream is not.
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

#[cfg(test)]
mod tests;
