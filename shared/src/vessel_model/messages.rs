//! To the wave model on the wire, which is in NED (reference heading zero).

use super::{Belief, DOFS, PITCH, ROLL, SURGE, SWAY};
use crate::msg::Seq;
use crate::msg::{MAX_COMPONENTS, WaveComponent};

/// Values of the six degrees of freedom after the reference has turned by `delta`: (surge, sway)
/// and (roll, pitch) as vectors.
fn turned(v: [f64; DOFS], delta: f64) -> [f64; DOFS] {
    let (s, c) = delta.sin_cos();
    let mut out = v;
    for (x, y) in [(SURGE, SWAY), (ROLL, PITCH)] {
        out[x] = c * v[x] + s * v[y];
        out[y] = -s * v[x] + c * v[y];
    }
    out
}
/// Variances likewise; the correlation of the two axes is dropped.
fn turned_variance(v: [f64; DOFS], delta: f64) -> [f64; DOFS] {
    let (s2, c2) = (delta.sin().powi(2), delta.cos().powi(2));
    let mut out = v;
    for (x, y) in [(SURGE, SWAY), (ROLL, PITCH)] {
        out[x] = c2 * v[x] + s2 * v[y];
        out[y] = s2 * v[x] + c2 * v[y];
    }
    out
}

impl Belief {
    /// The components with their oscillator states as they go on the wire: turned from this
    /// belief's `reference_heading` (rad) into NED.
    pub fn wave_message(&self, reference_heading: f64) -> Seq<WaveComponent, MAX_COMPONENTS> {
        let l = self.layout();
        let back = -reference_heading;
        Seq::filled(self.components().iter().enumerate().map(|(j, c)| {
            let pick = |f: &dyn Fn(usize, usize, usize) -> f64| {
                core::array::from_fn::<f64, DOFS, _>(|d| f(d, l.value(d, j), l.rate(d, j)))
            };
            let value = turned(pick(&|d, v, _| self.get(d, v)), back);
            let rate = turned(pick(&|d, _, r| self.get(d, r)), back);
            let vv = turned_variance(pick(&|d, v, _| self.variance(d, v)), back);
            let vr = turned_variance(pick(&|d, v, r| self.covariance((d, v), (d, r))), back);
            let rr = turned_variance(pick(&|d, _, r| self.variance(d, r)), back);
            WaveComponent {
                omega: c.omega as f32,
                direction: c.direction as f32,
                direction_sd: c.direction_sd as f32,
                omega_encounter: c.omega_encounter as f32,
                damping: c.damping as f32,
                state: core::array::from_fn(|d| [value[d] as f32, rate[d] as f32]),
                covariance: core::array::from_fn(|d| [vv[d] as f32, vr[d] as f32, rr[d] as f32]),
                drive: turned_variance(c.drive, back).map(|v| v as f32),
            }
        }))
    }
}
