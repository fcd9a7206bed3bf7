//! One axis of MPC-NE: a triple integrator with jerk as input and a barrier in height.

use nalgebra::{SMatrix, SVector};

pub const STAGES: usize = 10;
/// Maximum number of Newton steps; problems without a barrier need one or two.
const NEWTON_STEPS: usize = 12;
const HALVINGS: usize = 8;
/// Penalty weight on the square of a limit's excess; larger than the cost of the barrier.
const LIMIT_WEIGHT: f64 = 5000.0;

pub type PerStage = [f64; STAGES];

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisProblem {
    /// Initial position, velocity and acceleration: m, m/s, m/s².
    pub start: [f64; 3],
    /// Initial jerk, m/s³.
    pub previous: f64,
    /// Reference positions, m.
    pub position: PerStage,
    /// Reference velocities, m/s; the velocity limit is relative to them.
    pub velocity: PerStage,
    /// S: weights of the position and velocity errors.
    pub weight: [f64; 2],
    /// T: weight of the jerk's increments.
    pub increment_weight: f64,
    /// Soft limits: velocity relative to the reference, acceleration, jerk.
    pub limit: [f64; 3],
}

/// `weight_k f(deck_k - z_k)`: cost of the deck's tilt as a function of the height above it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Barrier {
    /// `alpha_L (roll² + pitch²)` at each stage.
    pub weight: PerStage,
    /// Vertical position z of a drone on the deck, at each stage, m.
    pub contact: PerStage,
    /// h_d: height of the barrier, m.
    pub height_m: f64,
}

/// `f(z)` of Gupta et al. and its first two derivatives: 1 between h_d and a point just above the deck; 0 far
/// above the deck and on it.
pub fn shape(height: f64, stands_at: f64) -> (f64, f64, f64) {
    let (x, width) = if height >= 0.16 {
        ((height - stands_at) / 0.15, -0.15)
    } else {
        (-(height - 0.1) / 0.01, 0.01)
    };
    // f = 1 / (1 + e^x); its derivative with respect to height is f (1 - f) / width.
    let f = 1.0 / (1.0 + x.clamp(-60.0, 60.0).exp());
    let slope = f * (1.0 - f) / width;
    (f, slope, slope * (1.0 - 2.0 * f) / width)
}

/// Responses of position, velocity and acceleration to a unit jerk held for one step, by the number of stages
/// since that step.
#[derive(Clone, Copy, Debug)]
pub struct JerkAxis {
    step: f64,
    response: [[f64; STAGES]; 3],
}

impl JerkAxis {
    pub fn new(step: f64) -> Self {
        let h = step;
        let by = |k: usize| {
            let d = (k + 1) as f64 * h;
            let e = k as f64 * h;
            [(d.powi(3) - e.powi(3)) / 6.0, (d.powi(2) - e.powi(2)) / 2.0, h]
        };
        JerkAxis {
            step,
            response: core::array::from_fn(|i| core::array::from_fn(|k| by(k)[i])),
        }
    }

    /// `[p, v, a]` after a constant jerk for the time `t`.
    pub fn roll([p, v, a]: [f64; 3], jerk: f64, t: f64) -> [f64; 3] {
        [
            p + t * (v + t * (0.5 * a + t * jerk / 6.0)),
            v + t * (a + 0.5 * t * jerk),
            a + t * jerk,
        ]
    }

    pub fn states(&self, start: [f64; 3], jerk: &PerStage) -> [[f64; 3]; STAGES] {
        let mut x = start;
        jerk.map(|u| {
            x = Self::roll(x, u, self.step);
            x
        })
    }

    fn cost(&self, problem: &AxisProblem, barrier: Option<&Barrier>, jerk: &PerStage) -> f64 {
        let over = |x: f64, limit: f64| (x.abs() - limit).max(0.0).powi(2) * LIMIT_WEIGHT;
        let mut sum = 0.0;
        let mut before = problem.previous;
        for (k, (x, u)) in self.states(problem.start, jerk).iter().zip(jerk).enumerate() {
            let e = x[0] - problem.position[k];
            let d = x[1] - problem.velocity[k];
            sum += problem.weight[0] * e * e + problem.weight[1] * d * d;
            sum += problem.increment_weight * (u - before).powi(2);
            sum +=
                over(d, problem.limit[0]) + over(x[2], problem.limit[1]) + 0.01 * over(*u, problem.limit[2]);
            if let Some(b) = barrier {
                sum += b.weight[k] * shape(b.contact[k] - x[0], b.height_m).0;
            }
            before = *u;
        }
        sum
    }

    /// Jerks of minimum cost, and the number of steps. Newton's method from `guess` with the convex part of
    /// the Hessian; a halving line search ensures that the cost never increases.
    pub fn solve(
        &self,
        problem: &AxisProblem,
        barrier: Option<&Barrier>,
        guess: &PerStage,
    ) -> (PerStage, u32) {
        let mut u = *guess;
        let mut cost = self.cost(problem, barrier, &u);
        let mut steps = 0;
        for _ in 0..NEWTON_STEPS {
            let (gradient, hessian) = self.derivatives(problem, barrier, &u);
            let Some(factor) = hessian.cholesky() else {
                break;
            };
            let direction = factor.solve(&gradient);
            let mut fraction = 1.0;
            let mut taken = None;
            for _ in 0..HALVINGS {
                let tried: PerStage = core::array::from_fn(|i| u[i] - fraction * direction[i]);
                let c = self.cost(problem, barrier, &tried);
                if c < cost {
                    taken = Some((tried, c));
                    break;
                }
                fraction *= 0.5;
            }
            let Some((tried, c)) = taken else {
                break;
            };
            steps += 1;
            let gain = cost - c;
            u = tried;
            cost = c;
            if gain < 1e-6 * (1.0 + cost) {
                break;
            }
        }
        (u, steps)
    }

    fn derivatives(
        &self,
        problem: &AxisProblem,
        barrier: Option<&Barrier>,
        jerk: &PerStage,
    ) -> (SVector<f64, STAGES>, SMatrix<f64, STAGES, STAGES>) {
        let mut g = SVector::<f64, STAGES>::zeros();
        let mut h = SMatrix::<f64, STAGES, STAGES>::zeros();
        let over = |x: f64, limit: f64| {
            let beyond = (x.abs() - limit).max(0.0);
            (
                2.0 * LIMIT_WEIGHT * beyond * x.signum(),
                if beyond > 0.0 { 2.0 * LIMIT_WEIGHT } else { 0.0 },
            )
        };
        for (k, x) in self.states(problem.start, jerk).iter().enumerate() {
            let e = x[0] - problem.position[k];
            let d = x[1] - problem.velocity[k];
            let mut slope = [2.0 * problem.weight[0] * e, 2.0 * problem.weight[1] * d, 0.0];
            let mut bend = [2.0 * problem.weight[0], 2.0 * problem.weight[1], 0.0];
            let (s, b) = over(d, problem.limit[0]);
            slope[1] += s;
            bend[1] += b;
            (slope[2], bend[2]) = over(x[2], problem.limit[1]);
            if let Some(b) = barrier {
                // Height decreases as z increases, hence the sign.
                let (_, first, second) = shape(b.contact[k] - x[0], b.height_m);
                slope[0] -= b.weight[k] * first;
                bend[0] += (b.weight[k] * second).max(0.0);
            }
            for i in 0..=k {
                let r: [f64; 3] = core::array::from_fn(|n| self.response[n][k - i]);
                g[i] += (0..3).map(|n| r[n] * slope[n]).sum::<f64>();
                for j in 0..=k {
                    h[(i, j)] += (0..3)
                        .map(|n| r[n] * bend[n] * self.response[n][k - j])
                        .sum::<f64>();
                }
            }
        }
        let t = 2.0 * problem.increment_weight;
        for k in 0..STAGES {
            let before = if k == 0 { problem.previous } else { jerk[k - 1] };
            let step = jerk[k] - before;
            g[k] += t * step;
            h[(k, k)] += t;
            if k > 0 {
                g[k - 1] -= t * step;
                h[(k - 1, k - 1)] += t;
                h[(k, k - 1)] -= t;
                h[(k - 1, k)] -= t;
            }
            let (s, b) = over(jerk[k], problem.limit[2]);
            g[k] += 0.01 * s;
            h[(k, k)] += 0.01 * b + 1e-9;
        }
        (g, h)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn barrier_shape_and_derivatives() {
        assert!(shape(3.0, 1.2).0 < 1e-4 && shape(0.5, 1.2).0 > 0.98);
        assert!((shape(1.2, 1.2).0 - 0.5).abs() < 1e-12 && (shape(0.1, 1.2).0 - 0.5).abs() < 1e-12);
        assert!(shape(0.0, 1.2).0 < 1e-4 && shape(-5.0, 1.2).0 < 1e-20 + 1e-12);
        for z in [0.05, 0.09, 0.12, 0.3, 0.9, 1.1, 1.3, 2.0] {
            let e = 1e-6;
            let a = shape(z - e, 1.2);
            let b = shape(z + e, 1.2);
            let (_, first, second) = shape(z, 1.2);
            assert!(
                ((b.0 - a.0) / (2.0 * e) - first).abs() < 1e-4 * (1.0 + first.abs()),
                "{z}"
            );
            assert!(
                ((b.1 - a.1) / (2.0 * e) - second).abs() < 1e-3 * (1.0 + second.abs()),
                "{z}"
            );
        }
    }

    fn falling(weight: f64, height: f64) -> (AxisProblem, Barrier) {
        let problem = AxisProblem {
            start: [-height, 0.0, 0.0],
            weight: [10.0, 2.0],
            increment_weight: 0.01,
            limit: [1.0, 3.0, 20.0],
            ..AxisProblem::default()
        };
        let barrier = Barrier {
            weight: [weight; STAGES],
            contact: [0.0; STAGES],
            height_m: 1.2,
        };
        (problem, barrier)
    }

    #[test]
    fn jerk_axis_gradient() {
        let axis = JerkAxis::new(0.1);
        let (problem, barrier) = falling(300.0, 1.5);
        let u: PerStage = core::array::from_fn(|i| 25.0 - 4.0 * i as f64);
        let (g, _) = axis.derivatives(&problem, Some(&barrier), &u);
        for i in 0..STAGES {
            let e = 1e-5;
            let mut a = u;
            let mut b = u;
            a[i] -= e;
            b[i] += e;
            let d = (axis.cost(&problem, Some(&barrier), &b) - axis.cost(&problem, Some(&barrier), &a))
                / (2.0 * e);
            assert!((d - g[i]).abs() < 1e-3 * (1.0 + d.abs()), "{i}: {d} {}", g[i]);
        }
    }

    /// Flies for `seconds`, applying the first step of a new solution each time.
    fn fly(weight: f64, seconds: usize) -> f64 {
        let axis = JerkAxis::new(0.1);
        let (mut problem, barrier) = falling(weight, 3.0);
        let mut guess = [0.0; STAGES];
        for _ in 0..10 * seconds {
            let (u, _) = axis.solve(&problem, Some(&barrier), &guess);
            problem.start = JerkAxis::roll(problem.start, u[0], 0.1);
            problem.previous = u[0];
            guess = u;
        }
        problem.start[0]
    }

    #[test]
    fn jerk_axis_above_tilted_and_level_decks() {
        let tilted = fly(610.0, 20);
        assert!(
            (-2.2..-1.5).contains(&tilted),
            "published: waits at about 1.8 m; here {tilted}"
        );
        assert!(fly(1.0, 20) > -0.1);
    }
}
