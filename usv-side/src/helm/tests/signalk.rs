//! The handshake with an autopilot behind a Signal K server.

use super::*;

/// A boat, her autopilot as a server has it, and a drone that comes, at 10 Hz.
struct Served {
    node: HelmNode,
    t_s: f64,
    state: String,
    target: f64,
    heading_rad: f64,
    /// Answers on their way.
    answers: String,
    demand: Demand,
    checkpoint: Option<HelmCheckpoint>,
}

impl Served {
    fn new(state: &str) -> Served {
        Served {
            node: Served::node(),
            t_s: 0.0,
            state: state.into(),
            target: 0.0,
            heading_rad: 0.0,
            answers: String::new(),
            demand: Demand::Comes,
            checkpoint: None,
        }
    }
    fn node() -> HelmNode {
        HelmNode::new(&HelmConfig {
            output: HelmOutput::SignalK,
            connect: "ws://127.0.0.1:3000".into(),
            ..HelmConfig::default()
        })
    }
    fn serve(&mut self, line: &str) {
        let value = line.split_once("\"value\":");
        let value = value.map(|(_, value)| value.trim_matches(['}', '"']).to_owned());
        let body = match (line.split(' ').nth(1), value) {
            (Some("/state"), Some(state)) => {
                self.state = state;
                String::new()
            }
            (Some("/target"), Some(target)) => {
                self.target = target.parse().unwrap();
                String::new()
            }
            _ => format!("{{\"state\":\"{}\",\"target\":{}}}", self.state, self.target),
        };
        self.answers += &format!("{line} 200 {body}\n");
    }
    fn step(&mut self, answers: Vec<HelmAnswer>) -> HelmStatus {
        self.t_s += 0.1;
        let now = Time::from_secs(self.t_s);
        let rate_radps = match self.state == "auto" {
            true => wrap_angle(self.target - self.heading_rad).clamp(-0.12, 0.12),
            false => 0.0,
        };
        self.heading_rad = wrap_angle(self.heading_rad + 0.1 * rate_radps);
        let motion = BoatMotion {
            heading_rad: self.heading_rad,
            rate_radps,
            speed_mps: 5.0,
        };
        let advice = Goal {
            heading_rad: 0.7,
            speed_mps: 5.0,
            likelihood: Some(0.98),
            slope_sd: None,
        };
        let input = HelmIn {
            demand: self.demand,
            drone: Some(1),
            motion: Some((now, motion)),
            advice: Some(advice),
            answers,
            bytes: Some(core::mem::take(&mut self.answers).into_bytes()),
            checkpoint: self.checkpoint.take(),
            ..HelmIn::default()
        };
        let out = self.node.step(now, &input);
        let requests = String::from_utf8(out.bytes).unwrap();
        requests.lines().for_each(|line| self.serve(line));
        out.status
    }
    fn run(&mut self, seconds: f64) -> HelmStatus {
        for _ in 0..(10.0 * seconds) as u32 {
            self.step(Vec::new());
        }
        self.node.status()
    }
    /// Requested, agreed, and steered for so long, s.
    fn agreed(&mut self, seconds: f64) -> HelmStatus {
        let asked = self.run(2.0).asked().unwrap();
        self.step(vec![HelmAnswer::Yes(asked)]);
        self.run(seconds)
    }
}

#[test]
fn signalk_autopilot_asked_and_given_back() {
    for before in ["standby", "auto"] {
        let mut b = Served::new(before);
        assert_eq!(b.agreed(25.0).state, Steady, "{before}");
        assert!((b.heading_rad - 0.7).abs() < 0.05, "{before}: {}", b.heading_rad);
        b.demand = Demand::Nothing;
        assert_eq!(b.run(11.0).state, Done);
        assert_eq!(b.run(60.0).state, Idle);
        assert_eq!(b.state, before);
        assert!(b.heading_rad.abs() < 0.05, "{before}: {}", b.heading_rad);
    }
}

#[test]
fn skipper_takes_a_signalk_autopilot_back() {
    // By its key, by its knob, and by a no.
    let mut b = Served::new("auto");
    b.agreed(25.0);
    b.state = "standby".into();
    assert_eq!(b.run(3.0).why, HelmEnd::ModeChanged);
    assert_eq!(b.state, "standby");
    let mut b = Served::new("auto");
    b.agreed(25.0);
    b.target += 0.17;
    let theirs = b.target;
    assert_eq!(b.run(3.0).why, HelmEnd::ModeChanged);
    assert_eq!((b.state.as_str(), b.target), ("auto", theirs));
    let mut b = Served::new("standby");
    b.agreed(25.0);
    assert_eq!(b.step(vec![HelmAnswer::No]).why, HelmEnd::Refused);
    b.run(3.0);
    assert_eq!(b.state, "standby", "what was before is given back");
}

#[test]
fn signalk_helm_of_a_process_that_was_restarted() {
    let mut b = Served::new("standby");
    b.agreed(10.0);
    assert_eq!(b.state, "auto");
    b.checkpoint = b.node.checkpoint();
    b.node = Served::node();
    b.answers.clear();
    assert_eq!(b.step(Vec::new()).why, HelmEnd::Restarted);
    b.run(4.0);
    assert_eq!((b.state.as_str(), b.node.checkpoint()), ("standby", None));
}
