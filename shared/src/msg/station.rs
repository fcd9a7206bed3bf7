//! Station: a position next to the vessel, given by an operator, that a drone keeps for a limited time.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{DroneTime, Span, Time};

/// Maximum height of a station above the deck's mean level, m.
pub const MAX_STATION_HEIGHT_M: u8 = 50;
/// Maximum horizontal distance of a station from the deck's centre, m.
pub const MAX_STATION_M: i8 = 60;
/// Maximum time on a station, min.
pub const MAX_STATION_MIN: u8 = 30;

/// Position relative to the vessel, in whole metres and minutes so that an order equals its repetition.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Station {
    /// Distance ahead of the deck's centre along the vessel's mean heading, m; negative: astern.
    pub ahead_m: i8,
    /// Distance to starboard of the deck's centre, m; negative: to port.
    pub right_m: i8,
    /// Height above the deck's mean level, m; 0 in an order: approach height.
    pub height_m: u8,
    /// Duration, counted from the order, min.
    pub for_min: u8,
}

impl Station {
    /// Default station: outside the space of the deck's owner, at approach height.
    pub const USUAL: Station = Station {
        ahead_m: 0,
        right_m: 20,
        height_m: 0,
        for_min: 10,
    };
    /// Station of an order with defaults: 0 m to starboard if only a distance ahead is given.
    pub fn named([ahead_m, right_m]: [Option<i8>; 2], height_m: Option<u8>, for_min: Option<u8>) -> Station {
        let usual = Station::USUAL;
        let abeam_m = if ahead_m.is_some() { 0 } else { usual.right_m };
        Station {
            ahead_m: ahead_m.unwrap_or(usual.ahead_m),
            right_m: right_m.unwrap_or(abeam_m),
            height_m: height_m.unwrap_or(usual.height_m),
            for_min: for_min.unwrap_or(usual.for_min),
        }
    }
    /// Whether the station is within the bounds of every vessel.
    pub fn is_sane(&self) -> bool {
        self.distance_m() <= f64::from(MAX_STATION_M)
            && self.height_m <= MAX_STATION_HEIGHT_M
            && (1..=MAX_STATION_MIN).contains(&self.for_min)
    }
    /// Replaces a missing height with the approach height in whole metres, rounded up.
    pub fn of_approach(self, height_m: f64) -> Station {
        let whole = height_m.ceil().min(f64::from(MAX_STATION_HEIGHT_M)) as u8;
        let height_m = if self.height_m == 0 { whole } else { self.height_m };
        Station { height_m, ..self }
    }
    /// Horizontal distance from the deck's centre, m.
    pub fn distance_m(&self) -> f64 {
        f64::from(self.ahead_m).hypot(f64::from(self.right_m))
    }
    /// Bearing from the deck's centre, clockwise from the bow, rad.
    pub fn bearing_rad(&self) -> f64 {
        f64::from(self.right_m).atan2(f64::from(self.ahead_m))
    }
}

impl fmt::Display for Station {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} m up", self.height_m)?;
        let mut side = |m: i8, one: &str, other: &str| match m {
            0 => Ok(()),
            1.. => write!(f, ", {m} m {one}"),
            i8::MIN..=-1 => write!(f, ", {} m {other}", m.unsigned_abs()),
        };
        side(self.ahead_m, "ahead", "astern")?;
        side(self.right_m, "to starboard", "to port")
    }
}

/// Station that a drone keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct KeptStation {
    /// Position of the station.
    pub station: Station,
    /// End of the time on the station.
    pub until: DroneTime,
}

impl KeptStation {
    /// This station with `until` replaced by the time left at `now`, in whole minutes after the clock's epoch.
    pub fn left_at(&self, now: DroneTime) -> KeptStation {
        let left_min = ((self.until - now).secs() / 60.0).ceil().max(0.0);
        KeptStation {
            until: Time::EPOCH + Span::from_secs(60.0 * left_min),
            ..*self
        }
    }
    /// This station with the time left that [`Self::left_at`] stored, counted from `now`.
    pub fn begun_at(&self, now: DroneTime) -> KeptStation {
        KeptStation {
            until: now + (self.until - Time::EPOCH),
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{DroneStatus, Reason, ReasonCode},
        *,
    };

    const ABEAM: Station = Station {
        ahead_m: 0,
        right_m: 20,
        height_m: 15,
        for_min: 10,
    };

    #[test]
    fn station_as_text() {
        assert_eq!(ABEAM.to_string(), "15 m up, 20 m to starboard");
        let astern = Station {
            ahead_m: -30,
            right_m: -5,
            ..ABEAM
        };
        assert_eq!(astern.to_string(), "15 m up, 30 m astern, 5 m to port");
    }

    #[test]
    fn station_in_a_status() {
        let state = |off_m| DroneStatus {
            station: Some(ABEAM),
            waiting: Reason::new(ReasonCode::OnStation, 700.0, off_m),
            ..DroneStatus::default()
        };
        let near = "keeps its station 15 m up, 20 m to starboard, 12 min left";
        assert_eq!(state(1.0).waits(), near);
        let far = "40 m from its station 15 m up, 20 m to starboard, 12 min left";
        assert_eq!(state(40.0).waits(), far);
    }

    #[test]
    fn height_of_a_station() {
        let height_m = |approach_m| Station::USUAL.of_approach(approach_m).height_m;
        assert_eq!(
            [2.0, 15.0, 15.2, 200.0].map(height_m),
            [2, 15, 16, MAX_STATION_HEIGHT_M]
        );
        assert_eq!(ABEAM.of_approach(30.0), ABEAM);
    }

    #[test]
    fn bounds_of_a_station() {
        assert!(ABEAM.is_sane());
        for changed in [
            Station { ahead_m: 59, ..ABEAM },
            Station {
                right_m: -61,
                ..ABEAM
            },
            Station {
                height_m: 51,
                ..ABEAM
            },
            Station { for_min: 31, ..ABEAM },
            Station { for_min: 0, ..ABEAM },
        ] {
            assert!(!changed.is_sane(), "{changed:?}");
        }
        assert!(Station::USUAL.is_sane());
    }
}
