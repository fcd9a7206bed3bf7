//! Live processes, each test with a separate instance on the loopback interface.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Child, Output},
    time::Duration,
};

use serde_json::Value;

use crate::{
    common::{assert_exit, errors, free_port, instance, once, printed, run, scratch, signal, started},
    ground::{self, GroundStation},
    hostile::Attack,
    view,
};

const PROCESSES: [&str; 8] = [
    "world",
    "sensors",
    "vessel",
    "bridge",
    "predictor",
    "mission",
    "planner",
    "pilot",
];

pub fn directory(instance: &str) -> PathBuf {
    std::env::temp_dir().join(format!("alight-{instance}"))
}

/// Landing that ends with its test in any case.
pub struct Land(Option<Child>);

impl Land {
    pub fn id(&self) -> u64 {
        u64::from(self.0.as_ref().expect("it runs").id())
    }
    pub fn output(mut self) -> Output {
        self.0.take().expect("it runs").wait_with_output().expect("ends")
    }
    fn kill(&mut self) {
        let mut child = self.0.take().expect("it runs");
        child.kill().expect("killed");
        child.wait().expect("waited for");
    }
}

impl Drop for Land {
    fn drop(&mut self) {
        if let Some(mut child) = self.0.take() {
            signal(u64::from(child.id()), "-TERM");
            let _status = child.wait();
        }
    }
}

pub fn land(instance: &str, more: &str) -> Land {
    Land(Some(started(format!(
        "land --json --sea calm --instance {instance} {more}"
    ))))
}

pub fn status(instance: &str) -> Value {
    let out = run(format!("status --json --instance {instance}"));
    let status: Value =
        serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {}", errors(&out)));
    assert_exit(&out, &status);
    status
}

#[track_caller]
pub fn status_when(instance: &str, wanted: impl Fn(&Value) -> bool) -> Value {
    once("status", || status(instance), wanted)
}

pub fn pid(status: &Value, process: &str) -> Option<u64> {
    let kind = format!("{}{}", process[..1].to_uppercase(), &process[1..]);
    status["processes"]
        .as_array()?
        .iter()
        .find(|p| p["kind"] == kind)?["pid"]
        .as_u64()
}

fn pids(status: &Value) -> Vec<u64> {
    PROCESSES.iter().filter_map(|p| pid(status, p)).collect()
}

pub fn running(instance: &str) -> Value {
    status_when(instance, |s| pids(s).len() == PROCESSES.len())
}

/// Asserts that a flight or a recording replays bit for bit; returns the output.
fn replay(path: &Path) -> String {
    let out = run(format!("replay --said {}", path.display()));
    let text = printed(&out);
    assert!(
        out.status.success() && text.contains("bit-identical"),
        "{text}{}",
        errors(&out)
    );
    text
}

fn replay_to(flight: &Path, recording: &Path) {
    let out = run(format!(
        "replay {} --record {}",
        flight.display(),
        recording.display()
    ));
    assert!(out.status.success(), "{}", errors(&out));
}

/// Asserts that the instance has left no process, no file in shared memory and no directory.
fn assert_gone(instance: &str, pids: &[u64]) {
    for pid in pids {
        let state = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        assert!(
            state.is_empty() || state.contains(") Z"),
            "process {pid} still runs: {state}"
        );
    }
    let prefix = format!("alight_{instance}_");
    for place in ["/dev/shm", "/tmp"] {
        let left: Vec<_> = fs::read_dir(place)
            .into_iter()
            .flatten()
            .flatten()
            .filter(|e| e.file_name().to_string_lossy().starts_with(&prefix))
            .collect();
        assert!(left.is_empty(), "{left:?}");
    }
    assert!(!directory(instance).exists());
}

pub fn outcome(out: &Output) -> Value {
    let text = printed(out);
    let last = text.lines().last().unwrap_or_default();
    serde_json::from_str(last).unwrap_or_else(|e| panic!("no outcome ({e}): {text}\n{}", errors(out)))
}

fn logs(directory: &Path) -> usize {
    fs::read_dir(directory).expect("a directory").flatten().count()
}

#[test]
fn replay_of_a_landing_among_hostile_packets() {
    let name = instance("lands");
    let log = std::env::temp_dir().join(format!("alight-live-log-{name}"));
    let recording = log.with_extension("mcap");
    let plot = log.with_extension("svg");
    let station = GroundStation::listen();
    let child = land(
        &name,
        &format!(
            "--warm-up 15 --transport udp --scenario {} --log {} --record {} --plot {} --ground-station {}",
            concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/moving-base.toml"),
            log.display(),
            recording.display(),
            plot.display(),
            station.address
        ),
    );
    let attack = Attack::begin(&name);
    let watched = ground::watch(&name);
    Attack::assert_counted(&name);
    let shown = status_when(&name, |s| s["mission"]["state"] == "Approach");
    // The vessel's RTCM frames have reached the drone's receiver.
    let passed_on = &shown["metrics"]["autopilot"]["rtcm_frames_passed_on"];
    assert!(passed_on.as_f64() > Some(0.0), "{shown}");
    ground::assert_status_shown(&name);
    let pids = pids(&shown);
    assert_eq!(pids.len(), PROCESSES.len(), "{shown}");
    assert!(shown["link"]["age_s"].as_f64().is_some(), "{shown}");

    let out = child.output();
    attack.end();
    let outcome = outcome(&out);
    assert_eq!(outcome["outcome"], "success", "{outcome}\n{}", errors(&out));
    assert_eq!(outcome["live"]["restarts"], 0, "{outcome}");
    assert_eq!(out.status.code(), Some(0));
    ground::assert_watched(watched);
    assert_gone(&name, &pids);
    station.assert_landing();

    assert_eq!(
        logs(&log),
        11,
        "sensors, vessel, bridge, predictor, mission, planner, pilot, autopilot, supervisor, the truth; the summary"
    );
    let listed = printed(&run(format!("flights {} --json", log.display())));
    assert!(listed.contains("\"outcome\":\"landed\""), "{listed}");
    let text = replay(&log);
    // The truth is left out, because a real flight does not have it.
    let merged = log.with_extension("flight.mcap");
    replay_to(&log, &merged);
    replay(&merged);
    fs::remove_file(&merged).expect("removed");
    for node in ["supervisor"].iter().chain(&PROCESSES[1..]) {
        assert!(text.contains(node), "{node}: {text}");
    }
    replay(&recording);
    let [of_flight, of_recording] =
        [&log, &recording].map(|path| printed(&run(format!("calibrate drone {} --json", path.display()))));
    assert!(of_flight.contains("\"identified\":true"), "{of_flight}");
    assert_eq!(of_flight, of_recording);
    assert!(fs::read_to_string(&plot).expect("a plot").contains("<svg"));
    fs::remove_dir_all(&log).expect("removed");
    fs::remove_file(&recording).expect("removed");
    fs::remove_file(&plot).expect("removed");
}

/// Ends a process by SIGKILL; returns the status once a new process has replaced it and `wanted` is true.
fn killed(instance: &str, process: &str, old: u64, wanted: impl Fn(&Value) -> bool) -> Value {
    signal(old, "-KILL");
    status_when(instance, |s| {
        pid(s, process).is_some_and(|new| new != old) && wanted(s)
    })
}

/// Asserts that a pilot whose recording directory cannot be written continues, and records once it can.
fn assert_unwritable_recorder(instance: &str, log: &Path) {
    // Root ignores permissions, so a file takes the place of the directory.
    fs::rename(log, log.with_extension("before")).expect("moved");
    fs::write(log, "").expect("written");
    let old = pid(&status(instance), "pilot").expect("it runs");
    let unrecorded = |s: &Value| s["metrics"]["pilot"]["steps_not_recorded"].as_u64() > Some(0);
    let shown = killed(instance, "pilot", old, unrecorded);
    fs::remove_file(log).expect("removed");
    let records = |_: &Value| fs::read_dir(log).is_ok_and(|files| files.count() > 0);
    let later = status_when(instance, records);
    assert_eq!(
        pid(&later, "pilot"),
        pid(&shown, "pilot"),
        "the same process: {shown}"
    );
}

#[test]
fn killed_and_frozen_processes_and_an_interrupt() {
    let name = instance("killed");
    let port = free_port();
    let log = scratch("killed-log");
    let flags = format!("--link clean --view=127.0.0.1:{port} --log {}", log.display());
    let mut first = land(&name, &format!("--warm-up 600 {flags}"));
    let mut shown = running(&name);
    for process in &PROCESSES[1..] {
        let old = pid(&shown, process).expect("it runs");
        shown = killed(&name, process, old, |_| true);
    }
    // The estimate still arrives: the vessel and the bridge have reconnected.
    let fresh = |s: &Value| s["link"]["age_s"].as_f64().is_some_and(|age| age < 2.0);
    let shown = status_when(&name, |s| {
        fresh(s) && s["mission"].is_object() && pid(s, "view").is_some()
    });
    assert_eq!(pids(&shown).len(), PROCESSES.len());

    // The other processes continue without the viewers' server.
    view::assert_shown(port, &name, &shown);
    let after = killed(&name, "view", pid(&shown, "view").expect("it runs"), |_| true);
    assert_eq!(pids(&shown), pids(&after));
    view::assert_shown(port, &name, &after);
    assert_unwritable_recorder(&name, &log);

    // A process that stays frozen is killed and restarted. Without a vessel the drone's computer continues.
    let shown = running(&name);
    let [pilot, vessel] = ["pilot", "vessel"].map(|p| pid(&shown, p).expect("it runs"));
    signal(pilot, "-STOP");
    signal(vessel, "-STOP");
    let another = |s: &Value, name, old| pid(s, name).is_some_and(|new| new != old);
    let shown = status_when(&name, |s| {
        another(s, "pilot", pilot) && another(s, "vessel", vessel) && fresh(s)
    });

    // Without their supervisor the processes end; the next start removes their remains.
    let orphans = pids(&shown);
    assert_eq!(orphans.len(), PROCESSES.len());
    first.kill();
    let ended = |pid: &u64| !Path::new(&format!("/proc/{pid}")).exists();
    for _ in 0..100 {
        if orphans.iter().all(ended) {
            break;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let next = land(&name, "--warm-up 600");
    let shown = status_when(&name, |s| {
        let new = pids(s);
        new.len() == PROCESSES.len() && new.iter().all(|pid| !orphans.contains(pid))
    });
    let twice = run(format!("land --instance {name}"));
    assert_eq!(
        twice.status.code(),
        Some(2),
        "a second one of the same name is rejected"
    );
    signal(next.id(), "-INT");
    let out = next.output();
    assert_eq!(out.status.code(), Some(1));
    assert_gone(&name, &[orphans, pids(&shown)].concat());
    let left = status(&name);
    assert!(left["running"] == false && left["worst"] == "warning", "{left}");
    for directory in [log.with_extension("before"), log] {
        fs::remove_dir_all(directory).expect("removed");
    }
}

#[test]
fn world_that_falls_behind_real_time() {
    let name = instance("slow");
    let child = land(&name, "--warm-up 1 --link clean");
    let shown = running(&name);
    let world = pid(&shown, "world").expect("it runs");
    signal(world, "-STOP");
    std::thread::sleep(Duration::from_millis(2500));
    signal(world, "-CONT");
    let out = child.output();
    assert_eq!(out.status.code(), Some(3), "{}", errors(&out));
    assert!(
        errors(&out).contains("this computer was too slow"),
        "{}",
        errors(&out)
    );
    let behind_s = outcome(&out)["too-slow"]["behind_s"].as_f64();
    assert!(behind_s.is_some_and(|s| s > 1.0), "{}", printed(&out));
    assert_gone(&name, &pids(&shown));
}

#[test]
#[ignore = "two minutes: CI runs it by name"]
fn fifty_starts_and_stops() {
    // A start is mostly idle, so several run in parallel.
    std::thread::scope(|scope| {
        for lane in 0..3 {
            scope.spawn(move || starts_and_stops(&instance(&format!("fifty-{lane}")), (lane..50).step_by(3)));
        }
    });
}

fn starts_and_stops(name: &str, starts: impl Iterator<Item = u64>) {
    for k in starts {
        let child = land(name, "--warm-up 600");
        // Ends the program at every stage from the first file to full flight. SIGINT does not work here: processes
        // that a shell starts in the background ignore it until their own handler is installed.
        std::thread::sleep(Duration::from_millis(37 * k % 900));
        signal(child.id(), "-TERM");
        let out = child.output();
        let errors = errors(&out);
        // Before the handler is installed a signal ends the program at once, with nothing to clean up.
        assert!(matches!(out.status.code(), Some(1) | None), "start {k}: {errors}");
        if out.status.code().is_some() {
            assert_gone(name, &[]);
        }
    }
    // The next start removes the remains of an early end.
    let last = land(name, "--warm-up 600");
    let shown = running(name);
    let pids = pids(&shown);
    signal(last.id(), "-INT");
    last.output();
    assert_gone(name, &pids);
}
