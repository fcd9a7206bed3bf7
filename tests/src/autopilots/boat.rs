//! The simulated boat's autopilot, as ArduPilot Rover: it steers its own course in AUTO, to velocity set-points in GUIDED, and
//! stops without one for 3 s there. It speaks MAVLink. Its skipper may take the wheel, with or without the mode switch.

use alight_shared::frames::wrap_angle;
use alight_shared::mavlink::{self, FrameReader, MavlinkSender, Outgoing};
use alight_shared::time::{Span, Time, TrueTime};

use crate::physics::vessel::steering::SteeringSetPoint;

/// Custom modes of Rover.
pub const MANUAL: u32 = 0;
/// See [`MANUAL`].
pub const AUTO: u32 = 10;
/// See [`MANUAL`].
pub const GUIDED: u32 = 15;
/// Without a set-point for so long it stops.
const TIMEOUT: Span = Span::from_millis(3000);
/// Time between two heartbeats.
const HEARTBEAT: Span = Span::from_millis(1000);
/// Frames: number and check byte of the definition.
const HEARTBEAT_ID: (u32, u8) = (0, 50);
const COMMAND_ACK: (u32, u8) = (77, 143);
const COMMAND_LONG: u32 = 76;
const SET_POSITION_TARGET: u32 = 84;
const DO_SET_MODE: u16 = 176;
/// Bits of a type mask that ignore the horizontal velocity.
const IGNORES_VELOCITY: u16 = 0b1_1000;
/// A boat (`MAV_TYPE`) of ArduPilot (`MAV_AUTOPILOT`), with custom modes, active, MAVLink 2.
const IDENTITY: [u8; 5] = [11, 3, 81, 4, 3];

/// The autopilot.
pub struct BoatAutopilot {
    /// Mode of the autopilot.
    pub mode: u32,
    /// Nothing comes or goes on its link.
    pub cut: bool,
    /// A hand steers so, whatever the mode.
    pub hand: Option<SteeringSetPoint>,
    frames: FrameReader,
    set_point: Option<(Time<TrueTime>, SteeringSetPoint)>,
    due: Time<TrueTime>,
    answers: Vec<u8>,
    sequence: u8,
}

impl Default for BoatAutopilot {
    fn default() -> Self {
        BoatAutopilot {
            mode: AUTO,
            cut: false,
            hand: None,
            frames: FrameReader::default(),
            set_point: None,
            due: Time::EPOCH,
            answers: Vec::new(),
            sequence: 0,
        }
    }
}

impl BoatAutopilot {
    /// The skipper takes the wheel from a boat that heads so: away by 40 deg at this speed, with or without the mode switch.
    pub fn take(&mut self, heading: f64, speed: f64, with_switch: bool) {
        if with_switch {
            self.mode = MANUAL;
        }
        self.hand = Some(SteeringSetPoint {
            heading: wrap_angle(heading + 0.7),
            speed,
        });
    }
    /// Bytes that it sends until `t`.
    pub fn sent(&mut self, t: Time<TrueTime>) -> Vec<u8> {
        let mut bytes = core::mem::take(&mut self.answers);
        if t >= self.due {
            self.due = t + HEARTBEAT;
            let payload = [&self.mode.to_le_bytes()[..], &IDENTITY].concat();
            bytes.extend(self.frame(HEARTBEAT_ID, payload));
        }
        if self.cut { Vec::new() } else { bytes }
    }
    /// Takes what came at `t`.
    pub fn receive(&mut self, t: Time<TrueTime>, bytes: &[u8]) {
        if self.cut || bytes.is_empty() {
            return;
        }
        self.frames.push(bytes);
        while let Some(raw) = self.frames.next_frame() {
            let p = raw.fields();
            match raw.id {
                COMMAND_LONG if p.u16(28) == DO_SET_MODE => {
                    self.mode = p.float(4) as u32;
                    let [low, high] = DO_SET_MODE.to_le_bytes();
                    let answer = self.frame(COMMAND_ACK, vec![low, high, 0]);
                    self.answers.extend(answer);
                }
                SET_POSITION_TARGET if self.mode == GUIDED && p.u16(48) & IGNORES_VELOCITY == 0 => {
                    let (north, east) = (p.float(16), p.float(20));
                    let to = SteeringSetPoint {
                        heading: east.atan2(north),
                        speed: north.hypot(east),
                    };
                    self.set_point = Some((t, to));
                }
                _ => {}
            }
        }
    }
    /// Set-point that it steers to at `t`; None: along its own course.
    pub fn steers_to(&self, t: Time<TrueTime>) -> Option<SteeringSetPoint> {
        let guided = self.set_point.filter(|_| self.mode == GUIDED);
        let guided = guided.map(|(at, to)| match t - at <= TIMEOUT {
            true => to,
            false => SteeringSetPoint { speed: 0.0, ..to },
        });
        self.hand.or(guided)
    }
    fn frame(&mut self, (id, crc): (u32, u8), payload: Vec<u8>) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        let from = MavlinkSender {
            system: 1,
            component: 1,
            sequence: self.sequence,
        };
        mavlink::encode(from, Outgoing::new(id, crc, payload), None)
    }
}
