//! State machine of Procházka et al. 2024, section IV: a pure function from phase, progress, command and
//! situation to phase and reasons.
//!
//! Concerns and orders come first (`concerns`), then the state's own transitions (`states`).

use alight_shared::msg::{BatteryPlace, CommandKind, Phase, Reason, ReasonCode, State};

use super::{
    answers::not_done,
    charge::is_open,
    concerns::{AFTER_ORDERS, BEFORE_ORDERS, interrupt, is_elsewhere},
    limits::LOST_OUTSIDE_M,
    phase::{
        Decision, DroneTime, HoldCause, MissionPhase, MissionProgress, PhaseTransition, RejectedOrder,
        gave_up, hard_contact, holding, lasting,
    },
    situation::{ControlState, Situation},
    states, station, take_off,
};
use crate::mission_config::MissionConfig;

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
    let transition = interrupted(phase, &mut progress, command, s, c)
        .unwrap_or_else(|| states::step(phase, &mut progress, s, c));
    let (phase, entered, waiting) = match transition {
        PhaseTransition::Stay(phase, waiting) => (phase, None, waiting),
        PhaseTransition::Go(phase, why) => (phase, Some(why), Reason::default()),
        PhaseTransition::BreakOff(why) if progress.stopped => (gave_up(s, c), Some(why), why),
        // The drone may be damaged, so no further attempt is made.
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
    if matches!(phase, MissionPhase::GaveUp { .. }) {
        progress.landing &= is_elsewhere(&progress);
        progress.deck_first = false;
    }
    progress.flared = flared(phase, &progress, s);
    if !phase.flies() {
        progress.low_battery = None;
    }
    // A drone that has left the deck stays on its sortie under any control.
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

/// [`MissionProgress::flared`] after a step in `phase`: kept while the end of a landing may not have been observed.
fn flared(phase: MissionPhase, progress: &MissionProgress, s: &Situation) -> Option<DroneTime> {
    if matches!(phase, MissionPhase::Flare { committed: true, .. }) && s.fresh_deck().is_some() {
        return Some(s.now);
    }
    if phase.waits_for_data() || phase.state() == State::Flare {
        progress.flared
    } else {
        None
    }
}

/// Whether the drone is in the air under our control.
fn can_stop(phase: MissionPhase, s: &Situation) -> bool {
    let waits = phase == MissionPhase::Idle && s.flight == ControlState::Ours && s.own.is_some();
    let stands = matches!(phase, MissionPhase::Landed { disarmed: false, .. });
    phase.flies() || waits || stands && s.may_fly()
}

/// Whether a landing that an operator stops now is completed, because that contact is softer
/// ([`crate::contingency::ContactOutcomes`]). A drone that would not stay on the deck climbs even into a harder, but
/// not harmful, contact. Completion is final, because forecasts could otherwise reverse it as the height decreases.
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

/// Keeps an order across a set-point loss, unless a pilot takes over before set-points are followed again. An order for
/// a drone that is found in a hold keeps waiting.
fn after_set_point_loss(phase: MissionPhase, progress: &mut MissionProgress, s: &Situation) {
    match s.flight {
        ControlState::Unknown => {}
        ControlState::SetPointsLost => {
            if !progress.set_points_lost {
                // Restarts the wait for the drone.
                progress.started = s.now;
            }
            progress.set_points_lost |= phase.flies();
        }
        ControlState::OnGround | ControlState::Ours => progress.set_points_lost = false,
        ControlState::Disarmed | ControlState::OtherControl(_) => {
            progress.landing &= !progress.set_points_lost;
            (progress.set_points_lost, progress.station) = (false, None);
        }
    }
}

fn interrupted(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    command: Option<CommandKind>,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    progress.overruled &= s.motors_stopped;
    progress.missing = lasting(!is_open(s, c), progress.missing, s.now).0;
    if s.flight == ControlState::Disarmed && progress.sortie {
        progress.sortie = false;
        // As far as this mission has observed, the drone was disarmed away from the deck.
        if !matches!(phase, MissionPhase::Landed { .. }) {
            progress.cycles.end(ReasonCode::NotOnDeck.into());
        }
    }
    after_set_point_loss(phase, progress, s);
    interrupt(&BEFORE_ORDERS, phase, progress, s, c)
        .or_else(|| command.and_then(|command| commanded(phase, progress, command, s, c)))
        .or_else(|| interrupt(&AFTER_ORDERS, phase, progress, s, c))
}

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
            // During a take-off, or on a sortie before its landing, there is no landing to stop.
            let away = phase.waits_for_operator() || phase == MissionPhase::Idle;
            progress.cycles.end(ReasonCode::Operator.into());
            let lands = progress.landing || !(phase.takes_off() || progress.sortie && away);
            progress.landing = false;
            progress.stopped |= lands;
            progress.deck_declined |= progress.is_urgent();
            progress.deck_first = false;
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
                // A landing that must be completed is not stopped by this reason.
                return (!stopped).then(|| phase.enter(why));
            }
            progress.landing = true;
            progress.stopped = false;
            progress.attempts = 0;
            progress.started = s.now;
            progress.led_from = None;
            progress.armed = false;
            progress.deck_declined = false;
            progress.deck_first = s.battery.is_some_and(|b| b < s.battery_reserve);
            progress.low_battery = progress.deck_first.then_some(BatteryPlace::Deck);
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
