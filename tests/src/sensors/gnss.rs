//! GNSS: a bias that wanders slowly, white noise, an antenna on its lever arm.

use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::frames::{Datum, VesselBody};
use alight_shared::msg::{GnssFix, Header};
use alight_shared::time::{Span, Time, TrueTime};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::clocks::Clocks;
use super::delay::DelayLine;
use super::noise::{GaussMarkov, Noise, Schedule, check_windows, covers};
use super::{Identity, QUEUE};
use crate::body::RigidState;
use crate::streams::Streams;

/// The errors of one GNSS receiver.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GnssErrorConfig {
    /// Standard deviation of the slow bias, each axis, m.
    pub bias_sd_m: f64,
    /// Correlation time of the slow bias, s.
    pub bias_correlation_s: f64,
    /// Standard deviation of the white position noise, each axis, m.
    pub white_sd_m: f64,
    /// Standard deviation of the white velocity noise, each axis, m/s.
    pub velocity_sd_mps: f64,
}

impl Default for GnssErrorConfig {
    /// A single-frequency receiver without corrections; figures ours (issue 2).
    fn default() -> Self {
        GnssErrorConfig {
            bias_sd_m: 1.0,
            bias_correlation_s: 300.0,
            white_sd_m: 0.3,
            velocity_sd_mps: 0.1,
        }
    }
}
impl Check for GnssErrorConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("bias_sd_m", self.bias_sd_m, 0.0, 100.0)?;
        at.range("bias_correlation_s", self.bias_correlation_s, 1.0, 1e6)?;
        at.range("white_sd_m", self.white_sd_m, 0.0, 100.0)?;
        at.range("velocity_sd_mps", self.velocity_sd_mps, 0.0, 10.0)
    }
}

/// The errors of one receiver as they run on. Each craft has its own, from its own streams: the
/// difference of two biases is what displaces the two craft's NED planes.
#[derive(Clone, Debug)]
pub struct GnssError {
    config: GnssErrorConfig,
    bias: GaussMarkov,
    white: Noise,
    velocity: Noise,
}

impl GnssError {
    /// The receiver of `craft` ("vessel", "drone"); its streams are `<craft>.gnss.bias`, `.white`
    /// and `.velocity`.
    pub fn new(config: &GnssErrorConfig, streams: &Streams, craft: &str) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("{craft}.gnss.{what}"));
        GnssError {
            config: *config,
            bias: GaussMarkov::new(noise("bias"), config.bias_sd_m, config.bias_correlation_s),
            white: noise("white"),
            velocity: noise("velocity"),
        }
    }
    /// The slow bias now, NED, m: what displaces the craft's NED plane.
    pub fn bias(&self) -> Vector3<f64> {
        self.bias.value()
    }
    /// Lets the slow bias run on for `dt` seconds and returns it.
    pub fn advance(&mut self, dt: f64) -> Vector3<f64> {
        self.bias.step(dt)
    }
    /// Draws a fresh position error, NED, m: bias plus white.
    pub fn position(&mut self) -> Vector3<f64> {
        self.bias.value() + self.white.normal3() * self.config.white_sd_m
    }
    /// Draws a fresh velocity error, NED, m/s.
    pub fn velocity(&mut self) -> Vector3<f64> {
        self.velocity.normal3() * self.config.velocity_sd_mps
    }
}

/// The vessel's GNSS receiver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VesselGnssConfig {
    /// Measurements per second.
    pub rate_hz: f64,
    /// From measurement to arrival at the estimator, s.
    pub latency_s: f64,
    /// Antenna in the vessel's body frame, as the estimator is told, m.
    pub antenna_m: [f64; 3],
    /// Standard deviation of what `antenna_m` is wrong by, each axis, drawn per seed, m.
    pub antenna_error_sd_m: f64,
    /// Probability that a fix is missing.
    pub dropout: f64,
    /// Windows `[start, end)` without fixes, s of true time.
    pub outages_s: Vec<[f64; 2]>,
    /// Origin of the NED plane that fixes are expressed in.
    pub datum: Datum,
    /// Its errors.
    pub error: GnssErrorConfig,
}

impl Default for VesselGnssConfig {
    fn default() -> Self {
        VesselGnssConfig {
            // Procházka 2024: GNSS at 10 Hz.
            rate_hz: 10.0,
            // Ours: usual for a receiver over a serial line.
            latency_s: 0.05,
            // Ours: on a mast behind and above the deck.
            antenna_m: [-0.8, 0.2, -2.0],
            // Ours: a tape measure.
            antenna_error_sd_m: 0.01,
            // Ours.
            dropout: 0.01,
            outages_s: Vec::new(),
            datum: Datum::default(),
            error: GnssErrorConfig::default(),
        }
    }
}
impl Check for VesselGnssConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("rate_hz", self.rate_hz, 0.1, 100.0)?;
        at.range("latency_s", self.latency_s, 0.0, 2.0)?;
        at.ranges("antenna_m", &self.antenna_m, -50.0, 50.0)?;
        at.range("antenna_error_sd_m", self.antenna_error_sd_m, 0.0, 1.0)?;
        at.range("dropout", self.dropout, 0.0, 1.0)?;
        check_windows(at, "outages_s", &self.outages_s)?;
        at.table("datum")
            .range("latitude_deg", self.datum.latitude_deg, -90.0, 90.0)?;
        at.table("datum")
            .range("longitude_deg", self.datum.longitude_deg, -180.0, 180.0)?;
        at.table("datum")
            .range("height_m", self.datum.height_m, -1e3, 1e4)?;
        self.error.check(&at.table("error"))
    }
}

/// The vessel's GNSS receiver at work.
#[derive(Clone, Debug)]
pub(super) struct VesselGnss {
    config: VesselGnssConfig,
    antenna: Vector3<f64>,
    error: GnssError,
    dropout: Noise,
    schedule: Schedule,
    sequence: u32,
    line: DelayLine<GnssFix>,
}

impl VesselGnss {
    pub(super) fn new(config: &VesselGnssConfig, streams: &Streams) -> Self {
        let mut mount = Noise::new(streams, "vessel.gnss.mount");
        VesselGnss {
            antenna: Vector3::from(config.antenna_m) + mount.normal3() * config.antenna_error_sd_m,
            error: GnssError::new(&config.error, streams, "vessel"),
            dropout: Noise::new(streams, "vessel.gnss.dropout"),
            schedule: Schedule::new(config.rate_hz),
            sequence: 0,
            line: DelayLine::new(QUEUE),
            config: config.clone(),
        }
    }
    pub(super) fn bias(&self) -> Vector3<f64> {
        self.error.bias()
    }
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        id: &Identity,
        clocks: &Clocks,
    ) -> Vec<GnssFix> {
        if let Some(dt) = self.schedule.due(t) {
            self.error.advance(dt);
            // Drawn even when the fix is lost, so that an outage does not shift the noise.
            let (dp, dv) = (self.error.position(), self.error.velocity());
            let lost = self.dropout.chance(self.config.dropout);
            if !lost && !covers(&self.config.outages_s, t) {
                let antenna = vessel.at::<VesselBody>(self.antenna);
                let fix = GnssFix {
                    header: Header::new(id.vessel, 0, id.boot, self.sequence, clocks.vessel_time(t)),
                    datum: self.config.datum,
                    position: (antenna.position.0 + dp).into(),
                    velocity: (antenna.velocity.0 + dv).into(),
                    position_sd: [self.config.error.white_sd_m.max(1e-3); 3],
                    velocity_sd: [self.config.error.velocity_sd_mps.max(1e-3); 3],
                    ..GnssFix::default()
                };
                self.sequence = self.sequence.wrapping_add(1);
                self.line.push(t + Span::from_secs(self.config.latency_s), fix);
            }
        }
        self.line.arrived(t)
    }
}
