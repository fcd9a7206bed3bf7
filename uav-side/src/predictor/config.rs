//! Figures of the predictor.

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::frames::Datum;
use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::vessel_model::VesselModelConfig;
use serde::{Deserialize, Serialize};

/// What the predictor believes about deck, drone, sensors and sea. Lists of six are in the order
/// north, east, down (m), deck normal about north, about east (rad), heading (rad).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PredictorConfig {
    /// Forecasts per second.
    pub rate_hz: f64,
    /// Time between the stages of a forecast, s.
    pub stage_s: f64,
    /// The deck; from the drone's common settings.
    #[serde(skip)]
    pub deck: DeckGeometry,
    /// The drone; from the drone's common settings.
    #[serde(skip)]
    pub drone: DroneGeometry,
    /// Origin of the drone's NED plane; without it the vessel's is meant.
    pub datum: Option<Datum>,
    /// Spread of the radio's slow error.
    pub radio_bias_sd_m_rad: [f64; 6],
    /// Correlation time of the radio's slow error, s.
    pub radio_bias_time_s: [f64; 6],
    /// Spread of the sight's slow error.
    pub vision_bias_sd_m_rad: [f64; 6],
    /// Correlation time of the sight's slow error, s.
    pub vision_bias_time_s: [f64; 6],
    /// Spread of the odometry's error of velocity, each axis, m/s.
    pub odometry_drift_mps: f64,
    /// Its correlation time, s.
    pub odometry_drift_s: f64,
    /// Random walk of the mean level after 1 s.
    pub mean_walk_m_rad: [f64; 6],
    /// Random walk of the mean rate after 1 s, m/s, rad/s.
    pub rate_walk_mps_radps: [f64; 6],
    /// Random walk of the mean velocity after 1 s as a share of the mean speed, in addition.
    pub speed_walk: f64,
    /// Random walk of the mean velocity after 1 s as a multiple of the acceleration across in a
    /// turn, in addition.
    pub turn_walk_s: f64,
    /// Time after which a mean rate dies out, s.
    pub rate_time_s: [f64; 6],
    /// Spread of the motion that no wave component explains.
    pub residual_sd_m_rad: [f64; 6],
    /// Angular frequency of that motion, rad/s.
    pub residual_omega_radps: f64,
    /// Damping ratio of that motion.
    pub residual_damping: f64,
    /// The vessel's model, as on the vessel: tells its motion from its wave model.
    pub vessel: VesselModelConfig,
    /// Damping ratio of a wave component as a multiple of what the vessel says.
    pub damping_scale: f64,
    /// Least damping ratio of a wave component.
    pub min_damping: f64,
    /// The spread that a wave component is given, as a multiple of what the vessel says.
    pub wave_scale: f64,
    /// The vessel's word on the present motion of each wave component is fused with its variance
    /// times this, because its errors last from one message to the next.
    pub wave_state_inflation: f64,
    /// Least spread of a wave component.
    pub min_wave_sd_m_rad: [f64; 6],
    /// Until the vessel has sent a wave model: angular frequencies, rad/s.
    pub bank_omega_radps: Vec<f64>,
    /// Damping ratio of these.
    pub bank_damping: f64,
    /// Spread of each of these.
    pub bank_sd_m_rad: [f64; 6],
    /// The vessel's estimates are filtered, so their errors persist: the variance of each is
    /// multiplied by this before it is fused as if it were independent.
    pub radio_inflation: f64,
    /// Share of the vessel's stated variance that is common to all its estimates and stays.
    pub radio_floor: f64,
    /// Least standard deviation of a fused value of the radio.
    pub radio_min_sd_m_rad: [f64; 6],
    /// Least standard deviation of a fused rate of the radio.
    pub radio_min_rate_sd_mps_radps: [f64; 6],
    /// Least standard deviation of a tag's position, m.
    pub tag_min_sd_m: f64,
    /// Least standard deviation of a tag's attitude, rad.
    pub tag_min_sd_rad: f64,
    /// Share of the drone's stated position error that is fused as noise of a sight; the rest is
    /// the same in the drone's position now and does not matter.
    pub drone_variance_fraction: f64,
    /// Error of a sight in proportion to its distance, besides the mount's, that is the same from
    /// one sight to the next.
    pub vision_scale_sd: f64,
    /// Position error of the camera's mount, m.
    pub camera_mount_sd_m: f64,
    /// A reading of the rangefinder is used at most this often, s.
    pub range_period_s: f64,
    /// Distance that a rangefinder's spot keeps from the deck's edge, m.
    pub range_margin_m: f64,
    /// Least standard deviation of a rangefinder's reading, m.
    pub range_min_sd_m: f64,
    /// Innovations beyond this many standard deviations are refused.
    pub gate_sd: f64,
    /// The vessel's wave model is used.
    pub use_wave_model: bool,
    /// Sightings of tag and UV markers are used.
    pub use_vision: bool,
    /// The vessel's estimates are used only while the newest tag sighting is older than this, s; 0
    /// for always.
    pub radio_after_vision_s: f64,
    /// Knowledge is fresh for this long, s.
    pub fresh_s: f64,
    /// Without any knowledge for this long there is no forecast, s.
    pub silence_s: f64,
}

impl Default for PredictorConfig {
    fn default() -> Self {
        let deg = |d: f64| d.to_radians();
        PredictorConfig {
            // alight_shared::topics::FORECAST.
            rate_hz: 50.0,
            // 41 stages reach 4 s: twice the paper's horizon of 2 s.
            stage_s: 0.1,
            deck: DeckGeometry::default(),
            drone: DroneGeometry::default(),
            datum: None,
            // GNSS of the vessel: 1 m; tilt: trim of its inertial unit; compass: 1 deg. Ours.
            radio_bias_sd_m_rad: [1.0, 1.0, 1.0, deg(0.3), deg(0.3), deg(1.5)],
            radio_bias_time_s: [300.0, 300.0, 300.0, 60.0, 60.0, 100.0],
            // GNSS of the drone: 1 m; camera mount 1 deg with the drone's own attitude error.
            vision_bias_sd_m_rad: [1.0, 1.0, 1.0, deg(1.2), deg(1.2), deg(1.5)],
            // The frame of the smooth odometry moves by its drift alone.
            vision_bias_time_s: [1e6, 1e6, 1e6, 200.0, 200.0, 100.0],
            // Of the smooth odometry in a landing, as measured, each axis.
            odometry_drift_mps: 0.07,
            odometry_drift_s: 6.0,
            // Ours.
            mean_walk_m_rad: [0.003, 0.003, 0.01, deg(0.05), deg(0.05), deg(0.05)],
            // Ours, between a drifting vessel (0.03 is best) and one that turns at 2 m/s.
            rate_walk_mps_radps: [0.05, 0.05, 0.0, 0.0, 0.0, 0.05],
            // Ours, tuned on a square at 2 m/s; nothing of it on a drifting vessel.
            speed_walk: 0.08,
            turn_walk_s: 0.6,
            rate_time_s: [100.0, 100.0, 1.0, 1.0, 1.0, 5.0],
            // Ours; a tilt that turns otherwise than foretold is given more ([`super::adaptive_noise`]).
            residual_sd_m_rad: [0.005, 0.005, 0.012, deg(0.35), deg(0.35), deg(0.2)],
            residual_omega_radps: 3.0,
            residual_damping: 0.5,
            vessel: VesselModelConfig::default(),
            // Ours: damping is also decay, and a free run of half a minute must not lose the waves.
            damping_scale: 0.3,
            min_damping: 0.003,
            // Ours, tuned at Moderate.
            wave_scale: 0.8,
            wave_state_inflation: 25.0,
            min_wave_sd_m_rad: [0.01, 0.01, 0.01, deg(0.1), deg(0.1), deg(0.1)],
            // As the vessel model's broad default.
            bank_omega_radps: vec![0.8, 1.06, 1.41, 1.88, 2.5],
            bank_damping: 0.1,
            bank_sd_m_rad: [0.15, 0.15, 0.15, deg(2.0), deg(2.0), deg(0.5)],
            // Ours: about half a second of correlation at 30 Hz.
            radio_inflation: 20.0,
            radio_floor: 0.5,
            // Ours.
            radio_min_sd_m_rad: [0.1, 0.1, 0.05, deg(0.3), deg(0.3), deg(0.5)],
            radio_min_rate_sd_mps_radps: [0.1, 0.1, 0.05, deg(0.5), deg(0.5), deg(1.0)],
            // Ours: what remains however near the tag is; far away the detector's own figure counts.
            tag_min_sd_m: 0.003,
            tag_min_sd_rad: deg(0.6),
            // Ours, tuned at Moderate.
            drone_variance_fraction: 0.0,
            // Ours: a tag of 71 px at 7 m appears 11 cm too near.
            vision_scale_sd: 0.012,
            // Issue 2: camera mount 1 cm wrong.
            camera_mount_sd_m: 0.01,
            range_period_s: 0.04,
            range_margin_m: 0.2,
            // Issue 2: rangefinder 3 cm.
            range_min_sd_m: 0.03,
            gate_sd: 5.0,
            // Less than all is for comparisons.
            use_wave_model: true,
            use_vision: true,
            radio_after_vision_s: 0.0,
            fresh_s: 1.0,
            silence_s: 30.0,
        }
    }
}

impl Check for PredictorConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("rate_hz", self.rate_hz, 1.0, 200.0)?;
        at.range("stage_s", self.stage_s, 0.01, 1.0)?;
        self.deck.check(&at.table("deck"))?;
        self.drone.check(&at.table("drone"))?;
        if let Some(d) = &self.datum {
            at.range("datum.latitude_deg", d.latitude_deg, -90.0, 90.0)?;
            at.range("datum.longitude_deg", d.longitude_deg, -360.0, 360.0)?;
            at.range("datum.height_m", d.height_m, -1e4, 1e4)?;
        }
        at.ranges("radio_bias_sd_m_rad", &self.radio_bias_sd_m_rad, 0.0, 100.0)?;
        at.ranges("radio_bias_time_s", &self.radio_bias_time_s, 0.1, 1e6)?;
        at.ranges("vision_bias_sd_m_rad", &self.vision_bias_sd_m_rad, 0.0, 100.0)?;
        at.ranges("vision_bias_time_s", &self.vision_bias_time_s, 0.1, 1e6)?;
        at.range("odometry_drift_mps", self.odometry_drift_mps, 0.0, 5.0)?;
        at.range("odometry_drift_s", self.odometry_drift_s, 0.1, 1e3)?;
        at.ranges("mean_walk_m_rad", &self.mean_walk_m_rad, 0.0, 10.0)?;
        at.ranges("rate_walk_mps_radps", &self.rate_walk_mps_radps, 0.0, 10.0)?;
        at.range("speed_walk", self.speed_walk, 0.0, 10.0)?;
        at.range("turn_walk_s", self.turn_walk_s, 0.0, 10.0)?;
        at.ranges("rate_time_s", &self.rate_time_s, 0.1, 1e6)?;
        at.ranges("residual_sd_m_rad", &self.residual_sd_m_rad, 0.0, 1.0)?;
        at.range("residual_omega_radps", self.residual_omega_radps, 0.5, 20.0)?;
        at.range("residual_damping", self.residual_damping, 0.05, 0.95)?;
        self.vessel.check(&at.table("vessel"))?;
        at.range("damping_scale", self.damping_scale, 0.01, 10.0)?;
        at.range("min_damping", self.min_damping, 1e-4, 0.5)?;
        at.range("wave_scale", self.wave_scale, 0.1, 10.0)?;
        at.range("wave_state_inflation", self.wave_state_inflation, 1.0, 1e12)?;
        at.ranges("min_wave_sd_m_rad", &self.min_wave_sd_m_rad, 1e-6, 1.0)?;
        at.ranges("bank_omega_radps", &self.bank_omega_radps, 0.1, 10.0)?;
        at.range("bank_damping", self.bank_damping, 1e-3, 0.95)?;
        at.ranges("bank_sd_m_rad", &self.bank_sd_m_rad, 0.0, 10.0)?;
        at.range("radio_inflation", self.radio_inflation, 1.0, 1e3)?;
        at.range("radio_floor", self.radio_floor, 0.0, 10.0)?;
        at.ranges("radio_min_sd_m_rad", &self.radio_min_sd_m_rad, 1e-4, 10.0)?;
        at.ranges(
            "radio_min_rate_sd_mps_radps",
            &self.radio_min_rate_sd_mps_radps,
            1e-4,
            10.0,
        )?;
        at.range("tag_min_sd_m", self.tag_min_sd_m, 1e-4, 1.0)?;
        at.range("tag_min_sd_rad", self.tag_min_sd_rad, 1e-4, 1.0)?;
        at.range("drone_variance_fraction", self.drone_variance_fraction, 0.0, 1.0)?;
        at.range("vision_scale_sd", self.vision_scale_sd, 0.0, 0.5)?;
        at.range("camera_mount_sd_m", self.camera_mount_sd_m, 0.0, 1.0)?;
        at.range("range_period_s", self.range_period_s, 0.0, 10.0)?;
        at.range("range_margin_m", self.range_margin_m, 0.0, 10.0)?;
        at.range("range_min_sd_m", self.range_min_sd_m, 1e-3, 1.0)?;
        at.range("gate_sd", self.gate_sd, 2.0, 20.0)?;
        at.range("radio_after_vision_s", self.radio_after_vision_s, 0.0, 60.0)?;
        at.range("fresh_s", self.fresh_s, 0.1, 10.0)?;
        at.range("silence_s", self.silence_s, 1.0, 600.0)
    }
}
