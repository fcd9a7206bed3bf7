//! The autopilot's side of MAVLink, as in PX4 and ArduCopter: denials, requested rates, parameters, forced disarm.

use std::collections::BTreeMap;

use alight_shared::frames::{DroneNed, TrueNed, Vector};
use alight_shared::geodesy::Datum;
use alight_shared::msg::{AutopilotMode, LandedState};
use alight_shared::time::{DroneClock, Span, Time, TrueTime};
use alight_uav::autopilot::message::{
    ARDUPILOT, ARMED, Address, AttitudeReport, CUSTOM_MODE, CommandLong, CommandResult, DistanceReport,
    Heartbeat, ImuReport, LandingTarget, MavlinkMessage, OUTPUTS, OdometryReport, PX4, PositionReport,
    RC_RECEIVER, RcChannels, TargetFrame, VelocityFrame, command, id, severity,
};
use alight_uav::autopilot::modes::{Firmware, px4_mode};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::alignment::flags;
use super::modes::{mode_number, own_mission};
use super::reference::FlightReference;
use super::{MAX_COMMANDS, SimulatedAutopilot};
use crate::physics::drone::{AutopilotConfig, LossAction};

/// Voltage of an empty four-cell battery, and the increase to a full one, V.
const EMPTY_V: f64 = 14.0;
const FULL_V: f64 = 2.6;
/// Period of CURRENT_MODE while the mode is unchanged.
const MODE_PERIOD: Span = Span::from_millis(500);
const RANGE_LASTS: Span = Span::from_millis(100);
const MISSION_PERIOD: Span = Span::from_millis(1000);
/// Integer parameters of PX4.
const INTEGERS: [&str; 8] = [
    "COM_OBL_RC_ACT",
    "MC_AIRMODE",
    "NAV_RCL_ACT",
    "COM_RCL_EXCEPT",
    "NAV_DLL_ACT",
    "COM_LOW_BAT_ACT",
    "GF_ACTION",
    "COM_ARM_MAG_STR",
];
/// Highest rate of ArduCopter's telemetry streams, Hz. Measured: 39 to 42 Hz when 100 Hz were requested.
const ARDUCOPTER_HZ: f64 = 40.0;
/// Maximum magnitude of a value in a set-point.
const MAX_VALUE: f64 = 1e5;

#[derive(Clone, Copy, Debug)]
pub(super) struct MessageSchedule {
    id: u32,
    period: Span,
    due: Time<TrueTime>,
}

impl MessageSchedule {
    fn new(id: u32, hz: f64) -> MessageSchedule {
        MessageSchedule {
            id,
            period: Span::from_secs(1.0 / hz.max(0.01)),
            due: Time::EPOCH,
        }
    }
}

pub(super) fn first_streams() -> Vec<MessageSchedule> {
    vec![MessageSchedule::new(id::HEARTBEAT, 1.0)]
}

pub(super) fn parameters(c: &AutopilotConfig) -> BTreeMap<&'static str, f64> {
    let action = match c.loss_action {
        LossAction::Hold => 5.0,
        LossAction::Land => 4.0,
        LossAction::Return => 3.0,
    };
    BTreeMap::from_iter(match c.firmware {
        Firmware::Px4 => vec![
            ("COM_OF_LOSS_T", c.loss_after_s),
            ("COM_OBL_RC_ACT", action),
            ("MPC_ACC_UP_MAX", 8.0),
            ("MC_AIRMODE", 0.0),
            // When the remote control is lost, PX4 returns home unless it is in OFFBOARD; a lost data link
            // has no effect.
            ("NAV_RCL_ACT", 2.0),
            ("COM_RCL_EXCEPT", 4.0),
            ("NAV_DLL_ACT", 0.0),
            ("COM_LOW_BAT_ACT", 3.0),
            ("BAT_CRIT_THR", 0.07),
            ("GF_ACTION", 2.0),
            ("RTL_LAND_DELAY", -1.0),
            ("COM_ARM_IMU_ACC", 0.7),
            ("COM_ARM_IMU_GYR", 0.25),
            ("COM_ARM_MAG_STR", 2.0),
        ],
        Firmware::ArduCopter => vec![
            ("GUID_TIMEOUT", c.loss_after_s),
            ("GUID_OPTIONS", 8.0),
            ("ATC_THR_MIX_MIN", 0.1),
            ("FS_THR_ENABLE", 1.0),
            ("FS_GCS_ENABLE", 0.0),
            ("BATT_MONITOR", 4.0),
            ("BATT_FS_LOW_ACT", 0.0),
            ("BATT_FS_CRT_ACT", 1.0),
            ("BATT_CRT_VOLT", 13.2),
            ("FENCE_ACTION", 4.0),
            ("RTL_ALT_FINAL", 1000.0),
            ("INS_GYR_CAL", 0.0),
            ("EK3_SRC1_YAW", 1.0),
            // Continues in GUIDED without remote control.
            ("FS_OPTIONS", 4.0),
        ],
    })
}

fn rotation(q: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let [w, x, y, z] = q;
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)
        .filter(|q| q.coords.iter().all(|v| v.is_finite()))
}
fn is_sane(values: &[f64]) -> bool {
    values.iter().all(|v| v.abs() < MAX_VALUE)
}

impl SimulatedAutopilot {
    pub(super) fn parameter(&self, name: &str) -> f64 {
        self.parameters.get(name).copied().unwrap_or(0.0)
    }

    fn ellipsoid_origin(&self) -> Datum {
        Datum {
            height_m: self.origin.height_m + self.geoid_m.unwrap_or(0.0),
            ..self.origin
        }
    }
    fn map_scale(&self) -> Vector3<f64> {
        let [north, east] = self
            .ellipsoid_origin()
            .metres_per_map_metre(self.firmware().map_radius_m());
        Vector3::new(north, east, 1.0)
    }
    /// Position that the firmware reports for a true position (m): relative to its origin, on a spherical Earth.
    fn on_map(&self, position: &Vector3<f64>) -> Vector3<f64> {
        let at = self
            .place
            .map(|place| place.at(&Vector::<TrueNed>::from(*position)));
        let local = at.map_or(*position, |at| self.ellipsoid_origin().to::<DroneNed>(&at).0);
        local.component_div(&self.map_scale())
    }
    fn off_map(&self, reported: &Vector3<f64>) -> Vector3<f64> {
        let local = reported.component_mul(&self.map_scale());
        self.place.map_or(local, |place| {
            let at = self.ellipsoid_origin().at(&Vector::<DroneNed>::from(local));
            place.to::<TrueNed>(&at).0
        })
    }

    pub(super) fn receive(&mut self, message: &MavlinkMessage) {
        match message {
            MavlinkMessage::Timesync {
                remote_ns: 0,
                local_ns,
            } => self.outbox.push(MavlinkMessage::Timesync {
                remote_ns: self.own_time().nanos(),
                local_ns: *local_ns,
            }),
            MavlinkMessage::Command(c) if c.to == self.address => {
                if self.commands.len() >= MAX_COMMANDS {
                    self.commands.pop_front();
                }
                self.commands.push_back((self.now, *c));
                if c.command == command::REQUEST_MESSAGE && !self.no_origin {
                    let sea_m = self.origin.height_m - self.on_map(&self.estimator.now().position).z;
                    let both = self.geoid_m.filter(|_| self.gnss_ellipsoid);
                    let ellipsoid_m = both.map_or(0.0, |g| sea_m + g);
                    self.outbox.push(match c.parameters[0] as u32 {
                        id::GPS_RAW_INT => MavlinkMessage::GnssHeights { sea_m, ellipsoid_m },
                        id::MISSION_CURRENT => self.mission_current(),
                        id::HOME_POSITION => {
                            let home = Vector::<DroneNed>::from(self.flight.home);
                            MavlinkMessage::Home(self.home.unwrap_or(self.origin.at(&home)))
                        }
                        _ => {
                            let now = self.now;
                            self.unaligned.iter_mut().for_each(|u| u.origin_reported(now));
                            MavlinkMessage::Origin(self.origin)
                        }
                    });
                }
                let result = self.answer.unwrap_or_else(|| self.apply(c));
                self.outbox.push(MavlinkMessage::CommandAck {
                    command: c.command,
                    result,
                    to: Address::default(),
                });
            }
            MavlinkMessage::ParameterRequest { to, name, .. } if *to == self.address => {
                let integer = INTEGERS.contains(&name.as_str());
                let value = self.parameters.get(name.as_str());
                let value = value.map(|v| self.firmware().parameter_value(*v, integer));
                self.outbox.extend(value.map(|value| MavlinkMessage::Parameter {
                    name: name.clone(),
                    value,
                    index: 0,
                    count: self.parameters.len() as u16,
                }));
            }
            MavlinkMessage::Position(p) if p.to == self.address => {
                let numbers = [p.position, p.velocity, p.acceleration, [p.yaw, p.yaw_rate, 0.0]];
                let reference = is_sane(numbers.as_flattened()).then(|| {
                    let [position, velocity, acceleration] =
                        [p.position, p.velocity, p.acceleration].map(Vector3::from);
                    let position = self.off_map(&position);
                    FlightReference::track(position, velocity, acceleration, p.yaw, p.yaw_rate)
                });
                self.take(reference);
            }
            MavlinkMessage::AttitudeThrust(a) if a.to == self.address => {
                let rates = a.rates.unwrap_or_default();
                let reference = rotation(a.attitude)
                    .filter(|_| is_sane(&rates) && (0.0..=1.0).contains(&a.thrust))
                    .map(|q| FlightReference::attitude(q, rates.into(), a.thrust));
                self.take(reference);
            }
            MavlinkMessage::LandingTarget(t) => self.take_target(t),
            MavlinkMessage::RemoteControlOverride { to, pulses_us } if to.system == self.address.system => {
                let channels = self.channels.get_or_insert([1500; 18]);
                for (channel, us) in channels.iter_mut().zip(pulses_us) {
                    if !matches!(*us, 0 | u16::MAX) {
                        *channel = *us;
                    }
                }
            }
            _ => {}
        }
    }
    /// Handles a landing target as each firmware does. PX4 (`MavlinkReceiver::handle_message_landing_target`)
    /// accepts a valid position only in MAV_FRAME_LOCAL_NED; any other frame causes a critical text.
    /// ArduPilot (`AC_PrecLand_MAVLink::handle_msg`) requires MAV_FRAME_BODY_FRD or MAV_FRAME_LOCAL_FRD; any
    /// other frame causes a single text. It uses only the direction `position / distance` of a valid
    /// position, and drops a message without a positive distance.
    fn take_target(&mut self, t: &LandingTarget) {
        let e = self.estimator.now();
        let (_, _, yaw) = e.attitude.euler_angles();
        let position = Vector3::from(t.position);
        let from_vehicle = |rotation: UnitQuaternion<f64>| {
            let direction = rotation * position / t.distance_m;
            (t.distance_m > 0.0).then(|| e.position + direction * t.distance_m)
        };
        let (target, text) = match (self.firmware(), t.frame) {
            (Firmware::Px4, TargetFrame::LocalNed) => (Some(self.off_map(&position)), None),
            (Firmware::Px4, TargetFrame::BodyFrd | TargetFrame::LocalFrd) => {
                let number = t.frame.number();
                let text = format!("landing target: coordinate frame {number} unsupported");
                (None, Some((severity::CRITICAL, text)))
            }
            (Firmware::ArduCopter, TargetFrame::BodyFrd) => (from_vehicle(e.attitude), None),
            (Firmware::ArduCopter, TargetFrame::LocalFrd) => {
                let level = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
                (from_vehicle(level), None)
            }
            (Firmware::ArduCopter, TargetFrame::LocalNed) => {
                let first = self.targets_rejected == 0;
                (
                    None,
                    first.then(|| (severity::INFO, "Plnd: Frame not supported".to_owned())),
                )
            }
        };
        self.outbox
            .extend(text.map(|(severity, text)| MavlinkMessage::Text { severity, text }));
        self.targets_rejected += u32::from(target.is_none());
        self.target = target.or(self.target);
        // PX4's Precision Land; ArduCopter's LAND with precision landing enabled.
        let guides = match self.firmware() {
            Firmware::Px4 => self.mode() == px4_mode(4, 9),
            Firmware::ArduCopter => self.parameter("PLND_ENABLED") > 0.0,
        };
        if let Some(target) = target.filter(|_| guides) {
            self.flight.guide(target, self.now);
        }
    }
    fn take(&mut self, reference: Option<FlightReference>) {
        self.set_points += 1;
        match reference {
            None => self.rejected += 1,
            Some(reference) => self.flight.take(reference, self.now, self.estimator.now()),
        }
    }

    fn apply(&mut self, c: &CommandLong) -> CommandResult {
        let p = c.parameters;
        match c.command {
            command::MESSAGE_INTERVAL => {
                let which = p[0] as u32;
                match (self.firmware(), which) {
                    (Firmware::Px4, id::SCALED_IMU | id::EKF_STATUS_REPORT)
                    | (Firmware::ArduCopter, id::ESTIMATOR_STATUS) => return CommandResult::Failed,
                    (Firmware::ArduCopter, id::ODOMETRY) => return CommandResult::Denied,
                    // Accepted without effect: heartbeats keep their own rate.
                    (Firmware::Px4, id::HEARTBEAT) => return CommandResult::Accepted,
                    (Firmware::Px4 | Firmware::ArduCopter, _) => {}
                }
                self.streams.retain(|s| s.id != which);
                let hz = 1e6 / p[1].max(1.0);
                let hz = match self.firmware() {
                    Firmware::Px4 => hz,
                    Firmware::ArduCopter => hz.min(ARDUCOPTER_HZ),
                };
                self.streams.push(MessageSchedule::new(which, hz));
                CommandResult::Accepted
            }
            command::ARM_DISARM => {
                let forced = (p[1] - command::FORCE).abs() < 0.5;
                let arms = p[0] > 0.5;
                if arms && !self.is_aligned() {
                    return CommandResult::Denied;
                }
                if let Some(text) = self.arming_denial().filter(|_| arms && !self.armed()) {
                    let severity = severity::CRITICAL;
                    self.outbox.push(MavlinkMessage::Text { severity, text });
                    return match self.firmware() {
                        Firmware::Px4 => CommandResult::TemporarilyRejected,
                        Firmware::ArduCopter => CommandResult::Failed,
                    };
                }
                if !arms && !forced && self.flight.landed() != LandedState::OnGround {
                    return CommandResult::Denied;
                }
                self.arm(arms);
                CommandResult::Accepted
            }
            command::SET_MODE => {
                let custom = match self.firmware() {
                    Firmware::Px4 => px4_mode(p[1] as u32, p[2] as u32),
                    Firmware::ArduCopter => p[1] as u32,
                };
                if self.choose(custom) {
                    CommandResult::Accepted
                } else {
                    CommandResult::Denied
                }
            }
            command::REQUEST_MESSAGE => CommandResult::Accepted,
            command::MISSION_START => {
                if self.flight.own.is_empty() {
                    return CommandResult::Denied;
                }
                self.flight.own.begin_again();
                self.choose(own_mission(self.firmware()));
                CommandResult::Accepted
            }
            command::SET_HOME => {
                let home = Datum::new(p[4], p[5], p[6]);
                self.flight.home = self.origin.to::<DroneNed>(&home).0;
                self.home = Some(home);
                CommandResult::Accepted
            }
            _ => CommandResult::Unsupported,
        }
    }

    /// Enters the failsafe mode for a lost remote control or data link. It stays active until another mode is
    /// commanded.
    pub(super) fn lose_connections(&mut self) {
        let offboard = self.in_offboard();
        let mode = match self.firmware() {
            Firmware::Px4 => {
                // Bit 2: no failsafe in OFFBOARD.
                let exempt = offboard && self.parameter("COM_RCL_EXCEPT") as u32 & 4 != 0;
                let mode = |action: f64| match action as u32 {
                    1 => Some(AutopilotMode::Hold),
                    2 => Some(AutopilotMode::Return),
                    3 => Some(AutopilotMode::Land),
                    _ => None,
                };
                let remote =
                    mode(self.parameter("NAV_RCL_ACT")).filter(|_| self.remote_control_lost && !exempt);
                remote.or(mode(self.parameter("NAV_DLL_ACT")).filter(|_| self.data_link_lost))
            }
            Firmware::ArduCopter => {
                // Bit 2: continue in GUIDED.
                let exempt = offboard && self.parameter("FS_OPTIONS") as u32 & 4 != 0;
                let mode = |action: f64| match action as u32 {
                    1 | 2 | 4 => Some(AutopilotMode::Return),
                    3 | 5 => Some(AutopilotMode::Land),
                    7 => Some(AutopilotMode::Hold),
                    _ => None,
                };
                let remote =
                    mode(self.parameter("FS_THR_ENABLE")).filter(|_| self.remote_control_lost && !exempt);
                remote.or(mode(self.parameter("FS_GCS_ENABLE")).filter(|_| self.data_link_lost))
            }
        };
        if let Some(mode) = mode.filter(|_| self.armed()) {
            self.choose(mode_number(self.firmware(), mode));
        }
    }

    fn mission_current(&self) -> MavlinkMessage {
        let (total, state) = self.flight.own.report(self.flight.flies_own_mission());
        MavlinkMessage::MissionCurrent { total, state }
    }
    /// Reports reached items and, for PX4, the state once per second and on change.
    fn report_own_mission(&mut self) {
        if self.flight.own.is_empty() {
            return;
        }
        let reached = self.flight.own.reached();
        self.outbox
            .extend(reached.map(|item| MavlinkMessage::MissionItemReached { item }));
        let (_, state) = self.flight.own.report(self.flight.flies_own_mission());
        let recent = |(at, reported)| reported == state && self.now - at < MISSION_PERIOD;
        if self.firmware() == Firmware::Px4 && !self.reported_mission.is_some_and(recent) {
            self.reported_mission = Some((self.now, state));
            let message = self.mission_current();
            self.outbox.push(message);
        }
    }

    pub(super) fn report(&mut self) {
        self.report_own_mission();
        for k in 0..self.streams.len() {
            let Some(stream) = self.streams.get_mut(k).filter(|s| self.now >= s.due) else {
                continue;
            };
            let which = stream.id;
            stream.due = (stream.due + stream.period).max(self.now);
            if self.muted.contains(&which) {
                continue;
            }
            if which == id::CURRENT_MODE {
                // Sent on change, and twice per second with the vehicle's state.
                let mode = self.mode();
                let recent = |(at, reported)| reported == mode && self.now - at < MODE_PERIOD;
                if self.reported_mode.is_some_and(recent) {
                    continue;
                }
                self.reported_mode = Some((self.now, mode));
            }
            let message = self.message(which);
            self.outbox.extend(message);
        }
    }

    fn message(&self, which: u32) -> Option<MavlinkMessage> {
        let time_us = (self.own_time().nanos() / 1000).max(0).unsigned_abs();
        let time_ms = (time_us / 1000) as u32;
        let e = self.estimator.now();
        let read = self.unaligned.map_or(e.attitude, |u| u.read(&e.attitude));
        let attitude = [read.w, read.i, read.j, read.k];
        Some(match which {
            id::HEARTBEAT => MavlinkMessage::Heartbeat(Heartbeat {
                autopilot: match self.firmware() {
                    Firmware::Px4 => PX4,
                    Firmware::ArduCopter => ARDUPILOT,
                },
                vehicle: 2,
                base_mode: CUSTOM_MODE | if self.armed() { ARMED } else { 0 },
                custom_mode: self.mode(),
            }),
            id::CURRENT_MODE => MavlinkMessage::Mode {
                custom_mode: self.mode(),
            },
            id::ODOMETRY => {
                let (position, velocity) = self.estimator.sd();
                let variances = [[position; 3], self.estimator.euler_sd(), [velocity; 3]];
                MavlinkMessage::Odometry(OdometryReport {
                    time_us,
                    position: self.on_map(&e.position).into(),
                    attitude,
                    velocity: (read.inverse() * e.velocity).into(),
                    frame: VelocityFrame::Body,
                    rates: e.rates.into(),
                    variances: Some(variances.map(|sd| sd.map(|s| s * s))),
                    resets: self.resets,
                })
            }
            id::LOCAL_POSITION_NED => MavlinkMessage::LocalPosition(PositionReport {
                time_ms,
                position: self.on_map(&e.position).into(),
                velocity: e.velocity.into(),
            }),
            id::ATTITUDE_QUATERNION => MavlinkMessage::Attitude(AttitudeReport {
                time_ms,
                attitude,
                rates: e.rates.into(),
            }),
            id::HIGHRES_IMU | id::SCALED_IMU => MavlinkMessage::Imu(ImuReport {
                time_us,
                accelerometer: e.specific_force.into(),
                gyro: e.rates.into(),
            }),
            id::DISTANCE_SENSOR => {
                let (at, sample) = self.range.filter(|(at, _)| self.now - *at <= RANGE_LASTS)?;
                let own: Time<DroneClock> = self.clock.read(at);
                MavlinkMessage::Distance(DistanceReport {
                    time_ms: (own.nanos() / 1_000_000).max(0) as u32,
                    range_m: sample.range_m,
                    limits_m: self.range_limits_m,
                    variance: Some(sample.variance),
                })
            }
            id::EXTENDED_SYS_STATE => MavlinkMessage::Landed {
                state: match self.landed_report.unwrap_or(self.flight.landed()) {
                    LandedState::Unknown => 0,
                    LandedState::OnGround => 1,
                    LandedState::InAir => 2,
                },
            },
            id::BATTERY_STATUS => MavlinkMessage::Battery {
                number: 0,
                remaining: self
                    .battery_reported
                    .then_some(0.01 * (100.0 * self.shown_charge()).round()),
                voltage_v: self
                    .battery_reported
                    .then_some(EMPTY_V + FULL_V * self.shown_charge()),
                current_a: None,
            },
            // Without a signal, PX4 reports the receiver as absent. ArduCopter reports it as unhealthy, with
            // the failsafe's channel values.
            id::RC_CHANNELS if self.remote_control_lost && self.firmware() == Firmware::Px4 => return None,
            id::RC_CHANNELS => MavlinkMessage::RemoteControl(RcChannels {
                count: 18,
                pulses_us: self.channels?,
            }),
            id::SYS_STATUS => {
                let bit = |is: bool| if is { RC_RECEIVER } else { 0 };
                let (receiver, lost) = (self.channels.is_some(), self.remote_control_lost);
                MavlinkMessage::SystemStatus {
                    present: bit(receiver && (!lost || self.firmware() == Firmware::ArduCopter)),
                    healthy: bit(receiver && !lost),
                }
            }
            id::ESTIMATOR_STATUS => MavlinkMessage::EstimatorStatus {
                flags: flags(self.firmware(), self.is_aligned()),
            },
            id::EKF_STATUS_REPORT => MavlinkMessage::EkfStatus {
                flags: flags(self.firmware(), self.is_aligned()),
            },
            id::SERVO_OUTPUT_RAW => {
                let mut pulses_us = [0; OUTPUTS];
                let motors = self.flight.frame().count();
                let pulse_us = self.flight.pulse_us().round() as u16;
                pulses_us.iter_mut().take(motors).for_each(|p| *p = pulse_us);
                MavlinkMessage::Outputs { port: 0, pulses_us }
            }
            id::ATTITUDE_TARGET => MavlinkMessage::AttitudeTargetThrust {
                thrust: self.flight.reported_thrust(),
            },
            _ => return None,
        })
    }
}
