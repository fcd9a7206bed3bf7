//! The vessel's motion as a sum of modes.
//!
//! ```text
//! y_d(t) = Re sum_k c_kd exp(p_k t),   p_k = -lambda_k omega_k + i omega_k sqrt(1 - lambda_k^2)
//! ```
//!
//! A mode is one damped oscillator that all six degrees of freedom share: its pole `p_k` holds frequency of
//! encounter and damping, its shape `c_kd` the present amplitude and phase per degree of freedom (Fossen 2011,
//! section 8.2.6; Procházka 2024, eq. 3: `A_wave` in modal form, `C_wave` times the wave state). A real pole is a
//! motion that fades; a pole of zero is a mean.

use nalgebra::Complex;

use super::{DOFS, HEAVE, PITCH, ROLL, YAW};
use crate::msg::{SPREAD_AT_S, WaveMode, WaveModel};
use crate::time::{Clock, Time};

/// One mode at the time of validity of its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// `p_k`, 1/s; its real part is not positive.
    pub pole: Complex<f64>,
    /// `c_kd`: north and east velocity (m/s), heave (m down), tilt about north and about east (rad), heading (rad).
    pub shape: [Complex<f64>; DOFS],
}

impl From<&Mode> for WaveMode {
    fn from(m: &Mode) -> WaveMode {
        let pair = |c: Complex<f64>| [c.re as f32, c.im as f32];
        WaveMode {
            pole: pair(m.pole),
            shape: m.shape.map(pair),
        }
    }
}
impl From<&WaveMode> for Mode {
    fn from(m: &WaveMode) -> Mode {
        let complex = |[re, im]: [f32; 2]| Complex::new(f64::from(re), f64::from(im));
        Mode {
            pole: complex(m.pole),
            shape: m.shape.map(complex),
        }
    }
}

/// All modes of a vessel, valid at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes<C: Clock> {
    /// Time of validity of the shapes.
    pub at: Time<C>,
    /// Mean of each degree of freedom.
    pub mean: [f64; DOFS],
    /// The modes.
    pub modes: Vec<Mode>,
}

impl<C: Clock> Modes<C> {
    /// Mean and modes `t` seconds after the time of validity. Of heave and heading the waves alone: their means and slow
    /// modes are errors of the mean water level, and a course.
    pub fn motion(&self, t: f64) -> Motion {
        let mut out = motion(&self.modes, t);
        for (sum, mean) in out.iter_mut().zip(self.mean) {
            sum[0] += mean;
        }
        let waves = self.waves(t);
        (out[HEAVE], out[YAW]) = (waves[HEAVE], waves[YAW]);
        out
    }
    /// The modes that are waves `t` seconds after the time of validity.
    pub fn waves(&self, t: f64) -> Motion {
        motion(self.modes.iter().filter(|m| is_wave(m)), t)
    }
    /// `Re sum_k c_kd (exp(p_k t) - 1) / p_k` over the waves: what their velocity in degree of freedom `dof` moves by
    /// within `t` seconds.
    pub fn path(&self, dof: usize, t: f64) -> f64 {
        let path = |m: &Mode| {
            let c = m.shape.get(dof).copied().unwrap_or_default();
            (c * ((m.pole * t).exp() - 1.0) / m.pole).re
        };
        self.modes.iter().filter(|m| is_wave(m)).map(path).sum()
    }
    /// Mean frequency of the waves, rad/s, weighted with the squares of heave (m) and tilt (rad); None without waves.
    pub fn frequency(&self) -> Option<f64> {
        let (mut sum, mut weight) = (0.0, 0.0);
        for m in self.modes.iter().filter(|m| is_wave(m)) {
            let square: f64 = [HEAVE, ROLL, PITCH].iter().map(|&d| m.shape[d].norm_sqr()).sum();
            sum += square * m.pole.im.abs();
            weight += square;
        }
        (weight > 1e-9).then(|| sum / weight)
    }
}
impl<C: Clock> From<&WaveModel<C>> for Modes<C> {
    fn from(m: &WaveModel<C>) -> Modes<C> {
        Modes {
            at: m.header.at,
            mean: m.mean.map(f64::from),
            modes: m.modes.iter().map(Mode::from).collect(),
        }
    }
}

/// Standard deviations `ahead` seconds from now, between those `now` and those at [`SPREAD_AT_S`]; held after the last.
pub fn spread_between(
    now: &[f64; DOFS],
    spread: &[[f64; DOFS]; SPREAD_AT_S.len()],
    ahead: f64,
) -> [f64; DOFS] {
    let (mut before, mut from) = (now, 0.0);
    for (sd, to) in spread.iter().zip(SPREAD_AT_S) {
        if ahead <= to {
            let f = ((ahead - from) / (to - from)).clamp(0.0, 1.0);
            return core::array::from_fn(|d| before[d] + f * (sd[d] - before[d]));
        }
        (before, from) = (sd, to);
    }
    *before
}

/// Value, first and second derivative of the six degrees of freedom.
pub type Motion = [[f64; 3]; DOFS];

/// Slower than this a motion is a course, a trim or a level, rad/s (periods above 18 s).
const SLOW_RADPS: f64 = 0.35;

/// Whether a mode is a wave: it oscillates or dies out faster than what is slow.
pub fn is_wave(mode: &Mode) -> bool {
    mode.pole.norm() > SLOW_RADPS
}

/// `Re sum_k c_kd exp(p_k t)` and its derivatives, `t` seconds after the time of validity.
fn motion<'a>(modes: impl IntoIterator<Item = &'a Mode>, t: f64) -> Motion {
    let mut out = [[0.0; 3]; DOFS];
    for m in modes {
        let grown = (m.pole * t).exp();
        for (sum, c) in out.iter_mut().zip(&m.shape) {
            let z = c * grown;
            let rate = z * m.pole;
            sum[0] += z.re;
            sum[1] += rate.re;
            sum[2] += (rate * m.pole).re;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::VesselClock;

    fn modes() -> Vec<Mode> {
        let shape = |a: f64| core::array::from_fn(|d| Complex::new(a + 0.1 * d as f64, 0.3 - a));
        vec![
            Mode {
                pole: Complex::new(-0.05, 1.3),
                shape: shape(0.2),
            },
            Mode {
                pole: Complex::new(-0.8, 0.0),
                shape: shape(-0.4),
            },
            Mode {
                pole: Complex::new(0.0, 0.0),
                shape: shape(0.1),
            },
        ]
    }

    #[test]
    fn motion_is_the_derivative_of_the_path_and_of_itself() {
        let (m, h) = (modes(), 1e-5);
        let all = Modes::<VesselClock> {
            at: Time::EPOCH,
            mean: [0.0; DOFS],
            modes: modes(),
        };
        for t in [0.0, 0.7, 3.0] {
            let (before, now, after) = (motion(&m, t - h), motion(&m, t), motion(&m, t + h));
            for d in 0..DOFS {
                for k in 0..2 {
                    let slope = (after[d][k] - before[d][k]) / (2.0 * h);
                    assert!((slope - now[d][k + 1]).abs() < 1e-7, "{t} {d} {k}");
                }
                let speed = (all.path(d, t + h) - all.path(d, t - h)) / (2.0 * h);
                assert!((speed - all.waves(t)[d][0]).abs() < 1e-7, "{t} {d}");
            }
        }
    }
}
