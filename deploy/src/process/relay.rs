//! `alight land --relay`: plain Unix and UDP sockets carry the messages of one landing beside the
//! middlewares, and one table says what each hop took.

use core::ops::ControlFlow;
use std::net::UdpSocket;
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use alight_shared::msg::{DeckForecast, Plan, SetPoint, VesselEstimate};
use alight_shared::time::DroneClock;
use alight_shared::transport::TransportError;
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Instance, Memory, Subscriber};
use alight_shared::transport::plain::Plain;
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::relay::{Hop, LARGEST, RELAYED, key_in_memory, read};
use alight_shared::transport::wake;
use alight_shared::wire;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::exit::CliError;
use crate::process::metrics::VESSEL_FIGURES;
use crate::process::snapshot::{Snapshot, time};

/// Longest wait of a receiver without a look at whether to end.
const MAX_WAIT: Duration = Duration::from_millis(50);

/// Where the drone's ends of the plain relays are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DroneRelay {
    /// Where the vessel's copies come in, over UDP.
    pub port: u16,
    /// The Unix socket that takes the copies of what goes through shared memory.
    pub socket: PathBuf,
}

type Shared<T> = Arc<Mutex<T>>;

fn lock<T>(shared: &Shared<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The drone's end of the plain relay over UDP, in the bridge's process.
pub struct RadioRelay {
    hop: Shared<Hop>,
}

impl RadioRelay {
    /// Listens at `port`, on every address: the drone's may come up later.
    pub fn listen(port: u16) -> Result<RadioRelay, CliError> {
        let fail = |e| CliError::because(format!("listening for the plain relay on port {port}"), e);
        let socket = UdpSocket::bind(("0.0.0.0", port)).map_err(fail)?;
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
        Ok(RadioRelay { hop })
    }
    /// The original with this key came at `at_ns`.
    pub fn original(&self, key: u64, at_ns: i64) {
        lock(&self.hop).original(key, at_ns);
    }
    /// Median and 99th percentile over the middleware, and over UDP, s.
    pub fn figures(&self) -> [f64; 4] {
        let [[a, b], [c, d]] = lock(&self.hop).quantiles();
        [a, b, c, d]
    }
}

/// Listens to both ways of every hop through shared memory.
pub struct Tap {
    hops: Shared<[Hop; RELAYED.len()]>,
    end: Arc<AtomicBool>,
}

impl Drop for Tap {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
    }
}

impl Tap {
    /// Opens both ends; to be called before the processes that send start.
    pub fn open(instance: &Instance, relay: &DroneRelay) -> Result<Tap, CliError> {
        let fail = |e| CliError::because(format!("listening at {}", relay.socket.display()), e);
        let socket = UnixDatagram::bind(&relay.socket).map_err(fail)?;
        socket.set_read_timeout(Some(MAX_WAIT)).map_err(fail)?;
        let tap = Tap {
            hops: Shared::default(),
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
    /// The table's rows: what the landing took, stage by stage.
    pub fn rows(&self, snapshot: &Snapshot) -> Vec<Stage> {
        let hops = lock(&self.hops).each_ref().map(Hop::quantiles);
        let step = |kind, name: &str| {
            let p = snapshot.processes.get(&kind);
            Stage::computed(name, p.map_or([f64::NAN; 2], |p| [p.step_p50_s, p.step_p99_s]))
        };
        let hop = |k: usize, name: &str| {
            let [middleware_s, plain_s] = hops.get(k).copied().unwrap_or([[f64::NAN; 2]; 2]);
            Stage {
                stage: name.into(),
                middleware_s,
                plain_s: Some(plain_s),
            }
        };
        let figure = |kind, k| snapshot.processes.get(&kind).map_or(f64::NAN, |p| p.figure(k));
        let bridge = |k| figure(ProcessKind::Bridge, k);
        let from = crate::drone::bridge::RELAY_FIGURES;
        let radio = Stage {
            stage: "radio: zenoh | UDP socket".into(),
            middleware_s: [bridge(from), bridge(from + 1)],
            plain_s: Some([bridge(from + 2), bridge(from + 3)]),
        };
        let vessel = [0, 1].map(|k| figure(ProcessKind::Vessel, VESSEL_FIGURES - 2 + k));
        let all = [0, 1].map(|k| figure(ProcessKind::Pilot, k));
        let mut rows = vec![
            Stage::computed("vessel: measurement to estimate sent", vessel),
            radio,
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
        let whole = Stage {
            stage: "whole: measurement on the vessel to set-point".into(),
            middleware_s: all,
            plain_s: Some([all[0] + gain(0), all[1] + gain(1)]),
        };
        rows.push(whole);
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
    let memory = Memory::join(instance, "relay")?;
    let mut subscriber: Subscriber<T> = memory.subscriber()?;
    let listener = memory.listener::<T>()?;
    wake::run(&[&listener], MAX_WAIT, || {
        let came = subscriber.all(steady_ns());
        let at_ns = steady_ns();
        if let Some(hop) = lock(hops).get_mut(k) {
            for order in came.iter().filter_map(Plain::order) {
                hop.original(key_in_memory(T::TOPIC, order), at_ns);
            }
        }
        if end.load(Ordering::Relaxed) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
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
}

/// The table in words.
pub fn text(stages: &[Stage]) -> String {
    if stages.is_empty() {
        return String::new();
    }
    let mut out = format!(
        "  {:<46}{:>11}{:>11}{:>12}{:>11}\n",
        "stage", "p50", "p99", "plain p50", "p99"
    );
    for s in stages {
        let [a, b] = s.middleware_s.map(time);
        let [c, d] = s
            .plain_s
            .map_or_else(|| [String::new(), String::new()], |p| p.map(time));
        out.push_str(&format!("  {:<46}{a:>11}{b:>11}{c:>12}{d:>11}\n", s.stage));
    }
    out
}
