//! Storms: several faults in one flight. Each storm in `tests/storm` broke a rule when it was found. The
//! drawn storms are the same in each run and reveal changes that often break a rule (`alight study storm`
//! flies thousands).

use alight_shared::msg::State;
use alight_sim::{
    harness::{
        observer::NoObserver,
        storm::{
            Fault, FaultKind, FlightKind, Flown, Moment, Mutant, Storm, fly_observed,
            watch::{StormEnding, StormRule},
        },
    },
    physics::vessel::VesselCourse,
};
use alight_uav::autopilot::modes::Firmware;
use rayon::prelude::*;

fn flown(storm: &Storm, mutant: Option<Mutant>) -> Flown {
    fly_observed(storm, mutant, &mut NoObserver, &mut |_, _| {}).unwrap()
}

/// Contact speed up to which a storm is not considered the cause, m/s: without a fault 2 of 60 landings with
/// ArduCopter touch down at 1.0 to 1.1 m/s, which `alight trial --trials N` counts.
const HARD_MPS: f64 = 1.2;

/// Rule violation of a flight, as text. A contact slower than `excused_mps` does not count.
fn broken_by(flown: &Flown, name: &str, storm: &Storm, excused_mps: f64) -> Option<String> {
    let violation = flown.violation?;
    let usual = violation.rule == StormRule::HardContact && violation.figure < excused_mps;
    (!usual).then(|| format!("{name}: {violation}\n{}", storm.text()))
}
fn broken(storms: &[(String, Storm)]) -> Vec<String> {
    let fly = |(name, storm): &(String, Storm)| broken_by(&flown(storm, None), name, storm, HARD_MPS);
    storms.par_iter().filter_map(fly).collect()
}

#[test]
fn storms_that_broke_a_rule_once() {
    let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/storm");
    let files = std::fs::read_dir(directory).unwrap();
    let storms: Vec<_> = files
        .map(|file| {
            let path = file.unwrap().path();
            let text = std::fs::read_to_string(&path).unwrap();
            let storm = Storm::read(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            (path.display().to_string(), storm)
        })
        .collect();
    assert!(!storms.is_empty());
    let broken = broken(&storms);
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn storms_drawn_by_seed() {
    let storms: Vec<_> = (1..=24)
        .map(|seed| (format!("seed {seed}"), Storm::drawn(seed, 4)))
        .collect();
    let broken = broken(&storms);
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

fn faultless(flight: FlightKind, autopilot: Firmware) -> Storm {
    // Draws until the scene suits the kind of flight.
    let mut drawn = (1..100).map(|seed| Storm::drawn(seed, 0));
    let storm = drawn.find(|s| s.flight == flight).unwrap();
    Storm {
        autopilot,
        course: VesselCourse::Drift,
        speed_mps: 0.0,
        sea: [0.2, 5.0],
        wind_mps: 3.0,
        drones: 1,
        mast: false,
        moving_base: false,
        stock: false,
        ..storm
    }
}

/// Without faults every flight keeps all rules and ends as intended: a take-off in the hold above the vessel,
/// the others on the deck. One flight may still wait for a better moment.
#[test]
fn every_flight_without_a_fault() {
    let both = |flight| super::BOTH.map(|autopilot| faultless(flight, autopilot));
    let flights: Vec<Storm> = FlightKind::ALL.into_iter().flat_map(both).collect();
    let wrong: Vec<String> = flights
        .into_par_iter()
        .filter_map(|storm| {
            let f = flown(&storm, None);
            let name = format!("{:?} over {:?}", storm.flight, storm.autopilot);
            let fits = match storm.flight {
                FlightKind::TakeOff => f.ending == StormEnding::Waits,
                FlightKind::Beacon => true,
                FlightKind::Landing
                | FlightKind::Sortie
                | FlightKind::Station
                | FlightKind::TagAlone
                | FlightKind::Cycles
                | FlightKind::Mavlink => f.ending == StormEnding::Landed,
            };
            let ended = (f.violation.is_none() && !fits).then(|| format!("{name}: {f:?}"));
            broken_by(&f, &name, &storm, 1.0).or(ended)
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A fault at the second of two landings, and a fault at a third landing, which does not occur.
#[test]
fn fault_at_the_second_landing() {
    let fault = |entry| Fault {
        kind: FaultKind::Blind,
        moment: Moment::In(State::Landed),
        entry,
        after_s: 0.5,
        size: 0.0,
        lasts_s: 1.0,
    };
    let storm = Storm {
        faults: vec![fault(2), fault(3)],
        ..faultless(FlightKind::Cycles, Firmware::Px4)
    };
    let f = flown(&storm, None);
    let began: Vec<_> = f.began.iter().map(|(kind, ..)| *kind).collect();
    assert_eq!(
        (began, f.ending),
        (vec![FaultKind::Blind], StormEnding::Landed),
        "{f:?}"
    );
    let landed: Vec<f64> = (f.states.iter())
        .filter(|(state, _)| *state == State::Landed.name())
        .map(|(_, t_s)| *t_s)
        .collect();
    assert!(landed.len() == 2 && f.began[0].2 > landed[1], "{f:?}");
}

fn with_fault(seed: u64, fault: Fault) -> Storm {
    Storm {
        flight: FlightKind::Landing,
        faults: vec![fault],
        sea: [0.2, 5.0],
        autopilot: Firmware::Px4,
        course: VesselCourse::Straight,
        speed_mps: 2.0,
        wind_mps: 3.0,
        reserved: false,
        drones: 1,
        mast: false,
        moving_base: false,
        stock: false,
        ..Storm::drawn(seed, 0)
    }
}

/// The companion computer and its clock are suspended, and the order remains.
#[test]
fn order_over_a_suspended_computer() {
    let cases = [(State::Approach, 1), (State::Descent, 2), (State::Flare, 1)];
    cases.into_par_iter().for_each(|(state, seed)| {
        let fault = Fault::new(FaultKind::ComputerSuspended, Moment::In(state), 0.3, 1.5);
        let f = flown(&with_fault(seed, fault), None);
        let context = format!("{state:?}, seed {seed}: {f:?}");
        assert!(
            f.violation.is_none() && f.ending == StormEnding::Landed,
            "{context}"
        );
    });
}

/// The computer is killed in the flare above a moving boat: the autopilot holds, and the drone slides over
/// the deck's edge.
#[test]
fn computer_killed_in_the_flare() {
    let flights = [(1, 0.1), (1, 0.8), (2, 0.1), (2, 0.8)];
    flights.into_par_iter().for_each(|(seed, after_s)| {
        let fault = Fault::new(FaultKind::ComputerKilled, Moment::In(State::Flare), after_s, 2.0);
        let violation = flown(&with_fault(seed, fault), None).violation;
        assert_eq!(violation, None, "{seed}, {after_s} s");
    });
}

/// Shortest known flight in which the mutant breaks a rule; without the mutant it breaks none.
fn flight_that_shows(mutant: Mutant) -> Option<(Storm, StormRule)> {
    use State::{ClimbOut, Descent, GaveUp, GetAltitude, Tracking, TrackingStable};
    let fault = |kind, state, after_s, size, lasts_s| Fault {
        kind,
        moment: Moment::In(state),
        entry: 1,
        after_s,
        size,
        lasts_s,
    };
    let abort = |state| fault(FaultKind::Abort, state, 0.5, 0.0, 0.0);
    let landing = |faults| Storm {
        flight: FlightKind::Landing,
        faults,
        sea: [0.3, 5.0],
        autopilot: Firmware::Px4,
        course: VesselCourse::Drift,
        speed_mps: 0.0,
        wind_mps: 0.0,
        reserved: false,
        drones: 1,
        mast: false,
        moving_base: false,
        stock: false,
        ..Storm::drawn(3, 0)
    };
    let two = |faults| Storm {
        drones: 2,
        reserved: true,
        ..landing(faults)
    };
    let killed = |kind, state, after_s, lasts_s| fault(kind, state, after_s, 0.0, lasts_s);
    Some(match mutant {
        Mutant::AbortIgnored => (landing(vec![abort(Descent)]), StormRule::AbortIgnored),
        Mutant::OrderKept => (landing(vec![abort(GetAltitude)]), StormRule::AbortIgnored),
        Mutant::StaleForecast => {
            let blind = killed(FaultKind::PredictorKilled, TrackingStable, 0.2, 10.0);
            (landing(vec![blind]), StormRule::HardContact)
        }
        Mutant::ReserveWaived => {
            // The drone hovers until its battery is empty, then falls; the slow planner prolongs the flight.
            let faults = vec![
                fault(FaultKind::BatteryAt, ClimbOut, 0.1, 0.201, 0.0),
                fault(FaultKind::PlannerSlow, ClimbOut, 0.2, 0.02, 400.0),
            ];
            let held = Storm {
                seed: 2,
                faults,
                ..faultless(FlightKind::TakeOff, Firmware::Px4)
            };
            (held, StormRule::BatterySpent)
        }
        Mutant::TwoOwners => (two(Vec::new()), StormRule::Collision),
        Mutant::DeckReleased => {
            let frozen = killed(FaultKind::VesselFrozen, TrackingStable, 0.2, 25.0);
            (two(vec![frozen]), StormRule::TwoAtDeck)
        }
        Mutant::OldCheckpoint => {
            let killed = killed(FaultKind::MissionKilled, GaveUp, 2.0, 0.5);
            (landing(vec![abort(Tracking), killed]), StormRule::AbortIgnored)
        }
        Mutant::StopsByRange
        | Mutant::StaleMission
        | Mutant::FramesIgnored
        | Mutant::ClockKept
        | Mutant::ThrustMissing => return None,
    })
}

#[test]
fn mutants_by_their_shortest_flights() {
    let shown: Vec<_> = Mutant::ALL
        .into_iter()
        .filter_map(|m| Some((m, flight_that_shows(m)?)))
        .collect();
    shown.into_par_iter().for_each(|(mutant, (storm, rule))| {
        assert_eq!(flown(&storm, None).violation, None, "{mutant:?}");
        let violation = flown(&storm, Some(mutant)).violation;
        assert_eq!(violation.map(|v| v.rule), Some(rule), "{mutant:?}");
    });
}

#[test]
#[ignore = "searches 300 storms for each mutant without a short flight: half an hour of processor time"]
fn every_other_mutant_within_300_storms() {
    let found = |mutant: Mutant| {
        let seeds: Vec<u64> = (1..=300).collect();
        // In the order of the seeds, so that the first hit measures the time to find the mutant.
        let first = seeds.par_iter().map(|seed| {
            let storm = Storm::drawn(*seed, 4);
            let violation = flown(&storm, Some(mutant)).violation?;
            // A storm that breaks a rule without the mutant does not reveal it.
            flown(&storm, None)
                .violation
                .is_none()
                .then_some((*seed, violation))
        });
        let first = first.find_map_first(|found| found);
        println!("{mutant:?}: {first:?}");
        first.is_some()
    };
    let others = Mutant::ALL
        .into_iter()
        .filter(|m| flight_that_shows(*m).is_none());
    let missed: Vec<Mutant> = others.filter(|m| !found(*m)).collect();
    assert!(missed.is_empty(), "{missed:?}");
}
