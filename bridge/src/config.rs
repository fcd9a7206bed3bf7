//! Limits of the bridge.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

/// Who talks to whom, and what is still believed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BridgeConfig {
    /// The only vessel that is listened to.
    pub vessel_id: u32,
    /// Our own identity: messages to other drones are refused.
    pub drone_id: u32,
    /// Rate of the link's state, Hz.
    pub link_rate_hz: f64,
    /// Window of the loss statistics, s.
    pub loss_window_s: f64,
    /// A time of validity may lie this much beyond what the clock's bounds allow, s.
    pub future_margin_s: f64,
    /// Clock offset.
    pub clock: ClockConfig,
}

/// Offset of the two computers' clocks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockConfig {
    /// Rate of time requests, Hz.
    pub request_rate_hz: f64,
    /// A reply after a longer round trip is refused, s.
    pub max_round_trip_s: f64,
    /// Exchanges older than this are forgotten, s.
    pub window_s: f64,
    /// Greatest drift of one clock against the other, s/s.
    pub max_drift: f64,
    /// An offset that moved by more than this in both directions of travel is a step, s.
    pub step_s: f64,
    /// The stated standard deviation is never smaller, s.
    pub min_sd_s: f64,
}

impl Default for BridgeConfig {
    fn default() -> Self {
        BridgeConfig {
            vessel_id: 1,
            drone_id: 1,
            // alight_shared::topics::LINK.
            link_rate_hz: 10.0,
            // Ours: 150 estimates at 30 Hz.
            loss_window_s: 5.0,
            // Ours: ten times the resolution of a 100 Hz loop is not needed, one is.
            future_margin_s: 0.01,
            clock: ClockConfig::default(),
        }
    }
}
impl Default for ClockConfig {
    fn default() -> Self {
        ClockConfig {
            // alight_shared::topics::TIME_REQUEST.
            request_rate_hz: 2.0,
            // Ours: forty times the default one-way delay of 50 ms.
            max_round_trip_s: 2.0,
            // Ours: 60 exchanges; at 50 ppm the oldest is 1.5 ms worse than when it was made.
            window_s: 30.0,
            // Quartz oscillators with temperature: 20 ppm typical, 50 ppm allowed.
            max_drift: 50e-6,
            // Ours: the best of ten delays of 50 +- 20 ms varies by about 10 ms.
            step_s: 0.04,
            // Ours: a tenth of the world's 10 ms tick.
            min_sd_s: 0.001,
        }
    }
}

impl Check for BridgeConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("link_rate_hz", self.link_rate_hz, 0.1, 100.0)?;
        at.range("loss_window_s", self.loss_window_s, 0.5, 60.0)?;
        at.range("future_margin_s", self.future_margin_s, 0.0, 1.0)?;
        self.clock.check(&at.table("clock"))
    }
}
impl Check for ClockConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("request_rate_hz", self.request_rate_hz, 0.1, 20.0)?;
        at.range("max_round_trip_s", self.max_round_trip_s, 0.05, 10.0)?;
        at.range("window_s", self.window_s, 2.0, 600.0)?;
        at.range("max_drift", self.max_drift, 0.0, 1e-3)?;
        at.range("step_s", self.step_s, 0.005, 1.0)?;
        at.range("min_sd_s", self.min_sd_s, 1e-6, 0.1)
    }
}
