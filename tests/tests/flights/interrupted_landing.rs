//! An operator, or the end of the planner's process, interrupts a landing near a deck under way. The drone
//! completes the landing or leaves with the deck; the deck must not pass beneath a drone at a fixed position.

use alight_sim::{
    harness::scenario::NodeConfigs,
    studies::aborts::{Interruption, drive, fly},
};

use crate::at_sea;

/// Unsafe flights after interruptions at these heights (m) with these seeds.
fn unsafe_flights(
    interruption: Interruption,
    heights_m: &[f64],
    seeds: core::ops::Range<u64>,
) -> Vec<String> {
    let mut scenario = at_sea("0.3,5");
    drive(&mut scenario, 7.0);
    let mut wrong = Vec::new();
    for height_m in heights_m {
        for seed in seeds.clone() {
            let nodes = NodeConfigs::default();
            let flown = fly(&scenario, &nodes, seed, interruption, *height_m).unwrap();
            let flown = flown.unwrap_or_else(|| panic!("seed {seed} never descended to {height_m} m"));
            if !flown.safe() {
                wrong.push(format!("{height_m} m, seed {seed}: {flown:?}"));
            }
        }
    }
    wrong
}

#[test]
#[ignore = "6 flights; CI runs them by name"]
fn plans_lost_near_a_deck_at_7_mps() {
    let wrong = unsafe_flights(Interruption::PlanLost, &[3.0, 1.5, 0.5], 60..62);
    assert!(wrong.is_empty(), "{} of 6:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
#[ignore = "8 flights; CI runs them by name"]
fn abort_and_hold_near_a_deck_at_7_mps() {
    for interruption in [Interruption::Abort, Interruption::Hold] {
        let wrong = unsafe_flights(interruption, &[1.5, 0.3], 61..63);
        assert!(wrong.is_empty(), "{} of 4:\n{}", wrong.len(), wrong.join("\n"));
    }
}
