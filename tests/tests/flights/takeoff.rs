//! Take-offs from the deck in the simulated world.

use alight_shared::msg::{CommandKind, DeckOrder, ReasonCode, State};
use alight_sim::autopilots::simulated::own_mission_mode;
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::physics::sea::SeaConfig;
use alight_sim::physics::vessel::VesselCourse;
use alight_uav::autopilot::modes::Firmware;
use nalgebra::Vector3;

use super::BOTH;

/// A drone on the deck in a sea of this amplitude (m) with a period of 5 s, whose owner permits take-offs.
pub(super) fn on_deck(amplitude_m: f64, firmware: Firmware) -> (Scenario, NodeConfigs) {
    let mut scenario = Scenario {
        sea: SeaConfig::paper(amplitude_m, 5.0),
        ..Scenario::default()
    };
    scenario.start.on_deck = true;
    scenario.start.hover_s = 20.0;
    scenario.drone.autopilot.firmware = firmware;
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.takeoff = true;
    nodes.drone.mission.reservation_required = true;
    (scenario, nodes)
}

/// At the start, with the order to take off and the crew's clearance.
pub(super) fn ordered(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Rig {
    let mut rig = Rig::new(scenario, nodes, seed).unwrap();
    rig.world.deck_order(DeckOrder::TakeOff(1));
    rig.run(1.0);
    rig.world.command(CommandKind::TakeOff);
    rig
}

/// Contacts of the drone's parts on its way, and its distance from the deck.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    pub(super) others: u32,
    pub(super) fastest_mps: f64,
    fastest_in: State,
    pub(super) water: bool,
    /// Take-offs begun, and the sum of their predicted probabilities.
    take_offs: u32,
    predicted: f64,
}

/// Until `state`, for `limit_s` at most, with what it met meanwhile.
pub(super) fn until(rig: &mut Rig, limit_s: f64, state: State) -> (bool, Contacts) {
    let mut met = Contacts::default();
    let mut before = rig.state(0);
    rig.each(limit_s, |rig| {
        if rig.state(0) == State::TakeOff && before != State::TakeOff {
            met.take_offs += 1;
            met.predicted += rig.mission(0).entered.value;
        }
        before = rig.state(0);
        let observed = rig.world.observation();
        for touch in observed.contacts {
            met.others += u32::from(!touch.foot);
            let speed_mps = touch.normal_mps.max(touch.tangential_mps);
            if speed_mps > met.fastest_mps {
                (met.fastest_mps, met.fastest_in) = (speed_mps, rig.state(0));
            }
        }
        met.water |= observed.in_water;
        rig.state(0) == state
    });
    (rig.state(0) == state, met)
}

#[test]
fn take_off_and_landing_with_both_autopilots() {
    for (k, firmware) in BOTH.into_iter().enumerate() {
        let (scenario, nodes) = on_deck(0.5, firmware);
        let mut rig = ordered(&scenario, &nodes, 40 + k as u64);
        let (up, met) = until(&mut rig, 60.0, State::Hold);
        assert!(
            up,
            "{firmware:?}: {:?}, {}",
            rig.visited(0),
            rig.mission(0).waiting
        );
        let order = [
            State::Preparing,
            State::Countdown,
            State::SpinUp,
            State::TakeOff,
            State::ClimbOut,
            State::Hold,
        ];
        assert_eq!(rig.visited(0)[1..], order, "{firmware:?}");
        assert!(met.others == 0 && met.fastest_mps < 1.0 && !met.water, "{met:?}");
        assert!(rig.world.physics().deck_distance_m(0) > 12.0);
        // It stays there until a landing is ordered.
        rig.run(5.0);
        assert_eq!(rig.mission(0).waiting.code, ReasonCode::NotCommanded);
        rig.world.command(CommandKind::Land);
        let (landed, met) = until(&mut rig, 120.0, State::Landed);
        assert!(landed && met.others == 0, "{firmware:?}: {:?}", rig.visited(0));
    }
}

/// No take-off starts without the crew's clearance, and nothing goes on once the deck is closed.
#[test]
fn take_off_without_clearance_or_after_its_end() {
    let (scenario, nodes) = on_deck(0.3, Firmware::Px4);
    let mut rig = Rig::new(&scenario, &nodes, 50).unwrap();
    rig.world.command(CommandKind::TakeOff);
    rig.run(10.0);
    assert_eq!(rig.state(0), State::Preparing);
    assert_eq!(rig.mission(0).waiting.code, ReasonCode::NotCleared);
    rig.world.deck_order(DeckOrder::TakeOff(1));
    let spins = rig.until(20.0, |r| armed(r, 0) && r.is_due(State::SpinUp, 3.5));
    assert!(spins, "{:?}, {}", rig.visited(0), rig.mission(0).waiting);
    rig.world.deck_order(DeckOrder::Closed);
    assert!(
        rig.until(5.0, |r| r.state(0) == State::Idle && !armed(r, 0)),
        "{:?}",
        rig.visited(0)
    );
    assert!(rig.visited(0).contains(&State::StandDown), "{:?}", rig.visited(0));
    assert!(!rig.visited(0).contains(&State::TakeOff));
    rig.run(5.0);
    assert!(rests_on_deck(&rig) && !armed(&rig, 0));
}

pub(super) fn armed(rig: &Rig, k: usize) -> bool {
    let drone = rig.world.drones().get(k).and_then(|d| d.autopilot());
    drone.is_some_and(|a| a.armed())
}
/// Four feet are on the deck.
pub(super) fn rests_on_deck(rig: &Rig) -> bool {
    let feet = rig.world.observation().feet;
    feet.iter().all(|[_, _, height]| height.abs() < 0.03)
}

#[test]
fn take_off_that_is_off_as_shipped() {
    let (scenario, mut nodes) = on_deck(0.0, Firmware::ArduCopter);
    nodes.drone.mission.takeoff = false;
    let mut rig = ordered(&scenario, &nodes, 51);
    rig.run(8.0);
    assert_eq!(rig.visited(0), [State::Idle]);
    assert_eq!(rig.mission(0).entered.code, ReasonCode::TakeOffOff);
    assert!(!armed(&rig, 0));
}

#[test]
fn take_off_aborted_in_the_countdown_and_armed() {
    for (state, after_s) in [(State::Countdown, 2.0), (State::SpinUp, 4.0)] {
        let (scenario, nodes) = on_deck(0.5, Firmware::ArduCopter);
        let mut rig = ordered(&scenario, &nodes, 52);
        let mut aborted = false;
        rig.each(30.0, |rig| {
            if !aborted && (rig.is_due(state, after_s) || state == State::SpinUp && armed(rig, 0)) {
                rig.world.command(CommandKind::Abort);
                aborted = true;
            }
            false
        });
        assert!(aborted, "{state:?}: {:?}", rig.visited(0));
        assert_eq!(rig.state(0), State::Idle, "{state:?}: {:?}", rig.visited(0));
        assert!(!rig.visited(0).contains(&State::TakeOff) && !armed(&rig, 0) && rests_on_deck(&rig));
    }
}

/// The text of each firmware that does not arm on a rocking deck is passed on, and nothing else happens.
#[test]
fn autopilots_that_do_not_arm() {
    for (firmware, parameter) in [
        (Firmware::Px4, ("COM_ARM_IMU_ACC", 0.2)),
        (Firmware::ArduCopter, ("INS_GYR_CAL", 1.0)),
    ] {
        let (scenario, mut nodes) = on_deck(0.5, firmware);
        // As their makers ship them: `alight check` names both.
        nodes.autopilot.check_parameters = false;
        let mut rig = Rig::new(&scenario, &nodes, 53).unwrap();
        if let Some(linked) = rig.world.linked(0) {
            linked.autopilot.parameters.insert(parameter.0, parameter.1);
        }
        rig.world.deck_order(DeckOrder::TakeOff(1));
        rig.world.command(CommandKind::TakeOff);
        rig.run(35.0);
        assert_eq!(rig.state(0), State::Idle, "{firmware:?}: {:?}", rig.visited(0));
        assert_eq!(
            rig.mission(0).entered.code,
            ReasonCode::ArmingRejected,
            "{firmware:?}"
        );
        assert!(!armed(&rig, 0) && rests_on_deck(&rig));
    }
}

/// A strap on one foot, and one on each: the thrust is cut before the drone tips over.
#[test]
fn feet_that_are_held() {
    for (firmware, feet) in [
        (Firmware::Px4, vec![0]),
        (Firmware::ArduCopter, vec![2]),
        (Firmware::ArduCopter, vec![0, 1, 2, 3]),
    ] {
        let (scenario, nodes) = on_deck(0.5, firmware);
        let mut rig = ordered(&scenario, &nodes, 54);
        for foot in &feet {
            rig.world.snag(0, *foot, 200.0);
        }
        let mut tilt = 0.0_f64;
        rig.each(40.0, |rig| {
            tilt = tilt.max(rig.world.observation().tilt_error.to_degrees());
            rig.state(0) == State::Idle && rig.visited(0).contains(&State::StandDown)
        });
        let visited = rig.visited(0);
        let waits = rig.mission(0).waiting;
        assert_eq!(
            rig.state(0),
            State::Idle,
            "{firmware:?}, {feet:?}: {visited:?}, {waits}"
        );
        assert!(
            visited.contains(&State::TakeOff) && !visited.contains(&State::ClimbOut),
            "{visited:?}"
        );
        assert!(tilt < 40.0, "{firmware:?}, {feet:?}: {tilt} deg");
        rig.run(3.0);
        assert!(rests_on_deck(&rig) && !armed(&rig, 0), "{firmware:?}, {feet:?}");
    }
}

/// Result of the cycles of one world.
#[derive(Debug, Default)]
struct Cycles {
    done: u32,
    /// Take-offs that were stopped on the deck, with a reason.
    stopped: u32,
    met: Contacts,
}

impl Cycles {
    fn add(&mut self, met: &Contacts) {
        let all = &mut self.met;
        all.others += met.others;
        if met.fastest_mps > all.fastest_mps {
            (all.fastest_mps, all.fastest_in) = (met.fastest_mps, met.fastest_in);
        }
        all.water |= met.water;
        all.take_offs += met.take_offs;
        all.predicted += met.predicted;
    }
    fn is_safe(&self) -> bool {
        self.met.others == 0 && self.met.fastest_mps < 1.0 && !self.met.water
    }
}

/// From deck to deck in one world. A take-off that is stopped on the deck is ordered again, twice.
fn cycles(scenario: &Scenario, nodes: &NodeConfigs, seed: u64, count: u32) -> Cycles {
    let mut rig = Rig::new(scenario, nodes, seed).unwrap();
    let mut all = Cycles::default();
    for _ in 0..count {
        let up = (0..3).any(|k| {
            all.stopped += u32::from(k > 0);
            rig.world.deck_order(DeckOrder::TakeOff(1));
            rig.run(1.0);
            rig.world.command(CommandKind::TakeOff);
            let (up, met) = until(&mut rig, 90.0, State::Hold);
            all.add(&met);
            up
        });
        if up {
            rig.run(10.0);
            rig.world.command(CommandKind::Land);
        }
        let (landed, met) = until(&mut rig, 300.0, State::Landed);
        all.add(&met);
        let rests = rig.until(10.0, |r| !armed(r, 0));
        rig.run(3.0);
        if !(up && landed && rests && rests_on_deck(&rig)) {
            let (visited, mission) = (rig.visited(0), rig.mission(0));
            println!(
                "seed {seed}: {visited:?}, {}, {}",
                mission.entered, mission.waiting
            );
            return all;
        }
        all.done += 1;
    }
    all
}

#[test]
fn cycles_from_deck_to_deck() {
    for (firmware, speed_mps) in [(Firmware::Px4, 0.0), (Firmware::ArduCopter, 2.0)] {
        let (mut scenario, nodes) = on_deck(0.5, firmware);
        if speed_mps > 0.0 {
            scenario.vessel.course = VesselCourse::Straight;
            scenario.vessel.speed_mps = speed_mps;
        }
        let flown = cycles(&scenario, &nodes, 60, 3);
        assert!(flown.done == 3 && flown.is_safe(), "{firmware:?}: {flown:?}");
    }
}

/// A hundred cycles in drawn seas, adrift and at 2 m/s, in wind to 8 m/s. Minutes: run with --ignored.
#[test]
#[ignore = "minutes"]
fn hundred_cycles_from_deck_to_deck() {
    let (mut all, mut unsafe_worlds) = (Cycles::default(), 0);
    for k in 0..20_u32 {
        let (mut scenario, nodes) = on_deck(0.2 + 0.02 * f64::from(k), BOTH[(k % 2) as usize]);
        scenario.drone.wind.mean_mps = 0.4 * f64::from(k);
        if k % 4 >= 2 {
            scenario.vessel.course = VesselCourse::Straight;
            scenario.vessel.speed_mps = 2.0;
        }
        let flown = cycles(&scenario, &nodes, 7000 + u64::from(k), 5);
        println!("world {k}: {flown:?}");
        unsafe_worlds += u32::from(!flown.is_safe());
        all.done += flown.done;
        all.stopped += flown.stopped;
        all.add(&flown.met);
    }
    // Each take-off is predicted to end without an unsafe contact with its probability; a world has five or so, and a landing
    // after each, which is begun at no less. By the binomial's normal approximation no more are unsafe than 3 standard deviations.
    let (n, p) = (f64::from(all.met.take_offs), all.met.predicted);
    let expected = 2.0 * (n - p);
    let most = expected + 3.0 * (2.0 * p * (n - p) / n).sqrt();
    println!("{unsafe_worlds} worlds with an unsafe contact of {most:.1} at most, {all:?}");
    assert!(all.done >= 95 && !all.met.water);
    assert!(
        f64::from(unsafe_worlds) <= most,
        "{unsafe_worlds} of {most:.1}: {all:?}"
    );
}

/// The autopilot flies its own mission away from a vessel under way: the drone turns while its battery still brings it back.
#[test]
fn sortie_ended_by_the_battery() {
    for firmware in BOTH {
        let (mut scenario, nodes) = on_deck(0.3, firmware);
        scenario.vessel.course = VesselCourse::Straight;
        scenario.vessel.speed_mps = 2.0;
        let mut rig = ordered(&scenario, &nodes, 61);
        let (up, _) = until(&mut rig, 60.0, State::Hold);
        assert!(up, "{firmware:?}: {:?}", rig.visited(0));
        if let Some(linked) = rig.world.linked(0) {
            assert!(linked.autopilot.choose(own_mission_mode(firmware)));
            let away = linked.autopilot.position() + Vector3::new(-150.0, 0.0, 0.0);
            linked.autopilot.hold_at(away);
        }
        rig.run(60.0);
        assert_eq!(rig.state(0), State::Idle, "{firmware:?}");
        let turns_in_s = rig.mission(0).turns_in_s.unwrap();
        assert!(turns_in_s > 30.0, "{firmware:?}: {turns_in_s} s");
        if let Some(linked) = rig.world.linked(0) {
            linked.autopilot.battery = 0.42;
        }
        // A smaller reading counts once it has lasted (`battery_lasts_s`); then it turns when it was predicted to.
        rig.run(nodes.drone.mission.battery_lasts_s + 1.0);
        let predicted_s = rig.mission(0).turns_in_s.unwrap();
        let from_s = rig.t_s();
        let turned = rig.until(predicted_s + 60.0, |r| {
            r.state(0) != State::Idle || r.mission(0).waiting.code == ReasonCode::TurnsBack
        });
        let turned_s = rig.t_s() - from_s;
        assert!(
            turned && predicted_s > 2.0,
            "{firmware:?}: predicted in {predicted_s} s"
        );
        assert!(
            turned_s > 0.7 * predicted_s - 10.0 && turned_s < 2.0 * predicted_s + 10.0,
            "{firmware:?}: turned after {turned_s} s, predicted {predicted_s} s"
        );
        let (landed, met) = until(&mut rig, 300.0, State::Landed);
        assert!(
            landed,
            "{firmware:?}: {:?}, {}",
            rig.visited(0),
            rig.mission(0).waiting
        );
        assert!(met.others == 0 && !met.water, "{met:?}");
        let left = rig.world.drones()[0].autopilot().unwrap().battery;
        assert!(
            left > nodes.drone.mission.battery_reserve - 0.05,
            "{firmware:?}: {left}"
        );
    }
}
