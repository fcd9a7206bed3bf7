//! Parameters and permissions of the autopilot link.

use alight_shared::config;
use serde::{Deserialize, Serialize};

use super::message::COMPANION_COMPONENT;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Diversion {
    /// No command; the autopilot's own low-battery failsafe applies.
    None,
    #[default]
    Return,
    Land,
}

/// Message that carries the deck's position to PX4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeckMessage {
    #[default]
    LandingTarget,
    Target,
}

config! {
    pub struct AutopilotLinkConfig {
        /// Address of the autopilot: udpin, udpout, tcpout, tcpin or serial, in MAVSDK's notation. A socket
        /// that accepts other computers must name the autopilot's address:
        /// `udpin://0.0.0.0:14540?from=192.168.7.20`.
        /// Source: PX4's onboard API link.
        pub connect: String = "udpin://127.0.0.1:14540".into();
        /// File with the MAVLink 2 signing key: a passphrase, whose SHA-256 is the key as in Mission Planner,
        /// MAVProxy and QGroundControl, or 64 hexadecimal digits. With a key every frame is signed, and
        /// frames without its signature are dropped. Empty: no signing and no check.
        pub signing_key: String = String::new();
        /// Accept orders and parameters from ground stations without a `signing_key`, from every sender on
        /// the link. If false, an unsigned link accepts only an abort.
        pub unsigned_orders: bool = false;
        /// System number of the autopilot; 0: the first one received. With 0 no flight begins while
        /// heartbeats of two vehicles arrive.
        pub vehicle: u8 = 0;
        /// System number of the beacon that reports the vessel's position over this link (`GLOBAL_POSITION_INT`,
        /// `FOLLOW_TARGET`), for `drone.mission.min_vessel = "beacon"` or "tag"; 0: none.
        pub beacon_system: u8 = 0;
        /// MMSI of the vessel whose AIS reports serve as a beacon: `AIS_VESSEL` over this link (ArduPilot with an AIS
        /// receiver), or sentences of `ais`; 0: none.
        pub beacon_mmsi: u32 = 0, in 0.0..=999_999_999.0;
        /// Address of an AIS receiver (NMEA 0183 `!AIVDM`), in the notation of `connect`; empty: none.
        pub ais: String = String::new();
        /// Address of the drone's own GNSS receiver, which uses the vessel's receiver as moving base, in the
        /// notation of `connect`. It is sent the vessel's RTCM and returns NAV-RELPOSNED (u-blox). Empty: the
        /// RTCM goes to the autopilot.
        pub receiver: String = String::new();
        /// Minimum delay between that receiver's measurement and its arrival, s, from the data sheet.
        pub receiver_latency_s: f64 = 0.0, in 0.0..=0.5;
        /// Our system number; 0: the vehicle's, as for a companion computer.
        /// Source: MAVLink's convention for companions.
        pub system: u8 = 0;
        /// Our component number.
        pub component: u8 = COMPANION_COMPONENT;
        /// Requested rate of odometry, attitude and inertial samples, Hz.
        /// Source: design rate of predictor and pilot.
        pub odometry_hz: f64 = 100.0, in 20.0..=500.0;
        /// Requested rate of ArduCopter's heartbeats, Hz; a mode change is known within one period. (PX4
        /// always sends 1 Hz and reports mode changes in `CURRENT_MODE`.)
        /// Chosen: takeover within 100 ms.
        pub heartbeat_hz: f64 = 20.0, in 1.0..=50.0;
        /// Requested rate of the rangefinder, Hz.
        /// Source: `topics::RANGE`.
        pub range_hz: f64 = 50.0, in 1.0..=200.0;
        /// Maximum rate of set-points, Hz.
        /// Source: `topics::SET_POINT`; 50 Hz is tested in flight.
        pub set_point_hz: f64 = 100.0, in 50.0..=400.0;
        /// Time without a heartbeat after which the link is lost, s.
        /// Chosen: tolerates a delay of half a period at the usual 1 Hz.
        pub heartbeat_loss_s: f64 = 1.5, in 0.2..=10.0;
        /// Time without an inertial sample or odometry after which set-points stop, s.
        /// Source: `topics::DRONE_STATE`.
        pub odometry_loss_s: f64 = 0.2, in 0.05..=2.0;
        /// Rate of TIMESYNC requests, Hz.
        pub timesync_hz: f64 = 5.0, in 0.5..=50.0;
        /// Maximum round trip of a TIMESYNC answer, s.
        /// Chosen: landings still succeed with 0.06 s each way (tests/tests/flights/link/landings.rs).
        pub timesync_limit_s: f64 = 0.25, in 0.002..=1.0;
        /// Send body rates with attitude set-points. PX4 ignores them. ArduCopter 4.6 and 4.7 rotate them by
        /// the attitude one time too many, so at a heading of 180 deg they oppose the commanded attitude.
        /// Measured: with ArduCopter 4.7 and body rates sent, 0 of 2 flights landed.
        pub send_rates: bool = false;
        /// Quadratic fraction f of the autopilot's thrust curve `T = f u² + (1 - f) u`; 0 if the autopilot
        /// compensates it (PX4 with THR_MDL_FAC).
        /// Source: The autopilot's own correction.
        pub thrust_curve: f64 = 0.0, in 0.0..=1.0;
        /// Initial hover thrust until it is identified, as an autopilot command, 0 to 1.
        pub hover_thrust: f64 = 0.4, in 0.05..=0.9;
        /// Time constant of the hover-thrust estimate, s.
        /// Chosen: that of PX4's hover thrust estimator.
        pub hover_thrust_s: f64 = 2.0, in 0.1..=100.0;
        /// Standard deviations used when the autopilot reports none: position (m), velocity (m/s), attitude
        /// (rad).
        pub odometry_sd: [f64; 3] = [0.3, 0.1, 0.02], in 1e-4..=10.0;
        /// Standard deviation of the rangefinder used when the autopilot reports none, m.
        pub range_sd_m: f64 = 0.02, in 0.001..=1.0;
        /// Require suitable autopilot parameters for a landing. If false, unsuitable ones are only reported.
        pub check_parameters: bool = true;
        /// Send the deck's position to the autopilot as its home (`MAV_CMD_DO_SET_HOME`) whenever the deck
        /// has moved, so that return mode flies to the vessel's current position. The return must end in a
        /// hover there (RTL_LAND_DELAY, RTL_ALT_FINAL).
        pub send_home: bool = false;
        /// Let an order to land arm a drone that is on the ground, in the mode chosen by the pilot, more than
        /// 20 m from a deck of known position. On the deck only a cleared take-off arms the drone.
        pub may_arm: bool = false;
        /// Remote control channel of the command switch. A change to low aborts and blocks other orders; to
        /// middle does nothing; to high lands. 0: no switch. The receiver's failsafe must select middle or no
        /// output.
        pub rc_switch: u8 = 0, in 0.0..=18.0;
        /// Forced disarm on the deck.
        pub disarm: DisarmConfig;
        /// Final battery reserve.
        pub battery: BatteryConfig;
        /// Side of the tag as reported in `LANDING_TARGET`, m.
        /// Source: The paper's tag.
        pub deck_tag_m: f64 = 1.0;
        /// Send `LANDING_TARGET` and the estimated deck to other systems on the link.
        pub publish_deck: bool = false;
        /// Message that carries the deck to PX4: "landing-target" (LANDING_TARGET), or "target"
        /// (TARGET_RELATIVE and TARGET_ABSOLUTE, for PX4 1.18 or later with its vision target estimator and
        /// the development dialect).
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
    pub fn takes_orders(&self) -> bool {
        self.unsigned_orders || !self.signing_key.is_empty()
    }
}

config! {
    /// Evidence for the forced disarm (`MAV_CMD_COMPONENT_ARM_DISARM`, 21196) after the pilot's confirmed
    /// touchdown. All conditions must hold simultaneously for `hold_s`.
    ///
    /// Chosen: at that touchdown the pilot commands half of hover or less.
    #[derive(Copy)]
    pub struct DisarmConfig {
        /// Force a disarm on the deck.
        pub on_deck: bool = true;
        /// Also disarm after the autopilot's own landing on the deck that `publish_deck` sends, on the same
        /// evidence held for a second.
        pub own_landing: bool = false;
        /// Maximum height of the feet above the deck, by rangefinder or forecast, m.
        pub height_m: f64 = 0.35, in 0.02..=1.0;
        /// Maximum speed relative to the deck, m/s. Without a forecast the drone must stand: gravity at little thrust,
        /// no rotation.
        pub speed_mps: f64 = 1.5, in 0.1..=5.0;
        /// Minimum specific force as a fraction of gravity; a falling drone has less.
        pub min_load_factor: f64 = 0.75, in 0.5..=1.0;
        /// Maximum thrust as a fraction of hover; flight needs more.
        pub max_thrust_of_hover: f64 = 0.7, in 0.1..=0.9;
        /// Time for which all evidence must hold, s.
        pub hold_s: f64 = 0.02, in 0.0..=1.0;
        /// Time without evidence after which the drone climbs a little and holds, s.
        pub evidence_timeout_s: f64 = 0.3, in 0.05..=2.0;
        /// Number of commands in the quick series; afterwards one every 2 s while the drone is armed on the
        /// deck.
        pub tries: u32 = 10, in 1.0..=100.0;
        /// Time between commands of the quick series, s.
        pub pause_s: f64 = 0.2, in 0.05..=5.0;
    }
}

config! {
    /// Final battery reserve, for a drone whose mission has no landing place yet
    /// (`drone.mission.battery_order`). A running mission confirms the charge first
    /// (`drone.mission.battery_lasts_s`).
    #[derive(Copy)]
    pub struct BatteryConfig {
        /// Remaining charge below which the drone is diverted, unless the mission lands it on the deck, 0 to 1.
        pub reserve: f64 = 0.1, in 0.0..=0.9;
        /// Time that the charge must stay below the reserve, s.
        pub for_s: f64 = 3.0, in 0.1..=60.0;
        /// Command sent to the autopilot at the reserve.
        pub diversion: Diversion = Diversion::Return;
        /// Maximum number of commands.
        pub tries: u32 = 3, in 1.0..=20.0;
    }
}
