//! Take-offs from the deck in the simulated world.

use alight_shared::msg::{CommandKind, DeckOrder, ReasonCode, State};
use alight_sim::{
    harness::{
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
    },
    physics::vessel::VesselCourse,
};
use alight_uav::autopilot::modes::Firmware;

use super::BOTH;
use crate::at_sea;

/// Drone on the deck in a sea of this amplitude (m) and a period of 5 s, with take-offs permitted.
pub(super) fn on_deck(amplitude_m: f64, firmware: Firmware) -> (Scenario, NodeConfigs) {
    let mut scenario = at_sea(&format!("{amplitude_m},5"));
    scenario.start.on_deck = true;
    scenario.start.hover_s = 20.0;
    scenario.drone.autopilot.firmware = firmware;
    let mut nodes = NodeConfigs::default();
    nodes.drone.mission.takeoff = true;
    nodes.drone.mission.reservation_required = true;
    (scenario, nodes)
}

pub(super) fn ordered(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Rig {
    let mut rig = Rig::new(scenario, nodes, seed).unwrap();
    rig.world.deck_order(DeckOrder::TakeOff(1));
    rig.run(1.0);
    rig.world.command(CommandKind::TakeOff);
    rig
}

#[derive(Debug, Default)]
pub(super) struct Contacts {
    pub(super) others: u32,
    pub(super) fastest_mps: f64,
    pub(super) water: bool,
    /// Number of take-offs begun, and sum of their predicted probabilities.
    take_offs: u32,
    predicted: f64,
}

/// Flies until `state`. Returns whether it was reached within `limit_s`, and the contacts.
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
            met.fastest_mps = met.fastest_mps.max(touch.normal_mps).max(touch.tangential_mps);
        }
        met.water |= observed.in_water;
        rig.state(0) == state
    });
    (rig.state(0) == state, met)
}

/// No take-off starts without clearance; none continues after the crew closes the deck.
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
pub(super) fn rests_on_deck(rig: &Rig) -> bool {
    let feet = rig.world.observation().feet;
    feet.iter().all(|[_, _, height]| height.abs() < 0.03)
}

/// Straps hold one foot or all feet: thrust is cut before the drone tips over.
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

#[derive(Debug, Default)]
struct Cycles {
    done: u32,
    stopped: u32,
    met: Contacts,
}

impl Cycles {
    fn add(&mut self, met: &Contacts) {
        let all = &mut self.met;
        all.others += met.others;
        all.fastest_mps = all.fastest_mps.max(met.fastest_mps);
        all.water |= met.water;
        all.take_offs += met.take_offs;
        all.predicted += met.predicted;
    }
    fn is_safe(&self) -> bool {
        self.met.others == 0 && self.met.fastest_mps < 1.0 && !self.met.water
    }
}

/// Flies from deck to deck in one world. A take-off that stops on the deck is ordered again, at most twice.
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
            let visited = rig.visited(0);
            let mission = rig.mission(0);
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

/// A hundred cycles in random seas, adrift and at 2 m/s, in wind of up to 8 m/s. Takes minutes: run with
/// --ignored.
#[test]
#[ignore = "minutes"]
fn hundred_cycles_from_deck_to_deck() {
    let mut all = Cycles::default();
    let mut unsafe_worlds = 0;
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
    // Each take-off has a predicted probability of safety. A world has about five take-offs, each followed by
    // a landing with at least the same probability. The number of unsafe contacts may exceed its mean by at
    // most 3 standard deviations, in the normal approximation of the binomial distribution.
    let n = f64::from(all.met.take_offs);
    let p = all.met.predicted;
    let expected = 2.0 * (n - p);
    let most = expected + 3.0 * (2.0 * p * (n - p) / n).sqrt();
    println!("{unsafe_worlds} worlds with an unsafe contact (at most {most:.1}), {all:?}");
    assert!(all.done >= 95 && !all.met.water);
    assert!(
        f64::from(unsafe_worlds) <= most,
        "{unsafe_worlds} of {most:.1}: {all:?}"
    );
}
