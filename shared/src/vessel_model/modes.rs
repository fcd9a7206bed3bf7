//! The vessel's motion as a sum of modes.
//!
//! ```text
//! y_d(t) = Re sum_k c_kd exp(p_k t),   p_k = -lambda_k omega_k + i omega_k sqrt(1 - lambda_k^2)
//! ```
//!
//! A mode is a damped oscillator common to all degrees of freedom. Its pole `p_k` gives frequency of
//! encounter and damping, its shape `c_kd` the present amplitude and phase in each degree of freedom (Fossen
//! 2011, section 8.2.6; Procházka 2024, eq. 3: `A_wave` in modal form, `C_wave` times the wave state). A real
//! pole is a decaying motion.

use nalgebra::Complex;

use super::{DOFS, HEAVE, PITCH, ROLL, SURGE, SWAY};
use crate::{
    msg::{WaveMode, WaveModel, f16},
    time::{Clock, Time},
};

/// One mode, with its shape at the time of validity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// `p_k`, 1/s; its real part is not positive.
    pub pole: Complex<f64>,
    /// `c_kd`: north and east velocity (m/s), heave (m down), tilt about north and about east (rad), heading (rad).
    pub shape: [Complex<f64>; DOFS],
}

/// Angular frequency below which a motion counts as a change of course, trim or level, rad/s (periods above 18 s).
const SLOW_RADPS: f64 = 0.35;

impl Mode {
    /// Whether the mode is a wave: it oscillates above the slow limit. Pure decay is an error of the level.
    pub fn is_wave(&self) -> bool {
        self.pole.im.abs() > SLOW_RADPS
    }
    /// `Re c_kd exp(p_k t)` and its derivatives, `t` seconds after the time of validity.
    pub fn motion(&self, t: f64) -> Motion {
        let propagator = (self.pole * t).exp();
        self.shape.map(|c| {
            let z = c * propagator;
            let rate = z * self.pole;
            [z.re, rate.re, (rate * self.pole).re]
        })
    }
    /// This mode with each degree of freedom multiplied by its factor.
    pub fn scaled(&self, by: &[f64; DOFS]) -> Mode {
        Mode {
            shape: core::array::from_fn(|d| self.shape[d] * by[d]),
            ..*self
        }
    }
    /// This mode in axes rotated by `angle` (rad) about down.
    pub fn turned(&self, angle: f64) -> Mode {
        let (s, c) = angle.sin_cos();
        let mut shape = self.shape;
        for [x, y] in [[SURGE, SWAY], [ROLL, PITCH]] {
            shape[x] = self.shape[x] * c + self.shape[y] * s;
            shape[y] = self.shape[y] * c - self.shape[x] * s;
        }
        Mode { shape, ..*self }
    }
    /// Factor from velocity to displacement, s: `1 / p_k`; zero for a slow mode, which is a change of course.
    pub fn integral(&self) -> Complex<f64> {
        if self.is_wave() {
            self.pole.inv()
        } else {
            Complex::default()
        }
    }
}

impl From<&Mode> for WaveMode {
    fn from(m: &Mode) -> WaveMode {
        WaveMode {
            pole: [m.pole.re as f32, m.pole.im as f32],
            shape: m.shape.map(|c| [c.re, c.im].map(f16::from_f64)),
        }
    }
}
impl From<&WaveMode> for Mode {
    fn from(m: &WaveMode) -> Mode {
        let [re, im] = m.pole.map(f64::from);
        Mode {
            pole: Complex::new(re, im),
            shape: m.shape.map(|c| {
                let [re, im] = c.map(f64::from);
                Complex::new(re, im)
            }),
        }
    }
}

/// All modes of a vessel, valid at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes<C: Clock> {
    /// Time of validity of the shapes.
    pub at: Time<C>,
    /// Modes; the vessel's motion is the sum of their motions.
    pub modes: Vec<Mode>,
}

impl<C: Clock> Modes<C> {
    /// `Re sum_k c_kd exp(p_k t)`, `t` seconds after the time of validity.
    pub fn values(&self, t: f64) -> [f64; DOFS] {
        let mut out = [0.0; DOFS];
        for m in &self.modes {
            let propagator = (m.pole * t).exp();
            for (sum, c) in out.iter_mut().zip(&m.shape) {
                *sum += (c * propagator).re;
            }
        }
        out
    }
    /// [`Modes::values`] and their derivatives.
    pub fn motion(&self, t: f64) -> Motion {
        let mut out = Motion::default();
        for m in &self.modes {
            for (sum, part) in out.iter_mut().zip(m.motion(t)) {
                for k in 0..part.len() {
                    sum[k] += part[k];
                }
            }
        }
        out
    }
    /// `Re sum_k c_kd (exp(p_k t) - 1) / p_k`: displacement by the waves' velocity in `dof` within `t` s.
    pub fn path(&self, dof: usize, t: f64) -> f64 {
        let path = |m: &Mode| {
            let c = m.shape.get(dof).copied().unwrap_or_default();
            (c * ((m.pole * t).exp() - 1.0) * m.integral()).re
        };
        self.modes.iter().map(path).sum()
    }
    /// Mean wave frequency, rad/s, weighted by the squared shapes of heave and of tilt, each normalised by
    /// its own sum so that metres and radians are not mixed; None without waves.
    pub fn frequency(&self) -> Option<f64> {
        // Noise level of the motion: m, rad.
        let (heave, tilt): (&[usize], &[usize]) = (&[HEAVE], &[ROLL, PITCH]);
        let mut sum = 0.0;
        let mut of = 0.0;
        for (dofs, noise) in [(heave, 0.02_f64), (tilt, 0.005)] {
            let square = |m: &Mode| dofs.iter().map(|&d| m.shape[d].norm_sqr()).sum::<f64>();
            let waves = || self.modes.iter().filter(|m| m.is_wave());
            let all: f64 = waves().map(square).sum();
            let mean: f64 =
                waves().map(|m| square(m) * m.pole.im.abs()).sum::<f64>() / all.max(f64::MIN_POSITIVE);
            // A motion below its noise level is weighted by its ratio to that level.
            let weight = (all / noise.powi(2)).min(1.0);
            sum += weight * mean;
            of += weight;
        }
        (of > 1e-3).then(|| sum / of)
    }
}
impl<C: Clock> From<&WaveModel<C>> for Modes<C> {
    fn from(m: &WaveModel<C>) -> Modes<C> {
        Modes {
            at: m.header.at,
            modes: m.modes.iter().map(Mode::from).collect(),
        }
    }
}

/// Value, first and second derivative of the six degrees of freedom.
pub type Motion = [[f64; 3]; DOFS];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::VesselClock;

    fn modes() -> Modes<VesselClock> {
        let shape = |a: f64| core::array::from_fn(|d| Complex::new(a + 0.1 * d as f64, 0.3 - a));
        Modes {
            at: Time::EPOCH,
            modes: vec![
                Mode {
                    pole: Complex::new(-0.05, 1.3),
                    shape: shape(0.2),
                },
                Mode {
                    pole: Complex::new(-0.8, 0.6),
                    shape: shape(-0.4),
                },
            ],
        }
    }

    #[test]
    fn mode_motion_derivatives() {
        let m = modes();
        let h = 1e-5;
        for t in [0.0, 0.7, 3.0] {
            let before = m.motion(t - h);
            let now = m.motion(t);
            let after = m.motion(t + h);
            for d in 0..DOFS {
                assert_eq!(m.values(t)[d], now[d][0]);
                for k in 0..2 {
                    let slope = (after[d][k] - before[d][k]) / (2.0 * h);
                    assert!((slope - now[d][k + 1]).abs() < 1e-7, "{t} {d} {k}");
                }
                let speed = (m.path(d, t + h) - m.path(d, t - h)) / (2.0 * h);
                assert!((speed - now[d][0]).abs() < 1e-7, "{t} {d}");
            }
        }
    }
    #[test]
    fn path_of_a_slow_mode() {
        let mut m = modes();
        m.modes = vec![Mode {
            pole: Complex::default(),
            shape: [Complex::new(0.3, 0.0); DOFS],
        }];
        assert_eq!(m.path(0, 5.0), 0.0);
        assert_eq!(m.frequency(), None);
    }
}
