//! The wind over the deck, as acceleration of the drone that follows the vessel: its mean and its gusts.
//!
//! In the air it needs a tilt that the touchdown has to remove or to keep, and gusts push the drone before it has
//! reacted; on the deck it pushes a drone that friction alone holds. Both are judged in acceleration, which is what the
//! odometry shows and what does not depend on the airframe's drag.

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

    /// Its mean, NED, m/s²: to and fro with the deck, the drone makes a wind of its own that is none on the deck.
    pub fn mean(&self) -> Vector2<f64> {
        self.mean
    }

    /// Standard deviation of one axis about the known mean, m/s²: `s sqrt(1 + T/t)` from that of a time t, of which gusts
    /// longer than T know one sample; 0 before any. More than the prior's gusts are the drone's own, which follows the
    /// deck.
    pub fn gust_sd(&self) -> f64 {
        if self.known_s <= 0.0 {
            return 0.0;
        }
        let prior = (PRIOR_FRACTION * self.mean.norm()).powi(2);
        let (n, t) = (INDEPENDENT_S, self.known_s);
        let variance = (n * prior + t * self.variance.min(prior)) / (n + t);
        (variance * (1.0 + n / t)).sqrt()
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
    fn gusts_of_a_steady_and_of_a_gusty_wind() {
        let of = |w: WindMonitor| (w.mean().norm(), w.gust_sd());
        // Soon after the beginning the prior's gusts and a short mean count.
        let (mean, early) = of(watched(2.0, 0.0, 6.0, true));
        assert!((mean - 2.0).abs() < 0.1 && early > 0.5, "{early}");
        let (_, steady) = of(watched(2.0, 0.0, 45.0, true));
        assert!(steady < 0.5 * early, "{steady}");
        // A sine of 1.27 has a standard deviation of 0.9, here along one axis of two.
        let (_, gusty) = of(watched(2.7, 1.27, 45.0, true));
        assert!(gusty > 0.5, "{gusty}");
    }

    #[test]
    fn wind_monitor_while_following() {
        let way = watched(5.0, 0.0, 45.0, false);
        assert!(way.mean().norm() < 1e-12 && way.gust_sd() < 1e-12);
    }
}
