//! Why the mission changed its state, or why it does not: a code with the figure that decided and its limit.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(super) mod display;

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
    /// Neither a tag nor a UVDAR marker was detected yet.
    NoVision,
    /// The deck was not detected for too long, s.
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
    /// A landing is not likely enough for its speed along the deck.
    LikelyFast,
    /// A landing is not likely enough for the angle between drone and deck.
    LikelyTilted,
    /// A landing is not likely enough for its place.
    LikelyBeside,
    /// A landing is not likely enough for slope and wind, in which a landed drone slides off.
    LikelySlides,
    /// The feet are above the deck although a touchdown was detected, m.
    FalseTouchdown,
    /// The mission was restarted in flight near the deck, m above it.
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
    /// The deck is detected elsewhere than where the radio places it: apart by, m, and what both may err.
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
    /// Armed again, by the pilot, after the landing.
    ArmedAgain,
    /// The data that was missing is back, s.
    Recovered,
    /// The motion of a vessel that is known by its tags alone is not identified yet.
    NotIdentified,
    /// The tags of a vessel that is not received are detected.
    TagsInSight,
    /// The vessel is known by its beacon alone: the standard deviation of its place, m, and the beacon's age, s.
    KnownByBeacon,
    /// Above the beacon's predicted place the tags are not detected: its distance, m, and how far is searched around it, m.
    AtBeacon,
    /// Looks for the tags around the beacon's place: flown so far, m, and the whole pattern's length, m.
    Searching,
    /// The tags were nowhere around the beacon's place: searched to this distance, m, which took so long, s.
    NotFound,
    /// The beacon's place is known too poorly for a search: the distance that it would have to reach, m, and the limit.
    BeaconVague,
    /// Several decks with this deck's tags are in sight, and it is not known which is its own: their number.
    SeveralDecks,
    /// A take-off was commanded.
    TakeOffCommanded,
    /// Take-offs are off: `drone.mission.takeoff`, or a mode in which nothing is commanded.
    TakeOffOff,
    /// The drone does not stand on the deck, disarmed: its distance from the centre, m, and the most that it may be.
    NotOnDeck,
    /// The crew has not cleared the deck for a take-off.
    NotCleared,
    /// Counts down: what is left, s.
    Counting,
    /// The countdown is over.
    CountedDown,
    /// Waits for the autopilot to arm: since, s, and for how long.
    Arming,
    /// The autopilot has not armed: after, s, and the limit.
    ArmingRejected,
    /// By the autopilot's report the rotors do not turn yet: armed for so long, s, and the limit.
    SpinningUp,
    /// A take-off is not likely enough, by its probability: the deck tilts, or moves sideways.
    TakeOffTilted,
    /// A take-off is not likely enough: the deck may rise into the drone.
    TakeOffHit,
    /// A better moment to take off comes soon: its probability now and then.
    BetterMoment,
    /// The moment to take off, with its probability.
    GoodMoment,
    /// No moment to take off came: waited for, s, and the limit.
    NoMoment,
    /// Leaves the deck: risen by, m.
    Leaving,
    /// The feet do not leave the deck: risen by, m, and what it had to be by then.
    DoesNotRise,
    /// The drone tips on the deck, as a foot that is held makes it: angle to the deck, rad, and the most that it may be.
    TipsOver,
    /// Clear of the deck: risen by, m.
    ClearOfDeck,
    /// At its height after the take-off.
    TakenOff,
    /// Stands on the deck armed after a stopped take-off: for so long, s.
    StillArmed,
    /// The autopilot is disarmed.
    Disarmed,
    /// Battery too low for a take-off: its charge, fraction.
    TakeOffBattery,
    /// A sortie ends: what is left of the battery, fraction, and what the way back to the vessel and one missed attempt take.
    TurnsBack,
    /// A sortie ends: the autopilot has flown all of its own mission.
    MissionDone,
    /// A sortie ends: an operator has ordered the drone back from the autopilot's own mission.
    OrderedBack,
    /// The autopilot has not begun its own mission, which it was handed to: after, s, and the limit.
    HandOverRefused,
    /// Stands on the deck until it is ready for the next sortie: its charge, fraction, and that at which it goes by itself.
    NotReady,
    /// Ready for the next sortie: its number, and how many there are to be.
    SortieBegins,
    /// All sorties are done: their number, and how many there were to be.
    SortiesDone,
    /// Out of radio range: on its way to where the vessel should be, m, which has been silent for so long, s.
    SeeksVessel,
    /// After a take-off: hands over to the autopilot's own mission, since, s, and for how long.
    HandsOver,
    /// Too dark for the camera to detect a tag: mean of its image, grey levels; the limit is its longest exposure, s, 0 where the
    /// drone does not set it.
    TooDark,
    /// Autopilots of two vehicles are received on the link: the system that is followed, and the other.
    SeveralAutopilots,
    /// The remote control's switch is held where it aborts.
    SwitchAborts,
    /// A light blinds the camera: part of its image, %, that is at its brightest while no tag is detected; the limit is how much a
    /// glint has.
    Glare,
    /// Keeps a place next to the vessel that an operator has named, or is on its way there: the time left, s, and how far from it, m.
    OnStation,
    /// The time on the station is over.
    StationOver,
    /// A station has to be at least as high as an approach: its height, m, and the minimum.
    StationTooLow,
    /// A station is over the deck of another drone, or of none: its horizontal distance from the deck's centre, m, and the minimum.
    StationTooNear,
    /// A station is at another drone's height: that one's, m, and how far it has to be from it.
    StationTaken,
    /// No station is taken from here: the drone takes off, is on its way down, stands or looks for the vessel.
    StationNotNow,
    /// An order is not carried out: the pilot, the autopilot's own mission or its hold has the drone.
    NotInControl,
    /// An order to land is not carried out: the drone stands on the deck.
    OnDeck,
    /// An order to land is not carried out: the drone is about to take off, or that was just stopped.
    DuringTakeOff,
    /// The drone follows set-points again, near the deck: feet above it, m.
    GivenBack,
    /// The autopilot reports no battery.
    BatteryUnknown,
    /// No two witnesses show that a drone whose rotors turn stands on the deck: it may be in the air, and climbs.
    MayFly,
    /// The mission stood still for too long and begins again: feet above the deck, m, and how long it stood still, s.
    StoodStill,
    /// An unsafe contact is too likely: its probability.
    HarmLikely,
    /// The deck's dimensions in the drone's configuration are not the vessel's: those that differ most, the drone's and, as the
    /// limit, the vessel's, m.
    DeckDiffers,
    /// Battery below the reserve, fraction, and the deck not open: it is awaited until this charge, fraction; 0: no other place is
    /// in reach.
    BatteryWaits,
    /// The charge is above the reserve again, fraction.
    BatteryRecovered,
}

/// A reason with the figure that decided and its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Reason {
    /// Code of the reason.
    pub code: ReasonCode,
    /// The figure (unit by code).
    pub value: f64,
    /// Limit that it was compared with.
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
