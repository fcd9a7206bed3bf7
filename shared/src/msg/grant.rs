//! Reservation of the deck: its owner, and where drones wait.

use core::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Header, Reason, ReasonCode, within};
use crate::time::{Clock, Time};

/// In the place of a drone's number: the deck is closed to all.
pub const DECK_CLOSED: u32 = u32::MAX;

/// Places at which drones wait for the deck.
pub const PLACES: usize = 8;
/// Drones wait so far from the deck's centre, m: a vessel's length and what the GNSS of both is off.
pub const WAITING_DISTANCE_M: f64 = 25.0;
/// Within this distance of the deck's centre there is its owner and no other drone, m.
pub const OWNER_ONLY_M: f64 = 15.0;
/// A station keeps so far from the height of another drone's waiting place or station, m: what two heights by GNSS differ by, three
/// times, and a drone.
pub const STATION_APART_M: f64 = 5.0;
/// Each place is so much higher than the one before, m: the heights of two drones by GNSS differ by 1.4 m (rms) when each
/// is off by 1 m; five times that, and a drone.
const LAYER_M: f64 = 8.0;

/// Waiting place of a drone: no other drone has this height, nor this bearing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitingPlace {
    /// Above the height of the approach, m.
    pub above_m: f64,
    /// From the deck's centre, from north towards east, rad.
    pub bearing_rad: f64,
}

impl WaitingPlace {
    /// The place of this number: the lowest first, bearings as far apart as they can be (van der Corput's sequence).
    pub fn of(number: u8) -> WaitingPlace {
        WaitingPlace {
            above_m: LAYER_M * f64::from(number),
            bearing_rad: TAU * f64::from(number.reverse_bits()) / 256.0,
        }
    }
}

/// Longest time for which a vessel states a steady course, s.
pub const MAX_STEADY_S: f32 = 3600.0;

/// Course and speed that the helm intends.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
pub enum Course {
    /// Nothing is stated, or what was has expired.
    #[default]
    Unknown,
    /// Course and speed are kept for so long from the message's time of validity on, s.
    Steady(f32),
    /// The vessel turns or changes her speed, or may at any moment.
    Turning,
}

impl Course {
    /// This course `age_s` later, s: a promise expires by itself.
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

/// Dimensions of a deck in two files that are apart by more than this are of different decks, m: more than a tape measure errs.
const SAME_DECK_M: f64 = 0.05;

/// Dimensions of the vessel's deck by a configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckDimensions {
    /// Centre of the deck's surface in the vessel's body frame, m.
    pub centre: [f32; 3],
    /// Length along the vessel and width across her, m.
    pub size: [f32; 2],
}

impl DeckDimensions {
    /// Coordinates of the centre, length and width, m, to the millimetre.
    pub fn all_m(&self) -> [f64; 5] {
        let ([x, y, z], [length, width]) = (self.centre, self.size);
        [x, y, z, length, width].map(|v| (f64::from(v) * 1e3).round() / 1e3)
    }
    /// Why no drone whose configuration has these dimensions descends to a deck with those of `vessel`: the two that differ
    /// most, m. None: they are alike.
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

/// The vessel announces which drone may descend to its deck. Repeated while it runs: a drone descends only
/// on a fresh grant that names it, and breaks a descent off on one that names another.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct DeckGrant<C: Clock> {
    /// Identity; `at` is when it was granted.
    pub header: Header<C>,
    /// The drone that has the deck; 0 when it is free, [`DECK_CLOSED`] when no drone may.
    pub owner: u32,
    /// It stands on it, or the vessel's sensor reports something there.
    pub occupied: bool,
    /// The drones that have the waiting places, from the lowest on; 0: free.
    pub places: [u32; PLACES],
    /// The heights over the deck's mean level of the stations that these drones keep, m; 0: none. One that came later, at the height
    /// of another, is not among them.
    pub stations: [u8; PLACES],
    /// Course that the helm intends.
    pub course: Course,
    /// Somebody aboard has cleared the deck for a take-off of its owner.
    pub take_off: bool,
    /// Another drone asks for the deck on which its owner stands.
    pub wanted: bool,
    /// Dimensions of the deck by the vessel's configuration; None: she does not state them.
    pub dimensions: Option<DeckDimensions>,
}

impl<C: Clock> DeckGrant<C> {
    /// Waiting place of this drone.
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
    use crate::geometry::DeckGeometry;
    use crate::msg::Message;
    use crate::time::VesselClock;
    use crate::{topics, wire};

    #[test]
    fn deck_of_other_dimensions() {
        let (mut deck, own) = (DeckGeometry::default(), DeckGeometry::default().dimensions());
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
