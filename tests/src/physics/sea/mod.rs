//! True sea: deep-water Gerstner waves at any position and time.
//!
//! A water particle with label `x0` (its horizontal position at rest) is at `x = x0 - sum q A d sin(theta)`,
//! with elevation `zeta = sum A cos(theta)`, `theta = k d.x0 - w t + phi`, `w² = g k` (Gerstner 1802; several
//! components as in Tessendorf 2001 and VRX). Samples are Eulerian (at a fixed position). Two Newton steps
//! and a second-order correction of the phases solve `x` for `x0` at constant cost. The surface has no loops
//! while `sum q k A < 1`, which [`Sea::new`] ensures by reducing q.
//!
//! Below the surface, velocity and acceleration decay with `exp(-k h)`, where h is the depth below the
//! *instantaneous* surface. This is exact up to second order in steepness for one Gerstner wave, and is
//! Wheeler's method (1970) for irregular seas. Above the surface h is zero.
//!
//! A linear sea ([`Sea::linear`], for vessels moved by a response table) evaluates the phases at the sampled
//! position: `zeta = sum A cos(k d.x - w t + phi)`, without solving for `x0`.

pub mod config;
pub mod spectrum;
mod trig;

use core::f64::consts::TAU;

use alight_shared::{
    frames::{TrueNed, Vector},
    geometry::GRAVITY,
    time::WorldTime,
};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;

pub use config::{MAX_COMPONENTS, SeaConfig, SeaKind, Spectrum, WaveSystem};
pub(crate) use trig::sin_cos;

use crate::physics::streams::Streams;

/// Density of sea water at 15 °C, kg/m³ (ITTC 2011).
pub const WATER_DENSITY: f64 = 1026.0;

/// Maximum sum of q k A; the surface folds at 1.
const MAX_STEEPNESS: f64 = 0.9;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeaComponent {
    pub amplitude_m: f64,
    pub wave_number: f64,
    /// Angular frequency, rad/s.
    pub frequency: f64,
    /// Direction of travel: unit vector, north and east.
    pub direction: Vector2<f64>,
    /// Phase at the origin at time zero, rad.
    pub phase: f64,
}

impl SeaComponent {
    /// Deep-water wave with this angular frequency.
    pub fn deep(amplitude_m: f64, frequency: f64, direction_rad: f64, phase: f64) -> Self {
        SeaComponent {
            amplitude_m,
            wave_number: frequency * frequency / GRAVITY,
            frequency,
            direction: Vector2::new(direction_rad.cos(), direction_rad.sin()),
            phase,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterSample {
    /// Surface above the rest level, positive up, m.
    pub elevation_m: f64,
    /// Slope of the surface to the north and east, m/m.
    pub slope: Vector2<f64>,
    /// Velocity of the water, NED, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration of the water particle, NED, m/s².
    pub acceleration: Vector3<f64>,
}

impl WaterSample {
    /// Unit normal of the surface, out of the water, NED.
    pub fn normal(&self) -> Vector<TrueNed> {
        Vector::from(Vector3::new(-self.slope.x, -self.slope.y, -1.0).normalize())
    }
    /// NED z of the surface, positive down, m.
    pub fn surface_z(&self) -> f64 {
        -self.elevation_m
    }
}

#[derive(Clone, Debug)]
pub struct Sea {
    components: Vec<SeaComponent>,
    /// q: fraction of the full horizontal displacement.
    steepness_factor: f64,
    /// Airy waves: `zeta = sum A cos(k d.x - w t + phi)` at the sampled position.
    linear: bool,
    mean_direction: f64,
}

/// Minimum number of components of an irregular linear sea.
pub const LINEAR_COMPONENTS: usize = 240;

impl Sea {
    pub fn new(config: &SeaConfig, streams: &Streams) -> Sea {
        let mean = mean_direction(config, streams);
        let each = config
            .components
            .min(MAX_COMPONENTS / config.wave_systems().len().max(1));
        Sea {
            mean_direction: mean,
            ..Self::from_components(components(config, mean, each, streams))
        }
    }

    /// Airy waves of this sea, with at least [`LINEAR_COMPONENTS`] components if irregular, for a vessel
    /// whose response is linear in the sampled waves.
    pub fn linear(config: &SeaConfig, streams: &Streams) -> Sea {
        let mean = mean_direction(config, streams);
        let systems = config.wave_systems().len().max(1);
        let each = config.components.max(LINEAR_COMPONENTS.div_ceil(systems));
        Sea {
            mean_direction: mean,
            ..Self::of_linear_components(components(config, mean, each, streams))
        }
    }

    pub fn of_linear_components(mut components: Vec<SeaComponent>) -> Sea {
        components.retain(|c| c.amplitude_m > 0.0);
        Sea {
            components,
            steepness_factor: 1.0,
            linear: true,
            mean_direction: 0.0,
        }
    }

    /// Regular wave that travels towards `direction_rad`, clockwise from north.
    pub fn regular(amplitude_m: f64, wavelength_m: f64, direction_rad: f64) -> Sea {
        let frequency = (GRAVITY * TAU / wavelength_m).sqrt();
        Self::from_components(vec![SeaComponent::deep(
            amplitude_m,
            frequency,
            direction_rad,
            0.0,
        )])
    }

    /// Drops waves of zero amplitude, and any beyond [`MAX_COMPONENTS`].
    pub fn from_components(mut components: Vec<SeaComponent>) -> Sea {
        components.retain(|c| c.amplitude_m > 0.0);
        components.truncate(MAX_COMPONENTS);
        let steepness: f64 = components.iter().map(|c| c.wave_number * c.amplitude_m).sum();
        Sea {
            components,
            steepness_factor: if steepness > MAX_STEEPNESS {
                MAX_STEEPNESS / steepness
            } else {
                1.0
            },
            linear: false,
            mean_direction: 0.0,
        }
    }

    /// Returns this sea with its origin moved to `by` (north, east, m).
    #[must_use]
    pub fn about(&self, by: &Vector2<f64>) -> Sea {
        let mut sea = self.clone();
        for c in &mut sea.components {
            c.phase += c.wave_number * c.direction.dot(by);
        }
        sea
    }
    /// Direction in which the waves travel, clockwise from north, rad.
    pub fn mean_direction(&self) -> f64 {
        self.mean_direction
    }
    pub fn components(&self) -> &[SeaComponent] {
        &self.components
    }
    /// Sum of q k A; the surface does not fold while it is below 1.
    pub fn steepness(&self) -> f64 {
        let sum = |s, c: &SeaComponent| s + c.wave_number * c.amplitude_m;
        self.steepness_factor * self.components.iter().fold(0.0, sum)
    }
    pub fn variance(&self) -> f64 {
        self.components
            .iter()
            .map(|c| 0.5 * c.amplitude_m * c.amplitude_m)
            .sum()
    }

    /// Surface at `north`, `east` (m), positive up, m.
    pub fn elevation(&self, t: WorldTime, north: f64, east: f64) -> f64 {
        self.surface(t, north, east).elevation_m
    }
    /// Water at the surface above or below `north`, `east` (m).
    pub fn surface(&self, t: WorldTime, north: f64, east: f64) -> WaterSample {
        let mut out = [WaterSample::default()];
        self.sample(t, &[Vector2::new(north, east)], 0.0, &mut out);
        out[0]
    }
    /// Samples many points (north, east, m): the surface above each point, and the motion at `depth_m` below
    /// the surface.
    pub fn sample(&self, t: WorldTime, points: &[Vector2<f64>], depth_m: f64, out: &mut [WaterSample]) {
        let n = self.components.len();
        let t = t.secs();
        if self.linear {
            for (p, o) in points.iter().zip(out) {
                *o = self.sample_linear(t, *p, depth_m);
            }
            return;
        }
        let mut kernel = [Precomputed::default(); MAX_COMPONENTS];
        for (k, c) in kernel.iter_mut().zip(&self.components) {
            let wave = c.direction * c.wave_number;
            let reach = c.direction * (self.steepness_factor * c.amplitude_m);
            *k = Precomputed {
                k: wave,
                base: (c.phase - c.frequency * t) % TAU,
                reach,
                bend: [reach.x * wave.x, reach.x * wave.y, reach.y * wave.y],
                // Most samples are at the surface and need no exponential.
                decay: if depth_m > 0.0 {
                    (-c.wave_number * depth_m).exp()
                } else {
                    1.0
                },
            };
        }
        let mut trig = [(0.0, 1.0); MAX_COMPONENTS];
        for (p, o) in points.iter().zip(out) {
            *o = self.sample_one(&kernel[..n], &mut trig[..n], *p);
        }
    }

    fn sample_linear(&self, t: f64, x: Vector2<f64>, depth_m: f64) -> WaterSample {
        let mut w = WaterSample::default();
        for c in &self.components {
            let (sin, cos) = sin_cos(c.wave_number * c.direction.dot(&x) - c.frequency * t + c.phase);
            let decay = if depth_m > 0.0 {
                (-c.wave_number * depth_m).exp()
            } else {
                1.0
            };
            let up = c.amplitude_m * cos;
            let across = c.amplitude_m * sin;
            w.elevation_m += up;
            w.slope -= c.direction * (c.wave_number * across);
            let speed = c.frequency * decay;
            w.velocity += Vector3::new(c.direction.x * up, c.direction.y * up, -across) * speed;
            w.acceleration +=
                Vector3::new(c.direction.x * across, c.direction.y * across, up) * (speed * c.frequency);
        }
        w
    }

    /// Samples one position. `kernel` has values independent of the position; `trig` is scratch memory for
    /// the sine and cosine of each phase.
    fn sample_one(&self, kernel: &[Precomputed], trig: &mut [(f64, f64)], x: Vector2<f64>) -> WaterSample {
        // Solve x0 - D(x0) = x by Newton's method, with the displacement D(x0) = sum q A d sin.
        let mut displacement = Vector2::zeros();
        let mut fold = Fold::default();
        for (sc, k) in trig.iter_mut().zip(kernel) {
            *sc = trig::sin_cos(k.k.dot(&x) + k.base);
            displacement += k.reach * sc.0;
            fold.add(k, sc.1);
        }
        // First step from x0 = x: phases change by k.step, which the maximum steepness limits to 1.6 rad.
        let step = fold.solve(displacement);
        displacement = Vector2::zeros();
        fold = Fold::default();
        for (sc, k) in trig.iter_mut().zip(kernel) {
            let turn = k.k.dot(&step).clamp(-1.6, 1.6);
            *sc = turned(*sc, trig::near_zero(turn));
            displacement += k.reach * sc.0;
            fold.add(k, sc.1);
        }
        // The second step is small, so second order is sufficient.
        let step = fold.solve(displacement - step);
        for (sc, k) in trig.iter_mut().zip(kernel) {
            let e = k.k.dot(&step);
            *sc = turned(*sc, (e, 1.0 - 0.5 * e * e));
        }
        let mut w = WaterSample::default();
        let mut gradient = Vector2::zeros();
        for ((k, c), &(sin, cos)) in kernel.iter().zip(&self.components).zip(trig.iter()) {
            let up = c.amplitude_m * cos;
            w.elevation_m += up;
            gradient -= k.k * (c.amplitude_m * sin);
            let speed = c.frequency * k.decay;
            let push = speed * c.frequency;
            w.velocity += Vector3::new(
                k.reach.x * speed * cos,
                k.reach.y * speed * cos,
                -c.amplitude_m * speed * sin,
            );
            w.acceleration += Vector3::new(
                k.reach.x * push * sin,
                k.reach.y * push * sin,
                c.amplitude_m * push * cos,
            );
        }
        // d zeta/dx = (dx/dx0)^-T d zeta/dx0; the Jacobian is symmetric.
        w.slope = fold.solve(gradient);
        w
    }
}

/// Values of a component that are common to all positions of a call.
#[derive(Clone, Copy, Default)]
struct Precomputed {
    /// Wave vector k d, rad/m.
    k: Vector2<f64>,
    /// Current phase at the origin, rad.
    base: f64,
    /// Horizontal displacement amplitude q A d, m.
    reach: Vector2<f64>,
    /// Gradient of that displacement, q A k d d': north-north, north-east, east-east.
    bend: [f64; 3],
    /// Decay with depth, exp(-k h).
    decay: f64,
}

/// Sine and cosine of the sum of two angles, from those of each angle.
#[inline(always)]
fn turned(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.1 + a.1 * b.0, a.1 * b.1 - a.0 * b.0)
}

/// The symmetric 2x2 matrix `dx/dx0 = I - sum q A k d d' cos(theta)`.
#[derive(Clone, Copy)]
struct Fold {
    nn: f64,
    ne: f64,
    ee: f64,
}
impl Default for Fold {
    fn default() -> Self {
        Fold {
            nn: 1.0,
            ne: 0.0,
            ee: 1.0,
        }
    }
}
impl Fold {
    #[inline(always)]
    fn add(&mut self, c: &Precomputed, cos: f64) {
        self.nn -= c.bend[0] * cos;
        self.ne -= c.bend[1] * cos;
        self.ee -= c.bend[2] * cos;
    }
    /// Solves `fold y = v`; the matrix is positive definite while the sea does not fold.
    fn solve(&self, v: Vector2<f64>) -> Vector2<f64> {
        let det = self.nn * self.ee - self.ne * self.ne;
        Vector2::new(self.ee * v.x - self.ne * v.y, self.nn * v.y - self.ne * v.x) / det
    }
}

fn mean_direction(config: &SeaConfig, streams: &Streams) -> f64 {
    let drawn = streams.stream("sea/mean-direction").random::<f64>() * TAU;
    config.mean_direction_deg.map_or(drawn, f64::to_radians)
}

/// `each` is the number of waves per irregular system.
fn components(config: &SeaConfig, mean: f64, each: usize, streams: &Streams) -> Vec<SeaComponent> {
    if config.kind == SeaKind::Paper {
        let drawn = streams.stream("sea/wavelength-scale").random_range(1.1..1.5);
        let s: f64 = config.wavelength_scale.unwrap_or(drawn);
        let middle = TAU / config.period_s;
        let mut phases = streams.stream("sea/phase");
        return [-1.0, 0.0, 1.0]
            .into_iter()
            .map(|i: f64| {
                SeaComponent::deep(
                    config.amplitude_m * s.powf(i),
                    // A factor of s^i in wavelength is s^(-i/2) in frequency.
                    middle * s.powf(-0.5 * i),
                    mean + i * config.direction_step_rad,
                    spectrum::phase(&mut phases),
                )
            })
            .collect();
    }
    let systems = config.wave_systems();
    let of_system = |(k, system): (usize, &WaveSystem)| irregular(k, system, mean, each.max(1), streams);
    systems.iter().enumerate().flat_map(of_system).collect()
}

/// Components of the `k`th irregular system with equal energy: `A = sqrt(2 m0 / n)`, `m0 = Hs²/16`. The
/// stream names of the first system have no number.
fn irregular(k: usize, system: &WaveSystem, mean: f64, n: usize, streams: &Streams) -> Vec<SeaComponent> {
    let amplitude = system.significant_height_m / 4.0 * (2.0 / n as f64).sqrt();
    let stream = |name: &str| match k {
        0 => streams.stream(name),
        _ => streams.stream(&format!("{name} {k}")),
    };
    let mut directions = stream("sea/direction");
    let mut phases = stream("sea/phase");
    let peak = TAU / system.peak_period_s;
    let mean = mean + system.from_mean_deg.to_radians();
    spectrum::frequencies(peak, system.enhancement(), n, &mut stream("sea/frequency"))
        .into_iter()
        .map(|w| {
            SeaComponent::deep(
                amplitude,
                w,
                mean + spectrum::direction(system.spread, &mut directions),
                spectrum::phase(&mut phases),
            )
        })
        .collect()
}

#[cfg(test)]
mod tests;
