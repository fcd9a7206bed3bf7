//! Estimates of the pilot in flight: hover thrust, unmodelled lift, lateral force.

use alight_shared::estimation::low_pass;
use alight_shared::geometry::GRAVITY;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::config::TrackingConfig;
use crate::odometry::hover::hover_sample;

/// Slow estimates of the thrust scale and of the horizontal disturbance.
#[derive(Clone, Debug)]
pub(crate) struct FlightEstimator {
    /// Collective thrust that hovers, 0 to 1.
    hover: f64,
    nominal: f64,
    reported: bool,
    disturbance: Vector2<f64>,
    /// Upward specific force that the thrust does not explain, m/s².
    lift: f64,
    /// Thrust that acts after the lag, 0 to 1.
    acting: Option<f64>,
    /// It has been commanded for so long without a gap, s.
    commanded_s: f64,
}

/// A newly commanded thrust is in force after this long, s: four lags of the rotors. Until then they still give what was
/// in force before, which is not known on this side.
const IN_FORCE_S: f64 = 0.2;

impl FlightEstimator {
    /// Starts from the nominal hover thrust.
    pub(crate) fn new(nominal: f64) -> Self {
        FlightEstimator {
            hover: nominal,
            nominal,
            reported: false,
            disturbance: Vector2::zeros(),
            lift: 0.0,
            acting: None,
            commanded_s: 0.0,
        }
    }
    /// Collective thrust that hovers, 0 to 1.
    pub(crate) fn hover(&self) -> f64 {
        self.hover
    }
    /// Horizontal specific disturbance (wind), NED, m/s².
    pub(crate) fn disturbance(&self) -> Vector2<f64> {
        self.disturbance
    }
    /// Specific thrust of the collective `u`, m/s²: thrust is linear in the collective.
    pub(crate) fn specific(&self, u: f64) -> f64 {
        u * GRAVITY / self.hover
    }
    /// Own commanded thrust after its lag, 0 to 1, once it is what the rotors give: a witness of what else carries the drone.
    /// None while the autopilot closes the loop.
    pub(crate) fn in_force(&self) -> Option<f64> {
        self.acting.filter(|_| self.commanded_s >= IN_FORCE_S)
    }
    /// The autopilot's own estimate starts ours.
    pub(crate) fn use_reported_hover(&mut self, hover: f64) {
        if !self.reported && self.plausible(hover) {
            self.hover = hover;
            self.reported = true;
        }
    }
    /// Upward specific force that the own thrust does not explain, m/s²: ground effect, the air that
    /// a fast descent meets, and in wind the drag's part along the leaning thrust, which the hover
    /// thrust has taken for a weakness of the rotors.
    pub(crate) fn lift(&self) -> f64 {
        self.lift
    }
    /// A deck carries the drone: what it gives is no lift.
    pub(crate) fn forget_lift(&mut self) {
        self.lift = 0.0;
    }
    /// Learns that from a specific force (body, m/s²) and an attitude (NED from body) in flight under
    /// own thrust `f_u`: `l' = (-(R f)_z - f_u cos(tilt) - l) / lift_time_s`. Forgotten while the
    /// autopilot closes the loop.
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
    /// First-order lag from the commanded to the acting thrust.
    pub(crate) fn commanded(&mut self, thrust: Option<f64>, dt: f64, lag: f64) {
        self.commanded_s = thrust.map_or(0.0, |_| self.commanded_s + dt);
        self.acting = thrust.map(|u| low_pass(self.acting, u, dt, lag));
    }
    /// Learns from a specific force (body, m/s²) in free flight under collective `thrust`.
    pub(crate) fn learn_hover(&mut self, force: &Vector3<f64>, thrust: f64, dt: f64, c: &TrackingConfig) {
        if thrust.is_nan() || thrust < 0.05 {
            return;
        }
        if let Some(sample) = hover_sample(thrust, -force.z, [0.5, 2.0]).filter(|s| self.plausible(*s)) {
            self.hover = low_pass(self.hover, sample, dt, c.hover_time_s);
        }
    }
    /// The horizontal disturbance in free flight.
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
        // Ground effect of a tenth on a level drone.
        let ground = learnt(Vector3::new(0.0, 0.0, -1.1 * GRAVITY), 0.0, 0.4, Some(0.4));
        assert!((ground - 0.1 * GRAVITY).abs() < 0.01, "{ground}");
        // Held against wind by a tilt: drag across and along the thrust, none upwards. Had the hover
        // thrust been learnt along the thrust, its error of a sin(tilt) is found here.
        let (tilt, thrust) = (0.2_f64, GRAVITY / 0.2_f64.cos());
        let drag = GRAVITY * tilt.tan();
        let measured_force = Vector3::new(drag * tilt.cos(), 0.0, -thrust + drag * tilt.sin());
        let u = 0.4 * thrust / GRAVITY;
        assert!(learnt(measured_force, tilt, 0.4, Some(u)).abs() < 0.01);
        let weak = 0.4 * thrust / -measured_force.z;
        let found = learnt(measured_force, tilt, weak, Some(u));
        assert!((found - drag * tilt.sin() * tilt.cos()).abs() < 0.01, "{found}");
        // Bounded, and nothing without an own thrust or from what is no number.
        let hit = learnt(Vector3::new(0.0, 0.0, -90.0), 0.0, 0.4, Some(0.4));
        assert!(hit <= c.lift_limit_mps2, "{hit}");
        assert!(learnt(Vector3::new(0.0, 0.0, -90.0), 0.0, 0.4, None).abs() < 1e-12);
        assert!(learnt(Vector3::repeat(f64::NAN), 0.0, 0.4, Some(0.4)).abs() < 1e-12);
    }
}
