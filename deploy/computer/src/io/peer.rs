//! Whose datagrams a UDP link takes: one sender's at a time. Who comes first, where the link listens, is asked to speak the
//! right language and, where one is named, to be at the right address; another takes its place only after a silence.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;
use tracing::warn;

/// A peer that sends nothing for this long may be replaced by another.
pub const PEER_TIMEOUT: Duration = Duration::from_secs(5);
/// Most senders that are named as left out.
const MAX_NAMED: usize = 8;

/// Whether a datagram may make its sender the peer.
pub type Speaks = Arc<dyn Fn(&[u8]) -> bool + Send + Sync>;

/// The peer of a UDP link.
pub struct Peer {
    /// And when it was received last.
    now: Option<(SocketAddr, Instant)>,
    /// Whom we send to.
    fixed: bool,
    /// The only address that is listened to.
    from: Option<IpAddr>,
    speaks: Option<Speaks>,
    foreign: u64,
    newest: Option<SocketAddr>,
    named: Vec<SocketAddr>,
}

impl Peer {
    /// The one that we send to, and nobody else.
    pub fn fixed(to: SocketAddr) -> Peer {
        Peer {
            now: Some((to, Instant::now())),
            fixed: true,
            ..Peer::listening(None, None)
        }
    }
    /// Nobody yet: the first at the address `from` that `speaks`.
    pub fn listening(from: Option<IpAddr>, speaks: Option<Speaks>) -> Peer {
        Peer {
            now: None,
            fixed: false,
            from,
            speaks,
            foreign: 0,
            newest: None,
            named: Vec::new(),
        }
    }
    /// Whom to answer.
    pub fn address(&self) -> Option<SocketAddr> {
        self.now.map(|(address, _)| address)
    }
    /// Datagrams of others.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }
    /// The newest sender of such.
    pub fn newest_stranger(&self) -> Option<SocketAddr> {
        self.newest
    }
    /// Whether a datagram from `sender` that arrives at `now` counts.
    pub fn takes(&mut self, now: Instant, sender: SocketAddr, datagram: &[u8]) -> bool {
        let known = self.address() == Some(sender);
        if known {
            if !self.fixed {
                self.now = Some((sender, now));
            }
            return true;
        }
        let silent = |(_, at): (SocketAddr, Instant)| now.duration_since(at) > PEER_TIMEOUT;
        let free = !self.fixed && self.now.is_none_or(silent);
        let may = self.from.is_none_or(|from| from == sender.ip().to_canonical())
            && self.speaks.as_ref().is_none_or(|speaks| speaks(datagram));
        if free && may {
            self.now = Some((sender, now));
            return true;
        }
        self.foreign = self.foreign.saturating_add(1);
        self.newest = Some(sender);
        if self.named.len() < MAX_NAMED && !self.named.contains(&sender) {
            self.named.push(sender);
            match self.address() {
                Some(peer) => warn!("datagrams of {sender} are left out: {peer} is listened to"),
                None => warn!("datagrams of {sender} are left out: it is not the one that is listened for"),
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    #[test]
    fn first_datagram_of_a_stranger() {
        let speaks: Speaks = Arc::new(|datagram| datagram.starts_with(b"autopilot"));
        let mut peer = Peer::listening(Some([10, 0, 0, 7].into()), Some(speaks));
        let now = Instant::now();
        let (own, other) = (at("10.0.0.7:14580"), at("10.0.0.8:14580"));
        assert!(!peer.takes(now, other, b"autopilot"), "of another computer");
        assert!(!peer.takes(now, own, b"scan"), "not an autopilot");
        assert_eq!((peer.address(), peer.foreign()), (None, 2));
        assert!(peer.takes(now, own, b"autopilot"));
        assert!(peer.takes(now, own, b"whatever it sends then"));
        // Another program of the same computer, before and after a silence.
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
        let mut peer = Peer::fixed(at("10.0.0.7:14580"));
        let later = Instant::now() + 10 * PEER_TIMEOUT;
        assert!(!peer.takes(later, at("10.0.0.8:14580"), b"autopilot"));
        assert!(peer.takes(later, at("10.0.0.7:14580"), b"autopilot"));
    }
}
