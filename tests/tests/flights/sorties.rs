//! Sorties in the simulated world: away from the deck in the autopilot's own mission, and back.

use alight_shared::msg::{AutopilotMode, BatteryPlace, CommandKind, DeckOrder, ReasonCode, State};
use alight_sim::autopilots::simulated::{mode_number, own_mission_mode};
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::world::Checkpoints;
use alight_sim::physics::vessel::VesselCourse;
use alight_uav::autopilot::modes::Firmware;
use nalgebra::Vector3;

use super::BOTH;
use super::takeoff::{armed, on_deck, ordered, rests_on_deck, until};

/// The autopilot of drone `k` has a mission of three places, so far away from where it is (m) and 20 m higher.
fn upload(rig: &mut Rig, k: usize, far_m: f64) {
    if let Some(linked) = rig.world.linked(k) {
        let here = linked.autopilot.position();
        let places = [[-0.5, 0.0], [-1.0, 0.3], [-1.0, -0.1]];
        let at = |[north, east]: [f64; 2]| here + Vector3::new(north * far_m, east * far_m, -20.0);
        linked.autopilot.upload(places.map(at).to_vec());
    }
}
/// The pilot at the remote control chooses a mode.
fn choose(rig: &mut Rig, mode: u32) {
    if let Some(linked) = rig.world.linked(0) {
        assert!(linked.autopilot.choose(mode));
    }
}
/// In its hold after the take-off, with a mission uploaded and chosen.
fn on_its_mission(firmware: Firmware, seed: u64, far_m: f64) -> Rig {
    let (scenario, nodes) = on_deck(0.3, firmware);
    let mut rig = ordered(&scenario, &nodes, seed);
    let (up, _) = until(&mut rig, 60.0, State::Hold);
    assert!(up, "{firmware:?}: {:?}", rig.visited(0));
    upload(&mut rig, 0, far_m);
    choose(&mut rig, own_mission_mode(firmware));
    assert!(rig.until(10.0, |r| r.state(0) == State::Idle));
    rig
}

/// The autopilot has flown its mission: the drone comes back and lands without an order.
#[test]
fn sortie_ended_by_its_own_mission() {
    for firmware in BOTH {
        let mut rig = on_its_mission(firmware, 62, 60.0);
        let farthest = rig.until(60.0, |r| r.world.physics().deck_distance_m(0) > 50.0);
        assert!(farthest && rig.state(0) == State::Idle, "{firmware:?}");
        let done = rig.until(60.0, |r| r.mission(0).waiting.code == ReasonCode::MissionDone);
        assert!(done, "{firmware:?}: {:?}", rig.mission(0).waiting);
        let (landed, met) = until(&mut rig, 200.0, State::Landed);
        let waiting = rig.mission(0).waiting;
        assert!(landed, "{firmware:?}: {:?}, {waiting}", rig.visited(0));
        assert!(met.others == 0 && !met.water, "{met:?}");
    }
}

/// The pilot stops the mission, or takes the drone when it is done: Alight commands nothing.
#[test]
fn own_mission_ended_by_a_person() {
    let firmware = Firmware::Px4;
    let hold = mode_number(firmware, AutopilotMode::Hold);
    let mut rig = on_its_mission(firmware, 63, 60.0);
    rig.run(5.0);
    choose(&mut rig, hold);
    rig.run(20.0);
    assert_eq!(rig.mission(0).waiting.code, ReasonCode::NotCommanded);
    assert!(rig.world.linked(0).is_some_and(|l| l.autopilot.chosen() == hold));
    // It goes on; the pilot takes the drone as soon as it comes back, and gives the mission again.
    choose(&mut rig, own_mission_mode(firmware));
    assert!(
        rig.until(90.0, |r| r.state(0) == State::GetAltitude),
        "{:?}",
        rig.visited(0)
    );
    let pilot = mode_number(firmware, AutopilotMode::Other);
    choose(&mut rig, pilot);
    rig.run(5.0);
    choose(&mut rig, own_mission_mode(firmware));
    rig.run(90.0);
    assert_eq!(rig.state(0), State::Idle, "{:?}", rig.visited(0));
    let mode = rig.world.linked(0).map(|l| l.autopilot.chosen());
    assert_eq!(mode, Some(hold), "done again, and left where it is");
}

/// A charger aboard, which the drone has while it stands disarmed.
fn charge(rig: &mut Rig, k: usize, to: f64) {
    if let Some(linked) = rig.world.linked(k)
        && !linked.autopilot.armed()
    {
        linked.autopilot.battery = to;
    }
}
/// With a charger aboard until `done`, for `limit_s` at most; whether it was done.
fn attended_by_a_charger(rig: &mut Rig, limit_s: f64, done: impl Fn(&Rig) -> bool) -> bool {
    let mut ended = false;
    rig.each(limit_s, |rig| {
        charge(rig, 0, 1.0);
        ended = done(rig);
        ended
    });
    ended
}

/// From one order on: two sorties of the autopilot's own mission, a charger between them, no crew aboard.
#[test]
fn unattended_cycles() {
    for firmware in BOTH {
        let (scenario, mut nodes) = on_deck(0.4, firmware);
        nodes.drone.mission.sorties_max = 2;
        let mut rig = Rig::new(&scenario, &nodes, 64).unwrap();
        upload(&mut rig, 0, 50.0);
        rig.world.deck_order(DeckOrder::TakeOffStanding(1));
        rig.run(1.0);
        rig.world.command(CommandKind::TakeOff);
        for sortie in 1..=2 {
            let away =
                attended_by_a_charger(&mut rig, 180.0, |r| r.world.physics().deck_distance_m(0) > 40.0);
            let m = rig.mission(0);
            let context = format!(
                "{firmware:?}, sortie {sortie}: {:?}, {}, {}",
                rig.visited(0),
                m.entered,
                m.waiting
            );
            assert!(
                away && m.state == State::Idle && m.sorties == [sortie, 2],
                "{context}"
            );
            let (landed, met) = until(&mut rig, 200.0, State::Landed);
            assert!(
                landed && met.others == 0 && met.fastest_mps < 1.0,
                "{context}, {met:?}"
            );
        }
        let over = |r: &Rig| r.mission(0).waiting.code == ReasonCode::SortiesDone;
        assert!(
            attended_by_a_charger(&mut rig, 20.0, over),
            "{}",
            rig.mission(0).waiting
        );
        attended_by_a_charger(&mut rig, 60.0, |_| false);
        assert!(rig.state(0) == State::Landed && rests_on_deck(&rig) && !armed(&rig, 0));
    }
}

/// Somebody changes the battery between two sorties: the standing clearance has ended, and is asked for again.
#[test]
fn battery_changed_between_two_sorties() {
    let (scenario, mut nodes) = on_deck(0.3, Firmware::Px4);
    nodes.drone.mission.sorties_max = 2;
    let mut rig = Rig::new(&scenario, &nodes, 65).unwrap();
    upload(&mut rig, 0, 30.0);
    charge(&mut rig, 0, 0.6);
    rig.world.deck_order(DeckOrder::TakeOffStanding(1));
    rig.run(1.0);
    rig.world.command(CommandKind::TakeOff);
    let (landed, _) = until(&mut rig, 300.0, State::Landed);
    assert!(
        landed && rig.until(20.0, |r| !armed(r, 0)),
        "{:?}",
        rig.visited(0)
    );
    rig.run(30.0);
    charge(&mut rig, 0, 1.0);
    let leaves = rig.until(90.0, |r| r.state(0) != State::Landed || armed(r, 0));
    assert!(!leaves, "{:?}", rig.visited(0));
    assert_eq!(rig.mission(0).waiting.code, ReasonCode::NotCleared);
    rig.world.deck_order(DeckOrder::TakeOffStanding(1));
    assert!(
        rig.until(60.0, |r| r.mission(0).sorties == [2, 2]),
        "{:?}",
        rig.visited(0)
    );
}

/// Without a charger it waits for the order that it is ready, and without the crew's standing clearance for that; an abort ends it.
#[test]
fn next_sortie_waits_for_people() {
    let (scenario, mut nodes) = on_deck(0.3, Firmware::Px4);
    nodes.drone.mission.sorties_max = 5;
    let mut rig = Rig::new(&scenario, &nodes, 65).unwrap();
    upload(&mut rig, 0, 30.0);
    if let Some(linked) = rig.world.linked(0) {
        linked.autopilot.battery = 0.8;
    }
    rig.world.deck_order(DeckOrder::TakeOff(1));
    rig.run(1.0);
    rig.world.command(CommandKind::TakeOff);
    let (landed, _) = until(&mut rig, 300.0, State::Landed);
    assert!(landed, "{:?}, {}", rig.visited(0), rig.mission(0).waiting);
    rig.run(60.0);
    assert_eq!(rig.mission(0).waiting.code, ReasonCode::NotReady);
    rig.world.command(CommandKind::Ready);
    rig.run(5.0);
    assert_eq!(rig.mission(0).waiting.code, ReasonCode::NotCleared);
    rig.world.deck_order(DeckOrder::TakeOff(1));
    let up = rig.until(60.0, |r| r.mission(0).sorties == [2, 5]);
    assert!(up, "{:?}, {}", rig.visited(0), rig.mission(0).waiting);
    let (landed, _) = until(&mut rig, 300.0, State::Landed);
    assert!(landed && rig.until(10.0, |r| !armed(r, 0)));
    rig.world.command(CommandKind::Abort);
    rig.run(3.0);
    let m = rig.mission(0);
    assert_eq!((m.sorties, m.waiting.code), ([2, 0], ReasonCode::Operator));
    rig.world.command(CommandKind::Ready);
    rig.world.deck_order(DeckOrder::TakeOff(1));
    rig.run(20.0);
    assert_eq!(rig.state(0), State::Landed);
}

/// The autopilot has no mission, or does not begin it: the drone lands again, and reports why.
#[test]
fn own_mission_that_does_not_begin() {
    let (scenario, mut nodes) = on_deck(0.3, Firmware::ArduCopter);
    nodes.drone.mission.sorties_max = 3;
    let mut rig = ordered(&scenario, &nodes, 66);
    let (landed, met) = until(&mut rig, 200.0, State::Landed);
    assert!(
        landed && met.others == 0,
        "{:?}, {}",
        rig.visited(0),
        rig.mission(0).waiting
    );
    rig.run(20.0);
    let m = rig.mission(0);
    assert_eq!((m.sorties, m.waiting.code), ([1, 0], ReasonCode::HandOverRefused));
}

/// On its own mission far away from a vessel under way, out of radio range, with a battery that calls.
fn called_out_of_range(firmware: Firmware, seed: u64, silent_s: f64) -> Rig {
    let (mut scenario, nodes) = on_deck(0.3, firmware);
    scenario.vessel.course = VesselCourse::Straight;
    scenario.vessel.speed_mps = 2.0;
    let mut rig = ordered(&scenario, &nodes, seed);
    assert!(until(&mut rig, 60.0, State::Hold).0, "{:?}", rig.visited(0));
    upload(&mut rig, 0, 300.0);
    choose(&mut rig, own_mission_mode(firmware));
    assert!(rig.until(60.0, |r| r.world.physics().deck_distance_m(0) > 180.0));
    rig.world.radio_outage(0, silent_s);
    rig.run(20.0);
    assert_eq!(rig.state(0), State::Idle);
    if let Some(linked) = rig.world.linked(0) {
        linked.autopilot.battery = 0.27;
    }
    let seeks = rig.until(60.0, |r| r.state(0) == State::Search);
    let m = rig.mission(0);
    assert!(
        seeks && m.entered.code == ReasonCode::SeeksVessel,
        "{:?}, {}",
        rig.visited(0),
        m.waiting
    );
    rig
}

/// Out of radio range the battery calls: the drone flies to where the vessel should be, receives it there, and lands.
#[test]
fn sortie_ended_out_of_radio_range() {
    for firmware in BOTH {
        let mut rig = called_out_of_range(firmware, 67, 80.0);
        let near = rig.until(120.0, |r| r.world.physics().deck_distance_m(0) < 60.0);
        assert!(
            near && rig.state(0) == State::Search,
            "{firmware:?}: {:?}",
            rig.visited(0)
        );
        rig.world.radio_outage(0, 0.0);
        let (landed, met) = until(&mut rig, 200.0, State::Landed);
        let waiting = rig.mission(0).waiting;
        assert!(
            landed && met.others == 0,
            "{firmware:?}: {:?}, {waiting}",
            rig.visited(0)
        );
    }
}

/// The companion loses its supply for so long on a sortie, s.
fn reboots(rig: &mut Rig, away_s: f64) {
    rig.world.kill_computer(0);
    rig.run(away_s);
    rig.world.restart_clock(0);
    rig.world.start_computer(0, Checkpoints::Kept);
}

/// A companion that reboots on a sortie knows what the flight is for: from its hold over ground or from the autopilot's own mission
/// the drone comes back when the battery calls, or when that mission is done.
#[test]
fn sortie_after_a_reboot() {
    for (firmware, seed) in BOTH.into_iter().zip(71..) {
        // Over ground, from where the vessel has gone on.
        let (mut scenario, mut nodes) = on_deck(0.3, firmware);
        nodes.drone.mission.reservation_required = false;
        (scenario.vessel.course, scenario.vessel.speed_mps) = (VesselCourse::Straight, 2.0);
        let mut rig = ordered(&scenario, &nodes, seed);
        assert!(until(&mut rig, 60.0, State::Hold).0, "{:?}", rig.visited(0));
        assert!(rig.until(150.0, |r| r.world.physics().deck_distance_m(0) > 100.0));
        reboots(&mut rig, 20.0);
        rig.run(10.0);
        if let Some(linked) = rig.world.linked(0) {
            linked.autopilot.battery = 0.4;
        }
        let (landed, met) = until(&mut rig, 300.0, State::Landed);
        let context = format!("{firmware:?}: {:?}, {}", rig.visited(0), rig.mission(0).waiting);
        assert!(landed && met.others == 0 && !met.water, "{context}, {met:?}");

        // The mission ends while the computer restarts.
        let mut rig = on_its_mission(firmware, seed + 10, 60.0);
        assert!(rig.until(60.0, |r| r.world.physics().deck_distance_m(0) > 50.0));
        reboots(&mut rig, 60.0);
        let (landed, met) = until(&mut rig, 300.0, State::Landed);
        let context = format!("{firmware:?}: {:?}, {}", rig.visited(0), rig.mission(0).waiting);
        assert!(landed && met.others == 0 && !met.water, "{context}, {met:?}");
    }
}

/// Nothing is received there, and home is out of reach: it comes down in place at the last moment.
#[test]
fn sortie_that_does_not_receive_its_vessel() {
    let mut rig = called_out_of_range(Firmware::Px4, 68, f64::INFINITY);
    let near = rig.until(120.0, |r| r.world.physics().deck_distance_m(0) < 40.0);
    assert!(near, "{:?}", rig.visited(0));
    if let Some(linked) = rig.world.linked(0) {
        linked.autopilot.battery = 0.12;
    }
    let here = rig.until(200.0, |r| r.mission(0).low_battery == Some(BatteryPlace::Here));
    let m = rig.mission(0);
    let context = format!("{:?}, {}", rig.visited(0), m.waiting);
    assert!(here && m.entered.code == ReasonCode::BatteryHere, "{context}");
}

/// Two drones of one vessel with a charger aboard: while one stands there, the other is away, without any order.
#[test]
fn two_drones_that_take_turns_on_one_deck() {
    let scenario = Scenario {
        sea: "slight".parse().unwrap(),
        drones: 2,
        ..Scenario::default()
    };
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.takeoff = true;
    nodes.drone.mission.reservation_required = true;
    nodes.drone.mission.sorties_max = 4;
    let mut rig = Rig::new(&scenario, &nodes, 69).unwrap();
    (1..=2).for_each(|drone| rig.world.deck_order(DeckOrder::TakeOffStanding(drone)));
    rig.world.command_to(0, CommandKind::Land);
    assert!(rig.until(150.0, |r| r.state(0) == State::Landed && !armed(r, 0)));
    rig.run(2.0);
    // Each on the side of the place at which it waits: nothing keeps two missions of autopilots apart.
    (0..2).for_each(|k| upload(&mut rig, k, if k == 0 { -120.0 } else { 120.0 }));
    // The first goes; the second, which was in the air, comes and stays.
    rig.world.command_to(0, CommandKind::TakeOff);
    let up = rig.until(60.0, |r| r.mission(0).sorties == [1, 4]);
    let m = rig.mission(0);
    assert!(
        up,
        "{:?}, {}, {}, {:?}",
        rig.visited(0),
        m.entered,
        m.waiting,
        m.sorties
    );
    rig.world.command_to(1, CommandKind::Land);
    assert!(rig.until(200.0, |r| r.state(1) == State::Landed && !armed(r, 1)));
    rig.run(2.0);
    rig.world.command_to(1, CommandKind::TakeOff);
    // Apart while Alight flies both: in its own mission each goes where that leads.
    let (mut landings, mut nearest_m) = ([0; 2], f64::INFINITY);
    let mut before = [rig.state(0), rig.state(1)];
    rig.each(900.0, |rig| {
        for k in 0..2 {
            charge(rig, k, 0.6);
            landings[k] += u32::from(rig.state(k) == State::Landed && before[k] != State::Landed);
            before[k] = rig.state(k);
        }
        if (0..2).all(|k| rig.state(k) != State::Idle) {
            nearest_m = nearest_m.min(apart_m(rig));
        }
        landings.iter().all(|n| *n >= 2)
    });
    let context = format!(
        "{:?}, {:?}; {}, {}",
        rig.visited(0),
        rig.visited(1),
        rig.mission(0).waiting,
        rig.mission(1).waiting
    );
    assert!(landings.iter().all(|n| *n >= 2), "{landings:?}: {context}");
    assert!(nearest_m > 15.0, "{nearest_m} m apart");
}
/// Distance of the two drones, m.
fn apart_m(rig: &Rig) -> f64 {
    let at = |k| rig.world.physics().drone(k).map(|d| d.position.0);
    at(0).zip(at(1)).map_or(f64::INFINITY, |(a, b)| (a - b).norm())
}
