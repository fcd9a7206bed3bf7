use alight_shared::frames::wrap_angle;
use alight_shared::mavlink::{self, FrameReader, MavlinkSender, Outgoing};
use alight_shared::msg::AskedCourse;

use super::*;
use HelmState::{Asked, Done, Idle, Steady};

mod ending;
mod signalk;

const AUTO: u32 = 10;
const GUIDED: u32 = 15;
const MANUAL: u32 = 0;

/// A boat with its autopilot (ArduPilot Rover), its skipper and a drone, at 10 Hz.
struct Bench {
    node: HelmNode,
    t_s: f64,
    mode: u32,
    /// Heading, rad, and speed, m/s.
    motion: [f64; 2],
    /// Course that it steers in its own mode, and by set-points.
    own: [f64; 2],
    set_point: Option<[f64; 2]>,
    demand: Demand,
    drone: Option<u32>,
    advice: Goal,
    silent: bool,
    denies: bool,
    /// Time between two heartbeats, s, and when the next is due; it takes a mode so long after a request.
    beat_s: [f64; 2],
    takes_after_s: f64,
    requested: Option<(f64, u32)>,
    /// A hand turns the wheel whatever the autopilot does.
    hand: bool,
    /// It steers to the set-points that it takes.
    follows: bool,
    rate_radps: f64,
    consent: bool,
    turning: bool,
    ends: bool,
    frames: FrameReader,
    /// Answers of the boat's autopilot on their way.
    answers: Vec<u8>,
    modes_set: Vec<u32>,
    visited: Vec<HelmState>,
}

impl Bench {
    fn new() -> Bench {
        Bench::with(&HelmConfig {
            output: HelmOutput::Mavlink,
            connect: "udpin://127.0.0.1:14560".into(),
            consent_switch: "/dev/null".into(),
            ..HelmConfig::default()
        })
    }
    fn with(config: &HelmConfig) -> Bench {
        let own = [0.0, 5.0];
        Bench {
            node: HelmNode::new(config),
            t_s: 0.0,
            mode: AUTO,
            motion: own,
            own,
            set_point: None,
            demand: Demand::Comes,
            drone: Some(1),
            advice: Goal {
                heading_rad: 0.7,
                speed_mps: 2.0,
                likelihood: Some(0.98),
                slope_sd: None,
            },
            silent: false,
            denies: false,
            beat_s: [0.0; 2],
            takes_after_s: 0.0,
            requested: None,
            hand: false,
            follows: true,
            rate_radps: 0.0,
            consent: false,
            turning: false,
            ends: false,
            frames: FrameReader::default(),
            answers: Vec::new(),
            modes_set: Vec::new(),
            visited: vec![HelmState::Idle],
        }
    }
    fn now(&self) -> Time<VesselClock> {
        Time::from_secs(self.t_s)
    }
    /// The boat's answer to what came.
    fn boat(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.frames.push(bytes);
        let mut out = core::mem::take(&mut self.answers);
        let from = MavlinkSender {
            system: 1,
            component: 1,
            sequence: 0,
        };
        while let Some(raw) = self.frames.next_frame() {
            let p = raw.fields();
            match raw.id {
                76 if p.u16(28) == 176 => {
                    let result = if self.denies { 2 } else { 0 };
                    if !self.denies {
                        self.requested = Some((self.t_s, p.float(4) as u32));
                    }
                    out.extend(mavlink::encode(
                        from,
                        Outgoing::new(77, 143, vec![176, 0, result]),
                        None,
                    ));
                }
                84 => {
                    let (north, east) = (p.float(16), p.float(20));
                    self.set_point = Some([east.atan2(north), north.hypot(east)]);
                }
                _ => {}
            }
        }
        let takes = |(at, _): &(f64, u32)| self.t_s - at >= self.takes_after_s;
        if let Some((_, mode)) = self.requested.take_if(|r| takes(r)) {
            self.mode = mode;
            self.modes_set.push(mode);
        }
        let [period_s, due_s] = self.beat_s;
        if self.t_s < due_s {
            return if self.silent { Vec::new() } else { out };
        }
        self.beat_s = [period_s, self.t_s + period_s - 1e-3];
        let heartbeat = Outgoing::new(0, 50, [&self.mode.to_le_bytes()[..], &[11, 3, 81, 4, 3]].concat());
        out.extend(mavlink::encode(from, heartbeat, None));
        if self.silent { Vec::new() } else { out }
    }
    fn sail(&mut self) {
        let steered = self.follows && self.mode == GUIDED;
        let goal = self.set_point.filter(|_| steered).unwrap_or(self.own);
        let [heading, speed] = &mut self.motion;
        let turn = if self.hand {
            -0.15
        } else {
            wrap_angle(goal[0] - *heading).clamp(-0.12, 0.12)
        };
        *heading = wrap_angle(*heading + 0.1 * turn);
        *speed += 0.1 * (goal[1] - *speed).clamp(-0.4, 0.4);
    }
    /// A step with these answers by order; a yes is to what is asked now.
    fn step_with(&mut self, answers: Vec<bool>) -> HelmStatus {
        let asked = self.asked();
        let answer = |yes: bool| match yes {
            true => HelmAnswer::Yes(asked),
            false => HelmAnswer::No,
        };
        self.step_answered(answers.into_iter().map(answer).collect())
    }
    fn asked(&self) -> AskedCourse {
        self.node.status().asked().unwrap_or_default()
    }
    fn step_answered(&mut self, answers: Vec<HelmAnswer>) -> HelmStatus {
        self.t_s += 0.1;
        let [heading_rad, speed_mps] = self.motion;
        let bytes = self.boat(&[]);
        let input = HelmIn {
            demand: self.demand,
            drone: self.drone,
            motion: Some((
                self.now(),
                BoatMotion {
                    heading_rad,
                    rate_radps: self.rate_radps,
                    speed_mps,
                },
            )),
            place: None,
            advice: Some(self.advice),
            answers,
            consent: Some(self.consent),
            turning: self.turning,
            bytes: Some(bytes),
            checkpoint: None,
            ends: self.ends,
        };
        let out = self.node.step(self.now(), &input);
        self.answers = self.boat(&out.bytes);
        self.sail();
        if self.visited.last() != Some(&out.status.state) {
            self.visited.push(out.status.state);
        }
        out.status
    }
    fn run(&mut self, seconds: f64) -> HelmStatus {
        for _ in 0..(10.0 * seconds) as u32 {
            self.step_with(Vec::new());
        }
        self.node.status()
    }
    /// Asked, agreed, and steered for so long, s.
    fn agreed(&mut self, seconds: f64) -> HelmStatus {
        assert_eq!(self.run(1.0).state, HelmState::Asked);
        self.step_with(vec![true]);
        self.run(seconds)
    }
    fn heading_deg(&self) -> f64 {
        self.motion[0].to_degrees()
    }
}

#[test]
fn helm_that_is_asked_steers_and_gives_back() {
    let mut b = Bench::new();
    let asked = b.run(1.0);
    assert_eq!(
        (asked.state, asked.heading_deg(), asked.speed_mps),
        (HelmState::Asked, 40.0, 2.0)
    );
    assert_eq!(
        (b.mode, b.set_point),
        (AUTO, None),
        "nothing is commanded without his yes"
    );
    let agreed = b.step_with(vec![true]);
    assert_eq!(agreed.state, HelmState::Agreed);
    assert!((agreed.likelihood - 0.98).abs() < 1e-6 && (5.0..30.0).contains(&agreed.steady_in_s));
    b.run(1.0);
    assert_eq!(
        b.mode, AUTO,
        "a drone that has just begun its descent is waited for"
    );
    let steady = b.run(24.0);
    assert_eq!(steady.state, HelmState::Steady);
    assert!(
        (b.heading_deg() - 40.1).abs() < 2.0 && (b.motion[1] - 2.0).abs() < 0.2,
        "{:?}",
        b.motion
    );
    b.demand = Demand::Descends;
    assert_eq!(b.run(10.0).state, HelmState::Steady);
    b.demand = Demand::Stands;
    assert_eq!(b.run(59.0).state, HelmState::Steady, "the drone is secured first");
    assert_eq!(b.run(3.0).state, HelmState::Done);
    b.run(40.0);
    assert!(
        b.heading_deg().abs() < 3.0 && b.mode == AUTO,
        "{} {}",
        b.heading_deg(),
        b.mode
    );
    assert_eq!(b.modes_set, [GUIDED, AUTO]);
    assert_eq!(b.visited, [Idle, Asked, HelmState::Agreed, Steady, Done, Idle]);
}

#[test]
fn helm_without_a_yes() {
    let mut b = Bench::new();
    assert_eq!(b.run(1.0).state, HelmState::Asked);
    assert_eq!(b.step_with(vec![false]).why, HelmEnd::Refused);
    assert_eq!(b.run(100.0).why, HelmEnd::Refused, "once for a landing");
    b.demand = Demand::Nothing;
    assert_eq!(b.run(11.0).state, HelmState::Idle);
    b.demand = Demand::Comes;
    assert_eq!(
        b.run(1.0).state,
        HelmState::Asked,
        "the next landing is another question"
    );
    assert_eq!(b.run(61.0).why, HelmEnd::Unanswered);
    assert_eq!((b.mode, b.set_point), (AUTO, None));
    // Landed meanwhile.
    let mut b = Bench::new();
    b.run(1.0);
    b.demand = Demand::Descends;
    assert_eq!(b.run(1.0).state, HelmState::Idle);
}

#[test]
fn helm_for_a_take_off_alone() {
    let mut b = Bench::new();
    b.demand = Demand::Descends;
    b.run(5.0);
    b.demand = Demand::Stands;
    assert_eq!(b.run(20.0).state, HelmState::Idle, "it has just landed");
    b.demand = Demand::Comes;
    assert_eq!(b.run(1.0).state, HelmState::Asked, "it prepares its take-off");
    b.demand = Demand::Descends;
    assert_eq!(b.run(1.0).state, HelmState::Idle, "from the countdown on");
    assert_eq!(b.step_with(vec![true]).state, HelmState::Idle);
    b.demand = Demand::Comes;
    assert_eq!(b.run(1.0).state, HelmState::Asked, "the countdown ended early");
    b.step_with(vec![true]);
    assert_eq!(b.run(25.0).state, HelmState::Steady);
    b.demand = Demand::Descends;
    assert_eq!(b.run(8.0).state, HelmState::Steady);
    b.demand = Demand::Nothing;
    assert_eq!(b.run(11.0).state, HelmState::Done);
}

#[test]
fn question_about_one_course() {
    let mut b = Bench::new();
    assert_eq!(b.run(1.0).heading_deg(), 40.0);
    b.advice.heading_rad = -0.7;
    assert_eq!(
        b.run(1.0).heading_deg(),
        40.0,
        "better advice is no other question"
    );
    // She yaws within the errors of a course, and is then turned away by hand.
    b.advice.heading_rad = 0.7;
    b.own[0] = -0.3;
    assert_eq!(b.run(5.0).heading_deg(), 40.0);
    b.own[0] = -0.6;
    let asks = b.run(5.0);
    assert_eq!(
        b.visited[..4],
        [Idle, Asked, Idle, Asked],
        "not permitted from there"
    );
    // 60 deg, the limit, from where she was when she was asked, within an error.
    let limit = b.heading_deg() + 60.0;
    assert!(
        (asks.heading_deg() - limit).abs() < 6.5,
        "{} {limit}",
        asks.heading_deg()
    );
    // A yes to what is not permitted in that step does not count.
    let mut b = Bench::new();
    b.run(1.0);
    b.motion[0] = -0.6;
    assert_eq!(b.step_with(vec![true]).state, Idle);
    assert_eq!(b.run(1.0).state, Asked);
}

#[test]
fn yes_to_another_question() {
    let mut b = Bench::new();
    b.run(1.0);
    let read = b.asked();
    // Turned by hand beyond what the limits permit from there.
    (b.own[0], b.motion[0]) = (-0.6, -0.6);
    assert_eq!(b.run(0.5).state, Asked);
    assert_ne!(b.asked(), read);
    assert_eq!(b.step_answered(vec![HelmAnswer::Yes(read)]).state, Asked);
    assert_eq!(b.step_with(vec![true]).state, HelmState::Agreed);
    // He cannot have recognised by the lamp that this question is another.
    let mut b = Bench::new();
    b.run(2.0);
    assert!(!b.node.asks_by_lamp(b.now()));
    b.consent = true;
    assert_eq!(b.run(5.0).state, Asked);
    assert!(b.node.asks_by_lamp(b.now()));
}

#[test]
fn yes_for_a_drone_that_is_not_received() {
    let mut b = Bench::new();
    b.run(1.0);
    b.demand = Demand::Nothing;
    assert_eq!(b.run(9.0).state, Asked);
    assert_eq!(b.step_with(vec![true]).state, Asked);
    b.run(20.0);
    assert_eq!((b.mode, b.set_point, b.modes_set.len()), (AUTO, None, 0));
}

#[test]
fn acknowledgement_of_another_stations_request() {
    // A denial for the ground station, for us, and for all.
    for (target, why) in [
        ([255_u8, 190], HelmEnd::None),
        ([1, 190], HelmEnd::None),
        ([1, 191], HelmEnd::Denied),
        ([0, 0], HelmEnd::Denied),
    ] {
        let mut b = Bench::new();
        b.takes_after_s = 2.0;
        b.agreed(1.7);
        let from = MavlinkSender {
            system: 1,
            component: 1,
            sequence: 0,
        };
        let payload = [&[176_u8, 0, 2, 0, 0, 0, 0, 0][..], &target].concat();
        b.answers
            .extend(mavlink::encode(from, Outgoing::new(77, 143, payload), None));
        assert_eq!(b.run(0.1).why, why, "{target:?}");
    }
}

#[test]
fn descent_before_the_autopilot_has_taken_the_helm() {
    // Within the lead nothing was commanded.
    let mut b = Bench::new();
    b.agreed(1.0);
    b.demand = Demand::Descends;
    assert_eq!(b.run(0.1).why, HelmEnd::Descent);
    b.run(20.0);
    assert_eq!((b.mode, b.set_point, b.modes_set.len()), (AUTO, None, 0));
    // The mode was requested, and is taken under the descent: it is given back with the heartbeat that shows it.
    let mut b = Bench::new();
    (b.beat_s, b.takes_after_s) = ([1.0, 0.0], 0.4);
    b.agreed(1.7);
    b.demand = Demand::Descends;
    assert_eq!(b.run(0.1).why, HelmEnd::Descent);
    b.run(3.0);
    // Until a heartbeat shows it, it is asked for again.
    let (first, later) = b.modes_set.split_at(1);
    assert!(
        first == [GUIDED] && !later.is_empty() && later.iter().all(|m| *m == AUTO),
        "{:?}",
        b.modes_set
    );
    assert_eq!(b.mode, AUTO);
}

#[test]
fn drone_that_comes_for_ever() {
    let mut b = Bench::new();
    b.agreed(570.0);
    assert_eq!(b.node.status().state, Steady);
    assert_eq!(b.run(60.0).why, HelmEnd::TooLong);
    assert_eq!(b.mode, AUTO);
    assert_eq!(b.run(60.0).why, HelmEnd::TooLong, "once for a landing");
}

#[test]
fn yes_by_the_switch_and_its_opening() {
    let mut b = Bench::new();
    b.consent = true;
    assert_eq!(
        b.run(2.0).state,
        HelmState::Asked,
        "closed before he was asked is no answer"
    );
    b.consent = false;
    assert_eq!(b.run(0.1).why, HelmEnd::Refused);
    let mut b = Bench::new();
    b.run(4.0);
    b.consent = true;
    assert_eq!(b.run(25.0).state, HelmState::Steady);
    b.consent = false;
    assert_eq!(b.run(3.0).why, HelmEnd::Refused);
    assert_eq!(b.mode, AUTO, "given back at once");
}

#[test]
fn hands_on_the_helm() {
    // By the measured course: what was before is given back.
    let mut b = Bench::new();
    assert_eq!(b.agreed(25.0).state, HelmState::Steady);
    b.hand = true;
    assert_eq!(b.run(7.0).why, HelmEnd::HandOnHelm);
    assert_eq!(b.run(2.0).why, HelmEnd::HandOnHelm);
    assert_eq!(b.mode, AUTO);
    // By the mode: it stays as the hand has set it.
    let mut b = Bench::new();
    b.agreed(8.0);
    b.mode = MANUAL;
    assert_eq!(b.run(0.2).why, HelmEnd::ModeChanged);
    b.run(20.0);
    assert_eq!((b.mode, b.modes_set.as_slice()), (MANUAL, &[GUIDED][..]));
    // While she goes back, too.
    let mut b = Bench::new();
    b.agreed(25.0);
    b.demand = Demand::Nothing;
    assert_eq!(b.run(12.0).state, HelmState::Done);
    b.mode = MANUAL;
    b.run(20.0);
    assert!(b.visited.contains(&HelmState::Withdrawn));
    assert_eq!(b.mode, MANUAL);
    // The helm states a turn.
    let mut b = Bench::new();
    b.agreed(8.0);
    b.turning = true;
    assert_eq!(b.run(0.2).why, HelmEnd::Turning);
}

#[test]
fn autopilots_that_deny_or_fall_silent() {
    let mut b = Bench::new();
    b.denies = true;
    assert_eq!(b.agreed(5.0).why, HelmEnd::Denied);
    let mut b = Bench::new();
    b.silent = true;
    assert_eq!(
        b.run(5.0).state,
        HelmState::Idle,
        "the crew is not asked for a boat that cannot be steered"
    );
    let mut b = Bench::new();
    b.agreed(10.0);
    b.silent = true;
    assert_eq!(b.run(3.5).why, HelmEnd::LinkLost);
    b.silent = false;
    b.run(3.0);
    assert_eq!(b.mode, AUTO, "given back once it is there again");
}

#[test]
fn descent_before_the_vessel_is_steady() {
    let mut b = Bench::new();
    b.agreed(4.0);
    let turned = b.heading_deg();
    b.demand = Demand::Descends;
    let kept = b.run(0.1);
    assert_eq!(kept.state, HelmState::Steady);
    b.run(10.0);
    assert!(
        (b.heading_deg() - turned).abs() < 3.0,
        "{turned} {}",
        b.heading_deg()
    );
}

#[test]
fn marine_autopilot_by_nmea() {
    let mut b = Bench::with(&HelmConfig {
        output: HelmOutput::Nmea0183,
        connect: "serial:///dev/ttyUSB1:4800".into(),
        ..HelmConfig::default()
    });
    assert_eq!(b.run(1.0).speed_mps, 5.0, "its speed stays the skipper's");
    b.step_with(vec![true]);
    b.t_s += 2.0;
    let input = HelmIn {
        demand: Demand::Comes,
        bytes: Some(Vec::new()),
        motion: Some((
            b.now(),
            BoatMotion {
                heading_rad: 0.0,
                rate_radps: 0.0,
                speed_mps: 5.0,
            },
        )),
        place: Some(BoatPlace {
            datum: Datum::new(59.9, 10.6, 40.0),
            position_m: [0.0; 2],
        }),
        ..HelmIn::default()
    };
    let out = b.node.step(b.now(), &input);
    let text = String::from_utf8(out.bytes).unwrap();
    assert!(text.starts_with("$EIAPB,A,A,0.00,R,N,V,V,40.1,T,"), "{text}");
    // Five nautical miles on 040 are 3.8 to the north and 3.2 to the east.
    let waypoint = "$EIRMB,A,0.00,R,START,ALIGHT,5957.";
    assert!(
        text.contains(waypoint) && text.contains("$EIBWC,,5957."),
        "{text}"
    );
}

#[test]
fn marine_autopilot_that_reports_its_mode() {
    let mut b = Bench::with(&HelmConfig {
        output: HelmOutput::Nmea0183,
        connect: "serial:///dev/ttyUSB1:4800".into(),
        ..HelmConfig::default()
    });
    b.run(1.0);
    let mut reports = |answers: Vec<HelmAnswer>, after_s: f64, mode: &str| {
        b.t_s += after_s;
        let content = format!("AGHTD,V,,,{mode},N,,,,,340.0,,,T,A,A,A,339.0");
        let sum = content.bytes().fold(0_u8, |sum, byte| sum ^ byte);
        let motion = BoatMotion {
            heading_rad: 0.0,
            rate_radps: 0.0,
            speed_mps: 5.0,
        };
        let input = HelmIn {
            demand: Demand::Comes,
            motion: Some((b.now(), motion)),
            answers,
            bytes: Some(format!("\r\n${content}*{sum:02X}\r\n").into_bytes()),
            ..HelmIn::default()
        };
        b.node.step(b.now(), &input).status
    };
    let yes = HelmAnswer::Yes(AskedCourse {
        heading_deg: 40,
        speed_dmps: 50,
    });
    // He steers by hand until he has put it into track control, for which it wants our sentences.
    assert_eq!(reports(vec![yes], 0.1, "M").state, HelmState::Agreed);
    assert_eq!(reports(Vec::new(), 2.0, "M").state, HelmState::Agreed);
    assert_eq!(reports(Vec::new(), 6.0, "T").state, HelmState::Agreed);
    assert_eq!(reports(Vec::new(), 1.0, "S").why, HelmEnd::ModeChanged);
}
