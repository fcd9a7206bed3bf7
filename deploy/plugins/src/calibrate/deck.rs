//! `alight calibrate deck`: measures the deck's position with a drone that stands on it, motors off.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use alight_computer::{
    config::DroneComputerConfig,
    exit::{CliError, Exit},
    process::instance::is_running,
    quantity::whole,
    record::{
        log::{Log, ReplayOrder},
        reading::contained,
    },
    terminal::{self, note},
};
use alight_shared::{
    config,
    msg::{AutopilotState, DroneState, TagPose, VesselEstimate},
    time::DroneClock,
};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory, Subscriber},
};
use alight_uav::{
    calibrate::{
        DeckCalibration, DeckCalibrationResult, DronePlacement, MountCalibration, USABLE_M, ValueWithSd,
        replaces,
    },
    mission::MissionIn,
    predictor::{PredictorConfig, PredictorIn},
};
use clap::Args;
use serde_json::{Value, json};

use crate::calibrate::list;

const POLL_PERIOD: Duration = Duration::from_millis(50);
/// Camera mount rotation beyond which a warning is given, in standard deviations of the predictor.
const MOUNT_SDS: f64 = 2.0;

/// Measurement with the drone on the deck.
#[derive(Args, Debug)]
#[command(
    after_help = "Put the drone on the middle of the deck, nose to the bow, motors off, the vessel rocking as it \
does. Run it as the user that runs Alight: sudo -u alight alight calibrate deck\n\
Exit codes: 0 measured, 1 the deck's position is not known better than by tape, 2 bad input or the drone moves."
)]
pub struct DeckArgs {
    /// Recording (MCAP) that ends with the drone on the deck, instead of the running processes
    #[arg(value_name = "FILE.mcap|FLIGHT")]
    pub recording: Option<PathBuf>,
    /// Configuration of the drone's computer (TOML) [default: the recording's, otherwise /etc/alight/drone.toml]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Name of the set of processes [default: the configuration's]
    #[arg(long, conflicts_with = "recording")]
    pub instance: Option<String>,
    /// Observation time, s
    #[arg(long = "for", value_name = "S", default_value_t = 120, value_parser = whole::<u64>(20..=3600))]
    pub seconds: u64,
    /// Position of the drone's centre: forward and right of the deck's centre, m [default: 0,0, or by the tag]
    #[arg(
        long,
        value_name = "FORWARD,RIGHT",
        allow_hyphen_values = true,
        value_delimiter = ',',
        num_args = 2
    )]
    pub at: Vec<f64>,
    /// Difference between the two GNSS receivers, horizontally and vertically, m, such as 0.02,0.03 with RTK
    /// [default: as the predictor is configured]
    #[arg(long, value_name = "H,V", value_delimiter = ',', num_args = 2)]
    pub receivers: Vec<f64>,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &DeckArgs) -> Result<Exit, CliError> {
    let (predictor, calibration) = match &args.recording {
        Some(path) => recorded(args, path)?,
        None => live(args)?,
    };
    let found = calibration.result().map_err(|e| CliError(e.to_string()))?;
    if args.json {
        terminal::line(object(&found));
    } else {
        print(&found, &predictor);
    }
    let usable = found.centre.iter().any(|f| f.sd <= USABLE_M);
    Ok(Exit::of(usable))
}

fn stand(args: &DeckArgs, config: &PredictorConfig) -> Result<DronePlacement, CliError> {
    let mut stand = DronePlacement::centred(config);
    if let [forward, right] = args.at[..] {
        stand.at_m = [forward, right];
    }
    if let [h, v] = args.receivers[..] {
        stand.receivers_sd_m = [h, v];
    }
    let fine = stand.at_m.iter().all(|v| v.abs() <= 50.0)
        && stand.receivers_sd_m.iter().all(|v| (1e-4..=100.0).contains(v));
    if !fine {
        return Err(CliError(format!(
            "--at {:?} --receivers {:?}: at most 50 m from the deck's centre, receivers 0.0001 to 100 m apart",
            stand.at_m, stand.receivers_sd_m
        )));
    }
    Ok(stand)
}

fn live(args: &DeckArgs) -> Result<(PredictorConfig, DeckCalibration), CliError> {
    let path = args
        .config
        .clone()
        .unwrap_or_else(|| "/etc/alight/drone.toml".into());
    let computer: DroneComputerConfig = config::load(&path)?;
    let predictor = computer.drone.predictor();
    let name = args.instance.as_ref().unwrap_or(&computer.instance);
    let instance = Instance::new(name)?;
    if !is_running(&instance) {
        return Err(CliError(format!(
            "no running drone computer found (instance \"{name}\"): systemctl status alight-drone"
        )));
    }
    let memory = Memory::join(&instance, "calibrate")?;
    let mut estimates: Subscriber<VesselEstimate<DroneClock>> = memory.subscriber()?;
    let mut drones: Subscriber<DroneState> = memory.subscriber()?;
    let mut tags: Subscriber<TagPose> = memory.subscriber()?;
    let mut autopilots: Subscriber<AutopilotState> = memory.subscriber()?;
    let mut calibration = DeckCalibration::new(&predictor, stand(args, &predictor)?);
    let until_ns = steady_ns() + Duration::from_secs(args.seconds).as_nanos() as i64;
    let mut reported_s = 0;
    let mut armed = None;
    while steady_ns() < until_ns && memory.wait(POLL_PERIOD) {
        let t = computer.clock.now::<DroneClock>().nanos();
        for state in autopilots.all(t) {
            armed = Some(state.armed);
        }
        if armed == Some(true) && calibration.collected().0 == 0 {
            break;
        }
        let states = drones.all(t);
        // Without a report of the autopilot the motors may be running.
        if armed != Some(false) {
            calibration.armed();
        }
        for s in &states {
            calibration.drone(s);
        }
        let tags = tags.all(t);
        let estimates = estimates.all(t);
        if armed == Some(false) {
            for e in &estimates {
                calibration.estimate(e);
            }
            for m in &tags {
                calibration.tag(m);
            }
        }
        let (n, s) = calibration.collected();
        if s as u64 >= reported_s + 10 {
            reported_s = s as u64;
            note(args.json, format_args!("{s:.0} s, {n} estimates of the vessel"));
        }
    }
    match armed {
        Some(false) => Ok((predictor, calibration)),
        Some(true) => Err(CliError(
            "the drone is armed: put it on the deck, disarm it, and try again".into(),
        )),
        None => Err(CliError(format!(
            "no autopilot reports under the name {name}: alight status --instance {name} lists the processes"
        ))),
    }
}

fn recorded(args: &DeckArgs, path: &Path) -> Result<(PredictorConfig, DeckCalibration), CliError> {
    contained(path, || {
        let log = Log::open(path)?.only(&["mission", "predictor"]);
        let settings = match &args.config {
            Some(file) => config::load::<DroneComputerConfig>(file)?.drone,
            None => log.first("predictor")?.config::<DroneComputerConfig>()?.drone,
        };
        let predictor = settings.predictor();
        let mut calibration = DeckCalibration::new(&predictor, stand(args, &predictor)?);
        let mut armed = true;
        log.steps(ReplayOrder::ByTime, |_, _, step| {
            if step.header.process == "mission" {
                let autopilot = step.entry::<MissionIn>()?.input.autopilot;
                armed = autopilot.map_or(armed, |a| a.armed);
                return Ok(());
            }
            if armed {
                calibration.armed();
            }
            calibration.take(&step.entry::<PredictorIn>()?.input, !armed);
            Ok(())
        })?;
        Ok((predictor, calibration))
    })
}

fn object(found: &DeckCalibrationResult) -> Value {
    json!({
        "estimates": found.estimates,
        "seconds": found.seconds,
        "rocking_rad": found.rocking_rad,
        "centre_m": found.centre,
        "stood_at_m": found.stood_at,
        "tilt_rad": found.tilt,
        "heading_rad": found.heading,
        "mount": found.mount.map(|m| json!({
            "tags": m.tags,
            "tilt_rad": m.tilt,
            "turn_rad": m.turn,
            "height_m": m.height,
        })),
    })
}

fn degrees(f: &ValueWithSd) -> String {
    format!("{:.2} +- {:.2} deg", f.value.to_degrees(), f.sd.to_degrees())
}

fn print(found: &DeckCalibrationResult, config: &PredictorConfig) {
    terminal::line(format_args!(
        "{} estimates of the vessel over {:.0} s, which rocked by {:.1} deg (rms)",
        found.estimates,
        found.seconds,
        found.rocking_rad.to_degrees()
    ));
    for (name, (f, old)) in ["forward", "right", "down"]
        .iter()
        .zip(found.centre.iter().zip(config.deck.centre_m))
    {
        let note = if f.sd > USABLE_M {
            "  not observable, unchanged: measure by tape, or with RTK (--receivers)"
        } else if replaces(f, old) {
            ""
        } else {
            "  agrees, unchanged"
        };
        terminal::line(format_args!(
            "deck's centre {name:<8} {:>7.3} +- {:.3} m, configured {old:.3}{note}",
            f.value, f.sd
        ));
    }
    let [roll, pitch] = &found.tilt;
    terminal::line(format_args!(
        "deck against the vessel's sensors: roll {}, pitch {}; drone's heading on it {}",
        degrees(roll),
        degrees(pitch),
        degrees(&found.heading)
    ));
    match &found.mount {
        Some(mount) => print_mount(found, mount, config),
        None => terminal::line(format_args!(
            "the tag is not detected from the deck: the drone's position is taken from --at, and the \
             camera's mount is not measured"
        )),
    }
    let centre: Vec<f64> = found
        .centre
        .iter()
        .zip(config.deck.centre_m)
        .map(|(f, old)| if replaces(f, old) { f.value } else { old })
        .collect();
    let line = list("centre_m", &centre, 3);
    terminal::line(format_args!(
        "\n# vessel.toml\n[vessel.deck]\n{line}\n\n# drone.toml\n[drone.deck]\n{line}"
    ));
}

fn print_mount(found: &DeckCalibrationResult, mount: &MountCalibration, config: &PredictorConfig) {
    let [forward, right] = &found.stood_at;
    terminal::line(format_args!(
        "by {} detections of the tag the drone stands {:.3} +- {:.3} m forward, {:.3} +- {:.3} m right of the \
         deck's centre",
        mount.tags, forward.value, forward.sd, right.value, right.sd
    ));
    let [roll, pitch] = &mount.tilt;
    terminal::line(format_args!(
        "camera's mount against the feet: roll {}, pitch {}, turn {}; {:.3} +- {:.3} m higher than configured",
        degrees(roll),
        degrees(pitch),
        degrees(&mount.turn),
        mount.height.value,
        mount.height.sd
    ));
    let granted = config.vision_bias_sd_m_rad[3];
    if mount
        .tilt
        .iter()
        .any(|t| t.value.abs() > MOUNT_SDS * granted + t.sd)
    {
        terminal::line(format_args!(
            "  more than the predictor allows for ({:.1} deg): align the camera",
            (MOUNT_SDS * granted).to_degrees()
        ));
    }
    if mount.height.value.abs() > 3.0 * mount.height.sd.hypot(config.camera_mount_sd_m) {
        terminal::line("  measure drone.airframe.camera_m, feet_below_m and drone.deck.tag_side_m again");
    }
}
