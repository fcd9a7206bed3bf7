//! Computer that a command refers to, by name or configuration.

use std::{
    fs,
    path::{Path, PathBuf},
};

use alight_shared::config;
use alight_transport::memory::Instance;
use clap::Args;

use crate::{
    config::{DroneComputerConfig, VesselComputerConfig},
    exit::{CliError, Doing},
    process::instance::is_running,
};

pub const SHIPPED: [&str; 2] = ["/etc/alight/vessel.toml", "/etc/alight/drone.toml"];
pub const SIMULATED: &str = "sim";

#[derive(Clone, Debug, PartialEq)]
pub enum Computer {
    Vessel(Box<VesselComputerConfig>),
    Drone(Box<DroneComputerConfig>),
}

impl Computer {
    /// Reads a vessel's or a drone's configuration, distinguished by keys that only one of them has.
    pub fn read(path: &Path) -> Result<Computer, CliError> {
        let text = fs::read_to_string(path).doing(format_args!(
            "reading {} (check the path and its permissions)",
            path.display()
        ))?;
        let table: toml::Table = text.parse().doing(format_args!("parsing {}", path.display()))?;
        let has = |keys: &[&str]| keys.iter().any(|k| table.contains_key(*k));
        let origin = path.display().to_string();
        match (
            has(&["vessel_id", "vessel", "sensor", "deck"]),
            has(&["bridge", "drone", "autopilot", "camera", "uvdar", "supervision"]),
        ) {
            (true, false) => Ok(Computer::Vessel(Box::new(config::parse(&text, &origin)?))),
            (false, true) => Ok(Computer::Drone(Box::new(config::parse(&text, &origin)?))),
            (true, true) | (false, false) => Err(CliError(format!(
                "{origin} is neither a vessel's configuration (vessel_id) nor a drone's (bridge)"
            ))),
        }
    }
    pub fn instance(&self) -> &str {
        match self {
            Computer::Vessel(v) => &v.instance,
            Computer::Drone(d) => &d.instance,
        }
    }
    pub fn shipped() -> Option<PathBuf> {
        let readable = |p: &&Path| fs::File::open(p).is_ok();
        SHIPPED
            .iter()
            .map(Path::new)
            .find(readable)
            .map(Path::to_path_buf)
    }
    /// This computer under another instance name, if one is given.
    #[must_use]
    pub fn named(mut self, instance: Option<&str>) -> Computer {
        if let Some(name) = instance {
            match &mut self {
                Computer::Vessel(v) => v.instance = name.into(),
                Computer::Drone(d) => d.instance = name.into(),
            }
        }
        self
    }
    fn of_instance(name: &str) -> Result<Computer, CliError> {
        let drone = drone_of_instance(name)?.unwrap_or_else(|| unconfigured(name));
        Ok(Computer::Drone(Box::new(drone)))
    }
}

/// Drone of the instance `name`: the installed drone, or that of a simulated landing, whose file is next to its
/// memory.
fn drone_of_instance(name: &str) -> Result<Option<DroneComputerConfig>, CliError> {
    let [_, installed] = SHIPPED.map(Path::new);
    // Without permission to read the installed file, the simulated landing's is tried.
    let installed: Option<DroneComputerConfig> = config::load(installed).ok();
    if let Some(drone) = installed.filter(|d| d.instance == name) {
        return Ok(Some(drone));
    }
    let file = Instance::new(name)?.directory().join("drone.toml");
    if !file.exists() {
        return Ok(None);
    }
    let mut drone: DroneComputerConfig = config::load(&file)?;
    drone.instance = name.into();
    Ok(Some(drone))
}

/// Drone whose configuration is unknown except for the instance name.
fn unconfigured(name: &str) -> DroneComputerConfig {
    DroneComputerConfig {
        instance: name.into(),
        ..DroneComputerConfig::default()
    }
}

/// Drone that a command on this computer refers to. The installed drone takes precedence over a simulated landing
/// unless another name is given: an order must not go to a simulation while a drone flies.
pub fn commanded_drone(
    config: Option<&Path>,
    instance: Option<&str>,
    is_abort: bool,
) -> Result<DroneComputerConfig, CliError> {
    if let Some(path) = config {
        return Ok(config::load(path)?);
    }
    let [_, installed] = SHIPPED.map(Path::new);
    if instance.is_none() && installed.exists() {
        return Ok(config::load(installed)?);
    }
    let name = instance.unwrap_or(SIMULATED);
    match drone_of_instance(name)? {
        Some(drone) => Ok(drone),
        // Without the configuration an order might carry the wrong drone's number, so it is rejected; an abort is
        // still sent.
        None if !is_abort && is_running(&Instance::new(name)?) => Err(CliError(format!(
            "the configuration of the processes {name} is not found: name it with --config"
        ))),
        None => Ok(unconfigured(name)),
    }
}

/// Vessel that an order on board refers to: the installed vessel, or, by name, that of a simulated landing, whose
/// file is next to its memory.
pub fn commanded_vessel(
    config: Option<&Path>,
    instance: Option<&str>,
) -> Result<VesselComputerConfig, CliError> {
    let Some(name) = instance.filter(|_| config.is_none()) else {
        return Ok(config::load(config.unwrap_or(Path::new(SHIPPED[0])))?);
    };
    let file = Instance::new(name)?.directory().join("vessel.toml");
    if !file.exists() {
        return Err(CliError(format!(
            "the vessel's configuration of the processes {name} is not found: name it with --config"
        )));
    }
    let mut vessel: VesselComputerConfig = config::load(&file)?;
    vessel.instance = name.into();
    Ok(vessel)
}

#[derive(Args, Clone, Debug, Default)]
pub struct Subject {
    /// Name of the set of processes [default: the configuration's; without one: sim]
    #[arg(long)]
    pub instance: Option<String>,
    /// Configuration of the vessel's or the drone's computer (TOML) [default: /etc/alight/vessel.toml or
    /// /etc/alight/drone.toml, whichever exists]
    #[arg(long, value_name = "FILE", conflicts_with = "instance")]
    pub config: Option<PathBuf>,
}

impl Subject {
    /// Configuration of the subject; that of a landing on this computer takes precedence over the installed one.
    pub fn computer(&self) -> Result<Computer, CliError> {
        let fixed = self.fixed()?;
        match (&fixed.instance, &fixed.config) {
            (Some(name), _) => Computer::of_instance(name),
            (None, Some(path)) => Computer::read(path),
            (None, None) => Computer::of_instance(SIMULATED),
        }
    }
    /// Subject of orders. As in [`commanded_drone`], the installed computer takes precedence over a simulated
    /// landing.
    pub fn ordered(&self) -> Result<Subject, CliError> {
        let [_, installed] = SHIPPED;
        let is_open = self.instance.is_none() && self.config.is_none();
        if is_open && Path::new(installed).exists() {
            return Ok(Subject {
                instance: None,
                config: Some(installed.into()),
            });
        }
        self.fixed()
    }
    /// Whether the configuration was read from a file, not assumed.
    pub fn is_configured(&self) -> bool {
        let known = |name: &String| drone_of_instance(name).is_ok_and(|drone| drone.is_some());
        self.instance.as_ref().is_none_or(known)
    }
    /// Subject by name or file, independent of processes that start later.
    pub fn fixed(&self) -> Result<Subject, CliError> {
        if self.instance.is_some() || self.config.is_some() {
            return Ok(self.clone());
        }
        let lands = is_running(&Instance::new(SIMULATED)?);
        let config = if lands { None } else { Computer::shipped() };
        Ok(Subject {
            instance: config.is_none().then(|| SIMULATED.into()),
            config,
        })
    }
}
