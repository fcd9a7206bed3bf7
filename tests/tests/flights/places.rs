//! Landings at four places on Earth, using the bytes of all devices. No configuration contains a frame's origin: the
//! vessel's is at its first fix, the drone's where its autopilot was switched on, up to 2 km away.

use alight_shared::msg::State;
use alight_sim::harness::{
    outcome::{Ending, Outcome, TIME_LIMIT_S},
    rig::Rig,
    scenario::{NodeConfigs, PlaceConfig, Scenario},
};

use crate::judged;

/// Scene at position `k` of the four seas.
fn scene(k: usize) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.place.among = vec![scenario.place.among[k]];
    scenario
}

struct Event {
    state: State,
    after_s: f64,
    happen: fn(&mut Rig),
}

fn landed(scenario: &Scenario, seed: u64, event: Option<Event>) -> Outcome {
    let mut rig = Rig::landing(scenario, &NodeConfigs::default(), seed).unwrap();
    let mut pending = event;
    let outcome = judged(&mut rig, seed, TIME_LIMIT_S, |rig| {
        if let Some(event) = pending.take_if(|e| rig.is_due(e.state, e.after_s)) {
            (event.happen)(rig);
        }
    });
    assert!(pending.is_none(), "seed {seed}: ended before");
    outcome
}

/// The vessel's computer restarts in every second landing.
#[test]
fn landings_at_four_places() {
    let mut lost = Vec::new();
    for k in 0..4 {
        let event = (k % 2 == 1).then_some(Event {
            state: State::Approach,
            after_s: 1.0,
            happen: Rig::restart_vessel,
        });
        let outcome = landed(&scene(k), 100 * k as u64, event);
        if outcome.outcome != Ending::Success {
            lost.push((k, outcome));
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}

#[test]
fn heading_resets_in_every_phase() {
    let phases = [(State::Tracking, 0.3), (State::Descent, 1.0), (State::Flare, 0.3)];
    let mut lost = Vec::new();
    for (n, (state, after_s)) in phases.into_iter().enumerate() {
        let event = Event {
            state,
            after_s,
            happen: |rig| rig.world.reset_heading(0, 12.0_f64.to_radians()),
        };
        let outcome = landed(&scene(n % 4), 40 + n as u64, Some(event));
        if outcome.outcome != Ending::Success {
            lost.push((state, after_s, outcome));
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}

#[test]
fn drifting_barometer_and_steel_below_the_compass() {
    let mut lost = Vec::new();
    for seed in 60..64 {
        let mut scenario = scene(seed as usize % 4);
        let navigation = &mut scenario.drone.navigation;
        navigation.barometer_drift_m = 4.0;
        navigation.steel_heading_deg = 15.0;
        let outcome = landed(&scenario, seed, None);
        if outcome.outcome != Ending::Success {
            lost.push((seed, outcome));
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}

/// The vessel's receiver omits the geoid height: according to the radio its deck is 31 m, 55 m or 30 m too
/// low, or 21 m too high. No drone may fly into the sea; a drone that detects the deck from a height that is
/// safe under both assumptions lands.
#[test]
fn vessel_height_without_the_geoid() {
    let mut landed_low = 0;
    for (k, sea) in PlaceConfig::default().among.iter().enumerate() {
        let mut scenario = scene(k);
        scenario.sensors.vessel_gnss.height_error_m = -sea.height_m;
        let outcome = landed(&scenario, 300 + k as u64, None);
        assert!(
            matches!(
                outcome.outcome,
                Ending::Success | Ending::Timeout | Ending::GaveUp
            ),
            "{k}: {outcome:#?}"
        );
        landed_low += u32::from(sea.height_m > 0.0 && outcome.outcome == Ending::Success);
    }
    assert_eq!(landed_low, 3);
}

/// The drone's receiver reports no heights above the ellipsoid; the geoid table, 55 m here, supplies the difference.
#[test]
fn drone_without_ellipsoid_height() {
    let mut scenario = scene(2);
    scenario.drone.navigation.gnss_ellipsoid = false;
    let outcome = landed(&scenario, 322, None);
    assert_eq!(outcome.outcome, Ending::Success, "{outcome:#?}");
}
