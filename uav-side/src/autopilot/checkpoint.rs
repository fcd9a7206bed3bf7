//! Checkpoint of the autopilot link, published while the link runs, so that a restarted link commands again
//! before the failsafe starts. Without it a new link waits for two heartbeats, the clock, the origin and
//! ArduCopter's options.
//!
//! A pilot's takeover during the restart is respected: in another mode the autopilot ignores set-points, and
//! its first heartbeat in that mode ends the command.

use alight_shared::{
    admission::Periodic,
    mavlink::SigningTimes,
    msg::{AutopilotMode, LinkCheckpoint, Message as _},
    time::{DroneClock, Span},
};

use super::{
    AutopilotLink, AutopilotOut, DroneTime, Output,
    message::{AUTOPILOT_COMPONENT, Address},
    modes::Firmware,
    peer::MavlinkPeer,
};
use crate::odometry::{Jumps, wind::WindMonitor};
use alight_shared::checkpoint::{CheckpointRejection, Recovery, validate};

const PERIOD: Span = Span::from_millis(20);

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LinkSuccession {
    pub(super) recovery: Recovery<LinkCheckpoint>,
    has_begun: bool,
    pub(super) began: Option<DroneTime>,
    timer: Periodic<DroneClock>,
}

impl AutopilotLink {
    /// Reads the predecessor's checkpoint once at the start. Boot number 0 means no checkpoint.
    pub(super) fn begin(&mut self, now: DroneTime, given: Option<&LinkCheckpoint>, out: &mut AutopilotOut) {
        let s = &mut self.succession;
        if s.has_begun {
            return;
        }
        let drone_id = self.headers.drone_id;
        let boot = self.headers.boot;
        s.began = s.began.or(Some(now));
        s.has_begun = s.recovery.poll(now, boot, given);
        let before = s.recovery.checkpoint();
        // Read at any age, because the mission's checkpoint may be too old.
        let readable = before.filter(|m| m.header.drone == drone_id && m.check().is_ok());
        self.operators.parameters.recalled = readable.and_then(|m| m.mode);
        if let Some(m) = &readable {
            self.own_mission.recall(m);
        }
        let Some(m) = before.filter(|m| m.commanding) else {
            return;
        };
        self.inputs.mode = self.inputs.mode.or(m.mode);
        match validate(now, drone_id, &m) {
            Ok(()) => self.resume(now, &m),
            Err(why) => {
                // Hover thrust is a property of the airframe that cannot be learned on a deck.
                let aged = why == CheckpointRejection::Age && m.header.at <= now;
                if aged && m.check().is_ok() {
                    self.estimate.hover.resume(m.hover_thrust, m.hover_learned_s);
                }
                out.texts
                    .push(format!("ignores the previous link's checkpoint: it is {why}"));
            }
        }
    }

    /// Resumes the previous link's state unless the autopilot has reported another one since.
    fn resume(&mut self, now: DroneTime, m: &LinkCheckpoint) {
        let address = Address::new(m.vehicle, AUTOPILOT_COMPONENT);
        let Some(firmware) = Firmware::of_autopilot(m.autopilot).filter(|_| self.accepts(address)) else {
            return;
        };
        let otherwise = |p: &MavlinkPeer| {
            (p.address, p.firmware) != (address, firmware) || p.mode != AutopilotMode::Offboard || !p.armed
        };
        if self.peer.as_ref().is_some_and(otherwise) {
            return;
        }
        let peer = self.peer.get_or_insert_with(|| {
            // Heartbeats that arrived before this link started are lost.
            let mut peer = MavlinkPeer::new(address, firmware, now, &self.config, self.stream.attitudes);
            peer.mode = AutopilotMode::Offboard;
            peer.armed = true;
            peer.resume_landed(m.header.at, m.landed);
            peer
        });
        peer.parameters.trust_thrust();
        self.clock.resume(now, m.clock_offset_ns, m.clock_error_s);
        let e = &mut self.estimate;
        e.origin.datum.get_or_insert(m.datum);
        e.origin.geoid_m.get_or_insert(m.geoid_m);
        e.assembler.resume(m.frames, m.reported_resets);
        let jumps = Jumps {
            offset: m.datum_offset.into(),
            heading: m.heading_jumps,
        };
        e.smooth.resume(m.smoothing, jumps);
        e.wind = WindMonitor::resume(&m.wind);
        e.heading.resume();
        e.hover.resume(m.hover_thrust, m.hover_learned_s);
        self.authority.resume();
    }

    pub(super) fn checkpoint(&mut self, now: DroneTime) -> Option<LinkCheckpoint> {
        let s = &mut self.succession;
        if !s.has_begun || !s.timer.is_due_spaced(now, PERIOD) {
            return None;
        }
        let header = self.headers.next(Output::Checkpoint, now);
        let peer = self.peer.as_ref()?;
        let (clock_offset_ns, clock_error_s) = self.clock.offset(now)?;
        let e = &self.estimate;
        let (hover_thrust, hover_learned_s) = e.hover.learned();
        Some(LinkCheckpoint {
            header,
            commanding: self.control_authority().commands(),
            vehicle: peer.address.system,
            autopilot: peer.firmware.autopilot() as u8,
            mode: self.inputs.mode,
            landed: peer.landed(now),
            clock_offset_ns,
            clock_error_s: clock_error_s.min(1.0),
            datum: e.origin.datum?,
            geoid_m: e.origin.geoid_m?,
            frames: e.assembler.frames,
            reported_resets: e.assembler.reported_resets,
            datum_offset: e.smooth.jumps().offset.into(),
            heading_jumps: e.smooth.jumps().heading,
            smoothing: e.smooth.difference(),
            wind: e.wind.checkpoint(),
            hover_thrust,
            hover_learned_s,
            ended_missions: self.own_mission.ends.map(|end| end.is_over()),
            own_mission: self.own_mission.monitor.is_under_way(),
            // Set by the process that signs and checks the frames.
            signing: SigningTimes::default(),
        })
    }
}
