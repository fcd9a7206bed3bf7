//! Camera image for display: reduced, with the detected tags and the outline of the deck.

use alight_shared::geometry::DeckGeometry;
use nalgebra::{Vector2, Vector3};

use super::image::GreyImage;

/// Maximum side of a marked image, px: the width of a phone screen.
const MAX_SIDE_PX: usize = 320;
/// Maximum size of the pixel data, bytes.
pub const MAX_BYTES: usize = 3 * MAX_SIDE_PX * MAX_SIDE_PX;
/// Number of straight segments that approximate an edge in a distorted image.
const EDGE_PARTS: usize = 8;
/// Distance outside the image up to which lines are drawn, in image sides.
const MAX_OUTSIDE: f64 = 4.0;
const LINE_PX: usize = 2;
/// Red, green and blue of tags and outline; both are distinguishable from grey with any colour vision deficiency.
const TAG: [u8; 3] = [0, 230, 90];
const OUTLINE: [u8; 3] = [255, 150, 0];

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MarkedImage {
    pub size: [usize; 2],
    pub rgb: Vec<u8>,
    pub tags: u32,
    /// Number of deck outlines drawn, 0 or 1.
    pub outlines: u32,
    /// Reduction factor relative to the original.
    step: usize,
}

impl MarkedImage {
    /// Image reduced by averaging, without marks.
    pub fn of(image: &GreyImage) -> MarkedImage {
        let step = image.width().max(image.height()).div_ceil(MAX_SIDE_PX).max(1);
        let size = [image.width() / step, image.height() / step];
        let mut rgb = Vec::with_capacity(3 * size[0] * size[1]);
        let mut sums = vec![0_u32; size[0]];
        let rows: Vec<&[u8]> = image.pixels().chunks_exact(image.width()).collect();
        for block in rows.chunks_exact(step) {
            sums.fill(0);
            for row in block {
                for (sum, part) in sums.iter_mut().zip(row.chunks_exact(step)) {
                    *sum += part.iter().map(|level| u32::from(*level)).sum::<u32>();
                }
            }
            let area = (step * step) as u32;
            rgb.extend(sums.iter().flat_map(|sum| [(sum / area) as u8; 3]));
        }
        MarkedImage {
            size,
            rgb,
            tags: 0,
            outlines: 0,
            step,
        }
    }
    /// Draws a tag's edges from its corners in the original image, px.
    pub fn draw_tag(&mut self, corners: &[Vector2<f64>; 4]) {
        let [a, b, c, d] = *corners;
        for (from, to) in [(a, b), (b, c), (c, d), (d, a)] {
            self.draw_line(from, to, TAG);
        }
        self.tags += 1;
    }
    /// Draws the deck's outline. `project` maps a point (forward, right, down from its centre, m) to a pixel.
    pub fn draw_outline(
        &mut self,
        deck: &DeckGeometry,
        project: impl Fn(Vector3<f64>) -> Option<Vector2<f64>>,
    ) {
        let (x, y) = (0.5 * deck.length_m, 0.5 * deck.width_m);
        let corners = [[-x, -y], [x, -y], [x, y], [-x, y], [-x, -y]].map(|[x, y]| Vector3::new(x, y, 0.0));
        for ends in corners.windows(2) {
            let [from, to] = ends else { continue };
            let point = |k: usize| project(from.lerp(to, k as f64 / EDGE_PARTS as f64));
            for k in 0..EDGE_PARTS {
                if let (Some(a), Some(b)) = (point(k), point(k + 1)) {
                    self.draw_line(a, b, OUTLINE);
                }
            }
        }
        self.outlines = 1;
    }
    fn draw_line(&mut self, from: Vector2<f64>, to: Vector2<f64>, colour: [u8; 3]) {
        // In both images the origin is the centre of pixel (0, 0).
        let scaled = |p: Vector2<f64>| (p.add_scalar(0.5) / self.step as f64).add_scalar(-0.5);
        let (from, to) = (scaled(from), scaled(to));
        let reach = MAX_OUTSIDE * MAX_SIDE_PX as f64;
        if !(from.amax() < reach && to.amax() < reach) {
            return;
        }
        let steps = (to - from).amax().ceil().max(1.0);
        for k in 0..=steps as usize {
            self.dot(from.lerp(&to, k as f64 / steps), colour);
        }
    }
    fn dot(&mut self, at: Vector2<f64>, colour: [u8; 3]) {
        let [width, height] = self.size;
        for (dx, dy) in (0..LINE_PX).flat_map(|dy| (0..LINE_PX).map(move |dx| (dx, dy))) {
            let (x, y) = (at.x.round() + dx as f64, at.y.round() + dy as f64);
            if (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y) {
                let first = 3 * (y as usize * width + x as usize);
                if let Some(pixel) = self.rgb.get_mut(first..first + 3) {
                    pixel.copy_from_slice(&colour);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grey(width: usize, height: usize) -> GreyImage {
        GreyImage::new(width, height, vec![100; width * height]).unwrap()
    }
    fn pixel(marked: &MarkedImage, x: usize, y: usize) -> &[u8] {
        &marked.rgb[3 * (y * marked.size[0] + x)..][..3]
    }

    #[test]
    fn marked_image_of_any_size() {
        for (size, small) in [
            ([640, 480], [320, 240]),
            ([320, 240], [320, 240]),
            ([1280, 800], [320, 200]),
            ([322, 32], [161, 16]),
            ([480, 640], [240, 320]),
            ([33, 3000], [3, 300]),
        ] {
            let marked = MarkedImage::of(&grey(size[0], size[1]));
            assert_eq!(marked.size, small);
            assert_eq!(marked.rgb, vec![100; 3 * small[0] * small[1]]);
            assert!(marked.rgb.len() <= MAX_BYTES);
        }
        let mut pixels = vec![0; 640 * 480];
        pixels[641] = 200;
        let marked = MarkedImage::of(&GreyImage::new(640, 480, pixels).unwrap());
        assert_eq!(pixel(&marked, 0, 0), [50; 3]);
    }

    #[test]
    fn marks_of_tag_and_deck() {
        let mut marked = MarkedImage::of(&grey(640, 480));
        let deck = DeckGeometry {
            length_m: 2.0,
            width_m: 1.0,
            ..DeckGeometry::default()
        };
        // The projection has 200 px per metre, with the bow up.
        marked.draw_outline(&deck, |p| {
            Some(Vector2::new(320.0 + 200.0 * p.y, 240.0 - 200.0 * p.x))
        });
        marked.draw_tag(&[[300.0, 260.0], [300.0, 220.0], [340.0, 220.0], [340.0, 260.0]].map(Vector2::from));
        assert_eq!((marked.tags, marked.outlines), (1, 1));
        assert_eq!(pixel(&marked, 160, 20), OUTLINE);
        assert_eq!(pixel(&marked, 110, 120), OUTLINE);
        assert_eq!(pixel(&marked, 150, 120), TAG);
        assert_eq!(pixel(&marked, 160, 120), [100; 3]);
    }

    proptest! {
        #[test]
        fn marks_anywhere(x in -1e5..1e5_f64, y in -1e5..1e5_f64, far in prop::num::f64::ANY) {
            let mut marked = MarkedImage::of(&grey(64, 48));
            let (a, b) = (Vector2::new(x, y), Vector2::new(far, y));
            marked.draw_tag(&[a, b, Vector2::zeros(), Vector2::new(x / 100.0, far)]);
            prop_assert_eq!(marked.rgb.len(), 3 * 64 * 48);
        }
    }
}
