use alight_shared::{
    config,
    frames::{TrueNed, Vector, VesselBody},
    geometry::GRAVITY,
    msg::ImuSample,
    time::{Time, TrueTime, VesselClock},
};
use nalgebra::{UnitQuaternion, Vector3};

use super::{
    noise::{GaussMarkovError, Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// Inertial measurement unit of the vessel.
    pub struct VesselImuConfig {
        /// Measurements per second.
        /// Source: Procházka 2024, IMU at 100 Hz.
        pub rate_hz: f64 = 100.0, in 1.0..=100.0;
        /// Delay from measurement to arrival at the estimator, s.
        /// Chosen: shorter than one step of the estimator.
        pub latency_s: f64 = 0.0, in 0.0..=2.0;
        /// Position in the vessel's body frame, as configured in the estimator, m.
        /// Chosen: in the payload tray, off centre.
        pub lever_arm_m: [f64; 3] = [0.3, 0.1, -0.3], in -50.0..=50.0;
        /// Standard deviation of the error of `lever_arm_m`, per axis, drawn per seed, m.
        /// Chosen: measured with a tape and a spirit level.
        pub lever_arm_error_sd_m: f64 = 0.01, in 0.0..=1.0;
        /// Standard deviation of the misalignment with the hull, per axis, drawn per seed, deg.
        pub alignment_sd_deg: f64 = 0.2, in 0.0..=20.0;
        /// White noise of the gyroscope, per axis and sample, rad/s.
        /// Source: Virtual RobotX WAM-V.
        pub gyro_white_sd_radps: f64 = 0.009, in 0.0..=1.0;
        /// Standard deviation of the gyroscope's bias, per axis, rad/s.
        pub gyro_bias_sd_radps: f64 = 0.005, in 0.0..=1.0;
        /// White noise of the accelerometer, per axis and sample, m/s².
        pub accelerometer_white_sd_mps2: f64 = 0.021, in 0.0..=10.0;
        /// Standard deviation of the accelerometer's bias, per axis, m/s².
        pub accelerometer_bias_sd_mps2: f64 = 0.05, in 0.0..=10.0;
        /// Correlation time of both biases, s.
        /// Chosen: biases are almost constant during a landing.
        pub bias_correlation_s: f64 = 3600.0, in 1.0..=1e9;
        /// Probability that a sample is missing.
        pub dropout: f64 = 0.0, in 0.0..=1.0;
        /// Windows `[start, end)` without samples, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

/// Angular rate (rad/s) and specific force `R' (a - g)` (m/s²) that an ideal sensor at the reference point
/// measures in the body frame (Groves 2013, section 4.1).
pub fn inertial<B>(state: &RigidState<B>) -> (Vector3<f64>, Vector3<f64>) {
    let gravity = Vector::<TrueNed>::new(0.0, 0.0, GRAVITY);
    let force = state.attitude.inverse() * (state.acceleration - gravity);
    (state.rates.0, force.0)
}

#[derive(Clone, Debug)]
pub(super) struct VesselImu {
    config: VesselImuConfig,
    lever_arm: Vector3<f64>,
    /// Rotation sensor from body.
    alignment: UnitQuaternion<f64>,
    gyro_bias: GaussMarkovError,
    accelerometer_bias: GaussMarkovError,
    gyro_white: Noise,
    accelerometer_white: Noise,
    dropout: Noise,
    outlet: Outlet<ImuSample, VesselClock>,
}

impl VesselImu {
    pub(super) fn new(config: &VesselImuConfig, identity: SenderIdentity, streams: &Streams) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("vessel.imu.{what}"));
        let mut mount = noise("mount");
        let tau = config.bias_correlation_s;
        VesselImu {
            lever_arm: Vector3::from(config.lever_arm_m) + mount.normal3() * config.lever_arm_error_sd_m,
            alignment: UnitQuaternion::from_scaled_axis(
                mount.normal3() * config.alignment_sd_deg.to_radians(),
            ),
            gyro_bias: GaussMarkovError::new(noise("gyro.bias"), config.gyro_bias_sd_radps, tau),
            accelerometer_bias: GaussMarkovError::new(
                noise("accelerometer.bias"),
                config.accelerometer_bias_sd_mps2,
                tau,
            ),
            gyro_white: noise("gyro.white"),
            accelerometer_white: noise("accelerometer.white"),
            dropout: noise("dropout"),
            outlet: Outlet::new(config.rate_hz, config.latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn step(&mut self, t: Time<TrueTime>, vessel: &RigidState<VesselBody>) -> Vec<ImuSample> {
        if let Some(dt) = self.outlet.due(t) {
            let (rate, force) = inertial(&vessel.at::<VesselBody>(self.lever_arm));
            let gyro = self.alignment * rate
                + self.gyro_bias.step(dt)
                + self.gyro_white.normal3() * self.config.gyro_white_sd_radps;
            let accelerometer = self.alignment * force
                + self.accelerometer_bias.step(dt)
                + self.accelerometer_white.normal3() * self.config.accelerometer_white_sd_mps2;
            let lost = self.dropout.chance(self.config.dropout);
            self.outlet.send(t, lost, |header| {
                Some(ImuSample {
                    header,
                    gyro: gyro.into(),
                    accelerometer: accelerometer.into(),
                    ..ImuSample::default()
                })
            });
        }
        self.outlet.arrived(t)
    }
}
