//! States of the last steps, for late measurements.
//!
//! The present acceleration is not enough to go back: at an antenna 2 m up on a slamming hull (20 rad/s²),
//! the velocity would be wrong by 2 m/s after a latency of 50 ms.

use std::collections::VecDeque;

use alight_shared::{
    time::VesselTime,
    vessel_model::{ETA, NU, PITCH, ROLL, YAW},
};

use super::{Tilt, VesselFilter};

/// Number of steps kept; for older fixes the model rolls the state back.
const STEPS: usize = 32;

#[derive(Clone, Copy, Debug)]
pub(super) struct PastState {
    at: VesselTime,
    /// Surge, sway, heave, m.
    pub(super) eta: [f64; 3],
    /// Their rates, m/s.
    pub(super) nu: [f64; 3],
    pub(super) tilt: Tilt,
}

/// Estimates of the last steps, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct History(VecDeque<PastState>);

impl History {
    /// State at a time, interpolated between two steps.
    fn at(&self, t: VesselTime) -> Option<PastState> {
        let k = self.0.partition_point(|s| s.at <= t);
        let a = self.0.get(k.checked_sub(1)?)?;
        let b = self.0.get(k)?;
        let f = (t - a.at).secs() / (b.at - a.at).secs();
        let mix = |a: f64, b: f64| a + f * (b - a);
        let two = |a: [f64; 2], b: [f64; 2]| core::array::from_fn(|i| mix(a[i], b[i]));
        let three = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|i| mix(a[i], b[i]));
        Some(PastState {
            at: t,
            eta: three(a.eta, b.eta),
            nu: three(a.nu, b.nu),
            tilt: Tilt {
                angles: two(a.tilt.angles, b.tilt.angles),
                rates: two(a.tilt.rates, b.tilt.rates),
                heading: mix(a.tilt.heading, b.tilt.heading),
                heading_rate: mix(a.tilt.heading_rate, b.tilt.heading_rate),
            },
        })
    }
    /// Drops all states when their frame changes.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

impl VesselFilter {
    fn present(&self) -> PastState {
        let b = &self.belief;
        PastState {
            at: self.at,
            eta: core::array::from_fn(|d| b.get(d, ETA)),
            nu: core::array::from_fn(|d| b.get(d, NU)),
            tilt: self.tilt(),
        }
    }
    pub(super) fn remember(&mut self) {
        let now = self.present();
        let history = &mut self.history.0;
        if history.back().is_some_and(|s| s.at >= now.at) {
            history.pop_back();
        }
        if history.len() >= STEPS {
            history.pop_front();
        }
        history.push_back(now);
    }
    /// State at `t`: the stored estimate, or the present state rolled back by the model.
    pub(super) fn state_at(&self, t: VesselTime) -> PastState {
        if let Some(state_at) = self.history.at(t) {
            return state_at;
        }
        let mut state_at = self.present();
        let a = self.accelerations();
        let late = (self.at - t).secs();
        for d in 0..3 {
            state_at.eta[d] += late * (0.5 * late * a[d] - state_at.nu[d]);
            state_at.nu[d] -= late * a[d];
        }
        for (i, d) in [ROLL, PITCH].into_iter().enumerate() {
            state_at.tilt.angles[i] += late * (0.5 * late * a[d] - state_at.tilt.rates[i]);
            state_at.tilt.rates[i] -= late * a[d];
        }
        state_at.tilt.heading += late * (0.5 * late * a[YAW] - state_at.tilt.heading_rate);
        state_at.tilt.heading_rate -= late * a[YAW];
        state_at
    }
    /// Applies a correction of the present position or velocity to the stored states.
    pub(super) fn correct_history(&mut self, dof: usize, eta: f64, nu: f64) {
        for s in &mut self.history.0 {
            s.eta[dof] += eta;
            s.nu[dof] += nu;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::time::Time;

    #[test]
    fn history_interpolation() {
        let step = |k: u32| PastState {
            at: Time::from_secs(0.02 * f64::from(k)),
            // The velocity jumps at the third step, unknown to the present acceleration.
            eta: [f64::from(k); 3],
            nu: [if k < 3 { 0.0 } else { 5.0 }; 3],
            tilt: Tilt::default(),
        };
        let history = History((0..5).map(step).collect());
        let state_at = history.at(Time::from_secs(0.03)).map(|s| (s.eta[0], s.nu[0]));
        assert!(
            state_at.is_some_and(|(e, v)| (e - 1.5).abs() < 1e-6 && v == 0.0),
            "{state_at:?}"
        );
        assert!(
            history
                .at(Time::from_secs(0.05))
                .is_some_and(|s| (s.nu[2] - 2.5).abs() < 1e-6)
        );
        assert!(history.at(Time::from_secs(-0.01)).is_none() && history.at(Time::from_secs(0.09)).is_none());
        assert!(History::default().at(Time::EPOCH).is_none());
    }
}
