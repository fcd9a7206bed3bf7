//! A process or the cable of a drone that lands fails: `alight land` gives its one order, a firmware of the tests' own
//! flies the drone behind the link to the autopilot. Nothing here asserts a wall-clock time: all times are the world's.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use alight_uav::autopilot::modes::Firmware;
use serde_json::Value;

use crate::common::{instance, run};
use crate::firmware::{Flight, Flown, fly};
use crate::landing::{directory, pid, status_when};

/// On the deck with motors on, at most, s: the autopilot denies for 1 s, PX4 comes back from its failsafe, and a
/// process that starts anew looks for the evidence.
const MOTORS_ON_S: f64 = 5.0;
/// For so long from the first disarm on the autopilot denies it, s: longer than a fault waits after the stop.
const DENIES_S: f64 = 1.0;
/// The drone never tilts further beyond what was commanded, deg.
const TILT_BEYOND_DEG: f64 = 10.0;
const BOTH: [Firmware; 2] = [Firmware::Px4, Firmware::ArduCopter];
const MODERATE: &str = "moderate";

/// It rests on the deck, disarmed in time, or is away from it without having touched it; nothing met the water, and
/// every contact was soft unless pilot or link stood still: then the autopilot's own hold does as it does.
fn is_safe(flown: &Flown) -> bool {
    let o = &flown.outcome;
    let none = |count: &str| o[count].as_u64() == Some(0);
    let fault = o["live"]["fault"]["fault"].as_str().unwrap_or_default();
    let uncommanded = ["pilot:freeze", "autopilot:freeze"]
        .iter()
        .any(|f| fault.starts_with(f));
    let landed = flown.entered("Landed")
        && !flown.autopilot.armed()
        && o["rest_position_error_m"].as_f64().is_some_and(|e| e < 1.0)
        && o["live"]["motors_on_deck_s"]
            .as_f64()
            .is_some_and(|s| s <= MOTORS_ON_S);
    let away = o["outcome"] == "gave-up" && o["touchdown_speed_mps"].is_null();
    none("water_contacts") && (uncommanded || none("unsafe_contacts")) && (landed || away)
}

/// One line for a person.
fn line(name: &str, flown: &Flown) -> String {
    let o = &flown.outcome;
    format!(
        "{name}: {} ({}), {} unsafe contacts, motors on {} s on deck, tilt {:.1} deg beyond, {} s late, fault {}",
        o["outcome"],
        o["reason"],
        o["unsafe_contacts"],
        o["live"]["motors_on_deck_s"],
        flown.tilt_beyond.to_degrees(),
        o["live"]["world_late_s"],
        o["live"]["fault"],
    )
}

/// Flies it, and again where the computer did not keep up.
fn in_time<R>(name: &str, fly: impl Fn() -> (Flown, R)) -> (Flown, R) {
    let mut again = 0;
    loop {
        let (flown, more) = fly();
        println!("{}", line(name, &flown));
        again += 1;
        if flown.outcome["too-slow"].is_null() || again == 3 {
            return (flown, more);
        }
    }
}

fn flown_in_time(name: &str, flight: &Flight) -> Flown {
    in_time(name, || (fly(&instance(name), flight), ())).0
}

/// The fault happened, and the flight is safe.
fn assert_safe(name: &str, flight: &Flight) -> Flown {
    let flown = flown_in_time(name, flight);
    assert!(is_safe(&flown), "{}", flown.show());
    flown
}

/// A landing in this sea, with this fault.
fn with_fault(firmware: Firmware, sea: &str, fault: Option<&str>, seed: usize) -> Flight {
    let flag = fault.map_or_else(String::new, |fault| format!("--fault {fault}"));
    let mut flight = Flight::new(firmware, format!("--sea {sea} --seed {seed} {flag}"));
    if fault.is_some_and(|fault| fault.ends_with("landed")) {
        flight.denies_s = DENIES_S;
    }
    flight
}

fn assert_lands_with(name: &str, firmware: Firmware, fault: &str) {
    let flown = assert_safe(name, &with_fault(firmware, MODERATE, Some(fault), 3));
    let at_s = &flown.outcome["live"]["fault"]["at_s"];
    assert!(at_s.is_number() && flown.entered("Landed"), "{}", flown.show());
}

#[test]
fn live_mission_killed_in_flare() {
    assert_lands_with("flare", Firmware::ArduCopter, "mission:kill:flare");
}

#[test]
fn abort_to_the_successor_of_a_killed_mission() {
    let name = instance("successor");
    let flight = with_fault(Firmware::Px4, MODERATE, Some("mission:kill:descent"), 4);
    let (flown, out) = in_time("successor", || {
        std::thread::scope(|scope| {
            let flown = scope.spawn(|| fly(&name, &flight));
            let descends = |s: &Value| s["mission"]["state"] == "Descent";
            let first = pid(&status_when(&name, descends), "mission");
            status_when(&name, |s| pid(s, "mission").is_some_and(|new| Some(new) != first));
            let config = directory(&name).join("drone.toml");
            let out = run(format!("command abort --json --config {}", config.display()));
            (flown.join().expect("flown"), out)
        })
    });
    assert!(out.status.success(), "{out:?}\n{}", flown.show());
    assert!(is_safe(&flown), "{}", flown.show());
}

#[test]
fn link_killed_after_the_stop_px4() {
    assert_lands_with("disarm-px4", Firmware::Px4, "autopilot:kill:landed");
}

#[test]
#[ignore = "in lock-step: restarts; live by hand"]
fn link_killed_after_the_stop_arducopter() {
    assert_lands_with("disarm-ap", Firmware::ArduCopter, "autopilot:kill:landed");
}

#[test]
#[ignore = "in lock-step: restarts; live by hand"]
fn live_pilot_killed_after_the_stop() {
    assert_lands_with("disarm-pilot", Firmware::Px4, "pilot:kill:landed");
}

#[test]
#[ignore = "in lock-step: restarts; live by hand"]
fn live_predictor_killed_in_flare() {
    assert_lands_with("predictor", Firmware::ArduCopter, "predictor:kill:flare");
}

#[test]
fn live_cable_silent_at_the_touchdown() {
    let mut flight = with_fault(Firmware::Px4, MODERATE, None, 5);
    flight.cable_out = true;
    let flown = assert_safe("cable", &flight);
    assert!(flown.entered("Landed"), "{}", flown.show());
}

/// Flies all, four at a time; none is unsafe or tilts too far.
fn assert_all_safe(flights: &[(String, Flight)]) {
    let next = AtomicUsize::new(0);
    let wrong = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while let Some((name, flight)) = flights.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let flown = flown_in_time(name, flight);
                    if !is_safe(&flown) || flown.tilt_beyond.to_degrees() > TILT_BEYOND_DEG {
                        wrong.lock().expect("a list").push(line(name, &flown));
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("a list");
    assert!(
        wrong.is_empty(),
        "{} of {}:\n{}",
        wrong.len(),
        flights.len(),
        wrong.join("\n")
    );
}

/// Predictor, mission, pilot and link killed or frozen at each moment, and the cable, over both firmwares.
fn matrix() -> Vec<(Firmware, Option<String>)> {
    let mut all = Vec::new();
    for firmware in BOTH {
        for moment in ["descent", "flare", "contact", "landed"] {
            for process in ["predictor", "mission", "pilot", "autopilot"] {
                for kind in ["kill", "freeze"] {
                    all.push((firmware, Some(format!("{process}:{kind}:{moment}"))));
                }
            }
        }
        all.push((firmware, None));
    }
    all
}

#[test]
#[ignore = "66 live landings, four at a time: takes 17 minutes"]
fn faults_at_every_moment_over_both_firmwares() {
    let flights: Vec<_> = (300_usize..)
        .zip(matrix())
        .map(|(seed, (firmware, fault))| {
            let cable_out = fault.is_none();
            let flight = with_fault(firmware, MODERATE, fault.as_deref(), seed);
            (format!("matrix-{seed}"), Flight { cable_out, ..flight })
        })
        .collect();
    assert_all_safe(&flights);
}

#[test]
#[ignore = "40 live landings on the decks beside the project, four at a time: takes 12 minutes"]
fn decks_beside_the_project_over_both_firmwares() {
    let decks = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/decks");
    let decks = ["mono-5m-js15-6", "twin-5m-cross", "work-12m-js25-7"].map(|d| decks.join(d));
    let faults = [
        None,
        Some("mission:kill:descent"),
        Some("mission:kill:flare"),
        Some("autopilot:kill:landed"),
    ];
    let mut flights = Vec::new();
    for firmware in BOTH {
        for k in 0..20_usize {
            let deck = decks[k % decks.len()].with_extension("csv");
            let fault = faults[k % faults.len()];
            let mut flight = with_fault(firmware, "0,5", fault, 400 + k);
            flight.scenario = format!(
                "[deck_motion]\nfile = {:?}\nstart_s = {}\nwater_follows = true\n",
                deck.display().to_string(),
                15 * k
            );
            flights.push((format!("deck-{}", flights.len()), flight));
        }
    }
    assert_all_safe(&flights);
}
