//! State, settings and checkpoint of the mission, and the drone's status for its vessel.

use core::fmt;

use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Command, CommandKind, DeckForecast, DroneState, FRACTION, Header, KeptStation, LandedState,
    MAX_POSITION_M, MAX_SPEED_MPS, Phase, Reason, ReasonCode, State, Station, within,
};
use crate::{
    geodesy::Datum,
    time::{DroneClock, DroneTime},
    topics,
};

/// Landing place of a drone with a low battery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum BatteryPlace {
    /// The vessel's deck, within wider limits.
    Deck,
    /// Destination of the autopilot's return mode.
    Home,
    /// Present position: the autopilot's land mode.
    Here,
}

/// Place for which a drone with a low battery leaves, and the charge at which it leaves.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LastResort {
    /// Home or here.
    pub place: BatteryPlace,
    /// Charge, 0 to 1.
    pub charge: f64,
}

/// Extent to which a landing is flown, in steps towards a first landing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum LandingMode {
    /// A pilot flies. Everything is computed and displayed, nothing is commanded.
    Shadow,
    /// Follows the deck down to the lowest clearance, holds there and climbs.
    Match,
    /// Lands on the deck.
    #[default]
    Land,
}

/// Mission settings that an operator changes from a ground station. Heights are those of the drone's centre of mass
/// above the deck's mean level.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionSettings {
    /// Extent of the landing.
    pub mode: LandingMode,
    /// Approach height, m.
    pub approach_height_m: f64,
    /// Tracking height, m; displayed only.
    pub tracking_height_m: f64,
    /// Minimum clearance between feet and deck with [`LandingMode::Match`], m.
    pub lowest_clearance_m: f64,
}

impl MissionSettings {
    fn is_sane(&self) -> bool {
        let heights = [
            self.approach_height_m,
            self.tracking_height_m,
            self.lowest_clearance_m,
        ];
        heights.iter().all(|h| (0.0..=1e3).contains(h))
    }
}

/// Change of the mission's settings by a ground station.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SettingsOrder {
    /// Identity and time of the order.
    pub header: Header<DroneClock>,
    /// New values of all settings.
    pub settings: MissionSettings,
}

/// Level of knowledge about the vessel, weakest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum VesselLevel {
    /// Tags on its deck only.
    Tag,
    /// A beacon in addition, accurate to metres ([`super::DeckBeacon`]): it starts a search for the tags.
    Beacon,
    /// Estimates and wave model broadcast by the vessel's computer.
    #[default]
    Computer,
}

/// State of the mission and the limits it sets.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionState {
    /// Identity.
    pub header: Header<DroneClock>,
    /// Present state.
    pub state: State,
    /// Previous state.
    pub previous: State,
    /// Time of entry into the state.
    pub since: DroneTime,
    /// Reason for entering the state.
    pub entered: Reason,
    /// Reason why the next state is not entered yet.
    pub waiting: Reason,
    /// Reason why a recent order is not carried out; displayed while `waiting` continues.
    pub rejected: Option<Reason>,
    /// Number of descents begun.
    pub attempts: u32,
    /// Commanded height of the drone's centre of mass above the deck's mean level, m.
    pub height_m: f64,
    /// Proposed descent speed relative to the deck, m/s, which a plan may exceed; 0: no descent.
    pub descent_mps: f64,
    /// Minimum height of the trajectory above the water (negative NED z), m.
    pub minimum_altitude_m: f64,
    /// Hold position in `Hold`, `GetAltitude` and `GaveUp`: drone's NED, m.
    pub hold_position: [f64; 3],
    /// Hold heading, rad.
    pub hold_yaw: f64,
    /// The drone climbs in place over the deck and moves with it until it reaches the hold height.
    pub with_deck: bool,
    /// Waiting place relative to the deck's centre, north and east, m.
    pub waiting_offset: Option<[f64; 2]>,
    /// Station that the drone keeps.
    pub station: Option<KeptStation>,
    /// Settings, including changes by an operator.
    pub settings: MissionSettings,
    /// Settings may be changed: the drone is disarmed, and neither a landing nor a take-off is ordered.
    pub settable: bool,
    /// Minimum knowledge of the vessel required to begin a landing.
    pub min_vessel: VesselLevel,
    /// Minimum clearance of plans above the deck along its normal, m; None: down to the deck.
    pub lowest_clearance_m: Option<f64>,
    /// Clearance below which only severe reasons break off a landing, m.
    pub commit_clearance_m: f64,
    /// Effective remaining battery, 0 to 1: sustained minimum of the gauge, or an estimate if the gauge is
    /// silent or stuck; None: unknown.
    pub battery: Option<f64>,
    /// Battery reserve: charge for the way to the deck and one attempt, or the fixed minimum, 0 to 1.
    pub battery_reserve: f64,
    /// Probability that a landing from here succeeds, 0 to 1; None while unknown.
    pub likelihood: Option<f64>,
    /// Probability that the contact of a landing from here is unsafe, 0 to 1; None while unknown.
    pub harm: Option<f64>,
    /// Target of the feet on the deck relative to its centre, NED, m: upwind in strong wind, which displaces the drone.
    pub meets: [f64; 2],
    /// Landing place, once the battery is below the reserve.
    pub low_battery: Option<BatteryPlace>,
    /// Place for which the drone leaves if the deck stays missing; None without one.
    pub last_resort: Option<LastResort>,
    /// On a sortie from the deck: time until the drone must turn back to the vessel, s; None: no sortie, or unknown.
    pub turns_in_s: Option<f64>,
    /// Sorties begun since the process started, and their planned number; the latter is 0 outside unattended cycles.
    pub sorties: [u32; 2],
    /// Boot and sequence of the newest abort received.
    pub abort: Option<[u32; 2]>,
    /// Boot and sequence of the newest other order received, accepted or rejected.
    pub order: Option<[u32; 2]>,
}

impl MissionState {
    /// Whether the crew must learn why the state was entered: an end without a landing or with a hard one, an
    /// uncommanded hold, or a descent broken off.
    pub fn was_entered_in_trouble(&self) -> bool {
        let broken_off = matches!(self.previous, State::Descent | State::Flare)
            && self.entered.code != ReasonCode::Matched;
        match self.state {
            State::GaveUp => true,
            State::Landed => self.entered.code == ReasonCode::HardContact,
            State::Hold => {
                let meant = matches!(
                    self.entered.code,
                    ReasonCode::Operator
                        | ReasonCode::Matched
                        | ReasonCode::OnStation
                        | ReasonCode::StationOver
                );
                broken_off || !meant
            }
            State::StandDown => self.entered.code != ReasonCode::Operator,
            State::Idle
            | State::GetAltitude
            | State::Approach
            | State::Search
            | State::Tracking
            | State::TrackingStable
            | State::Descent
            | State::Flare
            | State::Preparing
            | State::Countdown
            | State::SpinUp
            | State::TakeOff
            | State::ClimbOut => {
                broken_off && !self.state.is_take_off() && self.state.phase() != Phase::Landing
            }
        }
    }
    /// Whether the next state waits for a condition that requires action by crew or operator.
    pub fn waits_in_trouble(&self) -> bool {
        matches!(
            self.waiting.code,
            ReasonCode::BatteryLow
                | ReasonCode::BatteryStopped
                | ReasonCode::HeightsDisagree
                | ReasonCode::HeightUnconfirmed
                | ReasonCode::OrderExpired
                | ReasonCode::BatteryDeck
                | ReasonCode::BatteryHome
                | ReasonCode::BatteryHere
                | ReasonCode::ArmingRejected
        )
    }
    /// Hold position, drone's NED, m.
    pub fn hold_position(&self) -> Vector3<f64> {
        Vector3::from(self.hold_position)
    }
}

/// Last known state of the vessel, used to plan the way back when out of radio range.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LastVessel {
    /// Time of the state.
    pub at: DroneTime,
    /// Position of the deck.
    pub place: Datum,
    /// Mean velocity of the deck, north and east, m/s.
    pub velocity: [f64; 2],
}

impl LastVessel {
    /// Rounds to 20 m and 0.25 m/s.
    fn rounded(&self) -> LastVessel {
        let to = |v: f64, step: f64| (v / step).round() * step;
        let Datum {
            latitude_deg,
            longitude_deg,
            height_m,
        } = self.place;
        LastVessel {
            at: self.at,
            place: Datum::new(
                to(latitude_deg, 2e-4),
                to(longitude_deg, 2e-4),
                to(height_m, 20.0),
            ),
            velocity: self.velocity.map(|v| to(v, 0.25)),
        }
    }
}

/// State of the battery according to its gauge, passed on to a restarted mission.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct KnownBattery {
    /// Time at which the gauge last reached a new minimum in this flight.
    pub at: DroneTime,
    /// That minimum, 0 to 1; an assumed value if the gauge has never reported.
    pub gauge: f64,
    /// Start of the flight.
    pub start_at: DroneTime,
    /// Charge at the start, 0 to 1; None: the gauge has never reported.
    pub start: Option<f64>,
    /// Power measured by the gauge, as fraction of the charge per second, 1/s.
    pub power: Option<f64>,
}

impl KnownBattery {
    fn is_sane(&self) -> bool {
        let power = self.power.is_none_or(|p| (0.0..=1.0).contains(&p));
        FRACTION.contains(&self.gauge) && self.start.is_none_or(|b| FRACTION.contains(&b)) && power
    }
}

/// Checkpoint of the mission: a process restarted in flight continues from it.
///
/// Published with every [`MissionState`]. The restarted process validates it before use.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionCheckpoint {
    /// Identity and time of writing; boot 0: no checkpoint.
    pub header: Header<DroneClock>,
    /// Newest published state.
    pub state: MissionState,
    /// The motors are armed.
    pub armed: bool,
    /// A landing is ordered.
    pub landing: bool,
    /// Start of the landing.
    pub started: DroneTime,
    /// The operator ordered a landing below the battery reserve, so the deck has priority.
    pub deck_first: bool,
    /// Gauge history of the battery.
    pub battery: Option<KnownBattery>,
    /// An operator stopped a landing caused by low battery, so the deck is not chosen again.
    pub deck_declined: bool,
    /// An operator has stopped the mission and has not ordered a landing since.
    pub stopped: bool,
    /// Below the commit clearance: only severe reasons break off the flare.
    pub committed: bool,
    /// The drone was disarmed on the deck.
    pub disarmed: bool,
    /// Newest accepted command.
    pub command: Option<Command>,
    /// Newest accepted abort.
    pub abort: Option<Header<DroneClock>>,
    /// Number of the drone's frame: [`DroneState::frames`](super::DroneState::frames).
    pub frames: u8,
    /// Origin of the drone's NED.
    pub datum: Datum,
    /// Mean level of the deck, drone's NED z, m.
    pub mean_deck_z: Option<f64>,
    /// The drone has been away from the deck without an order: it climbs when the vessel approaches it.
    pub was_away: bool,
    /// The drone has taken off from the deck and not landed since.
    pub sortie: bool,
    /// Unattended cycles are in progress.
    pub cycling: bool,
    /// An operator has confirmed readiness for the next sortie.
    pub ready: bool,
    /// Reason why the cycles have ended.
    pub cycles_ended: Option<Reason>,
    /// Last known state of the vessel.
    pub last_vessel: Option<LastVessel>,
}

impl MissionCheckpoint {
    /// Purpose of the flight, which outlives a reboot and its new clock; None if the motors are disarmed. The
    /// vessel's position and the time on a station are rounded, so the file changes only every few seconds.
    pub fn lasting(&self) -> Option<MissionCheckpoint> {
        let header = self.header.outdated();
        let last_vessel = self.last_vessel.map(|v| LastVessel {
            at: header.at,
            ..v.rounded()
        });
        self.armed.then(|| MissionCheckpoint {
            header,
            state: MissionState {
                header,
                sorties: self.state.sorties,
                station: self.state.station.map(|kept| kept.left_at(self.header.at)),
                ..MissionState::default()
            },
            armed: true,
            landing: self.landing,
            deck_first: self.deck_first,
            stopped: self.stopped,
            deck_declined: self.deck_declined,
            sortie: self.sortie,
            cycling: self.cycling,
            cycles_ended: self.cycles_ended,
            last_vessel,
            ..MissionCheckpoint::default()
        })
    }
}

/// Acknowledgement of the orders that a mission has received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OrderEcho {
    /// Boot and sequence of the newest abort.
    abort: Option<[u32; 2]>,
    /// Boot and sequence of the newest order after that abort.
    order: Option<[u32; 2]>,
    /// The newest order is not carried out.
    rejected: bool,
}

impl OrderEcho {
    /// Whether the order that `is_own` recognises in the echo is carried out; None: not received, or superseded.
    pub fn answers(&self, kind: CommandKind, is_own: impl Fn([u32; 2]) -> bool) -> Option<bool> {
        let (echo, rejected) = match kind {
            CommandKind::Abort => (self.abort, self.rejected && self.order.is_none()),
            CommandKind::Land
            | CommandKind::Hold
            | CommandKind::TakeOff
            | CommandKind::Ready
            | CommandKind::Station(_) => (self.order, self.rejected),
        };
        echo.filter(|echo| is_own(*echo)).map(|_| !rejected)
    }
}

impl MissionState {
    /// Acknowledgement of the orders that it has received.
    pub fn echo(&self) -> OrderEcho {
        OrderEcho {
            abort: self.abort,
            order: self.order,
            rejected: self.rejected.is_some(),
        }
    }
}
impl DroneStatus {
    /// Acknowledgement of the orders that the mission has received.
    pub fn echo(&self) -> OrderEcho {
        OrderEcho {
            abort: self.abort,
            order: self.order,
            rejected: self.rejected.is_some(),
        }
    }
}

/// Status of the drone for the vessel and the deck's operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DroneStatus {
    /// Identity.
    pub header: Header<DroneClock>,
    /// State of the mission.
    pub state: State,
    /// Reason for entering the state.
    pub entered: Reason,
    /// Reason why the next state is not entered yet.
    pub waiting: Reason,
    /// Reason why a recent order is not carried out; displayed while `waiting` continues.
    pub rejected: Option<Reason>,
    /// Number of descents begun.
    pub attempts: u32,
    /// Remaining battery, 0 to 1; None when the autopilot does not report it.
    pub battery: Option<f64>,
    /// State reported by the autopilot's land detector.
    pub landed: LandedState,
    /// Horizontal distance from the deck's centre by odometry and forecast, m; None while either is old.
    pub deck_distance_m: Option<f32>,
    /// Direction from the deck's centre to the drone, clockwise from north, rad; known with the distance.
    pub bearing: Option<f32>,
    /// Boot and sequence of the newest abort received by the mission.
    pub abort: Option<[u32; 2]>,
    /// Boot and sequence of the newest other order received, accepted or rejected.
    pub order: Option<[u32; 2]>,
    /// The motors are armed according to the autopilot's newest report.
    pub armed: bool,
    /// Time since landing or stopped take-off, s, if the drone has been armed on the deck for too long; otherwise None.
    pub still_armed_s: Option<f32>,
    /// Age of the mission's state at sending, s; when it grows, the process has ended or hangs.
    pub mission_age_s: f32,
    /// True wind, north and east, m/s, once known to within 3 m/s.
    pub wind: Option<[f32; 2]>,
    /// Greatest speed of the wind in the last 5 to 10 min, m/s; known with the wind.
    pub gust_mps: Option<f32>,
    /// Station that the drone keeps or flies to.
    pub station: Option<Station>,
}

/// Message about a drone that is still armed on the deck, with the remedy, to be appended to the drone's name.
pub fn still_armed(for_s: f32) -> String {
    format!("on deck, still ARMED for {for_s:.0} s: disarm by remote control")
}

/// Wind for display: speed, and the direction that it comes from, clockwise from north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// Speed, m/s.
    pub speed_mps: f64,
    /// Direction, deg, 0 to 359.
    pub from_deg: i64,
}

impl Wind {
    /// Wind from a velocity north and east, m/s.
    pub fn towards([north, east]: [f64; 2]) -> Wind {
        Wind {
            speed_mps: north.hypot(east),
            from_deg: ((-east).atan2(-north).to_degrees().round() as i64).rem_euclid(360),
        }
    }
}

impl fmt::Display for Wind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.speed_mps < 0.5 {
            return f.write_str("calm");
        }
        write!(f, "{:.0} m/s from {}°", self.speed_mps, self.from_deg)
    }
}

/// Battery charge for display: per cent, or not reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Charge(pub Option<f64>);

impl fmt::Display for Charge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(charge) => write!(f, "{:.0} %", 100.0 * charge),
            None => f.write_str("not reported"),
        }
    }
}

impl DroneStatus {
    /// Position by odometry relative to the forecast deck's centre, north and east, m; None if one is missing or old.
    pub fn from_deck_m(
        now: DroneTime,
        own: Option<&DroneState>,
        forecast: Option<&DeckForecast>,
    ) -> Option<Vector2<f64>> {
        let own = own.filter(|m| now - m.header.at <= topics::DRONE_STATE.stale_after)?;
        let forecast = forecast.filter(|m| now - m.header.at <= topics::FORECAST.stale_after)?;
        let deck = forecast.stages.first()?;
        Some((Vector3::from(own.position) - Vector3::from(deck.position)).xy())
    }
}

message!(DroneStatus, DroneClock, |m| {
    m.battery.is_none_or(|b| FRACTION.contains(&b)) => "battery",
    m.deck_distance_m.is_none_or(|d| d >= 0.0) => "deck_distance_m",
    m.bearing.is_none_or(f32::is_finite) => "bearing",
    m.still_armed_s.is_none_or(|s| s >= 0.0) => "still_armed_s",
    m.mission_age_s >= 0.0 => "mission_age_s",
    m.wind.is_none_or(|w| within(&w, MAX_SPEED_MPS)) => "wind",
    m.gust_mps.is_none_or(|g| g >= 0.0) => "gust_mps",
    m.station.is_none_or(|station| station.is_sane() && station.height_m > 0) => "station",
});
message!(MissionState, DroneClock, |m| {
    within(&m.hold_position, MAX_POSITION_M) && within([&m.hold_yaw], 50.0) => "hold_position",
    within(m.waiting_offset.iter().flatten(), MAX_POSITION_M) => "waiting_offset",
    m.station.is_none_or(|kept| kept.station.is_sane() && kept.station.height_m > 0) => "station",
    m.settings.is_sane() => "settings",
    m.lowest_clearance_m.is_none_or(|c| (0.0..=1e3).contains(&c)) => "lowest_clearance_m",
    (0.0..=10.0).contains(&m.commit_clearance_m) => "commit_clearance_m",
    m.battery.is_none_or(|b| FRACTION.contains(&b)) => "battery",
    (0.0..=1e3).contains(&m.battery_reserve) => "battery_reserve",
    m.likelihood.is_none_or(|p| FRACTION.contains(&p)) => "likelihood",
    m.harm.is_none_or(|p| FRACTION.contains(&p)) => "harm",
    m.turns_in_s.is_none_or(|s| s >= 0.0) => "turns_in_s",
    m.last_resort.is_none_or(|l| l.charge >= 0.0) => "last_resort",
    within(&m.meets, 10.0) => "meets",
    (0.0..=1e3).contains(&m.height_m) && (0.0..=10.0).contains(&m.descent_mps) => "height_m or descent_mps",
});
message!(SettingsOrder, DroneClock, |m| {
    m.settings.is_sane() => "settings",
});
message!(MissionCheckpoint, DroneClock, |m| {
    m.state.header.version == m.header.version && super::Message::check(&m.state).is_ok() => "state",
    m.datum.is_on_earth() => "datum",
    m.mean_deck_z.is_none_or(|z| within([&z], MAX_POSITION_M)) => "mean_deck_z",
    m.battery.is_none_or(|b| b.is_sane()) => "battery",
    m.last_vessel.is_none_or(|v| v.place.is_on_earth() && within(&v.velocity, MAX_SPEED_MPS)) => "last_vessel",
});
