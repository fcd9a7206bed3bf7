//! Tags in an image that shows none of the deck's tags: other numbers, mirrored tags, other families. They show an
//! operator why the deck is not detected; no search for them takes place in flight.

use alight_shared::tags::{ForeignTag, Tags};
use nalgebra::Vector2;

use super::{
    apriltag::{Family, Library},
    detector::TagSettings,
    image::GreyImage,
};

pub struct ForeignTags {
    tags: Tags,
    min_margin: f64,
    own: Option<Library>,
    family_25h9: Option<Library>,
    family_41h12: Option<Library>,
    /// Detector of family 16h5 that tolerates three wrong bits of 16. Most patterns satisfy it, so it finds any black
    /// square.
    squares: Option<Library>,
}

impl ForeignTags {
    /// Detector in which a tag with a wrong bit is ignored.
    pub fn new(settings: &TagSettings, tags: &Tags) -> ForeignTags {
        let library = |family, bits| Library::new(family, bits, settings.decimate);
        ForeignTags {
            tags: *tags,
            min_margin: settings.min_margin,
            own: library(Family::Tag36h11, 0),
            family_25h9: library(Family::Tag25h9, 0),
            family_41h12: library(Family::TagStandard41h12, 0),
            squares: library(Family::Tag16h5, 3),
        }
    }
    /// Foreign tag in the image; None if the deck's tag is visible or nothing explains its absence.
    pub fn find(&mut self, image: &GreyImage) -> Option<ForeignTag> {
        let (width, height) = (image.width(), image.height());
        let margin = self.min_margin;
        let own = self.own.as_mut()?;
        let numbers = detected(own, image, margin);
        if !numbers.is_empty() {
            let is_decks = |id: &usize| self.tags.iter().any(|tag| usize::from(tag.id) == *id);
            let other = numbers.iter().find(|id| !is_decks(id));
            return other.map(|id| ForeignTag::Number(*id as u16));
        }
        let inverted = image.pixels().iter().map(|level| !level).collect();
        let inverted = GreyImage::new(width, height, inverted).ok()?;
        if let Some(id) = detected(own, &inverted, margin).first() {
            return Some(ForeignTag::Inverted(*id as u16));
        }
        let rows = image.pixels().chunks_exact(width);
        let mirror: Vec<u8> = rows.flat_map(|row| row.iter().rev().copied()).collect();
        let mirror = GreyImage::new(width, height, mirror).ok()?;
        // A pattern that is not in the family may be a mirror image.
        let squares = self.squares.as_mut()?;
        let mut is_marked = |image: &GreyImage| {
            let squares = squares.detect(image);
            squares.iter().any(|s| is_marker(image, &s.corners, margin))
        };
        if is_marked(image) || is_marked(&mirror) {
            if let Some(id) = detected(own, &mirror, margin).first() {
                return Some(ForeignTag::Mirrored(*id as u16));
            }
            let is_25h9 = !detected(self.family_25h9.as_mut()?, image, margin).is_empty();
            return Some(if is_25h9 {
                ForeignTag::Family25h9
            } else {
                ForeignTag::Unknown
            });
        }
        if !detected(self.family_41h12.as_mut()?, image, margin).is_empty() {
            return Some(ForeignTag::Family41h12);
        }
        let (length, read) = with_other_rows(image)?;
        let is_tag = !detected(self.own.as_mut()?, &read, margin).is_empty();
        is_tag.then_some(ForeignTag::RowLength(length))
    }
}

fn detected(library: &mut Library, image: &GreyImage, min_margin: f64) -> Vec<usize> {
    let found = library.detect(image);
    let clear = found.iter().filter(|f| f.margin >= min_margin);
    clear.map(|f| f.id).collect()
}

/// Minimum side of a square whose pattern can be assessed, px: four per cell of a tag.
const MIN_SIDE_PX: f64 = 32.0;
/// Samples along each side of a square and of its pattern.
const SAMPLES: usize = 16;
/// Minimum black fraction of a square's edge, and minimum white fraction of the margin around it.
const CLEAR: f64 = 0.9;
/// Minimum fractions of white and of black in the pattern: tags have at least a quarter of their cells of each.
const MIN_FRACTION: f64 = 0.15;
/// Minimum fraction of the pattern nearer to black or white than to their mean; evenly spread levels give half.
const BIMODAL: f64 = 0.75;

/// Whether a black square with a white margin contains a black-and-white pattern, as printed markers do.
fn is_marker(image: &GreyImage, corners: &[[f64; 2]; 4], min_margin: f64) -> bool {
    let [a, b, c, d] = corners.map(|[x, y]| Vector2::new(x - 0.5, y - 0.5));
    let sides = [b - a, c - b, d - c, a - d];
    if !sides.iter().all(|side| side.norm() >= MIN_SIDE_PX) {
        return false;
    }
    let level = |s: f64, t: f64| {
        let at = (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t;
        image.level_near(at).map(f64::from)
    };
    // Half a tag cell inside the edge, and half a cell outside.
    let ring = |depth: f64| -> Vec<f64> {
        let along = (0..SAMPLES).map(|k| (k as f64 + 0.5) / SAMPLES as f64);
        let (near, far) = (depth, 1.0 - depth);
        along
            .flat_map(|s| [level(s, near), level(s, far), level(near, s), level(far, s)])
            .flatten()
            .collect()
    };
    let (edge, margin) = (ring(1.0 / 16.0), ring(-1.0 / 16.0));
    let (Some(black), Some(white)) = (median(&edge), median(&margin)) else {
        return false;
    };
    let fraction = |levels: &[f64], is: &dyn Fn(f64) -> bool| {
        levels.iter().filter(|l| is(**l)).count() as f64 / levels.len().max(1) as f64
    };
    let middle = 0.5 * (black + white);
    let is_white = |l: f64| l > middle;
    let inside = |k: usize| 0.2 + 0.6 * (k as f64 + 0.5) / SAMPLES as f64;
    let pattern: Vec<f64> = (0..SAMPLES * SAMPLES)
        .filter_map(|k| level(inside(k / SAMPLES), inside(k % SAMPLES)))
        .collect();
    let white_fraction = fraction(&pattern, &is_white);
    white - black >= 2.0 * min_margin
        && fraction(&edge, &is_white) <= 1.0 - CLEAR
        && fraction(&margin, &is_white) >= CLEAR
        && (MIN_FRACTION..=1.0 - MIN_FRACTION).contains(&white_fraction)
        && fraction(&pattern, &|l| (l - middle).abs() >= 0.25 * (white - black)) >= BIMODAL
}

fn median(levels: &[f64]) -> Option<f64> {
    let mut sorted = levels.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// Stride of the pixel comparison: a prime, so that no column is preferred.
const ROW_STRIDE: usize = 61;

/// Row length, bytes, if it differs from the image's width, and the image with rows of that length. Rows of a scene
/// resemble their neighbours, so the difference between bytes one row apart is smallest at the true row length. Rows of
/// two widths or more are reduced to one byte per pixel.
fn with_other_rows(image: &GreyImage) -> Option<(u16, GreyImage)> {
    let (pixels, width) = (image.pixels(), image.width());
    let differ = |lag: usize| {
        let pairs = pixels.iter().zip(pixels.get(lag..)?).step_by(ROW_STRIDE);
        let (sum, n) = pairs.fold((0_u64, 0_u64), |(sum, n), (a, b)| {
            (sum + u64::from(a.abs_diff(*b)), n + 1)
        });
        (n > 0).then(|| sum as f64 / n as f64)
    };
    let lengths = width / 2..=(3 * width).min(pixels.len() / 2);
    let (length, _) = lengths
        .filter_map(|lag| Some((lag, differ(lag)?)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let per_pixel = (length / width).max(1);
    let kept: Vec<u8> = pixels.iter().step_by(per_pixel).copied().collect();
    let row = length / per_pixel;
    let whole = kept.get(..kept.len() / row * row)?;
    let read = GreyImage::new(row, whole.len() / row, whole.to_vec()).ok()?;
    (length != width).then_some((u16::try_from(length).ok()?, read))
}

#[cfg(test)]
mod tests {
    use super::{super::layout::cells, *};
    use alight_shared::tags::DeckTag;
    use proptest::prelude::*;

    fn finder() -> ForeignTags {
        let tags = Tags::filled([DeckTag {
            id: 7,
            ..DeckTag::default()
        }]);
        ForeignTags::new(&TagSettings::default(), &tags)
    }
    /// White image with cells of 10 px starting at row and column 20, black where `black` is true.
    fn drawn(size: [usize; 2], black: impl Fn(usize, usize) -> bool) -> GreyImage {
        let pixels = (0..size[0] * size[1]).map(|k| {
            let (row, column) = (k / size[0], k % size[0]);
            let inside = (20..100).contains(&row) && (20..100).contains(&column);
            if inside && black((row - 20) / 10, (column - 20) / 10) {
                20
            } else {
                200
            }
        });
        GreyImage::new(size[0], size[1], pixels.collect()).unwrap()
    }
    fn tag(id: u16) -> impl Fn(usize, usize) -> bool {
        let cells = cells(id).unwrap();
        move |row, column| !cells[row + 1][column + 1]
    }
    fn map(image: &GreyImage, from: impl Fn(usize, usize) -> (usize, usize)) -> GreyImage {
        let width = image.width();
        let at = |k: usize| from(k / width, k % width);
        let pixels = (0..width * width).map(|k| image.pixels()[at(k).0 * width + at(k).1]);
        GreyImage::new(width, width, pixels.collect()).unwrap()
    }

    #[test]
    fn images_that_are_not_the_decks() {
        let mut finder = finder();
        let mut find = |image: &GreyImage| finder.find(image);
        let right = drawn([120, 120], tag(7));
        assert_eq!(find(&right), None);
        assert_eq!(find(&map(&right, |row, column| (119 - row, 119 - column))), None);
        assert_eq!(find(&drawn([120, 120], tag(3))), Some(ForeignTag::Number(3)));
        for flip in [
            |row: usize, column: usize| (row, 119 - column),
            |row: usize, column: usize| (119 - row, column),
            |row: usize, column: usize| (column, row),
        ] {
            assert_eq!(find(&map(&right, flip)), Some(ForeignTag::Mirrored(7)));
        }
        let negative = right.pixels().iter().map(|level| 220 - level).collect();
        let negative = GreyImage::new(120, 120, negative).unwrap();
        assert_eq!(find(&negative), Some(ForeignTag::Inverted(7)));
        // Six by six cells of a 4x4 marker, printed in the same square.
        let marker = drawn([120, 120], |row, column| {
            let (row, column) = (6 * row / 8, 6 * column / 8);
            row % 5 == 0 || column % 5 == 0 || (row * 5 + column * 3) % 4 < 2
        });
        assert_eq!(find(&marker), Some(ForeignTag::Unknown));
    }

    #[test]
    fn rows_of_another_length() {
        let wide = drawn([160, 120], tag(7));
        for width in [120, 128, 160, 176] {
            let height = wide.pixels().len() / width;
            let image = GreyImage::new(width, height, wide.pixels()[..width * height].to_vec()).unwrap();
            let other = Some(ForeignTag::RowLength(160)).filter(|_| width != 160);
            assert_eq!(finder().find(&image), other, "{width}");
        }
        // Two bytes per pixel, alternating grey and colour.
        let pixels: Vec<u8> = wide.pixels().iter().flat_map(|level| [*level, 128]).collect();
        let image = GreyImage::new(160, 240, pixels).unwrap();
        assert_eq!(finder().find(&image), Some(ForeignTag::RowLength(320)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn nothing_foreign_in_waves_and_clutter(
            waves in prop::collection::vec((0.01..0.8_f64, -0.8..0.8_f64, 1.0..40.0_f64), 1..5),
            boxes in prop::collection::vec((0..280_usize, 0..200_usize, 4..120_usize, 4..120_usize, any::<u8>()), 0..12),
            noise in 0..30_u32,
        ) {
            let mut draw = 1_u32;
            let pixels = (0..320 * 240).map(|k| {
                let (x, y) = (k % 320, k / 320);
                // Windows, hatches and lines, drawn as nested boxes of any grey level.
                let within = |b: &&(usize, usize, usize, usize, u8)| {
                    (b.0..b.0 + b.2).contains(&x) && (b.1..b.1 + b.3).contains(&y)
                };
                let sea: f64 = waves.iter().map(|(kx, ky, a)| a * (kx * x as f64 + ky * y as f64).sin()).sum();
                let scene = boxes.iter().rfind(within).map_or(110.0 + sea, |b| f64::from(b.4));
                draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (scene + f64::from(draw >> 16) / 65536.0 * f64::from(noise)) as u8
            });
            let image = GreyImage::new(320, 240, pixels.collect()).unwrap();
            prop_assert_eq!(finder().find(&image), None);
        }
    }
}
