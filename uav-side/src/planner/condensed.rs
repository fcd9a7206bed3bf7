//! The exact fast path: one chain's problem condensed to its input increments (Procházka et al.
//! 2024, eq. 6-7) and solved by Cholesky as if there were no limits. If the result keeps all
//! limits it is the optimum of the limited problem too, because that one only removes choices or
//! adds a non-negative cost of slack.

use nalgebra::SVector;

use super::model::Discrete;

/// Reference and weights of one stage of a chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageCost<const N: usize> {
    /// Reference of the state.
    pub reference: SVector<f64, N>,
    /// Diagonal of Q.
    pub weight: SVector<f64, N>,
}

/// Factorised condensed problem of a chain of `N` states over a run-time number of stages.
#[derive(Clone, Debug)]
pub struct Condensed<const N: usize> {
    model: Discrete<N, 1>,
    stages: usize,
    increment_weight: f64,
    /// `response[i]`: state `i` steps after a unit input was switched on and held.
    response: Vec<SVector<f64, N>>,
    /// Weights the factor was made for.
    factored_for: Vec<SVector<f64, N>>,
    /// Lower Cholesky factor of H, row-major.
    factor: Vec<f64>,
    /// The unforced trajectory minus the reference, weighted.
    residual: Vec<SVector<f64, N>>,
    /// Right-hand side, then the solution.
    work: Vec<f64>,
}

impl<const N: usize> Condensed<N> {
    /// Prepares for `stages` steps of `model` with cost `increment_weight` on squared increments.
    pub fn new(model: Discrete<N, 1>, stages: usize, increment_weight: f64) -> Self {
        let mut response = vec![SVector::zeros(); stages + 1];
        for i in 0..stages {
            response[i + 1] = model.step(&response[i], 1.0);
        }
        Condensed {
            model,
            stages,
            increment_weight,
            response,
            factored_for: Vec::new(),
            factor: vec![0.0; stages * stages],
            residual: vec![SVector::zeros(); stages],
            work: vec![0.0; stages],
        }
    }

    /// Writes the inputs (not increments) that minimise
    /// `sum_k (x_k - r_k)' Q_k (x_k - r_k) + R (u_k - u_(k-1))²`, `k = 1..stages`, without limits.
    /// False if the problem is not positive definite (weights that are not finite).
    pub fn solve(
        &mut self,
        x0: &SVector<f64, N>,
        previous_input: f64,
        cost: &[StageCost<N>],
        inputs: &mut [f64],
    ) -> bool {
        let n = self.stages;
        if cost.len() != n || inputs.len() != n || !self.factorise(cost) {
            return false;
        }
        // Gradient: free response with the previous input held.
        let mut free = *x0;
        for k in 0..n {
            free = self.model.step(&free, previous_input);
            self.residual[k] = (free - cost[k].reference).component_mul(&cost[k].weight);
        }
        for j in 0..n {
            let mut sum = 0.0;
            for k in j..n {
                sum += self.response[k + 1 - j].dot(&self.residual[k]);
            }
            self.work[j] = -sum;
        }
        self.substitute();
        let mut u = previous_input;
        for k in 0..n {
            u += self.work[k];
            inputs[k] = u;
        }
        inputs.iter().all(|u| u.is_finite())
    }

    /// `H = R I + sum_k S_k' Q_k S_k`, factorised again only when a weight changed.
    fn factorise(&mut self, cost: &[StageCost<N>]) -> bool {
        let n = self.stages;
        let same =
            self.factored_for.len() == n && self.factored_for.iter().zip(cost).all(|(a, b)| *a == b.weight);
        if same {
            return true;
        }
        self.factored_for.clear();
        for i in 0..n {
            for j in 0..=i {
                let mut sum = if i == j { self.increment_weight } else { 0.0 };
                for k in i..n {
                    sum += self.response[k + 1 - i]
                        .component_mul(&cost[k].weight)
                        .dot(&self.response[k + 1 - j]);
                }
                self.factor[i * n + j] = sum;
            }
        }
        for i in 0..n {
            let (above, row) = self.factor.split_at_mut(i * n);
            for j in 0..i {
                let other = &above[j * n..j * n + j + 1];
                let mut sum = row[j];
                for k in 0..j {
                    sum -= row[k] * other[k];
                }
                row[j] = sum / other[j];
            }
            let mut pivot = row[i];
            for k in 0..i {
                pivot -= row[k] * row[k];
            }
            if !(pivot > 0.0) {
                return false;
            }
            row[i] = pivot.sqrt();
        }
        self.factored_for.extend(cost.iter().map(|c| c.weight));
        true
    }

    /// Solves `L L' x = work` in place.
    fn substitute(&mut self) {
        let n = self.stages;
        for i in 0..n {
            let row = &self.factor[i * n..i * n + i + 1];
            let mut sum = self.work[i];
            for k in 0..i {
                sum -= row[k] * self.work[k];
            }
            self.work[i] = sum / row[i];
        }
        for i in (0..n).rev() {
            let value = self.work[i] / self.factor[i * n + i];
            self.work[i] = value;
            for k in 0..i {
                self.work[k] -= self.factor[i * n + k] * value;
            }
        }
    }
}
