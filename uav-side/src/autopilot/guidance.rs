//! Optional disarm after a landing that the autopilot flies by itself to the deck sent by Alight. It replaces
//! the autopilot's land detector, which is designed for ground at rest.
//!
//! In such a landing the mission detects no touchdown. In addition to the evidence of [`super::disarm`], a
//! disarm therefore needs the deck's forecast, a longer duration, and a drone that moves with the deck.

use alight_shared::msg::AutopilotMode;

use super::{
    AutopilotLink, AutopilotOut, DroneTime,
    config::DisarmConfig,
    disarm::{ContactEvidence, DisarmDecision, PRESS_BELOW_BLIND_M, RESTS_MPS},
    message::severity,
};

/// Duration of the evidence, s. A drone that hovers low over a deck in waves does not hold it for so long.
const HOLD_S: f64 = 1.0;

impl AutopilotLink {
    pub(super) fn disarm_own_landing(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let c = self.config.disarm;
        let lands = |p: &super::MavlinkPeer| p.armed && p.mode == AutopilotMode::Land;
        // The autopilot's own landing needs no mission. In shadow mode nothing is commanded.
        if !(c.own_landing && !self.inputs.looks_on() && self.peer.as_ref().is_some_and(lands)) {
            self.disarm.own_landing.clear();
            return;
        }
        let found = self.contact(now);
        let known = found.forecast_height.is_some() && found.thrust.is_some();
        let evidence = ContactEvidence {
            landing: known,
            // Nothing is commanded, and the autopilot's land detector is not used.
            commanded_low: false,
            reports_on_ground: false,
            ..found
        };
        let lasting = DisarmConfig {
            on_deck: true,
            hold_s: HOLD_S,
            height_m: c.height_m.min(PRESS_BELOW_BLIND_M),
            speed_mps: c.speed_mps.min(RESTS_MPS),
            ..c
        };
        if self.disarm.own_landing.step(now, &evidence, &lasting) == DisarmDecision::Command {
            if self.disarm.own_landing.sent() == 1 {
                let text = "the autopilot has landed on the deck by itself: disarming".to_owned();
                out.alarm(severity::NOTICE, text);
            }
            self.command_disarm(self.disarm.own_landing.sent(), out);
        }
    }
}
