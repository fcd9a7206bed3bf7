//! Surroundings of a landing deck: keep-out volumes, approach sector, escape direction.

use core::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    config,
    config::{ConfigError, Keys},
    frames::wrap_angle,
    geometry::DeckGeometry,
    msg::{Seq, within},
};

/// Maximum number of keep-out volumes of a vessel.
pub const MAX_KEEP_OUT: usize = 8;
/// Minimum distance of a volume from the deck's outline, m: half a drone at the edge plus position error.
const COLUMN_MARGIN_M: f64 = 0.5;
/// Half width of the corridor along the escape direction, m: a drone plus its position error.
const ESCAPE_HALF_WIDTH_M: f64 = 1.0;
/// Step for checking the escape corridor, m.
const WAY_STEP_M: f64 = 0.25;
/// Minimum width of the approach sector, deg; the vessel's yaw in waves exceeds a narrower one.
const MIN_SECTOR_DEG: f64 = 20.0;
/// Height of waiting drones above the highest volume, m: 1 m each for deck heave, the tolerance of an
/// approach height, and a drone with its position error.
const WAIT_ABOVE_M: f64 = 3.0;
/// Additional height per metre of a volume's distance from the deck's centre: the vessel's tilt, rad.
const TILT_RAD: f64 = 0.2;

config! {
    /// Obstacles around the landing deck, and permitted flight directions.
    pub struct SurroundingsConfig {
        /// Keep-out volumes (mast, antennas, A-frame, crew area), at most 8: boxes along the vessel's axes,
        /// each given by two opposite corners in the vessel's body frame, m.
        pub keep_out_m: Vec<[[f64; 3]; 2]> = Vec::new(), in -200.0..=200.0;
        /// Bearings of low approaches over the vessel, from first clockwise to second, relative to the bow,
        /// deg.
        pub approach_sector_deg: [f64; 2] = [0.0, 360.0], in -360.0..=360.0;
        /// Bearing relative to the bow of a climb after breaking off near the deck, deg; unset: straight up.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub escape_deg: Option<f64> = None, in -360.0..=360.0;
    }
    check |this, at| {
        let count = this.keep_out_m.len();
        at.require(count <= MAX_KEEP_OUT, "keep_out_m", format!("{count} boxes"), "at most 8 boxes")?;
        at.require(
            this.sector_width_deg() >= MIN_SECTOR_DEG,
            "approach_sector_deg",
            format!("{:?}", this.approach_sector_deg),
            "a sector of 20 deg or more, clockwise",
        )?;
    }
}

impl SurroundingsConfig {
    fn sector_width_deg(&self) -> f64 {
        let [from, to] = self.approach_sector_deg;
        let width = (to - from).rem_euclid(360.0);
        if width == 0.0 && to != from { 360.0 } else { width }
    }

    /// Checks for volumes in the descent to this deck, or in the escape corridor.
    pub fn check_deck(&self, deck: &DeckGeometry, at: &Keys<'_>) -> Result<(), ConfigError> {
        let around = self.around(deck);
        let half = [0.5 * deck.length_m, 0.5 * deck.width_m];
        for (i, volume) in around.keep_out.iter().enumerate() {
            let overlaps = |k: usize| {
                let reach = half[k] + COLUMN_MARGIN_M;
                f64::from(volume.low[k]) < reach && f64::from(volume.high[k]) > -reach
            };
            at.require(
                !(overlaps(0) && overlaps(1)),
                &format!("keep_out_m[{i}]"),
                format!("{:?}", self.keep_out_m[i]),
                "half a metre or more outside the deck's outline",
            )?;
        }
        if let (Some(deg), Some(u)) = (self.escape_deg, around.escape_direction()) {
            let reach = around.reach_m();
            let blocked = |v: &KeepOut| {
                let from = Vector3::new(0.0, 0.0, f64::from(v.low[2]));
                v.low[2] < 0.0 && v.blocks(&from, u, reach, ESCAPE_HALF_WIDTH_M)
            };
            let free = !around.keep_out.iter().any(blocked);
            at.require(free, "escape_deg", deg, "a direction without a keep-out volume")?;
        }
        Ok(())
    }

    /// These surroundings relative to the deck's centre.
    pub fn around(&self, deck: &DeckGeometry) -> Surroundings {
        let from = wrap_angle(self.approach_sector_deg[0].to_radians());
        Surroundings {
            keep_out: KeepOut::all(&self.keep_out_m, deck),
            sector: [from as f32, self.sector_width_deg().to_radians() as f32],
            escape: self.escape_deg.map(|deg| wrap_angle(deg.to_radians()) as f32),
        }
    }
}

/// Box along the deck's axes (forward, right, down) relative to the deck's centre, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct KeepOut {
    /// Aftmost, leftmost, highest corner relative to the deck's centre, m.
    pub low: [f32; 3],
    /// Foremost, rightmost, lowest corner relative to the deck's centre, m.
    pub high: [f32; 3],
}

impl KeepOut {
    /// Boxes from pairs of opposite corners in the vessel's body frame, m; at most [`MAX_KEEP_OUT`].
    pub fn all(corners: &[[[f64; 3]; 2]], deck: &DeckGeometry) -> Seq<KeepOut, MAX_KEEP_OUT> {
        Seq::filled(corners.iter().map(|[a, b]| {
            let place = |i: usize, v: f64| (v - deck.centre_m[i]) as f32;
            KeepOut {
                low: core::array::from_fn(|i| place(i, a[i].min(b[i]))),
                high: core::array::from_fn(|i| place(i, a[i].max(b[i]))),
            }
        }))
    }
    /// Distance of the point `p` (deck frame, m) beyond the box along each axis, m; negative inside.
    pub fn beyond(&self, p: &Vector3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|i, _| (f64::from(self.low[i]) - p[i]).max(p[i] - f64::from(self.high[i])))
    }
    /// Distance of the point `p` (deck frame, m) from the box, m; 0 inside.
    pub fn distance(&self, p: &Vector3<f64>) -> f64 {
        self.beyond(p).map(|v| v.max(0.0)).norm()
    }
    /// Whether the box is nearer than `margin` to the horizontal path of `length` from the point `from` along
    /// `along` (forward and right); deck frame, m.
    pub fn blocks(&self, from: &Vector3<f64>, along: [f64; 2], length: f64, margin: f64) -> bool {
        let steps = (length / WAY_STEP_M).ceil() as u32;
        (0..=steps).any(|k| {
            let s = WAY_STEP_M * f64::from(k);
            self.distance(&(from + Vector3::new(s * along[0], s * along[1], 0.0))) < margin
        })
    }
    fn reach_m(&self) -> f64 {
        let far = |i: usize| f64::from(self.low[i].abs().max(self.high[i].abs()));
        far(0).hypot(far(1))
    }
}

/// Obstacles around a deck, in the deck's axes relative to its centre.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Surroundings {
    /// Keep-out volumes.
    pub keep_out: Seq<KeepOut, MAX_KEEP_OUT>,
    /// Approach sector: its first bearing relative to the bow and its width clockwise, rad.
    pub sector: [f32; 2],
    /// Escape direction relative to the bow, rad; None: straight up.
    pub escape: Option<f32>,
}

impl Default for Surroundings {
    fn default() -> Self {
        Surroundings {
            keep_out: Seq::new(),
            sector: [0.0, TAU as f32],
            escape: None,
        }
    }
}

impl Surroundings {
    /// Whether there are neither obstacles nor restricted directions.
    pub fn is_empty(&self) -> bool {
        self.keep_out.is_empty() && self.is_open() && self.escape.is_none()
    }
    /// Whether drones may approach from any direction.
    pub fn is_open(&self) -> bool {
        f64::from(self.sector[1]) > TAU - 1e-3
    }
    /// Whether all numbers are finite, the corners ordered and the sector at most a full turn.
    pub fn is_sound(&self) -> bool {
        let sound = |v: &KeepOut| {
            within(v.low.iter().chain(&v.high), 500.0) && v.low.iter().zip(&v.high).all(|(a, b)| a <= b)
        };
        self.keep_out.iter().all(sound)
            && within(&self.sector[..1], 7.0)
            && (0.1..=7.0).contains(&self.sector[1])
            && within(&self.escape, 7.0)
    }
    /// Horizontal distance of the furthest corner of a volume from the deck's centre, m.
    pub fn reach_m(&self) -> f64 {
        self.keep_out.iter().map(KeepOut::reach_m).fold(0.0, f64::max)
    }
    /// Minimum height of waiting or approaching drones above the mean deck level, m: above all volumes.
    pub fn wait_height_m(&self) -> f64 {
        let above = |v: &KeepOut| WAIT_ABOVE_M - f64::from(v.low[2]) + TILT_RAD * v.reach_m();
        self.keep_out.iter().map(above).fold(0.0, f64::max)
    }
    /// Angle of a bearing (relative to the bow) outside the approach sector narrowed by `margin` on both
    /// sides, rad: positive if the nearest permitted bearing is clockwise; 0 inside.
    pub fn outside_sector(&self, bearing: f64, margin: f64) -> f64 {
        if self.is_open() {
            return 0.0;
        }
        let half = 0.5 * f64::from(self.sector[1]);
        let off = wrap_angle(bearing - f64::from(self.sector[0]) - half);
        let inside = (half - margin).clamp(0.0, PI);
        off.clamp(-inside, inside) - off
    }
    /// Forward and right components of the escape direction.
    pub fn escape_direction(&self) -> Option<[f64; 2]> {
        let (sin, cos) = f64::from(self.escape?).sin_cos();
        Some([cos, sin])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::parse;

    const MAST: &str = "keep_out_m = [[[2.6, -0.2, -9.3], [2.2, 0.2, 0.0]]]";

    fn error(text: &str) -> Option<String> {
        let around = parse::<SurroundingsConfig>(text, "test");
        let checked = around.and_then(|s| s.check_deck(&DeckGeometry::default(), &Keys::ROOT));
        checked.err().map(|e| e.to_string())
    }

    #[test]
    fn surroundings_in_the_way_of_a_landing() {
        assert_eq!(error(MAST), None);
        assert_eq!(error("approach_sector_deg = [90, 270]\nescape_deg = 180"), None);
        let box_ = "[[2.2, -0.2, -9.3], [2.6, 0.2, 0.0]]";
        for (text, key) in [
            (
                format!("keep_out_m = [{}]", [box_; 9].join(", ")),
                "`keep_out_m` is 9 boxes",
            ),
            (
                "keep_out_m = [[[1.5, 0, -3], [3, 1, -1]]]".into(),
                "`keep_out_m[0]` is [[1.5, 0.0, -3.0]",
            ),
            (
                "keep_out_m = [[[nan, 0, -3], [3, 1, -1]]]".into(),
                "`keep_out_m[0][0][0]` is NaN",
            ),
            (
                "approach_sector_deg = [90, 90]".into(),
                "`approach_sector_deg` is [90.0, 90.0]",
            ),
            (format!("{MAST}\nescape_deg = -10"), "`escape_deg` is -10"),
        ] {
            let e = error(&text).unwrap_or_default();
            assert!(e.contains(key), "{text}: {e}");
        }
    }

    #[test]
    fn surroundings_message_size_and_finiteness() {
        use crate::{
            msg::{Message, VesselSurroundings},
            time::VesselClock,
        };
        let mut m = VesselSurroundings::<VesselClock>::default();
        m.surroundings.keep_out = Seq::filled([KeepOut::default(); MAX_KEEP_OUT]);
        m.surroundings.escape = Some(1.0);
        assert!(crate::wire::encode(&m).is_ok_and(|b| b.len() <= crate::topics::SURROUNDINGS.bytes));
        assert_eq!(m.check(), Ok(()));
        let mut wrong = [m; 4];
        wrong[0].surroundings.keep_out[7].high[1] = f32::INFINITY;
        wrong[1].surroundings.keep_out[0].low[2] = 1.0;
        wrong[2].surroundings.sector[1] = f32::NAN;
        wrong[3].surroundings.escape = Some(f32::NAN);
        assert!(wrong.iter().all(|m| m.check() == Err("surroundings")));
    }

    #[test]
    fn shorter_way_into_the_approach_sector() {
        let aft = parse::<SurroundingsConfig>("approach_sector_deg = [120, 240]", "test");
        let aft = aft.unwrap().around(&DeckGeometry::default());
        for (bearing, margin, turn) in [
            (180.0, 0.0, 0.0),
            (100.0, 0.0, 20.0),
            (125.0, 10.0, 5.0),
            (-80.0, 0.0, -40.0),
        ] {
            let out = aft.outside_sector(f64::to_radians(bearing), f64::to_radians(margin));
            assert!((out.to_degrees() - turn).abs() < 1e-3, "{bearing}: {out}");
        }
        assert_eq!(Surroundings::default().outside_sector(1.0, 0.2), 0.0);
    }
}
