//! `alight status`: status of an instance, from another terminal.
//!
//! [`page`] is what a person reads at one glance, [`drone`] and [`vessel`] fill it, [`watch`] shows it
//! for as long as somebody looks.

mod drone;
pub mod page;
pub mod vessel;
pub mod watch;

use std::path::PathBuf;
use std::time::Duration;

use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Instance, Memory};
use alight_uav::autopilot::config::DisarmConfig;
use clap::Args;
use page::View;
use serde_json::json;

use crate::exit::{CliError, Exit};
use crate::process::instance::{EDITED_FILE, is_running, said};
use crate::process::observer::Observer;
use crate::process::snapshot::Snapshot;
use crate::process::supervisor::pause;
use crate::terminal;
use crate::tools::check::facts::Computer;
use crate::tools::check::gather;
use crate::tools::{check, vessel_status};

/// What runs.
#[derive(Args, Debug)]
#[command(
    after_help = "Run it as the user that runs Alight: sudo -u alight alight status\n\
Exit codes on a vessel: 0 fine, 1 warnings or nothing runs, 2 broken. On a drone: 0 runs, 1 nothing runs."
)]
pub struct StatusArgs {
    /// Name of the set of processes [default: the configuration's; without one: land]
    #[arg(long)]
    pub instance: Option<String>,
    /// Configuration of the vessel's or the drone's computer (TOML) [default: /etc/alight/vessel.toml or
    /// /etc/alight/drone.toml, whichever is there]
    #[arg(long, value_name = "FILE", conflicts_with = "instance")]
    pub config: Option<PathBuf>,
    /// Show everything: each process, each topic as each process reads it, the radio; on a vessel each source
    #[arg(long, conflicts_with_all = ["watch", "json"])]
    pub all: bool,
    /// Go on showing until stopped (q); without a terminal a line for each change
    #[arg(long)]
    pub watch: bool,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

impl StatusArgs {
    fn view(&self) -> View {
        match (self.json, self.all) {
            (true, _) => View::Json,
            (false, true) => View::All,
            (false, false) => View::Page,
        }
    }
}

/// The name of `alight land`'s processes.
const LAND: &str = "land";
/// Observes for this long before it prints: twice the period of the reports.
const OBSERVATION_TIME: Duration = Duration::from_millis(1200);

/// An instance that starts or stops while it is being joined is asked for again, this often.
const MAX_TRIES: u32 = 5;
/// ... with this pause.
const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Shows once, or until stopped.
pub fn run(args: &StatusArgs) -> Result<Exit, CliError> {
    if let Some(name) = &args.instance {
        return of(args, name, &DisarmConfig::default());
    }
    let path = match &args.config {
        Some(path) => path.clone(),
        // A landing of this computer before what is installed on it.
        None if is_running(&Instance::new(LAND)?) => return of(args, LAND, &DisarmConfig::default()),
        None => match check::shipped() {
            Some(path) => path,
            None => return of(args, LAND, &DisarmConfig::default()),
        },
    };
    match gather::computer(&path)? {
        Computer::Vessel(v) => vessel_status::run(&path, &v, args.view(), args.watch),
        Computer::Drone(d) => of(args, &d.instance, &d.autopilot.disarm),
    }
}

/// Shows the set of processes `name`.
fn of(args: &StatusArgs, name: &str, disarm: &DisarmConfig) -> Result<Exit, CliError> {
    let instance = Instance::new(name)?;
    let mut tries = 0;
    let (memory, mut observer) = loop {
        if !is_running(&instance) {
            if args.json {
                terminal::line(format_args!("{}", json!({ "instance": name, "running": false })));
            } else {
                terminal::line(format_args!(
                    "nothing runs under the name {}; `alight land` starts something",
                    name
                ));
            }
            return Ok(Exit::Failed);
        }
        tries += 1;
        match join(&instance) {
            Ok(joined) => break joined,
            Err(rejected) if tries == MAX_TRIES => return Err(rejected),
            Err(_) => pause(RETRY_PAUSE),
        }
    };
    // The reports of every process are there by then.
    if !memory.wait(OBSERVATION_TIME) {
        return Ok(Exit::Success);
    }
    observer.poll(None);
    observer.snapshot.edited = said(&instance, EDITED_FILE);
    if args.watch && !args.json {
        let mut is_first = true;
        watch::run(|span| {
            if !is_first && (!memory.wait(span) || !is_running(&instance)) {
                return Ok(None);
            }
            is_first = false;
            observer.poll(None);
            observer.snapshot.edited = said(&instance, EDITED_FILE);
            Ok(Some(drone::page(name, &observer.snapshot, disarm, steady_ns())))
        })?;
        return Ok(Exit::Success);
    }
    loop {
        show(args, name, &observer.snapshot, disarm);
        if !args.watch || !memory.wait(OBSERVATION_TIME) || !is_running(&instance) {
            return Ok(Exit::Success);
        }
        observer.poll(None);
        observer.snapshot.edited = said(&instance, EDITED_FILE);
    }
}

fn join(instance: &Instance) -> Result<(Memory, Observer), CliError> {
    let memory = Memory::join(instance, "status")?;
    let observer = Observer::join(&memory)?;
    Ok((memory, observer))
}

fn show(args: &StatusArgs, name: &str, snapshot: &Snapshot, disarm: &DisarmConfig) {
    match args.view() {
        View::Page => terminal::line(drone::page(name, snapshot, disarm, steady_ns()).text()),
        View::All => terminal::line(drone::tables(name, snapshot, disarm, steady_ns())),
        View::Json => terminal::line(object(name, snapshot, disarm)),
    }
}

/// The object of `--json`.
fn object(name: &str, snapshot: &Snapshot, disarm: &DisarmConfig) -> serde_json::Value {
    let metrics: serde_json::Map<String, serde_json::Value> = snapshot
        .processes
        .values()
        .map(|p| {
            let of = p.metrics.iter().map(|m| (m.key(), m.json())).collect();
            (p.kind.name().into(), serde_json::Value::Object(of))
        })
        .collect();
    json!({
        "instance": name,
        "running": true,
        "processes": snapshot.processes.values().collect::<Vec<_>>(),
        "metrics": metrics,
        "mission": snapshot.mission,
        "autopilot": snapshot.autopilot,
        "still_armed_s": snapshot.still_armed_s(disarm),
        "link": snapshot.link,
        "edited": snapshot.edited,
    })
}
