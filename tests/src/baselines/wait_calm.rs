//! `wait-calm`: a landing-period indicator in the manner of Abujoub et al. 2020: follow the deck low
//! over it and descend only when the predicted deck stays within limits of tilt and heave rate for
//! the whole descent. The descent itself is that of `mpc`.
//!
//! In a sea that never is as calm as the limits ask for, the limits grow with the time waited: an
//! indicator without that would wait for ever in half of the seas of the paper's Table II.

use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{DeckForecast, Phase, State as Mode};
use alight_shared::time::{DroneClock, Span, Time};
use alight_uav::planner::law::{Law, View};
use alight_uav::planner::model::State;

use super::config::WaitCalmConfig;

/// The law, since when it waits, and whether a calm is predicted.
#[derive(Clone, Debug)]
pub struct WaitCalm {
    config: WaitCalmConfig,
    feet_below_m: f64,
    since: Option<Time<DroneClock>>,
    calm: bool,
}

impl Law for WaitCalm {
    fn limit(&mut self, now: Time<DroneClock>, start: &State, view: &mut View) {
        let clearance_m = feet_over_deck(now, view.forecast.as_ref(), start, self.feet_below_m);
        self.judge(now, clearance_m, view);
    }
}

impl WaitCalm {
    /// A law that has not waited yet.
    pub fn new(config: &WaitCalmConfig, drone: &DroneGeometry) -> Self {
        WaitCalm {
            config: *config,
            feet_below_m: drone.feet_below_m,
            since: None,
            calm: false,
        }
    }

    /// Takes the permission to descend away until calm is predicted. `clearance_m`: feet over the
    /// deck.
    pub fn judge(&mut self, now: Time<DroneClock>, clearance_m: f64, view: &mut View) {
        if view.mission.state.phase() != Phase::Landing {
            (self.since, self.calm) = (None, false);
            return;
        }
        if view.mission.state == Mode::Flare {
            return;
        }
        let config = &self.config;
        if clearance_m > config.wait_m || clearance_m < config.commit_m {
            return;
        }
        let since = *self.since.get_or_insert(now);
        let limit = 1.0 + (now - since).secs().max(0.0) / config.patience_s;
        // Once begun, half as much again has to be wrong to wait anew.
        let limit = if self.calm { 1.5 * limit } else { limit };
        self.calm = view
            .forecast
            .as_ref()
            .is_some_and(|f| worst(now, f, config.descent_s).within(config, limit));
        if !self.calm {
            view.mission.descent_mps = 0.0;
        }
    }
}

/// Feet of a level drone over the deck's centre, m; infinite while the deck is not known.
fn feet_over_deck(now: Time<DroneClock>, forecast: Option<&DeckForecast>, start: &State, feet_m: f64) -> f64 {
    forecast
        .and_then(|f| f.at(now.max(f.header.at)))
        .map_or(f64::INFINITY, |d| d.position[2] - feet_m - start[2])
}

/// The greatest tilt (rad) and vertical speed (m/s) of a stretch of the forecast.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Worst {
    tilt: f64,
    heave: f64,
    covered: bool,
}

impl Worst {
    fn within(&self, config: &WaitCalmConfig, factor: f64) -> bool {
        self.covered
            && self.tilt <= config.tilt_deg.to_radians() * factor
            && self.heave <= config.heave_mps * factor
    }
}

fn worst(now: Time<DroneClock>, forecast: &DeckForecast, lasts_s: f64) -> Worst {
    let (begin, end) = (now, now + Span::from_secs(lasts_s));
    let mut worst = Worst::default();
    for (k, s) in forecast.stages.iter().enumerate() {
        let t = forecast.header.at + forecast.step * k as i64;
        if t + forecast.step < begin {
            continue;
        }
        if t > end {
            worst.covered = true;
            break;
        }
        let tilt = (s.euler[0].cos() * s.euler[1].cos()).clamp(-1.0, 1.0).acos();
        worst.tilt = worst.tilt.max(tilt);
        worst.heave = worst.heave.max(s.velocity[2].abs());
    }
    worst
}
