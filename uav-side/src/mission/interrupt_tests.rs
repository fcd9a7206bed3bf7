//! What interrupts every state: old data, operators, retries, battery, patience, lost control.

use alight_shared::msg::AutopilotMode;
use nalgebra::Vector3;

use super::tests::*;
use super::*;

#[test]
fn mission_holds_at_a_safe_height_while_data_are_stale() {
    for (s, why) in [
        (
            Situation {
                forecast_age_s: 0.4,
                ..fair()
            },
            ReasonCode::ForecastStale,
        ),
        (
            Situation {
                odometry_age_s: 0.3,
                ..fair()
            },
            ReasonCode::OdometryStale,
        ),
        (
            Situation {
                flight: ControlState::Unknown,
                ..fair()
            },
            ReasonCode::NotFlying,
        ),
    ] {
        for phase in [TRACKING, MissionPhase::TrackingStable, DESCENT, COMMITTED] {
            let mut low = s;
            low.own.as_mut().unwrap().position.z = -3.0;
            let d = decide(phase, attempt(), None, &low, &config());
            goes(&d, State::Hold, why);
            let MissionPhase::Hold { at, .. } = d.phase else {
                panic!()
            };
            assert!((at.z + 8.3).abs() < 1e-9, "{at:?}");
            waits(&run(d.phase, d.progress, &s, 3.0), State::Hold, why);
            goes(
                &run(d.phase, d.progress, &fair(), 1.0),
                State::Tracking,
                ReasonCode::Reached,
            );
            let unseen = with_deck(|d| d.vision_age_s = 20.0);
            goes(
                &run(d.phase, d.progress, &unseen, 1.0),
                State::GetAltitude,
                ReasonCode::Reached,
            );
        }
    }
}

#[test]
fn operator_hold_lasts_until_the_next_landing_command() {
    let d = decide(COMMITTED, attempt(), Some(CommandKind::Hold), &fair(), &config());
    goes(&d, State::Hold, ReasonCode::Operator);
    waits(
        &run(d.phase, d.progress, &fair(), 20.0),
        State::Hold,
        ReasonCode::Operator,
    );
    let d = decide(d.phase, d.progress, Some(CommandKind::Land), &fair(), &config());
    goes(
        &run(d.phase, d.progress, &fair(), 1.0),
        State::Tracking,
        ReasonCode::Reached,
    );
}

#[test]
fn abort_ends_every_flying_state() {
    let spare = MissionPhase::Hold {
        cause: HoldCause::Data,
        at: Vector3::zeros(),
        yaw: 0.0,
        fresh: None,
    };
    for phase in [
        MissionPhase::GetAltitude { from: [0.0; 2] },
        MissionPhase::Approach { detected: None },
        TRACKING,
        MissionPhase::TrackingStable,
        DESCENT,
        FREE_FLARE,
        COMMITTED,
        spare,
    ] {
        let s = with_deck(|d| d.clearance_m = 0.2);
        let d = decide(phase, attempt(), Some(CommandKind::Abort), &s, &config());
        goes(&d, State::GaveUp, ReasonCode::Operator);
        let MissionPhase::GaveUp { at, .. } = d.phase else {
            panic!()
        };
        assert!(
            (at.z + 16.3).abs() < 1e-9,
            "straight up to the approach height: {at:?}"
        );
        assert!(!d.progress.landing);
        waits(
            &run(d.phase, d.progress, &fair(), 5.0),
            State::GaveUp,
            ReasonCode::NotCommanded,
        );
    }
}

#[test]
fn mission_gives_up_after_its_last_attempt() {
    let mut progress = wanted();
    let bad = with_deck(|d| d.distance_m = 4.0);
    let c = config();
    for n in 1..=c.max_attempts {
        let d = decide(MissionPhase::TrackingStable, progress, None, &fair(), &c);
        goes(&d, State::Descent, ReasonCode::Reached);
        assert_eq!(d.progress.attempts, n);
        progress = d.progress;
        let d = run(d.phase, d.progress, &bad, 1.0);
        if n < c.max_attempts {
            goes(&d, State::Tracking, ReasonCode::Deviated);
        } else {
            goes(&d, State::GaveUp, ReasonCode::OutOfRetries);
        }
    }
    // However it came back above the deck, it does not begin another.
    goes(
        &decide(MissionPhase::TrackingStable, progress, None, &fair(), &c),
        State::GaveUp,
        ReasonCode::OutOfRetries,
    );
}

#[test]
fn mission_gives_up_on_low_battery_unless_landing_or_commanded_again() {
    let low = Situation {
        battery: Some(0.1),
        ..fair()
    };
    let d = decide(TRACKING, wanted(), None, &low, &config());
    goes(&d, State::GaveUp, ReasonCode::BatteryLow);
    waits(
        &decide(DESCENT, attempt(), None, &low, &config()),
        State::Descent,
        ReasonCode::TooFar,
    );
    let d = decide(d.phase, d.progress, Some(CommandKind::Land), &low, &config());
    goes(&d, State::Hold, ReasonCode::Commanded);
    goes(
        &run(d.phase, d.progress, &low, 1.0),
        State::Tracking,
        ReasonCode::Reached,
    );
}

#[test]
fn mission_gives_up_after_its_time_limit() {
    let late = Situation {
        now: at(601.0),
        ..with_deck(|d| d.vision_age_s = f64::INFINITY)
    };
    let d = decide(
        MissionPhase::Approach { detected: None },
        wanted(),
        None,
        &late,
        &config(),
    );
    goes(&d, State::GaveUp, ReasonCode::TooLong);
}

#[test]
fn mission_returns_to_idle_when_control_is_lost() {
    let s = Situation {
        flight: ControlState::OtherControl(AutopilotMode::Other),
        ..fair()
    };
    let d = decide(COMMITTED, attempt(), None, &s, &config());
    goes(&d, State::Idle, ReasonCode::NotFlying);
    assert!(!d.progress.landing, "a person flies: nothing resumes by itself");
    let s = Situation {
        flight: ControlState::OtherControl(AutopilotMode::Hold),
        ..fair()
    };
    assert!(decide(TRACKING, wanted(), None, &s, &config()).progress.landing);
    let s = Situation {
        flight: ControlState::Disarmed,
        ..fair()
    };
    goes(
        &decide(TRACKING, wanted(), None, &s, &config()),
        State::Idle,
        ReasonCode::NotFlying,
    );
}
