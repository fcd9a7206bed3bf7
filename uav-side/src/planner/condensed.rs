//! Exact fast path: one chain's problem, condensed to its input increments (Procházka et al. 2024, eq. 6-7) and solved
//! by Cholesky without limits. A result within all limits is also the optimum of the constrained problem, which only
//! removes choices or adds a non-negative cost of slack.

use nalgebra::SVector;

use super::model::DiscreteModel;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageCost<const N: usize> {
    pub reference: SVector<f64, N>,
    pub weight: SVector<f64, N>,
}

/// Factorised condensed problem of a chain with `N` states.
#[derive(Clone, Debug)]
pub struct Condensed<const N: usize> {
    model: DiscreteModel<N, 1>,
    stages: usize,
    increment_weight: f64,
    /// `response[i]`: state `i` steps after a unit step of the input.
    response: Vec<SVector<f64, N>>,
    /// Weights for which the current factor was computed.
    factored_for: Vec<SVector<f64, N>>,
    /// Transposed Cholesky factor of H: upper triangular, row-major.
    factor: Vec<f64>,
    /// Weighted responses at one stage, by component, so that the inner loops run over stages.
    weighted: [Vec<f64>; N],
    /// Half of the solution: the inverse of the factor applied to the negative gradient.
    half: Vec<f64>,
    /// Right-hand side, then the solution.
    work: Vec<f64>,
}

impl<const N: usize> Condensed<N> {
    /// Prepares `stages` steps of `model` with the cost `increment_weight` on squared increments.
    pub fn new(model: DiscreteModel<N, 1>, stages: usize, increment_weight: f64) -> Self {
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
            weighted: core::array::from_fn(|_| vec![0.0; stages]),
            half: vec![0.0; stages],
            work: vec![0.0; stages],
        }
    }

    /// Writes the inputs (not increments) that minimise `sum_k (x_k - r_k)' Q_k (x_k - r_k) + R (u_k - u_(k-1))²`, `k =
    /// 1..stages`, without limits. Returns false if the problem is not positive definite.
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
        // The gradient follows from the free response with the previous input held.
        let mut free = *x0;
        self.half.fill(0.0);
        for k in 0..n {
            free = self.model.step(&free, previous_input);
            let residual = (free - cost[k].reference).component_mul(&cost[k].weight);
            for j in 0..=k {
                self.half[j] += self.response[k + 1 - j].dot(&residual);
            }
        }
        self.half.iter_mut().for_each(|v| *v = -*v);
        forward(&self.factor, &mut self.half);
        self.work.copy_from_slice(&self.half);
        backward(&self.factor, &mut self.work);
        let mut u = previous_input;
        for k in 0..n {
            u += self.work[k];
            inputs[k] = u;
        }
        inputs.iter().all(|u| u.is_finite())
    }

    /// Copies the factor of a chain with the same weights whose responses differ only in sign, which cancels in H.
    pub(super) fn adopt_factor(&mut self, other: &Self) {
        if self.factored_for != other.factored_for {
            self.factored_for.clone_from(&other.factored_for);
            self.factor.copy_from_slice(&other.factor);
        }
    }

    /// Factorises `H = R I + sum_k S_k' Q_k S_k` if a weight has changed.
    fn factorise(&mut self, cost: &[StageCost<N>]) -> bool {
        let n = self.stages;
        let same =
            self.factored_for.len() == n && self.factored_for.iter().zip(cost).all(|(a, b)| *a == b.weight);
        if same {
            return true;
        }
        self.factored_for.clear();
        self.factor.fill(0.0);
        for k in 0..n {
            self.factor[k * n + k] = self.increment_weight;
        }
        for k in 0..n {
            for i in 0..=k {
                for c in 0..N {
                    self.weighted[c][i] = self.response[k + 1 - i][c] * cost[k].weight[c];
                }
            }
            for j in 0..=k {
                let other = self.response[k + 1 - j];
                let row = &mut self.factor[j * n + j..=j * n + k];
                let weighted = self.weighted.each_ref().map(|w| &w[j..=k]);
                for (i, sum) in row.iter_mut().enumerate() {
                    *sum += SVector::<f64, N>::from_fn(|c, _| weighted[c][i]).dot(&other);
                }
            }
        }
        for k in 0..n {
            let (above, below) = self.factor.split_at_mut((k + 1) * n);
            let row = &mut above[k * n..];
            if !(row[k] > 0.0) {
                return false;
            }
            row[k] = row[k].sqrt();
            let pivot = row[k];
            row[k + 1..].iter_mut().for_each(|v| *v /= pivot);
            for (j, other) in (k + 1..n).zip(below.chunks_exact_mut(n)) {
                let factor = row[j];
                for (v, r) in other[j..].iter_mut().zip(&row[j..]) {
                    *v -= r * factor;
                }
            }
        }
        self.factored_for.extend(cost.iter().map(|c| c.weight));
        true
    }

    pub(super) fn response(&self) -> &[SVector<f64, N>] {
        &self.response
    }
    /// Half of the last solution, which is the input of [`Condensed::increments`].
    pub(super) fn half(&self) -> &[f64] {
        &self.half
    }
    /// Applies the inverse of the factor to a row of increments, in place.
    pub(super) fn image(&self, row: &mut [f64]) {
        forward(&self.factor, row);
    }
    pub(super) fn increments(&self, half: &mut [f64]) {
        backward(&self.factor, half);
    }
}

/// Solves `L x = v` in place, given `L'`.
fn forward(factor: &[f64], v: &mut [f64]) {
    for (i, row) in factor.chunks_exact(v.len()).enumerate() {
        let value = v[i] / row[i];
        v[i] = value;
        for (x, r) in v[i + 1..].iter_mut().zip(&row[i + 1..]) {
            *x -= r * value;
        }
    }
}

/// Solves `L' x = v` in place, given `L'`.
fn backward(factor: &[f64], v: &mut [f64]) {
    let n = v.len();
    for i in (0..n).rev() {
        let value = v[i] / factor[i * n + i];
        v[i] = value;
        for (x, row) in v[..i].iter_mut().zip(factor.chunks_exact(n)) {
            *x -= row[i] * value;
        }
    }
}
