//! The link's node and the simulated autopilot on a common clock, above a deck at rest, with inputs from
//! pilot, mission and predictor.

use alight_shared::{
    frames::{Deck, Point},
    geometry::{DeckGeometry, DroneGeometry, GRAVITY},
    mavlink::dialect::LANDING_TARGET_DATA,
    msg::{
        AutopilotMode, AutopilotState, BatteryPlace, Command, CommandKind, DeckForecast, DeckStage,
        DroneState, Header, LastResort, LinkCheckpoint, MissionSettings, MissionState, Motors, RangeSample,
        Reason, ReasonCode, Seq, SetPoint, SetPointKind, SettingsOrder, State,
    },
    node::Node as _,
    time::{DroneClock, DroneTime, Span, Time, WorldTime},
};
use alight_sim::{
    autopilots::simulated::{SimulatedAutopilot, mode_number},
    harness::link::LinkedAutopilot,
    physics::{
        body::RigidState,
        drone::{DroneConfig, DroneStart, NavigationConfig, SimulatedDrone},
        streams::Streams,
    },
};
use alight_uav::{
    autopilot::{
        AutopilotIn, AutopilotLink, AutopilotLinkConfig, AutopilotOut, ControlAuthority,
        message::{
            Address, CommandLong, MavCmd, MavMessage as M, MavResult, MavlinkFrame, MavlinkMessage,
            TargetAbsolute, TargetRelative, text,
        },
        modes::Firmware,
    },
    mission::MissionConfig,
    odometry::OdometryConfig,
};
use nalgebra::Vector3;

const BOOT: u32 = 7;
/// Step of the autopilot; a period of the link contains several.
pub const STEP: Span = Span::from_millis(5);
const TURNS: u32 = 2;

pub fn hover() -> f64 {
    let g = DroneGeometry::default();
    g.mass_kg * GRAVITY / g.max_thrust_n
}

fn quiet(firmware: Firmware) -> DroneConfig {
    let mut c = DroneConfig::default();
    (c.airframe.mass_error, c.airframe.thrust_error) = (0.0, 0.0);
    c.autopilot.firmware = firmware;
    c.autopilot.wire_s = 0.006;
    c.navigation = NavigationConfig::without_errors();
    c
}

pub type PilotControl = fn(&DroneState) -> SetPoint;

pub struct LinkRig {
    /// Frames that the link has received last.
    pub received: Vec<MavlinkFrame>,
    pub linked: LinkedAutopilot,
    /// The link; None: its process is dead.
    pub link: Option<AutopilotLink>,
    /// Checkpoint stored by the supervisor.
    pub kept: LinkCheckpoint,
    make: Box<dyn Fn(u32) -> AutopilotLink>,
    boot: u32,
    pub t_s: f64,
    drone: SimulatedDrone,
    pub on_deck: bool,
    pub pilot: Option<PilotControl>,
    pub mission: State,
    since: DroneTime,
    published: State,
    pub mission_silent: bool,
    pub low_battery: Option<BatteryPlace>,
    pub last_resort: Option<LastResort>,
    /// Charge according to the mission, 0 to 1.
    pub counted: Option<f64>,
    /// Newest abort that the mission received.
    pub abort: Option<[u32; 2]>,
    /// Newest order other than an abort, reported while the mission waits for the drone to fly.
    order: Option<[u32; 2]>,
    /// The forecast contains a deck.
    pub forecast: bool,
    pub states: Vec<AutopilotState>,
    pub odometry: Vec<(f64, DroneState)>,
    pub ranges: Vec<RangeSample>,
    pub texts: Vec<String>,
    /// Set-points from the link, with their times, s.
    pub sent: Vec<(f64, MavlinkMessage)>,
    pub commands: Vec<(f64, CommandLong)>,
    pub waits_for_flight: bool,
    /// Condition that the mission waits for, unless it waits for an order.
    pub waiting: Option<ReasonCode>,
    /// Texts for a ground station, with their severity.
    pub notes: Vec<(u8, String)>,
    /// Named values: time, s; name; value.
    pub values: Vec<(f64, String, f64)>,
    /// Heartbeats of the companion computer: time, s; address; heartbeat.
    pub heartbeats: Vec<(f64, Address, MavlinkMessage)>,
    pub orders: Vec<Command>,
    pub answers: Vec<(MavCmd, MavResult)>,
    pub answered: Vec<Address>,
    pub parameters: Vec<(String, f32)>,
    /// Mission settings from ground stations.
    pub settings: Vec<SettingsOrder>,
    pub mission_settings: MissionSettings,
    pub settable: bool,
    /// Number of messages that describe the deck.
    pub deck_messages: usize,
    /// Deck centre relative to the point below the drone, north and east, m.
    pub deck_offset: [f64; 2],
    pub targets: Vec<LANDING_TARGET_DATA>,
    /// Targets for the autopilot's target estimator.
    pub relative: Vec<TargetRelative>,
    pub absolute: Vec<TargetAbsolute>,
    sequence: u32,
    newest: Option<DroneState>,
}

pub fn hold(d: &DroneState) -> SetPoint {
    SetPoint {
        kind: SetPointKind::Trajectory,
        position: d.position,
        yaw: d.euler().z,
        ..SetPoint::default()
    }
}
/// Leads north at 1 m/s, as when tracking.
pub fn lead(d: &DroneState) -> SetPoint {
    SetPoint {
        velocity: [1.0, 0.0, 0.0],
        position: [d.position[0] + 0.5, d.position[1], d.position[2]],
        ..hold(d)
    }
}
/// Presses the drone down by attitude and thrust.
pub fn press(_: &DroneState) -> SetPoint {
    SetPoint {
        kind: SetPointKind::Attitude,
        thrust: 0.6 * hover(),
        ..SetPoint::default()
    }
}
pub fn stop(d: &DroneState) -> SetPoint {
    SetPoint {
        motors: Motors::Stop,
        thrust: 0.0,
        attitude: d.attitude,
        ..press(d)
    }
}

impl LinkRig {
    pub fn new(firmware: Firmware, height_m: f64, config: &AutopilotLinkConfig) -> LinkRig {
        LinkRig::at(firmware, height_m, 0.0, config)
    }
    pub fn at(firmware: Firmware, height_m: f64, yaw: f64, config: &AutopilotLinkConfig) -> LinkRig {
        let geometry = DroneGeometry::default();
        let streams = Streams::new(1);
        let t_s = 1000.0;
        let odometry = OdometryConfig::default();
        let config = config.clone();
        let c = quiet(firmware);
        let position = Vector3::new(0.0, 0.0, -height_m);
        let start = DroneStart { position, yaw };
        let drone = SimulatedDrone::new(
            &c,
            &geometry,
            &DeckGeometry::default(),
            Seq::new(),
            &streams,
            start,
        );
        let state = drone.plant_state(Time::from_secs(t_s));
        let hover = drone.hover_thrust();
        let make = move |boot| AutopilotLink::new(&config, &odometry, &geometry, true, 1, boot);
        let autopilot =
            SimulatedAutopilot::new(&c.autopilot, &c.navigation, &geometry, &streams, &state, hover);
        LinkRig {
            received: Vec::new(),
            linked: LinkedAutopilot::new(&c.autopilot, &streams, autopilot),
            link: Some(make(BOOT)),
            kept: LinkCheckpoint::default(),
            make: Box::new(make),
            boot: BOOT,
            t_s,
            drone,
            on_deck: false,
            pilot: Some(hold),
            mission: State::Idle,
            since: Time::EPOCH,
            published: State::Idle,
            mission_silent: false,
            low_battery: None,
            last_resort: None,
            counted: None,
            abort: None,
            order: None,
            forecast: true,
            states: Vec::new(),
            odometry: Vec::new(),
            ranges: Vec::new(),
            texts: Vec::new(),
            sent: Vec::new(),
            commands: Vec::new(),
            waits_for_flight: false,
            waiting: None,
            notes: Vec::new(),
            values: Vec::new(),
            heartbeats: Vec::new(),
            orders: Vec::new(),
            answers: Vec::new(),
            answered: Vec::new(),
            parameters: Vec::new(),
            settings: Vec::new(),
            mission_settings: MissionConfig::default().settings(),
            settable: true,
            deck_messages: 0,
            deck_offset: [0.0; 2],
            targets: Vec::new(),
            relative: Vec::new(),
            absolute: Vec::new(),
            sequence: 0,
            newest: None,
        }
    }
    /// Rig that is ready, in OFFBOARD (GUIDED), and commanding the drone.
    pub fn commanding(firmware: Firmware, height_m: f64, config: &AutopilotLinkConfig) -> LinkRig {
        let mut p = LinkRig::new(firmware, height_m, config);
        p.take_command();
        p
    }
    /// As pilot, selects OFFBOARD (GUIDED) once the link is ready.
    pub fn take_command(&mut self) {
        self.run(5.0);
        self.give_the_mode();
        self.run(1.0);
        self.assert_commanding();
    }

    pub fn restart_link(&mut self, away_s: f64) {
        self.link = None;
        self.run(away_s);
        self.boot += 1;
        self.link = Some((self.make)(self.boot));
    }
    /// As pilot, selects the mode that accepts set-points.
    pub fn give_the_mode(&mut self) {
        let accepted = self.choose(AutopilotMode::Offboard);
        assert!(accepted, "the mode was denied: {}", self.authority());
    }
    /// As pilot, selects a mode; returns true if it was entered.
    pub fn choose(&mut self, mode: AutopilotMode) -> bool {
        let a = &mut self.linked.autopilot;
        a.choose(mode_number(a.firmware(), mode))
    }
    pub fn mode(&self) -> AutopilotMode {
        let a = &self.linked.autopilot;
        a.firmware().mode(a.mode())
    }
    pub fn truth(&self) -> RigidState<alight_shared::frames::DroneBody> {
        self.drone.truth()
    }
    pub fn authority(&self) -> ControlAuthority {
        let link = self.link.as_ref();
        link.map_or(ControlAuthority::Searching, AutopilotLink::control_authority)
    }
    #[track_caller]
    pub fn assert_commanding(&self) {
        assert!(self.authority().commands(), "{}", self.authority());
    }
    /// Time of the last set-point, s.
    pub fn silent_since(&self) -> f64 {
        self.sent.last().expect("set-points").0
    }
    /// Number of resets of the odometry frame.
    pub fn frames(&self) -> u8 {
        self.odometry.last().map_or(0, |(_, o)| o.frames)
    }
    pub fn state(&self) -> &AutopilotState {
        self.states.last().expect("states")
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP.secs()).round() as u32 {
            self.step();
        }
    }

    fn step(&mut self) {
        let deck = RigidState::<Deck> {
            position: Point::new(0.0, 0.0, 0.0),
            ..RigidState::default()
        };
        let t = WorldTime::from_secs(self.t_s);
        let range = RangeSample {
            range_m: -self.truth().position.0.z - 0.08,
            variance: 4e-4,
            ..RangeSample::default()
        };
        self.linked.autopilot.take_range(t, range);
        let linked = &mut self.linked;
        let reports = self
            .drone
            .step(t, STEP, &[deck; 2], 100.0, TURNS, |truth| linked.turn(truth));
        self.on_deck = reports.iter().any(|r| r.feet.contains(&true));
        self.t_s += STEP.secs();
        let t = Time::from_secs(self.t_s);
        let now = Time::from_secs(self.t_s);
        let received = self.linked.received(t);
        self.received.clone_from(&received);
        self.step_link(
            (t, now),
            AutopilotIn {
                received,
                ..AutopilotIn::default()
            },
        );
        let mut input = AutopilotIn::default();
        self.sequence += 1;
        let header = Header::new(1, 1, 1, self.sequence, now);
        if self.published != self.mission {
            (self.published, self.since) = (self.mission, now);
        }
        if self.sequence.is_multiple_of(2) {
            input.set_point = self
                .newest
                .zip(self.pilot)
                .map(|(d, pilot)| SetPoint { header, ..pilot(&d) });
            let mission = MissionState {
                header,
                state: self.mission,
                since: self.since,
                low_battery: self.low_battery,
                last_resort: self.last_resort,
                battery: self.counted,
                abort: self.abort,
                order: self.order.filter(|_| self.waits_for_flight),
                settings: self.mission_settings,
                settable: self.settable,
                waiting: Reason::plain(self.waiting.unwrap_or(if self.waits_for_flight {
                    ReasonCode::NotFlying
                } else {
                    ReasonCode::NotCommanded
                })),
                ..MissionState::default()
            };
            let newest = self.orders.iter().rev().find(|c| c.kind != CommandKind::Abort);
            self.order = newest.map(|c| [c.header.boot, c.header.sequence]).or(self.order);
            input.mission = (!self.mission_silent).then_some(mission);
            input.forecast = self.forecast.then(|| self.deck(header));
        }
        self.step_link((t, now), input);
    }
    fn step_link(&mut self, (t, now): (WorldTime, DroneTime), input: AutopilotIn) {
        let Some(link) = &mut self.link else { return };
        let checkpoint = Some(self.kept);
        let out = link.step(now, &AutopilotIn { checkpoint, ..input });
        self.kept = out.checkpoint.unwrap_or(self.kept);
        self.linked.send(t, &out);
        self.take(out);
    }

    fn deck(&self, header: Header<DroneClock>) -> DeckForecast {
        // Position below the drone, wherever it is.
        let [x, y, _] = self.newest.map_or([0.0; 3], |d| d.position);
        let [north, east] = self.deck_offset;
        DeckForecast {
            header,
            step: Span::from_millis(50),
            stages: Seq::filled((0..41).map(|_| DeckStage {
                position: [x + north, y + east, 0.0],
                ..DeckStage::default()
            })),
            ..DeckForecast::default()
        }
    }

    fn take(&mut self, out: AutopilotOut) {
        for m in &out.messages {
            match m {
                MavlinkMessage::Position(_) | MavlinkMessage::AttitudeThrust(_) => {
                    self.sent.push((self.t_s, m.clone()))
                }
                MavlinkMessage::TargetRelative(t) => self.relative.push(*t),
                MavlinkMessage::TargetAbsolute(t) => self.absolute.push(*t),
                MavlinkMessage::Text { severity, text } => self.notes.push((*severity, text.clone())),
                MavlinkMessage::Common(M::LANDING_TARGET(d)) => self.targets.push(d.clone()),
                MavlinkMessage::Common(M::DEBUG_FLOAT_ARRAY(_)) => self.deck_messages += 1,
                MavlinkMessage::Common(M::COMMAND_LONG(d)) => self.commands.push((self.t_s, d.into())),
                MavlinkMessage::Common(M::COMMAND_ACK(d)) => {
                    self.answers.push((d.command, d.result));
                    self.answered
                        .push(Address::new(d.target_system, d.target_component));
                }
                MavlinkMessage::Common(M::PARAM_VALUE(d)) => {
                    self.parameters.push((text(&d.param_id), d.param_value));
                }
                MavlinkMessage::Common(M::NAMED_VALUE_FLOAT(d)) => {
                    self.values.push((self.t_s, text(&d.name), d.value.into()));
                }
                MavlinkMessage::Common(M::HEARTBEAT(_)) => {
                    self.heartbeats.push((self.t_s, out.from, m.clone()))
                }
                _ => {}
            }
        }
        for o in out.odometry {
            self.newest = Some(o);
            self.odometry.push((self.t_s, o));
        }
        self.states.extend(out.state);
        self.orders.extend(out.command);
        self.settings.extend(out.settings);
        self.ranges.extend(out.ranges);
        self.texts.extend(out.texts);
    }

    pub fn sent_since(&self, t_s: f64) -> usize {
        self.sent.iter().filter(|(t, _)| *t > t_s).count()
    }
    pub fn commands_of(&self, command: MavCmd) -> Vec<CommandLong> {
        self.commands
            .iter()
            .map(|(_, c)| *c)
            .filter(|c| c.command == command)
            .collect()
    }
    pub fn arm_commands(&self) -> Vec<CommandLong> {
        self.commands_of(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM)
    }
    pub fn mode_commands(&self) -> Vec<CommandLong> {
        self.commands_of(MavCmd::MAV_CMD_DO_SET_MODE)
    }
    pub fn give(&mut self, m: &MavlinkMessage) {
        let truth = self.drone.plant_state(Time::from_secs(self.t_s));
        self.linked.autopilot.step(&truth, core::slice::from_ref(m));
    }
    /// Injects a message from another participant on the wire.
    pub fn inject(&mut self, from: Address, m: &MavlinkMessage) {
        self.linked.up.send(Time::from_secs(self.t_s), from, m);
    }
}
