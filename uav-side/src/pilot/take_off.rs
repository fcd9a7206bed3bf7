//! The set-points of a take-off: on the deck, off it, and up.
//!
//! While a foot may still touch, the drone lies on the deck's plane: it rises along the deck's normal, and no foot leaves
//! after the others. The thrust rises on a ramp from little to what [`Climb`] gives, so that a foot which is held shows before
//! much torque turns the drone about it. Once the feet are clear, the drone follows the law of every climb over a deck.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::{MissionState, SetPoint};
use alight_shared::time::{DroneClock, Time};

use super::Pilot;
use crate::contingency::{Body, Climb, DeckBelow};
use crate::lift_off::{LEAVES_WITHIN_S, LIES_BELOW_M, Rise};

/// The thrust rises to that of the climb within this time, s: three times the lag of odometry, wire and rotors together.
const RAMP_S: f64 = 0.3;

/// The deck is seen, s: as fresh as a landing wants it.
const VISION_FRESH_S: f64 = 0.5;

impl Pilot {
    /// Whether the deck may carry the drone in a take-off: its thrust says nothing of its weight then.
    pub(super) fn lies_on_deck(&self) -> bool {
        let rise = self.jump.and_then(|(_, rise)| rise);
        let lies = rise.is_some_and(|rise| rise.risen_m() < LIES_BELOW_M);
        lies || self.mission.get().is_some_and(|m| m.state.stands_for_take_off())
    }

    /// A set-point that keeps the drone on the deck, in the deck's attitude and with less thrust than flight needs.
    pub(super) fn idle(
        &mut self,
        now: Time<DroneClock>,
        body: &Body,
        dt: f64,
        below: Option<&DeckBelow>,
    ) -> SetPoint {
        let thrust = self.config.tracking.min_thrust_of_hover * self.estimate.hover();
        let set_point = self.lie(now, body, dt, below, thrust);
        SetPoint {
            position: body.position.into(),
            ..set_point
        }
    }

    /// Whether a take-off in which this pilot has no part yet has left the deck by now: the feet leave within
    /// [`LEAVES_WITHIN_S`], or the camera sees that they have. By the receivers alone the deck may be metres off.
    fn is_in_the_air(
        &self,
        now: Time<DroneClock>,
        mission: &MissionState,
        below: Option<&DeckBelow>,
    ) -> bool {
        let lasts_s = (now - mission.since).secs();
        let seen = self
            .forecast
            .get()
            .is_some_and(|f| f.vision_age_s <= VISION_FRESH_S);
        lasts_s > LEAVES_WITHIN_S || seen && below.is_some_and(|b| b.clearance > LIES_BELOW_M)
    }

    /// Off the deck. A pilot that begins in the air, as after a restart, climbs as over any deck.
    pub(super) fn jump(
        &mut self,
        now: Time<DroneClock>,
        body: &Body,
        dt: f64,
        mission: &MissionState,
        below: Option<&DeckBelow>,
    ) -> SetPoint {
        let begun = || (!self.is_in_the_air(now, mission, below)).then(|| Rise::begun(now));
        let (began, rise) = self.jump.unwrap_or_else(|| (now, begun()));
        let Some(mut rise) = rise else {
            self.jump = Some((began, None));
            return self.hold(now, body, dt, below);
        };
        rise.update(now, body.velocity.z, below.map(|b| b.stage.velocity[2]));
        self.jump = Some((began, Some(rise)));
        if rise.risen_m() < LIES_BELOW_M {
            let least = self.config.tracking.min_thrust_of_hover;
            let climb = Climb::new(0.0, 0.0, &self.geometry).acceleration_mps2();
            let most = 1.0 + climb / GRAVITY;
            let ramp = ((now - began).secs() / RAMP_S).clamp(0.0, 1.0);
            let thrust = (least + ramp * (most - least)) * self.estimate.hover();
            return self.lie(now, body, dt, below, thrust);
        }
        // Its clearance by its own rise: the deck's place is not seen yet.
        let near = below.map(|b| b.with_clearance(rise.risen_m()));
        self.hold(now, body, dt, near.as_ref())
    }

    fn lie(
        &mut self,
        now: Time<DroneClock>,
        body: &Body,
        dt: f64,
        below: Option<&DeckBelow>,
        thrust: f64,
    ) -> SetPoint {
        let up = below.map(|b| b.stage.normal());
        let tracking = &self.config.tracking;
        let a = self.tracker.press(up, body.yaw(), thrust, body, dt, tracking);
        self.attitude(now, None, a, body)
    }
}
