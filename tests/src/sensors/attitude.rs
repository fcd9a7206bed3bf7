use alight_shared::{
    config,
    frames::VesselBody,
    msg::AttitudeFix,
    time::{Time, TrueTime, VesselClock},
};
use nalgebra::Vector3;

use super::{
    noise::{GaussMarkovError, Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// Roll, pitch, rates and heave of the vessel's inertial navigation system.
    pub struct VesselAttitudeConfig {
        /// Measurements per second.
        /// Chosen: typical of survey boats' motion sensors on a serial line.
        pub rate_hz: f64 = 20.0, in 1.0..=100.0;
        /// Delay from measurement to arrival at the estimator, s.
        pub latency_s: f64 = 0.03, in 0.0..=2.0;
        /// White noise of roll and pitch, deg.
        pub white_sd_deg: f64 = 0.02, in 0.0..=10.0;
        /// Standard deviation of the slow roll and pitch error, which the boat's acceleration causes, deg.
        pub bias_sd_deg: f64 = 0.05, in 0.0..=10.0;
        /// Correlation time of the slow roll, pitch and heave errors, s.
        /// Chosen: several wave periods, because the boat's acceleration causes these errors.
        pub bias_correlation_s: f64 = 20.0, in 0.1..=1e6;
        /// Standard deviation of the misalignment with the hull, per axis, drawn per seed, deg.
        pub alignment_sd_deg: f64 = 0.2, in 0.0..=20.0;
        /// White noise of the angular rates, rad/s.
        pub rate_white_sd_radps: f64 = 0.002, in 0.0..=1.0;
        /// Standard deviation of the slow heave error, m.
        /// Source: data sheets of motion sensors, 0.05 m or 5 %.
        pub heave_sd_m: f64 = 0.05, in 0.0..=10.0;
        /// Windows `[start, end)` without measurements, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

#[derive(Clone, Debug)]
pub(super) struct VesselAttitude {
    config: VesselAttitudeConfig,
    /// Roll, pitch, yaw, rad.
    alignment: Vector3<f64>,
    tilt: GaussMarkovError,
    heave: GaussMarkovError,
    white: Noise,
    outlet: Outlet<AttitudeFix, VesselClock>,
}

impl VesselAttitude {
    pub(super) fn new(config: &VesselAttitudeConfig, identity: SenderIdentity, streams: &Streams) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("vessel.attitude.{what}"));
        let tau = config.bias_correlation_s;
        VesselAttitude {
            alignment: noise("mount").normal3() * config.alignment_sd_deg.to_radians(),
            tilt: GaussMarkovError::new(noise("tilt"), config.bias_sd_deg.to_radians(), tau),
            heave: GaussMarkovError::new(noise("heave"), config.heave_sd_m, tau),
            white: noise("white"),
            outlet: Outlet::new(config.rate_hz, config.latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn step(&mut self, t: Time<TrueTime>, vessel: &RigidState<VesselBody>) -> Vec<AttitudeFix> {
        if let Some(dt) = self.outlet.due(t) {
            let c = &self.config;
            let white = c.white_sd_deg.to_radians();
            let error = self.alignment + self.tilt.step(dt) + self.white.normal3() * white;
            let rates = vessel.rates.0 + self.white.normal3() * c.rate_white_sd_radps;
            let heave = vessel.position.0.z + self.heave.step(dt).z;
            let angles = vessel.euler();
            self.outlet.send(t, false, |header| {
                Some(AttitudeFix {
                    header,
                    tilt: [angles.x + error.x, angles.y + error.y],
                    // As stated in a data sheet, without the mounting error.
                    tilt_sd: white.hypot(c.bias_sd_deg.to_radians()).max(1e-4),
                    rates: Some(rates.into()),
                    heave: Some(heave),
                    heave_sd: c.heave_sd_m.max(1e-3),
                    ..AttitudeFix::default()
                })
            });
        }
        self.outlet.arrived(t)
    }
}
