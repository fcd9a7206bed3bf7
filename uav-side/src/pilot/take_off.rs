//! Set-points for standing on the deck, lift-off and climb.
//!
//! While a foot may still touch, the drone keeps the deck's attitude and rises along the deck's normal, so that all
//! feet leave together. The thrust ramps up to that of [`Climb`], so that a sticking foot is detected before much
//! torque rotates the drone about it. Once the feet are clear, the drone makes the usual climb above a deck.

use alight_shared::{
    geometry::GRAVITY,
    msg::{MissionState, SetPoint},
    time::DroneTime,
};

use super::Pilot;
use crate::{
    contingency::{Body, Climb, DeckBelow},
    lift_off::{LEAVES_WITHIN_S, LIES_BELOW_M, Rise},
};

/// Duration of the ramp to the climb's thrust, s: three times the lag of odometry, link and rotors.
const RAMP_S: f64 = 0.3;

/// Age of a vision measurement up to which the deck counts as detected, s, as in a landing.
const VISION_FRESH_S: f64 = 0.5;

impl Pilot {
    /// Whether the deck may be supporting the drone, so that its thrust does not match its weight.
    pub(super) fn lies_on_deck(&self) -> bool {
        let rise = self.jump.and_then(|(_, rise)| rise);
        let lies = rise.is_some_and(|rise| rise.risen_m() < LIES_BELOW_M);
        lies || self.mission.get().is_some_and(|m| m.state.stands_for_take_off())
    }

    /// Keeps the drone on the deck, at the deck's attitude and with less thrust than flight needs.
    pub(super) fn idle(
        &mut self,
        now: DroneTime,
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

    /// Whether the drone left the deck in a take-off by a previous pilot node: [`LEAVES_WITHIN_S`] has passed, or the
    /// camera measures that the feet are off. GNSS heights may be wrong by metres.
    fn is_in_the_air(&self, now: DroneTime, mission: &MissionState, below: Option<&DeckBelow>) -> bool {
        let lasts_s = (now - mission.since).secs();
        let detected = self
            .forecast
            .get()
            .is_some_and(|f| f.vision_age_s <= VISION_FRESH_S);
        lasts_s > LEAVES_WITHIN_S || detected && below.is_some_and(|b| b.clearance > LIES_BELOW_M)
    }

    /// Leaves the deck. A pilot node that starts in the air makes the usual climb above a deck.
    pub(super) fn jump(
        &mut self,
        now: DroneTime,
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
            let min = self.config.tracking.min_thrust_of_hover;
            let climb = Climb::new(0.0, 0.0, &self.geometry).acceleration_mps2();
            let max = 1.0 + climb / GRAVITY;
            let ramp = ((now - began).secs() / RAMP_S).clamp(0.0, 1.0);
            let thrust = (min + ramp * (max - min)) * self.estimate.hover();
            return self.lie(now, body, dt, below, thrust);
        }
        // The clearance is the drone's own rise, because the deck is not detected yet.
        let near = below.map(|b| b.with_clearance(rise.risen_m()));
        self.hold(now, body, dt, near.as_ref())
    }

    fn lie(
        &mut self,
        now: DroneTime,
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
