//! Wind over the deck, as the acceleration of a drone that follows the vessel: mean and gusts.
//!
//! In the air the wind requires a tilt that touchdown must remove or keep, and gusts displace the drone before it has
//! reacted. On the deck the wind loads a drone that only friction holds. Both effects are accelerations, which the
//! odometry measures. The mean includes the vessel's speed; gusts are those of the true wind ([`WindEstimator`]).

use alight_shared::{
    msg::{DroneState, WindCheckpoint},
    time::DroneTime,
};
use nalgebra::Vector2;

use super::air::{INDEPENDENT_S, WindEstimator};

/// Gap of odometry above which a continuous flight ends, s.
const MAX_GAP_S: f64 = 0.1;
/// Averaging time of the wind, s.
const MEMORY_S: f64 = 60.0;
/// Speed over the deck below which the drone follows it, m/s. In 5 m/s of wind this speed changes the drag by half.
const FOLLOWS_MPS: f64 = 1.2;
/// Standard deviation of the wind above which it is not published, m/s.
const KNOWN_SD_MPS: f64 = 3.0;
/// Half the time over which the greatest wind speed is stated, s: meteorology takes 10 min.
const GUST_SPAN_S: f64 = 300.0;

/// Estimates mean and gusts of the acceleration due to wind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct WindMonitor {
    air: WindEstimator,
    /// Velocity of the drone while it follows the deck, NED, m/s.
    way: Vector2<f64>,
    at: Option<DroneTime>,
    /// Observation time, at most [`MEMORY_S`], s.
    known_s: f64,
    /// Mean acceleration, NED, m/s².
    mean: Vector2<f64>,
    /// Variance of one axis, (m/s²)².
    variance: f64,
    /// Greatest wind speed in the previous and in the present span, m/s, and the age of the latter, s.
    gusts: [f64; 3],
}

impl WindMonitor {
    pub(crate) fn resume(m: &WindCheckpoint) -> Self {
        WindMonitor {
            air: WindEstimator::resume(m.state, m.covariance),
            way: m.way.into(),
            at: None,
            known_s: m.known_s,
            mean: m.mean.into(),
            variance: m.variance,
            gusts: m.gusts,
        }
    }
    pub(crate) fn checkpoint(&self) -> WindCheckpoint {
        let (state, covariance) = self.air.learnt().unzip();
        WindCheckpoint {
            state,
            covariance: covariance.unwrap_or_default(),
            known_s: self.known_s,
            way: self.way.into(),
            mean: self.mean.into(),
            variance: self.variance,
            gusts: self.gusts,
        }
    }

    /// Processes new odometry and writes the wind into it. `deck`: horizontal velocity of the deck below the drone,
    /// NED, m/s. The drone measures the wind over the deck only while it follows the deck.
    pub(crate) fn update(&mut self, d: &mut DroneState, deck: Option<Vector2<f64>>) {
        self.learn(d, deck);
        self.publish(d);
    }

    fn learn(&mut self, d: &DroneState, deck: Option<Vector2<f64>>) {
        let velocity = d.velocity().xy();
        let dt = self.at.map_or(0.0, |at| (d.header.at - at).secs());
        self.at = Some(d.header.at);
        if !(dt > 0.0 && dt < MAX_GAP_S) {
            return;
        }
        self.air.update(&d.disturbance(), &velocity, dt);
        self.observe_gusts(dt);
        if !deck.is_some_and(|deck| (velocity - deck).norm() <= FOLLOWS_MPS) {
            return;
        }
        self.known_s = (self.known_s + dt).min(MEMORY_S);
        let fraction = dt / self.known_s;
        let off = d.disturbance() - self.mean;
        self.mean += off * fraction;
        self.way += (velocity - self.way) * fraction;
        self.variance += fraction * (0.5 * off.norm_squared() * (1.0 - fraction) - self.variance);
    }

    fn observe_gusts(&mut self, dt: f64) {
        let known = self.air.wind().is_some_and(|(_, sd)| sd < KNOWN_SD_MPS);
        let Some(speed) = self.air.speed() else { return };
        if !known {
            return;
        }
        let [before, greatest, age_s] = self.gusts;
        self.gusts = [before, greatest.max(speed), age_s + dt];
        if age_s > GUST_SPAN_S {
            self.gusts = [self.gusts[1], 0.0, 0.0];
        }
    }

    /// Writes the wind into `d`. The published mean disturbance is that of a drone at the deck's mean velocity, because
    /// a drone that follows the deck's motion has an additional apparent wind.
    fn publish(&self, d: &mut DroneState) {
        let wind = self.air.wind().filter(|(_, sd)| *sd < KNOWN_SD_MPS);
        d.wind = wind.map(|(wind, _)| wind.into());
        d.wind_sd_mps = wind.map(|(_, sd)| sd);
        d.gust_mps = wind.map(|_| self.gusts[0].max(self.gusts[1]));
        d.wind_push = self.mean.into();
        d.gust_sd = self.gust_sd();
    }

    /// Standard deviation of one axis about the mean, m/s²: `s sqrt(1 + T/t)` with the standard deviation `s` over the
    /// time `t`, in which gusts longer than `T` occur only once; 0 before any observation. Variance above that of the
    /// prior is due to the drone's motion with the deck and is ignored.
    fn gust_sd(&self) -> f64 {
        if self.known_s <= 0.0 {
            return 0.0;
        }
        let prior = self.air.gust_sd(&self.way).unwrap_or_default().powi(2);
        let n = INDEPENDENT_S;
        let t = self.known_s;
        let variance = (n * prior + t * self.variance.min(prior)) / (n + t);
        (variance * (1.0 + n / t)).sqrt()
    }

    /// Odometry after a long time in steady wind; the wind is an acceleration, m/s².
    #[cfg(test)]
    pub(crate) fn steady(mean_mps2: f64) -> DroneState {
        let mean = Vector2::new(mean_mps2, 0.0);
        let mut air = WindEstimator::default();
        for _ in 0..60 {
            air.update(&mean, &Vector2::zeros(), 1.0);
        }
        let known = WindMonitor {
            mean,
            air,
            known_s: MEMORY_S,
            ..WindMonitor::default()
        };
        let mut d = DroneState::default();
        known.publish(&mut d);
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{
        msg::Header,
        time::{Span, Time},
    };

    /// Monitor and last odometry of a drone above a deck that moves at `deck_mps`, under a disturbance that oscillates
    /// by `gust` about `mean` with a period of 8 s.
    fn watched(mean: f64, gust: f64, secs: f64, deck_mps: Option<f64>) -> (WindMonitor, DroneState) {
        let mut w = WindMonitor::default();
        let mut last = DroneState::default();
        for k in 0..(secs * 100.0) as i64 {
            let t = 0.01 * k as f64;
            let push = mean + gust * (core::f64::consts::TAU / 8.0 * t).sin();
            last = DroneState {
                header: Header::new(1, 1, 1, k as u32, Time::EPOCH + Span::from_millis(10 * k)),
                disturbance: [push, 0.0],
                ..DroneState::default()
            };
            // The wind has been steady for a long time when the observation begins.
            let deck = deck_mps.filter(|_| t > 5.0);
            w.update(&mut last, deck.map(|v| Vector2::new(0.0, v)));
        }
        (w, last)
    }

    #[test]
    fn gust_sd_in_steady_and_gusty_wind() {
        let of = |mean, gust, secs| {
            let (_, d) = watched(mean, gust, secs, Some(0.0));
            (Vector2::from(d.wind_push).norm(), d.gust_sd)
        };
        // After a short observation the gusts of the prior and the uncertainty of the mean dominate.
        let (mean, early) = of(2.0, 0.0, 6.0);
        assert!((mean - 2.0).abs() < 0.1 && early > 0.5, "{early}");
        let (_, steady) = of(2.0, 0.0, 45.0);
        assert!(steady < 0.5 * early, "{steady}");
        // A sine of amplitude 1.27 has a standard deviation of 0.9, here along one of two axes.
        let (_, gusty) = of(2.7, 1.27, 45.0);
        assert!(gusty > 0.5, "{gusty}");
    }

    #[test]
    fn wind_monitor_while_following() {
        // The wind is not learned without a deck, nor above a deck that moves away.
        for deck_mps in [None, Some(2.0 * FOLLOWS_MPS)] {
            let (_, d) = watched(5.0, 0.0, 45.0, deck_mps);
            assert_eq!((d.wind_push, d.gust_sd), ([0.0; 2], 0.0));
        }
    }

    #[test]
    fn wind_of_a_successor() {
        let (known, d) = watched(2.0, 0.5, 45.0, Some(0.0));
        let mut next = DroneState {
            header: d.header,
            disturbance: d.disturbance,
            ..DroneState::default()
        };
        WindMonitor::resume(&known.checkpoint()).publish(&mut next);
        assert!(next == d && d.gust_sd > 0.0, "{next:?} {d:?}");
    }
}
