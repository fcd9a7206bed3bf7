//! Configuration files of the vessel's and the drone's computer.

pub mod camera;
pub mod link_url;
pub mod method;
pub mod recorder;
pub mod supervision;
pub mod view;

use alight_bridge::BridgeConfig;
use alight_shared::{admission::Sender, config, process::ProcessKind, wire::MAX_RECORD_BYTES};
use alight_transport::{
    clock::ProcessClock,
    radio::{RadioConfig, TlsConfig},
};
use alight_uav::{
    autopilot::AutopilotLinkConfig,
    camera::motion_blur::longest_exposure_s,
    computer::{self, DroneNodes},
    settings::DroneSettings,
};
use alight_usv::{DeckConfig, VesselNodeConfig, computer::VesselNodes, sensors::SourcesConfig};

use crate::config::{
    camera::{CameraSource, UltravioletSource},
    link_url::LinkUrl,
    recorder::RecorderConfig,
    supervision::Supervision,
    view::ViewConfig,
};

const OF_DRONE: &str = "this is a drone's file: name the vessel's here, and this one as --drone-config or by alight drone --config";
const OF_VESSEL: &str = "this is a vessel's file: name the drone's here, and this one as --vessel-config or by alight vessel --config";

config! {
    /// The crew's limits of the deck's motion in the last 20 minutes. Beyond one of them the vessel says NO-GO.
    /// Source: helidecks have such limits (CAP 437); unlimited until the crew sets them.
    pub struct DeckLimits {
        /// Greatest roll, deg.
        pub roll_deg: f64 = 90.0, in 0.0..=90.0;
        /// Greatest pitch, deg.
        pub pitch_deg: f64 = 90.0, in 0.0..=90.0;
        /// Greatest inclination, deg.
        pub inclination_deg: f64 = 90.0, in 0.0..=90.0;
        /// Greatest significant heave rate, m/s.
        pub heave_rate_mps: f64 = 10.0, in 0.0..=10.0;
    }
}

config! {
    /// Configuration of the vessel's computer.
    pub struct VesselComputerConfig {
        /// Number of this vessel.
        pub vessel_id: u32 = 1;
        /// Name of the set of processes that share memory.
        pub instance: String = "vessel".into();
        /// Real sensors.
        pub sensor: SourcesConfig;
        /// Clock of the processes.
        pub clock: ProcessClock;
        /// Radio; the vessel listens.
        /// Source: Zenoh's usual port.
        pub radio: RadioConfig = RadioConfig::listening("udp/0.0.0.0:7447", TlsConfig::default()), table;
        /// Reservation of the deck by drones.
        pub deck: DeckConfig;
        /// Limits of the deck's motion.
        pub limits: DeckLimits;
        /// Directory and size of the recorded flights.
        pub recorder: RecorderConfig;
        /// View in a browser.
        pub view: ViewConfig;
        /// Nodes of the vessel.
        pub vessel: VesselNodeConfig;
    }
    former &[
        (
            "vessel.helm",
            "the computer no longer steers the boat: the skipper steers by its advice (alight help operate); \
             move heading_change_deg, \
             speed_mps and keep_out_deg to [vessel.advice] and remove the rest",
        ),
        ("autopilot", OF_DRONE),
        ("bridge", OF_DRONE),
    ];
}

impl VesselComputerConfig {
    /// Processes in data-flow order; the sensors' process only if sensors are configured.
    pub fn processes(&self) -> Vec<ProcessKind> {
        let absent = self.sensor.sources.is_empty().then_some(ProcessKind::Sensors);
        let all = alight_usv::computer::PROCESSES.iter().copied();
        all.filter(|kind| Some(*kind) != absent).collect()
    }
    pub fn nodes(&self) -> VesselNodes {
        let admitted = |peer: &String| match Sender::of_key(&format!("alight/{peer}")) {
            Sender::Drone(n) => Some(n),
            Sender::Vessel(_) | Sender::Operator(_) | Sender::Unknown => None,
        };
        VesselNodes {
            id: self.vessel_id,
            sensors: self.placed_sensors(),
            vessel: self.vessel.clone(),
            deck: self.deck.clone(),
            drones: self.radio.tls.peers.iter().filter_map(admitted).collect(),
        }
    }
    pub fn placed_sensors(&self) -> SourcesConfig {
        self.sensor.placed(&self.vessel.imu, &self.vessel.gnss)
    }
}

config! {
    /// Configuration file of a drone's nodes: `[bridge]` and `[drone.*]`.
    pub struct DroneFile {
        /// Bridge to the vessel's radio.
        pub bridge: BridgeConfig;
        /// Predictor, mission, planner and pilot, with their parameters of drone and deck.
        pub drone: DroneSettings;
    }
}

config! {
    /// Configuration of the drone's computer. `[bridge]` has the numbers of drone and vessel.
    pub struct DroneComputerConfig {
        /// Name of the set of processes that share memory.
        pub instance: String = "drone".into();
        /// Clock of the processes.
        pub clock: ProcessClock;
        /// Radio; the drone connects.
        /// Source: Ours, the vessel's address on its own network.
        pub radio: RadioConfig = RadioConfig::dialling("udp/192.168.7.1:7447", TlsConfig::default()), table;
        /// Link to a real autopilot.
        pub autopilot: AutopilotLinkConfig;
        /// Bridge to the vessel's radio.
        pub bridge: BridgeConfig;
        /// Image source of the belly camera.
        pub camera: CameraSource;
        /// Image source of the ultraviolet camera.
        pub uvdar: UltravioletSource;
        /// Supervision of the processes.
        pub supervision: Supervision;
        /// Directory and size of the recorded flights.
        pub recorder: RecorderConfig;
        /// View in a browser and in Foxglove.
        pub view: ViewConfig;
        /// Other nodes.
        pub drone: DroneSettings;
    }
    former &[("sensor", OF_VESSEL), ("deck", OF_VESSEL), ("vessel", OF_VESSEL)];
    check |this, at| {
        if this.supervision.autopilot && let Err(why) = LinkUrl::of_autopilot(&this.autopilot.connect) {
            at.table("autopilot").require(false, "connect", &this.autopilot.connect, &why)?;
        }
        if !this.autopilot.ais.is_empty() && let Err(why) = LinkUrl::of_sentences(&this.autopilot.ais) {
            at.table("autopilot").require(false, "ais", &this.autopilot.ais, &why)?;
        }
        let receiver = &this.autopilot.receiver;
        if !receiver.is_empty() && let Err(why) = LinkUrl::of_receiver(receiver) {
            at.table("autopilot").require(false, "receiver", receiver, &why)?;
        }
        let own = &this.drone;
        let (lens, uv) = (&own.camera.lens, &own.camera.uvdar.lens);
        let pixels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
        let largest = pixels([lens.width_px, lens.height_px]).max(pixels([uv.width_px, uv.height_px]));
        // A step has at most two images.
        at.table("recorder").require(
            !this.recorder.images || 2 * largest + 200 <= MAX_RECORD_BYTES as u64,
            "images",
            this.recorder.images,
            &format!("false: an image of {largest} px is too large for a recording"),
        )?;
        let [fx, fy] = own.camera.lens.focal_px;
        let longest_s = longest_exposure_s(
            fx.max(fy),
            own.deck.largest_tag_m(),
            own.mission.tracking_height_m,
            own.planner.limits.rates_rps,
        );
        if this.camera.is_there() && !this.camera.is_simulation() {
            let longest_s = (1e4 * longest_s).floor() / 1e4;
            at.table("camera").range("exposure_s", this.camera.exposure_s, 0.0, longest_s)?;
        }
    }
}

impl DroneComputerConfig {
    pub fn nodes(&self) -> DroneNodes {
        DroneNodes {
            bridge: self.bridge.clone(),
            autopilot: self.autopilot.clone(),
            drone: self.drone.clone(),
        }
    }
    /// Processes in data-flow order; a device's process only if the device is configured.
    pub fn processes(&self) -> Vec<ProcessKind> {
        let of_devices = [
            (ProcessKind::Autopilot, self.supervision.autopilot),
            (ProcessKind::Camera, self.camera.is_there()),
            (ProcessKind::Uvdar, self.ultraviolet().is_there()),
        ];
        let is_absent = |kind| of_devices.contains(&(kind, false));
        let all = computer::PROCESSES.iter().copied();
        all.filter(|kind| !is_absent(*kind)).collect()
    }
    pub fn ultraviolet(&self) -> CameraSource {
        self.uvdar.at_rate(self.drone.camera.uvdar.rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::config::{Check, Keys, commented};

    #[test]
    fn computer_configuration_toml_round_trip() {
        let text = commented(&VesselComputerConfig::default()).unwrap();
        assert_eq!(
            config::parse::<VesselComputerConfig>(&text, "vessel").unwrap(),
            VesselComputerConfig::default()
        );
        let text = commented(&DroneComputerConfig::default()).unwrap();
        assert_eq!(
            config::parse::<DroneComputerConfig>(&text, "drone").unwrap(),
            DroneComputerConfig::default()
        );
    }

    #[test]
    fn exposure_beyond_motion_blur_limit() {
        let check = |exposure_s: f64, focal: f64| {
            let mut config = DroneComputerConfig::default();
            config.camera.source = "/dev/video0".into();
            config.camera.exposure_s = exposure_s;
            config.drone.camera.lens.focal_px = [focal; 2];
            config.drone.deck.tag_side_m = Some(1.0);
            config.check(&Keys::ROOT).map_err(|e| e.to_string())
        };
        assert_eq!(check(0.017, 320.0), Ok(()));
        let e = check(0.018, 320.0).unwrap_err();
        assert!(e.contains("`camera.exposure_s` is 0.018"), "{e}");
        // Every common lens permits the default exposure.
        assert!(
            [200.0, 600.0, 1500.0, 4000.0]
                .iter()
                .all(|focal| check(0.004, *focal).is_ok())
        );
    }

    #[test]
    fn file_of_the_other_side() {
        let vessel = config::parse::<VesselComputerConfig>("[bridge]", "").unwrap_err();
        assert!(vessel.to_string().ends_with(OF_DRONE), "{vessel}");
        let drone = config::parse::<DroneComputerConfig>("[sensor]", "").unwrap_err();
        assert!(drone.to_string().ends_with(OF_VESSEL), "{drone}");
    }

    #[test]
    fn autopilot_address_of_a_former_version() {
        let check = |connect: &str, autopilot| {
            let mut config = DroneComputerConfig::default();
            config.autopilot.connect = connect.into();
            config.supervision.autopilot = autopilot;
            config.check(&Keys::ROOT).map_err(|e| e.to_string())
        };
        let e = check("udpin://0.0.0.0:14540", true).unwrap_err();
        assert!(e.contains("`autopilot.connect` is udpin://0.0.0.0:14540"), "{e}");
        assert!(
            e.contains("udpin://127.0.0.1:PORT") && e.contains("?from=IP"),
            "{e}"
        );
        assert_eq!(check("udpin://127.0.0.1:14540", true), Ok(()));
        // Another program owns the link.
        assert_eq!(check("udpin://0.0.0.0:14540", false), Ok(()));
    }

    #[test]
    fn radio_without_endpoints() {
        let config = DroneComputerConfig {
            radio: RadioConfig::default(),
            ..DroneComputerConfig::default()
        };
        let e = config.check(&Keys::ROOT).unwrap_err().to_string();
        assert!(e.contains("radio.listen, connect"), "{e}");
    }
}
