//! Detection of the deck's tags in family 36h11.

use alight_shared::{
    config,
    tags::{DeckTag, MAX_TAGS, Tags},
};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{
    apriltag::{Family, Library},
    image::GreyImage,
    light::TagLight,
    motion_blur::motion_blur_px2,
};

const MAX_DETECTIONS: usize = 64;

config! {
    pub struct TagSettings {
        /// Number of the deck's tag in family 36h11, for a deck with a single tag (`drone.deck.tag_side_m`).
        pub id: u16 = 0, in 0.0..=586.0;
        /// Maximum number of wrong bits (of 36) that are corrected.
        pub bits_corrected: u8 = 1, in 0.0..=2.0;
        /// Minimum decision margin: mean contrast of the bits against their threshold, grey levels.
        pub min_margin: f64 = 20.0, in 0.0..=255.0;
        /// Minimum side of a tag in the image, px.
        pub min_side_px: f64 = 10.0, in 5.0..=1e4;
        /// Factor by which the image is reduced for the search; corners are refined at full resolution.
        /// Chosen: at full resolution 640 x 480 takes twice the time and extends the range by 3 m.
        pub decimate: f64 = 1.5, in 1.0..=4.0;
        /// Standard deviation of each corner coordinate of a large, sharp tag, px.
        /// Source: Twice the value of rendered images, for the residual error of a calibrated lens.
        pub corner_sd_px: f64 = 0.15, in 0.01..=20.0;
        /// Standard deviation of a corner as a fraction of the tag's side in the image: residual lens error after
        /// calibration.
        pub corner_sd_fraction: f64 = 0.0, in 0.0..=0.2;
        /// Standard deviation added in quadrature for tags up to `small_width_px` wide, px.
        /// Source: Rendered images give 0.17, 18 and 0.24.
        pub small_sd_px: f64 = 0.3, in 0.0..=20.0;
        /// Width of the tag in the image above which `small_sd_px` decreases with the fourth power of the width, px.
        pub small_width_px: f64 = 18.0, in 1.0..=1e4;
        /// Standard deviation added for motion blur, as a fraction of the squared blur over the tag's width.
        pub motion_blur_sd: f64 = 0.3, in 0.0..=20.0;
        /// Standard deviation of each tag's position on the deck, each axis, m. Not used for a single tag.
        /// Source: laid by tape on printed lines.
        pub place_sd_m: f64 = 0.002, in 0.0..=0.1;
        /// Maximum sum of a tag's squared reprojection errors, in corner variances. For several tags the limit has
        /// the same probability.
        pub max_misfit: f64 = 40.0, in 1.0..=1e6;
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagDetection {
    pub tag: DeckTag,
    /// Corners, px, in the order of [`super::square_pose::corners`]; the tag's upper edge is at the front.
    pub corners: [Vector2<f64>; 4],
    pub wrong_bits: usize,
    /// Decision margin, grey levels.
    pub margin: f64,
    /// Squared motion during the exposure, measured from the edges, px².
    pub motion_blur_px2: f64,
    pub light: TagLight,
}

impl TagDetection {
    fn overlaps(&self, other: &[Vector2<f64>; 4]) -> bool {
        let middle = |c: &[Vector2<f64>; 4]| c.iter().sum::<Vector2<f64>>() / 4.0;
        let diagonal = (self.corners[2] - self.corners[0]).norm();
        (middle(&self.corners) - middle(other)).norm() < diagonal
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TagCounts {
    pub images: u64,
    pub detected: u64,
    /// Number of detected tags of the family whose ids are not on the deck.
    pub other_tags: u64,
    pub faint: u64,
    /// Number of detections that are too small, mirrored or not convex.
    pub misshapen: u64,
    /// Number of detections whose corners fit no pose.
    pub misfit: u64,
    pub wrong_size: u64,
    /// Number of images with a pose that equal their predecessor in every pixel, because the source repeats an old
    /// image.
    pub repeated: u64,
}

pub struct TagDetector {
    settings: TagSettings,
    tags: Tags,
    /// None if memory ran out; images are then not searched.
    library: Option<Library>,
    pub counts: TagCounts,
}

impl TagDetector {
    pub fn new(settings: &TagSettings, tags: &Tags) -> TagDetector {
        TagDetector {
            settings: settings.clone(),
            tags: *tags,
            library: Library::new(Family::Tag36h11, settings.bits_corrected, settings.decimate),
            counts: TagCounts::default(),
        }
    }
    pub fn min_margin(&self) -> f64 {
        self.settings.min_margin
    }
    /// Tags of the deck. If detections with the same number overlap, the one with the highest contrast is kept.
    pub fn find(&mut self, image: &GreyImage) -> Vec<TagDetection> {
        self.counts.images += 1;
        self.search(image).unwrap_or_default()
    }
    fn search(&mut self, image: &GreyImage) -> Option<Vec<TagDetection>> {
        let library = self.library.as_mut()?;
        let mut best: Vec<TagDetection> = Vec::with_capacity(MAX_TAGS);
        for found in library.detect(image).iter().take(MAX_DETECTIONS) {
            let Some(tag) = self.tags.iter().find(|tag| usize::from(tag.id) == found.id) else {
                self.counts.other_tags += 1;
                continue;
            };
            let corners = in_order(found.corners);
            let detection = TagDetection {
                tag: *tag,
                corners,
                wrong_bits: found.wrong_bits,
                margin: found.margin,
                motion_blur_px2: motion_blur_px2(image, &corners),
                light: TagLight::of(image, &corners).unwrap_or_default(),
            };
            if !(detection.margin >= self.settings.min_margin) {
                self.counts.faint += 1;
            } else if !well_shaped(&corners, self.settings.min_side_px) {
                self.counts.misshapen += 1;
            } else {
                // Another boat's tag with this number is elsewhere in the image.
                let same = |b: &&mut TagDetection| b.tag.id == tag.id && b.overlaps(&corners);
                let room = best.len() < MAX_DETECTIONS;
                match best.iter_mut().find(same) {
                    Some(b) if detection.margin > b.margin => *b = detection,
                    Some(_) => {}
                    None if room => best.push(detection),
                    None => {}
                }
            }
        }
        Some(best)
    }
}

/// Converts the library's corners (counter-clockwise from the lower left of an upright tag; origin at the image corner)
/// to clockwise ones with the origin at the centre of the first pixel.
fn in_order(p: [[f64; 2]; 4]) -> [Vector2<f64>; 4] {
    let [left_low, right_low, right_high, left_high] = p.map(|[x, y]| Vector2::new(x - 0.5, y - 0.5));
    [left_low, left_high, right_high, right_low]
}

/// Whether the corners are convex and not mirrored, and every side is at least `min_side`.
fn well_shaped(p: &[Vector2<f64>; 4], min_side: f64) -> bool {
    (0..4).all(|k| {
        let (a, b, c) = (p[k], p[(k + 1) % 4], p[(k + 2) % 4]);
        (b - a).norm() >= min_side && (b - a).perp(&(c - b)) > 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::{super::layout::cells, *};
    use proptest::prelude::*;

    fn one(id: u16) -> Tags {
        Tags::filled([DeckTag {
            id,
            ..DeckTag::default()
        }])
    }

    /// Image of a tag viewed from straight above, with its upper left corner at `at` and cells of `cell` px.
    fn front(size: [usize; 2], at: [usize; 2], cell: usize, id: u16) -> GreyImage {
        let mut pixels = vec![200_u8; size[0] * size[1]];
        let cells = cells(id).unwrap();
        for v in 0..8 * cell {
            for u in 0..8 * cell {
                let white = cells[v / cell + 1][u / cell + 1];
                pixels[(at[1] + v) * size[0] + at[0] + u] = if white { 200 } else { 20 };
            }
        }
        GreyImage::new(size[0], size[1], pixels).unwrap()
    }

    #[test]
    fn drawn_tags_of_all_numbers() {
        let image = |id| front([100, 100], [18, 18], 8, id);
        for id in (0..587).step_by(7) {
            let mut detector = TagDetector::new(&TagSettings::default(), &one(id));
            let found = detector.find(&image(id));
            assert_eq!(
                found.iter().map(|f| (f.tag.id, f.wrong_bits)).collect::<Vec<_>>(),
                [(id, 0)]
            );
        }
    }

    #[test]
    fn detector_corner_order() {
        let mut detector = TagDetector::new(&TagSettings::default(), &one(0));
        let found = detector.find(&front([200, 160], [40, 30], 10, 0))[0];
        // Edges lie between pixels: 40 px are pixels 40 to 119, with outer edges at 39.5 and 119.5.
        let expected = [[39.5, 109.5], [39.5, 29.5], [119.5, 29.5], [119.5, 109.5]];
        for (p, e) in found.corners.iter().zip(expected) {
            // An edge without blur is located to an eighth of a pixel per axis.
            assert!((p - Vector2::from(e)).norm() < 0.25, "{p} {e:?}");
        }
        assert_eq!(found.wrong_bits, 0);
    }

    #[test]
    fn detector_with_tags_of_another_id() {
        let mut detector = TagDetector::new(&TagSettings::default(), &one(7));
        assert_eq!(detector.find(&front([200, 160], [40, 30], 10, 0)), []);
        assert_eq!(detector.counts.other_tags, 1);
    }

    #[test]
    fn tag_half_covered_from_any_side() {
        let mut detector = TagDetector::new(&TagSettings::default(), &one(0));
        let whole = front([160, 160], [40, 40], 10, 0);
        for (k, level) in (0..24).flat_map(|k| [0, 20, 90, 200, 255].map(|level| (k, level))) {
            let (sin, cos) = (core::f64::consts::TAU * f64::from(k) / 24.0).sin_cos();
            let covered = |at: usize| (at % 160) as f64 * cos + (at / 160) as f64 * sin > 79.5 * (cos + sin);
            let pixels = whole.pixels().iter().enumerate();
            let pixels = pixels.map(|(at, p)| if covered(at) { level } else { *p });
            let image = GreyImage::new(160, 160, pixels.collect()).unwrap();
            assert_eq!(detector.find(&image), [], "{} deg, {level}", 15 * k);
        }
        assert_eq!(detector.find(&whole).len(), 1);
    }

    #[test]
    fn detector_with_mirrored_and_small_squares() {
        let p = [[0.0, 9.0], [0.0, 0.0], [9.0, 0.0], [9.0, 9.0]].map(Vector2::from);
        assert!(well_shaped(&p, 8.0));
        assert!(!well_shaped(&p, 10.0));
        assert!(!well_shaped(&[p[0], p[3], p[2], p[1]], 8.0));
        assert!(!well_shaped(&[p[0], p[2], p[1], p[3]], 8.0));
        assert!(!well_shaped(&[Vector2::new(f64::NAN, 0.0); 4], 8.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn detector_in_noise_of_any_size(
            sizes in prop::collection::vec((32_usize..150, 32_usize..150), 1..4),
            seed in any::<u32>(), levels in 1_u32..256,
        ) {
            let mut detector = TagDetector::new(&TagSettings::default(), &one(0));
            let mut x = seed | 1;
            for (w, h) in sizes {
                let pixels = (0..w * h).map(|_| {
                    x ^= x << 13;
                    x ^= x >> 17;
                    x ^= x << 5;
                    (x % levels * (255 / levels)) as u8
                }).collect();
                prop_assert_eq!(detector.find(&GreyImage::new(w, h, pixels).unwrap()), []);
            }
        }
    }
}
