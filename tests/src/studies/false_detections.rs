//! Images without the deck's whole tag: how often the camera node sees one all the same.
//!
//! Water with glitter, foam, a bare wet deck and the seas are rendered; structure, other tags and what
//! covers half of the right one are drawn over rendered images. A rendered image serves several times,
//! mirrored, which makes another image of it for the detector.

use alight_shared::frames::{Point, TrueNed, Vector};
use alight_shared::geometry::DeckGeometry;
use alight_uav::camera::{CameraSettings, GreyImage};
use nalgebra::{Rotation2, Vector2, Vector3};
use serde::Serialize;

use super::camera::{CameraBench, Condition};
use crate::physics::streams::Streams;
use crate::sensors::SensorConfig;
use crate::sensors::noise::Noise;
use crate::sensors::render::{Renderer, Shot};
use crate::studies::statistics::wilson;

/// Content of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum SceneKind {
    /// Swell, ripples and the sun's glitter.
    Water,
    /// Water with patches and streaks of foam.
    Foam,
    /// A deck without a tag, some of it wet.
    BareDeck,
    /// Boxes, hatches, gratings, chequered fields and lines on a deck.
    Structure,
    /// Squares with other codes: other numbers of the family, other families.
    OtherTags,
    /// The deck's tag with about half of it covered.
    HalfTag,
}

impl SceneKind {
    /// All of them.
    pub const ALL: [SceneKind; 6] = [
        SceneKind::Water,
        SceneKind::Foam,
        SceneKind::BareDeck,
        SceneKind::Structure,
        SceneKind::OtherTags,
        SceneKind::HalfTag,
    ];
}

/// One row.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FalseDetectionRow {
    /// Content of the images; None for all together.
    pub kind: Option<SceneKind>,
    /// Images.
    pub images: u64,
    /// Tags of the family with another number that the detector reported.
    pub other_tags: u64,
    /// Tags with the deck's number that the detector reported.
    pub reported: u64,
    /// Those that passed the node's own gates: false sightings.
    pub detections: u64,
    /// 95 % interval of the share of images with a false sighting (Wilson).
    pub share_95: [f64; 2],
}

impl FalseDetectionRow {
    fn new(
        kind: Option<SceneKind>,
        images: u64,
        other_tags: u64,
        reported: u64,
        detections: u64,
    ) -> FalseDetectionRow {
        let (low, high) = wilson(detections as usize, images as usize);
        FalseDetectionRow {
            kind,
            images,
            other_tags,
            reported,
            detections,
            share_95: [low, high],
        }
    }
    /// All rows as one.
    pub fn total(rows: &[FalseDetectionRow]) -> FalseDetectionRow {
        let sum = |of: fn(&FalseDetectionRow) -> u64| rows.iter().map(of).sum();
        FalseDetectionRow::new(
            None,
            sum(|r| r.images),
            sum(|r| r.other_tags),
            sum(|r| r.reported),
            sum(|r| r.detections),
        )
    }
}

/// Number of uses of a rendered image: as it is, mirrored either way, and both.
const TURNS: usize = 4;

/// The bench with a bare deck and a brush.
pub struct FalseDetectionBench {
    bench: CameraBench,
    bare: Renderer,
    draw: Noise,
}

impl FalseDetectionBench {
    /// Everything of one seed.
    pub fn new(
        sensors: &SensorConfig,
        settings: &CameraSettings,
        deck: &DeckGeometry,
        seed: u64,
    ) -> FalseDetectionBench {
        let streams = Streams::new(seed);
        // A tag of 1 mm is too small to be detected.
        let bare = DeckGeometry {
            tag_side_m: Some(0.001),
            ..*deck
        };
        FalseDetectionBench {
            bench: CameraBench::new(sensors, settings, deck, seed),
            bare: Renderer::new(&sensors.render, &bare, &streams),
            draw: Noise::new(&streams, "study.camera.empty"),
        }
    }
    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.draw.uniform()
    }
    fn shot(&mut self, kind: SceneKind) -> Shot {
        let near = kind == SceneKind::HalfTag;
        let condition = Condition {
            range_m: if near {
                self.within(1.6, 12.0)
            } else {
                self.within(1.5, 30.0)
            },
            incidence_deg: self.within(0.0, if near { 45.0 } else { 60.0 }),
            blur_px: self.within(0.0, 2.0),
            glare: 0.0,
        };
        let mut shot = self.bench.shot(&condition);
        if matches!(kind, SceneKind::Water | SceneKind::Foam) {
            // The deck far away: the sea alone.
            shot.deck.position = Point::new(1e4, 1e4, -1.3);
        }
        shot
    }
    fn render(&mut self, kind: SceneKind, shot: &Shot) -> Option<GreyImage> {
        if kind == SceneKind::HalfTag {
            return self.bench.image(shot);
        }
        let sun = Vector3::new(self.draw.normal(), self.draw.normal(), -1.0).normalize();
        self.bare.lit_from(Vector::<TrueNed>::from(sun));
        let wet = self.draw.chance(0.3);
        let glare = if wet { self.within(0.1, 3.0) } else { 0.0 };
        self.bare.set_glare(glare);
        self.bare.image(shot)
    }

    /// `images` of a kind.
    pub fn row(&mut self, kind: SceneKind, images: usize) -> FalseDetectionRow {
        let before = self.bench.node().counts();
        let mut detections = 0;
        let (mut at, mut ground) = (None, None);
        for k in 0..images {
            if k % TURNS == 0 {
                let shot = self.shot(kind);
                ground = self.render(kind, &shot);
                at = self.bench.tag_px(&shot);
            }
            let Some(image) = &ground else { continue };
            let drawn = self.over(kind, image, at, k % TURNS);
            let Ok(image) = drawn else { continue };
            detections += u64::from(self.bench.node().detect(&image).is_some());
        }
        let after = self.bench.node().counts();
        let own = |c: alight_uav::camera::detector::TagCounts| c.detected + c.faint + c.misshapen + c.misfit;
        FalseDetectionRow::new(
            Some(kind),
            after.images - before.images,
            after.other_tags - before.other_tags,
            own(after) - own(before),
            detections,
        )
    }

    /// The image, mirrored and drawn over.
    fn over(
        &mut self,
        kind: SceneKind,
        image: &GreyImage,
        tag: Option<([f64; 2], f64)>,
        turn: usize,
    ) -> Result<GreyImage, alight_uav::camera::ImageError> {
        let mut canvas = Canvas {
            size: [image.width(), image.height()],
            pixels: image.pixels().to_vec(),
        };
        match kind {
            SceneKind::Water | SceneKind::BareDeck => canvas.turn(turn),
            SceneKind::Foam => {
                canvas.turn(turn);
                self.foam(&mut canvas);
            }
            SceneKind::Structure => {
                canvas.turn(turn);
                self.structure(&mut canvas);
            }
            SceneKind::OtherTags => {
                canvas.turn(turn);
                self.other_tags(&mut canvas);
            }
            SceneKind::HalfTag => {
                if let Some((centre, side)) = tag {
                    self.cover(&mut canvas, centre, side);
                }
            }
        }
        GreyImage::new(canvas.size[0], canvas.size[1], canvas.pixels)
    }
    fn place(&mut self, canvas: &Canvas, size: [f64; 2]) -> Stamp {
        Stamp {
            centre: Vector2::new(
                self.within(0.0, canvas.size[0] as f64),
                self.within(0.0, canvas.size[1] as f64),
            ),
            turn: Rotation2::new(self.within(-3.1, 3.1)),
            half: Vector2::from(size) * 0.5,
        }
    }
    fn foam(&mut self, canvas: &mut Canvas) {
        for _ in 0..self.within(5.0, 40.0) as usize {
            let size = [self.within(4.0, 120.0), self.within(2.0, 20.0)];
            let stamp = self.place(canvas, size);
            let (level, seed) = (self.within(150.0, 255.0) as u8, self.draw.uniform().to_bits());
            canvas.stamp(&stamp, |u, v| {
                // Ragged: less of it towards the edge.
                let grain = hash(seed, (u * 0.7) as i64, (v * 0.7) as i64);
                let r2 = (u / stamp.half.x).powi(2) + (v / stamp.half.y).powi(2);
                (grain > r2).then_some(level)
            });
        }
    }
    fn structure(&mut self, canvas: &mut Canvas) {
        for _ in 0..self.within(3.0, 14.0) as usize {
            let size = [self.within(8.0, 260.0), self.within(3.0, 200.0)];
            let stamp = self.place(canvas, size);
            let levels = [self.within(0.0, 255.0) as u8, self.within(0.0, 255.0) as u8];
            let (pitch, style) = (self.within(2.0, 30.0), self.within(0.0, 4.0) as u8);
            let pick = |odd: bool| Some(if odd { levels[1] } else { levels[0] });
            canvas.stamp(&stamp, |u, v| {
                let cell = |x: f64| (x / pitch).floor() as i64;
                match style {
                    0 => Some(levels[0]),
                    1 => pick(cell(u) % 2 == 0),
                    2 => pick((cell(u) + cell(v)) % 2 == 0),
                    _ => pick(stamp.half.x - u.abs() > pitch && stamp.half.y - v.abs() > pitch),
                }
            });
        }
    }
    fn other_tags(&mut self, canvas: &mut Canvas) {
        for _ in 0..self.within(1.0, 6.0) as usize {
            let bits = [4, 5, 6, 6, 6, 7][self.within(0.0, 6.0) as usize % 6];
            let cell = self.within(2.0, 14.0);
            let (cells, seed) = (bits as f64 + 4.0, self.draw.uniform().to_bits());
            let known = OTHER_CODES[self.within(0.0, OTHER_CODES.len() as f64) as usize % OTHER_CODES.len()];
            let named = bits == 6 && self.draw.chance(0.5);
            let stamp = self.place(canvas, [cells * cell; 2]);
            canvas.stamp(&stamp, |u, v| {
                let at = |x: f64, half: f64| ((x + half) / cell).floor() as i64 - 2;
                let (column, row) = (at(u, stamp.half.x), at(v, stamp.half.y));
                let [edge, margin] =
                    [-1, -2].map(|k| [column, row].iter().any(|c| *c == k || *c == bits - 1 - k));
                let white = if margin {
                    true
                } else if edge {
                    false
                } else if named {
                    (known >> (35 - (row * 6 + column)).clamp(0, 35)) & 1 == 1
                } else {
                    hash(seed, column, row) > 0.5
                };
                Some(if white { 205 } else { 15 })
            });
        }
    }
    /// Covers the tag from an edge through its middle, about.
    fn cover(&mut self, canvas: &mut Canvas, centre: [f64; 2], side: f64) {
        let turn = Rotation2::new(self.within(-3.1, 3.1));
        let offset = self.within(0.85, 1.15) * 1.5 * side;
        let stamp = Stamp {
            centre: Vector2::from(centre) + turn * Vector2::new(offset, 0.0),
            turn,
            half: Vector2::new(1.5, 3.0) * side,
        };
        let level = self.within(0.0, 255.0) as u8;
        canvas.stamp(&stamp, |_, _| Some(level));
    }
}

/// The second to the eighth code of the family 36h11 (Wang and Olson 2016).
const OTHER_CODES: [u64; 7] = [
    0xd_97f1_8b49,
    0xd_d280_910e,
    0xe_479e_9c98,
    0xe_bcbc_a822,
    0xf_31da_b3ac,
    0x0_56a5_d085,
    0x1_0652_e1d4,
];

/// Uniform in [0, 1) for a cell (Steele et al. 2014, the finaliser of SplitMix).
fn hash(seed: u64, u: i64, v: i64) -> f64 {
    let mut x = seed ^ (u as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (v as u64).rotate_left(32);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A turned rectangle in an image, px.
struct Stamp {
    centre: Vector2<f64>,
    turn: Rotation2<f64>,
    half: Vector2<f64>,
}

struct Canvas {
    size: [usize; 2],
    pixels: Vec<u8>,
}

impl Canvas {
    /// 1: left and right exchanged; 2: above and below; 3: both.
    fn turn(&mut self, how: usize) {
        if how >= 2 {
            self.pixels.reverse();
        }
        if how == 1 || how == 2 {
            for row in self.pixels.chunks_mut(self.size[0]) {
                row.reverse();
            }
        }
    }
    /// Sets the pixels whose middle lies in the rectangle to the result of `paint` there, from its centre.
    fn stamp(&mut self, s: &Stamp, paint: impl Fn(f64, f64) -> Option<u8>) {
        let reach = s.half.norm();
        let [columns, rows] = [0, 1].map(|i| {
            let max = self.size[i] as f64;
            let clamped = |v: f64| v.clamp(0.0, max) as usize;
            clamped(s.centre[i] - reach)..clamped(s.centre[i] + reach + 1.0)
        });
        for row in rows {
            for column in columns.clone() {
                let p = s.turn.inverse() * (Vector2::new(column as f64, row as f64) - s.centre);
                if p.x.abs() > s.half.x || p.y.abs() > s.half.y {
                    continue;
                }
                if let (Some(level), Some(out)) =
                    (paint(p.x, p.y), self.pixels.get_mut(row * self.size[0] + column))
                {
                    *out = level;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn empty() -> FalseDetectionBench {
        let deck = DeckGeometry::default();
        FalseDetectionBench::new(&SensorConfig::default(), &CameraSettings::default(), &deck, 3)
    }

    #[test]
    fn other_tags_at_the_camera_node() {
        let row = empty().row(SceneKind::OtherTags, 60);
        assert_eq!((row.images, row.detections), (60, 0));
        assert!(row.other_tags > 20, "{row:?}");
    }

    #[test]
    fn half_covered_tag_at_the_camera_node() {
        let row = empty().row(SceneKind::HalfTag, 60);
        assert_eq!((row.images, row.detections), (60, 0), "{row:?}");
    }

    #[test]
    fn uncovered_tag_at_the_camera_node() {
        let mut empty = empty();
        let mut detected = 0;
        for _ in 0..20 {
            let shot = empty.shot(SceneKind::HalfTag);
            let image = empty.bench.image(&shot).unwrap();
            detected += usize::from(empty.bench.node().detect(&image).is_some());
        }
        assert!(detected >= 16, "{detected} of 20");
    }

    #[test]
    fn mirrored_canvas() {
        let turned = |how| {
            let mut c = Canvas {
                size: [3, 2],
                pixels: vec![1, 2, 3, 4, 5, 6],
            };
            c.turn(how);
            c.pixels
        };
        assert_eq!(turned(1), [3, 2, 1, 6, 5, 4]);
        assert_eq!(turned(2), [4, 5, 6, 1, 2, 3]);
        assert_eq!(turned(3), [6, 5, 4, 3, 2, 1]);
    }
}
