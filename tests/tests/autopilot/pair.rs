//! The link's node and an autopilot at protocol level on one clock, with what a pilot, a mission and a
//! predictor send it.

use alight_shared::frames::Datum;
use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::Seq;
use alight_shared::msg::{
    AutopilotState, BatteryPlace, DeckForecast, DeckStage, DroneState, Header, MissionState, Motors,
    RangeSample, Reason, ReasonCode, SetPoint, SetPointKind, State,
};
use alight_shared::time::{DroneClock, Span, Time};
use alight_sim::autopilots::fake::{FEET_M, FakeAutopilot, HOVER};
use alight_uav::autopilot::message::{Address, CommandLong, Message};
use alight_uav::autopilot::modes::Firmware;
use alight_uav::autopilot::wire::encode;
use alight_uav::autopilot::{AutopilotLink, AutopilotLinkConfig, AutopilotOut, ControlAuthority};
use alight_uav::odometry::OdometryConfig;

use crate::wired::Wired;

/// Step of both, s.
pub const STEP_S: f64 = 0.005;
/// Time that bytes take on the wire, s.
const WIRE_S: f64 = 0.006;

/// The pilot's set-point for a state of the drone.
pub type Pilot = fn(&DroneState) -> SetPoint;

pub struct Pair {
    pub wired: Wired,
    pub t_s: f64,
    pub pilot: Option<Pilot>,
    pub mission: State,
    /// The mission says nothing any more.
    pub mission_silent: bool,
    pub low_battery: Option<BatteryPlace>,
    /// A forecast of the deck is there.
    pub forecast: bool,
    pub states: Vec<AutopilotState>,
    pub odometry: Vec<(f64, DroneState)>,
    pub ranges: Vec<RangeSample>,
    pub texts: Vec<String>,
    /// Set-points sent by the link: when, and which.
    pub sent: Vec<(f64, Message)>,
    pub commands: Vec<(f64, CommandLong)>,
    /// The mission waits for the drone to fly.
    pub waits_for_flight: bool,
    /// Messages about the deck.
    pub deck_messages: usize,
    sequence: u32,
    newest: Option<DroneState>,
    dead: bool,
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
        thrust: 0.6 * HOVER,
        ..SetPoint::default()
    }
}
/// A pilot that reports a touchdown.
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
        let odometry = OdometryConfig::default();
        let config = config.clone();
        let link = move |boot| AutopilotLink::new(&config, &odometry, &geometry, true, datum, 1, boot);
        let autopilot = FakeAutopilot::new(firmware, height_m);
        Pair {
            wired: Wired::new(link, autopilot, WIRE_S),
            t_s: 1000.0,
            pilot: Some(hold),
            mission: State::Idle,
            mission_silent: false,
            low_battery: None,
            forecast: true,
            states: Vec::new(),
            odometry: Vec::new(),
            ranges: Vec::new(),
            texts: Vec::new(),
            sent: Vec::new(),
            commands: Vec::new(),
            waits_for_flight: false,
            deck_messages: 0,
            sequence: 0,
            newest: None,
            dead: false,
        }
    }
    /// Ready, in our mode, flying under our command.
    pub fn commanding(firmware: Firmware, height_m: f64, config: &AutopilotLinkConfig) -> Pair {
        let mut p = Pair::new(firmware, height_m, config);
        p.run(5.0);
        p.give_the_mode();
        p.run(1.0);
        p.assert_commanding();
        p
    }

    /// The link's process is dead for so long, s; then a new one begins.
    pub fn restart_link(&mut self, away_s: f64) {
        self.dead = true;
        self.run(away_s);
        self.wired.restart_link();
        self.dead = false;
    }
    /// A person chooses the mode that takes set-points.
    pub fn give_the_mode(&mut self) {
        let a = &mut self.wired.autopilot;
        let accepted = a.choose(FakeAutopilot::offboard_mode(a.firmware));
        assert!(accepted, "the mode was denied: {}", self.authority());
    }
    pub fn authority(&self) -> ControlAuthority {
        self.wired.link.control_authority()
    }
    #[track_caller]
    pub fn assert_commanding(&self) {
        assert!(self.authority().commands(), "{}", self.authority());
    }
    /// Since when no set-point was sent, s.
    pub fn silent_since(&self) -> f64 {
        self.sent.last().expect("set-points").0
    }
    /// The newest state that the link reports.
    pub fn state(&self) -> &AutopilotState {
        self.states.last().expect("states")
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as u32 {
            self.step();
        }
    }

    fn step(&mut self) {
        self.t_s += STEP_S;
        self.wired.step_autopilot(self.t_s, 0.0);
        let mut input = self.wired.received(self.t_s);
        if self.dead {
            return;
        }
        self.sequence += 1;
        let now = Time::from_secs(self.t_s);
        let header = Header::new(1, 1, 1, self.sequence, now);
        if self.sequence.is_multiple_of(2) {
            input.set_point = self
                .newest
                .zip(self.pilot)
                .map(|(d, pilot)| SetPoint { header, ..pilot(&d) });
            let mission = MissionState {
                header,
                state: self.mission,
                low_battery: self.low_battery,
                waiting: Reason::plain(if self.waits_for_flight {
                    ReasonCode::NotFlying
                } else {
                    ReasonCode::NotCommanded
                }),
                ..MissionState::default()
            };
            input.mission = (!self.mission_silent).then_some(mission);
            input.forecast = self.forecast.then(|| self.deck(header));
        }
        let out = self.wired.step_link(self.t_s, now, &input);
        self.take(out);
    }

    fn deck(&self, header: Header<DroneClock>) -> DeckForecast {
        let [z, speed] = self.wired.autopilot.deck;
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
                Message::Position(_) | Message::AttitudeThrust(_) => self.sent.push((self.t_s, m.clone())),
                Message::LandingTarget { .. } | Message::Deck { .. } => self.deck_messages += 1,
                Message::Command(c) => self.commands.push((self.t_s, *c)),
                _ => {}
            }
        }
        for o in out.odometry {
            self.newest = Some(o);
            self.odometry.push((self.t_s, o));
        }
        self.states.extend(out.state);
        self.ranges.extend(out.ranges);
        self.texts.extend(out.texts);
    }

    /// Set-points sent since `t_s`.
    pub fn sent_since(&self, t_s: f64) -> usize {
        self.sent.iter().filter(|(t, _)| *t > t_s).count()
    }
    /// Commands of one number sent so far.
    pub fn commands_of(&self, command: u16) -> Vec<CommandLong> {
        self.commands
            .iter()
            .map(|(_, c)| *c)
            .filter(|c| c.command == command)
            .collect()
    }
    /// Bytes of somebody else on the same wire.
    pub fn inject(&mut self, from: Address, m: &Message) {
        let bytes = encode(from, 0, m).expect("a message of this vocabulary");
        self.wired.up.send(self.t_s, bytes);
    }
}
