//! A process, the cable to the autopilot or the supervisor fails between the descent and the disarm, with one order to
//! land: the drone ends disarmed on the deck or flies on, and is disarmed nowhere else.

use std::collections::VecDeque;

use alight_shared::msg::{CommandKind, State};
use alight_sim::harness::outcome::MAX_CONTACT_MPS;
use alight_sim::harness::rig::Rig;
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::storm::FaultKind;
use alight_sim::harness::world::Checkpoints;
use alight_sim::physics::sea::SeaConfig;
use alight_uav::autopilot::message::CommandResult;
use alight_uav::autopilot::modes::Firmware;
use rayon::prelude::*;

/// When the part fails.
#[derive(Clone, Copy, Debug)]
enum When {
    /// So long after the mission entered this state, s.
    In(State, f64),
    /// At the first contact.
    AtContact,
    /// So long after the motors stopped, s.
    AfterStop(f64),
}

/// A landing with one order, and its fault.
#[derive(Clone, Copy, Debug)]
struct Flight {
    kind: FaultKind,
    when: When,
    away_s: f64,
    checkpoints: Checkpoints,
    amplitude_m: f64,
    seed: u64,
    firmware: Firmware,
    /// The autopilot obeys no disarm before the fault is over, and its failsafe waits as long as is permitted.
    denies: bool,
}

/// Time in which everything is over, s.
const LIMIT_S: f64 = 150.0;
/// Ticks in the period of the sea, 5 s.
const WAVE_TICKS: usize = 500;
/// Flown on after the fault, at least, s.
const REST_S: f64 = 10.0;
/// Flown on after the motors stopped, s.
const STOPPED_S: f64 = 8.0;
/// Flown on after the mission gave up or was idle, s.
const CLIMB_S: f64 = 15.0;
/// Time after the fault until the drone is commanded again, at most, s.
const RESUME_S: f64 = 1.5;

/// Ending of a flight.
#[derive(Debug, Default)]
struct End {
    state: State,
    motors_on: bool,
    /// Feet's centre above the deck, m.
    height_m: f64,
    /// Mean height over the last wave, m: who holds at a fixed place is met by single waves.
    mean_height_m: f64,
    /// When the motors stopped for good, s, and the height there, m.
    stopped: Option<(f64, f64)>,
    /// Off the deck's centre, m.
    off_m: f64,
    /// The hardest contact while somebody commands: without pilot or link the autopilot holds a fixed place, and the deck
    /// may rise into the drone, m/s.
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
        let in_the_air = self.stopped.is_some_and(|(_, height_m)| height_m > 0.2);
        self.hardest_mps <= MAX_CONTACT_MPS
            && !self.water
            && !in_the_air
            && (self.landed() || self.holds_above())
    }
}

impl Flight {
    /// Size of its fault: 1 where the successor has no checkpoint.
    fn size(&self) -> f64 {
        f64::from(u8::from(self.checkpoints == Checkpoints::Lost))
    }
    fn fly(&self) -> End {
        let mut scenario = Scenario {
            sea: SeaConfig::paper(self.amplitude_m, 5.0),
            ..Scenario::default()
        };
        scenario.drone.autopilot.firmware = self.firmware;
        if self.denies {
            scenario.drone.autopilot.loss_after_s = 0.5;
        }
        let mut rig = Rig::landing(&scenario, &NodeConfigs::default(), self.seed).unwrap();
        let (mut failed_s, mut over_s): (Option<f64>, Option<f64>) = (None, None);
        let (mut end, mut contact, mut heights_m) = (End::default(), false, VecDeque::new());
        rig.each(LIMIT_S, |rig| {
            let (t, state, o) = (rig.t_s(), rig.state(0), rig.world.observation());
            let commanded = matches!(self.kind, FaultKind::MissionKilled | FaultKind::PredictorKilled);
            let abandoned = !commanded && failed_s.is_some() && over_s.is_none_or(|at| t < at + RESUME_S);
            contact |= !o.contacts.is_empty();
            for c in o.contacts.iter().filter(|_| !abandoned) {
                end.hardest_mps = end.hardest_mps.max(c.normal_mps);
            }
            (end.state, end.motors_on, end.off_m) = (state, o.motors_on, o.horizontal_m);
            end.water |= o.in_water;
            end.height_m = o.feet_height_m();
            heights_m.push_back(end.height_m);
            heights_m.drain(..heights_m.len().saturating_sub(WAVE_TICKS));
            end.mean_height_m = heights_m.iter().sum::<f64>() / heights_m.len() as f64;
            end.stopped = (!o.motors_on).then(|| end.stopped.unwrap_or((t, end.height_m)));
            let due = match self.when {
                When::In(state, after_s) => rig.is_due(state, after_s),
                When::AtContact => contact,
                When::AfterStop(after_s) => end.stopped.is_some_and(|(at, _)| t >= at + after_s),
            };
            // Denied at first, disarms have to go on.
            let denies = self.denies && matches!(self.when, When::In(State::Landed, _)) && over_s.is_none();
            rig.world.linked(0).unwrap().autopilot.answer = denies.then_some(CommandResult::Denied);
            if due && failed_s.is_none() {
                failed_s = Some(t);
                rig.begin(self.kind, self.size());
            }
            if failed_s.is_some_and(|at| t >= at + self.away_s) && over_s.is_none() {
                over_s = Some(t);
                rig.end(self.kind, self.size());
            }
            let settled = end.stopped.is_some_and(|(at, _)| t >= at + STOPPED_S)
                || matches!(state, State::GaveUp | State::Idle) && t >= rig.entered_s(0) + CLIMB_S;
            over_s.is_some_and(|at| t >= at + REST_S) && settled || end.water
        });
        assert!(over_s.is_some(), "{self:?} never came so far: {end:?}");
        end
    }
}

/// Amplitude, m, and seed: those of every run, and those of one on request.
const SEAS: [(f64, u64); 1] = [(0.8, 43)];
const MORE_SEAS: [(f64, u64); 3] = [(0.5, 41), (0.5, 42), (0.8, 44)];

/// The drone of the defaults in these seas, with every fault.
fn over_seas(seas: &[(f64, u64)], kind: FaultKind, cases: &[When], checkpoints: Checkpoints) -> Vec<Flight> {
    let mut flights = Vec::new();
    for &when in cases {
        for away_s in [0.3, 1.0] {
            flights.extend(seas.iter().map(|&(amplitude_m, seed)| Flight {
                kind,
                when,
                away_s,
                checkpoints,
                amplitude_m,
                seed,
                firmware: Firmware::Px4,
                denies: false,
            }));
        }
    }
    flights
}
/// Both firmwares in one sea, with every fault.
fn over_firmwares(kind: FaultKind, cases: &[When], away_s: &[f64]) -> Vec<Flight> {
    let mut flights = Vec::new();
    for firmware in [Firmware::Px4, Firmware::ArduCopter] {
        for (&when, seed) in cases.iter().zip(51..) {
            flights.extend(away_s.iter().map(|&away_s| Flight {
                kind,
                when,
                away_s,
                checkpoints: Checkpoints::Kept,
                amplitude_m: 0.5,
                seed,
                firmware,
                denies: true,
            }));
        }
    }
    flights
}

/// Fails with every flight that was not safe; gives how many landed, and of how many.
fn all_safe(flights: &[Flight]) -> (usize, usize) {
    let flown: Vec<_> = flights.par_iter().map(|f| (f, f.fly())).collect();
    let landed = flown.iter().filter(|(_, end)| end.landed()).count();
    let wrong: Vec<_> = flown.iter().filter(|(_, end)| !end.is_safe()).collect();
    assert!(
        wrong.is_empty(),
        "{} of {} ({landed} landed): {wrong:#?}",
        wrong.len(),
        flights.len()
    );
    (landed, flights.len())
}
/// All are safe, and all land.
fn all_land(flights: &[Flight]) {
    let (landed, of) = all_safe(flights);
    assert_eq!(landed, of);
}
/// All are safe, and most land: an autopilot whose own hold has taken off from a deck that sinks is not pressed back onto it.
fn most_land(flights: &[Flight]) {
    let (landed, of) = all_safe(flights);
    assert!(4 * landed >= 3 * of, "{landed} of {of}");
}

const IN_DESCENT: [When; 2] = [When::In(State::Descent, 0.5), When::In(State::Descent, 2.5)];
const IN_FLARE: [When; 3] = [
    When::In(State::Flare, 0.1),
    When::In(State::Flare, 0.5),
    When::In(State::Flare, 0.3),
];
const ON_THE_DECK: [When; 4] = [
    When::AtContact,
    When::AfterStop(0.0),
    When::AfterStop(0.1),
    When::AfterStop(0.3),
];
const IN_THE_AIR: [When; 3] = [
    When::In(State::Descent, 1.0),
    When::In(State::Flare, 0.3),
    When::AtContact,
];
/// The pilot has stopped the motors, the autopilot has not disarmed.
const AFTER_THE_STOP: [When; 4] = [
    When::In(State::Landed, 0.0),
    When::In(State::Landed, 0.1),
    When::In(State::Landed, 0.2),
    When::In(State::Landed, 0.3),
];

/// Mission and computer are killed in these seas; without its checkpoint a mission may give up in the air.
fn killed_on_the_way_down(seas: &[(f64, u64)]) {
    for kind in [FaultKind::MissionKilled, FaultKind::ComputerKilled] {
        for cases in [&IN_DESCENT[..], &IN_FLARE, &ON_THE_DECK] {
            all_land(&over_seas(seas, kind, cases, Checkpoints::Kept));
        }
    }
    let lost = |cases: &[When]| over_seas(seas, FaultKind::MissionKilled, cases, Checkpoints::Lost);
    all_safe(&lost(&IN_DESCENT));
    all_safe(&lost(&IN_FLARE));
    all_land(&lost(&ON_THE_DECK));
}

#[test]
fn mission_or_computer_killed_on_the_way_down() {
    killed_on_the_way_down(&SEAS);
}

#[test]
#[ignore = "three times as many flights as the test above: two minutes"]
fn processes_killed_in_more_seas() {
    killed_on_the_way_down(&MORE_SEAS);
}

#[test]
fn mission_away_in_flare_until_after_contact() {
    let late = [0.3, 0.45, 0.6, 0.75].map(|s| When::In(State::Flare, s));
    all_land(&over_firmwares(FaultKind::MissionKilled, &late, &[0.7, 0.9, 2.0]));
}

#[test]
fn processes_restarted_in_the_air() {
    for (kind, away_s) in [
        (FaultKind::PilotKilled, &[0.3, 1.0][..]),
        (FaultKind::LinkKilled, &[0.3, 1.0]),
        (FaultKind::CableOut, &[2.0]),
    ] {
        all_safe(&over_firmwares(kind, &IN_THE_AIR, away_s));
    }
    for (kind, away_s) in [
        (FaultKind::PredictorKilled, &[0.3, 1.0][..]),
        (FaultKind::ComputerKilled, &[0.3, 0.6, 1.0]),
    ] {
        all_land(&over_firmwares(kind, &IN_THE_AIR, away_s));
    }
}

#[test]
fn processes_restarted_after_the_stop() {
    // The link before the failsafe, and after it.
    for (kind, away_s) in [
        (FaultKind::PilotKilled, [0.3, 1.0]),
        (FaultKind::LinkKilled, [0.1, 0.4]),
    ] {
        all_land(&over_firmwares(kind, &AFTER_THE_STOP, &away_s));
    }
    for (kind, away_s) in [
        (FaultKind::LinkKilled, &[0.3, 0.6][..]),
        (FaultKind::CableOut, &[1.0]),
        (FaultKind::ComputerKilled, &[0.3, 0.6, 1.0]),
    ] {
        most_land(&over_firmwares(kind, &AFTER_THE_STOP, away_s));
    }
}

#[test]
fn abort_of_an_idle_mission_above_the_deck() {
    let mut scenario = Scenario {
        sea: SeaConfig::paper(0.8, 5.0),
        ..Scenario::default()
    };
    scenario.start.distance_m = [0.0, 0.3];
    scenario.start.height_m = [4.0, 4.0];
    let mut rig = Rig::new(&scenario, &NodeConfigs::default(), 45).unwrap();
    rig.run(0.5);
    assert_eq!(rig.state(0), State::Idle);
    for _ in 0..2 {
        rig.world.command(CommandKind::Abort);
        rig.run(8.0);
        assert_eq!(rig.state(0), State::GaveUp);
    }
    let o = rig.world.observation();
    let height_m = o.feet_height_m();
    assert!(o.contacts.is_empty() && height_m > 12.0, "{height_m} m");
}

/// The pilot's process dies between its stop of the motors and the disarm: a new pilot must not start them again.
#[test]
fn motors_off_with_a_restarted_pilot() {
    let scenario = Scenario {
        sea: SeaConfig::paper(0.5, 5.0),
        ..Scenario::default()
    };
    let mut rig = Rig::landing(&scenario, &NodeConfigs::default(), 46).unwrap();
    assert!(rig.until(LIMIT_S, |rig| rig.state(0) == State::Landed));
    rig.end(FaultKind::PilotKilled, 0.0);
    // Until its own thrust is in force (0.2 s) a new pilot presses with less than carries the drone.
    rig.run(0.4);
    rig.each(5.0, |rig| {
        assert!(!rig.world.observation().motors_on);
        false
    });
}
