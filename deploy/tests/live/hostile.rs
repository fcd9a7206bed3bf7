//! Hostile client on the vessel's radio during a whole landing: everything that it publishes on the keys of vessel
//! and drone is counted and shown, and the landing continues.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, channel},
    },
    thread::JoinHandle,
    time::Duration,
};

use alight_shared::{
    msg::{DroneStatus, EstimateUpdate, TimeReply, TimeRequest, VesselPrediction, WaveUpdate},
    time::{DroneClock, VesselClock},
    wire::{MAX_WIRE_BYTES, decode, encode},
};
use zenoh::Wait;

use serde_json::Value;

use crate::landing::{directory, status_when};

const KEYS: [&str; 7] = [
    "alight/vessel-1/estimate",
    "alight/vessel-1/wave",
    "alight/vessel-1/prediction",
    "alight/vessel-1/time/reply",
    "alight/vessel-1/process",
    "alight/drone-1/time/request",
    "alight/drone-1/status",
];

/// Pseudo-random numbers from a seed (a linear congruential generator, whose quality does not matter).
struct Dice(u64);

impl Dice {
    fn throw(&mut self, sides: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % sides.max(1)
    }
}

/// Message of another version, of another vessel, or with an invalid number.
macro_rules! forged {
    ($bytes:expr, $ty:ty, $how:expr, $spoil:expr) => {{
        let mut m: $ty = decode($bytes).expect("genuine");
        match $how {
            0 => m.header.version += 1,
            1 => m.header.vessel = 99,
            _ => $spoil(&mut m),
        }
        encode(&m).expect("small")
    }};
}

fn forged(key: &str, bytes: &[u8], how: usize) -> Vec<u8> {
    let none = f32::NAN;
    match key.rsplit_once("-1/").expect("a key").1 {
        "estimate" => forged!(
            bytes,
            EstimateUpdate<VesselClock>,
            how,
            |m: &mut EstimateUpdate<VesselClock>| {
                m.header.sequence += 1;
                m.position[2] = none;
            }
        ),
        "wave" => forged!(bytes, WaveUpdate<VesselClock>, how, |m: &mut WaveUpdate<
            VesselClock,
        >| {
            m.header.sequence += 1;
            m.significant_height_m = none;
        }),
        "prediction" => {
            forged!(
                bytes,
                VesselPrediction<VesselClock>,
                how,
                |m: &mut VesselPrediction<VesselClock>| {
                    m.header.sequence += 1;
                    m.step_s = none;
                }
            )
        }
        "time/reply" => forged!(
            bytes,
            TimeReply<VesselClock, DroneClock>,
            how,
            |m: &mut TimeReply<VesselClock, DroneClock>| m.header.sequence += 1
        ),
        "time/request" => forged!(bytes, TimeRequest<DroneClock>, how, |m: &mut TimeRequest<
            DroneClock,
        >| m.header.vessel =
            98),
        // The drone's status; the vessel's report has neither version nor vessel and stays unchanged.
        _ if key.contains("drone") => forged!(bytes, DroneStatus, how, |m: &mut DroneStatus| {
            m.header.sequence += 1;
            m.battery = Some(f64::NAN);
        }),
        _ => bytes[..bytes.len() / 3].to_vec(),
    }
}

/// Message of the client on `key`, made from a genuine sample or from scratch.
fn poison(dice: &mut Dice, key: &str, first: &[u8], newest: &[u8]) -> Vec<u8> {
    match dice.throw(7) {
        0 => {
            let length = dice.throw(700);
            (0..length).map(|_| dice.throw(256) as u8).collect()
        }
        1 => newest[..dice.throw(newest.len())].to_vec(),
        2 => vec![7; MAX_WIRE_BYTES + 1 + dice.throw(20_000)],
        3 => first.to_vec(),
        how => forged(key, newest, how - 4),
    }
}

fn endpoint(instance: &str) -> String {
    let text = std::fs::read_to_string(directory(instance).join("drone.toml")).expect("it runs");
    let table: toml::Table = text.parse().expect("TOML");
    table["radio"]["connect"][0].as_str().expect("an endpoint").into()
}

fn client(endpoint: &str) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", r#""client""#.to_string()),
        ("connect/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
    ] {
        config.insert_json5(key, &value).expect("a setting");
    }
    zenoh::open(config).wait().expect("the vessel listens")
}

/// First and newest genuine sample of each key, as the client receives them.
struct Overheard {
    received: Receiver<(String, Vec<u8>)>,
    samples: BTreeMap<String, [Vec<u8>; 2]>,
}

impl Overheard {
    fn listen(session: &zenoh::Session) -> Overheard {
        let (sender, received) = channel();
        session
            .declare_subscriber("alight/**")
            .callback(move |sample| {
                let _gone = sender.send((
                    sample.key_expr().to_string(),
                    sample.payload().to_bytes().into_owned(),
                ));
            })
            .background()
            .wait()
            .expect("subscribed");
        Overheard {
            received,
            samples: BTreeMap::new(),
        }
    }
    fn until_all_keys(&mut self) {
        while KEYS.iter().any(|k| !self.samples.contains_key(*k)) {
            let (key, bytes) = self
                .received
                .recv_timeout(Duration::from_secs(30))
                .expect("vessel and drone talk");
            let [_, newest] = self.samples.entry(key).or_insert([bytes.clone(), Vec::new()]);
            *newest = bytes;
        }
    }
}

fn count(status: &Value, process: &str, metric: &str) -> f64 {
    status["metrics"][process][metric].as_f64().unwrap_or(0.0)
}

pub struct Attack {
    end: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Attack {
    /// Begins once vessel and drone receive each other, in a landing without certificates, which admits the client.
    pub fn begin(instance: &str) -> Attack {
        status_when(instance, |s| s["link"]["age_s"].as_f64().is_some());
        let session = client(&endpoint(instance));
        let mut overheard = Overheard::listen(&session);
        overheard.until_all_keys();
        let end = Arc::<AtomicBool>::default();
        let ended = Arc::clone(&end);
        let samples = overheard.samples;
        let thread = std::thread::spawn(move || {
            let mut dice = Dice(1);
            while !ended.load(Ordering::Relaxed) {
                let key = KEYS[dice.throw(KEYS.len())];
                let [first, newest] = &samples[key];
                let bytes = poison(&mut dice, key, first, newest);
                session.put(key, bytes).wait().expect("sent");
                std::thread::sleep(Duration::from_millis(4));
            }
        });
        Attack { end, thread }
    }
    pub fn assert_counted(instance: &str) {
        let wanted = [
            ("bridge", "rejected_malformed"),
            ("bridge", "rejected_of_another_version"),
            ("bridge", "rejected_of_another_vessel"),
            ("bridge", "rejected_out_of_range"),
            ("bridge", "rejected_unsolicited_replies"),
            ("bridge", "packets_dropped"),
            ("bridge", "vessel_status_rejected"),
            ("vessel", "time_requests_rejected"),
            ("vessel", "drone_messages_rejected"),
            ("vessel", "packets_dropped"),
        ];
        status_when(instance, |s| wanted.iter().all(|(p, f)| count(s, p, f) > 0.0));
        // Old samples are counted in one of three ways: repeated, older than a received one, or expired.
        status_when(instance, |s| {
            ["repeated", "out_of_order", "stale"]
                .iter()
                .any(|r| count(s, "bridge", &format!("rejected_{r}")) > 0.0)
        });
    }
    pub fn end(self) {
        self.end.store(true, Ordering::Relaxed);
        self.thread.join().expect("the attack itself does not fail");
    }
}
