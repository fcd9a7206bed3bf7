//! Snapshot of the live system: one line while it flies, tables at the end and on demand.

use std::collections::BTreeMap;

use alight_shared::geodesy::Datum;
use alight_shared::msg::{
    AttitudeResponse, AutopilotState, DeckForecast, DroneState, LinkState, MissionState, Plan, SourceReport,
    VesselStatus,
};
use alight_shared::topics::{self, Topic};
use alight_shared::transport::process::{InputState, ProcessKind, ProcessState};
use alight_uav::autopilot::config::DisarmConfig;
use alight_uav::autopilot::still_armed_s;
use nalgebra::Vector3;

use crate::cells;
use crate::table::{Cell, Table};

/// Times from microseconds to seconds in four digits.
pub fn time(s: f64) -> String {
    if !s.is_finite() {
        "-".into()
    } else if s.abs() < 1e-3 {
        format!("{:.0} us", s * 1e6)
    } else if s.abs() < 1.0 {
        format!("{:.1} ms", s * 1e3)
    } else {
        format!("{s:.1} s")
    }
}

/// The newest that was seen of everything.
#[derive(Default)]
pub struct Snapshot {
    /// Processes by kind.
    pub processes: BTreeMap<ProcessKind, ProcessState>,
    /// Mission.
    pub mission: Option<MissionState>,
    /// The autopilot's state.
    pub autopilot: Option<AutopilotState>,
    /// Odometry.
    pub drone: Option<DroneState>,
    /// The deck's forecast.
    pub forecast: Option<DeckForecast>,
    /// Link.
    pub link: Option<LinkState>,
    /// Plan, and its age when it was looked at, s.
    pub plan: Option<(Plan, f64)>,
    /// How the drone's attitude answers set-points, by the pilot.
    pub response: Option<AttitudeResponse>,
    /// What the vessel's process knows.
    pub vessel: Option<VesselStatus>,
    /// The vessel's real sensors by their places in its configuration.
    pub sources: BTreeMap<u32, SourceReport>,
    /// What is said of a configuration that was edited since the start.
    pub edited: Option<String>,
}

impl Snapshot {
    /// Where the drone's frame begins, and how far away the deck is by the newest forecast, m.
    pub fn frame(&self) -> Option<(Datum, Option<f64>)> {
        let drone = self.drone?;
        let deck = self.forecast.and_then(|f| f.stages.first().copied());
        let apart = deck.map(|d| (drone.position() - Vector3::from(d.position)).norm());
        Some((drone.datum, apart))
    }
    /// Since the landing, s, of a drone that is landed and armed for longer than its disarm takes.
    pub fn still_armed_s(&self, disarm: &DisarmConfig) -> Option<f64> {
        let (mission, autopilot) = (self.mission.as_ref()?, self.autopilot.as_ref()?);
        still_armed_s(mission.header.at, mission, autopilot.armed, disarm)
    }
    /// One line of at most 100 columns.
    pub fn line(&self) -> String {
        if let (Some(vessel), None) = (&self.vessel, &self.mission) {
            let estimate = vessel.estimator.estimate_age_s.map_or("no estimate".into(), time);
            return format!("estimate {estimate} old, {} drones received", vessel.drones.len());
        }
        let state = self.mission.map_or("-", |m| m.state.name());
        let waiting = self.mission.map(|m| m.waiting.to_string()).unwrap_or_default();
        let link = self.link.map_or_else(
            || "link -".into(),
            |l| format!("link {} old, {:.0} % lost", time(l.age_s), 100.0 * l.loss),
        );
        let plan = self.plan.as_ref().map_or_else(
            || "no plan".into(),
            |(_, age_s)| format!("plan {} old", time(*age_s)),
        );
        let solve = self
            .processes
            .get(&ProcessKind::Planner)
            .map_or_else(String::new, |p| {
                format!(", solved in {}/{}", time(p.step_p50_s), time(p.step_p99_s))
            });
        let mut line = format!("{state}: {link}; {plan}{solve}; {waiting}");
        if let Some((cut, _)) = line.char_indices().nth(100) {
            line.truncate(cut);
        }
        line
    }

    /// A table of the processes: what they use, how long a step takes.
    pub fn usage(&self, now_ns: i64) -> String {
        let heads = [
            "process", "pid", "CPU %", "MB", "steps", "step p50", "step p99", "up",
        ];
        let mut table = Table::new(1.., heads);
        // The link to a real autopilot and the cameras' images stand beside those of a trial.
        let real = [
            ProcessKind::Autopilot,
            ProcessKind::Camera,
            ProcessKind::Uvdar,
            ProcessKind::View,
        ]
        .into_iter()
        .filter(|kind| self.processes.contains_key(kind));
        for kind in ProcessKind::ALL.into_iter().chain(real) {
            let Some(p) = self.processes.get(&kind) else {
                table.row(cells![kind.name(), "no report"]);
                continue;
            };
            let up_s = (p.at_ns - p.began_ns) as f64 * 1e-9;
            let old_s = (now_ns - p.at_ns) as f64 * 1e-9;
            let silent = old_s > topics::PROCESS.stale_after.secs();
            table.row(cells![
                kind.name(),
                p.pid,
                Cell::number(100.0 * p.cpu_s / up_s, 1),
                Cell::number(p.resident_bytes as f64 / 1e6, 1),
                p.steps,
                time(p.step_p50_s),
                time(p.step_p99_s),
                Cell::from(time(up_s)).note(if silent { "silent" } else { "" }),
            ]);
        }
        table.text()
    }

    /// Where the time goes between a measurement on the vessel and the set-point: the age of each
    /// message when it is read, and what a step takes.
    pub fn stages(&self) -> String {
        const STAGES: [(ProcessKind, &Topic); 6] = [
            (ProcessKind::Predictor, &topics::BRIDGE_ESTIMATE),
            (ProcessKind::Predictor, &topics::DRONE_STATE),
            (ProcessKind::Mission, &topics::FORECAST),
            (ProcessKind::Planner, &topics::FORECAST),
            (ProcessKind::Pilot, &topics::PLAN),
            (ProcessKind::World, &topics::SET_POINT),
        ];
        let mut table = Table::new(1.., ["age when read", "p50", "p99"]);
        for (reader, topic) in STAGES {
            let inputs = self.processes.get(&reader).map(|p| p.inputs);
            let is_it = |i: &&InputState| topic_name(i.topic) == Some(topic.name);
            if let Some(i) = inputs.as_ref().and_then(|inputs| inputs.iter().find(is_it)) {
                let name = format!("{} at the {}", topic.name, reader.name());
                table.row(cells![name, time(i.read_age_p50_s), time(i.read_age_p99_s)]);
            }
        }
        if let Some(p) = self.processes.get(&ProcessKind::Planner) {
            let name = "(a step of the planner takes)";
            table.row(cells![name, time(p.step_p50_s), time(p.step_p99_s)]);
        }
        table.text()
    }

    /// A table of what goes over the radio.
    pub fn radio(&self) -> String {
        let mut table = Table::new(2.., ["sender", "over the radio", "Hz", "bytes/s"]);
        let mut total = 0.0;
        for p in self.processes.values() {
            for f in p.flows.iter() {
                total += f64::from(f.bytes_per_s);
                let rates = [(f.rate_hz, 1), (f.bytes_per_s, 0)];
                let [hz, bytes] = rates.map(|(rate, digits)| Cell::number(f64::from(rate), digits));
                table.row(cells![
                    p.kind.name(),
                    topic_name(f.topic).unwrap_or("status"),
                    hz,
                    bytes
                ]);
            }
        }
        let note = "computed: 48 bytes of headers a message";
        table.row(cells!["all", "", "", Cell::number(total, 0).note(note)]);
        table.text()
    }

    /// A table of the topics as each process reads them.
    pub fn topics(&self) -> String {
        let heads = [
            "reader",
            "topic",
            "messages",
            "Hz",
            "missed",
            "age",
            "read at p50",
            "p99",
        ];
        let mut table = Table::new(2.., heads);
        for p in self.processes.values() {
            let up_s = ((p.at_ns - p.began_ns) as f64 * 1e-9).max(1e-3);
            for i in p.inputs.iter() {
                table.row(cells![
                    p.kind.name(),
                    topic_name(i.topic).unwrap_or("?"),
                    i.received,
                    Cell::number(i.received as f64 / up_s, 1),
                    i.missed,
                    time(i.age_s),
                    time(i.read_age_p50_s),
                    time(i.read_age_p99_s),
                ]);
            }
        }
        table.text()
    }
}

/// The topic of that number.
fn topic_name(number: u32) -> Option<&'static str> {
    topics::ALL.get(number as usize).map(|t| t.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_line_width() {
        assert_eq!(time(0.000_042), "42 us");
        assert_eq!(time(0.0217), "21.7 ms");
        assert_eq!(time(12.34), "12.3 s");
        assert_eq!(time(f64::INFINITY), "-");
        let snapshot = Snapshot {
            mission: Some(MissionState::default()),
            link: Some(LinkState {
                age_s: 0.062,
                loss: 0.02,
                ..LinkState::default()
            }),
            ..Snapshot::default()
        };
        let line = snapshot.line();
        assert!(
            line.contains("62.0 ms") && line.contains("2 % lost") && line.chars().count() <= 100,
            "{line}"
        );
    }
}
