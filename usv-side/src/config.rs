//! Settings of the vessel's process.

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::geometry::DeckGeometry;
use alight_shared::vessel_model::VesselModelConfig;
use serde::{Deserialize, Serialize};

use crate::sea_state::SeaStateConfig;
use crate::throttle::ThrottleConfig;

/// The inertial sensor as the estimator is told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuConfig {
    /// Place in the vessel's body frame, m.
    pub lever_arm_m: [f64; 3],
    /// White noise of the gyroscope per sample, rad/s.
    pub gyro_sd_radps: f64,
    /// Spread of the gyroscope's bias, rad/s.
    pub gyro_bias_sd_radps: f64,
    /// White noise of the accelerometer per sample, m/s².
    pub accelerometer_sd_mps2: f64,
    /// Spread of the accelerometer's bias, misalignment of the sensor with the deck included, m/s².
    pub accelerometer_bias_sd_mps2: f64,
    /// Correlation time of both biases, s.
    pub bias_time_s: f64,
    /// Without a sample for so long the estimate is withheld, s.
    pub silence_s: f64,
}
impl Default for ImuConfig {
    fn default() -> Self {
        ImuConfig {
            // Ours: in the payload tray, off the middle.
            lever_arm_m: [0.3, 0.1, -0.3],
            // Virtual RobotX WAM-V.
            gyro_sd_radps: 0.009,
            gyro_bias_sd_radps: 0.005,
            accelerometer_sd_mps2: 0.021,
            // Virtual RobotX: 0.05; ours for misalignment with the deck, 0.2 deg (a spirit level) in
            // gravity.
            accelerometer_bias_sd_mps2: 0.06,
            // Ours, far shorter than real biases last: a heading that swings makes them seem
            // observable, because the correlation of roll with pitch is not kept.
            bias_time_s: 300.0,
            // Ours: a fifth of a wave period.
            silence_s: 1.0,
        }
    }
}
impl Check for ImuConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.ranges("lever_arm_m", &self.lever_arm_m, -50.0, 50.0)?;
        at.range("gyro_sd_radps", self.gyro_sd_radps, 1e-6, 1.0)?;
        at.range("gyro_bias_sd_radps", self.gyro_bias_sd_radps, 0.0, 1.0)?;
        at.range("accelerometer_sd_mps2", self.accelerometer_sd_mps2, 1e-6, 10.0)?;
        at.range(
            "accelerometer_bias_sd_mps2",
            self.accelerometer_bias_sd_mps2,
            0.0,
            10.0,
        )?;
        at.range("bias_time_s", self.bias_time_s, 1.0, 1e9)?;
        at.range("silence_s", self.silence_s, 0.05, 60.0)
    }
}

/// The GNSS receiver as the estimator is told. Its noise comes with every fix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GnssConfig {
    /// Antenna in the vessel's body frame, m.
    pub antenna_m: [f64; 3],
    /// Spread of the slow bias of the height, m.
    pub height_bias_sd_m: f64,
    /// Its correlation time, s.
    pub height_bias_time_s: f64,
    /// A fix that is older is refused, s.
    pub oldest_s: f64,
}
impl Default for GnssConfig {
    fn default() -> Self {
        GnssConfig {
            // Ours: on a mast behind and above the deck.
            antenna_m: [-0.8, 0.2, -2.0],
            // Issue 2: 1 m with 300 s.
            height_bias_sd_m: 1.0,
            height_bias_time_s: 300.0,
            // Ours: a late fix is compared with the state rolled back by a second-order series.
            oldest_s: 0.3,
        }
    }
}
impl Check for GnssConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.ranges("antenna_m", &self.antenna_m, -50.0, 50.0)?;
        at.range("height_bias_sd_m", self.height_bias_sd_m, 0.0, 100.0)?;
        at.range("height_bias_time_s", self.height_bias_time_s, 1.0, 1e6)?;
        at.range("oldest_s", self.oldest_s, 0.01, 1.0)
    }
}

/// The heading sensor as the estimator is told. Its white noise comes with every measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HeadingConfig {
    /// Spread of its slow bias, deg.
    pub bias_sd_deg: f64,
    /// Correlation time of that bias, s.
    pub bias_time_s: f64,
    /// A measurement that is older is refused, s.
    pub oldest_s: f64,
}
impl Default for HeadingConfig {
    fn default() -> Self {
        HeadingConfig {
            // Ours: compass deviation after a calibration.
            bias_sd_deg: 0.5,
            bias_time_s: 300.0,
            oldest_s: 0.3,
        }
    }
}
impl Check for HeadingConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("bias_sd_deg", self.bias_sd_deg, 0.0, 45.0)?;
        at.range("bias_time_s", self.bias_time_s, 1.0, 1e9)?;
        at.range("oldest_s", self.oldest_s, 0.01, 1.0)
    }
}

/// How often the vessel speaks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BroadcastConfig {
    /// State estimates, Hz.
    pub estimate_hz: f64,
    /// Wave models, Hz.
    pub wave_hz: f64,
    /// Predictions, Hz.
    pub prediction_hz: f64,
    /// Time between the stages of a prediction, s.
    pub prediction_step_s: f64,
    /// Less while the link backs up.
    pub throttle: ThrottleConfig,
}
impl Default for BroadcastConfig {
    fn default() -> Self {
        BroadcastConfig {
            // Issue 2.
            estimate_hz: 30.0,
            wave_hz: 5.0,
            prediction_hz: 2.0,
            // Ours: 15 stages reach 2.8 s, past the planner's 2 s horizon.
            prediction_step_s: 0.2,
            throttle: ThrottleConfig::default(),
        }
    }
}
impl Check for BroadcastConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("estimate_hz", self.estimate_hz, 1.0, 100.0)?;
        at.range("wave_hz", self.wave_hz, 0.1, 50.0)?;
        at.range("prediction_hz", self.prediction_hz, 0.1, 50.0)?;
        at.range("prediction_step_s", self.prediction_step_s, 0.02, 2.0)?;
        self.throttle.check(&at.table("throttle"))
    }
}

/// Everything the vessel's process is told.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VesselNodeConfig {
    /// Figures of the wave-augmented model.
    pub model: VesselModelConfig,
    /// The landing deck.
    pub deck: DeckGeometry,
    /// The inertial sensor.
    pub imu: ImuConfig,
    /// The GNSS receiver.
    pub gnss: GnssConfig,
    /// The heading sensor.
    pub heading: HeadingConfig,
    /// Identification of the sea.
    pub sea_state: SeaStateConfig,
    /// How often the vessel speaks.
    pub broadcast: BroadcastConfig,
}
impl Check for VesselNodeConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.model.check(&at.table("model"))?;
        self.deck.check(&at.table("deck"))?;
        self.imu.check(&at.table("imu"))?;
        self.gnss.check(&at.table("gnss"))?;
        self.heading.check(&at.table("heading"))?;
        self.sea_state.check(&at.table("sea_state"))?;
        self.broadcast.check(&at.table("broadcast"))
    }
}
