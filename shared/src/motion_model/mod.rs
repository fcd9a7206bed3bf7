//! Identification of the vessel's motion: frequencies, damping, mode shapes and what they leave unexplained, found in
//! the motion itself. No parameter of the hull or of the sea enters.
//!
//! Stochastic subspace identification (Van Overschee and De Moor 1996, chapter 3; Larimore 1990) on ten samples a
//! second of heave, tilt, their rates and horizontal acceleration: the future of the six degrees of freedom over three
//! seconds is regressed on their past of six ([`regression`]); the best low-rank part of that regression is the state
//! of a linear system, whose transition follows from the shift of the future by one step, and whose eigenvectors are
//! the modes ([`subspace`]). The wave forces of Procházka 2024, eq. 1 to 3, are these modes: `A_wave` holds the poles,
//! `C_wave` the shapes, and the hull's own response is part of both, because the motion that is seen has passed
//! through it.
//!
//! It is identified twice side by side, in axes parallel to NED and in axes that turn with the vessel: a small hull
//! follows the slope of the water, whose waves keep their direction when she turns; a long one swings in her own roll
//! and pitch. Both predictions are weighted by the inverse of their mean square errors of late (Bates and Granger
//! 1969), so that a hull between the two, and one that turns, is predicted by what holds for it. The third that is
//! weighed is rest, whose error is the motion itself: what has not been seen before, a course by other waves, is
//! predicted with caution.
//!
//! The error of the predictions is measured, not assumed: each is kept until it is due ([`errors`]).

mod errors;
mod identification;
mod regression;
mod subspace;

use crate::msg::MAX_MODES;
use crate::time::{Clock, Span, Time};
use crate::vessel_model::{DOFS, HEAVE, Mode, Modes, Motion, PITCH, ROLL, SURGE, SWAY};
use nalgebra::Complex;

use errors::Errors;
use identification::{Axes, Identification};
use regression::OBSERVED;

/// Time between two samples, s: ten a second, eight to the period of the fastest deck (0.95 Hz).
pub const SAMPLE_S: f64 = 0.1;
/// What no mode holds fades in this time, s: a quarter of a wave.
const FADE_S: f64 = 1.0;
/// They are weighted by their errors one second ahead, the third of [`errors::SPREAD_AT_S`].
const WEIGHED_AT: usize = 2;

/// The vessel's motion at an instant, in axes parallel to NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample<C: Clock> {
    /// Time of validity.
    pub at: Time<C>,
    /// Mean heading, rad.
    pub mean_heading: f64,
    /// Velocity about its mean north and east (m/s), heave (m down), tilt about north and east about the trim (rad),
    /// heading about its mean (rad).
    pub value: [f64; DOFS],
    /// Rates of heave (m/s), of the tilt about north and about east (rad/s) and of the velocity along north and east as
    /// the vessel's mean course turns (m/s²).
    pub rate: [f64; 5],
}

impl<C: Clock> MotionSample<C> {
    /// The same in axes turned by `angle` (rad) about down.
    fn turned(&self, angle: f64) -> MotionSample<C> {
        let (s, c) = angle.sin_cos();
        let turn = |[x, y]: [f64; 2]| [c * x + s * y, c * y - s * x];
        let [north, east, heave, about_north, about_east, yaw] = self.value;
        let ([x, y], [roll, pitch]) = (turn([north, east]), turn([about_north, about_east]));
        let [sinks, dn, de, an, ae] = self.rate;
        let ([dr, dp], [ax, ay]) = (turn([dn, de]), turn([an, ae]));
        MotionSample {
            value: [x, y, heave, roll, pitch, yaw],
            rate: [sinks, dr, dp, ax, ay],
            ..*self
        }
    }
}

/// Predictor of the vessel's motion.
#[derive(Clone, Debug)]
pub struct MotionModel<C: Clock> {
    newest: Option<MotionSample<C>>,
    /// In axes parallel to NED, and in axes that turn with the vessel.
    identified: [Identification<C>; 2],
    /// The modes of both with their weights, by the newest sample.
    modes: Option<Modes<C>>,
    /// How far both predict apart, per degree of freedom, at [`errors::SPREAD_AT_S`].
    apart: [[f64; DOFS]; errors::SPREAD_AT_S.len()],
    /// Of the modes, which the drone rolls on.
    errors: Errors<C>,
}

impl<C: Clock> Default for MotionModel<C> {
    fn default() -> Self {
        MotionModel {
            newest: None,
            identified: [Axes::Earth, Axes::Vessel].map(Identification::new),
            modes: None,
            apart: Default::default(),
            errors: Errors::default(),
        }
    }
}

impl<C: Clock> MotionModel<C> {
    /// Whether a sample at `at` is due.
    pub fn is_due(&self, at: Time<C>) -> bool {
        self.newest
            .is_none_or(|last| at - last.at > Span::from_secs(SAMPLE_S - 1e-3))
    }

    /// Takes the motion of an instant. Samples that are not finite are left out.
    pub fn push(&mut self, sample: MotionSample<C>) {
        let numbers = sample.value.iter().chain(&sample.rate);
        if !numbers.chain([&sample.mean_heading]).all(|v| v.is_finite()) {
            return;
        }
        for i in &mut self.identified {
            i.push(&sample);
        }
        self.newest = Some(sample);
        self.errors.compare(&sample);
        self.mix(&sample);
        let predicted = errors::SPREAD_AT_S.map(|ahead| self.modal_motion(ahead));
        self.errors.push(sample.at, predicted);
    }

    /// The modes of both, weighted, and how far they are apart; before the first identification a motion that fades.
    fn mix(&mut self, newest: &MotionSample<C>) {
        let known: Vec<_> = self
            .identified
            .iter()
            .filter_map(|i| Some((i.modes()?, i.mean_squares(WEIGHED_AT))))
            .collect();
        let most = MAX_MODES / known.len().max(1);
        let rest = self.deviation().map(|sd| sd * sd);
        let surprise = self.errors.surprise();
        let now = |squares: [f64; DOFS]| core::array::from_fn(|d| squares[d] * surprise[d]);
        // Both weigh the same, and rest nothing, until the errors of both are measured.
        let squares: Option<Vec<[f64; DOFS]>> = known.iter().map(|(_, squares)| squares.map(now)).collect();
        let share: Vec<[f64; DOFS]> = match squares {
            Some(squares) => {
                let inverse: Vec<_> = squares.iter().chain([&rest]).map(inverses).collect();
                let all: [f64; DOFS] = core::array::from_fn(|d| inverse.iter().map(|w| w[d]).sum());
                let of = |w: &[f64; DOFS]| core::array::from_fn(|d| w[d] / all[d]);
                inverse.iter().map(of).collect()
            }
            None => vec![[1.0 / known.len() as f64; DOFS]; known.len()],
        };
        let mixed = known.iter().zip(&share).flat_map(|((modes, _), share)| {
            modes.modes.iter().take(most).map(|m| Mode {
                pole: m.pole,
                shape: core::array::from_fn(|d| m.shape[d] * share[d]),
            })
        });
        let mut modes: Vec<Mode> = mixed.collect();
        self.apart = Default::default();
        if let ([(a, _), (b, _)], [of_a, of_b, ..]) = (&known[..], &share[..]) {
            for (apart, ahead) in self.apart.iter_mut().zip(errors::SPREAD_AT_S) {
                let (p, q) = (a.motion(ahead), b.motion(ahead));
                *apart = core::array::from_fn(|d| (of_a[d] * of_b[d]).sqrt() * (p[d][0] - q[d][0]).abs());
            }
        }
        if known.is_empty() {
            modes.push(fading(|d| newest.value[d]));
        }
        self.modes = Some(Modes { at: newest.at, modes });
    }

    /// Does one bounded part of an identification under way, or begins one that is due.
    pub fn work(&mut self) {
        for i in &mut self.identified {
            if i.work() {
                return;
            }
        }
    }

    /// The modes with their present shapes, valid at the newest sample; None before the first.
    pub fn modes(&self) -> Option<&Modes<C>> {
        self.modes.as_ref()
    }
    /// The modes `t` seconds after the newest sample; zero before the first.
    fn modal_motion(&self, t: f64) -> Motion {
        self.modes.as_ref().map_or_else(Motion::default, |m| m.motion(t))
    }
    /// The same with what the modes leave of heave now, which fades: its slow part, an error of the mean water level.
    pub fn motion(&self, t: f64) -> Motion {
        let mut out = self.modal_motion(t);
        let heave = self.newest.map_or(0.0, |s| s.value[HEAVE]);
        let rest = fading(|_| heave - self.modal_motion(0.0)[HEAVE][0]);
        for (sum, part) in out[HEAVE].iter_mut().zip(rest.motion(t)[HEAVE]) {
            *sum += part;
        }
        out
    }
    /// The waves' part of each degree of freedom at time `at`; None before the first identification.
    pub fn waves(&self, at: Time<C>) -> Option<[f64; DOFS]> {
        let modes = self.modes().filter(|_| self.is_identified())?;
        Some(modes.motion((at - modes.at).secs()).map(|m| m[0]))
    }
    /// Whether its motion has been identified, be it that of a vessel in a calm that no model predicts.
    pub fn is_identified(&self) -> bool {
        self.identified.iter().any(Identification::is_identified)
    }
    /// Share of the variance of heave and tilt that is predicted a second ahead, 0 to 1; 0 before the first
    /// identification.
    pub fn confidence(&self) -> f64 {
        if !self.is_identified() {
            return 0.0;
        }
        let (deviation, spread) = (self.deviation(), self.spread(1.0));
        let left: f64 = OBSERVED
            .iter()
            .map(|&d| (spread[d] / deviation[d].max(1e-9)).powi(2).min(1.0))
            .sum();
        1.0 - left / OBSERVED.len() as f64
    }
    /// Standard deviation per degree of freedom of what rolling the modes on is off by, `ahead` seconds on: as measured,
    /// and at least how far the two identifications predict apart now.
    pub fn spread(&self, ahead: f64) -> [f64; DOFS] {
        self.errors.spread(self.deviation(), &self.apart, ahead)
    }
    /// Standard deviation of each degree of freedom of late.
    pub fn deviation(&self) -> [f64; DOFS] {
        self.identified[0].deviation()
    }
}

/// One over the mean squares; axes that a turn mixes share theirs.
fn inverses(squares: &[f64; DOFS]) -> [f64; DOFS] {
    core::array::from_fn(|d| {
        let group: &[usize] = match d {
            SURGE | SWAY => &[SURGE, SWAY],
            ROLL | PITCH => &[ROLL, PITCH],
            _ => &[d],
        };
        1.0 / group.iter().map(|&k| squares[k]).sum::<f64>().max(1e-12)
    })
}

/// A motion that fades, by its value now in each degree of freedom.
fn fading(now: impl Fn(usize) -> f64) -> Mode {
    Mode {
        pole: Complex::from(-1.0 / FADE_S),
        shape: core::array::from_fn(|d| Complex::from(now(d))),
    }
}

#[cfg(test)]
mod tests;
