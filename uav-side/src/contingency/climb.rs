//! The climb away from the deck: one law for who flies it (the planner) and who asks whether it clears the deck (the
//! mission).
//!
//! In NED, with the deck's velocity down `d(t)` by its forecast and the drone's `v`: wanted is
//! `v*(t) = max(min(d, 0) - climb, -greatest)`, with the deck and up from it, but not down after a deck that sinks,
//! because that one comes back; and `|dv/dt|` is at most half of what the rotors give beyond hover, so that the other half
//! is left for the attitude.

use alight_shared::geometry::{DroneGeometry, GRAVITY};

/// So far below the height that it is to have the drone is clear of the vessel, and no longer on its way up, m.
pub(crate) const BELOW_M: f64 = 1.0;
/// Climb relative to a deck that rises or rests, m/s: the planner's for any climb.
const CLIMB_MPS: f64 = 3.0;
/// Greatest climb, m/s: the planner's limit on vertical speed.
const MAX_CLIMB_MPS: f64 = 4.0;
/// Greatest acceleration of any drone, m/s²: the planner's slew of the rotors builds it up within [`super::contact`]'s reaction.
const ACCELERATION_MPS2: f64 = 9.0;

/// Height and vertical speed on the way up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Climb {
    /// NED z, m.
    pub(crate) z: f64,
    /// NED, m/s.
    pub(crate) velocity: f64,
    /// Bound of its change, m/s².
    acceleration: f64,
}

impl Climb {
    /// A climb of this drone that begins at the height `z` with this velocity.
    pub(crate) fn new(z: f64, velocity: f64, drone: &DroneGeometry) -> Climb {
        let surplus = drone.max_thrust_n / drone.mass_kg - GRAVITY;
        Climb {
            z,
            velocity,
            acceleration: (0.5 * surplus).clamp(0.0, ACCELERATION_MPS2),
        }
    }

    /// Bound of the change of its velocity, m/s².
    pub(crate) fn acceleration_mps2(&self) -> f64 {
        self.acceleration
    }

    /// `dt` later (s) over a deck that moves down at `deck` (m/s).
    pub(crate) fn advance(&mut self, dt: f64, deck: f64) {
        self.towards((deck.min(0.0) - CLIMB_MPS).max(-MAX_CLIMB_MPS), dt);
    }

    /// `dt` later (s), sinking onto a deck that moves down at `deck` by `sink` (m/s) relative to it.
    pub(crate) fn sink(&mut self, dt: f64, deck: f64, sink: f64) {
        self.towards(deck + sink, dt);
    }

    /// `dt` later (s) on its way to a rest; at once from a standstill.
    pub(crate) fn rest(&mut self, dt: f64) {
        self.towards(0.0, dt);
    }

    fn towards(&mut self, wanted: f64, dt: f64) {
        let most = self.acceleration * dt;
        let before = self.velocity;
        self.velocity += (wanted - before).clamp(-most, most);
        self.z += 0.5 * (before + self.velocity) * dt;
    }

    /// The constant deceleration (m/s²) by which a drone that sinks at `sinking` relative to the deck, `clearance` above it,
    /// meets it at `least`: `a = (v0² - v²) / 2 h`, within its bound; 0 when it is slower.
    pub(crate) fn braking(&self, sinking: f64, clearance: f64, least: f64) -> f64 {
        let spare = sinking.max(0.0).powi(2) - least.powi(2);
        (spare.max(0.0) / (2.0 * clearance.max(0.01))).min(self.acceleration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn braking_to_the_least_speed() {
        let drone = DroneGeometry::default();
        let climb = Climb::new(-2.0, 2.0, &drone);
        let (mut v, mut h) = (2.0_f64, 0.8_f64);
        while h > 0.0 {
            v -= climb.braking(v, h, 0.5) * 1e-3;
            h -= v * 1e-3;
        }
        assert!((v - 0.5).abs() < 0.03, "{v}");
        assert_eq!(climb.braking(0.4, 0.8, 0.5), 0.0);
        // No more than its bound, at whatever height.
        assert_eq!(climb.braking(9.0, -1.0, 0.5), climb.acceleration);
    }
}
