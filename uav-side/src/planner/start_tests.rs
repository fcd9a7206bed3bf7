//! Where a plan of the landing begins: with the drone when that is ahead, with the plan when it is behind.

use alight_shared::geometry::{DeckGeometry, DroneGeometry};

use super::tests::approach::{ABOVE, Approach, MODERATE};
use super::*;

/// A descent of two seconds, then one odometry with the drone `lower` (m) and sinking `faster` (m/s) than its
/// plan. Gives how much lower and faster the plan begins than the last plan had it.
fn begins(kind: PlannerKind, lower: f64, faster: f64) -> [f64; 2] {
    let config = PlannerConfig {
        kind,
        ..PlannerConfig::default()
    };
    let mut planner = Planner::new(&config, &DroneGeometry::default(), &DeckGeometry::default(), 1);
    let mut flown = Approach::new(MODERATE, ABOVE, 1.0);
    let mut before = None;
    for _ in 0..299 {
        flown.tick(|now, input| {
            let plan = planner.step(now, input).plan;
            before = plan.or(before);
            plan
        });
    }
    let mut gap = None;
    for _ in 0..20 {
        flown.tick(|now, input| {
            let mut input = input.clone();
            if let Some(drone) = &mut input.drone {
                drone.position[2] += lower;
                drone.velocity[2] += faster;
            }
            let plan = planner.step(now, &input).plan?;
            let then = before.and_then(|p| p.sample(now))?;
            let state = planner.problem().state;
            gap.get_or_insert([state[2] - then.position[2], state[8] - then.velocity[2]]);
            Some(plan)
        });
    }
    gap.expect("plans")
}

#[test]
fn plan_start_follows_a_drone_ahead_of_its_plan_and_not_one_behind() {
    let [lower, faster] = begins(PlannerKind::Alight, 0.2, 0.4);
    assert!(
        (lower - 0.2).abs() < 0.01 && (faster - 0.3).abs() < 0.03,
        "{lower} {faster}"
    );
    for (kind, lower, faster) in [
        (PlannerKind::Alight, -0.2, -0.4),
        (PlannerKind::MpcFaa, 0.2, 0.4),
        (PlannerKind::MpcFaa, -0.2, -0.4),
    ] {
        let gap = begins(kind, lower, faster);
        assert!(gap[0].abs() < 0.01 && gap[1].abs() < 0.03, "{kind:?} {gap:?}");
    }
}
