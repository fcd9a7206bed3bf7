//! Reference solver for the benchmark and tests: the paper's eq. 6-7 as written, with all 12 states and 4
//! inputs, condensed to dense matrices at every solve and solved by Clarabel with default settings.

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus},
};
use nalgebra::{DMatrix, DVector, SMatrix};

/// Problem data, in the paper's state order `[p, euler, v, euler rates]`.
pub struct Data<'a> {
    pub a: SMatrix<f64, 12, 12>,
    pub b: SMatrix<f64, 12, 4>,
    pub state: [f64; 12],
    pub input: [f64; 4],
    pub reference: &'a [[f64; 12]],
    /// Diagonal of Q at each stage.
    pub weight: &'a [[f64; 12]],
    /// Soft upper bound of z at each stage.
    pub ceiling: &'a [f64],
    /// Violation of that bound per unit of slack, m.
    pub ceiling_slack: f64,
    /// Weight R of the input increments.
    pub increment_weight: f64,
    pub lowest: [f64; 4],
    pub highest: [f64; 4],
    pub slew: [f64; 4],
    /// Soft bounds of the states; infinite where a state is unbounded.
    pub limit: [f64; 12],
    /// Linear and quadratic cost of the slack.
    pub slack: [f64; 2],
    /// Clarabel's absolute and relative tolerance of the duality gap; its default is 1e-8.
    pub tolerance: f64,
}

/// Slack variable of each state's limit. Each stage has four: x, y, z, yaw.
const SLACK_OF: [usize; 12] = [0, 1, 2, 1, 0, 3, 0, 1, 2, 1, 0, 3];

struct Dense {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    free: DVector<f64>,
    response: DMatrix<f64>,
}

/// Builds `X = free + response dU`, and the Hessian and gradient of the cost in the increments dU.
fn condense(d: &Data<'_>) -> Dense {
    let n = d.reference.len();
    let mut free = DVector::zeros(12 * n);
    let mut response = DMatrix::zeros(12 * n, 4 * n);
    let u = nalgebra::SVector::<f64, 4>::from(d.input);
    let mut x = nalgebra::SVector::<f64, 12>::from(d.state);
    let mut held = vec![SMatrix::<f64, 12, 4>::zeros(); n + 1];
    for k in 0..n {
        held[k + 1] = d.a * held[k] + d.b;
        x = d.a * x + d.b * u;
        free.rows_mut(12 * k, 12).copy_from(&x);
        for j in 0..=k {
            response
                .view_mut((12 * k, 4 * j), (12, 4))
                .copy_from(&held[k + 1 - j]);
        }
    }
    let q = DVector::from_iterator(12 * n, d.weight.iter().flatten().copied());
    let r = DVector::from_iterator(12 * n, d.reference.iter().flatten().copied());
    let weighted = DMatrix::from_diagonal(&q) * &response;
    let hessian =
        2.0 * (response.transpose() * &weighted + DMatrix::identity(4 * n, 4 * n) * d.increment_weight);
    let gradient = 2.0 * weighted.transpose() * (&free - &r);
    Dense {
        hessian,
        gradient,
        free,
        response,
    }
}

fn inputs(d: &Data<'_>, increments: &[f64]) -> Vec<[f64; 4]> {
    let mut u = d.input;
    increments
        .chunks_exact(4)
        .map(|du| {
            for i in 0..4 {
                u[i] += du[i];
            }
            u
        })
        .collect()
}

/// Cost of an input sequence including slack, as both solvers minimise it.
pub fn cost(d: &Data<'_>, inputs: &[[f64; 4]]) -> f64 {
    let mut x = nalgebra::SVector::<f64, 12>::from(d.state);
    let mut before = d.input;
    let mut sum = 0.0;
    for (k, u) in inputs.iter().enumerate() {
        x = d.a * x + d.b * nalgebra::SVector::<f64, 4>::from(*u);
        let mut slack = [0.0_f64; 4];
        for i in 0..12 {
            sum += d.weight[k][i] * (x[i] - d.reference[k][i]).powi(2);
            if d.limit[i].is_finite() {
                let over = (x[i].abs() - d.limit[i]) / d.limit[i];
                slack[SLACK_OF[i]] = slack[SLACK_OF[i]].max(over);
            }
        }
        slack[2] = slack[2].max((x[2] - d.ceiling[k]) / d.ceiling_slack);
        for i in 0..4 {
            sum += d.increment_weight * (u[i] - before[i]).powi(2);
            sum += d.slack[0] * slack[i] + d.slack[1] * slack[i].powi(2);
        }
        before = *u;
    }
    sum
}

/// Optimum without limits; None if the Hessian is not positive definite.
pub fn unconstrained(d: &Data<'_>) -> Option<Vec<[f64; 4]>> {
    let dense = condense(d);
    let increments = dense.hessian.cholesky()?.solve(&-dense.gradient);
    Some(inputs(d, increments.as_slice()))
}

/// Optimum with limits; None if Clarabel does not solve it.
pub fn constrained(d: &Data<'_>) -> Option<Vec<[f64; 4]>> {
    let n = d.reference.len();
    let dense = condense(d);
    let moves = 4 * n;
    let all = 8 * n;
    let mut p = DMatrix::zeros(all, all);
    p.view_mut((0, 0), (moves, moves)).copy_from(&dense.hessian);
    let mut q = vec![d.slack[0]; all];
    q[..moves].copy_from_slice(dense.gradient.as_slice());
    for i in moves..all {
        p[(i, i)] = 2.0 * d.slack[1];
    }
    let mut rows: Vec<(DVector<f64>, f64)> = Vec::new();
    for k in 0..n {
        for i in 0..4 {
            let mut sum = DVector::zeros(all);
            for j in 0..=k {
                sum[4 * j + i] = 1.0;
            }
            rows.push((sum.clone(), d.highest[i] - d.input[i]));
            rows.push((-sum, d.input[i] - d.lowest[i]));
            for sign in [1.0, -1.0] {
                let mut row = DVector::zeros(all);
                row[4 * k + i] = sign;
                rows.push((row, d.slew[i]));
            }
            let mut positive = DVector::zeros(all);
            positive[moves + 4 * k + i] = -1.0;
            rows.push((positive, 0.0));
        }
        for s in 0..12 {
            let slack = moves + 4 * k + SLACK_OF[s];
            let mut base = DVector::zeros(all);
            base.rows_mut(0, moves)
                .copy_from(&dense.response.row(12 * k + s).transpose());
            let free = dense.free[12 * k + s];
            if d.limit[s].is_finite() {
                for sign in [1.0, -1.0] {
                    let mut row = &base * sign;
                    row[slack] = -d.limit[s];
                    rows.push((row, d.limit[s] - sign * free));
                }
            }
            if s == 2 {
                let mut row = base;
                row[slack] = -d.ceiling_slack;
                rows.push((row, d.ceiling[k] - free));
            }
        }
    }
    let mut a = DMatrix::zeros(rows.len(), all);
    let mut b = Vec::with_capacity(rows.len());
    for (i, (row, bound)) in rows.iter().enumerate() {
        a.row_mut(i).copy_from(&row.transpose());
        b.push(*bound);
    }
    let settings = DefaultSettings {
        verbose: false,
        tol_gap_abs: d.tolerance,
        tol_gap_rel: d.tolerance,
        ..DefaultSettings::default()
    };
    let p = sparse(&p, true);
    let a = sparse(&a, false);
    let mut solver = DefaultSolver::new(&p, &q, &a, &b, &[NonnegativeConeT(b.len())], settings).ok()?;
    solver.solve();
    (solver.solution.status == SolverStatus::Solved).then(|| inputs(d, &solver.solution.x[..moves]))
}

fn sparse(m: &DMatrix<f64>, upper: bool) -> CscMatrix<f64> {
    let mut colptr = vec![0];
    let mut rowval = Vec::new();
    let mut nzval = Vec::new();
    for j in 0..m.ncols() {
        for i in 0..m.nrows() {
            if m[(i, j)] != 0.0 && (!upper || i <= j) {
                rowval.push(i);
                nzval.push(m[(i, j)]);
            }
        }
        colptr.push(rowval.len());
    }
    CscMatrix::new(m.nrows(), m.ncols(), colptr, rowval, nzval)
}
