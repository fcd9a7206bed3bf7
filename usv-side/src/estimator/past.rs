//! The states of the last moments, for what is measured late.
//!
//! Rolled back by its present acceleration, the state of a hull that slams (20 rad/s² at an antenna 2 m up) is
//! off by metres a second after the 50 ms that a fix takes.

use std::collections::VecDeque;

use alight_shared::time::{Time, VesselClock};
use alight_shared::vessel_model::{ETA, NU, PITCH, ROLL, YAW};

use super::{Filter, Tilt};

/// Steps that are remembered: a fix later than this is rolled back by the model.
const STEPS: usize = 32;

/// Place, velocity and tilt at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Then {
    at: Time<VesselClock>,
    /// Surge, sway, heave, m.
    pub(super) eta: [f64; 3],
    /// Their rates, m/s.
    pub(super) nu: [f64; 3],
    pub(super) tilt: Tilt,
}

/// What was estimated at the last steps, oldest first.
#[derive(Clone, Debug, Default)]
pub(super) struct Past(VecDeque<Then>);

impl Past {
    /// The state at a time between two steps.
    fn at(&self, t: Time<VesselClock>) -> Option<Then> {
        let k = self.0.partition_point(|s| s.at <= t);
        let (a, b) = (self.0.get(k.checked_sub(1)?)?, self.0.get(k)?);
        let f = (t - a.at).secs() / (b.at - a.at).secs();
        let mix = |a: f64, b: f64| a + f * (b - a);
        let two = |a: [f64; 2], b: [f64; 2]| core::array::from_fn(|i| mix(a[i], b[i]));
        let three = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|i| mix(a[i], b[i]));
        Some(Then {
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
    /// Forgets: the states were reckoned otherwise.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

impl Filter {
    fn present(&self) -> Then {
        let b = &self.belief;
        Then {
            at: self.at,
            eta: core::array::from_fn(|d| b.get(d, ETA)),
            nu: core::array::from_fn(|d| b.get(d, NU)),
            tilt: self.tilt(),
        }
    }
    /// Keeps the state of this step.
    pub(super) fn remember(&mut self) {
        let now = self.present();
        let past = &mut self.past.0;
        if past.back().is_some_and(|s| s.at >= now.at) {
            past.pop_back();
        }
        if past.len() >= STEPS {
            past.pop_front();
        }
        past.push_back(now);
    }
    /// The state at `t`: as it was estimated then, or rolled back by the model from now.
    pub(super) fn then(&self, t: Time<VesselClock>) -> Then {
        if let Some(then) = self.past.at(t) {
            return then;
        }
        let (mut then, a) = (self.present(), self.accelerations());
        let late = (self.at - t).secs();
        for d in 0..3 {
            then.eta[d] += late * (0.5 * late * a[d] - then.nu[d]);
            then.nu[d] -= late * a[d];
        }
        for (i, d) in [ROLL, PITCH].into_iter().enumerate() {
            then.tilt.angles[i] += late * (0.5 * late * a[d] - then.tilt.rates[i]);
            then.tilt.rates[i] -= late * a[d];
        }
        then.tilt.heading += late * (0.5 * late * a[YAW] - then.tilt.heading_rate);
        then.tilt.heading_rate -= late * a[YAW];
        then
    }
    /// A correction of place or velocity now is one of what was estimated before.
    pub(super) fn correct_past(&mut self, dof: usize, eta: f64, nu: f64) {
        for s in &mut self.past.0 {
            s.eta[dof] += eta;
            s.nu[dof] += nu;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_past_is_told_between_two_steps_and_not_outside() {
        let step = |k: u32| Then {
            at: Time::from_secs(0.02 * f64::from(k)),
            // A velocity that jumps at the third step, as no acceleration now would tell.
            eta: [f64::from(k); 3],
            nu: [if k < 3 { 0.0 } else { 5.0 }; 3],
            tilt: Tilt::default(),
        };
        let past = Past((0..5).map(step).collect());
        let then = past.at(Time::from_secs(0.03)).map(|s| (s.eta[0], s.nu[0]));
        assert!(
            then.is_some_and(|(e, v)| (e - 1.5).abs() < 1e-6 && v == 0.0),
            "{then:?}"
        );
        assert!(
            past.at(Time::from_secs(0.05))
                .is_some_and(|s| (s.nu[2] - 2.5).abs() < 1e-6)
        );
        assert!(past.at(Time::from_secs(-0.01)).is_none() && past.at(Time::from_secs(0.09)).is_none());
        assert!(Past::default().at(Time::EPOCH).is_none());
    }
}
