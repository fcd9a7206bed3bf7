//! A marine autopilot behind a Signal K server, by version 2 of the server's autopilot API: its state `auto` and a target
//! heading. The speed stays the skipper's.
//!
//! A plugin of the server knows the autopilot (`signalk-autopilot` those of Raymarine and Simrad on NMEA 2000). State and target
//! are read once a second; a server that does not answer, or whose autopilot has other states, has no autopilot for us. Requests
//! and answers are lines here, `METHOD PATH BODY` and the same with the status and the body of the answer behind it; whoever
//! owns the link makes HTTP of them. A target is in radians: PUT requests over the WebSocket take degrees with one plugin and
//! radians with another, and are not used.
//!
//! Source: SignalK/signalk-server, `docs/develop/rest-api/autopilot_api.md`.

use alight_shared::frames::wrap_angle;
use alight_shared::lines::{Cut, LineBuffer};
use alight_shared::time::{Span, Time, VesselClock};
use core::f64::consts::TAU;
use serde_json::Value;

use super::command::{HelmCommand, ReadBack};
use super::config::{HelmBearings, HelmConfig};

/// Time between two looks at the autopilot, and between two requests of a state or a target.
const PERIOD: Span = Span::from_millis(1000);
/// A report counts for so long: three periods and an answer.
const SILENT: Span = Span::from_millis(4000);
/// A target that was taken is in the report after this: an autopilot sends it on NMEA 2000 once a second.
const SHOWN: Span = Span::from_millis(8000);
/// A reported target is ours within this, rad: autopilots keep whole degrees.
const NEAR_RAD: f64 = 0.035;
/// Longest answer, bytes: state, target and every option of an autopilot are below two thousand.
const MAX_ANSWER: usize = 16 << 10;

/// The states that are known, by the numbers that a checkpoint has. In `auto` it steers to a heading.
const STATES: [&str; 4] = ["standby", "auto", "wind", "route"];
const AUTO: u32 = 1;

/// State and target of the autopilot, and when they were reported.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pilot {
    at: Time<VesselClock>,
    state: u32,
    /// From the north that the configuration names, rad.
    target_rad: Option<f64>,
}

/// The link to it.
#[derive(Clone, Debug)]
pub(super) struct SignalKHelm {
    /// True headings have this subtracted, rad.
    variation_rad: f64,
    lines: LineBuffer,
    pilot: Option<Pilot>,
    /// The state before the first request of a helm.
    before: Option<u32>,
    /// The heading that is requested, rad, and since when.
    goal: Option<(Time<VesselClock>, f64)>,
    /// The heading that the server took last.
    taken: Option<f64>,
    /// The former state is requested, and not reported yet.
    gives_back: bool,
    denied: bool,
    /// When the next look and the next request are due.
    due: [Option<Time<VesselClock>>; 2],
}

const LOOK: usize = 0;
const REQUEST: usize = 1;

impl SignalKHelm {
    /// With the bearings of this configuration.
    pub(super) fn new(config: &HelmConfig) -> SignalKHelm {
        let variation_rad = match config.bearings {
            HelmBearings::True => 0.0,
            HelmBearings::Magnetic => config.variation_rad().unwrap_or_default(),
        };
        SignalKHelm {
            variation_rad,
            lines: LineBuffer::new(MAX_ANSWER),
            pilot: None,
            before: None,
            goal: None,
            taken: None,
            gives_back: false,
            denied: false,
            due: [None; 2],
        }
    }
    /// Takes what came at `now`.
    pub(super) fn receive(&mut self, now: Time<VesselClock>, bytes: &[u8]) {
        for byte in bytes {
            if let Some(Cut::Line(line)) = self.lines.push(*byte) {
                let _other = core::str::from_utf8(&line).ok().and_then(|l| self.answer(now, l));
            }
        }
    }
    /// Takes an answer; None where the line has another form.
    fn answer(&mut self, now: Time<VesselClock>, line: &str) -> Option<()> {
        let mut parts = line.splitn(5, ' ');
        let (method, path, request) = (parts.next()?, parts.next()?, parts.next()?);
        let status: u16 = parts.next()?.parse().ok()?;
        let taken = (200..300).contains(&status);
        if taken && method == "PUT" {
            // It is looked at next.
            self.due[LOOK] = None;
        }
        match (method, path) {
            ("GET", _) if taken => self.pilot = pilot(now, parts.next()?),
            ("PUT", "/target") if taken => {
                let (_, goal) = self.goal.filter(|(_, goal)| target(*goal) == request)?;
                self.taken = Some(goal);
            }
            // No token, no right, no plugin. Others pass: a state is not reached at once.
            ("PUT", _) if matches!(status, 401 | 403 | 404 | 405 | 501) => {
                self.denied = self.goal.is_some();
            }
            _ => {}
        }
        Some(())
    }
    fn fresh(&self, now: Time<VesselClock>) -> Option<Pilot> {
        self.pilot.filter(|pilot| now - pilot.at <= SILENT)
    }
    /// State and target as the helm reads them. It is ours in `auto` with our target: with another one somebody has turned its
    /// knob. The state that we have requested is no choice of the skipper's while it waits for its target.
    pub(super) fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        let pilot = self.fresh(now);
        let in_auto = pilot.is_some_and(|p| p.state == AUTO);
        let has_ours = |(since, goal): (Time<VesselClock>, f64)| {
            let target = pilot.and_then(|p| p.target_rad);
            let is_near = target.is_none_or(|t| wrap_angle(t - goal).abs() <= NEAR_RAD);
            self.taken.is_some() && (is_near || now - since <= SHOWN)
        };
        let waits = in_auto && self.goal.is_some() && self.taken.is_none();
        ReadBack {
            present: pilot.is_some(),
            mode: match waits {
                true => self.before,
                false => pilot.map(|p| p.state),
            },
            reported: pilot.map(|p| p.at),
            is_ours: in_auto && (self.gives_back || self.goal.is_some_and(has_ours)),
            denied: self.denied,
            by_hand: false,
        }
    }
    fn is_due(&mut self, what: usize, now: Time<VesselClock>) -> bool {
        let due = self.due.get(what).copied().flatten().is_none_or(|at| now >= at);
        if let Some(at) = self.due.get_mut(what).filter(|_| due) {
            *at = Some(now + PERIOD);
        }
        due
    }
    /// The requests that are due at `now` for a command.
    pub(super) fn send(&mut self, now: Time<VesselClock>, command: &HelmCommand) -> Vec<u8> {
        let mut out = String::new();
        if self.is_due(LOOK, now) {
            out.push_str("GET / {}\n");
        }
        let state = self.fresh(now).map(|pilot| pilot.state);
        // A process that was started again does not know it yet.
        let may_be_auto = state.is_none_or(|state| state == AUTO);
        let request = match *command {
            HelmCommand::Nothing => {
                (self.goal, self.taken, self.denied) = (None, None, false);
                self.gives_back &= may_be_auto;
                None
            }
            HelmCommand::Steer { heading_rad, .. } => {
                let goal = (heading_rad - self.variation_rad).rem_euclid(TAU);
                self.steer(now, goal, state)
            }
            HelmCommand::GiveBack { mode } => {
                (self.goal, self.taken) = (None, None);
                let former = mode.filter(|mode| *mode != AUTO);
                let name = former.and_then(|mode| STATES.get(mode as usize).copied());
                self.gives_back = name.is_some() && may_be_auto;
                name.filter(|_| state == Some(AUTO)).map(put_state)
            }
        };
        if let Some(request) = request.filter(|_| self.is_due(REQUEST, now)) {
            out.push_str(&request);
        }
        out.into_bytes()
    }
    /// First the state, then the target, which plugins take in `auto` alone. A state that is left later is not requested again.
    fn steer(&mut self, now: Time<VesselClock>, goal: f64, state: Option<u32>) -> Option<String> {
        if self.goal.is_none() {
            (self.before, self.taken, self.denied) = (state, None, false);
            self.gives_back = false;
        }
        if self.goal.is_none_or(|(_, former)| former != goal) {
            self.goal = Some((now, goal));
            self.due[REQUEST] = None;
        }
        if state == Some(AUTO) {
            (self.taken != Some(goal)).then(|| format!("PUT /target {}\n", target(goal)))
        } else {
            self.taken.is_none().then(|| put_state("auto"))
        }
    }
}

fn put_state(name: &str) -> String {
    format!("PUT /state {{\"value\":\"{name}\"}}\n")
}
/// The body of a request for a target, rad.
fn target(goal: f64) -> String {
    format!("{{\"value\":{goal:.5}}}")
}

/// Reads the report of a server's default autopilot; None where that is in a state which is not known.
fn pilot(at: Time<VesselClock>, body: &str) -> Option<Pilot> {
    let report: Value = serde_json::from_str(body).ok()?;
    let name = report.get("state")?.as_str()?;
    let state = STATES.iter().position(|known| *known == name)?;
    Some(Pilot {
        at,
        state: u32::try_from(state).ok()?,
        target_rad: report.get("target").and_then(Value::as_f64),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A server with its autopilot, at 10 Hz.
    struct Server {
        helm: SignalKHelm,
        t_s: f64,
        state: &'static str,
        target: f64,
        /// Status of its answers to requests of a change.
        status: u16,
        puts: Vec<String>,
    }

    impl Server {
        fn new(state: &'static str, variation_deg: Option<f64>) -> Server {
            let config = HelmConfig {
                bearings: variation_deg.map_or(HelmBearings::True, |_| HelmBearings::Magnetic),
                variation_deg,
                ..HelmConfig::default()
            };
            Server {
                helm: SignalKHelm::new(&config),
                t_s: 0.0,
                state,
                target: 0.0,
                status: 200,
                puts: Vec::new(),
            }
        }
        fn read_back(&self) -> ReadBack {
            self.helm.read_back(Time::from_secs(self.t_s))
        }
        /// So many seconds with a command, each request answered at once; what is reported at their end.
        fn run(&mut self, lasts_s: f64, command: &HelmCommand) -> ReadBack {
            let end_s = self.t_s + lasts_s;
            while self.t_s < end_s - 1e-6 {
                self.t_s += 0.1;
                let now = Time::from_secs(self.t_s);
                let sent = String::from_utf8(self.helm.send(now, command)).unwrap();
                for line in sent.lines() {
                    let answer = self.serve(line);
                    self.helm.receive(now, format!("{line} {answer}\n").as_bytes());
                }
            }
            self.read_back()
        }
        fn serve(&mut self, line: &str) -> String {
            let value = |line: &str| {
                line.split("\"value\":")
                    .nth(1)
                    .map(|v| v.trim_end_matches('}').to_owned())
            };
            if line.starts_with("GET / ") {
                let (state, target) = (self.state, self.target);
                return format!(
                    "200 {{\"options\": {{}}, \"state\": \"{state}\", \"mode\": null, \"target\": {target}}}"
                );
            }
            self.puts.push(line.into());
            let in_auto = self.state == "auto";
            match line.split(' ').nth(1) {
                _ if self.status != 200 => format!("{} {{}}", self.status),
                Some("/state") => {
                    let known = STATES.iter().copied().find(|s| value(line).unwrap().contains(s));
                    self.state = known.unwrap();
                    "200 {}".into()
                }
                Some("/target") if in_auto => {
                    self.target = value(line).unwrap().parse().unwrap();
                    "200 {}".into()
                }
                _ => "400 {}".into(),
            }
        }
    }

    const STEER: HelmCommand = HelmCommand::Steer {
        heading_rad: 0.7,
        speed_mps: 2.0,
    };

    #[test]
    fn signalk_autopilot_from_standby_and_back() {
        let mut s = Server::new("standby", None);
        let idle = s.run(1.0, &HelmCommand::Nothing);
        assert!(idle.present && !idle.is_ours && idle.mode == Some(0), "{idle:?}");
        let steered = s.run(5.0, &STEER);
        assert_eq!(
            s.puts,
            [
                "PUT /state {\"value\":\"auto\"}",
                "PUT /target {\"value\":0.70000}"
            ]
        );
        assert!(steered.is_ours && steered.mode == Some(AUTO), "{steered:?}");
        // Another course, then back to where it was.
        let other = HelmCommand::Steer {
            heading_rad: -0.1,
            speed_mps: 2.0,
        };
        assert!(s.run(2.0, &other).is_ours);
        assert_eq!(s.puts.last().unwrap(), "PUT /target {\"value\":6.18319}");
        let given_back = s.run(3.0, &HelmCommand::GiveBack { mode: Some(0) });
        assert_eq!(s.puts.last().unwrap(), "PUT /state {\"value\":\"standby\"}");
        assert!(
            !given_back.is_ours && given_back.mode == Some(0),
            "{given_back:?}"
        );
        assert_eq!(s.puts.len(), 4, "each once: {:?}", s.puts);
    }

    #[test]
    fn signalk_autopilot_with_magnetic_headings() {
        let mut s = Server::new("auto", Some(10.0));
        assert!(
            !s.run(1.0, &HelmCommand::Nothing).is_ours,
            "the skipper's own heading"
        );
        assert!(s.run(3.0, &STEER).is_ours);
        assert_eq!(s.puts, ["PUT /target {\"value\":0.52547}"]);
        // It keeps the heading that it has.
        assert!(!s.run(3.0, &HelmCommand::GiveBack { mode: Some(AUTO) }).is_ours);
        assert_eq!(s.puts.len(), 1);
    }

    #[test]
    fn hand_on_a_signalk_autopilot() {
        let mut s = Server::new("auto", None);
        s.run(1.0, &HelmCommand::Nothing);
        assert!(s.run(9.0, &STEER).is_ours);
        s.target += 0.17;
        assert!(!s.run(1.5, &STEER).is_ours, "ten degrees by its knob");
        assert_eq!(s.puts.len(), 1, "it is not turned back");
        let mut s = Server::new("auto", None);
        s.run(1.0, &HelmCommand::Nothing);
        s.run(3.0, &STEER);
        s.state = "standby";
        let by_hand = s.run(1.5, &STEER);
        assert!(!by_hand.is_ours && by_hand.mode == Some(0), "{by_hand:?}");
        assert_eq!(s.puts.len(), 1, "the state is not requested again");
    }

    #[test]
    fn signalk_server_that_denies_or_falls_silent() {
        let mut s = Server::new("standby", None);
        s.run(1.0, &HelmCommand::Nothing);
        s.status = 403;
        assert!(s.run(1.5, &STEER).denied);
        assert!(!s.run(1.0, &HelmCommand::Nothing).denied);
        // A failure that passes is no denial.
        s.status = 502;
        let failed = s.run(1.5, &STEER);
        assert!(!failed.denied && !failed.is_ours && failed.present, "{failed:?}");
        s.t_s += 4.1;
        assert!(!s.read_back().present);
        // A state that we cannot bring back, and one that is not there.
        for state in ["enabled", "off-line"] {
            let mut s = Server::new(state, None);
            assert!(!s.run(2.0, &HelmCommand::Nothing).present, "{state}");
        }
    }

    #[test]
    fn signalk_state_that_is_not_given_back() {
        let mut s = Server::new("standby", None);
        s.run(1.0, &HelmCommand::Nothing);
        assert!(s.run(3.0, &STEER).is_ours);
        s.status = 502;
        let give = HelmCommand::GiveBack { mode: Some(0) };
        assert!(s.run(3.0, &give).is_steered());
        assert!(
            s.run(3.0, &HelmCommand::Nothing).is_steered(),
            "until he sets another"
        );
        s.state = "standby";
        assert!(!s.run(1.5, &HelmCommand::Nothing).is_steered());
    }
}
