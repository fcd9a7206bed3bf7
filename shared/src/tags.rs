//! Tags on a deck: several of one family with individual ids, sizes and positions, measured as one body.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{config, msg::Seq};

/// Maximum number of tags on a deck.
pub const MAX_TAGS: usize = 24;
/// Number of tags in the family 36h11.
pub const FAMILY: u16 = 587;
/// Side of a tag with its white margin, relative to its black square: ten cells to eight.
pub const MARGIN: f64 = 1.25;

config! {
    /// Tag of the AprilTag family 36h11 with its upper edge forward.
    #[derive(Copy)]
    pub struct DeckTag {
        /// Id of the tag in the family.
        pub id: u16 = 0, in 0.0..=586.0;
        /// Side of its black square, m.
        pub side_m: f64 = 1.0, in 0.02..=10.0;
        /// Centre of the tag relative to the deck's centre: forward, right, down, m.
        pub centre_m: [f64; 3] = [0.0; 3], in -50.0..=50.0;
    }
}

/// Tags of a deck.
pub type Tags = Seq<DeckTag, MAX_TAGS>;

/// Content of an image in place of the deck's tags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C, u8)]
pub enum ForeignTag {
    /// Tag of the family 36h11 with this number, which the deck lacks.
    Number(u16),
    /// Mirrored tag of the family 36h11 with this number.
    Mirrored(u16),
    /// Tag of the family 36h11 with this number, black and white exchanged.
    Inverted(u16),
    /// Tag of the family 25h9.
    Family25h9,
    /// Tag of the family standard 41h12.
    Family41h12,
    /// Black square on white with a pattern that matches no tag of these families, mirrored or not.
    Unknown,
    /// Image with rows of this many pixels instead of the configured width.
    RowLength(u16),
}

impl ForeignTag {
    /// Remedy that makes the tags detectable.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::Number(_) => {
                "set drone.deck.tags to the numbers that are printed, or print the configured tags (alight tag)"
            }
            Self::Mirrored(_) | Self::Unknown => {
                "switch off one of the camera's flips (v4l2-ctl --set-ctrl horizontal_flip=0, vertical_flip=0), or print the tags \
                 again (alight tag --pdf)"
            }
            Self::Inverted(_) | Self::Family25h9 | Self::Family41h12 => {
                "print the tags again (alight tag --pdf)"
            }
            Self::RowLength(_) => {
                "write images of the lens's width_px x height_px, one byte a pixel (ffmpeg -s 640x480 -pix_fmt gray)"
            }
        }
    }
}

impl fmt::Display for ForeignTag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(n) => write!(f, "a tag in view has number {n}, which is not on the deck"),
            Self::Mirrored(n) => write!(f, "a tag in view is mirrored (number {n}): it is never detected"),
            Self::Inverted(n) => write!(f, "a tag in view is a negative (number {n}): it is never detected"),
            Self::Family25h9 => f.write_str("a tag in view is of another family (25h9): only 36h11 is detected"),
            Self::Family41h12 => f.write_str("a tag in view is of another family (41h12): only 36h11 is detected"),
            Self::Unknown => f.write_str(
                "a marker in view is not a 36h11 tag: a mirrored image (one of hflip, vflip), another family, or partly covered",
            ),
            Self::RowLength(n) => write!(f, "the image has rows of {n} bytes: another size or format than the lens's"),
        }
    }
}

/// Side of the small tags, m. From a height of 1.4 m and with a focal length of 320 px they measure 20 px, enough to
/// decode them in nearly all images.
const SMALL_M: f64 = 0.09;
/// Radius of the ring of six small tags about the seventh, m. At contact, the default camera (0.22 m above
/// the deck, 480 px high) sees a circle of 0.165 m, with a complete tag if its centre is within 0.101 m of
/// the circle's. Seven discs of that radius cover a disc of twice the radius, 0.2 m of landing error, if the
/// ring has sqrt(3) times the radius.
const RING_M: f64 = 0.173;
/// Maximum sides of the two long-range and the two mid-range tags, m, which are decoded from 16 m and from 5 m.
const LARGE_M: [f64; 2] = [0.8, 0.25];
/// Minimum side of the long-range tags, m: 20 px from the tracking height of 7 m. A shorter deck has room for
/// one tag, of at most the paper's 1 m and 0.7 of the deck to leave room for the margin.
const MIN_LARGE_M: f64 = 0.44;
const ALONE: (f64, f64) = (1.0, 0.7);

/// First tag id of the boat `vessel`. Each boat has [`MAX_TAGS`] ids of its own, unless boat numbers differ
/// by a multiple of 23. The first ids of the family, which all examples use, belong to no boat.
pub fn first_number(vessel: u32) -> u16 {
    let ids_per_boat = MAX_TAGS as u16;
    let boats = u32::from(FAMILY / ids_per_boat) - 1;
    ids_per_boat * (1 + (vessel % boats) as u16)
}
/// These tags with the ids of the boat `vessel`, in the same order.
pub fn of_vessel(tags: &Tags, vessel: u32) -> Tags {
    let first = first_number(vessel);
    Seq::filled(tags.iter().zip(first..).map(|(tag, id)| DeckTag { id, ..*tag }))
}
/// Whether the ids are the defaults, which all boats without their own ids share.
pub fn are_anybodys(tags: &[DeckTag]) -> bool {
    tags.iter().any(|tag| usize::from(tag.id) < MAX_TAGS)
}

/// Suggested tags for a deck of this size: seven small ones about its centre for the last metre, two
/// mid-range ones at the sides, two large ones fore and aft; one if the deck is too short.
pub fn suggested(length_m: f64, width_m: f64) -> Tags {
    let ring = core::array::from_fn::<_, 6, _>(|k| (60.0 * k as f64 + 30.0).to_radians().sin_cos());
    let inner = [ring[0].1, 1.0].map(|reach| RING_M * reach + 0.5 * MARGIN * SMALL_M);
    let room = |half: f64, inner: f64| (half - inner) / MARGIN;
    let large = (room(0.5 * length_m, inner[0]))
        .min(width_m / MARGIN)
        .min(LARGE_M[0]);
    let middle = room(0.5 * width_m, inner[1]).min(LARGE_M[1]);
    if large < MIN_LARGE_M {
        let side_m = (ALONE.1 * length_m.min(width_m)).min(ALONE.0);
        return Seq::filled([DeckTag {
            side_m,
            ..DeckTag::default()
        }]);
    }
    // Rounded to the millimetre, as printed.
    let mm = |v: f64| ((1e3 * v.abs() + 1e-6).round() / 1e3).copysign(v) + 0.0;
    let fore = inner[0] + 0.5 * MARGIN * large;
    let aside = inner[1] + 0.5 * MARGIN * middle;
    let far = [
        (large, fore, 0.0),
        (large, -fore, 0.0),
        (middle, 0.0, aside),
        (middle, 0.0, -aside),
    ];
    let small = ring.map(|(sin, cos)| (SMALL_M, RING_M * cos, RING_M * sin));
    let all = far.into_iter().chain([(SMALL_M, 0.0, 0.0)]).chain(small);
    // A narrow deck has no room for larger tags next to the small ones.
    let useful = all.filter(|(side, ..)| *side >= SMALL_M);
    Seq::filled(useful.zip(0..).map(|((side, x, y), id)| DeckTag {
        id,
        side_m: (1e3 * side + 1e-6).floor() / 1e3,
        centre_m: [mm(x), mm(y), 0.0],
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn tag_numbers_of_a_fleet() {
        let tags = suggested(2.5, 1.7);
        let boats: Vec<BTreeSet<u16>> = (1..=23)
            .map(|vessel| of_vessel(&tags, vessel).iter().map(|t| t.id).collect())
            .collect();
        let all: BTreeSet<u16> = boats.iter().flatten().copied().collect();
        assert_eq!(all.len(), 23 * tags.len());
        assert!(all.iter().all(|id| *id < FAMILY));
        assert!(are_anybodys(&tags) && !are_anybodys(&of_vessel(&tags, 7)));
        assert!((0..=u32::from(u16::MAX)).all(|v| first_number(v) + MAX_TAGS as u16 <= FAMILY));
    }
}
