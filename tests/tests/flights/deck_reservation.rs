//! Reservation of the deck in the whole world: drones ask the vessel's arbiter over the radio before
//! they descend.

use alight_shared::msg::{BatteryPlace, CommandKind, DeckOrder, ReasonCode, State, WAITING_DISTANCE_M};
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::studies::fleet;
use alight_usv::deck::DeckInputs;

/// Drones above one deck in a slight sea, each commanded to land.
fn fleet(drones: u32, nodes: &NodeConfigs, seed: u64) -> Rig {
    let scenario = Scenario {
        sea: "slight".parse().unwrap(),
        drones,
        ..Scenario::default()
    };
    Rig::landing(&scenario, nodes, seed).unwrap()
}
/// Two drones, flown until one descends: who does, and who waits.
fn pair(seed: u64) -> (Rig, usize, usize) {
    let mut fleet = fleet(2, &NodeConfigs::default(), seed);
    fleet.until(120.0, |f| !f.using_the_deck().is_empty());
    let first = fleet.using_the_deck()[0];
    (fleet, first, 1 - first)
}
/// The nodes of a drone that must reserve the deck.
fn reserving() -> NodeConfigs {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    nodes
}

/// Until a drone is in this state, which it must reach.
#[track_caller]
fn fly_to(fleet: &mut Rig, limit_s: f64, k: usize, state: State) {
    fleet.until(limit_s, |f| f.state(k) == state);
    assert_state(fleet, k, state);
}
#[track_caller]
fn assert_state(fleet: &Rig, k: usize, state: State) {
    assert_eq!(fleet.state(k), state, "{:?}", fleet.visited(k));
}
/// Distance of a drone from above the deck, and its height over it, m.
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
    // A person takes the first away.
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
fn vessel_restart_during_a_descent() {
    let (mut fleet, first, second) = pair(22);
    fleet.restart_vessel();
    fleet.run(40.0);
    assert_state(&fleet, first, State::Landed);
    assert_never_descended(&fleet, second);
}

#[test]
fn two_drones_without_radio() {
    let (mut fleet, first, second) = pair(23);
    fleet.until(60.0, |f| {
        place(f, second)[1] > 15.0 || f.state(first) == State::Landed
    });
    (0..2).for_each(|k| fleet.world.radio_outage(k, f64::INFINITY));
    fleet.run(40.0);
    assert_state(&fleet, first, State::Landed);
    assert_never_descended(&fleet, second);
    // It holds at the height that it was given.
    assert_state(&fleet, second, State::Hold);
    assert!(place(&fleet, second)[1] > 11.0, "{:?}", place(&fleet, second));
}

#[test]
fn deck_of_a_drone_landed_without_radio() {
    let (mut fleet, first, second) = pair(26);
    fleet.world.radio_outage(first, f64::INFINITY);
    // Half way the vessel is restarted.
    fleet.run(60.0);
    fleet.restart_vessel();
    fleet.run(60.0);
    assert_state(&fleet, first, State::Landed);
    assert_never_descended(&fleet, second);
    // A person carries it off, and reports it.
    fleet.world.deck_order(DeckOrder::Open);
    fleet.restart_drone(first);
    fly_to(&mut fleet, 120.0, second, State::Landed);
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
    (0..2).for_each(|k| assert_waits_aside(&fleet, k));
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
    // Its own weight.
    sense(&mut fleet, true);
    fleet.run(10.0);
    assert_state(&fleet, 0, State::Landed);
}

#[test]
fn reservation_of_a_lone_drone() {
    let mut fleet = fleet(1, &reserving(), 24);
    fly_to(&mut fleet, 120.0, 0, State::Landed);
}

#[test]
fn operator_abort_through_the_vessel() {
    let mut fleet = fleet(1, &reserving(), 25);
    fleet.until(120.0, |f| f.state(0) == State::Descent);
    fleet.world.operator_command(0, CommandKind::Abort);
    fleet.until(2.0, |f| f.state(0) != State::Descent);
    assert_state(&fleet, 0, State::GaveUp);
}

#[test]
fn deck_after_an_abort() {
    let (mut fleet, first, second) = pair(28);
    fleet.world.operator_command(first, CommandKind::Abort);
    fly_to(&mut fleet, 60.0, second, State::Descent);
    assert_state(&fleet, first, State::GaveUp);
    assert_waits_aside(&fleet, first);
    fly_to(&mut fleet, 60.0, second, State::Landed);
    assert_eq!(fleet.world.physics().collisions(), 0);
}

#[test]
fn fleet_with_random_orders_aborts_and_outages() {
    for (seed, drones) in [(31, 2), (32, 3)] {
        let report = fleet::fly(&Scenario::default(), &NodeConfigs::default(), seed, drones).unwrap();
        assert!(report.safe(), "seed {seed}: {report:?}");
        assert!(
            report.landings > 0 && report.stops + report.outages > 0,
            "seed {seed}: {report:?}"
        );
    }
}

/// A drone whose battery reaches its reserve 0.5 s after it has first entered a state.
fn low_battery_in(state: State, nodes: &NodeConfigs, seed: u64) -> Rig {
    let mut fleet = fleet(1, nodes, seed);
    fly_to(&mut fleet, 120.0, 0, state);
    fleet.run(0.5);
    let linked = fleet.world.linked(0).unwrap();
    // Reported in whole percents.
    linked.autopilot.battery = nodes.drone.mission.battery_reserve - 0.01;
    fleet
}

#[test]
fn low_battery_above_the_deck() {
    let mut nodes = NodeConfigs::default();
    // A descent takes less than the time for which a low charge has to last.
    nodes.drone.mission.battery_lasts_s = 0.5;
    for seed in 51..54 {
        for state in [State::Tracking, State::Descent] {
            let mut fleet = low_battery_in(state, &nodes, seed);
            let mut hardest: f64 = 0.0;
            fleet.until(60.0, |f| f.mission(0).low_battery.is_some());
            let chosen = fleet.mission(0);
            assert_eq!(
                chosen.low_battery,
                Some(BatteryPlace::Deck),
                "{:?}",
                fleet.visited(0)
            );
            assert_eq!(chosen.entered.code, ReasonCode::BatteryDeck);
            fleet.each(30.0, |f| {
                for c in f.world.observation().contacts {
                    assert!(c.foot && c.on_deck);
                    hardest = hardest.max(c.normal_mps.hypot(c.tangential_mps));
                }
                false
            });
            assert_state(&fleet, 0, State::Landed);
            assert!(
                place(&fleet, 0)[0] < 0.8 && hardest < 1.0,
                "seed {seed}: {hardest} m/s"
            );
        }
    }
}

/// A deck that is closed while the battery is low is awaited, and taken once it is open again.
#[test]
fn low_battery_near_a_closed_deck() {
    let mut fleet = low_battery_in(State::Tracking, &reserving(), 55);
    fleet.world.deck_order(DeckOrder::Closed);
    fleet.run(15.0);
    let m = fleet.mission(0);
    assert_eq!(
        m.low_battery,
        Some(BatteryPlace::Deck),
        "{:?}, {}, {:?}",
        fleet.visited(0),
        m.waiting,
        m.battery
    );
    assert_never_descended(&fleet, 0);
    fleet.world.deck_order(DeckOrder::Open);
    assert!(
        fleet.until(60.0, |f| f.state(0) == State::Landed),
        "{:?}",
        fleet.visited(0)
    );
}
