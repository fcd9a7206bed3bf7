//! Charge below the reserve: choice of landing place, and point of no return of each place.
//!
//! | place | costs | the drone leaves for it |
//! |---|---|---|
//! | deck | nothing | at once |
//! | home | unknown | with the last charge that reaches it, after [`MISSING_S`] without the deck |
//! | sea: here, and a home on which the vessel stood or stands | the drone | with the last charge for a descent |
//!
//! A place needs the charge `n = (1 + m) P (T + t) + g` with the power `P`, the flight time `T` in the wind, the landing
//! time `t`, the relative error `m` of all three, and the gauge's step `g`. The drone stays with the first place of
//! `battery_order` until its charge `b` falls to the `n` of the next place. Until then it waits for a deck that is
//! closed, reserved by another drone or unknown, and for as long as `P` is unknown. A drone that has been sent away for
//! want of the deck is taken back once the deck is free and in reach ([`taken_back`]).

use alight_shared::msg::{BatteryPlace, LandingMode, LastResort, OwnMission, Phase, Reason, ReasonCode};
use nalgebra::Vector2;

use super::{
    limits::{FOR_OPERATOR, HYSTERESIS, RESUME_DISTANCE_M},
    phase::{HoldCause, MissionPhase, MissionProgress, PhaseTransition, gave_up, holding, old_data},
    reservation::Reservation,
    situation::{Charges, ControlState, Deck, Situation},
    sortie::ReturnLeg,
};
use crate::mission_config::MissionConfig;

/// Relative error of power, wind and times.
const MARGIN: f64 = 0.25;
const STEP: f64 = 0.01;
/// Time of a mode change and of the last part of a descent to ground, s.
const ENDS_S: f64 = 10.0;
/// Speed of the autopilot's descent to land, m/s. Source: PX4's MPC_LAND_SPEED; ArduCopter sinks faster above 10 m.
const LAND_MPS: f64 = 0.7;
/// Air speed of the autopilot's return, m/s. Source: PX4's MPC_XY_CRUISE; ArduCopter's RTL is faster.
const RETURN_MPS: f64 = 5.0;
/// Duration of the shortest attempt, from above the deck onto it, s.
const LAST_ATTEMPT_S: f64 = 30.0;
/// Distance between home and the deck within which home is the vessel, m: two GNSS errors and the way after which
/// `send_home` follows her.
const AT_VESSEL_M: f64 = 10.0;
/// Fraction of the reserve kept for a home at an unknown position.
const UNKNOWN_HOME: f64 = 0.5;

/// Time after which a missing deck is given up, s: enough for the crew to cross it, for a landing, or for a restart.
const MISSING_S: f64 = 20.0;

impl Charges {
    /// `power`: 1/s; `home` and `deck`: offsets from the drone, m, None if unknown; `up_m`: height above the water.
    pub(super) fn of(
        power: f64,
        home: Option<Vector2<f64>>,
        deck: Option<Vector2<f64>>,
        wind: Vector2<f64>,
        up_m: f64,
        c: &MissionConfig,
    ) -> Charges {
        let land_s = up_m.max(0.0) / LAND_MPS + ENDS_S;
        let needs = |time_s: f64| (1.0 + MARGIN) * power * time_s + STEP;
        let way_s = |offset| {
            let way = ReturnLeg {
                offset,
                vessel: Vector2::zeros(),
                wind,
                air_mps: RETURN_MPS,
            };
            way.time_s(0.0)
        };
        let beneath = |home: Vector2<f64>| deck.is_some_and(|deck| (home - deck).norm() < AT_VESSEL_M);
        Charges {
            home: home.map_or(UNKNOWN_HOME * c.battery_reserve, |offset| {
                needs(way_s(offset) + land_s)
            }),
            home_is_sea: home.is_some_and(beneath),
            here: needs(land_s),
            deck: needs(deck.map_or(0.0, way_s) + LAST_ATTEMPT_S),
            attempt: power * LAST_ATTEMPT_S,
            known: true,
        }
    }
    /// Charge at which the drone must leave for `place`.
    fn last_moment(&self, place: BatteryPlace) -> f64 {
        match place {
            BatteryPlace::Deck => 0.0,
            BatteryPlace::Home => self.home,
            BatteryPlace::Here => self.here,
        }
    }
    /// Whether the charge `b` is enough to reach `place`, without a margin; landing in place is always possible. A home
    /// in the sea costs the drone as here does, and needs more charge.
    fn reaches(&self, place: BatteryPlace, b: f64) -> bool {
        match place {
            BatteryPlace::Deck | BatteryPlace::Here => true,
            BatteryPlace::Home => b >= without_margin(self.home) && !self.home_is_sea,
        }
    }
    /// Whether a drone with the charge `b` leaves for `place` when the deck has been missing for `missing_s`.
    fn leaves_for(&self, place: BatteryPlace, b: f64, missing_s: f64) -> bool {
        if !self.known {
            return false;
        }
        let last = self.last_moment(place);
        let margin_used = place == BatteryPlace::Here && b <= without_margin(last);
        b <= last && missing_s >= MISSING_S || margin_used
    }
}

fn without_margin(n: f64) -> f64 {
    (n - STEP) / (1.0 + MARGIN)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DeckAccess {
    /// The operator has declined the deck, or the mode permits no landing.
    Declined,
    /// The deck is closed, reserved by another drone, unknown or not detected, or it currently moves too much.
    Awaited,
    Open,
}

pub(super) fn is_open(s: &Situation, c: &MissionConfig) -> bool {
    let free = !matches!(s.reservation, Reservation::Others(owner) if owner != 0);
    let lands = |d: &Deck| {
        let on_the_way = d.distance_m > RESUME_DISTANCE_M;
        on_the_way || d.vision_age_s <= c.vision_lost_s && d.infeasible(c, HYSTERESIS).is_none()
    };
    free && s.fresh_deck().is_some_and(lands)
}

/// Places reachable with the charge `b`, in order of preference.
fn remaining<'a>(
    b: f64,
    deck: DeckAccess,
    first: bool,
    s: &'a Situation,
    c: &'a MissionConfig,
) -> impl Iterator<Item = BatteryPlace> + 'a {
    let deck_first = (first && c.battery_order.contains(&BatteryPlace::Deck)).then_some(BatteryPlace::Deck);
    let rest = c.battery_order.iter().copied();
    let all = deck_first
        .into_iter()
        .chain(rest.filter(move |p| deck_first != Some(*p)));
    all.filter(move |p| *p != BatteryPlace::Deck || deck != DeckAccess::Declined)
        .filter(move |p| s.charges.reaches(*p, b))
}

/// Landing place for the charge `b`, and the charge at which the drone leaves for the next place.
fn place(
    b: f64,
    deck: DeckAccess,
    progress: &MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<(BatteryPlace, f64)> {
    let missing_s = progress.missing.map_or(0.0, |since| (s.now - since).secs());
    let mut places = remaining(b, deck, progress.deck_first, s, c);
    let preferred = places.next()?;
    let next = places.next().filter(|_| preferred == BatteryPlace::Deck);
    let leaves_at = next.map_or(0.0, |p| s.charges.last_moment(p));
    let leaves = |p: &BatteryPlace| s.charges.leaves_for(*p, b, missing_s);
    match next.filter(|p| deck == DeckAccess::Awaited && leaves(p)) {
        Some(next) => Some((next, s.charges.last_moment(next))),
        None => Some((preferred, leaves_at)),
    }
}

/// Place for which the drone leaves if the deck stays missing.
pub(super) fn last_resort(s: &Situation, c: &MissionConfig) -> Option<LastResort> {
    let place = remaining(s.battery?, DeckAccess::Declined, false, s, c).next()?;
    let charge = if s.charges.known {
        s.charges.last_moment(place)
    } else {
        STEP
    };
    Some(LastResort { place, charge })
}

/// Reason to take back a drone that Alight has sent away: the deck is free and in reach. What an operator or the
/// pilot's switch has stopped stays stopped.
pub(super) fn taken_back(progress: &MissionProgress, s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let b = s.battery?;
    let stopped = progress.stopped || progress.deck_declined || s.held_back().is_some();
    let away = s.sortie.own_mission == OwnMission::SentAway && s.flight != ControlState::Ours;
    let free = progress.missing.is_none() && old_data(s).is_none() && c.lowest_plan_m().is_none();
    let listed = c.battery_order.contains(&BatteryPlace::Deck);
    let back = away && free && listed && !stopped && b >= without_margin(s.charges.deck);
    back.then(|| Reason::new(ReasonCode::BatteryDeck, b, s.battery_reserve))
}

/// Relaxation of the landing's limits on low battery, 0 to 1. It is 0 in the first half of the reserve, in which the
/// drone waits for the best moment, and 1 at the charge for one attempt or for home, whichever is larger.
pub(super) fn urgency(progress: &MissionProgress, s: &Situation, c: &MissionConfig) -> f64 {
    let Some(b) = s.battery.filter(|_| progress.is_urgent()) else {
        return 0.0;
    };
    let mut others = remaining(b, DeckAccess::Declined, false, s, c);
    let next = others.find(|p| *p == BatteryPlace::Home);
    let last = next
        .map_or(0.0, |p| s.charges.last_moment(p))
        .max(s.charges.attempt);
    let first = 0.5 * (s.battery_reserve + last);
    if first <= last {
        return 1.0;
    }
    ((first - b) / (first - last)).clamp(0.0, 1.0)
}

/// Charge below which the drone lands: the reserve, or less while an operator who stopped the landing may still decide.
fn limit(progress: &MissionProgress, s: &Situation) -> f64 {
    let kept = if progress.stopped { FOR_OPERATOR } else { 0.0 };
    (1.0 - kept) * s.battery_reserve
}

/// Whether the drone flies under the mission's control without an order, so that nothing else would land it.
pub(super) fn is_unordered(phase: MissionPhase, s: &Situation, c: &MissionConfig) -> bool {
    let ours = s.flight == ControlState::Ours && s.own.is_some() && !s.motors_stopped;
    let held = s.held_back().is_some();
    phase == MissionPhase::Idle && ours && !held && c.mode != LandingMode::Shadow
}

/// Transition to the landing place at a charge below the reserve. A descent in progress continues, because it is the
/// fastest way down. If the charge rises again, the previous state is restored.
pub(super) fn charge(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let lands = phase.state().phase() == Phase::Landing;
    if lands && progress.stopped {
        return None;
    }
    let Some(b) = s.battery.filter(|b| *b < limit(progress, s)) else {
        return above_again(phase, progress, s, c);
    };
    let gave_up_before = matches!(phase, MissionPhase::GaveUp { .. });
    let ended = gave_up_before || phase.waits_for_operator() || phase == MissionPhase::Idle;
    let wanted = progress.landing || lands || ended && !progress.deck_declined;
    let deck = match (wanted && c.lowest_plan_m().is_none(), progress.missing) {
        (false, _) => DeckAccess::Declined,
        (true, Some(_)) => DeckAccess::Awaited,
        (true, None) => DeckAccess::Open,
    };
    let chosen = if lands && deck != DeckAccess::Declined {
        Some((BatteryPlace::Deck, 0.0))
    } else {
        place(b, deck, progress, s, c)
    };
    let before = core::mem::replace(&mut progress.low_battery, chosen.map(|(place, _)| place));
    let changed = before != progress.low_battery;
    let low = |code| Reason::new(code, b, s.battery_reserve);
    let (to, why) = match chosen {
        Some((BatteryPlace::Deck, leaves_at)) => {
            if ended {
                (progress.landing, progress.stopped) = (true, false);
                (progress.attempts, progress.started) = (0, s.now);
            }
            let open = deck == DeckAccess::Open;
            let near = s.fresh_deck().is_some_and(|d| d.distance_m <= RESUME_DISTANCE_M);
            let next = match (open && near && !lands && s.waits(c).is_none(), ended) {
                (true, _) => MissionPhase::TRACKING,
                (false, true) => holding(HoldCause::Data, s, c),
                (false, false) => phase,
            };
            let why = if open || lands {
                low(ReasonCode::BatteryDeck)
            } else {
                Reason::new(ReasonCode::BatteryWaits, b, leaves_at)
            };
            return (changed || ended).then(|| next.enter(why));
        }
        Some((BatteryPlace::Home, needs)) => (gave_up(s, c), Reason::new(ReasonCode::BatteryHome, b, needs)),
        Some((BatteryPlace::Here, _)) => (gave_up(s, c), low(ReasonCode::BatteryHere)),
        None if ended => return None,
        None => (gave_up(s, c), low(ReasonCode::BatteryLow)),
    };
    (changed || !gave_up_before).then(|| to.enter(why))
}

/// Transition once the charge is sufficient again: a drone on its way to another place resumes.
fn above_again(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let left = matches!(
        progress.low_battery.take()?,
        BatteryPlace::Home | BatteryPlace::Here
    );
    let b = s.battery.unwrap_or_default();
    let cause = if progress.landing {
        HoldCause::Data
    } else {
        HoldCause::Operator
    };
    let why = Reason::new(ReasonCode::BatteryRecovered, b, s.battery_reserve);
    (left && matches!(phase, MissionPhase::GaveUp { .. })).then(|| holding(cause, s, c).enter(why))
}
