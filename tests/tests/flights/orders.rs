//! Orders that end by themselves, a battery below the reserve about an order or a stop, and an idle drone whose autopilot reports
//! the ground: whole flights.

use alight_shared::msg::{AutopilotMode, CommandKind, LandedState, State};
use alight_sim::autopilots::simulated::mode_number;
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::storm::FaultKind;
use alight_uav::autopilot::message::id;
use alight_uav::autopilot::modes::Firmware;

/// A drone that hovers in our mode, idle.
fn idle(scenario: &Scenario, seed: u64) -> Rig {
    idle_with(scenario, &NodeConfigs::default(), seed)
}
fn idle_with(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Rig {
    let mut rig = Rig::new(scenario, nodes, seed).unwrap();
    rig.run(1.0);
    rig
}
fn autopilot(rig: &mut Rig) -> &mut alight_sim::autopilots::simulated::SimulatedAutopilot {
    &mut rig.world.linked(0).unwrap().autopilot
}
/// A person chooses this mode.
fn choose(rig: &mut Rig, mode: AutopilotMode) {
    let a = autopilot(rig);
    let number = mode_number(a.firmware(), mode);
    assert!(a.choose(number), "{mode:?} denied");
}
fn height_m(rig: &Rig) -> f64 {
    -rig.world.physics().drone(0).unwrap().position.0.z
}
/// Motors off on the deck.
fn rests(rig: &Rig) -> bool {
    let o = rig.world.observation();
    !o.motors_on && !o.in_water && o.horizontal_m < 1.0
}

/// An order that is given while a pilot flies: given the mode minutes later, the drone stays where it is.
#[test]
fn order_given_in_a_persons_hands() {
    let mut rig = idle(&Scenario::default(), 41);
    choose(&mut rig, AutopilotMode::Hold);
    rig.run(1.0);
    rig.world.command(CommandKind::Land);
    rig.run(90.0);
    let before = rig.world.physics().drone(0).unwrap().position.0;
    choose(&mut rig, AutopilotMode::Offboard);
    rig.run(10.0);
    let apart = (rig.world.physics().drone(0).unwrap().position.0 - before).norm();
    assert_eq!(rig.state(0), State::Idle);
    assert!(apart < 3.0, "flew off by {apart:.1} m");
    // A new one counts.
    rig.world.command(CommandKind::Land);
    assert!(rig.until(120.0, rests), "{:?}", rig.visited(0));
}

/// An order with 18 % of the battery, to a deck on which no landing is likely enough for a drone that has a choice.
#[test]
fn order_below_the_reserve_above_an_unlikely_deck() {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.min_probability = 1.0;
    for seed in 51..53 {
        let mut rig = idle_with(&Scenario::default(), &nodes, seed);
        autopilot(&mut rig).battery = 0.18;
        rig.run(6.0);
        rig.world.command(CommandKind::Land);
        let landed = rig.until(120.0, rests);
        assert!(landed, "seed {seed}: {:?}", rig.visited(0));
    }
}

/// An abort above the deck, and no order since: before the battery is empty the drone is down on the deck.
#[test]
fn battery_runs_low_after_an_abort() {
    for command in [CommandKind::Abort, CommandKind::Hold] {
        let mut rig = idle(&Scenario::default(), 61);
        rig.world.command(CommandKind::Land);
        assert!(rig.until(60.0, |rig| rig.state(0) == State::Tracking));
        rig.world.command(command);
        rig.run(5.0);
        assert!(matches!(rig.state(0), State::GaveUp | State::Hold));
        autopilot(&mut rig).battery = 0.16;
        let landed = rig.until(150.0, rests);
        assert!(landed, "{command:?}: {:?}", rig.visited(0));
    }
}

/// A gauge that steps from 60 to 8 % on the way to a deck that is free, or above it: down on the deck, and not on the way to a home
/// that the vessel has left.
#[test]
fn gauge_that_steps_next_to_a_free_deck() {
    for (firmware, seed) in super::BOTH.into_iter().zip(63..) {
        for state in [State::Approach, State::Tracking] {
            let mut scenario = Scenario::default();
            scenario.drone.autopilot.firmware = firmware;
            let mut rig = idle(&scenario, seed);
            autopilot(&mut rig).battery = 0.6;
            rig.world.command(CommandKind::Land);
            assert!(rig.until(60.0, |rig| rig.state(0) == state));
            autopilot(&mut rig).battery = 0.08;
            let landed = rig.until(100.0, rests);
            assert!(landed, "{firmware:?}, {state:?}: {:?}", rig.visited(0));
        }
    }
}

/// A gauge that sticks or toggles at 40 %, its voltage with it, or is silent for a mission that finds the drone in the air: over a deck on
/// which no landing is likely enough for a drone that has a choice, one that flies for 400 s is down before its battery is empty, also
/// where its mission is restarted meanwhile.
#[test]
fn gauge_that_lies_above_the_deck() {
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.min_probability = 1.0;
    nodes.drone.mission.mission_timeout_s = 3600.0;
    let mut scenario = Scenario::default();
    scenario.drone.autopilot.endurance_s = 400.0;
    let cases = [
        (64, Some(0.0), false),
        (65, Some(0.0), true),
        (66, Some(0.01), false),
        (67, Some(0.01), true),
        (68, None, false),
        (69, None, true),
    ];
    let mut lost = Vec::new();
    for (seed, toggles_by, restarts) in cases {
        let mut rig = Rig::new(&scenario, &nodes, seed).unwrap();
        let shows = |rig: &mut Rig| {
            let autopilot = autopilot(rig);
            autopilot.battery_reported = toggles_by.is_some();
            autopilot.battery_report = toggles_by.map(|by| [0.4, by]);
        };
        autopilot(&mut rig).battery = 0.45;
        shows(&mut rig);
        for size in [1.0, 0.0].into_iter().skip(usize::from(toggles_by.is_some())) {
            rig.begin(FaultKind::MissionKilled, size);
            rig.end(FaultKind::MissionKilled, size);
            rig.each(4.0, |rig| {
                shows(rig);
                false
            });
        }
        rig.world.command(CommandKind::Land);
        let (mut restarted, mut empty) = (false, false);
        rig.each(400.0, |rig| {
            shows(rig);
            empty |= autopilot(rig).battery <= 0.0;
            if restarts && !restarted && rig.t_s() > 50.0 {
                restarted = true;
                rig.begin(FaultKind::MissionKilled, 0.0);
                rig.end(FaultKind::MissionKilled, 0.0);
            }
            rests(rig) || empty
        });
        if empty || !rests(&rig) {
            let waiting = rig.mission(0).waiting.to_string();
            lost.push((seed, rig.t_s(), rig.mission(0).battery, waiting));
        }
    }
    assert!(lost.is_empty(), "{lost:#?}");
}

/// BATTERY_STATUS stops above the deck after an abort: the charge goes on falling, and the drone is down before it is empty.
#[test]
fn battery_report_that_stops_above_the_deck() {
    let mut rig = idle(&Scenario::default(), 62);
    autopilot(&mut rig).battery = 0.22;
    rig.run(6.0);
    rig.world.command(CommandKind::Land);
    assert!(rig.until(60.0, |rig| rig.state(0) == State::Approach));
    rig.world.command(CommandKind::Abort);
    autopilot(&mut rig).muted = vec![id::BATTERY_STATUS];
    let landed = rig.until(150.0, rests);
    assert!(landed, "{:?}", rig.visited(0));
}

/// The autopilot reports the ground while the drone hovers idle, from now on or since before it was given.
#[test]
fn idle_drone_that_is_reported_on_the_ground() {
    for (firmware, from_start) in [
        (Firmware::Px4, false),
        (Firmware::Px4, true),
        (Firmware::ArduCopter, false),
    ] {
        let mut scenario = Scenario::default();
        scenario.drone.autopilot.firmware = firmware;
        scenario.start.height_m = [12.0, 12.0];
        let mut rig = idle(&scenario, 71);
        if from_start {
            choose(&mut rig, AutopilotMode::Hold);
            rig.run(1.0);
        }
        autopilot(&mut rig).landed_report = Some(LandedState::OnGround);
        rig.run(4.0);
        if from_start {
            choose(&mut rig, AutopilotMode::Offboard);
        }
        let before = height_m(&rig);
        rig.run(5.0);
        let fell = before - height_m(&rig);
        assert!(fell < 1.0, "{firmware:?}, {from_start}: fell by {fell:.1} m");
    }
}
