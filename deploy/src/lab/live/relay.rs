//! `alight land --relay`: plain Unix and UDP sockets carry the messages of one landing beside the
//! middlewares, and one table says what each hop took. Both ends read the steady clock of one computer.

use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use alight_shared::msg::{DeckForecast, Plan, SetPoint, VesselEstimate};
use alight_shared::time::DroneClock;
use alight_shared::topics::{self, Topic};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::Instance;
use alight_shared::transport::metrics::MetricName;
use alight_shared::transport::observe::SendObserver;
use alight_shared::transport::plain::Plain;
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::{Received, TransportError, wake};
use alight_shared::wire;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::config::RelayConfig;
use super::times::Times;
use crate::exit::{CliError, Doing};
use crate::process::snapshot::{Snapshot, time};
use crate::table::Table;
use crate::{cells, terminal};

/// The messages that are relayed in shared memory: the chain from the vessel's estimate to the
/// set-point.
const RELAYED: [&Topic; 4] = [
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
/// Largest datagram.
const LARGEST: usize = 65_000;

/// FNV-1a, what a message is known by at both ends.
fn key(parts: &[&[u8]]) -> u64 {
    parts
        .iter()
        .flat_map(|p| p.iter())
        .fold(0xcbf2_9ce4_8422_2325, |h, b| {
            (h ^ u64::from(*b)).wrapping_mul(0x0000_0100_0000_01b3)
        })
}

/// What a message in shared memory is known by.
fn key_of(name: &str, (boot, sequence): (u32, u32)) -> u64 {
    key(&[name.as_bytes(), &boot.to_le_bytes(), &sequence.to_le_bytes()])
}

enum Socket {
    Unix(UnixDatagram),
    /// And where to: the way there may not be up yet, so it is not connected.
    Udp(UdpSocket, SocketAddr),
}

/// The sending end.
struct Copier {
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
    fn unix(path: &Path) -> Result<Copier, CliError> {
        let doing = format_args!("relaying to {}", path.display());
        let socket = UnixDatagram::unbound().doing(doing)?;
        socket.set_nonblocking(true).doing(doing)?;
        socket.connect(path).doing(doing)?;
        Ok(Copier::new(Socket::Unix(socket)))
    }
    /// Copies go to the UDP address `to`.
    fn udp(to: &str) -> Result<Copier, CliError> {
        let doing = format_args!("relaying to {to}");
        let socket = UdpSocket::bind("0.0.0.0:0").doing(doing)?;
        socket.set_nonblocking(true).doing(doing)?;
        Ok(Copier::new(Socket::Udp(socket, to.parse().doing(doing)?)))
    }
    /// Sends the original by `send` and the copy `bytes`, in turns one and the other first: who wakes
    /// first takes the processor.
    fn beside(&mut self, topic: u32, key: u64, bytes: impl FnOnce() -> Option<Vec<u8>>, send: impl FnOnce()) {
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
pub struct Copies(Vec<(String, u32, Mutex<Copier>)>);

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

impl Copies {
    /// Copies of [`RELAYED`] go to the Unix socket at `path`.
    pub fn over_unix(path: &Path) -> Result<Copies, CliError> {
        let copy =
            |(topic, k): (&&Topic, u32)| Ok((topic.name.to_owned(), k, Mutex::new(Copier::unix(path)?)));
        Ok(Copies(
            RELAYED
                .iter()
                .zip(0..)
                .map(copy)
                .collect::<Result<_, CliError>>()?,
        ))
    }
    /// Copies of what is sent on the radio key `key` go to the UDP address `to`.
    pub fn over_udp(key: &str, to: &str) -> Result<Copies, CliError> {
        Ok(Copies(vec![(key.to_owned(), 0, Mutex::new(Copier::udp(to)?))]))
    }
}

/// A copy as it came.
struct ReceivedCopy<'a> {
    /// Index of its topic, as the sender has it.
    topic: u32,
    sent_ns: i64,
    before: (u64, i64),
    /// The message, encoded.
    bytes: &'a [u8],
}

/// Reads a datagram of a [`Copier`]; None when it is not one.
fn read(datagram: &[u8]) -> Option<ReceivedCopy<'_>> {
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
struct Hop {
    sent_ns: BTreeMap<u64, i64>,
    came_ns: BTreeMap<u64, i64>,
    originals: Times,
    copies: Times,
}

impl Hop {
    /// A copy was there at `at_ns`, decoded.
    fn copy(&mut self, received: &ReceivedCopy<'_>, at_ns: i64) {
        self.copies.add_ns(at_ns.saturating_sub(received.sent_ns));
        let (key, sent_ns) = received.before;
        match self.came_ns.remove(&key) {
            Some(came_ns) => self.originals.add_ns(came_ns.saturating_sub(sent_ns)),
            None => wait(&mut self.sent_ns, key, sent_ns),
        }
    }
    /// The original of the message known by `key` was there at `at_ns`.
    fn original(&mut self, key: u64, at_ns: i64) {
        match self.sent_ns.remove(&key) {
            Some(sent_ns) => self.originals.add_ns(at_ns.saturating_sub(sent_ns)),
            None => wait(&mut self.came_ns, key, at_ns),
        }
    }
    /// Median and 99th percentile, s: of the originals, of the copies.
    fn quantiles(&self) -> [[f64; 2]; 2] {
        [&self.originals, &self.copies].map(|times| [0.5, 0.99].map(|q| times.quantile(q)))
    }
}

fn wait(map: &mut BTreeMap<u64, i64>, key: u64, at_ns: i64) {
    // What waits so long has lost its other half.
    if map.len() >= WAITING {
        map.clear();
    }
    map.insert(key, at_ns);
}

/// Longest wait of a receiver without a look at whether to end.
const MAX_WAIT: Duration = Duration::from_millis(50);

type Shared<T> = Arc<Mutex<T>>;

fn lock<T>(shared: &Shared<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Median and 99th percentile over the middleware, and over UDP, s: what the bridge's process reports.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RelayReport {
    /// Of the hop over the radio.
    RadioHop([[f64; 2]; 2]),
}

/// Time between two reports, ns.
const REPORT_PERIOD_NS: i64 = 1_000_000_000;

/// The drone's end of the plain relay over UDP, in the bridge's process.
pub struct RadioHop {
    hop: Shared<Hop>,
    next_report_ns: i64,
}

impl RadioHop {
    /// Listens at the port of `address`, on every address: the drone's may come up later.
    pub fn listen(address: &str) -> Result<RadioHop, CliError> {
        let doing = format_args!("listening for the plain relay at {address}");
        let address: SocketAddr = address.parse().doing(doing)?;
        let socket = UdpSocket::bind(("0.0.0.0", address.port())).doing(doing)?;
        let hop = Shared::<Hop>::default();
        let own = Arc::clone(&hop);
        // It ends with the process.
        std::thread::spawn(move || {
            let mut buffer = vec![0_u8; LARGEST];
            while let Ok(length) = socket.recv(&mut buffer) {
                if let Some(received) = read(buffer.get(..length).unwrap_or_default()) {
                    lock(&own).copy(&received, steady_ns());
                }
            }
        });
        Ok(RadioHop {
            hop,
            next_report_ns: 0,
        })
    }
    /// A packet came by radio; the first subscription is the vessel's estimate.
    pub fn original(&self, packet: &Received) {
        if packet.subscription == 0 {
            lock(&self.hop).original(key(&[&packet.bytes]), packet.at_ns);
        }
    }
    /// Reports to the supervisor when it is time.
    pub fn report(&mut self, now_ns: i64) {
        if now_ns < self.next_report_ns {
            return;
        }
        self.next_report_ns = now_ns + REPORT_PERIOD_NS;
        let report = RelayReport::RadioHop(lock(&self.hop).quantiles());
        if let Ok(line) = serde_json::to_string(&report) {
            terminal::line(line);
        }
    }
}

/// Listens to both ways of every hop through shared memory.
pub struct Tap {
    hops: Shared<[Hop; RELAYED.len()]>,
    radio: [[f64; 2]; 2],
    end: Arc<AtomicBool>,
}

impl Drop for Tap {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
    }
}

impl Tap {
    /// Opens both ends; to be called before the processes that send start.
    pub fn open(instance: &Instance, relay: &RelayConfig) -> Result<Tap, CliError> {
        let doing = format_args!("listening at {}", relay.socket.display());
        let socket = UnixDatagram::bind(&relay.socket).doing(doing)?;
        socket.set_read_timeout(Some(MAX_WAIT)).doing(doing)?;
        let tap = Tap {
            hops: Shared::default(),
            radio: [[f64::NAN; 2]; 2],
            end: Arc::default(),
        };
        let (hops, end) = (Arc::clone(&tap.hops), Arc::clone(&tap.end));
        std::thread::spawn(move || copies(&socket, &hops, &end));
        for k in 0..RELAYED.len() {
            let (instance, hops, end) = (instance.clone(), Arc::clone(&tap.hops), Arc::clone(&tap.end));
            std::thread::spawn(move || {
                let ended = match k {
                    0 => originals::<VesselEstimate<DroneClock>>(k, &instance, &hops, &end),
                    1 => originals::<DeckForecast>(k, &instance, &hops, &end),
                    2 => originals::<Plan>(k, &instance, &hops, &end),
                    _ => originals::<SetPoint>(k, &instance, &hops, &end),
                };
                if let Err(e) = ended {
                    eprintln!("alight: the relay's end in shared memory: {e}");
                }
            });
        }
        Ok(tap)
    }
    /// Takes in what the bridge's process reported.
    pub fn observe(&mut self, lines: &[String]) {
        let reports = lines.iter().filter_map(|line| serde_json::from_str(line).ok());
        for RelayReport::RadioHop(quantiles) in reports {
            self.radio = quantiles;
        }
    }
    /// The table's rows: what the landing took, stage by stage.
    pub fn rows(&self, snapshot: &Snapshot) -> Vec<Stage> {
        let hops = lock(&self.hops).each_ref().map(Hop::quantiles);
        let step = |kind, name: &str| {
            let p = snapshot.processes.get(&kind);
            Stage::computed(name, p.map_or([f64::NAN; 2], |p| [p.step_p50_s, p.step_p99_s]))
        };
        let hop = |k: usize, name: &str| {
            let quantiles = hops.get(k).copied();
            Stage::carried(name, quantiles.unwrap_or([[f64::NAN; 2]; 2]))
        };
        let seconds = |kind, names: [MetricName; 2]| {
            let process = snapshot.processes.get(&kind);
            names.map(|name| process.map_or(f64::NAN, |p| p.seconds(name)))
        };
        let vessel = seconds(
            ProcessKind::Vessel,
            [
                MetricName::MeasurementToEstimateP50,
                MetricName::MeasurementToEstimateP99,
            ],
        );
        let all = seconds(
            ProcessKind::Pilot,
            [MetricName::VesselToSetPointP50, MetricName::VesselToSetPointP99],
        );
        let mut rows = vec![
            Stage::computed("vessel: measurement to estimate sent", vessel),
            Stage::carried("radio: zenoh | UDP socket", self.radio),
            step(ProcessKind::Bridge, "bridge: a step"),
            hop(0, "estimate: iceoryx2 | Unix socket"),
            step(ProcessKind::Predictor, "predictor: a step"),
            hop(1, "forecast: iceoryx2 | Unix socket"),
            step(ProcessKind::Planner, "planner: a step"),
            hop(2, "plan: iceoryx2 | Unix socket"),
            step(ProcessKind::Pilot, "pilot: a step"),
            hop(3, "set-point: iceoryx2 | Unix socket"),
        ];
        // On the way of the newest estimate to a set-point: radio, estimate and forecast; the plan is
        // sampled beside it.
        let gain = |q: usize| -> f64 {
            let on_the_way = rows.iter().enumerate().filter(|(k, _)| [1, 3, 5].contains(k));
            on_the_way
                .filter_map(|(_, s)| Some(s.plain_s?.get(q)? - s.middleware_s.get(q)?))
                .sum()
        };
        let whole = [all, [all[0] + gain(0), all[1] + gain(1)]];
        rows.push(Stage::carried(
            "whole: measurement on the vessel to set-point",
            whole,
        ));
        rows
    }
}

fn copies(socket: &UnixDatagram, hops: &Shared<[Hop; RELAYED.len()]>, end: &AtomicBool) {
    let mut buffer = vec![0_u8; LARGEST];
    while !end.load(Ordering::Relaxed) {
        let Ok(length) = socket.recv(&mut buffer) else {
            continue;
        };
        let Some(received) = read(buffer.get(..length).unwrap_or_default()) else {
            continue;
        };
        let decoded = match received.topic {
            0 => decodes::<VesselEstimate<DroneClock>>(received.bytes),
            1 => decodes::<DeckForecast>(received.bytes),
            2 => decodes::<Plan>(received.bytes),
            _ => decodes::<SetPoint>(received.bytes),
        };
        if let (true, Some(hop)) = (decoded, lock(hops).get_mut(received.topic as usize)) {
            hop.copy(&received, steady_ns());
        }
    }
}

/// To decode is part of a plain relay's way.
fn decodes<T: DeserializeOwned>(bytes: &[u8]) -> bool {
    std::hint::black_box(wire::decode_record::<T>(bytes)).is_ok()
}

fn originals<T: Plain>(
    k: usize,
    instance: &Instance,
    hops: &Shared<[Hop; RELAYED.len()]>,
    end: &AtomicBool,
) -> Result<(), TransportError> {
    wake::follow(instance, "relay", MAX_WAIT, |came: Vec<T>| {
        let at_ns = steady_ns();
        if let Some(hop) = lock(hops).get_mut(k) {
            for order in came.iter().filter_map(Plain::order) {
                hop.original(key_of(T::TOPIC.name, order), at_ns);
            }
        }
        !end.load(Ordering::Relaxed)
    })
}

/// One line of the table: median and 99th percentile, s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// What.
    pub stage: String,
    /// With the middleware; of a computation: what it takes.
    pub middleware_s: [f64; 2],
    /// With a plain socket.
    pub plain_s: Option<[f64; 2]>,
}

impl Stage {
    fn computed(name: &str, takes_s: [f64; 2]) -> Stage {
        Stage {
            stage: name.into(),
            middleware_s: takes_s,
            plain_s: None,
        }
    }
    fn carried(name: &str, [middleware_s, plain_s]: [[f64; 2]; 2]) -> Stage {
        Stage {
            stage: name.into(),
            middleware_s,
            plain_s: Some(plain_s),
        }
    }
}

/// The table in words; nothing without a relay.
pub fn text(stages: &[Stage]) -> String {
    let mut table = Table::new(1.., ["stage", "p50", "p99", "plain p50", "p99"]);
    for s in stages {
        let [a, b] = s.middleware_s.map(time);
        let [c, d] = s.plain_s.map_or_else(Default::default, |p| p.map(time));
        table.row(cells![s.stage, a, b, c, d]);
    }
    if table.is_empty() {
        String::new()
    } else {
        table.text()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relayed_copies_in_either_order() {
        let directory = std::env::temp_dir().join(format!("alight-relay-test-{}", std::process::id()));
        std::fs::create_dir_all(&directory).unwrap();
        let path = directory.join("relay");
        let to = UnixDatagram::bind(&path).unwrap();
        let mut copier = Copier::unix(&path).unwrap();
        let mut hop = Hop::default();
        let mut buffer = [0_u8; LARGEST];
        for k in 0..10_u32 {
            let key = key_of(topics::PLAN.name, (7, k));
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
        assert_eq!([hop.originals.count, hop.copies.count], [9, 10]);
        let [[a, b], [c, d]] = hop.quantiles();
        assert!(a > 0.0 && b >= a && c > 0.0 && d >= c && d < 10.0);
        assert!(read(&[0; 39]).is_none());
        std::fs::remove_dir_all(directory).unwrap();
    }
}
