//! Kalman filter of one degree of freedom of the deck.
//!
//! State: `[mean, mean rate, slow error of the radio, slow error of vision, drift of vision, rotation of vision,
//! (value, rate) per oscillator]`. The deck's position or angle is `mean + sum of values`. The radio measures it with
//! the radio's slow error (vessel GNSS and compass), vision with vision's slow error (drone GNSS, camera mount). Both
//! errors are first-order Gauss-Markov processes, and so is the drift, the velocity error of the odometry, which
//! integrates into vision's slow error. The rotation (camera mount, attitude) shifts distant detections north and east
//! and becomes observable during the descent. The oscillators are Fossen's wave filter (2011, section 8.2.6),
//! discretised exactly.
//!
//! The degrees of freedom are chosen to be decoupled. They are the position of the deck's centre (not of the vessel's
//! reference point) in NED, with the height that it has on a level vessel (see `lever_arm_heave`), and the tilt of a
//! vessel that heads north by its own compass, so that a turn does not affect the waves. Six filters of at most 18
//! states cost a tenth of a joint filter.

use alight_shared::estimation::reduce_covariance;

use super::{
    config::PredictorConfig,
    waves::{AXES, HandOver, MAX_OSCILLATORS, Oscillator},
};

/// Number of states before the oscillators.
pub const HEAD: usize = 6;
/// Mean level, m, rad.
pub const MEAN: usize = 0;
/// Mean rate, m/s, rad/s.
pub const RATE: usize = 1;
pub const RADIO: usize = 2;
pub const VISION: usize = 3;
/// Drift of vision: velocity error of the odometry.
pub const DRIFT: usize = 4;
/// Rotation of vision, rad. Multiplied by the distance along the line of sight, it gives the shift of a detection.
pub const TURN: usize = 5;
pub const MAX_STATES: usize = HEAD + 2 * MAX_OSCILLATORS;

/// Reading of the vessel's compass minus that of the drone's, rad. Tilt refers to a vessel that heads north by its own
/// compass, because its modes and estimates are the best information about tilt.
pub fn compass(heading: &[f64; MAX_STATES]) -> f64 {
    heading[RADIO] - heading[VISION]
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeasurementRow {
    /// Mean and waves, without slow errors.
    Level,
    /// Radio measurement: level plus the radio's slow error.
    Radio,
    /// Position in the drone's frame: level plus vision's slow error.
    Vision,
    /// Camera measurement: level plus vision's slow error and rotation. The value is the lever arm of the rotation, m.
    Camera(f64),
    /// Vision's slow error minus the radio's.
    Offset,
    /// Vision's rotation.
    Turn,
    /// Rate of the level, i.e. of mean and waves.
    Rate,
    /// Residual of the modes: sum of the oscillators.
    Residual,
    ResidualRate,
}

/// Scalar innovation `z - h(x)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// Row of the measurement matrix `dh/dx`.
    pub row: MeasurementRow,
    /// Measured minus predicted value, m or rad, or its rate.
    pub value: f64,
    pub variance: f64,
}

/// Non-zero entries of the row `row`, for a filter with `n` states.
fn entries(row: MeasurementRow, n: usize) -> impl Iterator<Item = (usize, f64)> {
    let (head, first): ([(usize, f64); 3], Option<usize>) = match row {
        MeasurementRow::Level => ([(MEAN, 1.0), (MEAN, 0.0), (MEAN, 0.0)], Some(HEAD)),
        MeasurementRow::Radio => ([(MEAN, 1.0), (RADIO, 1.0), (MEAN, 0.0)], Some(HEAD)),
        MeasurementRow::Vision => ([(MEAN, 1.0), (VISION, 1.0), (MEAN, 0.0)], Some(HEAD)),
        MeasurementRow::Camera(lever) => ([(MEAN, 1.0), (VISION, 1.0), (TURN, lever)], Some(HEAD)),
        MeasurementRow::Offset => ([(VISION, 1.0), (RADIO, -1.0), (MEAN, 0.0)], None),
        MeasurementRow::Turn => ([(TURN, 1.0), (MEAN, 0.0), (MEAN, 0.0)], None),
        MeasurementRow::Residual => ([(MEAN, 0.0); 3], Some(HEAD)),
        MeasurementRow::ResidualRate => ([(MEAN, 0.0); 3], Some(HEAD + 1)),
        MeasurementRow::Rate => ([(RATE, 1.0), (MEAN, 0.0), (MEAN, 0.0)], Some(HEAD + 1)),
    };
    let waves = first.map_or(n..n, |f| f..n).step_by(2).map(|i| (i, 1.0));
    head.into_iter().filter(|(_, h)| *h != 0.0).chain(waves)
}

/// Wave-independent noise parameters of one degree of freedom. A pair is the standard deviation and the correlation
/// time (s) of an error.
#[derive(Clone, Copy, Debug)]
pub struct AxisNoise {
    pub radio: (f64, f64),
    pub vision: (f64, f64),
    pub drift: (f64, f64),
    pub turn: (f64, f64),
    /// Variance per second of the mean's random walk.
    pub mean_walk: f64,
    /// Variance per second of the mean rate's random walk.
    pub rate_walk: f64,
    /// Random walk of the mean rate after 1 s, as a fraction of the mean speed.
    pub speed_walk: f64,
    /// Random walk of the mean rate after 1 s, per lateral acceleration in a turn, s.
    pub turn_walk: f64,
    /// Decay time of the mean rate, s.
    pub rate_time: f64,
}

impl AxisNoise {
    pub fn all(c: &PredictorConfig) -> [AxisNoise; AXES] {
        core::array::from_fn(|i| AxisNoise {
            radio: (c.radio_bias_sd_m_rad[i], c.radio_bias_time_s[i]),
            vision: (c.vision_bias_sd_m_rad[i], c.vision_bias_time_s[i]),
            // Angles do not drift, because the camera rotates with the drone, whose attitude is measured.
            drift: (if i < 3 { c.odometry_drift_mps } else { 0.0 }, c.odometry_drift_s),
            turn: match i {
                0 | 1 => (c.vision_bias_sd_m_rad[4 - i], c.vision_bias_time_s[4 - i]),
                _ => (0.0, c.vision_bias_time_s[4]),
            },
            mean_walk: c.mean_walk_m_rad[i].powi(2),
            rate_walk: c.rate_walk_mps_radps[i].powi(2),
            speed_walk: if i < 2 { c.speed_walk } else { 0.0 },
            turn_walk: if i < 2 { c.turn_walk_s } else { 0.0 },
            rate_time: c.rate_time_s[i],
        })
    }
}

/// Transition of all oscillators, shared by the six filters.
#[derive(Clone, Debug)]
pub struct OscillatorStep {
    pub dt: f64,
    pub count: usize,
    transitions: [OscillatorTransition; AXES],
}

/// One block per oscillator.
#[derive(Clone, Copy, Debug)]
pub struct OscillatorTransition {
    /// Row-major 2 x 2 blocks.
    pub a: [[f64; 4]; MAX_OSCILLATORS],
    /// `I - A diag(1, omega²) A'` in units of the stationary variance: q11, q12, q22.
    pub q: [[f64; 3]; MAX_OSCILLATORS],
}

impl OscillatorStep {
    /// Closed form of `exp(F dt)` of each damped oscillator, and the noise that keeps its covariance `diag(1, omega²)
    /// sd²`.
    pub fn new(oscillators: &[Oscillator], dt: f64) -> Self {
        OscillatorStep {
            dt,
            count: oscillators.len().min(MAX_OSCILLATORS),
            transitions: core::array::from_fn(|axis| OscillatorTransition::new(oscillators, axis, dt)),
        }
    }
    pub fn of(&self, axis: usize) -> &OscillatorTransition {
        &self.transitions[axis]
    }
}

impl OscillatorTransition {
    fn new(oscillators: &[Oscillator], axis: usize, dt: f64) -> Self {
        let mut s = OscillatorTransition {
            a: [[0.0; 4]; MAX_OSCILLATORS],
            q: [[0.0; 3]; MAX_OSCILLATORS],
        };
        for (i, o) in oscillators.iter().take(MAX_OSCILLATORS).enumerate() {
            let w = o.omega;
            let l = o.damping[axis];
            let wd = w * (1.0 - l * l).max(1e-6).sqrt();
            let e = (-l * w * dt).exp();
            let (sin, cos) = (wd * dt).sin_cos();
            let c = e * cos;
            let n = e * sin / wd;
            let a = [c + l * w * n, n, -w * w * n, c - l * w * n];
            let w2 = w * w;
            s.q[i] = [
                (1.0 - a[0] * a[0] - w2 * a[1] * a[1]).max(0.0),
                -(a[0] * a[2] + w2 * a[1] * a[3]),
                (w2 - a[2] * a[2] - w2 * a[3] * a[3]).max(0.0),
            ];
            s.a[i] = a;
        }
        s
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// Number of states in use.
    pub n: usize,
    pub x: [f64; MAX_STATES],
    pub p: [[f64; MAX_STATES]; MAX_STATES],
}

impl Axis {
    /// Starts at this level with standard deviation `sd`, at a rate of zero with `rate_sd`, and with the stationary
    /// covariance of waves and errors.
    pub fn new(
        noise: &AxisNoise,
        oscillators: &[Oscillator],
        axis: usize,
        level: f64,
        sd: f64,
        rate_sd: f64,
    ) -> Self {
        let mut a = Axis {
            n: HEAD,
            x: [0.0; MAX_STATES],
            p: [[0.0; MAX_STATES]; MAX_STATES],
        };
        a.x[MEAN] = level;
        a.p[MEAN][MEAN] = sd * sd;
        a.p[RATE][RATE] = rate_sd * rate_sd;
        a.p[RADIO][RADIO] = noise.radio.0.powi(2);
        a.p[VISION][VISION] = noise.vision.0.powi(2);
        a.p[DRIFT][DRIFT] = noise.drift.0.powi(2);
        a.p[TURN][TURN] = noise.turn.0.powi(2);
        for o in oscillators {
            a.append(o, axis);
        }
        a
    }

    /// Appends an oscillator at rest with its stationary covariance.
    pub fn append(&mut self, o: &Oscillator, axis: usize) {
        if self.n + 2 > MAX_STATES {
            return;
        }
        let i = self.n;
        self.n += 2;
        for k in 0..self.n {
            for j in [i, i + 1] {
                self.p[k][j] = 0.0;
                self.p[j][k] = 0.0;
            }
        }
        let var = o.sd[axis].powi(2);
        self.x[i] = 0.0;
        self.x[i + 1] = 0.0;
        self.p[i][i] = var;
        self.p[i + 1][i + 1] = var * o.omega * o.omega;
    }
    /// Replaces the modes and the residual oscillator by these oscillators.
    pub fn hold(&mut self, oscillators: &[Oscillator], axis: usize, held: &HandOver) {
        let left = [self.x[HEAD], self.x[HEAD + 1]];
        self.n = HEAD;
        let sum: f64 = oscillators.iter().map(|o| o.sd[axis].powi(2)).sum();
        for (o, motion) in oscillators.iter().zip(&held.motions) {
            let i = self.n;
            self.append(o, axis);
            let fraction = o.sd[axis].powi(2) / sum.max(f64::MIN_POSITIVE);
            self.x[i] = motion.value[axis] + fraction * left[0];
            self.x[i + 1] = motion.rate[axis] + fraction * left[1];
            for k in [i, i + 1] {
                self.p[k][k] *= held.unknown[axis];
            }
        }
    }
    /// Replaces all oscillators by their sum, with covariance `T P T'`.
    pub fn fold_oscillators(&mut self) {
        for k in (HEAD + 2..self.n).step_by(2) {
            for (to, from) in [(HEAD, k), (HEAD + 1, k + 1)] {
                self.x[to] += self.x[from];
                for j in 0..self.n {
                    self.p[to][j] += self.p[from][j];
                }
                for j in 0..self.n {
                    self.p[j][to] += self.p[j][from];
                }
            }
        }
        self.n = self.n.min(HEAD + 2);
    }
    /// `x <- A x`, `P <- A P A' + Q` over `step`.
    pub fn propagate(
        &mut self,
        noise: &AxisNoise,
        oscillators: &[Oscillator],
        axis: usize,
        step: &OscillatorStep,
    ) {
        let dt = step.dt;
        let n = self.n.min(HEAD + 2 * step.count);
        let h = Head::new(noise, dt);
        let step_of = step.of(axis);
        let a = step_of.a.get(..step.count).unwrap_or(&step_of.a);
        h.advance(&mut self.x, a);
        // A P, row block by row block.
        for j in 0..n {
            self.p[MEAN][j] += h.reach * self.p[RATE][j];
            self.p[RATE][j] *= h.rate;
            self.p[RADIO][j] *= h.radio;
            self.p[VISION][j] = h.vision * self.p[VISION][j] + h.wander * self.p[DRIFT][j];
            self.p[DRIFT][j] *= h.drift;
            self.p[TURN][j] *= h.turn;
        }
        for (k, a) in a.iter().enumerate() {
            let i = HEAD + 2 * k;
            for j in 0..n {
                let v = self.p[i][j];
                let r = self.p[i + 1][j];
                self.p[i][j] = a[0] * v + a[1] * r;
                self.p[i + 1][j] = a[2] * v + a[3] * r;
            }
        }
        // (A P) A'.
        for row in self.p.iter_mut().take(n) {
            h.advance(row, a);
        }
        let q = h.noise(noise, dt);
        self.p[MEAN][MEAN] += q.mean;
        self.p[MEAN][RATE] += q.cross;
        self.p[RATE][MEAN] += q.cross;
        self.p[RATE][RATE] += q.rate;
        self.p[RADIO][RADIO] += q.radio;
        self.p[VISION][VISION] += q.vision;
        self.p[VISION][DRIFT] += q.wander;
        self.p[DRIFT][VISION] += q.wander;
        self.p[DRIFT][DRIFT] += q.drift;
        self.p[TURN][TURN] += q.turn;
        for (k, (q, o)) in step_of.q.iter().zip(oscillators).take(step.count).enumerate() {
            let i = HEAD + 2 * k;
            let var = o.sd[axis].powi(2);
            self.p[i][i] += var * q[0];
            self.p[i][i + 1] += var * q[1];
            self.p[i + 1][i] += var * q[1];
            self.p[i + 1][i + 1] += var * q[2];
        }
    }

    pub fn project(&self, row: MeasurementRow) -> (f64, f64) {
        let mut ph = [0.0; MAX_STATES];
        (self.predicted(row), self.predict_variance(row, &mut ph))
    }
    pub fn predicted(&self, row: MeasurementRow) -> f64 {
        entries(row, self.n).map(|(i, h)| h * self.x[i]).sum()
    }

    /// Predicted variance of `row`; sets `ph` to `P h'`.
    fn predict_variance(&self, row: MeasurementRow, ph: &mut [f64; MAX_STATES]) -> f64 {
        let n = self.n;
        // P is symmetric, so its rows are read as columns.
        for (i, h) in entries(row, n) {
            for (a, b) in ph.iter_mut().zip(&self.p[i]).take(n) {
                *a += h * b;
            }
        }
        let var: f64 = entries(row, n).map(|(i, h)| h * ph[i]).sum();
        var.max(0.0)
    }

    pub fn innovation(&self, row: MeasurementRow, value: f64, variance: f64) -> Innovation {
        Innovation {
            row,
            value: value - self.predicted(row),
            variance,
        }
    }
    pub fn normalised(&self, innovation: &Innovation) -> f64 {
        let (_, var) = self.project(innovation.row);
        innovation.value.abs() / (var + innovation.variance).max(1e-300).sqrt()
    }

    pub fn update(&mut self, row: MeasurementRow, value: f64, r: f64) {
        self.correct(&self.innovation(row, value, r));
    }
    /// Fuses an innovation `nu`: `x += P h' nu / S`, and [`reduce_covariance`].
    pub fn correct(&mut self, innovation: &Innovation) {
        let mut ph = [0.0; MAX_STATES];
        let s = self.predict_variance(innovation.row, &mut ph) + innovation.variance;
        if !(s > 0.0) || !s.is_finite() {
            return;
        }
        let gain = 1.0 / s;
        let nu = innovation.value;
        for (x, c) in self.x.iter_mut().zip(&ph).take(self.n) {
            *x += c * gain * nu;
        }
        reduce_covariance(self.p.iter_mut().map(|row| &mut row[..]), &ph[..self.n], s);
    }

    /// Resets state `k` to zero with standard deviation `sd`, uncorrelated with the others.
    pub fn forget(&mut self, k: usize, sd: f64) {
        for j in 0..self.n {
            (self.p[k][j], self.p[j][k]) = (0.0, 0.0);
        }
        (self.x[k], self.p[k][k]) = (0.0, sd * sd);
    }

    pub fn is_finite(&self) -> bool {
        self.x.iter().take(self.n).all(|v| v.is_finite())
            && self
                .p
                .iter()
                .take(self.n)
                .all(|r| r.iter().take(self.n).all(|v| v.is_finite()))
    }
}

/// Transition of the states before the oscillators over one step: decay factors and gains.
#[derive(Clone, Copy, Debug)]
pub struct Head {
    /// Gain from the mean rate to the mean, s.
    pub reach: f64,
    pub rate: f64,
    pub radio: f64,
    pub vision: f64,
    /// Gain from the drift to vision's slow error, s.
    pub wander: f64,
    pub drift: f64,
    pub turn: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct HeadNoise {
    pub mean: f64,
    /// Covariance of mean and rate.
    pub cross: f64,
    pub rate: f64,
    pub radio: f64,
    pub vision: f64,
    /// Covariance of vision's slow error and its drift.
    pub wander: f64,
    pub drift: f64,
    pub turn: f64,
}

impl Head {
    pub fn new(n: &AxisNoise, dt: f64) -> Self {
        let rate = (-dt / n.rate_time).exp();
        let drift = (-dt * decays(n).1).exp();
        let vision = (-dt / n.vision.1).exp();
        Head {
            reach: n.rate_time * (1.0 - rate),
            rate,
            radio: (-dt / n.radio.1).exp(),
            vision,
            wander: (drift - vision) / decays(n).2,
            drift,
            turn: (-dt / n.turn.1).exp(),
        }
    }
    /// `v <- A v` for a state or a row of the covariance. `oscillators`: blocks of the states after the head.
    fn advance(&self, v: &mut [f64; MAX_STATES], oscillators: &[[f64; 4]]) {
        v[MEAN] += self.reach * v[RATE];
        v[RATE] *= self.rate;
        v[RADIO] *= self.radio;
        v[VISION] = self.vision * v[VISION] + self.wander * v[DRIFT];
        v[DRIFT] *= self.drift;
        v[TURN] *= self.turn;
        for (k, a) in oscillators.iter().enumerate() {
            let i = HEAD + 2 * k;
            let value = v[i];
            let rate = v[i + 1];
            v[i] = a[0] * value + a[1] * rate;
            v[i + 1] = a[2] * value + a[3] * rate;
        }
    }
    /// Process noise over `dt`. The random walk of the rate ignores the decay over `dt`, which is conservative. The
    /// drift and its effect on vision's slow error are exact: with their decay rates `a` and `b`, a pulse of drift has
    /// added `g(s) = (e^-bs - e^-as) / (a - b)` after `s`; the (co)variances are the integrals of `g²` and `g e^-bs`.
    pub fn noise(&self, n: &AxisNoise, dt: f64) -> HeadNoise {
        let sd = n.drift.0;
        let left = self.drift;
        let (a, b, apart) = decays(n);
        let density = 2.0 * b * sd * sd;
        let both = (1.0 - left * self.vision) / (a + b);
        let own = (1.0 - left * left) / (2.0 * b);
        let other = (1.0 - self.vision * self.vision) / (2.0 * a);
        HeadNoise {
            mean: n.mean_walk * dt + n.rate_walk * dt.powi(3) / 3.0,
            cross: n.rate_walk * dt * dt / 2.0,
            rate: n.rate_walk * dt,
            radio: n.radio.0.powi(2) * (1.0 - self.radio * self.radio),
            vision: n.vision.0.powi(2) * (1.0 - self.vision * self.vision)
                + (density / (apart * apart) * (own - 2.0 * both + other)).max(0.0),
            wander: density / apart * (own - both),
            drift: sd * sd * (1.0 - left * left),
            turn: n.turn.0.powi(2) * (1.0 - self.turn * self.turn),
        }
    }
}

/// Decay rates of vision's slow error and of its drift (1/s), and their difference, which is never zero.
fn decays(n: &AxisNoise) -> (f64, f64, f64) {
    let a = 1.0 / n.vision.1;
    let b = 1.0 / n.drift.1;
    let b = if (a - b).abs() < 1e-3 * a { 1.002 * a } else { b };
    (a, b, a - b)
}
