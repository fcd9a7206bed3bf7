//! Lateral disturbance during the descent, measured at the drone and predicted along its path.
//!
//! Wind decreases towards the water according to the logarithmic law, `w(h) = w(h0) ln(h / z0) / ln(h0 / z0)`, and a
//! drone that drifts with the wind has a lower airspeed. To first order, the drag `d = -k |u| u` of the airspeed
//! `u = v - w` becomes
//!
//! ```text
//! d(h, v) = d0 + S (w(h) - w(h0) - (v - v0)),    S = |d0| / |u0| (1 + u0 u0' / |u0|²)
//! ```
//!
//! In 10 m/s of wind the change on the way down from 7 m above a deck is a third of the disturbance, or 4 cm at the
//! plan's end.

use alight_shared::{landing::LINEAR_MPS, msg::DroneState};
use nalgebra::{Matrix2, Vector2};

use crate::odometry::DISTURBANCE_S;

/// Roughness length of the open sea, m.
const ROUGHNESS_M: f64 = 2e-4;
/// Minimum height above the water, m.
const LOWEST_M: f64 = 0.5;

/// Lateral disturbance and the conditions under which it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LateralDisturbance {
    /// NED, m/s².
    measured: Vector2<f64>,
    /// Velocity (NED, m/s) and height (NED z, m) at the measurement.
    velocity: Vector2<f64>,
    z: f64,
    /// True wind at the drone (direction of motion, NED, m/s); None while unknown.
    wind: Option<Vector2<f64>>,
    /// NED z of the water, m; None before the first landing.
    water_z: Option<f64>,
}

impl LateralDisturbance {
    /// Change of the disturbance of the drone `d` down to the height `z`, above water at `water_z` (NED, m), m/s².
    pub(crate) fn change(d: &DroneState, z: f64, water_z: f64) -> Vector2<f64> {
        let mut push = LateralDisturbance::default();
        push.measure(d, true);
        push.know_water(water_z);
        push.at(z, &push.velocity) - push.measured
    }
    /// In `free` flight the disturbance is averaged over [`DISTURBANCE_S`].
    pub(super) fn measure(&mut self, d: &DroneState, free: bool) {
        self.wind = d.wind.map(Vector2::from);
        if !free {
            return;
        }
        self.measured = d.disturbance();
        self.velocity = d.velocity().xy();
        self.z = d.position[2] - DISTURBANCE_S * d.velocity[2];
    }
    pub(super) fn know_water(&mut self, z: f64) {
        self.water_z = Some(z);
    }
    /// NED, m/s².
    pub(super) fn measured(&self) -> Vector2<f64> {
        self.measured
    }
    /// Disturbance at the height `z` (NED, m) and the velocity `velocity` (NED, m/s), m/s².
    pub(super) fn at(&self, z: f64, velocity: &Vector2<f64>) -> Vector2<f64> {
        let (Some(wind), Some(water_z)) = (self.wind, self.water_z) else {
            return self.measured;
        };
        let above = |z: f64| ((water_z - z).max(LOWEST_M) / ROUGHNESS_M).ln();
        let way = self.velocity - wind;
        let speed = way.norm().max(LINEAR_MPS);
        let slope =
            (Matrix2::identity() + way * way.transpose() / (speed * speed)) * (self.measured.norm() / speed);
        let changed = wind * (above(z) / above(self.z) - 1.0) - (velocity - self.velocity);
        let change = slope * changed;
        // The first-order approximation is valid only for a limited change.
        self.measured + change.cap_magnitude(0.5 * self.measured.norm())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drag(u: &Vector2<f64>) -> Vector2<f64> {
        -u * (0.028 * u.norm())
    }
    /// Disturbance measured 8 m above the water by a drone that moves at `v`.
    fn push(wind: Vector2<f64>, v: Vector2<f64>) -> LateralDisturbance {
        let mut push = LateralDisturbance::default();
        let d = DroneState {
            position: [0.0, 0.0, -8.0],
            velocity: [v.x, v.y, 0.0],
            disturbance: drag(&(v - wind)).into(),
            wind: Some(wind.into()),
            ..DroneState::default()
        };
        push.measure(&d, true);
        push.know_water(0.0);
        push
    }

    #[test]
    fn push_lower_in_the_wind() {
        let wind = Vector2::new(9.0, 3.0);
        let at_deck = wind * ((1.6_f64 / 2e-4).ln() / (8.0_f64 / 2e-4).ln());
        let found = push(wind, Vector2::zeros()).at(-1.6, &Vector2::zeros());
        assert!((found - drag(&-at_deck)).norm() < 0.1, "{found}");
        // The drone drifts with the wind at 0.5 m/s.
        let v = Vector2::new(0.5, 0.0);
        let found = push(wind, Vector2::zeros()).at(-8.0, &v);
        assert!((found - drag(&(v - wind))).norm() < 0.03, "{found}");
    }

    #[test]
    fn push_of_the_way_at_any_height() {
        let p = push(Vector2::zeros(), Vector2::new(5.0, 0.0));
        assert_eq!(p.at(-1.6, &Vector2::new(5.0, 0.0)), p.measured());
        let unknown = LateralDisturbance {
            wind: None,
            ..push(Vector2::new(9.0, 0.0), Vector2::zeros())
        };
        assert_eq!(unknown.at(-1.6, &Vector2::zeros()), unknown.measured());
    }
}
