//! `alight rehearse`: both services with the shipped files over mutual TLS, sensors by their bytes on serial lines,
//! the camera by its images, and a vessel's service that is killed while the drone follows.

use std::{
    fs,
    io::{BufRead, BufReader},
};

use alight_uav::autopilot::modes::Firmware;
use serde_json::Value;

use crate::{
    common::{alone, errors, printed, signal, started},
    firmware::{FirmwareFlight, StandIn, assert_disarmed},
};

/// Temporary files and shared memory left behind by a rehearsal with this process id.
fn left(pid: u32) -> Vec<String> {
    let places = [std::env::temp_dir(), "/dev/shm".into()];
    let entries = places.iter().filter_map(|p| fs::read_dir(p).ok()).flatten();
    let names = entries
        .flatten()
        .map(|e| e.file_name().to_string_lossy().into_owned());
    let number = format!("-{pid}");
    names
        .filter(|n| n.contains("rehears") && n.contains(&number))
        .collect()
}

#[test]
fn rehearsal_of_the_shipped_files() {
    alone();
    let name = format!("rehearsed-{}", std::process::id());
    let firmware = StandIn::start(&name, &FirmwareFlight::new(Firmware::ArduCopter, ""));
    let child = started(format!(
        "rehearse --seed 103 --fault vessel-restarted:tracking --warm-up 20 --json --autopilot {} --autopilot-at {} \
         --firmware {}",
        firmware.kind,
        firmware.connect,
        firmware.config.display()
    ));
    let pid = child.id();
    let out = child.wait_with_output().expect("it ends");
    let autopilot = firmware.end();
    println!("{}", errors(&out));
    let report: Value = serde_json::from_str(printed(&out).trim()).expect("an object");
    assert_eq!(
        report["landed"]["outcome"]["outcome"],
        "success",
        "{}",
        errors(&out)
    );
    assert!(out.status.success() && report["ok"] == true, "{}", errors(&out));
    let steps = report["steps"].as_array().expect("a list");
    for what in [
        "certificates",
        "alight check, vessel",
        "alight check, drone",
        "sensor receiver (ubx)",
        "sensor compass (nmea)",
        "sensor imu (mavlink)",
        "vision measurement",
        "alight-vessel, killed",
        "disarmed",
        "vessel's flight recorder",
        "drone's flight recorder",
    ] {
        assert!(steps.iter().any(|s| s["what"] == what), "{what}: {steps:?}");
    }
    let certificate = steps.iter().find(|s| s["what"] == "drone's status on vessel");
    let certificate = certificate.and_then(|s| s["figure"].as_str()).unwrap_or_default();
    assert!(certificate.starts_with("vessel-1 received it"), "{certificate}");
    assert_disarmed(&autopilot);
    assert_eq!(left(pid), [""; 0]);
}

#[test]
fn interrupted_rehearsal() {
    let mut child = started("rehearse --json");
    let pid = child.id();
    let output = BufReader::new(child.stderr.take().expect("its errors"));
    let mut lines = output.lines().map_while(Result::ok);
    assert!(
        lines.any(|l| l.contains("alight-drone")),
        "the drone's service is not ready"
    );
    signal(pid.into(), "-INT");
    assert!(lines.any(|l| l == "stopped"));
    assert_eq!(child.wait().expect("it ends").code(), Some(1));
    assert_eq!(left(pid), [""; 0]);
    let processes = fs::read_dir("/proc").expect("processes").flatten();
    let ours = processes.filter(|p| {
        let arguments = fs::read_to_string(p.path().join("cmdline")).unwrap_or_default();
        arguments.contains(&format!("alight-rehearsal-{pid}"))
    });
    assert_eq!(ours.count(), 0);
}
