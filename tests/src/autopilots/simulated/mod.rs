//! The simulated autopilot for trials, tests and live landings. It imitates PX4 or ArduCopter: it exchanges
//! MAVLink messages, and commands the rotors from an imperfect estimate of the drone's true motion.
//!
//! [`SimulatedAutopilot::step`] is one step of the inner loops; every fifth step also estimates, decides and reports.
//! [`protocol`] has messages, streams and commands; [`defaults`] parameters; [`failsafe`] failsafes; [`reference`]
//! set-points; [`flight`] modes, position control and the land detector; [`attitude`], [`shaping`] and [`mixer`] the
//! inner loops; [`spool`] the motors after arming; [`estimator`] the sensors; [`alignment`] the start-up; [`arming`] the arming checks.

mod alignment;
mod arming;
mod attitude;
mod defaults;
mod estimator;
mod failsafe;
mod flight;
mod mixer;
mod modes;
mod own_mission;
mod protocol;
mod reference;
mod shaping;
mod spool;

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};

use alight_shared::{
    autopilot_parameters::Version,
    geodesy::Datum,
    geometry::DroneGeometry,
    mavlink::{Signing, dialect::MissionState},
    msg::{AutopilotMode, LandedState, RangeSample},
    time::{DroneTime, Span, WorldTime},
};
use alight_uav::autopilot::{
    message::{Address, CommandLong, MavResult, MavlinkMessage},
    modes::Firmware,
    wire::{Decoder, Encoder},
};
use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    physics::{
        drone::{AutopilotConfig, MAX_ROTORS, NavigationConfig, PlantState, RotorFrame},
        streams::Streams,
    },
    sensors::{clocks::ClockModel, noise::Noise},
};
use alignment::Unaligned;
use estimator::SimulatedEstimator;
use flight::SimulatedFlight;
use protocol::MessageSchedule;

pub use defaults::{Installed, MakersDefault, makers_defaults, warned_by_default};
pub use failsafe::FailsafeConditions;
pub use mixer::Mixer;
pub use modes::{mode_number, own_mission as own_mission_mode};

/// Period of the estimator, position control and reports.
const OUTER: Span = Span::from_millis(10);
/// Steps of the inner loops in that period.
pub const INNER_PER_OUTER: u32 = 5;
/// Phase of the outer loops in the first period. Their report arrives just before the next period of a
/// lock-step computer; on a real computer the report itself wakes the process.
const PHASE: Span = Span::from_millis(6);
/// Time that a toggling battery gauge holds each value, s.
const TOGGLES_S: f64 = 20.0;
const MAX_COMMANDS: usize = 1000;

/// Tests change the public fields.
pub struct SimulatedAutopilot {
    pub address: Address,
    /// Origin of the autopilot's NED, with its height above the sea.
    pub origin: Datum,
    /// Height of the sea above the ellipsoid, m; known only from a receiver that reports both heights.
    pub geoid_m: Option<f64>,
    pub gnss_ellipsoid: bool,
    /// Distance from the hull's steel, which disturbs the compass, m.
    pub steel_m: f64,
    /// Origin of the true NED; None: the autopilot's origin.
    place: Option<Datum>,
    /// Version that AUTOPILOT_VERSION reports; [`SimulatedAutopilot::install`] changes it.
    pub version: Version,
    /// Parameters by name; requests for any other parameter remain unanswered.
    pub parameters: BTreeMap<&'static str, f64>,
    pub range_limits_m: [f64; 2],
    range: Option<(WorldTime, RangeSample)>,
    pub resets: u8,
    /// True charge of the battery, 0 to 1.
    pub battery: f64,
    /// Hover time with a full battery, s.
    pub endurance_s: f64,
    pub battery_reported: bool,
    /// Fault: gauge and voltage freeze at the first value, or toggle between it and a value that is higher by
    /// the second.
    pub battery_report: Option<[f64; 2]>,
    pub silent: bool,
    /// Fault: every command is answered with this result and not executed.
    pub answer: Option<MavResult>,
    pub arming_fault: Option<&'static str>,
    /// Home position, with its height above the sea; None until a command sets it.
    pub home: Option<Datum>,
    /// Fault: messages with these ids are not sent.
    pub muted: Vec<u32>,
    /// Fault: this landed state is reported regardless of the detector.
    pub landed_report: Option<LandedState>,
    pub no_origin: bool,
    /// Channels of the remote control, us; None: no receiver.
    pub channels: Option<[u16; 18]>,
    pub conditions: FailsafeConditions,
    pub commands: VecDeque<(WorldTime, CommandLong)>,
    pub set_points: u32,
    pub rejected: u32,
    /// Newest accepted landing target, in the NED of the estimate, m.
    pub target: Option<Vector3<f64>>,
    pub targets_rejected: u32,
    clock: ClockModel,
    unaligned: Option<Unaligned>,
    estimator: SimulatedEstimator,
    flight: SimulatedFlight,
    failsafes: failsafe::Failsafes,
    /// Rotation rate at the autopilot's start, rad/s.
    started_rps: f64,
    now: WorldTime,
    outer_due: WorldTime,
    force: (Vector3<f64>, f64),
    streams: Vec<MessageSchedule>,
    reported_mode: Option<(WorldTime, u32)>,
    /// Last state of PX4's own mission that was sent, and the time of sending.
    reported_mission: Option<(WorldTime, MissionState)>,
    outbox: Vec<MavlinkMessage>,
    decoder: Decoder,
    encoder: Encoder,
}

impl SimulatedAutopilot {
    /// Autopilot in a pilot's position mode, armed in the air at `truth`, with its estimator converged.
    /// `hover` is the collective thrust in hover, as a fraction of the nominal maximum. Sensor errors use the
    /// random streams `drone.*`, the clock uses `autopilot.clock`.
    pub fn new(
        config: &AutopilotConfig,
        navigation: &NavigationConfig,
        drone: &DroneGeometry,
        streams: &Streams,
        truth: &PlantState,
        hover: f64,
    ) -> SimulatedAutopilot {
        let mut clock = Noise::new(streams, "autopilot.clock");
        let ago_s = 100.0 + 900.0 * clock.uniform();
        let drift = 20e-6 * (2.0 * clock.uniform() - 1.0);
        let estimator = SimulatedEstimator::new(navigation, streams, truth, OUTER.secs());
        let flight = SimulatedFlight::new(
            config,
            drone,
            estimator.now(),
            hover * config.initial_hover_factor,
            truth.at + Span::from_secs(0.5 * clock.uniform()),
        );
        let mut autopilot = SimulatedAutopilot {
            address: Address::new(3, 1),
            origin: Datum::default(),
            geoid_m: Some(0.0),
            gnss_ellipsoid: navigation.gnss_ellipsoid,
            steel_m: f64::INFINITY,
            place: None,
            version: config.firmware.maker().assumed(),
            parameters: BTreeMap::new(),
            range_limits_m: [0.05, 30.0],
            range: None,
            resets: 0,
            battery: config.battery,
            battery_reported: true,
            battery_report: None,
            silent: false,
            answer: None,
            arming_fault: None,
            started_rps: truth.rates.norm(),
            muted: Vec::new(),
            landed_report: None,
            no_origin: false,
            home: None,
            channels: None,
            conditions: FailsafeConditions::default(),
            commands: VecDeque::new(),
            set_points: 0,
            rejected: 0,
            target: None,
            targets_rejected: 0,
            clock: ClockModel::new(ago_s - truth.at.secs(), drift),
            unaligned: None,
            estimator,
            flight,
            failsafes: failsafe::Failsafes::default(),
            endurance_s: config.endurance_s,
            now: truth.at,
            outer_due: truth.at + PHASE,
            force: (Vector3::zeros(), 0.0),
            streams: protocol::first_streams(),
            reported_mode: None,
            reported_mission: None,
            outbox: Vec::new(),
            decoder: Decoder::default(),
            encoder: Encoder::default(),
        };
        autopilot.install(config, autopilot.version, Installed::All);
        autopilot
    }
    /// Replaces the firmware by this version, with the parameters that its installer has set.
    pub fn install(&mut self, config: &AutopilotConfig, version: Version, installed: Installed) {
        self.version = version;
        self.parameters = defaults::parameters(config, version, installed);
    }

    /// With a key, signs messages and accepts only signed ones.
    pub fn set_signing(&mut self, signing: Option<Signing>) {
        self.decoder = Decoder::signed(signing.clone());
        self.encoder = Encoder::signed(signing);
    }
    pub fn set_frame(&mut self, drone: &DroneGeometry, frame: RotorFrame) {
        self.flight.set_frame(drone, frame);
    }
    /// Sets the origin of the autopilot's NED to `origin` (height above the ellipsoid), the origin of the
    /// true NED to `place`, and the height of the sea above the ellipsoid to `geoid_m`, m.
    pub fn begin_at(&mut self, place: Datum, origin: Datum, geoid_m: f64) {
        self.place = Some(place);
        self.geoid_m = Some(geoid_m);
        self.origin = Datum {
            height_m: origin.height_m - geoid_m,
            ..origin
        };
    }
    pub fn take_range(&mut self, at: WorldTime, sample: RangeSample) {
        self.range = Some((at, sample));
    }
    /// Restarts the autopilot as if just switched on, at a random time before or after Alight's processes. It
    /// aligns its heading after its origin is known.
    pub fn start(&mut self, streams: &Streams) {
        self.unaligned = Some(Unaligned::drawn(streams, self.now));
    }
    pub fn is_aligned(&self) -> bool {
        self.unaligned.is_none()
    }
    /// Resets the estimated position by `by`, m; `counted` increments the reset counter.
    pub fn reset_position(&mut self, by: &Vector3<f64>, counted: bool) {
        self.estimator.reset_position(by);
        self.resets = self.resets.wrapping_add(u8::from(counted));
    }
    pub fn reset_heading(&mut self, by_rad: f64) {
        self.estimator.reset_heading(by_rad);
        self.resets = self.resets.wrapping_add(1);
    }

    /// Advances one step at the drone's true state, with the messages that have arrived. Returns rotor
    /// commands as fractions of the nominal maximum; None if the motors are off.
    pub fn step(&mut self, truth: &PlantState, arrived: &[MavlinkMessage]) -> Option<[f64; MAX_ROTORS]> {
        let dt = (truth.at - self.now).secs();
        self.now = truth.at;
        let boots = self.unaligned.is_some_and(|u| u.boots(self.now));
        for message in arrived.iter().filter(|_| !boots) {
            self.receive(message);
        }
        self.force.0 += truth.specific_force;
        self.force.1 += 1.0;
        if truth.at >= self.outer_due {
            self.outer_due += OUTER;
            self.outer(truth);
        }
        let motors = self.flight.inner(self.estimator.errors(), truth, dt);
        motors.filter(|_| !self.is_empty())
    }
    /// An empty battery stops the motors regardless of the autopilot's commands.
    pub fn is_empty(&self) -> bool {
        self.battery <= 0.0
    }
    /// Charge reported by gauge and voltage, 0 to 1.
    fn shown_charge(&self) -> f64 {
        let [charge, toggles_by] = self.battery_report.unwrap_or([self.battery, 0.0]);
        let above = (self.now.secs() / TOGGLES_S).rem_euclid(2.0) >= 1.0;
        charge + if above { toggles_by } else { 0.0 }
    }
    /// Charge drawn, as a fraction of the capacity: ArduCopter computes its gauge from it, PX4 counts since its start.
    fn used(&self) -> f64 {
        match self.firmware() {
            Firmware::Px4 => self.now.secs().max(0.0) / self.endurance_s,
            Firmware::ArduCopter => (1.0 - self.shown_charge()).max(0.0),
        }
    }
    pub fn step_bytes(
        &mut self,
        truth: &PlantState,
        arrived: &[Vec<u8>],
    ) -> (Option<[f64; MAX_ROTORS]>, Vec<Vec<u8>>) {
        for bytes in arrived {
            self.decoder.push(bytes);
        }
        let frames = core::iter::from_fn(|| self.decoder.next_frame());
        let messages: Vec<_> = frames.map(|f| f.message).collect();
        let motors = self.step(truth, &messages);
        let sent = self.sent();
        let encoded = sent.iter().filter_map(|m| self.encoder.frame(self.address, m));
        (motors, encoded.collect())
    }
    pub fn sent(&mut self) -> Vec<MavlinkMessage> {
        let sent = core::mem::take(&mut self.outbox);
        let boots = self.unaligned.is_some_and(|u| u.boots(self.now));
        if self.silent || boots { Vec::new() } else { sent }
    }

    fn outer(&mut self, truth: &PlantState) {
        let dt = OUTER.secs();
        let (sum, count) = core::mem::take(&mut self.force);
        self.estimator.near_steel(self.steel_m, dt);
        self.estimator
            .step(truth, &(sum / count), self.flight.thrust(), dt);
        self.battery = (self.battery - dt / self.endurance_s).max(0.0);
        self.step_failsafes();
        let now = self.now;
        if self.unaligned.take_if(|u| u.is_over(now)).is_some() {
            // PX4 increments the reset counter.
            self.resets = self.resets.wrapping_add(1);
        }
        let levels = self.has_no_position();
        self.flight
            .outer(self.estimator.now(), now, &self.parameters, levels, dt);
        self.report();
    }

    /// Uploads the autopilot's own mission: positions in the autopilot's NED, m.
    pub fn upload(&mut self, items: Vec<Vector3<f64>>) {
        self.flight.own.upload(items);
    }
    /// Moves the pilot's mode switch; returns true if the autopilot entered the mode.
    pub fn choose(&mut self, mode: u32) -> bool {
        if !self.is_aligned() && self.firmware().mode(mode) == AutopilotMode::Offboard {
            return false;
        }
        self.flight.choose(mode, self.estimator.now(), self.now)
    }
    /// Mode commanded last; a failsafe's mode may be active instead.
    pub fn chosen(&self) -> u32 {
        self.flight.chosen()
    }
    pub fn mode(&self) -> u32 {
        self.flight.mode()
    }
    pub fn firmware(&self) -> Firmware {
        self.flight.firmware()
    }
    pub fn armed(&self) -> bool {
        self.flight.armed()
    }
    pub fn arm(&mut self, armed: bool) {
        self.flight.arm(armed, self.estimator.now());
    }
    /// Sets the position that the pilot holds in manual modes, in the autopilot's NED, m.
    pub fn hold_at(&mut self, position: Vector3<f64>) {
        self.flight.hold_at(position);
    }
    pub fn thrust(&self) -> f64 {
        self.flight.thrust()
    }
    pub fn wanted(&self) -> UnitQuaternion<f64> {
        self.flight.wanted()
    }
    pub fn hover_thrust(&self) -> f64 {
        self.flight.hover_thrust()
    }
    /// Estimated position in the autopilot's NED, m.
    pub fn position(&self) -> Vector3<f64> {
        self.estimator.now().position
    }
    /// Displacement of the autopilot's NED from the true one by GNSS error, m.
    pub fn frame_offset(&self) -> Vector3<f64> {
        self.estimator.offset()
    }
    /// Restarts the autopilot in the air, as after a power loss.
    pub fn restart(&mut self) {
        self.clock = ClockModel::new(-self.now.secs(), self.clock.drift());
        self.streams = protocol::first_streams();
    }
    fn own_time(&self) -> DroneTime {
        self.clock.read(self.now)
    }
    /// Whether a failsafe has replaced OFFBOARD (GUIDED) with another mode.
    pub fn holds_by_itself(&self) -> bool {
        let chosen = self.firmware().mode(self.chosen());
        chosen == AutopilotMode::Offboard && !self.in_offboard()
    }
    pub fn in_offboard(&self) -> bool {
        self.firmware().mode(self.mode()) == AutopilotMode::Offboard
    }
}
