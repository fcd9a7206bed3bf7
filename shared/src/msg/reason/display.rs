//! Reasons as text for people.

use core::fmt;

use super::{Reason, ReasonCode};
use crate::autopilot_parameters::{REQUESTS, numbered};
use crate::msg::DECK_CLOSED;

/// Nearer to its station a drone keeps it, m: what it is off in wind and waves.
const NEAR_STATION_M: f64 = 5.0;

/// Text on what a drone does about its station, which lies at ` place` where that is named.
pub(in crate::msg) fn on_station(waiting: &Reason, place: &str) -> String {
    let (left_min, off_m) = ((waiting.value / 60.0).ceil(), waiting.limit);
    if off_m <= NEAR_STATION_M {
        format!("keeps its station{place}, {left_min:.0} min left")
    } else {
        format!("{off_m:.0} m from its station{place}, {left_min:.0} min left")
    }
}

/// A take-off that is not likely enough, for people.
fn likely_take_off(f: &mut fmt::Formatter<'_>, p: f64, needed: f64, costs: &str) -> fmt::Result {
    let (p, needed) = ((p * 100.0).floor(), (needed * 100.0).ceil());
    write!(f, "a take-off is {p:.0} % likely (needs {needed:.0}): {costs}")
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
            ReasonCode::TakeOffCommanded => write!(f, "take-off commanded"),
            ReasonCode::TakeOffOff => write!(
                f,
                "take-off is off (drone.mission.takeoff = false, or mode = \"shadow\")"
            ),
            ReasonCode::NotOnDeck if v <= l => write!(f, "the drone is not disarmed on the ground"),
            ReasonCode::NotOnDeck => {
                write!(f, "not on the deck: {v:.1} m from its centre (limit {l:.0})")
            }
            ReasonCode::NotCleared => {
                write!(f, "the crew has not cleared the deck for a take-off")
            }
            ReasonCode::Counting => write!(f, "motors start in {:.0} s: stand clear", v.ceil()),
            ReasonCode::CountedDown => write!(f, "counted down: motors start"),
            ReasonCode::Arming => write!(f, "the autopilot has not armed for {v:.0} s (limit {l:.0})"),
            ReasonCode::ArmingRejected => write!(
                f,
                "the autopilot did not arm within {l:.0} s: its own text has the reason"
            ),
            ReasonCode::SpinningUp => write!(
                f,
                "the autopilot reports no rotors that turn, {v:.1} s after arming (limit {l:.1})"
            ),
            ReasonCode::TakeOffTilted => likely_take_off(f, v, l, "the deck tilts or slides away"),
            ReasonCode::TakeOffHit => likely_take_off(f, v, l, "the deck may rise into it"),
            ReasonCode::BetterMoment => write!(
                f,
                "a take-off is {:.0} % likely now, {:.0} % within seconds",
                (100.0 * v).floor(),
                (100.0 * l).floor()
            ),
            ReasonCode::GoodMoment => write!(f, "a take-off is {:.0} % likely now", (100.0 * v).floor()),
            ReasonCode::NoMoment => write!(f, "no moment to take off in {v:.0} s (limit {l:.0})"),
            ReasonCode::Leaving => write!(f, "leaves the deck, {v:.1} m above it"),
            ReasonCode::DoesNotRise => write!(
                f,
                "rose by {v:.2} m only (needs {l:.2}): held, too heavy, or a motor that does not follow"
            ),
            ReasonCode::TipsOver => write!(
                f,
                "tips on the deck by {:.0} deg (limit {:.0}): is a foot held?",
                v.to_degrees(),
                l.to_degrees()
            ),
            ReasonCode::ClearOfDeck => write!(f, "clear of the deck by {v:.1} m"),
            ReasonCode::TakenOff => write!(f, "at its height after the take-off"),
            ReasonCode::StillArmed => write!(
                f,
                "stands armed for {v:.0} s: if it stays so, disarm by remote control"
            ),
            ReasonCode::TurnsBack => battery(f, ": turns back to the vessel"),
            ReasonCode::MissionDone => write!(f, "the autopilot's mission is done: returns to the vessel"),
            ReasonCode::OrderedBack => write!(f, "ordered back: ends the autopilot's mission"),
            ReasonCode::HandOverRefused => write!(
                f,
                "the autopilot did not begin its own mission within {l:.0} s: lands, no further sortie"
            ),
            ReasonCode::NotReady => write!(
                f,
                "ready for the next sortie at {:.0} % (has {:.0} %), or by alight command ready",
                100.0 * l,
                100.0 * v
            ),
            ReasonCode::SortieBegins => write!(f, "ready: sortie {v:.0} of {l:.0}"),
            ReasonCode::SortiesDone if l == 0.0 => {
                write!(f, "no unattended cycles (drone.mission.sorties_max = 0)")
            }
            ReasonCode::SortiesDone if v < l => {
                write!(
                    f,
                    "no cycles go on, {v:.0} of {l:.0} sorties begun: order a take-off"
                )
            }
            ReasonCode::SortiesDone => write!(f, "all sorties are done: {v:.0} (limit {l:.0})"),
            ReasonCode::SeeksVessel => write!(
                f,
                "no radio for {l:.0} s: flies to where the vessel should be, {v:.0} m"
            ),
            ReasonCode::HandsOver => write!(f, "hands over to the autopilot's own mission"),
            ReasonCode::OnStation => f.write_str(&on_station(self, "")),
            ReasonCode::StationOver => write!(f, "the time on the station is over"),
            ReasonCode::StationTooLow => {
                write!(
                    f,
                    "no station {v:.0} m up: {l:.0} m at least, the height of the approach"
                )
            }
            ReasonCode::StationTooNear => {
                write!(
                    f,
                    "no station {v:.0} m from a deck that is not its own: {l:.0} m at least"
                )
            }
            ReasonCode::StationTaken => write!(
                f,
                "another drone waits {v:.0} m up: a station has to be {l:.0} m higher or lower"
            ),
            ReasonCode::StationNotNow => write!(
                f,
                "no station from here: it takes off, descends, stands or looks for the vessel"
            ),
            ReasonCode::NotInControl => write!(
                f,
                "the pilot or the autopilot's own mode has the drone: choose another mode there, or order a landing"
            ),
            ReasonCode::OnDeck => write!(f, "the drone stands on the deck"),
            ReasonCode::DuringTakeOff => write!(
                f,
                "it takes off: abort that, or order again once it is clear of the deck"
            ),
            ReasonCode::TakeOffBattery => battery(f, " for a take-off"),
            ReasonCode::BatteryUnknown => write!(
                f,
                "the autopilot reports no battery: ArduPilot does with BATT_MONITOR = 4, PX4 with a calibrated power module"
            ),
            ReasonCode::GivenBack => {
                write!(f, "follows set-points again, feet {v:.2} m above the deck")
            }
            ReasonCode::StoodStill => {
                write!(
                    f,
                    "mission stood still for {l:.1} s, feet {v:.2} m above the deck: begins again"
                )
            }
            ReasonCode::MayFly => write!(
                f,
                "nothing shows that it stands on the deck (rangefinder, way up, what carries it): climbs out"
            ),
            ReasonCode::Disarmed => write!(f, "disarmed on the deck"),
            ReasonCode::NotFlying => write!(
                f,
                "not flying, not armed, or not in OFFBOARD (PX4) or GUIDED (ArduPilot)"
            ),
            ReasonCode::NoVessel => write!(f, "no vessel state received from within 100 km"),
            ReasonCode::TagsInSight => write!(f, "the tags are detected, the vessel is silent"),
            ReasonCode::KnownByBeacon => {
                write!(f, "vessel known by beacon, {v:.0} m, {l:.1} s old")
            }
            ReasonCode::AtBeacon => {
                write!(f, "no tags at the beacon's place: searches {l:.0} m around it")
            }
            ReasonCode::Searching => {
                write!(f, "searches for the tags, {v:.0} m of {l:.0} m flown")
            }
            ReasonCode::NotFound => {
                write!(f, "no tags within {v:.0} m of the beacon in {l:.0} s of search")
            }
            ReasonCode::BeaconVague => {
                write!(
                    f,
                    "the beacon is too inexact: the search would reach {v:.0} m (limit {l:.0})"
                )
            }
            ReasonCode::SeveralDecks => {
                write!(
                    f,
                    "{v:.0} decks with these tags are near, and none in sight is known as its own"
                )
            }
            ReasonCode::NotIdentified => {
                write!(
                    f,
                    "the deck's motion is not identified yet: it takes a minute of vision"
                )
            }
            ReasonCode::OdometryStale if v.is_infinite() => write!(f, "no odometry of the autopilot yet"),
            ReasonCode::OdometryStale => write!(f, "own odometry {v:.2} s old (limit {l:.2})"),
            ReasonCode::ForecastStale if v.is_infinite() => {
                write!(f, "no deck forecast yet: no vessel estimate was received")
            }
            ReasonCode::ForecastStale => write!(f, "deck forecast {v:.2} s old (limit {l:.2})"),
            ReasonCode::NoVision => write!(f, "deck not detected yet"),
            ReasonCode::TooDark if l > 0.0 => write!(
                f,
                "too dark to see the tags (image mean {v:.0} of 255, exposure of {:.1} ms and gain at their limits): light \
                 the deck or its tags",
                1e3 * l
            ),
            ReasonCode::TooDark => write!(
                f,
                "too dark to see the tags (image mean {v:.0} of 255, exposed by the camera itself): light the deck or its tags"
            ),
            ReasonCode::Glare => write!(
                f,
                "blinded: no tag detected, and {v:.1} % of the image is at its brightest (limit {l:.1} %): dim or screen the \
                 lamp"
            ),
            ReasonCode::VisionLost => write!(f, "deck not detected for {v:.2} s (limit {l:.2})"),
            ReasonCode::TooFar => write!(f, "{v:.2} m off the deck (limit {l:.2} m)"),
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
            ReasonCode::BatteryWaits if l > 0.0 => write!(
                f,
                "battery at {:.0} %: waits for the deck until {:.0} %, which the next place needs",
                100.0 * v,
                100.0 * l
            ),
            ReasonCode::BatteryWaits => write!(
                f,
                "battery at {:.0} %: waits for the deck, no other place is in reach",
                100.0 * v
            ),
            ReasonCode::BatteryRecovered => battery(f, ": goes on"),
            ReasonCode::NoPlace => write!(f, "all {v:.0} waiting places at the vessel are taken"),
            ReasonCode::OutOfRetries => write!(f, "attempts used: {v:.0} (limit {l:.0})"),
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
            ReasonCode::HarmLikely => write!(
                f,
                "an unsafe contact is {:.1} % likely (limit {:.1})",
                v * 100.0,
                l * 100.0
            ),
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
                "the deck is detected {v:.1} m from where the radio places it (limit {l:.1}): another vessel's?"
            ),
            ReasonCode::DeckDiffers => write!(
                f,
                "a dimension of the deck is {v:.2} m in the drone's configuration and {l:.2} m in the vessel's"
            ),
            ReasonCode::HeightContradicted => write!(
                f,
                "rangefinder and camera contradict each other about the deck's height: by {v:.1} times what they err (limit {l:.1})"
            ),
            ReasonCode::HeadingUnaligned => write!(
                f,
                "the autopilot has not aligned its heading (PX4: ESTIMATOR_STATUS, ArduPilot: EKF_STATUS_REPORT)"
            ),
            ReasonCode::SwitchAborts => {
                write!(f, "the remote control's switch stands on abort")
            }
            ReasonCode::SeveralAutopilots => {
                write!(f, "autopilots {v:.0} and {l:.0} received: set autopilot.vehicle")
            }
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
