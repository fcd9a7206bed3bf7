//! `gnss-radio`: the vessel's position by radio, no camera, no wave model; the deck goes on at the
//! velocity that it has.
//!
//! Both receivers' errors are in the relative position, and nothing at close range removes them:
//! what remains of the deck's 2.5 m x 1.7 m is what this baseline shows.

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::msg::DeckForecast;
use serde::{Deserialize, Serialize};

/// How far a velocity is trusted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GnssRadioConfig {
    /// The vertical velocity dies out with this time constant, s: heave goes back, constant vertical
    /// velocity over the whole horizon would chase it by metres.
    pub heave_memory_s: f64,
}
impl Default for GnssRadioConfig {
    /// Ours: a fifth of a wave's period.
    fn default() -> Self {
        GnssRadioConfig { heave_memory_s: 1.0 }
    }
}
impl Check for GnssRadioConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("heave_memory_s", self.heave_memory_s, 0.01, 100.0)
    }
}

/// Replaces every stage by the first one moved on: `p + v t` horizontally, with
/// `v tau (1 - exp(-t / tau))` vertically; level, with the heading that it has.
pub fn extrapolate(forecast: &mut DeckForecast, config: &GnssRadioConfig) {
    let Some(first) = forecast.stages.first().copied() else {
        return;
    };
    let (step, tau) = (forecast.step.secs(), config.heave_memory_s);
    for (k, stage) in forecast.stages.iter_mut().enumerate() {
        let t = step * k as f64;
        let left = (-t / tau).exp();
        let [vn, ve, vd] = first.velocity;
        let [n, e, d] = first.position;
        stage.position = [n + vn * t, e + ve * t, d + vd * tau * (1.0 - left)];
        stage.velocity = [vn, ve, vd * left];
        stage.acceleration = [0.0, 0.0, -vd * left / tau];
        stage.euler = [0.0, 0.0, first.euler[2]];
        stage.euler_rates = [0.0; 3];
    }
}
