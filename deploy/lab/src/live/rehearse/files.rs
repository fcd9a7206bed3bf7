//! Copies of the installer's two files with changes (device paths, addresses, keys, a mode in place of one that needs
//! a pilot), and the world that they describe.

use std::{
    os::unix::fs::DirBuilderExt,
    path::{Path, PathBuf},
};

use alight_computer::{
    certificates::{self, common_name},
    config::{
        DroneComputerConfig, VesselComputerConfig, link_url::LinkUrl, method, recorder::RecorderConfig,
    },
    exit::{CliError, Doing},
};
use alight_shared::{config, msg::LandingMode};
use alight_sim::{harness::scenario::Scenario, sensors::moving_base::MovingBaseConfig};
use alight_transport::clock::steady_ns;
use alight_uav::autopilot::modes::Firmware;
use alight_usv::sensors::SourceConfig;
use rustix::fs::{FileType, Mode, mknodat};
use toml::{Table, Value};

use super::args::RehearseArgs;
use crate::{
    args::AutopilotArg,
    live::{
        config::{AT_SEA, AutopilotKind, Devices, SimulatedWorld, free_port},
        serial_lines::assigned,
    },
};

const SHIPPED_VESSEL: &str = include_str!("../../../../vessel/vessel.toml");
const SHIPPED_DRONE: &str = include_str!("../../../../drone/drone.toml");
/// Validity of a rehearsal's certificates, days: `alight check` warns below 30.
const DAYS: u32 = 60;
/// Minimum time until the vehicles start, at a full second of the steady clock, ns.
const RUN_UP_NS: i64 = 1_000_000_000;
const SECOND_NS: i64 = 1_000_000_000;
const RECEIVER: &str = "tty-receiver";
/// Address at which the computers reach each other.
const HOST: &str = "127.0.0.1";

/// Directory of the rehearsal, removed at the end unless kept.
pub struct Directory {
    path: PathBuf,
    kept: bool,
}

impl Directory {
    fn make(keep: Option<&Path>) -> Result<Directory, CliError> {
        // Not the instance's directory, which is alight-rehearse-NUMBER and is emptied when the instance starts.
        let own = || std::env::temp_dir().join(format!("alight-rehearsal-{}", std::process::id()));
        let path = keep.map_or_else(own, Path::to_path_buf);
        let mut builder = std::fs::DirBuilder::new();
        let made = builder.mode(0o700).create(&path);
        made.doing(format_args!("making the directory {}", path.display()))?;
        let path = path
            .canonicalize()
            .doing(format_args!("finding {}", path.display()))?;
        Ok(Directory {
            path,
            kept: keep.is_some(),
        })
    }
    pub fn path(&self) -> &Path {
        &self.path
    }
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        if !self.kept {
            let _left = std::fs::remove_dir_all(&self.path);
        }
    }
}

pub struct RehearsalPlan {
    pub vessel: VesselComputerConfig,
    pub drone: DroneComputerConfig,
    pub world: SimulatedWorld,
    /// Names of the certificates; empty if the files need none.
    pub certificates: Vec<String>,
    pub contradictions: Vec<String>,
    pub directory: Directory,
}

impl RehearsalPlan {
    pub fn of(args: &RehearseArgs) -> Result<RehearsalPlan, CliError> {
        let mut vessel_file = table(args.vessel_config.as_deref(), SHIPPED_VESSEL)?;
        let mut drone_file = table(args.drone_config.as_deref(), SHIPPED_DRONE)?;
        // The installer's text is checked before any change.
        let vessel: VesselComputerConfig = read(&vessel_file, args.vessel_config.as_deref(), "vessel.toml")?;
        let drone: DroneComputerConfig = read(&drone_file, args.drone_config.as_deref(), "drone.toml")?;
        let connect = autopilot_link(args)?;
        let directory = Directory::make(args.keep.as_deref())?;
        let names = radio(&directory, (&vessel, &mut vessel_file), (&drone, &mut drone_file))?;
        let sources = sources(&vessel, &directory);
        change_vessel(&mut vessel_file, &vessel, &directory, &sources)?;
        let camera = directory.file("camera");
        change_drone(&mut drone_file, &drone, &directory, connect, &camera);
        let pipe = mknodat(
            rustix::fs::CWD,
            &camera,
            FileType::Fifo,
            Mode::RUSR | Mode::WUSR,
            0,
        );
        pipe.doing("making the camera's pipe")?;

        let contradictions = contradictions(&vessel, &drone);
        let vessel = write(&vessel_file, &directory.file("vessel.toml"))?;
        let drone = write(&drone_file, &directory.file("drone.toml"))?;
        let mut world = world(args, (&vessel, &drone), &sources, camera)?;
        if !drone.autopilot.receiver.is_empty() {
            world.receiver = Some(directory.file(RECEIVER));
        }
        let text = toml::to_string(&world).doing("writing the world")?;
        std::fs::write(directory.file("world.toml"), text).doing("writing world.toml")?;
        Ok(RehearsalPlan {
            vessel,
            drone,
            world,
            certificates: names,
            contradictions,
            directory,
        })
    }
}

/// Address of the autopilot's MAVLink: that of a firmware or of the simulated one.
fn autopilot_link(args: &RehearseArgs) -> Result<String, CliError> {
    match &args.autopilot_at {
        Some(url) => {
            LinkUrl::of_autopilot(url).map_err(CliError)?;
            Ok(url.clone())
        }
        None => Ok(format!("udpin://{HOST}:{}", free_port()?)),
    }
}

fn change_vessel(
    file: &mut Table,
    vessel: &VesselComputerConfig,
    directory: &Directory,
    sources: &[SourceConfig],
) -> Result<(), CliError> {
    for (key, input) in [
        ("crew_switch", &vessel.deck.crew_switch),
        ("occupancy_sensor", &vessel.deck.occupancy_sensor),
        ("helm_switch", &vessel.deck.helm_switch),
        ("helm_lamp", &vessel.deck.helm_lamp),
    ] {
        if !input.is_empty() {
            set(file, &["deck"], key, "");
        }
    }
    set_recorder(file, "vessel", &vessel.recorder, directory);
    let list = Value::try_from(sources).doing("writing the sensors")?;
    set(file, &["sensor"], "sources", list);
    set(file, &[], "instance", format!("rehears-{}", std::process::id()));
    Ok(())
}

fn change_drone(
    file: &mut Table,
    drone: &DroneComputerConfig,
    directory: &Directory,
    connect: String,
    camera: &Path,
) {
    set_recorder(file, "drone", &drone.recorder, directory);
    set(file, &[], "instance", format!("rehearse-{}", std::process::id()));
    set(file, &["autopilot"], "connect", connect);
    // The sequence of first flights begins with a pilot, and a rehearsal has none.
    if drone.drone.mission.mode == LandingMode::Shadow {
        set(file, &["drone", "mission"], "mode", "land");
    }
    if !drone.autopilot.receiver.is_empty() {
        let line = format!("serial://{}:115200", directory.file(RECEIVER).display());
        set(file, &["autopilot"], "receiver", line);
    }
    set(file, &["camera"], "source", camera.display().to_string());
    // The simulated deck has no markers.
    if drone.uvdar.at_rate(1.0).is_there() {
        set(file, &["uvdar"], "source", "");
    }
}

/// Records to the rehearsal's directory, so that other recorded flights are not removed.
fn set_recorder(file: &mut Table, name: &str, recorder: &RecorderConfig, directory: &Directory) {
    if !recorder.directory.is_empty() {
        let flights = directory.file("flights").join(name);
        set(file, &["recorder"], "directory", flights.display().to_string());
    }
}

fn table(path: Option<&Path>, shipped: &str) -> Result<Table, CliError> {
    let Some(path) = path else {
        return shipped.parse().doing("reading the shipped file");
    };
    let doing = format_args!("reading {} (check the path and its permissions)", path.display());
    let text = std::fs::read_to_string(path).doing(doing)?;
    method::check_flight(&text, &path.display().to_string())?;
    text.parse().doing(doing)
}

fn read<C>(file: &Table, path: Option<&Path>, shipped: &str) -> Result<C, CliError>
where
    C: serde::de::DeserializeOwned + config::Check,
{
    let name = path.map_or_else(|| shipped.into(), |p| p.display().to_string());
    let text = toml::to_string(file).doing(format_args!("copying {name}"))?;
    Ok(config::parse(&text, &name)?)
}

/// Writes a changed file, and reads it back as its program will.
fn write<C>(file: &Table, path: &Path) -> Result<C, CliError>
where
    C: serde::de::DeserializeOwned + config::Check,
{
    let doing = format_args!("writing {}", path.display());
    std::fs::write(path, toml::to_string(file).doing(doing)?).doing(doing)?;
    Ok(config::load(path)?)
}

/// Sets a key in nested tables.
pub fn set(file: &mut Table, within: &[&str], key: &str, value: impl Into<Value>) {
    let mut at = file;
    for name in within {
        let entry = at.entry(*name).or_insert_with(|| Table::new().into());
        let Some(table) = entry.as_table_mut() else { return };
        at = table;
    }
    at.insert(key.into(), value.into());
}

/// Sets the endpoint and, if the files need them, the certificates of both computers; returns the certificates'
/// names.
fn radio(
    directory: &Directory,
    (vessel, vessel_file): (&VesselComputerConfig, &mut Table),
    (drone, drone_file): (&DroneComputerConfig, &mut Table),
) -> Result<Vec<String>, CliError> {
    let transport = |endpoints: &[String]| -> String {
        let first = endpoints.first().map(String::as_str).unwrap_or_default();
        first.split('/').next().unwrap_or_default().to_owned()
    };
    let listens = transport(&vessel.radio.listen);
    let connects = transport(&drone.radio.connect);
    let port = free_port()?;
    let listen = vec![format!("{listens}/{HOST}:{port}")];
    let connect = vec![format!("{connects}/{HOST}:{port}")];
    set(vessel_file, &["radio"], "listen", listen);
    set(drone_file, &["radio"], "connect", connect);
    let keys = directory.file("keys");
    let mut names = Vec::new();
    for (kind, number, tls, file) in [
        ("vessel", vessel.vessel_id, &vessel.radio.tls, vessel_file),
        ("drone", drone.bridge.drone_id, &drone.radio.tls, drone_file),
    ] {
        if tls.authority.is_empty() {
            continue;
        }
        if names.is_empty() {
            certificates::init(&keys, DAYS)?;
        }
        let own = certificates::issue(&keys, kind, number, &[HOST.into()], DAYS)?;
        let made = certificates::files(&own, Vec::new())?;
        let within = ["radio", "tls"];
        set(file, &within, "authority", made.authority);
        set(file, &within, "certificate", made.certificate);
        set(file, &within, "key", made.key);
        names.push(common_name(kind, number));
    }
    Ok(names)
}

fn tty(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    format!("tty-{}", name.chars().map(plain).collect::<String>())
}

/// The installer's sensors, each on a separate line; if the file has none yet, the receiver, compass and inertial
/// sensor of its examples.
fn sources(vessel: &VesselComputerConfig, directory: &Directory) -> Vec<SourceConfig> {
    let mut sources = vessel.sensor.sources.clone();
    if sources.is_empty() {
        sources = Scenario::default().sensors.sources(vessel.vessel.deck.centre_m);
    }
    for (k, source) in sources.iter_mut().enumerate() {
        // Two sensors may have the same name.
        let line = directory.file(&tty(&format!("{k}-{}", source.name)));
        source.connect = format!("serial://{}:115200", line.display());
    }
    sources
}

/// Settings that must be equal on vessel and drone but are not.
fn contradictions(vessel: &VesselComputerConfig, drone: &DroneComputerConfig) -> Vec<String> {
    let mut all = Vec::new();
    let tags = drone.drone.tags();
    if vessel.vessel.deck.with_tags(&tags) != drone.drone.deck.with_tags(&tags) {
        all.push("[vessel.deck] and [drone.deck] differ".into());
    }
    if vessel.vessel_id != drone.bridge.vessel_id {
        let own = vessel.vessel_id;
        let other = drone.bridge.vessel_id;
        all.push(format!("vessel_id is {own} on the vessel, {other} on the drone"));
    }
    all
}

fn world(
    args: &RehearseArgs,
    (vessel, drone): (&VesselComputerConfig, &DroneComputerConfig),
    sources: &[SourceConfig],
    camera: PathBuf,
) -> Result<SimulatedWorld, CliError> {
    let epoch_ns = (steady_ns() + RUN_UP_NS) / SECOND_NS * SECOND_NS + SECOND_NS;
    let mavlink = drone.autopilot.connect.trim_start_matches("udpin://");
    let (autopilot, mavlink) = match (&args.autopilot_at, args.autopilot) {
        (None, _) => (AutopilotKind::Internal, mavlink.to_owned()),
        (Some(_), Some(AutopilotArg::Ardupilot)) => (AutopilotKind::Ardupilot, String::new()),
        (Some(_), Some(AutopilotArg::Px4) | None) => (AutopilotKind::Px4, String::new()),
    };
    let world = SimulatedWorld {
        instance: drone.instance.clone(),
        epoch_ns,
        seed: args.seed,
        sea: args.sea.text.clone(),
        planner: format!("{:?}", drone.drone.planner.kind).to_lowercase(),
        autopilot,
        firmware: args
            .firmware
            .as_deref()
            .map_or_else(|| Ok(Default::default()), config::load)?,
        mavlink,
        signing_key: drone.autopilot.signing_key.clone(),
        sensors: sources.to_vec(),
        devices: Some(Devices {
            camera,
            camera_delay_s: drone.camera.delay_s,
        }),
        scenario: scenario(args, (vessel, drone), sources, epoch_ns)?,
        ..SimulatedWorld::default()
    };
    Ok(world)
}

fn scenario(
    args: &RehearseArgs,
    (vessel, drone): (&VesselComputerConfig, &DroneComputerConfig),
    sources: &[SourceConfig],
    epoch_ns: i64,
) -> Result<Scenario, CliError> {
    let mut s = Scenario {
        sea: args.sea.config.clone(),
        ..Scenario::default()
    };
    s.describe(
        &vessel.vessel.deck.with_tags(&drone.drone.tags()),
        &vessel.vessel.surroundings,
        &drone.drone.airframe,
    );
    s.place.among = vec![AT_SEA];
    s.start.warm_up_s = args.warm_up_s();
    // `alight check` needs the drone before any service runs.
    s.start.hover_s = s.start.warm_up_s.min(60.0);
    if args.autopilot == Some(AutopilotArg::Ardupilot) {
        s.drone.autopilot.firmware = Firmware::ArduCopter;
    }
    // Both computers are this one: their clock is the steady clock, which the vehicles' time stamps follow.
    s.sensors.clocks.epoch_s = epoch_ns as f64 * 1e-9;
    s.sensors.clocks.offset_s = 0.0;
    s.sensors.clocks.drift_ppm = 0.0;
    for (source, carries) in sources.iter().zip(assigned(sources)?) {
        if carries.imu {
            let own = vessel.vessel.imu.lever_arm_m;
            s.sensors.vessel_imu.lever_arm_m = source.mount.lever_arm_m.unwrap_or(own);
            s.sensors.vessel_imu.latency_s = source.latency_s;
        }
        if carries.gnss {
            let own = vessel.vessel.gnss.antenna_m;
            s.sensors.vessel_gnss.antenna_m = source.mount.antenna_m.unwrap_or(own);
            s.sensors.vessel_gnss.latency_s = source.latency_s;
        }
        if carries.heading {
            s.sensors.vessel_heading.latency_s = source.latency_s;
        }
        if source.is_base() {
            let own = vessel.vessel.gnss.antenna_m;
            let deck = vessel.vessel.deck.centre_m;
            let antenna_m = source.mount.antenna_m.unwrap_or(own);
            s.sensors.moving_base = Some(MovingBaseConfig {
                antenna_m: core::array::from_fn(|k| antenna_m[k] - deck[k]),
                fix_latency_s: drone.autopilot.receiver_latency_s,
                ..MovingBaseConfig::default()
            });
        }
    }
    let imu = &vessel.vessel.imu;
    s.sensors.vessel_imu.gyro_white_sd_radps = imu.gyro_sd_radps;
    s.sensors.vessel_imu.accelerometer_white_sd_mps2 = imu.accelerometer_sd_mps2;
    s.sensors.render.on = true;
    s.sensors.render.lens = drone.drone.camera.lens;
    s.sensors.camera_mount.rotation_deg = drone.drone.camera.mount_rotation_deg;
    s.sensors.tag.rate_hz = drone.camera.rate_hz.min(100.0);
    Ok(s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::typed;

    fn plan(arguments: &[&str]) -> Result<RehearsalPlan, CliError> {
        RehearsalPlan::of(&typed(core::iter::once(&"rehearse").chain(arguments)))
    }

    /// Keys of `b` that differ from those of `a`, with their tables.
    fn changed(a: &Table, b: &Table, within: &str) -> Vec<String> {
        let mut all = Vec::new();
        for (key, value) in b {
            let name = format!("{within}{key}");
            match (a.get(key).and_then(Value::as_table), value.as_table()) {
                (before, Some(after)) if before.is_some() || !after.is_empty() => {
                    all.extend(changed(
                        &before.cloned().unwrap_or_default(),
                        after,
                        &format!("{name}."),
                    ));
                }
                _ if a.get(key) != Some(value) => all.push(name),
                _ => {}
            }
        }
        all
    }

    #[test]
    fn rehearsal_changes_of_shipped_files() {
        let plan = plan(&[]).unwrap();
        let of = |shipped: &str, name: &str| {
            let text = std::fs::read_to_string(plan.directory.file(name)).unwrap();
            changed(&shipped.parse().unwrap(), &text.parse().unwrap(), "")
        };
        let vessel = of(SHIPPED_VESSEL, "vessel.toml");
        let tls = ["authority", "certificate", "key"].map(|k| format!("radio.tls.{k}"));
        let expected = |more: &[&str]| {
            let mut all: Vec<String> = more.iter().map(|m| (*m).to_owned()).chain(tls.clone()).collect();
            all.sort();
            all
        };
        let sorted = |mut all: Vec<String>| {
            all.sort();
            all
        };
        assert_eq!(
            sorted(vessel),
            expected(&["instance", "radio.listen", "recorder.directory", "sensor.sources"])
        );
        let drone = of(SHIPPED_DRONE, "drone.toml");
        assert_eq!(
            sorted(drone),
            expected(&[
                "autopilot.connect",
                "camera.source",
                "drone.mission.mode",
                "instance",
                "radio.connect",
                "recorder.directory"
            ])
        );
        assert_eq!(plan.certificates, ["vessel-1", "drone-1"]);
        assert!(plan.contradictions.is_empty());
        let directory = plan.directory.path().to_path_buf();
        drop(plan);
        assert!(!directory.exists(), "it leaves {}", directory.display());
    }
}
