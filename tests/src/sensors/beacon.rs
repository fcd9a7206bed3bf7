//! A beacon on the vessel: a receiver whose position and velocity reach the drone with a delay, over a link
//! that does not pass through the vessel's computer.

use alight_shared::{
    config,
    frames::{Deck, TrueNed, Vector},
    geodesy::Datum,
    time::{DroneClock, Time, TrueTime},
};
use alight_uav::autopilot::{message::Address, place_report::PlaceReport};

use super::{
    noise::{GaussMarkovError, Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

/// Address on the autopilot's link: a tracker with its own system id.
pub const BEACON: Address = Address::new(42, 1);

config! {
    /// GNSS beacon on the vessel.
    ///
    /// Defaults: a phone or an AIS transponder on deck; values chosen here.
    pub struct BeaconConfig {
        /// Messages per second.
        pub rate_hz: f64 = 1.0, in 0.1..=10.0;
        /// Time from a fix to its arrival at the drone's computer, s.
        pub latency_s: f64 = 0.5, in 0.0..=10.0;
        /// Standard deviation of the slow position error, per axis, m.
        pub bias_sd_m: f64 = 5.0, in 0.0..=100.0;
        /// Correlation time of the slow position error, s.
        pub bias_correlation_s: f64 = 300.0, in 1.0..=1e6;
        /// Standard deviation of the white position error, per axis, m.
        pub white_sd_m: f64 = 1.0, in 0.0..=100.0;
        /// Standard deviation of the velocity error, m/s.
        pub velocity_sd_mps: f64 = 0.2, in 0.01..=10.0;
        /// Ratio of the stated position error to the true one.
        pub stated_factor: f64 = 1.0, in 0.1..=10.0;
        /// Windows `[start, end)` without messages, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
    }
}

#[derive(Clone, Debug)]
pub(super) struct Beacon {
    config: BeaconConfig,
    /// Origin of the true NED; None: it coincides with the origin of vessel and drones.
    place: Option<Datum>,
    bias: GaussMarkovError,
    white: Noise,
    velocity: Noise,
    outlet: Outlet<PlaceReport, DroneClock>,
}

impl Beacon {
    pub(super) fn new(
        config: &BeaconConfig,
        place: Option<Datum>,
        identity: SenderIdentity,
        streams: &Streams,
    ) -> Self {
        let noise = |what: &str| Noise::new(streams, &format!("vessel.beacon.{what}"));
        let (rate_hz, latency_s) = (config.rate_hz, config.latency_s);
        Beacon {
            place,
            bias: GaussMarkovError::new(noise("bias"), config.bias_sd_m, config.bias_correlation_s),
            white: noise("white"),
            velocity: noise("velocity"),
            outlet: Outlet::new(rate_hz, latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn step(&mut self, t: Time<TrueTime>, deck: &RigidState<Deck>) -> Vec<PlaceReport> {
        if let Some(dt) = self.outlet.due(t) {
            let c = &self.config;
            let error = self.bias.step(dt) + self.white.normal3() * c.white_sd_m;
            let velocity = deck.velocity.0 + self.velocity.normal3() * c.velocity_sd_mps;
            let origin = self.place.unwrap_or_default();
            let place = origin.at(&Vector::<TrueNed>::from(deck.position.0 + error));
            let report = PlaceReport {
                latitude_deg: place.latitude_deg,
                longitude_deg: place.longitude_deg,
                velocity: Some([velocity.x, velocity.y]),
                error_m: Some((c.stated_factor * c.bias_sd_m.hypot(c.white_sd_m)).max(1.0)),
            };
            self.outlet.send(t, false, |_| Some(report));
        }
        self.outlet.arrived(t)
    }
}
