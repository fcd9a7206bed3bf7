//! The planner's process dies for good near the deck of a vessel under way: the drone completes the landing or leaves
//! with the deck, which must not pass beneath a drone that holds a fixed place.
// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use alight_shared::msg::{CommandKind, Phase};
use alight_sim::harness::outcome::MAX_CONTACT_MPS;
use alight_sim::harness::physics::TICK;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::world::World;
use alight_sim::physics::sea::SeaConfig;
use alight_sim::physics::vessel::Course;

/// Time in which it comes so low, s.
const LIMIT_S: f64 = 150.0;
/// Flown on without plans, s.
const REST_S: f64 = 20.0;

/// Until its feet are so high above the deck the drone has to move with it, m.
const CLEAR_M: f64 = 3.0;
/// So far from above the deck's centre, at most, m.
const STRAYED_M: f64 = 3.0;

/// The hardest contact (m/s) when the planner dies this high (feet above the deck, m), whether it flew into the water,
/// and how far from above the deck's centre it came before it was clear of the deck (m).
fn flown(height_m: f64, seed: u64) -> (f64, bool, f64) {
    let mut scenario = Scenario {
        sea: SeaConfig::paper(0.3, 5.0),
        ..Scenario::default()
    };
    scenario.vessel.course = Course::Straight;
    scenario.vessel.speed_mps = 7.0;
    // As much more as its drag takes there.
    scenario.vessel.thrust_forward_n = 250.0 * (7.0_f64 / 1.5).powi(2);
    scenario.vessel.thrust_reverse_n = 100.0 * (7.0_f64 / 1.5).powi(2);
    let mut world = World::new(&scenario, &NodeConfigs::default(), seed).unwrap();
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    let (mut died, mut hardest_mps, mut lost, mut strayed_m) = (None, 0.0_f64, false, 0.0_f64);
    let mut near = true;
    for _ in 0..(LIMIT_S / TICK.secs()) as u32 {
        world.tick(&mut NoTap);
        let t = world.physics().time_since_start().secs();
        let landing = world.mission_state().state.phase() == Phase::Landing;
        let o = world.observation();
        let height = o.feet_height_m();
        hardest_mps = o.contacts.iter().fold(hardest_mps, |h, c| h.max(c.normal_mps));
        // A drone that landed may slide there all the same: such a deck is no safe one at this speed.
        lost |= o.in_water && o.motors_on;
        near &= o.motors_on && (died.is_none() || height < CLEAR_M);
        if died.is_some() && near {
            strayed_m = strayed_m.max(o.horizontal_m);
        }
        if landing && height < height_m && died.is_none() {
            died = Some(t);
            world.kill_planner(0);
        }
        if died.is_some_and(|at| t > at + REST_S) {
            break;
        }
    }
    assert!(
        died.is_some(),
        "it never came so low: {:?}",
        world.mission_state()
    );
    (hardest_mps, lost, strayed_m)
}

#[test]
fn drone_without_plans_near_a_deck_at_7_mps_stays_with_the_deck() {
    let mut wrong = Vec::new();
    for height_m in [3.0, 1.5, 0.5] {
        for seed in 61..65 {
            let (hardest_mps, lost, strayed_m) = flown(height_m, seed);
            if hardest_mps > MAX_CONTACT_MPS || lost || strayed_m > STRAYED_M {
                wrong.push(format!(
                    "{height_m} m, seed {seed}: {hardest_mps:.2} m/s, lost {lost}, strayed {strayed_m:.1} m"
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{} of 12:\n{}", wrong.len(), wrong.join("\n"));
}
