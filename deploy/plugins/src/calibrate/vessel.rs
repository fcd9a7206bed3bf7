//! `alight calibrate vessel`: identifies damping, stiffness and the antenna's position from a recording.

use std::path::{Path, PathBuf};

use alight_computer::{
    config::VesselComputerConfig,
    exit::{CliError, Doing, Exit},
    record::{
        log::{Log, ReplayOrder},
        reading::{contained, is_mcap},
    },
    terminal,
};
use alight_shared::{
    config,
    vessel_model::{DOFS, HEAVE, PITCH, ROLL, SURGE, SWAY, YAW},
};
use alight_usv::{
    ComputerIn, VesselNodeConfig,
    calibrate::{
        DOF_NAMES, Decay, DecaySignal, NotObservable, Record, Stiffness, ValueWithSd, VesselCalibration,
        Weight, identify,
        incline::{inertia, level, stiffness},
    },
    log::table::{CsvTable, Quantity},
    sensors::Readings,
};
use clap::Args;
use serde_json::{Value, json};

use crate::calibrate::list;

/// Maximum standard deviation of a usable antenna position, m. Chosen: better than a tape measure achieves on a boat.
const USABLE_M: f64 = 0.1;
const MAX_TABLE_BYTES: u64 = 256 << 20;

/// Columns of a pose: degree of freedom, quantity and unit.
const POSE: [(usize, Quantity, f64); DOFS] = [
    (SURGE, Quantity::Surge, 1.0),
    (SWAY, Quantity::Sway, 1.0),
    (HEAVE, Quantity::Heave, 1.0),
    (ROLL, Quantity::Roll, core::f64::consts::PI / 180.0),
    (PITCH, Quantity::Pitch, core::f64::consts::PI / 180.0),
    (YAW, Quantity::Heading, core::f64::consts::PI / 180.0),
];

/// Recording of a vessel.
#[derive(Args, Debug)]
#[command(
    after_help = "On calm water, engines off: press one side down and let go, then the bow, then let somebody heavy \
step off; push her forward, sideways, and turn her, and let go. Three times each, and let her come to rest between, \
for longer than she moves. For the antenna's position rock her for two minutes, or take a recording in waves.\n\
For M in roll and pitch place a known weight off the middle and record her at rest for a minute (--loaded-log, --weight).\n\
The vessel's flight recorder records it: `alight flights` names the flight; or take one of its files, vessel-*.mcap\n\
Exit codes: 0 something was found, 1 nothing is observable, 2 bad input."
)]
pub struct VesselArgs {
    /// Recording: an MCAP file, a flight of the vessel's recorder, or Alight's CSV: t_s and any of roll_deg, pitch_deg,
    /// heading_deg, heave_m, surge_m, sway_m (alight help sensors)
    #[arg(value_name = "FILE|FLIGHT")]
    pub recording: PathBuf,
    /// Configuration of the vessel's computer (TOML) [default: the recording's, otherwise the program's defaults]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Recording at rest with a known weight on board, of any of these kinds
    #[arg(long, value_name = "FILE", requires = "weight")]
    pub loaded_log: Option<PathBuf>,
    /// Mass (kg) of that weight and its position from the vessel's reference point (m)
    #[arg(long, value_name = "KG,FORWARD,RIGHT", requires = "loaded_log", value_parser = weight, allow_hyphen_values = true)]
    pub weight: Option<Weight>,
    /// Print as one JSON object
    #[arg(long)]
    pub json: bool,
}

fn weight(text: &str) -> Result<Weight, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.unwrap_or_default().as_slice() {
        [mass_kg, x, y] if *mass_kg > 0.0 && *mass_kg < 1e6 && x.abs() < 1e3 && y.abs() < 1e3 => Ok(Weight {
            mass_kg: *mass_kg,
            at_m: [*x, *y],
        }),
        _ => Err("three numbers: kg, m forward, m right, as in 80,0.5,0.9".into()),
    }
}

type LoadedStiffness = Option<Stiffness>;

pub fn run(args: &VesselArgs) -> Result<Exit, CliError> {
    let named = args
        .config
        .as_ref()
        .map(|path| config::load::<VesselComputerConfig>(path));
    let named = named.transpose()?.map(|computer| computer.vessel);
    let (config, found) = read(&args.recording, named.clone())?;
    let loaded = match (&args.loaded_log, &args.weight) {
        (Some(path), Some(weight)) => {
            let (_, with) = read(path, named)?;
            Some(stiffness(weight, &found.level, &with.level))
        }
        (_, _) => None,
    };
    if args.json {
        terminal::line(object(&found, &loaded));
    } else {
        print(&found, &loaded, &config);
    }
    let some = found.decays.iter().any(Result::is_ok) || antenna(&found).is_some();
    Ok(Exit::of(some))
}

/// Configuration, and the calibration with which it is compared.
type Configured = (VesselNodeConfig, VesselCalibration);

fn read(path: &Path, named: Option<VesselNodeConfig>) -> Result<Configured, CliError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("mcap") => contained(path, || recorded(path, named)),
        _ if path.is_dir() || is_mcap(path) => contained(path, || recorded(path, named)),
        _ if path.is_file() => table(path, named.unwrap_or_default()),
        Some(_) | None => Err(CliError(format!(
            "{}: neither FILE.mcap, a table (FILE.csv) nor a flight of the recorder",
            path.display()
        ))),
    }
}

fn recorded(path: &Path, named: Option<VesselNodeConfig>) -> Result<Configured, CliError> {
    let log = Log::open(path)?.only(&["vessel"]);
    let own = log.first("vessel")?;
    let config = match named {
        Some(config) => config,
        None => own.config::<VesselComputerConfig>()?.vessel,
    };
    let mut record = Record::default();
    log.steps(ReplayOrder::ByStart, |_, _, step| {
        record.add(&Readings::of(&step.entry::<ComputerIn>()?.input.sensors));
        Ok(())
    })?;
    let found = record.identify(&config);
    Ok((config, found))
}

/// Table of poses. Decays are identified separately by column, and columns may have values in different rows.
fn table(path: &Path, config: VesselNodeConfig) -> Result<Configured, CliError> {
    let doing = format_args!("reading {} (check the path and its permissions)", path.display());
    let size = std::fs::metadata(path).doing(doing)?.len();
    if size > MAX_TABLE_BYTES {
        return Err(CliError(format!(
            "{}: {size} bytes; at most {MAX_TABLE_BYTES}",
            doing
        )));
    }
    let bytes = std::fs::read(path).doing(doing)?;
    let table = CsvTable::read(&bytes).doing(doing)?;
    if let Some((line, message)) = &table.bad.first {
        return Err(CliError(format!(
            "{doing}: line {line}: {message}; correct or remove the row"
        )));
    }
    if let Some((line, _)) = table.backwards {
        return Err(CliError(format!("{doing}: line {line}: time does not rise")));
    }
    let there: Vec<(usize, Quantity, f64)> = POSE.iter().copied().filter(|(_, q, _)| table.has(*q)).collect();
    if there.is_empty() {
        let names: Vec<&str> = POSE.iter().map(|(_, q, _)| q.name()).collect();
        let message = format!(
            "no column of a pose; t_s and any of {} are read",
            names.join(", ")
        );
        return Err(table.header_error(message)).doing(doing);
    }
    let mut signals: [DecaySignal; DOFS] = Default::default();
    for (dof, quantity, unit) in &there {
        let signal = &mut signals[*dof];
        for row in &table.rows {
            let Some(value) = row.get(*quantity) else { continue };
            if signal.t_s.last().is_some_and(|before| *before >= row.t) {
                return Err(CliError(format!(
                    "{doing}: line {}: time does not rise",
                    row.line
                )));
            }
            let y = value * unit;
            // The heading is unwrapped where it passes north.
            let y = match signal.y.last() {
                Some(before) if *dof == YAW => before + alight_shared::frames::wrap_angle(y - before),
                Some(_) | None => y,
            };
            signal.t_s.push(row.t);
            signal.y.push(y);
        }
    }
    let used: Vec<Quantity> = there.iter().map(|(_, q, _)| *q).collect();
    let left_out: Vec<&str> = table.unused(&used).into_iter().map(Quantity::name).collect();
    if !left_out.is_empty() {
        terminal::note(
            true,
            format_args!(
                "{}: ignored because they are not part of a pose: {}",
                path.display(),
                left_out.join(", ")
            ),
        );
    }
    let ends = |pick: fn(&[f64]) -> Option<f64>| signals.iter().filter_map(move |s| pick(&s.t_s));
    let first = ends(|t| t.first().copied()).fold(f64::INFINITY, f64::min);
    let last = ends(|t| t.last().copied()).fold(f64::NEG_INFINITY, f64::max);
    let found = VesselCalibration {
        seconds: (last - first).max(0.0),
        decays: identify(&signals),
        level: [ROLL, PITCH].map(|dof| signals.get(dof).and_then(level)),
        antenna_m: None,
    };
    Ok((config, found))
}

/// Position of the antenna, if its uncertainty permits its use.
fn antenna(found: &VesselCalibration) -> Option<[ValueWithSd; 3]> {
    found.antenna_m.filter(|a| a.iter().any(|f| f.sd <= USABLE_M))
}

fn why(unknown: &NotObservable) -> String {
    match unknown {
        NotObservable::NotMeasured => "not in the recording".into(),
        NotObservable::NotPushed { stands_out } => format!(
            "no motion stands out from that at rest (the largest by {stands_out:.1} standard deviations): push her and let \
             her come to rest, on calm water"
        ),
        NotObservable::NoDecay { explained } => format!(
            "a free decay explains {:.0} % of the best push: the vessel was held or driven by waves, or moved in another way",
            100.0 * explained
        ),
        NotObservable::Vague => "the impulses are too weak or too short to identify anything".into(),
    }
}

fn mass(dof: usize, decay: &Decay, loaded: &LoadedStiffness) -> Option<ValueWithSd> {
    let [roll, pitch] = loaded.as_ref()?;
    let of = match dof {
        ROLL => roll,
        PITCH => pitch,
        _ => return None,
    };
    inertia(of.as_ref().ok()?, decay)
}

fn object(found: &VesselCalibration, loaded: &LoadedStiffness) -> Value {
    let decays: serde_json::Map<String, Value> = DOF_NAMES
        .iter()
        .zip(&found.decays)
        .enumerate()
        .map(|(dof, (name, decay))| {
            let of = match decay {
                Ok(d) => json!({
                    "damping_per_mass": d.damping,
                    "stiffness_per_mass": d.stiffness,
                    "impulses": d.impulses,
                    "mass": mass(dof, d, loaded),
                }),
                Err(unknown) => json!({ "not_observable": why(unknown) }),
            };
            ((*name).into(), of)
        })
        .collect();
    json!({
        "seconds": found.seconds,
        "decays": decays,
        "antenna_m": found.antenna_m,
    })
}

fn print_loaded(loaded: &Stiffness) {
    for (name, of) in ["roll", "pitch"].iter().zip(loaded) {
        let text = match of {
            Ok(g) => format!("G {:.0} +- {:.0}", g.value, g.sd),
            Err(Some(tilt)) => format!(
                "heels by {:.2} +- {:.2} deg, which is too little or the wrong way: use a heavier weight, farther \
                 from the middle, on calm water",
                tilt.value.to_degrees(),
                tilt.sd.to_degrees()
            ),
            Err(None) => "no attitude for 20 s with and without it".into(),
        };
        terminal::line(format_args!("{name:<6} under the weight: {text}"));
    }
}

fn print(found: &VesselCalibration, loaded: &LoadedStiffness, config: &VesselNodeConfig) {
    let model = &config.model;
    terminal::line(format_args!("{:.0} s recorded", found.seconds));
    loaded.iter().for_each(print_loaded);
    let mut damping = model.damping_npmps_nmpradps;
    let mut stiffness = model.stiffness_npm_nmprad;
    let mut inertia = model.inertia_kg_kgm2;
    for (dof, (name, decay)) in DOF_NAMES.iter().zip(&found.decays).enumerate() {
        match decay {
            Ok(d) => {
                let m = mass(dof, d, loaded);
                if let Some(m) = &m {
                    terminal::line(format_args!(
                        "{name:<6} M {:.0} +- {:.0} (configured {:.0})",
                        m.value, m.sd, inertia[dof]
                    ));
                    inertia[dof] = m.value;
                }
                let [dd, gg] = [d.damping, d.stiffness].map(|f| f.scaled(inertia[dof]));
                terminal::line(format_args!(
                    "{name:<6} D {:.0} +- {:.0} (configured {:.0}), G {:.0} +- {:.0} (configured {:.0}), {} impulses",
                    dd.value, dd.sd, damping[dof], gg.value, gg.sd, stiffness[dof], d.impulses
                ));
                damping[dof] = dd.value;
                if gg.value > 0.0 {
                    stiffness[dof] = gg.value;
                }
            }
            Err(unknown) => terminal::line(format_args!(
                "{name:<6} not observable, unchanged: {}",
                why(unknown)
            )),
        }
    }
    terminal::line(
        "M is not observable from free motion and stays as configured elsewhere (a known weight shows it in roll and \
         pitch: --loaded-log): D and G are relative to M, which is all that the model uses; the inertial sensor's own \
         place defines the reference point; unchanged",
    );
    let mut place = config.gnss.antenna_m;
    match &found.antenna_m {
        Some(antenna) => {
            for (axis, (f, slot)) in ["forward", "right", "down"]
                .iter()
                .zip(antenna.iter().zip(&mut place))
            {
                let known = f.sd <= USABLE_M;
                let note = if known {
                    ""
                } else {
                    "  not observable, unchanged: too little rocking"
                };
                terminal::line(format_args!(
                    "GNSS antenna {axis:<8} {:>7.3} +- {:.3} m, configured {:.3}{note}",
                    f.value, f.sd, *slot
                ));
                if known {
                    *slot = f.value;
                }
            }
        }
        None => terminal::line("GNSS antenna not observable, unchanged: no fixes with motion between them"),
    }
    let m = list("inertia_kg_kgm2", &inertia, 0);
    let d = list("damping_npmps_nmpradps", &damping, 0);
    let g = list("stiffness_npm_nmprad", &stiffness, 0);
    let a = list("antenna_m", &place, 3);
    terminal::line(format_args!(
        "\n# vessel.toml\n[vessel.model]\n{m}\n{d}\n{g}\n[vessel.gnss]\n{a}"
    ));
}
