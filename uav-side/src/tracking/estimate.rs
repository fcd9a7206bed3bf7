//! Estimates in flight: hover thrust, unmodelled lift, lateral disturbance.

use alight_shared::{estimation::low_pass, geometry::GRAVITY};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::config::TrackingConfig;
use crate::odometry::hover::hover_sample;

#[derive(Clone, Debug)]
pub(crate) struct FlightEstimator {
    /// Collective thrust in hover, 0 to 1.
    hover: f64,
    nominal: f64,
    reported: bool,
    disturbance: Vector2<f64>,
    /// Upward specific force in excess of the modelled thrust, m/s².
    lift: f64,
    /// Commanded thrust after the rotors' lag, 0 to 1.
    applied: Option<f64>,
    /// Time for which thrust has been commanded without a gap, s.
    commanded_s: f64,
}

/// Delay until a newly commanded thrust is in effect, s: four rotor lags.
const IN_FORCE_S: f64 = 0.2;

impl FlightEstimator {
    pub(crate) fn new(nominal: f64) -> Self {
        FlightEstimator {
            hover: nominal,
            nominal,
            reported: false,
            disturbance: Vector2::zeros(),
            lift: 0.0,
            applied: None,
            commanded_s: 0.0,
        }
    }
    pub(crate) fn hover(&self) -> f64 {
        self.hover
    }
    /// NED, m/s².
    pub(crate) fn disturbance(&self) -> Vector2<f64> {
        self.disturbance
    }
    /// Specific thrust of the collective `u`, m/s²: thrust is linear in the collective.
    pub(crate) fn specific(&self, u: f64) -> f64 {
        u * GRAVITY / self.hover
    }
    /// Own commanded thrust after its lag, 0 to 1. None until the command is in effect, and while the autopilot closes
    /// the loop.
    pub(crate) fn in_force(&self) -> Option<f64> {
        self.applied.filter(|_| self.commanded_s >= IN_FORCE_S)
    }
    /// Initialises the estimate once with that of the autopilot.
    pub(crate) fn use_reported_hover(&mut self, hover: f64) {
        if !self.reported && self.plausible(hover) {
            self.hover = hover;
            self.reported = true;
        }
    }
    /// Upward specific force in excess of the own thrust, m/s²: ground effect, inflow of a fast descent, and in wind
    /// the component of drag along the tilted thrust.
    pub(crate) fn lift(&self) -> f64 {
        self.lift
    }
    /// Resets the lift while a deck supports the drone.
    pub(crate) fn forget_lift(&mut self) {
        self.lift = 0.0;
    }
    /// Updates the lift from a specific force (body, m/s²) and an attitude (NED from body) in flight under own thrust
    /// `f_u`: `l' = (-(R f)_z - f_u cos(tilt) - l) / lift_time_s`. Resets it while the autopilot closes the loop.
    pub(crate) fn learn_lift(
        &mut self,
        force: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
        dt: f64,
        c: &TrackingConfig,
    ) {
        let Some(u) = self.in_force() else {
            self.lift = 0.0;
            return;
        };
        let upright = (attitude * Vector3::z()).z;
        let wrong = -(attitude * force).z - self.specific(u) * upright;
        if wrong.is_finite() {
            let max = c.lift_limit_mps2;
            self.lift = low_pass(self.lift, wrong.clamp(-max, max), dt, c.lift_time_s);
        }
    }
    pub(crate) fn commanded(&mut self, thrust: Option<f64>, dt: f64, lag: f64) {
        self.commanded_s = thrust.map_or(0.0, |_| self.commanded_s + dt);
        self.applied = thrust.map(|u| low_pass(self.applied, u, dt, lag));
    }
    /// Updates the hover thrust from a specific force (body, m/s²) in free flight under the collective `thrust`.
    pub(crate) fn learn_hover(&mut self, force: &Vector3<f64>, thrust: f64, dt: f64, c: &TrackingConfig) {
        if thrust.is_nan() || thrust < 0.05 {
            return;
        }
        if let Some(sample) = hover_sample(thrust, -force.z, [0.5, 2.0]).filter(|s| self.plausible(*s)) {
            self.hover = low_pass(self.hover, sample, dt, c.hover_time_s);
        }
    }
    pub(crate) fn use_disturbance(&mut self, disturbance: Vector2<f64>) {
        self.disturbance = disturbance;
    }
    fn plausible(&self, hover: f64) -> bool {
        (0.5 * self.nominal..=2.0 * self.nominal).contains(&hover) && hover < 0.95
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lift_estimate() {
        let c = TrackingConfig::default();
        let learnt = |force: Vector3<f64>, tilt: f64, hover: f64, u: Option<f64>| {
            let mut e = FlightEstimator::new(hover);
            let attitude = UnitQuaternion::from_euler_angles(0.0, tilt, 0.4);
            for _ in 0..100 {
                e.commanded(u, 0.01, 0.0);
                e.learn_lift(&force, &attitude, 0.01, &c);
            }
            e.lift()
        };
        // Ground effect of 10 % on a level drone.
        let ground = learnt(Vector3::new(0.0, 0.0, -1.1 * GRAVITY), 0.0, 0.4, Some(0.4));
        assert!((ground - 0.1 * GRAVITY).abs() < 0.01, "{ground}");
        // In a tilted hover in wind the drag has no vertical component. A hover thrust learned along the thrust would
        // be wrong by a sin(tilt).
        let tilt = 0.2_f64;
        let thrust = GRAVITY / 0.2_f64.cos();
        let drag = GRAVITY * tilt.tan();
        let measured_force = Vector3::new(drag * tilt.cos(), 0.0, -thrust + drag * tilt.sin());
        let u = 0.4 * thrust / GRAVITY;
        assert!(learnt(measured_force, tilt, 0.4, Some(u)).abs() < 0.01);
        let weak = 0.4 * thrust / -measured_force.z;
        let found = learnt(measured_force, tilt, weak, Some(u));
        assert!((found - drag * tilt.sin() * tilt.cos()).abs() < 0.01, "{found}");
        // The lift is bounded, and zero without an own thrust or for NaN.
        let hit = learnt(Vector3::new(0.0, 0.0, -90.0), 0.0, 0.4, Some(0.4));
        assert!(hit <= c.lift_limit_mps2, "{hit}");
        assert!(learnt(Vector3::new(0.0, 0.0, -90.0), 0.0, 0.4, None).abs() < 1e-12);
        assert!(learnt(Vector3::repeat(f64::NAN), 0.0, 0.4, Some(0.4)).abs() < 1e-12);
    }
}
