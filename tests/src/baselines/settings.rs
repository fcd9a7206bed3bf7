//! Settings of a baseline outside the planner: the predictor's sources, and mission parameters that assume
//! Alight's planner. All other settings are common.

use alight_uav::{mission::MissionConfig, planner::PlannerKind, predictor::PredictorConfig};

use super::Baseline;

/// Maximum detection age at which `mpc-ne`, which lands by vision alone, ignores the radio, s. Longer than the last
/// metre of a descent, where the tag is out of view; after 5 s without vision the mission approaches by radio.
const VISION_ONLY_S: f64 = 4.5;
/// Maximum duration of a descent, s, including this planner's wait above the deck.
const WAITING_S: f64 = 120.0;

impl Baseline {
    pub fn predictor(&self, base: PredictorConfig) -> PredictorConfig {
        match self {
            Baseline::Mpc => base,
            // Radio guides the drone until the first detection; after that the tag alone guides it.
            Baseline::MpcNe => PredictorConfig {
                use_wave_model: false,
                radio_after_vision_s: VISION_ONLY_S,
                ..base
            },
        }
    }

    pub fn mission(&self, base: MissionConfig) -> MissionConfig {
        match self {
            Baseline::Mpc => PlannerKind::MpcFaa.mission(base),
            // This planner ignores surge and sway by design, and should not land on a tilted deck. The
            // mission's conditions on distance, speed and tilt at the decision clearance would never hold;
            // the planner's barrier decides instead.
            Baseline::MpcNe => MissionConfig {
                descent_timeout_s: WAITING_S,
                flare_timeout_s: WAITING_S,
                min_probability: 0.0,
                max_harm: 1.0,
                // This planner does not use the apparent slope that the vessel sends.
                friction: 2.0,
                ..base
            },
        }
    }
}
