//! Sorties in the simulated world: away from the vessel in the autopilot's own mission, and back to the deck.

use alight_shared::msg::{CommandKind, DeckOrder, ReasonCode, State};
use alight_sim::{
    autopilots::simulated::own_mission_mode,
    harness::{rig::Rig, scenario::NodeConfigs, world::Checkpoints},
    physics::vessel::VesselCourse,
};
use alight_uav::autopilot::modes::Firmware;
use nalgebra::Vector3;

use super::{
    BOTH,
    takeoff::{armed, on_deck, ordered, rests_on_deck, until},
};
use crate::at_sea;

/// Uploads a mission of three waypoints, `far_m` from the drone and 20 m higher.
fn upload(rig: &mut Rig, k: usize, far_m: f64) {
    if let Some(linked) = rig.world.linked(k) {
        let here = linked.autopilot.position();
        let places = [[-0.5, 0.0], [-1.0, 0.3], [-1.0, -0.1]];
        let at = |[north, east]: [f64; 2]| here + Vector3::new(north * far_m, east * far_m, -20.0);
        linked.autopilot.upload(places.map(at).to_vec());
    }
}

/// Simulates a charger on the vessel, which charges the drone while it is disarmed on the deck.
fn charge(rig: &mut Rig, k: usize, to: f64) {
    if let Some(linked) = rig.world.linked(k)
        && !linked.autopilot.armed()
    {
        linked.autopilot.battery = to;
    }
}
fn attended_by_a_charger(rig: &mut Rig, limit_s: f64, done: impl Fn(&Rig) -> bool) -> bool {
    let mut ended = false;
    rig.each(limit_s, |rig| {
        charge(rig, 0, 1.0);
        ended = done(rig);
        ended
    });
    ended
}

/// One order and no crew: two sorties in the autopilot's own mission, with a charge between them.
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
                "{firmware:?}, {sortie}: {:?}, {}, {}",
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

/// Drone in the autopilot's own mission, which leads away from a vessel under way or adrift.
fn on_its_mission(firmware: Firmware, seed: u64, far_m: f64, under_way: bool) -> Rig {
    let (mut scenario, nodes) = on_deck(0.3, firmware);
    if under_way {
        scenario.vessel.course = VesselCourse::Straight;
        scenario.vessel.speed_mps = 2.0;
    }
    let mut rig = ordered(&scenario, &nodes, seed);
    assert!(until(&mut rig, 60.0, State::Hold).0, "{:?}", rig.visited(0));
    upload(&mut rig, 0, far_m);
    let autopilot = &mut rig.world.linked(0).unwrap().autopilot;
    assert!(autopilot.choose(own_mission_mode(firmware)));
    rig
}
fn lands(rig: &mut Rig, limit_s: f64) {
    let (landed, met) = until(rig, limit_s, State::Landed);
    let context = format!("{:?}, {}", rig.visited(0), rig.mission(0).waiting);
    assert!(landed && met.others == 0 && !met.water, "{context}, {met:?}");
}
fn is_away(rig: &mut Rig, by_m: f64) -> bool {
    rig.until(60.0, |r| r.world.physics().deck_distance_m(0) > by_m)
}

/// The battery runs low out of radio range: the drone flies to the vessel's predicted position, receives the
/// vessel there, and lands.
#[test]
fn sortie_ended_out_of_radio_range() {
    let mut rig = on_its_mission(Firmware::Px4, 67, 300.0, true);
    assert!(is_away(&mut rig, 180.0));
    rig.world.radio_outage(0, 80.0);
    rig.run(20.0);
    assert_eq!(rig.state(0), State::Idle);
    rig.world.linked(0).unwrap().autopilot.battery = 0.27;
    let seeks = rig.until(60.0, |r| r.state(0) == State::Search);
    let m = rig.mission(0);
    assert!(
        seeks && m.entered.code == ReasonCode::SeeksVessel,
        "{}",
        m.waiting
    );
    let near = rig.until(120.0, |r| r.world.physics().deck_distance_m(0) < 60.0);
    assert!(near && rig.state(0) == State::Search, "{:?}", rig.visited(0));
    rig.world.radio_outage(0, 0.0);
    lands(&mut rig, 200.0);
}

/// A companion computer that reboots during a sortie resumes it: the drone returns after the autopilot's own mission.
#[test]
fn sortie_after_a_reboot() {
    let mut rig = on_its_mission(Firmware::ArduCopter, 82, 60.0, false);
    assert!(is_away(&mut rig, 50.0));
    rig.world.kill_computer(0);
    rig.run(60.0);
    rig.world.restart_clock(0);
    rig.world.start_computer(0, Checkpoints::Kept);
    lands(&mut rig, 300.0);
}

/// Two drones on a vessel with a charger: one is on the deck while the other is away, without further orders.
#[test]
fn two_drones_that_take_turns_on_one_deck() {
    let mut scenario = at_sea("slight");
    scenario.drones = 2;
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.takeoff = true;
    nodes.drone.mission.reservation_required = true;
    nodes.drone.mission.sorties_max = 4;
    let mut rig = Rig::new(&scenario, &nodes, 69).unwrap();
    for drone in 1..=2 {
        rig.world.deck_order(DeckOrder::TakeOffStanding(drone));
    }
    rig.world.command_to(0, CommandKind::Land);
    assert!(rig.until(150.0, |r| r.state(0) == State::Landed && !armed(r, 0)));
    rig.run(2.0);
    // The missions of the two autopilots are not coordinated, so each drone flies on the side of its waiting place.
    for k in 0..2 {
        upload(&mut rig, k, if k == 0 { -120.0 } else { 120.0 });
    }
    // The first drone takes off; the second lands from the air and stays.
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
    // Distance while Alight flies both drones; in its own mission each drone follows its waypoints.
    let mut landings = [0; 2];
    let mut nearest_m = f64::INFINITY;
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
pub(super) fn apart_m(rig: &Rig) -> f64 {
    let at = |k| rig.world.physics().drone(k).map(|d| d.position.0);
    at(0).zip(at(1)).map_or(f64::INFINITY, |(a, b)| (a - b).norm())
}
