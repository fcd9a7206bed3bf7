//! Grey levels in an image: mean, brightest area, and contrast and saturation of the tag.

use nalgebra::Vector2;

use super::image::GreyImage;
use alight_shared::msg::MIN_GLARE;

/// Number of samples along each side of the tag's square: four per cell.
const SAMPLES: usize = 32;
/// Fraction of the samples below the black level, and above the white level. At least 28 of 64 cells are black, and
/// every 36h11 code leaves at least a quarter of the square white.
const QUANTILE: f64 = 0.1;
/// Stride of averaging, px: a prime, so that no column is preferred.
const STRIDE: usize = 17;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TagLight {
    /// Grey level exceeded by nine tenths of the square.
    pub black: u8,
    /// Grey level exceeded by a tenth of the square.
    pub white: u8,
    /// Fraction of the square at grey level 0 or 255.
    pub saturation: f64,
}

impl TagLight {
    /// Light on the square with these corners (px); None outside the image.
    pub fn of(image: &GreyImage, corners: &[Vector2<f64>; 4]) -> Option<TagLight> {
        let [a, b, c, d] = corners;
        let along = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        let mut levels: Vec<u8> = (0..SAMPLES * SAMPLES)
            .filter_map(|k| {
                let (s, t) = (along(k / SAMPLES), along(k % SAMPLES));
                image.level_near((a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t)
            })
            .collect();
        levels.sort_unstable();
        let rank = (QUANTILE * levels.len() as f64) as usize;
        let clipped = levels.iter().filter(|l| matches!(**l, 0 | u8::MAX)).count();
        Some(TagLight {
            black: *levels.get(rank)?,
            white: *levels.iter().rev().nth(rank)?,
            saturation: clipped as f64 / levels.len() as f64,
        })
    }
    /// White minus black, divided by 255.
    pub fn contrast(&self) -> f64 {
        f64::from(self.white.saturating_sub(self.black)) / 255.0
    }
}

/// Side of the squares among which the brightest is searched, px: they fit into the smallest decodable tag.
const TILE_PX: usize = 6;

const MAX_TILE_SUM: u32 = (TILE_PX * TILE_PX) as u32 * u8::MAX as u32;

/// Factor by which the detector's sharpening increases a decision margin (its `decode_sharpening` is 0.25).
const SHARPENING: f64 = 1.25;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImageLight {
    pub mean: f64,
    /// Mean grey level of the brightest square of side [`TILE_PX`].
    pub brightest: f64,
    /// Fraction of these squares in which all pixels are 255, 0 to 1.
    pub saturated: f64,
}

impl ImageLight {
    pub fn of(image: &GreyImage) -> ImageLight {
        let columns = image.width() / TILE_PX;
        let (mut sums, mut brightest, mut saturated) = (vec![0_u32; columns], 0, 0);
        let rows: Vec<&[u8]> = image.pixels().chunks_exact(image.width()).collect();
        for tiles in rows.chunks_exact(TILE_PX) {
            sums.fill(0);
            for row in tiles {
                for (sum, part) in sums.iter_mut().zip(row.chunks_exact(TILE_PX)) {
                    *sum += part.iter().map(|level| u32::from(*level)).sum::<u32>();
                }
            }
            brightest = sums.iter().copied().fold(brightest, u32::max);
            saturated += sums.iter().filter(|sum| **sum == MAX_TILE_SUM).count();
        }
        let tiles = columns * (image.height() / TILE_PX);
        ImageLight {
            mean: mean_level(image),
            brightest: f64::from(brightest) / (TILE_PX * TILE_PX) as f64,
            saturated: saturated as f64 / tiles.max(1) as f64,
        }
    }
    /// Saturated fraction of the image, 0 to 1; None if it may be due to glints.
    pub fn glare(&self) -> Option<f64> {
        Some(self.saturated).filter(|part| *part > MIN_GLARE)
    }
    /// Whether no tag in the image can be decoded with a decision margin of `min_margin`, grey levels. The margin is
    /// half of the difference between white and black, raised by a quarter by sharpening. At least half of a tag with
    /// its white margin is white, so some of its squares are as bright as four fifths of the margin.
    pub fn is_dark(&self, min_margin: f64) -> bool {
        self.brightest < min_margin / SHARPENING
    }
}

pub fn mean_level(image: &GreyImage) -> f64 {
    let sampled = || image.pixels().iter().step_by(STRIDE);
    sampled().map(|p| f64::from(*p)).sum::<f64>() / sampled().count().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CORNERS: [Vector2<f64>; 4] = [
        Vector2::new(29.5, 89.5),
        Vector2::new(29.5, 29.5),
        Vector2::new(89.5, 29.5),
        Vector2::new(89.5, 89.5),
    ];

    /// Image of a square of 60 px whose left quarter is white, on a background of grey level 100.
    fn square(black: u8, white: u8) -> GreyImage {
        let pixels = (0..120 * 120).map(|k| match (k % 120, k / 120) {
            (30..45, 30..90) => white,
            (45..90, 30..90) => black,
            (_, _) => 100,
        });
        GreyImage::new(120, 120, pixels.collect()).unwrap()
    }

    #[test]
    fn tag_light_within_the_square() {
        let light = TagLight::of(&square(20, 180), &CORNERS).unwrap();
        assert_eq!((light.black, light.white, light.saturation), (20, 180, 0.0));
        assert!((light.contrast() - 160.0 / 255.0).abs() < 1e-12);
        let clipped = TagLight::of(&square(20, 255), &CORNERS).unwrap();
        assert!((clipped.saturation - 0.25).abs() < 0.02, "{clipped:?}");
        let dark = TagLight::of(&square(0, 40), &CORNERS).unwrap();
        assert!((dark.saturation - 0.75).abs() < 0.02, "{dark:?}");
    }

    #[test]
    fn tag_light_outside_the_image() {
        let outside = CORNERS.map(|c| c + Vector2::new(500.0, 0.0));
        assert_eq!(TagLight::of(&square(20, 180), &outside), None);
    }

    #[test]
    fn mean_level_of_all_pixels() {
        // The image has 900 pixels of level 200, 2700 of 20 and 10 800 of 100.
        let mean = mean_level(&square(20, 200));
        assert!((mean - 91.25).abs() < 2.0, "{mean}");
    }

    #[test]
    fn brightest_square_of_an_image() {
        // Half-white tag of 12 px anywhere in a dark image: a decision margin of 20 requires a white level of 32.
        let at = |white: u8, place: usize| {
            let pixels = (0..120 * 90).map(|k| {
                let (x, y) = (
                    (k % 120_usize).wrapping_sub(place),
                    (k / 120_usize).wrapping_sub(place),
                );
                if x < 12 && y < 12 && (x / 2 + y / 2).is_multiple_of(2) {
                    white
                } else {
                    0
                }
            });
            ImageLight::of(&GreyImage::new(120, 90, pixels.collect()).unwrap())
        };
        for place in 20..32 {
            assert!(!at(33, place).is_dark(20.0), "{place}: {:?}", at(33, place));
            assert!(at(28, place).is_dark(20.0), "{place}: {:?}", at(28, place));
        }
        assert!(at(255, 40).mean < 3.0);
        // A lamp saturates two of 300 squares.
        let lamp = |level: u8| {
            let lit = |k: usize| (42..54).contains(&(k % 120)) && (42..48).contains(&(k / 120));
            let pixels = (0..120 * 90).map(|k| if lit(k) { level } else { 0 });
            ImageLight::of(&GreyImage::new(120, 90, pixels.collect()).unwrap())
        };
        assert_eq!((lamp(255).saturated, lamp(254).saturated), (2.0 / 300.0, 0.0));
        assert!(lamp(255).glare().is_some() && lamp(254).glare().is_none());
        // Noise of a sensor at full gain.
        let noise = (0..120 * 90_u32).map(|k| ((k.wrapping_mul(2_654_435_761) >> 24) / 13) as u8);
        assert!(ImageLight::of(&GreyImage::new(120, 90, noise.collect()).unwrap()).is_dark(20.0));
    }

    proptest! {
        #[test]
        fn tag_light_with_any_corners(
            c in prop::array::uniform8(prop_oneof![-50.0..150.0_f64, Just(f64::NAN), Just(1e300)]),
        ) {
            let corners = [0, 2, 4, 6].map(|i| Vector2::new(c[i], c[i + 1]));
            if let Some(light) = TagLight::of(&square(0, 255), &corners) {
                prop_assert!(light.black <= light.white && (0.0..=1.0).contains(&light.saturation));
            }
        }
    }
}
