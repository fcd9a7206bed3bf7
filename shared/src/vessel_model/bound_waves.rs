//! Sharper crests and flatter troughs than the waves' sum: what a hull meets that the water does not carry along,
//! and, in slope alone, one that it does.
//!
//! A wave of small amplitude is linear in a frame that moves with the water's particles (Gerstner 1802;
//! as a model of the sea: Nouguier, Guérin and Chapron 2009, the "choppy wave model"). A particle with the
//! place at rest `x0` is at `x = x0 - sum d A sin(theta)`, `theta = k d.x0 - omega t + phi`, and at the
//! height `sum A cos(theta)`. A light free hull is carried along and feels the oscillators' plain sum. One
//! that stands still over the orbital motion, or takes only a share of it, asks what is at its *place*: it
//! meets the particle `x0 = wave_following_deficit sum d A sin(theta(x0))`. At a steepness `sum k A` of 0.4 that moves heave
//! by 0.16 m and slope by 0.04 (rms): multiples and sums of the waves' frequencies, bound to them, that
//! no further oscillator follows in phase.
//!
//! At a crest particles come nearer to each other, `dx/dx0 = I - sum k A d d' cos(theta)`: slopes per metre of
//! place are those per metre of label through its inverse, whoever looks at them.
//!
//! Phasors `q` turn with `exp(i omega t)`: of an oscillator, `value - i rate / omega`. A label further along
//! the direction of travel is later in phase, `q(x0) = q exp(-i k d.x0)`.

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Complex, Matrix2, Vector2};

use crate::geometry::GRAVITY;

/// Waves that are looked at, more than a message holds.
const MAX_WAVES: usize = 8;
/// Newton steps for the label; the last changes heave by less than 1 mm at a steepness of 0.5.
const STEPS: usize = 4;
/// Greatest `wave_following_deficit sum k A`: at 1 the surface begins to fold, and what is steeper is taken for an error.
const STEEPEST: f64 = 0.8;
/// Half of the step of the differences that give rate and acceleration, s.
const HALF_S: f64 = 0.05;

/// One wave as the hull feels it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveResponse {
    /// Phasors of heave (m, down), and of roll and pitch (rad) of a hull that heads along the first axis.
    pub phasors: [Complex<f64>; 3],
    /// Direction of travel in the frame of the phasors times how surely it is known (0 to 1).
    pub direction: Vector2<f64>,
    /// Wave number, rad/m; negative for a wave that the hull overtakes.
    pub wave_number: f64,
    /// Angular frequency of encounter, rad/s.
    pub omega: f64,
}

impl WaveResponse {
    const STILL: WaveResponse = WaveResponse {
        phasors: [Complex::new(0.0, 0.0); 3],
        direction: Vector2::new(0.0, 0.0),
        wave_number: 0.0,
        omega: 0.0,
    };
    /// A wave of earth-frame frequency `omega` (rad/s) that travels to `direction` (rad from the first axis,
    /// standard deviation `direction_sd`), met at `omega_encounter` by a hull of the mean velocity given.
    /// Deep water: `k = omega² / g`.
    pub fn new(
        phasors: [Complex<f64>; 3],
        (omega, omega_encounter): (f64, f64),
        (direction, direction_sd): (f64, f64),
        mean_velocity: [f64; 2],
    ) -> Self {
        let (s, c) = direction.sin_cos();
        let k = omega * omega / GRAVITY;
        // The phasor of a wave that the hull overtakes turns the other way, unless its frequency says so.
        let overtaken = omega_encounter > 0.0 && k * (mean_velocity[0] * c + mean_velocity[1] * s) > omega;
        // The mean of a direction that is spread normally; one that nobody knows shifts nothing.
        let known = if direction_sd < FRAC_PI_2 {
            (-0.5 * direction_sd * direction_sd).exp()
        } else {
            0.0
        };
        WaveResponse {
            phasors,
            direction: Vector2::new(c, s) * known,
            wave_number: if overtaken { -k } else { k },
            omega: omega_encounter,
        }
    }
    /// How much later in phase the particle of this label is.
    fn turn(&self, label: &Vector2<f64>) -> Complex<f64> {
        let (s, c) = (self.wave_number * self.direction.dot(label)).sin_cos();
        Complex::new(c, -s)
    }
    /// The phasors after `t` seconds.
    fn after(mut self, t: f64) -> Self {
        let turn = Complex::from_polar(1.0, self.omega * t);
        self.phasors = self.phasors.map(|q| q * turn);
        self
    }
}

/// Heave (m, down), roll and pitch (rad) less the sum of the oscillators, with first and second derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundMotion {
    /// m, rad.
    pub value: [f64; 3],
    /// m/s, rad/s.
    pub rate: [f64; 3],
    /// m/s², rad/s².
    pub acceleration: [f64; 3],
}

/// By how much the hull's motion is more than the oscillators' sum.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaveNonlinearity {
    /// Share of the water's orbital motion that passes under the hull, 0 (carried along) to 1 (it stands).
    pub wave_following_deficit: f64,
    /// Share, 0 to 1, of what crests are steeper by than the sum of slopes on a hull that is carried along:
    /// particles come nearer to each other there.
    pub crest_steepening: f64,
}

impl WaveNonlinearity {
    /// It is the plain sum.
    pub fn is_linear(&self) -> bool {
        !(self.wave_following_deficit > 0.0 || self.crest_steepening > 0.0)
    }
}

/// What heave, roll and pitch differ by from the oscillators' sum, m, rad.
pub fn bound(waves: &[WaveResponse], nonlinearity: WaveNonlinearity) -> [f64; 3] {
    let (_, value) = solve(waves, nonlinearity, 0.0, (Vector2::zeros(), STEPS));
    value
}

/// The same `t` seconds later, by `steps` Newton steps from a guess of the label; the label with it.
fn solve(
    waves: &[WaveResponse],
    nonlinearity: WaveNonlinearity,
    t: f64,
    (guess, steps): (Vector2<f64>, usize),
) -> (Vector2<f64>, [f64; 3]) {
    let mut now = [WaveResponse::STILL; MAX_WAVES];
    let mut steepness = 0.0;
    let mut n = 0;
    // Waves of no known direction are the same in either sum.
    for w in waves
        .iter()
        .filter(|w| w.direction != Vector2::zeros())
        .take(MAX_WAVES)
    {
        now[n] = if t == 0.0 { *w } else { w.after(t) };
        steepness += w.wave_number.abs() * w.direction.norm() * w.phasors[0].norm();
        n += 1;
    }
    let now = &now[..n];
    let most = STEEPEST / steepness.max(STEEPEST);
    let (wave_following_deficit, crest_steepening) = (
        nonlinearity.wave_following_deficit.min(most),
        nonlinearity.crest_steepening.min(most),
    );
    let mut label = guess;
    let mut stretch = Matrix2::identity();
    for step in 0..=steps {
        let mut displaced = Vector2::zeros();
        stretch = Matrix2::identity();
        for w in now {
            let q = w.phasors[0] * w.turn(&label);
            displaced += w.direction * (q.im * w.wave_number.signum());
            stretch +=
                w.direction * w.direction.transpose() * (wave_following_deficit * w.wave_number.abs() * q.re);
        }
        if step < steps
            && let Some(inverse) = stretch.try_inverse()
        {
            label -= inverse * (label - displaced * wave_following_deficit);
        }
    }
    let (mut shifted, mut sum) = ([0.0; 3], [0.0; 3]);
    if crest_steepening > wave_following_deficit {
        stretch = Matrix2::identity();
    }
    for w in now {
        let turn = w.turn(&label);
        if crest_steepening > wave_following_deficit {
            let heave = (w.phasors[0] * turn).re;
            stretch +=
                w.direction * w.direction.transpose() * (crest_steepening * w.wave_number.abs() * heave);
        }
        for (i, q) in w.phasors.iter().enumerate() {
            shifted[i] += (q * turn).re;
            sum[i] += q.re;
        }
    }
    // Heights along the two axes per metre of label, then per metre of place.
    let slope = Vector2::new(shifted[2], -shifted[1]);
    let slope = stretch
        .try_inverse()
        .map_or(slope, |inverse| inverse.transpose() * slope);
    let extra = slope - Vector2::new(sum[2], -sum[1]);
    (label, [shifted[0] - sum[0], -extra.y, extra.x])
}

/// The same with its derivatives, `ahead` seconds from now.
pub fn bound_motion(waves: &[WaveResponse], nonlinearity: WaveNonlinearity, ahead: f64) -> BoundMotion {
    if nonlinearity.is_linear() || waves.is_empty() {
        return BoundMotion::default();
    }
    let (label, b) = solve(waves, nonlinearity, ahead, (Vector2::zeros(), STEPS));
    let (_, a) = solve(waves, nonlinearity, ahead - HALF_S, (label, 2));
    let (_, c) = solve(waves, nonlinearity, ahead + HALF_S, (label, 2));
    BoundMotion {
        value: b,
        rate: core::array::from_fn(|i| (c[i] - a[i]) / (2.0 * HALF_S)),
        acceleration: core::array::from_fn(|i| (c[i] - 2.0 * b[i] + a[i]) / (HALF_S * HALF_S)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three waves (amplitude, omega, direction, phase) of the steepest sea of Table II.
    const SEA: [[f64; 4]; 3] = [
        [0.66, 1.379, 1.74, 3.2],
        [0.8, 1.257, 2.14, 4.4],
        [0.96, 1.145, 2.54, 2.1],
    ];

    /// Height (up) and slope at the origin by brute force, from the particles' parametric surface.
    fn surface(t: f64, place: Vector2<f64>) -> f64 {
        let mut x0 = place;
        for _ in 0..200 {
            let mut x = Vector2::zeros();
            for [a, w, d, p] in SEA {
                let dir = Vector2::new(d.cos(), d.sin());
                x += dir * a * (w * w / GRAVITY * dir.dot(&x0) - w * t + p).sin();
            }
            x0 = place + x;
        }
        SEA.iter()
            .map(|[a, w, d, p]| {
                let dir = Vector2::new(d.cos(), d.sin());
                a * (w * w / GRAVITY * dir.dot(&x0) - w * t + p).cos()
            })
            .sum()
    }
    fn slips(wave_following_deficit: f64) -> WaveNonlinearity {
        WaveNonlinearity {
            wave_following_deficit,
            crest_steepening: 0.0,
        }
    }
    fn waves() -> Vec<WaveResponse> {
        SEA.iter()
            .map(|&[a, w, d, p]| {
                let k = w * w / GRAVITY;
                // Height A cos(p - w t) is Re(A exp(-i p) exp(i w t)); its gradient -k d A sin.
                let up = Complex::from_polar(a, -p);
                let slope = up * Complex::new(0.0, -1.0) * k;
                let phasors = [-up, -slope * d.sin(), slope * d.cos()];
                WaveResponse::new(phasors, (w, w), (d, 0.0), [0.0; 2])
            })
            .collect()
    }

    #[test]
    fn bound_waves_of_a_standing_hull_match_the_particle_surface() {
        let waves = waves();
        let mut largest = 0.0_f64;
        for i in 0..80 {
            let t = 0.25 * f64::from(i);
            let then: Vec<WaveResponse> = waves.iter().map(|w| w.after(t)).collect();
            let extra = bound(&then, slips(1.0));
            let linear: [f64; 3] = core::array::from_fn(|k| then.iter().map(|w| w.phasors[k].re).sum());
            let height = surface(t, Vector2::zeros());
            assert!((linear[0] + extra[0] + height).abs() < 2e-3, "{t}");
            let h = 1e-3;
            let gradient = |d: Vector2<f64>| (surface(t, d * h) - surface(t, -d * h)) / (2.0 * h);
            let (ahead, right) = (gradient(Vector2::x()), gradient(Vector2::y()));
            assert!((linear[2] + extra[2] - ahead).abs() < 2e-3, "{t}");
            assert!((linear[1] + extra[1] + right).abs() < 2e-3, "{t}");
            largest = largest.max(extra[0].abs());
        }
        assert!(largest > 0.2, "a steep sea is not linear: {largest}");
    }

    /// The slope of the surface at the particle that the hull goes with.
    #[test]
    fn bound_waves_of_a_following_hull_steepen_crests_and_keep_heave() {
        let waves = waves();
        let nonlinearity = WaveNonlinearity {
            wave_following_deficit: 0.0,
            crest_steepening: 1.0,
        };
        let mut largest = 0.0_f64;
        for i in 0..80 {
            let t = 0.25 * f64::from(i);
            let then: Vec<WaveResponse> = waves.iter().map(|w| w.after(t)).collect();
            let extra = bound(&then, nonlinearity);
            assert_eq!(extra[0], 0.0);
            // Where the particle that rests at the origin is now.
            let mut place = Vector2::zeros();
            for [a, w, d, p] in SEA {
                place -= Vector2::new(d.cos(), d.sin()) * a * (p - w * t).sin();
            }
            let h = 1e-3;
            let ahead =
                (surface(t, place + Vector2::x() * h) - surface(t, place - Vector2::x() * h)) / (2.0 * h);
            let linear: f64 = then.iter().map(|w| w.phasors[2].re).sum();
            assert!((linear + extra[2] - ahead).abs() < 2e-3, "{t}");
            largest = largest.max(extra[1].hypot(extra[2]));
        }
        assert!(largest > 0.02, "{largest}");
    }

    #[test]
    fn bound_motion_is_differentiated_correctly_and_zero_for_a_following_hull() {
        let waves = waves();
        let value = |t: f64| bound_motion(&waves, slips(0.6), t).value;
        for t in [0.3, 2.1, 5.7] {
            let b = bound_motion(&waves, slips(0.6), t);
            for i in 0..3 {
                let h = 0.02;
                let rate = (value(t + h)[i] - value(t - h)[i]) / (2.0 * h);
                assert!((b.rate[i] - rate).abs() < 0.02 * rate.abs() + 5e-3);
            }
        }
        assert_eq!(bound_motion(&waves, slips(0.0), 1.0), BoundMotion::default());
        assert_eq!(bound_motion(&[], slips(1.0), 1.0), BoundMotion::default());
    }

    #[test]
    fn bound_waves_stay_finite_for_unknown_directions_and_folding_surfaces() {
        let mut waves = waves();
        let [a, w, d, _] = SEA[0];
        waves.truncate(1);
        let q = waves[0].phasors;
        waves[0] = WaveResponse::new(q, (w, w), (d, core::f64::consts::PI), [0.0; 2]);
        assert_eq!(bound(&waves, slips(1.0)), [0.0; 3]);
        waves[0] = WaveResponse::new(q.map(|q| q * (10.0 / a)), (w, w), (d, 0.0), [0.0; 2]);
        for i in 0..40 {
            let then: Vec<WaveResponse> = waves.iter().map(|w| w.after(0.1 * f64::from(i))).collect();
            assert!(
                bound(&then, slips(1.0))
                    .iter()
                    .all(|v| v.is_finite() && v.abs() < 20.0)
            );
        }
    }
}
