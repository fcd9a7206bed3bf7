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

/// Time of the tags' detection, s, and ending.
struct Flown {
    found_s: Option<f64>,
    outcome: Outcome,
    states: Vec<State>,
    reasons: Vec<ReasonCode>,
}

fn flown(scenario: &Scenario, nodes: &NodeConfigs, seed: u64, limit_s: f64) -> Flown {
    let mut rig = Rig::landing(scenario, nodes, seed).unwrap();
    let mut states = Vec::new();
    let mut reasons = Vec::new();
    let mut found_s = None;
    let mut faults = Schedule::new(&scenario.faults);
    let outcome = judged(&mut rig, seed, limit_s, |rig| {
        faults.act(rig);
        let m = *rig.mission(0);
        if states.last() != Some(&m.state) {
            states.push(m.state);
        }
        for code in [m.entered.code, m.waiting.code] {
            if !reasons.contains(&code) {
                reasons.push(code);
            }
        }
        if m.state == State::Tracking && found_s.is_none() {
            found_s = Some(rig.t_s());
        }
    });
    Flown {
        found_s,
        outcome,
        states,
        reasons,
    }
}

#[test]
fn deck_found_by_its_beacon() {
    let f = flown(&scenario(), &nodes(), 700, 120.0);
    assert!(f.found_s.is_some(), "{:?}, {:?}", f.states, f.reasons);
    assert_eq!(f.outcome.unsafe_contacts, 0, "{:?}", f.outcome);
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
    let f = flown(&scenario, &nodes(), 701, 150.0);
    assert!(f.found_s.is_none() && f.outcome.attempts == 0, "{:?}", f.states);
    assert!(
        f.states.ends_with(&[State::Search, State::GaveUp]),
        "{:?}",
        f.states
    );
    assert!(f.reasons.contains(&ReasonCode::NotFound), "{:?}", f.reasons);
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
    let f = flown(&scenario, &nodes, 500, 60.0);
    let found = f.found_s.is_some() && f.outcome.unsafe_contacts == 0;
    assert!(found, "{:?} {:?}", f.states, f.reasons);
}
