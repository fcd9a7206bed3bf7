//! Least squares of sinusoids that share their frequencies over all channels, by variable
//! projection.
//!
//! For given frequencies and directions the model is linear in offsets, trends and amplitudes; what
//! remains is a small nonlinear problem in `(omega_j, theta_j)` (Golub and Pereyra 1973; the
//! approximate Jacobian of Kaufman 1975), solved by Levenberg-Marquardt. With the basis
//! `Phi = [1, t, cos phi_j, sin phi_j]` and its derivatives by the parameters stacked beside it as
//! `Psi`, every quantity follows from the Gram matrix `Psi' Psi` and from `Psi' y_c`, so one pass
//! over the record per iteration is all.

use alight_shared::geometry::GRAVITY;
use alight_shared::msg::MAX_COMPONENTS;
use nalgebra::{Cholesky, Complex, DMatrix, DVector, Dyn};

use super::record::{Bin, CHANNELS};

/// A course is straight up to this root mean square distance from its line, m: the orbital motion of
/// a rough sea, a quarter of a radian of a 40 m wave.
const BEND_M: f64 = 1.5;
/// Columns of offset and trend.
const DRIFT: usize = 2;
/// Largest step of a frequency per iteration, in units of 2 pi / T.
const STEP_BINS: f64 = 0.35;
/// Largest step of a direction per iteration, rad.
const STEP_DIRECTION: f64 = 0.3;

/// What a component's phase depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wave {
    /// Earth-frame angular frequency, rad/s.
    pub omega: f64,
    /// Direction it travels to, rad.
    pub direction: f64,
}

/// Prior on a direction, before the phases are used.
#[derive(Clone, Copy, Debug)]
pub(super) struct DirectionPrior {
    pub mean: f64,
    pub sd: f64,
}

/// The record, centred and scaled for the fit.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    /// Time since the middle of the record, s.
    pub t: Vec<f64>,
    /// Path since its middle: north, east, m.
    pub path: [Vec<f64>; 2],
    /// Mean velocity: north, east, m/s.
    velocity: [Vec<f64>; 2],
    /// Channels.
    pub y: [Vec<f64>; CHANNELS],
    /// Bin numbers since the first.
    pub slot: Vec<usize>,
    /// Middle of the record: its time, s.
    pub middle: f64,
    /// Length, s.
    pub span_s: f64,
    /// Whether the course is bent enough for the directions to show in the phases.
    pub moving: bool,
    /// Whether the vessel drifts straight on.
    pub adrift: bool,
    /// Farthest from the path's middle along north or east, m.
    pub reach_m: f64,
    /// Channels as measured.
    raw: [Vec<f64>; CHANNELS],
    square: [f64; CHANNELS],
}

impl Rows {
    /// Takes over the bins that are not older than `window_s`.
    pub fn load<'a>(&mut self, bins: impl Iterator<Item = &'a Bin> + Clone, window_s: f64, waves: &[Wave]) {
        self.t.clear();
        self.slot.clear();
        self.path.iter_mut().for_each(Vec::clear);
        self.velocity.iter_mut().for_each(Vec::clear);
        self.y.iter_mut().for_each(Vec::clear);
        self.moving = false;
        self.span_s = 0.0;
        let end = bins.clone().last().map_or(0.0, |b| b.t);
        let bins = bins.filter(|b| b.t >= end - window_s);
        let Some(first) = bins.clone().next() else {
            return;
        };
        self.span_s = end - first.t;
        let n = bins.clone().count() as f64;
        self.middle = bins.clone().map(|b| b.t / n).sum();
        for b in bins {
            self.t.push(b.t - self.middle);
            self.slot.push((b.index - first.index).max(0) as usize);
            for i in 0..2 {
                self.velocity[i].push(b.velocity[i]);
            }
            for c in 0..CHANNELS {
                self.y[c].push(b.y[c]);
            }
        }
        let raw = self.velocity.clone();
        self.smooth_course(&[]);
        if !waves.is_empty() {
            // Once more, with the phases along the first path: what then is in step with a known
            // wave is its orbital motion, also at the end of the record, where it matters most.
            let phases: Vec<Vec<f64>> = waves
                .iter()
                .map(|w| {
                    let (sin, cos) = w.direction.sin_cos();
                    let number = w.omega * w.omega / GRAVITY;
                    (0..self.t.len())
                        .map(|i| {
                            w.omega * self.t[i] - number * (cos * self.path[0][i] + sin * self.path[1][i])
                        })
                        .collect()
                })
                .collect();
            self.velocity = raw;
            self.smooth_course(&phases);
        }
        self.reach_m = self.straighten();
        self.raw.clone_from(&self.y);
        self.square = core::array::from_fn(|c| dot(&self.y[c], &self.y[c]));
    }
    /// Fits to what the channels as measured leave of `known`, per row.
    pub fn less(&mut self, known: &[[f64; CHANNELS]]) {
        for c in 0..CHANNELS {
            for ((y, raw), known) in self.y[c].iter_mut().zip(&self.raw[c]).zip(known) {
                *y = raw - known[c];
            }
        }
        self.square = core::array::from_fn(|c| dot(&self.y[c], &self.y[c]));
    }
    /// Phase of a wave in row `i`, rad.
    pub fn phase(&self, w: &Wave, i: usize) -> f64 {
        let (sin, cos) = w.direction.sin_cos();
        w.omega * self.t[i] - w.omega * w.omega / GRAVITY * (cos * self.path[0][i] + sin * self.path[1][i])
    }
    /// On a vessel that drifts straight at constant speed a wave has one frequency of encounter, whose phase does not
    /// separate frequency from direction; the path is bent only by orbital motion that the smoothing has left. The
    /// straight line is used, and the directions are those of the amplitudes. Returns the largest distance of the
    /// path from its middle, m.
    fn straighten(&mut self) -> f64 {
        let n = self.t.len().max(1) as f64;
        let square: f64 = self.t.iter().map(|t| t * t).sum::<f64>().max(1e-9);
        let slope: [f64; 2] = core::array::from_fn(|i| dot(&self.t, &self.path[i]) / square);
        let off: f64 = (0..2)
            .map(|i| {
                let bend = |(t, x): (&f64, &f64)| (x - slope[i] * t).powi(2);
                self.t.iter().zip(&self.path[i]).map(bend).sum::<f64>()
            })
            .sum();
        let drifts = slope[0].hypot(slope[1]) < super::DRIFT_MPS && (off / n).sqrt() < BEND_M;
        // A wave of 40 m turns its phase by 0.5 rad in 3 m.
        let reach = self.path.iter().flatten().fold(0.0_f64, |r, x| r.max(x.abs()));
        self.moving = !drifts && reach > 3.0;
        self.adrift = drifts;
        if drifts {
            for i in 0..2 {
                for (x, t) in self.path[i].iter_mut().zip(&self.t) {
                    *x = slope[i] * t;
                }
                self.velocity[i].fill(slope[i]);
            }
        }
        reach
    }
    /// Smooths the velocity and integrates the path from it.
    fn smooth_course(&mut self, phases: &[Vec<f64>]) {
        let [north, east] = &mut self.velocity;
        super::course::smooth(&self.t, [north, east], phases);
        for (path, velocity) in self.path.iter_mut().zip(&self.velocity) {
            path.clear();
            let mut x = 0.0;
            path.push(0.0);
            for (t, v) in self.t.windows(2).zip(velocity.windows(2)) {
                x += 0.5 * (t[1] - t[0]) * (v[0] + v[1]);
                path.push(x);
            }
            let mean = path.iter().sum::<f64>() / path.len() as f64;
            path.iter_mut().for_each(|x| *x -= mean);
        }
    }
    /// Place on the path at the end of the record, m from its middle.
    pub fn end(&self) -> [f64; 2] {
        core::array::from_fn(|i| self.path[i].last().copied().unwrap_or(0.0))
    }
    /// Mean velocity at the end of the record: north, east, m/s.
    pub fn velocity_at_end(&self) -> [f64; 2] {
        core::array::from_fn(|i| self.velocity[i].last().copied().unwrap_or(0.0))
    }
    /// Bins in use.
    pub fn len(&self) -> usize {
        self.t.len()
    }
}

/// Inner product in four lanes, which the compiler may keep in vector registers.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (ca, cb) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = ca
        .remainder()
        .iter()
        .zip(cb.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in ca.zip(cb) {
        for l in 0..4 {
            lanes[l] += x[l] * y[l];
        }
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + tail
}

/// The linear part solved for given frequencies and directions.
#[derive(Clone, Debug)]
pub(super) struct Solution {
    /// The components.
    pub waves: Vec<Wave>,
    /// Coefficients per channel: offset, trend, then cosine and sine per component.
    pub coefficients: [DVector<f64>; CHANNELS],
    /// Sum of squared residuals per channel.
    pub residual: [f64; CHANNELS],
    /// Weighted sum of squared residuals plus the priors' terms.
    pub cost: f64,
    /// Inverse of the basis' Gram matrix: covariance of coefficients per unit of noise variance.
    pub inverse: DMatrix<f64>,
    parts: Vec<Part>,
    moments: [DVector<f64>; CHANNELS],
}

/// Gram matrix of a group of channels that share their columns, and its factor.
#[derive(Clone, Debug)]
struct Part {
    gram: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
}

/// Buffers of the fit.
#[derive(Clone, Debug, Default)]
pub(super) struct Fitter {
    /// The record.
    pub rows: Rows,
    /// Weight per channel, one over its noise variance.
    pub weights: [f64; CHANNELS],
    /// Ridge on the amplitudes: noise over signal variance.
    pub ridge: f64,
    columns: Vec<Vec<f64>>,
}

impl Fitter {
    /// Fills the columns of `Psi` and solves the linear part. `None` if the Gram matrix is not
    /// positive definite (components that coincide).
    pub fn solve(&mut self, waves: &[Wave], priors: &[DirectionPrior]) -> Option<Solution> {
        let waves = &waves[..waves.len().min(MAX_COMPONENTS + 1)];
        self.fill_columns(waves);
        let total = self.width(waves.len());
        let mut moments: [DVector<f64>; CHANNELS] = core::array::from_fn(|_| DVector::zeros(total));
        for c in 1..CHANNELS {
            self.moments(c, &mut moments[c]);
        }
        let mut grams = vec![self.gram(total)];
        if self.rows.moving {
            self.scale_to_acceleration(waves);
            grams.push(self.gram(total));
        }
        self.moments(0, &mut moments[0]);
        self.linear(waves, grams, moments, priors)
    }

    /// Columns of `Psi` for `k` components.
    fn width(&self, k: usize) -> usize {
        DRIFT + 2 * k * (2 + usize::from(self.rows.moving))
    }

    fn fill_columns(&mut self, waves: &[Wave]) {
        let (k, n) = (waves.len(), self.rows.len());
        let base = DRIFT + 2 * k;
        let total = self.width(k);
        while self.columns.len() < total {
            self.columns.push(Vec::new());
        }
        for column in &mut self.columns {
            column.resize(n, 0.0);
        }
        let half = (0.5 * self.rows.span_s).max(1.0);
        for i in 0..n {
            self.columns[0][i] = 1.0;
            self.columns[1][i] = self.rows.t[i] / half;
        }
        for (j, w) in waves.iter().enumerate() {
            let (sin_d, cos_d) = w.direction.sin_cos();
            let number = w.omega * w.omega / GRAVITY;
            let (c, s) = (DRIFT + 2 * j, DRIFT + 2 * j + 1);
            for i in 0..n {
                let (north, east) = (self.rows.path[0][i], self.rows.path[1][i]);
                let along = cos_d * north + sin_d * east;
                let (sin, cos) = (w.omega * self.rows.t[i] - number * along).sin_cos();
                self.columns[c][i] = cos;
                self.columns[s][i] = sin;
                let by_omega = self.rows.t[i] - 2.0 * w.omega / GRAVITY * along;
                self.columns[base + 2 * j][i] = by_omega * cos;
                self.columns[base + 2 * j + 1][i] = by_omega * sin;
                if self.rows.moving {
                    let by_direction = -number * (cos_d * east - sin_d * north);
                    self.columns[base + 2 * k + 2 * j][i] = by_direction * cos;
                    self.columns[base + 2 * k + 2 * j + 1][i] = by_direction * sin;
                }
            }
        }
    }

    /// Turns the columns into those of the vertical acceleration, which for one and the same wave
    /// goes with the square of the frequency of encounter and so changes with the course. The
    /// factor's own dependence on the parameters is left out of the Jacobian.
    fn scale_to_acceleration(&mut self, waves: &[Wave]) {
        let k = waves.len();
        for (j, w) in waves.iter().enumerate() {
            let (sin_d, cos_d) = w.direction.sin_cos();
            for i in 0..self.rows.len() {
                let along = cos_d * self.rows.velocity[0][i] + sin_d * self.rows.velocity[1][i];
                let factor = (1.0 - w.omega / GRAVITY * along).powi(2);
                for group in 0..3 {
                    let at = DRIFT + 2 * (group * k + j);
                    self.columns[at][i] *= factor;
                    self.columns[at + 1][i] *= factor;
                }
            }
        }
    }

    fn moments(&self, c: usize, out: &mut DVector<f64>) {
        for (o, column) in out.iter_mut().zip(&self.columns) {
            *o = dot(column, &self.rows.y[c]);
        }
    }

    fn gram(&self, total: usize) -> DMatrix<f64> {
        let mut gram = DMatrix::zeros(total, total);
        for a in 0..total {
            for b in a..total {
                let v = dot(&self.columns[a], &self.columns[b]);
                gram[(a, b)] = v;
                gram[(b, a)] = v;
            }
        }
        gram
    }

    fn linear(
        &self,
        waves: &[Wave],
        grams: Vec<DMatrix<f64>>,
        moments: [DVector<f64>; CHANNELS],
        priors: &[DirectionPrior],
    ) -> Option<Solution> {
        let base = DRIFT + 2 * waves.len();
        let mut parts = Vec::with_capacity(grams.len());
        for gram in grams {
            let mut head = gram.view((0, 0), (base, base)).clone_owned();
            for i in DRIFT..base {
                head[(i, i)] += self.ridge;
            }
            parts.push(Part {
                gram,
                factor: head.cholesky()?,
            });
        }
        let coefficients: [DVector<f64>; CHANNELS] = core::array::from_fn(|c| {
            parts[part_of(c, parts.len())]
                .factor
                .solve(&moments[c].rows(0, base).clone_owned())
        });
        // y'y - a'b is the residual plus the ridge's own share: the penalised cost that variable
        // projection minimises.
        let residual: [f64; CHANNELS] = core::array::from_fn(|c| {
            (self.rows.square[c] - coefficients[c].dot(&moments[c].rows(0, base))).max(0.0)
        });
        let cost = self.cost(waves, &residual, priors);
        let inverse = parts[0].factor.inverse();
        cost.is_finite().then(|| Solution {
            waves: waves.to_vec(),
            coefficients,
            residual,
            cost,
            inverse,
            parts,
            moments,
        })
    }

    /// The same fit under weights or priors that have changed since.
    pub fn rescore(&self, s: &mut Solution, priors: &[DirectionPrior]) {
        s.cost = self.cost(&s.waves, &s.residual, priors);
    }

    fn cost(&self, waves: &[Wave], residual: &[f64; CHANNELS], priors: &[DirectionPrior]) -> f64 {
        let mut cost: f64 = (0..CHANNELS).map(|c| self.weights[c] * residual[c]).sum();
        if self.rows.moving {
            for (w, p) in waves.iter().zip(priors) {
                cost += (w.direction - p.mean).powi(2) / (p.sd * p.sd);
            }
        }
        cost
    }

    /// The same record and components without component `drop`: no new pass over the record.
    pub fn without(&self, s: &Solution, drop: usize, priors: &[DirectionPrior]) -> Option<Solution> {
        let k = s.waves.len();
        let keep: Vec<usize> = (0..self.width(k))
            .filter(|i| *i < DRIFT || ((i - DRIFT) / 2) % k != drop)
            .collect();
        let grams = s
            .parts
            .iter()
            .map(|p| DMatrix::from_fn(keep.len(), keep.len(), |a, b| p.gram[(keep[a], keep[b])]))
            .collect();
        let moments = core::array::from_fn(|c| DVector::from_fn(keep.len(), |a, _| s.moments[c][keep[a]]));
        let rest = |j: &usize| *j != drop;
        let waves: Vec<Wave> = (0..k).filter(rest).map(|j| s.waves[j]).collect();
        let priors: Vec<DirectionPrior> = (0..priors.len()).filter(rest).map(|j| priors[j]).collect();
        self.linear(&waves, grams, moments, &priors)
    }

    /// Gauss-Newton matrix and gradient of half the cost in `(omega_j .., theta_j ..)`.
    fn normal_equations(&self, s: &Solution, priors: &[DirectionPrior]) -> (DMatrix<f64>, DVector<f64>) {
        let k = s.waves.len();
        let base = DRIFT + 2 * k;
        let p = k * (1 + usize::from(self.rows.moving));
        let mut h = DMatrix::zeros(p, p);
        let mut g = DVector::zeros(p);
        for c in 0..CHANNELS {
            let a = &s.coefficients[c];
            let Part { gram, factor } = &s.parts[part_of(c, s.parts.len())];
            // Column m of D is  b_j (w cos) - a_j (w sin)  of group m / k, component j = m % k.
            let term = |m: usize| {
                let (group, j) = (m / k, m % k);
                let at = base + 2 * k * group + 2 * j;
                [(at, a[DRIFT + 2 * j + 1]), (at + 1, -a[DRIFT + 2 * j])]
            };
            // Phi' D and its whitened form L^-1 Phi' D.
            let phi_d = DMatrix::from_fn(base, p, |i, m| {
                term(m).iter().map(|(col, f)| f * gram[(i, *col)]).sum()
            });
            let white = factor
                .l_dirty()
                .solve_lower_triangular(&phi_d)
                .unwrap_or_else(|| DMatrix::zeros(base, p));
            for m in 0..p {
                // D' r = D' y - D' Phi a
                let d_y: f64 = term(m).iter().map(|(col, f)| f * s.moments[c][*col]).sum();
                g[m] += self.weights[c] * (d_y - phi_d.column(m).dot(a));
                for q in m..p {
                    let mut d_d = 0.0;
                    for (x, fx) in term(m) {
                        for (y, fy) in term(q) {
                            d_d += fx * fy * gram[(x, y)];
                        }
                    }
                    let v = self.weights[c] * (d_d - white.column(m).dot(&white.column(q)));
                    h[(m, q)] += v;
                    if m != q {
                        h[(q, m)] += v;
                    }
                }
            }
        }
        if self.rows.moving {
            for j in 0..k.min(priors.len()) {
                let w = 1.0 / (priors[j].sd * priors[j].sd);
                h[(k + j, k + j)] += w;
                g[k + j] -= w * (s.waves[j].direction - priors[j].mean);
            }
        }
        (h, g)
    }

    /// Levenberg-Marquardt from `start`, at most `passes` passes over the record.
    pub fn refine(
        &mut self,
        start: Solution,
        priors: &[DirectionPrior],
        limits: (f64, f64),
        passes: usize,
    ) -> Solution {
        let mut best = start;
        let mut damping = 1e-3;
        let bound = STEP_BINS * core::f64::consts::TAU / self.rows.span_s.max(1.0);
        for _ in 0..passes {
            let k = best.waves.len();
            if k == 0 {
                break;
            }
            let (mut h, g) = self.normal_equations(&best, priors);
            for i in 0..h.nrows() {
                h[(i, i)] = h[(i, i)] * (1.0 + damping) + 1e-9;
            }
            let Some(step) = h.cholesky().map(|f| f.solve(&g)) else {
                damping *= 10.0;
                continue;
            };
            let moved: Vec<Wave> = (0..k)
                .map(|j| Wave {
                    omega: (best.waves[j].omega + step[j].clamp(-bound, bound)).clamp(limits.0, limits.1),
                    direction: best.waves[j].direction
                        + step
                            .get(k + j)
                            .map_or(0.0, |s| s.clamp(-STEP_DIRECTION, STEP_DIRECTION)),
                })
                .collect();
            match self.solve(&moved, priors) {
                Some(next) if next.cost < best.cost => {
                    let gain = (best.cost - next.cost) / best.cost.max(1e-30);
                    best = next;
                    damping = (damping * 0.2).max(1e-6);
                    if gain < 1e-4 {
                        break;
                    }
                }
                Some(_) | None => damping = (damping * 20.0).max(0.05),
            }
        }
        best
    }

    /// Standard deviations of the frequencies and, if they are in the fit, of the directions, for
    /// white residuals of the weights' variance.
    pub fn deviations(&self, s: &Solution, priors: &[DirectionPrior]) -> Option<DVector<f64>> {
        if s.waves.is_empty() {
            return None;
        }
        let (h, _) = self.normal_equations(s, priors);
        let inverse = h.cholesky()?.inverse();
        Some(inverse.diagonal().map(|v| v.max(0.0).sqrt()))
    }

    /// Residuals of `s` at every row of the record.
    pub fn residuals(&mut self, s: &Solution, out: &mut [Vec<f64>; CHANNELS]) {
        self.fill_columns(&s.waves);
        for c in [1, 2, 0] {
            if c == 0 && self.rows.moving {
                self.scale_to_acceleration(&s.waves);
            }
            out[c].clear();
            out[c].extend_from_slice(&self.rows.y[c]);
            for (a, column) in s.coefficients[c].iter().zip(&self.columns) {
                for (o, x) in out[c].iter_mut().zip(column) {
                    *o -= a * x;
                }
            }
        }
    }
}

/// Which of `parts` channel `c` belongs to: the acceleration has its own on a moving vessel.
fn part_of(c: usize, parts: usize) -> usize {
    usize::from(c == 0 && parts == 2)
}

impl Solution {
    /// Offset and trend of channel `c` at the end of the record.
    pub fn level_at_end(&self, c: usize) -> f64 {
        self.coefficients[c][0] + self.coefficients[c][1]
    }
    /// Phasor of channel `c` of component `j` at the middle of the record: `Re(p e^{i phi})`.
    pub fn phasor(&self, c: usize, j: usize) -> Complex<f64> {
        Complex::new(
            self.coefficients[c][DRIFT + 2 * j],
            -self.coefficients[c][DRIFT + 2 * j + 1],
        )
    }
    /// Variance of a phasor's real or imaginary part per unit of noise variance.
    pub fn phasor_variance(&self, j: usize) -> f64 {
        0.5 * (self.inverse[(DRIFT + 2 * j, DRIFT + 2 * j)]
            + self.inverse[(DRIFT + 2 * j + 1, DRIFT + 2 * j + 1)])
    }
}
