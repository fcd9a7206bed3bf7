//! Settings of the identification.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

/// Settings of the identification of the sea.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SeaStateConfig {
    /// Length of the record, s.
    pub window_s: f64,
    /// Length that the record is cut to while the sea proves hard to foretell, s.
    pub short_window_s: f64,
    /// Shortest record that is tried, s.
    pub min_window_s: f64,
    /// Time between two refinements, s.
    pub update_period_s: f64,
    /// Width of the bins that samples are averaged into, s.
    pub bin_s: f64,
    /// Lowest angular frequency of a component, rad/s.
    pub omega_min_radps: f64,
    /// Highest angular frequency of a component, rad/s.
    pub omega_max_radps: f64,
    /// Noise of the vertical acceleration in a bin, m/s².
    pub acceleration_noise_mps2: f64,
    /// Noise of the tilt in a bin, rad.
    pub tilt_noise_rad: f64,
    /// Standard deviation of the vertical acceleration below which the sea is calm, m/s².
    pub calm_acceleration_mps2: f64,
    /// Standard deviation of each component of the tilt below which the sea is calm, rad.
    pub calm_tilt_rad: f64,
    /// Bandwidth of what the components leave unexplained, Hz: sets how many independent samples
    /// the information criterion counts.
    pub residual_band_hz: f64,
    /// Share of a channel's variance that is not worth a component, 0 to 1.
    pub negligible: f64,
    /// Two components closer than this many cycles over the record are taken for one.
    pub min_separation: f64,
    /// The same on a vessel that covers more than 30 m in the record: there a pair can trade
    /// frequency against direction.
    pub min_separation_under_way: f64,
}

impl Default for SeaStateConfig {
    fn default() -> Self {
        SeaStateConfig {
            // Issue 2: "spectrum of the last minute".
            window_s: 60.0,
            // Ours: five periods of a 5 s sea.
            short_window_s: 25.0,
            // Ours: four periods of a 5 s sea.
            min_window_s: 20.0,
            // Ours: a third of a wave period, within the CPU share.
            update_period_s: 1.5,
            // Ours: 5 Hz, five times the fastest deck (0.95 Hz).
            bin_s: 0.2,
            // Ours: waves of 20 s, longer than any sea that rocks a small boat.
            omega_min_radps: 0.3,
            // Ours: small decks in a harbour rock at up to 0.95 Hz (6 rad/s).
            omega_max_radps: 7.0,
            // VRX sensor noise 0.021 m/s² a sample, and lever arms.
            acceleration_noise_mps2: 0.02,
            // 0.1 deg: gyro-carried attitude within a wave period.
            tilt_noise_rad: 0.0018,
            // Ours: half of what the smallest named sea (0.3 m, 5 s) makes, four times over.
            calm_acceleration_mps2: 0.06,
            calm_tilt_rad: 0.006,
            // Ours: the waves' own band, in which residuals are left.
            residual_band_hz: 0.5,
            // Ours: half of what second-order waves leave in a 14 deg sea; four times as much and two
            // waves 5 % apart are taken for one.
            negligible: 0.0015,
            // Ours: closer, and their amplitudes grow without bound.
            min_separation: 0.2,
            // Ours: on a square at 2 m/s closer pairs made the estimator's surge diverge in rough seas.
            min_separation_under_way: 0.4,
        }
    }
}

impl Check for SeaStateConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("window_s", self.window_s, 20.0, 120.0)?;
        at.range("min_window_s", self.min_window_s, 10.0, self.window_s)?;
        at.range(
            "short_window_s",
            self.short_window_s,
            self.min_window_s,
            self.window_s,
        )?;
        at.range("update_period_s", self.update_period_s, 0.2, 10.0)?;
        at.range("bin_s", self.bin_s, 0.1, 0.5)?;
        at.range("omega_min_radps", self.omega_min_radps, 0.1, 2.0)?;
        // The bins sample each period at least four times.
        let fastest = core::f64::consts::FRAC_PI_2 / self.bin_s;
        at.range(
            "omega_max_radps",
            self.omega_max_radps,
            self.omega_min_radps,
            fastest,
        )
    }
}
