//! Reservation of the deck: drones request it from the vessel's arbiter over radio before they descend.

use alight_shared::msg::{DeckOrder, ReasonCode, State, WAITING_DISTANCE_M};
use alight_sim::{
    harness::{
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
    },
    studies::fleet,
};
use alight_usv::deck::DeckInputs;

use crate::at_sea;

fn fleet(drones: u32, nodes: &NodeConfigs, seed: u64) -> Rig {
    let mut scenario = at_sea("slight");
    scenario.drones = drones;
    Rig::landing(&scenario, nodes, seed).unwrap()
}
/// Flies two drones until one descends; returns the descending and the waiting drone.
fn pair(seed: u64) -> (Rig, usize, usize) {
    let mut fleet = fleet(2, &NodeConfigs::default(), seed);
    fleet.until(120.0, |f| !f.using_the_deck().is_empty());
    let first = fleet.using_the_deck()[0];
    (fleet, first, 1 - first)
}
fn reserving() -> NodeConfigs {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    nodes
}

#[track_caller]
fn fly_to(fleet: &mut Rig, limit_s: f64, k: usize, state: State) {
    fleet.until(limit_s, |f| f.state(k) == state);
    assert_state(fleet, k, state);
}
#[track_caller]
fn assert_state(fleet: &Rig, k: usize, state: State) {
    assert_eq!(fleet.state(k), state, "{:?}", fleet.visited(k));
}
/// Horizontal distance from the deck's centre, and height above the deck, m.
fn place(fleet: &Rig, k: usize) -> [f64; 2] {
    let physics = fleet.world.physics();
    let r = physics.drone(k).unwrap().position.0 - physics.deck().position.0;
    [r.xy().norm(), -r.z]
}
#[track_caller]
fn assert_waits_aside(fleet: &Rig, k: usize) {
    let [aside, height] = place(fleet, k);
    let waiting = height > 15.0 - 4.0 && (aside - WAITING_DISTANCE_M).abs() < 4.0;
    let visited = fleet.visited(k);
    assert!(waiting, "{aside:.1} m aside, {height:.1} m high, {visited:?}");
}
#[track_caller]
fn assert_never_descended(fleet: &Rig, k: usize) {
    let visited = fleet.visited(k);
    assert!(!visited.contains(&State::Descent), "{visited:?}");
}

#[test]
fn two_drones_one_after_the_other() {
    let (mut fleet, first, second) = pair(21);
    fleet.until(60.0, |f| f.state(first) == State::Landed);
    fleet.run(30.0);
    assert_state(&fleet, first, State::Landed);
    assert_state(&fleet, second, State::Approach);
    assert_waits_aside(&fleet, second);
    let waiting = fleet.mission(second).waiting;
    assert_eq!(waiting.code, ReasonCode::DeckReserved);
    assert!(
        waiting.to_string().contains(&format!("drone {}", first + 1)),
        "{waiting}"
    );
    fleet.restart_drone(first);
    fly_to(&mut fleet, 60.0, second, State::Landed);
    let on_deck = fleet.world.physics().observation(second, fleet.mission(second));
    assert!(
        on_deck.horizontal_m < 0.8,
        "{} m from the deck's centre",
        on_deck.horizontal_m
    );
}

#[test]
fn deck_closed_by_the_crew() {
    let (mut fleet, first, _) = pair(27);
    fleet.world.deck_order(DeckOrder::Closed);
    fleet.until(3.0, |f| f.state(first) != State::Descent);
    assert_ne!(fleet.state(first), State::Descent, "it breaks off");
    let descents = |fleet: &Rig, k: usize| {
        let visited = fleet.visited(k);
        visited.iter().filter(|s| **s == State::Descent).count()
    };
    let before = [0, 1].map(|k| descents(&fleet, k));
    fleet.run(60.0);
    assert!(fleet.using_the_deck().is_empty());
    for k in 0..2 {
        assert_waits_aside(&fleet, k);
    }
    assert_eq!([0, 1].map(|k| descents(&fleet, k)), before);
    fleet.world.deck_order(DeckOrder::Open);
    assert!(fleet.until(120.0, |f| !f.using_the_deck().is_empty()));
}

#[test]
fn deck_occupied_during_a_descent() {
    let mut nodes = reserving();
    nodes.deck.occupancy_sensor = "sensor".into();
    let mut fleet = fleet(1, &nodes, 29);
    let sense = |fleet: &mut Rig, occupied| {
        fleet.world.deck_inputs(DeckInputs {
            occupied: Some(occupied),
            ..DeckInputs::default()
        });
    };
    sense(&mut fleet, true);
    fleet.run(60.0);
    assert_never_descended(&fleet, 0);
    let waiting = fleet.mission(0).waiting;
    assert!(waiting.to_string().contains("by its sensor"), "{waiting}");
    sense(&mut fleet, false);
    fleet.until(120.0, |f| f.state(0) == State::Descent);
    sense(&mut fleet, true);
    fleet.until(3.0, |f| f.state(0) != State::Descent);
    assert!(fleet.using_the_deck().is_empty(), "it breaks off");
    sense(&mut fleet, false);
    fleet.until(120.0, |f| f.state(0) == State::Landed);
    // The sensor detects the drone's weight.
    sense(&mut fleet, true);
    fleet.run(10.0);
    assert_state(&fleet, 0, State::Landed);
}

#[test]
fn fleet_with_random_orders_aborts_and_outages() {
    let report = fleet::fly(&Scenario::default(), &NodeConfigs::default(), 32, 3).unwrap();
    assert!(report.safe(), "{report:?}");
    assert!(
        report.landings > 0 && report.stops + report.outages > 0,
        "{report:?}"
    );
}
