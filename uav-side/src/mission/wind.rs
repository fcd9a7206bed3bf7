//! The wind over the deck, as acceleration of the drone that follows the vessel: its mean, its gusts, and what has
//! to be expected on the deck.
//!
//! A drone that stands on the deck with its motors stopped is held by friction alone: it slides
//! when wind and slope together exceed `mu g` (3.9 m/s² at 0.4). In the air the same wind needs a tilt that
//! the touchdown has to remove or to keep. Both are judged before a descent begins, in
//! acceleration, which is what the odometry shows and what does not depend on the airframe's drag.

use alight_shared::msg::DroneState;
use nalgebra::Vector2;

use crate::odometry::wind::WindObserver;

/// Time constant of the observer, s: the planner's, gusts of 2 s pass.
const OBSERVER_S: f64 = 0.7;
/// Largest acceleration accepted, m/s².
const MAX_MPS2: f64 = 9.0;
/// Standard deviation as a fraction of the mean before any is measured: twice the
/// intensity of turbulence over water, 0.19 at 7 m (MIL-F-8785C).
const PRIOR_FRACTION: f64 = 0.38;
/// Standard deviations of the gusts to be expected above the mean. With two, the descents that begin in 8 and 10 m/s are
/// those in a lull: of 80 trials 31 landed and 2 were blown off the deck afterwards.
const GUST_SDS: f64 = 3.0;
/// The wind is judged over this time, s.
const MEMORY_S: f64 = 60.0;
/// The prior counts as this much time, and gusts further apart are independent, s: twice the
/// integral time of the turbulence at 7 m, 50 m at 8 to 10 m/s (MIL-F-8785C).
const INDEPENDENT_S: f64 = 10.0;

/// Mean and gusts of the wind's acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindMonitor {
    observer: WindObserver,
    /// Time watched, at most the memory, s.
    known_s: f64,
    /// NED, m/s².
    mean: Vector2<f64>,
    /// Of one axis, (m/s²)².
    variance: f64,
}

impl WindMonitor {
    /// Learns from the newest odometry; only while the drone `follows` the vessel at its speed is
    /// its wind the wind over the deck.
    pub fn update(&mut self, d: &DroneState, follows: bool) {
        let dt = self.observer.update(d, true, OBSERVER_S, MAX_MPS2);
        let Some(dt) = dt.filter(|dt| follows && *dt > 0.0) else {
            return;
        };
        self.known_s = (self.known_s + dt).min(MEMORY_S);
        let fraction = dt / self.known_s;
        let off = self.observer.value() - self.mean;
        self.mean += off * fraction;
        self.variance += fraction * (0.5 * off.norm_squared() * (1.0 - fraction) - self.variance);
    }

    /// The acceleration now, m/s².
    pub fn now(&self) -> f64 {
        self.observer.value().norm()
    }

    /// Its mean, m/s²: to and fro with the deck, the drone makes a wind of its own that is none on the deck.
    pub fn mean(&self) -> f64 {
        self.mean.norm()
    }

    /// The acceleration to be expected, m/s²: `m + k s sqrt(1 + T/t)` from the mean and standard deviation
    /// of a time t, of which gusts longer than T know one sample; 0 before any. More than the prior's gusts are the
    /// drone's own, which follows the deck.
    pub fn peak(&self) -> f64 {
        if self.known_s <= 0.0 {
            return 0.0;
        }
        let prior = (PRIOR_FRACTION * self.mean()).powi(2);
        let (n, t) = (INDEPENDENT_S, self.known_s);
        let variance = (n * prior + t * self.variance.min(prior)) / (n + t);
        self.mean() + GUST_SDS * (variance * (1.0 + n / t)).sqrt()
    }

    /// A wind that has long been known to be steady, m/s².
    #[cfg(test)]
    pub(super) fn steady(mean_mps2: f64) -> WindMonitor {
        WindMonitor {
            mean: Vector2::new(mean_mps2, 0.0),
            known_s: MEMORY_S,
            ..WindMonitor::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::geometry::GRAVITY;
    use alight_shared::msg::Header;
    use alight_shared::time::{Span, Time};
    use nalgebra::UnitQuaternion;

    /// What a friction of 0.4 holds on a level deck, less 0.11 of slope.
    const HELD_MPS2: f64 = 2.8;

    /// A drone that keeps its place in a push that swings by `gust` about `mean` with a period of
    /// 8 s.
    fn watched(mean: f64, gust: f64, secs: f64, follows: bool) -> WindMonitor {
        let mut w = WindMonitor::default();
        for k in 0..(secs * 100.0) as i64 {
            let t = 0.01 * k as f64;
            let push = mean + gust * (core::f64::consts::TAU / 8.0 * t).sin();
            let tilt = UnitQuaternion::from_euler_angles(0.0, -(push / GRAVITY).atan(), 0.0);
            let d = DroneState {
                header: Header::new(1, 1, 1, k as u32, Time::EPOCH + Span::from_millis(10 * k)),
                attitude: [tilt.w, tilt.i, tilt.j, tilt.k],
                specific_force: [0.0, 0.0, -push.hypot(GRAVITY)],
                ..DroneState::default()
            };
            // Long settled when the watch begins.
            w.update(&d, follows && t > 5.0);
        }
        w
    }

    #[test]
    fn wind_monitor_trusts_a_steady_wind_in_time_and_keeps_a_margin_for_gusts() {
        // Soon after the beginning the prior's gusts and a short mean count.
        let early = watched(2.0, 0.0, 6.0, true);
        assert!(early.peak() > 3.5, "{}", early.peak());
        // The own wind of the fastest vessel that is landed on, 7.7 m/s without gusts: permitted.
        let steady = watched(1.7, 0.0, 45.0, true);
        let peak = steady.peak();
        assert!(peak > 2.0 && peak < HELD_MPS2, "{peak}");
        // The same mean with gusts of a standard deviation of 0.9.
        let gusty = watched(2.7, 1.27, 45.0, true);
        assert!(gusty.peak() > 4.0, "{}", gusty.peak());
    }

    #[test]
    fn wind_monitor_permits_light_wind_after_seconds_and_learns_only_while_following() {
        let light = watched(0.7, 0.4, 9.0, true);
        assert!(light.peak() < HELD_MPS2, "{}", light.peak());
        let way = watched(5.0, 0.0, 45.0, false);
        assert!(way.peak() < 1e-12);
    }
}
