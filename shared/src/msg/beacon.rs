//! Position of a vessel from common equipment: a second MAVLink system, a phone or an operator. A beacon is
//! not authenticated: it starts a search for the deck's tags, and never permits a landing without them.

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, within};
use crate::{geodesy::Datum, time::DroneClock};

/// Minimum standard deviation of a beacon's position on each axis, m: that of a receiver without corrections.
pub const MIN_BEACON_SD_M: f64 = 1.0;
/// Maximum plausible speed of a vessel with a beacon, m/s.
pub const MAX_BEACON_MPS: f64 = 20.0;
/// Maximum validity of a beacon, s.
pub const MAX_BEACON_LASTS_S: f64 = 3600.0;

/// Source of a beacon's position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum BeaconSource {
    /// Operator: `alight order deck-at`.
    #[default]
    Operator,
    /// `GLOBAL_POSITION_INT` of the vessel's own MAVLink system.
    GlobalPosition,
    /// `FOLLOW_TARGET` of a ground station or a phone.
    FollowTarget,
    /// The vessel's AIS transponder.
    Ais,
    /// The vessel itself, at its last position known by radio and camera.
    Vessel,
}

impl BeaconSource {
    /// Name used in messages.
    pub const fn name(self) -> &'static str {
        match self {
            BeaconSource::Operator => "an operator's order",
            BeaconSource::GlobalPosition => "GLOBAL_POSITION_INT",
            BeaconSource::FollowTarget => "FOLLOW_TARGET",
            BeaconSource::Ais => "AIS",
            BeaconSource::Vessel => "the last known place of the vessel",
        }
    }
}

/// Position and velocity of a vessel from a beacon.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckBeacon {
    /// Identity; `at` is the time of the position.
    pub header: Header<DroneClock>,
    /// Source of the position.
    pub source: BeaconSource,
    /// Latitude on WGS 84, deg, north positive.
    pub latitude_deg: f64,
    /// Longitude on WGS 84, deg, east positive.
    pub longitude_deg: f64,
    /// Velocity over ground, north and east, m/s.
    pub velocity: [f64; 2],
    /// Standard deviation of the position on each horizontal axis, m.
    pub place_sd_m: f64,
    /// Standard deviation of the velocity on each horizontal axis, m/s.
    pub velocity_sd_mps: f64,
    /// Validity after `at`, s.
    pub lasts_s: f64,
}

impl DeckBeacon {
    /// Position on the ellipsoid. The beacon's height is not used.
    pub fn place(&self) -> Datum {
        Datum::new(self.latitude_deg, self.longitude_deg, 0.0)
    }
    /// Velocity over ground, north and east, m/s.
    pub fn velocity(&self) -> Vector2<f64> {
        Vector2::from(self.velocity)
    }
}

message!(DeckBeacon, DroneClock, |m| {
    m.place().is_on_earth() => "latitude_deg or longitude_deg",
    within(&m.velocity, MAX_BEACON_MPS) => "velocity",
    (MIN_BEACON_SD_M..=1e3).contains(&m.place_sd_m) => "place_sd_m",
    (0.01..=MAX_BEACON_MPS).contains(&m.velocity_sd_mps) => "velocity_sd_mps",
    (1.0..=MAX_BEACON_LASTS_S).contains(&m.lasts_s) => "lasts_s",
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::Message;

    #[test]
    fn beacons_that_are_none() {
        let sound = DeckBeacon {
            latitude_deg: 59.3,
            longitude_deg: 18.1,
            velocity: [1.0, -2.0],
            place_sd_m: 5.0,
            velocity_sd_mps: 0.3,
            lasts_s: 10.0,
            ..DeckBeacon::default()
        };
        assert_eq!(sound.check(), Ok(()));
        let wrong: [fn(&mut DeckBeacon); 5] = [
            |m| m.latitude_deg = f64::NAN,
            |m| m.longitude_deg = 400.0,
            |m| m.velocity = [30.0, 0.0],
            |m| m.place_sd_m = 0.0,
            |m| m.lasts_s = f64::INFINITY,
        ];
        for spoil in wrong {
            let mut m = sound;
            spoil(&mut m);
            assert!(m.check().is_err(), "{m:?}");
        }
    }
}
