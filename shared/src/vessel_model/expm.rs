//! Matrix exponential and Van Loan's discretisation, using faer.

use faer::{Mat, linalg::solvers::Solve};
use nalgebra::DMatrix;

/// `exp(A)` by scaling and squaring with the diagonal Padé approximant of order 6 (Golub and Van Loan 2013,
/// algorithm 9.3.1); below a norm of 1/2 its error is below 1e-15.
pub fn expm(a: &Mat<f64>) -> Mat<f64> {
    // Padé coefficients c_k = q! (2q - k)! / ((2q)! k! (q - k)!) for q = 6.
    const C: [f64; 7] = [
        1.0,
        0.5,
        5.0 / 44.0,
        1.0 / 66.0,
        1.0 / 792.0,
        1.0 / 15_840.0,
        1.0 / 665_280.0,
    ];
    let n = a.nrows();
    let norm = (0..n)
        .map(|i| (0..n).map(|j| a[(i, j)].abs()).sum::<f64>())
        .fold(0.0, f64::max);
    // 2^60 is far beyond any model that passes the configuration check.
    let squarings = if norm > 0.5 {
        ((norm / 0.5).log2().ceil() as i32).clamp(0, 60)
    } else {
        0
    };
    let scale = 0.5_f64.powi(squarings);
    let a1 = Mat::from_fn(n, n, |i, j| a[(i, j)] * scale);
    let a2 = &a1 * &a1;
    let a4 = &a2 * &a2;
    let a6 = &a4 * &a2;
    let unit = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
    let even = Mat::from_fn(n, n, |i, j| {
        C[0] * unit(i, j) + C[2] * a2[(i, j)] + C[4] * a4[(i, j)] + C[6] * a6[(i, j)]
    });
    let odd = &a1
        * Mat::from_fn(n, n, |i, j| {
            C[1] * unit(i, j) + C[3] * a2[(i, j)] + C[5] * a4[(i, j)]
        });
    let mut e = (&even - &odd).partial_piv_lu().solve(&even + &odd);
    for _ in 0..squarings {
        e = &e * &e;
    }
    e
}

/// Exact discretisation of `x_dot = F x + w` with spectral density `W` over `dt` seconds (Van Loan 1978): for
/// `exp([[-F, W], [0, F']] dt) = [[., B], [0, C]]`, `A = C'` and `Q = A B`.
pub fn van_loan(f: &DMatrix<f64>, w: &DMatrix<f64>, dt: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let n = f.nrows();
    let m = Mat::from_fn(2 * n, 2 * n, |i, j| {
        dt * match (i < n, j < n) {
            (true, true) => -f[(i, j)],
            (true, false) => w[(i, j - n)],
            (false, true) => 0.0,
            (false, false) => f[(j - n, i - n)],
        }
    });
    let e = expm(&m);
    let a = DMatrix::from_fn(n, n, |i, j| e[(n + j, n + i)]);
    let b = DMatrix::from_fn(n, n, |i, j| e[(i, n + j)]);
    let mut q = &a * b;
    crate::estimation::symmetrise(&mut q);
    (a, q)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expm_of_a_rotation_generator() {
        let m = Mat::from_fn(2, 2, |i, j| match (i, j) {
            (0, 1) => 3.0,
            (1, 0) => -3.0,
            _ => 0.0,
        });
        let e = expm(&m);
        assert!((e[(0, 0)] - 3.0_f64.cos()).abs() < 1e-13);
        assert!((e[(0, 1)] - 3.0_f64.sin()).abs() < 1e-13);
    }

    #[test]
    fn van_loan_double_integrator() {
        let f = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 0.0, 0.0]);
        let w = DMatrix::from_row_slice(2, 2, &[0.0, 0.0, 0.0, 2.0]);
        let dt = 0.7;
        let (a, q) = van_loan(&f, &w, dt);
        assert!((a[(0, 1)] - dt).abs() < 1e-14 && (a[(0, 0)] - 1.0).abs() < 1e-14);
        assert!((q[(0, 0)] - 2.0 * dt.powi(3) / 3.0).abs() < 1e-13);
        assert!((q[(0, 1)] - 2.0 * dt.powi(2) / 2.0).abs() < 1e-13);
        assert!((q[(1, 1)] - 2.0 * dt).abs() < 1e-13);
    }
}
