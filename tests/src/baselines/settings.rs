//! Changes by a baseline outside the planner: which sources the predictor may use, and those of the
//! mission's parameters that assume another planner. Everything not named here is the same for all.

use alight_uav::mission::MissionConfig;
use alight_uav::planner::PlannerKind;
use alight_uav::predictor::PredictorConfig;

use super::Baseline;

/// While the newest tag detection is younger than this, `mpc-ne`, which lands by vision alone, uses no
/// radio, s. Longer than the last, blind metre of a descent; the mission goes back to approaching by
/// radio after 5 s without vision.
const VISION_ONLY_S: f64 = 4.5;
/// Waiting over the deck is its way to land, so a descent may last, s.
const WAITING_S: f64 = 120.0;

impl Baseline {
    /// The predictor of this planner.
    pub fn predictor(&self, base: PredictorConfig) -> PredictorConfig {
        match self {
            Baseline::Mpc => base,
            // Tag alone once it has been detected; the radio only leads there.
            Baseline::MpcNe => PredictorConfig {
                use_wave_model: false,
                radio_after_vision_s: VISION_ONLY_S,
                ..base
            },
        }
    }

    /// The mission of this planner.
    pub fn mission(&self, base: MissionConfig) -> MissionConfig {
        match self {
            // With and without alignment flare alike.
            Baseline::Mpc => PlannerKind::MpcFaa.mission(base),
            // Ignores surge and sway by design and lands on a tilted deck only by mistake: conditions on
            // distance, speed and tilt at the decision clearance would keep it up for ever, and its own
            // barrier is what decides.
            Baseline::MpcNe => MissionConfig {
                descent_timeout_s: WAITING_S,
                flare_timeout_s: WAITING_S,
                min_probability: 0.0,
                max_harm: 1.0,
                // It has no vessel that reports the deck's apparent slope.
                friction: 2.0,
                ..base
            },
        }
    }
}
