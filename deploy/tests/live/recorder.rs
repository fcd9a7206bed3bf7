//! Flight recorder of a real process that is killed. Only the rounds that are run by hand assert a time: `cargo test
//! --release --workspace --test live -- --ignored --nocapture hundred_kills`.

use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use alight_computer::vessel::deck_file;
use alight_lab::live::service::Service;
use alight_shared::{
    config,
    msg::{Header, SensorReadings},
    wire,
};
use alight_transport::memory::{Instance, Memory};
use alight_usv::{ComputerIn, sensors::Readings};
use serde_json::Value;

use crate::common::{errors, free_udp, instance, printed, run, scratch, service};

/// Recorded step of the vessel: time, input, omitted parts of it, hash of the output.
type Step = (i64, ComputerIn, [u8; 3], u64);

/// Vessel's computer that records, and its sensors' measurements in a simulated flight.
struct Vessel {
    directory: PathBuf,
    instance: String,
    readings: Vec<Readings>,
}

impl Drop for Vessel {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _left = fs::remove_dir_all(&self.directory);
            let instance = Instance::new(&self.instance).expect("a name");
            let _left = instance.wipe();
            let _left = fs::remove_dir_all(instance.directory());
        }
    }
}

impl Vessel {
    fn prepare(name: &str) -> Vessel {
        let directory = scratch(name);
        let _none = fs::remove_dir_all(&directory);
        fs::create_dir_all(&directory).expect("made");
        // The shared memory has a separate directory.
        let instance = instance(&format!("v-{name}"));
        let config = directory.join("vessel.toml");
        let flights = directory.join("flights");
        let text = format!(
            "instance = \"{instance}\"\n[radio]\nlisten = [\"udp/{}\"]\n[recorder]\ndirectory = \"{}\"\n",
            free_udp(),
            flights.display()
        );
        fs::write(&config, text).expect("written");
        let computer = config::load(&config).expect("read");
        deck_file::write_first(&directory, &computer).expect("written");
        let readings = readings(&directory);
        Vessel {
            directory,
            instance,
            readings,
        }
    }
    fn start(&self) -> Service {
        service("vessel", &self.directory, &[])
    }
    fn memory(&self) -> Option<Memory> {
        let instance = Instance::new(&self.instance).expect("a name");
        let owner = fs::read_to_string(instance.directory().join("ready")).ok()?;
        let lives = Path::new("/proc").join(owner).exists();
        lives.then(|| Memory::join(&instance, "test").expect("joined"))
    }
    /// Sends the recorded readings at their own rate for `ms`.
    fn feed(&self, ms: u64) {
        // The service has no receiver before it runs.
        let memory = self.memory();
        let mut sensors = memory
            .as_ref()
            .map(|m| m.publisher::<SensorReadings>().expect("opened"));
        for readings in self.readings.iter().cycle().take((ms / 10) as usize) {
            for message in readings.messages(&mut Header::default()) {
                if let Some(s) = &mut sensors {
                    s.send(&message);
                }
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    /// Feeds until there are `flights` flights and the newest has a file with steps.
    fn feed_until_synchronised(&self, flights: usize) {
        let mut beginning = None;
        for _ in 0..1_000 {
            self.feed(50);
            let found = below(&self.directory.join("flights"));
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
    fn flights(&self, more: &str) -> Vec<Value> {
        let flights = self.directory.join("flights");
        let out = run(format!("flights {} --json {more}", flights.display()));
        assert!(out.status.success(), "{}", errors(&out));
        let text = printed(&out);
        let object: Value = serde_json::from_str(text.lines().last().expect("a line")).expect("JSON");
        object["flights"].as_array().expect("a list").clone()
    }
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

fn readings(directory: &Path) -> Vec<Readings> {
    let recording = directory.join("trial.mcap");
    let scenario = directory.join("trial.toml");
    fs::write(&scenario, "[start]\nwarm_up_s = 5.0\nhover_s = 1.0\n").expect("written");
    let out = run(format!(
        "trial --json --scenario {} --record {}",
        scenario.display(),
        recording.display()
    ));
    assert!(out.status.code().is_some_and(|c| c < 2), "{}", errors(&out));
    let file = fs::read(&recording).expect("read");
    fs::remove_file(&recording).expect("removed");
    let messages = mcap::MessageStream::new(&file).expect("a recording");
    let vessel = messages.map(|m| m.expect("whole"));
    vessel
        .filter(|m| m.channel.topic == "/node/vessel")
        .map(|m| {
            let (_, input, _, _): Step = wire::decode_record(&m.data).expect("a step");
            Readings::of(&input.sensors)
        })
        .collect()
}

fn utc_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970");
    u64::try_from(since.as_nanos()).expect("before 2500")
}

/// Time of the newest step in a flight, time of day, ns, without the incomplete ends of its files.
fn newest_ns(flight: &Path) -> u64 {
    let files = fs::read_dir(flight).expect("read").flatten().map(|f| f.path());
    let parts = files.filter(|f| is_of_the_estimator(f));
    let newest = |path: PathBuf| {
        let file = fs::read(path).expect("read");
        // Repaired files have an end.
        let messages = mcap::MessageStream::new(&file).expect("a part");
        messages.map(|m| m.expect("whole").log_time).max()
    };
    parts.filter_map(newest).max().expect("steps")
}

/// Kills the recording vessel's process `rounds` times; returns the time missing at the end of each flight, s.
fn kill(vessel: &Vessel, rounds: u64) -> Vec<f64> {
    let mut missing_s = Vec::new();
    for round in 0..rounds {
        let mut process = vessel.start();
        vessel.feed_until_synchronised(round as usize + 1);
        vessel.feed(137 * round % 1_900);
        let killed_ns = utc_ns();
        process.kill();
        let listed = vessel.flights("");
        let flight = listed.last().expect("a flight");
        assert_eq!(
            (listed.len() as u64, &flight["files"]),
            (round + 1, &"cut off".into()),
            "{flight}"
        );
        let path = PathBuf::from(flight["path"].as_str().expect("a path"));
        // Replays the flight first as the kill left it, then repaired.
        for _ in 0..2 {
            let out = run(format!("replay {}", path.display()));
            assert!(
                out.status.success(),
                "round {round}: {}{}",
                printed(&out),
                errors(&out)
            );
            vessel.flights("--mend");
        }
        let repaired = &vessel.flights("")[round as usize];
        assert_eq!(
            (&repaired["cut"], &repaired["length_s"]),
            (&0.into(), &flight["length_s"])
        );
        missing_s.push(killed_ns.saturating_sub(newest_ns(&path)) as f64 * 1e-9);
    }
    missing_s
}

#[test]
#[ignore = "takes four minutes, and measures a time"]
fn hundred_kills_of_a_recording_process() {
    let mut missing_s = kill(&Vessel::prepare("kills"), 100);
    missing_s.sort_by(f64::total_cmp);
    let at = |q: usize| missing_s[(missing_s.len() - 1) * q / 100];
    println!(
        "{} kills: missing {:.2} s in the median, {:.2} s at most",
        missing_s.len(),
        at(50),
        at(100)
    );
    assert!(at(100) <= 2.0);
}

#[test]
fn killed_recording() {
    const KILLS: usize = 3;
    let vessel = Vessel::prepare("killed");
    assert_eq!(kill(&vessel, KILLS as u64).len(), KILLS);
    let mut process = vessel.start();
    vessel.feed_until_synchronised(KILLS + 1);
    let running = &vessel.flights("--mend")[KILLS];
    assert_eq!(
        (&running["files"], &running["computer"]),
        (&"running".into(), &"vessel-1".into())
    );
    assert_eq!(running["cut"], running["parts"], "it is not repaired: {running}");
    assert!(process.stop(), "it was killed");
    let ended = &vessel.flights("")[KILLS];
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
    let all = vessel.directory.join("flights");
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
