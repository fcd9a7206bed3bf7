//! The autopilot's side of MAVLink, as in PX4 and ArduCopter: denials, requested rates, parameters, forced disarm.

use alight_shared::{
    frames::{DroneNed, TrueNed, Vector, yaw_rotation},
    geodesy::Datum,
    mavlink::{EKF_STATUS_REPORT, MessageData as _, dialect as m, fields},
    msg::LandedState,
    time::{DroneTime, Span, Time, WorldTime},
};
use alight_uav::autopilot::{
    message::{
        Address, CommandLong, FORCE, MavCmd, MavMessage as M, MavModeFlag, MavResult, MavType,
        MavlinkMessage, command_ack, narrow, parameter, severity, text, wide,
    },
    modes::{Firmware, px4_mode},
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{
    MAX_COMMANDS, SimulatedAutopilot, alignment::flags, defaults::is_integer, modes::own_mission,
    reference::FlightReference,
};

/// Voltage of an empty four-cell battery, and the increase to a full one, V.
const EMPTY_V: f64 = 14.0;
const FULL_V: f64 = 2.6;
/// Capacity of that battery, Ah.
const CAPACITY_AH: f64 = 5.0;
/// Period of CURRENT_MODE while the mode is unchanged.
const MODE_PERIOD: Span = Span::from_millis(500);
const RANGE_LASTS: Span = Span::from_millis(100);
const MISSION_PERIOD: Span = Span::from_millis(1000);
/// Highest rate of ArduCopter's telemetry streams, Hz. Measured: 39 to 42 Hz when 100 Hz were requested.
const ARDUCOPTER_HZ: f64 = 40.0;
/// Maximum magnitude of a value in a set-point.
const MAX_VALUE: f64 = 1e5;

#[derive(Clone, Copy, Debug)]
pub(super) struct MessageSchedule {
    id: u32,
    period: Span,
    due: WorldTime,
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
    vec![MessageSchedule::new(m::HEARTBEAT_DATA::ID, 1.0)]
}

fn rotation(q: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let [w, x, y, z] = q;
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)
        .filter(|q| q.coords.iter().all(|v| v.is_finite()))
}
/// Place in 1e-7 deg and mm.
fn integers(place: &Datum) -> [i32; 3] {
    [
        place.latitude_deg * 1e7,
        place.longitude_deg * 1e7,
        place.height_m * 1e3,
    ]
    .map(|v| v.round() as i32)
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
            MavlinkMessage::Common(message) => self.receive_common(message),
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
            _ => {}
        }
    }
    fn send(&mut self, message: M) {
        self.outbox.push(message.into());
    }
    fn receive_common(&mut self, message: &M) {
        match message {
            M::TIMESYNC(d) if d.tc1 == 0 => self.send(M::TIMESYNC(m::TIMESYNC_DATA {
                tc1: self.own_time().nanos(),
                ts1: d.ts1,
                ..m::TIMESYNC_DATA::DEFAULT
            })),
            M::LANDING_TARGET(d) => self.take_target(d),
            M::COMMAND_LONG(d) => {
                let command = CommandLong::from(d);
                if command.to == self.address {
                    self.obey(command);
                }
            }
            M::PARAM_REQUEST_READ(d) if Address::new(d.target_system, d.target_component) == self.address => {
                let name = text(&d.param_id);
                let integer = is_integer(&name);
                if let Some(value) = self.parameters.get(name.as_str()) {
                    let value = self.firmware().parameter_value(*value, integer);
                    let count = self.parameters.len() as u16;
                    self.outbox.push(parameter(&name, value, 0, count));
                }
            }
            M::RC_CHANNELS_OVERRIDE(d) if d.target_system == self.address.system => {
                let pulses_us = fields!(d, chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw);
                let channels = self.channels.get_or_insert([1500; 18]);
                for (channel, us) in channels.iter_mut().zip(pulses_us) {
                    // 0: returned to the receiver, 65535: unchanged.
                    if !matches!(us, 0 | u16::MAX) {
                        *channel = us;
                    }
                }
            }
            _ => {}
        }
    }
    fn obey(&mut self, c: CommandLong) {
        if self.commands.len() >= MAX_COMMANDS {
            self.commands.pop_front();
        }
        self.commands.push_back((self.now, c));
        let id = c.parameters[0] as u32;
        if c.command == MavCmd::MAV_CMD_REQUEST_MESSAGE && id == m::AUTOPILOT_VERSION_DATA::ID {
            let [major, minor] = self.version;
            self.send(M::AUTOPILOT_VERSION(m::AUTOPILOT_VERSION_DATA {
                flight_sw_version: u32::from_le_bytes([0, 0, minor, major]),
                ..m::AUTOPILOT_VERSION_DATA::DEFAULT
            }));
        } else if c.command == MavCmd::MAV_CMD_REQUEST_MESSAGE && !self.no_origin {
            let message = self.requested(id);
            self.send(message);
        }
        let result = self.answer.unwrap_or_else(|| self.apply(&c));
        self.outbox
            .push(command_ack(c.command, result, Address::default()));
    }
    /// Answer to a request of message `id`; by default the origin.
    fn requested(&mut self, id: u32) -> M {
        let [latitude, longitude, altitude] = match id {
            m::GPS_RAW_INT_DATA::ID => {
                let sea_m = self.origin.height_m - self.on_map(&self.estimator.now().position).z;
                let both = self.geoid_m.filter(|_| self.gnss_ellipsoid);
                return M::GPS_RAW_INT(m::GPS_RAW_INT_DATA {
                    alt: (sea_m * 1e3).round() as i32,
                    alt_ellipsoid: both.map_or(0, |g| ((sea_m + g) * 1e3).round() as i32),
                    fix_type: m::GpsFixType::GPS_FIX_TYPE_3D_FIX,
                    satellites_visible: 10,
                    ..m::GPS_RAW_INT_DATA::DEFAULT
                });
            }
            m::MISSION_CURRENT_DATA::ID => return M::MISSION_CURRENT(self.mission_current()),
            m::HOME_POSITION_DATA::ID => {
                let home = self.origin.at(&Vector::<DroneNed>::from(self.flight.home));
                let [latitude, longitude, altitude] = integers(&self.home.unwrap_or(home));
                return M::HOME_POSITION(m::HOME_POSITION_DATA {
                    latitude,
                    longitude,
                    altitude,
                    ..m::HOME_POSITION_DATA::DEFAULT
                });
            }
            _ => integers(&self.origin),
        };
        let now = self.now;
        if let Some(u) = &mut self.unaligned {
            u.origin_reported(now);
        }
        M::GPS_GLOBAL_ORIGIN(m::GPS_GLOBAL_ORIGIN_DATA {
            latitude,
            longitude,
            altitude,
            ..m::GPS_GLOBAL_ORIGIN_DATA::DEFAULT
        })
    }
    /// Handles a landing target as each firmware does. PX4 (`MavlinkReceiver::handle_message_landing_target`)
    /// accepts a valid position only in MAV_FRAME_LOCAL_NED; any other frame causes a critical text.
    /// ArduPilot (`AC_PrecLand_MAVLink::handle_msg`) requires MAV_FRAME_BODY_FRD or MAV_FRAME_LOCAL_FRD; any
    /// other frame causes a single text. It uses only the direction `position / distance` of a valid
    /// position, and drops a message without a positive distance.
    fn take_target(&mut self, t: &m::LANDING_TARGET_DATA) {
        let e = self.estimator.now();
        let (_, _, yaw) = e.attitude.euler_angles();
        if t.position_valid != m::MavBool::MAV_BOOL_TRUE {
            return;
        }
        let position = Vector3::from(wide([t.x, t.y, t.z]));
        let distance_m = f64::from(t.distance);
        let from_vehicle = |rotation: UnitQuaternion<f64>| {
            let direction = rotation * position / distance_m;
            (distance_m > 0.0).then(|| e.position + direction * distance_m)
        };
        let (target, text) = match (self.firmware(), t.frame) {
            (Firmware::Px4, m::MavFrame::MAV_FRAME_LOCAL_NED) => (Some(self.off_map(&position)), None),
            (Firmware::Px4, frame) => {
                let text = format!("landing target: coordinate frame {} unsupported", frame as u8);
                (None, Some((severity::CRITICAL, text)))
            }
            (Firmware::ArduCopter, m::MavFrame::MAV_FRAME_BODY_FRD) => (from_vehicle(e.attitude), None),
            (Firmware::ArduCopter, m::MavFrame::MAV_FRAME_LOCAL_FRD) => {
                let level = yaw_rotation(yaw);
                (from_vehicle(level), None)
            }
            (Firmware::ArduCopter, _) => {
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
    pub(super) fn shown_voltage(&self) -> f64 {
        EMPTY_V + FULL_V * self.shown_charge()
    }
    fn take(&mut self, reference: Option<FlightReference>) {
        self.set_points += 1;
        match reference {
            None => self.rejected += 1,
            Some(reference) => self.flight.take(reference, self.now, self.estimator.now()),
        }
    }

    fn apply(&mut self, c: &CommandLong) -> MavResult {
        let p = c.parameters;
        match c.command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let which = p[0] as u32;
                match (self.firmware(), which) {
                    (Firmware::Px4, m::SCALED_IMU_DATA::ID | EKF_STATUS_REPORT)
                    | (Firmware::ArduCopter, m::ESTIMATOR_STATUS_DATA::ID) => {
                        return MavResult::MAV_RESULT_FAILED;
                    }
                    (Firmware::ArduCopter, m::ODOMETRY_DATA::ID) => return MavResult::MAV_RESULT_DENIED,
                    // Accepted without effect: heartbeats keep their own rate.
                    (Firmware::Px4, m::HEARTBEAT_DATA::ID) => return MavResult::MAV_RESULT_ACCEPTED,
                    (Firmware::Px4 | Firmware::ArduCopter, _) => {}
                }
                self.streams.retain(|s| s.id != which);
                let hz = 1e6 / p[1].max(1.0);
                let hz = match self.firmware() {
                    Firmware::Px4 => hz,
                    Firmware::ArduCopter => hz.min(ARDUCOPTER_HZ),
                };
                self.streams.push(MessageSchedule::new(which, hz));
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
                let forced = (p[1] - FORCE).abs() < 0.5;
                let arms = p[0] > 0.5;
                if arms && !self.is_aligned() {
                    return MavResult::MAV_RESULT_DENIED;
                }
                if let Some(text) = self.arming_denial().filter(|_| arms && !self.armed()) {
                    let severity = severity::CRITICAL;
                    self.outbox.push(MavlinkMessage::Text { severity, text });
                    return match self.firmware() {
                        Firmware::Px4 => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                        Firmware::ArduCopter => MavResult::MAV_RESULT_FAILED,
                    };
                }
                if !arms && !forced && self.flight.landed() != LandedState::OnGround {
                    return MavResult::MAV_RESULT_DENIED;
                }
                self.arm(arms);
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_DO_SET_MODE => {
                let custom = match self.firmware() {
                    Firmware::Px4 => px4_mode(p[1] as u32, p[2] as u32),
                    Firmware::ArduCopter => p[1] as u32,
                };
                if self.choose(custom) {
                    MavResult::MAV_RESULT_ACCEPTED
                } else {
                    MavResult::MAV_RESULT_DENIED
                }
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE => MavResult::MAV_RESULT_ACCEPTED,
            MavCmd::MAV_CMD_MISSION_START => {
                if self.flight.own.is_empty() {
                    return MavResult::MAV_RESULT_DENIED;
                }
                self.flight.own.begin_again();
                self.choose(own_mission(self.firmware()));
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_DO_SET_HOME => {
                let home = Datum::new(p[4], p[5], p[6]);
                self.flight.home = self.origin.to::<DroneNed>(&home).0;
                self.home = Some(home);
                MavResult::MAV_RESULT_ACCEPTED
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        }
    }

    fn mission_current(&self) -> m::MISSION_CURRENT_DATA {
        self.flight.own.report(self.flight.flies_own_mission())
    }
    /// Reports reached items and, for PX4, the state once per second and on change.
    fn report_own_mission(&mut self) {
        if self.flight.own.is_empty() {
            return;
        }
        let reached = self.flight.own.reached();
        self.outbox
            .extend(reached.map(|seq| M::MISSION_ITEM_REACHED(m::MISSION_ITEM_REACHED_DATA { seq }).into()));
        let report = self.mission_current();
        let state = report.mission_state;
        let recent = |(at, reported)| reported == state && self.now - at < MISSION_PERIOD;
        if self.firmware() == Firmware::Px4 && !self.reported_mission.is_some_and(recent) {
            self.reported_mission = Some((self.now, state));
            self.send(M::MISSION_CURRENT(report));
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
            if which == m::CURRENT_MODE_DATA::ID {
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

    fn estimator_flags(&self) -> m::EstimatorStatusFlags {
        let mut flags = flags(self.firmware(), self.is_aligned());
        if self.conditions.dead_reckoning || self.conditions.estimator_bad {
            flags.remove(m::EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_ABS);
        }
        flags
    }
    fn message(&self, which: u32) -> Option<MavlinkMessage> {
        let time_us = (self.own_time().nanos() / 1000).max(0).unsigned_abs();
        let time_boot_ms = (time_us / 1000) as u32;
        let e = self.estimator.now();
        let read = self.unaligned.map_or(e.attitude, |u| u.read(&e.attitude));
        let attitude = [read.w, read.i, read.j, read.k];
        let message = match which {
            m::HEARTBEAT_DATA::ID => {
                let mut mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
                if self.armed() {
                    mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
                }
                M::HEARTBEAT(m::HEARTBEAT_DATA {
                    autopilot: self.firmware().autopilot(),
                    mavtype: MavType::MAV_TYPE_QUADROTOR,
                    base_mode: mode,
                    custom_mode: self.mode(),
                    system_status: self.system_status(),
                    mavlink_version: 3,
                })
            }
            m::CURRENT_MODE_DATA::ID => M::CURRENT_MODE(m::CURRENT_MODE_DATA {
                custom_mode: self.mode(),
                intended_custom_mode: self.mode(),
                ..m::CURRENT_MODE_DATA::DEFAULT
            }),
            m::ODOMETRY_DATA::ID => {
                let (position, velocity) = self.estimator.sd();
                let variances = [[position; 3], self.estimator.euler_sd(), [velocity; 3]];
                let [p, a, v] = variances.map(|sd| narrow(sd.map(|s| s * s)));
                let mut d = m::ODOMETRY_DATA {
                    time_usec: time_us,
                    q: narrow(attitude),
                    frame_id: m::MavFrame::MAV_FRAME_LOCAL_NED,
                    child_frame_id: m::MavFrame::MAV_FRAME_BODY_FRD,
                    reset_counter: self.resets,
                    ..m::ODOMETRY_DATA::DEFAULT
                };
                fields!(d, x y z) = narrow(self.on_map(&e.position).into());
                fields!(d, vx vy vz) = narrow((read.inverse() * e.velocity).into());
                fields!(d, rollspeed pitchspeed yawspeed) = narrow(e.rates.into());
                // Upper triangles of 6 x 6 matrices, row by row.
                let pose = &mut d.pose_covariance;
                [pose[0], pose[6], pose[11]] = p;
                [pose[15], pose[18], pose[20]] = a;
                let velocity = &mut d.velocity_covariance;
                [velocity[0], velocity[6], velocity[11]] = v;
                M::ODOMETRY(d)
            }
            m::LOCAL_POSITION_NED_DATA::ID => {
                let mut d = m::LOCAL_POSITION_NED_DATA::DEFAULT;
                d.time_boot_ms = time_boot_ms;
                fields!(d, x y z) = narrow(self.on_map(&e.position).into());
                fields!(d, vx vy vz) = narrow(e.velocity.into());
                M::LOCAL_POSITION_NED(d)
            }
            m::ATTITUDE_QUATERNION_DATA::ID => {
                let mut d = m::ATTITUDE_QUATERNION_DATA::DEFAULT;
                d.time_boot_ms = time_boot_ms;
                fields!(d, q1 q2 q3 q4) = narrow(attitude);
                fields!(d, rollspeed pitchspeed yawspeed) = narrow(e.rates.into());
                M::ATTITUDE_QUATERNION(d)
            }
            m::HIGHRES_IMU_DATA::ID | m::SCALED_IMU_DATA::ID => {
                let mut d = m::HIGHRES_IMU_DATA::DEFAULT;
                d.time_usec = time_us;
                fields!(d, xacc yacc zacc) = narrow(e.specific_force.into());
                fields!(d, xgyro ygyro zgyro) = narrow(e.rates.into());
                M::HIGHRES_IMU(d)
            }
            m::DISTANCE_SENSOR_DATA::ID => {
                let (at, sample) = self.range.filter(|(at, _)| self.now - *at <= RANGE_LASTS)?;
                let own: DroneTime = self.clock.read(at);
                // `as` saturates and maps NaN to zero.
                let cm = |v: f64| (v * 100.0).round() as u16;
                M::DISTANCE_SENSOR(m::DISTANCE_SENSOR_DATA {
                    time_boot_ms: (own.nanos() / 1_000_000).max(0) as u32,
                    min_distance: cm(self.range_limits_m[0]),
                    max_distance: cm(self.range_limits_m[1]),
                    current_distance: cm(sample.range_m),
                    orientation: m::MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270,
                    covariance: (sample.variance * 1e4).round().clamp(1.0, 254.0) as u8,
                    ..m::DISTANCE_SENSOR_DATA::DEFAULT
                })
            }
            m::EXTENDED_SYS_STATE_DATA::ID => M::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
                landed_state: match self.landed_report.unwrap_or(self.flight.landed()) {
                    LandedState::Unknown => m::MavLandedState::MAV_LANDED_STATE_UNDEFINED,
                    LandedState::OnGround => m::MavLandedState::MAV_LANDED_STATE_ON_GROUND,
                    LandedState::InAir => m::MavLandedState::MAV_LANDED_STATE_IN_AIR,
                },
                ..m::EXTENDED_SYS_STATE_DATA::DEFAULT
            }),
            m::BATTERY_STATUS_DATA::ID => {
                let mut battery = m::BATTERY_STATUS_DATA {
                    voltages: [u16::MAX; 10],
                    current_battery: -1,
                    current_consumed: -1,
                    battery_remaining: -1,
                    ..m::BATTERY_STATUS_DATA::DEFAULT
                };
                if self.battery_reported && self.has_battery_monitor() {
                    // Battery voltage as that of the first cell.
                    battery.voltages[0] = (self.shown_voltage() * 1e3).round() as u16;
                    battery.current_battery = (3.6e5 * CAPACITY_AH / self.endurance_s).round() as i16;
                    battery.current_consumed = (1e3 * CAPACITY_AH * self.used()).round() as i32;
                    battery.battery_remaining = (100.0 * self.shown_charge()).round() as i8;
                }
                M::BATTERY_STATUS(battery)
            }
            // Without a signal, PX4 reports the receiver as absent. ArduCopter reports it as unhealthy, with
            // the failsafe's channel values.
            m::RC_CHANNELS_DATA::ID if self.conditions.remote_lost && self.firmware() == Firmware::Px4 => {
                return None;
            }
            m::RC_CHANNELS_DATA::ID => {
                let mut d = m::RC_CHANNELS_DATA {
                    chancount: 18,
                    rssi: u8::MAX,
                    ..m::RC_CHANNELS_DATA::DEFAULT
                };
                fields!(d, chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw chan13_raw chan14_raw chan15_raw chan16_raw chan17_raw chan18_raw) =
                    self.channels?;
                M::RC_CHANNELS(d)
            }
            m::SYS_STATUS_DATA::ID => {
                let bit = |is: bool| {
                    if is {
                        m::MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_RC_RECEIVER
                    } else {
                        m::MavSysStatusSensor::empty()
                    }
                };
                let receiver = self.channels.is_some();
                let lost = self.conditions.remote_lost;
                let present = bit(receiver && (!lost || self.firmware() == Firmware::ArduCopter));
                M::SYS_STATUS(m::SYS_STATUS_DATA {
                    onboard_control_sensors_present: present,
                    onboard_control_sensors_enabled: present,
                    onboard_control_sensors_health: bit(receiver && !lost),
                    ..m::SYS_STATUS_DATA::DEFAULT
                })
            }
            m::ESTIMATOR_STATUS_DATA::ID => M::ESTIMATOR_STATUS(m::ESTIMATOR_STATUS_DATA {
                flags: self.estimator_flags(),
                ..m::ESTIMATOR_STATUS_DATA::DEFAULT
            }),
            EKF_STATUS_REPORT => {
                let flags = self.estimator_flags().bits();
                return Some(MavlinkMessage::EkfStatus { flags });
            }
            m::SERVO_OUTPUT_RAW_DATA::ID => {
                let motors = self.flight.frame().count();
                let pulse_us = self.flight.pulse_us().round() as u16;
                let pulse = |k: usize| if k < motors { pulse_us } else { 0 };
                M::SERVO_OUTPUT_RAW(m::SERVO_OUTPUT_RAW_DATA {
                    servo1_raw: pulse(0),
                    servo2_raw: pulse(1),
                    servo3_raw: pulse(2),
                    servo4_raw: pulse(3),
                    servo5_raw: pulse(4),
                    servo6_raw: pulse(5),
                    servo7_raw: pulse(6),
                    servo8_raw: pulse(7),
                    ..m::SERVO_OUTPUT_RAW_DATA::DEFAULT
                })
            }
            m::ATTITUDE_TARGET_DATA::ID => M::ATTITUDE_TARGET(m::ATTITUDE_TARGET_DATA {
                thrust: self.flight.reported_thrust() as f32,
                ..m::ATTITUDE_TARGET_DATA::DEFAULT
            }),
            _ => return None,
        };
        Some(message.into())
    }
}
