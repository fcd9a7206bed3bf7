//! Mean and covariance of the wave-augmented state, in blocks of correlated degrees of freedom.

use nalgebra::DMatrix;

use super::{
    Component, DISTURBANCE, DOFS, ETA, HEAD, NU, PITCH, ROLL, SLOW, SURGE, SWAY, VesselModel,
    model::connected,
};
use crate::estimation::{Gaussian, LinearTransition, Update};

/// Additional state in a degree of freedom's block, e.g. a sensor bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extra {
    /// Initial standard deviation.
    pub sd: f64,
    /// Standard deviation of the random walk after 1 s.
    pub walk: f64,
    /// Correlation time, s; infinite for a pure random walk.
    pub time_s: f64,
}

/// Specification of a belief's layout.
#[derive(Clone, Debug, Default)]
pub struct BeliefSpec {
    /// Pairs of degrees of freedom with correlation, in addition to those coupled by the model.
    pub couplings: Vec<(usize, usize)>,
    /// Additional states per degree of freedom.
    pub extras: [Vec<Extra>; DOFS],
    /// Initial standard deviations of eta and nu per degree of freedom.
    pub initial_sd: [[f64; 2]; DOFS],
}

/// Index of each state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    components: usize,
    extras: [usize; DOFS],
    blocks: Vec<Vec<usize>>,
    place: [(usize, usize); DOFS],
}

impl Layout {
    /// Number of wave components.
    pub const fn components(&self) -> usize {
        self.components
    }
    /// Slot of the `k`-th additional state.
    pub const fn extra(&self, k: usize) -> usize {
        HEAD + k
    }
    /// Slot of the value of component `j` in degree of freedom `dof`.
    pub const fn value(&self, dof: usize, j: usize) -> usize {
        HEAD + self.extras[dof] + 2 * j
    }
    /// Slot of the rate of component `j` in degree of freedom `dof`.
    pub const fn rate(&self, dof: usize, j: usize) -> usize {
        self.value(dof, j) + 1
    }
    /// Number of slots of a degree of freedom.
    pub const fn slots(&self, dof: usize) -> usize {
        HEAD + self.extras[dof] + 2 * self.components
    }
    /// Degrees of freedom in each block.
    pub fn blocks(&self) -> &[Vec<usize>] {
        &self.blocks
    }
    /// (block, index) of a state.
    pub const fn at(&self, dof: usize, slot: usize) -> (usize, usize) {
        let (block, offset) = self.place[dof];
        (block, offset + slot)
    }
    fn new(components: usize, extras: [usize; DOFS], blocks: Vec<Vec<usize>>) -> Self {
        let mut layout = Layout {
            components,
            extras,
            blocks,
            place: [(0, 0); DOFS],
        };
        for (b, dofs) in layout.blocks.clone().iter().enumerate() {
            let mut offset = 0;
            for &d in dofs {
                layout.place[d] = (b, offset);
                offset += layout.slots(d);
            }
        }
        layout
    }
}

/// Entry of a measurement row: `gain` times the state (`dof`, `slot`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// Degree of freedom.
    pub dof: usize,
    /// Slot in the degree of freedom.
    pub slot: usize,
    /// Partial derivative of the measurement.
    pub gain: f64,
}

impl Term {
    /// `gain` times (`dof`, `slot`).
    pub const fn new(dof: usize, slot: usize, gain: f64) -> Self {
        Term { dof, slot, gain }
    }
}

/// Transition and noise of one step in the layout of a [`Belief`].
#[derive(Clone, Debug)]
pub struct BeliefStep {
    /// Duration, s.
    pub dt: f64,
    blocks: Vec<(LinearTransition, DMatrix<f64>)>,
}

/// Mean and covariance of the state.
#[derive(Clone, Debug)]
pub struct Belief {
    spec: BeliefSpec,
    layout: Layout,
    components: Vec<Component>,
    blocks: Vec<Gaussian>,
}

impl Belief {
    /// Belief with zero mean, and the stationary or initial deviations of slow states, disturbances and oscillators.
    pub fn new(model: &VesselModel, spec: &BeliefSpec) -> Self {
        let mut related = [[false; DOFS]; DOFS];
        for g in model.groups() {
            for &i in g {
                for &j in g {
                    related[i][j] = true;
                }
            }
        }
        for &(i, j) in &spec.couplings {
            if i < DOFS && j < DOFS {
                related[i][j] = true;
            }
        }
        let extras = core::array::from_fn(|d| spec.extras[d].len());
        let layout = Layout::new(model.components().len(), extras, connected(&related));
        let c = model.config();
        let blocks = layout
            .blocks
            .iter()
            .map(|dofs| {
                let mut sd = Vec::new();
                for &d in dofs {
                    sd.extend([
                        spec.initial_sd[d][0],
                        spec.initial_sd[d][1],
                        c.slow_sd_mps_m_rad_radps[d],
                        c.disturbance_sd_mps2_m_rad_radps2[d],
                    ]);
                    sd.extend(spec.extras[d].iter().map(|e| e.sd));
                    for w in model.components() {
                        let s = w.stationary_sd(d);
                        sd.extend([s, s * w.omega]);
                    }
                }
                Gaussian::new(&sd)
            })
            .collect();
        Belief {
            spec: spec.clone(),
            layout,
            components: model.components().to_vec(),
            blocks,
        }
    }
    /// Layout of the states.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }
    /// Wave components with oscillators in the state.
    pub fn components(&self) -> &[Component] {
        &self.components
    }
    /// Blocks in the order of [`Layout::blocks`].
    pub fn blocks(&self) -> &[Gaussian] {
        &self.blocks
    }
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.blocks.iter().all(Gaussian::is_finite)
    }
    /// Mean of a state.
    pub fn get(&self, dof: usize, slot: usize) -> f64 {
        let (b, i) = self.layout.at(dof, slot);
        self.blocks[b].x[i]
    }
    /// Overwrites the mean of a state.
    pub fn set(&mut self, dof: usize, slot: usize, value: f64) {
        let (b, i) = self.layout.at(dof, slot);
        self.blocks[b].x[i] = value;
    }
    /// Covariance of two states; zero across blocks.
    pub fn covariance(&self, a: (usize, usize), b: (usize, usize)) -> f64 {
        let (ba, i) = self.layout.at(a.0, a.1);
        let (bb, j) = self.layout.at(b.0, b.1);
        if ba == bb { self.blocks[ba].p[(i, j)] } else { 0.0 }
    }
    /// Variance of a state.
    pub fn variance(&self, dof: usize, slot: usize) -> f64 {
        self.covariance((dof, slot), (dof, slot))
    }
    /// Sets the variance of a state and removes its correlations.
    pub fn set_variance(&mut self, dof: usize, slot: usize, variance: f64) {
        let (b, i) = self.layout.at(dof, slot);
        let p = &mut self.blocks[b].p;
        p.column_mut(i).fill(0.0);
        p.row_mut(i).fill(0.0);
        p[(i, i)] = variance;
    }
    /// Increases the variance of a state.
    pub fn inflate(&mut self, dof: usize, slot: usize, variance: f64) {
        let (b, i) = self.layout.at(dof, slot);
        self.blocks[b].p[(i, i)] += variance;
    }
    /// Sum of the wave components in a degree of freedom.
    pub fn wave(&self, dof: usize) -> f64 {
        (0..self.layout.components)
            .map(|j| self.get(dof, self.layout.value(dof, j)))
            .sum()
    }
    /// Acceleration `nu_dot` of a degree of freedom by the model at the mean.
    pub fn acceleration(&self, model: &VesselModel, dof: usize) -> f64 {
        let mut sum = 0.0;
        for g in model.groups() {
            if g.contains(&dof) {
                for &k in g {
                    let row = model.acceleration_row(dof, k);
                    for (slot, r) in row.iter().enumerate() {
                        sum += r * self.get(k, slot);
                    }
                    sum += row[DISTURBANCE] * self.wave(k);
                }
            }
        }
        sum
    }
    /// Appends the terms of `scale * nu_dot` of a degree of freedom to a measurement row.
    pub fn acceleration_terms(&self, model: &VesselModel, dof: usize, scale: f64, row: &mut Vec<Term>) {
        for g in model.groups() {
            if g.contains(&dof) {
                for &k in g {
                    let r = model.acceleration_row(dof, k);
                    for (slot, v) in r.iter().enumerate() {
                        if *v != 0.0 {
                            row.push(Term::new(k, slot, scale * v));
                        }
                    }
                    if r[DISTURBANCE] != 0.0 {
                        for j in 0..self.layout.components {
                            row.push(Term::new(k, self.layout.value(k, j), scale * r[DISTURBANCE]));
                        }
                    }
                }
            }
        }
    }

    /// Exact step over `dt` seconds in this layout.
    pub fn step(&self, model: &VesselModel, dt: f64) -> BeliefStep {
        let discrete = model.discretise(dt);
        let blocks = self
            .layout
            .blocks
            .iter()
            .enumerate()
            .map(|(b, _)| {
                let n = self.blocks[b].len();
                let mut a = DMatrix::identity(n, n);
                let mut q = DMatrix::zeros(n, n);
                for g in discrete.groups.iter() {
                    let stride = HEAD + 2 * discrete.components;
                    let place: Vec<Option<usize>> = (0..g.dofs.len() * stride)
                        .map(|s| {
                            let dof = g.dofs[s / stride];
                            let slot = s % stride;
                            let slot = if slot < HEAD {
                                slot
                            } else {
                                slot + self.layout.extras[dof]
                            };
                            let (block, i) = self.layout.at(dof, slot);
                            (block == b).then_some(i)
                        })
                        .collect();
                    for (i, pi) in place.iter().enumerate() {
                        for (j, pj) in place.iter().enumerate() {
                            if let (Some(pi), Some(pj)) = (pi, pj) {
                                a[(*pi, *pj)] = g.a[(i, j)];
                                q[(*pi, *pj)] = g.q[(i, j)];
                            }
                        }
                    }
                }
                for &dof in &self.layout.blocks[b] {
                    for (k, e) in self.spec.extras[dof].iter().enumerate() {
                        let (_, i) = self.layout.at(dof, self.layout.extra(k));
                        let phi = (-dt / e.time_s).exp();
                        a[(i, i)] = phi;
                        q[(i, i)] = if e.time_s.is_finite() {
                            e.walk * e.walk * 0.5 * e.time_s * (1.0 - phi * phi)
                        } else {
                            e.walk * e.walk * dt
                        };
                    }
                }
                (LinearTransition::from_dense(&a), q)
            })
            .collect();
        BeliefStep { dt, blocks }
    }
    /// Advances mean and covariance by one step.
    pub fn propagate(&mut self, step: &BeliefStep) {
        for (g, (a, q)) in self.blocks.iter_mut().zip(&step.blocks) {
            g.predict(a, q);
        }
    }
    /// Predicted value of a measurement row.
    pub fn predicted(&self, row: &[Term]) -> f64 {
        row.iter().map(|t| t.gain * self.get(t.dof, t.slot)).sum()
    }

    /// Fuses a scalar with this innovation and variance `r`, unless its normalised innovation squared exceeds
    /// `gate`. If a row spans blocks, each gets its exact marginal posterior, without cross-correlation.
    pub fn update(&mut self, row: &[Term], innovation: f64, r: f64, gate: f64) -> Update {
        const MAX_TERMS: usize = 64;
        let mut entries = [(0usize, 0.0f64); MAX_TERMS];
        let mut used = [0usize; DOFS + 1];
        if row.len() > MAX_TERMS || !innovation.is_finite() {
            return Update::Invalid;
        }
        let mut n = 0;
        for b in 0..self.blocks.len().min(DOFS) {
            for t in row {
                let (block, i) = self.layout.at(t.dof, t.slot);
                if block == b {
                    entries[n] = (i, t.gain);
                    n += 1;
                }
            }
            used[b + 1] = n;
        }
        let mut s = r;
        for (b, g) in self.blocks.iter_mut().enumerate() {
            let h = &entries[used[b]..used[b + 1]];
            if !h.is_empty() {
                s += g.project(h);
            }
        }
        if !(s > 0.0 && s.is_finite()) {
            return Update::Invalid;
        }
        let nis = innovation * innovation / s;
        if !(nis <= gate) {
            return Update::Rejected { nis };
        }
        for (b, g) in self.blocks.iter_mut().enumerate() {
            if used[b + 1] > used[b] {
                g.fuse_projected(innovation, s);
            }
        }
        Update::Fused { nis }
    }

    /// Rotates the reference heading by `delta` rad: (surge, sway) and (roll, pitch) with waves and
    /// disturbances, and the mean velocity. Trim (the slow state of roll and pitch), additional states and
    /// yaw are fixed to the body and remain unchanged.
    pub fn turn(&mut self, delta: f64) {
        let (s, c) = delta.sin_cos();
        let before = self.clone();
        // Each new state is `own * old + other * old of the partner`.
        let partner = |dof: usize| match dof {
            SURGE => Some((SWAY, s)),
            SWAY => Some((SURGE, -s)),
            ROLL => Some((PITCH, s)),
            PITCH => Some((ROLL, -s)),
            _ => None,
        };
        let turns = |dof: usize, slot: usize| {
            let extras = HEAD..HEAD + self.layout.extras[dof];
            !extras.contains(&slot) && !(slot == SLOW && (dof == ROLL || dof == PITCH))
        };
        let twin = |dof: usize, slot: usize, other: usize| {
            if slot < HEAD {
                slot
            } else {
                slot - self.layout.extras[dof] + self.layout.extras[other]
            }
        };
        let mut out = self.blocks.clone();
        for (b, dofs) in self.layout.blocks.iter().enumerate() {
            // (new index, [(block, index, factor); 2])
            let mut map: Vec<[(usize, usize, f64); 2]> = Vec::with_capacity(self.blocks[b].len());
            for &d in dofs {
                for slot in 0..self.layout.slots(d) {
                    let (bi, i) = self.layout.at(d, slot);
                    map.push(match partner(d) {
                        Some((o, f)) if turns(d, slot) => {
                            let (bo, io) = self.layout.at(o, twin(d, slot, o));
                            [(bi, i, c), (bo, io, f)]
                        }
                        _ => [(bi, i, 1.0), (bi, i, 0.0)],
                    });
                }
            }
            for (i, from) in map.iter().enumerate() {
                out[b].x[i] = from.iter().map(|&(k, j, f)| f * before.blocks[k].x[j]).sum();
                for (j, to) in map.iter().enumerate().take(i + 1) {
                    let mut v = 0.0;
                    for &(ka, ia, fa) in from {
                        for &(kb, ib, fb) in to {
                            if ka == kb {
                                v += fa * fb * before.blocks[ka].p[(ia, ib)];
                            }
                        }
                    }
                    out[b].p[(i, j)] = v;
                    out[b].p[(j, i)] = v;
                }
            }
        }
        self.blocks = out;
    }

    /// (variance of eta, covariance, variance of nu) of a degree of freedom.
    pub fn motion_covariance(&self, dof: usize) -> [f64; 3] {
        [
            self.variance(dof, ETA),
            self.covariance((dof, ETA), (dof, NU)),
            self.variance(dof, NU),
        ]
    }
}
