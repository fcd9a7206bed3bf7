//! Mission, pilot, link, its cable or the supervisor fail between the descent and the disarm, with one order to land: the drone ends
//! disarmed on the deck or flies on, and is disarmed nowhere else.

use alight_shared::msg::{CommandKind, State};
use alight_sim::harness::outcome::MAX_CONTACT_MPS;
use alight_sim::harness::physics::TICK;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::world::{Checkpoints, World};
use alight_sim::physics::sea::SeaConfig;
use alight_uav::autopilot::message::CommandResult;
use alight_uav::autopilot::modes::Firmware;

use crate::BOTH;

/// What fails.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Failing {
    Mission,
    Predictor,
    Pilot,
    Link,
    Cable,
    /// With every process of the drone's computer.
    Supervisor,
}

/// When it fails.
#[derive(Clone, Copy, Debug)]
enum When {
    /// So long after the mission entered this state, s. In `Landed` the pilot has stopped the motors, and the
    /// autopilot obeys no disarm before the fault is over.
    In(State, f64),
    /// At the first contact.
    AtContact,
}

const IN_THE_AIR: [When; 3] = [
    When::In(State::Descent, 1.0),
    When::In(State::Flare, 0.3),
    When::AtContact,
];
const AFTER_THE_STOP: [When; 4] = [
    When::In(State::Landed, 0.0),
    When::In(State::Landed, 0.1),
    When::In(State::Landed, 0.2),
    When::In(State::Landed, 0.3),
];

/// Time in which everything is over, s.
const LIMIT_S: f64 = 150.0;
/// Flown on after the fault, at least, s.
const REST_S: f64 = 10.0;

/// Time after the fault until the drone is commanded again, at most, s.
const RESUME_S: f64 = 1.5;

/// How a flight ended.
#[derive(Debug)]
struct End {
    state: State,
    motors_on: bool,
    /// Feet's centre above the deck, m.
    height_m: f64,
    /// The same when the motors stopped for good, m.
    stopped_at_m: Option<f64>,
    off_m: f64,
    /// The hardest contact while somebody commands: without pilot or link the autopilot's own hold does as it does,
    /// m/s.
    hardest_mps: f64,
    water: bool,
}

impl End {
    fn landed(&self) -> bool {
        !self.motors_on && self.height_m.abs() < 0.1 && self.off_m < 1.5
    }
    fn is_safe(&self) -> bool {
        let holds_above = self.motors_on && self.height_m > 4.0 && self.state != State::Landed;
        let in_the_air = self.stopped_at_m.is_some_and(|h| h > 0.2);
        self.hardest_mps <= MAX_CONTACT_MPS && !self.water && !in_the_air && (self.landed() || holds_above)
    }
}

fn flown(firmware: Firmware, failing: Failing, when: When, away_s: f64, seed: u64) -> End {
    let mut scenario = Scenario {
        sea: SeaConfig::paper(0.5, 5.0),
        ..Scenario::default()
    };
    let a = &mut scenario.drone.autopilot;
    // The longest that is permitted.
    (a.firmware, a.loss_after_s) = (firmware, 0.5);
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, seed).unwrap();
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    let fail = |world: &mut World, failed: bool| match (failing, failed) {
        (Failing::Mission, true) => world.kill_mission(0),
        (Failing::Mission, false) => world.start_mission(0, &scenario, &nodes, Checkpoints::Kept),
        (Failing::Predictor, true) => world.kill_predictor(0),
        (Failing::Predictor, false) => world.start_predictor(0, &nodes, Checkpoints::Kept),
        (Failing::Pilot, true) => world.kill_pilot(0),
        (Failing::Pilot, false) => world.start_pilot(0, &nodes),
        (Failing::Link, true) => world.kill_link(0),
        (Failing::Link, false) => world.start_link(0, Checkpoints::Kept),
        (Failing::Cable, _) => world.linked(0).unwrap().cut = failed,
        (Failing::Supervisor, true) => world.kill_computer(0),
        (Failing::Supervisor, false) => world.start_computer(0, &scenario, &nodes, Checkpoints::Kept),
    };
    let stubborn = matches!(when, When::In(State::Landed, _));
    let (mut entered_s, mut state, mut contact) = (0.0, State::Idle, false);
    let (mut failed_s, mut over_s): (Option<f64>, Option<f64>) = (None, None);
    let mut end = None;
    let (mut hardest_mps, mut water, mut stopped_at_m) = (0.0_f64, false, None);
    for _ in 0..(LIMIT_S / TICK.secs()) as u32 {
        world.tick(&mut NoTap);
        let t = world.physics().time_since_start().secs();
        let now = world.mission_state().state;
        if now != state {
            (state, entered_s) = (now, t);
        }
        let o = world.observation();
        contact |= !o.contacts.is_empty();
        let commands = matches!(failing, Failing::Mission | Failing::Predictor);
        let abandoned = !commands && failed_s.is_some() && over_s.is_none_or(|at| t < at + RESUME_S);
        for c in o.contacts.iter().filter(|_| !abandoned) {
            hardest_mps = hardest_mps.max(c.normal_mps);
        }
        water |= o.in_water;
        let height_m = o.feet_height_m();
        if o.motors_on {
            stopped_at_m = None;
        } else {
            stopped_at_m.get_or_insert(height_m);
        }
        let due = match when {
            When::In(s, after_s) => state == s && t >= entered_s + after_s,
            When::AtContact => contact,
        };
        let motors_on = o.motors_on;
        end = Some(End {
            state,
            motors_on,
            height_m,
            stopped_at_m,
            off_m: o.horizontal_m,
            hardest_mps,
            water,
        });
        // The autopilot denies the first disarms: they have to go on.
        let denies = stubborn && over_s.is_none();
        world.linked(0).unwrap().autopilot.answer = denies.then_some(CommandResult::Denied);
        if due && failed_s.is_none() {
            failed_s = Some(t);
            fail(&mut world, true);
        }
        if failed_s.is_some_and(|at| t >= at + away_s) && over_s.is_none() {
            over_s = Some(t);
            fail(&mut world, false);
        }
        let rested = over_s.is_some_and(|at| t >= at + REST_S);
        let settled = !motors_on || matches!(state, State::GaveUp) && t >= entered_s + 15.0;
        if rested && settled || water {
            break;
        }
    }
    assert!(over_s.is_some(), "it never came so far: {end:?}");
    end.unwrap()
}

/// Flies all and fails with every flight that was not safe; gives how many landed, and of how many.
fn all_safe(failing: Failing, cases: &[When], away_s: &[f64]) -> (usize, usize) {
    let (mut unsafe_ends, mut landed, mut flights) = (Vec::new(), 0, 0);
    for firmware in BOTH {
        for (&when, seed) in cases.iter().zip(51..) {
            for &away_s in away_s {
                let end = flown(firmware, failing, when, away_s, seed);
                flights += 1;
                landed += usize::from(end.landed());
                if !end.is_safe() {
                    unsafe_ends.push(format!(
                        "{firmware:?}, {when:?}, {away_s} s, seed {seed}: {end:?}"
                    ));
                }
            }
        }
    }
    assert!(
        unsafe_ends.is_empty(),
        "{failing:?}, {} of {flights}:\n{}",
        unsafe_ends.len(),
        unsafe_ends.join("\n")
    );
    (landed, flights)
}

#[test]
fn mission_away_in_the_flare_until_after_the_contact_ends_disarmed() {
    let late = [0.3, 0.45, 0.6, 0.75].map(|s| When::In(State::Flare, s));
    let (landed, of) = all_safe(Failing::Mission, &late, &[0.7, 0.9, 2.0]);
    assert_eq!(landed, of);
}

#[test]
fn pilot_restarted_in_descent_flare_or_at_contact_lands_or_flies_on() {
    all_safe(Failing::Pilot, &IN_THE_AIR, &[0.3, 1.0]);
}

#[test]
fn pilot_restarted_after_its_stop_ends_disarmed() {
    let (landed, of) = all_safe(Failing::Pilot, &AFTER_THE_STOP, &[0.3, 1.0]);
    assert_eq!(landed, of);
}

#[test]
fn link_restarted_in_descent_flare_or_at_contact_lands_or_flies_on() {
    all_safe(Failing::Link, &IN_THE_AIR, &[0.3, 1.0]);
}

#[test]
fn link_restarted_after_the_stop_before_the_failsafe_ends_disarmed() {
    let (landed, of) = all_safe(Failing::Link, &AFTER_THE_STOP, &[0.1, 0.4]);
    assert_eq!(landed, of);
}

#[test]
fn link_restarted_after_the_stop_ends_disarmed_or_climbs() {
    let (landed, of) = all_safe(Failing::Link, &AFTER_THE_STOP, &[0.3, 0.6]);
    // An autopilot whose own hold has taken off from a deck that sinks is not pressed back onto it.
    assert!(4 * landed >= 3 * of, "{landed} of {of}");
}

#[test]
fn cable_out_in_descent_flare_or_at_contact_lands_or_flies_on() {
    all_safe(Failing::Cable, &IN_THE_AIR, &[2.0]);
}

#[test]
fn cable_out_after_the_stop_ends_disarmed_or_climbs() {
    let (landed, of) = all_safe(Failing::Cable, &AFTER_THE_STOP, &[1.0]);
    // An autopilot whose own hold has taken off from a deck that sinks is not pressed back onto it.
    assert!(4 * landed >= 3 * of, "{landed} of {of}");
}

#[test]
fn predictor_restarted_in_the_air() {
    let (landed, of) = all_safe(Failing::Predictor, &IN_THE_AIR, &[0.3, 1.0]);
    assert_eq!(landed, of);
}

#[test]
fn supervisor_restarted_in_the_air() {
    let (landed, of) = all_safe(Failing::Supervisor, &IN_THE_AIR, &[0.3, 0.6, 1.0]);
    assert_eq!(landed, of);
}

#[test]
fn supervisor_restarted_after_the_stop() {
    let (landed, of) = all_safe(Failing::Supervisor, &AFTER_THE_STOP, &[0.3, 0.6, 1.0]);
    // An autopilot whose own hold has taken off from a deck that sinks is not pressed back onto it.
    assert!(4 * landed >= 3 * of, "{landed} of {of}");
}
