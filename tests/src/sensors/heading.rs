use alight_shared::{
    config,
    frames::{VesselBody, wrap_angle},
    msg::HeadingFix,
    time::{Time, TrueTime, VesselClock},
};

use super::{
    noise::{GaussMarkovError, Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// Heading sensor of the vessel: a compass, or two GNSS antennas.
    pub struct VesselHeadingConfig {
        /// Measurements per second.
        pub rate_hz: f64 = 10.0, in 0.1..=100.0;
        /// Delay from measurement to arrival at the estimator, s.
        pub latency_s: f64 = 0.05, in 0.0..=2.0;
        /// White noise, deg.
        pub white_sd_deg: f64 = 1.0, in 0.0..=45.0;
        /// Standard deviation of the slow bias (deviation, mounting), deg.
        /// Chosen: every compass has a bias, which averaging does not remove.
        pub bias_sd_deg: f64 = 0.5, in 0.0..=45.0;
        /// Correlation time of the slow bias, s.
        pub bias_correlation_s: f64 = 300.0, in 1.0..=1e9;
        /// Ratio of the reported to the true errors.
        pub stated_factor: f64 = 1.0, in 0.1..=10.0;
        /// Probability that a measurement is missing.
        pub dropout: f64 = 0.01, in 0.0..=1.0;
        /// Windows `[start, end)` without measurements, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

#[derive(Clone, Debug)]
pub(super) struct VesselHeading {
    config: VesselHeadingConfig,
    bias: GaussMarkovError,
    white: Noise,
    dropout: Noise,
    outlet: Outlet<HeadingFix, VesselClock>,
}

impl VesselHeading {
    pub(super) fn new(config: &VesselHeadingConfig, identity: SenderIdentity, streams: &Streams) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("vessel.heading.{what}"));
        VesselHeading {
            bias: GaussMarkovError::new(
                noise("bias"),
                config.bias_sd_deg.to_radians(),
                config.bias_correlation_s,
            ),
            white: noise("white"),
            dropout: noise("dropout"),
            outlet: Outlet::new(config.rate_hz, config.latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn step(&mut self, t: Time<TrueTime>, vessel: &RigidState<VesselBody>) -> Vec<HeadingFix> {
        if let Some(dt) = self.outlet.due(t) {
            let white = self.config.white_sd_deg.to_radians();
            let error = self.bias.step(dt).x + self.white.normal() * white;
            let lost = self.dropout.chance(self.config.dropout);
            let all = white.hypot(self.config.bias_sd_deg.to_radians());
            let stated = (all * self.config.stated_factor).max(1e-4);
            self.outlet.send(t, lost, |header| {
                Some(HeadingFix {
                    header,
                    heading: wrap_angle(vessel.euler().z + error),
                    // Data sheets state the total error.
                    heading_sd: stated,
                    ..HeadingFix::default()
                })
            });
        }
        self.outlet.arrived(t)
    }
}
