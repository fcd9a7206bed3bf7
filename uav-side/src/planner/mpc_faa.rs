//! The paper's planner, section III of Procházka et al. 2024:
//!
//! - eq. 4-5: the model, linear about hover ([`super::model`]);
//! - eq. 6: minimise over the increments of the inputs
//!   `sum_k (x_k - r_k)' Q_k (x_k - r_k) + du_k' R du_k`, no terminal cost;
//! - Q with Forcing Attitude Alignment ([`super::weights`]);
//! - eq. 7: limits of inputs and increments (hard), of tilt, velocity and rates (soft).
//!
//! Each chain is first solved exactly without limits ([`super::condensed`]). In the paper's planner a chain whose
//! optimum exceeds a limit is passed to Clarabel ([`super::qp`]). Alight's planner uses the active-set solver
//! (`active_set`) instead, as do problems that Clarabel does not solve.
//!
//! Axes: NED. Tilt is measured about north and east (`phi`, `theta` of the body rotated back by its yaw), so the hover
//! model at yaw 0 is correct at every heading.

use alight_shared::{geometry::DroneGeometry, msg::Solve};
use nalgebra::SVector;

use super::{
    active_set::ActiveSet,
    condensed::{Condensed, StageCost},
    config::{PlannerConfig, PlannerKind},
    model::{Chain, DiscreteModel, HoverModel, INPUTS, ModelState, state},
    qp::{ChainLimits, ChainSolver, NO_CEILING, QpInstance, SlackCost, SparseForm},
};

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Problem {
    pub state: ModelState,
    /// Virtual input applied now: thrust, roll, pitch, yaw, as deviations from hover.
    pub input: [f64; INPUTS],
    /// References of stages 1..=N.
    pub reference: Vec<ModelState>,
    /// Diagonal of Q, stages 1..=N.
    pub weight: Vec<ModelState>,
    /// Soft upper bound of z (NED, so the minimum height) at stages 1..=N, m.
    pub ceiling: Vec<f64>,
    pub sides: Vec<Side>,
}

/// Half-space that must contain a stage's position: `n . (x, y, z) >= b`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// Index of the stage in [`Problem::reference`].
    pub stage: usize,
    /// Normal `n`, pointing towards the drone's side.
    pub normal: [f64; 3],
    /// Offset `b`, m.
    pub offset: f64,
}

impl Side {
    /// Horizontal axis closest to the normal.
    fn axis(&self) -> usize {
        usize::from(self.normal[1].abs() > self.normal[0].abs())
    }
    /// Narrows the bounds of this axis, given the planned values of the other two.
    fn bound(&self, axis: usize, states: &[ModelState], [low, high]: &mut [Vec<f64>; 2]) {
        let (n, across) = (self.normal[axis], self.normal[1 - axis]);
        let (Some(state), Some(low), Some(high)) = (
            states.get(self.stage),
            low.get_mut(self.stage),
            high.get_mut(self.stage),
        ) else {
            return;
        };
        let place = (self.offset - across * state[1 - axis] - self.normal[2] * state[state::DOWN]) / n;
        if n > 0.0 {
            *low = low.max(place);
        } else {
            *high = high.min(place);
        }
    }
}

impl Problem {
    pub fn alignment(&self) -> f64 {
        self.weight.first().map_or(0.0, |w| w[3])
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Solution {
    /// Worst result of the four chains.
    pub solve: Solve,
    /// Solver iterations over all chains; 0 on the fast path.
    pub iterations: u32,
    /// Virtual inputs, held over each stage.
    pub inputs: Vec<[f64; INPUTS]>,
    /// States at the end of each stage.
    pub states: Vec<ModelState>,
}

/// For each chain, the indices of its states in the paper's state vector, and the index of its input.
const X: ([usize; 4], usize) = ([0, 6, 4, 10], 2);
const Y: ([usize; 4], usize) = ([1, 7, 3, 9], 1);
const Z: ([usize; 2], usize) = ([2, 8], 0);
const YAW: ([usize; 2], usize) = ([5, 11], 3);

#[derive(Debug)]
pub struct Mpc {
    stages: usize,
    step_s: f64,
    model: HoverModel,
    x: ChainMpc<4>,
    y: ChainMpc<4>,
    bounded: [ChainMpc<4>; 2],
    z: ChainMpc<2>,
    yaw: ChainMpc<2>,
    half: Roller,
}

impl Mpc {
    pub fn new(config: &PlannerConfig, drone: &DroneGeometry) -> Self {
        let model = heading_free(drone);
        let bounds = config.rotors.bounds(drone);
        let [slew_thrust, slew_roll, slew_pitch, slew_yaw] = config.rotors.slew(config.step_s);
        let l = &config.limits;
        let (tilt, rate) = (l.tilt_deg.to_radians(), l.rates_rps);
        let horizontal = [None, Some(l.horizontal_mps), Some(tilt), Some(rate)];
        let tilting = |slew, bounded| ChainLimits {
            input: [-bounds.tilt, bounds.tilt],
            slew,
            state: horizontal,
            ceiling: bounded,
            floor: bounded,
        };
        let vertical = ChainLimits {
            input: bounds.thrust,
            slew: slew_thrust,
            state: [None, Some(l.vertical_mps)],
            ceiling: true,
            floor: false,
        };
        let turning = ChainLimits {
            input: [-bounds.yaw, bounds.yaw],
            slew: slew_yaw,
            state: [None, Some(rate)],
            ceiling: false,
            floor: false,
        };
        Mpc {
            stages: config.stages,
            step_s: config.step_s,
            model,
            x: ChainMpc::new(model.x_chain(), X, tilting(slew_pitch, false), config),
            y: ChainMpc::new(model.y_chain(), Y, tilting(slew_roll, false), config),
            bounded: [
                ChainMpc::new(model.x_chain(), X, tilting(slew_pitch, true), config),
                ChainMpc::new(model.y_chain(), Y, tilting(slew_roll, true), config),
            ],
            z: ChainMpc::new(model.z_chain(), Z, vertical, config),
            yaw: ChainMpc::new(model.yaw_chain(), YAW, turning, config),
            half: Roller::new(&model, 0.5 * config.step_s),
        }
    }

    pub fn stages(&self) -> usize {
        self.stages
    }
    pub fn step_s(&self) -> f64 {
        self.step_s
    }
    /// Model with the larger tilt inertia about both axes.
    pub fn model(&self) -> &HoverModel {
        &self.model
    }
    pub fn limits(&self) -> (ChainLimits<4>, ChainLimits<4>, ChainLimits<2>, ChainLimits<2>) {
        (self.x.limits, self.y.limits, self.z.limits, self.yaw.limits)
    }

    /// Writes `ceiling(k, x, y)`, the bound of z at stage k+1 at the planned position, into the problem.
    pub fn solve(
        &mut self,
        problem: &mut Problem,
        mut ceiling: impl FnMut(usize, f64, f64) -> f64,
        solution: &mut Solution,
    ) {
        let n = self.stages;
        solution.solve = Solve::Optimal;
        solution.iterations = 0;
        solution.inputs.clear();
        solution.inputs.resize(n, [0.0; INPUTS]);
        solution.states.clear();
        solution.states.resize(n, problem.state);
        if problem.reference.len() != n || problem.weight.len() != n {
            solution.solve = Solve::Infeasible;
            return;
        }
        problem.ceiling.clear();
        problem.ceiling.resize(n, NO_CEILING);
        self.x.solve(problem, [&[], &[]], solution);
        // Both tilts have the same inertia.
        self.y.fast.adopt_factor(&self.x.fast);
        self.y.solve(problem, [&[], &[]], solution);
        if !problem.sides.is_empty() {
            self.keep_clear(problem, solution);
        }
        for k in 0..n {
            problem.ceiling[k] = ceiling(k, solution.states[k][0], solution.states[k][1]);
        }
        self.z.solve(problem, [&[], &problem.ceiling], solution);
        self.yaw.solve(problem, [&[], &[]], solution);
    }

    /// Keeps x and y clear of the volumes. Each axis is solved with z and the other axis fixed, and once more if the
    /// other axis has moved.
    fn keep_clear(&mut self, problem: &Problem, solution: &mut Solution) {
        self.z.solve(problem, [&[], &[]], solution);
        let mut due = [0, 1].map(|axis| problem.sides.iter().any(|s| s.axis() == axis));
        let bounded = due;
        for axis in [0, 1, 0, 1] {
            if !core::mem::take(&mut due[axis]) {
                continue;
            }
            let mut bounds = [f64::NEG_INFINITY, f64::INFINITY].map(|none| vec![none; self.stages]);
            for side in problem.sides.iter().filter(|s| s.axis() == axis) {
                side.bound(axis, &solution.states, &mut bounds);
            }
            let [low, high] = &bounds;
            let chain = &mut self.bounded[axis];
            chain.fast.adopt_factor(&self.x.fast);
            chain.solve(problem, [low, high], solution);
            due[1 - axis] = bounded[1 - axis];
        }
    }

    pub fn half_step(&self, state: &ModelState, input: &[f64; INPUTS]) -> ModelState {
        self.half.step(state, input)
    }
    /// State `time_s` later.
    pub fn roll(&self, state: &ModelState, input: &[f64; INPUTS], time_s: f64) -> ModelState {
        Roller::new(&self.model, time_s).step(state, input)
    }
}

/// Hover model for axes that do not rotate with the body. Both tilts get the larger inertia, so that the torque limits
/// hold at every heading.
pub fn heading_free(drone: &DroneGeometry) -> HoverModel {
    let model = HoverModel::new(drone);
    let weaker = model.roll.min(model.pitch);
    HoverModel {
        roll: weaker,
        pitch: weaker,
        ..model
    }
}

/// All four chains, discretised over one duration.
#[derive(Clone, Copy, Debug)]
struct Roller {
    x: DiscreteModel<4, 1>,
    y: DiscreteModel<4, 1>,
    z: DiscreteModel<2, 1>,
    yaw: DiscreteModel<2, 1>,
}

impl Roller {
    fn new(model: &HoverModel, time_s: f64) -> Self {
        Roller {
            x: model.x_chain().discrete(time_s),
            y: model.y_chain().discrete(time_s),
            z: model.z_chain().discrete(time_s),
            yaw: model.yaw_chain().discrete(time_s),
        }
    }
    fn step(&self, state: &ModelState, input: &[f64; INPUTS]) -> ModelState {
        let mut next = *state;
        scatter(&X.0, &self.x.step(&gather(&X.0, state), input[X.1]), &mut next);
        scatter(&Y.0, &self.y.step(&gather(&Y.0, state), input[Y.1]), &mut next);
        scatter(&Z.0, &self.z.step(&gather(&Z.0, state), input[Z.1]), &mut next);
        scatter(
            &YAW.0,
            &self.yaw.step(&gather(&YAW.0, state), input[YAW.1]),
            &mut next,
        );
        next
    }
}

fn gather<const N: usize>(index: &[usize; N], full: &ModelState) -> SVector<f64, N> {
    SVector::from_fn(|i, _| full[index[i]])
}
fn scatter<const N: usize>(index: &[usize; N], part: &SVector<f64, N>, full: &mut ModelState) {
    for i in 0..N {
        full[index[i]] = part[i];
    }
}

#[derive(Debug)]
struct ChainMpc<const N: usize> {
    index: [usize; N],
    input: usize,
    model: DiscreteModel<N, 1>,
    limits: ChainLimits<N>,
    fast: Condensed<N>,
    exact: ActiveSet<N>,
    /// Interior-point solver, only in the paper's planner.
    interior: Option<ChainSolver<N>>,
    cost: Vec<StageCost<N>>,
    floor: Vec<f64>,
    ceiling: Vec<f64>,
    inputs: Vec<f64>,
    states: Vec<SVector<f64, N>>,
}

impl<const N: usize> ChainMpc<N> {
    fn new(
        chain: Chain<N>,
        (index, input): ([usize; N], usize),
        limits: ChainLimits<N>,
        config: &PlannerConfig,
    ) -> Self {
        let (n, r) = (config.stages, config.increment_weight);
        let model = chain.discrete(config.step_s);
        let slack = SlackCost {
            linear: config.limits.slack_linear,
            quadratic: config.limits.slack_quadratic,
        };
        ChainMpc {
            index,
            input,
            model,
            limits,
            fast: Condensed::new(model, n, r),
            exact: ActiveSet::new(model, n, limits, slack),
            interior: (config.kind == PlannerKind::MpcFaa)
                .then(|| ChainSolver::new(SparseForm::new(model, n, r, limits, slack))),
            cost: Vec::with_capacity(n),
            floor: vec![-NO_CEILING; n],
            ceiling: vec![NO_CEILING; n],
            inputs: vec![0.0; n],
            states: vec![SVector::zeros(); n],
        }
    }

    fn solve(&mut self, problem: &Problem, [floor, ceiling]: [&[f64]; 2], solution: &mut Solution) {
        // Positions relative to the current one keep precision far from the origin.
        let origin = problem.state[self.index[0]];
        let local = |full: &ModelState| {
            let mut x = gather(&self.index, full);
            x[0] -= origin;
            x
        };
        let x0 = local(&problem.state);
        let previous = problem.input[self.input].clamp(self.limits.input[0], self.limits.input[1]);
        self.cost.clear();
        self.cost.extend(
            problem
                .reference
                .iter()
                .zip(&problem.weight)
                .map(|(r, w)| StageCost {
                    reference: local(r),
                    weight: gather(&self.index, w),
                }),
        );
        let local_bound = |given: Option<&f64>, none: f64| {
            given.map_or(none, |g| (g - origin).clamp(-NO_CEILING, NO_CEILING))
        };
        for (k, (low, high)) in self.floor.iter_mut().zip(&mut self.ceiling).enumerate() {
            *low = local_bound(floor.get(k), -NO_CEILING);
            *high = local_bound(ceiling.get(k), NO_CEILING);
        }

        let solved = self.fast.solve(&x0, previous, &self.cost, &mut self.inputs);
        self.roll(&x0);
        if !solved
            || !self
                .limits
                .hold(previous, &self.inputs, &self.states, [&self.floor, &self.ceiling])
        {
            let instance = QpInstance {
                state: x0,
                previous_input: previous,
                cost: &self.cost,
                ceiling: &self.ceiling,
                floor: &self.floor,
            };
            let inputs = &mut self.inputs;
            let interior = self.interior.as_mut().map(|i| i.solve(&instance, inputs));
            let (mut ending, iterations) = interior.unwrap_or((Solve::Infeasible, 0));
            solution.iterations += iterations;
            if solved && ending != Solve::Optimal {
                let changes;
                (ending, changes) = self.exact.solve(&self.fast, &instance, inputs);
                solution.iterations += changes;
            }
            solution.solve = worse(solution.solve, ending);
            self.roll(&x0);
        }
        for k in 0..self.states.len() {
            self.states[k][0] += origin;
            scatter(&self.index, &self.states[k], &mut solution.states[k]);
            solution.inputs[k][self.input] = self.inputs[k];
        }
    }

    fn roll(&mut self, x0: &SVector<f64, N>) {
        let mut x = *x0;
        for (u, slot) in self.inputs.iter().zip(&mut self.states) {
            x = self.model.step(&x, *u);
            *slot = x;
        }
    }
}

fn worse(a: Solve, b: Solve) -> Solve {
    match (a, b) {
        (Solve::Infeasible, _) | (_, Solve::Infeasible) => Solve::Infeasible,
        (Solve::IterationLimit, _) | (_, Solve::IterationLimit) => Solve::IterationLimit,
        (Solve::Optimal, Solve::Optimal) => Solve::Optimal,
    }
}
