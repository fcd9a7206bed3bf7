//! The mission's state, its settings and checkpoint, and the drone's status for its vessel.

use core::fmt;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Command, CommandKind, DeckForecast, DroneState, FRACTION, Header, KeptStation, LandedState,
    MAX_POSITION_M, MAX_SPEED_MPS, Phase, Reason, ReasonCode, State, Station, within,
};
use crate::geodesy::Datum;
use crate::time::{DroneClock, Time};
use crate::topics;

/// Landing place of a drone with a low battery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum BatteryPlace {
    /// On the vessel's deck, within wider limits.
    Deck,
    /// Destination of the autopilot's return mode.
    Home,
    /// Present place: the autopilot's land mode.
    Here,
}

/// Extent of a landing: the ladder to a first landing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum LandingMode {
    /// A person flies. Everything is computed and shown, nothing is commanded.
    Shadow,
    /// Follows the deck down to the lowest clearance, holds there and climbs.
    Match,
    /// Onto the deck.
    #[default]
    Land,
}

/// Part of the mission's configuration that an operator changes from a ground station. Heights are of the drone's centre
/// of mass above the deck's mean level.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionSettings {
    /// Extent of the landing.
    pub mode: LandingMode,
    /// Approach height, m.
    pub approach_height_m: f64,
    /// Tracking height, m; shown, and not changed.
    pub tracking_height_m: f64,
    /// With [`LandingMode::Match`] the feet come no nearer to the deck, m.
    pub lowest_clearance_m: f64,
}

impl MissionSettings {
    /// Each is a height over a deck.
    fn is_sane(&self) -> bool {
        let heights = [
            self.approach_height_m,
            self.tracking_height_m,
            self.lowest_clearance_m,
        ];
        heights.iter().all(|h| (0.0..=1e3).contains(h))
    }
}

/// A ground station changes the mission's settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SettingsOrder {
    /// Identity, and the time at which it was given.
    pub header: Header<DroneClock>,
    /// All of them, as they are to be.
    pub settings: MissionSettings,
}

/// Ways in which a drone knows its vessel, the weakest first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum VesselLevel {
    /// By the tags on its deck alone.
    Tag,
    /// By a beacon as well, which gives place and velocity to metres ([`super::DeckBeacon`]): it leads to a search for the tags.
    Beacon,
    /// By the estimates and the waves that its computer broadcasts.
    #[default]
    Computer,
}

/// The mission's state and what it permits.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionState {
    /// Identity.
    pub header: Header<DroneClock>,
    /// The state.
    pub state: State,
    /// The state before it.
    pub previous: State,
    /// When the state was entered.
    pub since: Time<DroneClock>,
    /// Why it was entered.
    pub entered: Reason,
    /// Why the next state is not entered yet.
    pub waiting: Reason,
    /// Why an order that was given a moment ago is not carried out: for people, while `waiting` goes on.
    pub rejected: Option<Reason>,
    /// Descents begun so far.
    pub attempts: u32,
    /// Height of the drone's centre of mass above the deck's mean that the state asks for, m.
    pub height_m: f64,
    /// Permitted speed of descent relative to the deck, m/s; 0 when descent is not permitted.
    pub descent_mps: f64,
    /// The trajectory must stay above this height over the water (NED z is its negative), m.
    pub minimum_altitude_m: f64,
    /// Place to hold in `Hold`, `GetAltitude` and `GaveUp`: drone's NED, m.
    pub hold_position: [f64; 3],
    /// Heading to hold there, rad.
    pub hold_yaw: f64,
    /// Low over the deck: until it is as high as there, the drone climbs in place over the deck and moves with it.
    pub with_deck: bool,
    /// Waiting place off the deck, from the deck's centre, north and east, m.
    pub waiting_offset: Option<[f64; 2]>,
    /// The station that it keeps.
    pub station: Option<KeptStation>,
    /// Settings that an operator may have changed.
    pub settings: MissionSettings,
    /// They may be changed: the drone is disarmed, and neither a landing nor a take-off is ordered.
    pub settable: bool,
    /// Weakest knowledge of a vessel that permits a landing to begin.
    pub least_vessel: VesselLevel,
    /// No plan leads lower over the deck, along its normal, m; None: onto it.
    pub lowest_clearance_m: Option<f64>,
    /// Below this clearance only hard reasons break a landing off, m.
    pub commit_clearance_m: f64,
    /// Remaining battery that counts, 0 to 1: what has lasted, and what is reckoned where the gauge is silent or stuck; None while
    /// that is not known.
    pub battery: Option<f64>,
    /// Remaining battery that the way to the deck and one attempt take, or that is kept in any case, 0 to 1.
    pub battery_reserve: f64,
    /// Probability that a landing from here succeeds, 0 to 1; None while that is not known.
    pub likelihood: Option<f64>,
    /// Probability that the contact of a landing from here is unsafe, 0 to 1; None while that is not known.
    pub harm: Option<f64>,
    /// Place at which the feet are to meet the deck, from its centre, NED, m: upwind in strong wind, which moves the drone.
    pub meets: [f64; 2],
    /// Landing place, once the battery is below the reserve.
    pub low_battery: Option<BatteryPlace>,
    /// On a sortie from the deck: time until the drone has to turn back to the vessel, s; None: on none, or not known.
    pub turns_in_s: Option<f64>,
    /// Sorties begun since the process began, and how many there are to be; the latter 0 where no unattended cycles go on.
    pub sorties: [u32; 2],
    /// Boot and sequence of the newest abort that it has received ...
    pub abort: Option<[u32; 2]>,
    /// ... and of the newest other order, whether it is carried out or rejected.
    pub order: Option<[u32; 2]>,
}

impl MissionState {
    /// The state was entered for a cause that the crew has to know: an end without a landing or with a hard one, a hold
    /// without a command, a descent that was broken off.
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
    /// The next state waits for something that does not come by itself.
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
    /// Place to hold, drone's NED, m.
    pub fn hold_position(&self) -> Vector3<f64> {
        Vector3::from(self.hold_position)
    }
}

/// The vessel when its deck was known last: what the way back is judged by out of radio range.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct LastVessel {
    /// When.
    pub at: Time<DroneClock>,
    /// Place of its deck.
    pub place: Datum,
    /// Mean velocity of the deck, north and east, m/s.
    pub velocity: [f64; 2],
}

impl LastVessel {
    /// To 20 m and 0.25 m/s.
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

/// A battery by its gauge, for a mission that goes on with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct KnownBattery {
    /// When the flight's last minimum of the gauge was ...
    pub at: Time<DroneClock>,
    /// ... and that, 0 to 1: assumed of a gauge that has never reported.
    pub gauge: f64,
    /// When the flight began ...
    pub start_at: Time<DroneClock>,
    /// ... and with what charge, 0 to 1; None: the gauge has never reported.
    pub start: Option<f64>,
    /// The power by the gauge, 1/s, as far as it is measured.
    pub power: Option<f64>,
}

impl KnownBattery {
    fn is_sane(&self) -> bool {
        let power = self.power.is_none_or(|p| (0.0..=1.0).contains(&p));
        FRACTION.contains(&self.gauge) && self.start.is_none_or(|b| FRACTION.contains(&b)) && power
    }
}

/// Checkpoint of the mission: a successor goes on from there when the process ends in flight.
///
/// It is published with every [`MissionState`], and validated by the successor before it counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionCheckpoint {
    /// Identity of the writer and time of writing; boot 0: no checkpoint.
    pub header: Header<DroneClock>,
    /// The state published last.
    pub state: MissionState,
    /// The motors are armed.
    pub armed: bool,
    /// A landing is wanted.
    pub landing: bool,
    /// When the landing was begun.
    pub started: Time<DroneClock>,
    /// The operator asked for a landing below the battery's reserve: the deck is the first place.
    pub deck_first: bool,
    /// State of the battery in addition to the charge that counts.
    pub battery: Option<KnownBattery>,
    /// An operator has stopped a landing that the low battery had brought about: the deck is not chosen again.
    pub deck_declined: bool,
    /// An operator stopped what the mission did, and has commanded no landing since.
    pub stopped: bool,
    /// Below the commit clearance: only hard reasons break the flare off.
    pub committed: bool,
    /// On the deck, and disarmed meanwhile.
    pub disarmed: bool,
    /// The newest command that was accepted.
    pub command: Option<Command>,
    /// The newest abort that was accepted.
    pub abort: Option<Header<DroneClock>>,
    /// The drone's frame: [`DroneState::frames`](super::DroneState::frames) ...
    pub frames: u8,
    /// ... and where its NED begins.
    pub datum: Datum,
    /// The deck's mean level, drone's NED z, m.
    pub mean_deck_z: Option<f64>,
    /// Without an order it has been away from the deck: it climbs when the vessel comes to it.
    pub was_away: bool,
    /// It has taken off from the deck, and not landed since.
    pub sortie: bool,
    /// Unattended cycles go on.
    pub cycling: bool,
    /// The order that the drone is ready was given for the next sortie.
    pub ready: bool,
    /// Why the cycles have ended.
    pub cycles_ended: Option<Reason>,
    /// The vessel when it was known last.
    pub last_vessel: Option<LastVessel>,
}

impl MissionCheckpoint {
    /// Part that outlives the computer's boot, and with that its clock: the purpose of a flight; None: the motors are disarmed.
    /// The vessel's place and the time on a station are rounded, so that a disk is written to every few seconds.
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
    /// Boot and sequence of the newest abort ...
    abort: Option<[u32; 2]>,
    /// ... and of the newest other order since.
    order: Option<[u32; 2]>,
    /// The newest of all is not carried out.
    rejected: bool,
}

impl OrderEcho {
    /// Whether an order of this kind is carried out, by the echo that `is_own`; None: it has not been received, or a newer one has.
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

/// Status of the drone for the vessel, for the deck's operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DroneStatus {
    /// Identity.
    pub header: Header<DroneClock>,
    /// The mission's state.
    pub state: State,
    /// Why it was entered.
    pub entered: Reason,
    /// Why the next state is not entered yet.
    pub waiting: Reason,
    /// Why an order that was given a moment ago is not carried out: for people, while `waiting` goes on.
    pub rejected: Option<Reason>,
    /// Descents begun so far.
    pub attempts: u32,
    /// Remaining battery, 0 to 1; None when the autopilot does not report it.
    pub battery: Option<f64>,
    /// The autopilot's own opinion of where it is.
    pub landed: LandedState,
    /// Horizontal distance from the deck's centre by odometry and forecast, m; None while either is old.
    pub deck_distance_m: Option<f32>,
    /// Boot and sequence of the newest abort that the mission has received ...
    pub abort: Option<[u32; 2]>,
    /// ... and of the newest other order, whether it is carried out or rejected.
    pub order: Option<[u32; 2]>,
    /// The motors are armed, by the autopilot's newest report.
    pub armed: bool,
    /// On the deck and armed for longer than the disarm there takes: since the landing, or since the take-off was stopped, s.
    pub still_armed_s: Option<f32>,
    /// Age of the mission's state when this was sent, s: its process may have ended, or hang.
    pub mission_age_s: f32,
    /// The true wind, towards north and east, m/s, once the drone knows it to 3 m/s.
    pub wind: Option<[f32; 2]>,
    /// The station that it keeps, or flies to.
    pub station: Option<Station>,
}

/// Remedy for a drone that is on the deck and armed, as text after its subject.
pub fn still_armed(for_s: f32) -> String {
    format!("on deck, still ARMED for {for_s:.0} s: disarm by remote control")
}

/// A wind for people: how fast, and where from, clockwise from north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wind {
    /// m/s.
    pub speed_mps: f64,
    /// deg, 0 to 359.
    pub from_deg: i64,
}

impl Wind {
    /// Wind of a velocity towards north and east, m/s.
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

/// A battery's charge for people: per cent, or that it is not reported.
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
    /// Horizontal distance between odometry and the deck's centre in its forecast, m; None while one is missing or
    /// older at `now` than its topic allows.
    pub fn deck_distance_m(
        now: Time<DroneClock>,
        own: Option<&DroneState>,
        forecast: Option<&DeckForecast>,
    ) -> Option<f32> {
        let own = own.filter(|m| now - m.header.at <= topics::DRONE_STATE.stale_after)?;
        let forecast = forecast.filter(|m| now - m.header.at <= topics::FORECAST.stale_after)?;
        let deck = forecast.stages.first()?;
        let from_deck = Vector3::from(own.position) - Vector3::from(deck.position);
        Some(from_deck.xy().norm() as f32)
    }
}

message!(DroneStatus, DroneClock, |m| {
    m.battery.is_none_or(|b| FRACTION.contains(&b)) => "battery",
    m.deck_distance_m.is_none_or(|d| d >= 0.0) => "deck_distance_m",
    m.still_armed_s.is_none_or(|s| s >= 0.0) => "still_armed_s",
    m.mission_age_s >= 0.0 => "mission_age_s",
    m.wind.is_none_or(|w| within(&w, MAX_SPEED_MPS)) => "wind",
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
