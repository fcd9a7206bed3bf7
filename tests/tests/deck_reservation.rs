//! The deck's reservation in the whole world: drones ask the vessel's arbiter over the radio before they
//! descend.
// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use alight_shared::msg::{BatteryPlace, CommandKind, ReasonCode, State, WAITING_DISTANCE_M};
use alight_sim::harness::physics::TICK;
use alight_sim::harness::scenario::{NodeConfigs, Scenario, StateOutage};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::world::{DroneComputer, World};
use alight_sim::studies::fleet;
use alight_usv::deck::{DeckInputs, DeckOrder};

/// Drones above one deck in a slight sea, each commanded to land; every state in which one was.
struct Fleet {
    world: World,
    scenario: Scenario,
    visited: Vec<Vec<State>>,
}

impl Fleet {
    fn new(drones: u32, nodes: &NodeConfigs, seed: u64) -> Fleet {
        let scenario = Scenario {
            sea: "slight".parse().unwrap(),
            drones,
            ..Scenario::default()
        };
        Fleet::of(scenario, nodes, seed)
    }
    fn of(scenario: Scenario, nodes: &NodeConfigs, seed: u64) -> Fleet {
        let drones = scenario.drones;
        let mut world = World::new(&scenario, nodes, seed).unwrap();
        world.warm_up(&mut NoTap);
        world.command(CommandKind::Land);
        let visited = vec![Vec::new(); drones as usize];
        Fleet {
            world,
            scenario,
            visited,
        }
    }
    fn drone(&self, k: usize) -> &DroneComputer {
        &self.world.drones()[k]
    }
    fn state(&self, k: usize) -> State {
        self.drone(k).mission_state.state
    }
    /// The drones that are on the way down or stand on the deck.
    fn using_the_deck(&self) -> Vec<usize> {
        let uses = |k: &usize| matches!(self.state(*k), State::Descent | State::Flare | State::Landed);
        (0..self.visited.len()).filter(uses).collect()
    }
    /// Until `done`, `limit_s` at most; on the way no two drones use the deck.
    fn fly(&mut self, limit_s: f64, done: impl Fn(&Fleet) -> bool) {
        for _ in 0..(limit_s / TICK.secs()) as u32 {
            if done(self) {
                return;
            }
            self.world.tick(&mut NoTap);
            for k in 0..self.visited.len() {
                let state = self.state(k);
                if self.visited[k].last() != Some(&state) {
                    self.visited[k].push(state);
                }
            }
            assert!(self.using_the_deck().len() <= 1, "{:?}", self.visited);
        }
    }
    fn assert_state(&self, k: usize, state: State) {
        assert_eq!(self.state(k), state, "{:?}", self.visited);
    }
    /// Its distance from above the deck, and its height over it, m.
    fn place(&self, k: usize) -> [f64; 2] {
        let physics = self.world.physics();
        let r = physics.drone(k).unwrap().position.0 - physics.deck().position.0;
        [r.xy().norm(), -r.z]
    }
    fn assert_waits_aside(&self, k: usize) {
        let [aside, height] = self.place(k);
        let waiting = height > 15.0 - 4.0 && (aside - WAITING_DISTANCE_M).abs() < 4.0;
        assert!(
            waiting,
            "{aside:.1} m aside, {height:.1} m high, {:?}",
            self.visited
        );
    }
    fn assert_never_descended(&self, k: usize) {
        assert!(!self.visited[k].contains(&State::Descent), "{:?}", self.visited);
    }
    /// Until one descends: who does, and who waits.
    fn first_descent(&mut self) -> (usize, usize) {
        self.fly(120.0, |f| !f.using_the_deck().is_empty());
        let first = self.using_the_deck()[0];
        (first, 1 - first)
    }
}

#[test]
fn arbiter_lets_one_of_two_drones_descend_and_the_other_after_it_has_left() {
    let nodes = NodeConfigs::default();
    let mut fleet = Fleet::new(2, &nodes, 21);
    let (first, second) = fleet.first_descent();
    fleet.fly(60.0, |f| f.state(first) == State::Landed);
    fleet.fly(30.0, |_| false);
    fleet.assert_state(first, State::Landed);
    fleet.assert_state(second, State::Approach);
    fleet.assert_waits_aside(second);
    let waiting = fleet.drone(second).mission_state.waiting;
    assert_eq!(waiting.code, ReasonCode::DeckReserved);
    assert!(
        waiting.to_string().contains(&format!("drone {}", first + 1)),
        "{waiting}"
    );
    // A person takes the first away.
    let scenario = fleet.scenario.clone();
    fleet.world.restart_drone(first, &scenario, &nodes);
    fleet.fly(60.0, |f| f.state(second) == State::Landed);
    fleet.assert_state(second, State::Landed);
    let on_deck = fleet
        .world
        .physics()
        .observation(second, &fleet.drone(second).mission_state);
    assert!(
        on_deck.horizontal_m < 0.8,
        "{} m from the deck's centre",
        on_deck.horizontal_m
    );
}

#[test]
fn arbiter_restarted_with_its_vessel_during_a_descent_keeps_the_other_drone_away() {
    let nodes = NodeConfigs::default();
    let mut fleet = Fleet::new(2, &nodes, 22);
    let (first, second) = fleet.first_descent();
    fleet.world.restart_vessel(&nodes);
    fleet.fly(40.0, |_| false);
    fleet.assert_state(first, State::Landed);
    fleet.assert_never_descended(second);
}

#[test]
fn drone_without_radio_begins_no_descent_but_completes_one_under_way() {
    let nodes = NodeConfigs::default();
    let mut fleet = Fleet::new(2, &nodes, 23);
    let (first, second) = fleet.first_descent();
    fleet.fly(60.0, |f| {
        f.place(second)[1] > 15.0 || f.state(first) == State::Landed
    });
    let for_good = StateOutage {
        state: State::Descent,
        after_s: 0.0,
        duration_s: f64::INFINITY,
    };
    (0..2).for_each(|k| fleet.world.radio_outage(k, &for_good));
    fleet.fly(40.0, |_| false);
    fleet.assert_state(first, State::Landed);
    fleet.assert_never_descended(second);
    // It holds at the height that it was given.
    fleet.assert_state(second, State::Hold);
    assert!(fleet.place(second)[1] > 11.0, "{:?}", fleet.place(second));
}

#[test]
fn arbiter_keeps_the_deck_for_a_drone_that_landed_without_a_radio_until_the_crew_opens_it() {
    let nodes = NodeConfigs::default();
    let mut fleet = Fleet::new(2, &nodes, 26);
    let (first, second) = fleet.first_descent();
    let for_good = StateOutage {
        state: State::Descent,
        after_s: 0.0,
        duration_s: f64::INFINITY,
    };
    fleet.world.radio_outage(first, &for_good);
    // Half way the vessel is started anew.
    fleet.fly(60.0, |_| false);
    fleet.world.restart_vessel(&nodes);
    fleet.fly(60.0, |_| false);
    fleet.assert_state(first, State::Landed);
    fleet.assert_never_descended(second);
    // A person carries it off, and says so.
    fleet.world.deck_order(DeckOrder::Open);
    let scenario = fleet.scenario.clone();
    fleet.world.restart_drone(first, &scenario, &nodes);
    fleet.fly(120.0, |f| f.state(second) == State::Landed);
    fleet.assert_state(second, State::Landed);
}

#[test]
fn nobody_descends_to_a_deck_that_the_crew_has_closed() {
    let nodes = NodeConfigs::default();
    let mut fleet = Fleet::new(2, &nodes, 27);
    let (first, second) = fleet.first_descent();
    fleet.world.deck_order(DeckOrder::Closed);
    fleet.fly(3.0, |f| f.state(first) != State::Descent);
    assert_ne!(fleet.state(first), State::Descent, "it breaks off");
    let before = fleet.visited.clone();
    fleet.fly(60.0, |_| false);
    assert!(fleet.using_the_deck().is_empty());
    (0..2).for_each(|k| fleet.assert_waits_aside(k));
    let descents = |visited: &[State]| visited.iter().filter(|s| **s == State::Descent).count();
    for k in [first, second] {
        assert_eq!(
            descents(&fleet.visited[k]),
            descents(&before[k]),
            "{:?}",
            fleet.visited
        );
    }
    fleet.world.deck_order(DeckOrder::Open);
    fleet.fly(120.0, |f| !f.using_the_deck().is_empty());
    assert_eq!(fleet.using_the_deck().len(), 1, "{:?}", fleet.visited);
}

#[test]
fn drone_leaves_a_deck_on_which_something_comes_to_lie_and_lands_once_it_is_free() {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    nodes.deck.occupancy_sensor = "sensor".into();
    let mut fleet = Fleet::new(1, &nodes, 29);
    let sense = |fleet: &mut Fleet, occupied| {
        fleet.world.deck_inputs(DeckInputs {
            occupied: Some(occupied),
            ..DeckInputs::default()
        });
    };
    sense(&mut fleet, true);
    fleet.fly(60.0, |_| false);
    fleet.assert_never_descended(0);
    let waiting = fleet.drone(0).mission_state.waiting;
    assert!(waiting.to_string().contains("by its sensor"), "{waiting}");
    sense(&mut fleet, false);
    fleet.fly(120.0, |f| f.state(0) == State::Descent);
    sense(&mut fleet, true);
    fleet.fly(3.0, |f| f.state(0) != State::Descent);
    assert!(fleet.using_the_deck().is_empty(), "it breaks off");
    sense(&mut fleet, false);
    fleet.fly(120.0, |f| f.state(0) == State::Landed);
    // Its own weight.
    sense(&mut fleet, true);
    fleet.fly(10.0, |_| false);
    fleet.assert_state(0, State::Landed);
}

#[test]
fn lone_drone_that_must_reserve_is_granted_the_deck_and_lands() {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    let mut fleet = Fleet::new(1, &nodes, 24);
    fleet.fly(120.0, |f| f.state(0) == State::Landed);
    fleet.assert_state(0, State::Landed);
}

#[test]
fn operators_abort_reaches_the_drone_through_the_vessel() {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    let mut fleet = Fleet::new(1, &nodes, 25);
    fleet.fly(120.0, |f| f.state(0) == State::Descent);
    fleet.world.operator_command(0, CommandKind::Abort);
    fleet.fly(2.0, |f| f.state(0) != State::Descent);
    fleet.assert_state(0, State::GaveUp);
}

#[test]
fn drone_that_aborts_climbs_and_leaves_the_deck_to_the_one_that_waits() {
    let nodes = NodeConfigs::default();
    let mut fleet = Fleet::new(2, &nodes, 28);
    let (first, second) = fleet.first_descent();
    fleet.world.operator_command(first, CommandKind::Abort);
    fleet.fly(60.0, |f| f.state(second) == State::Descent);
    fleet.assert_state(second, State::Descent);
    fleet.assert_state(first, State::GaveUp);
    fleet.assert_waits_aside(first);
    fleet.fly(60.0, |f| f.state(second) == State::Landed);
    fleet.assert_state(second, State::Landed);
    assert_eq!(fleet.world.physics().collisions(), 0);
}

#[test]
fn drones_with_random_orders_aborts_and_outages_meet_neither_each_other_nor_an_occupied_deck() {
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
fn low_battery_in(state: State, nodes: &NodeConfigs, seed: u64) -> Fleet {
    let mut fleet = Fleet::new(1, nodes, seed);
    fleet.fly(120.0, |f| f.state(0) == state);
    fleet.assert_state(0, state);
    fleet.fly(0.5, |_| false);
    let linked = fleet.world.linked(0).unwrap();
    // Reported in whole percents.
    linked.autopilot.battery = nodes.drone.mission.battery_reserve - 0.01;
    fleet
}

#[test]
fn low_battery_above_the_deck_leads_onto_it_within_the_limits() {
    let mut nodes = NodeConfigs::default();
    // A descent takes less than the time for which a low charge has to last.
    nodes.drone.mission.battery_lasts_s = 0.5;
    for seed in 51..54 {
        for state in [State::Tracking, State::Descent] {
            let mut fleet = low_battery_in(state, &nodes, seed);
            let mut hardest: f64 = 0.0;
            fleet.fly(60.0, |f| f.drone(0).mission_state.low_battery.is_some());
            let chosen = fleet.drone(0).mission_state;
            assert_eq!(
                chosen.low_battery,
                Some(BatteryPlace::Deck),
                "{:?}",
                fleet.visited
            );
            assert_eq!(chosen.entered.code, ReasonCode::BatteryDeck);
            for _ in 0..3000 {
                fleet.fly(TICK.secs(), |_| false);
                let o = fleet.world.observation();
                assert!(o.contacts.iter().all(|c| c.foot && c.on_deck));
                hardest = o
                    .contacts
                    .iter()
                    .map(|c| c.normal_mps.hypot(c.tangential_mps))
                    .fold(hardest, f64::max);
            }
            fleet.assert_state(0, State::Landed);
            assert!(
                fleet.place(0)[0] < 0.8 && hardest < 1.0,
                "seed {seed}: {hardest} m/s"
            );
        }
    }
}

#[test]
fn low_battery_beside_a_closed_deck_leads_home() {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.reservation_required = true;
    let mut fleet = low_battery_in(State::Tracking, &nodes, 55);
    fleet.world.deck_order(DeckOrder::Closed);
    fleet.fly(60.0, |f| f.state(0) == State::GaveUp);
    let mission = fleet.drone(0).mission_state;
    assert_eq!(mission.low_battery, Some(BatteryPlace::Home));
    assert_eq!(mission.entered.code, ReasonCode::BatteryHome);
    fleet.assert_never_descended(0);
}
