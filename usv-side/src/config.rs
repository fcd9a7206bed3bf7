use alight_shared::{
    config, geometry::DeckGeometry, surroundings::SurroundingsConfig, vessel_model::VesselModelConfig,
};

use crate::{advice::AdviceConfig, rate_control::RateControlConfig};

config! {
    /// Inertial sensor: position, noise and timeout.
    pub struct ImuConfig {
        /// Position in the vessel's body frame, m.
        /// Chosen: in the payload tray, off the centre line.
        pub lever_arm_m: [f64; 3] = [0.3, 0.1, -0.3], in -50.0..=50.0;
        /// White noise of the gyroscope per sample, rad/s.
        /// Source: Virtual RobotX WAM-V.
        pub gyro_sd_radps: f64 = 0.009, in 1e-6..=1.0;
        /// Standard deviation of the gyroscope's bias, rad/s.
        pub gyro_bias_sd_radps: f64 = 0.005, in 0.0..=1.0;
        /// White noise of the accelerometer per sample, m/s².
        pub accelerometer_sd_mps2: f64 = 0.021, in 1e-6..=10.0;
        /// Standard deviation of the accelerometer's bias including misalignment with the deck, m/s².
        /// Source: Virtual RobotX: 0.05; chosen for misalignment with the deck: 0.2 deg (a spirit level) of gravity.
        pub accelerometer_bias_sd_mps2: f64 = 0.06, in 0.0..=10.0;
        /// Correlation time of both biases, s.
        /// Chosen: much shorter than the drift of real biases. On a yawing vessel the filter would otherwise
        /// overrate its knowledge of them, because it does not keep the correlation of roll with pitch.
        pub bias_time_s: f64 = 300.0, in 1.0..=1e9;
        /// Time without a sample after which no estimate is published, s.
        /// Chosen: a fifth of a wave period.
        pub timeout_s: f64 = 1.0, in 0.05..=60.0;
    }
}

config! {
    /// GNSS receiver; each fix has its own standard deviations.
    pub struct GnssConfig {
        /// Antenna in the vessel's body frame, m.
        /// Chosen: on a mast behind and above the deck.
        pub antenna_m: [f64; 3] = [-0.8, 0.2, -2.0], in -50.0..=50.0;
        /// Standard deviation of the slow height error, m.
        /// Source: 1 m, correlated over 300 s.
        pub height_bias_sd_m: f64 = 1.0, in 0.0..=100.0;
        /// Correlation time of the height error, s.
        pub height_bias_time_s: f64 = 300.0, in 1.0..=1e6;
        /// Maximum age of a fix, s; older ones are rejected.
        /// Chosen: a late fix is compared with the state at its time, which is kept for 0.64 s; 1 Hz receivers at 4800
        /// baud are late by 0.3 to 0.6 s.
        pub max_age_s: f64 = 0.6, in 0.01..=1.0;
    }
}

config! {
    /// Heading sensor; each measurement has its own standard deviation.
    pub struct HeadingConfig {
        /// Standard deviation of the slow heading bias, deg.
        /// Chosen: compass deviation after a calibration.
        pub bias_sd_deg: f64 = 0.5, in 0.0..=45.0;
        /// Correlation time of the bias, s.
        pub bias_time_s: f64 = 300.0, in 1.0..=1e9;
        /// Maximum age of a measurement, s; older ones are rejected.
        pub max_age_s: f64 = 0.3, in 0.01..=1.0;
    }
}

config! {
    /// Rates of the vessel's messages.
    pub struct BroadcastConfig {
        /// Rate of state estimates, Hz.
        pub estimate_hz: f64 = 30.0, in 1.0..=100.0;
        /// Rate of wave models, Hz.
        pub wave_hz: f64 = 5.0, in 0.1..=50.0;
        /// Rate of predictions, Hz.
        pub prediction_hz: f64 = 1.0, in 0.1..=50.0;
        /// Interval between stages of a prediction, s.
        /// Chosen: 15 stages reach 2.8 s, beyond the planner's horizon of 2 s.
        pub prediction_step_s: f64 = 0.2, in 0.02..=2.0;
        /// Reduction of message rates on a congested link.
        pub rate_control: RateControlConfig;
    }
}

config! {
    /// Configuration of the vessel's node.
    pub struct VesselNodeConfig {
        /// Parameters of the wave-augmented model.
        pub model: VesselModelConfig;
        /// Landing deck.
        pub deck: DeckGeometry;
        /// Obstacles around the deck, and permitted flight directions.
        pub surroundings: SurroundingsConfig;
        /// Inertial sensor.
        pub imu: ImuConfig;
        /// GNSS receiver.
        pub gnss: GnssConfig;
        /// Heading sensor.
        pub heading: HeadingConfig;
        /// Rates of the vessel's messages.
        pub broadcast: BroadcastConfig;
        /// Limits on the advised course set by the skipper.
        pub advice: AdviceConfig;
    }
    check |this, at| {
        this.surroundings.check_deck(&this.deck, &at.table("surroundings"))?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keep_out_volume_over_the_own_deck() {
        let text =
            "[deck]\ncentre_m = [-4.0, 0.0, -1.0]\n[surroundings]\nkeep_out_m = [[[-3, 0, -4], [-2, 1, 0]]]";
        let e = config::parse::<VesselNodeConfig>(text, "test")
            .unwrap_err()
            .to_string();
        assert!(
            e.contains("`surroundings.keep_out_m[0]` is [[-3.0, 0.0, -4.0]"),
            "{e}"
        );
        assert!(config::parse::<VesselNodeConfig>(&text.replace("-4.0", "4.0"), "test").is_ok());
    }
}
