//! The end of a landing that the autopilot flies by itself, towards the deck that is sent to it: where the operator allows that,
//! the disarm that its land detector, made for ground that lies still, does not give.
//!
//! The mission detects no touchdown for it, so the evidence is that of [`super::disarm`] with the deck's forecast in any
//! case, for longer, and on a drone that goes with the deck.

use alight_shared::msg::AutopilotMode;

use super::config::DisarmConfig;
use super::disarm::{ContactEvidence, DisarmDecision, PRESS_BELOW_BLIND_M, RESTS_MPS};
use super::message::severity;
use super::{AutopilotLink, AutopilotOut, DroneTime};

/// The evidence holds for so long, s: a drone that hovers low over a deck in waves is left by it sooner.
const HOLD_S: f64 = 1.0;

impl AutopilotLink {
    /// Disarms a drone that the autopilot has landed by itself, where that is configured.
    pub(super) fn disarm_own_landing(&mut self, now: DroneTime, out: &mut AutopilotOut) {
        let c = self.config.disarm;
        let lands = |p: &super::MavlinkPeer| p.armed && p.mode == AutopilotMode::Land;
        // A landing of the autopilot's own needs no mission; one that looks on commands nothing.
        if !(c.own_landing && !self.inputs.looks_on() && self.peer.as_ref().is_some_and(lands)) {
            self.disarm.own_landing.clear();
            return;
        }
        let found = self.contact(now);
        let known = found.forecast_height.is_some() && found.thrust.is_some();
        let evidence = ContactEvidence {
            landing: known,
            // Nothing is commanded, and its own opinion is what cannot be waited for.
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
                let text = "on the deck by the autopilot's own landing: disarms".to_owned();
                out.alarm(severity::NOTICE, text);
            }
            self.command_disarm(self.disarm.own_landing.sent(), out);
        }
    }
}
