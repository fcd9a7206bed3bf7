//! The drone's true parameters, which no node sees.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

/// Airframe, contact, wind, autopilot and navigation of the simulated drone.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DroneConfig {
    /// Rotors, drag and unknown errors of mass and thrust.
    pub airframe: AirframeConfig,
    /// Feet and deck surface.
    pub contact: ContactConfig,
    /// Mean wind and gusts.
    pub wind: WindConfig,
    /// The autopilot's control loops and failsafes.
    pub autopilot: AutopilotConfig,
    /// The autopilot's sensors and state estimator.
    pub navigation: NavigationConfig,
}

/// Rotors, drag and unknown errors of mass and thrust.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AirframeConfig {
    /// The true mass as a multiple of the nominal one, before the error drawn per seed.
    pub mass_factor: f64,
    /// The same of the true thrust.
    pub thrust_factor: f64,
    /// Bound of the relative error of the true mass, drawn uniformly per seed.
    pub mass_error: f64,
    /// Bound of the relative error of the true thrust, drawn uniformly per seed.
    pub thrust_error: f64,
    /// First-order lag of the rotor speed, s.
    pub rotor_lag_s: f64,
    /// Idle thrust of a running rotor as a fraction of its greatest.
    pub idle_thrust: f64,
    /// Quadratic drag on the velocity relative to the air, N/(m/s)².
    pub drag_n_per_mps2: f64,
    /// Radius of a rotor disc, m; 0 switches the ground effect off.
    pub rotor_radius_m: f64,
    /// Height of the rotor discs above the centre of mass, m.
    pub rotor_above_m: f64,
}

impl Default for AirframeConfig {
    fn default() -> Self {
        AirframeConfig {
            mass_factor: 1.0,
            thrust_factor: 1.0,
            mass_error: 0.05,        // issue: +-5 % unknown to the nodes
            thrust_error: 0.05,      // issue: +-5 % unknown to the nodes
            rotor_lag_s: 0.03,       // ctu-mrs t650
            idle_thrust: 0.0225,     // (875 / 5832 rpm)², ctu-mrs t650
            drag_n_per_mps2: 0.0995, // ctu-mrs t650
            rotor_radius_m: 0.19,    // 15 inch propeller of the Tarot T650
            rotor_above_m: 0.05,     // ours
        }
    }
}
impl Check for AirframeConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("mass_factor", self.mass_factor, 0.3, 2.0)?;
        at.range("thrust_factor", self.thrust_factor, 0.3, 2.0)?;
        at.range("mass_error", self.mass_error, 0.0, 0.5)?;
        at.range("thrust_error", self.thrust_error, 0.0, 0.5)?;
        at.range("rotor_lag_s", self.rotor_lag_s, 0.002, 0.5)?;
        at.range("idle_thrust", self.idle_thrust, 0.0, 0.2)?;
        at.range("drag_n_per_mps2", self.drag_n_per_mps2, 0.0, 10.0)?;
        at.range("rotor_radius_m", self.rotor_radius_m, 0.0, 2.0)?;
        at.range("rotor_above_m", self.rotor_above_m, -1.0, 1.0)
    }
}

/// Feet and deck surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ContactConfig {
    /// Coefficient of friction between drone and deck.
    pub friction: f64,
    /// Coefficient of restitution.
    pub restitution: f64,
    /// Radius of a foot, m.
    pub foot_radius_m: f64,
    /// Thickness of the deck, m.
    pub deck_thickness_m: f64,
}

impl Default for ContactConfig {
    fn default() -> Self {
        ContactConfig {
            friction: 0.4,          // issue
            restitution: 0.3,       // issue
            foot_radius_m: 0.015,   // ours: a leg's rubber end
            deck_thickness_m: 0.30, // ours
        }
    }
}
impl Check for ContactConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("friction", self.friction, 0.0, 5.0)?;
        at.range("restitution", self.restitution, 0.0, 0.95)?;
        at.range("foot_radius_m", self.foot_radius_m, 0.005, 0.2)?;
        at.range("deck_thickness_m", self.deck_thickness_m, 0.05, 2.0)
    }
}

/// Mean wind and gusts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindConfig {
    /// Mean wind speed 6 m above the water, m/s.
    pub mean_mps: f64,
    /// Direction it blows to, deg from north towards east; drawn per seed when missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to_deg: Option<f64>,
    /// Dryden gusts on the mean wind.
    pub gusts: bool,
}

impl Default for WindConfig {
    fn default() -> Self {
        WindConfig {
            mean_mps: 0.0, // the paper's simulations have no wind
            to_deg: None,
            gusts: true,
        }
    }
}
impl Check for WindConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("mean_mps", self.mean_mps, 0.0, 30.0)?;
        at.range("to_deg", self.to_deg.unwrap_or(0.0), -360.0, 360.0)
    }
}

/// What the autopilot does when set-points stop coming.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LossAction {
    /// Brake and hold position.
    #[default]
    Hold,
    /// Land where it is.
    Land,
    /// Fly back to the start and land there.
    Return,
}

/// The autopilot's control loops and failsafes, after PX4 1.16 (parameter names in comments).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AutopilotConfig {
    /// Lag with which a tilt set-point is followed, s: the gain of the attitude loop is its inverse.
    pub attitude_lag_s: f64,
    /// Uses the body rates of an attitude set-point as feed-forward.
    pub use_rates: bool,
    /// Gain of the heading loop, 1/s.
    pub yaw_gain_hz: f64,
    /// Weight of heading against tilt.
    pub yaw_weight: f64,
    /// Bandwidth of the rate loop of roll and pitch, 1/s.
    pub rate_gain_hz: f64,
    /// The same of yaw, 1/s.
    pub yaw_rate_gain_hz: f64,
    /// Integral gain of the rate loop, 1/s².
    pub rate_integral_hz2: f64,
    /// Limit of roll and pitch rate set-points, rad/s.
    pub max_rate_rps: f64,
    /// Limit of the heading rate, rad/s.
    pub max_yaw_rate_rps: f64,
    /// Gain from horizontal position error to velocity, 1/s.
    pub position_gain_hz: f64,
    /// Gain from height error to velocity, 1/s.
    pub height_gain_hz: f64,
    /// Horizontal velocity loop: proportional 1/s, integral 1/s², derivative.
    pub velocity_pid: [f64; 3],
    /// Vertical velocity loop: proportional 1/s, integral 1/s², derivative.
    pub climb_pid: [f64; 3],
    /// Limit of the horizontal velocity set-point, m/s.
    pub max_speed_mps: f64,
    /// Limits of the vertical velocity set-point: up, down, m/s.
    pub max_climb_mps: [f64; 2],
    /// Greatest tilt that position control commands, deg.
    pub max_tilt_deg: f64,
    /// Least collective thrust that position control commands, 0 to 1.
    pub min_thrust: f64,
    /// Tilt from the horizontal acceleration alone, as PX4 does; else from the whole vector.
    pub decouple_vertical: bool,
    /// Without a set-point for this long the failsafe acts, s.
    pub loss_after_s: f64,
    /// What the failsafe does.
    pub loss_action: LossAction,
    /// Deceleration with which it comes to rest when it begins to hold: horizontally, vertically, m/s².
    pub stop_mps2: [f64; 2],
    /// Speed of the autopilot's own landing, m/s.
    pub land_mps: f64,
    /// Height above the start's datum that `Return` flies at, m.
    pub return_height_m: f64,
    /// Time constant of the hover thrust estimate, s.
    pub hover_thrust_s: f64,
    /// Battery at the start, 0 to 1.
    pub battery: f64,
    /// Hover time that a full battery gives, s.
    pub endurance_s: f64,
}

impl Default for AutopilotConfig {
    fn default() -> Self {
        AutopilotConfig {
            attitude_lag_s: 0.2,           // issue; PX4 0.18 to 0.32 s, ArduCopter 0.21 s (measured)
            use_rates: false,              // PX4 drops the rates when an attitude is given
            yaw_gain_hz: 2.8,              // MC_YAW_P
            yaw_weight: 0.4,               // MC_YAW_WEIGHT
            rate_gain_hz: 20.0,            // MC_ROLLRATE_P in units of angular acceleration
            yaw_rate_gain_hz: 8.0,         // ours: what the rotors' drag moment allows
            rate_integral_hz2: 15.0,       // ours
            max_rate_rps: 3.84,            // MC_ROLLRATE_MAX 220 deg/s
            max_yaw_rate_rps: 1.05,        // MPC_MAN_Y_MAX, MPC_YAWRAUTO_MAX 60 deg/s
            position_gain_hz: 0.95,        // MPC_XY_P
            height_gain_hz: 1.0,           // MPC_Z_P
            velocity_pid: [1.8, 0.4, 0.2], // MPC_XY_VEL_{P,I,D}_ACC
            climb_pid: [4.0, 2.0, 0.0],    // MPC_Z_VEL_{P,I,D}_ACC
            max_speed_mps: 12.0,           // MPC_XY_VEL_MAX
            max_climb_mps: [4.0, 4.0],     // the paper's |vz| <= 4 m/s (PX4's MPC_Z_VEL_MAX_* raised to it)
            max_tilt_deg: 45.0,            // MPC_TILTMAX_AIR
            min_thrust: 0.12,              // MPC_THR_MIN
            decouple_vertical: true,       // MPC_ACC_DECOUPLE
            // COM_OF_LOSS_T (PX4's default is 1.0): what flies on without its pilot flies on sinking. With
            // the pilot frozen for 2 s in descent or flare, 100 seeds: 11 hard contacts at 0.5 s, 3 at 0.25 s.
            loss_after_s: 0.25,
            loss_action: LossAction::Hold, // COM_OBL_RC_ACT
            // MPC_ACC_HOR; MPC_ACC_UP_MAX (PX4's default is 4) raised, less what its jerk limit takes. With the
            // pilot frozen for 2 s in descent, 74 cases: 3 hard contacts up to 2.2 m/s at 3 m/s², 1 of 1.3 m/s
            // at 6 m/s².
            stop_mps2: [3.0, 6.0],
            land_mps: 0.7,         // MPC_LAND_SPEED
            return_height_m: 30.0, // RTL_RETURN_ALT
            hover_thrust_s: 2.0,   // ours: settles as PX4's hover thrust estimator does
            battery: 0.9,          // ours
            endurance_s: 1500.0,   // ours
        }
    }
}
impl Check for AutopilotConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("attitude_lag_s", self.attitude_lag_s, 0.08, 1.0)?;
        for (key, v, low, high) in [
            ("yaw_gain_hz", self.yaw_gain_hz, 0.1, 10.0),
            ("yaw_weight", self.yaw_weight, 0.05, 1.0),
            ("rate_gain_hz", self.rate_gain_hz, 2.0, 40.0),
            ("yaw_rate_gain_hz", self.yaw_rate_gain_hz, 1.0, 40.0),
            ("rate_integral_hz2", self.rate_integral_hz2, 0.0, 200.0),
            ("max_rate_rps", self.max_rate_rps, 0.2, 30.0),
            ("max_yaw_rate_rps", self.max_yaw_rate_rps, 0.1, 10.0),
            ("position_gain_hz", self.position_gain_hz, 0.05, 5.0),
            ("height_gain_hz", self.height_gain_hz, 0.05, 5.0),
            ("max_speed_mps", self.max_speed_mps, 0.5, 40.0),
            ("max_tilt_deg", self.max_tilt_deg, 5.0, 80.0),
            ("min_thrust", self.min_thrust, 0.0, 0.5),
            ("loss_after_s", self.loss_after_s, 0.02, 60.0),
            ("land_mps", self.land_mps, 0.1, 5.0),
            ("return_height_m", self.return_height_m, 1.0, 500.0),
            ("hover_thrust_s", self.hover_thrust_s, 0.1, 100.0),
            ("battery", self.battery, 0.0, 1.0),
            ("endurance_s", self.endurance_s, 10.0, 1e6),
        ] {
            at.range(key, v, low, high)?;
        }
        at.ranges("stop_mps2", &self.stop_mps2, 0.5, 15.0)?;
        at.ranges("velocity_pid", &self.velocity_pid, 0.0, 20.0)?;
        at.ranges("climb_pid", &self.climb_pid, 0.0, 20.0)?;
        at.ranges("max_climb_mps", &self.max_climb_mps, 0.1, 20.0)
    }
}

/// The autopilot's sensors and state estimator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NavigationConfig {
    /// Standard deviation of the slow GNSS error, m.
    pub gnss_bias_m: f64,
    /// Correlation time of the slow GNSS error, s.
    pub gnss_bias_s: f64,
    /// White GNSS position error, m.
    pub gnss_noise_m: f64,
    /// White GNSS velocity error, m/s.
    pub gnss_velocity_mps: f64,
    /// GNSS rate, Hz.
    pub gnss_hz: f64,
    /// White gyro noise per 100 Hz sample, rad/s.
    pub gyro_noise_rps: f64,
    /// Standard deviation of the constant gyro bias, rad/s.
    pub gyro_bias_rps: f64,
    /// White accelerometer noise per 100 Hz sample with the motors off, m/s².
    pub accelerometer_noise_mps2: f64,
    /// Standard deviation of the constant accelerometer bias, m/s².
    pub accelerometer_bias_mps2: f64,
    /// Additional white noise per 100 Hz sample by vibration at full thrust, m/s².
    pub vibration_mps2: f64,
    /// Range of the accelerometer, m/s².
    pub accelerometer_range_mps2: f64,
    /// Slow error of roll and pitch, deg, and its correlation time, s.
    pub tilt_error_deg: f64,
    /// Correlation time of the tilt error, s.
    pub tilt_error_s: f64,
    /// Slow error of heading, deg.
    pub heading_error_deg: f64,
    /// Correlation time of the heading error, s.
    pub heading_error_s: f64,
    /// White error of each attitude angle, deg.
    pub attitude_noise_deg: f64,
}

impl Default for NavigationConfig {
    fn default() -> Self {
        NavigationConfig {
            gnss_bias_m: 1.0,                // issue
            gnss_bias_s: 300.0,              // issue
            gnss_noise_m: 0.3,               // issue
            gnss_velocity_mps: 0.1,          // issue
            gnss_hz: 10.0,                   // issue
            gyro_noise_rps: 0.005,           // ours: an ICM-42688 with vibration
            gyro_bias_rps: 0.002,            // ours: what is left after the estimator's correction
            accelerometer_noise_mps2: 0.03,  // ours: ICM-42688
            accelerometer_bias_mps2: 0.05,   // VRX
            vibration_mps2: 0.8,             // ours: 0.3 m/s² in hover
            accelerometer_range_mps2: 156.9, // 16 g
            tilt_error_deg: 0.3,             // ours
            tilt_error_s: 30.0,              // ours
            heading_error_deg: 1.0,          // issue
            heading_error_s: 300.0,          // ours
            attitude_noise_deg: 0.05,        // ours
        }
    }
}
impl Check for NavigationConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        for (key, v, low, high) in [
            ("gnss_bias_m", self.gnss_bias_m, 0.0, 100.0),
            ("gnss_bias_s", self.gnss_bias_s, 1.0, 1e5),
            ("gnss_noise_m", self.gnss_noise_m, 0.001, 50.0),
            ("gnss_velocity_mps", self.gnss_velocity_mps, 0.001, 10.0),
            ("gnss_hz", self.gnss_hz, 1.0, 50.0),
            ("gyro_noise_rps", self.gyro_noise_rps, 0.0, 0.5),
            ("gyro_bias_rps", self.gyro_bias_rps, 0.0, 0.5),
            (
                "accelerometer_noise_mps2",
                self.accelerometer_noise_mps2,
                0.0,
                10.0,
            ),
            ("accelerometer_bias_mps2", self.accelerometer_bias_mps2, 0.0, 5.0),
            ("vibration_mps2", self.vibration_mps2, 0.0, 50.0),
            (
                "accelerometer_range_mps2",
                self.accelerometer_range_mps2,
                20.0,
                1e3,
            ),
            ("tilt_error_deg", self.tilt_error_deg, 0.0, 10.0),
            ("tilt_error_s", self.tilt_error_s, 0.1, 1e5),
            ("heading_error_deg", self.heading_error_deg, 0.0, 45.0),
            ("heading_error_s", self.heading_error_s, 0.1, 1e5),
            ("attitude_noise_deg", self.attitude_noise_deg, 0.0, 5.0),
        ] {
            at.range(key, v, low, high)?;
        }
        Ok(())
    }
}

impl Check for DroneConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.airframe.check(&at.table("airframe"))?;
        self.contact.check(&at.table("contact"))?;
        self.wind.check(&at.table("wind"))?;
        self.autopilot.check(&at.table("autopilot"))?;
        self.navigation.check(&at.table("navigation"))
    }
}
