//! Response of the hull to a single wave according to the vessel model: a wall-sided hull with the model's
//! stiffness. Heave, roll and pitch respond as damped oscillators to a wave averaged over length and beam,
//! and the water carries the hull along horizontally.
//!
//! For the wave `Re(e^{i psi})`, positive up, with `psi = omega_e t - k x` (deep water, `k = omega²/g`), relative direction
//! `mu` (0 in a following sea, which runs towards the bow) and frequency of encounter `omega_e = omega - k U cos mu`:
//!
//! ```text
//! heave (down)   -N_0(k L cos mu / 2) N_0(k B sin mu / 2) H_3(omega_e)
//! pitch (bow up) -i k cos mu  N_1(k L cos mu / 2) H_5(omega_e)
//! roll           +i k sin mu  N_1(k B sin mu / 2) H_4(omega_e)
//! acceleration    i omega² N_0 N_0 [cos mu, sin mu]
//! H_d(w) = w_d² / (w_d² - w² + 2 i zeta_d w_d w),  N_0(x) = sin x / x,  N_1(x) = 3 (sin x - x cos x) / x³
//! ```
//!
//! `w_d² = G/M`, `zeta_d = D / (2 sqrt(G M))` and, for wall-sided hulls, `L² = 12 G_5/G_3`, `B² = 12 G_4/G_3` from the
//! vessel model (Fossen 2011, sections 8.1 and 8.2; Faltinsen 1990, chapter 3). In the horizontal directions, the
//! wave's pressure accelerates the hull like the water that it displaces, at any speed.

use alight_shared::{
    geometry::GRAVITY,
    vessel_model::{HEAVE, PITCH, ROLL, VesselModelConfig},
};
use nalgebra::{Complex, Vector3};

/// Averaging time of slopes, s, as for the apparent slope.
const MEAN_S: f64 = 1.0;

/// Number of compared signals of the deck's motion.
pub(super) const SIGNALS: usize = 7;
/// Apparent slope along and across the hull, averaged over one second.
pub(super) const SLOPE: [usize; 2] = [0, 1];
/// Vertical speed, m/s.
pub(super) const SINK: usize = 2;
/// Tilt, rad.
pub(super) const TILT: [usize; 2] = [3, 4];
/// Horizontal and vertical acceleration, m/s².
pub(super) const PUSH: usize = 5;
pub(super) const LIFT: usize = 6;

pub(super) type Powers = [f64; SIGNALS];

/// Motion of the hull's reference point at one frequency, as complex amplitudes.
#[derive(Clone, Copy, Debug)]
pub(super) struct HullMotion {
    /// Acceleration forward and to starboard, m/s².
    pub push: [Complex<f64>; 2],
    /// Heave, positive down, m.
    pub heave: Complex<f64>,
    pub tilt: [Complex<f64>; 2],
}

impl HullMotion {
    /// Squared amplitudes of the signals at the deck's centre (body frame, m) at the frequency `w`, rad/s.
    pub(super) fn powers(&self, w: f64, deck: &Vector3<f64>) -> Powers {
        let i = Complex::i();
        let [roll, pitch] = self.tilt;
        let ahead = self.push[0] - pitch * (w * w * deck.z);
        let right = self.push[1] + roll * (w * w * deck.z);
        let sink = i * w * (self.heave + roll * deck.y - pitch * deck.x);
        let mean = mean_over(0.5 * w * MEAN_S) / GRAVITY;
        let slopes = [(ahead + pitch * GRAVITY) * mean, (right - roll * GRAVITY) * mean];
        let mut out = Powers::default();
        out[SLOPE[0]] = slopes[0].norm_sqr();
        out[SLOPE[1]] = slopes[1].norm_sqr();
        out[SINK] = sink.norm_sqr();
        out[TILT[0]] = roll.norm_sqr();
        out[TILT[1]] = pitch.norm_sqr();
        out[PUSH] = ahead.norm_sqr() + right.norm_sqr();
        out[LIFT] = (sink * w).norm_sqr();
        out
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Encounter {
    /// Angular frequency of the wave, rad/s.
    pub omega: f64,
    /// Direction of propagation relative to the bow, rad.
    pub relative: f64,
    /// Frequency of encounter, rad/s; negative if the vessel overtakes the wave.
    pub met: f64,
}

impl Encounter {
    /// Wave of frequency `omega` propagating towards `towards`, met by a vessel with this heading (rad) and speed, m/s.
    pub(super) fn of(omega: f64, towards: f64, heading: f64, speed_mps: f64) -> Encounter {
        let relative = towards - heading;
        Encounter {
            omega,
            relative,
            met: omega - omega * omega / GRAVITY * speed_mps * relative.cos(),
        }
    }
}

/// Damped oscillator: natural frequency, rad/s, and damping ratio.
#[derive(Clone, Copy, Debug)]
struct Oscillator {
    natural: f64,
    damping: f64,
}

impl Oscillator {
    fn response(&self, w: f64) -> Complex<f64> {
        let n = self.natural;
        Complex::from(n * n) / Complex::new(n * n - w * w, 2.0 * self.damping * n * w)
    }
}

#[derive(Clone, Debug)]
pub(super) struct HullModel {
    heave: Oscillator,
    roll: Oscillator,
    pitch: Oscillator,
    length_m: f64,
    beam_m: f64,
}

impl HullModel {
    /// Hull with the parameters of the vessel model; a degree of freedom without stiffness follows the water.
    pub(super) fn of(model: &VesselModelConfig) -> HullModel {
        let m = model.inertia_kg_kgm2;
        let d = model.damping_npmps_nmpradps;
        let g = model.stiffness_npm_nmprad;
        let oscillator = |dof: usize| Oscillator {
            natural: if g[dof] > 0.0 {
                (g[dof] / m[dof]).sqrt()
            } else {
                1e3
            },
            damping: if g[dof] > 0.0 {
                d[dof] / (2.0 * (g[dof] * m[dof]).sqrt())
            } else {
                1.0
            },
        };
        let size = |dof: usize| {
            if g[HEAVE] > 0.0 {
                (12.0 * g[dof] / g[HEAVE]).sqrt()
            } else {
                0.0
            }
        };
        HullModel {
            heave: oscillator(HEAVE),
            roll: oscillator(ROLL),
            pitch: oscillator(PITCH),
            length_m: size(PITCH),
            beam_m: size(ROLL),
        }
    }
    /// Motion of the hull per metre of wave amplitude.
    pub(super) fn motion(&self, e: &Encounter) -> HullMotion {
        let k = e.omega * e.omega / GRAVITY;
        let (sin, cos) = e.relative.sin_cos();
        let along = 0.5 * k * self.length_m * cos;
        let across = 0.5 * k * self.beam_m * sin;
        let whole = mean_over(along) * mean_over(across);
        let push = Complex::new(0.0, e.omega * e.omega * whole);
        let slope = Complex::new(0.0, -k);
        HullMotion {
            push: [push * cos, push * sin],
            heave: self.heave.response(e.met) * -whole,
            tilt: [
                self.roll.response(e.met) * slope * (-sin * moment_over(across)),
                self.pitch.response(e.met) * slope * (cos * moment_over(along)),
            ],
        }
    }
}

fn mean_over(x: f64) -> f64 {
    if x.abs() < 1e-4 { 1.0 } else { x.sin() / x }
}
fn moment_over(x: f64) -> f64 {
    if x.abs() < 1e-2 {
        1.0 - 0.1 * x * x
    } else {
        3.0 * (x.sin() - x * x.cos()) / x.powi(3)
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    fn powers(relative: f64, omega: f64, speed_mps: f64, deck: Vector3<f64>) -> (Powers, f64) {
        let e = Encounter::of(omega, relative, 0.0, speed_mps);
        let hull = HullModel::of(&VesselModelConfig::default());
        (hull.motion(&e).powers(e.met, &deck), e.met)
    }

    #[test]
    fn long_wave_that_carries_the_hull() {
        let omega = 0.5;
        let k = 0.25 / GRAVITY;
        for relative in [0.0, 0.7, FRAC_PI_2, PI] {
            let (p, _) = powers(relative, omega, 0.0, Vector3::zeros());
            // The hull heaves and tilts with the water, so the apparent slope vanishes.
            assert!((p[SINK].sqrt() - omega).abs() < 0.02 * omega, "{relative}");
            let tilt = (p[TILT[0]] + p[TILT[1]]).sqrt();
            assert!((tilt - k).abs() < 0.05 * k, "{relative}: {tilt}");
            let slope = (p[SLOPE[0]] + p[SLOPE[1]]).sqrt();
            assert!(slope < 0.15 * k, "{relative}: {slope}");
        }
    }

    #[test]
    fn frequency_of_encounter() {
        let (head, met) = powers(PI, 1.26, 4.0, Vector3::new(-1.0, 0.0, -1.2));
        let (following, overtaken) = powers(0.0, 1.26, 4.0, Vector3::new(-1.0, 0.0, -1.2));
        assert!(met > 1.8 && overtaken < 0.7, "{met} {overtaken}");
        assert!(head[SINK] > 4.0 * following[SINK] && head[LIFT] > 20.0 * following[LIFT]);
        assert!(head[TILT[0]] < 1e-12 && following[TILT[0]] < 1e-12);
    }
}
