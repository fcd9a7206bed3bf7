//! Kalman filter with a sparse transition; updates are scalar and sequential.
//!
//! Notation (Bar-Shalom, Li, Kirubarajan 2001): state `x` (n), covariance `P` (n x n), transition
//! `A`, process noise `Q`, measurement `z = h x + v`, `v ~ (0, r)`, innovation `nu = z - h x`,
//! `S = h P h' + r`, gain `K = P h' / S`.

use nalgebra::{DMatrix, DVector};

/// Transition matrix stored by rows, non-zero entries only.
#[derive(Clone, Debug, Default)]
pub struct LinearTransition {
    starts: Vec<usize>,
    entries: Vec<(usize, f64)>,
}

impl LinearTransition {
    /// Builds a transition from a square matrix; exact zeros are dropped.
    pub fn from_dense(a: &DMatrix<f64>) -> Self {
        let mut t = LinearTransition {
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
    /// Whether the state is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Non-zero entries of row `i`: (column, value).
    pub fn row(&self, i: usize) -> &[(usize, f64)] {
        match (self.starts.get(i), self.starts.get(i + 1)) {
            (Some(&a), Some(&b)) => self.entries.get(a..b).unwrap_or(&[]),
            _ => &[],
        }
    }
}

/// Outcome of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Update {
    /// Fused. `nis` is the normalised innovation squared, `nu' S^-1 nu`.
    Fused {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// Rejected by the gate; state and covariance are unchanged.
    Rejected {
        /// Normalised innovation squared.
        nis: f64,
    },
    /// Not finite, of wrong size, or `S` not positive definite; state and covariance are unchanged.
    Invalid,
}

impl Update {
    /// Whether the measurement was fused.
    pub const fn fused(self) -> bool {
        matches!(self, Update::Fused { .. })
    }
}

/// Mean and covariance of a Gaussian belief, with scratch memory to avoid allocation in each step.
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
    /// Zero mean and uncorrelated components with these standard deviations.
    pub fn new(sd: &[f64]) -> Self {
        let n = sd.len();
        Gaussian {
            x: DVector::zeros(n),
            p: DMatrix::from_fn(n, n, |i, j| if i == j { sd[i] * sd[i] } else { 0.0 }),
            scratch: DMatrix::zeros(n, n),
            column: DVector::zeros(n),
        }
    }
    /// Dimension of the state.
    pub fn len(&self) -> usize {
        self.x.len()
    }
    /// Whether the state is empty.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        // No short circuit, so that the processor tests eight values at a time.
        let all = |values: &[f64]| values.iter().fold(true, |ok, v| ok & v.is_finite());
        all(self.x.as_slice()) & all(self.p.as_slice())
    }

    /// Propagates the mean only: `x <- A x`.
    pub fn predict_mean(&mut self, a: &LinearTransition) {
        let n = self.len().min(a.len());
        for i in 0..n {
            self.column[i] = a.row(i).iter().map(|&(j, v)| v * self.x[j]).sum();
        }
        self.x.copy_from(&self.column);
    }

    /// `x <- A x`, `P <- A P A' + Q`, in about `2 n nnz(A)` operations.
    pub fn predict(&mut self, a: &LinearTransition, q: &DMatrix<f64>) {
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
        let n = self.len();
        for &(i, g) in h {
            if i < n {
                add_scaled(
                    self.column.as_mut_slice(),
                    g,
                    &self.p.as_slice()[i * n..(i + 1) * n],
                );
            }
        }
        h.iter()
            .map(|&(i, g)| g * self.column.get(i).copied().unwrap_or(0.0))
            .sum()
    }

    /// Fuses a measurement with the row last passed to [`Gaussian::project`]: `x += P h' nu / S`, and
    /// [`reduce_covariance`]. `s` exceeds `h P h' + r` if the innovation has other independent errors.
    pub fn fuse_projected(&mut self, innovation: f64, s: f64) {
        self.x.axpy(innovation * (1.0 / s), &self.column, 1.0);
        let n = self.len();
        let columns = self.p.as_mut_slice().chunks_exact_mut(n.max(1));
        reduce_covariance(columns, self.column.as_slice(), s);
    }
}

/// Covariance after a scalar measurement, `P -= P h' h P / S`, in `n²` operations. `columns` are those (or
/// the rows) of `P` and `projected` is `P h'`, of length n. With the optimal gain this equals the Joseph form
/// and stays symmetric (Bar-Shalom, Li, Kirubarajan 2001, section 5.2).
pub fn reduce_covariance<'a>(columns: impl Iterator<Item = &'a mut [f64]>, projected: &[f64], s: f64) {
    let k = 1.0 / s;
    for (i, (column, c)) in columns.zip(projected).enumerate() {
        let f = -c * k;
        if f != 0.0 {
            add_scaled(column, f, projected);
        }
        // Rounding must not turn a variance negative.
        if let Some(variance) = column.get_mut(i).filter(|v| **v < 0.0) {
            *variance = 0.0;
        }
    }
}

/// `out[:, i] = sum_c A[i, c] p[:, c]`, i.e. `p A'`.
fn multiply_rows(a: &LinearTransition, p: &DMatrix<f64>, out: &mut DMatrix<f64>) {
    let n = p.nrows();
    for (i, to) in out.as_mut_slice().chunks_exact_mut(n.max(1)).enumerate() {
        let mut terms = a
            .row(i)
            .iter()
            .map(|&(c, v)| (v, &p.as_slice()[c * n..(c + 1) * n]));
        match terms.next() {
            Some((v, column)) => to.iter_mut().zip(column).for_each(|(t, p)| *t = v * p),
            None => to.fill(0.0),
        }
        for (v, column) in terms {
            add_scaled(to, v, column);
        }
    }
}

/// `to += f column`, on slices for vectorisation.
#[inline]
fn add_scaled(to: &mut [f64], f: f64, column: &[f64]) {
    for (t, c) in to.iter_mut().zip(column) {
        *t += f * c;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic normal generator (sum of 12 uniforms; xorshift, Marsaglia 2003).
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

    /// Fuses `z` with row `h` and variance `r`. Returns the normalised innovation squared.
    fn fuse(g: &mut Gaussian, h: &[(usize, f64)], z: f64, r: f64) -> f64 {
        let innovation = z - h.iter().map(|&(j, gain)| gain * g.x[j]).sum::<f64>();
        let s = g.project(h) + r;
        g.fuse_projected(innovation, s);
        innovation * innovation / s
    }

    #[test]
    fn sequential_update_against_information_form() {
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
        // P+ = (P^-1 + H' R^-1 H)^-1, x+ = P+ (P^-1 x + H' R^-1 z).
        let pi = p.clone().try_inverse().unwrap();
        let ri = DMatrix::from_diagonal(&DVector::from_row_slice(&r.map(|v: f64| 1.0 / v)));
        let expected_p = (&pi + h.transpose() * &ri * &h).try_inverse().unwrap();
        let expected_x = &expected_p * (&pi * &x + h.transpose() * &ri * DVector::from_row_slice(&z));
        let mut g = Gaussian::new(&[0.0; 5]);
        g.x = x;
        g.p = p;
        for i in 0..3 {
            fuse(&mut g, &rows[i], z[i], r[i]);
        }
        assert!((&g.p - expected_p).norm() < 1e-10);
        assert!((&g.x - expected_x).norm() < 1e-10);
    }

    #[test]
    fn sparse_prediction_against_dense_product() {
        let mut noise = Noise(3);
        let n = 7;
        let a = DMatrix::from_fn(n, n, |i, j| if (i + 2 * j) % 3 == 0 { noise.next() } else { 0.0 });
        let p = spd(n, &mut noise);
        let q = spd(n, &mut noise);
        let x = DVector::from_fn(n, |_, _| noise.next());
        let mut g = Gaussian::new(&[0.0; 7]);
        g.x = x.clone();
        g.p = p.clone();
        g.predict(&LinearTransition::from_dense(&a), &q);
        assert!((&g.x - &a * x).norm() < 1e-12);
        assert!((&g.p - (&a * p * a.transpose() + q)).norm() < 1e-10);
    }

    #[test]
    fn nees_and_nis_on_a_simulated_system() {
        // Constant velocity with white acceleration, position measured.
        let dt = 0.1;
        let q = 0.5_f64;
        let r = 0.04_f64;
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
        let t = LinearTransition::from_dense(&a);
        let mut noise = Noise(42);
        let mut nees = 0.0;
        let mut nis = 0.0;
        let mut count = 0;
        for _ in 0..50 {
            let mut truth = DVector::from_row_slice(&[noise.next(), noise.next()]);
            let mut g = Gaussian::new(&[1.0, 1.0]);
            for _ in 0..200 {
                truth = &a * truth + &l * DVector::from_fn(2, |_, _| noise.next());
                g.predict(&t, &qd);
                let z = truth[0] + r.sqrt() * noise.next();
                nis += fuse(&mut g, &[(0, 1.0)], z, r);
                let e = &g.x - &truth;
                nees += e.dot(&g.p.clone().cholesky().unwrap().solve(&e));
                count += 1;
            }
        }
        let nees = nees / f64::from(count);
        let nis = nis / f64::from(count);
        assert!((nees - 2.0).abs() < 0.12, "NEES {nees}");
        assert!((nis - 1.0).abs() < 0.05, "NIS {nis}");
    }
}
