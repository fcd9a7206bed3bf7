//! Identification of the vessel's motion: frequencies, damping, mode shapes and residual, from the motion
//! itself without parameters of hull or sea.
//!
//! Stochastic subspace identification (Van Overschee and De Moor 1996, chapter 3; Larimore 1990) at 10 Hz on
//! heave, tilt, their rates and horizontal acceleration. The future of the six degrees of freedom over three
//! seconds is regressed on six seconds of their past ([`regression`]). The best low-rank part is the state of
//! a linear system. Its transition follows from shifting the future by a step; its eigenvectors are the modes
//! ([`subspace`]). They are the wave forces of Procházka 2024, eq. 1 to 3: `A_wave` holds the poles and
//! `C_wave` the shapes, both including the hull's response, through which the measured motion has passed.
//!
//! The motion is identified in axes parallel to NED and in axes that turn with the vessel. A small hull
//! follows the water, whose waves keep their direction when the vessel turns; a long hull swings in its own
//! roll and pitch. Both predictions are weighted by the inverse of their recent mean square errors (Bates and
//! Granger 1969), which also suits turns and hulls in between.
//!
//! A prediction starts at the estimate and continues the present residual of the modes. In heave the residual
//! fades, because its slow part is an error of the mean water level. In tilt it remains, because its slow part
//! is heel and trim, which turn with the vessel and change within seconds.
//!
//! Errors of the predictions are measured: each prediction is kept until it is due ([`errors`]).

mod errors;
mod identification;
mod regression;
mod subspace;

use crate::{
    msg::MAX_MODES,
    time::{Clock, Span, Time},
    vessel_model::{DOFS, HEAVE, Mode, Modes, Motion, PITCH, ROLL},
};
use nalgebra::Complex;

pub use errors::MeasuredErrors;
use errors::{ForecastErrors, SPREAD_AT_S};
use identification::{Axes, Identification};
use regression::OBSERVED;

/// Sampling interval, s: ten samples per period of the fastest deck motion (0.95 Hz).
pub const SAMPLE_S: f64 = 0.1;
/// Time within which motion outside the modes fades, s: a quarter of a wave period.
pub const FADE_S: f64 = 1.0;
/// Time within which heel and trim change, s: duration of a helm manoeuvre.
const HEEL_S: f64 = 2.0;

/// The vessel's motion at one time, in axes parallel to NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSample<C: Clock> {
    /// Time of validity.
    pub at: Time<C>,
    /// Mean heading, rad.
    pub mean_heading: f64,
    /// Velocity north and east about its mean (m/s), heave (m, down), tilt about north and east (rad),
    /// heading about its mean (rad).
    pub value: [f64; DOFS],
    /// Rates of heave (m/s) and of tilt about north and east (rad/s); acceleration north and east caused by
    /// the turn of the mean course (m/s²).
    pub rate: [f64; 5],
    /// Variance of the slow heave error, m²: error of the mean water level to which heave refers.
    pub level_variance: f64,
}

impl<C: Clock> MotionSample<C> {
    /// This sample in axes rotated by `angle` (rad) about down.
    fn turned(&self, angle: f64) -> MotionSample<C> {
        let turn = |v| turned(v, angle);
        let [north, east, heave, about_north, about_east, yaw] = self.value;
        let [x, y] = turn([north, east]);
        let [roll, pitch] = turn([about_north, about_east]);
        let [sinks, dn, de, an, ae] = self.rate;
        let [dr, dp] = turn([dn, de]);
        let [ax, ay] = turn([an, ae]);
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
    samples: f64,
    /// Heel and trim: slow residual of the tilt, in the vessel's axes, rad.
    heel: [f64; 2],
    /// Identifications in axes parallel to NED, and in axes that turn with the vessel.
    identified: [Identification<C>; 2],
    /// Weighted modes of both identifications at the newest sample.
    modes: Option<Modes<C>>,
    /// Difference between both predictions, per degree of freedom, at [`SPREAD_AT_S`].
    apart: [[f64; DOFS]; SPREAD_AT_S.len()],
    /// Prediction errors of the modes as the drone propagates them.
    errors: ForecastErrors<C>,
}

impl<C: Clock> Default for MotionModel<C> {
    fn default() -> Self {
        MotionModel {
            newest: None,
            samples: 0.0,
            heel: [0.0; 2],
            identified: [Axes::Earth, Axes::Vessel].map(Identification::new),
            modes: None,
            apart: Default::default(),
            errors: ForecastErrors::default(),
        }
    }
}

impl<C: Clock> MotionModel<C> {
    /// Newest sample; None before the first.
    pub fn newest(&self) -> Option<&MotionSample<C>> {
        self.newest.as_ref()
    }
    /// Observation time of the motion, s.
    pub fn observed_s(&self) -> f64 {
        self.samples * SAMPLE_S
    }
    /// Whether a sample at `at` is due.
    pub fn is_due(&self, at: Time<C>) -> bool {
        self.newest
            .is_none_or(|last| at - last.at > Span::from_secs(SAMPLE_S - 1e-3))
    }

    /// Adds the motion at one time. Non-finite samples are dropped.
    pub fn push(&mut self, sample: MotionSample<C>) {
        let numbers = sample.value.iter().chain(&sample.rate);
        let more = [&sample.mean_heading, &sample.level_variance];
        if !numbers.chain(more).all(|v| v.is_finite()) {
            return;
        }
        for i in &mut self.identified {
            i.push(&sample);
        }
        self.newest = Some(sample);
        self.errors.compare(&sample);
        self.mix(&sample);
        self.follow_heel(&sample);
        // The drone propagates the modes about the mean in the same way.
        let mean_tilt = self.mean_tilt(sample.mean_heading);
        let modes = self.modes.as_ref();
        let modal = |ahead| modes.map_or_else(Motion::default, |m| m.motion(ahead));
        self.errors
            .push(sample.at, |ahead| about(mean_tilt, modal(ahead)));
    }

    /// Updates heel and trim, at first as the mean of all samples.
    fn follow_heel(&mut self, sample: &MotionSample<C>) {
        self.samples += 1.0;
        let left = left_of_tilt(sample, &self.modal_motion(0.0));
        let fraction = (SAMPLE_S / HEEL_S).max(1.0 / self.samples);
        for (heel, left) in self.heel.iter_mut().zip(turned(left, sample.mean_heading)) {
            *heel += (left - *heel) * fraction;
        }
    }

    /// Weights the modes of both identifications and stores their difference; uses a fading motion before there are modes.
    fn mix(&mut self, newest: &MotionSample<C>) {
        let [earth, vessel] = &self.identified;
        self.apart = Default::default();
        let modes = match (earth.modes(), vessel.modes()) {
            (Some(a), Some(b)) => {
                let of_a = earth.weights();
                let of_b = vessel.weights();
                let weight: [f64; DOFS] = core::array::from_fn(|d| of_a[d] / (of_a[d] + of_b[d]));
                for (apart, ahead) in self.apart.iter_mut().zip(SPREAD_AT_S) {
                    let p = a.values(ahead);
                    let q = b.values(ahead);
                    let both = |d: usize| (weight[d] * (1.0 - weight[d])).sqrt();
                    *apart = core::array::from_fn(|d| both(d) * (p[d] - q[d]).abs());
                }
                let rest = weight.map(|s| 1.0 - s);
                [(a, weight), (b, rest)]
                    .into_iter()
                    .flat_map(|(m, by)| m.modes.iter().take(MAX_MODES / 2).map(move |m| m.scaled(&by)))
                    .collect()
            }
            (Some(only), None) | (None, Some(only)) => only.modes.clone(),
            (None, None) => {
                let [roll, pitch] = self.mean_tilt(newest.mean_heading);
                let mean = |d: usize| match d {
                    ROLL => roll,
                    PITCH => pitch,
                    _ => 0.0,
                };
                vec![fading(|d| newest.value[d] - mean(d))]
            }
        };
        self.modes = Some(Modes { at: newest.at, modes });
    }

    /// Performs one bounded part of a pending identification, or begins one that is due.
    pub fn work(&mut self) {
        for i in &mut self.identified {
            if i.work() {
                return;
            }
        }
    }

    /// Modes with their present shapes, valid at the newest sample; None before the first.
    pub fn modes(&self) -> Option<&Modes<C>> {
        self.modes.as_ref()
    }
    /// Motion of the modes `t` seconds after the newest sample; zero before the first.
    fn modal_motion(&self, t: f64) -> Motion {
        self.modes.as_ref().map_or_else(Motion::default, |m| m.motion(t))
    }
    /// Recent mean tilt about north and east of a vessel on this mean heading, rad; it turns with the vessel.
    fn mean_tilt(&self, mean_heading: f64) -> [f64; 2] {
        let [_, vessel] = &self.identified;
        let mean = vessel.mean();
        turned([mean[ROLL], mean[PITCH]], -mean_heading)
    }
    /// Present heel and trim as tilt about north and east on this mean heading, rad; they turn with the vessel.
    pub fn heel(&self, mean_heading: f64) -> [f64; 2] {
        turned(self.heel, -mean_heading)
    }
    /// Motion `t` s ahead about heel and trim: the modes plus the present residual of heave and tilt, which fades.
    pub fn motion(&self, t: f64) -> Motion {
        let mut out = self.modal_motion(t);
        let Some(newest) = &self.newest else { return out };
        let now = self.modal_motion(0.0);
        let tilt = left_of_tilt(newest, &now);
        let heel = self.heel(newest.mean_heading);
        let rest = fading(|d| match d {
            HEAVE => newest.value[HEAVE] - now[HEAVE][0],
            ROLL => tilt[0] - heel[0],
            PITCH => tilt[1] - heel[1],
            _ => 0.0,
        });
        for (sum, part) in out.iter_mut().flatten().zip(rest.motion(t).into_iter().flatten()) {
            *sum += part;
        }
        out
    }
    /// Wave component of each degree of freedom at time `at`; None before the first identification.
    pub fn waves(&self, at: Time<C>) -> Option<[f64; DOFS]> {
        let modes = self.modes().filter(|_| self.is_identified())?;
        Some(modes.values((at - modes.at).secs()))
    }
    /// Whether the motion has been identified, including calm water without predictable motion.
    pub fn is_identified(&self) -> bool {
        self.identified.iter().any(Identification::is_identified)
    }
    /// Fraction of heave and tilt variance predicted one second ahead, 0 to 1; 0 before an identification.
    pub fn confidence(&self) -> f64 {
        if !self.is_identified() {
            return 0.0;
        }
        let deviation = self.deviation();
        let spread = self.spread(1.0);
        let left: f64 = OBSERVED
            .iter()
            .map(|&d| (spread[d] / deviation[d].max(1e-9)).powi(2).min(1.0))
            .sum();
        1.0 - left / OBSERVED.len() as f64
    }
    /// Standard deviation of the modes' prediction error `ahead` s ahead, by degree of freedom: as measured,
    /// but at least the present difference between the two identifications.
    pub fn spread(&self, ahead: f64) -> [f64; DOFS] {
        self.errors.spread(self.deviation(), &self.apart, ahead)
    }
    /// Variance of the modes' slow heave caused by the error of the mean water level, m². The estimated
    /// motion contains the same error, so a comparison with it does not reveal it.
    pub fn slow_heave_variance(&self) -> f64 {
        let [earth, vessel] = &self.identified;
        earth.slow_variance().max(vessel.slow_variance())
    }
    /// Recent standard deviation of each degree of freedom.
    pub fn deviation(&self) -> [f64; DOFS] {
        self.identified[0].deviation()
    }
}

fn left_of_tilt<C: Clock>(sample: &MotionSample<C>, motion: &Motion) -> [f64; 2] {
    [ROLL, PITCH].map(|d| sample.value[d] - motion[d][0])
}

/// Adds this mean tilt, rad, to a motion.
fn about([roll, pitch]: [f64; 2], mut motion: Motion) -> Motion {
    motion[ROLL][0] += roll;
    motion[PITCH][0] += pitch;
    motion
}

/// Rotates a horizontal vector into axes turned by `angle` (rad) about down.
fn turned([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    let (s, c) = angle.sin_cos();
    [c * x + s * y, c * y - s * x]
}

/// Motion that starts at `now` in each degree of freedom and fades.
fn fading(now: impl Fn(usize) -> f64) -> Mode {
    Mode {
        pole: Complex::from(-1.0 / FADE_S),
        shape: core::array::from_fn(|d| Complex::from(now(d))),
    }
}

#[cfg(test)]
mod tests;
