//! Conditions under which a descent or flare continues or is broken off.

use alight_shared::msg::{
    Course, Reason,
    ReasonCode::{
        Descending, DescendingTo, Deviated, FlareHeight, Flaring, Matched, Matching, Missed, NoPlan, Swings,
        TiltExcess, TooNear, VesselTurns, VisionLost,
    },
};

use super::{
    super::{
        limits::{DECISION_TIMEOUT_S, HYSTERESIS, LOST_OUTSIDE_M, exceeds, first_beyond},
        phase::{DroneTime, MissionPhase, MissionProgress, PhaseTransition, gave_up, lasting},
        situation::{ClimbRoom, Deck, MAY_TOUCH_M, Situation},
    },
    MAX_SWING_RAD, begin_harm, begins_at, blind_limit, unlikely, urgency, widening,
};
use crate::mission_config::MissionConfig;

/// Reason to break off an uncommitted landing: another owner of the deck, or a turn announced by the helm.
fn withdrawn(urgency: f64, s: &Situation) -> Option<Reason> {
    let turns = s.course == Course::Turning && urgency <= 0.0;
    (s.reservation.lost()).or_else(|| turns.then(|| VesselTurns.into()))
}

fn not_ready_to_flare(deck: &Deck, c: &MissionConfig) -> Option<Reason> {
    first_beyond([
        (
            VisionLost,
            deck.located_age_s().min(deck.radio_age_s),
            c.vision_fresh_s,
        ),
        (VisionLost, deck.located_age_s(), c.descent_vision_s),
    ])
}

/// Cone of a descent: radius at the deck, m, and its increase per metre of clearance.
const CONE_M: f64 = 1.0;
const CONE_SLOPE: f64 = 0.3;
/// Duration of a new attempt, s, and its probability of a harmful contact. A landing is broken off if its probability
/// falls below the required one by more than the cost of both, or if its harm exceeds that of a new attempt by more than
/// the permitted harm.
const REPEAT_S: f64 = 30.0;
const REPEAT_RISK: f64 = 0.02;

/// Reasons that neither prevent nor end a landing on low battery.
fn swings_or_contradicted(deck: &Deck, s: &Situation) -> Option<Reason> {
    exceeds(Swings, s.swing_rad, HYSTERESIS * MAX_SWING_RAD).or(deck.contradicted)
}

fn repeat_cost(c: &MissionConfig) -> f64 {
    REPEAT_S * c.waiting_cost_per_s() + REPEAT_RISK
}

/// Reason to climb at the last height from which the drone can, at the latest before the flare. There most is known of
/// the contact, so that the strict limits of a landing hold: in gusts twice that of the lull that [`gusty`] awaited, and
/// otherwise the cost of a new attempt more.
fn too_harmful(deck: &Deck, urgency: f64, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let decides = match deck.climb {
        ClimbRoom::Clear => deck.clearance_m < c.flare_clearance_m,
        ClimbRoom::Last => true,
        ClimbRoom::Meets => false,
    };
    if !decides {
        return None;
    }
    let repeat = repeat_cost(c);
    let max_harm = if s.odds.is_some_and(|o| o.gusts) {
        2.0 * c.max_harm
    } else {
        c.max_harm + repeat
    };
    unlikely(urgency, s, c.min_probability - repeat, max_harm)
}

/// Clearance below which a descent pauses until the gust of the contact is mild, m: a drone that is met there by the
/// deck can still climb.
const AWAITS_LULL_M: f64 = 2.4;

/// Reason to pause low above the deck, where a gust lasts until the contact. Other errors are as well known at any
/// height.
fn gusty(deck: &Deck, urgency: f64, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let waits = deck.clearance_m < AWAITS_LULL_M && s.odds.is_some_and(|o| o.gusts);
    if !waits {
        return None;
    }
    unlikely(urgency, s, c.min_probability - repeat_cost(c), c.max_harm)
}

/// Violated condition of a landing in progress. `blind_s`: maximum time without vision.
fn violation(deck: &Deck, urgency: f64, s: &Situation, c: &MissionConfig, blind_s: f64) -> Option<Reason> {
    let cone = CONE_M + CONE_SLOPE * deck.clearance_m.max(0.0);
    let repeat = repeat_cost(c);
    exceeds(VisionLost, deck.located_age_s(), blind_s)
        .or(s.doubt)
        .or_else(|| exceeds(Deviated, deck.distance_m, cone))
        .or_else(|| deck.infeasible(c, HYSTERESIS * widening(urgency)))
        .or_else(|| swings_or_contradicted(deck, s).filter(|_| urgency <= 0.0))
        .or_else(|| unlikely(urgency, s, begins_at(c) - repeat, begin_harm(c) + repeat))
        .or_else(|| exceeds(NoPlan, s.plan_age_s, s.plan_limit_s))
}

/// Tilt in excess of the commanded one at which attitude control is lost, rad: 10 deg; landings reach 2 deg.
const MAX_TILT_EXCESS_RAD: f64 = 0.175;

/// Reason if attitude control is being lost; the higher thrust of a climb restores the rotors' torque.
fn attitude_lost(deck: &Deck, s: &Situation) -> Option<Reason> {
    exceeds(TiltExcess, s.tilt_excess_rad, MAX_TILT_EXCESS_RAD).filter(|_| deck.clearance_m > MAY_TOUCH_M)
}

/// Descends to the flare, pausing at the decision clearance until the flare's conditions are met.
pub(super) fn descent(
    violated: Option<DroneTime>,
    paused: Option<DroneTime>,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let Some(deck) = s.fresh_deck() else {
        return PhaseTransition::BreakOff(s.no_deck());
    };
    if let Some(why) = attitude_lost(deck, s) {
        return PhaseTransition::BreakOff(why);
    }
    let urgency = urgency(progress, s, c);
    let violation = violation(deck, urgency, s, c, c.descent_vision_s);
    let (violated, lasted) = lasting(violation.is_some(), violated, s.now);
    let close = deck.clearance_m < c.commit_clearance_m;
    // Below the commit clearance continuing over the deck is safer than breaking off.
    if let Some(why) = violation.filter(|_| lasted > VIOLATION_S && !close) {
        return PhaseTransition::BreakOff(why);
    }
    if close && let Some(why) = exceeds(Deviated, s.outside_m, LOST_OUTSIDE_M) {
        return PhaseTransition::BreakOff(why);
    }
    let withdrawn = withdrawn(urgency, s).filter(|_| !close);
    if let Some(why) = withdrawn.or_else(|| too_harmful(deck, urgency, s, c)) {
        return PhaseTransition::BreakOff(why);
    }
    if let Some(lowest_m) = c.lowest_plan_m() {
        return matching(lowest_m, violated, paused, deck, violation, s, c);
    }
    let rejection = not_ready_to_flare(deck, c);
    // A deck that rises to the drone does not decide the landing while a climb clears it.
    if let Some(why) = rejection
        && close
        && deck.climb != ClimbRoom::Meets
    {
        return PhaseTransition::BreakOff(why);
    }
    if deck.clearance_m < c.flare_clearance_m && (rejection.is_none() || close) {
        let flare = MissionPhase::Flare {
            committed: close,
            violated: None,
        };
        return flare.enter(Reason::new(FlareHeight, deck.clearance_m, c.flare_clearance_m));
    }
    let stopped = rejection.filter(|_| deck.clearance_m < c.decision_clearance_m);
    let stopped = stopped.or_else(|| gusty(deck, urgency, s, c));
    let (paused, waited) = lasting(stopped.is_some(), paused, s.now);
    if let Some(why) = stopped.filter(|_| waited > DECISION_TIMEOUT_S) {
        return PhaseTransition::BreakOff(why);
    }
    let sinking = Reason::new(Descending, deck.clearance_m, c.flare_clearance_m);
    MissionPhase::Descent { violated, paused }.stay(stopped.or(violation).unwrap_or(sinking))
}

/// Distance above the lowest plan within which the drone follows the deck, m: the heave that it does not follow.
const MATCHED_WITHIN_M: f64 = 0.5;

/// Ends a descent without a landing: the drone follows the deck at the lowest permitted height, from `matched` on,
/// and then climbs.
fn matching(
    lowest_m: f64,
    violated: Option<DroneTime>,
    matched: Option<DroneTime>,
    deck: &Deck,
    violation: Option<Reason>,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    if deck.clearance_m < c.lowest_clearance_m {
        let why = Reason::new(TooNear, deck.clearance_m, c.lowest_clearance_m);
        return PhaseTransition::BreakOff(why);
    }
    let there = deck.clearance_m < lowest_m + MATCHED_WITHIN_M;
    let (paused, lasted) = lasting(there, matched, s.now);
    if lasted >= c.match_s {
        return gave_up(s, c).enter(Reason::new(Matched, c.lowest_clearance_m, c.match_s));
    }
    let waits = if there {
        Reason::new(Matching, lasted, c.match_s)
    } else {
        Reason::new(DescendingTo, deck.clearance_m, lowest_m)
    };
    MissionPhase::Descent { violated, paused }.stay(violation.unwrap_or(waits))
}

/// Flares until touchdown. A missed or lost deck breaks off the flare; until it is committed, soft reasons do as well.
pub(super) fn flare(
    committed: bool,
    violated: Option<DroneTime>,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let Some(deck) = s.fresh_deck() else {
        return PhaseTransition::BreakOff(s.no_deck());
    };
    // Half a metre above the commit clearance there is time to decide after the deck has fallen away.
    let committed = deck.clearance_m < c.commit_clearance_m + if committed { 0.5 } else { 0.0 };
    let hard = exceeds(Missed, -deck.clearance_m, c.missed_m).or_else(|| {
        exceeds(Deviated, s.outside_m, LOST_OUTSIDE_M).filter(|_| deck.clearance_m < c.commit_clearance_m)
    });
    let slides = s.slides().filter(|_| deck.clearance_m < MAY_TOUCH_M);
    let hard = hard.or(slides).or_else(|| attitude_lost(deck, s));
    let urgency = urgency(progress, s, c);
    let soft = withdrawn(urgency, s).or_else(|| too_harmful(deck, urgency, s, c));
    if let Some(why) = hard.or_else(|| soft.filter(|_| !committed)) {
        return PhaseTransition::BreakOff(why);
    }
    let violation = violation(deck, urgency, s, c, blind_limit(deck));
    let (violated, lasted) = lasting(violation.is_some(), violated, s.now);
    if let Some(why) = violation.filter(|_| lasted > VIOLATION_S && !committed) {
        return PhaseTransition::BreakOff(why);
    }
    let sinking = Reason::new(Flaring, deck.clearance_m, 0.0);
    MissionPhase::Flare { committed, violated }.stay(violation.unwrap_or(sinking))
}

/// Duration of a violation that breaks off a landing, s: several messages.
const VIOLATION_S: f64 = 0.3;
