//! Keep-out volumes under way in a moderate sea: a mast forward of the deck and an A-frame abeam. Drones that
//! receive the volumes stay clear of both, approach within the sector, and leave along the escape direction.

use alight_shared::surroundings::SurroundingsConfig;
use alight_sim::{
    harness::{
        outcome::Outcome,
        scenario::{NodeConfigs, Scenario},
        trace::TracePoint,
        trial::{self, Watch},
    },
    studies::aborts::{Interruption, drive, fly},
};

use crate::at_sea;

/// The mast rises 8 m above the deck (1 m above the waiting height without it), the A-frame 3.5 m.
pub const KEEP_OUT_M: [[[f64; 3]; 2]; 2] = [
    [[2.2, -0.2, -9.3], [2.6, 0.2, 0.0]],
    [[-1.2, 1.6, -4.8], [1.2, 2.0, -0.5]],
];

pub fn vessel(speed_mps: f64, surroundings: SurroundingsConfig) -> (Scenario, NodeConfigs) {
    let mut scenario = at_sea("0.4,5");
    scenario.keep_out_m = KEEP_OUT_M.to_vec();
    drive(&mut scenario, speed_mps);
    let mut nodes = NodeConfigs::default();
    nodes.vessel.surroundings = surroundings;
    (scenario, nodes)
}

pub fn known() -> SurroundingsConfig {
    SurroundingsConfig {
        keep_out_m: KEEP_OUT_M.to_vec(),
        ..SurroundingsConfig::default()
    }
}

fn land((scenario, nodes): &(Scenario, NodeConfigs), seed: u64) -> (Outcome, Vec<TracePoint>) {
    let watch = Watch {
        on_event: &mut |_| (),
        trace_step_s: Some(0.05),
    };
    let flown = trial::fly(scenario, nodes, seed, "0.4,5", watch).unwrap();
    (flown.outcome, flown.trace.unwrap().points)
}

#[test]
fn landing_next_to_a_mast() {
    let without = vessel(2.0, SurroundingsConfig::default());
    let with = vessel(2.0, known());
    // Without the volumes, the drone approaches from the mast's side.
    let (before, _) = land(&without, 33);
    assert_eq!(before.keep_out_collisions, Some(1));
    let (after, _) = land(&with, 33);
    let gap = after.keep_out_gap_m.unwrap();
    assert!(after.success && gap > 0.5, "{gap} {}", after.reason);
}

#[test]
fn approach_through_the_sector() {
    let sector = SurroundingsConfig {
        approach_sector_deg: [120.0, 240.0],
        ..known()
    };
    let world = vessel(2.0, sector.clone());
    let around = sector.around(&world.0.deck);
    let (o, points) = land(&world, 33);
    assert!(o.success, "{}", o.reason);
    let mut worst = 0.0_f64;
    for p in &points {
        let north = p.drone[0] - p.deck[0];
        let east = p.drone[1] - p.deck[1];
        // Only points between the deck and a distance clear of the vessel count.
        if (3.5..9.5).contains(&north.hypot(east)) {
            let out = around.outside_sector(east.atan2(north) - p.deck_yaw, 0.0);
            worst = worst.max(out.abs().to_degrees());
        }
    }
    // Margin for the vessel's yaw about its mean heading.
    assert!(worst < 5.0, "{worst} deg outside the sector");
}

#[test]
fn hold_ahead_of_a_mast_under_way() {
    let astern = vec![[[-3.4, -0.3, -9.3], [-3.0, 0.3, 0.0]]];
    for informed in [false, true] {
        let mut around = SurroundingsConfig::default();
        if informed {
            around.keep_out_m = astern.clone();
        }
        let (mut scenario, nodes) = vessel(4.0, around);
        scenario.keep_out_m = astern.clone();
        let flown = fly(&scenario, &nodes, 10, Interruption::Hold, 3.0).unwrap();
        let flown = flown.unwrap();
        assert_eq!(flown.collided, !informed, "{flown:?}");
    }
}

#[test]
fn escape_clear_of_every_volume() {
    let around = SurroundingsConfig {
        escape_deg: Some(180.0),
        ..known()
    };
    let (scenario, nodes) = vessel(4.0, around);
    for (interruption, seed, height_m) in [
        (Interruption::Abort, 10, 5.0),
        (Interruption::PlanLost, 33, 3.0),
        (Interruption::Abort, 22, 1.5),
        (Interruption::PlanLost, 58, 0.5),
    ] {
        let flown = fly(&scenario, &nodes, seed, interruption, height_m).unwrap();
        let safe = flown.as_ref().is_some_and(|f| f.safe());
        assert!(safe, "{interruption:?} at {height_m} m, seed {seed}: {flown:?}");
    }
}
