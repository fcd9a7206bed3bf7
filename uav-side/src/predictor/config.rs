use alight_shared::{
    config,
    geometry::{DeckGeometry, DroneGeometry},
};

/// Three lengths (m), and three angles (degrees, converted to rad).
fn six(lengths: [f64; 3], degrees: [f64; 3]) -> [f64; 6] {
    let [n, e, d] = lengths;
    let [r, p, y] = degrees.map(f64::to_radians);
    [n, e, d, r, p, y]
}

config! {
    /// Predictor's model of deck, drone, sensors and sea. Lists of six: north, east, down (m), deck normal about north,
    /// about east (rad), heading (rad).
    pub struct PredictorConfig {
        /// Forecasts per second.
        /// Source: `topics::FORECAST`.
        pub rate_hz: f64 = 50.0, in 1.0..=200.0;
        /// Time between the stages of a forecast, s.
        /// Source: 41 stages span 4 s, twice the paper's horizon of 2 s.
        pub stage_s: f64 = 0.1, in 0.01..=1.0;
        /// The deck; from the drone's common settings.
        #[serde(skip)]
        pub deck: DeckGeometry;
        /// The drone; from the drone's common settings.
        #[serde(skip)]
        pub drone: DroneGeometry;
        /// Use beacons; set from the mission.
        #[serde(skip)]
        pub beacons: bool = false;
        /// Standard deviation of the radio's slow error.
        /// Source: GNSS of the vessel: 1 m; tilt: trim of its inertial unit; compass: 1 deg.
        pub radio_bias_sd_m_rad: [f64; 6] = six([1.0, 1.0, 1.0], [0.3, 0.3, 1.5]), in 0.0..=100.0;
        /// Correlation time of the radio's slow error, s.
        pub radio_bias_time_s: [f64; 6] = [300.0, 300.0, 300.0, 60.0, 60.0, 100.0], in 0.1..=1e6;
        /// Standard deviation of vision's slow error.
        /// Source: GNSS of the drone: 1 m; camera mount and the drone's attitude: 1 deg.
        pub vision_bias_sd_m_rad: [f64; 6] = six([1.0, 1.0, 1.0], [1.2, 1.2, 1.5]), in 0.0..=100.0;
        /// Correlation time of vision's slow error, s.
        /// Source: the frame of the smooth odometry moves only by its drift.
        pub vision_bias_time_s: [f64; 6] = [1e6, 1e6, 1e6, 200.0, 200.0, 100.0], in 0.1..=1e6;
        /// Standard deviation of the odometry's velocity error per axis, m/s.
        /// Source: measured on the smooth odometry in landings.
        pub odometry_drift_mps: f64 = 0.07, in 0.0..=5.0;
        /// Correlation time of that drift, s.
        pub odometry_drift_s: f64 = 6.0, in 0.1..=1e3;
        /// Random walk of the mean level after 1 s.
        pub mean_walk_m_rad: [f64; 6] = six([0.003, 0.003, 0.01], [0.05, 0.05, 0.05]), in 0.0..=10.0;
        /// Random walk of the mean rate after 1 s, m/s, rad/s.
        /// Chosen: between a drifting vessel (0.03 is best) and one that turns at 2 m/s.
        pub rate_walk_mps_radps: [f64; 6] = [0.05, 0.05, 0.0, 0.0, 0.0, 0.05], in 0.0..=10.0;
        /// Additional random walk of the mean velocity after 1 s, as a fraction of the mean speed.
        /// Chosen: tuned on a square course at 2 m/s; zero for a drifting vessel.
        pub speed_walk: f64 = 0.08, in 0.0..=10.0;
        /// Additional random walk of the mean velocity after 1 s, per lateral acceleration in a turn, s.
        pub turn_walk_s: f64 = 0.6, in 0.0..=10.0;
        /// Decay time of the mean rate, s.
        pub rate_time_s: [f64; 6] = [100.0, 100.0, 1.0, 1.0, 1.0, 5.0], in 0.1..=1e6;
        /// Minimum standard deviation of the motion outside the vessel's modes.
        pub residual_sd_m_rad: [f64; 6] = six([0.005, 0.005, 0.012], [0.35, 0.35, 0.2]), in 0.0..=1.0;
        /// Angular frequency of the residual motion until it is known, rad/s.
        pub residual_omega_radps: f64 = 3.0, in 0.5..=20.0;
        /// Damping ratio of the residual motion.
        pub residual_damping: f64 = 0.1, in 0.05..=0.95;
        /// Damping ratio of the residual motion in heave, tilt and heading while the modes are fresh: a prediction
        /// error fades within a quarter of a wave.
        pub residual_fresh_damping: f64 = 0.9, in 0.05..=0.95;
        /// Angular frequencies of the default oscillators, used until the vessel sends a wave model, rad/s.
        /// Source: same as the vessel model's broad default.
        pub bank_omega_radps: Vec<f64> = vec![0.8, 1.06, 1.41, 1.88, 2.5], in 0.1..=10.0;
        /// Damping ratio of the default oscillators.
        pub bank_damping: f64 = 0.1, in 1e-3..=0.95;
        /// Standard deviation of each default oscillator.
        pub bank_sd_m_rad: [f64; 6] = six([0.15, 0.15, 0.15], [2.0, 2.0, 0.5]), in 0.0..=10.0;
        /// Fraction of the vessel's stated variance that all its estimates have in common and that does not average
        /// out.
        pub radio_floor: f64 = 0.5, in 0.0..=10.0;
        /// Minimum standard deviation of a tag's position, m.
        /// Chosen: the error at close range; at long range the detector's own variance dominates.
        pub tag_min_sd_m: f64 = 0.003, in 1e-4..=1.0;
        /// Minimum standard deviation of a tag's attitude, rad.
        pub tag_min_sd_rad: f64 = f64::to_radians(0.6), in 1e-4..=1.0;
        /// Fraction of the drone's stated position variance that counts as vision noise. The rest cancels, because the
        /// drone's current position contains it as well.
        /// Chosen: tuned at Moderate.
        pub drone_variance_fraction: f64 = 0.0, in 0.0..=1.0;
        /// Error of vision as a fraction of the distance, constant over all detections, excluding the mount's error.
        /// Chosen: a tag of 71 px at 7 m appears 11 cm too near.
        pub vision_scale_sd: f64 = 0.012, in 0.0..=0.5;
        /// Position error of the camera's mount, m.
        /// Source: camera mounted with an error of 1 cm.
        pub camera_mount_sd_m: f64 = 0.01, in 0.0..=1.0;
        /// Minimum time between two rangefinder readings that are used, s.
        pub range_period_s: f64 = 0.04, in 0.0..=10.0;
        /// Minimum distance of the rangefinder's spot from the deck's edge, m.
        pub range_margin_m: f64 = 0.2, in 0.0..=10.0;
        /// Minimum standard deviation of a rangefinder reading, m.
        /// Source: rangefinder accuracy of 3 cm.
        pub range_min_sd_m: f64 = 0.03, in 1e-3..=1.0;
        /// Number of standard deviations beyond which innovations are rejected.
        pub gate_sd: f64 = 5.0, in 2.0..=20.0;
        /// Use the vessel's wave model.
        /// Source: switched off only for comparisons.
        pub use_wave_model: bool = true;
        /// Maximum age of the newest tag detection with which the vessel's estimates are used, s; 0: always.
        pub radio_after_vision_s: f64 = 0.0, in 0.0..=60.0;
        /// Time for which radio and vision count as fresh, s.
        pub fresh_s: f64 = 1.0, in 0.1..=10.0;
        /// Silence of both radio and vision after which no forecast is published, s.
        pub silence_s: f64 = 30.0, in 1.0..=600.0;
    }
}
