//! `precision-land`: what a user would switch on today, precision landing of PX4 v1.15
//! (`precland.cpp`) and ArduPilot (`AC_PrecLand`, moving target): the tag's place is the set-point,
//! the tag's velocity its feed-forward, and the drone sinks at constant speed over the earth. No
//! prediction of waves, no heave, no alignment.
//!
//! - Over the target within `PLD_HACC_RAD` it begins to sink and does not ask again.
//! - A target that has timed out stops the descent, except below `PLD_FAPPR_ALT`.
//! - Between detections the target moves on at its velocity.
//!
//! The measurement is the predictor's deck at the present instant, taken while the tag is fresh, and
//! this predictor uses no radio while it detects the tag and never the wave model
//! ([`super::settings`]). That filter is a better one than either autopilot has.

use alight_shared::geometry::DroneGeometry;
use alight_shared::msg::{DeckStage, Phase};
use alight_shared::time::{DroneClock, Time};
use alight_uav::planner::law::{Law, View};
use alight_uav::planner::model::State;

use super::config::PrecisionLandConfig;

/// The law, the last detection, and whether the descent has begun.
#[derive(Clone, Debug)]
pub struct PrecisionLand {
    config: PrecisionLandConfig,
    feet_below_m: f64,
    detection: Option<(Time<DroneClock>, DeckStage)>,
    sinking: bool,
}

impl PrecisionLand {
    /// A law without a detection yet.
    pub fn new(config: &PrecisionLandConfig, drone: &DroneGeometry) -> Self {
        PrecisionLand {
            config: *config,
            feet_below_m: drone.feet_below_m,
            detection: None,
            sinking: false,
        }
    }
}

impl Law for PrecisionLand {
    /// Replaces the forecast by the target and the permitted speed by the law's.
    fn limit(&mut self, now: Time<DroneClock>, start: &State, view: &mut View) {
        let config = &self.config;
        let Some(forecast) = &mut view.forecast else {
            return;
        };
        let begin = now.max(forecast.header.at);
        if forecast.tag_age_s <= config.fresh_s
            && let Some(stage) = forecast.at(begin)
        {
            self.detection = Some((begin, stage));
        }
        self.sinking &= view.mission.state.phase() == Phase::Landing;
        // Before the first detection the approach is by the radio's position.
        let (at, detection) = match (self.detection, forecast.stages.first()) {
            (Some((at, detection)), _) if (begin - at).secs() <= config.timeout_s => (at, detection),
            (_, Some(first)) => (forecast.header.at, *first),
            (_, None) => return,
        };
        let age = (forecast.header.at - at).secs();
        let step = forecast.step.secs();
        for (k, stage) in forecast.stages.iter_mut().enumerate() {
            let t = age + step * k as f64;
            let [n, e, d] = detection.position;
            let [vn, ve, _] = detection.velocity;
            stage.position = [n + vn * t, e + ve * t, d];
            stage.velocity = [vn, ve, 0.0];
            stage.acceleration = [0.0; 3];
            stage.euler = [0.0, 0.0, detection.euler[2]];
            stage.euler_rates = [0.0; 3];
        }

        let Some(target) = forecast.at(begin) else {
            return;
        };
        let near = (0..2).all(|i| (target.position[i] - start[i]).abs() < config.begin_within_m);
        self.sinking |= near && view.mission.descent_mps > 0.0;
        let usable =
            forecast.tag_age_s <= config.timeout_s || target.position[2] - start[2] < config.final_approach_m;
        let height = target.position[2] - self.feet_below_m - start[2];
        view.mission.descent_mps = if !(self.sinking && usable && view.mission.descent_mps > 0.0) {
            0.0
        } else if height < config.crawl_below_m {
            config.crawl_mps
        } else {
            config.sink_mps
        };
    }
}
