//! Motion blur, measured by the width of the tag's edges; a lens out of focus widens them as well.
//!
//! The mean profile across a side is a step smeared by optics, pixel and motion, whose variances add up. Motion by `b`
//! px across the edge contributes `b²/12`.

use nalgebra::Vector2;

use super::image::GreyImage;

const LINES: usize = 12;
const STEP_PX: f64 = 0.5;
/// Minimum and maximum sampling distance from the edge, px.
const REACH_PX: [f64; 2] = [2.0, 24.0];
/// Cells of the tag's black square; its border and the margin around it are one cell wide each.
const CELLS: f64 = 8.0;
/// Variance of a sharp edge: optics of 0.6 px, the pixel's area and the sampling interval, px².
const SHARP_PX2: f64 = 0.55;
/// Minimum step of the mean profile at an edge, grey levels.
const MIN_EDGE_STEP: f64 = 5.0;

/// Width of a quadrilateral: its area divided by its longest side, px.
pub fn width_px(p: &[Vector2<f64>; 4]) -> f64 {
    let [a, b, c, d] = p;
    let longest = [b - a, c - b, d - c, a - d]
        .iter()
        .fold(f64::MIN_POSITIVE, |most, side| most.max(side.norm()));
    0.5 * (c - a).perp(&(d - b)).abs() / longest
}

/// Maximum exposure at which half of the images of a tag are decoded, s. For a focal length `f` (px) and a turn rate
/// `ω` it is `t = b / (f ω)`, where `b` is the largest blur with which a tag of width `w = f side / height` is decoded:
/// `w = 13.3 px + 0.27 b² / px`, but at least 3 px, the value at the smallest detectable width.
///
/// Source: rendered images (`alight study camera` at commit 2bb52893).
pub fn longest_exposure_s(focal_px: f64, side_m: f64, height_m: f64, rate_rps: f64) -> f64 {
    let width_px = focal_px * side_m / height_m;
    let blur_px = ((width_px - 13.3) / 0.27).max(9.0).sqrt();
    blur_px / (focal_px * rate_rps)
}

/// Sum of the squared motions during the exposure across both pairs of sides, px²; zero without an edge.
pub fn motion_blur_px2(image: &GreyImage, corners: &[Vector2<f64>; 4]) -> f64 {
    let [a, b, c, d] = *corners;
    let reach = (0.9 * width_px(corners) / CELLS).clamp(REACH_PX[0], REACH_PX[1]);
    let across = |first: [Vector2<f64>; 2], second: [Vector2<f64>; 2]| {
        let both = [first, second].map(|[p, q]| variance(image, p, q, reach));
        let known = both.iter().flatten().count();
        let mean = both.iter().flatten().sum::<f64>() / known.max(1) as f64;
        if known == 0 {
            0.0
        } else {
            12.0 * (mean - SHARP_PX2).max(0.0)
        }
    };
    across([a, b], [c, d]) + across([b, c], [d, a])
}

/// Variance of the smear across the side from `p` to `q`, px²; None without an edge.
fn variance(image: &GreyImage, p: Vector2<f64>, q: Vector2<f64>, reach: f64) -> Option<f64> {
    let along = q - p;
    let normal = Vector2::new(along.y, -along.x).try_normalize(1e-9)?;
    let count = 2 * (reach / STEP_PX) as usize + 1;
    let at = |k: usize| (k as f64 - 0.5 * (count - 1) as f64) * STEP_PX;
    let profile: Vec<f64> = (0..count)
        .map(|k| {
            let levels = (0..LINES).filter_map(|line| {
                let along_side = 0.15 + 0.7 * line as f64 / (LINES - 1) as f64;
                level(image, p + along * along_side + normal * at(k))
            });
            let (sum, n) = levels.fold((0.0, 0.0), |(sum, n), l| (sum + l, n + 1.0));
            sum / n
        })
        .collect();
    let (mut mass, mut first, mut second) = (0.0, 0.0, 0.0);
    for (k, pair) in profile.windows(2).enumerate() {
        let [before, after] = pair else { continue };
        let x = at(k) + 0.5 * STEP_PX;
        let slope = after - before;
        mass += slope;
        first += slope * x;
        second += slope * x * x;
    }
    let var = second / mass - (first / mass).powi(2);
    (mass.abs() >= MIN_EDGE_STEP && var.is_finite()).then_some(var)
}

/// Grey level interpolated between pixels; None outside the image.
fn level(image: &GreyImage, at: Vector2<f64>) -> Option<f64> {
    let (width, height) = (image.width(), image.height());
    let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < (width - 1) as f64 && at.y < (height - 1) as f64;
    if !inside {
        return None;
    }
    let (column, row) = (at.x as usize, at.y as usize);
    let (u, v) = (at.x - column as f64, at.y - row as f64);
    let pixel = |i: usize, j: usize| {
        image
            .pixels()
            .get((row + j) * width + column + i)
            .map(|p| f64::from(*p))
    };
    Some(
        pixel(0, 0)? * (1.0 - u) * (1.0 - v)
            + pixel(1, 0)? * u * (1.0 - v)
            + pixel(0, 1)? * (1.0 - u) * v
            + pixel(1, 1)? * u * v,
    )
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

    /// Image of a dark square of 60 px on a light background, moved by `b` px to the right during the exposure.
    fn moved(b: f64) -> GreyImage {
        let pixels = (0..120 * 120).map(|k| {
            let (u, v) = (f64::from(k % 120), f64::from(k / 120));
            // 64 instants, each with 8 positions within the pixel.
            let centred = |i: u32, count: u32| (f64::from(i) + 0.5) / f64::from(count) - 0.5;
            let dark = (0..64 * 8_u32).filter(|i| {
                let x = u - centred(i / 8, 64) * b + centred(i % 8, 8);
                (29.5..89.5).contains(&x) && (29.5..89.5).contains(&v)
            });
            200 - (180 * dark.count() / (64 * 8)) as u8
        });
        GreyImage::new(120, 120, pixels.collect()).unwrap()
    }

    #[test]
    fn motion_blur_at_crossed_edges() {
        for b in [0.0, 4.0, 8.0, 12.0] {
            let measured = motion_blur_px2(&moved(b), &CORNERS);
            assert!((measured - b * b).abs() < 5.0 + 0.1 * b * b, "{b} px: {measured}");
        }
    }

    #[test]
    fn longest_exposure_by_height() {
        // With a focal length of 320 px, a tag of 1 m at 7 m is 45.7 px wide and permits a blur of 11 px.
        let longest_s = longest_exposure_s(320.0, 1.0, 7.0, 2.0);
        assert!((longest_s - 0.0171).abs() < 1e-4, "{longest_s}");
        // A tag too narrow to be detected permits 3 px of blur.
        assert!((longest_exposure_s(320.0, 0.1, 7.0, 2.0) - 3.0 / 640.0).abs() < 1e-9);
        assert!(longest_exposure_s(320.0, 1.0, 7.0, 4.0) < 0.6 * longest_s);
    }

    #[test]
    fn motion_blur_without_an_edge() {
        let flat = GreyImage::new(120, 120, vec![90; 120 * 120]).unwrap();
        assert_eq!(motion_blur_px2(&flat, &CORNERS), 0.0);
        let outside = CORNERS.map(|c| c + Vector2::new(500.0, -300.0));
        assert_eq!(motion_blur_px2(&moved(4.0), &outside), 0.0);
    }

    proptest! {
        #[test]
        fn motion_blur_with_any_corners(
            c in prop::array::uniform8(prop_oneof![-50.0..250.0_f64, Just(0.0), Just(f64::NAN), Just(1e300)]),
            seed in any::<u32>(),
        ) {
            let noise = (0..64 * 48_u32).map(|k| (k.wrapping_mul(seed | 1) >> 24) as u8);
            let image = GreyImage::new(64, 48, noise.collect()).unwrap();
            let corners = [0, 2, 4, 6].map(|i| Vector2::new(c[i], c[i + 1]));
            let measured = motion_blur_px2(&image, &corners);
            prop_assert!(measured >= 0.0 && measured.is_finite(), "{measured}");
        }
    }
}
