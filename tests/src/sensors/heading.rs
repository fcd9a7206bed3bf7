//! The vessel's heading sensor: a compass, or two GNSS antennas.

use alight_shared::config;
use alight_shared::frames::{VesselBody, wrap_angle};
use alight_shared::msg::{Header, HeadingFix};
use alight_shared::time::{Span, Time, TrueTime};

use super::clocks::Clocks;
use super::delay::DelayLine;
use super::noise::{GaussMarkov, Noise, Schedule, check_windows, covers};
use super::{Identity, QUEUE};
use crate::physics::body::RigidState;
use crate::physics::streams::Streams;

config! {
    /// The vessel's heading sensor.
    pub struct VesselHeadingConfig {
        /// Measurements per second.
        pub rate_hz: f64 = 10.0, in 0.1..=100.0;
        /// From measurement to arrival at the estimator, s.
        pub latency_s: f64 = 0.05, in 0.0..=2.0;
        /// White noise, deg.
        pub white_sd_deg: f64 = 1.0, in 0.0..=45.0;
        /// Standard deviation of the slow bias (deviation, mounting), deg.
        /// Chosen: a compass is never free of it, and averaging does not remove it.
        pub bias_sd_deg: f64 = 0.5, in 0.0..=45.0;
        /// Correlation time of the slow bias, s.
        pub bias_correlation_s: f64 = 300.0, in 1.0..=1e9;
        /// Probability that a measurement is missing.
        pub dropout: f64 = 0.01, in 0.0..=1.0;
        /// Windows `[start, end)` without measurements, s of true time.
        pub outages_s: Vec<[f64; 2]> = Vec::new();
    }
    check |this, at| {
        check_windows(at, "outages_s", &this.outages_s)?;
    }
}

/// The vessel's heading sensor at work.
#[derive(Clone, Debug)]
pub(super) struct VesselHeading {
    config: VesselHeadingConfig,
    bias: GaussMarkov,
    white: Noise,
    dropout: Noise,
    schedule: Schedule,
    sequence: u32,
    line: DelayLine<HeadingFix>,
}

impl VesselHeading {
    pub(super) fn new(config: &VesselHeadingConfig, streams: &Streams) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("vessel.heading.{what}"));
        VesselHeading {
            bias: GaussMarkov::new(
                noise("bias"),
                config.bias_sd_deg.to_radians(),
                config.bias_correlation_s,
            ),
            white: noise("white"),
            dropout: noise("dropout"),
            schedule: Schedule::new(config.rate_hz),
            sequence: 0,
            line: DelayLine::new(QUEUE),
            config: config.clone(),
        }
    }
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        id: &Identity,
        clocks: &Clocks,
    ) -> Vec<HeadingFix> {
        if let Some(dt) = self.schedule.due(t) {
            let white = self.config.white_sd_deg.to_radians();
            let error = self.bias.step(dt).x + self.white.normal() * white;
            let lost = self.dropout.chance(self.config.dropout);
            if !lost && !covers(&self.config.outages_s, t) {
                let fix = HeadingFix {
                    header: Header::new(id.vessel, 0, id.boot, self.sequence, clocks.vessel_time(t)),
                    heading: wrap_angle(vessel.euler().z + error),
                    // As its data sheet says: the whole error.
                    heading_sd: white.hypot(self.config.bias_sd_deg.to_radians()).max(1e-4),
                    ..HeadingFix::default()
                };
                self.sequence = self.sequence.wrapping_add(1);
                self.line.push(t + Span::from_secs(self.config.latency_s), fix);
            }
        }
        self.line.arrived(t)
    }
}
