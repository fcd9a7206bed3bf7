//! Tests of the modes that precede a first landing: shadow and match.

use alight_shared::msg::{
    AutopilotMode, AutopilotState, BatteryPlace, CommandKind, LandedState, LandingMode,
    ReasonCode::{BatteryHome, DescendingTo, Matched, Matching, NotFlying, Operator, TooNear, VisionLost},
};

use super::{tests::*, *};
use crate::contingency::ContactOutcomes;

fn matching() -> MissionConfig {
    MissionConfig {
        mode: LandingMode::Match,
        ..config()
    }
}
fn step_at(d: &Decision, s: &Situation, command: Option<CommandKind>) -> Decision {
    decide(d.phase, d.progress, command, s, &matching())
}
fn descends() -> Decision {
    Decision {
        phase: DESCENT,
        progress: attempt(),
        entered: None,
        waiting: Reason::default(),
    }
}
fn at_clearance(t: f64, clearance_m: f64) -> Situation {
    Situation {
        now: at(t),
        ..with_deck(|d| d.clearance_m = clearance_m)
    }
}

#[test]
fn match_for_its_time() {
    let mut d = step_at(&descends(), &at_clearance(10.0, 5.0), None);
    waits(&d, State::Descent, DescendingTo);
    for k in 0..=100 {
        let t = 12.0 + 0.1 * f64::from(k);
        d = step_at(&d, &at_clearance(t, 2.5 + 0.3 * t.sin()), None);
        if k < 100 {
            waits(&d, State::Descent, Matching);
        }
    }
    goes(&d, State::GaveUp, Matched);
    assert!(!d.progress.landing);
    let why = d.entered.unwrap().to_string();
    assert_eq!(why, "matched the deck at 2.0 m for 10 s: climbs");
}

#[test]
fn match_left_behind() {
    let mut d = descends();
    for (t, clearance_m) in [(12.0, 2.5), (20.0, 2.5), (20.1, 3.2), (20.2, 2.5), (22.5, 2.5)] {
        d = step_at(&d, &at_clearance(t, clearance_m), None);
    }
    waits(&d, State::Descent, Matching);
}

#[test]
fn match_below_its_clearance_and_blind() {
    let d = step_at(&descends(), &at_clearance(12.0, 1.95), None);
    goes(&d, State::Tracking, TooNear);
    let blind = |t: f64| Situation {
        now: at(t),
        ..with_deck(|d| (d.clearance_m, d.vision_age_s) = (2.5, 3.0))
    };
    let d = step_at(&descends(), &blind(12.0), None);
    goes(&step_at(&d, &blind(12.5), None), State::Tracking, VisionLost);
}

#[test]
fn match_with_abort_and_hold() {
    let low =
        with_deck(|d| (d.clearance_m, d.ends) = (0.3, Some(ContactOutcomes::of_speeds(0.5, Some(2.0)))));
    for (order, state) in [
        (CommandKind::Abort, State::GaveUp),
        (CommandKind::Hold, State::Hold),
    ] {
        goes(&step_at(&descends(), &low, Some(order)), state, Operator);
    }
}

#[test]
fn match_with_a_low_battery() {
    let empty = with(|s| s.battery = Some(0.1));
    for phase in [TRACKING, DESCENT] {
        let d = Decision { phase, ..descends() };
        let d = step_at(&d, &empty, None);
        goes(&d, State::GaveUp, BatteryHome);
        assert_eq!(d.progress.low_battery, Some(BatteryPlace::Home));
    }
}

#[test]
fn shadow_until_disarmed() {
    let a = AutopilotState {
        armed: true,
        mode: AutopilotMode::Other,
        landed: LandedState::InAir,
        ..AutopilotState::default()
    };
    let of = |a: &AutopilotState, mode| ControlState::of(Some(a), mode);
    for mode in [AutopilotMode::Other, AutopilotMode::Hold, AutopilotMode::Land] {
        let flown = AutopilotState { mode, ..a };
        assert_eq!(of(&flown, LandingMode::Shadow), ControlState::Ours);
        for other in [LandingMode::Match, LandingMode::Land] {
            assert_eq!(of(&flown, other), ControlState::OtherControl(mode));
        }
    }
    let disarmed = AutopilotState { armed: false, ..a };
    let s = with(|s| s.flight = of(&disarmed, LandingMode::Shadow));
    let d = step(TRACKING, &s);
    goes(&d, State::Idle, NotFlying);
    assert!(!d.progress.landing);
}
