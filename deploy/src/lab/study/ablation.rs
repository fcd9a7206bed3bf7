//! What `alight` is made of, each ingredient switched off in turn by the configuration.

use alight_shared::config::{Check, Keys};
use alight_sim::baselines::BenchPlanner;
use alight_sim::harness::scenario::NodeConfigs;
use alight_uav::pilot::config::Output;
use alight_uav::planner::PlannerKind;
use alight_uav::planner::rendezvous::config::WeightSchedule;
use alight_uav::planner::weights::FaaDistance;

use super::variant::{Change, PlannerVariant};

/// Seas of the study: the paper's Moderate, its steepest and its shortest.
pub const SEAS: [&str; 3] = ["0.5,5", "0.8,5", "0.4,4"];

/// What flies in the place of an ingredient, and how.
const INGREDIENTS: [(&str, Change); 16] = [
    // The instant of contact is not chosen.
    ("earliest instant", |n| {
        n.drone.planner.rendezvous.touchdown_time.window_s = 0.0;
    }),
    // Attitude is not matched at the contact.
    ("no attitude alignment", |n| {
        let r = &mut n.drone.planner.rendezvous;
        let none = WeightSchedule {
            far: 0.0,
            contact: 0.0,
        };
        (r.tilt, r.rates) = (none, none);
    }),
    // Weights grow with the drone's present height, as in the paper, not with that of the stage.
    ("weights by present height", |n| {
        n.drone.planner.rendezvous.distance = FaaDistance::Current;
    }),
    // The linear model's a = g tilt.
    ("a = g tilt", |n| n.drone.planner.rendezvous.true_tilt = false),
    // The pilot's commands do not lead the attitude loop, nor is its lag made up for: believed 0.02 s, what
    // the loop is laid out for too, so that commands keep their size.
    ("no attitude lag", |n| {
        let p = &mut n.drone.pilot;
        (p.lag.design_s, p.lag.bounds_s, p.tracking.rate_lag_s) = (0.02, [0.02; 2], 0.0);
    }),
    // The lag is what the airframe's owner says.
    ("lag not learnt", |n| n.drone.pilot.lag.prior_rad2s = 10.0),
    // The plan does not allow for the wind.
    ("no wind in the plan", |n| {
        n.drone.planner.rendezvous.wind.limit_mps2 = 0.0;
    }),
    // The autopilot closes the position loop.
    ("autopilot's position loop", |n| {
        n.drone.pilot.output = Output::Trajectory;
    }),
    // v_la of the paper.
    ("descent at 1 m/s", |n| {
        n.drone.planner.rendezvous.profile.sink_mps = 1.0;
    }),
    // v_fa of the paper.
    ("contact at 0.5 m/s", |n| {
        let p = &mut n.drone.planner.rendezvous.profile;
        (p.touch_mps, p.soft_s) = (0.5, 0.0);
    }),
    // The reference ends on the deck.
    ("no pressing down", |n| {
        n.drone.planner.rendezvous.profile.press_m = 0.01;
    }),
    // The deck's heave is followed from wherever the descent begins.
    ("heave from afar", |n| {
        let p = &mut n.drone.planner.rendezvous.profile;
        (p.heave_below_m, p.mean_above_m) = (20.0, 25.0);
    }),
    // A landing goes on from the plan of following.
    ("begins at the plan", |n| {
        n.drone.planner.rendezvous.start_from_measured = false;
    }),
    // Position and velocity as the autopilot says them, corrected by every fix.
    ("autopilot's odometry", |n| n.drone.odometry.smooth = false),
    // The vessel's estimate by radio, but not what it knows of the waves.
    ("no wave model", |n| n.drone.predictor.use_wave_model = false),
    // Once the tag has been seen, nothing by radio.
    ("no radio after sight", |n| {
        n.drone.predictor.use_wave_model = false;
        n.drone.predictor.radio_after_vision_s = 4.5;
    }),
];

/// `alight` whole, then without each ingredient. Refused when the base leaves no room for a switch.
pub fn planners(base: &NodeConfigs) -> Result<Vec<PlannerVariant>, String> {
    let kind = BenchPlanner::Flight(PlannerKind::Alight);
    let mut all = vec![PlannerVariant::from(kind)];
    for (name, change) in INGREDIENTS {
        let flown = PlannerVariant {
            name: format!("{}, {name}", kind.name()),
            kind,
            change: Some(change),
        };
        let nodes = flown.nodes(base);
        nodes
            .drone
            .check(&Keys::ROOT)
            .map_err(|e| format!("switching to `{name}`: {e}"))?;
        all.push(flown);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ablation_switches() {
        let base = NodeConfigs::default();
        let all = planners(&base).unwrap();
        assert_eq!(all.len(), 1 + INGREDIENTS.len());
        for (i, f) in all.iter().enumerate().skip(1) {
            assert_ne!(f.nodes(&base), base, "{} changes nothing", f.name);
            for g in &all[..i] {
                assert_ne!(f.nodes(&base), g.nodes(&base), "{} is {}", f.name, g.name);
            }
        }
    }
}
