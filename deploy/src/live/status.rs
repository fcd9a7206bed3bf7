//! `alight status`: what runs under an instance's name, from another terminal.

use std::io::IsTerminal;
use std::time::Duration;

use alight_shared::msg::{LinkState, MissionState, Plan};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Instance, Memory, Subscriber};
use alight_shared::transport::process::ProcessState;
use serde_json::json;

use super::args::StatusArgs;
use super::check::facts::Computer;
use super::check::{self, gather};
use super::display::{Snapshot, time};
use super::figures;
use super::instance::is_running;
use super::supervisor::pause;
use super::vessel_status;
use crate::{CliError, Exit, terminal};

/// The name of `alight land`'s processes.
const LAND: &str = "land";
/// Looks on for this long before it says something: twice the processes' own period.
const OBSERVATION_TIME: Duration = Duration::from_millis(1200);

/// Reads what the processes say.
pub struct Observer {
    processes: Subscriber<ProcessState>,
    mission: Subscriber<MissionState>,
    link: Subscriber<LinkState>,
    plan: Subscriber<Plan>,
    /// What was seen.
    pub snapshot: Snapshot,
    /// Ages of the vessel's newest state that were seen since somebody took them, s.
    pub ages_s: Vec<f64>,
}

impl Observer {
    /// Looks on.
    pub fn join(memory: &Memory) -> Result<Observer, CliError> {
        Ok(Observer {
            processes: memory.subscriber()?,
            mission: memory.subscriber()?,
            link: memory.subscriber()?,
            plan: memory.subscriber()?,
            snapshot: Snapshot::default(),
            ages_s: Vec::new(),
        })
    }
    /// Takes in what is new; the drone's clock reads `drone_ns`, if it is known.
    pub fn poll(&mut self, drone_ns: Option<i64>) {
        let now = steady_ns();
        for state in self.processes.all(now) {
            self.snapshot.processes.insert(state.kind, state);
        }
        let t = drone_ns.unwrap_or(now);
        self.snapshot.mission = self.mission.newest(t).or(self.snapshot.mission);
        let links = self.link.all(t);
        // Who does not take them does not keep them.
        self.ages_s.truncate(64);
        self.ages_s.extend(links.iter().map(|l| l.age_s));
        self.snapshot.link = links.last().copied().or(self.snapshot.link);
        // Without the drone's clock the mission's newest stamp stands for now.
        let now_ns = drone_ns.or(self.snapshot.mission.map(|m| m.header.at.nanos()));
        if let Some(plan) = self.plan.newest(t) {
            self.snapshot.plan = Some((plan, f64::INFINITY));
        }
        if let (Some((plan, age_s)), Some(now_ns)) = (&mut self.snapshot.plan, now_ns) {
            *age_s = (now_ns - plan.header.at.nanos()).max(0) as f64 * 1e-9;
        }
    }
}

/// An instance that starts or stops while it is being joined is asked for again, this often.
const MAX_TRIES: u32 = 5;
/// ... with this pause.
const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Shows once, or until stopped.
pub fn run(args: &StatusArgs) -> Result<Exit, CliError> {
    if let Some(name) = &args.instance {
        return of(args, name);
    }
    let path = match &args.config {
        Some(path) => path.clone(),
        // A landing of this computer before what is installed on it.
        None if is_running(&Instance::new(LAND)?) => return of(args, LAND),
        None => match check::shipped() {
            Some(path) => path,
            None => return of(args, LAND),
        },
    };
    match gather::computer(&path)? {
        Computer::Vessel(v) => vessel_status::run(&path, &v, args.watch, args.json),
        Computer::Drone(d) => of(args, &d.instance),
    }
}

/// Shows the set of processes `name`.
fn of(args: &StatusArgs, name: &str) -> Result<Exit, CliError> {
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
            Err(refused) if tries == MAX_TRIES => return Err(refused),
            Err(_) => pause(RETRY_PAUSE),
        }
    };
    loop {
        if !memory.wait(OBSERVATION_TIME) {
            return Ok(Exit::Success);
        }
        observer.poll(None);
        show(args, name, &observer.snapshot)?;
        if !args.watch || !is_running(&instance) {
            return Ok(Exit::Success);
        }
    }
}

fn join(instance: &Instance) -> Result<(Memory, Observer), CliError> {
    let memory = Memory::join(instance, "status")?;
    let observer = Observer::join(&memory)?;
    Ok((memory, observer))
}

/// The figures of all processes by their names.
fn named(snapshot: &Snapshot) -> serde_json::Map<String, serde_json::Value> {
    snapshot
        .processes
        .values()
        .map(|p| {
            let of: serde_json::Map<String, serde_json::Value> = figures::named(p)
                .into_iter()
                .map(|(name, value)| (name, json!(value)))
                .collect();
            (p.kind.name().into(), of.into())
        })
        .collect()
}

fn show(args: &StatusArgs, name: &str, snapshot: &Snapshot) -> Result<(), CliError> {
    if args.json {
        let object = json!({
            "instance": name,
            "running": true,
            "processes": snapshot.processes.values().collect::<Vec<_>>(),
            "figures": named(snapshot),
            "mission": snapshot.mission,
            "link": snapshot.link,
        });
        terminal::line(object);
        return Ok(());
    }
    if args.watch && std::io::stdout().is_terminal() {
        print!("\x1b[H\x1b[J");
    }
    terminal::line(format_args!("instance {name}\n"));
    if let Some(m) = &snapshot.mission {
        terminal::line(format_args!(
            "  mission   {} since {:.1} s: {}",
            m.state.name(),
            (m.header.at - m.since).secs(),
            m.entered
        ));
        terminal::line(format_args!("  waiting   {}", m.waiting));
    }
    if let Some(l) = &snapshot.link {
        terminal::line(format_args!(
            "  link      state {} old, {:.1} % lost or, over datagrams, overtaken; {:.1} % seen overtaken, latency {} / {} (p50/p99), {} refused",
            time(l.age_s),
            100.0 * l.loss,
            100.0 * l.out_of_order,
            time(l.latency_p50_s),
            time(l.latency_p99_s),
            l.rejected
        ));
        terminal::line(format_args!(
            "  clocks    drone minus vessel {:.4} s +- {}",
            l.clock_offset_s,
            time(l.clock_offset_sd_s)
        ));
    }
    if let Some((plan, age_s)) = &snapshot.plan {
        terminal::line(format_args!(
            "  plan      {} old, {:?}, {} iterations",
            time(*age_s),
            plan.solve,
            plan.iterations
        ));
    }
    for p in snapshot.processes.values() {
        let text = figures::text(p);
        if !text.is_empty() {
            terminal::line(format_args!("  {:<9} {text}", p.kind.name()));
        }
    }
    terminal::line(format_args!(
        "\n{}\n{}\n{}",
        snapshot.usage(steady_ns()),
        snapshot.topics(),
        snapshot.radio()
    ));
    Ok(())
}
