//! Turnaround of unattended cycles ([`super::cycles`]), and handover to the autopilot's mission in the air.

use alight_shared::msg::{
    Reason,
    ReasonCode::{
        self, BatteryUnknown, ForecastStale, HandOverRejected, HandsOver, Infeasible, NoVessel, NotReady,
        SortieBegins, SortiesDone, TakeOffBattery, TakeOffHit, TakeOffTilted, TooSteep, VesselTurns,
    },
};

use super::{
    limits::ORDER_WAITS_S,
    phase::{HoldCause, MissionPhase, MissionProgress, PhaseTransition, holding, lasting},
    situation::{ControlState, Situation},
};
use crate::mission_config::MissionConfig;

/// Time for which the charge must be sufficient for the drone to be ready, s: a gauge recovers after a flight.
const CHARGED_S: f64 = 30.0;
/// Time for the autopilot to start its own mission, s: three commands a second apart, and their answers.
const HAND_OVER_S: f64 = 8.0;

/// Keeps a drone disarmed on the deck, in `phase`, until it is ready and cleared.
pub(super) fn stands(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let cycles = &mut progress.cycles;
    let (begun, most) = (f64::from(cycles.sorties), f64::from(c.sorties_max));
    if cycles.sorties >= c.sorties_max {
        let why = Reason::new(SortiesDone, begun, most);
        cycles.end(why);
        return phase.stay(why);
    }
    let (charged, lasted_s) = lasting(
        s.battery.is_some_and(|b| b >= c.battery_ready),
        cycles.charged,
        s.now,
    );
    cycles.charged = charged;
    let is_charged = charged.is_some() && lasted_s >= CHARGED_S;
    // A drone in the air needs the deck more than this one needs the rest of its charge.
    let gives_way = s.deck_wanted && s.battery.is_some_and(|b| b >= s.battery_for_take_off);
    if !(cycles.ready || is_charged || gives_way) {
        let unknown = BatteryUnknown.into();
        let why = (s.battery).map_or(unknown, |b| Reason::new(NotReady, b, c.battery_ready));
        return phase.stay(why);
    }
    if let Some(why) = s.not_cleared {
        return phase.stay(why);
    }
    let cycles = *cycles;
    *progress = MissionProgress {
        started: s.now,
        cycles,
        ..MissionProgress::default()
    };
    MissionPhase::Preparing.enter(Reason::new(SortieBegins, begun + 1.0, most))
}

/// Whether a reason passes without action by the crew, as do those due to sea, course or radio.
const fn passes(why: ReasonCode) -> bool {
    matches!(
        why,
        TakeOffTilted
            | TakeOffHit
            | Infeasible
            | TooSteep
            | VesselTurns
            | NoVessel
            | ForecastStale
            | TakeOffBattery
            | BatteryUnknown
    )
}

/// Transition of a drone on the deck that has no clearance or is unfit for a sortie, for the reason `why`. The mission
/// waits if the reason passes by itself.
pub(super) fn unprepared(progress: &mut MissionProgress, s: &Situation, why: Reason) -> PhaseTransition {
    if s.not_cleared.is_some() {
        return MissionPhase::STANDS.enter(why);
    }
    if passes(why.code) {
        progress.started = s.now;
    }
    let waited_s = (s.now - progress.started).secs();
    if waited_s > ORDER_WAITS_S {
        return MissionPhase::Idle.enter(why);
    }
    MissionPhase::Preparing.stay(why)
}

/// In the hold after the climb-out, since `progress.started`: hands over to the autopilot's own mission, or returns to
/// the deck if that does not start.
pub(super) fn hands_over(
    hold: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    if !progress.cycles.on {
        return None;
    }
    let lasted_s = (s.now - progress.started).secs();
    if lasted_s <= HAND_OVER_S || s.flight != ControlState::Ours {
        return Some(hold.stay(Reason::new(HandsOver, lasted_s, HAND_OVER_S)));
    }
    let why = Reason::new(HandOverRejected, lasted_s, HAND_OVER_S);
    progress.cycles.end(why);
    (progress.landing, progress.started, progress.attempts) = (true, s.now, 0);
    Some(holding(HoldCause::Data, s, c).enter(why))
}
