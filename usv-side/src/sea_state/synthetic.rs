//! Synthetic records for the tests: plane waves, a hull that follows the surface, sensor noise.
//! (The simulated world, with other physics, is met in `tests/`.)

use std::f64::consts::TAU;

use alight_shared::time::{Time, VesselClock};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::MotionSample;

const G: f64 = 9.80665;

/// One plane wave: amplitude m, angular frequency rad/s, direction rad, phase rad.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    pub a: f64,
    pub omega: f64,
    pub direction: f64,
    pub phase: f64,
}

/// The paper's three-component sea: amplitudes `A s^(-1, 0, 1)`, wavelengths scaled by `s`,
/// directions 0.4 rad apart.
pub fn paper(seed: u64, amplitude: f64, period: f64, s: f64) -> Vec<Plane> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mean = TAU * rng.random::<f64>();
    (-1..=1)
        .map(|i| Plane {
            a: amplitude * s.powi(i),
            omega: TAU / period * s.powf(-0.5 * f64::from(i)),
            direction: mean + 0.4 * f64::from(i),
            phase: TAU * rng.random::<f64>(),
        })
        .collect()
}

/// JONSWAP (gamma 3.3) by 40 components of jittered frequency, cos^2 spread.
pub fn jonswap(seed: u64, height: f64, period: f64) -> Vec<Plane> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mean = TAU * rng.random::<f64>();
    let w0 = TAU / period;
    let n = 40;
    let (low, high) = (0.6 * w0, 2.5 * w0);
    let step = (high - low) / f64::from(n);
    let mut planes: Vec<Plane> = (0..n)
        .map(|i| {
            let w = low + (f64::from(i) + rng.random::<f64>()) * step;
            let sigma: f64 = if w < w0 { 0.07 } else { 0.09 };
            let peak = (-(w - w0).powi(2) / (2.0 * (sigma * w0).powi(2))).exp();
            let s = w.powi(-5) * (-1.25 * (w0 / w).powi(4)).exp() * 3.3f64.powf(peak);
            Plane {
                a: (2.0 * s * step).sqrt(),
                omega: w,
                direction: mean + 0.6 * (rng.random::<f64>() + rng.random::<f64>() - 1.0),
                phase: TAU * rng.random::<f64>(),
            }
        })
        .collect();
    let m0: f64 = planes.iter().map(|p| 0.5 * p.a * p.a).sum();
    let scale = height / (4.0 * m0.sqrt());
    planes.iter_mut().for_each(|p| p.a *= scale);
    planes
}

/// Clean channels at time `t`, mean position `x` and mean velocity `v`.
pub fn truth(planes: &[Plane], t: f64, x: [f64; 2], v: [f64; 2]) -> [f64; 3] {
    let mut y = [0.0; 3];
    for p in planes {
        let k = p.omega * p.omega / G;
        let (sin_d, cos_d) = p.direction.sin_cos();
        let phase = p.omega * t - k * (cos_d * x[0] + sin_d * x[1]) + p.phase;
        let (sin, cos) = phase.sin_cos();
        // Along a straight path the surface is met at the frequency of encounter.
        let encounter = p.omega - k * (cos_d * v[0] + sin_d * v[1]);
        y[0] -= encounter * encounter * p.a * cos;
        // n = i k d zeta
        y[1] -= k * cos_d * p.a * sin;
        y[2] -= k * sin_d * p.a * sin;
    }
    y
}

/// A vessel's record: the path and the noisy samples along it.
pub struct Voyage<'a> {
    pub seed: u64,
    pub rate_hz: f64,
    pub seconds: f64,
    pub tilt_noise: f64,
    pub acceleration_noise: f64,
    /// Mean velocity at a time.
    pub velocity: &'a dyn Fn(f64) -> [f64; 2],
    /// The sea at a time.
    pub sea: &'a dyn Fn(f64) -> Vec<Plane>,
}

impl Voyage<'_> {
    /// Samples, and after each the mean position.
    pub fn samples(&self) -> Vec<(MotionSample, [f64; 2])> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ 0x5ea);
        let mut noise = move |sd: f64| -> f64 {
            let z: f64 = StandardNormal.sample(&mut rng);
            sd * z
        };
        let n = (self.seconds * self.rate_hz) as usize;
        let dt = 1.0 / self.rate_hz;
        let mut x = [0.0; 2];
        (0..n)
            .map(|i| {
                let t = i as f64 * dt;
                let v = (self.velocity)(t);
                let y = truth(&(self.sea)(t), t, x, v);
                let sample = MotionSample {
                    at: Time::<VesselClock>::from_secs(1000.0 + t),
                    mean_velocity: [v[0] + noise(0.03), v[1] + noise(0.03)],
                    normal: [
                        y[1] + 0.01 + noise(self.tilt_noise),
                        y[2] - 0.02 + noise(self.tilt_noise),
                    ],
                    acceleration_up: y[0] + 0.05 + noise(self.acceleration_noise),
                };
                let here = x;
                x[0] += v[0] * dt;
                x[1] += v[1] * dt;
                (sample, here)
            })
            .collect()
    }
}

/// Uneven times for the samples of the "uneven" test.
pub fn jitter(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    move || rng.random::<f64>()
}
