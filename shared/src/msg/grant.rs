//! Reservation of the deck and waiting places of drones.

use core::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, Reason, ReasonCode, within};
use crate::time::{Clock, Time};

/// Value in place of a drone's number: the deck is closed to all drones.
pub const DECK_CLOSED: u32 = u32::MAX;

/// Number of waiting places.
pub const PLACES: usize = 8;
/// Horizontal distance of the waiting places from the deck's centre, m; covers the vessel's length and GNSS errors.
pub const WAITING_DISTANCE_M: f64 = 25.0;
/// Radius around the deck's centre in which only the owner may fly, m.
pub const OWNER_ONLY_M: f64 = 15.0;
/// Minimum height difference between a station and another place or station, m: three times the difference of
/// two GNSS heights, plus a drone.
pub const STATION_APART_M: f64 = 5.0;
/// Height difference between successive waiting places, m: five times the difference of two GNSS heights (1.4
/// m rms for 1 m each), plus a drone.
const LAYER_M: f64 = 8.0;

/// Waiting place of a drone; each has its own height and bearing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitingPlace {
    /// Height above the approach height, m.
    pub above_m: f64,
    /// Bearing from the deck's centre, from north towards east, rad.
    pub bearing_rad: f64,
}

impl WaitingPlace {
    /// Waiting place of this number: lowest first, bearings as far apart as possible (van der Corput sequence).
    pub fn of(number: u8) -> WaitingPlace {
        WaitingPlace {
            above_m: LAYER_M * f64::from(number),
            bearing_rad: TAU * f64::from(number.reverse_bits()) / 256.0,
        }
    }
}

/// Maximum time for which a vessel may state a steady course, s.
pub const MAX_STEADY_S: f32 = 3600.0;

/// Course and speed that the helm intends.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
pub enum Course {
    /// Nothing stated, or the statement has expired.
    #[default]
    Unknown,
    /// Course and speed are kept for this time after the message's time of validity, s.
    Steady(f32),
    /// The vessel turns or changes speed, or may do so at any moment.
    Turning,
}

impl Course {
    /// This course `age_s` seconds later; a steady course expires.
    pub fn after(self, age_s: f64) -> Course {
        match self {
            Course::Unknown | Course::Turning => self,
            Course::Steady(for_s) => {
                let left_s = for_s - age_s as f32;
                if left_s > 0.0 {
                    Course::Steady(left_s)
                } else {
                    Course::Unknown
                }
            }
        }
    }
}

/// Tolerance between the dimensions of one deck in two files, m: more than the error of a tape measure.
const SAME_DECK_M: f64 = 0.05;

/// Dimensions of the vessel's deck from a configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckDimensions {
    /// Centre of the deck's surface in the vessel's body frame, m.
    pub centre: [f32; 3],
    /// Length along the vessel and width across it, m.
    pub size: [f32; 2],
}

impl DeckDimensions {
    /// Coordinates of the centre, length and width, m, rounded to the millimetre.
    pub fn all_m(&self) -> [f64; 5] {
        let [x, y, z] = self.centre;
        let [length, width] = self.size;
        [x, y, z, length, width].map(|v| (f64::from(v) * 1e3).round() / 1e3)
    }
    /// Reason why a drone with these dimensions must not descend to `vessel`: the pair that differs most, m.
    pub fn differs_from(&self, vessel: &DeckDimensions) -> Option<Reason> {
        let apart = |(own, other): &(f64, f64)| (own - other).abs();
        let pairs = self.all_m().into_iter().zip(vessel.all_m());
        let most = pairs.max_by(|a, b| apart(a).total_cmp(&apart(b)));
        let (own, other) = most.filter(|pair| apart(pair) > SAME_DECK_M)?;
        Some(Reason::new(ReasonCode::DeckDiffers, own, other))
    }
    fn is_sound(&self) -> bool {
        within(self.centre.iter().chain(&self.size), 100.0)
    }
}

/// Grant that states which drone may descend. It is repeated: a drone descends only with a fresh grant that
/// names it, and breaks off when a grant names another.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct DeckGrant<C: Clock> {
    /// Identity; `at` is the time of the grant.
    pub header: Header<C>,
    /// Number of the deck owner; 0: the deck is free, [`DECK_CLOSED`]: no drone may descend.
    pub owner: u32,
    /// The owner stands on the deck, or the deck sensor detects an object.
    pub occupied: bool,
    /// Drones at the waiting places, lowest place first; 0: free.
    pub places: [u32; PLACES],
    /// Heights above the deck's mean level of the stations of these drones, m; 0: no station, or one
    /// requested at a height that was already taken.
    pub stations: [u8; PLACES],
    /// Course that the helm intends.
    pub course: Course,
    /// The crew has cleared the deck for a take-off of its owner.
    pub take_off: bool,
    /// Another drone requests the deck while the owner stands on it.
    pub wanted: bool,
    /// Deck dimensions in the vessel's configuration; None: not stated.
    pub dimensions: Option<DeckDimensions>,
}

impl<C: Clock> DeckGrant<C> {
    /// Waiting place of this drone, if it has one.
    pub fn place(&self, drone: u32) -> Option<WaitingPlace> {
        let number = self.places.iter().position(|d| *d == drone && drone != 0)?;
        u8::try_from(number).ok().map(WaitingPlace::of)
    }
}

restamped!(DeckGrant {
    owner,
    occupied,
    places,
    stations,
    course,
    take_off,
    wanted,
    dimensions
});
message!(@C DeckGrant<C>, C, |m| {
    match m.course {
        Course::Unknown | Course::Turning => true,
        Course::Steady(for_s) => (0.0..=MAX_STEADY_S).contains(&for_s),
    } => "course",
    m.dimensions.is_none_or(|d| d.is_sound()) => "dimensions",
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::DeckGeometry, msg::Message, time::VesselClock, topics, wire};

    #[test]
    fn deck_of_other_dimensions() {
        let mut deck = DeckGeometry::default();
        let own = DeckGeometry::default().dimensions();
        let differs = |vessel: &DeckGeometry| own.differs_from(&vessel.dimensions());
        deck.width_m = 1.74;
        assert_eq!(differs(&deck), None);
        deck.width_m = 1.8;
        assert_eq!(
            differs(&deck),
            Some(Reason::new(ReasonCode::DeckDiffers, 1.7, 1.8))
        );
        deck.centre_m = [0.0, 0.0, -1.0];
        let why = differs(&deck).unwrap().to_string();
        assert!(why.contains("-1.30 m") && why.contains("-1.00 m"), "{why}");
    }

    #[test]
    fn longest_grant_on_the_radio() {
        let grant = DeckGrant::<VesselClock> {
            course: Course::Steady(60.0),
            dimensions: Some(DeckGeometry::default().dimensions()),
            ..DeckGrant::default()
        };
        assert_eq!(grant.check(), Ok(()));
        let length = wire::encode(&grant).unwrap().len();
        assert!(length <= topics::DECK.bytes, "{length}");
    }
}
