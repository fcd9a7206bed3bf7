//! True parameters of the drone; nodes do not receive them.

use alight_shared::config;
use alight_uav::autopilot::modes::Firmware;
use serde::{Deserialize, Serialize};

use super::frame::RotorFrame;

config! {
    /// Airframe, contact, wind, autopilot and navigation of the simulated drone.
    pub struct DroneConfig {
        /// Rotors, drag and unknown errors of mass and thrust.
        pub airframe: AirframeConfig;
        /// Feet and deck surface.
        pub contact: ContactConfig;
        /// Mean wind and gusts.
        pub wind: WindConfig;
        /// Control loops and failsafes of the autopilot.
        pub autopilot: AutopilotConfig;
        /// Sensors and state estimator of the autopilot.
        pub navigation: NavigationConfig;
    }
}

config! {
    /// Rotors, drag and unknown errors of mass and thrust.
    pub struct AirframeConfig {
        /// Rotor layout: quad-x or hexa-x.
        pub frame: RotorFrame = RotorFrame::QuadX;
        /// True mass relative to the nominal mass, before the random error of the seed.
        pub mass_factor: f64 = 1.0, in 0.3..=2.0;
        /// True thrust relative to the nominal thrust, before the random error of the seed.
        pub thrust_factor: f64 = 1.0, in 0.3..=2.0;
        /// Bound of the relative error of the true mass, drawn uniformly per seed.
        /// Source: +-5 %, unknown to the nodes.
        pub mass_error: f64 = 0.05, in 0.0..=0.5;
        /// Bound of the relative error of the true thrust, drawn uniformly per seed.
        /// Source: +-5 %, unknown to the nodes.
        pub thrust_error: f64 = 0.05, in 0.0..=0.5;
        /// First-order lag of the rotor speed, s.
        /// Source: Ctu-mrs t650.
        pub rotor_lag_s: f64 = 0.03, in 0.002..=0.5;
        /// Idle thrust of a running rotor, as a fraction of its maximum thrust.
        /// Source: (875 / 5832 rpm)², ctu-mrs t650.
        pub idle_thrust: f64 = 0.0225, in 0.0..=0.2;
        /// Quadratic drag on the velocity relative to the air, N/(m/s)².
        /// Source: Ctu-mrs t650.
        pub drag_n_per_mps2: f64 = 0.0995, in 0.0..=10.0;
        /// Quadratic drag of a parked drone with stopped rotors, N/(m/s)².
        /// Source: sum over the body's parts (Hoerner 1965, sections 3 and 8), in air of 1.225 kg/m³: body 0.24 x 0.15
        /// m (1.05), four legs and four arms at an angle, 16 and 25 mm (1.2, cross-flow), motors and blades: 0.082 m².
        pub parked_drag_n_per_mps2: f64 = 0.05, in 0.0..=10.0;
        /// Radius of a rotor disc, m; 0 disables the ground effect.
        /// Source: 15 inch propeller of the Tarot T650.
        pub rotor_radius_m: f64 = 0.19, in 0.0..=2.0;
        /// Height of the rotor discs above the centre of mass, m.
        pub rotor_above_m: f64 = 0.05, in -1.0..=1.0;
    }
}

config! {
    /// Feet and deck surface.
    pub struct ContactConfig {
        /// Coefficient of friction between drone and deck.
        pub friction: f64 = 0.4, in 0.0..=5.0;
        /// Coefficient of restitution.
        pub restitution: f64 = 0.3, in 0.0..=0.95;
        /// Radius of a foot, m.
        /// Chosen: the rubber foot of a leg.
        pub foot_radius_m: f64 = 0.015, in 0.005..=0.2;
        /// Thickness of the deck, m.
        pub deck_thickness_m: f64 = 0.30, in 0.05..=2.0;
    }
}

config! {
    /// Mean wind and gusts.
    pub struct WindConfig {
        /// Mean wind speed U10, 10 m above the water, m/s; the wind profile reduces it below that height.
        /// Source: the paper's simulations have no wind.
        pub mean_mps: f64 = 0.0, in 0.0..=30.0;
        /// Direction towards which the wind blows, deg from north towards east; drawn per seed if missing.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub to_deg: Option<f64> = None;
        /// The wind blows in the direction of the waves; overrides `to_deg`.
        pub with_waves: bool = false;
        /// Dryden gusts on the mean wind.
        pub gusts: bool = true;
    }
    check |this, at| {
        at.range("to_deg", this.to_deg.unwrap_or(0.0), -360.0, 360.0)?;
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LossAction {
    #[default]
    Hold,
    /// Land at the present position.
    Land,
    /// Return to the start position and land there.
    Return,
}

config! {
    /// Control loops and failsafes of the autopilot, after PX4 1.16 (parameter names under "Source").
    pub struct AutopilotConfig {
        /// Imitated firmware: px4 or ardupilot. ardupilot has its own position and velocity gains and no `loss_action`.
        pub firmware: Firmware = Firmware::Px4;
        /// Time constant of the response to a tilt set-point, s; if missing, the firmware's. PX4: inverse of
        /// the attitude loop's gain. ArduCopter: time constant of the input shaping (ATC_INPUT_TC).
        /// Source: fits to flights of PX4 main of March 2026 (0.10 s) and of ArduCopter 4.7-dev (0.15 s).
        #[serde(skip_serializing_if = "Option::is_none")]
        pub attitude_lag_s: Option<f64> = None;
        /// Dead time of attitude and thrust set-points in the autopilot, in addition to the wire's delay, s.
        pub dead_time_s: f64 = 0.0, in 0.0..=0.5;
        /// Gain of the heading loop, 1/s.
        /// Source: MC_YAW_P.
        pub yaw_gain_hz: f64 = 2.8, in 0.1..=10.0;
        /// Weight of heading relative to tilt.
        /// Source: MC_YAW_WEIGHT.
        pub yaw_weight: f64 = 0.4, in 0.05..=1.0;
        /// Bandwidth of the roll and pitch rate loops, 1/s.
        /// Source: MC_ROLLRATE_P in units of angular acceleration.
        pub rate_gain_hz: f64 = 20.0, in 2.0..=40.0;
        /// Bandwidth of the yaw rate loop, 1/s.
        /// Chosen: limited by the rotors' drag moment.
        pub yaw_rate_gain_hz: f64 = 8.0, in 1.0..=40.0;
        /// Integral gain of the rate loop, 1/s².
        pub rate_integral_hz2: f64 = 15.0, in 0.0..=200.0;
        /// Limit of roll and pitch rate set-points, rad/s.
        /// Source: MC_ROLLRATE_MAX 220 deg/s.
        pub max_rate_rps: f64 = 3.84, in 0.2..=30.0;
        /// Limit of the heading rate, rad/s.
        /// Source: MPC_MAN_Y_MAX, MPC_YAWRAUTO_MAX 60 deg/s.
        pub max_yaw_rate_rps: f64 = 1.05, in 0.1..=10.0;
        /// Gain from horizontal position error to velocity, 1/s.
        /// Source: MPC_XY_P.
        pub position_gain_hz: f64 = 0.95, in 0.05..=5.0;
        /// Gain from height error to velocity, 1/s.
        /// Source: MPC_Z_P.
        pub height_gain_hz: f64 = 1.0, in 0.05..=5.0;
        /// Horizontal velocity loop: proportional 1/s, integral 1/s², derivative.
        /// Source: MPC_XY_VEL_{P,I,D}_ACC.
        pub velocity_pid: [f64; 3] = [1.8, 0.4, 0.2], in 0.0..=20.0;
        /// Vertical velocity loop: proportional 1/s, integral 1/s², derivative.
        /// Source: MPC_Z_VEL_{P,I,D}_ACC.
        pub climb_pid: [f64; 3] = [4.0, 2.0, 0.0], in 0.0..=20.0;
        /// Limit of the horizontal velocity set-point, m/s.
        /// Source: MPC_XY_VEL_MAX.
        pub max_speed_mps: f64 = 12.0, in 0.5..=40.0;
        /// Limits of the vertical velocity set-point: up, down, m/s.
        /// Source: the paper's |vz| <= 4 m/s (PX4's MPC_Z_VEL_MAX_* raised to it).
        pub max_climb_mps: [f64; 2] = [4.0, 4.0], in 0.1..=20.0;
        /// Maximum tilt that position control commands, deg.
        /// Source: MPC_TILTMAX_AIR.
        pub max_tilt_deg: f64 = 45.0, in 5.0..=80.0;
        /// Minimum collective thrust that position control commands, 0 to 1.
        /// Source: MPC_THR_MIN.
        pub min_thrust: f64 = 0.12, in 0.0..=0.5;
        /// Compute tilt from the horizontal acceleration alone, as PX4 does; if false, from the full vector.
        /// Source: MPC_ACC_DECOUPLE.
        pub decouple_vertical: bool = true;
        /// Time without a set-point until the failsafe acts, s.
        /// Source: COM_OF_LOSS_T (PX4's default is 1.0). Until the failsafe acts, a drone continues to sink: with the
        /// pilot process frozen for 2 s in descent or flare, 100 seeds had 11 hard contacts at 0.5 s, and 3 at 0.25 s.
        pub loss_after_s: f64 = 0.25, in 0.02..=60.0;
        /// Action of the failsafe.
        /// Source: COM_OBL_RC_ACT.
        pub loss_action: LossAction = LossAction::Hold;
        /// Deceleration at the start of a hold: horizontal, vertical, m/s².
        /// Source: MPC_ACC_HOR; MPC_ACC_UP_MAX, raised above PX4's default of 4 and reduced by the effect of
        /// its jerk limit. With the pilot process frozen for 2 s in descent, 74 cases had 3 hard contacts of
        /// up to 2.2 m/s at 3 m/s², and 1 of 1.3 m/s at 6 m/s².
        pub stop_mps2: [f64; 2] = [3.0, 6.0], in 0.5..=15.0;
        /// Speed of the autopilot's own landing, m/s.
        /// Source: MPC_LAND_SPEED.
        pub land_mps: f64 = 0.7, in 0.1..=5.0;
        /// Height of the `Return` mode above the datum of the start, m.
        /// Source: RTL_RETURN_ALT.
        pub return_height_m: f64 = 30.0, in 1.0..=500.0;
        /// Time constant of the hover thrust estimate, s.
        /// Chosen: converges like PX4's hover thrust estimator.
        pub hover_thrust_s: f64 = 2.0, in 0.1..=100.0;
        /// Initial hover thrust estimate relative to the true hover thrust.
        pub initial_hover_factor: f64 = 1.0, in 0.4..=2.0;
        /// One-way delay of the wire to the drone's computer, s.
        /// Source: an ODOMETRY of 244 bytes takes 2.6 ms at 921 600 baud.
        pub wire_s: f64 = 0.003, in 0.0..=0.5;
        /// Maximum of the uniformly distributed addition to the wire's delay, s.
        pub wire_jitter_s: f64 = 0.001, in 0.0..=0.5;
        /// Charge of the battery at the start, 0 to 1.
        pub battery: f64 = 0.9, in 0.0..=1.0;
        /// Hover time with a full battery, s.
        pub endurance_s: f64 = 1500.0, in 10.0..=1e6;
    }
    check |this, at| {
        at.range("attitude_lag_s", this.attitude_lag_s(), 0.04, 1.0)?;
    }
}

impl AutopilotConfig {
    pub fn attitude_lag_s(&self) -> f64 {
        self.attitude_lag_s.unwrap_or(match self.firmware {
            Firmware::Px4 => 0.10,
            Firmware::ArduCopter => 0.15,
        })
    }
    /// Replaces the gains by ArduCopter's if it is the firmware (PSC_POSXY_P, PSC_VELXY_*, PSC_VELZ_P; in
    /// units of acceleration).
    pub fn with_gains_of_firmware(&self) -> AutopilotConfig {
        match self.firmware {
            Firmware::Px4 => self.clone(),
            Firmware::ArduCopter => AutopilotConfig {
                position_gain_hz: 1.0,
                velocity_pid: [2.0, 1.0, 0.25],
                climb_pid: [5.0, 2.0, 0.0],
                decouple_vertical: false,
                ..self.clone()
            },
        }
    }
}

config! {
    /// The autopilot's sensors and state estimator.
    pub struct NavigationConfig {
        /// Standard deviation of the slow GNSS error, m.
        pub gnss_bias_m: f64 = 1.0, in 0.0..=100.0;
        /// Correlation time of the slow GNSS error, s.
        pub gnss_bias_s: f64 = 300.0, in 1.0..=1e5;
        /// Standard deviation of the barometer's drift relative to GNSS height in ten minutes, m.
        /// Source: static pressure drifts by 0.1 to 0.3 hPa in ten minutes (8 m per hPa), and wind adds
        /// errors of similar size.
        pub barometer_drift_m: f64 = 0.0, in 0.0..=100.0;
        /// White GNSS position error, m.
        pub gnss_noise_m: f64 = 0.3, in 0.001..=50.0;
        /// White GNSS velocity error, m/s.
        pub gnss_velocity_mps: f64 = 0.1, in 0.001..=10.0;
        /// Report the height above the ellipsoid in addition (`alt_ellipsoid` of `GPS_RAW_INT`).
        pub gnss_ellipsoid: bool = true;
        /// GNSS rate, Hz.
        pub gnss_hz: f64 = 10.0, in 1.0..=50.0;
        /// White gyro noise per 100 Hz sample, rad/s.
        /// Chosen: ICM-42688 with vibration.
        pub gyro_noise_rps: f64 = 0.005, in 0.0..=0.5;
        /// Standard deviation of the constant gyro bias, rad/s.
        /// Chosen: bias that remains after the estimator's correction.
        pub gyro_bias_rps: f64 = 0.002, in 0.0..=0.5;
        /// White accelerometer noise per 100 Hz sample with the motors off, m/s².
        /// Chosen: ICM-42688.
        pub accelerometer_noise_mps2: f64 = 0.03, in 0.0..=10.0;
        /// Standard deviation of the constant accelerometer bias, m/s².
        /// Source: VRX.
        pub accelerometer_bias_mps2: f64 = 0.05, in 0.0..=5.0;
        /// Additional white noise per 100 Hz sample from vibration at full thrust, m/s².
        /// Chosen: 0.3 m/s² in hover.
        pub vibration_mps2: f64 = 0.8, in 0.0..=50.0;
        /// Range of the accelerometer, m/s².
        /// Source: 16 g.
        pub accelerometer_range_mps2: f64 = 156.9, in 20.0..=1e3;
        /// Standard deviation of the slow roll and pitch error, deg.
        pub tilt_error_deg: f64 = 0.3, in 0.0..=10.0;
        /// Correlation time of the tilt error, s.
        pub tilt_error_s: f64 = 30.0, in 0.1..=1e5;
        /// Standard deviation of the slow heading error, deg.
        pub heading_error_deg: f64 = 1.0, in 0.0..=45.0;
        /// Correlation time of the heading error, s.
        pub heading_error_s: f64 = 300.0, in 0.1..=1e5;
        /// Heading error caused by the hull's steel at 1 m from the deck's centre, deg. It decreases with the
        /// third power of distance; the gyroscopes delay its effect by seconds.
        /// Source: field of a dipole (Jackson 1999, eq. 5.56): hull plates of 100 A m² deflect a compass by
        /// 20 deg at 1 m.
        pub steel_heading_deg: f64 = 0.0, in 0.0..=90.0;
        /// White error of each attitude angle, deg.
        pub attitude_noise_deg: f64 = 0.05, in 0.0..=5.0;
    }
}

impl NavigationConfig {
    pub fn without_errors() -> NavigationConfig {
        NavigationConfig {
            gnss_bias_m: 0.0,
            gnss_noise_m: 0.001,
            gnss_velocity_mps: 0.001,
            gyro_noise_rps: 0.0,
            gyro_bias_rps: 0.0,
            accelerometer_noise_mps2: 0.001,
            accelerometer_bias_mps2: 0.0,
            accelerometer_range_mps2: 1e3,
            vibration_mps2: 0.0,
            tilt_error_deg: 0.0,
            heading_error_deg: 0.0,
            attitude_noise_deg: 0.0,
            ..NavigationConfig::default()
        }
    }
}
