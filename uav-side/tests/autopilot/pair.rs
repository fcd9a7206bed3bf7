//! The link's node and the stand-in on one clock, with a wire between them that takes its time.

use std::collections::VecDeque;

use alight_shared::frames::Datum;
use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::Seq;
use alight_shared::msg::{
    AutopilotState, DeckForecast, DeckStage, DroneState, Header, MissionState, Motors, RangeSample, Reason,
    ReasonCode, SetPoint, SetPointKind, State,
};
use alight_shared::node::Node;
use alight_shared::time::{Span, Time};
use alight_uav::autopilot::message::{Address, CommandLong, Message};
use alight_uav::autopilot::modes::Firmware;
use alight_uav::autopilot::wire::{Decoder, encode};
use alight_uav::autopilot::{AutopilotIn, AutopilotLink, AutopilotLinkConfig, AutopilotOut};
use alight_uav::odometry::OdometryConfig;

use super::fake_autopilot::{FEET_M, FakeAutopilot};

/// Step of both, s.
pub const STEP_S: f64 = 0.005;
/// Time that bytes take on the wire, s.
const WIRE_S: f64 = 0.006;

/// What the pilot asks for, from what is known of the drone.
pub type Pilot = fn(&DroneState) -> SetPoint;

pub struct Pair {
    pub link: AutopilotLink,
    pub autopilot: FakeAutopilot,
    pub t_s: f64,
    pub pilot: Option<Pilot>,
    pub mission: State,
    /// The forecast says what the deck does, or nothing.
    pub forecast: bool,
    /// Whether bytes pass at all.
    pub cut: bool,
    pub states: Vec<AutopilotState>,
    pub odometry: Vec<(f64, DroneState)>,
    pub ranges: Vec<RangeSample>,
    pub texts: Vec<String>,
    /// Set-points said by the link: when, and which.
    pub said: Vec<(f64, Message)>,
    pub commands: Vec<(f64, CommandLong)>,
    /// The mission waits for the drone to fly.
    pub waits_for_flight: bool,
    /// Messages about the deck.
    pub offered: usize,
    to_us: VecDeque<(f64, Vec<u8>)>,
    to_it: VecDeque<(f64, Vec<u8>)>,
    decoder: Decoder,
    sequence: u32,
    wire_sequence: u8,
    newest: Option<DroneState>,
}

/// A pilot that holds where the drone is.
pub fn hold(d: &DroneState) -> SetPoint {
    SetPoint {
        kind: SetPointKind::Trajectory,
        position: d.position,
        ..SetPoint::default()
    }
}
/// A pilot that leads north at 1 m/s, as in tracking.
pub fn lead(d: &DroneState) -> SetPoint {
    SetPoint {
        velocity: [1.0, 0.0, 0.0],
        position: [d.position[0] + 0.5, d.position[1], d.position[2]],
        ..hold(d)
    }
}
/// A pilot that presses the drone down by attitude and thrust.
pub fn press(_: &DroneState) -> SetPoint {
    SetPoint {
        kind: SetPointKind::Attitude,
        thrust: 0.6 * super::fake_autopilot::HOVER,
        ..SetPoint::default()
    }
}
/// A pilot that believes to stand on the deck.
pub fn stop(d: &DroneState) -> SetPoint {
    SetPoint {
        motors: Motors::Stop,
        thrust: 0.0,
        attitude: d.attitude,
        ..press(d)
    }
}

impl Pair {
    pub fn new(firmware: Firmware, height_m: f64, config: &AutopilotLinkConfig) -> Pair {
        Pair::at(firmware, height_m, config, None)
    }
    /// With the other nodes' NED beginning at `datum`.
    pub fn at(firmware: Firmware, height_m: f64, config: &AutopilotLinkConfig, datum: Option<Datum>) -> Pair {
        let geometry = DroneGeometry {
            feet_below_m: FEET_M,
            ..DroneGeometry::default()
        };
        Pair {
            link: AutopilotLink::new(config, &OdometryConfig::default(), &geometry, true, datum, 1, 7),
            autopilot: FakeAutopilot::new(firmware, height_m),
            t_s: 1000.0,
            pilot: Some(hold),
            mission: State::Idle,
            forecast: true,
            cut: false,
            states: Vec::new(),
            odometry: Vec::new(),
            ranges: Vec::new(),
            texts: Vec::new(),
            said: Vec::new(),
            commands: Vec::new(),
            waits_for_flight: false,
            offered: 0,
            to_us: VecDeque::new(),
            to_it: VecDeque::new(),
            decoder: Decoder::default(),
            sequence: 0,
            wire_sequence: 0,
            newest: None,
        }
    }
    /// Ready, in our mode, flying under our command.
    pub fn commanding(firmware: Firmware, height_m: f64, config: &AutopilotLinkConfig) -> Pair {
        let mut p = Pair::new(firmware, height_m, config);
        p.run(5.0);
        assert!(
            p.autopilot.choose(FakeAutopilot::offboard_mode(firmware)),
            "the mode was refused: {}",
            p.link.control_authority()
        );
        p.run(1.0);
        assert!(
            p.link.control_authority().commands(),
            "{}",
            p.link.control_authority()
        );
        p
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as u32 {
            self.step();
        }
    }

    fn due(queue: &mut VecDeque<(f64, Vec<u8>)>, t_s: f64, cut: bool) -> Vec<Vec<u8>> {
        let mut out = Vec::new();
        while queue.front().is_some_and(|(at, _)| *at <= t_s) {
            out.extend(queue.pop_front().filter(|_| !cut).map(|(_, b)| b));
        }
        out
    }

    fn step(&mut self) {
        self.t_s += STEP_S;
        let bytes = Pair::due(&mut self.to_it, self.t_s, self.cut);
        for b in self.autopilot.step(self.t_s, &bytes) {
            self.to_us.push_back((self.t_s + WIRE_S, b));
        }
        for b in Pair::due(&mut self.to_us, self.t_s, self.cut) {
            self.decoder.push(&b);
        }
        let mut input = AutopilotIn::default();
        while let Some(f) = self.decoder.next_frame() {
            input.received.push(f);
        }
        self.sequence += 1;
        let now = Time::from_secs(self.t_s);
        let header = Header::new(1, 1, 1, self.sequence, now);
        if self.sequence.is_multiple_of(2) {
            input.set_point = self
                .newest
                .zip(self.pilot)
                .map(|(d, pilot)| SetPoint { header, ..pilot(&d) });
            input.mission = Some(MissionState {
                header,
                state: self.mission,
                waiting: Reason::plain(if self.waits_for_flight {
                    ReasonCode::NotFlying
                } else {
                    ReasonCode::NotCommanded
                }),
                ..MissionState::default()
            });
            input.forecast = self.forecast.then(|| self.deck(header));
        }
        let out = self.link.step(now, &input);
        self.take(out);
    }

    fn deck(&self, header: Header<alight_shared::time::DroneClock>) -> DeckForecast {
        let [z, speed] = self.autopilot.deck;
        // Below the drone, wherever it is.
        let [x, y, _] = self.newest.map_or([0.0; 3], |d| d.position);
        DeckForecast {
            header,
            step: Span::from_millis(50),
            stages: Seq::filled((0..41).map(|k| DeckStage {
                position: [x, y, z + speed * 0.05 * f64::from(k)],
                velocity: [0.0, 0.0, speed],
                ..DeckStage::default()
            })),
            ..DeckForecast::default()
        }
    }

    fn take(&mut self, out: AutopilotOut) {
        for m in &out.messages {
            match m {
                Message::Position(_) | Message::AttitudeThrust(_) => self.said.push((self.t_s, m.clone())),
                Message::LandingTarget { .. } | Message::Deck { .. } => self.offered += 1,
                Message::Command(c) => self.commands.push((self.t_s, *c)),
                _ => {}
            }
            self.wire_sequence = self.wire_sequence.wrapping_add(1);
            let bytes = encode(out.from, self.wire_sequence, m).expect("a message of this vocabulary");
            self.to_it.push_back((self.t_s + WIRE_S, bytes));
        }
        for o in out.odometry {
            self.newest = Some(o);
            self.odometry.push((self.t_s, o));
        }
        self.states.extend(out.state);
        self.ranges.extend(out.ranges);
        self.texts.extend(out.texts);
    }

    /// Set-points said since `t_s`.
    pub fn said_since(&self, t_s: f64) -> usize {
        self.said.iter().filter(|(t, _)| *t > t_s).count()
    }
    /// Commands of one number said so far.
    pub fn told(&self, command: u16) -> Vec<CommandLong> {
        self.commands
            .iter()
            .map(|(_, c)| *c)
            .filter(|c| c.command == command)
            .collect()
    }
    /// Bytes of somebody else on the same wire.
    pub fn inject(&mut self, from: Address, m: &Message) {
        let bytes = encode(from, 0, m).expect("a message of this vocabulary");
        self.to_us.push_back((self.t_s, bytes));
    }
}
