//! Planners that would destroy the drone, drawn by the seed: the pilot lets none of them touch beyond the limits.

use core::f64::consts::TAU;

use alight_shared::{msg::Plan, process::ProcessKind, wire};
use alight_sim::harness::{
    bus::BusSide, observer::NoObserver, outcome::Outcome, scenario::NodeConfigs, trial, world::World,
};
use alight_uav::planner::PlannerKind;

use crate::{
    at_sea,
    keep_out::{known, vessel},
};

/// Changes the own planner's plan by the kind and size of `seed`, for half of the seeds only before the touchdown.
fn change(seed: u64, plan: &mut Plan, old: &mut Plan) {
    let kind = seed / 4 % 7;
    let size = wire::hash_record(&seed).unwrap() as f64 / u64::MAX as f64;
    let left_s = plan.touchdown_at.map_or(10.0, |at| (at - plan.header.at).secs());
    if seed / 2 % 2 == 1 && left_s > 2.0 * size {
        return;
    }
    let (sin, cos) = (TAU * size).sin_cos();
    let adds = match kind {
        // Aside: over the edge of the deck, into the mast; and down.
        0 => [3.0 * cos, 3.0 * sin, 0.0],
        1 => [0.0, 0.0, 0.5 + 5.0 * size],
        _ => [0.0; 3],
    };
    let step_s = plan.step.secs();
    for (k, stage) in plan.stages.iter_mut().enumerate() {
        let t = k as f64 * step_s;
        for (i, speed) in adds.into_iter().enumerate() {
            stage.position[i] += speed * t;
            stage.velocity[i] += speed;
        }
        match kind {
            // Fast, tilted, jumping, braking less.
            2 => stage.velocity = stage.velocity.map(|v| v * (1.0 + 3.0 * size)),
            3 => stage.euler[0] += 0.2 + 2.8 * size,
            4 if t > 0.5 => stage.position[2] += 500.0 * size.powi(3),
            5 => stage.acceleration[2] += 2.0 + 7.0 * size,
            _ => {}
        }
    }
    if (plan.header.at - old.header.at).secs() > 1.5 * size {
        *old = *plan;
    }
    // Late: the stages of an older plan.
    if kind == 6 {
        plan.stages = old.stages;
    }
}

/// Lands with a hostile planner, for every second seed under way next to a mast. Returns whether plans were refused.
fn land(seed: u64) -> bool {
    let (scenario, nodes) = match seed % 2 {
        0 => vessel(2.0, known()),
        _ => (at_sea("0.6,5"), NodeConfigs::default()),
    };
    let mut old = Plan::default();
    let world = World::new(&scenario, &nodes, seed).unwrap();
    let bus = &world.drones()[0].bus;
    bus.wrap(
        ProcessKind::Pilot,
        BusSide::Read,
        move |_, mut plans: Vec<Plan>| {
            plans.iter_mut().for_each(|plan| change(seed, plan, &mut old));
            plans
        },
    );
    let watch = trial::Watch {
        on_event: &mut |_| (),
        trace_step_s: None,
    };
    let o: Outcome = trial::land(world, &scenario, &nodes, seed, "", watch, &mut NoObserver).outcome;
    println!("seed {seed}: {:.3} refused, {}", o.refused_plans, o.reason);
    let collisions = o.keep_out_collisions.unwrap_or(0);
    assert_eq!(
        o.unsafe_contacts + o.water_contacts + collisions,
        0,
        "seed {seed}: {}",
        o.reason
    );
    o.refused_plans > 0.0
}

#[test]
fn hostile_planners_touch_nothing_beyond_the_limits() {
    let refused = (0..14).filter(|seed| land(2 * seed + seed % 2)).count();
    assert!(refused > 7, "{refused} of 14");
}

#[test]
#[ignore = "500 flights"]
fn many_hostile_planners_within_the_limits() {
    for seed in 10_000..10_500 {
        land(seed);
    }
}

#[test]
fn plans_of_the_own_planners_are_admitted() {
    for kind in [PlannerKind::Alight, PlannerKind::MpcFaa] {
        let mut nodes = NodeConfigs::default();
        nodes.drone.planner.kind = kind;
        let o = trial::outcome(&at_sea("0.6,5"), &nodes, 20_001, "").unwrap();
        assert!(o.refused_plans < 0.02, "{kind:?}: {}", o.refused_plans);
    }
}
