//! Why the mission changed its state, or why it does not: a code with the figure that decided and its limit, and its text for
//! people.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grant::DECK_CLOSED;
use crate::autopilot_parameters::{REQUESTS, numbered};

/// Nearer to its station a drone keeps it, m: what it is off in wind and waves.
const NEAR_STATION_M: f64 = 5.0;

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

/// Text on a value of the autopilot's parameter of this number.
fn parameter(value: f64, number: f64) -> String {
    let unknown = || format!("a parameter of the autopilot is {value}");
    numbered(number).map_or_else(unknown, |p| p.describe(value).to_string())
}

/// Name of the autopilot's parameter of this number.
fn parameter_name(number: f64) -> &'static str {
    numbered(number).map_or("a parameter", |p| p.name)
}

/// Codes, each with its text: that of the first condition which holds, else the first. `v` is the figure and `l` its limit.
macro_rules! reasons {
    (
        ($v:ident, $l:ident, $v_percent:ident, $l_percent:ident, $v_deg:ident, $l_deg:ident, $left:ident, $likely:ident,
         $needed:ident)
        $($(#[$meta:meta])* $code:ident {
            $text:literal $(, $argument:expr)* $(; if $when:expr => $special:literal $(, $special_argument:expr)*)*
        })*
    ) => {
        /// Why a transition happened, or why the next one does not.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum ReasonCode {
            $($(#[$meta])* $code,)*
        }

        impl ReasonCode {
            /// All of them.
            pub const ALL: &'static [ReasonCode] = &[$(ReasonCode::$code),*];

            /// Forms of its text, with figures in braces.
            pub const fn texts(self) -> &'static [&'static str] {
                match self {
                    $(ReasonCode::$code => &[$text $(, $special)*],)*
                }
            }
        }

        impl fmt::Display for Reason {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let ($v, $l) = (self.value, self.limit);
                let ($v_percent, $l_percent) = (100.0 * $v, 100.0 * $l);
                let ($v_deg, $l_deg) = ($v.to_degrees(), $l.to_degrees());
                let ($left, $likely, $needed) = (($v - $l).max(0.0), $v_percent.floor(), $l_percent.ceil());
                match self.code {
                    $(ReasonCode::$code => {
                        $(if $when {
                            return write!(f, $special $(, $special_argument)*);
                        })*
                        write!(f, $text $(, $argument)*)
                    })*
                }
            }
        }
    };
}

reasons! {
    (v, l, v_percent, l_percent, v_deg, l_deg, left, likely, needed)
    /// No reason.
    #[default]
    None { "" }
    /// A landing was commanded.
    Commanded { "landing commanded" }
    /// At the height of the approach.
    HeightReached { "at the height of the approach" }
    /// No landing was commanded.
    NotCommanded { "no landing commanded" }
    /// The drone is not flying, not armed or not in the mode that takes set-points.
    NotFlying { "not flying, not armed, or not in OFFBOARD (PX4) or GUIDED (ArduPilot)" }
    /// No message of the vessel yet.
    NoVessel { "no vessel state received from within 100 km" }
    /// The drone's own odometry is too old, s.
    OdometryStale { "own odometry {v:.2} s old (limit {l:.2})";
        if v.is_infinite() => "no odometry of the autopilot yet" }
    /// The deck forecast is too old, s.
    ForecastStale { "deck forecast {v:.2} s old (limit {l:.2})";
        if v.is_infinite() => "no deck forecast yet: no vessel estimate was received" }
    /// Neither a tag nor a UVDAR marker was detected yet.
    NoVision { "deck not detected yet" }
    /// The deck was not detected for too long, s.
    VisionLost { "deck not detected for {v:.2} s (limit {l:.2})" }
    /// Horizontal distance to the deck is too large, m.
    TooFar { "{v:.2} m off the deck (limit {l:.2} m)" }
    /// Relative horizontal speed is too large, m/s.
    TooFast { "{v:.2} m/s relative to the deck (limit {l:.2})" }
    /// The deck's predicted speed or acceleration exceeds what the drone can follow.
    Infeasible { "predicted deck motion exceeds limits: {v:.2} (limit {l:.2})" }
    /// The deck's predicted tilt exceeds the limit, rad.
    TooSteep { "deck tilts {v_deg:.1} deg (limit {l_deg:.1})" }
    /// Not yet steady above the deck for long enough, s.
    NotSteady { "steady for {v:.2} s (needs {l:.2})" }
    /// The plan is too old or the solver found none, s.
    NoPlan { "no fresh plan for {v:.2} s (limit {l:.2})" }
    /// The drone left the cone above the deck, m.
    Deviated { "{v:.2} m off the deck's centre (limit {l:.2})" }
    /// The deck was missed: still no contact, m below it.
    Missed { "deck missed: feet {v:.2} m below it (limit {l:.2})" }
    /// Touchdown was detected.
    Touchdown { "touchdown" }
    /// Battery below the reserve, fraction.
    BatteryLow { "battery at {v_percent:.0} % (needs {l_percent:.0} %) and no place to land: landing aborted" }
    /// Attempts used up.
    OutOfRetries { "attempts used: {v:.0} (limit {l:.0})" }
    /// An operator commanded it.
    Operator { "operator's command" }
    /// Below the minimum altitude, m.
    TooLow { "{v:.2} m above the water (minimum {l:.2})" }
    /// A state lasted longer than its limit, s.
    TooLong { "took {v:.1} s (limit {l:.1})" }
    /// The vessel's deck is another drone's: its number.
    DeckReserved { "the deck is drone {v:.0}'s";
        if v == 0.0 => "the deck is not reserved yet";
        if v == f64::from(DECK_CLOSED) => "the deck is closed: by its crew, by its sensor, or because two drones \
            have one number" }
    /// The newest deck grant is too old, s.
    DeckGrantStale { "newest deck grant {v:.1} s old (limit {l:.1})" }
    /// A landing is not likely enough, by its probability: the speed onto the deck costs most of it.
    LikelyHard { "a landing is {likely:.0} % likely (needs {needed:.0}): the contact may be hard" }
    /// A landing is not likely enough for its speed along the deck.
    LikelyFast { "a landing is {likely:.0} % likely (needs {needed:.0}): it may slip along the deck" }
    /// A landing is not likely enough for the angle between drone and deck.
    LikelyTilted { "a landing is {likely:.0} % likely (needs {needed:.0}): the deck may tilt too far" }
    /// A landing is not likely enough for its place.
    LikelyBeside { "a landing is {likely:.0} % likely (needs {needed:.0}): it may miss the deck's middle" }
    /// A landing is not likely enough for slope and wind, in which a landed drone slides off.
    LikelySlides { "a landing is {likely:.0} % likely (needs {needed:.0}): slope and wind may move it off" }
    /// The feet are above the deck although a touchdown was detected, m.
    FalseTouchdown { "no touchdown: feet {v:.2} m above the deck (limit {l:.2})" }
    /// The mission was restarted in flight near the deck, m above it.
    Restarted { "mission restarted in flight, feet {v:.2} m above the deck" }
    /// Battery below the reserve, fraction, with the deck below: the landing goes on within wider limits.
    BatteryDeck { "battery at {v_percent:.0} % (needs {l_percent:.0} %): lands on the deck, within wider limits" }
    /// The drone tilts beyond what was commanded, rad: its autopilot loses the attitude.
    TiltExcess { "tilts {v_deg:.0} deg beyond what was commanded (limit {l_deg:.0})" }
    /// A parameter of the autopilot must be another: its value; the limit is its number in
    /// [`crate::autopilot_parameters`].
    AutopilotParameter { "{}", parameter(v, l) }
    /// A parameter of the autopilot was not reported: requests so far; the limit is its number, as above.
    AutopilotParameterUnknown { "the autopilot has not reported {} ({v:.0} requests); for a firmware without it set \
        autopilot.check_parameters = false", parameter_name(l);
        if v < f64::from(REQUESTS) => "the autopilot has not reported {} ({v:.0} requests)", parameter_name(l) }
    /// The vessel's waiting places are all taken: their number.
    NoPlace { "all {v:.0} waiting places at the vessel are taken" }
    /// Battery below the reserve, fraction: the autopilot returns home.
    BatteryHome { "battery at {v_percent:.0} % (needs {l_percent:.0} %): the autopilot returns home" }
    /// Battery below the reserve, fraction: the autopilot lands where it is.
    BatteryHere { "battery at {v_percent:.0} % (needs {l_percent:.0} %): the autopilot lands here" }
    /// Stopped by an operator where a climb would meet the deck harder than the landing does: it is completed.
    CompletesLanding { "stopped where a climb would meet the deck harder than the landing: completes it" }
    /// The autopilot has not reported where its NED begins.
    NoOrigin { "the autopilot has not reported its origin (GPS_GLOBAL_ORIGIN)" }
    /// The drone's origin or its position estimate has jumped, and no forecast has come since; by so much the origin, m.
    OriginMoved { "the autopilot's origin has moved by {v:.1} m";
        if v == 0.0 => "the autopilot's estimate of position or heading has jumped" }
    /// The vessel is too far away, m.
    VesselTooFar { "the vessel is {:.1} km away (limit {:.0})", v / 1e3, l / 1e3 }
    /// Follows the deck at its lowest clearance and does not land: for so long, s.
    Matching { "matches the deck for {v:.1} s (needs {l:.0})" }
    /// Nearer to the deck than it may come, m.
    TooNear { "{v:.2} m above the deck (lowest {l:.2})" }
    /// Has followed the deck at this clearance, m, for as long as it was to, s.
    Matched { "matched the deck at {v:.1} m for {l:.0} s: climbs" }
    /// The vessel states that she turns or may turn.
    VesselTurns { "the vessel states that she turns" }
    /// The landing would outlast the stated steadiness of the vessel's course: its time, and what is left of it, s.
    CourseEnds { "a landing takes {v:.0} s, and the vessel keeps her course for {l:.0} s more" }
    /// A landing is not likely enough, by its probability: the vessel's turn costs most of it.
    TurnTooFast { "a landing is {likely:.0} % likely (needs {needed:.0}): the vessel turns" }
    /// The commanded attitude swings to and fro besides what plan and wind ask for, root mean square, rad.
    Swings { "attitude set-points swing by {v_deg:.0} deg rms (limit {l_deg:.0}): the autopilot's attitude gains do \
        not suit" }
    /// The order to land has ended: the drone did not fly, or nothing else let it begin, for so long, s.
    OrderExpired { "the order to land has ended after {v:.0} s in which the drone did not begin (limit {l:.0}): give \
        it again" }
    /// Nothing but the radio gives the deck's height: the drone stays so high above it, m, until something confirms it.
    HeightUnconfirmed { "only the radio gives the deck's height: stays {v:.0} m above it until the camera, mean sea \
        level or a take-off from the deck agrees, or a person flies lower" }
    /// Battery below the reserve, fraction, with the landing stopped: a place is chosen below the limit, unless an operator
    /// decides before.
    BatteryStopped { "battery at {v_percent:.0} %: below {l_percent:.0} % it lands on the deck, or at the next \
        place, unless it is commanded otherwise" }
    /// By another witness the deck is so much higher than by the forecast, m: the drone stays above both.
    HeightsDisagree { "the deck is {v:.0} m higher by take-off, mean sea level or camera than by the forecast (limit \
        {l:.0}): stays above both; check the vessel's geoid separation and the autopilot's origin" }
    /// The deck was met harder than drones are built for: the speed, m/s.
    HardContact { "hard contact at {v:.1} m/s (limit {l:.1}): inspect the drone, no further attempt" }
    /// The autopilot has not aligned its heading, or knows its position no more.
    HeadingUnaligned { "the autopilot has not aligned its heading (PX4: ESTIMATOR_STATUS, ArduPilot: \
        EKF_STATUS_REPORT)" }
    /// The deck is detected elsewhere than where the radio places it: apart by, m, and what both may err.
    DeckElsewhere { "the deck is detected {v:.1} m from where the radio places it (limit {l:.1}): another vessel's?" }
    /// The rangefinder contradicts the camera about the deck's height, in standard deviations of both.
    HeightContradicted { "rangefinder and camera contradict each other about the deck's height: by {v:.1} times what \
        they err (limit {l:.1})" }
    /// On its way to the height that it is to hold: off it, m.
    OffHeight { "{v:.1} m off its height (limit {l:.1} m)" }
    /// Descends: height above the deck, m, and that at which the flare begins.
    Descending { "descending, {left:.1} m to the flare" }
    /// Descends to follow the deck: height above it, m, and that at which it follows.
    DescendingTo { "descending, {left:.1} m to {l:.1} m above the deck" }
    /// Flares: height above the deck, m.
    Flaring { "flaring, {v:.1} m above the deck" }
    /// The deck is in sight for long enough.
    InSight { "the deck is in sight" }
    /// Steady above the deck, s.
    Steady { "steady above the deck for {v:.1} s" }
    /// Nothing speaks against a descent.
    Permitted { "the descent is permitted" }
    /// At the height of the flare, m.
    FlareHeight { "{v:.1} m above the deck: flare" }
    /// Armed again, by the pilot, after the landing.
    ArmedAgain { "armed again after the landing" }
    /// The data that was missing is back, s.
    Recovered { "what was missing is back for {v:.1} s" }
    /// The motion of a vessel that is known by its tags alone is not identified yet.
    NotIdentified { "the deck's motion is not identified yet: it takes a minute of vision" }
    /// The tags of a vessel that is not received are detected.
    TagsInSight { "the tags are detected, the vessel is silent" }
    /// The vessel is known by its beacon alone: the standard deviation of its place, m, and the beacon's age, s.
    KnownByBeacon { "vessel known by beacon, {v:.0} m, {l:.1} s old" }
    /// Above the beacon's predicted place the tags are not detected: its distance, m, and how far is searched around it, m.
    AtBeacon { "no tags at the beacon's place: searches {l:.0} m around it" }
    /// Looks for the tags around the beacon's place: flown so far, m, and the whole pattern's length, m.
    Searching { "searches for the tags, {v:.0} m of {l:.0} m flown" }
    /// The tags were nowhere around the beacon's place: searched to this distance, m, which took so long, s.
    NotFound { "no tags within {v:.0} m of the beacon in {l:.0} s of search" }
    /// The beacon's place is known too poorly for a search: the distance that it would have to reach, m, and the limit.
    BeaconVague { "the beacon is too inexact: the search would reach {v:.0} m (limit {l:.0})" }
    /// Several decks with this deck's tags are in sight, and it is not known which is its own: their number.
    SeveralDecks { "{v:.0} decks with these tags are near, and none in sight is known as its own" }
    /// A take-off was commanded.
    TakeOffCommanded { "take-off commanded" }
    /// Take-offs are off: `drone.mission.takeoff`, or a mode in which nothing is commanded.
    TakeOffOff { "take-off is off (drone.mission.takeoff = false, or mode = \"shadow\")" }
    /// The drone does not stand on the deck, disarmed: its distance from the centre, m, and the most that it may be.
    NotOnDeck { "not on the deck: {v:.1} m from its centre (limit {l:.0})";
        if v <= l => "the drone is not disarmed on the ground" }
    /// The crew has not cleared the deck for a take-off.
    NotCleared { "the crew has not cleared the deck for a take-off" }
    /// Counts down: what is left, s.
    Counting { "motors start in {:.0} s: stand clear", v.ceil() }
    /// The countdown is over.
    CountedDown { "counted down: motors start" }
    /// Waits for the autopilot to arm: since, s, and for how long.
    Arming { "the autopilot has not armed for {v:.0} s (limit {l:.0})" }
    /// The autopilot has not armed: after, s, and the limit.
    ArmingRejected { "the autopilot did not arm within {l:.0} s: its own text has the reason" }
    /// By the autopilot's report the rotors do not turn yet: armed for so long, s, and the limit.
    SpinningUp { "the autopilot reports no rotors that turn, {v:.1} s after arming (limit {l:.1})" }
    /// A take-off is not likely enough, by its probability: the deck tilts, or moves sideways.
    TakeOffTilted { "a take-off is {likely:.0} % likely (needs {needed:.0}): the deck tilts or slides away" }
    /// A take-off is not likely enough: the deck may rise into the drone.
    TakeOffHit { "a take-off is {likely:.0} % likely (needs {needed:.0}): the deck may rise into it" }
    /// A better moment to take off comes soon: its probability now and then.
    BetterMoment { "a take-off is {likely:.0} % likely now, {:.0} % within seconds", l_percent.floor() }
    /// The moment to take off, with its probability.
    GoodMoment { "a take-off is {likely:.0} % likely now" }
    /// No moment to take off came: waited for, s, and the limit.
    NoMoment { "no moment to take off in {v:.0} s (limit {l:.0})" }
    /// Leaves the deck: risen by, m.
    Leaving { "leaves the deck, {v:.1} m above it" }
    /// The feet do not leave the deck: risen by, m, and what it had to be by then.
    DoesNotRise { "rose by {v:.2} m only (needs {l:.2}): held, too heavy, or a motor that does not follow" }
    /// The drone tips on the deck, as a foot that is held makes it: angle to the deck, rad, and the most that it may be.
    TipsOver { "tips on the deck by {v_deg:.0} deg (limit {l_deg:.0}): is a foot held?" }
    /// Clear of the deck: risen by, m.
    ClearOfDeck { "clear of the deck by {v:.1} m" }
    /// At its height after the take-off.
    TakenOff { "at its height after the take-off" }
    /// Stands on the deck armed after a stopped take-off: for so long, s.
    StillArmed { "stands armed for {v:.0} s: if it stays so, disarm by remote control" }
    /// The autopilot is disarmed.
    Disarmed { "disarmed on the deck" }
    /// Battery too low for a take-off: its charge, fraction.
    TakeOffBattery { "battery at {v_percent:.0} % (needs {l_percent:.0} %) for a take-off" }
    /// A sortie ends: what is left of the battery, fraction, and what the way back to the vessel and one missed attempt take.
    TurnsBack { "battery at {v_percent:.0} % (needs {l_percent:.0} %): turns back to the vessel" }
    /// A sortie ends: the autopilot has flown all of its own mission.
    MissionDone { "the autopilot's mission is done: returns to the vessel" }
    /// A sortie ends: an operator has ordered the drone back from the autopilot's own mission.
    OrderedBack { "ordered back: ends the autopilot's mission" }
    /// The autopilot has not begun its own mission, which it was handed to: after, s, and the limit.
    HandOverRefused { "the autopilot did not begin its own mission within {l:.0} s: lands, no further sortie" }
    /// Stands on the deck until it is ready for the next sortie: its charge, fraction, and that at which it goes by itself.
    NotReady { "ready for the next sortie at {l_percent:.0} % (has {v_percent:.0} %), or by alight command ready" }
    /// Ready for the next sortie: its number, and how many there are to be.
    SortieBegins { "ready: sortie {v:.0} of {l:.0}" }
    /// All sorties are done: their number, and how many there were to be.
    SortiesDone { "all sorties are done: {v:.0} (limit {l:.0})";
        if l == 0.0 => "no unattended cycles (drone.mission.sorties_max = 0)";
        if v < l => "no cycles go on, {v:.0} of {l:.0} sorties begun: order a take-off" }
    /// Out of radio range: on its way to where the vessel should be, m, which has been silent for so long, s.
    SeeksVessel { "no radio for {l:.0} s: flies to where the vessel should be, {v:.0} m" }
    /// After a take-off: hands over to the autopilot's own mission, since, s, and for how long.
    HandsOver { "hands over to the autopilot's own mission" }
    /// Too dark for the camera to detect a tag: mean of its image, grey levels; the limit is its longest exposure, s, 0 where the
    /// drone does not set it.
    TooDark { "too dark to see the tags (image mean {v:.0} of 255, exposed by the camera itself): light the deck or \
        its tags";
        if l > 0.0 => "too dark to see the tags (image mean {v:.0} of 255, exposure of {:.1} ms and gain at their \
            limits): light the deck or its tags", 1e3 * l }
    /// Autopilots of two vehicles are received on the link: the system that is followed, and the other.
    SeveralAutopilots { "autopilots {v:.0} and {l:.0} received: set autopilot.vehicle" }
    /// The remote control's switch is held where it aborts.
    SwitchAborts { "the remote control's switch stands on abort" }
    /// A light blinds the camera: part of its image, %, that is at its brightest while no tag is detected; the limit is how much a
    /// glint has.
    Glare { "blinded: no tag detected, and {v:.1} % of the image is at its brightest (limit {l:.1} %): dim or screen \
        the lamp" }
    /// Keeps a place next to the vessel that an operator has named, or is on its way there: the time left, s, and how far from it, m.
    OnStation { "{l:.0} m from its station, {:.0} min left", (v / 60.0).ceil();
        if l <= NEAR_STATION_M => "keeps its station, {:.0} min left", (v / 60.0).ceil() }
    /// The time on the station is over.
    StationOver { "the time on the station is over" }
    /// A station has to be at least as high as an approach: its height, m, and the minimum.
    StationTooLow { "no station {v:.0} m up: {l:.0} m at least, the height of the approach" }
    /// A station is over the deck of another drone, or of none: its horizontal distance from the deck's centre, m, and the minimum.
    StationTooNear { "no station {v:.0} m from a deck that is not its own: {l:.0} m at least" }
    /// A station is at another drone's height: that one's, m, and how far it has to be from it.
    StationTaken { "another drone waits {v:.0} m up: a station has to be {l:.0} m higher or lower" }
    /// No station is taken from here: the drone takes off, is on its way down, stands or looks for the vessel.
    StationNotNow { "no station from here: it takes off, descends, stands or looks for the vessel" }
    /// An order is not carried out: the pilot, the autopilot's own mission or its hold has the drone.
    NotInControl { "the pilot or the autopilot's own mode has the drone: choose another mode there, or order a \
        landing" }
    /// An order to land is not carried out: the drone stands on the deck.
    OnDeck { "the drone stands on the deck" }
    /// An order to land is not carried out: the drone is about to take off, or that was just stopped.
    DuringTakeOff { "it takes off: abort that, or order again once it is clear of the deck" }
    /// The drone follows set-points again, near the deck: feet above it, m.
    GivenBack { "follows set-points again, feet {v:.2} m above the deck" }
    /// The autopilot reports no battery.
    BatteryUnknown { "the autopilot reports no battery: ArduPilot does with BATT_MONITOR = 4, PX4 with a calibrated \
        power module" }
    /// No two witnesses show that a drone whose rotors turn stands on the deck: it may be in the air, and climbs.
    MayFly { "nothing shows that it stands on the deck (rangefinder, way up, what carries it): climbs out" }
    /// The mission stood still for too long and begins again: feet above the deck, m, and how long it stood still, s.
    StoodStill { "mission stood still for {l:.1} s, feet {v:.2} m above the deck: begins again" }
    /// An unsafe contact is too likely: its probability.
    HarmLikely { "an unsafe contact is {v_percent:.1} % likely (limit {l_percent:.1})" }
    /// The deck's dimensions in the drone's configuration are not the vessel's: those that differ most, the drone's and, as the
    /// limit, the vessel's, m.
    DeckDiffers { "a dimension of the deck is {v:.2} m in the drone's configuration and {l:.2} m in the vessel's" }
    /// Battery below the reserve, fraction, and the deck not open: it is awaited until this charge, fraction; 0: no other place is
    /// in reach.
    BatteryWaits { "battery at {v_percent:.0} %: waits for the deck, no other place is in reach";
        if l > 0.0 => "battery at {v_percent:.0} %: waits for the deck until {l_percent:.0} %, which the next place \
            needs" }
    /// The charge is above the reserve again, fraction.
    BatteryRecovered { "battery at {v_percent:.0} % (needs {l_percent:.0} %): goes on" }
}
