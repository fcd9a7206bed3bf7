//! The mission's state, its reason, and commands to it.

use core::fmt;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    DECK_CLOSED, DeckForecast, DroneState, FRACTION, Header, LandedState, MAX_POSITION_M, MAX_SPEED_MPS,
    within,
};
use crate::autopilot_parameters::{REQUESTS, numbered};
use crate::geodesy::Datum;
use crate::time::{Clock, DroneClock, Time, VesselClock};
use crate::topics;

/// States of the landing mission (Procházka et al., section IV).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum State {
    /// Waits for a landing command, flight and the vessel's state.
    #[default]
    Idle,
    /// Straight up or down to the approach height.
    GetAltitude,
    /// Towards the predicted vessel at approach height.
    Approach,
    /// Follows the predicted vessel at tracking height.
    Tracking,
    /// The same, stably above the deck.
    TrackingStable,
    /// Descends at constant speed relative to the predicted deck.
    Descent,
    /// The last part, with the full deck pose as reference.
    Flare,
    /// On the deck.
    Landed,
    /// Holds position at a safe height: data too old, or commanded.
    Hold,
    /// Ended without landing: aborted by command or out of retries.
    GaveUp,
}

/// Phases that choose weights and rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum Phase {
    /// No planning.
    #[default]
    None,
    /// Far from the vessel.
    Navigation,
    /// Above the vessel.
    Follow,
    /// Descent and flare.
    Landing,
}

impl State {
    /// The phase that a state belongs to.
    pub const fn phase(self) -> Phase {
        match self {
            State::Idle | State::Landed => Phase::None,
            State::GetAltitude | State::Approach | State::Hold | State::GaveUp => Phase::Navigation,
            State::Tracking | State::TrackingStable => Phase::Follow,
            State::Descent | State::Flare => Phase::Landing,
        }
    }
    /// The name that a person reads.
    pub const fn name(self) -> &'static str {
        match self {
            State::Idle => "Idle",
            State::GetAltitude => "Get altitude",
            State::Approach => "Approach",
            State::Tracking => "Tracking",
            State::TrackingStable => "Tracking stable",
            State::Descent => "Descent",
            State::Flare => "Flare",
            State::Landed => "Landed",
            State::Hold => "Hold",
            State::GaveUp => "Gave up",
        }
    }
    /// What the drone does in it, for people.
    pub const fn does(self) -> &'static str {
        match self {
            State::Idle => "not landing: the autopilot or a pilot flies",
            State::GetAltitude => "climbs or sinks in place to the approach height",
            State::Approach => "flies to the predicted vessel at the approach height",
            State::Tracking => "follows the predicted deck at the tracking height",
            State::TrackingStable => "follows the predicted deck, steady above it",
            State::Descent => "descends to the predicted deck",
            State::Flare => "sets down with the deck's attitude",
            State::Landed => "stands on the deck",
            State::Hold => "holds its position at a safe height",
            State::GaveUp => "holds its position: the landing has ended without a touchdown",
        }
    }
    /// How a landing ended that left the drone in it, for people; None: it goes on, or there was none.
    pub const fn ending(self) -> Option<&'static str> {
        match self {
            State::Landed => Some("landed"),
            State::GaveUp => Some("gave up"),
            State::Idle
            | State::GetAltitude
            | State::Approach
            | State::Tracking
            | State::TrackingStable
            | State::Descent
            | State::Flare
            | State::Hold => None,
        }
    }
    /// A landing goes on in it.
    pub const fn is_landing(self) -> bool {
        !matches!(self, State::Idle) && self.ending().is_none()
    }
    /// The state with why it was entered, for people: `Hold: operator's command`.
    pub fn because(self, entered: &Reason) -> String {
        let reason = entered.to_string();
        if reason.is_empty() {
            self.name().into()
        } else {
            format!("{}: {reason}", self.name())
        }
    }
}

/// Why a transition happened, or why the next one does not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum ReasonCode {
    /// No reason.
    #[default]
    None,
    /// A landing was commanded.
    Commanded,
    /// At the height of the approach.
    HeightReached,
    /// No landing was commanded.
    NotCommanded,
    /// The drone is not flying, not armed or not in the mode that takes set-points.
    NotFlying,
    /// No message of the vessel yet.
    NoVessel,
    /// The drone's own odometry is too old, s.
    OdometryStale,
    /// The deck forecast is too old, s.
    ForecastStale,
    /// Neither tag nor UVDAR has been seen yet.
    NoVision,
    /// The deck has not been seen for too long, s.
    VisionLost,
    /// Horizontal distance to the deck is too large, m.
    TooFar,
    /// Relative horizontal speed is too large, m/s.
    TooFast,
    /// The deck's predicted speed or acceleration exceeds what the drone can follow.
    Infeasible,
    /// The deck's predicted tilt exceeds the limit, rad.
    TooSteep,
    /// Not yet steady above the deck for long enough, s.
    NotSteady,
    /// The plan is too old or the solver found none, s.
    NoPlan,
    /// The drone left the cone above the deck, m.
    Deviated,
    /// The deck was missed: still no contact, m below it.
    Missed,
    /// Touchdown was detected.
    Touchdown,
    /// Battery below the reserve, fraction.
    BatteryLow,
    /// Attempts used up.
    OutOfRetries,
    /// An operator commanded it.
    Operator,
    /// Below the minimum altitude, m.
    TooLow,
    /// A state lasted longer than its limit, s.
    TooLong,
    /// The vessel's deck is another drone's: its number.
    DeckReserved,
    /// The newest deck grant is too old, s.
    DeckGrantStale,
    /// A landing is not likely enough, by its probability: the speed onto the deck costs most of it.
    LikelyHard,
    /// The same by the speed along the deck.
    LikelyFast,
    /// The same by the angle between drone and deck.
    LikelyTilted,
    /// The same by the place.
    LikelyBeside,
    /// The same by slope and wind, in which a landed drone slides off.
    LikelySlides,
    /// The feet are above the deck although a touchdown was detected, m.
    FalseTouchdown,
    /// The mission began anew in flight near the deck, m above it.
    Restarted,
    /// Battery below the reserve, fraction, with the deck below: the landing goes on within wider limits.
    BatteryDeck,
    /// The drone tilts beyond what was commanded, rad: its autopilot loses the attitude.
    TiltExcess,
    /// A parameter of the autopilot must be another: its value; the limit is its number in
    /// [`crate::autopilot_parameters`].
    AutopilotParameter,
    /// A parameter of the autopilot was not reported: requests so far; the limit is its number, as above.
    AutopilotParameterUnknown,
    /// The vessel's waiting places are all taken: their number.
    NoPlace,
    /// Battery below the reserve, fraction: the autopilot returns home.
    BatteryHome,
    /// Battery below the reserve, fraction: the autopilot lands where it is.
    BatteryHere,
    /// Stopped by an operator where a climb would meet the deck harder than the landing does: it is completed.
    CompletesLanding,
    /// The autopilot has not reported where its NED begins.
    NoOrigin,
    /// The drone's origin or its position estimate has jumped, and no forecast has come since; by so much the origin, m.
    OriginMoved,
    /// The vessel is too far away, m.
    VesselTooFar,
    /// Follows the deck at its lowest clearance and does not land: for so long, s.
    Matching,
    /// Nearer to the deck than it may come, m.
    TooNear,
    /// Has followed the deck at this clearance, m, for as long as it was to, s.
    Matched,
    /// The vessel states that she turns or may turn.
    VesselTurns,
    /// The landing would outlast the stated steadiness of the vessel's course: its time, and what is left of it, s.
    CourseEnds,
    /// A landing is not likely enough, by its probability: the vessel's turn costs most of it.
    TurnTooFast,
    /// The commanded attitude swings to and fro besides what plan and wind ask for, root mean square, rad.
    Swings,
    /// The order to land has ended: the drone did not fly, or nothing else let it begin, for so long, s.
    OrderExpired,
    /// Nothing but the radio gives the deck's height: the drone stays so high above it, m, until something confirms it.
    HeightUnconfirmed,
    /// Battery below the reserve, fraction, with the landing stopped: a place is chosen below the limit, unless an operator
    /// decides before.
    BatteryStopped,
    /// By another witness the deck is so much higher than by the forecast, m: the drone stays above both.
    HeightsDisagree,
    /// The deck was met harder than drones are built for: the speed, m/s.
    HardContact,
    /// The autopilot has not aligned its heading, or knows its position no more.
    HeadingUnaligned,
    /// The deck is seen elsewhere than where the radio places it: apart by, m, and what both may err.
    DeckElsewhere,
    /// The rangefinder contradicts the camera about the deck's height, in standard deviations of both.
    HeightContradicted,
    /// On its way to the height that it is to hold: off it, m.
    OffHeight,
    /// Descends: height above the deck, m, and that at which the flare begins.
    Descending,
    /// Descends to follow the deck: height above it, m, and that at which it follows.
    DescendingTo,
    /// Flares: height above the deck, m.
    Flaring,
    /// The deck is in sight for long enough.
    InSight,
    /// Steady above the deck, s.
    Steady,
    /// Nothing speaks against a descent.
    Permitted,
    /// At the height of the flare, m.
    FlareHeight,
    /// Armed again, by a person, after the landing.
    ArmedAgain,
    /// The data that was missing is back, s.
    Recovered,
    /// The motion of a vessel that is known by its tags alone is not identified yet.
    NotIdentified,
    /// The tags of a vessel that is not received are in sight.
    TagsInSight,
}

/// A reason with the figure that decided and its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Reason {
    /// What.
    pub code: ReasonCode,
    /// The figure (unit by code).
    pub value: f64,
    /// What it was compared with.
    pub limit: f64,
}

impl Reason {
    /// A reason without a figure.
    pub const fn plain(code: ReasonCode) -> Self {
        Reason {
            code,
            value: 0.0,
            limit: 0.0,
        }
    }
    /// A reason with its figure and limit.
    pub const fn new(code: ReasonCode, value: f64, limit: f64) -> Self {
        Reason { code, value, limit }
    }
}

impl From<ReasonCode> for Reason {
    fn from(code: ReasonCode) -> Self {
        Reason::plain(code)
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (v, l) = (self.value, self.limit);
        let battery = |f: &mut fmt::Formatter<'_>, then: &str| {
            write!(
                f,
                "battery at {:.0} % (needs {:.0} %){then}",
                v * 100.0,
                l * 100.0
            )
        };
        let likely = |f: &mut fmt::Formatter<'_>, costs: &str| {
            let (p, needed) = ((v * 100.0).floor(), (l * 100.0).ceil());
            write!(f, "a landing is {p:.0} % likely (needs {needed:.0}): {costs}")
        };
        match self.code {
            ReasonCode::None => Ok(()),
            ReasonCode::Commanded => write!(f, "landing commanded"),
            ReasonCode::HeightReached => write!(f, "at the height of the approach"),
            ReasonCode::InSight => write!(f, "the deck is in sight"),
            ReasonCode::Steady => write!(f, "steady above the deck for {v:.1} s"),
            ReasonCode::Permitted => write!(f, "the descent is permitted"),
            ReasonCode::FlareHeight => write!(f, "{v:.1} m above the deck: flare"),
            ReasonCode::ArmedAgain => write!(f, "armed again after the landing"),
            ReasonCode::Recovered => write!(f, "what was missing is back for {v:.1} s"),
            ReasonCode::NotCommanded => write!(f, "no landing commanded"),
            ReasonCode::NotFlying => write!(
                f,
                "not flying, not armed, or not in OFFBOARD (PX4) or GUIDED (ArduPilot)"
            ),
            ReasonCode::NoVessel => write!(f, "no vessel state received from within 100 km"),
            ReasonCode::TagsInSight => write!(f, "the tags are in sight, the vessel is silent"),
            ReasonCode::NotIdentified => {
                write!(
                    f,
                    "the deck's motion is not identified yet: it takes a minute of sight"
                )
            }
            ReasonCode::OdometryStale if v.is_infinite() => write!(f, "no odometry of the autopilot yet"),
            ReasonCode::OdometryStale => write!(f, "own odometry {v:.2} s old (limit {l:.2})"),
            ReasonCode::ForecastStale if v.is_infinite() => {
                write!(f, "no deck forecast yet: no vessel estimate was received")
            }
            ReasonCode::ForecastStale => write!(f, "deck forecast {v:.2} s old (limit {l:.2})"),
            ReasonCode::NoVision => write!(f, "deck not seen yet"),
            ReasonCode::VisionLost => write!(f, "deck not seen for {v:.2} s (limit {l:.2})"),
            ReasonCode::TooFar => write!(f, "{v:.2} m beside the deck (limit {l:.2} m)"),
            ReasonCode::OffHeight => write!(f, "{v:.1} m off its height (limit {l:.1} m)"),
            ReasonCode::Descending => write!(f, "descending, {:.1} m to the flare", (v - l).max(0.0)),
            ReasonCode::DescendingTo => {
                write!(
                    f,
                    "descending, {:.1} m to {l:.1} m above the deck",
                    (v - l).max(0.0)
                )
            }
            ReasonCode::Flaring => write!(f, "flaring, {v:.1} m above the deck"),
            ReasonCode::TooFast => write!(f, "{v:.2} m/s relative to the deck (limit {l:.2})"),
            ReasonCode::Infeasible => {
                write!(f, "predicted deck motion exceeds limits: {v:.2} (limit {l:.2})")
            }
            ReasonCode::TooSteep => {
                write!(
                    f,
                    "deck tilts {:.1} deg (limit {:.1})",
                    v.to_degrees(),
                    l.to_degrees()
                )
            }
            ReasonCode::NotSteady => write!(f, "steady for {v:.2} s (needs {l:.2})"),
            ReasonCode::NoPlan => write!(f, "no fresh plan for {v:.2} s (limit {l:.2})"),
            ReasonCode::Deviated => write!(f, "{v:.2} m off the deck's centre (limit {l:.2})"),
            ReasonCode::Missed => write!(f, "deck missed: feet {v:.2} m below it (limit {l:.2})"),
            ReasonCode::Touchdown => write!(f, "touchdown"),
            ReasonCode::BatteryLow => battery(f, " and no place to land: landing aborted"),
            ReasonCode::BatteryDeck => battery(f, ": lands on the deck, within wider limits"),
            ReasonCode::BatteryHome => battery(f, ": the autopilot returns home"),
            ReasonCode::BatteryHere => battery(f, ": the autopilot lands here"),
            ReasonCode::NoPlace => write!(f, "all {v:.0} waiting places at the vessel are taken"),
            ReasonCode::OutOfRetries => write!(f, "{v:.0} attempts used (limit {l:.0})"),
            ReasonCode::Operator => write!(f, "operator's command"),
            ReasonCode::CompletesLanding => {
                write!(
                    f,
                    "stopped where a climb would meet the deck harder than the landing: completes it"
                )
            }
            ReasonCode::TooLow => write!(f, "{v:.2} m above the water (minimum {l:.2})"),
            ReasonCode::TooLong => write!(f, "took {v:.1} s (limit {l:.1})"),
            ReasonCode::DeckReserved if v == 0.0 => write!(f, "the deck is not reserved yet"),
            ReasonCode::DeckReserved if v == f64::from(DECK_CLOSED) => {
                write!(
                    f,
                    "the deck is closed: by its crew, by its sensor, or because two drones have one number"
                )
            }
            ReasonCode::DeckReserved => write!(f, "the deck is drone {v:.0}'s"),
            ReasonCode::DeckGrantStale => write!(f, "newest deck grant {v:.1} s old (limit {l:.1})"),
            ReasonCode::LikelyHard => likely(f, "the contact may be hard"),
            ReasonCode::LikelyFast => likely(f, "it may slip along the deck"),
            ReasonCode::LikelyTilted => likely(f, "the deck may tilt too far"),
            ReasonCode::LikelyBeside => likely(f, "it may miss the deck's middle"),
            ReasonCode::LikelySlides => likely(f, "slope and wind may move it off"),
            ReasonCode::TurnTooFast => likely(f, "the vessel turns"),
            ReasonCode::FalseTouchdown => {
                write!(f, "no touchdown: feet {v:.2} m above the deck (limit {l:.2})")
            }
            ReasonCode::Restarted => write!(f, "mission restarted in flight, feet {v:.2} m above the deck"),
            ReasonCode::TiltExcess => write!(
                f,
                "tilts {:.0} deg beyond what was commanded (limit {:.0})",
                v.to_degrees(),
                l.to_degrees()
            ),
            ReasonCode::Swings => write!(
                f,
                "attitude set-points swing by {:.0} deg rms (limit {:.0}): the autopilot's attitude gains do not suit",
                v.to_degrees(),
                l.to_degrees()
            ),
            ReasonCode::AutopilotParameter => match numbered(l) {
                Some(p) => write!(f, "{}", p.describe(v)),
                None => write!(f, "a parameter of the autopilot is {v}"),
            },
            ReasonCode::AutopilotParameterUnknown => {
                let name = numbered(l).map_or("a parameter", |p| p.name);
                write!(f, "the autopilot has not reported {name} ({v:.0} requests)")?;
                if v < f64::from(REQUESTS) {
                    return Ok(());
                }
                write!(
                    f,
                    "; for a firmware without it set autopilot.check_parameters = false"
                )
            }
            ReasonCode::NoOrigin => {
                write!(f, "the autopilot has not reported its origin (GPS_GLOBAL_ORIGIN)")
            }
            ReasonCode::DeckElsewhere => write!(
                f,
                "the deck is seen {v:.1} m from where the radio places it (limit {l:.1}): another vessel's?"
            ),
            ReasonCode::HeightContradicted => write!(
                f,
                "rangefinder and camera contradict each other about the deck's height: by {v:.1} times what they err (limit {l:.1})"
            ),
            ReasonCode::HeadingUnaligned => write!(
                f,
                "the autopilot has not aligned its heading (PX4: ESTIMATOR_STATUS, ArduPilot: EKF_STATUS_REPORT)"
            ),
            ReasonCode::OriginMoved if v == 0.0 => {
                write!(f, "the autopilot's estimate of position or heading has jumped")
            }
            ReasonCode::OriginMoved => write!(f, "the autopilot's origin has moved by {v:.1} m"),
            ReasonCode::VesselTooFar => {
                write!(f, "the vessel is {:.1} km away (limit {:.0})", v / 1e3, l / 1e3)
            }
            ReasonCode::Matching => write!(f, "matches the deck for {v:.1} s (needs {l:.0})"),
            ReasonCode::TooNear => write!(f, "{v:.2} m above the deck (lowest {l:.2})"),
            ReasonCode::Matched => write!(f, "matched the deck at {v:.1} m for {l:.0} s: climbs"),
            ReasonCode::VesselTurns => write!(f, "the vessel states that she turns"),
            ReasonCode::OrderExpired => write!(
                f,
                "the order to land has ended after {v:.0} s in which the drone did not begin (limit {l:.0}): give it again"
            ),
            ReasonCode::BatteryStopped => write!(
                f,
                "battery at {:.0} %: below {:.0} % it lands on the deck, or at the next place, unless it is commanded otherwise",
                100.0 * v,
                100.0 * l
            ),
            ReasonCode::HeightUnconfirmed => write!(
                f,
                "only the radio gives the deck's height: stays {v:.0} m above it until the camera, mean sea level or a \
                 take-off from the deck agrees, or a person flies lower"
            ),
            ReasonCode::HeightsDisagree => write!(
                f,
                "the deck is {v:.0} m higher by take-off, mean sea level or camera than by the forecast (limit {l:.0}): \
                 stays above both; check the vessel's geoid separation and the autopilot's origin"
            ),
            ReasonCode::HardContact => write!(
                f,
                "hard contact at {v:.1} m/s (limit {l:.1}): inspect the drone, no further attempt"
            ),
            ReasonCode::CourseEnds => write!(
                f,
                "a landing takes {v:.0} s, and the vessel keeps her course for {l:.0} s more"
            ),
        }
    }
}

/// Where a drone with a low battery lands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum BatteryPlace {
    /// On the vessel's deck, within wider limits.
    Deck,
    /// Where the autopilot's return mode leads to.
    Home,
    /// Where it is: the autopilot's land mode.
    Here,
}

/// How far a landing goes: the ladder to a first landing.
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

/// What of the mission's configuration an operator changes from a ground station. Heights are of the drone's centre of mass
/// above the deck's mean level.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionSettings {
    /// How far the landing goes.
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

/// By what a drone knows its vessel, the least first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "kebab-case")]
pub enum VesselLevel {
    /// By the tags on its deck alone.
    Tag,
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
    /// Descents begun so far.
    pub attempts: u32,
    /// Height of the drone's centre of mass above the deck's mean that the state asks for, m.
    pub height_m: f64,
    /// Permitted speed of descent relative to the deck, m/s; 0 when descent is not permitted.
    pub descent_mps: f64,
    /// The trajectory must stay above this height over the water (NED z is its negative), m.
    pub minimum_altitude_m: f64,
    /// Where to hold in `Hold`, `GetAltitude` and `GaveUp`: drone's NED, m.
    pub hold_position: [f64; 3],
    /// Heading to hold there, rad.
    pub hold_yaw: f64,
    /// Low over the deck: until it is as high as there, the drone climbs in place over the deck and moves with it.
    pub with_deck: bool,
    /// Waits beside the deck: there, from the deck's centre, north and east, m.
    pub waiting_offset: Option<[f64; 2]>,
    /// What an operator may have changed.
    pub settings: MissionSettings,
    /// They may be changed: the drone is disarmed, and no landing is ordered.
    pub settable: bool,
    /// The least by which a vessel has to be known for a landing to begin.
    pub least_vessel: VesselLevel,
    /// No plan leads lower over the deck, along its normal, m; None: onto it.
    pub lowest_clearance_m: Option<f64>,
    /// Below this clearance only hard reasons break a landing off, m.
    pub commit_clearance_m: f64,
    /// Remaining battery that the way to the deck and one attempt take, or that is kept in any case, 0 to 1.
    pub battery_reserve: f64,
    /// How likely a landing from here succeeds, 0 to 1; None while that is not known.
    pub likelihood: Option<f64>,
    /// The true wind apart from the drone's own way, towards north and east, m/s; None until it is known to 3 m/s.
    pub wind: Option<[f64; 2]>,
    /// Where it lands, once the battery is below the reserve.
    pub low_battery: Option<BatteryPlace>,
    /// Boot and sequence of the newest abort that it has received.
    pub abort: Option<[u32; 2]>,
}

impl MissionState {
    /// The state was entered for a cause that people have to know of: an end without a landing or with a hard one, a hold
    /// that nobody commanded, a descent that was broken off.
    pub fn was_entered_in_trouble(&self) -> bool {
        let broken_off = matches!(self.previous, State::Descent | State::Flare)
            && self.entered.code != ReasonCode::Matched;
        match self.state {
            State::GaveUp => true,
            State::Landed => self.entered.code == ReasonCode::HardContact,
            State::Hold => {
                broken_off || !matches!(self.entered.code, ReasonCode::Operator | ReasonCode::Matched)
            }
            State::Idle | State::GetAltitude | State::Approach | State::Tracking | State::TrackingStable => {
                broken_off
            }
            State::Descent | State::Flare => false,
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
        )
    }
    /// Where to hold, drone's NED, m.
    pub fn hold_position(&self) -> Vector3<f64> {
        Vector3::from(self.hold_position)
    }
}

/// Checkpoint of the mission: a successor goes on from there when the process ends in flight.
///
/// It is published with every [`MissionState`], and validated by the successor before it counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct MissionCheckpoint {
    /// Identity of the writer and time of writing; boot 0: there is none.
    pub header: Header<DroneClock>,
    /// The state published last.
    pub state: MissionState,
    /// A landing is wanted.
    pub landing: bool,
    /// When the landing was begun.
    pub started: Time<DroneClock>,
    /// The charge at which the operator asked for a landing below the battery's reserve, 0 to 1; None: above it.
    pub ordered_below: Option<f64>,
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
}

/// What an operator wants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
pub enum CommandKind {
    /// Land on the vessel.
    #[default]
    Land,
    /// Stop landing, climb and hold; always wins. Where a climb would meet the deck harder
    /// than the landing does, that is completed.
    Abort,
    /// Hold where you are (not below the tracking height over the deck).
    Hold,
}

/// A command to the mission.
pub type Command = OperatorCommand<DroneClock>;

/// A command for the drone that its header names: from an operator to the vessel, from the vessel to the drone, and to
/// the mission.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct OperatorCommand<C: Clock> {
    /// Identity, and time it was given.
    pub header: Header<C>,
    /// What to do.
    pub kind: CommandKind,
}

message!(@C OperatorCommand<C>, C, |m| {});
restamped!(OperatorCommand { kind });

/// How far an operator's command has come at the vessel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(u8)]
#[serde(rename_all = "snake_case")]
pub enum CommandProgress {
    /// Repeated to the drone, which has not shown that it has taken it: an abort for as long as that takes.
    #[default]
    Pending,
    /// A status of the drone that came after it shows it; of an abort its own echo.
    Taken,
    /// The drone did not take it in time.
    GivenUp,
    /// Not passed on: an abort that the operator may not know of was pending, or given just before.
    Forbidden,
    /// A newer command for the drone came.
    Replaced,
    /// Known from before a restart of the vessel, and not repeated any more.
    Unknown,
}

/// Receipt of one command of an operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CommandReceipt {
    /// Identity of the vessel, the drone that the command is for, and the time of this progress.
    pub header: Header<VesselClock>,
    /// Boot and sequence of the operator's message: the vessel's own repetitions have others.
    pub operator: [u32; 2],
    /// What was commanded.
    pub kind: CommandKind,
    /// How far it has come.
    pub progress: CommandProgress,
}

message!(CommandReceipt, VesselClock, |m| {});

impl CommandKind {
    /// Whether a mission that stands so, and waits for this, has done what was commanded.
    pub fn is_met(self, state: State, waiting: ReasonCode) -> bool {
        match self {
            // A mission that was commanded and waits for something else has received it.
            CommandKind::Land => match state {
                State::Idle => !matches!(waiting, ReasonCode::NotCommanded | ReasonCode::Operator),
                State::Hold => waiting != ReasonCode::Operator,
                State::GaveUp => false,
                State::GetAltitude
                | State::Approach
                | State::Tracking
                | State::TrackingStable
                | State::Descent
                | State::Flare
                | State::Landed => true,
            },
            // On the deck there is nothing to break off; a waiting mission reports when it has received it.
            CommandKind::Abort => {
                matches!(state, State::GaveUp | State::Landed)
                    || state == State::Idle && waiting == ReasonCode::Operator
                    || waiting == ReasonCode::CompletesLanding
            }
            CommandKind::Hold => {
                matches!(state, State::Hold | State::Idle) && waiting == ReasonCode::Operator
                    || state == State::Landed
                    || waiting == ReasonCode::CompletesLanding
            }
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
    /// Descents begun so far.
    pub attempts: u32,
    /// Remaining battery, 0 to 1; None when the autopilot does not report it.
    pub battery: Option<f64>,
    /// The autopilot's own opinion of where it is.
    pub landed: LandedState,
    /// Horizontal distance from the deck's centre by odometry and forecast, m; None while either is old.
    pub deck_distance_m: Option<f32>,
    /// Boot and sequence of the newest abort that the mission has received.
    pub abort: Option<[u32; 2]>,
    /// The motors are armed, by the autopilot's newest report.
    pub armed: bool,
    /// Landed and armed for longer than the disarm on the deck takes: since the landing, s.
    pub still_armed_s: Option<f32>,
    /// Age of the mission's state when this was sent, s: its process may have ended, or hang.
    pub mission_age_s: f32,
}

/// What to do about a drone that is on the deck and armed, as people read it after its subject.
pub fn still_armed(for_s: f32) -> String {
    format!("landed and still ARMED for {for_s:.0} s: disarm by remote control")
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
    /// Of a velocity towards north and east, m/s.
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
});
message!(MissionState, DroneClock, |m| {
    within(&m.hold_position, MAX_POSITION_M) && within([&m.hold_yaw], 50.0) => "hold_position",
    within(m.waiting_offset.iter().flatten(), MAX_POSITION_M) => "waiting_offset",
    m.settings.is_sane() => "settings",
    m.lowest_clearance_m.is_none_or(|c| (0.0..=1e3).contains(&c)) => "lowest_clearance_m",
    (0.0..=10.0).contains(&m.commit_clearance_m) => "commit_clearance_m",
    (0.0..=1e3).contains(&m.battery_reserve) => "battery_reserve",
    m.likelihood.is_none_or(|p| FRACTION.contains(&p)) => "likelihood",
    m.wind.is_none_or(|w| within(&w, MAX_SPEED_MPS)) => "wind",
    (0.0..=1e3).contains(&m.height_m) && (0.0..=10.0).contains(&m.descent_mps) => "height_m or descent_mps",
});
message!(SettingsOrder, DroneClock, |m| {
    m.settings.is_sane() => "settings",
});
message!(MissionCheckpoint, DroneClock, |m| {
    m.state.header.version == m.header.version && super::Message::check(&m.state).is_ok() => "state",
    m.datum.is_on_earth() => "datum",
    m.mean_deck_z.is_none_or(|z| within([&z], MAX_POSITION_M)) => "mean_deck_z",
    m.ordered_below.is_none_or(|b| FRACTION.contains(&b)) => "ordered_below",
});
