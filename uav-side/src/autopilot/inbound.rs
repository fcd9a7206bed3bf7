//! What is heard on the link: heartbeats, clocks, samples, answers.

use alight_shared::frames::{Datum, DroneNed};
use alight_shared::msg::{DroneState, LandedState};

use super::message::{self, Address, CommandResult, Frame, Message, command};
use super::modes::Firmware;
use super::peer::Peer;
use super::{AutopilotLink, AutopilotOut, Instant, drone_state, thrust};

/// An origin further from the datum than this is none of this landing, m.
const MAX_ORIGIN_DISTANCE_M: f64 = 5.0e4;
/// An origin that moved by more than this is another, m.
const ORIGIN_MOVED_M: f64 = 0.05;
/// Time constant of the specific force in the evidence for a disarm, s.
const SPECIFIC_FORCE_TIME_S: f64 = 0.03;
/// Another autopilot is listened to when the first was silent for this long, s.
const OTHER_AFTER_S: f64 = 10.0;

impl AutopilotLink {
    /// A frame of the link. Gives whether it was the autopilot's word on its mode: a heartbeat, mostly.
    pub(super) fn receive(&mut self, now: Instant, frame: &Frame, out: &mut AutopilotOut) -> bool {
        if let Message::Heartbeat {
            autopilot,
            vehicle,
            base_mode,
            custom_mode,
        } = frame.message
        {
            return self.on_heartbeat(now, frame.from, autopilot, vehicle, base_mode, custom_mode);
        }
        let Some(peer) = self.peer.as_mut().filter(|p| p.address == frame.from) else {
            return false;
        };
        let c = &self.config;
        match &frame.message {
            Message::Heartbeat { .. } => {}
            Message::Timesync {
                remote_ns: 0,
                local_ns,
            } => out.messages.push(Message::Timesync {
                remote_ns: now.nanos(),
                local_ns: *local_ns,
            }),
            Message::Timesync { remote_ns, local_ns } => {
                if let Some(k) = self.timesync_requests.iter().position(|q| q == local_ns) {
                    self.timesync_requests.remove(k);
                    let before = self.clock.restarts();
                    self.clock
                        .answered(now, *local_ns, *remote_ns, c.timesync_limit_s);
                    if self.clock.restarts() != before {
                        self.drone_state.restart();
                    }
                }
            }
            Message::Odometry(o) => {
                peer.streams.received(message::id::ODOMETRY);
                if let Some(at) = self.clock.ours(now, micros(o.time_us)) {
                    let state = self.drone_state.odometry(at, o, c);
                    self.on_odometry(now, state, out);
                }
            }
            Message::LocalPosition {
                time_ms,
                position,
                velocity,
            } => {
                peer.streams.received(message::id::LOCAL_POSITION_NED);
                if let Some(at) = self.clock.ours(now, millis(*time_ms)) {
                    let state = self.drone_state.position(at, *position, *velocity, c);
                    self.on_odometry(now, state, out);
                }
            }
            Message::Attitude {
                time_ms,
                attitude,
                rates,
            } => {
                peer.streams.received(message::id::ATTITUDE_QUATERNION);
                if let Some(at) = self.clock.ours(now, millis(*time_ms)) {
                    self.drone_state.attitude(at, *attitude, *rates);
                }
            }
            Message::Imu {
                time_us,
                accelerometer,
                ..
            } => {
                peer.streams.received(match peer.firmware {
                    Firmware::Px4 => message::id::HIGHRES_IMU,
                    Firmware::ArduCopter => message::id::SCALED_IMU,
                });
                if let Some(at) = self.clock.ours(now, micros(*time_us)) {
                    self.drone_state.imu(at, *accelerometer);
                }
            }
            Message::Distance {
                time_ms,
                range_m,
                limits_m,
                variance,
            } => {
                peer.streams.received(message::id::DISTANCE_SENSOR);
                let sample = self
                    .clock
                    .ours(now, millis(*time_ms))
                    .and_then(|at| drone_state::range(at, *range_m, *limits_m, *variance, c));
                if let Some(mut sample) = sample
                    && self.range.is_none_or(|r| sample.header.at > r.header.at)
                {
                    sample.header = self.header(2, sample.header.at);
                    self.range = Some(sample);
                    out.ranges.push(sample);
                }
            }
            Message::Mode { custom_mode } => {
                peer.streams.received(message::id::CURRENT_MODE);
                peer.mode = peer.firmware.mode(*custom_mode);
                // As good a word on the mode as a heartbeat.
                return true;
            }
            Message::Landed { state } => {
                peer.streams.received(message::id::EXTENDED_SYS_STATE);
                peer.landed(*state);
            }
            Message::Battery { number, remaining } => {
                peer.streams.received(message::id::BATTERY_STATUS);
                peer.battery(*number, *remaining);
            }
            Message::AttitudeTargetThrust { thrust } => {
                peer.streams.received(message::id::ATTITUDE_TARGET);
                let attitude = self.state.map(|s| s.attitude);
                peer.thrust(now, *thrust / attitude.map_or(1.0, |a| peer.tilt_compensation(a)));
            }
            Message::Parameter { name, value } => peer.parameter(name, *value),
            Message::Origin(reported) => self.on_origin(reported),
            Message::CommandAck { command, result } => {
                if *command == command::MESSAGE_INTERVAL {
                    peer.streams.answered(now, *result);
                } else if *command == command::ARM_DISARM
                    && *result == CommandResult::Accepted
                    && self.disarm.sent() > 0
                {
                    // PX4's next heartbeat may be a second away.
                    peer.armed = false;
                } else if matches!(*command, command::ARM_DISARM | command::SET_MODE)
                    && !matches!(result, CommandResult::Accepted | CommandResult::InProgress)
                {
                    out.texts
                        .push(format!("the autopilot refused command {command}: {result:?}"));
                }
            }
            Message::Text { severity, text } => {
                if *severity <= 4 {
                    out.texts.push(format!("{}: {text}", peer.firmware.name()));
                }
            }
            // What others are told.
            Message::ParameterRequest { .. }
            | Message::Command(_)
            | Message::Position(_)
            | Message::AttitudeThrust(_)
            | Message::LandingTarget { .. }
            | Message::Deck { .. }
            | Message::HilSensor(_)
            | Message::HilGps(_)
            | Message::HilActuators { .. } => {}
        }
        false
    }

    fn on_heartbeat(
        &mut self,
        now: Instant,
        from: Address,
        autopilot: u8,
        vehicle: u8,
        base_mode: u8,
        custom_mode: u32,
    ) -> bool {
        let wanted = self.config.vehicle;
        let Some(firmware) = Firmware::of(autopilot, vehicle)
            .filter(|_| from.component == message::AUTOPILOT_COMPONENT)
            .filter(|_| wanted == 0 || wanted == from.system)
        else {
            return false;
        };
        let gone = |p: &Peer| (now - p.heartbeat_at).secs() > OTHER_AFTER_S;
        let other = self
            .peer
            .as_ref()
            .is_none_or(|p| (p.address, p.firmware) != (from, firmware));
        if other {
            if self.peer.as_ref().is_some_and(|p| !gone(p)) {
                return false;
            }
            self.peer = Some(Peer::new(from, firmware, now, &self.config));
            self.clock.forget();
            self.drone_state.restart();
        }
        if let Some(p) = &mut self.peer {
            p.streams.received(message::id::HEARTBEAT);
            p.heartbeat(now, base_mode, custom_mode);
        }
        true
    }

    /// The origin of the autopilot's own NED.
    fn on_origin(&mut self, reported: &Datum) {
        let Some(datum) = &self.datum else { return };
        let reported = Datum {
            height_m: reported.height_m + self.config.geoid_m,
            ..*reported
        };
        let shift = datum.offset_to::<DroneNed>(&reported).0;
        if !(shift.norm() < MAX_ORIGIN_DISTANCE_M) {
            return;
        }
        if self.shift.is_some_and(|s| (s - shift).norm() > ORIGIN_MOVED_M) {
            self.drone_state.restart();
        }
        self.shift = Some(shift);
    }

    /// New odometry: made smooth, learnt from, told on.
    fn on_odometry(&mut self, now: Instant, reported: Option<DroneState>, out: &mut AutopilotOut) {
        let (Some(mut reported), Some(shift)) = (reported, self.shift) else {
            return;
        };
        reported.position = (reported.position() + shift).into();
        let dt = self
            .state
            .map_or(0.01, |s| (reported.header.at - s.header.at).secs());
        let up = -reported.specific_force[2];
        let gain = 1.0 - (-dt.clamp(0.0, 1.0) / SPECIFIC_FORCE_TIME_S).exp();
        self.force = Some(self.force.map_or(up, |f| f + gain * (up - f)));
        if let Some(p) = &self.peer
            && p.armed
            && p.landed != LandedState::OnGround
            && !self.may_touch(now)
            && let Some(t) = p.thrust_now(now)
        {
            let fraction = thrust::fraction(t, self.config.thrust_curve);
            self.hover.learn(fraction, up, dt, self.config.hover_thrust_s);
        }
        let mut state = self.smooth.step(&reported);
        state.header = self.header(0, reported.header.at);
        self.state = Some(state);
        out.odometry.push(state);
    }
}

/// Nanoseconds of microseconds; saturates.
fn micros(us: u64) -> i64 {
    i64::try_from(us).unwrap_or(i64::MAX).saturating_mul(1000)
}
/// Nanoseconds of milliseconds.
fn millis(ms: u32) -> i64 {
    i64::from(ms).saturating_mul(1_000_000)
}
