//! State table: one function per state, with its conditions and transitions.

mod descent;

use alight_shared::{
    landing::Odds,
    msg::{
        Course, OwnMission, PLACES, Reason, ReasonCode,
        ReasonCode::{
            ArmedAgain, Commanded, CourseEnds, HeightReached, InSight, NoPlace, NoPlan, NoVessel, NoVision,
            NotCommanded, NotFlying, NotIdentified, NotSteady, OffHeight, Operator, Permitted, Recovered,
            Steady, Swings, TagsInSight, TooFar, TooFast, VesselTurns, VisionLost,
        },
        VesselLevel,
    },
};
use nalgebra::Vector3;

use super::{
    charge::{self, urgency},
    limits::{
        CONTACT_CONFIRM_S, DECISION_TIMEOUT_S, FOR_OPERATOR, HEAVE_M, HEIGHT_TOLERANCE_M, HYSTERESIS,
        ORDER_WAITS_S, RECOVER_S, RESUME_DISTANCE_M, STEADY_DISTANCE_M, STEADY_HEIGHT_M, exceeds,
        first_beyond,
    },
    phase::{
        DroneTime, HoldCause, MissionPhase, MissionProgress, PhaseTransition, gave_up, held_place, holding,
        lasting, moving_place, old_data, too_far,
    },
    reservation::Reservation,
    search, seek,
    situation::{ControlState, Deck, SilentVessel, Situation},
    station, take_off, turnaround,
};
use crate::mission_config::MissionConfig;
use descent::{descent, flare};

/// Transition of the state of `phase` in this situation.
pub(super) fn step(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    match phase {
        MissionPhase::Idle => idle(progress, s, c),
        MissionPhase::GetAltitude { from } => get_altitude(from, s, c),
        MissionPhase::Approach { detected } => approach(detected, s, c),
        MissionPhase::Search(looks) => search::search(looks, s, c),
        MissionPhase::Seek => seek::seek(progress, s, c),
        MissionPhase::Tracking { steady } => tracking(steady, progress, s, c),
        MissionPhase::TrackingStable => tracking_stable(progress, s, c),
        MissionPhase::Descent { violated, paused } => descent(violated, paused, progress, s, c),
        MissionPhase::Flare { committed, violated } => flare(committed, violated, progress, s, c),
        MissionPhase::Landed { disarmed, airborne } => landed(disarmed, airborne, progress, s, c),
        MissionPhase::Hold {
            cause,
            at,
            yaw,
            fresh,
        } => {
            let at = match cause {
                HoldCause::Station(kept) => station::held_place(&kept, &at, s, c),
                HoldCause::Operator | HoldCause::Data => held_place(&at, s, false),
            };
            let hold = |fresh| MissionPhase::Hold {
                cause,
                at,
                yaw,
                fresh,
            };
            if s.flight == ControlState::SetPointsLost {
                return hold(None).stay(NotFlying);
            }
            held(cause, hold, fresh, progress, s, c)
        }
        MissionPhase::GaveUp { at, yaw } => {
            let at = held_place(&at, s, true);
            let rests = if s.flight == ControlState::SetPointsLost {
                NotFlying
            } else {
                NotCommanded
            };
            let why = stopped_low(progress, s).unwrap_or(rests.into());
            MissionPhase::GaveUp { at, yaw }.stay(why)
        }
        MissionPhase::Preparing => take_off::preparing(progress, s, c),
        MissionPhase::Countdown { since } => take_off::countdown(since, s, c),
        MissionPhase::SpinUp { since, armed } => take_off::spin_up(since, armed, s, c),
        MissionPhase::TakeOff { since, left } => take_off::take_off(since, left, s, c),
        MissionPhase::ClimbOut { .. } => take_off::climb_out(phase, progress, s, c),
        MissionPhase::StandDown { since, unarmed } => take_off::stand_down(since, unarmed, s, c),
    }
}

/// Reason to end a waiting order: it has waited too long, or its flight is over.
fn order_expired(progress: &mut MissionProgress, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let over = progress.armed && s.flight == ControlState::Disarmed;
    progress.armed |= !matches!(s.flight, ControlState::Disarmed | ControlState::Unknown);
    let limit_s = if s.flight == ControlState::Ours {
        c.mission_timeout_s
    } else {
        ORDER_WAITS_S
    };
    let waited_s = (s.now - progress.started).secs();
    (over || waited_s > limit_s).then(|| Reason::new(ReasonCode::OrderExpired, waited_s, limit_s))
}

/// Reason while the battery is below its reserve and the operator of a stopped landing may still decide.
fn stopped_low(progress: &MissionProgress, s: &Situation) -> Option<Reason> {
    let b = s.battery.filter(|b| *b < s.battery_reserve && progress.stopped)?;
    let limit = (1.0 - FOR_OPERATOR) * s.battery_reserve;
    Some(Reason::new(ReasonCode::BatteryStopped, b, limit)).filter(|_| b >= limit)
}

/// Reason if another control holds the drone where a wave can lift the deck into it.
fn held_low(s: &Situation) -> Option<Reason> {
    let deck = s.fresh_deck()?;
    let held = matches!(s.flight, ControlState::OtherControl(_)) && s.rotors_carry == Some(true);
    let low = deck.clearance_m < HEAVE_M && deck.distance_m < RESUME_DISTANCE_M;
    if held && low {
        Some(Reason::new(ReasonCode::HeldLow, deck.clearance_m, HEAVE_M))
    } else {
        None
    }
}

fn goes_on(s: &Situation) -> bool {
    s.flight == ControlState::Ours && old_data(s).is_none()
}

/// Waits for an order, for a flight in our mode, and for the vessel's radio.
fn idle(progress: &mut MissionProgress, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    let idle = MissionPhase::Idle;
    if let Some(why) = charge::taken_back(progress, s, c) {
        return idle.stay(why);
    }
    if progress.cycles.on && !progress.sortie && s.flight == ControlState::Disarmed {
        return turnaround::stands(idle, progress, s, c);
    }
    if let Some(kept) = progress.station.filter(|_| goes_on(s) && !progress.landing) {
        progress.station = None;
        return holding(HoldCause::Station(kept), s, c).enter(ReasonCode::Restarted);
    }
    if !progress.landing {
        if let Some(why) = held_low(s) {
            return idle.stay(why);
        }
        let waits = if progress.stopped { Operator } else { NotCommanded };
        return idle.stay(stopped_low(progress, s).unwrap_or(waits.into()));
    }
    let done = (s.sortie.own_mission == OwnMission::Done).then(|| ReasonCode::MissionDone.into());
    let ends = s.sortie.turns_back.or(done).filter(|_| progress.sortie);
    // The drone can return to a vessel that is received or extrapolated.
    let may_return = old_data(s).is_none() || seek::due(progress, s).is_some();
    let turns_back = ends.filter(|_| may_return);
    let stays_due = ends.is_some();
    if let Some(why) = order_expired(progress, s, c).filter(|_| !stays_due) {
        progress.landing = false;
        return idle.enter(why);
    }
    if s.flight != ControlState::Ours {
        let missing = ends.and_then(|_| old_data(s));
        // Unattended cycles have no pilot to select the mode.
        let flies = s.sortie.own_mission == OwnMission::Flies;
        let recalled = progress.cycles.on && flies && old_data(s).is_none();
        let recalled = recalled.then(|| ReasonCode::OrderedBack.into());
        // While the pilot's switch is on abort, no order takes control, because the drone would hover instead of
        // landing.
        let held = s.rejection.filter(|why| why.code == ReasonCode::SwitchAborts);
        let why = held.or(turns_back).or(recalled).or(s.rejection).or(missing);
        return idle.stay(why.unwrap_or(s.not_flying()));
    }
    if let Some(why) = s.rejection {
        return idle.stay(why);
    }
    if let Some(why) = s.waits(c).filter(|_| s.place.is_none()) {
        let full = matches!(s.reservation, Reservation::Others(_));
        return idle.stay(if full {
            Reason::new(NoPlace, PLACES as f64, 0.0)
        } else {
            why
        });
    }
    if let Some(seeks) = seek::due(progress, s) {
        return seek::sets_out(progress, &seeks, s);
    }
    if let Some(why) = old_data(s) {
        return idle.stay(why);
    }
    match (s.fresh_deck(), s.own) {
        (Some(deck), Some(own)) if deck.radio_age_s <= c.radio_fresh_s => {
            if let Some(why) = too_far(deck, c) {
                return idle.stay(why);
            }
            progress.started = s.now;
            let from = [own.position.x, own.position.y];
            MissionPhase::GetAltitude { from }.enter(Commanded)
        }
        (Some(deck), _) if (c.min_vessel == VesselLevel::Tag || deck.beacon.is_some()) && above(deck, c) => {
            progress.started = s.now;
            MissionPhase::TRACKING.enter(TagsInSight)
        }
        (Some(deck), Some(own)) if let Some([sd_m, age_s]) = deck.beacon => {
            if let Some(why) = too_far(deck, c).or_else(|| search::vague(deck)) {
                return idle.stay(why);
            }
            progress.started = s.now;
            let from = [own.position.x, own.position.y];
            let known = Reason::new(ReasonCode::KnownByBeacon, sd_m, age_s);
            MissionPhase::GetAltitude { from }.enter(known)
        }
        (deck, _) => {
            let age_s = deck.map_or(f64::INFINITY, |deck| deck.radio_age_s);
            let silent = Reason::new(NoVessel, age_s, c.radio_fresh_s);
            idle.stay(s.several.unwrap_or(silent))
        }
    }
}

fn get_altitude(from: [f64; 2], s: &Situation, c: &MissionConfig) -> PhaseTransition {
    let (Some(own), Some(mean)) = (s.own, s.mean_deck_z) else {
        return MissionPhase::GetAltitude { from }.stay(s.no_deck());
    };
    let z = s.no_lower(mean - s.approach_height_m(c));
    let error = (own.position.z - z).abs();
    if error > HEIGHT_TOLERANCE_M {
        let from = match s.place {
            Some(_) => moving_place(&Vector3::new(from[0], from[1], z), s, false)
                .1
                .xy()
                .into(),
            None => from,
        };
        return MissionPhase::GetAltitude { from }.stay(Reason::new(OffHeight, error, HEIGHT_TOLERANCE_M));
    }
    MissionPhase::APPROACH.enter(HeightReached)
}

/// Climbs vertically to the height of the waiting place, moving with the deck while above it.
fn leave(s: &Situation, why: Reason) -> PhaseTransition {
    let from = s.own.map_or([0.0; 2], |own| own.position.xy().into());
    MissionPhase::GetAltitude { from }.enter(why)
}

/// Flies to the waiting place until the deck is reserved, then to the deck until vision is confirmed.
fn approach(detected: Option<DroneTime>, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    let Some(deck) = s.fresh_deck() else {
        return MissionPhase::APPROACH.stay(s.no_deck());
    };
    if let Some(why) = too_far(deck, c) {
        return holding(HoldCause::Data, s, c).enter(why);
    }
    let blind = deck.vision_age_s > c.vision_fresh_s;
    if blind && deck.radio_age_s > c.radio_lost_s && deck.beacon.is_none() {
        return holding(HoldCause::Data, s, c).enter(Reason::new(NoVessel, deck.radio_age_s, c.radio_lost_s));
    }
    if let Some(why) = s.waits(c) {
        let z = s.mean_deck_z.unwrap_or(f64::INFINITY) - s.approach_height_m(c);
        return if moving_place(&Vector3::new(0.0, 0.0, z), s, false).0 && s.place.is_some() {
            leave(s, why)
        } else {
            MissionPhase::APPROACH.stay(why)
        };
    }
    // Until a witness confirms the deck's height, the drone stays at a height that is safe for every witness.
    if let Some(why) = s.doubt {
        return MissionPhase::APPROACH.stay(why);
    }
    if blind {
        if let Some(next) = search::begins(deck, s, c) {
            return next;
        }
        let why = deck.contradicted.or(s.several);
        return MissionPhase::APPROACH.stay(why.unwrap_or(s.not_detected(deck)));
    }
    let (detected, lasted) = lasting(true, detected, s.now);
    if lasted < CONTACT_CONFIRM_S {
        return MissionPhase::Approach { detected }.stay(NoVision);
    }
    MissionPhase::TRACKING.enter(InSight)
}

/// Reason why the drone is not steady above the deck; `slack` widens the limits.
fn unsteady(deck: &Deck, s: &Situation, c: &MissionConfig, slack: f64) -> Option<Reason> {
    let height = match (s.own, s.mean_deck_z) {
        (Some(own), Some(mean)) => (own.position.z - (mean - c.tracking_height_m)).abs(),
        _ => f64::INFINITY,
    };
    first_beyond([
        (TooFar, deck.distance_m, STEADY_DISTANCE_M * slack),
        (TooFast, deck.relative_speed_mps, c.steady_speed_mps * slack),
        (OffHeight, height, STEADY_HEIGHT_M * slack),
    ])
}

/// Transition to the waiting place if the deck is closed or owned by another drone.
fn deck_lost(s: &Situation, c: &MissionConfig) -> Option<PhaseTransition> {
    let why = s
        .waits(c)
        .filter(|_| matches!(s.reservation, Reservation::Others(_)))?;
    s.place.map(|_| leave(s, why))
}

/// Transition without vision, back to an approach by radio or beacon if available.
fn vision_lost(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<PhaseTransition> {
    let why = exceeds(VisionLost, deck.vision_age_s, c.vision_lost_s)?;
    let next = if deck.radio_age_s <= c.radio_fresh_s || deck.beacon.is_some() {
        MissionPhase::APPROACH
    } else {
        holding(HoldCause::Data, s, c)
    };
    Some(next.enter(why))
}

/// Transition if the deck is not detected, is owned by another drone, or has a doubtful height.
fn not_followed(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<PhaseTransition> {
    let doubted = || s.doubt.map(|why| MissionPhase::APPROACH.enter(why));
    vision_lost(deck, s, c)
        .or_else(|| deck_lost(s, c))
        .or_else(doubted)
}

fn widening(urgency: f64) -> f64 {
    if urgency > 0.0 { HYSTERESIS } else { 1.0 }
}

/// Reason if the landing's probability is too low, or that of an unsafe contact too high. The limits are `needed (1 -
/// u)` and `max_harm^(1 - u)` for the [`urgency`] `u`.
fn unlikely(urgency: f64, s: &Situation, needed: f64, max_harm: f64) -> Option<Reason> {
    if urgency >= 1.0 || s.forced_descent.is_some() {
        return None;
    }
    let (needed, max_harm) = ((1.0 - urgency) * needed, max_harm.powf(1.0 - urgency));
    // Without a forecast of the contact the landing has no probability.
    let unknown = Reason::new(ReasonCode::LikelyOutside, 0.0, needed);
    let why = |odds: Odds| odds.below(needed).or_else(|| odds.harmful(max_harm));
    s.odds.map_or(Some(unknown), why)
}

/// Probability of an unsafe contact above which no descent begins: it selects among descents, and most of it is avoided
/// by the strict limit low above the deck.
const BEGIN_HARM: f64 = 0.15;

fn begin_harm(c: &MissionConfig) -> f64 {
    c.max_harm.max(BEGIN_HARM)
}

fn begins_at(c: &MissionConfig) -> f64 {
    (1.0 - BEGIN_HARM) * c.min_probability
}

/// Reason why a drone that lands now may not stay. A late decision does not avoid this, so that it is strict at the
/// beginning.
fn may_slide(urgency: f64, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let needed = (1.0 - urgency) * c.min_probability;
    let stays = s.odds?.slides;
    let slides = stays < needed && s.forced_descent.is_none();
    slides.then(|| Reason::new(ReasonCode::LikelySlides, stays, needed))
}

fn tracking(
    steady: Option<DroneTime>,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let Some(deck) = s.fresh_deck() else {
        return MissionPhase::TRACKING.stay(s.no_deck());
    };
    if let Some(lost) = not_followed(deck, s, c) {
        return lost;
    }
    let urgency = urgency(progress, s, c);
    if let Some(why) = unsteady(deck, s, c, widening(urgency)) {
        return MissionPhase::TRACKING.stay(why);
    }
    let (steady, lasted) = lasting(true, steady, s.now);
    if lasted < c.steady_s && urgency <= 0.0 {
        return MissionPhase::Tracking { steady }.stay(Reason::new(NotSteady, lasted, c.steady_s));
    }
    MissionPhase::TrackingStable.enter(Reason::new(Steady, lasted, c.steady_s))
}

fn tracking_stable(progress: &mut MissionProgress, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    let stable = MissionPhase::TrackingStable;
    let Some(deck) = s.fresh_deck() else {
        return stable.stay(s.no_deck());
    };
    if let Some(lost) = not_followed(deck, s, c) {
        return lost;
    }
    let urgency = urgency(progress, s, c);
    let (wide, urgent) = (widening(urgency), urgency > 0.0);
    if let Some(why) = unsteady(deck, s, c, HYSTERESIS * wide) {
        return MissionPhase::TRACKING.enter(why);
    }
    if s.flight != ControlState::Ours {
        return stable.stay(NotFlying);
    }
    // The vessel does not withdraw the deck from a silent owner, so a stale grant stays valid.
    let stale = matches!(s.reservation, Reservation::Unknown(_));
    let rejection = (s.reservation.rejection())
        .filter(|_| !(stale && urgent))
        .or_else(|| {
            first_beyond([
                (VisionLost, deck.vision_age_s, c.descent_vision_s),
                (NoPlan, s.plan_age_s, s.plan_limit_s),
            ])
        })
        .or_else(|| deck.infeasible(c, wide));
    // Landing at any risk of sliding is better than emptying the battery in the air.
    let rejection = rejection.or_else(|| {
        if urgent {
            return None;
        }
        (deck.contradicted.or(s.rejection).or(s.other_deck))
            .or_else(|| (!deck.identified).then(|| NotIdentified.into()))
            .or_else(|| exceeds(Swings, s.swing_rad, MAX_SWING_RAD))
            .or_else(|| course_rejection(deck, s, c))
    });
    let rejection = rejection
        .or_else(|| unlikely(urgency, s, s.worth_waiting.max(begins_at(c)), begin_harm(c)))
        .or_else(|| may_slide(urgency, s, c));
    let early = s.forced_descent.filter(|at| s.now < *at);
    if let Some(why) = rejection.or(early.map(|_| NotSteady.into())) {
        return stable.stay(why);
    }
    // After a hard contact no further attempt is made.
    let spent = progress.attempts > 0 && s.hard_contact_mps.is_some();
    if spent || progress.attempts >= c.max_attempts {
        return PhaseTransition::BreakOff(Reason::default());
    }
    progress.attempts += 1;
    MissionPhase::DESCENT.enter(Permitted)
}

/// Maximum time to touchdown, s, including the longest pause at the decision clearance.
fn landing_s(deck: &Deck, c: &MissionConfig) -> f64 {
    let descent_m = (deck.clearance_m - c.flare_clearance_m).max(0.0);
    descent_m / c.descent_mps + c.flare_clearance_m / c.flare_mps + DECISION_TIMEOUT_S
}

fn course_rejection(deck: &Deck, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    match s.course {
        Course::Unknown => None,
        Course::Steady(left_s) => exceeds(CourseEnds, landing_s(deck, c), f64::from(left_s)),
        Course::Turning => Some(VesselTurns.into()),
    }
}

/// Limit of the RMS oscillation of the commanded tilt beyond plan and wind, rad (5 deg): half of a harmful contact's
/// angle. A stable attitude loop stays below it.
const MAX_SWING_RAD: f64 = 0.087;

/// Maximum duration of a flare without vision, s: the last metre, and longer while the radio reports the vessel.
const BLIND_S: f64 = 2.5;
pub(super) const RADIO_BLIND_S: f64 = 5.0;
/// Maximum age of the radio's position that extends a flare without vision, s.
const RADIO_FRESH_S: f64 = 1.5;

pub(super) fn blind_limit(deck: &Deck) -> f64 {
    if deck.radio_age_s <= RADIO_FRESH_S {
        RADIO_BLIND_S
    } else {
        BLIND_S
    }
}

/// Time for which the rotors must carry a landed drone above the deck before the touchdown counts as false, s.
const AIRBORNE_S: f64 = 1.0;

/// Stays landed until the drone is armed again after a disarm, or shown to fly. In the latter case the link keeps the
/// motors running.
fn landed(
    disarmed: bool,
    airborne: Option<DroneTime>,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let risen = s.false_touchdown().filter(|_| !disarmed);
    let (airborne, lasted) = lasting(risen.is_some(), airborne, s.now);
    let leaves = s.slides().or(risen.filter(|_| lasted >= AIRBORNE_S));
    if let Some(why) = leaves
        && !disarmed
        && s.flight != ControlState::Disarmed
    {
        // The order lasts until the rotors are off.
        progress.overruled = s.motors_stopped;
        return if progress.landing {
            PhaseTransition::BreakOff(why)
        } else {
            gave_up(s, c).enter(why)
        };
    }
    let armed = matches!(
        s.flight,
        ControlState::OnGround
            | ControlState::OtherControl(_)
            | ControlState::SetPointsLost
            | ControlState::Ours
    );
    if disarmed && armed {
        return MissionPhase::Idle.enter(ArmedAgain);
    }
    let disarmed = disarmed || s.flight == ControlState::Disarmed;
    progress.landing &= !disarmed;
    progress.deck_first &= !disarmed;
    let landed = MissionPhase::Landed { disarmed, airborne };
    if disarmed && progress.cycles.on {
        return turnaround::stands(landed, progress, s, c);
    }
    landed.stay(progress.cycles.ended.filter(|_| disarmed).unwrap_or_default())
}

fn above(deck: &Deck, c: &MissionConfig) -> bool {
    deck.vision_age_s <= c.vision_fresh_s && deck.distance_m <= RESUME_DISTANCE_M
}

/// Holds until data are fresh and a landing is ordered. `hold`: this hold, with the start of fresh data.
fn held(
    cause: HoldCause,
    hold: impl Fn(Option<DroneTime>) -> MissionPhase,
    fresh: Option<DroneTime>,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    if let HoldCause::Station(kept) = cause {
        return station::keeps(hold(None), &kept, s, c);
    }
    if cause == HoldCause::Operator && !progress.landing {
        if let Some(next) = turnaround::hands_over(hold(None), progress, s, c) {
            return next;
        }
        let waits = if progress.stopped { Operator } else { NotCommanded };
        let why = stopped_low(progress, s).unwrap_or(waits.into());
        return hold(None).stay(why);
    }
    if s.flight == ControlState::Unknown {
        return hold(None).stay(NotFlying);
    }
    let far = |seeks: &SilentVessel| s.sortie.turns_back.is_some() || seeks.offset.norm() > seek::FAR_M;
    if let Some(seeks) = seek::due(progress, s).filter(far) {
        return seek::sets_out(progress, &seeks, s);
    }
    if let Some(why) = old_data(s) {
        return hold(None).stay(why);
    }
    let (Some(deck), Some(own)) = (s.fresh_deck(), s.own) else {
        return hold(None).stay(s.no_deck());
    };
    if let Some(why) = too_far(deck, c) {
        return hold(None).stay(why);
    }
    if deck.vision_age_s > c.vision_fresh_s && deck.radio_age_s > c.radio_fresh_s && deck.beacon.is_none() {
        return hold(None).stay(if deck.vision_age_s.is_finite() {
            Reason::new(VisionLost, deck.vision_age_s, c.vision_fresh_s)
        } else {
            Reason::new(NoVessel, deck.radio_age_s, c.radio_fresh_s)
        });
    }
    let (fresh, lasted) = lasting(true, fresh, s.now);
    if lasted < RECOVER_S {
        return hold(fresh).stay(Reason::new(NotSteady, lasted, RECOVER_S));
    }
    let next = if above(deck, c) && s.waits(c).is_none() && s.doubt.is_none() {
        MissionPhase::TRACKING
    } else {
        MissionPhase::GetAltitude {
            from: [own.position.x, own.position.y],
        }
    };
    next.enter(match cause {
        HoldCause::Operator => Commanded.into(),
        HoldCause::Data | HoldCause::Station(_) => Reason::new(Recovered, lasted, RECOVER_S),
    })
}
