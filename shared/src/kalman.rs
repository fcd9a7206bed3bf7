//! A Kalman filter for systems whose transition is mostly zeros: prediction by the non-zero
//! entries, Joseph update by a Cholesky solve (no inverse), a scalar path for sequential updates,
//! innovation gates and the consistency figures NIS and NEES.
//!
//! Notation (Bar-Shalom, Li, Kirubarajan 2001): state `x` (n), covariance `P` (n x n), transition
//! `A`, process noise `Q`, measurement `z = H x + v`, `v ~ (0, R)`, innovation `nu = z - H x`,
//! `S = H P H' + R`, gain `K = P H' S^-1`.

use nalgebra::{DMatrix, DVector};

/// A transition matrix stored by rows without its zeros.
#[derive(Clone, Debug, Default)]
pub struct Transition {
    starts: Vec<usize>,
    entries: Vec<(usize, f64)>,
}

impl Transition {
    /// From a square matrix; exact zeros are left out.
    pub fn from_dense(a: &DMatrix<f64>) -> Self {
        let mut t = Transition {
            starts: vec![0],
            entries: Vec::new(),
        };
        for i in 0..a.nrows() {
            for j in 0..a.ncols() {
                let v = a[(i, j)];
                if v != 0.0 {
                    t.entries.push((j, v));
                }
            }
            t.starts.push(t.entries.len());
        }
        t
    }
    /// Dimension of the state.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }
    /// No state at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// The non-zero entries of row `i`: (column, value).
    pub fn row(&self, i: usize) -> &[(usize, f64)] {
        match (self.starts.get(i), self.starts.get(i + 1)) {
            (Some(&a), Some(&b)) => self.entries.get(a..b).unwrap_or(&[]),
            _ => &[],
        }
    }
}

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Update {
    /// Fused. `nis` is the normalised innovation squared, `nu' S^-1 nu`.
    Fused {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// The gate refused it: state and covariance are untouched.
    Gated {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// Not finite, of wrong size, or `S` not positive definite: untouched.
    Invalid,
}

impl Update {
    /// It was fused.
    pub const fn fused(self) -> bool {
        matches!(self, Update::Fused { .. })
    }
}

/// Mean and covariance of a Gaussian belief, with scratch memory so that no step allocates.
#[derive(Clone, Debug)]
pub struct Gaussian {
    /// Mean.
    pub x: DVector<f64>,
    /// Covariance, symmetric.
    pub p: DMatrix<f64>,
    scratch: DMatrix<f64>,
    column: DVector<f64>,
}

impl Gaussian {
    /// Zero mean, given standard deviations, uncorrelated.
    pub fn new(sd: &[f64]) -> Self {
        let n = sd.len();
        Gaussian {
            x: DVector::zeros(n),
            p: DMatrix::from_fn(n, n, |i, j| if i == j { sd[i] * sd[i] } else { 0.0 }),
            scratch: DMatrix::zeros(n, n),
            column: DVector::zeros(n),
        }
    }
    /// From mean and covariance.
    pub fn from_moments(x: DVector<f64>, p: DMatrix<f64>) -> Self {
        let n = x.len();
        Gaussian {
            x,
            p,
            scratch: DMatrix::zeros(n, n),
            column: DVector::zeros(n),
        }
    }
    /// Dimension.
    pub fn len(&self) -> usize {
        self.x.len()
    }
    /// No state at all.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
    /// Every number is finite.
    pub fn is_finite(&self) -> bool {
        self.x.iter().chain(self.p.iter()).all(|v| v.is_finite())
    }

    /// Propagates the mean only: `x <- A x`.
    pub fn predict_mean(&mut self, a: &Transition) {
        let n = self.len().min(a.len());
        for i in 0..n {
            self.column[i] = a.row(i).iter().map(|&(j, v)| v * self.x[j]).sum();
        }
        self.x.copy_from(&self.column);
    }

    /// `x <- A x`, `P <- A P A' + Q`, in about `2 n nnz(A)` operations.
    pub fn predict(&mut self, a: &Transition, q: &DMatrix<f64>) {
        let n = self.len();
        if a.len() != n || q.nrows() != n {
            return;
        }
        self.predict_mean(a);
        // scratch = P A' by columns; P symmetric, so its columns are contiguous.
        multiply_rows(a, &self.p, &mut self.scratch);
        // (P A')' = A P; then P <- (A P) A' by columns.
        self.scratch.transpose_to(&mut self.p);
        core::mem::swap(&mut self.p, &mut self.scratch);
        multiply_rows(a, &self.scratch, &mut self.p);
        self.p += q;
        self.symmetrise();
    }

    /// Replaces `P` by `(P + P') / 2`.
    pub fn symmetrise(&mut self) {
        symmetrise(&mut self.p);
    }

    /// `P h` for a sparse row `h` of (index, gain), into the scratch column; returns `h P h'`.
    pub fn project(&mut self, h: &[(usize, f64)]) -> f64 {
        self.column.fill(0.0);
        for &(i, g) in h {
            if i < self.len() {
                self.column.axpy(g, &self.p.column(i), 1.0);
            }
        }
        h.iter()
            .map(|&(i, g)| g * self.column.get(i).copied().unwrap_or(0.0))
            .sum()
    }

    /// Fuses with the last [`Gaussian::project`]ed row: `x += P h' nu / S`,
    /// `P -= P h' h P / S`. With the optimal gain this equals the Joseph form; it is symmetric by
    /// construction. `s` may exceed `h P h' + r` when the innovation carries further independent
    /// errors.
    pub fn fuse_projected(&mut self, innovation: f64, s: f64) {
        let k = 1.0 / s;
        self.x.axpy(innovation * k, &self.column, 1.0);
        let n = self.len();
        for j in 0..n {
            let f = -self.column[j] * k;
            if f != 0.0 {
                self.p.column_mut(j).axpy(f, &self.column, 1.0);
            }
        }
        for i in 0..n {
            // Rounding must not turn a variance negative.
            if self.p[(i, i)] < 0.0 {
                self.p[(i, i)] = 0.0;
            }
        }
    }

    /// Fuses one scalar with sparse row `h`, given its innovation and variance `r`; refused when
    /// the normalised innovation squared exceeds `gate`.
    pub fn update_scalar(&mut self, h: &[(usize, f64)], innovation: f64, r: f64, gate: f64) -> Update {
        let s = self.project(h) + r;
        if !(s > 0.0 && s.is_finite() && innovation.is_finite()) {
            return Update::Invalid;
        }
        let nis = innovation * innovation / s;
        if !(nis <= gate) {
            return Update::Gated { nis };
        }
        self.fuse_projected(innovation, s);
        Update::Fused { nis }
    }

    /// Fuses `m` measurements at once in Joseph's form
    /// `P <- (I - K H) P (I - K H)' + K R K'` with `K' = S^-1 H P` from a Cholesky solve.
    /// `h` is m x n, `r` is m x m.
    pub fn update(
        &mut self,
        h: &DMatrix<f64>,
        innovation: &DVector<f64>,
        r: &DMatrix<f64>,
        gate: f64,
    ) -> Update {
        let (m, n) = (h.nrows(), self.len());
        if h.ncols() != n || innovation.len() != m || r.nrows() != m || r.ncols() != m {
            return Update::Invalid;
        }
        if !innovation.iter().chain(r.iter()).all(|v| v.is_finite()) {
            return Update::Invalid;
        }
        let hp = h * &self.p;
        let mut s = &hp * h.transpose() + r;
        symmetrise(&mut s);
        let Some(factor) = s.cholesky() else {
            return Update::Invalid;
        };
        let nis = innovation.dot(&factor.solve(innovation));
        if !(nis <= gate) {
            return Update::Gated { nis };
        }
        let k = factor.solve(&hp).transpose();
        self.x += &k * innovation;
        let keep = DMatrix::identity(n, n) - &k * h;
        self.p = &keep * &self.p * keep.transpose() + &k * r * k.transpose();
        self.symmetrise();
        Update::Fused { nis }
    }

    /// Normalised estimation error squared of the sub-state `which` against `truth`:
    /// `e' P^-1 e`; None when that block of `P` is not positive definite.
    pub fn nees(&self, which: &[usize], truth: &[f64]) -> Option<f64> {
        if which.len() != truth.len() || which.iter().any(|&i| i >= self.len()) {
            return None;
        }
        let m = which.len();
        let e = DVector::from_fn(m, |i, _| self.x[which[i]] - truth[i]);
        let p = DMatrix::from_fn(m, m, |i, j| self.p[(which[i], which[j])]);
        Some(e.dot(&p.cholesky()?.solve(&e)))
    }
}

/// `out[:, i] = sum_c A[i, c] p[:, c]`, i.e. `p A'`.
fn multiply_rows(a: &Transition, p: &DMatrix<f64>, out: &mut DMatrix<f64>) {
    for i in 0..a.len() {
        let mut column = out.column_mut(i);
        let mut first = true;
        for &(c, v) in a.row(i) {
            if first {
                column.copy_from(&p.column(c));
                if v != 1.0 {
                    column *= v;
                }
                first = false;
            } else {
                column.axpy(v, &p.column(c), 1.0);
            }
        }
        if first {
            column.fill(0.0);
        }
    }
}

/// Replaces `p` by `(p + p') / 2`.
pub fn symmetrise(p: &mut DMatrix<f64>) {
    let n = p.nrows();
    for j in 0..n {
        for i in 0..j {
            let m = 0.5 * (p[(i, j)] + p[(j, i)]);
            p[(i, j)] = m;
            p[(j, i)] = m;
        }
    }
}

/// Quantile of the chi-square distribution with `dof` degrees of freedom at the standard normal
/// quantile `z` (e.g. 2.326 for 99 %), by Wilson and Hilferty (1931); within 1 % for `dof >= 3`.
pub fn chi_square_quantile(dof: f64, z: f64) -> f64 {
    let c = 2.0 / (9.0 * dof);
    dof * (1.0 - c + z * c.sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small deterministic normal generator (sum of 12 uniforms; xorshift, Marsaglia 2003).
    struct Noise(u64);
    impl Noise {
        fn next(&mut self) -> f64 {
            let mut sum = 0.0;
            for _ in 0..12 {
                self.0 ^= self.0 << 13;
                self.0 ^= self.0 >> 7;
                self.0 ^= self.0 << 17;
                sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
            }
            sum - 6.0
        }
    }

    fn spd(n: usize, noise: &mut Noise) -> DMatrix<f64> {
        let l = DMatrix::from_fn(n, n, |_, _| noise.next());
        &l * l.transpose() + DMatrix::identity(n, n)
    }

    #[test]
    fn joint_update_equals_the_information_form() {
        let mut noise = Noise(7);
        let (n, m) = (6, 3);
        let p = spd(n, &mut noise);
        let r = spd(m, &mut noise);
        let h = DMatrix::from_fn(m, n, |_, _| noise.next());
        let x = DVector::from_fn(n, |_, _| noise.next());
        let z = DVector::from_fn(m, |_, _| noise.next());
        // P+ = (P^-1 + H' R^-1 H)^-1, x+ = P+ (P^-1 x + H' R^-1 z).
        let (pi, ri) = (p.clone().try_inverse().unwrap(), r.clone().try_inverse().unwrap());
        let expected_p = (&pi + h.transpose() * &ri * &h).try_inverse().unwrap();
        let expected_x = &expected_p * (&pi * &x + h.transpose() * &ri * &z);
        let mut g = Gaussian::from_moments(x.clone(), p);
        assert!(g.update(&h, &(&z - &h * &x), &r, f64::INFINITY).fused());
        assert!((&g.p - expected_p).norm() < 1e-10);
        assert!((&g.x - expected_x).norm() < 1e-10);
    }

    #[test]
    fn sequential_scalars_equal_the_joint_update() {
        let mut noise = Noise(11);
        let n = 5;
        let p = spd(n, &mut noise);
        let x = DVector::from_fn(n, |_, _| noise.next());
        let rows = [
            vec![(0, 1.0), (3, -0.5)],
            vec![(2, 2.0)],
            vec![(1, 0.3), (4, 1.0)],
        ];
        let r = [0.5, 0.2, 1.5];
        let z = [0.3, -0.4, 1.0];
        let h = DMatrix::from_fn(3, n, |i, j| {
            rows[i].iter().find(|e| e.0 == j).map_or(0.0, |e| e.1)
        });
        let mut joint = Gaussian::from_moments(x.clone(), p.clone());
        let innovation = DVector::from_row_slice(&z) - &h * &x;
        let rm = DMatrix::from_diagonal(&DVector::from_row_slice(&r));
        assert!(joint.update(&h, &innovation, &rm, f64::INFINITY).fused());
        let mut one = Gaussian::from_moments(x, p);
        for i in 0..3 {
            let predicted: f64 = rows[i].iter().map(|&(j, g)| g * one.x[j]).sum();
            assert!(
                one.update_scalar(&rows[i], z[i] - predicted, r[i], f64::INFINITY)
                    .fused()
            );
        }
        assert!((&one.p - &joint.p).norm() < 1e-10);
        assert!((&one.x - &joint.x).norm() < 1e-10);
    }

    #[test]
    fn sparse_prediction_equals_the_dense_product() {
        let mut noise = Noise(3);
        let n = 7;
        let a = DMatrix::from_fn(n, n, |i, j| if (i + 2 * j) % 3 == 0 { noise.next() } else { 0.0 });
        let (p, q) = (spd(n, &mut noise), spd(n, &mut noise));
        let x = DVector::from_fn(n, |_, _| noise.next());
        let mut g = Gaussian::from_moments(x.clone(), p.clone());
        g.predict(&Transition::from_dense(&a), &q);
        assert!((&g.x - &a * x).norm() < 1e-12);
        assert!((&g.p - (&a * p * a.transpose() + q)).norm() < 1e-10);
    }

    #[test]
    fn nees_and_nis_are_consistent_on_a_simulated_system() {
        // Constant velocity with white acceleration, position measured.
        let (dt, q, r) = (0.1, 0.5_f64, 0.04_f64);
        let a = DMatrix::from_row_slice(2, 2, &[1.0, dt, 0.0, 1.0]);
        let qd = DMatrix::from_row_slice(
            2,
            2,
            &[
                q * dt * dt * dt / 3.0,
                q * dt * dt / 2.0,
                q * dt * dt / 2.0,
                q * dt,
            ],
        );
        let l = qd.clone().cholesky().unwrap().l();
        let t = Transition::from_dense(&a);
        let mut noise = Noise(42);
        let (mut nees, mut nis, mut count) = (0.0, 0.0, 0);
        for _ in 0..50 {
            let mut truth = DVector::from_row_slice(&[noise.next(), noise.next()]);
            let mut g = Gaussian::new(&[1.0, 1.0]);
            for _ in 0..200 {
                truth = &a * truth + &l * DVector::from_fn(2, |_, _| noise.next());
                g.predict(&t, &qd);
                let z = truth[0] + r.sqrt() * noise.next();
                match g.update_scalar(&[(0, 1.0)], z - g.x[0], r, f64::INFINITY) {
                    Update::Fused { nis: v } => nis += v,
                    other => panic!("{other:?}"),
                }
                nees += g.nees(&[0, 1], truth.as_slice()).unwrap();
                count += 1;
            }
        }
        let (nees, nis) = (nees / f64::from(count), nis / f64::from(count));
        assert!((nees - 2.0).abs() < 0.12, "NEES {nees}");
        assert!((nis - 1.0).abs() < 0.05, "NIS {nis}");
    }

    #[test]
    fn update_leaves_the_state_on_a_gated_outlier() {
        let mut g = Gaussian::new(&[1.0, 1.0]);
        let before = g.clone();
        let gate = chi_square_quantile(1.0, 2.326);
        assert!(matches!(
            g.update_scalar(&[(0, 1.0)], 50.0, 0.1, gate),
            Update::Gated { .. }
        ));
        assert_eq!(g.update_scalar(&[(0, 1.0)], f64::NAN, 0.1, gate), Update::Invalid);
        assert_eq!((g.x, g.p), (before.x, before.p));
    }

    #[test]
    fn chi_square_quantiles_match_the_tables() {
        // Abramowitz and Stegun, table 26.8, P = 0.99.
        for (dof, expected) in [(3.0, 11.345), (6.0, 16.812), (12.0, 26.217)] {
            assert!((chi_square_quantile(dof, 2.326) / expected - 1.0).abs() < 0.01);
        }
    }
}
