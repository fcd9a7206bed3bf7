use nalgebra::Vector2;

use crate::camera::image::GreyImage;

/// Maximum number of spots per image; the brightest are kept.
pub const MAX_BLOBS: usize = 64;

/// Maximum number of runs of bright pixels; an image with more shows glare or noise.
const MAX_RUNS: usize = 4000;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// Centroid of the light above the threshold, px.
    pub at: Vector2<f64>,
    /// Light above the threshold, grey levels times pixels.
    pub light: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlobLimits {
    /// Minimum grey level of a spot's pixels.
    pub threshold: u8,
    /// Maximum number of pixels: markers are small, unlike the sun and its reflections.
    pub max_pixels: usize,
}

/// Connected pixels above the threshold, scanned row by row from the top. Runs of a row are joined with those of the
/// row above, and only the brightest spots are kept, so time and memory are bounded.
pub fn find(image: &GreyImage, spot: &BlobLimits) -> Vec<Blob> {
    let mut open: Vec<(usize, usize, usize)> = Vec::new();
    let mut groups = Groups::default();
    for (row, pixels) in image.pixels().chunks(image.width()).enumerate() {
        if groups.parent.len() > MAX_RUNS {
            return Vec::new();
        }
        let mut runs = Vec::new();
        let mut from = 0;
        while let Some(start) = pixels
            .get(from..)
            .and_then(|rest| rest.iter().position(|p| *p >= spot.threshold))
        {
            let start = from + start;
            let rest = pixels.get(start..).unwrap_or_default();
            let length = rest
                .iter()
                .position(|p| *p < spot.threshold)
                .unwrap_or(rest.len());
            let end = start + length;
            let group = groups.new_run(row, start, rest.get(..length).unwrap_or_default(), spot.threshold);
            runs.push((start, end, group));
            from = end;
        }
        // Scans the runs of both rows from the left; touching runs belong to one spot.
        let mut above = open.iter().peekable();
        for (start, end, group) in &runs {
            while let Some((_, right, _)) = above.peek()
                && right < start
            {
                above.next();
            }
            let mut touching = above.clone();
            while let Some((left, _, other)) = touching.next()
                && left <= end
            {
                groups.join(*other, *group);
            }
        }
        open = runs;
    }
    groups.blobs(spot.max_pixels)
}

#[derive(Clone, Copy, Default)]
struct Sum {
    light: f64,
    moment: Vector2<f64>,
    pixels: usize,
}

#[derive(Default)]
struct Groups {
    parent: Vec<usize>,
    sums: Vec<Sum>,
}

impl Groups {
    fn new_run(&mut self, row: usize, start: usize, pixels: &[u8], threshold: u8) -> usize {
        let mut sum = Sum::default();
        for (k, p) in pixels.iter().enumerate() {
            let light = f64::from(p - threshold) + 1.0;
            sum.light += light;
            sum.moment += Vector2::new((start + k) as f64, row as f64) * light;
            sum.pixels += 1;
        }
        self.parent.push(self.parent.len());
        self.sums.push(sum);
        self.parent.len() - 1
    }
    fn root(&self, mut k: usize) -> usize {
        while let Some(parent) = self.parent.get(k)
            && *parent != k
        {
            k = *parent;
        }
        k
    }
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        if a == b {
            return;
        }
        // The later run becomes a child of the earlier one, which takes over its sum.
        let (low, high) = (a.min(b), a.max(b));
        let add = self.sums.get(high).copied().unwrap_or_default();
        if let (Some(parent), Some(sum)) = (self.parent.get_mut(high), self.sums.get_mut(low)) {
            *parent = low;
            sum.light += add.light;
            sum.moment += add.moment;
            sum.pixels += add.pixels;
        }
    }
    fn blobs(&self, max_pixels: usize) -> Vec<Blob> {
        let mut all: Vec<Blob> = self
            .parent
            .iter()
            .zip(&self.sums)
            .enumerate()
            .filter(|(k, (parent, sum))| *parent == k && sum.pixels <= max_pixels)
            .map(|(_, (_, sum))| Blob {
                at: sum.moment / sum.light,
                light: sum.light,
            })
            .collect();
        all.sort_by(|a, b| b.light.total_cmp(&a.light));
        all.truncate(MAX_BLOBS);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SPOT: BlobLimits = BlobLimits {
        threshold: 100,
        max_pixels: 30,
    };

    fn image(bright: &[(usize, usize, u8)]) -> GreyImage {
        let mut pixels = vec![10_u8; 64 * 48];
        for (x, y, level) in bright {
            pixels[y * 64 + x] = *level;
        }
        GreyImage::new(64, 48, pixels).unwrap()
    }

    #[test]
    fn blob_centre() {
        // A "U" whose legs join in the last row, and a pixel that touches it at a corner.
        let u = [
            (10, 10, 150),
            (12, 10, 150),
            (10, 11, 150),
            (12, 11, 150),
            (10, 12, 150),
            (11, 12, 150),
            (12, 12, 150),
            (13, 13, 150),
        ];
        let blobs = find(&image(&u), &SPOT);
        assert_eq!(blobs.len(), 1, "{blobs:?}");
        let two = find(&image(&[(5, 5, 200), (6, 5, 150), (40, 30, 255)]), &SPOT);
        assert_eq!(two.len(), 2);
        // With light of 101 and 51 the centroid lies at a third of the distance.
        let left = two.iter().find(|b| b.at.x < 20.0).unwrap();
        assert!((left.at.x - (5.0 + 51.0 / 152.0)).abs() < 1e-9 && (left.at.y - 5.0).abs() < 1e-9);
    }

    #[test]
    fn large_or_too_many_blobs() {
        let square: Vec<_> = (0..6)
            .flat_map(|y| (0..6).map(move |x| (20 + x, 20 + y, 255)))
            .collect();
        assert!(find(&image(&square), &SPOT).is_empty());
        let many: Vec<_> = (0..24)
            .flat_map(|y| (0..32).map(move |x| (2 * x, 2 * y, 120 + y as u8)))
            .collect();
        let found = find(&image(&many), &SPOT);
        assert_eq!(found.len(), MAX_BLOBS);
        assert!(found.iter().all(|b| b.light >= 40.0), "the brightest");
    }

    proptest! {
        #[test]
        fn bright_pixels_in_blobs(pixels in prop::collection::vec(any::<u8>(), 32 * 32)) {
            let grey = GreyImage::new(32, 32, pixels.clone()).unwrap();
            let all = find(&grey, &BlobLimits { threshold: 250, max_pixels: usize::MAX });
            let light: f64 = pixels.iter().filter(|p| **p >= 250).map(|p| f64::from(p - 250) + 1.0).sum();
            let found: f64 = all.iter().map(|b| b.light).sum();
            prop_assert!(all.len() == MAX_BLOBS || (light - found).abs() < 1e-6);
        }
    }
}
