use alight_shared::msg::{
    AutopilotMode, CommandKind,
    ReasonCode::{
        BatteryDeck, BatteryLow, Commanded, ForecastStale, NoPlace, NoVessel, NotFlying, OnStation, Operator,
        StationNotNow, StationOver, StationTaken, StationTooLow, StationTooNear, TurnsBack, VesselTooFar,
    },
    Station,
};
use nalgebra::Vector3;

use super::{
    phase::{HoldCause, gave_up, holding},
    reservation::Reservation,
    situation::OwnState,
    tests::{COMMITTED, DESCENT, TRACKING, at, commanded, config, step, waits, with},
    *,
};

const ABEAM: Station = Station {
    ahead_m: 0,
    right_m: 20,
    height_m: 15,
    for_min: 10,
};
const ORDER: CommandKind = CommandKind::Station(ABEAM);

/// Drone above its vessel, which heads east.
fn flying(change: impl FnOnce(&mut Situation)) -> Situation {
    with(|s| {
        if let Some(deck) = &mut s.deck {
            deck.heading_rad = core::f64::consts::FRAC_PI_2;
        }
        change(s);
    })
}
fn radio_age(s: &mut Situation, age_s: f64) {
    if let Some(deck) = &mut s.deck {
        (deck.radio_age_s, deck.vision_age_s) = (age_s, 1e3);
    }
}
fn decided(phase: MissionPhase, command: Option<CommandKind>, s: &Situation) -> Decision {
    let shared = MissionConfig {
        reservation_required: true,
        ..config()
    };
    decide(phase, MissionProgress::default(), command, s, &shared)
}
fn on_station() -> Decision {
    let d = commanded(TRACKING, ORDER, &flying(|_| ()));
    assert_eq!(d.entered.map(|why| why.code), Some(OnStation));
    d
}

#[test]
fn station_is_taken_in_the_air() {
    let hold = holding(HoldCause::Data, &flying(|_| ()), &config());
    let gave_up = gave_up(&flying(|_| ()), &config());
    for phase in [
        MissionPhase::Idle,
        TRACKING,
        hold,
        gave_up,
        MissionPhase::APPROACH,
    ] {
        let d = commanded(phase, ORDER, &flying(|_| ()));
        let kept = d.phase.station().unwrap();
        assert_eq!(kept.station, ABEAM, "{phase:?}");
        let usual = commanded(phase, CommandKind::Station(Station::USUAL), &flying(|_| ()));
        assert_eq!(usual.phase.station().map(|kept| kept.station), Some(ABEAM));
        assert_eq!((kept.until - flying(|_| ()).now).secs(), 600.0);
        assert!(!d.progress.landing && !d.progress.stopped, "{phase:?}");
        waits(&step(&d, &flying(|_| ())), State::Hold, OnStation);
    }
}

#[test]
fn station_in_the_frame_of_the_heading() {
    let d = on_station();
    let place = Waypoint::of(d.phase, &flying(|_| ()), &config());
    assert!(place.with_deck && place.offset.is_none(), "{place:?}");
    let high = |s: &mut Situation| s.own.as_mut().unwrap().position.z = -16.3;
    // Starboard of a vessel that heads east is south; the path there leads around the vessel.
    let abeam = flying(|s| {
        high(s);
        let deck = s.deck.as_mut().unwrap();
        (deck.distance_m, deck.bearing_rad) = (20.0, 0.0);
    });
    let place = Waypoint::of(d.phase, &abeam, &config());
    let [north, east] = place.offset.unwrap();
    assert!((north + 20.0).abs() < 1e-9 && east.abs() < 1e-9, "{place:?}");
    assert!(!place.with_deck && place.height_m == 15.0, "{place:?}");
    assert!(
        step(&d, &abeam).waiting.limit < 0.1,
        "{}",
        step(&d, &abeam).waiting
    );
}

#[test]
fn station_rejected_with_its_reason() {
    type Case = (MissionPhase, Station, fn(&mut Situation), ReasonCode);
    let low = Station {
        height_m: 14,
        ..ABEAM
    };
    let near = Station { right_m: 14, ..ABEAM };
    let cases: [Case; 12] = [
        (
            MissionPhase::Idle,
            ABEAM,
            |s| s.flight = ControlState::Disarmed,
            NotFlying,
        ),
        (DESCENT, ABEAM, |_| (), StationNotNow),
        (COMMITTED, ABEAM, |_| (), StationNotNow),
        (MissionPhase::LANDED, ABEAM, |_| (), StationNotNow),
        (MissionPhase::Preparing, ABEAM, |_| (), StationNotNow),
        (MissionPhase::Seek, ABEAM, |_| (), StationNotNow),
        (TRACKING, low, |_| (), StationTooLow),
        (
            TRACKING,
            near,
            |s| s.reservation = Reservation::Others(2),
            StationTooNear,
        ),
        (
            TRACKING,
            ABEAM,
            |s| s.others = [0, 0, 0, 0, 0, 0, 0, 2],
            StationTaken,
        ),
        (TRACKING, ABEAM, |s| s.battery = Some(0.1), BatteryLow),
        (TRACKING, ABEAM, |s| radio_age(s, 2.0), NoVessel),
        (TRACKING, ABEAM, |s| radio_age(s, f64::NAN), NoVessel),
    ];
    for (phase, station, change, why) in cases {
        let mut s = flying(change);
        // The eighth place is at 71 m, the first at 15 m.
        s.others.reverse();
        let order = CommandKind::Station(station);
        let d = decided(phase, Some(order), &s);
        assert!(d.phase.station().is_none(), "{phase:?}, {why:?}");
        let rejected = d.progress.rejected.and_then(|order| order.shown(s.now));
        assert_eq!(rejected.map(|r| r.code), Some(why), "{phase:?}");
        // The autopilot link acts on the waiting reason (it arms), so the order must not change that reason.
        let without = decided(phase, None, &s);
        assert_eq!(
            (d.phase.state(), d.waiting),
            (without.phase.state(), without.waiting)
        );
    }
}

/// The vessel's grant decides on the first owner of the station; the other drone returns to its own height.
#[test]
fn station_of_another_drone() {
    let order = |height_m| CommandKind::Station(Station { height_m, ..ABEAM });
    let place = alight_shared::msg::WaitingPlace::of(1);
    let flies = |other_m| {
        flying(|s| {
            (s.place, s.reservation) = (Some(place), Reservation::Others(0));
            (s.others[0], s.other_stations_m[0]) = (2, other_m);
        })
    };
    for (other_m, height_m, taken) in [(30, 30, true), (34, 30, true), (35, 30, false), (0, 30, false)] {
        let d = decided(TRACKING, Some(order(height_m)), &flies(other_m));
        let why = d.progress.rejected.map(|order| order.why.code);
        assert_eq!(why, taken.then_some(StationTaken), "{other_m} m, {height_m} m");
        assert_eq!(d.phase.station().is_none(), taken);
    }
    // Both drones were ordered to the station before either knew of the other.
    let high = |other_m| Situation {
        own: flies(other_m).own.map(|own| OwnState {
            position: Vector3::new(0.0, 20.0, -31.3),
            ..own
        }),
        ..flies(other_m)
    };
    let kept = decided(TRACKING, Some(order(30)), &high(0));
    for command in [None, Some(CommandKind::Hold), Some(CommandKind::Abort)] {
        let other_m = if command.is_none() { 30 } else { 0 };
        let d = decided(kept.phase, command, &high(other_m));
        assert_eq!(d.phase.station(), None);
        let (MissionPhase::Hold { at, .. } | MissionPhase::GaveUp { at, .. }) = d.phase else {
            panic!("{:?}", d.phase);
        };
        let height_m = high(0).mean_deck_z.unwrap() - at.z;
        assert!((height_m - 23.0).abs() < 1e-9, "{command:?}: {height_m} m");
    }
    let none = Situation {
        place: None,
        ..flies(0)
    };
    let d = decided(TRACKING, Some(order(30)), &none);
    assert_eq!(d.progress.rejected.map(|order| order.why.code), Some(NoPlace));
}

#[test]
fn rejection_is_shown_and_forgotten() {
    let low = CommandKind::Station(Station { height_m: 5, ..ABEAM });
    let hold = holding(HoldCause::Operator, &flying(|_| ()), &config());
    let d = decided(hold, Some(low), &flying(|_| ()));
    let shown = |d: &Decision, s: &Situation| d.progress.rejected.and_then(|order| order.shown(s.now));
    assert_eq!(d.phase.station(), None);
    assert_eq!(
        shown(&d, &flying(|_| ())).map(|why| why.code),
        Some(StationTooLow)
    );
    let without = decided(hold, None, &flying(|_| ()));
    assert_eq!(d.waiting, without.waiting);
    let later = flying(|s| s.now += Span::from_secs(16.0));
    assert_eq!(shown(&step(&d, &later), &later), None);
    let again = commanded(&d, CommandKind::Hold, &flying(|_| ()));
    assert_eq!(again.progress.rejected, None);
}

#[test]
fn own_deck_may_be_kept_from_above() {
    let above = CommandKind::Station(Station { right_m: 0, ..ABEAM });
    let d = commanded(TRACKING, above, &flying(|_| ()));
    assert!(d.phase.station().is_some());
    // The drone leaves the station when it loses the deck's reservation.
    let d = step(&d, &flying(|s| s.reservation = Reservation::Others(2)));
    assert_eq!(d.entered.map(|why| why.code), Some(StationTooNear));
}

#[test]
fn station_ended_by_time_vessel_or_mode() {
    type Case = (fn(&mut Situation), Option<ReasonCode>);
    let cases: [Case; 5] = [
        (|s| s.now += Span::from_secs(599.0), None),
        (|s| s.now += Span::from_secs(601.0), Some(StationOver)),
        (|s| radio_age(s, 4.9), None),
        (|s| s.forecast_age_s = 1.0, None),
        (
            |s| s.deck.as_mut().unwrap().distance_m = 6000.0,
            Some(VesselTooFar),
        ),
    ];
    for (change, ends) in cases {
        let d = step(&on_station(), &flying(change));
        assert_eq!(d.entered.map(|why| why.code), ends);
        assert_eq!(d.phase.station().is_none(), ends.is_some());
        assert_eq!(d.phase.state(), State::Hold);
    }
    let stale = step(&on_station(), &flying(|s| s.forecast_age_s = 1.0));
    assert_eq!(stale.waiting.code, ForecastStale);
    let taken = flying(|s| s.flight = ControlState::OtherControl(AutopilotMode::Other));
    assert_eq!(step(&on_station(), &taken).phase, MissionPhase::Idle);
}

/// Without the vessel the drone stays over ground, and continues once the vessel is received again.
#[test]
fn station_after_a_silence() {
    let high = |s: &mut Situation| {
        s.own.as_mut().unwrap().position = Vector3::new(-20.0, 0.0, -16.3);
        let deck = s.deck.as_mut().unwrap();
        (deck.distance_m, deck.bearing_rad) = (20.0, 0.0);
    };
    let offset = |d: &Decision, s: &Situation| Waypoint::of(d.phase, s, &config()).offset;
    let mut d = step(&on_station(), &flying(high));
    assert!(offset(&d, &flying(high)).is_some());
    let silences: [fn(&mut Situation); 2] = [|s| radio_age(s, 8.0), |s| s.forecast_age_s = 6.0];
    for silence in silences {
        let silent = flying(|s| {
            high(s);
            silence(s);
        });
        d = step(&d, &silent);
        assert!(d.phase.station().is_some() && d.entered.is_none());
        assert_eq!((d.waiting.code, offset(&d, &silent)), (NoVessel, None));
        let place = Waypoint::of(d.phase, &silent, &config());
        assert!((place.at.x + 20.0).abs() < 1e-9 && !place.with_deck, "{place:?}");
        let back = flying(|s| {
            high(s);
            s.deck.as_mut().unwrap().distance_m = 490.0;
        });
        d = step(&d, &back);
        assert_eq!(d.waiting.code, OnStation);
        assert!(offset(&d, &back).is_some() && d.waiting.limit > 450.0);
    }
}

#[test]
fn station_ended_by_an_order() {
    let s = flying(|_| ());
    let lands = commanded(&on_station(), CommandKind::Land, &s);
    assert_eq!(lands.entered.map(|why| why.code), Some(Commanded));
    assert!(lands.progress.landing && lands.phase.station().is_none());
    for (order, state) in [
        (CommandKind::Hold, State::Hold),
        (CommandKind::Abort, State::GaveUp),
    ] {
        let d = commanded(&on_station(), order, &s);
        assert_eq!(d.entered.map(|why| why.code), Some(Operator));
        assert_eq!((d.phase.state(), d.phase.station()), (state, None));
    }
    let other = Station {
        right_m: -30,
        ..ABEAM
    };
    let d = commanded(&on_station(), CommandKind::Station(other), &s);
    assert_eq!(d.phase.station().map(|kept| kept.station), Some(other));
    let low = CommandKind::Station(Station { height_m: 3, ..ABEAM });
    let d = commanded(&on_station(), low, &s);
    assert_eq!(
        (d.phase.station().map(|kept| kept.station), d.entered),
        (Some(ABEAM), None)
    );
}

#[test]
fn station_ended_by_the_battery() {
    let mut d = on_station();
    d.progress.sortie = true;
    let called = flying(|s| s.sortie.turns_back = Some(TurnsBack.into()));
    let d = step(&d, &called);
    assert_eq!(d.entered.map(|why| why.code), Some(TurnsBack));
    assert!(d.progress.landing && d.phase.station().is_none());
    let low = flying(|s| s.battery = Some(0.9 * s.battery_reserve));
    let d = step(&on_station(), &low);
    assert_eq!(d.entered.map(|why| why.code), Some(BatteryDeck));
    assert!(d.progress.landing && d.phase.station().is_none());
}

#[test]
fn station_outlives_the_process() {
    let kept = on_station().phase.station();
    let m = MissionCheckpoint {
        state: MissionState {
            state: State::Hold,
            station: kept,
            hold_position: Vector3::new(1.0, 2.0, -16.3).into(),
            ..MissionState::default()
        },
        ..MissionCheckpoint::default()
    };
    for same_frame in [true, false] {
        let s = flying(|s| s.now = at(10.0));
        let (phase, _) = checkpoint::restored(&m, same_frame, &s, &config());
        assert_eq!(phase.station(), kept);
    }
}
