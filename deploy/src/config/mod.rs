//! One configuration file per computer: the vessel's, the drone's, and the simulated world's.

pub mod camera;
pub mod supervision;

#[cfg(feature = "lab")]
use std::path::PathBuf;

use alight_bridge::BridgeConfig;
use alight_shared::config;
use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::transport::clock::ProcessClock;
use alight_shared::transport::radio::RadioConfig;
#[cfg(feature = "lab")]
use alight_sim::autopilots::FirmwareConfig;
#[cfg(feature = "lab")]
use alight_sim::harness::scenario::{Scenario, StateOutage};
#[cfg(feature = "lab")]
use alight_sim::radio::{Direction, RadioConfig as Impairment};
use alight_uav::autopilot::AutopilotLinkConfig;
#[cfg(feature = "lab")]
use alight_uav::odometry::OdometryConfig;
use alight_uav::settings::DroneSettings;
use alight_usv::sensors::SourcesConfig;
use alight_usv::{DeckConfig, VesselNodeConfig};
use serde::{Deserialize, Serialize};

use crate::config::camera::{CameraSource, UltravioletSource};
use crate::config::supervision::Supervision;
#[cfg(feature = "lab")]
use crate::lab::live::plant::AutopilotKind;
use crate::process::link::Impaired;
use crate::process::relay::DroneRelay;

/// An impairment of the radio, applied to what a process receives; for trials only.
#[cfg(feature = "lab")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkImpairment {
    /// Seed of its losses and delays.
    pub seed: u64,
    /// Its outage at a state of the mission.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outage: Option<StateOutage>,
    /// Delay, loss, outages.
    pub profile: Impairment,
}

/// The vessel's computer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VesselComputer {
    /// Number of this vessel.
    pub vessel_id: u32,
    /// Where the sensors' datagrams come in.
    pub sensors: String,
    /// Its real sensors; where there are some, the vessel's process starts `alight sensors`.
    pub sensor: SourcesConfig,
    /// Its clock.
    pub clock: ProcessClock,
    /// Its radio.
    pub radio: RadioConfig,
    /// Impairment of what it receives.
    #[cfg(feature = "lab")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impairment: Option<LinkImpairment>,
    /// Where copies of its estimates go over UDP; for trials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relay: Option<String>,
    /// How the deck is given to drones.
    pub deck: DeckConfig,
    /// Its node.
    pub vessel: VesselNodeConfig,
}

impl Default for VesselComputer {
    fn default() -> Self {
        VesselComputer {
            vessel_id: 1,
            // Ours.
            sensors: "127.0.0.1:7440".into(),
            sensor: SourcesConfig::default(),
            clock: ProcessClock::default(),
            // Zenoh's usual port.
            radio: RadioConfig {
                listen: vec!["udp/0.0.0.0:7447".into()],
                ..RadioConfig::default()
            },
            #[cfg(feature = "lab")]
            impairment: None,
            relay: None,
            deck: DeckConfig::default(),
            vessel: VesselNodeConfig::default(),
        }
    }
}

impl VesselComputer {
    /// What comes over the radio, as a trial impairs it.
    pub fn heard<T: Clone>(&self) -> Impaired<T> {
        #[cfg(feature = "lab")]
        return Impaired::new(self.impairment.as_ref(), Direction::ToVessel, self.clock.epoch_ns);
        #[cfg(not(feature = "lab"))]
        Impaired::default()
    }
}

impl Check for VesselComputer {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.sensor.check(&at.table("sensor"))?;
        self.clock.check(&at.table("clock"))?;
        self.radio.check(&at.table("radio"))?;
        #[cfg(feature = "lab")]
        if let Some(link) = &self.impairment {
            link.profile.check(&at.table("impairment").table("profile"))?;
        }
        self.deck.check(&at.table("deck"))?;
        self.vessel.check(&at.table("vessel"))
    }
}

config! {
    /// The drone's file: `[bridge]` and `[drone.*]`.
    pub struct DroneFile {
        /// The bridge.
        pub bridge: BridgeConfig;
        /// Predictor, mission, planner, pilot and what they know of drone and deck.
        pub drone: DroneSettings;
    }
}

/// The drone's computer. Its own number and its vessel's are the bridge's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DroneComputer {
    /// Name of the set of processes that share memory.
    pub instance: String,
    /// Its clock.
    pub clock: ProcessClock,
    /// Its radio.
    pub radio: RadioConfig,
    /// Impairment of what it receives.
    #[cfg(feature = "lab")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impairment: Option<LinkImpairment>,
    /// Where plain relays of its messages are; for trials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relay: Option<DroneRelay>,
    /// Its link to a real autopilot.
    pub autopilot: AutopilotLinkConfig,
    /// Its bridge.
    pub bridge: BridgeConfig,
    /// Where its camera's images come from.
    pub camera: CameraSource,
    /// Where its ultraviolet camera's images come from.
    pub uvdar: UltravioletSource,
    /// How its processes are run.
    pub supervision: Supervision,
    /// Its other nodes.
    pub drone: DroneSettings,
}

impl Default for DroneComputer {
    fn default() -> Self {
        DroneComputer {
            instance: "drone".into(),
            clock: ProcessClock::default(),
            // Ours: the vessel's address on its own network.
            radio: RadioConfig {
                connect: vec!["udp/192.168.7.1:7447".into()],
                ..RadioConfig::default()
            },
            #[cfg(feature = "lab")]
            impairment: None,
            relay: None,
            autopilot: AutopilotLinkConfig::default(),
            bridge: BridgeConfig::default(),
            camera: CameraSource::default(),
            uvdar: UltravioletSource::default(),
            supervision: Supervision::default(),
            drone: DroneSettings::default(),
        }
    }
}

impl DroneComputer {
    /// Where the ultraviolet camera's images come from, at the rate of the markers' bits.
    pub fn ultraviolet(&self) -> CameraSource {
        self.uvdar.at_rate(self.drone.camera.uvdar.rate_hz)
    }
    /// What comes over the radio, as a trial impairs it.
    pub fn heard<T: Clone>(&self) -> Impaired<T> {
        #[cfg(feature = "lab")]
        return Impaired::new(self.impairment.as_ref(), Direction::ToDrone, self.clock.epoch_ns);
        #[cfg(not(feature = "lab"))]
        Impaired::default()
    }
}

impl Check for DroneComputer {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.clock.check(&at.table("clock"))?;
        self.radio.check(&at.table("radio"))?;
        #[cfg(feature = "lab")]
        if let Some(link) = &self.impairment {
            link.profile.check(&at.table("impairment").table("profile"))?;
        }
        self.autopilot.check(&at.table("autopilot"))?;
        self.bridge.check(&at.table("bridge"))?;
        self.camera.check(&at.table("camera"))?;
        self.uvdar.check(&at.table("uvdar"))?;
        self.supervision.check(&at.table("supervision"))?;
        self.drone.check(&at.table("drone"))
    }
}

/// The simulated vehicles.
#[cfg(feature = "lab")]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedWorld {
    /// Name of the set of processes that share the drone's memory.
    pub instance: String,
    /// Where the vessel's process takes its sensors' datagrams.
    pub sensors: String,
    /// The steady clock's reading at the true time zero, ns.
    pub epoch_ns: i64,
    /// Seed of sea, noise and start.
    pub seed: u64,
    /// The sea as the person named it.
    pub sea: String,
    /// The planner, for the outcome.
    pub planner: String,
    /// The drone only follows, for this long after the start, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub follow_s: Option<f64>,
    /// The truth is logged beside what the processes log.
    pub truth: bool,
    /// A picture of the landing is drawn there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plot: Option<PathBuf>,
    /// Who flies the drone.
    pub autopilot: AutopilotKind,
    /// The plant of a firmware.
    pub firmware: FirmwareConfig,
    /// How the autopilot's odometry is made smooth.
    pub odometry: OdometryConfig,
    /// What is simulated.
    pub scenario: Scenario,
}

#[cfg(feature = "lab")]
impl Check for SimulatedWorld {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.firmware.check(&at.table("firmware"))?;
        self.odometry.check(&at.table("odometry"))?;
        self.scenario.check(&at.table("scenario"))
    }
}

#[cfg(all(test, feature = "lab"))]
mod tests {
    use super::*;

    #[test]
    fn computer_configurations_round_trip_through_toml() {
        let text = toml::to_string(&VesselComputer::default()).unwrap();
        assert_eq!(
            config::parse::<VesselComputer>(&text, "vessel").unwrap(),
            VesselComputer::default()
        );
        let text = toml::to_string(&DroneComputer::default()).unwrap();
        assert_eq!(
            config::parse::<DroneComputer>(&text, "drone").unwrap(),
            DroneComputer::default()
        );
        let text = toml::to_string(&SimulatedWorld::default()).unwrap();
        assert_eq!(
            config::parse::<SimulatedWorld>(&text, "world").unwrap(),
            SimulatedWorld::default()
        );
    }

    #[test]
    fn configuration_refuses_a_radio_that_neither_listens_nor_connects() {
        let config = DroneComputer {
            radio: RadioConfig::default(),
            ..DroneComputer::default()
        };
        let e = config.check(&Keys::ROOT).unwrap_err().to_string();
        assert!(e.contains("radio.listen, connect"), "{e}");
    }
}
