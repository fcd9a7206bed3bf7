//! One chain's constrained problem: sparse multiple shooting for Clarabel, with a fixed structure.
//!
//! Variables per stage k: absolute input `u_k`, state `x_(k+1)`, and one slack `s_k` shared by the stage's state limits
//! and measured in fractions of each limit. Inputs and their increments have hard limits. States have soft limits with
//! a linear and a quadratic cost of slack, because with hard state limits 2.5 % of closed-loop problems have no
//! solution (measured). A chain whose position is bounded on both sides has a separate slack for the position; a shared
//! slack failed to limit tilt and speed on the wrong side of a bound.

use clarabel::{
    algebra::CscMatrix,
    solver::{
        DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT,
    },
};
use nalgebra::SVector;

use alight_shared::msg::Solve;

use super::{condensed::StageCost, model::DiscreteModel};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainLimits<const N: usize> {
    /// Hard bounds of the virtual input (deviation from hover).
    pub input: [f64; 2],
    /// Hard bound of the input's change per stage.
    pub slew: f64,
    /// Soft bound of each state's magnitude.
    pub state: [Option<f64>; N],
    /// Whether the first state has a separate soft upper bound at each stage (height above the water).
    pub ceiling: bool,
    /// Whether the first state has a separate soft lower bound at each stage.
    pub floor: bool,
}

/// Cost per unit of slack (the size of a limit), linear and quadratic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlackCost {
    pub linear: f64,
    pub quadratic: f64,
}

/// Value of a missing ceiling, m: far beyond the reach of a horizon.
pub const NO_CEILING: f64 = 1.0e3;
/// Size of one unit of slack at the ceiling, m; small, so that violating the minimum altitude is expensive.
pub const CEILING_SLACK_M: f64 = 0.1;
/// Size of one unit of the position's separate slack, m.
const PLACE_SLACK_M: f64 = 1.0;
/// Cost of the slack of speed, tilt and rate as a multiple of that of the separate position slack.
const MOTION_OVER_PLACE: f64 = 100.0;
/// Tolerated violation at the unconstrained optimum, in the limit's unit: the solver's feasibility tolerance.
pub(super) const TOLERANCE: f64 = 1e-9;
/// Maximum number of interior-point iterations; 7 to 15 are needed.
const MAX_ITERATIONS: u32 = 40;

impl<const N: usize> ChainLimits<N> {
    fn width(&self) -> usize {
        N + 2 + usize::from(self.floor)
    }
    /// Clips rounding errors to the hard limits; leaves a non-finite input unchanged.
    pub(super) fn clip(&self, previous_input: f64, inputs: &mut [f64]) {
        let (mut before, slew) = (previous_input, self.slew);
        for u in inputs.iter_mut().filter(|u| u.is_finite()) {
            *u = u
                .clamp(before - slew, before + slew)
                .clamp(self.input[0], self.input[1]);
            before = *u;
        }
    }
    /// Whether inputs and states satisfy all limits (`states[k]` follows `inputs[k]`).
    pub fn hold(
        &self,
        previous_input: f64,
        inputs: &[f64],
        states: &[SVector<f64, N>],
        [floor, ceiling]: [&[f64]; 2],
    ) -> bool {
        let mut before = previous_input;
        for (k, (u, x)) in inputs.iter().zip(states).enumerate() {
            let in_range = *u >= self.input[0] - TOLERANCE && *u <= self.input[1] + TOLERANCE;
            let slow = (u - before).abs() <= self.slew + TOLERANCE;
            if !in_range || !slow {
                return false;
            }
            before = *u;
            for (value, limit) in x.iter().zip(&self.state) {
                if let Some(limit) = limit
                    && !(value.abs() <= limit + TOLERANCE)
                {
                    return false;
                }
            }
            if self.ceiling && !ceiling.get(k).is_none_or(|top| x[0] <= top + TOLERANCE) {
                return false;
            }
            if self.floor && !floor.get(k).is_none_or(|low| x[0] >= low - TOLERANCE) {
                return false;
            }
        }
        true
    }
}

#[derive(Clone, Copy, Debug)]
pub struct QpInstance<'a, const N: usize> {
    pub state: SVector<f64, N>,
    pub previous_input: f64,
    pub cost: &'a [StageCost<N>],
    /// Upper bound of the first state per stage if the chain has one ([`NO_CEILING`]: unbounded).
    pub ceiling: &'a [f64],
    /// Lower bound of the first state per stage if the chain has one.
    pub floor: &'a [f64],
}

/// Indices of the variables of each stage: input, state, slack of the motion, and slack of a position with a floor.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChainLayout<const N: usize> {
    width: usize,
    /// 1 if the position has a separate slack, otherwise 0.
    pub place: usize,
    /// Cost of the motion's slack relative to the position's.
    pub motion_cost: f64,
    /// Size of one unit of the position's slack, m.
    pub unit_m: f64,
}

impl<const N: usize> ChainLayout<N> {
    pub fn of(limits: &ChainLimits<N>) -> Self {
        let (place, motion_cost, unit_m) = if limits.floor {
            (1, MOTION_OVER_PLACE, PLACE_SLACK_M)
        } else {
            (0, 1.0, CEILING_SLACK_M)
        };
        ChainLayout {
            width: limits.width(),
            place,
            motion_cost,
            unit_m,
        }
    }
    fn input(&self, k: usize) -> usize {
        k * self.width
    }
    fn state(&self, k: usize) -> usize {
        k * self.width + 1
    }
    fn slack(&self, k: usize) -> usize {
        k * self.width + 1 + N
    }
    fn place_slack(&self, k: usize) -> usize {
        self.slack(k) + self.place
    }

    /// `P`: inputs tridiagonal (squared increments), states diagonal (`Q`, explicit even if zero), slacks diagonal.
    /// Also returns the index of each stage's `Q` in its values.
    fn quadratic(
        &self,
        stages: usize,
        increment_weight: f64,
        slack: SlackCost,
    ) -> (CscMatrix<f64>, Vec<usize>) {
        let (mut colptr, mut rowval, mut nzval) = (vec![0], Vec::new(), Vec::new());
        let mut weight_at = Vec::with_capacity(stages);
        let r2 = 2.0 * increment_weight;
        for k in 0..stages {
            if k > 0 {
                rowval.push(self.input(k - 1));
                nzval.push(-r2);
            }
            rowval.push(self.input(k));
            nzval.push(if k + 1 < stages { 2.0 * r2 } else { r2 });
            colptr.push(rowval.len());
            weight_at.push(nzval.len());
            for i in 0..N {
                rowval.push(self.state(k) + i);
                nzval.push(2.0);
                colptr.push(rowval.len());
            }
            for (i, cost) in [self.motion_cost, 1.0]
                .into_iter()
                .take(1 + self.place)
                .enumerate()
            {
                rowval.push(self.slack(k) + i);
                nzval.push(2.0 * cost * slack.quadratic);
                colptr.push(rowval.len());
            }
        }
        let variables = stages * self.width;
        (
            CscMatrix::new(variables, variables, colptr, rowval, nzval),
            weight_at,
        )
    }
}

#[derive(Default)]
struct Constraints {
    rows: Vec<usize>,
    cols: Vec<usize>,
    values: Vec<f64>,
    b: Vec<f64>,
}

impl Constraints {
    fn set(&mut self, row: usize, col: usize, value: f64) {
        self.rows.push(row);
        self.cols.push(col);
        self.values.push(value);
    }
    /// Appends the row `entries . v <= bound`.
    fn row<const M: usize>(&mut self, entries: [(usize, f64); M], bound: f64) {
        for (col, value) in entries {
            self.set(self.b.len(), col, value);
        }
        self.b.push(bound);
    }

    /// Appends `x_k+1 - A x_k - B u_k = 0`, with the current state on the right-hand side.
    fn dynamics<const N: usize>(&mut self, at: &ChainLayout<N>, model: &DiscreteModel<N, 1>, stages: usize) {
        for k in 0..stages {
            for i in 0..N {
                let row = k * N + i;
                self.set(row, at.state(k) + i, 1.0);
                self.set(row, at.input(k), -model.b[i]);
                for j in (0..N).filter(|j| k > 0 && model.a[(i, *j)] != 0.0) {
                    self.set(row, at.state(k - 1) + j, -model.a[(i, j)]);
                }
            }
        }
    }

    /// Appends the limits of input, slew, slacks, position and states; returns the index of their first row.
    fn limits<const N: usize>(&mut self, at: &ChainLayout<N>, limits: &ChainLimits<N>, k: usize) -> usize {
        let first = self.b.len();
        let u = at.input(k);
        for (sign, bound) in [(1.0, limits.input[1]), (-1.0, -limits.input[0])] {
            self.row([(u, sign)], bound);
        }
        for sign in [1.0, -1.0] {
            if k > 0 {
                self.row([(u, sign), (at.input(k - 1), -sign)], limits.slew);
            } else {
                self.row([(u, sign)], limits.slew);
            }
        }
        for i in 0..=at.place {
            self.row([(at.slack(k) + i, -1.0)], 0.0);
        }
        for (bounded, sign) in [(limits.ceiling, 1.0), (limits.floor, -1.0)] {
            if bounded {
                let slack = (at.place_slack(k), -at.unit_m);
                self.row([(at.state(k), sign), slack], NO_CEILING);
            }
        }
        for (i, limit) in limits.state.iter().enumerate() {
            if let Some(limit) = limit {
                for sign in [1.0, -1.0] {
                    self.row([(at.state(k) + i, sign), (at.slack(k), -limit)], *limit);
                }
            }
        }
        first
    }
}

/// Problem data of fixed structure, in Clarabel's form `min x'Px/2 + q'x, Ax + s = b`.
#[derive(Clone, Debug)]
pub struct SparseForm<const N: usize> {
    stages: usize,
    limits: ChainLimits<N>,
    increment_weight: f64,
    slack: SlackCost,
    model: DiscreteModel<N, 1>,
    /// Quadratic cost, upper triangle.
    pub p: CscMatrix<f64>,
    pub q: Vec<f64>,
    /// Constraints: dynamics first, then inequalities.
    pub a: CscMatrix<f64>,
    pub b: Vec<f64>,
    pub equalities: usize,
    /// Index of the diagonal element of `P` for each stage's first state.
    weight_at: Vec<usize>,
    /// Index of the first inequality row of each stage.
    row_at: Vec<usize>,
}

impl<const N: usize> SparseForm<N> {
    pub fn new(
        model: DiscreteModel<N, 1>,
        stages: usize,
        increment_weight: f64,
        limits: ChainLimits<N>,
        slack: SlackCost,
    ) -> Self {
        let layout = ChainLayout::<N>::of(&limits);
        let variables = stages * layout.width;
        let (p, weight_at) = layout.quadratic(stages, increment_weight, slack);
        let equalities = stages * N;
        let mut constraints = Constraints {
            b: vec![0.0; equalities],
            ..Constraints::default()
        };
        constraints.dynamics(&layout, &model, stages);
        let row_at = (0..stages)
            .map(|k| constraints.limits(&layout, &limits, k))
            .collect();
        let Constraints {
            rows,
            cols,
            values,
            b,
        } = constraints;
        let a = CscMatrix::new_from_triplets(b.len(), variables, rows, cols, values);
        let mut q = vec![0.0; variables];
        for k in 0..stages {
            q[layout.slack(k)] = layout.motion_cost * slack.linear;
            if limits.floor {
                q[layout.place_slack(k)] = slack.linear;
            }
        }
        SparseForm {
            stages,
            limits,
            increment_weight,
            slack,
            model,
            p,
            q,
            a,
            b,
            equalities,
            weight_at,
            row_at,
        }
    }

    pub fn fill(&mut self, instance: &QpInstance<'_, N>) {
        let width = self.limits.width();
        for (k, cost) in instance.cost.iter().take(self.stages).enumerate() {
            for i in 0..N {
                self.p.nzval[self.weight_at[k] + i] = 2.0 * cost.weight[i];
                self.q[k * width + 1 + i] = -2.0 * cost.weight[i] * cost.reference[i];
            }
            // Skips the rows of input (two), slew (two) and slacks.
            let row = self.row_at[k] + 5 + usize::from(self.limits.floor);
            if self.limits.ceiling {
                self.b[row] = instance.ceiling.get(k).copied().unwrap_or(NO_CEILING);
            }
            if self.limits.floor {
                let row = row + usize::from(self.limits.ceiling);
                self.b[row] = -instance.floor.get(k).copied().unwrap_or(-NO_CEILING);
            }
        }
        self.q[0] = -2.0 * self.increment_weight * instance.previous_input;
        let first = self.model.a * instance.state;
        self.b[..N].copy_from_slice(first.as_slice());
        self.b[self.row_at[0] + 2] = self.limits.slew + instance.previous_input;
        self.b[self.row_at[0] + 3] = self.limits.slew - instance.previous_input;
    }

    fn cones(&self) -> [SupportedConeT<f64>; 2] {
        [
            ZeroConeT(self.equalities),
            NonnegativeConeT(self.b.len() - self.equalities),
        ]
    }
}

pub struct ChainSolver<const N: usize> {
    form: SparseForm<N>,
    /// None if Clarabel rejected the structure, which a validated configuration excludes.
    solver: Option<DefaultSolver<f64>>,
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: MAX_ITERATIONS,
        presolve_enable: false,
        direct_solve_method: "qdldl".into(),
        max_threads: 1,
        iterative_refinement_enable: false,
        // A tenth of the default: with 1e-8, inputs of equal cost differed by 0.4 % of their range.
        tol_gap_abs: 1e-9,
        tol_gap_rel: 1e-9,
        max_step_fraction: 0.999,
        ..DefaultSettings::default()
    }
}

impl<const N: usize> ChainSolver<N> {
    pub fn new(form: SparseForm<N>) -> Self {
        let solver = DefaultSolver::new(&form.p, &form.q, &form.a, &form.b, &form.cones(), settings()).ok();
        ChainSolver { form, solver }
    }

    /// Writes the inputs, which satisfy the hard limits exactly. Also returns the number of iterations.
    pub fn solve(&mut self, instance: &QpInstance<'_, N>, inputs: &mut [f64]) -> (Solve, u32) {
        self.form.fill(instance);
        let form = &self.form;
        let Some(solver) = &mut self.solver else {
            return (Solve::Infeasible, 0);
        };
        let updated = solver.update_P(&form.p.nzval).is_ok()
            && solver.update_q(&form.q).is_ok()
            && solver.update_b(&form.b).is_ok();
        if !updated {
            return (Solve::Infeasible, 0);
        }
        solver.solve();
        let found = solver.solution.x.iter().step_by(form.limits.width());
        inputs.iter_mut().zip(found).for_each(|(u, x)| *u = *x);
        form.limits.clip(instance.previous_input, inputs);
        let ending = if inputs.iter().all(|u| u.is_finite()) {
            verdict(solver.solution.status)
        } else {
            Solve::Infeasible
        };
        (ending, solver.solution.iterations)
    }
}

fn verdict(status: SolverStatus) -> Solve {
    match status {
        SolverStatus::Solved => Solve::Optimal,
        SolverStatus::AlmostSolved
        | SolverStatus::MaxIterations
        | SolverStatus::MaxTime
        | SolverStatus::CallbackTerminated
        | SolverStatus::InsufficientProgress => Solve::IterationLimit,
        SolverStatus::Unsolved
        | SolverStatus::PrimalInfeasible
        | SolverStatus::DualInfeasible
        | SolverStatus::AlmostPrimalInfeasible
        | SolverStatus::AlmostDualInfeasible
        | SolverStatus::NumericalError => Solve::Infeasible,
    }
}

impl<const N: usize> core::fmt::Debug for ChainSolver<N> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("ChainSolver")
            .field("stages", &self.form.stages)
            .field("slack", &self.form.slack)
            .finish_non_exhaustive()
    }
}
