//! Identification of the vessel's motion: frequencies, damping, mode shapes and what they leave unexplained, found in
//! the motion itself. No parameter of the hull or of the sea enters.
//!
//! Stochastic subspace identification (Van Overschee and De Moor 1996, chapter 3; Larimore 1990) on ten samples a
//! second of heave, tilt and their rates: the future of the six degrees of freedom over three seconds is regressed on
//! their past of six ([`regression`]); the best low-rank part of that regression is the state of a linear system,
//! whose transition follows from the shift of the future by one step, and whose eigenvectors are the modes
//! ([`subspace`]). The wave forces of Procházka 2024, eq. 1 to 3, are these modes: `A_wave` holds the poles, `C_wave`
//! the shapes, and the hull's own response is part of both, because the motion that is seen has passed through it.
//!
//! The error of its predictions is measured, not assumed: each is kept until it is due ([`errors`]).

mod errors;
mod regression;
mod subspace;

use std::collections::VecDeque;

use alight_shared::time::{Span, Time, VesselClock};
use alight_shared::vessel_model::{DOFS, Modes};

use errors::Errors;
pub use errors::SPREAD_AT_S;
use regression::{PAST, REACH, Regression};
use subspace::{Fit, Model};

/// Time between two samples, s: ten a second, eight to the period of the fastest deck (0.95 Hz).
pub const SAMPLE_S: f64 = 0.1;
/// A longer gap between two samples empties the record, s: the past of a regression has no holes.
const MAX_GAP_S: f64 = 0.15;
/// Samples between two identifications: five seconds, within which no sea changes.
const REFIT: u32 = 50;
/// Rows before the first identification.
const FIRST_FIT: f64 = 100.0;

/// The vessel's motion at an instant, in axes parallel to NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample {
    /// Time of validity.
    pub at: Time<VesselClock>,
    /// Velocity about its mean north and east (m/s), heave (m down), tilt about north and east (rad), heading about
    /// its mean (rad).
    pub value: [f64; DOFS],
    /// Rates of heave (m/s) and of the tilt about north and about east (rad/s).
    pub rate: [f64; 3],
}

/// Predictor of the vessel's motion.
#[derive(Clone, Debug, Default)]
pub struct MotionModel {
    /// Newest last.
    record: VecDeque<MotionSample>,
    regression: Regression,
    fit: Option<Fit>,
    model: Option<Model>,
    since_fit: u32,
    errors: Errors,
    /// Of the predictor that it is compared with.
    others: Errors,
}

impl MotionModel {
    /// Whether a sample at `at` is due.
    pub fn is_due(&self, at: Time<VesselClock>) -> bool {
        self.record
            .back()
            .is_none_or(|last| at - last.at > Span::from_secs(SAMPLE_S - 1e-3))
    }

    /// Takes the motion of an instant. Samples that are not finite are left out.
    pub fn push(&mut self, sample: MotionSample) {
        if !sample.value.iter().chain(&sample.rate).all(|v| v.is_finite()) {
            return;
        }
        let gap = |last: &MotionSample| (sample.at - last.at).secs() > MAX_GAP_S || sample.at <= last.at;
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
        self.others.compare(&sample);
        if self.errors.is_due()
            && let Some(modes) = self.modes()
        {
            self.errors.push(
                sample.at,
                SPREAD_AT_S.map(|ahead| modes.motion(ahead).map(|m| m[0])),
            );
        }
    }

    /// Whether another predictor is to be compared at the newest sample.
    pub fn compares(&mut self) -> bool {
        self.model.is_some() && self.others.is_due()
    }
    /// Keeps what another predictor says at the newest sample of each time of [`SPREAD_AT_S`], until it has come.
    pub fn compare_with(&mut self, predicted: [[f64; DOFS]; SPREAD_AT_S.len()]) {
        if let Some(newest) = self.record.back() {
            self.others.push(newest.at, predicted);
        }
    }
    /// Whether the modes have predicted heave and tilt better than the other predictor of late (the predictor that
    /// predicted best predicts on: Dawid 1984).
    pub fn is_better(&self) -> bool {
        let deviation = self.regression.deviation();
        let of = |e: &Errors| e.unexplained(deviation);
        of(&self.errors)
            .zip(of(&self.others))
            .is_some_and(|(own, other)| own < other)
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

    /// The modes with their present shapes, valid at the newest sample; None before the first identification, and
    /// after a gap until the past is whole again.
    pub fn modes(&self) -> Option<Modes<VesselClock>> {
        let newest = self.record.back()?;
        let past = regression::past(&self.record, self.record.len() - 1)?;
        let model = self.model.as_ref()?;
        Some(Modes {
            at: newest.at,
            mean: model.mean,
            modes: model.modes(&past),
        })
    }
    /// Standard deviation of the error of a prediction `ahead` seconds from now per degree of freedom, from that of
    /// the present state, `now`, on.
    pub fn spread(&self, now: [f64; DOFS], ahead: f64) -> [f64; DOFS] {
        let measured = self.errors.spread(self.regression.deviation());
        let (mut before, mut from) = ([0.0; DOFS], 0.0);
        let mut out = measured[measured.len() - 1];
        for (sd, to) in measured.into_iter().zip(SPREAD_AT_S) {
            if ahead <= to {
                let f = ((ahead - from) / (to - from)).clamp(0.0, 1.0);
                out = core::array::from_fn(|d| before[d] + f * (sd[d] - before[d]));
                break;
            }
            (before, from) = (sd, to);
        }
        // Measured against the estimates, whose own error comes on top.
        core::array::from_fn(|d| out[d].hypot(now[d]))
    }
}

#[cfg(test)]
mod tests;
