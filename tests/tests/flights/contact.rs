//! Link killed at each tenth of a second around the contact: no contact is hard, the motors stop soon after the link
//! is back, and the drone does not take off again.

use alight_sim::harness::{
    outcome::{MAX_CONTACT_MPS, MAX_STOP_S},
    rig::Rig,
    scenario::{NodeConfigs, Scenario},
    storm::FaultKind,
};
use alight_uav::autopilot::{
    message::MavCmd,
    modes::{Firmware, px4_mode},
};
use nalgebra::Vector2;
use rayon::prelude::*;

use crate::{BOTH, at_sea};

const LIMIT_S: f64 = 150.0;
const STOPPED_S: f64 = 2.0;
const STEP_S: f64 = 0.1;
/// Times for which the link is away, s.
const AWAY_S: [f64; 5] = [0.4, 0.7, 1.0, 1.5, 2.0];
/// Maximum height of resting feet, m.
const RESTS_M: f64 = 0.05;
/// Climb after a rest on the deck that counts as a take-off, m, and minimum height above the deck for it, m.
/// A deck that sinks away below a drone held by its autopilot does not count.
const TAKES_OFF_M: f64 = 0.4;

/// Outage of the link, s.
#[derive(Clone, Copy, Debug)]
struct Outage {
    from_s: f64,
    away_s: f64,
}

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
    /// End of the outage, s.
    back_s: f64,
    /// Distance between the first contact and the end of the outage, and between that and the stop, along the deck, m.
    slid_m: [f64; 2],
    tilt_deg: f64,
}

impl Flown {
    fn is_good(&self) -> bool {
        let soon = self
            .stopped_s
            .zip(self.rests_s)
            .is_some_and(|(stopped, rests)| stopped - rests.max(self.back_s) <= MAX_STOP_S);
        self.hardest_mps <= MAX_CONTACT_MPS && self.rose_m <= TAKES_OFF_M && soon && !self.water
    }
}

fn scenario(firmware: Firmware) -> Scenario {
    let mut scenario = at_sea("0.5,5");
    scenario.start.distance_m = [0.0, 5.0];
    scenario.start.height_m = [10.0, 14.0];
    scenario.drone.autopilot.firmware = firmware;
    scenario
}

fn fly(firmware: Firmware, seed: u64, outage: Option<Outage>) -> Flown {
    let mut rig = Rig::landing(&scenario(firmware), &NodeConfigs::default(), seed).unwrap();
    let mut flown = Flown::default();
    let mut lowest = None;
    let mut failed = false;
    let mut over = outage.is_none();
    let mut from = None;
    rig.each(LIMIT_S, |rig| {
        let t = rig.t_s();
        let o = rig.world.observation();
        let height_m = o.feet_height_m();
        let feet = o
            .feet
            .iter()
            .map(|f| Vector2::new(f[0], f[1]))
            .sum::<Vector2<f64>>()
            / 4.0;
        if !o.contacts.is_empty() {
            flown.contact_s.get_or_insert(t);
        }
        for c in o.contacts {
            flown.hardest_mps = flown.hardest_mps.max(c.normal_mps);
        }
        if flown.contact_s.is_some() && o.motors_on {
            let way = &mut flown.slid_m[usize::from(over)];
            *way = way.max((feet - *from.get_or_insert(feet)).norm());
            flown.tilt_deg = flown.tilt_deg.max(o.tilt_error.to_degrees());
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
        if let Some(outage) = outage {
            if t >= outage.from_s && !failed {
                failed = true;
                rig.begin(FaultKind::LinkKilled, 0.0);
            }
            if t >= outage.from_s + outage.away_s && !over {
                over = true;
                flown.back_s = t;
                from = None;
                rig.end(FaultKind::LinkKilled, 0.0);
            }
        }
        over && flown.stopped_s.is_some_and(|at| t >= at + STOPPED_S) || flown.water
    });
    flown
}

#[test]
#[ignore = "110 flights; CI runs them by name"]
fn link_killed_around_the_contact() {
    let mut cells = Vec::new();
    for firmware in BOTH {
        for seed in [71, 72] {
            let undisturbed = fly(firmware, seed, None);
            assert!(undisturbed.is_good(), "{firmware:?}, {seed}: {undisturbed:?}");
            let contact_s = undisturbed.contact_s.unwrap();
            for k in (-5..=5).filter(|k| (k + seed as i32) % 2 == 0) {
                let from_s = contact_s + STEP_S * f64::from(k);
                cells.extend(AWAY_S.map(|away_s| (firmware, seed, k, Outage { from_s, away_s })));
            }
        }
    }
    assert_eq!(cells.len(), 110);
    let flown: Vec<_> = cells
        .par_iter()
        .map(|&(firmware, seed, k, outage)| {
            let flown = fly(firmware, seed, Some(outage));
            let off_s = flown.stopped_s.unwrap_or(f64::INFINITY) - flown.back_s;
            let at_s = STEP_S * f64::from(k);
            let cell = format!("{firmware:?}, {seed}, {at_s:+.1} s, away {} s", outage.away_s);
            let text = format!(
                "{cell}: off after {off_s:.2} s, {:.2} m/s, rose {:.2} m, slid {:.2?} m, tilt {:.0} deg, water {}",
                flown.hardest_mps, flown.rose_m, flown.slid_m, flown.tilt_deg, flown.water
            );
            (flown.is_good(), flown.water, text)
        })
        .collect();
    for (good, _, text) in &flown {
        println!("{} {text}", if *good { "good" } else { "bad " });
    }
    // PX4's hold slides a drone that stands on a moving deck; back under command it climbs and lands again.
    let wrong: Vec<_> = flown.iter().filter(|(good, ..)| !good).collect();
    let none_in_water = flown.iter().all(|(_, water, _)| !water);
    assert!(
        none_in_water && wrong.len() <= 13,
        "{} of 110: {wrong:#?}",
        wrong.len()
    );
}

/// The autopilot lands by itself on the published deck; only the disarm is commanded, if permitted. Returns
/// the flight, the number of disarm commands, and their maximum height above the deck.
fn own_landing(firmware: Firmware, seed: u64, disarms: bool) -> (Flown, usize, f64) {
    let mut scenario = scenario(firmware);
    scenario.start.distance_m = [0.0, 2.0];
    scenario.start.height_m = [6.0, 6.0];
    let mut nodes = NodeConfigs::default();
    nodes.autopilot.publish_deck = true;
    nodes.autopilot.disarm.own_landing = disarms;
    let mut rig = Rig::new(&scenario, &nodes, seed).unwrap();
    rig.run(5.0);
    let mut flown = Flown::default();
    let mut disarmed = 0;
    let mut highest_m = 0.0_f64;
    let autopilot = &mut rig.world.linked(0).unwrap().autopilot;
    autopilot.parameters.insert("PLND_ENABLED", 1.0);
    let mode = match firmware {
        Firmware::Px4 => px4_mode(4, 9),
        Firmware::ArduCopter => 9,
    };
    assert!(autopilot.choose(mode));
    autopilot.commands.clear();
    rig.each(40.0, |rig| {
        let t = rig.t_s();
        let o = rig.world.observation();
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
            disarmed = count;
            highest_m = highest_m.max(height_m);
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
