//! Climb away from the deck. The planner flies and the mission predicts it with the same law.
//!
//! In NED, with the drone's vertical velocity `v` and the forecast deck's `d(t)`, both downwards, the reference is
//! `v*(t) = max(min(d, 0) - climb, -max_climb)`: upwards relative to the deck, but not down with a sinking deck, which
//! will rise again. `|dv/dt|` is at most half of the rotors' acceleration beyond hover; the rest is reserved for
//! attitude.

use alight_shared::geometry::{DroneGeometry, GRAVITY};

/// Distance below the requested height at which the climb ends and the drone is clear of the vessel, m.
pub(crate) const BELOW_M: f64 = 1.0;
/// Climb rate of the planner relative to a rising or resting deck, m/s.
const CLIMB_MPS: f64 = 3.0;
/// Maximum climb rate, m/s: the planner's limit on vertical speed.
const MAX_CLIMB_MPS: f64 = 4.0;
/// Maximum acceleration of any drone, m/s². The planner builds it up within the reaction time of [`super::contact`].
const ACCELERATION_MPS2: f64 = 9.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Climb {
    /// NED z, m.
    pub(crate) z: f64,
    /// NED, m/s.
    pub(crate) velocity: f64,
    /// Bound on the acceleration, m/s².
    acceleration: f64,
}

impl Climb {
    /// Climb from the height `z` with this initial velocity.
    pub(crate) fn new(z: f64, velocity: f64, drone: &DroneGeometry) -> Climb {
        let surplus = drone.max_thrust_n / drone.mass_kg - GRAVITY;
        Climb {
            z,
            velocity,
            acceleration: (0.5 * surplus).clamp(0.0, ACCELERATION_MPS2),
        }
    }

    pub(crate) fn acceleration_mps2(&self) -> f64 {
        self.acceleration
    }

    /// Advances the climb by `dt` (s) over a deck that moves down at `deck` (m/s).
    pub(crate) fn advance(&mut self, dt: f64, deck: f64) {
        self.towards((deck.min(0.0) - CLIMB_MPS).max(-MAX_CLIMB_MPS), dt);
    }

    /// Advances by `dt` (s) while sinking at `sink` (m/s) relative to a deck that moves down at `deck` (m/s).
    pub(crate) fn sink(&mut self, dt: f64, deck: f64, sink: f64) {
        self.towards(deck + sink, dt);
    }

    /// Advances by `dt` (s) while decelerating to rest.
    pub(crate) fn rest(&mut self, dt: f64) {
        self.towards(0.0, dt);
    }

    fn towards(&mut self, wanted: f64, dt: f64) {
        let max = self.acceleration * dt;
        let before = self.velocity;
        self.velocity += (wanted - before).clamp(-max, max);
        self.z += 0.5 * (before + self.velocity) * dt;
    }

    /// Constant deceleration (m/s²) from `sinking` to `contact`, both speeds relative to the deck, within `clearance`:
    /// `a = (v0² - v²) / 2 h`, up to its bound; 0 if the drone is slower.
    pub(crate) fn braking(&self, sinking: f64, clearance: f64, contact: f64) -> f64 {
        let spare = sinking.max(0.0).powi(2) - contact.powi(2);
        (spare.max(0.0) / (2.0 * clearance.max(0.01))).min(self.acceleration)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn braking_to_the_contact_speed() {
        let drone = DroneGeometry::default();
        let climb = Climb::new(-2.0, 2.0, &drone);
        let mut v = 2.0_f64;
        let mut h = 0.8_f64;
        while h > 0.0 {
            v -= climb.braking(v, h, 0.5) * 1e-3;
            h -= v * 1e-3;
        }
        assert!((v - 0.5).abs() < 0.03, "{v}");
        assert_eq!(climb.braking(0.4, 0.8, 0.5), 0.0);
        // The deceleration never exceeds its bound, at any height.
        assert_eq!(climb.braking(9.0, -1.0, 0.5), climb.acceleration);
    }
}
