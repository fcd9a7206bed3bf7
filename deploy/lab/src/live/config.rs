//! Files that the processes of a live landing read in addition to the computers' configurations.

use std::{
    net::UdpSocket,
    path::{Path, PathBuf},
};

use alight_computer::{
    config::DroneComputerConfig,
    exit::{CliError, Doing, Exit},
    process::instance::OwnedInstance,
    terminal,
};
use alight_shared::{
    config,
    config::{Check, ConfigError, Keys, commented},
    geodesy::Datum,
};
use alight_sim::{
    autopilots::FirmwareConfig,
    baselines::Baseline,
    harness::{scenario::Scenario, storm::Fault},
    radio::SimulatedRadioConfig,
};
use alight_usv::sensors::SourceConfig;
use clap::ValueEnum;
use serde::{Deserialize, Serialize};

pub const AT_SEA: Datum = Datum::new(43.5, 16.3, 0.0);

/// Source of the simulated drone's motor commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum AutopilotKind {
    /// The simulated autopilot.
    #[default]
    Internal,
    /// PX4, over its simulator API (TCP 4560).
    Px4,
    /// ArduPilot, over its JSON backend (UDP 9002).
    Ardupilot,
}

impl AutopilotKind {
    /// Default address of the autopilot's MAVLink on this computer.
    pub const fn connect(self) -> &'static str {
        match self {
            AutopilotKind::Internal | AutopilotKind::Px4 => "udpin://127.0.0.1:14540",
            AutopilotKind::Ardupilot => "tcpout://127.0.0.1:5760",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkImpairment {
    /// Reading of the steady clock at the profile's time zero, ns.
    pub epoch_ns: i64,
    pub seed: u64,
    /// Outage that begins when the mission first enters a state.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outage: Option<Fault>,
    pub profile: SimulatedRadioConfig,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attachments {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impairment: Option<LinkImpairment>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Baseline>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exec: Option<String>,
}

impl Check for Attachments {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        let impairment = self.impairment.as_ref();
        impairment.map_or(Ok(()), |i| {
            i.profile.check(&at.table("impairment").table("profile"))
        })
    }
}

/// Devices of the simulated vehicles for installed processes; without them, images go through shared memory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Devices {
    /// Named pipe for the belly camera's raw images.
    pub camera: PathBuf,
    /// Delay from the middle of an image's exposure to its delivery in that pipe, s.
    pub camera_delay_s: f64,
}

config! {
    /// The simulated vehicles.
    pub struct SimulatedWorld {
        /// Name of the set of processes that share the drone's memory: that of `alight drone` or of a landing.
        pub instance: String = DroneComputerConfig::default().instance;
        /// The vessel's sensors as in the vessel's configuration (`[[sensor.sources]]`), each with the address to
        /// which it sends bytes.
        pub sensors: Vec<SourceConfig> = sources(&Scenario::default(), |k| format!("udpin://127.0.0.1:{}", 10_110 + k));
        /// Serial line of the drone's own GNSS receiver, if the scenario has a moving base.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub receiver: Option<PathBuf> = None;
        /// Reading of the steady clock at the true time zero, ns; 0: the next full second after the process starts,
        /// by the clock that `alight vessel` and `alight drone` read on this computer. With another value the
        /// scenario's `sensors.clocks.epoch_s` equals that reading, s.
        pub epoch_ns: i64 = 0;
        /// Seed of sea, noise and start.
        pub seed: u64 = 0;
        /// Name of the sea in the outcome.
        pub sea: String = String::new();
        /// Name of the planner in the outcome.
        pub planner: String = String::new();
        /// Records the truth in addition to the recordings of the processes.
        pub truth: bool = false;
        /// Time after an abort or a takeover until the next landing at the latest, s; 0: the trial is then over.
        pub goes_on_s: f64 = 0.0, in 0.0..=3600.0;
        /// File for the plot of the landing.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub plot: Option<PathBuf> = None;
        /// Autopilot of the drone: internal, px4, ardupilot.
        pub autopilot: AutopilotKind = AutopilotKind::default();
        /// UDP address at which the drone's link to the simulated autopilot listens.
        pub mavlink: String = "127.0.0.1:14540".into();
        /// Key of MAVLink signing that the simulated autopilot shares with the drone's computer (`autopilot.signing_key`).
        pub signing_key: String = String::new();
        /// UDP address at which a ground station listens, on the simulated autopilot's other link; the autopilot
        /// forwards between both links.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub ground_station: Option<String> = None;
        /// The plant of a firmware.
        pub firmware: FirmwareConfig;
        /// Devices of the drone's computer, which may then start later than the vehicles.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub devices: Option<Devices> = None;
        /// Scenario of the simulation, as `alight config scenario` prints it.
        pub scenario: Scenario;
    }
}

/// Sensor sources of a scene's vessel; source number `k` has the address `connect(k)`.
pub fn sources(scenario: &Scenario, connect: impl Fn(usize) -> String) -> Vec<SourceConfig> {
    let mut all = scenario.sensors.sources(scenario.deck.centre_m);
    for (source, k) in all.iter_mut().zip(0..) {
        source.connect = connect(k);
    }
    all
}

/// Prints a world's configuration with every key, and with the default addresses of `alight vessel` and `alight
/// drone`.
pub fn print_world() -> Result<Exit, CliError> {
    let mut world = SimulatedWorld::default();
    // A process that is started by hand uses this computer's clock.
    let clocks = &mut world.scenario.sensors.clocks;
    (clocks.epoch_s, clocks.offset_s, clocks.drift_ppm) = (0.0, 0.0, 0.0);
    let text = commented(&world).doing("writing the configuration as TOML")?;
    terminal::line(text.trim_end());
    Ok(Exit::Success)
}

pub fn write<C: Serialize>(owned: &OwnedInstance, name: &str, config: &C) -> Result<PathBuf, CliError> {
    let path = owned.file(name);
    let text = toml::to_string(config).doing(format_args!("writing {name}"))?;
    std::fs::write(&path, text).doing(format_args!("writing {}", path.display()))?;
    Ok(path)
}

pub fn free_port() -> Result<u16, CliError> {
    let bound = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
    let address = bound.doing("looking for a free port")?;
    Ok(address.port())
}

pub fn attached(name: &str, attachments: &Path, config: &Path) -> Vec<String> {
    let path = |p: &Path| p.display().to_string();
    ["attach".into(), name.into()]
        .into_iter()
        .chain([
            "--attachments".into(),
            path(attachments),
            "--config".into(),
            path(config),
        ])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_world_toml_round_trip() {
        let text = commented(&SimulatedWorld::default()).unwrap();
        assert!(text.contains("# Reading of the steady clock"), "{text}");
        let read = config::parse::<SimulatedWorld>(&text, "world").unwrap();
        assert_eq!(read, SimulatedWorld::default());
    }
}
