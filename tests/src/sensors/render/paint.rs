//! Reflectance of the deck's paint, its tags and the sea. Light is a fraction of the light from a white surface.

use alight_shared::{
    frames::{TrueNed, Vector},
    geometry::DeckGeometry,
    tags::{DeckTag, MARGIN},
};
use alight_uav::camera::layout::{CELLS, cells};
use nalgebra::{Matrix3, Vector3};

use super::{
    super::{
        camera::CameraMotion,
        night::{NightConfig, TAG},
    },
    rays::Ray,
};
use crate::sensors::noise::Noise;

/// Minimum side of a cell that the detector can decode, px.
const DECODED_CELL_PX: f64 = 1.5;
const PLANK_M: f32 = 0.14;

/// Number of index cells along each axis of the deck.
const INDEX: usize = 64;

#[derive(Clone, Debug)]
struct Painted {
    centre: [f32; 2],
    /// Side of a cell, m.
    cell: f32,
    white: [[bool; CELLS]; CELLS],
    /// Light from white and from black cells.
    light: [f32; 2],
}

impl Painted {
    fn light(&self, white: bool) -> f32 {
        self.light[usize::from(!white)]
    }
    /// None outside the tag.
    fn at(&self, x: f32, y: f32) -> Option<f32> {
        let [row, column] = [self.row(x), self.column(y)];
        let across = 0.0..CELLS as f32;
        let on = across.contains(&column) && across.contains(&row);
        on.then(|| self.light(self.white[row as usize][column as usize]))
    }
    /// Row or column of cells, counted from the upper left corner of the margin; the tag's upper edge is forward.
    fn row(&self, x: f32) -> f32 {
        0.5 * CELLS as f32 - (x - self.centre[0]) / self.cell
    }
    fn column(&self, y: f32) -> f32 {
        (y - self.centre[1]) / self.cell + 0.5 * CELLS as f32
    }
    fn within(&self, patch: &Patch) -> Paint {
        let rows = [self.row(patch.x[1]), self.row(patch.x[0])];
        let columns = [self.column(patch.y[0]), self.column(patch.y[1])];
        let across = 0.0..CELLS as f32;
        if [rows, columns]
            .iter()
            .any(|[from, to]| *to < 0.0 || *from >= across.end)
        {
            return Paint::Outside;
        }
        if ![rows, columns].as_flattened().iter().all(|v| across.contains(v)) {
            return Paint::Edges;
        }
        let [rows, columns] = [rows, columns].map(|[from, to]| from as usize..=to as usize);
        let mut cells = self.white[rows].iter().flat_map(|row| &row[columns.clone()]);
        match cells.next() {
            Some(first) if cells.all(|c| c == first) => Paint::Even(self.light(*first)),
            Some(_) | None => Paint::Edges,
        }
    }
}

/// Rectangle on the deck, with forward and starboard axes, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub(super) x: [f32; 2],
    pub(super) y: [f32; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Paint {
    Outside,
    Even(f32),
    Edges,
}

#[derive(Clone, Debug)]
pub(super) struct DeckPaint {
    half: [f32; 2],
    tags: Vec<Painted>,
    /// Bit mask of the tags that overlap each index cell.
    index: Vec<u32>,
    /// Light from a white surface.
    scene: f32,
}

impl DeckPaint {
    pub(super) fn new(deck: &DeckGeometry) -> DeckPaint {
        let paint = |tag: &DeckTag| {
            Some(Painted {
                centre: [tag.centre_m[0], tag.centre_m[1]].map(|v| v as f32),
                cell: (tag.side_m * MARGIN / CELLS as f64) as f32,
                white: cells(tag.id)?,
                light: TAG.map(|reflectance| reflectance as f32),
            })
        };
        let half = [deck.length_m, deck.width_m].map(|v| (0.5 * v) as f32);
        let tags: Vec<Painted> = deck.tags().iter().filter_map(paint).collect();
        let index = (0..INDEX * INDEX).map(|k| {
            let part = half.map(|h| h / INDEX as f32);
            let middle = [k / INDEX, k % INDEX].map(|i| 2.0 * i as f32 + 1.0);
            let near = |tag: &Painted| {
                let reach = 0.5 * CELLS as f32 * tag.cell;
                (0..2)
                    .all(|i| (part[i] * middle[i] - half[i] - tag.centre[i]).abs() <= reach + 1.01 * part[i])
            };
            tags.iter()
                .zip(0..)
                .fold(0, |bits, (tag, k)| bits | (u32::from(near(tag)) << k))
        });
        DeckPaint {
            half,
            index: index.collect(),
            tags,
            scene: 1.0,
        }
    }
    /// Paint at night, with light in lux on white.
    pub(super) fn at_night(mut self, night: &NightConfig) -> DeckPaint {
        self.scene = night.scene_lux() as f32;
        let light = night.tag_lux().map(|lux| lux as f32);
        self.tags.iter_mut().for_each(|tag| tag.light = light);
        self
    }
    /// Side of the smallest cell that can be decoded at `px` per metre; if none can be decoded, that of the largest.
    pub(super) fn min_cell_px(&self, px: f64) -> f64 {
        let cells = || self.tags.iter().map(|tag| f64::from(tag.cell) * px);
        let most = cells().fold(0.0, f64::max);
        cells()
            .filter(|cell| *cell >= DECODED_CELL_PX)
            .fold(most, f64::min)
    }
    /// Light from a point at a position forward and to starboard, m; None outside the deck.
    #[inline]
    pub(super) fn at(&self, x: f32, y: f32) -> Option<f32> {
        if !(x.abs() <= self.half[0] && y.abs() <= self.half[1]) {
            return None;
        }
        let part =
            |v: f32, half: f32| ((v / half + 1.0) * (0.5 * INDEX as f32)).min(INDEX as f32 - 1.0) as usize;
        let k = part(x, self.half[0]) * INDEX + part(y, self.half[1]);
        let mut bits = self.index.get(k).copied().unwrap_or(0);
        while bits != 0 {
            if let Some(light) = self
                .tags
                .get(bits.trailing_zeros() as usize)
                .and_then(|tag| tag.at(x, y))
            {
                return Some(light);
            }
            bits &= bits - 1;
        }
        Some(self.plank(y))
    }
    fn plank(&self, y: f32) -> f32 {
        let plank = (y / PLANK_M).floor() as i32;
        self.scene * if plank % 2 == 0 { 0.42 } else { 0.50 }
    }
    pub(super) fn covers(&self, patch: &Patch) -> bool {
        let sides = [(patch.x, self.half[0]), (patch.y, self.half[1])];
        sides
            .iter()
            .all(|([from, to], half)| -half <= *from && to <= half)
    }
    /// Content of a patch; reported as edges where an exact answer would be expensive.
    pub(super) fn within(&self, patch: &Patch) -> Paint {
        let sides = [(patch.x, self.half[0]), (patch.y, self.half[1])];
        if sides.iter().any(|([from, to], half)| *to < -half || from > half) {
            return Paint::Outside;
        }
        if !self.covers(patch) {
            return Paint::Edges;
        }
        // As for a point, the first tag that overlaps decides.
        for tag in &self.tags {
            match tag.within(patch) {
                Paint::Outside => {}
                paint => return paint,
            }
        }
        let [from, to] = patch.y.map(|y| (y / PLANK_M).floor());
        if from == to {
            Paint::Even(self.plank(patch.y[0]))
        } else {
            Paint::Edges
        }
    }
    /// Points along the deck's edge, in its axes, m.
    pub(super) fn outline(&self) -> impl Iterator<Item = Vector3<f64>> {
        let [x, y] = self.half.map(f64::from);
        (0..16).flat_map(move |k| {
            let s = f64::from(k) / 8.0 - 1.0;
            [
                Vector3::new(s * x, -y, 0.0),
                Vector3::new(x, s * y, 0.0),
                Vector3::new(-s * x, y, 0.0),
                Vector3::new(-x, -s * y, 0.0),
            ]
        })
    }
}

/// Side of the square noise tile for the sea's texture, in points.
const TILE: usize = 128;

/// The sea: moving light and dark patches, glitter towards the sun, and haze far away.
#[derive(Clone, Debug)]
pub(super) struct SeaPaint {
    tile: Vec<f32>,
}

impl SeaPaint {
    pub(super) fn new(draw: &mut Noise) -> SeaPaint {
        let rough: Vec<f32> = (0..TILE * TILE).map(|_| draw.normal() as f32).collect();
        // Smooths over three points, with wrap-around.
        let at = |x: usize, y: usize| rough.get((y % TILE) * TILE + x % TILE).copied().unwrap_or(0.0);
        let tile = (0..TILE * TILE).map(|k| {
            let (x, y) = (k % TILE + TILE, k / TILE + TILE);
            let cross = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
            0.4 * (at(x, y) + 0.5 * cross)
        });
        SeaPaint { tile: tile.collect() }
    }
    fn noise(&self, x: f32, y: f32) -> f32 {
        let (column, row) = (floor(x), floor(y));
        let k = (row.rem_euclid(TILE as i64) as usize) * TILE + column.rem_euclid(TILE as i64) as usize;
        self.tile.get(k).copied().unwrap_or(0.0)
    }
    /// The sea at one time in view of the camera.
    pub(super) fn scene(&self, view: &CameraMotion, sun: Vector<TrueNed>, t_s: f32) -> SeaScene<'_> {
        let world = view.camera_from_world.inverse().0.to_rotation_matrix();
        let centre = view.centre.0.map(|v| v as f32);
        SeaScene {
            sea: self,
            world: world.matrix().map(|v| v as f32),
            centre,
            height: (-centre.z).max(0.3),
            mirrored: [sun.0.x as f32, sun.0.y as f32, -sun.0.z as f32],
            t_s,
        }
    }
}

/// Largest integer not above `x`; without SSE 4.1 `f32::floor` would be a function call.
fn floor(x: f32) -> i64 {
    let whole = x as i64;
    whole - i64::from(whole as f32 > x)
}

pub(super) struct SeaScene<'a> {
    sea: &'a SeaPaint,
    /// Rotation world from camera.
    world: Matrix3<f32>,
    /// Position of the camera, m, and its height above the sea, m.
    centre: Vector3<f32>,
    height: f32,
    /// Direction to the sun's mirror image.
    mirrored: [f32; 3],
    t_s: f32,
}

impl SeaScene<'_> {
    /// Light of the sea below the horizon, and of the sky above it.
    pub(super) fn light(&self, ray: &Ray) -> f32 {
        let (m, [u, v]) = (&self.world, ray.at);
        let d = [0, 1, 2].map(|i| m[(i, 0)] * u + m[(i, 1)] * v + m[(i, 2)]);
        let down = d[2];
        if down <= 0.02 {
            return 0.85;
        }
        let reach = self.height / down;
        let (north, east) = (self.centre.x + d[0] * reach, self.centre.y + d[1] * reach);
        // Swell of several metres and ripples of decimetres, which fade in the haze.
        let (sea, t_s) = (self.sea, self.t_s);
        let swell = sea.noise(0.45 * north + 0.9 * t_s, 0.45 * east);
        let ripple = sea.noise(5.0 * north + 4.0 * t_s, 5.0 * east - 3.0 * t_s);
        let near = 1.0 / (1.0 + 0.05 * reach);
        let cos = (d[0] * self.mirrored[0] + d[1] * self.mirrored[1] + down * self.mirrored[2])
            / (d[0] * d[0] + d[1] * d[1] + down * down).sqrt();
        // More facets mirror the sun in the direction of its image.
        let glitter = if ripple > 1.6 - 1.3 * cos.max(0.0).powi(8) {
            1.2
        } else {
            0.0
        };
        (0.24 + near * (0.04 * swell + 0.05 * ripple + glitter)).max(0.05)
    }
}
