//! `gnss-radio`: the vessel's position by radio, no camera, no wave model; the deck goes on at the
//! velocity that it has.
//!
//! Both receivers' errors are in the relative position, and nothing at close range removes them:
//! what remains of the deck's 2.5 m x 1.7 m is what this baseline shows.

use alight_shared::msg::{DeckForecast, State as Mode};
use alight_shared::time::{DroneClock, Time};
use alight_uav::planner::law::{Law, View};
use alight_uav::planner::model::State;

use super::config::GnssRadioConfig;

/// The law.
#[derive(Clone, Debug)]
pub struct GnssRadio {
    config: GnssRadioConfig,
}

impl GnssRadio {
    /// The law with these parameters.
    pub fn new(config: &GnssRadioConfig) -> Self {
        GnssRadio { config: *config }
    }
}

impl Law for GnssRadio {
    fn limit(&mut self, _now: Time<DroneClock>, _start: &State, view: &mut View) {
        if let Some(f) = &mut view.forecast {
            let flare = view.mission.state == Mode::Flare;
            let lower_m = if flare { self.config.below_m } else { 0.0 };
            extrapolate(f, lower_m, &self.config);
        }
    }
}

/// Replaces every stage by the first one moved on: `p + v t` horizontally, with
/// `v tau (1 - exp(-t / tau))` vertically; level, with the heading that it has. `lower_m`: and lower
/// by this much.
pub fn extrapolate(forecast: &mut DeckForecast, lower_m: f64, config: &GnssRadioConfig) {
    let Some(first) = forecast.stages.first().copied() else {
        return;
    };
    let (step, tau) = (forecast.step.secs(), config.heave_memory_s);
    for (k, stage) in forecast.stages.iter_mut().enumerate() {
        let t = step * k as f64;
        let left = (-t / tau).exp();
        let [vn, ve, vd] = first.velocity;
        let [n, e, d] = first.position;
        stage.position = [n + vn * t, e + ve * t, d + vd * tau * (1.0 - left) + lower_m];
        stage.velocity = [vn, ve, vd * left];
        stage.acceleration = [0.0, 0.0, -vd * left / tau];
        stage.euler = [0.0, 0.0, first.euler[2]];
        stage.euler_rates = [0.0; 3];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::msg::DeckStage;
    use alight_shared::time::Span;

    #[test]
    fn gnss_radio_extrapolation() {
        let mut f = DeckForecast {
            step: Span::from_millis(100),
            ..DeckForecast::default()
        };
        for _ in 0..41 {
            let _ = f.stages.push(DeckStage {
                position: [1.0, 2.0, -1.5],
                velocity: [0.5, -0.2, 0.8],
                euler: [0.2, 0.1, 1.0],
                euler_rates: [0.3, 0.2, 0.1],
                ..DeckStage::default()
            });
        }
        extrapolate(&mut f, 0.0, &GnssRadioConfig::default());
        let (a, b) = (f.stages[0], f.stages[40]);
        assert_eq!((a.position, a.euler), ([1.0, 2.0, -1.5], [0.0, 0.0, 1.0]));
        assert!((b.position[0] - 3.0).abs() < 1e-9 && (b.position[1] - 1.2).abs() < 1e-9);
        // 0.8 m/s for 1 s, not for 4 s.
        assert!((b.position[2] + 1.5 - 0.8).abs() < 0.02 && b.velocity[2] < 0.02);
        // Velocity and acceleration are the slopes of position and velocity.
        for w in f.stages.windows(2) {
            let slope = (w[1].position[2] - w[0].position[2]) / 0.1;
            assert!((slope - 0.5 * (w[0].velocity[2] + w[1].velocity[2])).abs() < 1e-3);
            let slope = (w[1].velocity[2] - w[0].velocity[2]) / 0.1;
            assert!((slope - 0.5 * (w[0].acceleration[2] + w[1].acceleration[2])).abs() < 1e-3);
        }
    }
}
