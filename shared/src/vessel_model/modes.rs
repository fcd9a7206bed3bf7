//! The vessel's motion as a sum of modes: what prediction and broadcast share.
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

use super::DOFS;
use crate::time::{Clock, Time};

/// One mode at the time of validity of its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// `p_k`, 1/s; its real part is not positive.
    pub pole: Complex<f64>,
    /// `c_kd`: north and east velocity (m/s), heave (m down), tilt about north and about east (rad), heading (rad).
    pub shape: [Complex<f64>; DOFS],
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
    /// Mean and modes `t` seconds after the time of validity.
    pub fn motion(&self, t: f64) -> Motion {
        let mut out = motion(&self.modes, t);
        for (sum, mean) in out.iter_mut().zip(self.mean) {
            sum[0] += mean;
        }
        out
    }
}
/// Value, first and second derivative of the six degrees of freedom.
pub type Motion = [[f64; 3]; DOFS];

/// Slower than this a motion is a course, a trim or a level, rad/s (periods above 18 s).
const SLOW_RADPS: f64 = 0.35;

/// Whether a mode is a wave: it oscillates.
pub fn is_wave(mode: &Mode) -> bool {
    mode.pole.im.abs() > SLOW_RADPS
}

/// `Re sum_k c_kd exp(p_k t)` and its derivatives, `t` seconds after the time of validity.
pub fn motion<'a>(modes: impl IntoIterator<Item = &'a Mode>, t: f64) -> Motion {
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
    fn rates_of_the_modes_are_the_derivatives_of_their_values() {
        let (m, h) = (modes(), 1e-5);
        for t in [0.0, 0.7, 3.0] {
            let (before, now, after) = (motion(&m, t - h), motion(&m, t), motion(&m, t + h));
            for d in 0..DOFS {
                for k in 0..2 {
                    let slope = (after[d][k] - before[d][k]) / (2.0 * h);
                    assert!((slope - now[d][k + 1]).abs() < 1e-7, "{t} {d} {k}");
                }
            }
        }
    }
}
