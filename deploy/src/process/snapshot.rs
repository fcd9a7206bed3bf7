//! What a person sees of the live system: one line while it flies, tables at the end and on demand.

use std::collections::BTreeMap;

use alight_shared::msg::{LinkState, MissionState, Plan};
use alight_shared::topics::{self, Topic};
use alight_shared::transport::process::{InputState, ProcessKind, ProcessState};

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
    /// Link.
    pub link: Option<LinkState>,
    /// Plan, and its age when it was looked at, s.
    pub plan: Option<(Plan, f64)>,
}

impl Snapshot {
    /// One line of at most 100 columns.
    pub fn line(&self) -> String {
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
        let mut out = format!(
            "  {:<10}{:>8}{:>8}{:>9}{:>10}{:>12}{:>12}{:>9}\n",
            "process", "pid", "CPU %", "MB", "steps", "step p50", "step p99", "up"
        );
        // The link to a real autopilot and the cameras' images stand beside those of a trial.
        let real = [ProcessKind::Autopilot, ProcessKind::Camera, ProcessKind::Uvdar]
            .into_iter()
            .filter(|kind| self.processes.contains_key(kind));
        for kind in ProcessKind::ALL.into_iter().chain(real) {
            let Some(p) = self.processes.get(&kind) else {
                out.push_str(&format!("  {:<10}  no report\n", kind.name()));
                continue;
            };
            let up_s = (p.at_ns - p.began_ns) as f64 * 1e-9;
            let cpu = if up_s > 0.0 {
                100.0 * p.cpu_s / up_s
            } else {
                f64::NAN
            };
            let old_s = (now_ns - p.at_ns) as f64 * 1e-9;
            let note = if old_s > topics::PROCESS.stale_after.secs() {
                "  silent"
            } else {
                ""
            };
            out.push_str(&format!(
                "  {:<10}{:>8}{:>8.1}{:>9.1}{:>10}{:>12}{:>12}{:>9}{note}\n",
                p.kind.name(),
                p.pid,
                cpu,
                p.resident_bytes as f64 / 1e6,
                p.steps,
                time(p.step_p50_s),
                time(p.step_p99_s),
                time(up_s),
            ));
        }
        out
    }

    /// Where the time goes between a measurement on the vessel and the set-point: the age of each
    /// message when it is read, and what a step takes.
    pub fn stages(&self) -> String {
        const STAGES: [(ProcessKind, &Topic, &str); 6] = [
            (
                ProcessKind::Predictor,
                &topics::BRIDGE_ESTIMATE,
                "vessel's estimate at the predictor",
            ),
            (
                ProcessKind::Predictor,
                &topics::DRONE_STATE,
                "odometry at the predictor",
            ),
            (ProcessKind::Mission, &topics::FORECAST, "forecast at the mission"),
            (ProcessKind::Planner, &topics::FORECAST, "forecast at the planner"),
            (ProcessKind::Pilot, &topics::PLAN, "plan at the pilot"),
            (
                ProcessKind::World,
                &topics::SET_POINT,
                "set-point at the autopilot",
            ),
        ];
        let mut out = format!("  {:<36}{:>12}{:>12}\n", "age when read", "p50", "p99");
        let mut row = |name: &str, p50_s: f64, p99_s: f64| {
            out.push_str(&format!("  {name:<36}{:>12}{:>12}\n", time(p50_s), time(p99_s)));
        };
        for (reader, topic, name) in STAGES {
            let inputs = self.processes.get(&reader).map(|p| p.inputs);
            let is_it = |i: &&InputState| {
                topics::ALL
                    .get(i.topic as usize)
                    .is_some_and(|t| t.name == topic.name)
            };
            if let Some(i) = inputs.as_ref().and_then(|inputs| inputs.iter().find(is_it)) {
                row(name, i.read_age_p50_s, i.read_age_p99_s);
            }
        }
        if let Some(p) = self.processes.get(&ProcessKind::Planner) {
            row("(a step of the planner takes)", p.step_p50_s, p.step_p99_s);
        }
        out
    }

    /// A table of what goes over the radio.
    pub fn radio(&self) -> String {
        let mut out = format!(
            "  {:<10}{:<20}{:>8}{:>10}\n",
            "sender", "over the radio", "Hz", "bytes/s"
        );
        let mut total = 0.0;
        for p in self.processes.values() {
            for f in p.flows.iter() {
                let name = topics::ALL.get(f.topic as usize).map_or("status", |t| t.name);
                total += f.bytes_per_s;
                let who = p.kind.name();
                out.push_str(&format!(
                    "  {who:<10}{name:<20}{:>8.1}{:>10.0}\n",
                    f.rate_hz, f.bytes_per_s
                ));
            }
        }
        out.push_str(&format!(
            "  {:<10}{:<20}{:>8}{total:>10.0}  computed: 48 bytes of headers a message\n",
            "all", "", ""
        ));
        out
    }

    /// A table of the topics as each process reads them.
    pub fn topics(&self) -> String {
        let mut out = format!(
            "  {:<10}{:<20}{:>10}{:>8}{:>8}{:>12}{:>13}{:>13}\n",
            "reader", "topic", "messages", "Hz", "missed", "age", "read at p50", "p99"
        );
        for p in self.processes.values() {
            let up_s = ((p.at_ns - p.began_ns) as f64 * 1e-9).max(1e-3);
            for i in p.inputs.iter() {
                let name = topics::ALL.get(i.topic as usize).map_or("?", |t| t.name);
                out.push_str(&format!(
                    "  {:<10}{:<20}{:>10}{:>8.1}{:>8}{:>12}{:>13}{:>13}\n",
                    p.kind.name(),
                    name,
                    i.received,
                    i.received as f64 / up_s,
                    i.missed,
                    time(i.age_s),
                    time(i.read_age_p50_s),
                    time(i.read_age_p99_s),
                ));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_line_fits_100_columns_and_durations_are_short() {
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
