//! Situation of one computer, derived only from the topics of its processes.

use alight_shared::{
    admission,
    admission::AccessRejection,
    metrics::{MetricName, MetricValue},
    msg::{ComputerReport, SourceReport, SourceUse, VesselReport, VesselStatus, still_armed_s},
    process::{ProcessKind, ProcessState},
    time::Span,
    topics,
};
use alight_uav::autopilot::config::DisarmConfig;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value, json};

use crate::{
    process::{facts::Facts, snapshot::Snapshot},
    subject::Computer,
};

/// Two reporting periods, s; a process without a report for this time is silent.
pub const OBSERVATION_S: f64 = 1.2;

/// Report that a computer with this configuration makes once its processes run.
pub fn configured(computer: &Computer) -> ComputerReport {
    match computer {
        Computer::Vessel(v) => Facts::vessel(v).report,
        Computer::Drone(d) => Facts::drone(d).report,
    }
}

/// State of a real sensor: its bytes, and the estimator's use of its measurements.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SourceHealth {
    pub name: String,
    pub age_s: Option<f64>,
    #[serde(flatten)]
    pub report: SourceReport,
    #[serde(flatten)]
    pub uses: SourceUse,
}

#[derive(Clone, Debug, Default)]
pub struct ObservedSituation {
    /// The computer's own report, or the expected one.
    pub known: ComputerReport,
    pub snapshot: Snapshot,
    /// Observer's clock, ns: the steady clock for running processes.
    pub now_ns: i64,
    /// Time until the battery reaches its reserve, s, once this flight has shown the discharge rate.
    pub battery_left_s: Option<f64>,
}

impl ObservedSituation {
    pub fn of(snapshot: &Snapshot, now_ns: i64) -> ObservedSituation {
        ObservedSituation::look(snapshot, &ComputerReport::default(), now_ns)
    }
    /// Situation of a computer; its own report takes precedence over `configured`.
    pub fn look(snapshot: &Snapshot, configured: &ComputerReport, now_ns: i64) -> ObservedSituation {
        ObservedSituation {
            known: snapshot.computer.unwrap_or(*configured),
            snapshot: snapshot.clone(),
            now_ns,
            battery_left_s: None,
        }
    }
    pub fn since_s(&self, at_ns: i64) -> f64 {
        self.now_ns.saturating_sub(at_ns) as f64 * 1e-9
    }
    pub fn vessel(&self) -> Option<(&VesselReport, &VesselStatus)> {
        let reported = self.snapshot.computer.as_ref()?;
        Some((reported.vessel.as_ref()?, self.snapshot.vessel.as_ref()?))
    }
    pub fn process(&self, kind: ProcessKind) -> Option<&ProcessState> {
        self.snapshot.processes.get(&kind)
    }
    /// Whether the process reports. A vessel's process reports less often by radio.
    pub fn reports(&self, kind: ProcessKind) -> bool {
        let by_radio = kind == ProcessKind::Vessel && !self.known.processes.contains(&kind);
        let stale_s = topics::process_reports(by_radio).stale_after.secs();
        self.process(kind)
            .is_some_and(|p| self.since_s(p.at_ns) <= stale_s)
    }
    pub fn has_waited(&self) -> bool {
        self.since_s(self.snapshot.since_ns) >= OBSERVATION_S
    }
    /// Silent processes, each with the time since its last report, s, if any.
    pub fn silent(&self) -> Vec<(ProcessKind, Option<f64>)> {
        let missing = self.known.processes.iter().copied();
        let missing = missing.filter(|kind| self.has_waited() && self.process(*kind).is_none());
        let ended = self.snapshot.processes.values().filter(|p| !self.reports(p.kind));
        missing
            .map(|kind| (kind, None))
            .chain(ended.map(|p| (p.kind, Some(self.since_s(p.at_ns)))))
            .collect()
    }
    /// Time since the computer's last report, s, if the reports have stopped.
    pub fn unreported_s(&self) -> Option<f64> {
        let age_s = self.since_s(self.snapshot.computer.as_ref()?.header.at.nanos());
        (age_s > topics::COMPUTER.stale_after.secs()).then_some(age_s)
    }
    /// Time since the landing or the stopped take-off, s, if the drone remains armed on the deck for longer than
    /// disarming takes.
    pub fn still_armed_s(&self) -> Option<f64> {
        let mission = self.snapshot.mission.as_ref()?;
        let autopilot = self.snapshot.autopilot.as_ref()?;
        let disarm_s = self.known.disarm_s;
        let disarm_s = disarm_s.unwrap_or_else(|| DisarmConfig::default().longest_s());
        still_armed_s(mission.header.at, mission, autopilot.armed, disarm_s)
    }
    /// Age of the vessel's newest estimate on the drone, s; infinite before the first, None without a bridge.
    pub fn link_age_s(&self) -> Option<f64> {
        let age_s = self.snapshot.link.map(|l| l.age_s)?;
        Some(age_s + self.snapshot.link.age_s(self.now_ns))
    }
    pub fn sources(&self) -> Vec<SourceHealth> {
        let Some((known, status)) = self.vessel() else {
            return Vec::new();
        };
        // The vessel's clock advances like the steady clock, so drift since the newest report does not count as age.
        let since_ns = self.now_ns.saturating_sub(self.known.header.at.nanos());
        let now = known.clock + Span::from_nanos(since_ns);
        let source = |r: &SourceReport| {
            let number = usize::try_from(r.number).unwrap_or(usize::MAX);
            Some(SourceHealth {
                name: known.sources.get(number)?.to_string(),
                age_s: r.status.newest_s.map(|at| now.secs() - at),
                report: *r,
                uses: *status.uses.get(number)?,
            })
        };
        self.snapshot.sources.values().filter_map(source).collect()
    }
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
    pub fn rejected_last(&self) -> Option<&'static str> {
        let process = self.process(ProcessKind::Vessel)?;
        if let MetricValue::AccessRejection(last) = process.metric(MetricName::LastPeerRejection)? {
            return last.map(AccessRejection::name);
        }
        None
    }
}

impl Serialize for ObservedSituation {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let processes = || self.snapshot.processes.values();
        let metrics = |p: &ProcessState| -> Map<String, Value> {
            p.metrics.iter().map(|m| (m.key(), m.json())).collect()
        };
        let mut all = json!({
            "processes": processes().collect::<Vec<_>>(),
            "metrics": processes()
                .map(|p| (p.kind.name().to_owned(), metrics(p).into()))
                .collect::<Map<_, _>>(),
            "edited": self.known.edited,
        });
        let more = match &self.known.vessel {
            Some(known) => json!({
                "vessel": *self.snapshot.vessel,
                "sources": self.sources(),
                "certificate": known.certificate.read(),
                "rejected": self.rejected(),
                "rejected_last": self.rejected_last(),
            }),
            None => json!({
                "mission": *self.snapshot.mission,
                "autopilot": *self.snapshot.autopilot,
                "link": *self.snapshot.link,
                "deck": *self.snapshot.grant,
                "wave": *self.snapshot.wave,
                "response": self.snapshot.response,
                "still_armed_s": self.still_armed_s(),
            }),
        };
        if let (Value::Object(all), Value::Object(more)) = (&mut all, more) {
            all.extend(more);
        }
        all.serialize(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        msg::{Certificate, CertificateState, Header, Seq},
        time::Time,
    };

    /// The state of running processes is known from their reports alone, not from files or the present configuration.
    #[test]
    fn situation_by_topics_alone() {
        let reported = ComputerReport {
            header: Header::new(8, 0, 1, 1, Time::from_secs(100.0)),
            title: "vessel 8".into(),
            processes: Seq::filled([ProcessKind::Vessel]),
            edited: Some("vessel.toml was edited".into()),
            vessel: Some(VesselReport {
                clock: Time::from_secs(40.0),
                sources: Seq::filled(["receiver".into()]),
                certificate: CertificateState::Read(Certificate {
                    days_left: 12,
                    name: "vessel-8".into(),
                    ..Certificate::default()
                }),
                ..VesselReport::default()
            }),
            ..ComputerReport::default()
        };
        let mut measured = SourceReport::default();
        measured.status.newest_s = Some(39.5);
        let mut snapshot = Snapshot {
            vessel: VesselStatus::default().into(),
            sources: [(0, measured)].into(),
            ..Snapshot::default()
        };
        let configured = ComputerReport {
            title: "vessel 7".into(),
            vessel: Some(VesselReport::default()),
            ..ComputerReport::default()
        };
        let now_ns = 101_000_000_000;
        let waits = ObservedSituation::look(&snapshot, &configured, now_ns);
        assert_eq!(waits.known.title.as_str(), "vessel 7");
        assert!(waits.vessel().is_none(), "it has not reported what it is");
        snapshot.computer = reported.into();
        let s = ObservedSituation::look(&snapshot, &configured, now_ns);
        let all = serde_json::to_value(&s).unwrap();
        assert_eq!(s.known.title.as_str(), "vessel 8");
        assert_eq!(all["edited"], "vessel.toml was edited");
        assert_eq!(
            (&all["certificate"]["name"], &all["certificate"]["days_left"]),
            (&json!("vessel-8"), &json!(12))
        );
        assert_eq!(all["sources"][0]["name"], "receiver");
        let [receiver]: [SourceHealth; 1] = s.sources().try_into().unwrap();
        assert!(receiver.age_s.is_some_and(|age| (age - 1.5).abs() < 1e-9));
        assert_eq!(s.silent(), [(ProcessKind::Vessel, None)]);
        assert_eq!(s.unreported_s(), None);
        let later = ObservedSituation::look(&snapshot, &configured, 110_000_000_000);
        assert_eq!(later.unreported_s(), Some(10.0));
    }
}
