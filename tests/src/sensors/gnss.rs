//! GNSS receiver with slow bias, white noise, and a lever arm of its antenna.

use alight_shared::{
    config,
    frames::{TrueNed, Vector, VesselBody},
    geodesy::Datum,
    msg::GnssFix,
    time::{Time, TrueTime, VesselClock},
};
use nalgebra::Vector3;

use super::{
    noise::{GaussMarkovError, Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

config! {
    /// Errors of a GNSS receiver.
    ///
    /// Defaults: a single-frequency receiver without corrections; values chosen here.
    #[derive(Copy)]
    pub struct GnssErrorConfig {
        /// Standard deviation of the slow bias, per axis, m.
        pub bias_sd_m: f64 = 1.0, in 0.0..=100.0;
        /// Correlation time of the slow bias, s.
        pub bias_correlation_s: f64 = 300.0, in 1.0..=1e6;
        /// Standard deviation of the white position noise, per axis, m.
        pub white_sd_m: f64 = 0.3, in 0.0..=100.0;
        /// Standard deviation of the white velocity noise, per axis, m/s.
        pub velocity_sd_mps: f64 = 0.1, in 0.0..=10.0;
    }
}

/// Vessel and drone have separate random streams. The difference of their biases displaces their NED planes.
#[derive(Clone, Debug)]
pub struct GnssError {
    config: GnssErrorConfig,
    bias: GaussMarkovError,
    white: Noise,
    velocity: Noise,
}

impl GnssError {
    /// `craft` is "vessel" or "drone". Streams: `<craft>.gnss.bias`, `.white` and `.velocity`.
    pub fn new(config: &GnssErrorConfig, streams: &Streams, craft: &str) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("{craft}.gnss.{what}"));
        GnssError {
            config: *config,
            bias: GaussMarkovError::new(noise("bias"), config.bias_sd_m, config.bias_correlation_s),
            white: noise("white"),
            velocity: noise("velocity"),
        }
    }
    /// Slow bias, NED, m, which displaces the craft's NED plane.
    pub fn bias(&self) -> Vector3<f64> {
        self.bias.value()
    }
    pub fn advance(&mut self, dt: f64) -> Vector3<f64> {
        self.bias.step(dt)
    }
    /// Position error, NED, m: bias plus white noise.
    pub fn position(&mut self) -> Vector3<f64> {
        self.bias.value() + self.white.normal3() * self.config.white_sd_m
    }
    pub fn velocity(&mut self) -> Vector3<f64> {
        self.velocity.normal3() * self.config.velocity_sd_mps
    }
}

config! {
    /// GNSS receiver of the vessel.
    pub struct VesselGnssConfig {
        /// Measurements per second.
        /// Source: Procházka 2024, GNSS at 10 Hz.
        pub rate_hz: f64 = 10.0, in 0.1..=100.0;
        /// Delay from measurement to arrival at the estimator, s.
        /// Chosen: typical of a receiver on a serial line.
        pub latency_s: f64 = 0.05, in 0.0..=2.0;
        /// Position of the antenna in the vessel's body frame, as configured in the estimator, m.
        /// Chosen: on a mast behind and above the deck.
        pub antenna_m: [f64; 3] = [-0.8, 0.2, -2.0], in -50.0..=50.0;
        /// Standard deviation of the error of `antenna_m`, per axis, drawn per seed, m.
        /// Chosen: measured with a tape.
        pub antenna_error_sd_m: f64 = 0.01, in 0.0..=1.0;
        /// Probability that a fix is missing.
        pub dropout: f64 = 0.01, in 0.0..=1.0;
        /// Windows `[start, end)` without fixes, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
        /// Height error, positive up, m. Receivers that omit the geoid height (field 11 of GGA) are wrong by
        /// 22 to 51 m in seven of 56 vessel logs.
        pub height_error_m: f64 = 0.0, in -200.0..=200.0;
        /// Ratio of the reported to the true white noise.
        pub stated_factor: f64 = 1.0, in 0.1..=10.0;
        /// Errors of the receiver.
        pub error: GnssErrorConfig;
    }
}

#[derive(Clone, Debug)]
pub(super) struct VesselGnss {
    config: VesselGnssConfig,
    /// Origin of the true NED; None: it is the vessel's origin.
    place: Option<Datum>,
    antenna: Vector3<f64>,
    error: GnssError,
    dropout: Noise,
    outlet: Outlet<GnssFix, VesselClock>,
}

impl VesselGnss {
    pub(super) fn new(
        config: &VesselGnssConfig,
        place: Option<Datum>,
        identity: SenderIdentity,
        streams: &Streams,
    ) -> Self {
        let mut mount = Noise::new(streams, "vessel.gnss.mount");
        VesselGnss {
            place,
            antenna: Vector3::from(config.antenna_m) + mount.normal3() * config.antenna_error_sd_m,
            error: GnssError::new(&config.error, streams, "vessel"),
            dropout: Noise::new(streams, "vessel.gnss.dropout"),
            outlet: Outlet::new(config.rate_hz, config.latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn bias(&self) -> Vector3<f64> {
        self.error.bias()
    }
    pub(super) fn step(&mut self, t: Time<TrueTime>, vessel: &RigidState<VesselBody>) -> Vec<GnssFix> {
        if let Some(dt) = self.outlet.due(t) {
            self.error.advance(dt);
            // Drawn even without a fix, so that an outage does not change later noise.
            let (dp, dv) = (self.error.position(), self.error.velocity());
            let lost = self.dropout.chance(self.config.dropout);
            let (config, place) = (&self.config, self.place);
            self.outlet.send(t, lost, |header| {
                let antenna = vessel.at::<VesselBody>(self.antenna);
                let position = antenna.position.0 + dp - Vector3::z() * config.height_error_m;
                let (datum, position) = match place {
                    Some(place) => (place.at(&Vector::<TrueNed>::from(position)), Vector3::zeros()),
                    None => (Datum::default(), position),
                };
                Some(GnssFix {
                    header,
                    datum,
                    position: position.into(),
                    velocity: (antenna.velocity.0 + dv).into(),
                    position_sd: [(config.error.white_sd_m * config.stated_factor).max(1e-3); 3],
                    velocity_sd: [(config.error.velocity_sd_mps * config.stated_factor).max(1e-3); 3],
                    ..GnssFix::default()
                })
            });
        }
        self.outlet.arrived(t)
    }
}
