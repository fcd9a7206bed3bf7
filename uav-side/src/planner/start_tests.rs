//! Start of a landing's plan: at the drone if it is ahead of the plan, at the plan if it is behind, and in between if
//! it is off to the side.

use alight_shared::geometry::{DeckGeometry, DroneGeometry};

use super::{
    tests::approach::{ABOVE, Approach, MODERATE},
    *,
};

/// Offset between the next plan's start and the last plan, after a descent of two seconds, for a drone that is off its
/// plan by `place` (m) and `faster` (m/s) on this axis.
fn begins(kind: PlannerKind, axis: usize, place: f64, faster: f64) -> [f64; 2] {
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
                drone.position[axis] += place;
                drone.velocity[axis] += faster;
            }
            let plan = planner.step(now, &input).plan?;
            let then = before.and_then(|p| p.sample(now))?;
            let state = planner.problem().state;
            gap.get_or_insert([
                state[axis] - then.position[axis],
                state[6 + axis] - then.velocity[axis],
            ]);
            Some(plan)
        });
    }
    gap.expect("plans")
}

#[test]
fn plan_start_with_a_drone_ahead_or_behind() {
    let [lower, faster] = begins(PlannerKind::Alight, 2, 0.2, 0.4);
    assert!(
        (lower - 0.2).abs() < 0.01 && (faster - 0.3).abs() < 0.03,
        "{lower} {faster}"
    );
    for (kind, lower, faster) in [
        (PlannerKind::Alight, -0.2, -0.4),
        (PlannerKind::MpcFaa, 0.2, 0.4),
        (PlannerKind::MpcFaa, -0.2, -0.4),
    ] {
        let gap = begins(kind, 2, lower, faster);
        assert!(gap[0].abs() < 0.01 && gap[1].abs() < 0.03, "{kind:?} {gap:?}");
    }
}

#[test]
fn plan_start_with_a_drone_aside() {
    // Plans at 50 Hz each close 1 - exp(-0.02 / 0.3) of the gap.
    for axis in [0, 1] {
        let [place, velocity] = begins(PlannerKind::Alight, axis, 0.3, -0.6);
        assert!(
            (0.25..1.5).contains(&(place / 0.02)) && (0.25..1.5).contains(&(velocity / -0.04)),
            "{place} {velocity}"
        );
        let stays = begins(PlannerKind::MpcFaa, axis, 0.3, -0.6);
        assert!(stays[0].abs() < 0.005 && stays[1].abs() < 0.03, "{stays:?}");
    }
}
