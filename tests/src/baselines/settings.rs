//! What a baseline changes outside the planner: which sources the predictor may use, and those of the
//! mission's parameters that assume another planner. Everything not named here is the same for all.

use alight_uav::mission::MissionConfig;
use alight_uav::planner::PlannerKind;
use alight_uav::predictor::PredictorConfig;

use super::Baseline;

/// While the newest tag detection is younger than this, planners that land by vision alone use no
/// radio, s. Longer than the last, blind metre of a descent; the mission goes back to approaching by
/// radio after 5 s without vision.
const VISION_ONLY_S: f64 = 4.5;
/// Waiting over the deck is these planners' way to land, so a descent may last, s.
const WAITING_S: f64 = 120.0;
/// How far the deck may be from the height that two receivers of 1 m each give it: two standard
/// deviations, m.
const UNKNOWN_HEIGHT_M: f64 = 2.8;

impl Baseline {
    /// The predictor of this planner.
    pub fn predictor(&self, base: PredictorConfig) -> PredictorConfig {
        match self {
            Baseline::Mpc | Baseline::WaitCalm(_) => base,
            // Tag alone once it has been detected; the radio only leads there.
            Baseline::MpcNe(_) | Baseline::PrecisionLand(_) => PredictorConfig {
                use_wave_model: false,
                radio_after_vision_s: VISION_ONLY_S,
                ..base
            },
            Baseline::GnssRadio(_) => PredictorConfig {
                use_wave_model: false,
                use_vision: false,
                ..base
            },
        }
    }

    /// The mission of this planner.
    pub fn mission(&self, base: MissionConfig) -> MissionConfig {
        match self {
            // With and without alignment flare alike.
            Baseline::Mpc => PlannerKind::MpcFaa.mission(base),
            Baseline::WaitCalm(_) => MissionConfig {
                descent_timeout_s: WAITING_S,
                ..base
            },
            // Ignores surge and sway by design and lands on a tilted deck only by mistake: conditions on
            // distance, speed and tilt at the decision clearance would keep it up for ever, and its own
            // barrier is what decides.
            Baseline::MpcNe(_) => MissionConfig {
                descent_timeout_s: WAITING_S,
                flare_timeout_s: WAITING_S,
                min_probability: 0.0,
                ..without_slope_warnings(base)
            },
            Baseline::PrecisionLand(_) => without_slope_warnings(base),
            // There is no vision to wait for, and two receivers of 1 m each would never be known well
            // enough. The deck may be metres higher or lower than estimated: slowly from well above it, and
            // on down to where it has to be met or is not there.
            Baseline::GnssRadio(_) => MissionConfig {
                vision_required: false,
                min_probability: 0.0,
                flare_clearance_m: UNKNOWN_HEIGHT_M,
                decision_clearance_m: UNKNOWN_HEIGHT_M + 0.7,
                missed_m: UNKNOWN_HEIGHT_M,
                flare_timeout_s: 2.0 * UNKNOWN_HEIGHT_M / base.flare_mps + 4.0,
                ..without_slope_warnings(base)
            },
        }
    }
}

/// A mission that does not ask for the deck's apparent slope: these planners have no vessel that reports it.
fn without_slope_warnings(base: MissionConfig) -> MissionConfig {
    MissionConfig {
        friction: 2.0,
        ..base
    }
}
