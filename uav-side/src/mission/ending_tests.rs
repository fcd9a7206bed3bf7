//! Ends of orders and waivers: an order that waits, a battery below the reserve at the order and after a stop, heights in doubt.

use alight_shared::msg::ReasonCode::{
    BatteryDeck, BatteryHome, BatteryStopped, HeightsDisagree, NotCommanded, NotFlying, OffHeight, Operator,
    OrderExpired,
};
use alight_shared::msg::{AutopilotMode, BatteryPlace, CommandKind};

use super::reservation::Reservation;
use super::situation::Deck;
use super::tests::*;
use super::*;

/// An order to land waits a minute for a flight, and no longer.
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
        // The mode is given an hour later.
        let later = Situation {
            now: given + Span::from_secs(3600.0),
            ..fair()
        };
        waits(&step(&d, &later), State::Idle, NotCommanded);
    }
}

/// An order ends with the flight in which it was given.
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
    // One that is given to a disarmed drone waits for the take-off.
    let d = commanded(
        (MissionPhase::Idle, MissionProgress::default()),
        CommandKind::Land,
        &disarmed,
    );
    let d = step(&step(&d, &disarmed), &other);
    waits(&d, State::Idle, NotFlying);
    assert_eq!(step(&d, &fair()).phase.state(), State::GetAltitude);
}

fn charged(battery: f64) -> Situation {
    with(|s| s.battery = Some(battery))
}

/// An order below the reserve chooses the deck at once, within wider limits, and still leaves it for another place when half
/// of what there was is gone.
#[test]
fn order_below_the_reserve() {
    let rough = |battery: f64| {
        with(|s| {
            s.battery = Some(battery);
            s.odds.as_mut().unwrap().slides = 0.2;
        })
    };
    let d = commanded(
        (MissionPhase::Idle, MissionProgress::default()),
        CommandKind::Land,
        &rough(0.18),
    );
    assert_eq!(d.progress.ordered_below, Some(0.18));
    let tracking = (
        MissionPhase::TrackingStable,
        MissionProgress {
            low_battery: Some(BatteryPlace::Deck),
            ..d.progress
        },
    );
    goes(
        &step(tracking, &rough(0.17)),
        State::Descent,
        alight_shared::msg::ReasonCode::Permitted,
    );
    // No descent can begin: half of it is for the next place.
    let closed = |battery| Situation {
        reservation: Reservation::Others(2),
        ..charged(battery)
    };
    let d = step(tracking, &closed(0.17));
    goes(&d, State::GaveUp, BatteryHome);
    let worse = |battery| Situation {
        deck: fair().deck.map(|deck| Deck {
            tilt_rad: 0.8,
            ..deck
        }),
        ..charged(battery)
    };
    assert_eq!(step(tracking, &worse(0.1)).phase.state(), State::TrackingStable);
    goes(&step(tracking, &worse(0.08)), State::GaveUp, BatteryHome);
    // With less than half of the reserve there is no other place to reach.
    let last = (
        MissionPhase::TrackingStable,
        MissionProgress {
            ordered_below: Some(0.08),
            ..tracking.1
        },
    );
    assert_eq!(step(last, &worse(0.01)).phase.state(), State::TrackingStable);
    goes(
        &step(last, &rough(0.03)),
        State::Descent,
        alight_shared::msg::ReasonCode::Permitted,
    );
}

/// After an abort or a hold the operator decides until a quarter of the reserve is gone; then it lands, and a second abort
/// finally declines the deck.
#[test]
fn low_battery_after_a_stop() {
    for (command, state, waiting) in [
        (CommandKind::Abort, State::GaveUp, NotCommanded),
        (CommandKind::Hold, State::Hold, Operator),
    ] {
        let d = commanded(TRACKING, command, &charged(0.5));
        waits(&step(&d, &charged(0.21)), state, waiting);
        let d = step(&d, &charged(0.18));
        waits(&d, state, BatteryStopped);
        assert_eq!(
            d.waiting.to_string(),
            "battery at 18 %: below 15 % it lands on the deck, or at the next place, unless it is commanded otherwise"
        );
        let d = step(&d, &charged(0.14));
        goes(&d, State::Tracking, BatteryDeck);
        assert_eq!(d.progress.low_battery, Some(BatteryPlace::Deck));
        assert!(d.progress.landing && !d.progress.stopped);
        let d = commanded(&d, command, &charged(0.14));
        goes(&d, state, Operator);
        goes(&step(&d, &charged(0.14)), State::GaveUp, BatteryHome);
        // A deck closed by the crew is not available.
        let d = commanded(TRACKING, command, &charged(0.5));
        let closed = with(|s| {
            (s.battery, s.reservation) = (Some(0.14), Reservation::Others(alight_shared::msg::DECK_CLOSED));
        });
        goes(&step(&d, &closed), State::GaveUp, BatteryHome);
    }
}

/// A gauge that steps from above the reserve to below half of it: next to a deck that is free no other place is nearer.
#[test]
fn gauge_that_steps_below_half_of_the_reserve() {
    let gave_up = phase::gave_up(&fair(), &config());
    for charge in [0.09, 0.05, 0.01] {
        for phase in [MissionPhase::APPROACH, TRACKING, gave_up] {
            let d = step(&step(phase, &charged(0.5)), &charged(charge));
            goes(&d, State::Tracking, BatteryDeck);
            let d = step(&d, &charged(0.5 * charge));
            assert_eq!(d.phase.state().phase(), Phase::Follow);
        }
        let taken = with(|s| (s.battery, s.reservation) = (Some(charge), Reservation::Others(2)));
        goes(&step(TRACKING, &taken), State::GaveUp, BatteryHome);
    }
    // One that was noticed above that has waited for its deck.
    let d = step(&step(TRACKING, &charged(0.15)), &charged(0.09));
    goes(&d, State::GaveUp, BatteryHome);
}

/// A landing that was given up leaves no drone in the air until it falls.
#[test]
fn low_battery_after_a_give_up() {
    let gave_up = phase::gave_up(&fair(), &config());
    let progress = MissionProgress {
        attempts: config().max_attempts,
        ..MissionProgress::default()
    };
    waits(
        &step((gave_up, progress), &charged(0.5)),
        State::GaveUp,
        NotCommanded,
    );
    let d = step((gave_up, progress), &charged(0.19));
    goes(&d, State::Tracking, BatteryDeck);
    let d = run(&d, &charged(0.19), 5.0);
    let d = run(&d, &charged(0.19), 5.0);
    goes(&d, State::Descent, alight_shared::msg::ReasonCode::Permitted);
}

/// A deck whose height another witness contradicts is approached no lower than both allow, and never followed down.
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
    // Committed it goes on.
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
