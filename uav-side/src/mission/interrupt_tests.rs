use alight_shared::msg::{
    AutopilotMode, CommandKind,
    ReasonCode::{
        Commanded, CompletesLanding, Deviated, FalseTouchdown, ForecastStale, HardContact, NotCommanded,
        NotFlying, OdometryStale, Operator, OutOfRetries, Permitted, Recovered, Touchdown,
    },
};
use nalgebra::Vector3;

use super::{phase::HoldCause, tests::*, *};
use crate::contingency::ContactOutcomes;

#[test]
fn hold_with_stale_data() {
    for (s, why) in [
        (with(|s| s.forecast_age_s = 0.4), ForecastStale),
        (with(|s| s.odometry_age_s = 0.3), OdometryStale),
        (with(|s| s.flight = ControlState::Unknown), NotFlying),
    ] {
        for phase in [TRACKING, MissionPhase::TrackingStable, DESCENT, COMMITTED] {
            let mut low = s;
            low.own.as_mut().unwrap().position.z = -3.0;
            let d = step(phase, &low);
            goes(&d, State::Hold, why);
            let MissionPhase::Hold { at, .. } = d.phase else {
                panic!()
            };
            assert!((at.z + 8.3).abs() < 1e-9, "{at:?}");
            waits(&run(&d, &s, 3.0), State::Hold, why);
            goes(&run(&d, &fair(), 1.0), State::Tracking, Recovered);
            let undetected = with_deck(|d| d.vision_age_s = 20.0);
            goes(&run(&d, &undetected, 1.0), State::GetAltitude, Recovered);
        }
    }
}

#[test]
fn hold_by_an_operator() {
    let d = commanded(COMMITTED, CommandKind::Hold, &fair());
    goes(&d, State::Hold, Operator);
    waits(&run(&d, &fair(), 20.0), State::Hold, Operator);
    let d = commanded(&d, CommandKind::Land, &fair());
    goes(&run(&d, &fair(), 1.0), State::Tracking, Commanded);
}

#[test]
fn abort_in_every_flying_state() {
    let spare = MissionPhase::Hold {
        cause: HoldCause::Data,
        at: Vector3::zeros(),
        yaw: 0.0,
        fresh: None,
    };
    for phase in [
        MissionPhase::GetAltitude { from: [0.0; 2] },
        MissionPhase::APPROACH,
        TRACKING,
        MissionPhase::TrackingStable,
        DESCENT,
        FREE_FLARE,
        COMMITTED,
        spare,
    ] {
        let s = with_deck(|d| d.clearance_m = 0.2);
        let d = commanded(phase, CommandKind::Abort, &s);
        goes(&d, State::GaveUp, Operator);
        let MissionPhase::GaveUp { at, .. } = d.phase else {
            panic!()
        };
        assert!(
            (at.z + 16.3).abs() < 1e-9,
            "straight up to the approach height: {at:?}"
        );
        assert!(!d.progress.landing);
        waits(&run(&d, &fair(), 5.0), State::GaveUp, NotCommanded);
    }
}

fn on_the_deck() -> ContactOutcomes {
    ContactOutcomes {
        rests: true,
        ..ContactOutcomes::of_speeds(0.5, None)
    }
}

/// Low above the deck, with a climb that would hit the deck at this speed.
fn low(contact_mps: f64) -> Situation {
    with_deck(|d| (d.clearance_m, d.ends) = (0.3, Some(ContactOutcomes::of_speeds(0.5, Some(contact_mps)))))
}

#[test]
fn abort_with_a_climb_into_the_deck() {
    for command in [CommandKind::Abort, CommandKind::Hold] {
        let climbs = if command == CommandKind::Abort {
            State::GaveUp
        } else {
            State::Hold
        };
        goes(&commanded(COMMITTED, command, &low(0.4)), climbs, Operator);
        let on_it = with_deck(|d| d.ends = Some(on_the_deck()));
        for s in [low(0.8), on_it] {
            let d = commanded(COMMITTED, command, &s);
            waits(&d, State::Flare, CompletesLanding);
            // A second order has no effect, even once the climb becomes possible.
            let d = commanded(&d, command, &low(0.1));
            waits(&d, State::Flare, CompletesLanding);
            let mut stopped = s;
            stopped.motors_stopped = true;
            goes(&step(&d, &stopped), State::Landed, Touchdown);
        }
        // A drone that would slide overboard climbs unless that contact is harmful.
        let slides = |contact_mps| Situation {
            staying: Staying {
                probability: 0.8,
                ..Staying::default()
            },
            ..low(contact_mps)
        };
        goes(&commanded(COMMITTED, command, &slides(0.8)), climbs, Operator);
        let d = commanded(COMMITTED, command, &slides(1.1));
        waits(&d, State::Flare, CompletesLanding);
        let mut off_deck = low(0.8);
        off_deck.outside_m = 0.5;
        goes(&commanded(COMMITTED, command, &off_deck), climbs, Operator);
    }
}

#[test]
fn abort_with_a_completed_landing_broken_off() {
    let d = commanded(COMMITTED, CommandKind::Abort, &low(0.8));
    let mut missed = low(0.8);
    missed.outside_m = 0.5;
    goes(&step(&d, &missed), State::GaveUp, Deviated);
    let mut stale = low(0.8);
    stale.forecast_age_s = 0.4;
    let gone = step(&d, &stale);
    goes(&gone, State::GaveUp, ForecastStale);
    waits(&run(&gone, &fair(), 5.0), State::GaveUp, NotCommanded);
    let again = commanded(&d, CommandKind::Land, &low(0.8));
    goes(&step(&again, &missed), State::Tracking, Deviated);
}

#[test]
fn hold_position_with_the_deck() {
    let at_height = |z: f64, distance_m: f64| {
        with(|s| {
            s.own.as_mut().unwrap().position = Vector3::new(30.0, 4.0, z);
            s.deck.as_mut().unwrap().distance_m = distance_m;
        })
    };
    for command in [CommandKind::Abort, CommandKind::Hold] {
        let d = commanded(
            DESCENT,
            command,
            &with(|s| s.own.as_mut().unwrap().position.z = -3.0),
        );
        let place = |d: &Decision, s: &Situation| match step(d, s).phase {
            MissionPhase::GaveUp { at, .. } | MissionPhase::Hold { at, .. } => {
                (at.x, super::phase::moving_place(&at, s, false).0)
            }
            phase => panic!("{phase:?}"),
        };
        assert_eq!(place(&d, &at_height(-5.0, 1.0)), (30.0, true));
        // High enough; vessel far away; deck unknown.
        assert_eq!(place(&d, &at_height(-17.0, 1.0)), (0.0, false));
        assert_eq!(place(&d, &at_height(-5.0, 11.0)), (0.0, false));
        let mut stale = at_height(-5.0, 1.0);
        stale.forecast_age_s = 0.4;
        assert_eq!(place(&d, &stale), (0.0, false));
    }
}

#[test]
fn abort_of_an_idle_drone() {
    let idle = (MissionPhase::Idle, MissionProgress::default());
    waits(&step(idle, &fair()), State::Idle, NotCommanded);
    let low = with(|s| s.own.as_mut().unwrap().position.z = -2.0);
    let d = commanded(idle, CommandKind::Abort, &low);
    goes(&d, State::GaveUp, Operator);
    let MissionPhase::GaveUp { at, .. } = d.phase else {
        panic!()
    };
    assert!((at.z + 16.3).abs() < 1e-9, "{at:?}");
    goes(&commanded(idle, CommandKind::Hold, &low), State::Hold, Operator);
    for flight in [
        ControlState::Disarmed,
        ControlState::OnGround,
        ControlState::OtherControl(AutopilotMode::Other),
    ] {
        let s = with(|s| s.flight = flight);
        let d = commanded(idle, CommandKind::Abort, &s);
        waits(&d, State::Idle, Operator);
        waits(&step(&d, &s), State::Idle, Operator);
        waits(&commanded(&d, CommandKind::Abort, &s), State::Idle, Operator);
        waits(&commanded(&d, CommandKind::Land, &s), State::Idle, NotFlying);
    }
}

#[test]
fn abort_after_a_touchdown() {
    let in_air = |stopped| {
        with(|s| {
            s.deck.as_mut().unwrap().clearance_m = 1.2;
            s.motors_stopped = stopped;
        })
    };
    let d = commanded(MissionPhase::LANDED, CommandKind::Abort, &in_air(true));
    goes(&d, State::GaveUp, Operator);
    // A false stop by the pilot node is ignored until withdrawn; its next stop is accepted.
    let d = step(&d, &in_air(true));
    assert_eq!(d.phase.state(), State::GaveUp);
    let d = step(&d, &in_air(false));
    goes(&step(&d, &in_air(true)), State::Landed, Touchdown);

    for on_deck in [
        with_deck(|d| d.clearance_m = 0.1),
        with(|s| s.rotors_carry = Some(false)),
    ] {
        let d = commanded(MissionPhase::LANDED, CommandKind::Abort, &on_deck);
        assert_eq!(d.phase.state(), State::Landed);
        assert_eq!(run(&d, &on_deck, 5.0).phase.state(), State::Landed);
    }
    // Without a thrust report the height above the deck shows that the drone flies; without a height, the pilot's mode.
    let silent = |mut s: Situation| {
        s.rotors_carry = None;
        s
    };
    let mut undetected = silent(in_air(true));
    undetected.forecast_age_s = 9.0;
    for flies in [silent(in_air(true)), undetected] {
        goes(
            &commanded(MissionPhase::LANDED, CommandKind::Abort, &flies),
            State::GaveUp,
            Operator,
        );
    }
    goes(
        &run(MissionPhase::LANDED, &silent(in_air(true)), 1.5),
        State::Tracking,
        FalseTouchdown,
    );
    for stays in [undetected, silent(with_deck(|d| d.clearance_m = 0.1))] {
        assert_eq!(
            run(MissionPhase::LANDED, &stays, 5.0).phase.state(),
            State::Landed
        );
    }
    // Without an abort, the landing is resumed once the rotors have carried the drone for a second.
    let d = run(MissionPhase::LANDED, &in_air(true), 0.9);
    assert_eq!(d.phase.state(), State::Landed);
    let d = run(MissionPhase::LANDED, &in_air(true), 1.5);
    goes(&d, State::Tracking, FalseTouchdown);
    // An abort on the deck is final.
    let rests = with_deck(|d| d.clearance_m = 0.1);
    let d = run(
        &commanded(MissionPhase::LANDED, CommandKind::Abort, &rests),
        &in_air(true),
        1.5,
    );
    goes(&d, State::GaveUp, FalseTouchdown);
    assert!(!d.progress.landing);
}

#[test]
fn last_attempt() {
    let mut progress = wanted();
    let bad = with_deck(|d| d.distance_m = 4.0);
    let c = config();
    for n in 1..=c.max_attempts {
        let d = step((MissionPhase::TrackingStable, progress), &fair());
        goes(&d, State::Descent, Permitted);
        assert_eq!(d.progress.attempts, n);
        progress = d.progress;
        let d = run(&d, &bad, 1.0);
        if n < c.max_attempts {
            goes(&d, State::Tracking, Deviated);
        } else {
            goes(&d, State::GaveUp, OutOfRetries);
        }
    }
    // No further descent begins, however the drone has returned above the deck.
    let d = step((MissionPhase::TrackingStable, progress), &fair());
    goes(&d, State::GaveUp, OutOfRetries);
}

#[test]
fn completion_of_a_landing_without_data() {
    let harder = 2.0 * config().flare_mps;
    let (clears, meets) = (
        ContactOutcomes::of_speeds(0.5, None),
        ContactOutcomes::of_speeds(0.5, Some(harder)),
    );
    // Without odometry no set-point is sent, and the decision to leave is postponed.
    for (clearance_m, ends, age_s, state, undetected) in [
        (0.02, on_the_deck(), 0.4, State::Flare, State::Flare),
        (0.02, on_the_deck(), 1.1, State::Hold, State::Hold),
        (0.4, clears, 0.4, State::Hold, State::Flare),
        (0.4, clears, 1.1, State::Hold, State::Hold),
        (0.4, meets, 0.4, State::Flare, State::Flare),
        (0.4, meets, 1.1, State::Hold, State::Hold),
    ] {
        let deck = |s: &mut Situation| {
            let d = s.deck.as_mut().unwrap();
            (d.clearance_m, d.ends) = (clearance_m, Some(ends));
        };
        let without_forecast = with(|s| {
            deck(s);
            s.forecast_age_s = age_s;
        });
        let without_odometry = with(|s| {
            deck(s);
            s.odometry_age_s = age_s;
        });
        for (s, state) in [(without_forecast, state), (without_odometry, undetected)] {
            let d = step(COMMITTED, &s);
            assert_eq!(d.phase.state(), state, "{clearance_m} m, {age_s} s");
        }
    }
}

#[test]
fn hard_contact_that_is_not_repeated() {
    let hard = |change: fn(&mut Situation)| {
        with(|s| {
            s.hard_contact_mps = Some(2.6);
            change(s);
        })
    };
    let d = step(COMMITTED, &hard(|s| s.motors_stopped = true));
    goes(&d, State::Landed, HardContact);
    let text = d.entered.unwrap_or_default().to_string();
    assert!(text.starts_with("hard contact at 2.6 m/s (limit 1.5)"), "{text}");
    // After a bounce over the edge another attempt needs an order.
    let d = step(
        COMMITTED,
        &hard(|s| (s.outside_m, s.deck.as_mut().unwrap().clearance_m) = (0.5, 0.3)),
    );
    goes(&d, State::GaveUp, HardContact);
    waits(&run(&d, &hard(|_| ()), 60.0), State::GaveUp, NotCommanded);
    goes(
        &commanded(&d, CommandKind::Land, &hard(|_| ())),
        State::Hold,
        Commanded,
    );
}

#[test]
fn order_after_a_set_point_loss_and_a_takeover() {
    let holds = with(|s| s.flight = ControlState::SetPointsLost);
    let d = step(DESCENT, &holds);
    goes(&d, State::Idle, NotFlying);
    assert!(d.progress.landing);
    let d = run(&d, &holds, 5.0);
    goes(&step(&d, &fair()), State::GetAltitude, Commanded);
    for mode in [AutopilotMode::Other, AutopilotMode::Hold, AutopilotMode::Return] {
        let taken = step(&d, &with(|s| s.flight = ControlState::OtherControl(mode)));
        waits(&taken, State::Idle, NotCommanded);
        waits(&run(&taken, &fair(), 60.0), State::Idle, NotCommanded);
    }
}
