//! Situation: what is known on one computer, by the topics of its processes and by its configuration.

use std::path::Path;

use alight_shared::admission::AccessRejection;
use alight_shared::geometry::DeckGeometry;
use alight_shared::metrics::{MetricName, MetricValue};
use alight_shared::msg::{SourceReport, SourceUse, VesselStatus, still_armed_s};
use alight_shared::process::{ProcessKind, ProcessState};
use alight_shared::time::{Time, VesselClock};
use alight_shared::{admission, topics};
use alight_transport::clock::{ProcessClock, steady_ns};
use alight_uav::autopilot::config::DisarmConfig;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value, json};

use crate::certificates::{self, Certificate};
use crate::config::{DroneComputer, VesselComputer};
use crate::process::snapshot::Snapshot;
use crate::subject::Computer;

/// Two periods of the processes' reports: who has not reported by then is silent, s.
pub const OBSERVATION_S: f64 = 1.2;

/// A vessel's configuration, as far as people are to know it.
#[derive(Clone, Debug)]
pub struct KnownVessel {
    /// Endpoints that it listens on.
    pub listen: Vec<String>,
    /// Endpoints that it connects to.
    pub connect: Vec<String>,
    /// Names that are admitted.
    pub peers: Vec<String>,
    /// The certificate, or why it cannot be read; None: the radio has none.
    pub certificate: Option<Result<Certificate, String>>,
    /// Names of the real sensors.
    pub sources: Vec<String>,
    /// The clock of their measurements.
    pub clock: ProcessClock,
    /// When the certificate's file was read, on the steady clock, ns.
    pub read_ns: i64,
}

/// The certificate's file is read again this often, ns.
const CERTIFICATE_PERIOD_NS: i64 = 60_000_000_000;

/// What does not change, as far as it is known.
#[derive(Clone, Debug, Default)]
pub struct Known {
    /// Whose situation it is.
    pub title: String,
    /// Number of the drone whose computer it is.
    pub drone_id: Option<u32>,
    /// The deck.
    pub deck: Option<DeckGeometry>,
    /// The motors on the deck.
    pub disarm: DisarmConfig,
    /// Processes that report while it runs.
    pub processes: Vec<ProcessKind>,
    /// Of a vessel's computer.
    pub vessel: Option<KnownVessel>,
    /// People read winds and the vessel's speed in knots.
    pub knots: bool,
}

impl Known {
    /// A computer.
    pub fn of(computer: &Computer) -> Known {
        match computer {
            Computer::Vessel(v) => Known::vessel(v),
            Computer::Drone(d) => Known::drone(d),
        }
    }
    /// Reads again what of a computer changes while it runs: a vessel's certificate.
    pub fn refresh_for(&mut self, computer: &Computer, now_ns: i64) {
        if let Computer::Vessel(vessel) = computer {
            self.refresh(vessel, now_ns);
        }
    }
    /// A drone's computer.
    pub fn drone(computer: &DroneComputer) -> Known {
        Known {
            title: format!("drone {}, {}", computer.bridge.drone_id, computer.instance),
            drone_id: Some(computer.bridge.drone_id),
            deck: Some(computer.drone.deck),
            disarm: computer.autopilot.disarm,
            processes: computer.processes(),
            vessel: None,
            knots: computer.view.knots,
        }
    }
    /// A vessel's computer, with what its certificate's file holds now.
    pub fn vessel(computer: &VesselComputer) -> Known {
        let file = Path::new(&computer.radio.tls.certificate);
        let read = || {
            certificates::read_certificate(file)
                .map(|c| c.certificate)
                .map_err(|e| e.to_string())
        };
        Known {
            title: format!("vessel {}", computer.vessel_id),
            processes: computer.processes(),
            vessel: Some(KnownVessel {
                listen: computer.radio.listen.clone(),
                connect: computer.radio.connect.clone(),
                peers: computer.radio.tls.peers.clone(),
                certificate: (!file.as_os_str().is_empty()).then(read),
                sources: computer.sensor.sources.iter().map(|s| s.name.clone()).collect(),
                clock: computer.clock,
                read_ns: steady_ns(),
            }),
            knots: computer.view.knots,
            ..Known::default()
        }
    }
    /// Reads the file of a vessel's certificate again where that is due.
    pub fn refresh(&mut self, computer: &VesselComputer, now_ns: i64) {
        let read_ns = self.vessel.as_ref().map_or(i64::MIN, |v| v.read_ns);
        if now_ns.saturating_sub(read_ns) >= CERTIFICATE_PERIOD_NS {
            *self = Known::vessel(computer);
        }
    }
}

/// A real sensor: its bytes, and what the estimator made of its measurements.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SourceHealth {
    /// Its name.
    pub name: String,
    /// Age of its newest measurement, s; None before the first.
    pub age_s: Option<f64>,
    /// What became of its bytes.
    #[serde(flatten)]
    pub report: SourceReport,
    /// What the estimator made of it.
    #[serde(flatten)]
    pub uses: SourceUse,
}

/// What is known on one computer.
#[derive(Clone, Debug, Default)]
pub struct Situation {
    /// What does not change.
    pub known: Known,
    /// The newest of each topic.
    pub seen: Snapshot,
    /// The observer's clock, ns: the steady clock where processes run.
    pub now_ns: i64,
}

impl Situation {
    /// Of what was received until `now_ns`.
    pub fn of(known: Known, seen: &Snapshot, now_ns: i64) -> Situation {
        Situation {
            known,
            seen: seen.clone(),
            now_ns,
        }
    }
    /// Since then, s.
    pub fn since_s(&self, at_ns: i64) -> f64 {
        self.now_ns.saturating_sub(at_ns) as f64 * 1e-9
    }
    /// What is known of a vessel's computer, and what its process reports.
    pub fn vessel(&self) -> Option<(&KnownVessel, &VesselStatus)> {
        Some((self.known.vessel.as_ref()?, self.seen.vessel.as_ref()?))
    }
    /// The newest report of a process.
    pub fn process(&self, kind: ProcessKind) -> Option<&ProcessState> {
        self.seen.processes.get(&kind)
    }
    /// Whether that process reports.
    pub fn reports(&self, kind: ProcessKind) -> bool {
        self.process(kind)
            .is_some_and(|p| self.since_s(p.at_ns) <= topics::PROCESS.stale_after.secs())
    }
    /// Whether every process has had the time to report.
    pub fn has_waited(&self) -> bool {
        self.since_s(self.seen.since_ns) >= OBSERVATION_S
    }
    /// Processes that do not report, and for how long (s), where they have.
    pub fn silent(&self) -> Vec<(ProcessKind, Option<f64>)> {
        let missing = self.known.processes.iter().copied();
        let missing = missing.filter(|kind| self.has_waited() && self.process(*kind).is_none());
        let ended = self.seen.processes.values().filter(|p| !self.reports(p.kind));
        missing
            .map(|kind| (kind, None))
            .chain(ended.map(|p| (p.kind, Some(self.since_s(p.at_ns)))))
            .collect()
    }
    /// Since the landing or the stopped take-off, s, of a drone that is on the deck and armed for longer than its disarm takes.
    pub fn still_armed_s(&self) -> Option<f64> {
        let (mission, autopilot) = (self.seen.mission.as_ref()?, self.seen.autopilot.as_ref()?);
        still_armed_s(
            mission.header.at,
            mission,
            autopilot.armed,
            self.known.disarm.longest_s(),
        )
    }
    /// Age of the vessel's newest estimate on the drone, s; infinite before the first, None without a bridge.
    pub fn link_age_s(&self) -> Option<f64> {
        let age_s = self.seen.link.map(|l| l.age_s)?;
        Some(age_s + self.seen.link.age_s(self.now_ns))
    }
    /// The vessel's real sensors.
    pub fn sources(&self) -> Vec<SourceHealth> {
        let Some((known, status)) = self.vessel() else {
            return Vec::new();
        };
        let now: Time<VesselClock> = known.clock.read(self.now_ns);
        let source = |r: &SourceReport| {
            let number = usize::try_from(r.number).unwrap_or(usize::MAX);
            Some(SourceHealth {
                name: known.sources.get(number)?.clone(),
                age_s: r.status.newest_s.map(|at| now.secs() - at),
                report: *r,
                uses: *status.uses.get(number)?,
            })
        };
        self.seen.sources.values().filter_map(source).collect()
    }
    /// Peers that the vessel's process has rejected since its start, by reason.
    pub fn rejected(&self) -> Vec<(&'static str, u64)> {
        let Some(process) = self.process(ProcessKind::Vessel) else {
            return Vec::new();
        };
        let other_keys = MetricName::Rejected(admission::RejectionReason::Sender);
        AccessRejection::ALL
            .map(|r| (r.name(), MetricName::PeersRejectedFor(r)))
            .into_iter()
            .chain([("a name that is not its key's", other_keys)])
            .map(|(why, name)| (why, process.count(name)))
            .filter(|(_, n)| *n > 0)
            .collect()
    }
    /// The newest reason for which a peer was rejected.
    pub fn rejected_last(&self) -> Option<&'static str> {
        let process = self.process(ProcessKind::Vessel)?;
        if let MetricValue::AccessRejection(last) = process.metric(MetricName::LastPeerRejection)? {
            return last.map(AccessRejection::name);
        }
        None
    }
}

impl Serialize for Situation {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let processes = || self.seen.processes.values();
        let metrics = |p: &ProcessState| -> Map<String, Value> {
            p.metrics.iter().map(|m| (m.key(), m.json())).collect()
        };
        let mut all = json!({
            "processes": processes().collect::<Vec<_>>(),
            "metrics": processes()
                .map(|p| (p.kind.name().to_owned(), metrics(p).into()))
                .collect::<Map<_, _>>(),
            "edited": self.seen.edited,
        });
        let more = match &self.known.vessel {
            Some(known) => json!({
                "vessel": *self.seen.vessel,
                "sources": self.sources(),
                "certificate": known.certificate.as_ref().and_then(|c| c.as_ref().ok()),
                "rejected": self.rejected(),
                "rejected_last": self.rejected_last(),
            }),
            None => json!({
                "mission": *self.seen.mission,
                "autopilot": *self.seen.autopilot,
                "link": *self.seen.link,
                "deck": *self.seen.grant,
                "wave": *self.seen.wave,
                "response": self.seen.response,
                "still_armed_s": self.still_armed_s(),
            }),
        };
        if let (Value::Object(all), Value::Object(more)) = (&mut all, more) {
            all.extend(more);
        }
        all.serialize(to)
    }
}
