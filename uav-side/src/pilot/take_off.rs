//! The set-points of a take-off: on the deck, off it, and up.
//!
//! While a foot may still touch, the drone lies on the deck's plane: it rises along the deck's normal, and no foot leaves
//! after the others. The thrust rises on a ramp from little to what [`Climb`] gives, so that a foot which is held shows before
//! much torque turns the drone about it. Once the feet are clear, the drone follows the law of every climb over a deck.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::SetPoint;
use alight_shared::time::{DroneClock, Time};

use super::Pilot;
use crate::contingency::{Body, Climb, DeckBelow};
use crate::lift_off::{LIES_BELOW_M, Rise};

/// The thrust rises to that of the climb within this time, s: three times the lag of odometry, wire and rotors together.
const RAMP_S: f64 = 0.3;

impl Pilot {
    /// Whether the deck may carry the drone in a take-off: its thrust says nothing of its weight then.
    pub(super) fn lies_on_deck(&self) -> bool {
        let lies = self.jump.is_some_and(|(_, rise)| rise.risen_m() < LIES_BELOW_M);
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

    /// Off the deck.
    pub(super) fn jump(
        &mut self,
        now: Time<DroneClock>,
        body: &Body,
        dt: f64,
        below: Option<&DeckBelow>,
    ) -> SetPoint {
        let (began, mut rise) = self.jump.unwrap_or((now, Rise::default()));
        rise.update(now, body.velocity.z, below.map(|b| b.stage.velocity[2]));
        self.jump = Some((began, rise));
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
