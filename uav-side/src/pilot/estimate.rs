//! What the pilot learns in flight: the thrust that hovers and the force that pushes.

use alight_shared::geometry::GRAVITY;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::config::TrackingConfig;

/// Slow estimates of the thrust scale and of the horizontal disturbance.
#[derive(Clone, Debug)]
pub(crate) struct FlightEstimate {
    /// Collective thrust that hovers, 0 to 1.
    hover: f64,
    nominal: f64,
    told: bool,
    disturbance: Vector2<f64>,
    /// Horizontal velocity that attitude, thrust and disturbance explain, m/s; None at rest.
    velocity: Option<Vector2<f64>>,
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
            disturbance: Vector2::zeros(),
            velocity: None,
            acting: None,
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
    /// What attitude and thrust do not explain of the horizontal velocity: wind, and the errors of
    /// attitude and accelerometers, all as the odometry sees them. A Luenberger observer,
    /// `v' = (R [0, 0, f_z])_xy + d + 2 w (v_m - v)`, `d' = w² (v_m - v)`, with both poles at
    /// `w = 1 / disturbance_time_s`. Drag felt by the accelerometers would be quicker, but their bias
    /// of 0.05 m/s² and the tilt's of 0.3 deg would each cost 3 cm.
    pub(crate) fn learn_disturbance(
        &mut self,
        force: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
        velocity: &Vector3<f64>,
        dt: f64,
        c: &TrackingConfig,
    ) {
        let measured = velocity.xy();
        let thrust = attitude * Vector3::new(0.0, 0.0, force.z);
        let w = 1.0 / c.disturbance_time_s;
        let v = self.velocity.unwrap_or(measured);
        let wrong = measured - v;
        // A jump of the odometry is not a force.
        if !(wrong.norm() < 2.0) || !thrust.norm().is_finite() {
            self.velocity = None;
            return;
        }
        self.velocity = Some(v + (thrust.xy() + self.disturbance + wrong * (2.0 * w)) * dt);
        let most = c.disturbance_limit_mps2;
        self.disturbance = (self.disturbance + wrong * (w * w * dt)).map(|d| d.clamp(-most, most));
    }
    /// In contact or without odometry the observer starts anew; what it found stays.
    pub(crate) fn pause_disturbance(&mut self) {
        self.velocity = None;
    }
    fn plausible(&self, hover: f64) -> bool {
        (0.5 * self.nominal..=2.0 * self.nominal).contains(&hover) && hover < 0.95
    }
}
