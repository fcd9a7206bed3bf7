//! Reason for a transition of the mission, or for staying: code, deciding value, its limit and text.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grant::DECK_CLOSED;
use crate::autopilot_parameters::numbered;

/// Distance within which a drone counts as on its station, m: its error in wind and waves.
const NEAR_STATION_M: f64 = 5.0;

/// Reason with the deciding value and its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Reason {
    /// Code of the reason.
    pub code: ReasonCode,
    /// Deciding value; its unit depends on the code.
    pub value: f64,
    /// Limit of the value.
    pub limit: f64,
}

impl Reason {
    /// Reason without a value.
    pub const fn plain(code: ReasonCode) -> Self {
        Reason {
            code,
            value: 0.0,
            limit: 0.0,
        }
    }
    /// Reason with its value and limit.
    pub const fn new(code: ReasonCode, value: f64, limit: f64) -> Self {
        Reason { code, value, limit }
    }
}

impl From<ReasonCode> for Reason {
    fn from(code: ReasonCode) -> Self {
        Reason::plain(code)
    }
}

/// Displays two significant digits from 0.1 on, and whole numbers from 10 on.
pub struct TwoDigits(pub f64);

impl fmt::Display for TwoDigits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        let decimals = usize::from(size < 9.95) + usize::from(size < 0.995);
        let value = if size < 0.005 { 0.0 } else { self.0 };
        write!(f, "{value:.decimals$}")
    }
}

/// Time for which each reason has kept a mission from its next state.
#[derive(Clone, Debug, Default)]
pub struct WaitingTimes(Vec<(Reason, f64)>);

impl WaitingTimes {
    /// Adds `dt` (s) to the time of a reason's code.
    pub fn add(&mut self, why: Reason, dt: f64) {
        match self.0.iter_mut().find(|(known, _)| known.code == why.code) {
            Some(entry) => *entry = (why, entry.1 + dt),
            None if why.code != ReasonCode::None => self.0.push((why, dt)),
            None => {}
        }
    }
    /// Reason with the longest time, with its newest values, and that time, s.
    pub fn longest(&self) -> Option<(Reason, f64)> {
        self.0.iter().copied().max_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

/// Message about this value of the autopilot parameter identified by `number`.
fn parameter(value: f64, number: f64) -> String {
    let unknown = || format!("a parameter of the autopilot is {value}");
    numbered(number).map_or_else(unknown, |p| p.describe(value).to_string())
}

/// Name of the autopilot parameter identified by this number.
fn parameter_name(number: f64) -> &'static str {
    numbered(number).map_or("a parameter", |p| p.name)
}

/// Codes with their texts: that of the first condition that holds, otherwise the first text. `v` is the value
/// and `l` its limit.
macro_rules! reasons {
    (
        ($v:ident, $l:ident, $v_two:ident, $l_two:ident, $v_percent:ident, $l_percent:ident, $v_deg:ident, $l_deg:ident,
         $left:ident, $likely:ident, $needed:ident)
        $($(#[$meta:meta])* $code:ident {
            $text:literal $(, $argument:expr)* $(; if $when:expr => $special:literal $(, $special_argument:expr)*)*
        })*
    ) => {
        /// Reason for a transition, or for the next one to wait.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum ReasonCode {
            $($(#[$meta])* $code,)*
        }

        impl ReasonCode {
            /// All codes.
            pub const ALL: &'static [ReasonCode] = &[$(ReasonCode::$code),*];

            /// Variants of the text, with values in braces.
            pub const fn texts(self) -> &'static [&'static str] {
                match self {
                    $(ReasonCode::$code => &[$text $(, $special)*],)*
                }
            }
        }

        impl fmt::Display for Reason {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                // A small negative value would be displayed as -0.
                let shown = |x: f64| if x > -0.5 && x <= 0.0 { 0.0 } else { x };
                let ($v, $l) = (shown(self.value), shown(self.limit));
                let ($v_two, $l_two) = (TwoDigits($v), TwoDigits($l));
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
    (v, l, v_two, l_two, v_percent, l_percent, v_deg, l_deg, left, likely, needed)
    /// No reason.
    #[default]
    None { "" }
    /// A landing was commanded.
    Commanded { "landing commanded" }
    /// At approach height.
    HeightReached { "at the height of the approach" }
    /// No landing was commanded.
    NotCommanded { "no landing commanded" }
    /// The drone is not flying, not armed, or not in the mode that follows set-points; 1: it is armed in another mode.
    NotFlying { "not flying, not armed, or not in OFFBOARD (PX4) or GUIDED (ArduPilot)";
        if v > 0.0 => "armed, but not in OFFBOARD (PX4) or GUIDED (ArduPilot)" }
    /// No vessel message received yet.
    NoVessel { "no vessel state received from within 100 km";
        if v > 0.0 && v.is_finite() => "no vessel state for {v_two} s (limit {l_two})" }
    /// Own odometry too old, s.
    OdometryStale { "own odometry {v_two} s old (limit {l_two})";
        if v.is_infinite() => "no odometry of the autopilot yet" }
    /// Deck forecast too old, s.
    ForecastStale { "deck forecast {v_two} s old (limit {l_two})";
        if v.is_infinite() => "no deck forecast yet: no vessel estimate was received" }
    /// Neither a tag nor a UVDAR marker detected yet.
    NoVision { "deck not detected yet" }
    /// The deck has not been detected for too long, s.
    VisionLost { "deck not detected for {v_two} s (limit {l_two})";
        if v.is_infinite() => "deck not detected yet" }
    /// Horizontal distance to the deck is too large, m.
    TooFar { "{v_two} m off the deck (limit {l_two} m)" }
    /// Relative horizontal speed is too large, m/s.
    TooFast { "{v_two} m/s relative to the deck (limit {l_two})" }
    /// The deck's predicted speed or acceleration exceeds what the drone can follow.
    Infeasible { "predicted deck motion exceeds limits: {v_two} (limit {l_two})" }
    /// The deck's predicted tilt exceeds the limit, rad.
    TooSteep { "deck tilts {v_deg:.1} deg (limit {l_deg:.1})" }
    /// Duration of steady flight above the deck so far, s.
    NotSteady { "steady for {v_two} s (needs {l_two})" }
    /// Plan too old, none found by the solver, or none admitted by the pilot, s.
    NoPlan { "no fresh, admitted plan for {v_two} s (limit {l_two})";
        if v.is_infinite() => "no plan yet" }
    /// The drone left the cone above the deck, m.
    Deviated { "{v_two} m off the deck's centre (limit {l_two})" }
    /// Deck missed: distance of the feet below it without contact, m.
    Missed { "deck missed: feet {v_two} m below it (limit {l_two})" }
    /// Touchdown was detected.
    Touchdown { "touchdown" }
    /// Battery below the reserve and no place to land, fraction.
    BatteryLow { "battery at {v_percent:.0} % (needs {l_percent:.0} %) and no place to land: landing aborted" }
    /// All attempts used.
    OutOfRetries { "attempts used: {v:.0} (limit {l:.0})" }
    /// Operator command.
    Operator { "operator's command" }
    /// Below the minimum altitude, m.
    TooLow { "{v_two} m above the water (minimum {l_two})" }
    /// State lasted longer than its limit, s.
    TooLong { "took {v:.1} s (limit {l:.1})" }
    /// Number of the other drone that has reserved the deck.
    DeckReserved { "the deck is drone {v:.0}'s";
        if v == 0.0 => "the deck is not reserved yet";
        if v == f64::from(DECK_CLOSED) => "the deck is closed: by its crew, by its sensor, or because two drones \
            have one number" }
    /// Newest deck grant too old, s.
    DeckGrantStale { "newest deck grant {v:.1} s old (limit {l:.1})";
        if v.is_infinite() => "no deck grant of the vessel yet" }
    /// Probability of a landing too low, mainly because of the contact speed.
    LikelyHard { "probability of a landing {likely:.0} % (needs {needed:.0} %): the contact may be hard" }
    /// Probability of a landing too low because of the speed along the deck.
    LikelyFast { "probability of a landing {likely:.0} % (needs {needed:.0} %): it may slip along the deck" }
    /// Probability of a landing too low because of the angle between drone and deck.
    LikelyTilted { "probability of a landing {likely:.0} % (needs {needed:.0} %): the deck may tilt too far" }
    /// Probability of a landing too low because of the touchdown position.
    LikelyOutside { "probability of a landing {likely:.0} % (needs {needed:.0} %): it may miss the deck's middle" }
    /// Probability of a landing too low because a landed drone slides in this slope and wind.
    LikelySlides { "probability of a landing {likely:.0} % (needs {needed:.0} %): slope and wind may move it off" }
    /// Touchdown detected with the feet above the deck, m.
    FalseTouchdown { "no touchdown: feet {v_two} m above the deck (limit {l_two})" }
    /// Mission restarted in flight near the deck, m above it.
    Restarted { "mission restarted in flight, feet {v_two} m above the deck" }
    /// Battery below the reserve, fraction: the drone lands on the deck, within wider limits.
    BatteryDeck { "battery at {v_percent:.0} % (needs {l_percent:.0} %): lands on the deck, within wider limits" }
    /// Tilt beyond the commanded one, rad: the autopilot loses attitude control.
    TiltExcess { "tilts {v_deg:.0} deg beyond what was commanded (limit {l_deg:.0})" }
    /// Unsuitable value of an autopilot parameter; the limit is its number in [`crate::autopilot_parameters`].
    AutopilotParameter { "{}", parameter(v, l) }
    /// Autopilot parameter not reported: requests so far; the limit is its number, as in `AutopilotParameter`.
    AutopilotParameterUnknown { "the autopilot has not reported {} ({v:.0} requests)", parameter_name(l) }
    /// All waiting places of the vessel are taken: their number.
    NoPlace { "all {v:.0} waiting places at the vessel are taken" }
    /// Battery below the reserve, fraction: the autopilot returns home.
    BatteryHome { "battery at {v_percent:.0} % (needs {l_percent:.0} %): the autopilot returns home" }
    /// Battery below the reserve, fraction: the autopilot lands at its present position.
    BatteryHere { "battery at {v_percent:.0} % (needs {l_percent:.0} %): the autopilot lands here" }
    /// Aborted by an operator where a climb would hit the deck harder than the landing: the landing is completed.
    CompletesLanding { "stopped where a climb would hit the deck harder than the landing: completes the landing" }
    /// The autopilot has not reported the origin of its NED.
    NoOrigin { "the autopilot has not reported its origin (GPS_GLOBAL_ORIGIN)" }
    /// The origin or the position estimate has jumped, and no new forecast has arrived since: shift of the origin, m.
    OriginMoved { "the autopilot's origin has moved by {v:.1} m";
        if v == 0.0 => "the autopilot's estimate of position or heading has jumped" }
    /// The vessel is too far away, m.
    VesselTooFar { "the vessel is {:.1} km away (limit {:.0})", v / 1e3, l / 1e3 }
    /// Time spent following the deck at the lowest clearance without landing, s.
    Matching { "matches the deck for {v:.1} s (needs {l:.0})" }
    /// Closer to the deck than permitted, m.
    TooNear { "{v_two} m above the deck (lowest {l_two})" }
    /// The drone has followed the deck at this clearance, m, for the required time, s.
    Matched { "matched the deck at {v:.1} m for {l:.0} s: climbs" }
    /// The vessel states that it turns or may turn.
    VesselTurns { "the vessel states that she turns" }
    /// The landing would outlast the stated steady course: duration of the landing and remaining time of the course, s.
    CourseEnds { "a landing takes {v:.0} s, and the vessel keeps her course for {l:.0} s more" }
    /// Probability of a landing too low, mainly because of the vessel's turn.
    TurnTooFast { "probability of a landing {likely:.0} % (needs {needed:.0} %): the vessel turns" }
    /// Oscillation of the attitude set-point beyond the demand of plan and wind, root mean square, rad.
    Swings { "attitude set-points swing by {v_deg:.0} deg rms (limit {l_deg:.0}): the autopilot's attitude gains do \
        not suit" }
    /// The landing order expired: the drone was not flying, or something else prevented the start, for this time, s.
    OrderExpired { "the landing order expired after {v:.0} s without a start (limit {l:.0}): give it again" }
    /// Only the radio gives the deck's height: minimum height of the drone above it until confirmed, m.
    HeightUnconfirmed { "only the radio gives the deck's height: stays {v:.0} m above it until the camera, mean sea \
        level or a take-off from the deck agrees, or a pilot flies lower" }
    /// Battery below the reserve, fraction, after a stopped landing; below the limit a place is chosen
    /// without the operator.
    BatteryStopped { "battery at {v_percent:.0} %: below {l_percent:.0} % it lands on the deck, or at the next \
        place, unless it is commanded otherwise" }
    /// The deck is higher by another source than in the forecast: difference, m. The drone stays above both.
    HeightsDisagree { "the deck is {v:.0} m higher by take-off, mean sea level or camera than by the forecast (limit \
        {l:.0}): stays above both; check the vessel's geoid separation and the autopilot's origin" }
    /// Contact speed above the drone's structural limit, m/s.
    HardContact { "hard contact at {v:.1} m/s (limit {l:.1}): inspect the drone, no further attempt" }
    /// The autopilot has not aligned its heading, or has lost its position.
    HeadingUnaligned { "the autopilot has not aligned its heading (PX4: ESTIMATOR_STATUS, ArduPilot: \
        EKF_STATUS_REPORT)" }
    /// Distance between the deck's position by vision and by radio, m, and the bound of both errors.
    DeckElsewhere { "the deck is detected {v:.1} m from where the radio places it (limit {l:.1}): another vessel's?" }
    /// Difference between the deck's height by rangefinder and by camera, in combined standard deviations.
    HeightContradicted { "rangefinder and camera contradict each other about the deck's height: by {v:.1} \
        standard deviations (limit {l:.1})" }
    /// Distance from the hold height, m.
    OffHeight { "{v:.1} m off its height (limit {l:.1} m)" }
    /// Descent: height above the deck, m, and height at which the flare begins.
    Descending { "descending, {left:.1} m to the flare" }
    /// Descent to follow the deck: height above it, m, and height at which it is followed.
    DescendingTo { "descending, {left:.1} m to {l:.1} m above the deck" }
    /// Flare: height above the deck, m.
    Flaring { "flaring, {v:.1} m above the deck" }
    /// The deck has been in sight for long enough.
    InSight { "the deck is in sight" }
    /// Time of steady flight above the deck, s.
    Steady { "steady above the deck for {v:.1} s" }
    /// No condition prevents a descent.
    Permitted { "the descent is permitted" }
    /// At flare height, m.
    FlareHeight { "{v:.1} m above the deck: flare" }
    /// Armed again, by the pilot, after the landing.
    ArmedAgain { "armed again after the landing" }
    /// Time since the missing data returned, s.
    Recovered { "all data have been fresh for {v:.1} s" }
    /// The motion of a vessel known by its tags alone is not identified yet.
    NotIdentified { "the deck's motion is not identified yet: it takes a minute of vision" }
    /// Tags of a vessel without radio are detected.
    TagsInSight { "the tags are detected, the vessel is silent" }
    /// The vessel is known by its beacon alone: standard deviation of its position, m, and age of the beacon, s.
    KnownByBeacon { "vessel known by beacon, {v:.0} m, {l:.1} s old" }
    /// No tags detected above the beacon's predicted position: distance to it, m, and search radius, m.
    AtBeacon { "no tags at the beacon's place: searches {l:.0} m around it" }
    /// Search for the tags around the beacon's position: distance flown, m, and length of the pattern, m.
    Searching { "searches for the tags, {v:.0} m of {l:.0} m flown" }
    /// No tags found around the beacon's position: search radius, m, and duration, s.
    NotFound { "no tags within {v:.0} m of the beacon in {l:.0} s of search" }
    /// Beacon position too inaccurate for a search: required search radius, m, and the limit.
    BeaconVague { "the beacon is too inaccurate: the search would reach {v:.0} m (limit {l:.0})" }
    /// Number of decks in sight with this deck's tags, none of them identified as the drone's own.
    SeveralDecks { "{v:.0} decks with these tags are near, and the drone's own is not identified" }
    /// A take-off was commanded.
    TakeOffCommanded { "take-off commanded" }
    /// Take-offs are disabled: `drone.mission.takeoff`, or a mode without commands.
    TakeOffOff { "take-off is off (drone.mission.takeoff = false, or mode = \"shadow\")" }
    /// The drone is not disarmed on the deck: distance from its centre, m, and the maximum.
    NotOnDeck { "not on the deck: {v:.1} m from its centre (limit {l:.0})";
        if v <= l => "the drone is not disarmed on the ground" }
    /// The crew has not cleared the deck for a take-off.
    NotCleared { "the crew has not cleared the deck for a take-off" }
    /// Countdown: remaining time, s.
    Counting { "motors start in {:.0} s: stand clear", v.ceil() }
    /// The countdown is over.
    CountedDown { "counted down: motors start" }
    /// Time spent waiting for the autopilot to arm, s, and the limit.
    Arming { "the autopilot has not armed for {v:.0} s (limit {l:.0})" }
    /// The autopilot did not arm: time waited, s, and the limit.
    ArmingRejected { "the autopilot did not arm within {l:.0} s: its own text has the reason" }
    /// Time for which the autopilot has reported turning rotors, s, and the minimum.
    SpinningUp { "the rotors have turned for {v:.1} s (needs {l:.1})";
        if v <= 0.0 => "the autopilot reports no turning rotors" }
    /// Probability of a take-off too low because the deck tilts or moves sideways.
    TakeOffTilted { "probability of a take-off {likely:.0} % (needs {needed:.0} %): the deck tilts or slides away" }
    /// Probability of a take-off too low because the deck may rise into the drone.
    TakeOffHit { "probability of a take-off {likely:.0} % (needs {needed:.0} %): the deck may hit the drone" }
    /// A better moment to take off comes soon: probability now, and at that moment.
    BetterMoment { "probability of a take-off {likely:.0} % now, {:.0} % within seconds", l_percent.floor() }
    /// Probability of a take-off at this moment.
    GoodMoment { "probability of a take-off {likely:.0} % now" }
    /// No suitable moment to take off: time waited, s, and the limit.
    NoMoment { "no good moment to take off in {v:.0} s (limit {l:.0})" }
    /// Leaving the deck: height gained, m.
    Leaving { "leaves the deck, {v:.1} m above it" }
    /// The feet do not leave the deck: height gained, m, and the minimum by that time.
    DoesNotRise { "rose by {v_two} m only (needs {l_two}): held, too heavy, or a motor that does not follow" }
    /// The drone tips on the deck, for example because a foot is held: angle to the deck, rad, and its maximum.
    TipsOver { "tips on the deck by {v_deg:.0} deg (limit {l_deg:.0}): is a foot held?" }
    /// Clear of the deck: height gained, m.
    ClearOfDeck { "clear of the deck by {v:.1} m" }
    /// At the target height after the take-off.
    TakenOff { "at its height after the take-off" }
    /// Armed on the deck after a stopped take-off, s.
    StillArmed { "armed on the deck for {v:.0} s: if this continues, disarm by remote control" }
    /// The autopilot is disarmed.
    Disarmed { "disarmed on the deck" }
    /// Battery too low for a take-off, fraction.
    TakeOffBattery { "battery at {v_percent:.0} % (needs {l_percent:.0} %) for a take-off" }
    /// End of a sortie: remaining charge, fraction, and the charge for the way back and one missed attempt.
    TurnsBack { "battery at {v_percent:.0} % (needs {l_percent:.0} %): turns back to the vessel" }
    /// End of a sortie: the autopilot has completed its own mission.
    MissionDone { "the autopilot's mission is done: returns to the vessel" }
    /// End of a sortie: an operator has ordered the drone back from the autopilot's own mission.
    OrderedBack { "ordered back: ends the autopilot's mission" }
    /// The autopilot did not begin its own mission after hand-over: time waited, s, and the limit.
    HandOverRejected { "the autopilot did not begin its own mission within {l:.0} s: lands, no further sortie" }
    /// On the deck until ready for the next sortie: charge, fraction, and the charge at which it starts by itself.
    NotReady { "ready for the next sortie at {l_percent:.0} % (has {v_percent:.0} %), or by alight order ready" }
    /// Ready for the next sortie: its number, and the planned number.
    SortieBegins { "ready: sortie {v:.0} of {l:.0}" }
    /// All sorties are done: their number, and the planned number.
    SortiesDone { "all sorties are done: {v:.0} (limit {l:.0})";
        if l == 0.0 => "no unattended cycles (drone.mission.sorties_max = 0)";
        if v < l => "no cycles in progress, {v:.0} of {l:.0} sorties begun: order a take-off" }
    /// Out of radio range, flying to the vessel's expected position: distance, m, and time since its last message, s.
    SeeksVessel { "no radio for {l:.0} s: flies to where the vessel should be, {v:.0} m" }
    /// Handing over to the autopilot's own mission after a take-off: time waited, s, and the limit.
    HandsOver { "hands over to the autopilot's own mission" }
    /// Too dark to detect a tag: mean grey level of the image, and longest exposure, s, 0 if not set.
    TooDark { "too dark to see the tags (image mean {v:.0} of 255, exposed by the camera itself): light the deck or \
        its tags";
        if l > 0.0 => "too dark to see the tags (image mean {v:.0} of 255, exposure of {:.1} ms and gain at their \
            limits): light the deck or its tags", 1e3 * l }
    /// Several autopilots on the link: the MAVLink system in use, and the other.
    SeveralAutopilots { "autopilots {v:.0} and {l:.0} received: set autopilot.vehicle" }
    /// The remote control's switch is in its abort position.
    SwitchAborts { "the remote control's switch is on abort" }
    /// A light blinds the camera and no tag is detected: saturated part of the image, %, and the limit for glints.
    Glare { "blinded: no tag detected, and {v:.1} % of the image is at its brightest (limit {l:.1} %): dim or screen \
        the lamp" }
    /// Keeping an ordered station next to the vessel, or on the way to it: remaining time, s, and distance to it, m.
    OnStation { "{l:.0} m from its station, {:.0} min left", (v / 60.0).ceil();
        if l <= NEAR_STATION_M => "keeps its station, {:.0} min left", (v / 60.0).ceil() }
    /// The time on the station has elapsed.
    StationOver { "the time on the station is over" }
    /// Station below the approach height: its height, m, and the minimum.
    StationTooLow { "a station {v:.0} m up is too low: at least {l:.0} m, the approach height" }
    /// Station too near a deck that is not the drone's own: distance from the deck's centre, m, and the minimum.
    StationTooNear { "a station {v:.0} m from a deck that is not its own is too near: at least {l:.0} m" }
    /// Station at another drone's height: that height, m, and the minimum difference.
    StationTaken { "another drone waits {v:.0} m up: a station has to be {l:.0} m higher or lower" }
    /// A station cannot begin now: the drone takes off, descends, stands or searches for the vessel.
    StationNotNow { "no station from here: the drone takes off, descends, stands or searches for the vessel" }
    /// Order rejected: the pilot, the autopilot's own mission or its hold is in control.
    NotInControl { "the pilot or the autopilot's own mode has the drone: choose another mode there, or order a \
        landing" }
    /// Landing order rejected: the drone stands on the deck.
    OnDeck { "the drone stands on the deck" }
    /// Landing order rejected: the drone is about to take off, or its take-off was just stopped.
    DuringTakeOff { "the drone takes off: abort the take-off, or order again once it is clear of the deck" }
    /// The drone follows set-points again near the deck: height of the feet above it, m.
    GivenBack { "follows set-points again, feet {v_two} m above the deck" }
    /// A pilot or a ground station holds the drone low above the deck: height of the feet, m.
    HeldLow { "{v_two} m above the deck in another mode: a wave can lift the deck into the drone; it climbs once its \
        mode is selected again" }
    /// The autopilot answers no TIMESYNC, so that its samples cannot be dated.
    NoTimesync { "the autopilot does not answer TIMESYNC, so its samples have no time" }
    /// The autopilot reports no battery.
    BatteryUnknown { "the autopilot reports no battery: ArduPilot does with BATT_MONITOR = 4, PX4 with a calibrated \
        power module" }
    /// Fewer than two sources confirm that a drone with turning rotors stands on the deck, so it climbs.
    MayFly { "not confirmed on the deck (by rangefinder, height gained and thrust): climbs out" }
    /// The mission was suspended for too long and restarts: height of the feet above the deck, m, and duration, s.
    StoodStill { "mission suspended for {l:.1} s, feet {v_two} m above the deck: starts again" }
    /// Probability of an unsafe contact too high.
    HarmLikely { "probability of an unsafe contact {v_percent:.1} % (limit {l_percent:.1} %)" }
    /// Deck dimensions in the drone's configuration differ from the vessel's: the dimension that differs
    /// most, the drone's and, as the limit, the vessel's, m.
    DeckDiffers { "a dimension of the deck is {v:.2} m in the drone's configuration and {l:.2} m in the vessel's" }
    /// Battery below the reserve, fraction, while the deck is not free: the drone waits until the charge
    /// reaches the limit, fraction; 0: no other place is in reach.
    BatteryWaits { "battery at {v_percent:.0} %: waits for the deck, no other place is in reach";
        if l > 0.0 => "battery at {v_percent:.0} %: waits for the deck until {l_percent:.0} %, which the next place \
            needs" }
    /// Charge above the reserve again, fraction.
    BatteryRecovered { "battery at {v_percent:.0} % (needs {l_percent:.0} %): continues" }
    /// No landing within the time limit: longest time for which a single reason prevented it, s, and that limit.
    WaitedTooLong { "no landing within {l:.0} s, for {v:.0} s of them for one reason" }
}
