//! Inbound messages: heartbeats, clocks, samples and answers.

use alight_shared::geodesy::Datum;
use alight_shared::msg::{CommandKind, DroneState, LandedState};
use alight_shared::time::Span;

use super::message::{
    self, Address, CommandResult, DistanceReport, Heartbeat, MavlinkFrame, MavlinkMessage, command, severity,
};
use super::modes::Firmware;
use super::orders::named;
use super::peer::MavlinkPeer;
use super::station::{Answer, CommandOutcome, Repetition, StationCommand};
use super::{AutopilotLink, AutopilotOut, DroneTime, Output, drone_state};

/// Silence after which an autopilot counts as gone and another one is accepted, s.
const OTHER_AFTER_S: f64 = 10.0;

impl AutopilotLink {
    /// Processes a frame. Returns whether it reported the autopilot's mode.
    pub(super) fn receive(&mut self, now: DroneTime, frame: &MavlinkFrame, out: &mut AutopilotOut) -> bool {
        if let MavlinkMessage::Heartbeat(heartbeat) = &frame.message {
            return self.on_heartbeat(now, frame.from, heartbeat);
        }
        if self.asked_by_station(now, frame, out) {
            return false;
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
        let c = &self.config;
        match &frame.message {
            MavlinkMessage::Heartbeat(_) => {}
            MavlinkMessage::Timesync {
                remote_ns: 0,
                local_ns,
            } => out.messages.push(MavlinkMessage::Timesync {
                remote_ns: now.nanos(),
                local_ns: *local_ns,
            }),
            MavlinkMessage::Timesync { remote_ns, local_ns } => {
                let limit_s = c.timesync_limit_s;
                if self.clock.on_answer(now, *local_ns, *remote_ns, limit_s) {
                    self.estimate.forget();
                    peer.parameters.read_again();
                }
            }
            MavlinkMessage::Odometry(o) => {
                peer.streams.received(message::id::ODOMETRY);
                if let Some(at) = self.clock.local_time(now, micros(o.time_us)) {
                    let state = self.estimate.assembler.odometry(at, o, c);
                    self.on_odometry(now, state, out);
                }
            }
            MavlinkMessage::LocalPosition(p) => {
                peer.streams.received(message::id::LOCAL_POSITION_NED);
                if let Some(at) = self.clock.local_time(now, millis(p.time_ms)) {
                    let state = self.estimate.assembler.position(at, p.position, p.velocity, c);
                    self.on_odometry(now, state, out);
                }
            }
            MavlinkMessage::Attitude(a) => {
                peer.streams.received(message::id::ATTITUDE_QUATERNION);
                if let Some(at) = self.clock.local_time(now, millis(a.time_ms)) {
                    self.estimate.assembler.attitude(at, a.attitude, a.rates);
                }
            }
            MavlinkMessage::Imu(i) => {
                peer.streams.received(match peer.firmware {
                    Firmware::Px4 => message::id::HIGHRES_IMU,
                    Firmware::ArduCopter => message::id::SCALED_IMU,
                });
                if let Some(at) = self.clock.local_time(now, micros(i.time_us)) {
                    self.estimate.assembler.imu(at, i.accelerometer);
                }
            }
            MavlinkMessage::Distance(d) => {
                peer.streams.received(message::id::DISTANCE_SENSOR);
                self.on_distance(now, d, out);
            }
            MavlinkMessage::Mode { custom_mode } => {
                peer.streams.received(message::id::CURRENT_MODE);
                peer.on_mode(*custom_mode);
                return true;
            }
            MavlinkMessage::Landed { state } => {
                peer.streams.received(message::id::EXTENDED_SYS_STATE);
                peer.on_landed(now, *state);
            }
            MavlinkMessage::Battery {
                number,
                remaining,
                voltage_v,
                current_a,
            } => {
                peer.streams.received(message::id::BATTERY_STATUS);
                peer.battery(now, *number, [*remaining, *voltage_v, *current_a]);
            }
            MavlinkMessage::Outputs { port, pulses_us } => {
                peer.streams.received(message::id::SERVO_OUTPUT_RAW);
                peer.rotors.outputs(now, peer.armed, *port, pulses_us);
            }
            MavlinkMessage::AttitudeTargetThrust { thrust } => {
                peer.streams.received(message::id::ATTITUDE_TARGET);
                let attitude = self.estimate.state.map(|s| s.attitude);
                peer.thrust(now, *thrust / attitude.map_or(1.0, |a| peer.tilt_compensation(a)));
            }
            MavlinkMessage::Parameter { name, value, .. } => peer.parameters.received(name, *value),
            MavlinkMessage::Origin(origin) => {
                if self.estimate.origin.on_report(origin) {
                    self.estimate.restart();
                }
            }
            MavlinkMessage::Home(home) => {
                peer.home = Some(*home).filter(Datum::is_on_earth);
            }
            MavlinkMessage::GnssHeights { sea_m, ellipsoid_m } => {
                self.estimate.origin.on_heights(*sea_m, *ellipsoid_m);
            }
            MavlinkMessage::CommandAck { command, result, to } => {
                if self.is_addressed(*to) {
                    self.on_answer(now, *command, *result, out);
                }
            }
            MavlinkMessage::SystemStatus { present, healthy } => {
                peer.streams.received(message::id::SYS_STATUS);
                self.operators.switch.on_status(now, *present, *healthy);
            }
            MavlinkMessage::EstimatorStatus { flags } => {
                peer.streams.received(message::id::ESTIMATOR_STATUS);
                self.estimate.heading.status(now, *flags);
            }
            MavlinkMessage::EkfStatus { flags } => {
                peer.streams.received(message::id::EKF_STATUS_REPORT);
                self.estimate.heading.status(now, *flags);
            }
            MavlinkMessage::MissionCurrent { total, state } => {
                self.own_mission.monitor.current(peer.firmware, *total, *state);
            }
            MavlinkMessage::MissionItemReached { item } => self.own_mission.monitor.reached(*item),
            MavlinkMessage::RemoteControl(channels) => {
                peer.streams.received(message::id::RC_CHANNELS);
                if let Some(kind) = self.operators.switch.on_channels(now, c.rc_switch, channels) {
                    let header = self.headers.next(Output::Command, now);
                    self.operators.switch.give(header, kind);
                    self.on_order(now, kind, "the remote control", out);
                }
            }
            MavlinkMessage::Text { severity: of, text } => {
                if *of <= severity::WARNING {
                    self.commands.departure.explained(now, text);
                    out.texts.push(format!("{}: {text}", peer.firmware.name()));
                }
            }
            // Addressed to other systems.
            MavlinkMessage::ParameterList { .. }
            | MavlinkMessage::ParameterRequest { .. }
            | MavlinkMessage::ParameterSet { .. }
            | MavlinkMessage::Command(_)
            | MavlinkMessage::CommandInt { .. }
            | MavlinkMessage::GlobalPosition(_)
            | MavlinkMessage::FollowTarget(_)
            | MavlinkMessage::Ais(_)
            | MavlinkMessage::RelativePlace(_)
            | MavlinkMessage::Rtcm { .. }
            | MavlinkMessage::Position(_)
            | MavlinkMessage::AttitudeThrust(_)
            | MavlinkMessage::LandingTarget(_)
            | MavlinkMessage::TargetRelative(_)
            | MavlinkMessage::TargetAbsolute(_)
            | MavlinkMessage::Deck { .. }
            | MavlinkMessage::RemoteControlOverride { .. }
            | MavlinkMessage::NamedValue { .. }
            | MavlinkMessage::HilSensor(_)
            | MavlinkMessage::HilGps(_)
            | MavlinkMessage::HilActuators { .. } => {}
        }
        false
    }

    fn on_distance(&mut self, now: DroneTime, d: &DistanceReport, out: &mut AutopilotOut) {
        if !(d.range_m > 0.0) {
            let rejected = &mut self.estimate.assembler.rejected;
            *rejected = rejected.saturating_add(1);
            return;
        }
        let at = self.clock.local_time(now, millis(d.time_ms));
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
    fn on_answer(&mut self, now: DroneTime, command: u16, result: CommandResult, out: &mut AutopilotOut) {
        let Some(peer) = &mut self.peer else { return };
        let (departure, d) = (&mut self.commands.departure, &self.disarm);
        if command == command::ARM_DISARM && result == CommandResult::Accepted {
            departure.accepted(now);
        }
        if command == command::MESSAGE_INTERVAL {
            peer.streams.answered(now, result);
        } else if command == command::ARM_DISARM
            && result == CommandResult::Accepted
            && departure.disarms() + d.touchdown.sent() + d.alone.sent() + d.own_landing.sent() > 0
        {
            // PX4's next heartbeat may be a second away.
            peer.armed = false;
        } else if matches!(
            command,
            command::ARM_DISARM | command::SET_MODE | command::MISSION_START
        ) && !matches!(result, CommandResult::Accepted | CommandResult::InProgress)
        {
            if command == command::ARM_DISARM
                && let Some(why) = departure.denied(now, result)
            {
                let text = format!("{} {why}", peer.firmware.name());
                out.alarm(severity::WARNING, text);
                return;
            }
            out.texts
                .push(format!("the autopilot denied command {command}: {result:?}"));
        }
    }

    fn on_order(&mut self, now: DroneTime, kind: CommandKind, place: &str, out: &mut AutopilotOut) {
        if kind == CommandKind::Abort {
            self.operators.station.stopped(now);
        }
        let (severity, order) = named(kind);
        out.alarm(severity, format!("{place} commands {order}"));
    }

    /// Answers a ground station's request; returns false for other frames.
    fn asked_by_station(&mut self, now: DroneTime, frame: &MavlinkFrame, out: &mut AutopilotOut) -> bool {
        let own = self.address();
        if let MavlinkMessage::Command(c) = &frame.message
            && c.to == own
        {
            let [height, ahead, right, minutes, ..] = c.parameters;
            let asked = StationCommand {
                number: c.command,
                first: [height, ahead, right, minutes],
                repetition: Repetition::counted(c.confirmation),
            };
            self.on_command(now, frame.from, &asked, out);
            return true;
        }
        if let MavlinkMessage::CommandInt { to, command, first } = &frame.message
            && *to == own
        {
            let asked = StationCommand {
                number: *command,
                first: *first,
                repetition: Repetition::Perhaps,
            };
            self.on_command(now, frame.from, &asked, out);
            return true;
        }
        // A ground station requests the parameters of all components at once.
        if let MavlinkMessage::ParameterList { to } = &frame.message
            && (*to == own || *to == Address::new(own.system, message::ALL_COMPONENTS))
        {
            self.list_parameters(out);
            return *to == own;
        }
        if let MavlinkMessage::ParameterRequest { to, name, index } = &frame.message
            && *to == own
        {
            self.read_parameter(name, *index, out);
            return true;
        }
        if let MavlinkMessage::ParameterSet { to, name, value } = &frame.message
            && *to == own
        {
            self.set_parameter(now, frame.from, name, *value, out);
            return true;
        }
        false
    }

    fn on_command(&mut self, now: DroneTime, from: Address, asked: &StationCommand, out: &mut AutopilotOut) {
        let command = asked.number;
        let answer = |result| MavlinkMessage::CommandAck {
            command,
            result,
            to: from,
        };
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
                out.messages.push(answer(CommandResult::InProgress));
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
        let (own, (at, system)) = (self.peer.as_ref()?.address.system, self.others.autopilot?);
        let recent = (now - at).secs() <= OTHER_AFTER_S;
        (recent && system != own).then_some(system)
    }

    fn on_heartbeat(&mut self, now: DroneTime, from: Address, h: &Heartbeat) -> bool {
        let Some(firmware) = Firmware::of(h.autopilot, h.vehicle).filter(|_| self.accepts(from)) else {
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
                let (c, attitudes) = (&self.config, self.stream.attitudes);
                *peer = Some(MavlinkPeer::new(from, firmware, now, c, attitudes));
                self.authority.forget();
                self.clock.forget();
                self.estimate.forget();
            }
        }
        if let Some(p) = &mut self.peer {
            p.streams.received(message::id::HEARTBEAT);
            p.heartbeat(now, h.base_mode, h.custom_mode);
        }
        true
    }

    fn on_odometry(&mut self, now: DroneTime, reported: Option<DroneState>, out: &mut AutopilotOut) {
        let Some(reported) = reported else { return };
        let up = |p: &MavlinkPeer| p.armed && p.landed(now) != LandedState::OnGround;
        let flies = self.peer.as_ref().is_some_and(up) && !self.may_touch(now);
        let thrust = self.applied_thrust(now).filter(|_| flies);
        let (firmware, c) = (self.firmware(), &self.config);
        let (inputs, headers) = (&self.inputs, &mut self.headers);
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
