//! Tests of orders that wait or belong to a previous flight, and of doubtful deck heights.

use alight_shared::msg::{
    AutopilotMode, CommandKind,
    ReasonCode::{HeightsDisagree, NotCommanded, NotFlying, OffHeight, OrderExpired},
};

use super::{situation::Deck, tests::*, *};

#[test]
fn order_that_waits_for_a_flight() {
    let given = at(10.0);
    for flight in [
        ControlState::Disarmed,
        ControlState::OnGround,
        ControlState::OtherControl(AutopilotMode::Other),
        ControlState::Unknown,
    ] {
        let waiting = |t: f64| Situation {
            now: given + Span::from_secs(t),
            ..with(|s| s.flight = flight)
        };
        let d = commanded(
            (MissionPhase::Idle, MissionProgress::default()),
            CommandKind::Land,
            &waiting(0.0),
        );
        waits(&d, State::Idle, NotFlying);
        waits(&step(&d, &waiting(59.0)), State::Idle, NotFlying);
        let d = step(&d, &waiting(61.0));
        goes(&d, State::Idle, OrderExpired);
        assert!(!d.progress.landing);
        let later = Situation {
            now: given + Span::from_secs(3600.0),
            ..fair()
        };
        waits(&step(&d, &later), State::Idle, NotCommanded);
    }
}

#[test]
fn order_of_the_flight_before() {
    let other = with(|s| s.flight = ControlState::OtherControl(AutopilotMode::Other));
    let d = commanded(
        (MissionPhase::Idle, MissionProgress::default()),
        CommandKind::Land,
        &other,
    );
    waits(&d, State::Idle, NotFlying);
    let disarmed = with(|s| s.flight = ControlState::Disarmed);
    goes(&step(&d, &disarmed), State::Idle, OrderExpired);
    // An order to a disarmed drone waits for the take-off.
    let d = commanded(
        (MissionPhase::Idle, MissionProgress::default()),
        CommandKind::Land,
        &disarmed,
    );
    let d = step(&step(&d, &disarmed), &other);
    waits(&d, State::Idle, NotFlying);
    assert_eq!(step(&d, &fair()).phase.state(), State::GetAltitude);
}

/// While a second source contradicts the deck's height, the approach stays above both heights and no descent begins.
#[test]
fn heights_that_disagree_in_every_phase() {
    let doubtful = with(|s| {
        (s.mean_deck_z, s.lowest_z) = (Some(-1.3), Some(-16.3));
        s.doubt = Some(Reason::new(HeightsDisagree, 31.0, 8.0));
        s.own.as_mut().unwrap().position.z = -16.3;
    });
    waits(
        &run(MissionPhase::APPROACH, &doubtful, 5.0),
        State::Approach,
        HeightsDisagree,
    );
    for phase in [TRACKING, MissionPhase::TrackingStable] {
        goes(&step(phase, &doubtful), State::Approach, HeightsDisagree);
    }
    for phase in [DESCENT, FREE_FLARE] {
        goes(&run(phase, &doubtful, 1.0), State::Tracking, HeightsDisagree);
    }
    let low = Situation {
        deck: doubtful.deck.map(|d| Deck {
            clearance_m: 0.4,
            ..d
        }),
        ..doubtful
    };
    assert_eq!(run(COMMITTED, &low, 1.0).phase.state(), State::Flare);
    let climb = MissionPhase::GetAltitude { from: [0.0; 2] };
    let below = Situation {
        own: fair().own,
        ..doubtful
    };
    waits(&step(climb, &below), State::GetAltitude, OffHeight);
}
