//! Landings at four places on Earth, where no configuration says where a frame begins: the vessel's at her first fix,
//! the drone's where its autopilot was switched on, up to 2 km away.
// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use alight_shared::msg::{CommandKind, State};
use alight_sim::harness::outcome::{Ending, Judge, Outcome, TIME_LIMIT_S};
use alight_sim::harness::physics::TICK;
use alight_sim::harness::scenario::{NodeConfigs, PlaceConfig, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::world::World;

/// The scene at the place number `k` of the four seas.
fn scene(k: usize) -> Scenario {
    let seas = PlaceConfig::four_seas();
    let place = PlaceConfig {
        among: vec![seas.among[k]],
        ..seas
    };
    Scenario {
        place,
        ..Scenario::default()
    }
}

/// What happens on the way, this long (s) after the mission entered this state.
#[derive(Clone, Copy)]
enum Event {
    None,
    /// The vessel's computer starts anew.
    VesselRestarts(State, f64),
    /// The heading that the autopilot believes jumps by so much, rad.
    HeadingReset(State, f64, f64),
}

/// How a landing ends.
fn landed(scenario: &Scenario, seed: u64, event: Event) -> Outcome {
    let nodes = NodeConfigs::default();
    let mut world = World::new(scenario, &nodes, seed).unwrap();
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    let half_deck = [scenario.deck.length_m / 2.0, scenario.deck.width_m / 2.0];
    let mut judge = Judge::default();
    let (mut entered, mut happened) = ((State::Idle, 0.0), matches!(event, Event::None));
    for _ in 0..(TIME_LIMIT_S / TICK.secs()) as u32 {
        world.tick(&mut NoTap);
        let t_s = world.physics().time_since_start().secs();
        let state = world.mission_state().state;
        if state != entered.0 {
            entered = (state, t_s);
        }
        let is_due = |at: State, after_s: f64| !happened && state == at && t_s >= entered.1 + after_s;
        match event {
            Event::VesselRestarts(at, after_s) if is_due(at, after_s) => {
                world.restart_vessel(&nodes);
                happened = true;
            }
            Event::HeadingReset(at, after_s, by_rad) if is_due(at, after_s) => {
                world.reset_heading(0, by_rad);
                happened = true;
            }
            Event::None | Event::VesselRestarts(..) | Event::HeadingReset(..) => {}
        }
        if judge.observe(&world.observation(), half_deck) {
            break;
        }
    }
    assert!(happened, "seed {seed}: ended before");
    judge.outcome(seed, "", "", 0.0)
}

/// All `seeds` at all places, half of them with a restart.
fn all_land(seeds: u64) {
    let mut lost = Vec::new();
    for k in 0..4 {
        for seed in 0..seeds {
            let event = match seed % 2 {
                1 => Event::VesselRestarts(State::Approach, 1.0 + 0.3 * seed as f64),
                _ => Event::None,
            };
            let outcome = landed(&scene(k), 100 * k as u64 + seed, event);
            if outcome.outcome != Ending::Success {
                lost.push((k, seed, outcome));
            }
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}

#[test]
fn landings_at_four_places() {
    all_land(2);
}

#[test]
#[ignore = "40 trials: a minute"]
fn forty_landings_at_four_places() {
    all_land(10);
}

#[test]
fn heading_resets_in_every_phase_over_the_deck() {
    let phases = [
        (State::Approach, 2.0),
        (State::Tracking, 0.3),
        (State::Descent, 1.0),
        (State::Descent, 3.0),
        (State::Flare, 0.3),
    ];
    let mut lost = Vec::new();
    for (n, (state, after_s)) in phases.into_iter().enumerate() {
        let event = Event::HeadingReset(state, after_s, 12.0_f64.to_radians());
        let outcome = landed(&scene(n % 4), 40 + n as u64, event);
        if outcome.outcome != Ending::Success {
            lost.push((state, after_s, outcome));
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}

#[test]
fn drifting_barometer_and_steel_below_the_compass() {
    let mut lost = Vec::new();
    for seed in 60..68 {
        let mut scenario = scene(seed as usize % 4);
        let navigation = &mut scenario.drone.navigation;
        (navigation.barometer_drift_m, navigation.steel_heading_deg) = (4.0, 15.0);
        let outcome = landed(&scenario, seed, Event::None);
        if outcome.outcome != Ending::Success {
            lost.push((seed, outcome));
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}
