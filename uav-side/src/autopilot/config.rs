//! Parameters of the link to the autopilot, and permissions.

use alight_shared::config;
use serde::{Deserialize, Serialize};

use super::message::COMPANION_COMPONENT;

/// Action when the battery reaches the reserve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Diversion {
    /// Nothing: the autopilot's own low-battery failsafe rules.
    None,
    /// The autopilot's return mode.
    #[default]
    Return,
    /// The autopilot lands where it is.
    Land,
}

/// In what message the deck is sent to PX4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeckMessage {
    #[default]
    LandingTarget,
    /// `TARGET_RELATIVE` and `TARGET_ABSOLUTE`.
    Target,
}

config! {
    /// The link to the autopilot.
    pub struct AutopilotLinkConfig {
        /// Address of the autopilot: udpin, udpout, tcpout, tcpin or serial, as MAVSDK writes them. One that listens
        /// beyond this computer names the autopilot's address: `udpin://0.0.0.0:14540?from=192.168.7.20`.
        /// Source: PX4's onboard API link.
        pub connect: String = "udpin://127.0.0.1:14540".into();
        /// File with the key of MAVLink 2 signing: a passphrase, of which the key is the SHA-256 as in Mission Planner,
        /// MAVProxy and QGroundControl, or 64 hexadecimal digits. With it every frame is signed, and only those are
        /// taken that the same key signed. Empty: none is signed, and none is checked.
        pub signing_key: String = String::new();
        /// Orders and parameters of ground stations count although no `signing_key` is set: of whoever reaches the link. Without,
        /// an abort alone does.
        pub unsigned_orders: bool = false;
        /// System number of the autopilot; 0: the first one whose heartbeat is received, and nothing is begun while those of two
        /// vehicles are.
        pub vehicle: u8 = 0;
        /// System number of what reports the vessel's place over this link (`GLOBAL_POSITION_INT`, `FOLLOW_TARGET`), for
        /// `drone.mission.least_vessel = "beacon"` or "tag"; 0: nothing does.
        pub beacon_system: u8 = 0;
        /// MMSI of the vessel, whose AIS reports are a beacon, too: `AIS_VESSEL` over this link (ArduPilot with an AIS receiver),
        /// or sentences of `ais`; 0: none.
        pub beacon_mmsi: u32 = 0, in 0.0..=999_999_999.0;
        /// Address of a receiver's AIS sentences (NMEA 0183 `!AIVDM`), written as `connect`; empty: none.
        pub ais: String = String::new();
        /// Address of the drone's own GNSS receiver whose moving base is the vessel's, written as `connect`: it is sent her RTCM, and
        /// its NAV-RELPOSNED (u-blox) is read; empty: the autopilot is sent the RTCM.
        pub receiver: String = String::new();
        /// Smallest delay from a measurement of that receiver to its arrival, s: of its data sheet.
        pub receiver_latency_s: f64 = 0.0, in 0.0..=0.5;
        /// Our system number; 0: the vehicle's, as a companion computer has it.
        /// Source: MAVLink's convention for companions.
        pub system: u8 = 0;
        /// Our component number.
        pub component: u8 = COMPANION_COMPONENT;
        /// Rate requested of odometry, attitude and inertial samples, Hz.
        /// Source: what predictor and pilot are designed for.
        pub odometry_hz: f64 = 100.0, in 20.0..=500.0;
        /// Rate requested of ArduCopter's heartbeats, Hz: a change of mode is known within their period. (PX4
        /// keeps to 1 Hz, and reports a change of mode in `CURRENT_MODE`.)
        /// Chosen: takeover within 100 ms.
        pub heartbeat_hz: f64 = 20.0, in 1.0..=50.0;
        /// Rate requested of the rangefinder, Hz.
        /// Source: `topics::RANGE`.
        pub range_hz: f64 = 50.0, in 1.0..=200.0;
        /// Greatest rate of set-points, Hz.
        /// Source: `topics::SET_POINT`; 50 at least is flown.
        pub set_point_hz: f64 = 100.0, in 50.0..=400.0;
        /// Without a heartbeat for this long the link is lost, s.
        /// Chosen: one of the usual 1 Hz may be missed in part.
        pub heartbeat_loss_s: f64 = 1.5, in 0.2..=10.0;
        /// Without an inertial sample or odometry for this long no set-points are sent, s.
        /// Source: `topics::DRONE_STATE`.
        pub odometry_loss_s: f64 = 0.2, in 0.05..=2.0;
        /// After a person took over no set-points are streamed for this long, s.
        pub takeover_pause_s: f64 = 2.0, in 0.5..=60.0;
        /// Rate of TIMESYNC requests, Hz.
        pub timesync_hz: f64 = 5.0, in 0.5..=50.0;
        /// TIMESYNC answers with a longer round trip are not used, s.
        /// Chosen: 0.06 s each way is still flown (tests/tests/flights/link/landings.rs).
        pub timesync_limit_s: f64 = 0.25, in 0.002..=1.0;
        /// Body rates go with attitude set-points. PX4 drops them; ArduCopter 4.6 and 4.7 turn them by the
        /// attitude once too often, so that at a heading of 180 deg they work against it.
        /// Measured: with ArduCopter 4.7 0 of 2 landed with them.
        pub send_rates: bool = false;
        /// Fraction of the square in the autopilot's thrust curve `T = f u² + (1 - f) u` that it does not
        /// compensate itself (PX4: THR_MDL_FAC is its own correction, then 0).
        /// Source: The autopilot's own correction.
        pub thrust_curve: f64 = 0.0, in 0.0..=1.0;
        /// Hover thrust before it is identified, as the autopilot commands it, 0 to 1.
        pub hover_thrust: f64 = 0.4, in 0.05..=0.9;
        /// Time constant of the hover thrust's estimate, s.
        /// Chosen: settles as PX4's hover thrust estimator does.
        pub hover_thrust_s: f64 = 2.0, in 0.1..=100.0;
        /// Standard deviations where the autopilot reports none: position (m), velocity (m/s), attitude
        /// (rad).
        pub odometry_sd: [f64; 3] = [0.3, 0.1, 0.02], in 1e-4..=10.0;
        /// Standard deviation of the rangefinder where the autopilot reports none, m.
        pub range_sd_m: f64 = 0.02, in 0.001..=1.0;
        /// No landing before the autopilot's parameters that it relies on were read and suit. Without: what does not
        /// suit is reported only.
        pub check_parameters: bool = true;
        /// The deck is sent to the autopilot as its home (`MAV_CMD_DO_SET_HOME`) when it has moved, so that a return
        /// of its own leads to the vessel and not to where she was. It has to end in a hover there (RTL_LAND_DELAY,
        /// RTL_ALT_FINAL).
        pub send_home: bool = false;
        /// An order to land may arm a drone that stands on the ground in the mode that a person gave, more than 20 m from a deck
        /// whose place is known. On the deck nothing but a take-off arms, which the crew clears.
        pub may_arm: bool = false;
        /// Channel of the remote control whose switch commands, by its change: low aborts, and held there rejects every
        /// order to begin; the middle does nothing, high lands; 0: none. The receiver's failsafe must leave it in the middle, or send nothing.
        pub rc_switch: u8 = 0, in 0.0..=18.0;
        /// The forced disarm on the deck.
        pub disarm: DisarmConfig;
        /// The battery's last reserve.
        pub battery: BatteryConfig;
        /// Side of the tag reported in `LANDING_TARGET`, m.
        /// Source: The paper's.
        pub deck_tag_m: f64 = 1.0;
        /// `LANDING_TARGET` and the estimated deck are sent to other users of the link.
        pub publish_deck: bool = false;
        /// In what PX4 is sent the deck: "landing-target" (LANDING_TARGET), or "target" (TARGET_RELATIVE and TARGET_ABSOLUTE,
        /// for one that is built with its vision target estimator and MAVLink's development dialect, 1.18 and later).
        pub deck_message: DeckMessage = DeckMessage::LandingTarget;
    }
    check |this, at| {
        at.require(this.component > 0, "component", this.component, "1 to 255")?;
        at.require(
            this.publish_deck || !this.disarm.own_landing,
            "disarm.own_landing",
            this.disarm.own_landing,
            "false without publish_deck: the autopilot would land without the deck",
        )?;
    }
}

impl AutopilotLinkConfig {
    /// Orders of ground stations count, other than an abort, which always does.
    pub fn takes_orders(&self) -> bool {
        self.unsigned_orders || !self.signing_key.is_empty()
    }
}

config! {
    /// When the forced disarm (`MAV_CMD_COMPONENT_ARM_DISARM`, 21196) may be sent. All must hold at once,
    /// for `hold_s`, in addition to the pilot's confirmed touchdown.
    ///
    /// Chosen: the pilot has pressed at half of hover or less when it confirms.
    #[derive(Copy)]
    pub struct DisarmConfig {
        /// Disarm on the deck.
        pub on_deck: bool = true;
        /// Disarm also where the autopilot has landed by itself on the deck that `publish_deck` sends: by the same evidence,
        /// for a second.
        pub own_landing: bool = false;
        /// Greatest height of the feet above the deck, by rangefinder or forecast, m.
        pub height_m: f64 = 0.35, in 0.02..=1.0;
        /// Greatest speed relative to the deck (without a forecast: over ground), m/s.
        pub speed_mps: f64 = 1.5, in 0.1..=5.0;
        /// Minimum specific force as a fraction of gravity: it is less in a fall.
        pub min_load_factor: f64 = 0.75, in 0.5..=1.0;
        /// Greatest thrust as a fraction of hover: flight needs more.
        pub max_thrust_of_hover: f64 = 0.7, in 0.1..=0.9;
        /// Time for which all evidence must hold, s.
        pub hold_s: f64 = 0.02, in 0.0..=1.0;
        /// Without the evidence for this long the drone climbs a little and holds, s.
        pub evidence_timeout_s: f64 = 0.3, in 0.05..=2.0;
        /// Commands in quick succession; then one each 2 s, as long as the drone stands there armed.
        pub tries: u32 = 10, in 1.0..=100.0;
        /// Time between two of those, s.
        pub pause_s: f64 = 0.2, in 0.05..=5.0;
    }
}

config! {
    /// The battery's last reserve, for a drone whose mission has chosen no place before (`drone.mission.battery_order`): it acts no
    /// sooner than a mission that runs has counted the charge (`drone.mission.battery_lasts_s`).
    #[derive(Copy)]
    pub struct BatteryConfig {
        /// Remaining charge below which the drone is diverted, unless the mission lands it on the deck, 0 to 1.
        pub reserve: f64 = 0.1, in 0.0..=0.9;
        /// Time for which the charge must be below, s.
        pub for_s: f64 = 3.0, in 0.1..=60.0;
        /// Command to the autopilot.
        pub diversion: Diversion = Diversion::Return;
        /// Greatest number of commands.
        pub tries: u32 = 3, in 1.0..=20.0;
    }
}
