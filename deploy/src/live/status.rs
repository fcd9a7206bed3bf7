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
use super::display::{Picture, time};
use super::figures;
use super::instance::runs;
use super::supervisor::pause;
use super::vessel_status;
use crate::{End, Refused, say};

/// The name of `alight land`'s processes.
const LAND: &str = "land";
/// Looks on for this long before it says something: twice the processes' own period.
const LOOK: Duration = Duration::from_millis(1200);

/// Reads what the processes say.
pub struct Onlooker {
    processes: Subscriber<ProcessState>,
    mission: Subscriber<MissionState>,
    link: Subscriber<LinkState>,
    plan: Subscriber<Plan>,
    /// What was seen.
    pub picture: Picture,
    /// Ages of the vessel's newest state that were seen since somebody took them, s.
    pub ages_s: Vec<f64>,
}

impl Onlooker {
    /// Looks on.
    pub fn join(memory: &Memory) -> Result<Onlooker, Refused> {
        Ok(Onlooker {
            processes: memory.subscriber()?,
            mission: memory.subscriber()?,
            link: memory.subscriber()?,
            plan: memory.subscriber()?,
            picture: Picture::default(),
            ages_s: Vec::new(),
        })
    }
    /// Takes in what is new; the drone's clock reads `drone_ns`, if it is known.
    pub fn look(&mut self, drone_ns: Option<i64>) {
        let now = steady_ns();
        for state in self.processes.all(now) {
            self.picture.processes.insert(state.kind, state);
        }
        let t = drone_ns.unwrap_or(now);
        self.picture.mission = self.mission.newest(t).or(self.picture.mission);
        let links = self.link.all(t);
        // Who does not take them does not keep them.
        self.ages_s.truncate(64);
        self.ages_s.extend(links.iter().map(|l| l.age_s));
        self.picture.link = links.last().copied().or(self.picture.link);
        // Without the drone's clock the mission's newest stamp stands for now.
        let now_ns = drone_ns.or(self.picture.mission.map(|m| m.header.at.nanos()));
        if let Some(plan) = self.plan.newest(t) {
            self.picture.plan = Some((plan, f64::INFINITY));
        }
        if let (Some((plan, age_s)), Some(now_ns)) = (&mut self.picture.plan, now_ns) {
            *age_s = (now_ns - plan.header.at.nanos()).max(0) as f64 * 1e-9;
        }
    }
}

/// An instance that starts or stops while it is being joined is asked for again, this often.
const TRIES: u32 = 5;
/// ... with this pause.
const AGAIN: Duration = Duration::from_millis(100);

/// Shows once, or until stopped.
pub fn run(args: &StatusArgs) -> Result<End, Refused> {
    if let Some(name) = &args.instance {
        return of(args, name);
    }
    let path = match &args.config {
        Some(path) => path.clone(),
        // A landing of this computer before what is installed on it.
        None if runs(&Instance::new(LAND)?) => return of(args, LAND),
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
fn of(args: &StatusArgs, name: &str) -> Result<End, Refused> {
    let instance = Instance::new(name)?;
    let mut tries = 0;
    let (memory, mut onlooker) = loop {
        if !runs(&instance) {
            if args.json {
                say::line(format_args!("{}", json!({ "instance": name, "running": false })));
            } else {
                say::line(format_args!(
                    "nothing runs under the name {}; `alight land` starts something",
                    name
                ));
            }
            return Ok(End::Failed);
        }
        tries += 1;
        match join(&instance) {
            Ok(joined) => break joined,
            Err(refused) if tries == TRIES => return Err(refused),
            Err(_) => pause(AGAIN),
        }
    };
    loop {
        if !memory.wait(LOOK) {
            return Ok(End::Success);
        }
        onlooker.look(None);
        show(args, name, &onlooker.picture)?;
        if !args.watch || !runs(&instance) {
            return Ok(End::Success);
        }
    }
}

fn join(instance: &Instance) -> Result<(Memory, Onlooker), Refused> {
    let memory = Memory::join(instance, "status")?;
    let onlooker = Onlooker::join(&memory)?;
    Ok((memory, onlooker))
}

/// The figures of all processes by their names.
fn named(picture: &Picture) -> serde_json::Map<String, serde_json::Value> {
    picture
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

fn show(args: &StatusArgs, name: &str, picture: &Picture) -> Result<(), Refused> {
    if args.json {
        let object = json!({
            "instance": name,
            "running": true,
            "processes": picture.processes.values().collect::<Vec<_>>(),
            "figures": named(picture),
            "mission": picture.mission,
            "link": picture.link,
        });
        say::line(object);
        return Ok(());
    }
    if args.watch && std::io::stdout().is_terminal() {
        print!("\x1b[H\x1b[J");
    }
    say::line(format_args!("instance {name}\n"));
    if let Some(m) = &picture.mission {
        say::line(format_args!(
            "  mission   {} since {:.1} s: {}",
            m.state.name(),
            (m.header.at - m.since).secs(),
            m.entered
        ));
        say::line(format_args!("  waiting   {}", m.waiting));
    }
    if let Some(l) = &picture.link {
        say::line(format_args!(
            "  link      state {} old, {:.1} % lost or, over datagrams, overtaken; {:.1} % seen overtaken, latency {} / {} (p50/p99), {} refused",
            time(l.age_s),
            100.0 * l.loss,
            100.0 * l.overtaken,
            time(l.latency_p50_s),
            time(l.latency_p99_s),
            l.rejected
        ));
        say::line(format_args!(
            "  clocks    drone minus vessel {:.4} s +- {}",
            l.clock_offset_s,
            time(l.clock_offset_sd_s)
        ));
    }
    if let Some((plan, age_s)) = &picture.plan {
        say::line(format_args!(
            "  plan      {} old, {:?}, {} iterations",
            time(*age_s),
            plan.solve,
            plan.iterations
        ));
    }
    for p in picture.processes.values() {
        let text = figures::text(p);
        if !text.is_empty() {
            say::line(format_args!("  {:<9} {text}", p.kind.name()));
        }
    }
    say::line(format_args!(
        "\n{}\n{}\n{}",
        picture.usage(steady_ns()),
        picture.topics(),
        picture.radio()
    ));
    Ok(())
}
