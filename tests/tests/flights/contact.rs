//! Faults at each tenth of the last second before and the first second after contact: no contact is hard, the
//! motors stop soon, and the drone does not take off again.

use alight_sim::harness::outcome::{MAX_CONTACT_MPS, MAX_STOP_S};
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::storm::FaultKind;
use alight_uav::autopilot::message::MavCmd;
use alight_uav::autopilot::modes::{Firmware, px4_mode};

use crate::{BOTH, at_sea};

const LIMIT_S: f64 = 150.0;
const STOPPED_S: f64 = 2.0;
/// Time from the earliest fault to the first contact, s, and step between the faults, s.
const BEFORE_S: f64 = 1.0;
const STEP_S: f64 = 0.1;
/// The motors stop before this step.
const LAST_STEP: usize = 30;
/// Maximum height of resting feet, m.
const RESTS_M: f64 = 0.05;
/// Climb after a rest on the deck that counts as a take-off, m, and minimum height above the deck for it, m.
/// A deck that sinks away below a drone held by its autopilot does not count.
const TAKES_OFF_M: f64 = 0.4;

#[derive(Debug, Default)]
struct Flown {
    contact_s: Option<f64>,
    hardest_mps: f64,
    /// Climb after a rest on the deck, m.
    rose_m: f64,
    /// Start of the current rest on the deck, s.
    rests_s: Option<f64>,
    /// Final stop of the motors, s.
    stopped_s: Option<f64>,
    water: bool,
}

impl Flown {
    fn is_good(&self) -> bool {
        let soon = self
            .stopped_s
            .zip(self.rests_s)
            .is_some_and(|(stopped, rests)| stopped - rests <= MAX_STOP_S);
        self.hardest_mps <= MAX_CONTACT_MPS && self.rose_m <= TAKES_OFF_M && soon && !self.water
    }
}

fn scenario(firmware: Firmware) -> Scenario {
    let mut scenario = at_sea("0.5,5");
    (scenario.start.distance_m, scenario.start.height_m) = ([0.0, 5.0], [10.0, 14.0]);
    scenario.drone.autopilot.firmware = firmware;
    scenario
}

/// Flies one landing order; `fault` is called after every tick.
fn fly(firmware: Firmware, seed: u64, mut fault: impl FnMut(&mut Rig, f64)) -> Flown {
    let mut rig = Rig::landing(&scenario(firmware), &NodeConfigs::default(), seed).unwrap();
    let (mut flown, mut lowest) = (Flown::default(), None);
    rig.each(LIMIT_S, |rig| {
        let (t, o) = (rig.t_s(), rig.world.observation());
        let height_m = o.feet_height_m();
        if !o.contacts.is_empty() {
            flown.contact_s.get_or_insert(t);
        }
        for c in o.contacts {
            flown.hardest_mps = flown.hardest_mps.max(c.normal_mps);
        }
        let rests = height_m.abs() <= RESTS_M && flown.contact_s.is_some();
        flown.rests_s = rests.then(|| flown.rests_s.unwrap_or(t));
        let down_m = rig.world.physics().trace_point(0).drone[2];
        if rests {
            lowest = Some(lowest.map_or(down_m, |l: f64| l.max(down_m)));
        }
        if let Some(lowest) = lowest {
            flown.rose_m = flown.rose_m.max(height_m.min(lowest - down_m));
        }
        flown.stopped_s = (!o.motors_on).then(|| flown.stopped_s.unwrap_or(t));
        flown.water |= o.in_water;
        fault(rig, t);
        flown.stopped_s.is_some_and(|at| t >= at + STOPPED_S) || flown.water
    });
    flown
}

#[test]
#[ignore = "about 35 flights; CI runs them by name"]
fn link_killed_around_the_contact() {
    let mut wrong = Vec::new();
    for (odd, firmware) in BOTH.into_iter().enumerate() {
        let undisturbed = [71, 72].map(|seed| (seed, fly(firmware, seed, |_, _| ())));
        for (seed, flown) in &undisturbed {
            assert!(flown.is_good(), "{firmware:?}, {seed}: {flown:?}");
        }
        // Two of every four steps, so that every autopilot flies both seas and both restarts.
        for k in (0..LAST_STEP).filter(|k| k.div_ceil(2) % 2 == odd) {
            let (seed, flown) = &undisturbed[k % 2];
            let away_s = if k % 4 < 2 { 0.4 } else { 0.7 };
            let contact_s = flown.contact_s.unwrap();
            let fails_s = contact_s - BEFORE_S + STEP_S * k as f64;
            if fails_s > flown.stopped_s.unwrap() + STEP_S {
                break;
            }
            let (mut failed, mut over) = (false, false);
            let flown = fly(firmware, *seed, |rig, t| {
                if t >= fails_s && !failed {
                    failed = true;
                    rig.begin(FaultKind::LinkKilled, 0.0);
                }
                if t >= fails_s + away_s && !over {
                    over = true;
                    rig.end(FaultKind::LinkKilled, 0.0);
                }
            });
            if !flown.is_good() {
                let at_s = fails_s - contact_s;
                wrong.push(format!(
                    "{firmware:?}, {seed}, {at_s:.1} s, away {away_s} s: {flown:?}"
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The autopilot lands by itself on the published deck; only the disarm is commanded, if permitted. Returns
/// the flight, the number of disarm commands, and their maximum height above the deck.
fn own_landing(firmware: Firmware, seed: u64, disarms: bool) -> (Flown, usize, f64) {
    let mut scenario = scenario(firmware);
    (scenario.start.distance_m, scenario.start.height_m) = ([0.0, 2.0], [6.0, 6.0]);
    let mut nodes = NodeConfigs::default();
    nodes.autopilot.publish_deck = true;
    nodes.autopilot.disarm.own_landing = disarms;
    let mut rig = Rig::new(&scenario, &nodes, seed).unwrap();
    rig.run(5.0);
    let (mut flown, mut disarmed, mut highest_m) = (Flown::default(), 0, 0.0_f64);
    let autopilot = &mut rig.world.linked(0).unwrap().autopilot;
    autopilot.parameters.insert("PLND_ENABLED", 1.0);
    let mode = match firmware {
        Firmware::Px4 => px4_mode(4, 9),
        Firmware::ArduCopter => 9,
    };
    assert!(autopilot.choose(mode));
    autopilot.commands.clear();
    rig.each(40.0, |rig| {
        let (t, o) = (rig.t_s(), rig.world.observation());
        let height_m = o.feet_height_m();
        for c in o.contacts {
            flown.contact_s.get_or_insert(t);
            flown.hardest_mps = flown.hardest_mps.max(c.normal_mps);
        }
        let rests = height_m.abs() <= RESTS_M && flown.contact_s.is_some();
        flown.rests_s = rests.then(|| flown.rests_s.unwrap_or(t));
        flown.stopped_s = (!o.motors_on).then(|| flown.stopped_s.unwrap_or(t));
        flown.water |= o.in_water;
        let commands = &mut rig.world.linked(0).unwrap().autopilot.commands;
        let orders = commands
            .iter()
            .filter(|(_, c)| c.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
        let count = orders.count();
        if count > disarmed {
            (disarmed, highest_m) = (count, highest_m.max(height_m));
        }
        flown.stopped_s.is_some_and(|at| t >= at + STOPPED_S) || flown.water
    });
    (flown, disarmed, highest_m)
}

#[test]
fn disarm_in_the_autopilots_own_landing() {
    for firmware in BOTH {
        let (flown, disarms, highest_m) = own_landing(firmware, 80, true);
        let after_s = flown
            .stopped_s
            .zip(flown.contact_s)
            .map(|(stop, contact)| stop - contact);
        assert!(
            after_s.is_some_and(|s| s < 6.0) && disarms > 0 && highest_m < 0.1 && !flown.water,
            "{firmware:?}: {after_s:?} s, {disarms} at {highest_m} m: {flown:?}"
        );
    }
    let (flown, disarms, _) = own_landing(Firmware::Px4, 80, false);
    assert_eq!(disarms, 0, "{flown:?}");
}
