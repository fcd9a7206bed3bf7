//! Changes that a baseline needs outside the planner: sources that the predictor may use, and mission parameters that
//! assume another planner. Everything else is the same for all planners.

use alight_uav::mission::MissionConfig;
use alight_uav::planner::PlannerKind;
use alight_uav::predictor::PredictorConfig;

use super::Baseline;

/// Age of the newest tag detection up to which `mpc-ne`, which lands by vision alone, ignores the radio, s. It is
/// longer than the last, blind metre of a descent; the mission returns to an approach by radio after 5 s without
/// vision.
const VISION_ONLY_S: f64 = 4.5;
/// Maximum duration of a descent, s, which includes the time that this planner waits above the deck.
const WAITING_S: f64 = 120.0;

impl Baseline {
    pub fn predictor(&self, base: PredictorConfig) -> PredictorConfig {
        match self {
            Baseline::Mpc => base,
            // After its first detection only the tag is used; before it, radio alone guides the drone to the deck.
            Baseline::MpcNe => PredictorConfig {
                use_wave_model: false,
                radio_after_vision_s: VISION_ONLY_S,
                ..base
            },
        }
    }

    pub fn mission(&self, base: MissionConfig) -> MissionConfig {
        match self {
            // The flare is the same with and without alignment.
            Baseline::Mpc => PlannerKind::MpcFaa.mission(base),
            // This planner ignores surge and sway by design, and lands on a tilted deck only by mistake. Conditions on
            // distance, speed and tilt at the decision clearance would keep it waiting for ever; its own barrier
            // decides instead.
            Baseline::MpcNe => MissionConfig {
                descent_timeout_s: WAITING_S,
                flare_timeout_s: WAITING_S,
                min_probability: 0.0,
                max_harm: 1.0,
                // This planner does not receive the deck's apparent slope from the vessel.
                friction: 2.0,
                ..base
            },
        }
    }
}
