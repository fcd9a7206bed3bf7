use alight_shared::msg::{
    AutopilotMode, CommandKind, Course, DeckGrant, LandingMode,
    ReasonCode::{
        Arming, ArmingRejected, BatteryLow, BatteryUnknown, ClearOfDeck, CountedDown, Counting,
        DeckGrantStale, DeckReserved, Disarmed, DoesNotRise, ForecastStale, GoodMoment, MayFly, NoMoment,
        NotCleared, NotOnDeck, Operator, OrderExpired, SpinningUp, StillArmed, SwitchAborts, TakeOffBattery,
        TakeOffCommanded, TakeOffOff, TakeOffTilted, TakenOff, TipsOver, VesselTurns,
    },
};
use nalgebra::Vector3;

use super::{
    lift_off::{LiftOff, Moments},
    reservation::Reservation,
    tests::{at, config, fair, with},
    *,
};
use crate::standing::StandingVerdict;

const SURE: LiftOff = LiftOff {
    along: 1.0,
    clear: 1.0,
};
const STEEP: LiftOff = LiftOff { along: 0.4, ..SURE };

pub(super) fn permits() -> MissionConfig {
    MissionConfig {
        takeoff: true,
        ..config()
    }
}
fn moments(now: LiftOff) -> Option<Moments> {
    Some(Moments { now, later: None })
}
pub(super) fn standing(change: impl FnOnce(&mut Situation)) -> Situation {
    let mut s = with(|s| {
        s.flight = ControlState::Disarmed;
        s.on_ground = true;
        s.leaving.lift_off = moments(SURE);
        s.deck.iter_mut().for_each(|d| {
            (d.clearance_m, d.vision_age_s) = (1.4, f64::INFINITY);
        });
    });
    change(&mut s);
    s
}
/// Drone that stands by two witnesses, with rotors that have been reported turning for `turn_s` (s).
fn spun(turn_s: f64, change: impl FnOnce(&mut Situation)) -> (MissionPhase, Situation) {
    let phase = MissionPhase::SpinUp {
        since: at(10.0 - turn_s),
        armed: Some(at(10.0 - turn_s)),
    };
    let situation = standing(|s| {
        s.flight = ControlState::OnGround;
        (s.leaving.rotors_turn_s, s.leaving.standing) = (turn_s, StandingVerdict::Stands);
        change(s);
    });
    (phase, situation)
}
fn decided(phase: MissionPhase, command: Option<CommandKind>, s: &Situation) -> Decision {
    let progress = MissionProgress {
        started: at(9.0),
        ..MissionProgress::default()
    };
    decide(phase, progress, command, s, &permits())
}
fn follows(phase: MissionPhase, command: Option<CommandKind>, s: &Situation) -> (State, ReasonCode) {
    let d = decided(phase, command, s);
    (d.phase.state(), d.entered.unwrap_or(d.waiting).code)
}

#[test]
fn order_to_take_off() {
    let order = Some(CommandKind::TakeOff);
    for phase in [MissionPhase::Idle, MissionPhase::STANDS] {
        let s = standing(|_| {});
        assert_eq!(follows(phase, order, &s), (State::Preparing, TakeOffCommanded));
        for c in [
            config(),
            MissionConfig {
                mode: LandingMode::Shadow,
                ..permits()
            },
        ] {
            let d = decide(phase, MissionProgress::default(), order, &s, &c);
            assert_eq!((d.phase, d.entered), (phase, Some(TakeOffOff.into())));
        }
    }
    assert_eq!(
        follows(MissionPhase::Idle, order, &fair()),
        (State::Idle, NotOnDeck)
    );
    let held = standing(|s| s.rejection = Some(SwitchAborts.into()));
    for kind in [CommandKind::TakeOff, CommandKind::Land] {
        let d = decided(MissionPhase::Idle, Some(kind), &held);
        assert_eq!(
            (d.phase, d.entered),
            (MissionPhase::Idle, Some(SwitchAborts.into()))
        );
        assert!(!d.progress.landing);
    }
    let d = decided(MissionPhase::TRACKING, order, &fair());
    assert_eq!(d.phase.state(), State::Tracking);
}

#[test]
fn checks_before_the_countdown() {
    let preparing = MissionPhase::Preparing;
    let waits = |change: fn(&mut Situation)| follows(preparing, None, &standing(change));
    assert_eq!(waits(|_| {}), (State::Countdown, Counting));
    type Change = fn(&mut Situation);
    let gaps: [(ReasonCode, Change); 9] = [
        (NotCleared, |s| s.not_cleared = Some(NotCleared.into())),
        (NotOnDeck, |s| s.on_ground = false),
        (NotOnDeck, |s| s.deck.iter_mut().for_each(|d| d.distance_m = 5.1)),
        (ForecastStale, |s| s.forecast_age_s = 0.4),
        (TakeOffBattery, |s| s.battery = Some(0.29)),
        (BatteryUnknown, |s| s.battery = None),
        (VesselTurns, |s| s.course = Course::Turning),
        (TakeOffTilted, |s| s.leaving.lift_off = moments(STEEP)),
        (ReasonCode::HeadingUnaligned, |s| {
            s.rejection = Some(ReasonCode::HeadingUnaligned.into());
        }),
    ];
    for (why, change) in gaps {
        assert_eq!(waits(change), (State::Preparing, why));
        let counting = MissionPhase::Countdown { since: at(8.0) };
        let s = standing(change);
        let stays = why == TakeOffTilted;
        let expected = if stays {
            (State::Countdown, Counting)
        } else {
            (State::Preparing, why)
        };
        assert_eq!(follows(counting, None, &s), expected);
    }
    // The wait is bounded, and arming by a pilot is not followed by a take-off.
    assert_eq!(waits(|s| s.now = at(69.1)), (State::Idle, OrderExpired));
    assert_eq!(waits(|s| s.flight = ControlState::Ours), (State::Idle, NotOnDeck));
}

#[test]
fn clearance_by_the_grant() {
    let grant = |owner, take_off| DeckGrant {
        header: Header::new(1, 0, 1, 1, at(10.0)),
        owner,
        take_off,
        ..DeckGrant::default()
    };
    let code = |g: Option<&DeckGrant<DroneClock>>, s| take_off::not_cleared(g, 3, at(s)).map(|r| r.code);
    assert_eq!(code(Some(&grant(3, true)), 10.5), None);
    assert_eq!(code(Some(&grant(3, true)), 12.5), Some(DeckGrantStale));
    assert_eq!(code(Some(&grant(3, false)), 10.5), Some(NotCleared));
    assert_eq!(code(Some(&grant(2, true)), 10.5), Some(DeckReserved));
    assert_eq!(code(None, 10.5), Some(DeckGrantStale));
}

#[test]
fn countdown_and_arming() {
    let counting = |s| MissionPhase::Countdown { since: at(10.0 - s) };
    let s = standing(|_| {});
    assert_eq!(follows(counting(4.9), None, &s), (State::Countdown, Counting));
    assert_eq!(follows(counting(5.0), None, &s), (State::SpinUp, CountedDown));
    let spins = |s: f64| MissionPhase::SpinUp {
        since: at(10.0 - s),
        armed: None,
    };
    assert_eq!(follows(spins(9.9), None, &s), (State::SpinUp, Arming));
    assert_eq!(follows(spins(10.1), None, &s), (State::StandDown, ArmingRejected));
    // Alight armed the drone, and another authority disarmed it or chose another mode.
    let (phase, s) = spun(1.0, |s| s.flight = ControlState::Disarmed);
    assert_eq!(follows(phase, None, &s), (State::Idle, Disarmed));
    let (phase, s) = spun(1.0, |s| {
        s.flight = ControlState::OtherControl(AutopilotMode::Other)
    });
    assert_eq!(decided(phase, None, &s).phase, MissionPhase::Idle);
}

#[test]
fn moment_of_the_take_off() {
    let at_moment = |s: f64, change: fn(&mut Situation)| {
        let (phase, s) = spun(s, change);
        follows(phase, None, &s)
    };
    assert_eq!(at_moment(1.4, |_| {}), (State::SpinUp, SpinningUp));
    assert_eq!(at_moment(1.6, |_| {}), (State::TakeOff, GoodMoment));
    // The mission waits while the autopilot is armed but the motors do not turn.
    let still: fn(&mut Situation) = |s| s.leaving.rotors_turn_s = 0.0;
    for (armed_s, expected) in [
        (1.6, State::SpinUp),
        (8.4, State::SpinUp),
        (8.6, State::StandDown),
    ] {
        assert_eq!(at_moment(armed_s, still), (expected, SpinningUp));
    }
    assert_eq!(
        at_moment(1.6, |s| s.motors_stopped = true),
        (State::SpinUp, SpinningUp)
    );
    let steep: fn(&mut Situation) = |s| s.leaving.lift_off = moments(STEEP);
    assert_eq!(at_moment(1.6, steep), (State::SpinUp, TakeOffTilted));
    assert_eq!(at_moment(8.6, steep), (State::StandDown, NoMoment));
    assert_eq!(
        at_moment(8.6, |s| s.motors_stopped = true),
        (State::StandDown, SpinningUp)
    );
    let better: fn(&mut Situation) = |s| {
        s.leaving.lift_off = Some(Moments {
            now: LiftOff { along: 0.96, ..SURE },
            later: Some((1.0, SURE)),
        });
    };
    assert_eq!(at_moment(1.6, better), (State::SpinUp, ReasonCode::BetterMoment));
    assert_eq!(at_moment(8.6, better), (State::TakeOff, GoodMoment));
    let closed: fn(&mut Situation) = |s| s.not_cleared = Some(DeckReserved.into());
    assert_eq!(at_moment(3.0, closed), (State::StandDown, DeckReserved));
}

fn rising(since_s: f64, left: bool) -> MissionPhase {
    MissionPhase::TakeOff {
        since: at(10.0 - since_s),
        left,
    }
}
/// Climb to 15 m over the deck.
fn climbing(since_s: f64, stopped: bool) -> MissionPhase {
    MissionPhase::ClimbOut {
        since: at(10.0 - since_s),
        at: Vector3::new(0.0, 0.0, -16.3),
        yaw: 0.0,
        stopped,
    }
}

/// The thrust is cut neither after an unmeasured rise nor while a drone descends to the deck again.
#[test]
fn thrust_of_a_drone_that_may_be_in_the_air() {
    let s = with(|s| (s.leaving.risen_m, s.leaving.tips_rad) = (0.05, 0.3));
    assert_eq!(
        follows(rising(0.3, false), None, &s),
        (State::StandDown, TipsOver)
    );
    assert_eq!(follows(rising(0.3, true), None, &s).0, State::TakeOff);
    type Change = fn(&mut Situation);
    let gaps: [Change; 3] = [
        |s| s.leaving.rise_measured = false,
        |s| s.odometry_age_s = 0.5,
        |s| s.forecast_age_s = 0.5,
    ];
    for gap in gaps {
        let mut s = s;
        gap(&mut s);
        assert_eq!(follows(rising(0.3, false), None, &s).0, State::ClimbOut);
        s.leaving.tips_rad = 0.0;
        assert_eq!(follows(rising(0.3, false), None, &s).0, State::TakeOff);
        assert_eq!(follows(rising(1.1, false), None, &s).0, State::ClimbOut);
    }
    let d = decided(rising(0.5, false), None, &with(|s| s.leaving.risen_m = 0.4));
    assert!(matches!(d.phase, MissionPhase::TakeOff { left: true, .. }) && d.progress.sortie);
}

/// Low above the deck only climbing is safe, under any control authority.
#[test]
fn set_points_that_cease_in_a_take_off() {
    let holds = with(|s| (s.flight, s.leaving.risen_m) = (ControlState::SetPointsLost, 0.5));
    for phase in [rising(0.8, true), climbing(2.0, false), climbing(60.0, true)] {
        let d = decided(phase, None, &holds);
        assert_eq!(d.phase.state(), State::ClimbOut, "{phase:?}");
        let MissionPhase::ClimbOut { since, .. } = d.phase else {
            panic!("{:?}", d.phase)
        };
        assert_eq!(since, holds.now);
    }
    let other = with(|s| s.flight = ControlState::OtherControl(AutopilotMode::Other));
    let d = decided(climbing(2.0, false), None, &other);
    assert_eq!(d.phase, MissionPhase::Idle);
}

/// The thrust is cut only if two witnesses show that the drone stands.
#[test]
fn set_points_that_cease_while_it_stands() {
    let cut = |change: fn(&mut Situation)| {
        let (phase, mut s) = spun(2.0, |s| s.flight = ControlState::SetPointsLost);
        change(&mut s);
        follows(phase, None, &s)
    };
    assert_eq!(cut(|_| {}), (State::StandDown, ReasonCode::NotFlying));
    assert_eq!(
        cut(|s| s.leaving.standing = StandingVerdict::Flies),
        (State::ClimbOut, ReasonCode::NotFlying)
    );
    assert_eq!(
        cut(|s| (s.leaving.standing, s.leaving.rise_measured) = (StandingVerdict::Unknown, false)),
        (State::ClimbOut, ReasonCode::NotFlying)
    );
    let down = |change: fn(&mut Situation)| {
        let (_, mut s) = spun(2.0, |_| {});
        change(&mut s);
        let phase = MissionPhase::StandDown {
            since: at(9.0),
            unarmed: None,
        };
        follows(phase, None, &s)
    };
    assert_eq!(down(|_| {}), (State::StandDown, StillArmed));
    let brief = down(|s| s.leaving.unwitnessed_s = 0.6);
    assert_eq!(brief, (State::StandDown, StillArmed));
    for change in [
        (|s: &mut Situation| s.leaving.unwitnessed_s = 0.8) as fn(&mut Situation),
        |s| s.leaving.standing = StandingVerdict::Flies,
        |s| (s.leaving.standing, s.flight) = (StandingVerdict::Flies, ControlState::SetPointsLost),
    ] {
        assert_eq!(down(change), (State::ClimbOut, MayFly));
    }
}

/// Above the deck the climb continues; clear of it an order, a low battery or stale data end it.
#[test]
fn climb_that_ends_sooner() {
    let over = with(|_| {});
    let clear = with(|s| s.deck.iter_mut().for_each(|d| d.distance_m = 60.0));
    let abort = Some(CommandKind::Abort);
    let stopped = decided(climbing(2.0, false), abort, &over).phase;
    assert_eq!(stopped, climbing(2.0, true));
    assert_eq!(follows(stopped, None, &over).0, State::ClimbOut);
    assert_eq!(follows(stopped, None, &clear), (State::Hold, Operator));
    assert_eq!(follows(climbing(2.0, false), None, &clear).0, State::ClimbOut);
    let low = |mut s: Situation| {
        s.battery = Some(0.1);
        follows(climbing(2.0, false), None, &s)
    };
    assert_eq!(
        (low(over).0, low(clear)),
        (State::ClimbOut, (State::Hold, BatteryLow))
    );
    let mut old = clear;
    old.forecast_age_s = 0.5;
    assert_eq!(
        follows(climbing(2.0, false), None, &old),
        (State::Hold, ForecastStale)
    );
    assert_eq!(
        follows(climbing(30.1, false), None, &over),
        (State::Hold, ReasonCode::TooLong)
    );
    // Clear of the vessel an order to land applies.
    let d = decided(climbing(2.0, false), Some(CommandKind::Land), &clear);
    assert!(
        d.progress.landing && d.phase.state() == State::Hold,
        "{:?}",
        d.phase
    );
}

#[test]
fn feet_that_leave_the_deck_or_do_not() {
    let leaves = |since_s: f64, risen_m: f64, tips_rad: f64, in_sight: bool| {
        let s = with(|s| {
            (s.leaving.risen_m, s.leaving.tips_rad, s.on_ground) = (risen_m, tips_rad, false);
            s.deck.iter_mut().for_each(|d| {
                d.vision_age_s = if in_sight { 0.05 } else { f64::INFINITY };
            });
        });
        follows(rising(since_s, false), None, &s)
    };
    assert_eq!(leaves(0.5, 0.1, 0.05, false).0, State::TakeOff);
    assert_eq!(leaves(0.3, 0.05, 0.18, false), (State::StandDown, TipsOver));
    assert_eq!(leaves(0.3, 0.15, 0.18, false).0, State::TakeOff, "it levels");
    assert_eq!(leaves(1.1, 0.1, 0.05, false), (State::StandDown, DoesNotRise));
    // The mission waits for sufficient thrust; then the drone must rise.
    let lifted = |since_s: f64, lifts_s: f64| {
        let s = with(|s| (s.leaving.risen_m, s.leaving.lifts_s, s.on_ground) = (0.02, Some(lifts_s), false));
        follows(rising(since_s, false), None, &s)
    };
    assert_eq!(lifted(3.0, 0.0).0, State::TakeOff);
    assert_eq!(lifted(3.0, 1.1), (State::StandDown, DoesNotRise));
    assert_eq!(lifted(6.1, 0.0), (State::StandDown, DoesNotRise));
    assert_eq!(leaves(0.9, 0.4, 0.3, false).0, State::TakeOff);
    assert_eq!(leaves(1.5, 3.1, 0.0, true), (State::ClimbOut, ClearOfDeck));
    assert_eq!(leaves(1.5, 3.1, 0.0, false).0, State::TakeOff);
    assert_eq!(leaves(2.5, 6.1, 0.0, false), (State::ClimbOut, ClearOfDeck));
    assert_eq!(
        leaves(6.1, 2.0, 0.0, false),
        (State::ClimbOut, ReasonCode::TooLong)
    );
}

#[test]
fn take_off_stopped_by_an_operator() {
    for command in [CommandKind::Abort, CommandKind::Hold] {
        let on_deck = standing(|_| {});
        for phase in [
            MissionPhase::Preparing,
            MissionPhase::Countdown { since: at(9.0) },
        ] {
            let d = decided(phase, Some(command), &on_deck);
            assert_eq!(
                (d.phase, d.entered.map(|r| r.code)),
                (MissionPhase::Idle, Some(Operator))
            );
        }
        // The drone is armed, or an arming command may be pending.
        let (armed, s) = spun(2.0, |_| {});
        let since = at(8.0);
        let waits = MissionPhase::SpinUp { since, armed: None };
        for (phase, s) in [(armed, s), (waits, on_deck)] {
            assert_eq!(follows(phase, Some(command), &s), (State::StandDown, Operator));
        }
        // On the deck the take-off is stopped by an order, or when the deck is closed.
        let s = with(|s| s.leaving.risen_m = 0.1);
        assert_eq!(
            follows(rising(0.2, false), Some(command), &s),
            (State::StandDown, Operator)
        );
        // The feet may have left the deck, so the take-off continues to its hold, and the sortie ends as usual.
        let s = with(|s| s.leaving.risen_m = 0.2);
        let d = decided(rising(0.4, false), Some(command), &s);
        assert_eq!((d.phase, d.progress.stopped), (rising(0.4, false), false));
    }
    let closed = |risen_m: f64| {
        let s = with(|s| {
            s.reservation = Reservation::Others(alight_shared::msg::DECK_CLOSED);
            s.leaving.risen_m = risen_m;
        });
        follows(rising(0.2, false), None, &s)
    };
    assert_eq!(closed(0.1), (State::StandDown, DeckReserved));
    assert_eq!(closed(0.2).0, State::TakeOff);
}

#[test]
fn end_of_a_take_off() {
    let stands = |since_s, unarmed| MissionPhase::StandDown {
        since: at(since_s),
        unarmed,
    };
    // Set-points are restored for a drone that stands.
    for flight in [ControlState::OnGround, ControlState::SetPointsLost] {
        let armed = standing(|s| s.flight = flight);
        let d = decided(stands(9.0, Some(Operator.into())), None, &armed);
        assert_eq!((d.phase, d.waiting.code), (stands(9.0, None), StillArmed));
    }
    let disarmed = standing(|_| {});
    assert_eq!(
        follows(stands(9.0, None), None, &disarmed),
        (State::Idle, Disarmed)
    );
    let stopped = |since_s| follows(stands(since_s, Some(Operator.into())), None, &disarmed);
    assert_eq!(stopped(7.1), (State::StandDown, Arming));
    assert_eq!(stopped(6.9), (State::Idle, Operator));
    let (spins, set_points_lost) = spun(2.0, |s| s.flight = ControlState::SetPointsLost);
    assert_eq!(
        follows(spins, None, &set_points_lost),
        (State::StandDown, ReasonCode::NotFlying)
    );
    // A low battery does not end a climb that has just begun.
    let climbs = climbing(2.0, false);
    let low = with(|s| s.battery = Some(0.1));
    let (state, why) = follows(climbs, None, &low);
    assert!(state == State::ClimbOut && why != BatteryLow);
    let high = with(|s| s.own.iter_mut().for_each(|own| own.position.z = -16.0));
    assert_eq!(follows(climbs, None, &high), (State::Hold, TakenOff));
}

#[test]
fn successor_of_a_mission_that_takes_off() {
    let restored_in = |state: State, sortie: bool, s: &Situation| {
        let header = Header::new(1, 1, 1, 1, at(9.9));
        let m = MissionCheckpoint {
            header,
            state: MissionState {
                header,
                state,
                ..MissionState::default()
            },
            sortie,
            ..MissionCheckpoint::default()
        };
        let (phase, _) = checkpoint::restored(&m, true, s, &permits());
        (phase.state(), phase.waits_for_operator())
    };
    for (state, sortie, expected) in [
        (State::Preparing, false, (State::Idle, false)),
        (State::Countdown, false, (State::Idle, false)),
        (State::SpinUp, false, (State::StandDown, false)),
        (State::StandDown, false, (State::StandDown, false)),
        (State::TakeOff, false, (State::ClimbOut, false)),
        (State::ClimbOut, false, (State::ClimbOut, false)),
        (State::Hold, true, (State::Hold, true)),
        (State::Hold, false, (State::Hold, false)),
    ] {
        assert_eq!(restored_in(state, sortie, &fair()), expected, "{state:?}");
    }
    // The autopilot or the camera shows that the drone is on the deck, unless it rises; receivers alone do
    // not.
    let low = |vision_age_s: f64, on_ground: bool, sinking_mps: f64| {
        with(|s| {
            s.on_ground = on_ground;
            s.deck.iter_mut().for_each(|d| {
                (d.clearance_m, d.vision_age_s, d.sinking_mps) = (0.1, vision_age_s, sinking_mps);
            });
        })
    };
    let on_deck = |vision_age_s, on_ground, sinking_mps| {
        let s = low(vision_age_s, on_ground, sinking_mps);
        restored_in(State::TakeOff, false, &s).0
    };
    assert_eq!(on_deck(0.05, false, 0.0), State::StandDown);
    assert_eq!(on_deck(f64::INFINITY, true, 0.0), State::StandDown);
    assert_eq!(on_deck(f64::INFINITY, false, 0.0), State::ClimbOut);
    assert_eq!(on_deck(0.05, true, -2.0), State::ClimbOut);
    // Without a deck the autopilot's report may be old; after lift-off it is wrong.
    let mut s = low(0.05, true, 0.0);
    assert_eq!(restored_in(State::TakeOff, true, &s).0, State::ClimbOut);
    s.deck = None;
    assert_eq!(restored_in(State::TakeOff, false, &s).0, State::ClimbOut);
}

/// A low battery ends the sortie at once from the hold, otherwise by an order that waits for the drone.
#[test]
fn end_of_a_sortie_by_the_battery() {
    let due = Reason::new(ReasonCode::TurnsBack, 0.3, 0.31);
    let sortie = |stopped| MissionProgress {
        sortie: true,
        stopped,
        ..MissionProgress::default()
    };
    let hold = MissionPhase::Hold {
        cause: phase::HoldCause::Operator,
        at: Vector3::new(0.0, 0.0, -16.3),
        yaw: 0.0,
        fresh: None,
    };
    let step = |phase, progress, s: &Situation| decide(phase, progress, None, s, &permits());
    let s = with(|s| s.sortie.turns_back = Some(due));
    let d = step(hold, sortie(false), &s);
    assert!(d.progress.landing && d.phase.state() == State::Hold && !d.phase.waits_for_operator());
    assert_eq!(step(hold, sortie(true), &s).entered, None);
    assert_eq!(step(hold, MissionProgress::default(), &s).entered, None);
    let others = with(|s| {
        s.sortie.turns_back = Some(due);
        s.flight = ControlState::OtherControl(AutopilotMode::Other);
    });
    let d = step(MissionPhase::Idle, sortie(false), &others);
    assert_eq!((d.entered, d.progress.landing), (Some(due), true));
    // A hold ordered on the way is not a stop of a landing.
    for phase in [hold, MissionPhase::Idle] {
        let waits = with(|_| {});
        let d = decide(phase, sortie(false), Some(CommandKind::Hold), &waits, &permits());
        assert!(!d.progress.stopped, "{phase:?}");
    }
    // A drone that could not fly back is not handed over; it returns despite a reason against a landing.
    let with_order = MissionProgress {
        landing: true,
        started: at(9.0),
        ..sortie(false)
    };
    let waits = |change: fn(&mut Situation)| {
        let mut s = others;
        change(&mut s);
        step(MissionPhase::Idle, with_order, &s).waiting.code
    };
    assert_eq!(waits(|_| {}), ReasonCode::TurnsBack);
    assert_eq!(
        waits(|s| s.rejection = Some(NotCleared.into())),
        ReasonCode::TurnsBack
    );
    assert_eq!(waits(|s| s.rejection = Some(SwitchAborts.into())), SwitchAborts);
    assert_eq!(waits(|s| s.forecast_age_s = 40.0), ForecastStale);
    let mut later = others;
    later.now = at(300.0);
    let d = step(MissionPhase::Idle, d.progress, &later);
    assert_eq!((d.entered, d.waiting, d.progress.landing), (None, due, true));
}
