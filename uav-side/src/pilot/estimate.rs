//! What the pilot learns in flight: the thrust that hovers, the lift that it does not explain, and
//! the force that pushes.

use alight_shared::geometry::GRAVITY;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::config::TrackingConfig;
use crate::disturbance::Disturbance;

/// Slow estimates of the thrust scale and of the horizontal disturbance.
#[derive(Clone, Debug)]
pub(crate) struct FlightEstimate {
    /// Collective thrust that hovers, 0 to 1.
    hover: f64,
    nominal: f64,
    told: bool,
    disturbance: Disturbance,
    /// Upward specific force that the thrust does not explain, m/s².
    lift: f64,
    /// Thrust that acts after the lag, 0 to 1.
    acting: Option<f64>,
}

impl FlightEstimate {
    /// Starts from the nominal hover thrust.
    pub(crate) fn new(nominal: f64) -> Self {
        FlightEstimate {
            hover: nominal,
            nominal,
            told: false,
            disturbance: Disturbance::default(),
            lift: 0.0,
            acting: None,
        }
    }
    /// Collective thrust that hovers, 0 to 1.
    pub(crate) fn hover(&self) -> f64 {
        self.hover
    }
    /// Horizontal specific disturbance (wind), NED, m/s².
    pub(crate) fn disturbance(&self) -> Vector2<f64> {
        self.disturbance.value()
    }
    /// Specific thrust of the collective `u`, m/s²: thrust is linear in the collective.
    pub(crate) fn specific(&self, u: f64) -> f64 {
        u * GRAVITY / self.hover
    }
    /// Own commanded thrust after its lag, 0 to 1; None while the autopilot closes the loop.
    pub(crate) fn acting(&self) -> Option<f64> {
        self.acting
    }
    /// The autopilot's own estimate starts ours.
    pub(crate) fn told_hover(&mut self, hover: f64) {
        if !self.told && self.plausible(hover) {
            self.hover = hover;
            self.told = true;
        }
    }
    /// Upward specific force that the own thrust does not explain, m/s²: ground effect, the air that
    /// a fast descent meets, and in wind the drag's part along the leaning thrust, which the hover
    /// thrust has taken for a weakness of the rotors.
    pub(crate) fn lift(&self) -> f64 {
        self.lift
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
        let Some(u) = self.acting else {
            self.lift = 0.0;
            return;
        };
        let upright = (attitude * Vector3::z()).z;
        let wrong = -(attitude * force).z - self.specific(u) * upright;
        if wrong.is_finite() {
            let most = c.lift_limit_mps2;
            self.lift += (1.0 - (-dt / c.lift_time_s).exp()) * (wrong.clamp(-most, most) - self.lift);
        }
    }
    /// First-order lag from the commanded to the acting thrust.
    pub(crate) fn commanded(&mut self, thrust: Option<f64>, dt: f64, lag: f64) {
        self.acting = thrust.map(|u| {
            let share = if lag > 0.0 { 1.0 - (-dt / lag).exp() } else { 1.0 };
            let last = self.acting.unwrap_or(u);
            last + share * (u - last)
        });
    }
    /// Learns from a specific force (body, m/s²) in free flight under collective `thrust`.
    pub(crate) fn learn_hover(&mut self, force: &Vector3<f64>, thrust: f64, dt: f64, c: &TrackingConfig) {
        let up = -force.z;
        if !(0.5 * GRAVITY..=2.0 * GRAVITY).contains(&up) || thrust.is_nan() || thrust < 0.05 {
            return;
        }
        let sample = thrust * GRAVITY / up;
        if self.plausible(sample) {
            self.hover += (1.0 - (-dt / c.hover_time_s).exp()) * (sample - self.hover);
        }
    }
    /// The horizontal disturbance, to be taught in free flight.
    pub(crate) fn disturbance_mut(&mut self) -> &mut Disturbance {
        &mut self.disturbance
    }
    fn plausible(&self, hover: f64) -> bool {
        (0.5 * self.nominal..=2.0 * self.nominal).contains(&hover) && hover < 0.95
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lift_is_what_the_thrust_does_not_explain_upwards() {
        let c = TrackingConfig::default();
        let learnt = |force: Vector3<f64>, lean: f64, hover: f64, u: Option<f64>| {
            let mut e = FlightEstimate::new(hover);
            let attitude = UnitQuaternion::from_euler_angles(0.0, lean, 0.4);
            for _ in 0..100 {
                e.commanded(u, 0.01, 0.0);
                e.learn_lift(&force, &attitude, 0.01, &c);
            }
            e.lift()
        };
        // Ground effect of a tenth on a level drone.
        let ground = learnt(Vector3::new(0.0, 0.0, -1.1 * GRAVITY), 0.0, 0.4, Some(0.4));
        assert!((ground - 0.1 * GRAVITY).abs() < 0.01, "{ground}");
        // Held against wind by a lean: drag across and along the thrust, none upwards. Had the hover
        // thrust been learnt along the thrust, its error of a sin(lean) is found here.
        let (lean, thrust) = (0.2_f64, GRAVITY / 0.2_f64.cos());
        let drag = GRAVITY * lean.tan();
        let felt = Vector3::new(drag * lean.cos(), 0.0, -thrust + drag * lean.sin());
        let u = 0.4 * thrust / GRAVITY;
        assert!(learnt(felt, lean, 0.4, Some(u)).abs() < 0.01);
        let weak = 0.4 * thrust / -felt.z;
        let found = learnt(felt, lean, weak, Some(u));
        assert!((found - drag * lean.sin() * lean.cos()).abs() < 0.01, "{found}");
        // Bounded, and nothing without an own thrust or from what is no number.
        let hit = learnt(Vector3::new(0.0, 0.0, -90.0), 0.0, 0.4, Some(0.4));
        assert!(hit <= c.lift_limit_mps2, "{hit}");
        assert!(learnt(Vector3::new(0.0, 0.0, -90.0), 0.0, 0.4, None).abs() < 1e-12);
        assert!(learnt(Vector3::repeat(f64::NAN), 0.0, 0.4, Some(0.4)).abs() < 1e-12);
    }
}
