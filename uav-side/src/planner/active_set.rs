//! Exact solver of one chain's constrained problem: the dual active-set method of Goldfarb and Idnani (1983), started
//! from the unconstrained optimum of [`super::condensed`].
//!
//! Constraints join the working set one at a time, the most violated first, and leave it when their multiplier reaches
//! zero. The increments follow from the images of the set's rows under the factor of H, and from the Cholesky factor of
//! the images' inner products. A soft constraint involves the slack of its stage (costs as in [`super::qp`]), which
//! stays at its bound of zero until a soft row joins.

use alight_shared::msg::Solve;

use super::{
    condensed::Condensed,
    model::DiscreteModel,
    qp::{ChainLayout, ChainLimits, QpInstance, SlackCost, TOLERANCE},
};

/// Maximum number of changes of the working set: landings need up to 15, the worst of 1500 random problems 386.
const MAX_CHANGES: u32 = 500;
/// Relative distance between a row's image and the working set's span below which the row counts as dependent.
const DEPENDENT: f64 = 1e-11;
/// Minimum quadratic cost of slack relative to the linear cost, because the method needs positive curvature.
const MIN_CURVATURE: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Bounded {
    Input,
    Slew,
    State(usize),
    /// First state, bounded by a ceiling or a floor.
    Place,
    /// Slack, bounded below by zero.
    Slack,
}

/// A constraint row: `sign * what <= bound + unit * slack`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    stage: usize,
    what: Bounded,
    sign: f64,
    /// Index of the slack; None for a hard row.
    slack: Option<usize>,
    unit: f64,
}

/// Slack with its cost in half the objective; `open` once one of its soft rows has joined the working set.
#[derive(Clone, Copy, Debug)]
struct Slack {
    linear: f64,
    quadratic: f64,
    open: bool,
    value: f64,
}

#[derive(Clone, Debug)]
pub(super) struct ActiveSet<const N: usize> {
    model: DiscreteModel<N, 1>,
    limits: ChainLimits<N>,
    stages: usize,
    at: ChainLayout<N>,
    /// Slacks of all stages, alternating between motion and position.
    slacks: Vec<Slack>,
    /// Working set, its multipliers, and the concatenated images of its rows.
    rows: Vec<Row>,
    multipliers: Vec<f64>,
    images: Vec<f64>,
    /// Lower Cholesky factor of the images' inner products, `capacity` columns wide.
    factor: Vec<f64>,
    capacity: usize,
    /// Data of the joining row: its image, its row of the factor, and the change of the set's multipliers per unit of
    /// the joining row's multiplier.
    image: Vec<f64>,
    joining: Vec<f64>,
    change: Vec<f64>,
    work: Vec<f64>,
}

impl<const N: usize> ActiveSet<N> {
    pub fn new(model: DiscreteModel<N, 1>, stages: usize, limits: ChainLimits<N>, cost: SlackCost) -> Self {
        let at = ChainLayout::<N>::of(&limits);
        let slack = |over: f64| Slack {
            linear: 0.5 * over * cost.linear,
            quadratic: over * cost.quadratic.max(MIN_CURVATURE * cost.linear),
            open: false,
            value: 0.0,
        };
        let capacity = 3 * stages;
        ActiveSet {
            model,
            limits,
            stages,
            slacks: [slack(at.motion_cost), slack(1.0)].repeat(stages),
            at,
            rows: Vec::with_capacity(capacity),
            multipliers: Vec::with_capacity(capacity),
            images: Vec::with_capacity(capacity * stages),
            factor: vec![0.0; capacity * capacity],
            capacity,
            image: vec![0.0; stages],
            joining: Vec::with_capacity(capacity),
            change: Vec::with_capacity(capacity),
            work: vec![0.0; stages],
        }
    }

    /// Writes the inputs, starting from the unconstrained optimum of `free`. Also returns the number of changes of the
    /// working set.
    pub fn solve(
        &mut self,
        free: &Condensed<N>,
        instance: &QpInstance<'_, N>,
        inputs: &mut [f64],
    ) -> (Solve, u32) {
        self.rows.clear();
        self.multipliers.clear();
        self.images.clear();
        self.slacks
            .iter_mut()
            .for_each(|s| (s.open, s.value) = (false, 0.0));
        let mut changes = 0;
        let ending = loop {
            self.primal(free, instance.previous_input, inputs);
            let Some((row, over)) = self.most_violated(instance, inputs) else {
                break Solve::Optimal;
            };
            if !self.join(free, row, over, &mut changes) {
                break Solve::IterationLimit;
            }
        };
        self.limits.clip(instance.previous_input, inputs);
        if inputs.iter().all(|u| u.is_finite()) {
            (ending, changes)
        } else {
            (Solve::Infeasible, changes)
        }
    }

    fn primal(&mut self, free: &Condensed<N>, previous_input: f64, inputs: &mut [f64]) {
        self.work.copy_from_slice(free.half());
        for slack in self.slacks.iter_mut().filter(|s| s.open) {
            slack.value = -slack.linear / slack.quadratic;
        }
        let images = self.images.chunks_exact(self.stages);
        for ((row, multiplier), image) in self.rows.iter().zip(&self.multipliers).zip(images) {
            self.work
                .iter_mut()
                .zip(image)
                .for_each(|(w, g)| *w -= multiplier * g);
            if let Some(i) = row.slack {
                self.slacks[i].value += row.unit * multiplier / self.slacks[i].quadratic;
            }
        }
        free.increments(&mut self.work);
        let mut u = previous_input;
        for (slot, increment) in inputs.iter_mut().zip(&self.work) {
            u += increment;
            *slot = u;
        }
    }

    /// Most violated row outside the set, and its violation. Early rows have a larger weight, because an early input
    /// determines which later rows are violated.
    fn most_violated(&self, instance: &QpInstance<'_, N>, inputs: &[f64]) -> Option<(Row, f64)> {
        let (limits, mut worst, mut most) = (&self.limits, None, 0.0);
        let mut consider = |row: Row, value: f64, bound: f64| {
            let over = row.sign * value - bound - row.unit * row.slack.map_or(0.0, |i| self.slacks[i].value);
            if over > TOLERANCE {
                let of = over / row.unit.abs().max(bound.abs()).max(TOLERANCE) / (row.stage as f64 + 1.0);
                if of > most && !self.rows.contains(&row) {
                    (worst, most) = (Some((row, over)), of);
                }
            }
        };
        let (mut before, mut x) = (instance.previous_input, instance.state);
        for (stage, u) in inputs.iter().enumerate() {
            x = self.model.step(&x, *u);
            let row = |what, sign| Row {
                stage,
                what,
                sign,
                slack: None,
                unit: 0.0,
            };
            consider(row(Bounded::Input, 1.0), *u, limits.input[1]);
            consider(row(Bounded::Input, -1.0), *u, -limits.input[0]);
            let (slack, place) = (2 * stage, 2 * stage + self.at.place);
            for sign in [1.0, -1.0] {
                consider(row(Bounded::Slew, sign), u - before, limits.slew);
                for (i, limit) in limits.state.iter().enumerate() {
                    if let Some(limit) = limit {
                        let row = Row {
                            slack: Some(slack),
                            unit: *limit,
                            ..row(Bounded::State(i), sign)
                        };
                        consider(row, x[i], *limit);
                    }
                }
            }
            before = *u;
            let bounds = [
                (limits.ceiling, 1.0, instance.ceiling),
                (limits.floor, -1.0, instance.floor),
            ];
            for (bounded, sign, bound) in bounds {
                if let Some(bound) = bound.get(stage).filter(|_| bounded) {
                    let row = Row {
                        slack: Some(place),
                        unit: self.at.unit_m,
                        ..row(Bounded::Place, sign)
                    };
                    consider(row, x[0], sign * bound);
                }
            }
            for i in [slack, slack + 1] {
                if self.slacks[i].open {
                    consider(Row::of_slack(i), 0.0, 0.0);
                }
            }
        }
        worst
    }

    /// Adds the row, and removes rows whose multipliers reach zero. Returns false after too many changes.
    fn join(&mut self, free: &Condensed<N>, row: Row, over: f64, changes: &mut u32) -> bool {
        if let Some(i) = row.slack.filter(|i| !self.slacks[*i].open) {
            // Until now the slack was at its bound, and its multiplier was its linear cost.
            self.slacks[i].open = true;
            self.image.fill(0.0);
            self.joining.clear();
            self.joining.resize(self.rows.len(), 0.0);
            let (multiplier, pivot) = (self.slacks[i].linear, self.slacks[i].quadratic.recip().sqrt());
            if !self.push(Row::of_slack(i), multiplier, pivot) {
                return false;
            }
        }
        self.write_image(free, &row);
        let (mut multiplier, mut left) = (0.0, over);
        loop {
            *changes += 1;
            let slope = self.direction(&row);
            let mut first = (f64::INFINITY, 0);
            for (i, (value, change)) in self.multipliers.iter().zip(&self.change).enumerate() {
                if *change < 0.0 && -value / change < first.0 {
                    first = (-value / change, i);
                }
            }
            let full = slope.map_or(f64::INFINITY, |slope| left / slope);
            let step = full.min(first.0);
            if !step.is_finite() || *changes > MAX_CHANGES {
                return false;
            }
            for (value, change) in self.multipliers.iter_mut().zip(&self.change) {
                *value += step * change;
            }
            multiplier += step;
            if full <= first.0 {
                return self.push(row, multiplier, slope.unwrap_or_default().sqrt());
            }
            left -= step * slope.unwrap_or_default();
            self.remove(first.1);
        }
    }

    fn write_image(&mut self, free: &Condensed<N>, row: &Row) {
        self.image.fill(0.0);
        let held = self.image.iter_mut().take(row.stage + 1);
        let response = free.response()[1..=row.stage + 1].iter().rev();
        match row.what {
            Bounded::Input => held.for_each(|v| *v = row.sign),
            Bounded::Slew => self.image[row.stage] = row.sign,
            Bounded::State(i) => held.zip(response).for_each(|(v, r)| *v = row.sign * r[i]),
            Bounded::Place => held.zip(response).for_each(|(v, r)| *v = row.sign * r[0]),
            Bounded::Slack => return,
        }
        free.image(&mut self.image);
    }

    /// Computes the change of the set's multipliers, per unit of the joining row's multiplier, that keeps the set's
    /// rows at their bounds. Returns the rate at which the joining row's violation decreases; None if the set leaves no
    /// freedom.
    fn direction(&mut self, row: &Row) -> Option<f64> {
        self.joining.clear();
        let images = self.images.chunks_exact(self.stages);
        for (i, (other, image)) in self.rows.iter().zip(images).enumerate() {
            let mut value = row.product(other, &self.slacks) + dot(&self.image, image);
            let factor = &self.factor[i * self.capacity..];
            value -= dot(&factor[..i], &self.joining);
            self.joining.push(value / factor[i]);
        }
        let own = row.product(row, &self.slacks) + dot(&self.image, &self.image);
        let slope = own - dot(&self.joining, &self.joining);
        self.change.clear();
        self.change.extend(self.joining.iter().map(|v| -v));
        for i in (0..self.change.len()).rev() {
            let factor = &self.factor[i * self.capacity..];
            let value = self.change[i] / factor[i];
            self.change[i] = value;
            for (v, f) in self.change[..i].iter_mut().zip(factor) {
                *v -= f * value;
            }
        }
        (slope > DEPENDENT * own).then_some(slope)
    }

    /// Returns false if the set is full.
    fn push(&mut self, row: Row, multiplier: f64, pivot: f64) -> bool {
        let n = self.rows.len();
        if n >= self.capacity {
            return false;
        }
        self.rows.push(row);
        self.multipliers.push(multiplier);
        self.images.extend_from_slice(&self.image);
        let factor = &mut self.factor[n * self.capacity..];
        factor[..n].copy_from_slice(&self.joining);
        factor[n] = pivot;
        true
    }

    /// Removes a row from the set; plane rotations restore the triangular factor.
    fn remove(&mut self, out: usize) {
        self.rows.remove(out);
        self.multipliers.remove(out);
        self.images.drain(out * self.stages..(out + 1) * self.stages);
        let (n, width) = (self.rows.len(), self.capacity);
        for i in out..n {
            self.factor
                .copy_within((i + 1) * width..(i + 1) * width + i + 2, i * width);
        }
        for c in out..n {
            let at = c * width + c;
            let length = self.factor[at].hypot(self.factor[at + 1]);
            let (cos, sin) = (self.factor[at] / length, self.factor[at + 1] / length);
            for i in c..n {
                let pair = &mut self.factor[i * width + c..];
                (pair[0], pair[1]) = (cos * pair[0] + sin * pair[1], cos * pair[1] - sin * pair[0]);
            }
        }
    }
}

impl Row {
    fn of_slack(i: usize) -> Self {
        Row {
            stage: i / 2,
            what: Bounded::Slack,
            sign: 1.0,
            slack: Some(i),
            unit: 1.0,
        }
    }
    /// Contribution of a shared slack to the inner product of two rows' images.
    fn product(&self, other: &Row, slacks: &[Slack]) -> f64 {
        let shared = self.slack.filter(|_| self.slack == other.slack);
        shared.map_or(0.0, |i| self.unit * other.unit / slacks[i].quadratic)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::{
        condensed::StageCost,
        model::HoverModel,
        qp::{ChainSolver, NO_CEILING, SparseForm},
    };
    use alight_shared::geometry::DroneGeometry;
    use nalgebra::SVector;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]
        #[test]
        fn active_set_against_interior_point(
            place in -5.0..5.0_f64, speed in -6.0..6.0_f64, tilt in -0.6..0.6_f64, previous in -0.3..0.3_f64,
            near in 0.0..4.0_f64, bounded in any::<bool>(), low in -3.0..0.5_f64, room in 0.2..3.0_f64,
        ) {
            let model = HoverModel::new(&DroneGeometry::default()).x_chain().discrete(0.1);
            let limits = ChainLimits {
                input: [-0.3, 0.3],
                slew: 0.25,
                state: [None, Some(8.0), Some(0.7), Some(2.0)],
                ceiling: bounded,
                floor: bounded,
            };
            let slack = SlackCost { linear: 1e4, quadratic: 1e4 };
            let cost: Vec<_> = (0..20).map(|k| StageCost {
                reference: SVector::from([place + 0.1 * speed * f64::from(k), speed, 0.1, 0.0]),
                weight: SVector::from([30.0, 5.0, 1.0 + 10f64.powf(near) * f64::from(k) / 20.0, 1.0]),
            }).collect();
            let (floor, ceiling) = ([low; 20], [if bounded { low + room } else { NO_CEILING }; 20]);
            let instance = QpInstance {
                state: SVector::from([0.0, 0.3 * speed, tilt, 0.0]),
                previous_input: previous,
                cost: &cost,
                ceiling: &ceiling,
                floor: &floor,
            };
            let mut free = Condensed::new(model, 20, 0.1);
            let (mut exact, mut interior) = ([0.0; 20], [0.0; 20]);
            prop_assert!(free.solve(&instance.state, previous, &cost, &mut exact));
            let mut set = ActiveSet::new(model, 20, limits, slack);
            let (ending, changes) = set.solve(&free, &instance, &mut exact);
            prop_assert!(ending == Solve::Optimal, "{ending:?} {changes}");
            let mut solver = ChainSolver::new(SparseForm::new(model, 20, 0.1, limits, slack));
            let (ending, _) = solver.solve(&instance, &mut interior);
            if ending == Solve::Optimal {
                for (k, (a, b)) in exact.iter().zip(&interior).enumerate() {
                    prop_assert!((a - b).abs() < 2e-3, "{k}: {a} {b}");
                }
            }
        }
    }
}
