//! The state machine of Procházka et al. 2024, section IV, as a pure function: phase, progress,
//! command and situation in, phase and reasons out.
//!
//! Interrupts first (touchdown, abort, loss of control, stale data, hold, battery, time limit), then
//! what the state itself does, in `states`.

use alight_shared::msg::{
    BatteryPlace, CommandKind, OwnMission, Phase, Reason, ReasonCode, WAITING_DISTANCE_M,
};

use super::answers::not_done;
use super::checkpoint::ends_softer;
use super::limits::{LOST_OUTSIDE_M, RESUME_DISTANCE_M, exceeds};
use super::phase::{
    Decision, HoldCause, MissionPhase, MissionProgress, PhaseTransition, RejectedOrder, gave_up, holding,
    old_data,
};
use super::reservation::Reservation;
use super::situation::{ControlState, Deck, Situation};
use super::states;
use super::station;
use super::take_off;
use crate::contingency::HARD_MPS;
use crate::mission_config::MissionConfig;

/// One step of the mission.
pub fn decide(
    phase: MissionPhase,
    progress: MissionProgress,
    command: Option<CommandKind>,
    s: &Situation,
    c: &MissionConfig,
) -> Decision {
    let (mut progress, before, former) = (progress, phase, progress);
    if command.is_some() {
        progress.rejected = None;
    }
    let transition = interrupt(phase, &mut progress, command, s, c)
        .unwrap_or_else(|| states::step(phase, &mut progress, s, c));
    let (phase, entered, waiting) = match transition {
        PhaseTransition::Stay(phase, waiting) => (phase, None, waiting),
        PhaseTransition::Go(phase, why) => (phase, Some(why), Reason::default()),
        PhaseTransition::BreakOff(why) if progress.stopped => (gave_up(s, c), Some(why), why),
        // What happened once to a drone that may be damaged now is not tried again.
        PhaseTransition::BreakOff(why) if s.hard_contact_mps.is_some() => {
            (gave_up(s, c), hard_contact(s), why)
        }
        PhaseTransition::BreakOff(why) if progress.attempts >= c.max_attempts => {
            let (attempts, limit) = (f64::from(progress.attempts), f64::from(c.max_attempts));
            let spent = Reason::new(ReasonCode::OutOfRetries, attempts, limit);
            (gave_up(s, c), Some(spent), why)
        }
        PhaseTransition::BreakOff(why) => (MissionPhase::TRACKING, Some(why), why),
    };
    if matches!(phase, MissionPhase::GaveUp { .. } | MissionPhase::Landed { .. }) {
        (progress.landing, progress.ordered_below) = (false, None);
    }
    if !phase.flies() {
        progress.low_battery = None;
    }
    // Whoever takes the drone from here on takes one that has left the deck.
    if phase.has_left() && !progress.sortie {
        progress.sortie = true;
        progress.cycles.leave();
    }
    if let Some(why) = entered {
        progress.cycles.follow(before.state(), phase.state(), why);
    }
    let completes = progress.stopped && phase.state().phase() == Phase::Landing;
    let waiting = if completes {
        ReasonCode::CompletesLanding.into()
    } else {
        waiting
    };
    let mut decision = Decision {
        phase,
        progress,
        entered,
        waiting,
    };
    let undone = command.filter(|_| decision.progress.rejected.is_none());
    let undone = undone.and_then(|order| not_done(order, before, &former, &decision, s));
    if let Some(why) = undone {
        decision.progress.rejected = Some(RejectedOrder { at: s.now, why });
    }
    decision
}

/// The hard contact that was noticed.
fn hard_contact(s: &Situation) -> Option<Reason> {
    let reason = |mps| Reason::new(ReasonCode::HardContact, mps, HARD_MPS);
    s.hard_contact_mps.map(reason)
}

/// Whether there is something that an operator can stop: a drone in the air that is ours.
fn can_stop(phase: MissionPhase, s: &Situation) -> bool {
    let waits = phase == MissionPhase::Idle && s.flight == ControlState::Ours && s.own.is_some();
    let stands = matches!(phase, MissionPhase::Landed { disarmed: false, .. });
    phase.flies() || waits || stands && s.may_fly()
}

/// Whether an operator who stops the landing now lets it be completed, because that is the softer contact ([`crate::contingency::ContactOutcomes`]).
/// A drone that would not stay on the deck climbs at the price of a harder contact, but no harmful one. Once completed it
/// stays so: each new forecast could change the decision, over a height that shrinks.
fn completes(phase: MissionPhase, progress: &MissionProgress, s: &Situation, c: &MissionConfig) -> bool {
    let stays = s.staying.probability >= c.min_probability;
    let harder = s.fresh_deck().and_then(|d| d.ends).is_some_and(|ends| {
        if stays {
            ends.landing_is_softer()
        } else {
            ends.climb_is_harmful()
        }
    });
    let beneath = s.outside_m <= LOST_OUTSIDE_M && !s.motors_stopped;
    let touches = c.lowest_plan_m().is_none();
    touches && phase.state().phase() == Phase::Landing && (progress.stopped || harder && beneath)
}

/// Data may be this old where a landing is completed without them, s.
const COMPLETES_WITHOUT_DATA_S: f64 = 1.0;

/// Whether a landing that was not stopped goes on although data are old, for a moment: because to complete it is softer, or
/// because the drone's own odometry is missing low over the deck. Without that nothing is commanded, so that to leave now or
/// once it is back is the same, and then it is decided by where the drone is, not by where it was.
fn completes_without_data(
    phase: MissionPhase,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> bool {
    let known = s.forecast_age_s.max(s.odometry_age_s) <= COMPLETES_WITHOUT_DATA_S;
    let lands = phase.state().phase() == Phase::Landing && !progress.stopped;
    let touches = c.lowest_plan_m().is_none();
    let blind = s.odometry_age_s > s.odometry_limit_s && s.forecast_age_s <= s.forecast_limit_s;
    let goes_on = |d: Deck| blind && d.ends.is_some() || ends_softer(&d, s);
    lands && touches && known && s.deck.is_some_and(goes_on)
}

/// Transition on stale data: hold until they are fresh, unless an operator has stopped the landing meanwhile.
fn without_data(progress: &MissionProgress, s: &Situation, c: &MissionConfig) -> MissionPhase {
    if progress.stopped {
        gave_up(s, c)
    } else {
        holding(HoldCause::Data, s, c)
    }
}

/// Share of the reserve that is for waiting above a deck on which no descent can begin; the rest is for the next place.
const FOR_WAITING: f64 = 0.5;

/// Whether the charge `b` is below what the flight keeps: the reserve, and for a stopped landing what is left of it for its
/// operator; at once where the order came with less.
fn is_low(b: f64, progress: &MissionProgress, s: &Situation) -> bool {
    let limit = if progress.stopped {
        (1.0 - states::FOR_OPERATOR) * s.battery_reserve
    } else {
        s.battery_reserve
    };
    b < limit
}

/// Whether there is charge left to wait for the deck: until half of the reserve is left, or of what was left of it at the
/// order. An order that came with less, or a gauge that was above the reserve a moment before, leaves nothing for another place.
fn lasts(b: f64, progress: &MissionProgress, s: &Situation) -> bool {
    let half = (1.0 - FOR_WAITING) * s.battery_reserve;
    if progress.low_from.is_some_and(|from| from < half) {
        return true;
    }
    match progress.ordered_below {
        Some(ordered) if ordered < half => true,
        Some(ordered) => b >= (1.0 - FOR_WAITING) * ordered,
        None => b >= half,
    }
}

/// Whether the battery empties before any other place is reached than this deck: as near as where drones wait for it the measured power
/// asks for more than the configured reserve, so that half of the reserve lasts for about half of an attempt.
fn drains(deck: &Deck, s: &Situation, c: &MissionConfig) -> bool {
    deck.distance_m <= WAITING_DISTANCE_M + RESUME_DISTANCE_M && s.battery_reserve > c.battery_reserve
}

/// Transition with a battery below the reserve: to the first place of the configured order that can be had. The deck can
/// while its forecast is fresh, it is neither another's nor closed, half of the reserve is left or would not last for another
/// place, and no operator has declined it; a descent that has begun is the quickest way down in any case. An order to land that comes below the reserve makes the
/// deck the first place. A landing that an operator has stopped, or that was given up, leaves no drone in the air until it
/// falls.
fn low_battery(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let low = s.battery.filter(|b| is_low(*b, progress, s));
    let noticed = low.filter(|_| progress.low_battery.is_none());
    progress.low_from = progress.low_from.or(noticed).filter(|_| low.is_some());
    let b = low?;
    let why = |code| Reason::new(code, b, s.battery_reserve);
    let lands = phase.state().phase() == Phase::Landing;
    let touches = c.lowest_plan_m().is_none();
    if lands && progress.stopped {
        return None;
    }
    let ended = matches!(phase, MissionPhase::GaveUp { .. }) || phase.waits_for_operator();
    let free = !matches!(s.reservation, Reservation::Others(holder) if holder != 0);
    let wanted = progress.landing || ended && !progress.deck_declined;
    let deck = s
        .fresh_deck()
        .filter(|d| wanted && free && touches && (lands || lasts(b, progress, s) || drains(d, s, c)));
    let had = |p: &&BatteryPlace| **p != BatteryPlace::Deck || deck.is_some();
    let ordered = (deck.is_some() && progress.ordered_below.is_some()).then_some(BatteryPlace::Deck);
    let place = ordered.or(c.battery_order.iter().find(had).copied());
    if lands && place != Some(BatteryPlace::Deck) && touches {
        return None;
    }
    let before = core::mem::replace(&mut progress.low_battery, place);
    let code = match place {
        Some(BatteryPlace::Deck) => {
            let near = deck.is_some_and(|d| d.distance_m <= RESUME_DISTANCE_M);
            let tracks = near && !lands && s.waits(c).is_none();
            let next = match (tracks, ended) {
                (true, _) => MissionPhase::TRACKING,
                (false, true) => holding(HoldCause::Data, s, c),
                (false, false) => phase,
            };
            if ended {
                (progress.landing, progress.stopped) = (true, false);
                (progress.attempts, progress.started) = (0, s.now);
            }
            return (before != place || ended).then(|| next.enter(why(ReasonCode::BatteryDeck)));
        }
        Some(BatteryPlace::Home) => ReasonCode::BatteryHome,
        Some(BatteryPlace::Here) => ReasonCode::BatteryHere,
        // It holds already.
        None if ended => return None,
        None => ReasonCode::BatteryLow,
    };
    Some(gave_up(s, c).enter(why(code)))
}

/// The order outlives a lapse of the set-points, and ends where a pilot takes the drone over before they are back.
fn after_lapse(progress: &mut MissionProgress, s: &Situation) {
    match s.flight {
        ControlState::Unknown => {}
        ControlState::Lapsed => {
            if !progress.lapsed {
                // From now on it waits for the drone.
                progress.started = s.now;
            }
            progress.lapsed = true;
        }
        ControlState::OnGround | ControlState::Ours => progress.lapsed = false,
        ControlState::Disarmed | ControlState::OtherControl(_) => {
            progress.landing &= !progress.lapsed;
            progress.lapsed = false;
        }
    }
}

/// The end of a sortie by what is left of the battery, or because the autopilot's own mission is done: the drone lands as if
/// that had been ordered. Where the pilot flies, or the
/// autopilot its own mission, the order waits for the drone; who stopped a landing is asked first, as for any low battery.
fn turn_back(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let waits = phase.waits_for_operator();
    let idles = phase == MissionPhase::Idle;
    let done = (s.sortie.own_mission == OwnMission::Done && idles).then(|| ReasonCode::MissionDone.into());
    let why = (s.sortie.turns_back.or(done))
        .filter(|_| progress.sortie && !progress.landing && !progress.stopped)?;
    if !(waits || idles) {
        return None;
    }
    (progress.landing, progress.started, progress.attempts) = (true, s.now, 0);
    let next = if waits {
        holding(HoldCause::Data, s, c)
    } else {
        phase
    };
    Some(next.enter(why))
}

/// A beacon alone has led the drone too far from where that began: one that moves on would lead it anywhere.
fn led_too_far(progress: &mut MissionProgress, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let deck = s.fresh_deck()?;
    let known = deck.radio_age_s <= c.radio_fresh_s || deck.vision_age_s <= c.vision_fresh_s;
    if known || s.moved.is_some() || deck.beacon.is_none() {
        progress.led_from = None;
        return None;
    }
    let here = s.own?.position;
    let [x, y] = *progress.led_from.get_or_insert([here.x, here.y]);
    let way_m = (here.x - x).hypot(here.y - y);
    exceeds(ReasonCode::VesselTooFar, way_m, c.beacon_max_way_m)
}

/// Transitions of every state.
fn interrupt(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    command: Option<CommandKind>,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    progress.overruled &= s.motors_stopped;
    if s.flight == ControlState::Disarmed && progress.sortie {
        progress.sortie = false;
        // Elsewhere than on the deck, as far as this mission has observed.
        if !matches!(phase, MissionPhase::Landed { .. }) {
            progress.cycles.end(ReasonCode::NotOnDeck.into());
        }
    }
    after_lapse(progress, s);
    if phase.flies() && s.motors_stopped && !progress.overruled {
        let touchdown = hard_contact(s).unwrap_or(ReasonCode::Touchdown.into());
        return Some(MissionPhase::LANDED.enter(touchdown));
    }
    let commanded = command.and_then(|command| commanded(phase, progress, command, s, c));
    let commanded = commanded.or_else(|| turn_back(phase, progress, s, c));
    if commanded.is_some() || !phase.flies() {
        return commanded;
    }
    if let Some(transition) = not_ours(phase, progress, s, c) {
        return Some(transition);
    }
    // What ends a climb over the deck waits until the drone is clear of it.
    if phase.takes_off() {
        return None;
    }
    if let Some(why) = old_data(s).filter(|_| phase.needs_data()) {
        return Some(if completes_without_data(phase, progress, s, c) {
            phase.stay(why)
        } else {
            without_data(progress, s, c).enter(why)
        });
    }
    let gives_up = matches!(phase, MissionPhase::GaveUp { .. });
    // On its way to another place.
    let elsewhere = matches!(
        progress.low_battery,
        Some(BatteryPlace::Home | BatteryPlace::Here)
    );
    if gives_up && elsewhere {
        return None;
    }
    if let Some(transition) = low_battery(phase, progress, s, c) {
        return Some(transition);
    }
    if phase.state().phase() == Phase::Landing || gives_up || phase.waits_for_operator() {
        return None;
    }
    if let Some(why) = led_too_far(progress, s, c) {
        // Nor is it led on by a low battery.
        progress.deck_declined = true;
        return Some(gave_up(s, c).enter(why));
    }
    let took = (s.now - progress.started).secs();
    (took > c.mission_timeout_s)
        .then(|| gave_up(s, c).enter(Reason::new(ReasonCode::TooLong, took, c.mission_timeout_s)))
}

/// Transition on an operator's command.
fn commanded(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    command: CommandKind,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let gives_up = matches!(phase, MissionPhase::GaveUp { .. });
    match command {
        CommandKind::Abort | CommandKind::Hold => {
            let aborts = command == CommandKind::Abort;
            let completes = completes(phase, progress, s, c);
            // On a sortie, before it lands, and in a take-off there is no landing that is stopped.
            let away = phase.waits_for_operator() || phase == MissionPhase::Idle;
            progress.cycles.end(ReasonCode::Operator.into());
            let lands = progress.landing || !(phase.takes_off() || progress.sortie && away);
            progress.landing = false;
            progress.stopped |= lands;
            progress.deck_declined |= progress.is_urgent();
            progress.ordered_below = None;
            if phase.stands() || phase.takes_off() {
                return take_off::stopped(phase, s, c, ReasonCode::Operator);
            }
            if !can_stop(phase, s) || completes || aborts && gives_up {
                return None;
            }
            progress.overruled = s.motors_stopped;
            let stops = if aborts {
                gave_up(s, c)
            } else {
                holding(HoldCause::Operator, s, c)
            };
            Some(station::leaves(phase, stops, s, c).enter(ReasonCode::Operator))
        }
        CommandKind::Land => {
            let stopped = progress.stopped && phase.state().phase() == Phase::Landing;
            let climbs_out = matches!(phase, MissionPhase::ClimbOut { .. });
            if !(phase == MissionPhase::Idle
                || gives_up
                || phase.waits_for_operator()
                || stopped
                || climbs_out)
            {
                return None;
            }
            if let Some(why) = s.held_back() {
                // A landing that is completed in any case is not rejected.
                return (!stopped).then(|| phase.enter(why));
            }
            progress.landing = true;
            progress.stopped = false;
            progress.attempts = 0;
            progress.started = s.now;
            progress.led_from = None;
            progress.armed = false;
            progress.deck_declined = false;
            progress.ordered_below = s.battery.filter(|b| *b < s.battery_reserve);
            progress.low_battery = progress.ordered_below.map(|_| BatteryPlace::Deck);
            let restarts = gives_up || phase.station().is_some();
            restarts.then(|| holding(HoldCause::Data, s, c).enter(ReasonCode::Commanded))
        }
        CommandKind::TakeOff => take_off::commanded(phase, progress, s, c),
        CommandKind::Station(station) => station::commanded(phase, progress, station, s, c),
        CommandKind::Ready => {
            let why = progress.cycles.rejects_ready(s, c);
            progress.cycles.ready |= why.is_none();
            progress.rejected = why.map(|why| RejectedOrder { at: s.now, why });
            None
        }
    }
}

/// Transition when the drone is not ours, or not known to be.
fn not_ours(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    match s.flight {
        ControlState::Disarmed | ControlState::OtherControl(_) => {
            progress.landing = false;
            Some(MissionPhase::Idle.enter(ReasonCode::NotFlying))
        }
        // Low over the deck: up, as soon as it follows set-points again.
        ControlState::Lapsed if phase.takes_off() => take_off::lapsed(phase, s, c),
        // It goes on to hold there, or on its way up, once set-points are followed again.
        ControlState::Lapsed if phase.rests() => None,
        ControlState::Lapsed => Some(MissionPhase::Idle.enter(ReasonCode::NotFlying)),
        ControlState::Unknown if phase.needs_data() => {
            Some(without_data(progress, s, c).enter(ReasonCode::NotFlying))
        }
        ControlState::Unknown | ControlState::OnGround | ControlState::Ours => None,
    }
}
