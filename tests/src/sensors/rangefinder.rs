//! Belly rangefinder: distance along the body's down axis to the deck or the water.

use alight_shared::{
    config,
    frames::{Deck, DroneBody},
    geometry::{DeckGeometry, DroneGeometry},
    msg::RangeSample,
    time::{DroneClock, Time, TrueTime},
};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{
    noise::{Noise, Windows},
    outlet::{Outlet, SenderIdentity},
};
use crate::physics::{body::RigidState, streams::Streams};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RangefinderFault {
    #[default]
    None,
    /// Spray on the window: the reading is always the range to the feet.
    Feet,
    /// A wet deck mirrors the beam: the reading is the range to the water below.
    Water,
    /// Readings are 0 m, the manufacturer's value for an invalid reading.
    Invalid,
}

config! {
    /// Rangefinder of the drone.
    pub struct RangefinderConfig {
        /// Readings per second.
        /// Chosen: a typical small lidar.
        pub rate_hz: f64 = 50.0, in 0.1..=100.0;
        /// Delay from measurement to arrival, s.
        pub latency_s: f64 = 0.01, in 0.0..=2.0;
        /// Maximum range, m.
        pub max_range_m: f64 = 30.0, in 0.1..=500.0;
        /// Minimum range, m.
        pub min_range_m: f64 = 0.05;
        /// White noise, m.
        pub white_sd_m: f64 = 0.03, in 0.0..=5.0;
        /// Probability that a reading is missing above the deck.
        pub deck_miss: f64 = 0.005, in 0.0..=1.0;
        /// Probability that a reading is missing above water, which reflects the beam away.
        pub water_miss: f64 = 0.2, in 0.0..=1.0;
        /// Windows `[start, end)` without readings, s of true time.
        pub outages_s: Windows = Windows::default(), in -1e9..=1e9;
        /// Permanent fault that begins with the first reading from the deck below `fails_below_m`.
        pub fault: RangefinderFault = RangefinderFault::None;
        /// Reading from the deck below which the fault begins, m.
        pub fails_below_m: f64 = 0.8, in 0.0..=500.0;
    }
    check |this, at| {
        at.range("min_range_m", this.min_range_m, 0.0, this.max_range_m)?;
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Echo {
    Deck(f64),
    Water(f64),
    None,
}

#[derive(Clone, Debug)]
pub(super) struct Rangefinder {
    config: RangefinderConfig,
    place: Vector3<f64>,
    /// Half length and width, m.
    half: [f64; 2],
    /// Range with the feet on the deck, m.
    feet_m: f64,
    failed: bool,
    white: Noise,
    miss: Noise,
    outlet: Outlet<RangeSample, DroneClock>,
}

impl Rangefinder {
    pub(super) fn new(
        config: &RangefinderConfig,
        drone: &DroneGeometry,
        deck: &DeckGeometry,
        identity: SenderIdentity,
        streams: &Streams,
    ) -> Self {
        Rangefinder {
            place: Vector3::from(drone.rangefinder_m),
            half: [0.5 * deck.length_m, 0.5 * deck.width_m],
            feet_m: drone.feet_below_m - drone.rangefinder_m[2],
            failed: false,
            white: Noise::new(streams, "drone.rangefinder.white"),
            miss: Noise::new(streams, "drone.rangefinder.miss"),
            outlet: Outlet::new(config.rate_hz, config.latency_s, &config.outages_s, identity),
            config: config.clone(),
        }
    }
    pub(super) fn step(
        &mut self,
        t: Time<TrueTime>,
        drone: &RigidState<DroneBody>,
        deck: &RigidState<Deck>,
        other: Option<&RigidState<Deck>>,
        water: impl Fn(f64, f64) -> f64,
    ) -> Vec<RangeSample> {
        if self.outlet.due(t).is_some() {
            let (white, luck) = (self.white.normal(), self.miss.uniform());
            let decks = [Some(deck), other].into_iter().flatten();
            let nearest = decks
                .filter_map(|d| self.on_deck(drone, d))
                .min_by(f64::total_cmp);
            let eye = drone.at::<DroneBody>(self.place).position.0;
            let echo = nearest.map_or_else(|| self.water(eye, drone.attitude.down().0, &water), Echo::Deck);
            self.failed |= matches!(echo, Echo::Deck(r) if r <= self.config.fails_below_m);
            let fault = if self.failed {
                self.config.fault
            } else {
                RangefinderFault::None
            };
            let echo = match fault {
                RangefinderFault::None | RangefinderFault::Invalid => echo,
                RangefinderFault::Feet => Echo::Deck(self.feet_m),
                RangefinderFault::Water => self.water(eye, drone.attitude.down().0, &water),
            };
            let met = match echo {
                Echo::Deck(r) if luck >= self.config.deck_miss => Some(r),
                Echo::Water(r) if luck >= self.config.water_miss => Some(r),
                Echo::Deck(_) | Echo::Water(_) | Echo::None => None,
            };
            let range = met
                .map(|r| r + white * self.config.white_sd_m)
                .filter(|r| (self.config.min_range_m..=self.config.max_range_m).contains(r));
            let range = match fault {
                RangefinderFault::Invalid => Some(0.0),
                RangefinderFault::None | RangefinderFault::Feet | RangefinderFault::Water => range,
            };
            let variance = self.config.white_sd_m.max(1e-3).powi(2);
            self.outlet.send(t, false, |header| {
                range.map(|range_m| RangeSample {
                    header,
                    range_m,
                    variance,
                })
            });
        }
        self.outlet.arrived(t)
    }
    /// Distance along the beam, m; None if the beam misses the deck.
    fn on_deck(&self, drone: &RigidState<DroneBody>, deck: &RigidState<Deck>) -> Option<f64> {
        let eye = drone.at::<DroneBody>(self.place).position;
        let beam = drone.attitude.down();
        let to_deck = deck.attitude.inverse();
        let (from, along) = (to_deck * (eye - deck.position), to_deck * beam);
        if along.0.z > 1e-6 && from.0.z < 0.0 {
            let r = -from.0.z / along.0.z;
            let hit = from.0 + along.0 * r;
            return (hit.x.abs() <= self.half[0] && hit.y.abs() <= self.half[1]).then_some(r);
        }
        None
    }
    /// Water surface along the beam, by fixed-point steps that each sample the surface below the previous
    /// estimate. They contract by slope x tan(tilt), which is below 0.2 in flight.
    fn water(&self, eye: Vector3<f64>, beam: Vector3<f64>, water: impl Fn(f64, f64) -> f64) -> Echo {
        if !(beam.z > 0.2) {
            return Echo::None;
        }
        let mut r = -eye.z / beam.z;
        for _ in 0..4 {
            if !(-10.0..=2.0 * self.config.max_range_m).contains(&r) {
                return Echo::None;
            }
            let at = eye + beam * r;
            let next = (water(at.x, at.y) - eye.z) / beam.z;
            let moved = (next - r).abs();
            r = next;
            if moved < 0.01 {
                break;
            }
        }
        if r > 0.0 { Echo::Water(r) } else { Echo::None }
    }
}
