//! A vessel located by its beacon alone: the drone flies to the beacon's position, searches for the tags
//! there and lands by them.

use alight_shared::msg::{ReasonCode, State, VesselLevel};
use alight_sim::{
    harness::{
        outcome::Outcome,
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
        storm::{Fault, FaultKind, Moment, Schedule},
    },
    physics::vessel::response::HULLS,
    sensors::beacon::BeaconConfig,
};

use crate::{at_sea, judged};

/// Silent vessel 300 m away, whose beacon has an error of 5 m and a rate of 1 Hz.
fn scenario() -> Scenario {
    let mut scenario = at_sea("0.5,5");
    scenario.radio.loss = 1.0;
    scenario.start.distance_m = [300.0, 300.0];
    scenario.start.height_m = [20.0, 30.0];
    scenario.sensors.beacon = Some(BeaconConfig::default());
    scenario
}
fn nodes() -> NodeConfigs {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.min_vessel = VesselLevel::Beacon;
    nodes
}

fn flown(scenario: &Scenario, nodes: &NodeConfigs, seed: u64, limit_s: f64) -> (Rig, Outcome) {
    let mut rig = Rig::landing(scenario, nodes, seed).unwrap();
    let mut faults = Schedule::new(&scenario.faults);
    let outcome = judged(&mut rig, seed, limit_s, |rig| faults.act(rig));
    (rig, outcome)
}
/// Asserts that the drone finds the tags, and touches nothing else.
#[track_caller]
fn assert_found(scenario: &Scenario, nodes: &NodeConfigs, seed: u64, limit_s: f64) {
    let (rig, outcome) = flown(scenario, nodes, seed, limit_s);
    let states = rig.visited(0);
    assert!(states.contains(&State::Tracking), "{states:?}, {:?}", rig.reasons);
    assert_eq!(outcome.unsafe_contacts, 0, "{outcome:?}");
}

#[test]
fn deck_found_by_its_beacon() {
    assert_found(&scenario(), &nodes(), 700, 120.0);
}

/// The deck is 30 m to the side of its beacon. It is not found, and the search ends.
#[test]
fn deck_that_is_not_at_its_beacon() {
    let mut scenario = scenario();
    scenario.start.distance_m = [60.0, 60.0];
    scenario.sensors.beacon = Some(BeaconConfig {
        bias_sd_m: 60.0,
        stated_factor: 0.1,
        ..BeaconConfig::default()
    });
    let (rig, outcome) = flown(&scenario, &nodes(), 701, 150.0);
    let states = rig.visited(0);
    assert!(
        !states.contains(&State::Tracking) && outcome.attempts == 0,
        "{states:?}"
    );
    assert!(states.ends_with(&[State::Search, State::GaveUp]), "{states:?}");
    assert!(rig.reasons.contains(&ReasonCode::NotFound), "{:?}", rig.reasons);
}

/// A vessel 150 m away without ultraviolet markers, received until the drone is on its way, and then never
/// again. The drone flies to the predicted position and searches for the tags.
#[test]
fn radio_lost_for_good_on_the_way() {
    let mut scenario = Scenario::default();
    let mut nodes = nodes();
    scenario.sea = "jonswap:0.5,5".parse().unwrap();
    scenario.install_hull(&mut nodes, HULLS[1]).unwrap();
    scenario.start.distance_m = [150.0, 150.0];
    scenario.sensors.uvdar.max_range_m = 0.0;
    let on_its_way = Moment::In(State::GetAltitude);
    scenario.faults = vec![Fault::new(FaultKind::RadioLost, on_its_way, 0.0, f64::INFINITY)];
    assert_found(&scenario, &nodes, 500, 60.0);
}
