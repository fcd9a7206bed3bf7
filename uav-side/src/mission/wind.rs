//! The wind over the deck, as acceleration of the drone that follows the vessel: its mean and its gusts.
//!
//! In the air it needs a tilt that the touchdown has to remove or to keep, and gusts push the drone before it has
//! reacted; on the deck it pushes a drone that friction alone holds. Both are judged in acceleration, which is what the
//! odometry shows. The mean is that of the vessel's way and the wind together; gusts are the wind's alone ([`WindEstimator`]).

use alight_shared::landing::WindPush;
use alight_shared::msg::DroneState;
use alight_shared::time::{DroneClock, Time};
use nalgebra::Vector2;

use super::air::{INDEPENDENT_S, WindEstimator};

/// Odometry further apart than this is no continuous flight, s.
const MAX_GAP_S: f64 = 0.1;
/// The wind is judged over this time, s.
const MEMORY_S: f64 = 60.0;

/// Mean and gusts of the wind's acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindMonitor {
    air: WindEstimator,
    /// Velocity of the drone while it follows, NED, m/s.
    way: Vector2<f64>,
    /// Time of the newest odometry.
    at: Option<Time<DroneClock>>,
    /// Time watched, at most the memory, s.
    known_s: f64,
    /// NED, m/s².
    mean: Vector2<f64>,
    /// Variance of one axis, (m/s²)².
    variance: f64,
}

impl WindMonitor {
    /// Learns from the newest odometry; only while the drone `follows` the vessel at its speed is
    /// its wind the wind over the deck.
    pub fn update(&mut self, d: &DroneState, follows: bool) {
        let dt = self.at.map_or(0.0, |at| (d.header.at - at).secs());
        self.at = Some(d.header.at);
        if !(dt > 0.0 && dt < MAX_GAP_S) {
            return;
        }
        self.air.update(&d.disturbance(), &d.velocity().xy(), dt);
        if !follows {
            return;
        }
        self.known_s = (self.known_s + dt).min(MEMORY_S);
        let fraction = dt / self.known_s;
        let off = d.disturbance() - self.mean;
        self.mean += off * fraction;
        self.way += (d.velocity().xy() - self.way) * fraction;
        self.variance += fraction * (0.5 * off.norm_squared() * (1.0 - fraction) - self.variance);
    }

    /// Mean wind acceleration, NED, m/s²: by following the deck to and fro the drone makes an apparent wind of its own.
    pub fn mean(&self) -> Vector2<f64> {
        self.mean
    }

    /// The true wind, towards NED, m/s, with its standard deviation; None before any is known.
    pub fn true_wind(&self) -> Option<(Vector2<f64>, f64)> {
        self.air.wind()
    }

    /// Standard deviation of one axis about the known mean, m/s²: `s sqrt(1 + T/t)` from that of a time t, of which gusts
    /// longer than T know one sample; 0 before any. More than the prior's gusts are the drone's own, which follows the
    /// deck.
    pub fn gust_sd(&self) -> f64 {
        if self.known_s <= 0.0 {
            return 0.0;
        }
        let prior = self.air.gust_sd(&self.way).unwrap_or_default().powi(2);
        let (n, t) = (INDEPENDENT_S, self.known_s);
        let variance = (n * prior + t * self.variance.min(prior)) / (n + t);
        (variance * (1.0 + n / t)).sqrt()
    }

    /// Both, as they push a drone that follows the vessel.
    pub fn push(&self) -> WindPush {
        WindPush {
            mean: self.mean(),
            gust_sd: self.gust_sd(),
        }
    }

    /// A wind that has long been known to be steady, m/s².
    #[cfg(test)]
    pub(super) fn steady(mean_mps2: f64) -> WindMonitor {
        let mean = Vector2::new(mean_mps2, 0.0);
        let mut air = WindEstimator::default();
        (0..60).for_each(|_| air.update(&mean, &Vector2::zeros(), 1.0));
        WindMonitor {
            mean,
            air,
            known_s: MEMORY_S,
            ..WindMonitor::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::Header;
    use alight_shared::time::{Span, Time};

    /// A drone that keeps its place in a push that swings by `gust` about `mean` with a period of
    /// 8 s.
    fn watched(mean: f64, gust: f64, secs: f64, follows: bool) -> WindMonitor {
        let mut w = WindMonitor::default();
        for k in 0..(secs * 100.0) as i64 {
            let t = 0.01 * k as f64;
            let push = mean + gust * (core::f64::consts::TAU / 8.0 * t).sin();
            let d = DroneState {
                header: Header::new(1, 1, 1, k as u32, Time::EPOCH + Span::from_millis(10 * k)),
                disturbance: [push, 0.0],
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
