//! Scenarios and success rates in the simulated world, and the link to its autopilots: one file per subject,
//! in one program so that linking happens once.

// Test helpers may panic.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod advice;
mod beacon;
mod calibration;
mod contact;
mod deck_reservation;
mod estimate_jumps;
mod estimator;
mod failsafes;
mod faults;
mod hostile_planners;
mod hulls;
mod identity;
mod interrupted_landing;
mod keep_out;
mod ladder;
mod landing;
mod link;
mod moving_base;
mod night;
mod places;
mod radio_link;
mod recorded_motion;
mod review;
mod sorties;
mod stated_course;
mod station;
mod storm;
mod takeoff;
mod under_way;
mod witnesses;

use alight_sim::harness::{
    outcome::{Judge, Outcome},
    rig::Rig,
    scenario::{NodeConfigs, Scenario},
    trial,
};
use alight_uav::autopilot::modes::Firmware;

const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduCopter];

/// Flies for at most `limit_s`; `each` is called after every tick.
fn judged(rig: &mut Rig, seed: u64, limit_s: f64, mut each: impl FnMut(&mut Rig)) -> Outcome {
    let half_deck = [rig.scenario.deck.length_m / 2.0, rig.scenario.deck.width_m / 2.0];
    let mut judge = Judge::default();
    rig.each(limit_s, |rig| {
        each(rig);
        judge.observe(&rig.world.observation(), half_deck)
    });
    judge.outcome(seed, "", "", 0.0)
}

fn landed(scenario: &Scenario, seed: u64) -> Outcome {
    trial::outcome(scenario, &NodeConfigs::default(), seed, "").unwrap()
}
#[track_caller]
fn assert_lands(scenario: &Scenario, seed: u64) -> Outcome {
    let outcome = landed(scenario, seed);
    assert!(outcome.success, "seed {seed}: {}", outcome.reason);
    outcome
}

fn at_sea(sea: &str) -> Scenario {
    Scenario {
        sea: sea.parse().unwrap(),
        ..Scenario::default()
    }
}
