//! Survival of a vessel with a full recorder, of a supervisor whose process cannot be started, and of the deck's
//! state.

use std::{os::unix::fs::PermissionsExt, path::PathBuf};

use alight_computer::vessel::deck_file;
use alight_lab::live::service::Service;
use alight_shared::{
    config,
    msg::{Closure, DroneStatus, Header, State},
    time::Time,
    wire,
};
use alight_transport::{
    memory::Instance,
    radio::{Radio, RadioConfig, TlsConfig},
};
use alight_usv::{VesselCheckpoint, deck::Claim};
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::Value;

use crate::{
    common::{self, alight, free_udp, instance, printed, run, scratch, service},
    landing::{pid, status_when},
};

/// Vessel's computer without sensors, on the loopback interface.
pub struct Vessel {
    pub directory: PathBuf,
    pub instance: Instance,
    config: PathBuf,
    endpoint: String,
}

impl Vessel {
    pub fn prepare(name: &str) -> Vessel {
        let directory = scratch(name);
        let _none = std::fs::remove_dir_all(&directory);
        std::fs::create_dir_all(&directory).expect("made");
        let config = directory.join("vessel.toml");
        let endpoint = format!("udp/{}", free_udp());
        // The shared memory has a separate directory.
        let instance = instance(&format!("v-{name}"));
        let text = format!("vessel_id = 1\ninstance = \"{instance}\"\n[radio]\nlisten = [\"{endpoint}\"]\n");
        std::fs::write(&config, text).expect("written");
        let computer = config::load(&config).expect("read");
        deck_file::write_first(&directory, &computer).expect("written");
        Vessel {
            directory,
            instance: Instance::new(&instance).expect("a name"),
            config,
            endpoint,
        }
    }
    /// Appends tables to its configuration.
    pub fn configure(&self, tables: &str) {
        let text = std::fs::read_to_string(&self.config).expect("read");
        std::fs::write(&self.config, text + tables).expect("written");
    }
    pub fn start(&self) -> Service {
        service("vessel", &self.directory, &[])
    }
    fn command_deck(&self, order: &str) {
        let config = self.config.display().to_string();
        let out = alight(format!("order deck {order} --json --config {config}"))
            .env("STATE_DIRECTORY", &self.directory)
            .output()
            .expect("runs");
        assert!(out.status.success(), "{out:?}");
    }
    fn deck_file(&self) -> PathBuf {
        let files = std::fs::read_dir(&self.directory).expect("read").flatten();
        let mut paths = files.map(|f| f.path());
        let deck = |p: &PathBuf| p.extension().is_some_and(|e| e == "deck");
        paths.find(deck).expect("the deck's state")
    }
    /// Content of the deck's state; None if it cannot be read.
    fn kept(&self) -> Option<VesselCheckpoint> {
        deck_file::load(&self.deck_file(), 1).ok().flatten()
    }
    /// Radio of a drone with this number, without a bridge.
    fn drone(&self, number: u32) -> Radio {
        let dial = RadioConfig::dialling(&self.endpoint, TlsConfig::default());
        let key = format!("alight/drone-{number}/status");
        Radio::open(&dial, common::publication(&key), Vec::<String>::new()).expect("opens")
    }
    fn status(&self) -> Value {
        let out = run(format!("status --json --config {}", self.config.display()));
        serde_json::from_str(&printed(&out)).unwrap_or(Value::Null)
    }
    #[track_caller]
    fn status_when(&self, what: &str, wanted: impl FnMut(&Value) -> bool) -> Value {
        common::once(what, || self.status(), wanted)
    }
}

impl Drop for Vessel {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _left = std::fs::remove_dir_all(&self.directory);
            let _left = self.instance.wipe();
            let _left = std::fs::remove_dir_all(self.instance.directory());
        }
    }
}

fn finding<'a>(status: &'a Value, topic: &str) -> Option<&'a Value> {
    status["findings"]
        .as_array()?
        .iter()
        .find(|f| f["topic"] == topic)
}

#[test]
fn flight_with_a_camera_that_cannot_be_started() {
    let name = instance("unstartable");
    let directory = scratch("unstartable-files");
    let _none = std::fs::remove_dir_all(&directory);
    std::fs::create_dir_all(&directory).expect("made");
    let file = |name: &str| directory.join(name);
    // Copy of the program whose execute permission can be removed: without it, not even root can run the program.
    let program = file("alight");
    std::fs::copy(env!("CARGO_BIN_EXE_alight"), &program).expect("copied");
    let permit = |mode| {
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(mode)).expect("permitted");
    };
    let text = format!(
        "instance = {name:?}\n[camera]\nsource = \"/nonexistent/video0\"\n[autopilot]\nconnect = \"udpin://{}\"\n",
        free_udp()
    );
    std::fs::write(file("drone.toml"), text).expect("written");
    let mut running = Service::start("drone", &[&program], &directory, &[]).expect("starts");
    let printed = |what: &str| {
        let text = std::fs::read_to_string(file("drone.err")).expect("read");
        text.matches(what).count()
    };
    let both = |s: &Value| ["pilot", "autopilot"].map(|p| pid(s, p));
    let ended = "camera ended";
    let before = status_when(&name, |s| {
        both(s).iter().all(Option::is_some) && printed(ended) >= 2
    });
    permit(0o644);
    status_when(&name, |_| printed("camera could not start, retrying") >= 2);
    let tried = printed(ended);
    permit(0o755);
    let after = status_when(&name, |_| printed(ended) > tried);
    assert_eq!(both(&after), both(&before));
    assert!(running.stop(), "it was killed");
    std::fs::remove_dir_all(&directory).expect("removed");
}

#[test]
fn vessel_with_a_deck_switch_and_a_full_recorder() {
    let vessel = Vessel::prepare("inputs");
    let [switch, log] = ["value", "log"].map(|name| vessel.directory.join(name));
    vessel.configure(&format!("[deck]\ncrew_switch = {switch:?}\n"));
    std::fs::write(&switch, "1\n").expect("written");
    let flight = log.display().to_string();
    let mut running = service("vessel", &vessel.directory, &["--flight", &flight]);
    let wait_for = |closed: Value| vessel.status_when("closed", |s| s["vessel"]["deck"]["closed"] == closed);
    wait_for("switch".into());
    std::fs::write(&switch, "0\n").expect("written");
    wait_for(Value::Null);
    std::fs::remove_file(&switch).expect("removed");
    let status = wait_for("switch".into());
    let errors = &status["vessel"]["deck"]["input_errors"];
    let named = format!("deck.crew_switch: {}", switch.display());
    assert!(
        errors[0].as_str().is_some_and(|e| e.starts_with(&named)),
        "{errors}"
    );

    let pid = pid(&status, "vessel").and_then(|p| Pid::from_raw(p.try_into().ok()?));
    let limit = Rlimit {
        current: Some(1 << 16),
        maximum: Some(1 << 16),
    };
    prlimit(pid, Resource::Fsize, limit).expect("limited");
    let status = vessel.status_when("the recorder is full", |s| finding(s, "recorder").is_some());
    assert_eq!(finding(&status, "recorder").expect("there")["level"], "warning");
    assert!(running.poll(), "it has ended");
    let log_text = std::fs::read_to_string(vessel.directory.join("vessel.err")).expect("read");
    assert!(
        log_text.contains("continues without its recorder: writing")
            && log_text.contains(&log.display().to_string()),
        "{log_text}"
    );
}

fn stands(kept: &VesselCheckpoint) -> bool {
    kept.deck.claims.iter().any(|c| c.claim == Claim::OnDeck)
}

#[test]
fn occupied_and_closed_deck_of_a_killed_vessel() {
    let vessel = Vessel::prepare("deck");
    let mut process = vessel.start();
    let mut drone = vessel.drone(1);
    let mut sequence = 0;
    // The drone lands, and is switched off.
    vessel.status_when("the drone is received on the deck", |s| {
        sequence += 1;
        let status = DroneStatus {
            header: Header::new(1, 1, 7, sequence, Time::EPOCH),
            state: State::Landed,
            ..DroneStatus::default()
        };
        drone.send(0, wire::encode(&status).expect("small"));
        s["vessel"]["occupied"] == true && vessel.kept().is_some_and(|kept| stands(&kept))
    });
    drop(drone);
    let again = |process: &mut Service| {
        let before = pid(&vessel.status(), "vessel");
        process.kill();
        *process = vessel.start();
        vessel.status_when("another process reports", |s| {
            pid(s, "vessel").is_some_and(|now| Some(now) != before)
        })
    };
    let status = again(&mut process);
    let owner = &status["vessel"]["deck_owner"];
    let occupied = &status["vessel"]["occupied"];
    assert!(owner == 1 && occupied == true, "{status}");

    vessel.command_deck("closed");
    vessel.status_when("it is kept", |_| {
        let kept = vessel.kept();
        kept.is_some_and(|kept| kept.deck.closed == Some(Closure::Crew))
    });
    let status = again(&mut process);
    assert_eq!(status["vessel"]["deck"]["closed"], "crew", "{status}");

    vessel.command_deck("open");
    let open = |s: &Value| s["vessel"]["deck"]["closed"].is_null() && s["vessel"]["deck_owner"].is_null();
    vessel.status_when("the crew finds no drone there", open);
    vessel.status_when("it is kept", |_| vessel.kept().is_some_and(|kept| !stands(&kept)));
    assert!(open(&again(&mut process)));

    std::fs::write(vessel.deck_file(), "half a fi").expect("written");
    let status = again(&mut process);
    assert_eq!(
        status["vessel"]["deck"]["closed"], "checkpoint_damaged",
        "{status}"
    );
}
