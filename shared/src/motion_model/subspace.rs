//! Subspace identification: modes from the regression's sums, computed in parts of less than two milliseconds each.

use crate::{
    msg::MAX_MODES,
    vessel_model::{DOFS, HEAVE, Mode, SURGE, SWAY, YAW},
};
use faer::{
    Mat, Side, c64,
    linalg::solvers::{Solve, SolveLstsq},
};
use nalgebra::{Complex, DVector};

use super::{
    SAMPLE_S,
    regression::{AHEAD, CHANNELS, INPUTS, LAGS, OUTPUTS, Regression, STRIDE, channels_of},
};

const ORDER: usize = 24;
/// Ridge of a full record, as a fraction of each input's variance.
const RIDGE: f64 = 3e-3;
/// Number of rows at which the ridge is twice that of a full record.
const RIDGE_ROWS: f64 = 300.0;
/// Minimum decay rate, 1/s, so that a mode loses its phase within two minutes.
const MIN_DECAY: f64 = 0.004;
/// Minimum magnitude of an eigenvalue: fraction of the mode that remains after one step.
const DEAD: f64 = 0.37;
/// Degrees of freedom whose slow modes are dropped because they belong to the course.
const WITHOUT_SLOW: [usize; 3] = [SURGE, SWAY, YAW];
const STEP_S: f64 = SAMPLE_S * STRIDE as f64;

/// Whether a mode is a wave rather than a change of course, trim or level.
fn wave(pole: Complex<f64>, shape: [Complex<f64>; DOFS]) -> bool {
    Mode { pole, shape }.is_wave()
}

#[derive(Clone, Debug)]
pub(super) struct Fit {
    stage: Stage,
    scale_in: DVector<f64>,
    scale_out: DVector<f64>,
    mean_in: DVector<f64>,
    /// Covariance of the scaled inputs, and of outputs with inputs.
    gram: Mat<f64>,
    cross: Mat<f64>,
    variance: Vec<f64>,
    ridge: f64,
    /// Variance of the slow heave error, m².
    level_variance: f64,
}

#[derive(Clone, Debug)]
enum Stage {
    Solve,
    /// Coefficients, inputs x outputs.
    Reduce(Mat<f64>),
    Modes {
        /// Matrix from inputs to the state.
        state: Mat<f64>,
        /// Matrix from the state to outputs.
        observe: Mat<f64>,
    },
}

pub(super) enum FitProgress {
    Working(Box<Fit>),
    Done(Box<Model>),
    /// The sums are degenerate or not finite.
    Failed,
}

#[derive(Clone, Debug)]
pub(super) struct Model {
    mean_in: DVector<f64>,
    modes: Vec<ModeFit>,
    /// Variance of the modes' slow heave caused by the error of the mean water level, m².
    pub(super) slow_variance: f64,
}

/// Pole, shape per unit of excitation, and excitation from the past.
#[derive(Clone, Debug)]
struct ModeFit {
    pole: Complex<f64>,
    shape: [Complex<f64>; DOFS],
    real: DVector<f64>,
    imaginary: DVector<f64>,
}

impl Model {
    /// Modes whose present shapes follow from the past.
    pub(super) fn modes(&self, past: &DVector<f64>) -> Vec<Mode> {
        let z = past - &self.mean_in;
        let mode = |m: &ModeFit| {
            let excitation = Complex::new(m.real.dot(&z), m.imaginary.dot(&z));
            Mode {
                pole: m.pole,
                shape: m.shape.map(|c| c * excitation),
            }
        };
        self.modes.iter().map(mode).collect()
    }
}

impl Fit {
    pub(super) fn new(sums: &Regression, level_variance: f64) -> Fit {
        let w = sums.weight;
        let mean = &sums.sums / w;
        let mean_in: DVector<f64> = mean.rows(0, INPUTS).into_owned();
        let mean_out: DVector<f64> = mean.rows(INPUTS, OUTPUTS).into_owned();
        let variance_in = |i: usize| sums.products[(i, i)] / w - mean_in[i] * mean_in[i];
        // One scale for all lags of a channel, and for all steps of a degree of freedom, so that steps can be shifted.
        let channel: [f64; CHANNELS] = core::array::from_fn(|c| {
            let sum: f64 = (0..LAGS).map(|l| variance_in(CHANNELS * l + c)).sum();
            (sum / LAGS as f64).max(1e-12).sqrt()
        });
        let variance_out = |j: usize| sums.squares[j] / w - mean_out[j] * mean_out[j];
        let dof: [f64; DOFS] = core::array::from_fn(|d| {
            let sum: f64 = (0..AHEAD).map(|j| variance_out(DOFS * j + d)).sum();
            (sum / AHEAD as f64).max(1e-12).sqrt()
        });
        let scale_in = DVector::from_fn(INPUTS, |i, _| channel[i % CHANNELS]);
        let scale_out = DVector::from_fn(OUTPUTS, |j, _| dof[j % DOFS]);
        let gram = Mat::from_fn(INPUTS, INPUTS, |i, j| {
            let product = sums.products[(i.max(j), i.min(j))];
            (product / w - mean_in[i] * mean_in[j]) / (scale_in[i] * scale_in[j])
        });
        let cross = Mat::from_fn(INPUTS, OUTPUTS, |i, j| {
            (sums.products[(INPUTS + j, i)] / w - mean_in[i] * mean_out[j]) / (scale_in[i] * scale_out[j])
        });
        Fit {
            stage: Stage::Solve,
            variance: (0..OUTPUTS)
                .map(|j| variance_out(j) / scale_out[j].powi(2))
                .collect(),
            ridge: RIDGE * (1.0 + RIDGE_ROWS / w),
            level_variance,
            scale_in,
            scale_out,
            mean_in,
            gram,
            cross,
        }
    }

    pub(super) fn advance(mut self) -> FitProgress {
        match core::mem::replace(&mut self.stage, Stage::Solve) {
            Stage::Solve => {
                let mut normal = self.gram.clone();
                for i in 0..INPUTS {
                    normal[(i, i)] += self.ridge;
                }
                match normal.llt(Side::Lower) {
                    Ok(llt) => {
                        self.stage = Stage::Reduce(llt.solve(&self.cross));
                        FitProgress::Working(Box::new(self))
                    }
                    Err(_) => FitProgress::Failed,
                }
            }
            Stage::Reduce(coefficients) => match self.reduce(&coefficients) {
                Some(stage) => {
                    self.stage = stage;
                    FitProgress::Working(Box::new(self))
                }
                None => FitProgress::Failed,
            },
            Stage::Modes { state, observe } => match self.model(&state, &observe) {
                Some(model) => FitProgress::Done(Box::new(model)),
                None => FitProgress::Failed,
            },
        }
    }

    /// Best low-rank part of the regression: principal directions of the predicted future, weighted by each
    /// output's residual (Larimore 1990).
    fn reduce(&self, b: &Mat<f64>) -> Option<Stage> {
        // Covariance of the prediction and variance of the residual; gram * b = cross - ridge * b.
        let with_past = Mat::from_fn(INPUTS, OUTPUTS, |i, j| {
            self.cross[(i, j)] - self.ridge * b[(i, j)]
        });
        let predicted = b.transpose() * &with_past;
        let weight: Vec<f64> = (0..OUTPUTS)
            .map(|j| {
                let own = 2.0 * self.ridge * b.col(j).squared_norm_l2();
                let left = self.variance[j] - own - predicted[(j, j)];
                1.0 / left.max(1e-4).sqrt()
            })
            .collect();
        let weighted = Mat::from_fn(OUTPUTS, OUTPUTS, |i, j| weight[i] * weight[j] * predicted[(i, j)]);
        let eigen = weighted.self_adjoint_eigen(Side::Lower).ok()?;
        let u = eigen.U();
        let v = Mat::from_fn(OUTPUTS, ORDER, |i, k| u[(i, OUTPUTS - 1 - k)]);
        let scaled = Mat::from_fn(OUTPUTS, ORDER, |i, k| weight[i] * v[(i, k)]);
        Some(Stage::Modes {
            state: b * &scaled,
            observe: Mat::from_fn(OUTPUTS, ORDER, |i, k| v[(i, k)] / weight[i]),
        })
    }

    /// Transition, from the future shifted by a step, and its modes.
    fn model(&self, state: &Mat<f64>, observe: &Mat<f64>) -> Option<Model> {
        let x = self.gram.as_ref() * state;
        let covariance = state.transpose() * &x;
        // Maps the state to present values: `E[y x'] E[x x']^-1` of the channels.
        let damped = Mat::from_fn(ORDER, ORDER, |i, j| {
            covariance[(i, j)]
                + if i == j {
                    1e-6 * covariance[(i, i)] + 1e-12
                } else {
                    0.0
                }
        });
        let present = damped
            .llt(Side::Lower)
            .ok()?
            .solve(x.subrows(0, CHANNELS).transpose());
        let shorter = observe.subrows(0, OUTPUTS - DOFS);
        let later = observe.subrows(DOFS, OUTPUTS - DOFS);
        let transition = shorter.qr().solve_lstsq(later.to_owned());
        let eigen = transition.eigen().ok()?;
        let vectors = eigen.U();
        let values = eigen.S();
        let directions = Mat::<c64>::from_fn(ORDER, ORDER, |i, j| vectors[(i, j)]);
        let inverse = directions
            .partial_piv_lu()
            .solve(Mat::<c64>::identity(ORDER, ORDER));
        let mut modes: Vec<(f64, ModeFit)> = Vec::with_capacity(ORDER);
        for k in 0..ORDER {
            let value = values[k];
            let size = value.re.hypot(value.im);
            let angle = value.im.atan2(value.re);
            // Keeps one of each conjugate pair. A negative real eigenvalue oscillates at half the sampling rate and is not
            // a motion. A mode that decays within a step is noise: negligible in position, but not in velocity.
            if !(size > DEAD) || !(0.0..=3.1).contains(&angle) {
                continue;
            }
            let pole = Complex::new((size.ln() / STEP_S).min(-MIN_DECAY), angle / STEP_S);
            let twice = if angle > 0.0 { 2.0 } else { 1.0 };
            let along = |row: &dyn Fn(usize) -> f64| {
                (0..ORDER).fold(Complex::default(), |s: Complex<f64>, i| {
                    let v = directions[(i, k)];
                    s + Complex::new(v.re, v.im) * row(i)
                })
            };
            let channel = |c: usize| along(&|i| present[(i, c)]);
            let output = |row: usize| along(&|i| observe[(row, i)]);
            let mut shape = self.shape((pole, twice), channel, output);
            if !wave(pole, shape) {
                for d in WITHOUT_SLOW {
                    shape[d] = Complex::default();
                }
            }
            // Excitation by the past: row k of the inverse times the rows of the state.
            let row: [c64; ORDER] = core::array::from_fn(|m| inverse[(k, m)]);
            let mut real = DVector::zeros(INPUTS);
            let mut imaginary = DVector::zeros(INPUTS);
            for (m, v) in row.iter().enumerate() {
                for (i, x) in state.col_as_slice(m).iter().enumerate() {
                    real[i] += v.re * x;
                    imaginary[i] += v.im * x;
                }
            }
            real.component_div_assign(&self.scale_in);
            imaginary.component_div_assign(&self.scale_in);
            let strength = self.strength(&covariance, &row, &shape);
            modes.push((
                strength,
                ModeFit {
                    pole,
                    shape,
                    real,
                    imaginary,
                },
            ));
        }
        self.strongest(modes)
    }

    /// Shape of the mode with this pole, fitted to its responses in the present channels and future outputs.
    fn shape(
        &self,
        (pole, twice): (Complex<f64>, f64),
        channel: impl Fn(usize) -> Complex<f64>,
        output: impl Fn(usize) -> Complex<f64>,
    ) -> [Complex<f64>; DOFS] {
        core::array::from_fn(|d| {
            let mut sum = Complex::<f64>::default();
            let mut squares = 0.0;
            let mut add = |gain: Complex<f64>, response: Complex<f64>| {
                sum += gain.conj() * response;
                squares += gain.norm_sqr();
            };
            let (value, rate) = channels_of(d);
            if let Some(c) = value {
                let ratio = self.scale_out[d] / self.scale_in[c];
                add(ratio.into(), channel(c));
            }
            if let Some(c) = rate {
                let ratio = self.scale_out[d] / self.scale_in[c];
                add(pole * ratio, channel(c));
            }
            for j in 0..AHEAD {
                let propagator = (pole * ((j + 1) as f64 * STEP_S)).exp();
                add(propagator, output(DOFS * j + d));
            }
            sum / squares * (twice * self.scale_out[d])
        })
    }

    /// Model of the strongest modes; None if one is not finite.
    fn strongest(&self, mut modes: Vec<(f64, ModeFit)>) -> Option<Model> {
        let finite =
            |m: &ModeFit| m.pole.is_finite() && m.real.iter().chain(&m.imaginary).all(|v| v.is_finite());
        if modes.is_empty() || !modes.iter().all(|(s, m)| s.is_finite() && finite(m)) {
            return None;
        }
        modes.sort_by(|a, b| b.0.total_cmp(&a.0));
        modes.truncate(MAX_MODES);
        let mut modes: Vec<ModeFit> = modes.into_iter().map(|(_, m)| m).collect();
        let fraction = self.keep_slow_heave(&mut modes);
        Some(Model {
            mean_in: self.mean_in.clone(),
            modes,
            slow_variance: fraction * self.level_variance,
        })
    }

    /// Fraction of the slow heave that the error of the mean water level does not explain (Wiener 1949): `s = 1 - P / V`,
    /// with the variances `V` of slow heave and `P` of the level. Waves met slowly in a following sea keep nearly all of
    /// their heave, a drifting boat almost none. The kept part has an error variance of `s P`.
    fn keep_slow_heave(&self, modes: &mut [ModeFit]) -> f64 {
        let slow = |m: &&mut ModeFit| !wave(m.pole, m.shape);
        // Slow heave as a function of the past: Re c (r + i s)' z.
        let mut gain = DVector::zeros(INPUTS);
        for m in modes.iter_mut().filter(slow) {
            gain += &m.real * m.shape[HEAVE].re - &m.imaginary * m.shape[HEAVE].im;
        }
        let scaled = Mat::from_fn(INPUTS, 1, |i, _| gain[i] * self.scale_in[i]);
        let variance = (scaled.transpose() * &self.gram * &scaled)[(0, 0)];
        let fraction = (1.0 - self.level_variance / variance.max(f64::MIN_POSITIVE)).max(0.0);
        for m in modes.iter_mut().filter(slow) {
            m.shape[HEAVE] *= Complex::from(fraction);
        }
        fraction
    }

    /// Mean square of a mode relative to the total, summed over degrees of freedom. `row` excites the mode
    /// from a state with this covariance.
    fn strength(&self, covariance: &Mat<f64>, row: &[c64; ORDER], shape: &[Complex<f64>; DOFS]) -> f64 {
        let square = |i: usize, j: usize| row[i].re * row[j].re + row[i].im * row[j].im;
        let excitation: f64 = (0..ORDER)
            .flat_map(|i| (0..ORDER).map(move |j| (i, j)))
            .map(|(i, j)| square(i, j) * covariance[(i, j)])
            .sum();
        (0..DOFS)
            .map(|d| excitation * shape[d].norm_sqr() / self.scale_out[d].powi(2))
            .sum()
    }
}
