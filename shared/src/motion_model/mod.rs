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
//! The error of its predictions is measured, not assumed: each is kept until it is due ([`errors`]).

mod errors;
mod regression;
mod subspace;

use std::collections::VecDeque;

use crate::time::{Clock, Span, Time};
use crate::vessel_model::{DOFS, HEAVE, Mode, Modes, Motion};
use nalgebra::Complex;

use errors::Errors;
use regression::{OBSERVED, PAST, REACH, Regression};
use subspace::{Fit, Model, WITHOUT_SLOW};

/// Time between two samples, s: ten a second, eight to the period of the fastest deck (0.95 Hz).
pub const SAMPLE_S: f64 = 0.1;
/// A longer gap between two samples empties the record, s: the past of a regression has no holes.
const MAX_GAP_S: f64 = 0.15;
/// Samples between two identifications: five seconds, within which no sea changes.
const REFIT: u32 = 50;
/// Rows before the first identification.
const FIRST_FIT: f64 = 100.0;
/// What no mode holds fades in this time, s: a quarter of a wave.
const FADE_S: f64 = 1.0;

/// The vessel's motion at an instant, in axes parallel to NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample<C: Clock> {
    /// Time of validity.
    pub at: Time<C>,
    /// Velocity about its mean north and east (m/s), heave (m down), tilt about north and east (rad), heading about
    /// its mean (rad).
    pub value: [f64; DOFS],
    /// Rates of heave (m/s), of the tilt about north and about east (rad/s) and of the velocity along north and east as
    /// the vessel's mean course turns (m/s²).
    pub rate: [f64; 5],
}

/// A motion that fades, by its value now in each degree of freedom.
fn fading(now: impl Fn(usize) -> f64) -> Mode {
    Mode {
        pole: Complex::from(-1.0 / FADE_S),
        shape: core::array::from_fn(|d| Complex::from(now(d))),
    }
}

/// Predictor of the vessel's motion.
#[derive(Clone, Debug, Default)]
pub struct MotionModel<C: Clock> {
    /// Newest last.
    record: VecDeque<MotionSample<C>>,
    regression: Regression,
    fit: Option<Fit>,
    model: Option<Model>,
    /// The modes by the newest sample.
    modes: Option<Modes<C>>,
    since_fit: u32,
    /// Of the modes, which the drone rolls on.
    errors: Errors<C>,
}

impl<C: Clock> MotionModel<C> {
    /// Whether a sample at `at` is due.
    pub fn is_due(&self, at: Time<C>) -> bool {
        self.record
            .back()
            .is_none_or(|last| at - last.at > Span::from_secs(SAMPLE_S - 1e-3))
    }

    /// Takes the motion of an instant. Samples that are not finite are left out.
    pub fn push(&mut self, sample: MotionSample<C>) {
        if !sample.value.iter().chain(&sample.rate).all(|v| v.is_finite()) {
            return;
        }
        let gap = |last: &MotionSample<C>| (sample.at - last.at).secs() > MAX_GAP_S || sample.at <= last.at;
        if self.record.back().is_some_and(gap) {
            self.record.clear();
        }
        self.record.push_back(sample);
        while self.record.len() > PAST + REACH {
            self.record.pop_front();
        }
        self.regression.push(&self.record);
        self.since_fit += 1;
        self.errors.compare(&sample);
        self.modes = Some(self.modes_at(&sample));
        if self.errors.is_due() {
            let predicted = errors::SPREAD_AT_S.map(|ahead| self.modal_motion(ahead));
            self.errors.push(sample.at, predicted);
        }
    }

    /// Does one bounded part of an identification under way, or begins one that is due.
    pub fn work(&mut self) {
        self.fit = match self.fit.take() {
            Some(fit) => match fit.advance() {
                subspace::Progress::Working(fit) => Some(*fit),
                subspace::Progress::Done(model) => {
                    self.model = Some(*model);
                    None
                }
                subspace::Progress::Failed => None,
            },
            None if self.since_fit >= REFIT && self.regression.rows() >= FIRST_FIT => {
                self.since_fit = 0;
                Some(Fit::new(&self.regression))
            }
            None => None,
        };
    }

    /// The modes with their shapes at the newest sample. Before the first identification, and after a gap until the
    /// past is whole again, the motion fades to its mean.
    fn modes_at(&self, newest: &MotionSample<C>) -> Modes<C> {
        let identified = self
            .model
            .as_ref()
            .zip(regression::past(&self.record, self.record.len() - 1));
        let modes = identified.map_or_else(
            || {
                let mean = self.mean();
                vec![fading(|d| newest.value[d] - mean[d])]
            },
            |(model, past)| model.modes(&past),
        );
        Modes { at: newest.at, modes }
    }
    /// The modes with their present shapes, valid at the newest sample; None before the first.
    pub fn modes(&self) -> Option<&Modes<C>> {
        self.modes.as_ref()
    }
    /// Mean of the tilt: the trim. The other degrees of freedom are about their means.
    fn mean(&self) -> [f64; DOFS] {
        let mut mean = self.model.as_ref().map_or(self.regression.mean(), |m| m.mean);
        for d in WITHOUT_SLOW {
            mean[d] = 0.0;
        }
        mean
    }
    /// Mean and modes `t` seconds after the newest sample; zero before the first.
    fn modal_motion(&self, t: f64) -> Motion {
        let mut out = self.modes.as_ref().map_or_else(Motion::default, |m| m.motion(t));
        for (sum, mean) in out.iter_mut().zip(self.mean()) {
            sum[0] += mean;
        }
        out
    }
    /// The same with what the modes leave of heave now, which fades: its slow part, an error of the mean water level.
    pub fn motion(&self, t: f64) -> Motion {
        let mut out = self.modal_motion(t);
        let heave = self.record.back().map_or(0.0, |s| s.value[HEAVE]);
        let rest = fading(|_| heave - self.modal_motion(0.0)[HEAVE][0]);
        for (sum, part) in out[HEAVE].iter_mut().zip(rest.motion(t)[HEAVE]) {
            *sum += part;
        }
        out
    }
    /// The waves' part of each degree of freedom at time `at`; None before the first identification.
    pub fn waves(&self, at: Time<C>) -> Option<[f64; DOFS]> {
        self.model.as_ref()?;
        let modes = self.modes()?;
        Some(modes.motion((at - modes.at).secs()).map(|m| m[0]))
    }
    /// Whether its motion has been identified, be it that of a vessel in a calm that no model predicts.
    pub fn is_identified(&self) -> bool {
        self.model.is_some()
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
    /// Standard deviation per degree of freedom of what rolling the modes on is off by, `ahead` seconds on.
    pub fn spread(&self, ahead: f64) -> [f64; DOFS] {
        self.errors.spread(self.deviation(), ahead)
    }
    /// Standard deviation of each degree of freedom of late.
    pub fn deviation(&self) -> [f64; DOFS] {
        self.regression.deviation()
    }
}

#[cfg(test)]
mod tests;
