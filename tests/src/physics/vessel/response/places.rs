//! Deck, sensors and trim as measured by an installer, in a TOML file next to the response table.

use alight_shared::{config, geometry::DeckGeometry, tags::Tags};
use serde::{Deserialize, Serialize};

use super::HullError;

/// Position relative to amidships at the still-water line, along the vessel's axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HullPlace {
    /// Position forward of amidships, m; negative aft.
    pub forward_m: f64,
    /// Position to starboard, m.
    pub right_m: f64,
    /// Height above the water line, m.
    pub above_water_m: f64,
}

impl HullPlace {
    /// Position in the body frame (forward, right, down), m.
    pub fn body(&self) -> [f64; 3] {
        [self.forward_m, self.right_m, -self.above_water_m]
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeckPlace {
    /// Position of the deck's centre forward of amidships, m; negative aft.
    pub forward_m: f64,
    /// Position of the deck's centre to starboard, m.
    pub right_m: f64,
    /// Height of the deck's centre above the water line, m.
    pub above_water_m: f64,
    pub length_m: f64,
    pub width_m: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trim {
    /// Pitch, positive bow up, deg.
    pub pitch_deg: f64,
    /// Roll, positive starboard down, deg.
    pub roll_deg: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Places {
    pub description: String,
    pub deck: DeckPlace,
    pub trim: Trim,
    pub antenna: HullPlace,
    pub imu: HullPlace,
}

impl Places {
    pub fn parse(text: &str, origin: &str) -> Result<Self, HullError> {
        let wrong = |message: String| HullError::Places {
            origin: origin.into(),
            message,
        };
        let places: Places = config::read(text, "the places").map_err(|e| wrong(e.to_string()))?;
        let deck = &places.deck;
        let trim = &places.trim;
        let lengths = [
            ("deck.forward_m", deck.forward_m, [-50.0, 50.0]),
            ("deck.right_m", deck.right_m, [-50.0, 50.0]),
            ("deck.above_water_m", deck.above_water_m, [-50.0, 50.0]),
            ("deck.length_m", deck.length_m, [0.5, 100.0]),
            ("deck.width_m", deck.width_m, [0.5, 100.0]),
            ("trim.pitch_deg", trim.pitch_deg, [-20.0, 20.0]),
            ("trim.roll_deg", trim.roll_deg, [-20.0, 20.0]),
        ];
        let of_place = |name: &'static str, p: &HullPlace| p.body().map(|v| (name, v, [-50.0, 50.0]));
        let all = lengths
            .into_iter()
            .chain(of_place("antenna", &places.antenna))
            .chain(of_place("imu", &places.imu));
        for (name, value, [min, max]) in all {
            if !(min..=max).contains(&value) {
                return Err(wrong(format!("{name} is {value}, allowed is {min} to {max}")));
            }
        }
        Ok(places)
    }
    /// Deck for nodes and world, with the tag layout suggested by the hull's file, otherwise that of `base`.
    pub fn deck(&self, base: &DeckGeometry) -> DeckGeometry {
        let deck = &self.deck;
        DeckGeometry {
            centre_m: [deck.forward_m, deck.right_m, -deck.above_water_m],
            length_m: deck.length_m,
            width_m: deck.width_m,
            tags: Tags::new(),
            ..*base
        }
    }
}
