//! Inbound messages: heartbeats, clocks, samples and answers.

use alight_shared::{
    geodesy::Datum,
    mavlink::{self, EKF_STATUS_REPORT, Message as _, MessageData as _, dialect as m, fields},
    msg::{CommandKind, DroneState, LandedState},
    time::Span,
};

use super::{
    AutopilotLink, AutopilotOut, DroneTime, Output, drone_state,
    message::{
        self, Address, CommandLong, MavCmd, MavMessage as M, MavResult, MavlinkFrame, MavlinkMessage,
        ParameterValue, command_ack, result_name, severity, text, version, wide,
    },
    modes::Firmware,
    orders::named,
    peer::MavlinkPeer,
    station::{Answer, CommandOutcome, Repetition, StationCommand},
};

/// Factor of `SCALED_IMU`, m/s² per mG.
const MILLI_G: f64 = 9.806_65e-3;
/// Silence after which an autopilot counts as gone and another one is accepted, s.
const OTHER_AFTER_S: f64 = 10.0;

impl AutopilotLink {
    /// Processes a frame. Returns whether it reported the autopilot's mode.
    pub(super) fn receive(&mut self, now: DroneTime, frame: &MavlinkFrame, out: &mut AutopilotOut) -> bool {
        if let MavlinkMessage::Common(message) = &frame.message {
            if let M::HEARTBEAT(heartbeat) = message {
                return self.on_heartbeat(now, frame.from, heartbeat);
            }
            if self.asked_by_station(now, frame.from, message, out) {
                return false;
            }
        }
        if let MavlinkMessage::RelativePlace(report) = &frame.message {
            let latency = Span::from_secs(self.config.receiver_latency_s);
            if let Some(text) = self.moving_base.other_station(now, report) {
                out.alarm(severity::WARNING, text);
            }
            let place = self.moving_base.place(now, report, latency, &mut self.headers);
            out.relative.extend(place);
            return false;
        }
        let own = self.peer.as_ref().map(|p| p.address.system);
        if let Some(beacon) = (self.others).beacon(now, frame, own, &self.config, &mut self.headers) {
            out.beacon = Some(beacon);
            return false;
        }
        let Some(peer) = self.peer.as_mut().filter(|p| p.address == frame.from) else {
            return false;
        };
        match &frame.message {
            MavlinkMessage::Common(message) => return self.on_message(now, message, out),
            MavlinkMessage::EkfStatus { flags } => {
                peer.streams.received(EKF_STATUS_REPORT);
                let flags = m::EstimatorStatusFlags::from_bits_retain(*flags);
                self.estimate.heading.status(now, flags);
            }
            MavlinkMessage::Text { severity: of, text } => {
                if *of <= severity::WARNING {
                    self.failsafe.on_text(now, text);
                    self.commands.departure.explained(now, text);
                    out.texts.push(format!("{}: {text}", peer.firmware.name()));
                }
            }
            // Of other systems.
            MavlinkMessage::Ais(_)
            | MavlinkMessage::RelativePlace(_)
            | MavlinkMessage::Position(_)
            | MavlinkMessage::AttitudeThrust(_)
            | MavlinkMessage::TargetRelative(_)
            | MavlinkMessage::TargetAbsolute(_)
            | MavlinkMessage::HilSensor(_)
            | MavlinkMessage::HilGps(_) => {}
        }
        false
    }

    /// Processes a message of the autopilot. Returns whether it reported the autopilot's mode.
    fn on_message(&mut self, now: DroneTime, message: &M, out: &mut AutopilotOut) -> bool {
        let Some(peer) = &mut self.peer else {
            return false;
        };
        let c = &self.config;
        peer.streams.received(match (message, peer.firmware) {
            // Either inertial message counts for the requested one.
            (M::HIGHRES_IMU(_) | M::SCALED_IMU(_), Firmware::Px4) => m::HIGHRES_IMU_DATA::ID,
            (M::HIGHRES_IMU(_) | M::SCALED_IMU(_), Firmware::ArduCopter) => m::SCALED_IMU_DATA::ID,
            _ => message.message_id(),
        });
        match message {
            M::TIMESYNC(d) if d.tc1 == 0 => out.send(M::TIMESYNC(m::TIMESYNC_DATA {
                tc1: now.nanos(),
                ts1: d.ts1,
                ..m::TIMESYNC_DATA::DEFAULT
            })),
            M::TIMESYNC(d) => {
                let restarted = self.clock.on_answer(now, d.ts1, d.tc1, c.timesync_limit_s);
                if restarted {
                    self.estimate.forget();
                    peer.parameters.read_again();
                }
            }
            M::ODOMETRY(d) => {
                if let Some(at) = self.clock.local_time(now, micros(d.time_usec)) {
                    let state = self.estimate.assembler.odometry(at, d, c);
                    self.on_odometry(now, state, out);
                }
            }
            M::DISTANCE_SENSOR(d) => self.on_distance(now, d, out),
            M::LOCAL_POSITION_NED(d) => {
                if let Some(at) = self.clock.local_time(now, millis(d.time_boot_ms)) {
                    let position = wide(fields!(d, x y z));
                    let velocity = wide(fields!(d, vx vy vz));
                    let state = self.estimate.assembler.position(at, position, velocity, c);
                    self.on_odometry(now, state, out);
                }
            }
            M::ATTITUDE_QUATERNION(d) => {
                if let Some(at) = self.clock.local_time(now, millis(d.time_boot_ms)) {
                    let rates = wide(fields!(d, rollspeed pitchspeed yawspeed));
                    let attitude = wide(fields!(d, q1 q2 q3 q4));
                    self.estimate.assembler.attitude(at, attitude, rates);
                }
            }
            M::HIGHRES_IMU(d) => self.on_imu(now, micros(d.time_usec), wide(fields!(d, xacc yacc zacc))),
            M::SCALED_IMU(d) => {
                let force = fields!(d, xacc yacc zacc).map(|a| f64::from(a) * MILLI_G);
                self.on_imu(now, millis(d.time_boot_ms), force);
            }
            M::CURRENT_MODE(d) => {
                peer.on_mode(d.custom_mode);
                return true;
            }
            M::EXTENDED_SYS_STATE(d) => peer.on_landed(now, d.landed_state),
            M::BATTERY_STATUS(d) => peer.battery(now, d),
            M::SERVO_OUTPUT_RAW(d) => peer.rotors.outputs(now, peer.armed, d),
            M::ATTITUDE_TARGET(d) => {
                let attitude = self.estimate.state.map(|s| s.attitude);
                let compensation = attitude.map_or(1.0, |a| peer.tilt_compensation(a));
                peer.thrust(now, f64::from(d.thrust) / compensation);
            }
            M::PARAM_VALUE(d) => {
                let value = ParameterValue::read(d.param_value, d.param_type);
                peer.parameters.received(&text(&d.param_id), value);
            }
            M::AUTOPILOT_VERSION(d) => peer.parameters.on_version(version(d)),
            M::GPS_GLOBAL_ORIGIN(d) => {
                let origin = mavlink::place(d.latitude, d.longitude, d.altitude);
                if self.estimate.origin.on_report(&origin) {
                    self.estimate.restart();
                }
            }
            M::HOME_POSITION(d) => {
                let home = mavlink::place(d.latitude, d.longitude, d.altitude);
                peer.home = Some(home).filter(Datum::is_on_earth);
            }
            M::GPS_RAW_INT(d) => {
                let metres = |mm: i32| f64::from(mm) * 1e-3;
                self.estimate
                    .origin
                    .on_heights(metres(d.alt), metres(d.alt_ellipsoid));
            }
            M::COMMAND_ACK(d) => self.on_answer(now, d, out),
            M::SYS_STATUS(d) => {
                let present = d.onboard_control_sensors_present;
                let healthy = d.onboard_control_sensors_health;
                self.operators.switch.on_status(now, present, healthy);
            }
            M::ESTIMATOR_STATUS(d) => self.estimate.heading.status(now, d.flags),
            M::MISSION_CURRENT(d) => self.own_mission.monitor.current(peer.firmware, d),
            M::MISSION_ITEM_REACHED(d) => self.own_mission.monitor.reached(d.seq),
            M::RC_CHANNELS(d) => {
                if let Some(kind) = self.operators.switch.on_channels(now, c.rc_switch, d) {
                    let header = self.headers.next(Output::Command, now);
                    self.operators.switch.give(header, kind);
                    self.on_order(now, kind, "the remote control", out);
                }
            }
            _ => {}
        }
        false
    }

    /// Processes a specific force, m/s².
    fn on_imu(&mut self, now: DroneTime, time_ns: i64, force: [f64; 3]) {
        if let Some(at) = self.clock.local_time(now, time_ns) {
            self.estimate.assembler.imu(at, force);
        }
    }

    fn on_distance(&mut self, now: DroneTime, d: &m::DISTANCE_SENSOR_DATA, out: &mut AutopilotOut) {
        if drone_state::is_invalid(d) {
            let rejected = &mut self.estimate.assembler.rejected;
            *rejected = rejected.saturating_add(1);
            return;
        }
        let at = self.clock.local_time(now, millis(d.time_boot_ms));
        let sample = at.and_then(|at| drone_state::range(at, d, &self.config));
        let newer = sample.and_then(|s| self.estimate.range.take(s, &mut self.headers));
        out.ranges.extend(newer);
    }

    /// Whether an answer is addressed to this component; some firmware omits the address.
    fn is_addressed(&self, to: Address) -> bool {
        let own = self.address();
        let is = |stated: u8, own: u8| stated == 0 || stated == own;
        is(to.system, own.system) && is(to.component, own.component)
    }
    fn on_answer(&mut self, now: DroneTime, d: &m::COMMAND_ACK_DATA, out: &mut AutopilotOut) {
        let command = d.command;
        let result = d.result;
        if !self.is_addressed(Address::new(d.target_system, d.target_component)) {
            return;
        }
        let Some(peer) = &mut self.peer else { return };
        let departure = &mut self.commands.departure;
        let d = &self.disarm;
        if command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
            && result == MavResult::MAV_RESULT_ACCEPTED
            && departure.accepted(now)
        {
            peer.arming_accepted(now);
        }
        if command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL {
            peer.streams.answered(now, result);
        } else if command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
            && result == MavResult::MAV_RESULT_ACCEPTED
            && departure.disarms() + d.touchdown.sent() + d.alone.sent() + d.own_landing.sent() > 0
        {
            // PX4's next heartbeat may be a second away.
            peer.armed = false;
        } else if matches!(
            command,
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
                | MavCmd::MAV_CMD_DO_SET_MODE
                | MavCmd::MAV_CMD_MISSION_START
        ) && !matches!(
            result,
            MavResult::MAV_RESULT_ACCEPTED | MavResult::MAV_RESULT_IN_PROGRESS
        ) {
            if command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
                && let Some(why) = departure.denied(now, result)
            {
                let text = format!("{} {why}", peer.firmware.name());
                out.alarm(severity::WARNING, text);
                return;
            }
            let result = result_name(result);
            out.texts
                .push(format!("the autopilot denied {command:?}: {result}"));
        }
    }

    fn on_order(&mut self, now: DroneTime, kind: CommandKind, place: &str, out: &mut AutopilotOut) {
        if kind == CommandKind::Abort {
            self.operators.station.stopped(now);
        }
        let (severity, order) = named(kind);
        out.alarm(severity, format!("{place} commands {order}"));
    }

    /// Answers a ground station's request; returns false for other messages.
    fn asked_by_station(
        &mut self,
        now: DroneTime,
        from: Address,
        message: &M,
        out: &mut AutopilotOut,
    ) -> bool {
        let own = self.address();
        match message {
            M::COMMAND_LONG(d) => {
                let command = CommandLong::from(d);
                let [height, ahead, right, minutes, ..] = command.parameters;
                let asked = StationCommand {
                    number: command.command,
                    first: [height, ahead, right, minutes],
                    repetition: Repetition::counted(command.confirmation),
                };
                if command.to != own {
                    return false;
                }
                self.on_command(now, from, &asked, out);
            }
            M::COMMAND_INT(d) if Address::new(d.target_system, d.target_component) == own => {
                let asked = StationCommand {
                    number: d.command,
                    first: wide(fields!(d, param1 param2 param3 param4)),
                    repetition: Repetition::Perhaps,
                };
                self.on_command(now, from, &asked, out);
            }
            // A ground station requests the parameters of all components at once.
            M::PARAM_REQUEST_LIST(d)
                if d.target_system == own.system
                    && [own.component, message::ALL_COMPONENTS].contains(&d.target_component) =>
            {
                self.list_parameters(out);
                return d.target_component == own.component;
            }
            M::PARAM_REQUEST_READ(d) if Address::new(d.target_system, d.target_component) == own => {
                // -1: by name.
                let index = u16::try_from(d.param_index).ok();
                self.read_parameter(&text(&d.param_id), index, out);
            }
            M::PARAM_SET(d) if Address::new(d.target_system, d.target_component) == own => {
                let value = ParameterValue::read(d.param_value, d.param_type);
                self.set_parameter(now, from, &text(&d.param_id), value, out);
            }
            _ => return false,
        }
        true
    }

    fn on_command(&mut self, now: DroneTime, from: Address, asked: &StationCommand, out: &mut AutopilotOut) {
        let command = asked.number;
        let answer = |result| command_ack(command, result, from);
        let admits = [self.operators.switch.bars(), self.config.takes_orders()];
        match self.operators.station.received(now, from, asked, admits) {
            CommandOutcome::Answered(result) => out.messages.push(answer(result)),
            CommandOutcome::Rejected(result, why) => {
                out.messages.push(answer(result));
                let text = format!("rejected an order of ground station {}: {why}", from.system);
                out.alarm(severity::WARNING, text);
            }
            CommandOutcome::Order(kind) => {
                let header = self.headers.next(Output::Command, now);
                let replaced = self.operators.station.give((command, kind), from, header);
                out.messages.extend(replaced.iter().flat_map(Answer::messages));
                out.messages.push(answer(MavResult::MAV_RESULT_IN_PROGRESS));
                self.on_order(now, kind, &format!("ground station {}", from.system), out);
            }
        }
    }

    /// Whether the vehicle's autopilot has this address.
    pub(super) fn accepts(&self, from: Address) -> bool {
        let wanted = self.config.vehicle;
        from.component == message::AUTOPILOT_COMPONENT && (wanted == 0 || wanted == from.system)
    }

    /// System number of another vehicle's autopilot, if none is configured.
    pub(super) fn other_autopilot(&self, now: DroneTime) -> Option<u8> {
        let own = self.peer.as_ref()?.address.system;
        let (at, system) = self.others.autopilot?;
        let recent = (now - at).secs() <= OTHER_AFTER_S;
        (recent && system != own).then_some(system)
    }

    fn on_heartbeat(&mut self, now: DroneTime, from: Address, h: &m::HEARTBEAT_DATA) -> bool {
        let Some(firmware) = Firmware::of(h.autopilot, h.mavtype).filter(|_| self.accepts(from)) else {
            return false;
        };
        match &mut self.peer {
            Some(p) if (p.address, p.firmware) == (from, firmware) => {}
            Some(p) if (now - p.heartbeat_at).secs() <= OTHER_AFTER_S => {
                if from.system != p.address.system {
                    self.others.autopilot = Some((now, from.system));
                }
                return false;
            }
            peer => {
                let c = &self.config;
                let attitudes = self.stream.attitudes;
                *peer = Some(MavlinkPeer::new(from, firmware, now, c, attitudes));
                self.authority.forget();
                self.clock.forget();
                self.estimate.forget();
            }
        }
        if let Some(p) = &mut self.peer {
            p.streams.received(m::HEARTBEAT_DATA::ID);
            p.heartbeat(now, h.base_mode, h.custom_mode);
            p.is_critical = h.system_status == m::MavState::MAV_STATE_CRITICAL;
        }
        true
    }

    fn on_odometry(&mut self, now: DroneTime, reported: Option<DroneState>, out: &mut AutopilotOut) {
        let Some(reported) = reported else { return };
        let up = |p: &MavlinkPeer| p.armed && p.landed(now) != LandedState::OnGround;
        let flies = self.peer.as_ref().is_some_and(up) && !self.may_touch(now);
        let thrust = self.applied_thrust(now).filter(|_| flies);
        let firmware = self.firmware();
        let c = &self.config;
        let inputs = &self.inputs;
        let headers = &mut self.headers;
        let state = (self.estimate).step(now, reported, inputs, thrust, firmware, c, headers);
        out.odometry.extend(state);
    }
}

/// Converts to ns, saturating.
fn micros(us: u64) -> i64 {
    i64::try_from(us).unwrap_or(i64::MAX).saturating_mul(1000)
}
fn millis(ms: u32) -> i64 {
    i64::from(ms).saturating_mul(1_000_000)
}
