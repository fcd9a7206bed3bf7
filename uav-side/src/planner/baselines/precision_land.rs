//! `precision-land`: what a user would switch on today, precision landing of PX4 v1.15
//! (`precland.cpp`) and ArduPilot (`AC_PrecLand`, moving target): the tag's place is the set-point,
//! the tag's velocity its feed-forward, and the drone sinks at constant speed over the earth. No
//! prediction of waves, no heave, no alignment.
//!
//! - Over the target within `PLD_HACC_RAD` it begins to sink and does not ask again.
//! - A target that has timed out stops the descent, except below `PLD_FAPPR_ALT`.
//! - Between sightings the target moves on at its velocity.
//!
//! The measurement is the predictor's deck at the present instant, taken while the tag is fresh, and
//! this predictor hears no radio while it sees the tag and never the wave model
//! ([`super::settings`]). That filter is a better one than either autopilot has.

use alight_shared::config;
use alight_shared::msg::{DeckStage, Phase};
use alight_shared::time::{DroneClock, Time};

use super::View;
use crate::planner::model::State;

config! {
    /// Parameters, by their names in PX4.
    ///
    /// Defaults: PX4's defaults, except: the camera of a drone on legs sees no tag of 1 m below 0.5
    /// m, so the final approach begins at 1 m instead of 0.1 m (else it would never touch down);
    /// fresh is three frames at 30 Hz.
    #[derive(Copy)]
    pub struct PrecisionLandConfig {
        /// `MPC_LAND_SPEED`: speed of sinking over the earth, m/s.
        pub sink_mps: f64 = 0.7, in 0.05..=3.0;
        /// `MPC_LAND_CRWL`: the same on a drone with a rangefinder, as this one is, below `crawl_below_m`,
        /// m/s.
        pub crawl_mps: f64 = 0.3;
        /// `MPC_LAND_ALT3`: height of the feet over the target below which it crawls, m.
        pub crawl_below_m: f64 = 1.0, in 0.0..=10.0;
        /// `PLD_HACC_RAD`: sinking begins within this distance in north and in east, m.
        pub begin_within_m: f64 = 0.2, in 0.01..=10.0;
        /// `PLD_FAPPR_ALT`: below this height over the target it sinks on without one, m.
        pub final_approach_m: f64 = 1.0, in 0.0..=10.0;
        /// A sighting is a measurement up to this age, s.
        pub fresh_s: f64 = 0.1, in 0.01..=5.0;
        /// `PLD_BTOUT`: without a measurement for this long the target is lost, s.
        pub timeout_s: f64 = 5.0, in 0.1..=60.0;
    }
    check |this, at| {
        at.range("crawl_mps", this.crawl_mps, 0.05, this.sink_mps)?;
    }
}

/// The last sighting, and whether the descent has begun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PrecisionLand {
    detection: Option<(Time<DroneClock>, DeckStage)>,
    sinking: bool,
}

impl PrecisionLand {
    /// Replaces the forecast by the target and the permitted speed by the law's. `feet_m`: feet below
    /// the centre of mass.
    pub fn judge(
        &mut self,
        now: Time<DroneClock>,
        start: &State,
        feet_m: f64,
        view: &mut View,
        config: &PrecisionLandConfig,
    ) {
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
        // Before the first sighting the way there is by the radio's position.
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
        let height = target.position[2] - feet_m - start[2];
        view.mission.descent_mps = if !(self.sinking && usable && view.mission.descent_mps > 0.0) {
            0.0
        } else if height < config.crawl_below_m {
            config.crawl_mps
        } else {
            config.sink_mps
        };
    }
}
