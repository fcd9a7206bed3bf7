//! The status of the vessel's process for people on its own computer: a small file that is replaced twice a
//! second, where `alight status` finds it. The vessel shares no memory.
//!
//! The file is named after the port of the vessel's sensors, which no two processes of a computer have.

use core::f64::consts::PI;
use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};

use alight_shared::msg::Course;
use alight_shared::time::{Time, VesselClock};
use alight_shared::transport::metrics::MetricName;
use alight_shared::transport::process::ProcessState;
use alight_shared::transport::rejections::{AccessRejection, AccessRejections};
use alight_usv::deck::{Closure, Starved, Unheard};
use alight_usv::followed::FollowsAnother;
use alight_usv::sensors::Remark;
use alight_usv::{ComputerIn, ComputerOut, Estimator, KINDS, VesselNode};
use serde::{Deserialize, Serialize};

use crate::certificates;
use crate::config::VesselComputer;
use crate::process::lateness;
use crate::vessel::sensor_supervisor::{SensorSupervisor, SourceReport};

/// Directory of the installed service.
const SERVICE_DIRECTORY: &str = "/run/alight";
/// Longest file, bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Time between two samples of the motion, ns, and how many are kept until the next status.
const MOTION_PERIOD_NS: i64 = 90_000_000;
const MAX_MOTION: usize = 16;
/// Statuses that `lately` reaches back: 10 s.
const LATELY: usize = 20;
/// The certificate's file is read again this often, ns.
const CERTIFICATE_PERIOD_NS: i64 = 60_000_000_000;

/// A drone that was received.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DroneContact {
    /// Its number.
    pub drone: u32,
    /// Since its newest status, s.
    pub age_s: f64,
    /// Its mission's state, and why.
    pub state: String,
    /// Why it is in it.
    pub entered: String,
    /// Why its next state is not entered yet.
    #[serde(default)]
    pub waiting: String,
    /// Age of that state when it was sent, s.
    #[serde(default)]
    pub mission_age_s: f64,
    /// Its battery, 0 to 1; None: not reported.
    pub battery: Option<f64>,
    /// Its motors are armed.
    #[serde(default)]
    pub armed: bool,
    /// Landed and armed for longer than its disarm takes: since the landing, s.
    #[serde(default)]
    pub still_armed_s: Option<f32>,
}

/// The certificate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum CertificateStatus {
    /// The radio has none.
    None,
    /// Its name and the days until it expires, negative when it has.
    Held {
        /// Whose it is.
        name: String,
        /// Days left.
        days_left: i64,
    },
    /// It cannot be read; the system's error.
    Unreadable(String),
}

/// The heading of the least deck motion beside the present one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadingAdvice {
    /// Present mean heading, deg.
    pub now_deg: f64,
    /// Heading of the least tilt, deg.
    pub quietest_deg: f64,
    /// Standard deviation of the deck's tilt that is predicted on both, deg.
    pub tilt_deg: [f64; 2],
    /// Where the waves come from, deg.
    pub waves_from_deg: f64,
}

impl HeadingAdvice {
    fn of(estimator: &Estimator) -> Option<HeadingAdvice> {
        let (quiet, now) = estimator.quietest_heading()?;
        let compass = |rad: f64| rad.to_degrees().rem_euclid(360.0);
        Some(HeadingAdvice {
            now_deg: compass(now),
            quietest_deg: compass(quiet.heading),
            tilt_deg: [quiet.tilt_now, quiet.tilt].map(f64::to_degrees),
            waves_from_deg: compass(quiet.waves_to + PI),
        })
    }
}

/// The estimator's health.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorStatus {
    /// Since the newest sample of inertial or attitude sensor, GNSS and heading, s; None before the first.
    pub sensor_age_s: [Option<f64>; 3],
    /// Since the newest estimate that it published, s; None before the first.
    pub estimate_age_s: Option<f64>,
    /// Standard deviations of that estimate: horizontal position (m), height (m), tilt (rad), heading (rad).
    pub sd: [f64; 4],
    /// Roll, pitch (rad) and height (m, upwards) since the status before, at about 10 Hz, oldest first.
    #[serde(default)]
    pub motion: Vec<[f64; 3]>,
    /// Significant wave height, m, and how far the waves' identification is trusted, 0 to 1.
    pub waves: Option<[f64; 2]>,
    /// Another heading that would be quieter, where the waves' direction is known.
    #[serde(default)]
    pub heading: Option<HeadingAdvice>,
    /// Measurements outside its chi-square gates: inertial, GNSS, heading.
    pub gated: [u64; 3],
    /// Starts from scratch.
    pub restarts: u64,
    /// Inputs rejected before its gates.
    pub rejected: u64,
}

/// A real sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SourceHealth {
    /// Its name.
    pub name: String,
    /// Age of its newest measurement, s; None before the first.
    pub age_s: Option<f64>,
    /// Why nothing can come, if that is so.
    pub why: Option<String>,
    /// Whole messages of a kind that is used.
    pub good: u64,
    /// Damaged ones.
    pub corrupted: u64,
    /// Measurements without a time, or of one that cannot be right.
    pub undated: u64,
    /// Measurements older than the one before, on either side of the socket between the processes.
    pub out_of_order: u64,
    /// Time pulses of another time base than the fixes.
    pub mismatched_pulses: u64,
    /// Measurements given to the filter.
    pub used: u64,
    /// Of those, outside its gates.
    pub gated: u64,
    /// Rejected before the gates: too old, from the future, absurd.
    pub rejected: u64,
    /// Of those, samples of an inertial sensor that repeats one for ever.
    #[serde(default)]
    pub stuck: u64,
    /// It does so now.
    #[serde(default)]
    pub is_stuck: bool,
    /// Used and refused (rejected or gated) since some seconds ago.
    #[serde(default)]
    pub lately: [u64; 2],
    /// What else is to be said of its bytes.
    #[serde(default)]
    pub remarks: Vec<Remark>,
}

impl SourceHealth {
    fn of(status: &SourceReport, since_s: f64, node: &VesselNode) -> SourceHealth {
        let (s, d) = (&status.status, &status.status.decoded);
        let mut health = SourceHealth {
            name: status.source.clone(),
            age_s: status.age_s.map(|age| finite(age + since_s)),
            why: status.why.clone(),
            good: d.good,
            corrupted: d.corrupted,
            undated: d.undated + s.implausible_time,
            out_of_order: s.out_of_order,
            mismatched_pulses: d.mismatched_pulses,
            remarks: status.remarks.clone(),
            ..SourceHealth::default()
        };
        // A source of bytes is two sources of measurements.
        for kind in 0..KINDS.len() {
            for number in [2 * status.number, 2 * status.number + 1] {
                let c = node.source(kind, number);
                health.out_of_order += c.out_of_order;
                health.used += c.taken;
                health.gated += c.gated;
                health.rejected += c.rejected;
                health.stuck += c.stuck;
                health.is_stuck |= c.is_stuck;
            }
        }
        health
    }
}

/// The process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProcessStatus {
    /// Its number.
    pub pid: u32,
    /// The steady clock when this was written, ns.
    pub at_ns: i64,
    /// The steady clock when the process began, ns.
    pub began_ns: i64,
    /// Steps of its node.
    pub steps: u64,
    /// Median and 99th percentile of the time of one step, s.
    pub step_s: [f64; 2],
    /// Processor time since it began, s.
    pub cpu_s: f64,
    /// Resident memory, bytes.
    pub resident_bytes: u64,
    /// Sent over the radio, bytes.
    pub sent_bytes: u64,
    /// Packets that it had to drop.
    pub dropped: u64,
    /// Steps that are not recorded because the disk refused or was too slow.
    pub unrecorded: u64,
    /// What is to be said of missed deadlines.
    #[serde(default)]
    pub late: Option<String>,
    /// Datagrams at its sensors' port that were no measurements.
    #[serde(default)]
    pub datagrams_rejected: u64,
}

/// JSON has no infinity and no NaN.
fn finite(v: f64) -> f64 {
    if v.is_finite() { v } else { 0.0 }
}

/// The deck, and the commands that concern it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DeckStatus {
    /// Its owner.
    #[serde(skip)]
    pub owner: Option<u32>,
    /// Why it is closed, if it is.
    pub closed: Option<Closure>,
    /// Since the owner's newest status, s.
    pub owner_age_s: Option<f64>,
    /// Numbers that two drones have.
    pub doubles: Vec<u32>,
    /// Drones that were switched on without a position.
    #[serde(default)]
    pub unplaced: Vec<u32>,
    /// A drone with a low battery waits for a silent owner.
    #[serde(default)]
    pub starved: Option<Starved>,
    /// Silent drones that may be on their way down.
    #[serde(default)]
    pub unheard: Vec<Unheard>,
    /// A drone that listens to another computer with this vessel's identity.
    #[serde(default)]
    pub follows_another: Option<FollowsAnother>,
    /// Drones that have not acknowledged an abort.
    pub aborts: Vec<u32>,
    /// Why its state would not outlive the process, if it would not.
    pub file_error: Option<String>,
    /// Digital inputs that cannot be read, and why.
    pub input_errors: Vec<String>,
    /// Why the lamp at the helm cannot be driven, if it cannot.
    #[serde(default)]
    pub lamp_error: Option<String>,
    /// What the helm intends.
    #[serde(default)]
    pub course: Course,
    /// A drone wants the vessel to keep course and speed.
    #[serde(default)]
    pub wants_steady: bool,
}

impl DeckStatus {
    /// As arbiter and relay know it at `now`.
    pub fn of(now: Time<VesselClock>, node: &alight_usv::VesselComputer) -> DeckStatus {
        let (arbiter, relay) = (node.arbiter(), node.relay());
        DeckStatus {
            owner: arbiter.owner(),
            closed: arbiter.closed(now),
            owner_age_s: arbiter.owner_age_s(now).map(finite),
            doubles: arbiter.doubles().map(|(id, _)| id).collect(),
            unplaced: arbiter.unplaced().collect(),
            starved: arbiter.starved(now),
            unheard: arbiter.unheard(now).collect(),
            follows_another: node.follows_another(now),
            aborts: relay.unacknowledged().collect(),
            course: arbiter.course(now),
            wants_steady: arbiter.wants_steady(now),
            ..DeckStatus::default()
        }
    }
}

/// The whole status.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VesselStatus {
    /// Number of the vessel.
    pub vessel: u32,
    /// The process.
    pub process: ProcessStatus,
    /// Endpoints that it listens on.
    pub listen: Vec<String>,
    /// Names that are admitted.
    pub peers: Vec<String>,
    /// The certificate.
    pub certificate: CertificateStatus,
    /// Peers rejected since the start, by reason.
    pub rejected: Vec<(String, u64)>,
    /// The newest reason.
    pub rejected_last: Option<String>,
    /// The drone that the deck is reserved for.
    pub deck_owner: Option<u32>,
    /// A drone stands on it, or its sensor reports something.
    pub occupied: bool,
    /// What else is known of the deck.
    pub deck: DeckStatus,
    /// What is to be said of a configuration that was edited since the start.
    #[serde(default)]
    pub edited: Option<String>,
    /// Drones that were received.
    pub drones: Vec<DroneContact>,
    /// The estimator.
    pub estimator: EstimatorStatus,
    /// The process that reads the real sensors, while it runs.
    pub sensors_pid: Option<u32>,
    /// The real sensors.
    pub sources: Vec<SourceHealth>,
}

/// Where the process of this computer writes its status.
pub fn own_path(computer: &VesselComputer) -> PathBuf {
    let directory = Path::new(SERVICE_DIRECTORY);
    let of_service = std::env::var_os("TMPDIR").is_some_and(|t| Path::new(&t) == directory);
    let temporary = std::env::temp_dir();
    if of_service { directory } else { &temporary }.join(name(computer))
}

/// The status of the process that runs on this computer, and whether that is the installed service.
pub fn existing(computer: &VesselComputer) -> Option<(PathBuf, bool)> {
    let service = Path::new(SERVICE_DIRECTORY).join(name(computer));
    if service.exists() {
        return Some((service, true));
    }
    let by_hand = std::env::temp_dir().join(name(computer));
    by_hand.exists().then_some((by_hand, false))
}

/// The name of a file of this computer's process.
pub fn file_name(computer: &VesselComputer, extension: &str) -> String {
    let port = computer.sensors.rsplit(':').next().unwrap_or_default();
    let port: String = port.chars().filter(char::is_ascii_digit).collect();
    format!("alight-vessel-{port}.{extension}")
}

fn name(computer: &VesselComputer) -> String {
    file_name(computer, "json")
}

/// The status of this computer's vessel process; None when there is none.
pub fn read(computer: &VesselComputer) -> Option<Result<VesselStatus, String>> {
    let (path, _) = existing(computer)?;
    let doing = |e: &dyn std::fmt::Display| format!("reading {}: {e}", path.display());
    let read = || -> Result<VesselStatus, String> {
        if fs::metadata(&path).map_err(|e| doing(&e))?.len() > MAX_BYTES {
            return Err(doing(&"too long for a vessel's status"));
        }
        let text = fs::read_to_string(&path).map_err(|e| doing(&e))?;
        serde_json::from_str(&text).map_err(|e| doing(&e))
    };
    Some(read())
}

/// Collects what the process knows, and writes it to its file.
pub struct StatusFile {
    path: PathBuf,
    sensors: [Option<i64>; 3],
    estimated_ns: Option<i64>,
    sd: [f64; 4],
    motion: Vec<[f64; 3]>,
    motion_ns: i64,
    waves: Option<[f64; 2]>,
    occupied: bool,
    certificate: (i64, CertificateStatus),
    /// Used and refused of each source at the statuses before, oldest first.
    counts: VecDeque<Vec<[u64; 2]>>,
    /// What is to be said of a configuration that was edited since the start.
    pub edited: Option<String>,
}

impl StatusFile {
    /// Knows nothing yet.
    pub fn new(computer: &VesselComputer) -> StatusFile {
        StatusFile {
            path: own_path(computer),
            sensors: [None; 3],
            estimated_ns: None,
            sd: [0.0; 4],
            motion: Vec::new(),
            motion_ns: i64::MIN,
            waves: None,
            occupied: false,
            certificate: (i64::MIN, CertificateStatus::None),
            counts: VecDeque::new(),
            edited: None,
        }
    }
    /// Works out what became of each source's measurements since some statuses ago.
    fn compare(&mut self, sources: &mut [SourceHealth]) {
        let now: Vec<[u64; 2]> = sources
            .iter()
            .map(|s| [s.used - s.gated.min(s.used), s.rejected + s.gated])
            .collect();
        if let Some(before) = self.counts.front().filter(|b| b.len() == now.len()) {
            for ((source, now), before) in sources.iter_mut().zip(&now).zip(before) {
                source.lately = [0, 1].map(|k| now[k].saturating_sub(before[k]));
            }
        }
        if self.counts.len() >= LATELY {
            self.counts.pop_front();
        }
        self.counts.push_back(now);
    }
    /// A step of the node at `now_ns` of the steady clock.
    pub fn observe(&mut self, now_ns: i64, input: &ComputerIn, out: &ComputerOut) {
        self.occupied = out.grant.map_or(self.occupied, |g| g.occupied);
        let (input, out) = (&input.vessel, &out.vessel);
        let arrived = [
            // An attitude sensor stands in where there is no inertial one.
            !(input.imu.is_empty() && input.attitude.is_empty()),
            !input.gnss.is_empty(),
            !input.heading.is_empty(),
        ];
        for (slot, arrived) in self.sensors.iter_mut().zip(arrived) {
            *slot = if arrived { Some(now_ns) } else { *slot };
        }
        if let Some(e) = &out.estimate {
            self.estimated_ns = Some(now_ns);
            if now_ns.saturating_sub(self.motion_ns) >= MOTION_PERIOD_NS && self.motion.len() < MAX_MOTION {
                self.motion_ns = now_ns;
                self.motion.push([e.eta[3], e.eta[4], -e.eta[2]].map(finite));
            }
            let variance = |i: usize| e.covariance(i)[0];
            self.sd = [
                variance(0) + variance(1),
                variance(2),
                variance(3) + variance(4),
                variance(5),
            ]
            .map(f64::sqrt);
        }
        if let Some(w) = &out.wave {
            self.waves = Some([w.significant_height_m, w.confidence].map(f64::from));
        }
    }
    /// Writes the status; a full disk or a missing directory does not stop the vessel.
    pub fn write(
        &mut self,
        computer: &VesselComputer,
        (node, at): (&alight_usv::VesselComputer, Time<VesselClock>),
        process: &ProcessState,
        deck: DeckStatus,
        rejections: &AccessRejections,
        sensor_supervisor: &SensorSupervisor,
    ) {
        let now = process.at_ns;
        let since = |t: &Option<i64>| t.map(|t| (now - t).max(0) as f64 * 1e-9);
        if now.saturating_sub(self.certificate.0) > CERTIFICATE_PERIOD_NS {
            self.certificate = (now, certificate(computer));
        }
        let (drones, on_other_keys) = (node.drones().statuses(), node.on_other_keys().into());
        let node = node.node();
        let (gated, rejected) = (node.gated(), node.rejected());
        let mut sources: Vec<SourceHealth> = sensor_supervisor
            .reports(now)
            .map(|(since_s, status)| SourceHealth::of(status, since_s, node))
            .collect();
        self.compare(&mut sources);
        let status = VesselStatus {
            vessel: computer.vessel_id,
            process: ProcessStatus {
                pid: process.pid,
                at_ns: now,
                began_ns: process.began_ns,
                steps: process.steps,
                step_s: [process.step_p50_s, process.step_p99_s].map(finite),
                cpu_s: finite(process.cpu_s),
                resident_bytes: process.resident_bytes,
                sent_bytes: process.count(MetricName::BytesSent),
                dropped: process.count(MetricName::PacketsDropped),
                unrecorded: process.count(MetricName::StepsUnrecorded),
                late: lateness::finding(process),
                datagrams_rejected: process.count(MetricName::SensorDatagramsRejected),
            },
            listen: computer.radio.listen.clone(),
            peers: computer.radio.tls.peers.clone(),
            certificate: self.certificate.1.clone(),
            rejected: AccessRejection::ALL
                .iter()
                .map(|r| (r.name(), rejections.of(*r)))
                .chain([("a name that is not its key's", on_other_keys)])
                .filter(|(_, n)| *n > 0)
                .map(|(why, n)| (why.to_owned(), n))
                .collect(),
            rejected_last: rejections.last.map(|r| r.name().to_owned()),
            deck_owner: deck.owner,
            occupied: self.occupied,
            deck,
            edited: self.edited.clone(),
            drones: drones
                .map(|s| DroneContact {
                    drone: s.message.header.drone,
                    age_s: (at - s.at).secs().max(0.0),
                    state: s.message.state.name().to_owned(),
                    entered: s.message.entered.to_string(),
                    waiting: s.message.waiting.to_string(),
                    mission_age_s: f64::from(s.message.mission_age_s),
                    battery: s.message.battery,
                    armed: s.message.armed,
                    still_armed_s: s.message.still_armed_s,
                })
                .collect(),
            estimator: EstimatorStatus {
                sensor_age_s: [0, 1, 2].map(|k| self.sensors.get(k).and_then(since)),
                estimate_age_s: since(&self.estimated_ns),
                sd: self.sd.map(finite),
                motion: core::mem::take(&mut self.motion),
                waves: self.waves,
                heading: HeadingAdvice::of(node.estimator()),
                gated: [gated.imu, gated.gnss, gated.heading],
                restarts: gated.restarts,
                rejected: rejected.total().into(),
            },
            sensors_pid: sensor_supervisor.pid(),
            sources,
        };
        let new = self.path.with_extension("new");
        // A reader sees the old status or the new one, never half of one.
        let _written = serde_json::to_vec(&status)
            .map_err(std::io::Error::other)
            .and_then(|bytes| fs::write(&new, bytes))
            .and_then(|()| fs::rename(&new, &self.path));
    }
}

impl Drop for StatusFile {
    fn drop(&mut self) {
        let _gone = fs::remove_file(&self.path);
    }
}

fn certificate(computer: &VesselComputer) -> CertificateStatus {
    let file = &computer.radio.tls.certificate;
    if file.is_empty() {
        return CertificateStatus::None;
    }
    match certificates::read_certificate(Path::new(file)) {
        Ok(look) => CertificateStatus::Held {
            name: look.certificate.name,
            days_left: look.certificate.days_left,
        },
        Err(e) => CertificateStatus::Unreadable(e.to_string()),
    }
}
