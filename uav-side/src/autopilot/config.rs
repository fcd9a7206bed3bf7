//! How Alight talks to the autopilot, and what it may do there.

use alight_shared::config::{Check, ConfigError, Keys};
use serde::{Deserialize, Serialize};

use super::message::COMPANION_COMPONENT;

/// What is done when the battery reaches the reserve.
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

/// The link to the autopilot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AutopilotLinkConfig {
    /// Where the autopilot is: udpin, udpout, tcpout, tcpin or serial, as MAVSDK writes them.
    pub connect: String,
    /// System that is listened to; 0: the first autopilot that is heard.
    pub vehicle: u8,
    /// Our system number; 0: the vehicle's, as a companion computer has it.
    pub system: u8,
    /// Our component number.
    pub component: u8,
    /// Odometry, attitude and inertial samples asked for, Hz.
    pub odometry_hz: f64,
    /// Heartbeats asked of ArduCopter, Hz: a change of mode is known within their period. (PX4 keeps to
    /// 1 Hz, and tells a change of mode in `CURRENT_MODE`.)
    pub heartbeat_hz: f64,
    /// Rangefinder asked for, Hz.
    pub range_hz: f64,
    /// Set-points sent at most, Hz.
    pub set_point_hz: f64,
    /// Without a heartbeat for this long the link is lost, s.
    pub heartbeat_loss_s: f64,
    /// Without an inertial sample or odometry for this long no set-points are sent, s.
    pub odometry_loss_s: f64,
    /// After a person took over nothing is offered for this long, s.
    pub quiet_s: f64,
    /// Questions about clocks, Hz.
    pub timesync_hz: f64,
    /// Answers to them that took longer are not used, s.
    pub timesync_limit_s: f64,
    /// Body rates go with attitude set-points. PX4 drops them; ArduCopter 4.6 and 4.7 turn them by the
    /// attitude once too often, so that at a heading of 180 deg they work against it.
    pub send_rates: bool,
    /// Share of the square in the autopilot's thrust curve `T = f u² + (1 - f) u` that it does not
    /// make up for itself (PX4: THR_MDL_FAC is its own correction, then 0).
    pub thrust_curve: f64,
    /// Hover thrust before it is known, the autopilot's measure, 0 to 1.
    pub hover_thrust: f64,
    /// Time constant of the hover thrust's estimate, s.
    pub hover_thrust_s: f64,
    /// Standard deviations where the autopilot tells none: position (m), velocity (m/s), attitude
    /// (rad).
    pub odometry_sd: [f64; 3],
    /// Standard deviation of the rangefinder where it tells none, m.
    pub range_sd_m: f64,
    /// Height of mean sea level above the ellipsoid (geoid) at this place, m: the autopilot tells its
    /// origin above the one, a datum is above the other.
    pub geoid_m: f64,
    /// Alight may arm a drone that stands on the ground in the mode that a person gave.
    pub may_arm: bool,
    /// The forced disarm on the deck.
    pub disarm: DisarmConfig,
    /// The battery's last reserve.
    pub battery: BatteryConfig,
    /// Side of the tag told in `LANDING_TARGET`, m.
    pub deck_tag_m: f64,
    /// `LANDING_TARGET` and the estimated deck are offered to other users of the link.
    pub offer_deck: bool,
}

impl Default for AutopilotLinkConfig {
    fn default() -> Self {
        AutopilotLinkConfig {
            connect: "udpin://0.0.0.0:14540".into(), // PX4's onboard API link
            vehicle: 0,                              // ours
            system: 0,                               // MAVLink's convention for companions
            component: COMPANION_COMPONENT,
            odometry_hz: 100.0,            // what predictor and pilot are laid out for
            heartbeat_hz: 20.0,            // ours: take-over within 100 ms
            range_hz: 50.0,                // topics::RANGE
            set_point_hz: 100.0,           // topics::SET_POINT; 50 at least is flown
            heartbeat_loss_s: 1.5,         // ours: one of the usual 1 Hz may be missed in part
            odometry_loss_s: 0.2,          // topics::DRONE_STATE
            quiet_s: 2.0,                  // ours
            timesync_hz: 5.0,              // ours
            timesync_limit_s: 0.25,        // ours: 0.06 s each way is still flown (tests/tests/mavlink.rs)
            send_rates: false,             // measured: with ArduCopter 4.7 0 of 2 landed with them
            thrust_curve: 0.0,             // the autopilot's own correction
            hover_thrust: 0.4,             // ours
            hover_thrust_s: 2.0,           // ours: settles as PX4's hover thrust estimator does
            odometry_sd: [0.3, 0.1, 0.02], // ours
            range_sd_m: 0.02,              // ours
            geoid_m: 0.0,                  // ours: of the place
            may_arm: false,                // issue
            disarm: DisarmConfig::default(),
            battery: BatteryConfig::default(),
            deck_tag_m: 1.0, // the paper's
            offer_deck: false,
        }
    }
}

/// When the forced disarm (`MAV_CMD_COMPONENT_ARM_DISARM`, 21196) may be sent. All must hold at once,
/// for `hold_s`, beside the pilot's confirmed touchdown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DisarmConfig {
    /// Disarm on the deck.
    pub on_deck: bool,
    /// Feet above the deck, by rangefinder or forecast, at most, m.
    pub height_m: f64,
    /// Speed relative to the deck (without a forecast: over ground), at most, m/s.
    pub speed_mps: f64,
    /// Least specific force as a share of gravity: what falls feels less.
    pub carried_of_g: f64,
    /// Greatest thrust as a share of hover: what flies needs more.
    pub thrust_of_hover: f64,
    /// All of it for this long, s.
    pub hold_s: f64,
    /// The evidence may be missing for this long, then the drone climbs a little and holds, s.
    pub patience_s: f64,
    /// Commands at most.
    pub tries: u32,
    /// Time between two, s.
    pub pause_s: f64,
}

impl Default for DisarmConfig {
    /// Ours. The pilot has pressed at half of hover or less when it confirms.
    fn default() -> Self {
        DisarmConfig {
            on_deck: true,
            height_m: 0.35,
            speed_mps: 1.5,
            carried_of_g: 0.75,
            thrust_of_hover: 0.7,
            hold_s: 0.02,
            patience_s: 0.3,
            tries: 10,
            pause_s: 0.2,
        }
    }
}

/// The battery's last reserve; the mission gives up landings before.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BatteryConfig {
    /// Remaining charge below which the drone is diverted, 0 to 1.
    pub reserve: f64,
    /// For this long, s.
    pub for_s: f64,
    /// Where to.
    pub diversion: Diversion,
    /// Commands at most.
    pub tries: u32,
}

impl Default for BatteryConfig {
    /// Ours.
    fn default() -> Self {
        BatteryConfig {
            reserve: 0.1,
            for_s: 3.0,
            diversion: Diversion::Return,
            tries: 3,
        }
    }
}

impl Check for AutopilotLinkConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.require(self.component > 0, "component", self.component, "1 to 255")?;
        for (key, v, low, high) in [
            ("odometry_hz", self.odometry_hz, 20.0, 500.0),
            ("heartbeat_hz", self.heartbeat_hz, 1.0, 50.0),
            ("range_hz", self.range_hz, 1.0, 200.0),
            ("set_point_hz", self.set_point_hz, 50.0, 400.0),
            ("heartbeat_loss_s", self.heartbeat_loss_s, 0.2, 10.0),
            ("odometry_loss_s", self.odometry_loss_s, 0.05, 2.0),
            ("quiet_s", self.quiet_s, 0.5, 60.0),
            ("timesync_hz", self.timesync_hz, 0.5, 50.0),
            ("timesync_limit_s", self.timesync_limit_s, 0.002, 1.0),
            ("thrust_curve", self.thrust_curve, 0.0, 1.0),
            ("hover_thrust", self.hover_thrust, 0.05, 0.9),
            ("hover_thrust_s", self.hover_thrust_s, 0.1, 100.0),
            ("geoid_m", self.geoid_m, -120.0, 120.0),
            ("range_sd_m", self.range_sd_m, 0.001, 1.0),
        ] {
            at.range(key, v, low, high)?;
        }
        at.ranges("odometry_sd", &self.odometry_sd, 1e-4, 10.0)?;
        self.disarm.check(&at.table("disarm"))?;
        self.battery.check(&at.table("battery"))
    }
}
impl Check for DisarmConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("height_m", self.height_m, 0.02, 1.0)?;
        at.range("speed_mps", self.speed_mps, 0.1, 5.0)?;
        at.range("carried_of_g", self.carried_of_g, 0.5, 1.0)?;
        at.range("thrust_of_hover", self.thrust_of_hover, 0.1, 0.9)?;
        at.range("hold_s", self.hold_s, 0.0, 1.0)?;
        at.range("patience_s", self.patience_s, 0.05, 2.0)?;
        at.range("tries", f64::from(self.tries), 1.0, 100.0)?;
        at.range("pause_s", self.pause_s, 0.05, 5.0)
    }
}
impl Check for BatteryConfig {
    fn check(&self, at: &Keys<'_>) -> Result<(), ConfigError> {
        at.range("reserve", self.reserve, 0.0, 0.9)?;
        at.range("for_s", self.for_s, 0.1, 60.0)?;
        at.range("tries", f64::from(self.tries), 1.0, 20.0)
    }
}
