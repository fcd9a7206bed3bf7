//! `alight calibrate drone`: prints the response of the drone's attitude to set-points, as the pilot identified it in
//! a flight.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use alight_computer::{
    config::DroneComputerConfig,
    exit::{CliError, Exit},
    process::{instance::is_running, observer::Observer},
    record::{
        flight::store,
        log::{Log, ReplayOrder},
        reading::contained,
    },
    terminal,
};
use alight_shared::{config, msg::AttitudeResponse};
use alight_transport::memory::{Instance, Memory};
use alight_uav::mission::MissionIn;
use clap::Args;
use serde_json::json;

const LISTEN_TIME: Duration = Duration::from_secs(1);
/// Maximum number of recorded flights, newest first, that are searched for a response; reading one takes some
/// seconds.
const MAX_FLIGHTS: usize = 5;

/// Flight to read.
#[derive(Args, Debug)]
#[command(
    after_help = "The response is identified while Alight flies (an approach suffices), and again by every flight; until then \
that of the newest recorded flight is shown. A flight begins with the value in the file.\n\
Exit codes: 0 identified, 1 not flown long enough, 2 bad input."
)]
pub struct DroneArgs {
    /// Recording or directory of the flight, instead of the running processes
    #[arg(value_name = "FILE.mcap|FLIGHT")]
    pub recording: Option<PathBuf>,
    /// Configuration of the drone's computer (TOML)
    #[arg(
        long,
        value_name = "FILE",
        default_value = "/etc/alight/drone.toml",
        conflicts_with = "recording"
    )]
    pub config: PathBuf,
    /// Name of the set of processes [default: the configuration's]
    #[arg(long, conflicts_with = "recording")]
    pub instance: Option<String>,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &DroneArgs) -> Result<Exit, CliError> {
    let found = match &args.recording {
        Some(path) => recorded(path)?,
        None => live(args)?,
    };
    match (found, args.json) {
        (Some(r), false) => terminal::line(text(&r)),
        (None, false) => terminal::line(
            "the response is not identified: let Alight fly the drone for some seconds, an approach to the deck suffices",
        ),
        (found, true) => terminal::json(&json!({
            "identified": found.is_some(),
            "dead_time_s": found.map(|r| r.dead_time_s),
            "lag_s": found.map(|r| r.lag_s),
            "rate_lag_s": found.map(|r| r.rate_lag_s),
        }))?,
    }
    Ok(Exit::of(found.is_some()))
}

fn text(r: &AttitudeResponse) -> String {
    let [roll, pitch] = r.lag_s;
    format!(
        "the attitude responds to a set-point after {:.3} s (transmission included), with time constants of {roll:.3} s in roll and \
         {pitch:.3} s in pitch;\nthe rate loop's lag is {:.3} s\n\n# drone.toml\n[drone.airframe]\nattitude_lag_s = {:.2}",
        r.dead_time_s,
        r.rate_lag_s,
        roll.max(pitch)
    )
}

fn recorded(path: &Path) -> Result<Option<AttitudeResponse>, CliError> {
    contained(path, || {
        let log = Log::open(path)?.only(&["mission"]);
        log.first("mission")?;
        let mut newest = None;
        log.steps(ReplayOrder::ByStart, |_, _, step| {
            let response = step.entry::<MissionIn>()?.input.set_point.map(|s| s.response);
            newest = response.filter(|r| r.identified).or(newest);
            Ok(())
        })?;
        Ok(newest)
    })
}

/// Response identified by the running processes, otherwise by the newest flight that they recorded.
fn live(args: &DroneArgs) -> Result<Option<AttitudeResponse>, CliError> {
    let computer: DroneComputerConfig = config::load(&args.config)?;
    let name = args.instance.as_ref().unwrap_or(&computer.instance);
    let instance = Instance::new(name)?;
    if !is_running(&instance) {
        return Err(CliError(format!(
            "no running drone computer found (instance \"{name}\"): systemctl status alight-drone, or name a recording"
        )));
    }
    let memory = Memory::join(&instance, "calibrate")?;
    let mut observer = Observer::join(&memory)?;
    memory.wait(LISTEN_TIME);
    observer.poll();
    match observer.snapshot.response.filter(|r| r.identified) {
        Some(response) => Ok(Some(response)),
        None => newest_flown(Path::new(&computer.recorder.directory)),
    }
}

/// Response identified in the newest recorded flight. A running process begins each flight with the configured value.
fn newest_flown(directory: &Path) -> Result<Option<AttitudeResponse>, CliError> {
    let flights = store::flights(directory).unwrap_or_default();
    for flight in flights.iter().rev().take(MAX_FLIGHTS) {
        if let Some(response) = recorded(&flight.path)? {
            return Ok(Some(response));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn response_as_a_line_of_the_file() {
        let r = AttitudeResponse {
            dead_time_s: 0.031,
            lag_s: [0.162, 0.171],
            rate_lag_s: 0.07,
            identified: true,
        };
        let text = text(&r);
        assert!(
            text.contains("after 0.031 s") && text.ends_with("attitude_lag_s = 0.17"),
            "{text}"
        );
    }
}
