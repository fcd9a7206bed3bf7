//! Take-off from the deck: checks, countdown, arming, lift-off at the best time, and climb.
//!
//! The mission commands nothing before the end of the countdown. In [`MissionPhase::SpinUp`] the link selects the mode
//! and arms while the pilot node keeps the drone on the deck; in [`MissionPhase::TakeOff`] the pilot node jumps. If the
//! take-off is stopped before the feet have left the deck, the thrust is cut and the link disarms
//! ([`MissionPhase::StandDown`]). Afterwards only climbing is safe: an order to stop leads to the hold at the end of
//! every take-off.

use alight_shared::{
    landing::MAX_TILT_RAD,
    msg::{
        Course, DeckGrant, LandingMode, Reason,
        ReasonCode::{
            Arming, ArmingRejected, BatteryLow, BatteryUnknown, BetterMoment, ClearOfDeck, Commanded,
            CountedDown, Counting, DeckGrantStale, DeckReserved, Disarmed, DoesNotRise, GoodMoment, Leaving,
            MayFly, NoMoment, NoVessel, NotCleared, NotFlying, NotOnDeck, OdometryStale, OffHeight, Operator,
            OrderExpired, SpinningUp, StillArmed, TakeOffBattery, TakeOffCommanded, TakeOffOff, TakenOff,
            TipsOver, TooLong, VesselTurns,
        },
    },
    time::DroneClock,
    topics,
};

use super::{
    limits::{HEIGHT_TOLERANCE_M, ORDER_WAITS_S, exceeds},
    phase::{
        DroneTime, HoldCause, MissionPhase, MissionProgress, PhaseTransition, climbing_out, holding,
        moving_place, old_data,
    },
    situation::{ControlState, Situation},
    turnaround,
};
use crate::{
    lift_off::{LEAVES_WITHIN_S, LEFT_M, LIES_BELOW_M},
    mission_config::MissionConfig,
    standing::{StandingVerdict, WITNESSED_WITHIN_S},
};

/// Duration of the countdown shown to the crew, s.
const COUNTDOWN_S: f64 = 5.0;
/// Time within which the autopilot must arm, s: a second of set-points before PX4's OFFBOARD, three attempts a second
/// apart, and two heartbeats a second apart.
const ARMING_S: f64 = 10.0;
/// Time until a pending arming command shows an effect, s: its answer, and two heartbeats a second apart.
const ARMING_SHOWS_S: f64 = 3.0;
/// Time until turning rotors reach idle speed, s: speed controllers start within a second, which is not reported.
const IDLES_S: f64 = 1.5;
/// Maximum time on the deck with turning rotors, s: PX4 (COM_DISARM_PRFLT) and ArduCopter (DISARM_DELAY, at rest)
/// disarm after 10 s, and the heartbeat that reports the arming may be a second late.
const MOMENT_S: f64 = 8.5;
/// Rise below which a drone may tip over a foot, m: half of the feet's span times the sine of the angle.
const TIPS_BELOW_M: f64 = 0.1;
/// Clearance of a drone that is clear of the deck, with and without a detection, m.
const CLEAR_M: f64 = 3.0;
const CLEAR_BLIND_M: f64 = 6.0;
/// Time after which a drone that has left the deck climbs out, s.
const TAKE_OFF_S: f64 = 6.0;
/// Maximum duration of the climb-out before a hold, s: twice that of 20 m at 2 m/s and the path away from the vessel.
const CLIMB_OUT_S: f64 = 30.0;
/// Maximum distance between the forecast deck's centre and a drone on the deck, m: two receivers and half a deck.
const ON_DECK_M: f64 = 5.0;

/// Reason not to leave the deck, according to the vessel: no fresh grant, another owner, or no clearance.
pub(super) fn not_cleared(grant: Option<&DeckGrant<DroneClock>>, own: u32, now: DroneTime) -> Option<Reason> {
    let age_s = grant.map_or(f64::INFINITY, |g| (now - g.header.at).secs());
    let stale = exceeds(DeckGrantStale, age_s, topics::DECK.stale_after.secs());
    stale.or_else(|| {
        let g = grant?;
        if g.owner != own {
            return Some(Reason::new(DeckReserved, f64::from(g.owner), 0.0));
        }
        (!g.take_off).then(|| NotCleared.into())
    })
}

pub(super) fn commanded(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let rests = matches!(
        phase,
        MissionPhase::Idle | MissionPhase::Landed { disarmed: true, .. }
    );
    if !rests {
        return None;
    }
    if let Some(why) = s.held_back() {
        return Some(phase.enter(why));
    }
    if !c.takeoff || c.mode == LandingMode::Shadow {
        return Some(phase.enter(TakeOffOff));
    }
    if s.flight != ControlState::Disarmed {
        return Some(phase.enter(NotOnDeck));
    }
    *progress = MissionProgress {
        started: s.now,
        cycles: progress.cycles.begun(c),
        ..MissionProgress::default()
    };
    Some(MissionPhase::Preparing.enter(TakeOffCommanded))
}

/// Transition on an order to stop; None if the take-off continues to its hold or has already been stopped.
pub(super) fn stopped(
    phase: MissionPhase,
    s: &Situation,
    c: &MissionConfig,
    why: impl Into<Reason>,
) -> Option<PhaseTransition> {
    match phase {
        MissionPhase::Preparing | MissionPhase::Countdown { .. } => Some(stop(s, why)),
        MissionPhase::SpinUp { .. } => Some(cut(s, c, why)),
        MissionPhase::TakeOff { left, .. } => (stands(left, s)).then(|| down(s, why)),
        MissionPhase::ClimbOut { since, at, yaw, .. } => {
            let stopped = MissionPhase::ClimbOut {
                since,
                at,
                yaw,
                stopped: true,
            };
            Some(stopped.stay(why))
        }
        MissionPhase::StandDown { .. }
        | MissionPhase::Idle
        | MissionPhase::GetAltitude { .. }
        | MissionPhase::Approach { .. }
        | MissionPhase::Search(_)
        | MissionPhase::Seek
        | MissionPhase::Tracking { .. }
        | MissionPhase::TrackingStable
        | MissionPhase::Descent { .. }
        | MissionPhase::Flare { .. }
        | MissionPhase::Landed { .. }
        | MissionPhase::Hold { .. }
        | MissionPhase::GaveUp { .. } => None,
    }
}

/// Whether a rise measured without a gap shows that the feet are on the deck, so that the thrust may be cut.
fn stands(left: bool, s: &Situation) -> bool {
    !left && s.leaving.risen_m < LIES_BELOW_M && is_measured(s)
}
fn is_measured(s: &Situation) -> bool {
    s.leaving.rise_measured && old_data(s).is_none()
}

/// Transition on a set-point loss with a hold low above the deck: a climb once set-points are followed again.
pub(super) fn set_points_lost(
    phase: MissionPhase,
    s: &Situation,
    c: &MissionConfig,
) -> Option<PhaseTransition> {
    let leaves = matches!(phase, MissionPhase::TakeOff { .. });
    leaves.then(|| climbing_out(s, c).enter(NotFlying))
}

fn stop(s: &Situation, why: impl Into<Reason>) -> PhaseTransition {
    if s.flight == ControlState::Disarmed {
        MissionPhase::Idle.enter(why)
    } else {
        down(s, why)
    }
}
/// Ends a take-off after the motors may have started. The thrust is cut if the drone stands; otherwise it climbs,
/// because the autopilot may have lifted it after a set-point loss.
fn cut(s: &Situation, c: &MissionConfig, why: impl Into<Reason>) -> PhaseTransition {
    if is_armed(s)
        && s.leaving.standing != StandingVerdict::Stands
        && !(s.leaving.standing == StandingVerdict::Unknown && stands(false, s))
    {
        climbing_out(s, c).enter(why)
    } else {
        down(s, why)
    }
}
fn down(s: &Situation, why: impl Into<Reason>) -> PhaseTransition {
    let why = why.into();
    standing_down(s, why).enter(why)
}
fn is_armed(s: &Situation) -> bool {
    matches!(
        s.flight,
        ControlState::OnGround | ControlState::Ours | ControlState::SetPointsLost
    )
}
/// Stand-down with the thrust cut. While an arming command is pending, a disarmed drone's rotors may still start.
pub(super) fn standing_down(s: &Situation, why: Reason) -> MissionPhase {
    let unarmed = matches!(s.flight, ControlState::Disarmed | ControlState::Unknown);
    MissionPhase::StandDown {
        since: s.now,
        unarmed: unarmed.then_some(why),
    }
}

fn turns(s: &Situation) -> Option<Reason> {
    (s.course == Course::Turning).then(|| VesselTurns.into())
}

fn unfit(s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let first = s
        .not_cleared
        .or_else(|| old_data(s))
        .or(s.rejection)
        .or_else(|| turns(s));
    first.or_else(|| {
        let Some(deck) = s.fresh_deck() else {
            return Some(s.no_deck());
        };
        let silent = (deck.radio_age_s > c.radio_fresh_s).then(|| NoVessel.into());
        silent.or_else(|| deck.infeasible(c, 1.0))
    })
}

fn unprepared(s: &Situation, c: &MissionConfig) -> Option<Reason> {
    let grounded = (!s.on_ground).then(|| NotOnDeck.into());
    let away = || exceeds(NotOnDeck, s.deck?.distance_m, ON_DECK_M);
    let low = || {
        let Some(b) = s.battery else {
            return Some(BatteryUnknown.into());
        };
        (b < s.battery_for_take_off).then(|| Reason::new(TakeOffBattery, b, s.battery_for_take_off))
    };
    grounded.or_else(|| unfit(s, c)).or_else(away).or_else(low)
}

/// Transition if another authority has armed the drone.
fn taken_over(s: &Situation) -> Option<PhaseTransition> {
    match s.flight {
        ControlState::OnGround
        | ControlState::Ours
        | ControlState::OtherControl(_)
        | ControlState::SetPointsLost => Some(MissionPhase::Idle.enter(NotOnDeck)),
        ControlState::Disarmed | ControlState::Unknown => None,
    }
}

/// Waits until every check passes and the forecast has a suitable lift-off time.
pub(super) fn preparing(progress: &mut MissionProgress, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    if let Some(ended) = taken_over(s) {
        return ended;
    }
    let expired = || exceeds(OrderExpired, (s.now - progress.started).secs(), ORDER_WAITS_S);
    if let Some(why) = expired().filter(|_| !progress.cycles.on) {
        return MissionPhase::Idle.enter(why);
    }
    let unlikely = || match &s.leaving.lift_off {
        Some(moments) => moments.none_soon(c),
        None => Some(s.no_deck()),
    };
    match unprepared(s, c).or_else(unlikely) {
        Some(why) if progress.cycles.on => turnaround::unprepared(progress, s, why),
        Some(why) => MissionPhase::Preparing.stay(why),
        None => MissionPhase::Countdown { since: s.now }.enter(Reason::new(Counting, COUNTDOWN_S, 0.0)),
    }
}

/// Counts down; any reason against the take-off resets the countdown.
pub(super) fn countdown(since: DroneTime, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    if let Some(ended) = taken_over(s) {
        return ended;
    }
    if let Some(why) = unprepared(s, c) {
        return MissionPhase::Preparing.enter(why);
    }
    let left_s = COUNTDOWN_S - (s.now - since).secs();
    if left_s > 0.0 {
        return MissionPhase::Countdown { since }.stay(Reason::new(Counting, left_s, 0.0));
    }
    MissionPhase::SpinUp {
        since: s.now,
        armed: None,
    }
    .enter(CountedDown)
}

/// Waits with motors started for arming, for turning rotors, and for the lift-off time.
pub(super) fn spin_up(
    since: DroneTime,
    armed: Option<DroneTime>,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let stays = |armed, why| MissionPhase::SpinUp { since, armed }.stay(why);
    let armed = match (s.flight, armed) {
        (ControlState::Disarmed, Some(_)) => return MissionPhase::Idle.enter(Disarmed),
        (ControlState::OtherControl(_), _) => return MissionPhase::Idle.enter(NotFlying),
        (ControlState::SetPointsLost, _) => return cut(s, c, NotFlying),
        (ControlState::Disarmed | ControlState::Unknown, armed) => armed,
        (ControlState::OnGround | ControlState::Ours, armed) => armed.or(Some(s.now)),
    };
    if let Some(why) = unfit(s, c) {
        return cut(s, c, why);
    }
    if armed.is_some() && s.leaving.standing == StandingVerdict::Flies {
        return climbing_out(s, c).enter(MayFly);
    }
    let Some(at) = armed else {
        let waited_s = (s.now - since).secs();
        return match exceeds(ArmingRejected, waited_s, ARMING_S) {
            Some(why) => cut(s, c, why),
            None => stays(None, Reason::new(Arming, waited_s, ARMING_S)),
        };
    };
    let turn_s = s.leaving.rotors_turn_s;
    if turn_s < IDLES_S || s.motors_stopped {
        let why = Reason::new(SpinningUp, turn_s, IDLES_S);
        return if (s.now - at).secs() > MOMENT_S {
            cut(s, c, why)
        } else {
            stays(armed, why)
        };
    }
    let Some(moments) = &s.leaving.lift_off else {
        return cut(s, c, s.no_deck());
    };
    match moments.not_now(c) {
        None => rising(s).enter(Reason::new(GoodMoment, moments.now.whole(), 0.0)),
        Some(why) if turn_s > MOMENT_S && why.code == BetterMoment => {
            rising(s).enter(Reason::new(GoodMoment, moments.now.whole(), 0.0))
        }
        Some(_) if turn_s > MOMENT_S => cut(s, c, Reason::new(NoMoment, turn_s, MOMENT_S)),
        Some(why) => stays(armed, why),
    }
}

fn rising(s: &Situation) -> MissionPhase {
    MissionPhase::TakeOff {
        since: s.now,
        left: false,
    }
}

/// Lifts off and climbs clear. The thrust may be cut while a rise without a gap shows that the feet are on the deck.
pub(super) fn take_off(since: DroneTime, left: bool, s: &Situation, c: &MissionConfig) -> PhaseTransition {
    let (rose, lasted_s) = (s.leaving.risen_m, (s.now - since).secs());
    let left = left || rose >= LEFT_M;
    let leaving = MissionPhase::TakeOff { since, left }.stay(Reason::new(Leaving, rose, 0.0));
    if !left {
        let tips = exceeds(TipsOver, s.leaving.tips_rad, MAX_TILT_RAD).filter(|_| rose < TIPS_BELOW_M);
        let lost = (s.reservation.lost()).filter(|_| stands(left, s));
        // Time without sufficient thrust is no evidence that the feet stick.
        let lifts_s = s.leaving.lifts_s.unwrap_or(lasted_s);
        let stuck = lifts_s > LEAVES_WITHIN_S || lasted_s > TAKE_OFF_S;
        let stuck = stuck.then_some(Reason::new(DoesNotRise, rose, LEFT_M));
        return match tips.or(lost).or(stuck) {
            Some(why) if is_measured(s) => down(s, why),
            // The drone may be in the air.
            Some(_) => climbing_out(s, c).enter(old_data(s).unwrap_or(OdometryStale.into())),
            None => leaving,
        };
    }
    let in_sight = s.fresh_deck().is_some_and(|d| d.vision_age_s <= c.vision_fresh_s);
    if in_sight && rose > CLEAR_M || rose > CLEAR_BLIND_M {
        return climbing_out(s, c).enter(Reason::new(ClearOfDeck, rose, 0.0));
    }
    if lasted_s > TAKE_OFF_S {
        return climbing_out(s, c).enter(Reason::new(TooLong, lasted_s, TAKE_OFF_S));
    }
    leaving
}

/// Climbs away from the vessel to the approach height, where the drone holds for the next pilot or program. Clear of
/// the vessel, an order, a low battery or stale data end this state early; its maximum duration ends it anywhere. The
/// hold then completes the climb and responds to each of them.
pub(super) fn climb_out(
    phase: MissionPhase,
    progress: &mut MissionProgress,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let MissionPhase::ClimbOut {
        since,
        at,
        yaw,
        stopped,
    } = phase
    else {
        return phase.stay(Reason::default());
    };
    let set_points_lost = s.flight == ControlState::SetPointsLost;
    let since = if set_points_lost { s.now } else { since };
    let (moves, at) = moving_place(&at, s, true);
    let error = s.own.map_or(f64::INFINITY, |own| (own.position.z - at.z).abs());
    let low = || {
        let b = s.battery.filter(|b| *b < s.battery_reserve)?;
        Some(Reason::new(BatteryLow, b, s.battery_reserve))
    };
    let ordered = || stopped.then(|| Operator.into());
    let lands = || progress.landing.then(|| Commanded.into());
    let sooner = || ordered().or_else(lands).or_else(low).or_else(|| old_data(s));
    let ends = if moves {
        None
    } else if error <= HEIGHT_TOLERANCE_M {
        Some(TakenOff.into())
    } else {
        sooner()
    };
    let ends = ends.or_else(|| exceeds(TooLong, (s.now - since).secs(), CLIMB_OUT_S));
    match ends.filter(|_| !set_points_lost) {
        Some(why) => {
            if !progress.landing {
                progress.started = s.now;
            }
            holding(HoldCause::Operator, s, c).enter(why)
        }
        None => MissionPhase::ClimbOut {
            since,
            at,
            yaw,
            stopped,
        }
        .stay(if set_points_lost {
            NotFlying.into()
        } else {
            Reason::new(OffHeight, error, HEIGHT_TOLERANCE_M)
        }),
    }
}

/// Stands down until the drone is disarmed or was never armed. From the autopilot's hold after a set-point loss it
/// returns to this state's set-points. A drone that is not shown to stand may be flying, so it climbs.
pub(super) fn stand_down(
    since: DroneTime,
    unarmed: Option<Reason>,
    s: &Situation,
    c: &MissionConfig,
) -> PhaseTransition {
    let lasted_s = (s.now - since).secs();
    let stays = |unarmed, why| MissionPhase::StandDown { since, unarmed }.stay(why);
    let unwitnessed =
        s.leaving.standing == StandingVerdict::Flies || s.leaving.unwitnessed_s > WITNESSED_WITHIN_S;
    match (s.flight, unarmed) {
        (ControlState::Disarmed, None) => MissionPhase::Idle.enter(Disarmed),
        (ControlState::Disarmed, Some(why)) if lasted_s > ARMING_SHOWS_S => MissionPhase::Idle.enter(why),
        (ControlState::OtherControl(_), _) => MissionPhase::Idle.enter(NotFlying),
        (ControlState::Disarmed, Some(_)) => stays(unarmed, Reason::new(Arming, lasted_s, ARMING_SHOWS_S)),
        (ControlState::Unknown, _) => stays(unarmed, Reason::new(StillArmed, lasted_s, 0.0)),
        (ControlState::OnGround | ControlState::Ours | ControlState::SetPointsLost, _)
            if unwitnessed && s.odometry_age_s <= s.odometry_limit_s =>
        {
            climbing_out(s, c).enter(MayFly)
        }
        (ControlState::OnGround | ControlState::Ours | ControlState::SetPointsLost, _) => {
            stays(None, Reason::new(StillArmed, lasted_s, 0.0))
        }
    }
}
