//! The wind in the plan: what pushes the drone that hovers, and so will push it while it is aligned.

use alight_shared::msg::DroneState;
use alight_shared::time::{DroneClock, Time};
use nalgebra::{Vector2, Vector3};

use super::config::WindConfig;
use crate::disturbance::DisturbanceObserver;

/// Odometry further apart than this is no continuous flight, s.
const MAX_GAP_S: f64 = 0.1;

/// What is known of the wind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wind {
    observer: DisturbanceObserver,
    at: Option<Time<DroneClock>>,
}

impl Wind {
    /// Its acceleration, NED, m/s².
    pub fn value(&self) -> Vector2<f64> {
        self.observer.value()
    }

    /// The part of the acceleration `wind` that an aligned drone is to be blown along with; against
    /// the rest it leans.
    pub fn carried(wind: &Vector2<f64>, c: &WindConfig) -> Vector2<f64> {
        let whole = wind.norm();
        if whole <= c.aligned_mps2 {
            return *wind;
        }
        wind * ((c.aligned_mps2 + c.aligned_fraction * (whole - c.aligned_mps2)) / whole)
    }

    /// Learns from the newest odometry, unless the drone is `near` enough to the deck to touch it.
    pub fn update(&mut self, d: &DroneState, near: bool, c: &WindConfig) {
        let dt = self.at.map_or(0.0, |t| (d.header.at - t).secs());
        self.at = Some(d.header.at);
        if near || !(0.0..MAX_GAP_S).contains(&dt) {
            self.observer.pause();
            return;
        }
        let force = Vector3::from(d.specific_force);
        self.observer
            .learn(&force, &d.attitude(), &d.velocity(), dt, c.time_s, c.limit_mps2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strong_wind_is_split_between_drift_and_tilt_continuously() {
        let c = WindConfig {
            aligned_mps2: 1.0,
            aligned_fraction: 0.5,
            ..WindConfig::default()
        };
        let of = |d: f64| Wind::carried(&Vector2::new(0.0, d), &c).y;
        assert_eq!((of(0.7), of(-1.0)), (0.7, -1.0));
        assert!((of(1.001) - 1.0005).abs() < 1e-9 && (of(3.0) - 2.0).abs() < 1e-9);
    }
}
