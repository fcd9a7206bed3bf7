//! Peer of a UDP link, which accepts datagrams of one sender at a time. On a listening link the peer is the first
//! sender of valid messages from the permitted address; another sender replaces it only after a silence. A single
//! sender may use a new port for each datagram; its ports do not recur, whereas the ports of two senders do.

use std::{
    net::{IpAddr, SocketAddr},
    sync::Arc,
    time::Duration,
};

use tokio::time::Instant;
use tracing::{info, warn};

/// Silence after which another sender may replace the peer.
pub const PEER_TIMEOUT: Duration = Duration::from_secs(5);
const MAX_NAMED: usize = 8;

/// Number of consecutive new ports of one address, without recurrence, that identifies a single sender.
const NEW_PORTS: usize = 4;
/// Number of remembered ports per address; more programs on one computer, each with its own port, look like one
/// sender.
const MAX_PORTS: usize = 8;

/// Whether a datagram may make its sender the peer.
pub type Speaks = Arc<dyn Fn(&[u8]) -> bool + Send + Sync>;

pub struct LinkPeer {
    /// Present peer, and the time of its newest datagram.
    now: Option<(SocketAddr, Instant)>,
    fixed: bool,
    from: Option<IpAddr>,
    speaks: Option<Speaks>,
    foreign: u64,
    newest: Option<SocketAddr>,
    named: Vec<SocketAddr>,
    ports: Ports,
}

#[derive(Default)]
struct Ports {
    /// Recent ports, the newest last.
    known: Vec<u16>,
    new: usize,
    left_out: u64,
}

impl Ports {
    fn sends(&mut self, port: u16) {
        if self.known.last() == Some(&port) {
            return;
        }
        let count = self.known.len();
        self.known.retain(|p| *p != port);
        if self.known.len() < count {
            self.new = 0;
            self.left_out = 0;
        } else {
            self.new = self.new.saturating_add(1);
            self.known.drain(..count.saturating_sub(MAX_PORTS - 1));
        }
        self.known.push(port);
    }
    /// Whether these are the ports of one sender that changes its port.
    fn change(&self) -> bool {
        self.new >= NEW_PORTS
    }
}

impl LinkPeer {
    pub fn fixed(to: SocketAddr) -> LinkPeer {
        LinkPeer {
            now: Some((to, Instant::now())),
            fixed: true,
            ..LinkPeer::listening(None, None)
        }
    }
    /// Waits for the first sender at the address `from` that `speaks` accepts.
    pub fn listening(from: Option<IpAddr>, speaks: Option<Speaks>) -> LinkPeer {
        LinkPeer {
            now: None,
            fixed: false,
            from,
            speaks,
            foreign: 0,
            newest: None,
            named: Vec::new(),
            ports: Ports::default(),
        }
    }
    pub fn address(&self) -> Option<SocketAddr> {
        self.now.map(|(address, _)| address)
    }
    pub fn foreign(&self) -> u64 {
        self.foreign
    }
    pub fn newest_foreign(&self) -> Option<SocketAddr> {
        self.newest
    }
    pub fn takes(&mut self, now: Instant, sender: SocketAddr, datagram: &[u8]) -> bool {
        let known = self.address() == Some(sender);
        if self.fixed && known {
            return true;
        }
        let is_same = self.address().is_some_and(|peer| peer.ip() == sender.ip());
        let may = known || self.may(sender, datagram);
        let is_own = is_same && !self.fixed && self.is_own(sender, may);
        let silent = |(_, at): (SocketAddr, Instant)| now.duration_since(at) > PEER_TIMEOUT;
        let free = !self.fixed && self.now.is_none_or(silent);
        if may && (known || is_own || free) {
            if !is_same {
                self.ports = Ports::default();
                self.ports.sends(sender.port());
            }
            self.now = Some((sender, now));
            return true;
        }
        if is_own {
            return true;
        }
        self.ports.left_out = self.ports.left_out.saturating_add(u64::from(may && is_same));
        self.foreign = self.foreign.saturating_add(1);
        self.newest = Some(sender);
        if self.named.len() < MAX_NAMED && !self.named.contains(&sender) {
            self.named.push(sender);
            match self.address() {
                Some(peer) => warn!("datagrams from {sender} are ignored: the link's peer is {peer}"),
                None => warn!("datagrams from {sender} are ignored: it is not the expected sender"),
            }
        }
        false
    }
    fn may(&self, sender: SocketAddr, datagram: &[u8]) -> bool {
        self.from.is_none_or(|from| from == sender.ip().to_canonical())
            && self.speaks.as_ref().is_none_or(|speaks| speaks(datagram))
    }
    /// Whether a sender at the peer's address is the peer on a new port. Such a sender may send any kind of message.
    fn is_own(&mut self, sender: SocketAddr, may: bool) -> bool {
        let before = self.ports.change();
        if may {
            self.ports.sends(sender.port());
        }
        let is_own = self.ports.change();
        if is_own && !before {
            info!(
                "{} sends from a new port each time: it is one sender",
                sender.ip()
            );
            let left_out = core::mem::take(&mut self.ports.left_out);
            self.foreign = self.foreign.saturating_sub(left_out);
            self.newest = self.newest.filter(|other| other.ip() != sender.ip());
        }
        is_own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    #[test]
    fn first_datagram_of_another_sender() {
        let speaks: Speaks = Arc::new(|datagram| datagram.starts_with(b"autopilot"));
        let mut peer = LinkPeer::listening(Some([10, 0, 0, 7].into()), Some(speaks));
        let now = Instant::now();
        let own = at("10.0.0.7:14580");
        let other = at("10.0.0.8:14580");
        assert!(!peer.takes(now, other, b"autopilot"), "of another computer");
        assert!(!peer.takes(now, own, b"scan"), "not an autopilot");
        assert_eq!((peer.address(), peer.foreign()), (None, 2));
        assert!(peer.takes(now, own, b"autopilot"));
        assert!(peer.takes(now, own, b"whatever it sends then"));
        let second = at("10.0.0.7:5000");
        let later = now + Duration::from_secs(4);
        assert!(!peer.takes(later, second, b"autopilot"));
        let later = now + PEER_TIMEOUT + Duration::from_millis(1);
        assert!(!peer.takes(later, second, b"scan") && peer.address() == Some(own));
        assert!(peer.takes(later, second, b"autopilot"));
        assert_eq!((peer.address(), peer.foreign()), (Some(second), 4));
    }

    #[test]
    fn peer_that_we_send_to() {
        let mut peer = LinkPeer::fixed(at("10.0.0.7:14580"));
        let later = Instant::now() + 10 * PEER_TIMEOUT;
        assert!(!peer.takes(later, at("10.0.0.8:14580"), b"autopilot"));
        assert!(peer.takes(later, at("10.0.0.7:14580"), b"autopilot"));
    }

    /// Acceptance of each datagram from these ports of one address, sent 100 ms apart, and the final peer.
    fn taken(ports: impl IntoIterator<Item = u16>) -> (Vec<bool>, LinkPeer) {
        let speaks: Speaks = Arc::new(|datagram| datagram.starts_with(b"$GP"));
        let mut peer = LinkPeer::listening(None, Some(speaks));
        let mut now = Instant::now();
        let mut takes = |port: u16| {
            now += Duration::from_millis(100);
            peer.takes(now, SocketAddr::from(([10_u8, 0, 0, 7], port)), b"$GPGGA")
        };
        let all = ports.into_iter().map(&mut takes).collect();
        (all, peer)
    }

    #[test]
    fn sender_with_a_new_port_for_each_datagram() {
        let (taken_all, mut peer) = taken(40_000..40_100);
        let left_out = taken_all.iter().filter(|taken| !**taken).count();
        assert_eq!((left_out, taken_all.last()), (NEW_PORTS - 2, Some(&true)));
        assert_eq!((peer.foreign(), peer.newest_foreign()), (0, None));
        let now = Instant::now();
        assert!(!peer.takes(now, at("10.0.0.8:5000"), b"$GPGGA") && peer.foreign() == 1);
        let (taken_all, peer) = taken((0..60).map(|k| 40_000 + k / 3));
        let left_out = taken_all.iter().filter(|taken| !**taken).count();
        assert_eq!((left_out, peer.foreign()), (3 * (NEW_PORTS - 2), 0));
    }

    #[test]
    fn senders_with_a_port_each() {
        for senders in 2..NEW_PORTS as u16 {
            let (taken, peer) = taken((0..100).map(|k| 40_000 + k % senders));
            let of_first = taken
                .iter()
                .enumerate()
                .all(|(k, taken)| *taken == (k as u16).is_multiple_of(senders));
            assert!(of_first, "{senders}: {taken:?}");
            assert_eq!(peer.address().map(|a| a.port()), Some(40_000));
        }
        for senders in NEW_PORTS as u16..=MAX_PORTS as u16 {
            let (taken, _) = taken((0..800).map(|k| 40_000 + k % senders));
            let later: Vec<bool> = taken.into_iter().skip(usize::from(2 * senders)).collect();
            let count = later.iter().filter(|taken| **taken).count();
            assert_eq!(count, later.len() / usize::from(senders), "{senders}");
        }
    }
}
