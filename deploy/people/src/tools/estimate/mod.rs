//! `alight estimate LOG`: runs the vessel's estimator over a recording of a boat.

pub mod show;

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use alight_computer::{
    config::VesselComputerConfig,
    exit::{CliError, Doing, Exit},
    record::{
        log::{Log, ReplayOrder},
        reading::{contained, is_mcap},
    },
    terminal::{Form, note},
};
use alight_shared::{config, msg::Decoded};
use alight_usv::{
    ComputerIn, VesselNodeConfig,
    log::{self, LogError, MAX_MEASUREMENTS, SensorRecording},
    review::{Review, SourceReview, review},
    sensors::{Measurement, Mount},
};
use clap::Args;

use crate::tools::check::equipment::MIN_ATTITUDE_HZ;

const MAX_BYTES: u64 = 512 << 20;

/// Recording to estimate.
#[derive(Args, Debug)]
pub struct EstimateArgs {
    /// Recording: NMEA 0183, NMEA 2000, Signal K, UBX or MAVLink as it was received, Alight's CSV (columns t_s and any
    /// of roll_deg, pitch_deg, heading_deg, heave_m, surge_m, sway_m, gyro_x_radps, ..., see alight help sensors),
    /// Alight's MCAP, or a flight of the vessel's recorder; `python -m alight.convert FILE` makes the CSV of other recordings
    #[arg(value_name = "LOG")]
    pub log: PathBuf,
    /// Vessel's configuration, as for `alight vessel` [default: that of the recording, otherwise the program's]
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Source of [[sensor.sources]] with the mounting of the recorded sensors [default: the first]
    #[arg(long, value_name = "NAME", requires = "config")]
    pub source: Option<String>,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}

pub fn run(args: &EstimateArgs) -> Result<Exit, CliError> {
    let named: Option<VesselComputerConfig> =
        args.config.as_ref().map(|path| config::load(path)).transpose()?;
    let origin = args.log.display().to_string();
    let mount = mount(named.as_ref(), args.source.as_deref())?;
    let (recorded, own) = recorded(&args.log, &origin, &mount)?;
    let vessel = match (named, own) {
        (Some(computer), _) => computer.vessel,
        (None, Some(own)) => own,
        (None, None) => VesselNodeConfig::default(),
    };
    let review = review(&vessel, &recorded);
    if review.estimates == 0 {
        return Err(CliError(not_started(&origin, &review)));
    }
    note(args.form.alone(), show::table(&origin, &review).trim_end());
    args.form.print(&review, &review.predictions)?;
    Ok(Exit::Success)
}

/// Reason why the estimator never started: its required inputs, the recording's content, and the rejected input.
fn not_started(origin: &str, review: &Review) -> String {
    let mut parts = vec![format!(
        "{origin}: the estimator never started; it needs inertial samples or attitudes, for a few seconds \
         without a break"
    )];
    let there = review.sources.iter().map(|s| {
        let rate = format!("{} {} at {:.1} Hz", s.samples, s.kind, s.rate_hz);
        match s.counts.rejected + s.counts.out_of_order {
            0 => rate,
            n => format!("{rate}, {n} of them rejected or out of order"),
        }
    });
    let there: Vec<String> = there.collect();
    parts.push(match there.is_empty() {
        true => "there was no measurement".into(),
        false => format!("there were {}", there.join("; ")),
    });
    let has_inertial = review.sources.iter().any(|s| s.kind == "imu");
    let slow = |s: &&SourceReview| s.kind == "attitude" && !has_inertial && s.rate_hz < MIN_ATTITUDE_HZ;
    parts.extend(review.sources.iter().filter(slow).map(|s| {
        format!(
            "attitude at {:.1} Hz: too slow for a rocking deck ({MIN_ATTITUDE_HZ} Hz or more is needed)",
            s.rate_hz
        )
    }));
    let d = &review.decoded;
    let left_out = [
        (d.left_out, "without a measurement in them"),
        (d.ignored, "of kinds that are not read"),
        (d.corrupted, "damaged"),
        (d.undated, "without a time"),
        (review.outliers_in_time, "dated far ahead"),
    ];
    let some = left_out.iter().filter(|(n, _)| *n > 0);
    let some: Vec<String> = some.map(|(n, why)| format!("{n} {why}")).collect();
    if !some.is_empty() {
        parts.push(format!("left out: {}", some.join(", ")));
    }
    parts.extend(review.notes.iter().cloned());
    parts.join("; ")
}

fn mount(named: Option<&VesselComputerConfig>, name: Option<&str>) -> Result<Mount, CliError> {
    let sources = named.map(|c| c.placed_sensors().sources).unwrap_or_default();
    match name {
        None => Ok(sources.first().map(|s| s.mount.clone()).unwrap_or_default()),
        Some(name) => {
            let source = sources.iter().find(|s| s.name == name);
            source.map(|s| s.mount.clone()).ok_or_else(|| {
                let names: Vec<&str> = sources.iter().map(|s| s.name.as_str()).collect();
                CliError(format!(
                    "no source is called {name:?}; there are: {}",
                    names.join(", ")
                ))
            })
        }
    }
}

fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    let doing = format_args!("reading {} (check the path and its permissions)", path.display());
    let mut bytes = Vec::new();
    let file = File::open(path).doing(doing)?;
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).doing(doing)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(CliError(format!(
            "{}: more than {} MB; cut the recording into parts",
            path.display(),
            MAX_BYTES >> 20
        )));
    }
    Ok(bytes)
}

fn recorded(
    path: &Path,
    origin: &str,
    mount: &Mount,
) -> Result<(SensorRecording, Option<VesselNodeConfig>), CliError> {
    if path.is_dir() || is_mcap(path) {
        return contained(path, || flown(path)).map(|(r, c)| (r, Some(c)));
    }
    log::read(&read(path)?, origin, mount)
        .map(|r| (r, None))
        .map_err(|e| CliError(e.to_string()))
}

fn flown(path: &Path) -> Result<(SensorRecording, VesselNodeConfig), CliError> {
    let log = Log::open(path)?.only(&["vessel"]);
    let config = log.first("vessel")?.config::<VesselComputerConfig>()?.vessel;
    let mut all = Vec::new();
    let mut decoded = Decoded::default();
    log.steps(ReplayOrder::ByStart, |_, _, step| {
        if all.len() <= MAX_MEASUREMENTS {
            let i = step.entry::<ComputerIn>()?.input.vessel();
            decoded.good += 1;
            all.extend(i.readings.imu.into_iter().map(Measurement::Imu));
            all.extend(i.readings.attitude.into_iter().map(Measurement::Attitude));
            all.extend(i.readings.gnss.into_iter().map(Measurement::Gnss));
            all.extend(i.readings.heading.into_iter().map(Measurement::Heading));
        }
        Ok(())
    })?;
    let error = |message: String| CliError(LogError::new(&path.display().to_string(), message).to_string());
    if all.is_empty() {
        return Err(error("holds no measurement of a vessel".into()));
    }
    if all.len() > MAX_MEASUREMENTS {
        return Err(error(format!("more than {MAX_MEASUREMENTS} measurements")));
    }
    let recording = SensorRecording {
        format: "MCAP",
        measurements: all,
        decoded,
        notes: Vec::new(),
    };
    Ok((recording, config))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reason_of_an_estimator_that_never_started() {
        let rows: String = (0..=30).map(|t| format!("{t},1,2\n")).collect();
        let table = format!("t_s,roll_deg,pitch_deg\n{rows}");
        let recorded = log::read(table.as_bytes(), "slow.csv", &Mount::default()).unwrap();
        let recorded = SensorRecording {
            decoded: Decoded {
                left_out: 7,
                ..recorded.decoded
            },
            ..recorded
        };
        let text = not_started("slow.csv", &review(&VesselNodeConfig::default(), &recorded));
        for part in [
            "31 attitude at 1.0 Hz",
            "attitude at 1.0 Hz: too slow for a rocking deck",
            "left out: 7 without a measurement in them",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}
