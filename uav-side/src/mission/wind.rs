//! The wind over the deck, as acceleration of the drone that follows the vessel: its mean, its gusts, and what has
//! to be expected on the deck.
//!
//! A drone that stands on the deck with its motors stopped is held by friction alone: it slides
//! when wind and slope together exceed `mu g` (3.9 m/s² at 0.4). In the air the same wind needs a tilt that
//! the touchdown has to remove or to keep. Both are judged before a descent begins, in
//! acceleration, which is what the odometry shows and what does not depend on the airframe's drag.

use alight_shared::msg::DroneState;

use super::config::MissionConfig;
use crate::odometry::wind::WindObserver;

/// Time constant of the observer, s: the planner's, gusts of 2 s pass.
const OBSERVER_S: f64 = 0.7;
/// Largest acceleration accepted, m/s².
const MAX_MPS2: f64 = 9.0;
/// Standard deviation as a fraction of the mean before any is measured: twice the
/// intensity of turbulence over water, 0.19 at 7 m (MIL-F-8785C).
const PRIOR_FRACTION: f64 = 0.38;
/// The prior counts as this much time, and gusts further apart are independent, s: twice the
/// integral time of the turbulence at 7 m, 50 m at 8 to 10 m/s (MIL-F-8785C).
const INDEPENDENT_S: f64 = 10.0;

/// Mean and gusts of the wind's acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindMonitor {
    observer: WindObserver,
    /// Time watched, at most the memory, s.
    known_s: f64,
    mean: f64,
    variance: f64,
}

impl WindMonitor {
    /// Learns from the newest odometry; only while the drone `follows` the vessel at its speed is
    /// its wind the wind over the deck.
    pub fn update(&mut self, d: &DroneState, follows: bool, c: &MissionConfig) {
        let dt = self.observer.update(d, true, OBSERVER_S, MAX_MPS2);
        let Some(dt) = dt.filter(|dt| follows && *dt > 0.0) else {
            return;
        };
        self.known_s = (self.known_s + dt).min(c.wind_memory_s);
        let fraction = dt / self.known_s;
        let off = self.observer.value().norm() - self.mean;
        self.mean += fraction * off;
        self.variance += fraction * (off * off * (1.0 - fraction) - self.variance);
    }

    /// The acceleration now, m/s².
    pub fn now(&self) -> f64 {
        self.observer.value().norm()
    }

    /// The acceleration to be expected, m/s²: `m + k s sqrt(1 + T/t)` from the mean and standard deviation
    /// of a time t, of which gusts longer than T know one sample; 0 before any.
    pub fn peak(&self, c: &MissionConfig) -> f64 {
        if self.known_s <= 0.0 {
            return 0.0;
        }
        let prior = PRIOR_FRACTION * self.mean;
        let (n, t) = (INDEPENDENT_S, self.known_s);
        let variance = (n * prior * prior + t * self.variance) / (n + t);
        self.mean + c.wind_gust_sds * (variance * (1.0 + n / t)).sqrt()
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
    fn watched(mean: f64, gust: f64, secs: f64, follows: bool) -> (WindMonitor, MissionConfig) {
        let (c, mut w) = (MissionConfig::default(), WindMonitor::default());
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
            w.update(&d, follows && t > 5.0, &c);
        }
        (w, c)
    }

    #[test]
    fn wind_monitor_trusts_a_steady_wind_in_time_and_keeps_a_margin_for_gusts() {
        // Soon after the beginning the prior's gusts and a short mean count.
        let (early, c) = watched(2.0, 0.0, 6.0, true);
        assert!(early.peak(&c) > 3.5, "{}", early.peak(&c));
        // The own wind of the fastest vessel that is landed on, 7.7 m/s without gusts: permitted.
        let (steady, c) = watched(1.7, 0.0, 45.0, true);
        let peak = steady.peak(&c);
        assert!(peak > 2.0 && peak < c.wind_peak_mps2, "{peak}");
        // The same mean with gusts of a standard deviation of 0.9.
        let (gusty, c) = watched(2.7, 1.27, 45.0, true);
        assert!(gusty.peak(&c) > 4.0, "{}", gusty.peak(&c));
    }

    #[test]
    fn wind_monitor_permits_light_wind_after_seconds_and_learns_only_while_following() {
        let (light, c) = watched(0.7, 0.4, 9.0, true);
        assert!(light.peak(&c) < c.wind_peak_mps2, "{}", light.peak(&c));
        let (way, c) = watched(5.0, 0.0, 45.0, false);
        assert!(way.peak(&c) < 1e-12);
    }
}
