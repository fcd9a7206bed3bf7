use alight_uav::camera::Lens;

use crate::sensors::noise::Noise;

/// Direction of a pixel's centre at unit distance, and its change per pixel to the right and per pixel down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) at: [f32; 2],
    right: [f32; 2],
    down: [f32; 2],
}

impl Ray {
    /// Direction at an offset in pixels.
    pub(super) fn moved(&self, right: f32, down: f32) -> [f32; 2] {
        [
            self.at[0] + self.right[0] * right + self.down[0] * down,
            self.at[1] + self.right[1] * right + self.down[1] * down,
        ]
    }
}

/// Rays of all pixels, in rows from the top.
#[derive(Clone, Debug)]
pub(super) struct Rays {
    pub(super) all: Vec<Ray>,
    /// Maximum distance of a ray from the optical axis, at unit distance.
    furthest: f64,
}

fn distort(lens: &Lens, x: f64, y: f64) -> [f64; 2] {
    let [k1, k2, p1, p2, k3] = lens.distortion;
    let r2 = x * x + y * y;
    let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
    [
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    ]
}

/// Inverse distortion, by damped fixed-point iteration.
fn straight(lens: &Lens, x: f64, y: f64) -> [f64; 2] {
    let mut n = [x, y];
    for _ in 0..60 {
        let d = distort(lens, n[0], n[1]);
        let next = [n[0] + 0.7 * (x - d[0]), n[1] + 0.7 * (y - d[1])];
        if next == n {
            break;
        }
        n = next;
    }
    n
}

impl Rays {
    pub(super) fn new(lens: &Lens) -> Rays {
        let (width, height) = (lens.width_px as usize, lens.height_px as usize);
        let direction = |u: f64, v: f64| {
            straight(
                lens,
                (u - lens.centre_px[0]) / lens.focal_px[0],
                (v - lens.centre_px[1]) / lens.focal_px[1],
            )
        };
        let mut furthest = 0.0_f64;
        let all = (0..width * height)
            .map(|k| {
                let (u, v) = ((k % width) as f64, (k / width) as f64);
                let at = direction(u, v);
                furthest = furthest.max(at[0].hypot(at[1]));
                let (a, b) = (direction(u + 0.5, v), direction(u - 0.5, v));
                let (c, d) = (direction(u, v + 0.5), direction(u, v - 0.5));
                let single = |v: [f64; 2]| v.map(|x| x as f32);
                Ray {
                    at: single(at),
                    right: single([a[0] - b[0], a[1] - b[1]]),
                    down: single([c[0] - d[0], c[1] - d[1]]),
                }
            })
            .collect();
        Rays { all, furthest }
    }
    /// Pixel of a direction at unit distance. A direction outside the image is first moved close to its edge,
    /// where the distortion model is valid.
    pub(super) fn pixel(&self, lens: &Lens, x: f64, y: f64) -> [f64; 2] {
        let max_radius = 1.05 * self.furthest;
        let scale = (max_radius / x.hypot(y).max(1e-12)).min(1.0);
        let d = distort(lens, x * scale, y * scale);
        [
            d[0] * lens.focal_px[0] + lens.centre_px[0],
            d[1] * lens.focal_px[1] + lens.centre_px[1],
        ]
    }
}

/// A ray: offset within the pixel, px, and time from the middle of the exposure, as a fraction of the exposure.
#[derive(Clone, Copy, Debug)]
pub(super) struct RaySample {
    pub(super) right: f32,
    pub(super) down: f32,
    pub(super) time: f64,
}

/// `side` x `side` rays, Gaussian with the combined variance of pixel area and optics.
#[derive(Clone, Debug)]
pub(super) struct Pattern {
    pub(super) side: usize,
    pub(super) rays: Vec<RaySample>,
}

impl Pattern {
    /// Maximum distance of a ray from the pixel's centre along an axis, px.
    pub(super) fn reach_px(&self) -> f32 {
        let furthest = |r: &RaySample| r.right.abs().max(r.down.abs());
        self.rays.iter().map(furthest).fold(0.0, f32::max)
    }
    pub(super) fn new(side: usize, optics_sd_px: f64, draw: &mut Noise) -> Pattern {
        // The variance of a pixel's area is 1/12 px².
        let sd = (1.0 / 12.0 + optics_sd_px * optics_sd_px).sqrt();
        let place = |k: usize| normal_quantile((k as f64 + 0.5) / side as f64);
        let spread = ((0..side).map(|k| place(k).powi(2)).sum::<f64>() / side as f64).sqrt();
        let count = side * side;
        let at = |k: usize| [k % side, k / side].map(|i| place(i) * sd / spread.max(1e-9));
        // The times of rays are uncorrelated with both directions; otherwise a moving edge would be sharper on one
        // side. A ray and its mirror image about the pixel's centre are equally far from the middle of the exposure, on
        // opposite sides; otherwise odd moments of position and time would shift all edges of a 9 px smear by 0.3 px.
        let mut best: (f64, Vec<usize>) = (f64::INFINITY, (0..count).collect());
        for _ in 0..400 {
            let mut order: Vec<usize> = (0..count).collect();
            let half = count / 2;
            for k in (1..half).rev() {
                order.swap(k, ((k + 1) as f64 * draw.uniform()) as usize % (k + 1));
            }
            for k in 0..half {
                if draw.uniform() < 0.5 {
                    order[k] = count - 1 - order[k];
                }
                order[count - 1 - k] = count - 1 - order[k];
            }
            let along = |axis: usize| -> f64 {
                let pairs = order.iter().enumerate();
                pairs.map(|(k, t)| at(k)[axis] * time(*t, count)).sum()
            };
            let tilt = along(0).abs() + along(1).abs();
            if tilt < best.0 {
                best = (tilt, order);
            }
        }
        let rays = best.1.iter().enumerate();
        Pattern {
            side,
            rays: rays
                .map(|(k, t)| RaySample {
                    right: at(k)[0] as f32,
                    down: at(k)[1] as f32,
                    time: time(*t, count),
                })
                .collect(),
        }
    }
}

/// Middle of the `k`-th of `count` parts of the exposure.
fn time(k: usize, count: usize) -> f64 {
    (k as f64 + 0.5) / count as f64 - 0.5
}

/// Standard normal quantile (Abramowitz and Stegun 1964, 26.2.23; error below 5e-4).
fn normal_quantile(p: f64) -> f64 {
    let q = p.min(1.0 - p).max(1e-9);
    let t = (-2.0 * q.ln()).sqrt();
    let top = 2.515_517 + t * (0.802_853 + t * 0.010_328);
    let bottom = 1.0 + t * (1.432_788 + t * (0.189_269 + t * 0.001_308));
    (t - top / bottom) * if p < 0.5 { -1.0 } else { 1.0 }
}
