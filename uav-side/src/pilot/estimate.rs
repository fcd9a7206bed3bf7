//! What the pilot learns in flight: the thrust that hovers and the force that pushes.

use alight_shared::geometry::GRAVITY;
use nalgebra::{Vector2, Vector3};

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
