//! Flight recorder of a real process that is killed.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use alight_shared::msg::{Header, ImuSample, SensorReadings};
use alight_transport::memory::Memory;
use alight_usv::sensors::Readings;
use serde_json::Value;

use crate::{
    common::{errors, printed, run},
    survival::Vessel,
};

/// Memory of the vessel's process, if it runs.
fn memory(vessel: &Vessel) -> Option<Memory> {
    let owner = fs::read_to_string(vessel.instance.directory().join("ready")).ok()?;
    let lives = Path::new("/proc").join(owner).exists();
    lives.then(|| Memory::join(&vessel.instance, "test").expect("joined"))
}
/// Sends measurements of a vessel at rest at 100 Hz for `ms`.
fn feed(vessel: &Vessel, ms: u64) {
    // The service has no receiver before it runs.
    let memory = memory(vessel);
    let mut sensors = memory
        .as_ref()
        .map(|m| m.publisher::<SensorReadings>().expect("opened"));
    let rests = Readings {
        imu: vec![ImuSample {
            accelerometer: [0.0, 0.0, -9.81],
            ..ImuSample::default()
        }],
        ..Readings::default()
    };
    for _ in 0..ms / 10 {
        for message in rests.messages(&mut Header::default()) {
            if let Some(s) = &mut sensors {
                s.send(&message);
            }
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}
/// Feeds until there are `flights` flights and the newest has a file with steps.
fn feed_until_synchronised(vessel: &Vessel, flights: usize) {
    let mut beginning = None;
    for _ in 0..1_000 {
        feed(vessel, 50);
        let found = below(&vessel.directory.join("flights"));
        let parts = found.iter().max().map_or_else(Vec::new, |flight| below(flight));
        let part = parts.iter().find(|p| is_of_the_estimator(p));
        let Some(part) = part.filter(|_| found.len() == flights) else {
            continue;
        };
        let bytes = fs::metadata(part).map_or(0, |m| m.len());
        // The configuration precedes the first steps.
        if bytes > 0 && bytes > *beginning.get_or_insert(bytes) {
            return;
        }
    }
    panic!("nothing is recorded");
}
fn flights(vessel: &Vessel, more: &str) -> Vec<Value> {
    let flights = vessel.directory.join("flights");
    let out = run(format!("flights {} --json {more}", flights.display()));
    assert!(out.status.success(), "{}", errors(&out));
    let text = printed(&out);
    let object: Value = serde_json::from_str(text.lines().last().expect("a line")).expect("JSON");
    object["flights"].as_array().expect("a list").clone()
}

/// Whether the vessel's process recorded this file; its supervisor records separate files.
fn is_of_the_estimator(file: &Path) -> bool {
    let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    name.starts_with("vessel-") && name.ends_with(".mcap")
}

fn below(directory: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries.map(|e| e.path()).collect()
}

#[test]
fn killed_recording() {
    const KILLS: usize = 3;
    let vessel = Vessel::prepare("killed");
    let all = vessel.directory.join("flights");
    vessel.configure(&format!("[recorder]\ndirectory = {all:?}\n"));
    for round in 0..KILLS {
        let mut process = vessel.start();
        feed_until_synchronised(&vessel, round + 1);
        feed(&vessel, 137 * round as u64);
        process.kill();
        let listed = flights(&vessel, "");
        let flight = listed.last().expect("a flight");
        assert_eq!(
            (listed.len(), &flight["files"]),
            (round + 1, &"cut off".into()),
            "{flight}"
        );
        let path = flight["path"].as_str().expect("a path");
        // Replays the flight first as the kill left it, then repaired.
        for _ in 0..2 {
            let out = run(format!("replay {path}"));
            assert!(
                out.status.success(),
                "round {round}: {}{}",
                printed(&out),
                errors(&out)
            );
            flights(&vessel, "--mend");
        }
        let repaired = &flights(&vessel, "")[round];
        assert_eq!(
            (&repaired["cut"], &repaired["length_s"]),
            (&0.into(), &flight["length_s"])
        );
    }
    let mut process = vessel.start();
    feed_until_synchronised(&vessel, KILLS + 1);
    let running = &flights(&vessel, "--mend")[KILLS];
    assert_eq!(
        (&running["files"], &running["computer"]),
        (&"running".into(), &"vessel-1".into())
    );
    assert_eq!(running["cut"], running["parts"], "it is not repaired: {running}");
    assert!(process.stop(), "it was killed");
    let ended = &flights(&vessel, "")[KILLS];
    assert_eq!(
        (&ended["files"], &ended["cut"]),
        (&"complete".into(), &0.into()),
        "{ended}"
    );
    assert_eq!(ended["outcome"], "not commanded");
    assert!(ended["length_s"].as_f64() > Some(1.0), "{ended}");
    let path = ended["path"].as_str().expect("a path");
    let out = run(format!("replay {path} --json"));
    assert!(out.status.success(), "{}", errors(&out));
    // The directory of all flights is not itself a flight.
    let out = run(format!("replay {}", all.display()));
    assert_eq!(out.status.code(), Some(2));
    assert!(
        errors(&out).contains("holds flights but is not one"),
        "{}",
        errors(&out)
    );
    let out = run(format!("calibrate vessel {path} --json"));
    assert!(out.status.code().is_some_and(|c| c < 2), "{}", errors(&out));
}
