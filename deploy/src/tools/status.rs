//! `alight status`: what runs under an instance's name, from another terminal.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Duration;

use alight_shared::msg::{
    AutopilotState, LandingMode, MissionState, ReasonCode, ShadowComparison, still_armed,
};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Instance, Memory};
use alight_uav::autopilot::config::DisarmConfig;
use clap::Args;
use serde_json::json;

use crate::exit::{CliError, Exit};
use crate::process::instance::is_running;
use crate::process::metrics;
use crate::process::observer::Observer;
use crate::process::snapshot::{Snapshot, time};
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
    /// Go on showing until stopped
    #[arg(long)]
    pub watch: bool,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
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
        Computer::Vessel(v) => vessel_status::run(&path, &v, args.watch, args.json),
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
            Err(refused) if tries == MAX_TRIES => return Err(refused),
            Err(_) => pause(RETRY_PAUSE),
        }
    };
    loop {
        if !memory.wait(OBSERVATION_TIME) {
            return Ok(Exit::Success);
        }
        observer.poll(None);
        show(args, name, &observer.snapshot, disarm)?;
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

fn show(args: &StatusArgs, name: &str, snapshot: &Snapshot, disarm: &DisarmConfig) -> Result<(), CliError> {
    let still_armed_s = snapshot.still_armed_s(disarm);
    if args.json {
        let metrics: serde_json::Map<String, serde_json::Value> = snapshot
            .processes
            .values()
            .map(|p| {
                let of = p.metrics.iter().map(|m| (m.key(), m.json())).collect();
                (p.kind.name().into(), serde_json::Value::Object(of))
            })
            .collect();
        let object = json!({
            "instance": name,
            "running": true,
            "processes": snapshot.processes.values().collect::<Vec<_>>(),
            "metrics": metrics,
            "mission": snapshot.mission,
            "autopilot": snapshot.autopilot,
            "still_armed_s": still_armed_s,
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
        let (since_s, entered) = ((m.header.at - m.since).secs(), m.entered.to_string());
        let reason = if entered.is_empty() {
            String::new()
        } else {
            format!(": {entered}")
        };
        terminal::line(format_args!(
            "  mission   {} since {since_s:.1} s{reason}",
            m.state.name()
        ));
        terminal::line(format_args!("  waiting   {}", m.waiting));
    }
    if let Some(s) = still_armed_s {
        terminal::line(format_args!("  ALARM     {}", still_armed(s as f32)));
    }
    if let Some(a) = &snapshot.autopilot
        && a.rejection.code != ReasonCode::None
    {
        terminal::line(format_args!("  autopilot no landing: {}", a.rejection));
    }
    if let Some(a) = &snapshot.autopilot {
        show_battery(a, snapshot.mission.as_ref());
        show_mode(a, snapshot.mission.as_ref());
    }
    if let Some((origin, apart)) = snapshot.frame() {
        let deck = apart.map_or("no forecast of the deck".into(), |m| {
            format!("deck {m:.0} m away")
        });
        terminal::line(format_args!(
            "  frame     begins at {:.6}, {:.6}, {:.1} m above the ellipsoid; {deck}",
            origin.latitude_deg, origin.longitude_deg, origin.height_m
        ));
    }
    if let Some(l) = &snapshot.link {
        terminal::line(format_args!(
            "  link      state {} old, {:.1} % lost, {:.1} % out of order (datagrams may overtake each other), latency \
             {} / {} (p50/p99), {} rejected (late or repeated ones are normal)",
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
        let text = metrics::text(p);
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

/// The battery, and what the way to the deck and one attempt cost of it.
fn show_battery(a: &AutopilotState, mission: Option<&MissionState>) {
    let charge = a.battery.map_or("charge not reported".into(), |b| {
        let needs = mission.map_or(String::new(), |m| {
            format!(" (needs {:.0} %)", 100.0 * m.battery_reserve)
        });
        format!("{:.0} %{needs}", 100.0 * b)
    });
    let volts = a.battery_v.map_or(String::new(), |v| format!(", {v:.1} V"));
    let amps = a.battery_a.map_or(String::new(), |i| format!(", {i:.1} A"));
    terminal::line(format_args!("  battery   {charge}{volts}{amps}"));
}

/// How far the landing goes, when not onto the deck.
fn show_mode(a: &AutopilotState, mission: Option<&MissionState>) {
    match mission.map_or(LandingMode::Land, |m| m.mode) {
        LandingMode::Land => {}
        LandingMode::Match => {
            let lowest_m = mission.and_then(|m| m.lowest_clearance_m).unwrap_or_default();
            terminal::line(format_args!(
                "  match     follows the deck {lowest_m:.1} m above it and climbs"
            ));
        }
        LandingMode::Shadow => match &a.shadow {
            None => terminal::line("  shadow    a person flies; nothing to compare yet"),
            Some(s) => terminal::line(format_args!("  shadow    {}", shadow(s))),
        },
    }
}

/// What would be commanded beside what is flown.
fn shadow(s: &ShadowComparison) -> String {
    let [roll, pitch] = s.tilt.map(f64::to_degrees);
    let motors = if s.stops { "; would stop the motors" } else { "" };
    format!(
        "would command roll {roll:.1} pitch {pitch:.1} deg, thrust {:.2}; apart by {:.1} deg, {:.2} m/s{motors}",
        s.thrust,
        s.apart_rad.to_degrees(),
        s.apart_mps
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadow_line_says_what_would_be_commanded() {
        let s = ShadowComparison {
            tilt: [0.1, -0.05],
            thrust: 0.41,
            apart_rad: 0.02,
            apart_mps: 0.3,
            ..ShadowComparison::default()
        };
        assert_eq!(
            shadow(&s),
            "would command roll 5.7 pitch -2.9 deg, thrust 0.41; apart by 1.1 deg, 0.30 m/s"
        );
    }
}
