//! A plain relay beside the middlewares: the very messages once more through a datagram socket, to
//! compare on one run what a hop costs. For trials; both ends read the steady clock of one computer.

use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::topics::{self, Topic};
use crate::transport::TransportError;
use crate::transport::clock::steady_ns;
use crate::transport::observe::{SendObserver, observe};

/// The messages that are relayed in shared memory: the chain from the vessel's estimate to the
/// set-point.
pub const RELAYED: [&Topic; 4] = [
    &topics::BRIDGE_ESTIMATE,
    &topics::FORECAST,
    &topics::PLAN,
    &topics::SET_POINT,
];

/// Bytes before the message: topic, key, when the copy was sent, key of the message before, when the
/// original of that was sent.
const HEAD: usize = 40;
/// Messages that wait for their other half at most.
const WAITING: usize = 1024;
/// Times that are kept at most.
const MAX_TIMES: usize = 500_000;
/// Largest datagram.
pub const LARGEST: usize = 65_000;

/// FNV-1a, what a message is known by at both ends.
pub fn key(parts: &[&[u8]]) -> u64 {
    parts
        .iter()
        .flat_map(|p| p.iter())
        .fold(0xcbf2_9ce4_8422_2325, |h, b| {
            (h ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3)
        })
}

/// What a message in shared memory is known by.
pub fn key_in_memory(topic: &Topic, order: (u32, u32)) -> u64 {
    key_of(topic.name, order)
}
fn key_of(name: &str, (boot, sequence): (u32, u32)) -> u64 {
    key(&[name.as_bytes(), &boot.to_le_bytes(), &sequence.to_le_bytes()])
}

enum Socket {
    Unix(UnixDatagram),
    /// And where to: the way there may not be up yet, so it is not connected.
    Udp(UdpSocket, SocketAddr),
}

/// The sending end.
pub struct Copier {
    socket: Socket,
    before: (u64, i64),
    plain_first: bool,
}

impl Copier {
    fn new(socket: Socket) -> Copier {
        Copier {
            socket,
            before: (0, 0),
            plain_first: false,
        }
    }
    /// Copies go to the Unix datagram socket at `path`.
    pub fn unix(path: &Path) -> Result<Copier, TransportError> {
        let fail = |e| TransportError::because(format!("relaying to {}", path.display()), e);
        let socket = UnixDatagram::unbound().map_err(fail)?;
        socket.set_nonblocking(true).map_err(fail)?;
        socket.connect(path).map_err(fail)?;
        Ok(Copier::new(Socket::Unix(socket)))
    }
    /// Copies go to the UDP address `to`.
    pub fn udp(to: &str) -> Result<Copier, TransportError> {
        let fail = |e| TransportError::because(format!("relaying to {to}"), e);
        let socket = UdpSocket::bind("0.0.0.0:0").map_err(fail)?;
        socket.set_nonblocking(true).map_err(fail)?;
        let to = to
            .parse()
            .map_err(|e| TransportError::because(format!("relaying to {to}"), e))?;
        Ok(Copier::new(Socket::Udp(socket, to)))
    }
    /// Sends the original by `send` and the copy `bytes`, in turns one and the other first: who wakes
    /// first takes the processor.
    pub fn beside(
        &mut self,
        topic: u32,
        key: u64,
        bytes: impl FnOnce() -> Option<Vec<u8>>,
        send: impl FnOnce(),
    ) {
        self.plain_first = !self.plain_first;
        if self.plain_first {
            self.copy(topic, key, bytes);
            self.before = (key, steady_ns());
            send();
        } else {
            let at_ns = steady_ns();
            send();
            self.copy(topic, key, bytes);
            self.before = (key, at_ns);
        }
    }
    /// To encode is part of a plain relay's way.
    fn copy(&mut self, topic: u32, key: u64, bytes: impl FnOnce() -> Option<Vec<u8>>) {
        let at_ns = steady_ns();
        let Some(bytes) = bytes() else { return };
        let mut datagram = Vec::with_capacity(HEAD + bytes.len());
        datagram.extend(u64::from(topic).to_le_bytes());
        datagram.extend(key.to_le_bytes());
        datagram.extend(at_ns.to_le_bytes());
        datagram.extend(self.before.0.to_le_bytes());
        datagram.extend(self.before.1.to_le_bytes());
        datagram.extend(bytes);
        // A copy that does not go out is one that did not come.
        let _lost = match &self.socket {
            Socket::Unix(s) => s.send(&datagram),
            Socket::Udp(s, to) => s.send_to(&datagram, to),
        };
    }
}

/// Who is copied: topic or radio key, its index, where to.
struct Copies(Vec<(String, u32, Mutex<Copier>)>);

impl SendObserver for Copies {
    fn around(
        &self,
        name: &str,
        order: Option<(u32, u32)>,
        bytes: &dyn Fn() -> Option<Vec<u8>>,
        send: &mut dyn FnMut(),
    ) {
        let Some((_, topic, copier)) = self.0.iter().find(|(copied, ..)| copied == name) else {
            return send();
        };
        let key = match order {
            Some(order) => key_of(name, order),
            None => bytes().map_or(0, |b| key(&[&b])),
        };
        let mut copier = copier.lock().unwrap_or_else(PoisonError::into_inner);
        copier.beside(*topic, key, bytes, send);
    }
}

/// Copies of [`RELAYED`] go to the Unix socket at `path`, too; before publishers are made.
pub fn observe_memory(path: &Path) -> Result<(), TransportError> {
    let copies: Result<_, TransportError> = RELAYED
        .iter()
        .zip(0..)
        .map(|(topic, k)| Ok((topic.name.to_owned(), k, Mutex::new(Copier::unix(path)?))))
        .collect();
    observe(Box::new(Copies(copies?)));
    Ok(())
}
/// Copies of what is sent on the radio key `key` go to the UDP address `to`, too; before the radio is opened.
pub fn observe_radio(key: &str, to: &str) -> Result<(), TransportError> {
    let copier = Mutex::new(Copier::udp(to)?);
    observe(Box::new(Copies(vec![(key.to_owned(), 0, copier)])));
    Ok(())
}

/// A copy as it came.
pub struct ReceivedCopy<'a> {
    /// Index of its topic, as the sender has it.
    pub topic: u32,
    sent_ns: i64,
    before: (u64, i64),
    /// The message, encoded.
    pub bytes: &'a [u8],
}

/// Reads a datagram of a [`Copier`]; None when it is not one.
pub fn read(datagram: &[u8]) -> Option<ReceivedCopy<'_>> {
    let word = |k: usize| {
        let part = datagram.get(8 * k..8 * k + 8)?;
        part.try_into().ok().map(u64::from_le_bytes)
    };
    Some(ReceivedCopy {
        topic: u32::try_from(word(0)?).ok()?,
        sent_ns: word(2)?.cast_signed(),
        before: (word(3)?, word(4)?.cast_signed()),
        bytes: datagram.get(HEAD..)?,
    })
}

/// The receiving end of one hop: how long originals and copies took.
#[derive(Clone, Debug, Default)]
pub struct Hop {
    sent_ns: BTreeMap<u64, i64>,
    came_ns: BTreeMap<u64, i64>,
    original_s: Vec<f64>,
    plain_s: Vec<f64>,
}

fn keep(times: &mut Vec<f64>, ns: i64) {
    if times.len() < MAX_TIMES && ns >= 0 {
        times.push(ns as f64 * 1e-9);
    }
}

impl Hop {
    /// A copy was there at `at_ns`, decoded.
    pub fn copy(&mut self, received: &ReceivedCopy<'_>, at_ns: i64) {
        keep(&mut self.plain_s, at_ns.saturating_sub(received.sent_ns));
        let (key, sent_ns) = received.before;
        match self.came_ns.remove(&key) {
            Some(came_ns) => keep(&mut self.original_s, came_ns.saturating_sub(sent_ns)),
            None => wait(&mut self.sent_ns, key, sent_ns),
        }
    }
    /// The original of the message known by `key` was there at `at_ns`.
    pub fn original(&mut self, key: u64, at_ns: i64) {
        match self.sent_ns.remove(&key) {
            Some(sent_ns) => keep(&mut self.original_s, at_ns.saturating_sub(sent_ns)),
            None => wait(&mut self.came_ns, key, at_ns),
        }
    }
    /// Median and 99th percentile, s: of the originals, of the copies.
    pub fn quantiles(&self) -> [[f64; 2]; 2] {
        [&self.original_s, &self.plain_s].map(|times| {
            let mut sorted = times.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            [0.5, 0.99].map(|q| {
                let rank = ((q * sorted.len() as f64).ceil() as usize).max(1) - 1;
                sorted.get(rank).copied().unwrap_or(f64::NAN)
            })
        })
    }
    /// Originals and copies that were timed.
    pub fn counts(&self) -> [usize; 2] {
        [self.original_s.len(), self.plain_s.len()]
    }
}

fn wait(map: &mut BTreeMap<u64, i64>, key: u64, at_ns: i64) {
    // What waits so long has lost its other half.
    if map.len() >= WAITING {
        map.clear();
    }
    map.insert(key, at_ns);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hop_matches_originals_and_copies_in_either_order() {
        let directory = std::env::temp_dir().join(format!("alight-relay-test-{}", std::process::id()));
        std::fs::create_dir_all(&directory).unwrap();
        let path = directory.join("relay");
        let to = UnixDatagram::bind(&path).unwrap();
        let mut copier = Copier::unix(&path).unwrap();
        let mut hop = Hop::default();
        let mut buffer = [0_u8; LARGEST];
        for k in 0..10_u32 {
            let key = key_in_memory(&topics::PLAN, (7, k));
            let mut sent = false;
            copier.beside(2, key, || Some(vec![9; 700]), || sent = true);
            assert!(sent);
            let mut copy = |hop: &mut Hop| {
                let n = to.recv(&mut buffer).unwrap();
                let received = read(&buffer[..n]).unwrap();
                assert_eq!((received.topic, received.bytes.len()), (2, 700));
                hop.copy(&received, steady_ns());
            };
            if k % 2 == 0 {
                copy(&mut hop);
                hop.original(key, steady_ns());
            } else {
                hop.original(key, steady_ns());
                copy(&mut hop);
            }
        }
        // Of the last original it is not known yet when it was sent.
        assert_eq!(hop.counts(), [9, 10]);
        let [[a, b], [c, d]] = hop.quantiles();
        assert!(a > 0.0 && b >= a && c > 0.0 && d >= c && d < 10.0);
        assert!(read(&[0; 39]).is_none());
        std::fs::remove_dir_all(directory).unwrap();
    }
}
