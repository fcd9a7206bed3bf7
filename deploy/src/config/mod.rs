//! One configuration file per computer: the vessel's and the drone's.

pub mod camera;
pub mod supervision;

use alight_bridge::BridgeConfig;
use alight_shared::config;
use alight_shared::config::{Check, ConfigError, Keys};
use alight_shared::transport::clock::ProcessClock;
use alight_shared::transport::radio::RadioConfig;
use alight_uav::autopilot::AutopilotLinkConfig;
use alight_uav::settings::DroneSettings;
use alight_usv::sensors::SourcesConfig;
use alight_usv::{DeckConfig, VesselNodeConfig};
use serde::{Deserialize, Serialize};

use crate::config::camera::{CameraSource, UltravioletSource};
use crate::config::supervision::Supervision;

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
            deck: DeckConfig::default(),
            vessel: VesselNodeConfig::default(),
        }
    }
}

impl Check for VesselComputer {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.sensor.check(&at.table("sensor"))?;
        self.clock.check(&at.table("clock"))?;
        self.radio.check(&at.table("radio"))?;
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
}

impl Check for DroneComputer {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        self.clock.check(&at.table("clock"))?;
        self.radio.check(&at.table("radio"))?;
        self.autopilot.check(&at.table("autopilot"))?;
        self.bridge.check(&at.table("bridge"))?;
        self.camera.check(&at.table("camera"))?;
        self.uvdar.check(&at.table("uvdar"))?;
        self.supervision.check(&at.table("supervision"))?;
        self.drone.check(&at.table("drone"))
    }
}

#[cfg(test)]
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
