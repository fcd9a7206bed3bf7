//! Cheap look-ahead: the rows of `C A^k` are worked out once per model, so that a prediction is a
//! dot product per figure and stage.

use nalgebra::{DMatrix, DVector};

use super::{Belief, DISTURBANCE, DOFS, ETA, HEAD, NU, VesselModel};

/// Precomputed rows for stages `0..=stages` of a fixed step.
#[derive(Clone, Debug)]
pub struct Horizon {
    step_s: f64,
    stages: usize,
    components: usize,
    groups: Vec<Rows>,
    /// (group, position in the group) of each degree of freedom.
    place: [(usize, usize); DOFS],
}

#[derive(Clone, Debug)]
struct Rows {
    dofs: Vec<usize>,
    stride: usize,
    /// Rows of eta, nu, nu_dot: `[(local dof * 3 + quantity) * stages + k]`, each of the group's size.
    rows: Vec<DVector<f64>>,
    /// Noise variance accumulated until stage k, same order, for eta and nu and their covariance:
    /// `[(local dof * 3 + {eta, cov, nu}) * stages + k]`.
    noise: Vec<f64>,
}

impl Horizon {
    /// Rows for `stages + 1` instants `k step_s`, k = 0..=stages.
    pub fn new(model: &VesselModel, step_s: f64, stages: usize) -> Self {
        let discrete = model.discretise(step_s);
        let count = stages + 1;
        let stride = HEAD + 2 * discrete.components;
        let mut place = [(0, 0); DOFS];
        let groups = discrete
            .groups
            .iter()
            .enumerate()
            .map(|(gi, g)| {
                let n = g.dofs.len() * stride;
                let mut rows = Vec::with_capacity(3 * g.dofs.len() * count);
                let mut noise = Vec::with_capacity(3 * g.dofs.len() * count);
                let transposed: DMatrix<f64> = g.a.transpose();
                for (li, &dof) in g.dofs.iter().enumerate() {
                    place[dof] = (gi, li);
                    let mut acceleration = DVector::zeros(n);
                    for (lk, &k) in g.dofs.iter().enumerate() {
                        let r = model.acceleration_row(dof, k);
                        for slot in 0..HEAD {
                            acceleration[lk * stride + slot] = r[slot];
                        }
                        for j in 0..discrete.components {
                            acceleration[lk * stride + HEAD + 2 * j] = r[DISTURBANCE];
                        }
                    }
                    let unit = |slot| {
                        let mut u = DVector::zeros(n);
                        u[li * stride + slot] = 1.0;
                        u
                    };
                    let quantities = [unit(ETA), unit(NU), acceleration];
                    let start = rows.len();
                    for first in quantities {
                        let mut row = first;
                        for _ in 0..count {
                            let next = &transposed * &row;
                            rows.push(core::mem::replace(&mut row, next));
                        }
                    }
                    for (a, b) in [(0, 0), (0, 1), (1, 1)] {
                        let mut v = 0.0;
                        for k in 0..count {
                            noise.push(v);
                            let (ra, rb): (&DVector<f64>, &DVector<f64>) =
                                (&rows[start + a * count + k], &rows[start + b * count + k]);
                            v += ra.dot(&(&g.q * rb));
                        }
                    }
                }
                Rows {
                    dofs: g.dofs.clone(),
                    stride,
                    rows,
                    noise,
                }
            })
            .collect();
        Horizon {
            step_s,
            stages,
            components: discrete.components,
            groups,
            place,
        }
    }
    /// Time between stages, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }
    /// The last stage.
    pub fn stages(&self) -> usize {
        self.stages
    }
    /// It belongs to a model with as many components as the belief has.
    pub fn fits(&self, belief: &Belief) -> bool {
        self.components == belief.layout().components()
    }

    /// Mean of (eta, nu, nu_dot) of `dof` at stage `k` (held at the last stage); zeros when the
    /// belief is of another model.
    pub fn mean(&self, belief: &Belief, dof: usize, k: usize) -> [f64; 3] {
        if !self.fits(belief) {
            return [0.0; 3];
        }
        let (rows, first, count) = self.rows(dof);
        let k = k.min(self.stages);
        let mut out = [0.0; 3];
        for (quantity, o) in out.iter_mut().enumerate() {
            let row = &rows.rows[first + quantity * count + k];
            *o = rows
                .segments(belief)
                .map(|(local, block, at, len)| {
                    row.rows(local, len).dot(&belief.blocks()[block].x.rows(at, len))
                })
                .sum();
        }
        out
    }
    /// Covariance (var eta, cov, var nu) of `dof` at stage `k`, process noise included.
    pub fn covariance(&self, belief: &Belief, dof: usize, k: usize) -> [f64; 3] {
        if !self.fits(belief) {
            return [f64::INFINITY, 0.0, f64::INFINITY];
        }
        let (rows, first, count) = self.rows(dof);
        let k = k.min(self.stages);
        let (eta, nu) = (&rows.rows[first + k], &rows.rows[first + count + k]);
        let mut out = [
            rows.noise[first + k],
            rows.noise[first + count + k],
            rows.noise[first + 2 * count + k],
        ];
        for (la, ba, ia, na) in rows.segments(belief) {
            for (lb, bb, ib, nb) in rows.segments(belief) {
                if ba != bb {
                    continue;
                }
                let p = &belief.blocks()[ba].p;
                for j in 0..nb {
                    let column = p.column(ib + j);
                    let column = column.rows(ia, na);
                    let pe = eta.rows(la, na).dot(&column);
                    let pn = nu.rows(la, na).dot(&column);
                    out[0] += pe * eta[lb + j];
                    out[1] += pe * nu[lb + j];
                    out[2] += pn * nu[lb + j];
                }
            }
        }
        out
    }

    fn rows(&self, dof: usize) -> (&Rows, usize, usize) {
        let (group, local) = self.place[dof];
        let count = self.stages + 1;
        (&self.groups[group], local * 3 * count, count)
    }
}

impl Rows {
    /// Stretches of the group's state that are contiguous in the belief: (index in the group's row,
    /// block, index in the block, length): head and oscillators of each degree of freedom.
    fn segments<'a>(&'a self, belief: &'a Belief) -> impl Iterator<Item = (usize, usize, usize, usize)> + 'a {
        let layout = belief.layout();
        self.dofs.iter().enumerate().flat_map(move |(local, &dof)| {
            let (block, head) = layout.at(dof, 0);
            let (_, waves) = layout.at(dof, layout.value(dof, 0));
            let start = local * self.stride;
            [
                (start, block, head, HEAD),
                (start + HEAD, block, waves, self.stride - HEAD),
            ]
        })
    }
}
