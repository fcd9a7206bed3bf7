use alight_shared::msg::{
    AutopilotMode, BatteryPlace, CommandKind, DECK_CLOSED, OwnMission,
    ReasonCode::{
        BatteryDeck, BatteryHere, BatteryHome, BatteryLow, BatteryRecovered, BatteryStopped, BatteryWaits,
        Commanded, DeckGrantStale, NotCommanded, Operator, Permitted, Recovered,
    },
};
use nalgebra::Vector2;
use proptest::prelude::*;

use BatteryPlace::{Deck, Here, Home};

use super::{
    charge::urgency,
    phase::{HoldCause, holding},
    reservation::Reservation,
    situation::Charges,
    tests::*,
    *,
};

fn charged(battery: f64) -> Situation {
    with(|s| s.battery = Some(battery))
}
const MISSING: [fn(&mut Situation); 5] = [
    |s| s.reservation = Reservation::Others(DECK_CLOSED),
    |s| s.reservation = Reservation::Others(2),
    |s| s.forecast_age_s = 2.5,
    |s| s.odometry_age_s = 2.0,
    |s| s.deck.as_mut().unwrap().tilt_rad = 0.8,
];
fn without_deck(battery: f64, missing: fn(&mut Situation)) -> Situation {
    let mut s = charged(battery);
    missing(&mut s);
    s
}

/// For each charge, cause and phase the drone waits while it can reach another place or has charge for the deck, and it
/// lands on the deck once that is available again.
#[test]
fn deck_that_is_missing_for_a_moment() {
    let hold = holding(HoldCause::Data, &fair(), &config());
    let station = holding(HoldCause::Operator, &fair(), &config());
    for missing in MISSING {
        for phase in [
            hold,
            station,
            MissionPhase::APPROACH,
            TRACKING,
            MissionPhase::TrackingStable,
        ] {
            for battery in [0.19, 0.13, 0.05] {
                let mut s = without_deck(battery, missing);
                let mut d = step(phase, &s);
                for _ in 0..600 {
                    s.now += Span::from_millis(10);
                    d = step(&d, &s);
                    let waits = d.progress.low_battery == Some(Deck) && d.progress.landing;
                    assert!(waits, "{phase:?} at {battery}: {d:?}");
                    assert_ne!(d.phase.state(), State::GaveUp);
                }
                s = Situation {
                    now: s.now,
                    ..charged(battery)
                };
                for _ in 0..300 {
                    s.now += Span::from_millis(10);
                    d = step(&d, &s);
                }
                assert_eq!(d.phase.state(), State::Descent, "{phase:?} at {battery}: {d:?}");
            }
        }
    }
}

/// After a long time without the deck the drone leaves at the last moment for the next place.
#[test]
fn last_moment_for_the_next_place() {
    for missing in MISSING {
        let after = |d: &Decision, secs: f64, battery: f64| {
            let mut s = without_deck(battery, missing);
            s.now += Span::from_secs(secs);
            step(d, &s)
        };
        let first = step(TRACKING, &without_deck(0.13, missing));
        let waits = |d: &Decision| d.progress.low_battery == Some(Deck) && d.progress.landing;
        assert!(waits(&after(&first, 0.1, 0.055)), "not missing for long");
        assert!(waits(&after(&first, 21.0, 0.061)), "home is still in reach");
        let d = after(&first, 21.0, 0.06);
        goes(&d, State::GaveUp, BatteryHome);
        let text = d.entered.unwrap().to_string();
        assert_eq!(text, "battery at 6 % (needs 6 %): the autopilot returns home");
        // If home is out of reach, the drone waits for the deck while it can still land in place.
        let d = after(&first, 21.0, 0.039);
        assert!(waits(&d));
        assert!(
            waits(&after(&first, 1.0, 0.029)),
            "the margin is used to wait for the deck"
        );
        goes(&after(&first, 1.0, 0.015), State::GaveUp, BatteryHere);
        let d = after(&d, 21.0, 0.03);
        goes(&d, State::GaveUp, BatteryHere);
        // The deck reopens before the autopilot has taken over.
        goes(&step(&d, &charged(0.03)), State::Tracking, BatteryDeck);
    }
    let d = step(TRACKING, &without_deck(0.13, MISSING[0]));
    let text = d.entered.unwrap().to_string();
    assert_eq!(
        text,
        "battery at 13 %: waits for the deck until 6 %, which the next place needs"
    );
    goes(&step(TRACKING, &charged(0.01)), State::Tracking, BatteryDeck);
}

/// A place that costs the drone is left for only with the last charge for a descent, and with a known power.
#[test]
fn home_that_is_the_sea_and_unknown_power() {
    for (sea, known, battery, resort, place) in [
        (false, true, 0.06, Home, Home),
        (true, true, 0.06, Here, Deck),
        (true, true, 0.03, Here, Here),
        (false, false, 0.06, Home, Deck),
        (true, false, 0.01, Here, Deck),
    ] {
        let mut s = without_deck(battery, MISSING[0]);
        (s.charges.home_is_sea, s.charges.known) = (sea, known);
        assert_eq!(charge::last_resort(&s, &config()).map(|l| l.place), Some(resort));
        let first = step(TRACKING, &s);
        s.now += Span::from_secs(21.0);
        let d = step(&first, &s);
        assert_eq!(d.progress.low_battery, Some(place), "{sea} {known} {battery}");
    }
}

/// The autopilot flies home. Only a drone that Alight has sent away is taken back, to a free deck in reach.
#[test]
fn drone_sent_away_from_a_deck_that_is_free_again() {
    let away = |change: fn(&mut Situation)| {
        let mut s = charged(0.05);
        s.flight = ControlState::OtherControl(AutopilotMode::Return);
        s.sortie.own_mission = OwnMission::SentAway;
        change(&mut s);
        s
    };
    let idle = |deck_declined| {
        let progress = MissionProgress {
            deck_declined,
            ..MissionProgress::default()
        };
        (MissionPhase::Idle, progress)
    };
    let back = step(idle(false), &away(|_| {}));
    waits(&back, State::Idle, BatteryDeck);
    goes(&step(&back, &charged(0.05)), State::Tracking, BatteryDeck);
    waits(&step(idle(true), &away(|_| {})), State::Idle, NotCommanded);
    let reasons: [fn(&mut Situation); 4] = [
        |s| s.reservation = Reservation::Others(DECK_CLOSED),
        |s| s.rejection = Some(ReasonCode::SwitchAborts.into()),
        |s| s.battery = Some(0.02),
        |s| s.sortie.own_mission = OwnMission::None,
    ];
    for reason in reasons {
        waits(&step(idle(false), &away(reason)), State::Idle, NotCommanded);
    }
}

#[test]
fn configured_order_of_places() {
    let closed = |battery| without_deck(battery, MISSING[0]);
    for (order, at_19, at_1) in [
        (vec![Deck, Home, Here], (Some(Deck), BatteryWaits), Some(Here)),
        (vec![Home, Deck, Here], (Some(Home), BatteryHome), Some(Here)),
        (vec![Here, Deck, Home], (Some(Here), BatteryHere), Some(Here)),
        (vec![Deck], (Some(Deck), BatteryWaits), Some(Deck)),
        (vec![], (None, BatteryLow), None),
    ] {
        let c = MissionConfig {
            battery_order: order,
            ..config()
        };
        let d = decide(MissionPhase::APPROACH, wanted(), None, &closed(0.19), &c);
        assert_eq!((d.progress.low_battery, d.entered.unwrap().code), at_19);
        let d = decide(d.phase, d.progress, None, &closed(0.01), &c);
        assert_eq!(d.progress.low_battery, at_1);
        let d = decide(DESCENT, attempt(), None, &charged(0.1), &c);
        assert_eq!(d.phase.state(), State::Descent);
    }
    // An order below the reserve makes the deck the first choice.
    let c = MissionConfig {
        battery_order: vec![Home, Deck],
        ..config()
    };
    let idle = (MissionPhase::Idle, MissionProgress::default());
    let d = decide(idle.0, idle.1, Some(CommandKind::Land), &charged(0.15), &c);
    assert_eq!((d.progress.low_battery, d.progress.landing), (Some(Deck), true));
    let d = decide(
        d.phase,
        MissionProgress {
            deck_first: false,
            ..d.progress
        },
        None,
        &charged(0.15),
        &c,
    );
    goes(&d, State::GaveUp, BatteryHome);
}

#[test]
fn charge_above_the_reserve_again() {
    let closed = without_deck(0.015, MISSING[0]);
    let d = step(TRACKING, &closed);
    goes(&d, State::GaveUp, BatteryHere);
    let d = step(&d, &charged(0.6));
    goes(&d, State::Hold, BatteryRecovered);
    assert_eq!(d.progress.low_battery, None);
    goes(&run(&d, &charged(0.6), 1.0), State::Tracking, Recovered);
    let d = step(TRACKING, &charged(0.1));
    assert_eq!(step(&d, &charged(0.6)).progress.low_battery, None);
}

/// In the first half of the reserve the drone waits for the best moment; later the limits are relaxed.
#[test]
fn low_battery_limits_above_the_deck() {
    let rough = |battery: f64| {
        with(|s| {
            s.battery = Some(battery);
            (s.odds.as_mut().unwrap().slides, s.deck.as_mut().unwrap().tilt_rad) = (0.2, 0.5);
        })
    };
    for battery in [0.9, 0.19, 0.14] {
        let d = run(TRACKING, &rough(battery), 5.0);
        let d = run(&d, &rough(battery), 5.0);
        let d = run(&d, &rough(battery), 5.0);
        assert_eq!(d.phase.state(), State::TrackingStable, "{battery}");
    }
    let urgent = MissionProgress {
        low_battery: Some(Deck),
        ..wanted()
    };
    let of = |battery| urgency(&urgent, &charged(battery), &config());
    assert_eq!([0.2, 0.13, 0.06, 0.01].map(of), [0.0, 0.0, 1.0, 1.0]);
    assert!((of(0.095) - 0.5).abs() < 1e-9);
    for phase in [MissionPhase::APPROACH, TRACKING, MissionPhase::TrackingStable] {
        let d = step(phase, &rough(0.07));
        goes(&d, State::Tracking, BatteryDeck);
        let d = run(&d, &rough(0.07), 5.0);
        goes(&run(&d, &rough(0.07), 5.0), State::Descent, Permitted);
    }
    let silent = |battery| Situation {
        reservation: Reservation::Unknown(5.0),
        ..charged(battery)
    };
    let d = run(TRACKING, &silent(0.1), 5.0);
    let d = run(&d, &silent(0.1), 5.0);
    goes(&run(&d, &silent(0.1), 5.0), State::Descent, Permitted);
    let full = step(MissionPhase::TrackingStable, &silent(0.9));
    waits(&full, State::TrackingStable, DeckGrantStale);
}

/// After an abort or a hold the operator may decide until a quarter of the reserve is used; then the drone lands. A
/// second abort declines the deck.
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
        assert!(d.progress.landing && !d.progress.stopped);
        let d = commanded(&d, command, &charged(0.14));
        goes(&d, state, Operator);
        goes(&step(&d, &charged(0.14)), State::GaveUp, BatteryHome);
    }
}

/// After giving up a landing, or without an order, a drone does not stay in the air until its battery is empty.
#[test]
fn low_battery_of_a_drone_that_waits() {
    let spent = MissionProgress {
        attempts: config().max_attempts,
        ..MissionProgress::default()
    };
    let gave_up = phase::gave_up(&fair(), &config());
    let stopped = MissionProgress {
        stopped: true,
        ..MissionProgress::default()
    };
    for (phase, progress, low) in [
        (gave_up, spent, 0.19),
        (MissionPhase::Idle, MissionProgress::default(), 0.19),
        (MissionPhase::Idle, stopped, 0.14),
    ] {
        let rests = step((phase, progress), &charged(low + 0.01));
        assert_eq!(rests.phase.state(), phase.state());
        let d = step(&rests, &charged(low));
        goes(&d, State::Tracking, BatteryDeck);
        let d = run(&d, &charged(low), 5.0);
        goes(&run(&d, &charged(low), 5.0), State::Descent, Permitted);
    }
    let unordered = (MissionPhase::Idle, MissionProgress::default());
    for change in [
        (|s| s.flight = ControlState::OtherControl(AutopilotMode::Other)) as fn(&mut Situation),
        |s| s.flight = ControlState::Disarmed,
        |s| s.flight = ControlState::OnGround,
        |s| s.rejection = Some(ReasonCode::SwitchAborts.into()),
    ] {
        let s = without_deck(0.1, change);
        waits(&step(unordered, &s), State::Idle, NotCommanded);
    }
}

#[test]
fn order_to_land_below_the_reserve() {
    let closed = |battery| without_deck(battery, MISSING[1]);
    let d = step(MissionPhase::APPROACH, &closed(0.1));
    let d = commanded(&d, CommandKind::Land, &charged(0.1));
    assert!(d.progress.landing);
    let gave_up = (phase::gave_up(&fair(), &config()), MissionProgress::default());
    let d = commanded(gave_up, CommandKind::Land, &charged(0.1));
    goes(&d, State::Hold, Commanded);
    assert!(d.progress.deck_first);
}

#[test]
fn charge_of_a_way_home() {
    let c = config();
    let of = |home: Option<[f64; 2]>, wind: [f64; 2]| {
        let deck = Some(Vector2::new(3.0, 0.0));
        Charges::of(1e-3, home.map(Vector2::from), deck, wind.into(), 14.0, &c)
    };
    let beneath = of(Some([3.0, 4.0]), [0.0; 2]);
    let [calm, against, unknown] = [
        of(Some([300.0, 0.0]), [0.0; 2]),
        of(Some([300.0, 0.0]), [-2.0, 0.0]),
        of(None, [0.0; 2]),
    ];
    assert!(
        (calm.home - 0.01 - 1.25e-3 * (60.0 + 30.0)).abs() < 1e-9,
        "{calm:?}"
    );
    assert!(
        (against.home - 0.01 - 1.25e-3 * (100.0 + 30.0)).abs() < 1e-9,
        "{against:?}"
    );
    assert!(
        (unknown.home - 0.5 * c.battery_reserve).abs() < 1e-9,
        "{unknown:?}"
    );
    assert!(beneath.home_is_sea && !calm.home_is_sea && !unknown.home_is_sea);
    assert!((calm.here - 0.01 - 1.25e-3 * 30.0).abs() < 1e-9 && (calm.attempt - 0.03).abs() < 1e-9);
}

proptest! {
    #[test]
    fn urgency_grows_as_the_charge_falls(
        b in 0.0..0.3_f64, less in 0.0..0.3_f64, home in 0.0..0.5_f64, attempt in 0.0..0.2_f64,
    ) {
        let urgent = MissionProgress { low_battery: Some(Deck), ..wanted() };
        let of = |b: f64| {
            let s = with(|s| {
                s.battery = Some(b.max(0.0));
                (s.charges.home, s.charges.attempt) = (home, attempt);
            });
            urgency(&urgent, &s, &config())
        };
        // If home is out of reach, the drone has more charge for the deck.
        let reach = (home - 0.01) / 1.25;
        let home_lost = b >= reach && b - less < reach;
        prop_assert!(home_lost || of(b - less) >= of(b) - 1e-12);
    }
}
