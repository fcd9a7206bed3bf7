//! The mission's process, or the supervisor with all of them, dies near the deck and starts anew, with one order to land
//! and nobody who orders again.
// Helpers of tests may panic, as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::VecDeque;

use alight_shared::msg::CommandKind;
use alight_shared::msg::State;
use alight_sim::harness::outcome::MAX_CONTACT_MPS;
use alight_sim::harness::physics::TICK;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::tap::NoTap;
use alight_sim::harness::world::{Checkpoints, World};
use alight_sim::physics::sea::SeaConfig;

/// What dies.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Dies {
    /// The mission's process.
    Mission,
    /// The supervisor, and with it every process of the drone's computer.
    Supervisor,
}

/// When the process dies.
#[derive(Clone, Copy, Debug)]
enum Killed {
    /// So long after it entered this state, s.
    In(State, f64),
    /// At the first contact.
    AtContact,
    /// So long after the motors stopped, s.
    AfterStop(f64),
}

/// How a flight ended.
#[derive(Debug)]
struct End {
    state: State,
    motors_on: bool,
    /// Feet's centre above the deck, m.
    height_m: f64,
    /// Its mean over the last wave, m: who holds at a fixed place is met by single waves.
    mean_height_m: f64,
    /// Off the deck's centre, m.
    off_m: f64,
    /// The hardest contact while somebody commands, m/s: without the computer the autopilot holds a fixed place, and the deck may
    /// rise into the drone.
    hardest_mps: f64,
    water: bool,
}

impl End {
    fn landed(&self) -> bool {
        !self.motors_on && self.height_m.abs() < 0.1 && self.off_m < 1.5
    }
    fn holds_above(&self) -> bool {
        // Idle: not lower than it followed.
        self.motors_on
            && self.mean_height_m > 4.0
            && matches!(self.state, State::GaveUp | State::Hold | State::Idle)
    }
    fn is_safe(&self) -> bool {
        self.hardest_mps <= MAX_CONTACT_MPS && !self.water && (self.landed() || self.holds_above())
    }
}

/// Time in which everything is over, s.
const LIMIT_S: f64 = 150.0;
/// Ticks in the period of the sea, 5 s.
const WAVE_TICKS: usize = 500;
/// Flown on after the restart and after the motors stopped, s.
const REST_S: f64 = 8.0;
/// Time after the restart of all processes until the drone is commanded again, at most, s.
const RESUME_S: f64 = 1.5;
/// Flown on after the mission gave up or was idle, s.
const CLIMB_S: f64 = 15.0;

/// A landing with one order; the mission dies when `killed` says and starts anew `away_s` later.
fn flown(
    dies: Dies,
    amplitude_m: f64,
    seed: u64,
    killed: Killed,
    away_s: f64,
    checkpoints: Checkpoints,
) -> End {
    let scenario = Scenario {
        sea: SeaConfig::paper(amplitude_m, 5.0),
        ..Scenario::default()
    };
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, seed).unwrap();
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    let (mut entered, mut state) = (0.0, State::Idle);
    let (mut contact, mut stop) = (None, None);
    let mut heights_m = VecDeque::new();
    let mut died: Option<f64> = None;
    let gone = |died: Option<f64>, t: f64| {
        dies == Dies::Supervisor && died.is_some_and(|at| t < at + away_s + RESUME_S)
    };
    let mut started = false;
    let mut end = None;
    let (mut hardest_mps, mut water) = (0.0_f64, false);
    for _ in 0..(LIMIT_S / TICK.secs()) as u32 {
        world.tick(&mut NoTap);
        let t = world.physics().time_since_start().secs();
        let now = world.mission_state().state;
        if now != state {
            (state, entered) = (now, t);
        }
        let o = world.observation();
        for c in o.contacts {
            contact.get_or_insert(t);
            if !gone(died, t) {
                hardest_mps = hardest_mps.max(c.normal_mps);
            }
        }
        water |= o.in_water;
        if !o.motors_on {
            stop.get_or_insert(t);
        }
        let due = match killed {
            Killed::In(s, after_s) => state == s && t >= entered + after_s,
            Killed::AtContact => contact.is_some(),
            Killed::AfterStop(after_s) => stop.is_some_and(|at| t >= at + after_s),
        };
        let height_m = o.feet_height_m();
        heights_m.push_back(height_m);
        heights_m.drain(..heights_m.len().saturating_sub(WAVE_TICKS));
        end = Some(End {
            state,
            motors_on: o.motors_on,
            height_m,
            mean_height_m: heights_m.iter().sum::<f64>() / heights_m.len() as f64,
            off_m: o.horizontal_m,
            hardest_mps,
            water,
        });
        if due && died.is_none() {
            died = Some(t);
            match dies {
                Dies::Mission => world.kill_mission(0),
                Dies::Supervisor => world.kill_computer(0),
            }
        }
        if died.is_some_and(|at| t >= at + away_s) && !started {
            started = true;
            match dies {
                Dies::Mission => world.start_mission(0, &scenario, &nodes, checkpoints),
                Dies::Supervisor => world.start_computer(0, &scenario, &nodes, checkpoints),
            }
        }
        let over = stop.is_some_and(|at| t >= at + REST_S)
            || matches!(state, State::GaveUp | State::Idle) && t >= entered + CLIMB_S;
        if died.is_some_and(|at| t >= at + away_s + REST_S) && over || water {
            break;
        }
    }
    assert!(started, "it never came so far: {end:?}");
    end.unwrap()
}

/// Flies all and fails with every flight that was not safe; gives how many landed, and of how many.
fn all_safe(dies: Dies, cases: &[Killed], away_s: &[f64], checkpoints: Checkpoints) -> (usize, usize) {
    let (mut unsafe_ends, mut landed, mut flights) = (Vec::new(), 0, 0);
    for &killed in cases {
        for &away_s in away_s {
            for (amplitude_m, seed) in [(0.5, 41), (0.5, 42), (0.8, 43), (0.8, 44)] {
                let end = flown(dies, amplitude_m, seed, killed, away_s, checkpoints);
                flights += 1;
                landed += usize::from(end.landed());
                if !end.is_safe() {
                    unsafe_ends.push(format!(
                        "{killed:?}, {away_s} s, {amplitude_m} m, seed {seed}: {end:?}"
                    ));
                }
            }
        }
    }
    assert!(
        unsafe_ends.is_empty(),
        "{dies:?}, {} of {flights} ({landed} landed):\n{}",
        unsafe_ends.len(),
        unsafe_ends.join("\n")
    );
    (landed, flights)
}

const IN_DESCENT: [Killed; 2] = [Killed::In(State::Descent, 0.5), Killed::In(State::Descent, 2.5)];
const IN_FLARE: [Killed; 3] = [
    Killed::In(State::Flare, 0.1),
    Killed::In(State::Flare, 0.5),
    Killed::In(State::Flare, 0.3),
];
const ON_THE_DECK: [Killed; 4] = [
    Killed::AtContact,
    Killed::AfterStop(0.0),
    Killed::AfterStop(0.1),
    Killed::AfterStop(0.3),
];
const AWAY_S: [f64; 2] = [0.3, 1.0];

#[test]
fn mission_killed_in_descent_goes_on_and_lands() {
    let (landed, of) = all_safe(Dies::Mission, &IN_DESCENT, &AWAY_S, Checkpoints::Kept);
    assert_eq!(landed, of);
}

#[test]
fn mission_killed_in_flare_goes_on_and_lands() {
    let (landed, of) = all_safe(Dies::Mission, &IN_FLARE, &AWAY_S, Checkpoints::Kept);
    assert_eq!(landed, of);
}

#[test]
fn mission_killed_on_the_deck_ends_with_motors_off() {
    let (landed, of) = all_safe(Dies::Mission, &ON_THE_DECK, &AWAY_S, Checkpoints::Kept);
    assert_eq!(landed, of);
}

#[test]
fn mission_killed_in_descent_without_checkpoint_climbs_from_the_deck_and_holds() {
    all_safe(Dies::Mission, &IN_DESCENT, &AWAY_S, Checkpoints::Lost);
}

#[test]
fn mission_killed_in_flare_without_checkpoint_lands_or_climbs() {
    all_safe(Dies::Mission, &IN_FLARE, &AWAY_S, Checkpoints::Lost);
}

#[test]
fn mission_killed_on_the_deck_without_checkpoint_ends_with_motors_off() {
    let (landed, of) = all_safe(Dies::Mission, &ON_THE_DECK, &AWAY_S, Checkpoints::Lost);
    assert_eq!(landed, of);
}

#[test]
fn supervisor_killed_in_descent() {
    let (landed, of) = all_safe(Dies::Supervisor, &IN_DESCENT, &AWAY_S, Checkpoints::Kept);
    assert_eq!(landed, of);
}

#[test]
fn supervisor_killed_in_flare() {
    let (landed, of) = all_safe(Dies::Supervisor, &IN_FLARE, &AWAY_S, Checkpoints::Kept);
    assert_eq!(landed, of);
}

#[test]
fn supervisor_killed_on_the_deck() {
    let (landed, of) = all_safe(Dies::Supervisor, &ON_THE_DECK, &AWAY_S, Checkpoints::Kept);
    assert_eq!(landed, of);
}

#[test]
fn abort_of_an_idle_mission_above_the_deck_climbs() {
    let mut scenario = Scenario {
        sea: SeaConfig::paper(0.8, 5.0),
        ..Scenario::default()
    };
    scenario.start.distance_m = [0.0, 0.3];
    scenario.start.height_m = [4.0, 4.0];
    let mut world = World::new(&scenario, &NodeConfigs::default(), 45).unwrap();
    world.warm_up(&mut NoTap);
    let fly = |world: &mut World, s: f64| (0..(s / TICK.secs()) as u32).for_each(|_| world.tick(&mut NoTap));
    fly(&mut world, 0.5);
    assert_eq!(world.mission_state().state, State::Idle);
    for _ in 0..2 {
        world.command(CommandKind::Abort);
        fly(&mut world, 8.0);
        assert_eq!(world.mission_state().state, State::GaveUp);
    }
    let o = world.observation();
    let height_m = o.feet_height_m();
    assert!(o.contacts.is_empty() && height_m > 12.0, "{height_m} m");
}

/// The pilot's process dies between its stop of the motors and the disarm: a new pilot must not start them again.
#[test]
fn pilot_restarted_after_its_stop_leaves_the_motors_off() {
    let scenario = Scenario {
        sea: SeaConfig::paper(0.5, 5.0),
        ..Scenario::default()
    };
    let nodes = NodeConfigs::default();
    let mut world = World::new(&scenario, &nodes, 46).unwrap();
    world.warm_up(&mut NoTap);
    world.command(CommandKind::Land);
    for _ in 0..(LIMIT_S / TICK.secs()) as u32 {
        world.tick(&mut NoTap);
        if world.mission_state().state == State::Landed {
            break;
        }
    }
    assert_eq!(world.mission_state().state, State::Landed);
    world.start_pilot(0, &nodes);
    for tick in 0..500 {
        world.tick(&mut NoTap);
        // The disarm is on its way for a moment.
        assert!(tick < 20 || !world.observation().motors_on);
    }
}
