//! Faults of the installed services over mutual TLS: radio silence, restarts, an order of an unauthorised peer.
//! `rehearse` flies their landing without a fault.
//!
//! `deploy/packages/test` lands with the installed packages: it sets ALIGHT_VESSEL and ALIGHT_DRONE to their
//! commands, preceded by network namespace and user.

use std::{
    collections::BTreeMap,
    net::UdpSocket,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

use alight_computer::vessel::deck_file;
use alight_lab::live::{
    config::{SimulatedWorld, sources},
    rehearse::files::set,
    service::{Service, runs},
};
use alight_shared::config;
use alight_sim::{harness::scenario::Scenario, sensors::clocks::ClockErrorConfig};
use alight_transport::clock::steady_ns;
use serde_json::Value;
use toml::Table;

use crate::{
    common::{self, free_port, once, signal, tls},
    landing::pid,
};

/// Maximum time from the start of the test to the simulated time zero, ns.
const RUN_UP_NS: i64 = 5_000_000_000;
const SECOND_NS: i64 = 1_000_000_000;
/// Run time of the vessel's estimator before the landing is commanded, s.
const WARM_UP_S: f64 = 15.0;
/// Time for which a landed drone calibrates the deck, s, and the slightly longer time for which it stays there.
const CALIBRATION_S: u32 = 22;
const STAY_S: f64 = 32.0;

/// Program of one side with its prefix: from the environment, or the program under test.
fn arguments(side: &str) -> Vec<String> {
    let mut arguments = ["nice", "-n", "-15"].map(str::to_owned).to_vec();
    match std::env::var(format!("ALIGHT_{}", side.to_uppercase())) {
        Ok(text) if !text.is_empty() => arguments.extend(text.split_whitespace().map(str::to_owned)),
        Ok(_) | Err(_) => arguments.push(env!("CARGO_BIN_EXE_alight").into()),
    }
    arguments
}

fn run(side: &str, what: impl AsRef<str>) -> Output {
    let arguments = arguments(side);
    let mut command = Command::new(&arguments[0]);
    command
        .args(&arguments[1..])
        .args(what.as_ref().split_whitespace());
    command.output().expect("runs")
}

/// Computers of a vessel and a drone, and the vehicles; all end with their test.
struct Installed {
    instance: String,
    directory: PathBuf,
    endpoint: String,
    services: BTreeMap<&'static str, Service>,
}

impl Installed {
    /// Writes certificates and configurations; `change` may change the vessel's and the drone's.
    fn prepare(test: &str, seed: u64, change: impl Fn(&mut Table, &mut Table)) -> Installed {
        let instance = format!("{test}-{}", std::process::id());
        let directory = common::certificates(&instance);
        let shipped = |side: &str| -> Table {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("{side}/{side}.toml"));
            std::fs::read_to_string(path)
                .expect("the shipped file")
                .parse()
                .expect("TOML")
        };
        // A full second, which the clocks of the simulated vehicles represent exactly.
        let epoch_ns = (steady_ns() + RUN_UP_NS) / SECOND_NS * SECOND_NS;
        let host = std::env::var("ALIGHT_VESSEL_HOST").unwrap_or_else(|_| "127.0.0.1".into());
        if host != "127.0.0.1" {
            let again = directory.join("vessel-1");
            std::fs::remove_dir_all(&again).expect("removed");
            common::keys(&directory, &format!("vessel 1 --address {host}"));
        }
        common::keys(&directory, "operator 1");
        let other = directory.join("other");
        common::keys(&other, "init --days 2");
        common::keys(&other, "operator 1");
        let endpoint = format!("quic/{host}:{}", free_port());
        let radio = |computer: &mut Table, side: &str, peers: &[&str], end: &str| {
            let tls = tls(&directory.join(side), peers);
            set(computer, &["radio"], end, vec![endpoint.clone()]);
            set(computer, &["radio"], "tls", Table::try_from(tls).expect("TOML"));
        };
        let mut vessel = shipped("vessel");
        let mut drone = shipped("drone");
        radio(&mut vessel, "vessel-1", &["drone-1", "operator-1"], "listen");
        radio(&mut drone, "drone-1", &["vessel-1"], "connect");
        set(&mut vessel, &[], "instance", format!("v{instance}"));
        let sensors = sources(&Scenario::default(), |_| {
            format!("udpin://{host}:{}", free_port())
        });
        let listed = toml::Value::try_from(&sensors).expect("TOML");
        set(&mut vessel, &["sensor"], "sources", listed);
        set(&mut drone, &[], "instance", instance.clone());
        // With the shipped file the mission first waits for a pilot, but the simulated vehicles have none.
        set(&mut drone, &["drone", "mission"], "mode", "land");
        // Destination of the simulated autopilot's MAVLink.
        let host = std::env::var("ALIGHT_DRONE_HOST").unwrap_or_else(|_| "127.0.0.1".into());
        let mavlink = format!("{host}:{}", free_port());
        set(
            &mut drone,
            &["autopilot"],
            "connect",
            format!("udpin://{mavlink}"),
        );
        for (side, computer) in [("vessel", &mut vessel), ("drone", &mut drone)] {
            let flights = directory.join("flights").join(side).display().to_string();
            set(computer, &["recorder"], "directory", flights);
        }
        change(&mut vessel, &mut drone);

        let mut world = SimulatedWorld {
            instance: instance.clone(),
            mavlink,
            sensors,
            epoch_ns,
            seed,
            sea: "moderate".into(),
            planner: "alight".into(),
            ..SimulatedWorld::default()
        };
        world.scenario.start.warm_up_s = WARM_UP_S;
        // The computers' clocks are this computer's, as on real vehicles.
        world.scenario.sensors.clocks = ClockErrorConfig {
            epoch_s: epoch_ns as f64 * 1e-9,
            offset_s: 0.0,
            drift_ppm: 0.0,
        };
        let world = Table::try_from(world).expect("TOML");
        for (name, computer) in [("vessel", &vessel), ("drone", &drone), ("world", &world)] {
            let text = toml::to_string(computer).expect("TOML");
            std::fs::write(directory.join(format!("{name}.toml")), text).expect("written");
        }
        let vessel = config::load(&directory.join("vessel.toml")).expect("read");
        deck_file::write_first(&directory, &vessel).expect("written");
        open_to_all(&directory);
        Installed {
            instance,
            directory,
            endpoint,
            services: BTreeMap::new(),
        }
    }

    fn change(&self, name: &str, change: impl Fn(&mut Table)) {
        let file = self.file(&format!("{name}.toml"));
        let text = std::fs::read_to_string(&file).expect("read");
        let mut computer: Table = text.parse().expect("TOML");
        change(&mut computer);
        std::fs::write(&file, toml::to_string(&computer).expect("TOML")).expect("written");
    }
    fn file(&self, name: &str) -> String {
        self.directory.join(name).display().to_string()
    }

    fn start(&mut self, name: &'static str) {
        let service = Service::start(name, &arguments(name), &self.directory, &[]).expect("starts");
        open_to_all(&service.socket());
        self.services.insert(name, service);
    }
    fn start_ready(&mut self, name: &'static str) {
        self.start(name);
        let ready = self.services.get_mut(name).expect("it runs").await_ready();
        ready.unwrap_or_else(|e| panic!("{e}\n{}", self.complaints()));
    }
    fn stop(&mut self, name: &str) {
        let mut service = self.services.remove(name).expect("it runs");
        assert!(service.stop(), "killed: {}", self.complaints());
    }
    /// Kills the drone's supervisor and restarts it as its service manager does: after RestartSec, once all of its
    /// processes have ended.
    fn crash_supervisor(&mut self) {
        let processes = self.status()["processes"].as_array().cloned().unwrap_or_default();
        let of_drone = processes
            .iter()
            .filter(|p| p["kind"] != "World" && p["kind"] != "Vessel");
        let pids = of_drone.filter_map(|p| u32::try_from(p["pid"].as_u64()?).ok());
        let pids: Vec<u32> = pids.collect();
        assert!(pids.len() >= 5, "{processes:?}");
        let mut service = self.services.remove("drone").expect("it runs");
        let began_ns = steady_ns();
        signal(service.id().expect("it runs").into(), "-KILL");
        while service.poll() || pids.iter().any(|p| runs(*p)) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let gone_ns = steady_ns();
        std::thread::sleep(Duration::from_millis(100));
        self.start_ready("drone");
        let [gone_s, ready_s] = [gone_ns, steady_ns()].map(|t| (t - began_ns) as f64 * 1e-9);
        println!("gone after {gone_s:.3} s, ready after {ready_s:.3} s");
    }
    fn complaints(&self) -> String {
        ["vessel", "drone", "world"]
            .map(|name| std::fs::read_to_string(self.file(&format!("{name}.err"))).unwrap_or_default())
            .concat()
    }
    fn order(&self, order: &str) -> Output {
        let config = self.file("drone.toml");
        run("drone", format!("command {order} --json --config {config}"))
    }
    fn ashore(&self, order: &str, keys: &str) -> String {
        let endpoint = &self.endpoint;
        let keys = self.file(keys);
        format!("command {order} --json --vessel {endpoint} --keys {keys}")
    }
    fn status(&self) -> Value {
        let out = run("drone", format!("status --json --instance {}", self.instance));
        serde_json::from_slice(&out.stdout).unwrap_or(Value::Null)
    }
    fn vessel_status(&self) -> Value {
        let config = self.file("vessel.toml");
        let out = run("vessel", format!("status --json --config {config}"));
        serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {out:?}"))
    }
    fn status_when(&self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let look = || self.status();
        once(what, look, wanted)
    }
    /// Starts everything, and commands a landing once the estimator has warmed up and the vessel is received.
    fn begin_landing(&mut self) {
        self.start_ready("vessel");
        self.start_ready("drone");
        self.start("world");
        self.status_when("the vessel is received and the drone flies", |s| {
            let t = self.time_s(s);
            t.is_some_and(|t| t > 0.0) && fresh(s)
        });
        self.assert_accepted(&self.order("land"));
    }
    fn assert_accepted(&self, out: &Output) {
        assert!(out.status.success(), "{out:?}\n{}", self.complaints());
    }
    /// Asserts that neither an unauthorised peer nor the drone itself can send a command through the vessel, and
    /// that the status shows the attempt.
    fn assert_others_rejected(&self) {
        std::thread::scope(|scope| {
            for keys in ["other/operator-1", "drone-1"] {
                let order = self.ashore("abort", keys);
                scope.spawn(move || {
                    let out = run("drone", order);
                    assert!(!out.status.success(), "{keys}: {out:?}");
                });
            }
        });
        assert_ne!(self.state(), "GaveUp");
        let status = self.status_when("the unauthorised peer is noticed", |s| {
            s["metrics"]["vessel"]["unauthorised_peers_rejected"]
                .as_f64()
                .is_some_and(|n| n > 0.0)
        });
        assert!(
            status["metrics"]["vessel"]["last_peer_rejected_for"].is_string(),
            "{status}"
        );
        let vessel = self.vessel_status();
        let rejected = vessel["rejected"].as_array().expect("a list");
        assert!(!rejected.is_empty() && vessel["worst"] == "warning", "{vessel}");
    }
    /// Simulated time since the start, s.
    fn time_s(&self, status: &Value) -> Option<f64> {
        status["metrics"]["world"]["time_since_start_s"].as_f64()
    }
    fn state(&self) -> String {
        let status = self.status();
        status["mission"]["state"].as_str().unwrap_or_default().to_owned()
    }
    fn assert_success(&self) {
        let outcome = self.outcome();
        println!("{outcome}");
        assert_eq!(outcome["outcome"], "success", "{}", self.complaints());
    }
    fn outcome(&self) -> Value {
        let lines = self.services["world"].lines();
        let mut reports = lines.filter_map(|line| serde_json::from_str::<Value>(&line).ok());
        let report = reports.next();
        let report = report.unwrap_or_else(|| panic!("no outcome: {}", self.complaints()));
        report["landed"]["outcome"].clone()
    }
}

impl Drop for Installed {
    fn drop(&mut self) {
        for service in self.services.values_mut() {
            service.ask_to_end();
        }
        self.services.clear();
        if !std::thread::panicking() {
            let _left = std::fs::remove_dir_all(&self.directory);
        }
    }
}

fn fresh(status: &Value) -> bool {
    status["link"]["age_s"].as_f64().is_some_and(|age| age < 1.0)
}

fn open_to_all(directory: &Path) {
    let mut waiting = vec![directory.to_path_buf()];
    while let Some(path) = waiting.pop() {
        let is_directory = path.is_dir();
        let mode = if is_directory { 0o777 } else { 0o666 };
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).expect("permitted");
        if is_directory {
            waiting.extend(
                std::fs::read_dir(&path)
                    .expect("read")
                    .flatten()
                    .map(|e| e.path()),
            );
        }
    }
}

// `rehearsal_of_the_shipped_files` does this for the program under test, with sensor bytes and camera images.
#[test]
#[ignore = "needs the installed packages, which deploy/packages/test makes"]
fn landing_of_the_shipped_configurations() {
    let mut all = Installed::prepare("installed", 103, |_, _| {});
    all.begin_landing();
    all.status_when("lands", |s| s["mission"]["state"] == "Descent");
    let vessel = all.vessel_status();
    let status = &vessel["vessel"];
    assert_eq!(status["drones"][0]["status"]["header"]["drone"], 1, "{vessel}");
    assert_eq!(vessel["certificate"]["name"], "vessel-1", "{vessel}");
    assert!(
        status["estimator"]["estimate_age_s"].as_f64() < Some(2.0),
        "{vessel}"
    );
    all.assert_success();
}

struct RadioPath {
    silent: Arc<AtomicBool>,
    end: Arc<AtomicBool>,
    ways: Vec<JoinHandle<()>>,
}

impl RadioPath {
    /// Opens the path between the drone's port `from` and the vessel's endpoint.
    fn open(from: u16, endpoint: &str) -> RadioPath {
        let drone = UdpSocket::bind(("127.0.0.1", from)).expect("a socket");
        let vessel = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        vessel
            .connect(endpoint.trim_start_matches("quic/"))
            .expect("an address");
        let silent = Arc::<AtomicBool>::default();
        let end = Arc::<AtomicBool>::default();
        let who = Arc::new(Mutex::new(None));
        let ways = [true, false].map(|there| {
            let [drone, vessel] = [&drone, &vessel].map(|s| s.try_clone().expect("a socket"));
            let silent = Arc::clone(&silent);
            let end = Arc::clone(&end);
            let who = Arc::clone(&who);
            std::thread::spawn(move || {
                let socket = if there { &drone } else { &vessel };
                socket
                    .set_read_timeout(Some(Duration::from_millis(50)))
                    .expect("set");
                let mut buffer = vec![0; 1 << 16];
                while !end.load(Ordering::Relaxed) {
                    // A restarting vessel accepts nothing meanwhile.
                    let Ok((n, sender)) = socket.recv_from(&mut buffer) else {
                        continue;
                    };
                    if there {
                        *who.lock().expect("an address") = Some(sender);
                    }
                    let to = *who.lock().expect("an address");
                    let _lost = match to {
                        _ if silent.load(Ordering::Relaxed) => continue,
                        _ if there => vessel.send(&buffer[..n]),
                        Some(to) => drone.send_to(&buffer[..n], to),
                        None => continue,
                    };
                }
            })
        });
        RadioPath {
            silent,
            end,
            ways: ways.into(),
        }
    }
    fn silence(&self, silent: bool) {
        self.silent.store(silent, Ordering::Relaxed);
    }
}

impl Drop for RadioPath {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        for way in self.ways.drain(..) {
            let _ended = way.join();
        }
    }
}

#[test]
fn abort_in_radio_silence_with_a_vessel_restart() {
    let port = free_port();
    let mut all = Installed::prepare("silence", 108, |_, drone| {
        steady(drone, 100.0);
        let connect = vec![format!("quic/127.0.0.1:{port}")];
        set(drone, &["radio"], "connect", connect);
    });
    let radio_path = RadioPath::open(port, &all.endpoint);
    all.begin_landing();
    all.status_when("follows", |s| s["mission"]["state"] == "Tracking");
    let config = all.file("drone.toml");
    let out = run("drone", format!("calibrate deck --config {config}"));
    let errors = String::from_utf8_lossy(&out.stderr);
    assert!(errors.contains("the drone is armed"), "{errors}");
    all.assert_others_rejected();
    radio_path.silence(true);
    // Each command waits 12 s in vain for a reply.
    let [land, abort] = ["land", "abort"].map(|order| all.ashore(order, "operator-1"));
    let landing = std::thread::spawn(|| run("drone", land));
    std::thread::sleep(Duration::from_secs(2));
    run("drone", abort);
    landing.join().expect("runs");
    let age_s = |s: &Value| s["link"]["age_s"].as_f64();
    all.status_when("10 s of silence", |s| age_s(s).is_some_and(|age| age > 10.0));
    assert_ne!(all.state(), "GaveUp");
    let vessel = pid(&all.vessel_status(), "vessel");
    signal(vessel.expect("it runs"), "-KILL");
    all.stop("vessel");
    all.start_ready("vessel");
    radio_path.silence(false);
    all.status_when("the abort acts", |s| s["mission"]["state"] == "GaveUp");
    all.status_when("the vessel has the answer", |_| {
        let aborts = &all.vessel_status()["vessel"]["deck"]["aborts"];
        aborts.as_array().is_some_and(Vec::is_empty)
    });
    assert_eq!(all.state(), "GaveUp");
}

/// Lets a drone follow the vessel for this time before it descends.
fn steady(drone: &mut Table, steady_s: f64) {
    set(drone, &["drone", "mission"], "steady_s", steady_s);
}

#[test]
fn restarted_computer_killed_supervisor_calibration() {
    let mut all = Installed::prepare("crash", 109, |_, drone| steady(drone, 6.0));
    all.change("world", |world| set(world, &["scenario"], "stay_s", STAY_S));
    all.begin_landing();
    all.status_when("follows", |s| s["mission"]["state"] == "Tracking");
    let before = all.status();
    all.stop("drone");
    all.start_ready("drone");
    // All of its processes have restarted, and the autopilot has kept the drone in the air meanwhile.
    let after = all.status_when("flies on and receives the vessel", |s| {
        let t = all.time_s(s);
        t.is_some_and(|t| t > all.time_s(&before).unwrap_or(0.0)) && fresh(s)
    });
    assert_eq!(
        after["mission"]["state"], "Idle",
        "it waits for an order: {after}"
    );
    let check = run(
        "drone",
        format!("check --json --config {}", all.file("drone.toml")),
    );
    let check = String::from_utf8_lossy(&check.stdout).into_owned();
    assert!(check.contains(&format!("{} answers", all.endpoint)), "{check}");
    all.assert_accepted(&all.order("land"));

    all.status_when("descends", |s| s["mission"]["state"] == "Descent");
    all.crash_supervisor();
    println!("{}", all.complaints());
    all.status_when("has landed", |s| s["mission"]["state"] == "Landed");
    std::thread::sleep(Duration::from_secs(4));
    let config = all.file("drone.toml");
    let arguments = format!("calibrate deck --json --for {CALIBRATION_S} --config {config}");
    let out = run("drone", arguments);
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let found: Value = serde_json::from_str(text.lines().last().unwrap_or_default())
        .unwrap_or_else(|e| panic!("{e}: {out:?}\n{}", all.complaints()));
    for (axis, truth) in found["centre_m"]
        .as_array()
        .expect("a list")
        .iter()
        .zip([0.0, 0.0, -1.3])
    {
        let [value, sd] = ["value", "sd"].map(|k| axis[k].as_f64().expect("a number"));
        assert!((value - truth).abs() < 3.0 * sd + 0.15, "{found}");
    }
    all.assert_success();
}
