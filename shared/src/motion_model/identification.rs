//! Identification of the motion in one pair of horizontal axes.

use std::collections::VecDeque;

use crate::{
    time::Clock,
    vessel_model::{DOFS, Modes, PITCH, ROLL},
};

use super::{
    MotionSample,
    errors::ForecastErrors,
    regression::{self, PAST, REACH, Regression},
    subspace::{Fit, FitProgress, Model},
};

/// Gap between samples that empties the record, s: a regression needs an uninterrupted past.
const MAX_GAP_S: f64 = 0.15;
/// Samples between two identifications: five seconds, during which the sea does not change.
const REFIT: u32 = 50;
/// Number of rows required for the first identification.
const FIRST_FIT: f64 = 100.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axes {
    /// North and east.
    Earth,
    /// Along the vessel's mean heading and to starboard.
    Vessel,
}

impl Axes {
    /// Rotation of the axes from NED, rad.
    fn angle(self, mean_heading: f64) -> f64 {
        match self {
            Axes::Earth => 0.0,
            Axes::Vessel => mean_heading,
        }
    }
}

/// Record, regression and modes in one pair of axes.
#[derive(Clone, Debug)]
pub(super) struct Identification<C: Clock> {
    axes: Axes,
    /// Samples in these axes, newest last.
    record: VecDeque<MotionSample<C>>,
    regression: Regression,
    fit: Option<Fit>,
    model: Option<Model>,
    /// Modes at the newest sample, in axes parallel to NED.
    modes: Option<Modes<C>>,
    since_fit: u32,
    errors: ForecastErrors<C>,
}

impl<C: Clock> Identification<C> {
    pub(super) fn new(axes: Axes) -> Self {
        Identification {
            axes,
            record: VecDeque::with_capacity(PAST + REACH + 1),
            regression: Regression::default(),
            fit: None,
            model: None,
            modes: None,
            since_fit: 0,
            errors: ForecastErrors::default(),
        }
    }

    /// Adds a sample in axes parallel to NED.
    pub(super) fn push(&mut self, sample: &MotionSample<C>) {
        let gap = |last: &MotionSample<C>| (sample.at - last.at).secs() > MAX_GAP_S || sample.at <= last.at;
        if self.record.back().is_some_and(gap) {
            self.record.clear();
        }
        let angle = self.axes.angle(sample.mean_heading);
        self.record.push_back(sample.turned(angle));
        while self.record.len() > PAST + REACH {
            self.record.pop_front();
        }
        self.regression.push(&self.record);
        self.since_fit += 1;
        self.errors.compare(sample);
        self.modes = self
            .model
            .as_ref()
            .zip(regression::past(&self.record, self.record.len() - 1))
            .map(|(model, past)| Modes {
                at: sample.at,
                modes: model.modes(&past).iter().map(|m| m.turned(-angle)).collect(),
            });
        if let Some(modes) = &self.modes {
            let mean = self.mean();
            let tilt = super::turned([mean[ROLL], mean[PITCH]], -angle);
            self.errors
                .push(sample.at, |ahead| super::about(tilt, modes.motion(ahead)));
        }
    }

    /// Performs one bounded part of an identification that is in progress or due; returns false without one.
    pub(super) fn work(&mut self) -> bool {
        self.fit = match self.fit.take() {
            Some(fit) => match fit.advance() {
                FitProgress::Working(fit) => Some(*fit),
                FitProgress::Done(model) => {
                    self.model = Some(*model);
                    None
                }
                FitProgress::Failed => None,
            },
            None if self.since_fit >= REFIT && self.regression.rows() >= FIRST_FIT => {
                self.since_fit = 0;
                let level = self.record.back().map_or(0.0, |s| s.level_variance);
                Some(Fit::new(&self.regression, level))
            }
            None => return false,
        };
        true
    }

    /// Modes at the newest sample, strongest first; None before the first identification, and after a gap
    /// until the record covers the past again.
    pub(super) fn modes(&self) -> Option<&Modes<C>> {
        self.modes.as_ref()
    }
    pub(super) fn is_identified(&self) -> bool {
        self.model.is_some()
    }
    /// Variance of the modes' slow heave caused by the error of the mean water level, m².
    pub(super) fn slow_variance(&self) -> f64 {
        self.model.as_ref().map_or(0.0, |m| m.slow_variance)
    }
    pub(super) fn weights(&self) -> [f64; DOFS] {
        self.errors.weights()
    }
    /// Recent mean of each degree of freedom in these axes.
    pub(super) fn mean(&self) -> [f64; DOFS] {
        self.regression.mean()
    }
    pub(super) fn deviation(&self) -> [f64; DOFS] {
        self.regression.deviation()
    }
}
