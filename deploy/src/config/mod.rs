//! One configuration file per computer: the vessel's and the drone's.

pub mod camera;
pub mod supervision;

use alight_bridge::BridgeConfig;
use alight_shared::config;
use alight_shared::transport::clock::ProcessClock;
use alight_shared::transport::radio::{RadioConfig, TlsConfig};
use alight_uav::autopilot::AutopilotLinkConfig;
use alight_uav::settings::DroneSettings;
use alight_usv::sensors::SourcesConfig;
use alight_usv::{DeckConfig, VesselNodeConfig};

use crate::config::camera::{CameraSource, UltravioletSource};
use crate::config::supervision::Supervision;

config! {
    /// The vessel's computer.
    pub struct VesselComputer {
        /// Number of this vessel.
        pub vessel_id: u32 = 1;
        /// Address that takes the sensors' datagrams.
        /// Source: Ours.
        pub sensors: String = "127.0.0.1:7440".into();
        /// Its real sensors; where there are some, the vessel's process starts `alight sensors`.
        pub sensor: SourcesConfig;
        /// Its clock.
        pub clock: ProcessClock;
        /// Its radio; it listens.
        /// Source: Zenoh's usual port.
        pub radio: RadioConfig = RadioConfig::listening("udp/0.0.0.0:7447", TlsConfig::default()), table;
        /// How the deck is reserved for drones.
        pub deck: DeckConfig;
        /// Its node.
        pub vessel: VesselNodeConfig;
    }
}

impl VesselComputer {
    /// Its nodes, for a start with this boot id.
    pub fn node(&self, boot: u32) -> alight_usv::VesselComputer {
        alight_usv::VesselComputer::new(&self.vessel, &self.deck, self.vessel_id, boot)
    }
    /// Its real sensors, each in its place on board.
    pub fn placed_sensors(&self) -> SourcesConfig {
        self.sensor.placed(&self.vessel.imu, &self.vessel.gnss)
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

config! {
    /// The drone's computer. Its own number and its vessel's are the bridge's.
    pub struct DroneComputer {
        /// Name of the set of processes that share memory.
        pub instance: String = "drone".into();
        /// Its clock.
        pub clock: ProcessClock;
        /// Its radio; it connects.
        /// Source: Ours, the vessel's address on its own network.
        pub radio: RadioConfig = RadioConfig::dialling("udp/192.168.7.1:7447", TlsConfig::default()), table;
        /// Its link to a real autopilot.
        pub autopilot: AutopilotLinkConfig;
        /// Its bridge.
        pub bridge: BridgeConfig;
        /// Source of its camera's images.
        pub camera: CameraSource;
        /// Source of its ultraviolet camera's images.
        pub uvdar: UltravioletSource;
        /// How its processes are run.
        pub supervision: Supervision;
        /// Its other nodes.
        pub drone: DroneSettings;
    }
}

impl DroneComputer {
    /// Where the ultraviolet camera's images come from, at the rate of the markers' bits.
    pub fn ultraviolet(&self) -> CameraSource {
        self.uvdar.at_rate(self.drone.camera.uvdar.rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::config::{Check, Keys, commented};

    #[test]
    fn computer_configurations_round_trip_through_toml() {
        let text = commented(&VesselComputer::default()).unwrap();
        assert_eq!(
            config::parse::<VesselComputer>(&text, "vessel").unwrap(),
            VesselComputer::default()
        );
        let text = commented(&DroneComputer::default()).unwrap();
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
