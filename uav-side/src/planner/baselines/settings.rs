//! What a planner's kind changes outside the planner, in one place: which sources the predictor may
//! use, and those of the mission's figures that assume another planner. Everything not named here is
//! the same for all.

use crate::mission::MissionConfig;
use crate::planner::PlannerKind;
use crate::predictor::PredictorConfig;

/// While the newest tag sighting is younger than this, planners that land by sight alone hear no
/// radio, s. Longer than the last, blind metre of a descent; the mission goes back to approaching by
/// radio after 5 s without sight.
const VISION_ONLY_S: f64 = 4.5;
/// Waiting over the deck is these planners' way to land, so a descent may last, s.
const WAITING_S: f64 = 120.0;
/// Clearance at which the paper's planner flares, m. Not published; v_fa = 0.5 m/s for a second. Below 0.55 m
/// the tag is out of view, so a flare from 0.9 m took 0.25 s more of drift into the contact. Seeds from 100,
/// 0.9 m and 0.5 m: 0,0 0.048 and 0.037 m, 0.5,5 0.064 and 0.047, 0.4,4 0.071 and 0.058, 0.8,5 0.091 and
/// 0.074; tilt p95 at 0.5,5 1.37 and 1.03 deg; all land, at the same speed.
const PAPER_FLARE_M: f64 = 0.5;
/// How far the deck may be from the height that two receivers of 1 m each give it: two standard
/// deviations, m.
const UNKNOWN_HEIGHT_M: f64 = 2.8;

impl PlannerKind {
    /// The predictor of this planner.
    pub fn predictor(self, base: PredictorConfig) -> PredictorConfig {
        match self {
            PlannerKind::MpcFaa | PlannerKind::Mpc | PlannerKind::Alight | PlannerKind::WaitCalm => base,
            // Tag alone once it has been seen; the radio only leads there.
            PlannerKind::MpcNe | PlannerKind::PrecisionLand => PredictorConfig {
                use_wave_model: false,
                radio_after_vision_s: VISION_ONLY_S,
                ..base
            },
            PlannerKind::GnssRadio => PredictorConfig {
                use_wave_model: false,
                use_vision: false,
                ..base
            },
        }
    }

    /// The mission of this planner.
    pub fn mission(self, base: MissionConfig) -> MissionConfig {
        match self {
            PlannerKind::Alight => base,
            // With and without alignment flare alike.
            PlannerKind::MpcFaa | PlannerKind::Mpc => MissionConfig {
                flare_clearance_m: base.flare_clearance_m.min(PAPER_FLARE_M),
                commit_clearance_m: base.commit_clearance_m.min(PAPER_FLARE_M),
                ..base
            },
            PlannerKind::WaitCalm => MissionConfig {
                descent_timeout_s: WAITING_S,
                ..base
            },
            // Ignores surge and sway by design and lands on a tilted deck only by mistake: conditions
            // on distance, speed and tilt at the gate would keep it up for ever, and its own barrier
            // is what decides.
            PlannerKind::MpcNe => MissionConfig {
                descent_timeout_s: WAITING_S,
                flare_timeout_s: WAITING_S,
                flare_distance_m: 1.0,
                flare_speed_mps: 2.0,
                flare_tilt_rad: 1.0,
                break_distance_m: 1.5,
                ..without_slope_warnings(base)
            },
            PlannerKind::PrecisionLand => without_slope_warnings(base),
            // There is no sight to wait for, and two receivers of 1 m each would never be known
            // well enough. The deck may be metres higher or lower than believed: slowly from well
            // above it, and on down to where it has to be met or is not there.
            PlannerKind::GnssRadio => MissionConfig {
                vision_required: false,
                horizontal_sd_m: 5.0,
                vertical_sd_m: 5.0,
                flare_clearance_m: UNKNOWN_HEIGHT_M,
                decision_clearance_m: UNKNOWN_HEIGHT_M + 0.7,
                missed_m: UNKNOWN_HEIGHT_M,
                flare_timeout_s: 2.0 * UNKNOWN_HEIGHT_M / base.flare_mps + 4.0,
                ..without_slope_warnings(base)
            },
        }
    }
}

/// A mission that does not ask how steep the deck felt of late: these planners have no vessel that says so.
fn without_slope_warnings(base: MissionConfig) -> MissionConfig {
    MissionConfig {
        slide_slope: 100.0,
        slope_limit: 100.0,
        ..base
    }
}
