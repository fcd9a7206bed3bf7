//! What interrupts every state: stale data, operators, retries, battery, time limit, lost control.

use alight_shared::msg::AutopilotMode;
use alight_shared::msg::ReasonCode::{
    BatteryLow, Commanded, Deviated, ForecastStale, NotCommanded, NotFlying, OdometryStale, Operator,
    OutOfRetries, Reached, TooFar, TooLong,
};
use nalgebra::Vector3;

use super::phase::HoldCause;
use super::tests::*;
use super::*;

#[test]
fn mission_holds_at_a_safe_height_while_data_are_stale() {
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
            goes(&run(&d, &fair(), 1.0), State::Tracking, Reached);
            let unseen = with_deck(|d| d.vision_age_s = 20.0);
            goes(&run(&d, &unseen, 1.0), State::GetAltitude, Reached);
        }
    }
}

#[test]
fn operator_hold_lasts_until_the_next_landing_command() {
    let d = commanded(COMMITTED, CommandKind::Hold, &fair());
    goes(&d, State::Hold, Operator);
    waits(&run(&d, &fair(), 20.0), State::Hold, Operator);
    let d = commanded(&d, CommandKind::Land, &fair());
    goes(&run(&d, &fair(), 1.0), State::Tracking, Reached);
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

#[test]
fn mission_gives_up_after_its_last_attempt() {
    let mut progress = wanted();
    let bad = with_deck(|d| d.distance_m = 4.0);
    let c = config();
    for n in 1..=c.max_attempts {
        let d = step((MissionPhase::TrackingStable, progress), &fair());
        goes(&d, State::Descent, Reached);
        assert_eq!(d.progress.attempts, n);
        progress = d.progress;
        let d = run(&d, &bad, 1.0);
        if n < c.max_attempts {
            goes(&d, State::Tracking, Deviated);
        } else {
            goes(&d, State::GaveUp, OutOfRetries);
        }
    }
    // However it came back above the deck, it does not begin another.
    goes(
        &step((MissionPhase::TrackingStable, progress), &fair()),
        State::GaveUp,
        OutOfRetries,
    );
}

#[test]
fn mission_gives_up_on_low_battery_unless_landing_or_commanded_again() {
    let low = with(|s| s.battery = Some(0.1));
    let d = step(TRACKING, &low);
    goes(&d, State::GaveUp, BatteryLow);
    waits(&step(DESCENT, &low), State::Descent, TooFar);
    let d = commanded(&d, CommandKind::Land, &low);
    goes(&d, State::Hold, Commanded);
    goes(&run(&d, &low, 1.0), State::Tracking, Reached);
}

#[test]
fn mission_gives_up_after_its_time_limit() {
    let late = Situation {
        now: at(601.0),
        ..with_deck(|d| d.vision_age_s = f64::INFINITY)
    };
    let d = step(MissionPhase::APPROACH, &late);
    goes(&d, State::GaveUp, TooLong);
}

#[test]
fn mission_returns_to_idle_when_control_is_lost() {
    let s = with(|s| s.flight = ControlState::OtherControl(AutopilotMode::Other));
    let d = step(COMMITTED, &s);
    goes(&d, State::Idle, NotFlying);
    assert!(!d.progress.landing, "a person flies: nothing resumes by itself");
    let s = with(|s| s.flight = ControlState::OtherControl(AutopilotMode::Hold));
    assert!(step(TRACKING, &s).progress.landing);
    let s = with(|s| s.flight = ControlState::Disarmed);
    goes(&step(TRACKING, &s), State::Idle, NotFlying);
}
