//! The boat's autopilot over MAVLink: ArduPilot Rover in GUIDED, PX4 in OFFBOARD.
//!
//! Both take `SET_POSITION_TARGET_LOCAL_NED` with a velocity alone (type mask 3527): the boat heads where it points and goes
//! as fast as it is long. ArduPilot stops a boat that was not given one for 3 s, PX4 leaves OFFBOARD after
//! `COM_OF_LOSS_T`: that is the dead man of this end. PX4 wants set-points for a second before it takes the mode.

use alight_shared::mavlink::{
    self, Fields, FrameReader, MAX_WAITING, MavlinkSender, Outgoing, Signing, dialect as m,
};
use alight_shared::time::{Span, Time, VesselClock};

use super::command::{HelmCommand, ReadBack};
use crate::mavlink_systems::{AUTOPILOT, Systems};

/// Time between two heartbeats of ours and two requests of a mode.
const SLOW: Span = Span::from_millis(1000);
/// Time between two set-points: PX4 wants 2 Hz, ArduPilot one in 3 s.
const FAST: Span = Span::from_millis(200);
/// The autopilot is silent after so long without a heartbeat: three periods, and the time in which ArduPilot stops.
const SILENT: Span = Span::from_millis(3000);
/// PX4 is asked for OFFBOARD after so long with set-points.
const PX4_LEAD: Span = Span::from_millis(1200);
/// Our own component: an onboard computer of the autopilot's system.
const COMPANION: u8 = 191;
const HEARTBEAT: u32 = 0;
const COMMAND_ACK: u32 = 77;
const DO_SET_MODE: u16 = 176;
/// `MAV_RESULT`: accepted, and in progress.
const ACCEPTED: u8 = 0;
const IN_PROGRESS: u8 = 5;

/// Firmware by its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Firmware {
    ArduPilot,
    Px4,
}

impl Firmware {
    /// Firmware by `MAV_AUTOPILOT`; None: it is not known how that one is steered.
    fn of(autopilot: u8) -> Option<Firmware> {
        match autopilot {
            3 => Some(Firmware::ArduPilot),
            12 => Some(Firmware::Px4),
            _ => None,
        }
    }
    /// Custom mode in which it takes set-points: Rover's GUIDED, PX4's OFFBOARD (main mode in the third byte).
    fn steered_mode(self) -> u32 {
        match self {
            Firmware::ArduPilot => 15,
            Firmware::Px4 => 6 << 16,
        }
    }
    /// A custom mode as the parameters of `MAV_CMD_DO_SET_MODE`: mode, main mode, sub mode.
    fn mode_parameters(self, custom_mode: u32) -> [f32; 3] {
        // MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.
        let [_, _, main, sub] = custom_mode.to_le_bytes();
        match self {
            Firmware::ArduPilot => [1.0, custom_mode as f32, 0.0],
            Firmware::Px4 => [1.0, f32::from(main), f32::from(sub)],
        }
    }
}

/// The link to it.
#[derive(Default)]
pub(super) struct MavlinkHelm {
    frames: FrameReader,
    signing: Option<Signing>,
    systems: Systems,
    firmware: Option<Firmware>,
    mode: Option<u32>,
    received: Option<Time<VesselClock>>,
    denied: bool,
    /// Our mode was requested.
    requested: bool,
    sequence: u8,
    /// Set-points are sent since.
    steers: Option<Time<VesselClock>>,
    due: [Option<Time<VesselClock>>; 3],
}

impl core::fmt::Debug for MavlinkHelm {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("MavlinkHelm")
            .field("firmware", &self.firmware)
            .field("mode", &self.mode)
            .finish_non_exhaustive()
    }
}

/// Slots of the messages that are sent in turn.
const BEAT: usize = 0;
const MODE: usize = 1;
const SET_POINT: usize = 2;

impl MavlinkHelm {
    /// Frames are signed with this key, and of others only those that it signed are taken.
    pub(super) fn sign(&mut self, key: Signing) {
        self.frames = FrameReader::signed(Some(key.clone()));
        self.signing = Some(key);
    }
    /// Takes what came at `now`.
    pub(super) fn receive(&mut self, now: Time<VesselClock>, bytes: &[u8]) {
        for part in bytes.chunks(MAX_WAITING / 4) {
            self.frames.push(part);
            while let Some(raw) = self.frames.next_frame() {
                if !self.systems.is_own(&raw) || raw.component != AUTOPILOT {
                    continue;
                }
                let p = raw.fields();
                match raw.id {
                    HEARTBEAT => {
                        self.received = Some(now);
                        self.mode = Some(p.u32(0));
                        self.firmware = Firmware::of(p.u8(5));
                    }
                    COMMAND_ACK if self.requested && p.u16(0) == DO_SET_MODE && self.is_for_us(&p) => {
                        self.denied = !matches!(p.u8(2), ACCEPTED | IN_PROGRESS);
                    }
                    _ => {}
                }
            }
        }
    }
    /// An acknowledgement names us (MAVLink 2), or no one (MAVLink 1): on a link with a router others get theirs, too.
    fn is_for_us(&self, acknowledgement: &Fields<'_>) -> bool {
        let (system, component) = (acknowledgement.u8(8), acknowledgement.u8(9));
        system == 0 || Some(system) == self.systems.own() && [0, COMPANION].contains(&component)
    }
    /// Report of the autopilot.
    pub(super) fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        let present = self.received.is_some_and(|t| now - t <= SILENT) && self.firmware.is_some();
        ReadBack {
            present,
            mode: self.mode,
            reported: self.received,
            is_ours: present && self.firmware.map(Firmware::steered_mode) == self.mode,
            denied: self.denied,
            by_hand: false,
        }
    }
    fn is_due(&mut self, what: usize, now: Time<VesselClock>, period: Span) -> bool {
        let due = self.due.get(what).copied().flatten().is_none_or(|at| now >= at);
        if let Some(at) = self.due.get_mut(what).filter(|_| due) {
            *at = Some(now + period);
        }
        due
    }
    /// The bytes that are due at `now` for a command.
    pub(super) fn send(&mut self, now: Time<VesselClock>, command: &HelmCommand) -> Vec<u8> {
        let mut bytes = Vec::new();
        if self.is_due(BEAT, now, SLOW) {
            bytes.extend(self.frame(&heartbeat()));
        }
        let (Some(system), Some(firmware)) = (self.systems.own(), self.firmware) else {
            return bytes;
        };
        let ours = firmware.steered_mode();
        match *command {
            HelmCommand::Nothing => (self.steers, self.denied, self.requested) = (None, false, false),
            HelmCommand::Steer {
                heading_rad,
                speed_mps,
            } => {
                let since = *self.steers.get_or_insert(now);
                if self.is_due(SET_POINT, now, FAST) {
                    bytes.extend(self.frame(&velocity(system, heading_rad, speed_mps)));
                }
                let may_ask = firmware == Firmware::ArduPilot || now - since >= PX4_LEAD;
                if self.mode != Some(ours) && may_ask && self.is_due(MODE, now, SLOW) {
                    bytes.extend(self.frame(&set_mode(system, firmware, ours)));
                    self.requested = true;
                }
            }
            HelmCommand::GiveBack { mode } => {
                self.steers = None;
                let wanted = mode.filter(|mode| *mode != ours && self.mode == Some(ours));
                if let Some(mode) = wanted.filter(|_| self.is_due(MODE, now, SLOW)) {
                    bytes.extend(self.frame(&set_mode(system, firmware, mode)));
                }
            }
        }
        bytes
    }
    fn frame(&mut self, message: &m::MavMessage) -> Vec<u8> {
        let from = MavlinkSender {
            system: self.systems.own().unwrap_or(1),
            component: COMPANION,
            sequence: self.sequence,
        };
        self.sequence = self.sequence.wrapping_add(1);
        mavlink::encode(from, Outgoing::from(message), self.signing.as_ref())
    }
}

fn heartbeat() -> m::MavMessage {
    m::MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
        mavtype: m::MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: m::MavAutopilot::MAV_AUTOPILOT_INVALID,
        system_status: m::MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
        ..m::HEARTBEAT_DATA::DEFAULT
    })
}

/// A velocity over ground; its direction is the heading to steer.
fn velocity(system: u8, heading_rad: f64, speed_mps: f64) -> m::MavMessage {
    use m::PositionTargetTypemask as Mask;
    let (sin, cos) = heading_rad.sin_cos();
    let mut d = m::SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT;
    (d.target_system, d.target_component) = (system, AUTOPILOT);
    d.coordinate_frame = m::MavFrame::MAV_FRAME_LOCAL_NED;
    d.type_mask = Mask::from_bits_retain(USE_VELOCITY);
    (d.vx, d.vy) = ((speed_mps * cos) as f32, (speed_mps * sin) as f32);
    m::MavMessage::SET_POSITION_TARGET_LOCAL_NED(d)
}

/// Position, acceleration, yaw and yaw rate are ignored (bits 0 to 2, 6 to 8, 10 and 11): 3527. Rover's own example, 3559,
/// ignores the velocity down as well, which Rover does not look at; older versions of PX4 then take no velocity at all.
const USE_VELOCITY: u16 = 0x0DC7;

fn set_mode(system: u8, firmware: Firmware, custom_mode: u32) -> m::MavMessage {
    let [param1, param2, param3] = firmware.mode_parameters(custom_mode);
    m::MavMessage::COMMAND_LONG(m::COMMAND_LONG_DATA {
        target_system: system,
        target_component: AUTOPILOT,
        command: m::MavCmd::MAV_CMD_DO_SET_MODE,
        param1,
        param2,
        param3,
        ..m::COMMAND_LONG_DATA::DEFAULT
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_point_of_a_velocity_alone() {
        let m::MavMessage::SET_POSITION_TARGET_LOCAL_NED(d) = velocity(1, 0.5, 3.0) else {
            panic!("another message");
        };
        // X, Y and Z (1, 2, 4), accelerations (64, 128, 256), yaw (1024) and yaw rate (2048) are ignored, no velocity is.
        assert_eq!(d.type_mask.bits(), 7 + 64 + 128 + 256 + 1024 + 2048);
        assert_eq!(d.type_mask.bits(), 3527);
        assert!((d.vy.atan2(d.vx) - 0.5).abs() < 1e-6 && (d.vx.hypot(d.vy) - 3.0).abs() < 1e-6);
        assert_eq!(d.vz, 0.0);
    }
}
