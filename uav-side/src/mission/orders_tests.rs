use alight_shared::msg::{
    AutopilotMode, CommandKind, KeptStation,
    ReasonCode::{
        CompletesLanding, DuringTakeOff, KnownByBeacon, NotInControl, OnDeck, StillArmed, TakeOffOff,
        VesselTooFar,
    },
    Station,
};
use nalgebra::Vector3;

use super::{
    concerns_tests::states,
    phase::{HoldCause, holding},
    situation::Deck,
    tests::*,
    *,
};

fn phases() -> Vec<MissionPhase> {
    let (s, c) = (fair(), config());
    let kept = KeptStation {
        station: Station::USUAL.of_approach(c.approach_height_m),
        until: at(600.0),
    };
    let more = [
        FREE_FLARE,
        MissionPhase::LANDED,
        holding(HoldCause::Station(kept), &s, &c),
    ];
    states().into_iter().map(|(phase, _)| phase).chain(more).collect()
}

const FLIGHTS: [ControlState; 7] = [
    ControlState::Unknown,
    ControlState::Disarmed,
    ControlState::OnGround,
    ControlState::OtherControl(AutopilotMode::Other),
    ControlState::OtherControl(AutopilotMode::Return),
    ControlState::SetPointsLost,
    ControlState::Ours,
];
const ORDERS: [CommandKind; 6] = [
    CommandKind::Land,
    CommandKind::Abort,
    CommandKind::Hold,
    CommandKind::TakeOff,
    CommandKind::Ready,
    CommandKind::Station(Station::USUAL),
];

/// Whether the order is fulfilled, provided that the drone is under our control.
fn is_done(order: CommandKind, before: &MissionProgress, d: &Decision, s: &Situation) -> bool {
    let state = d.phase.state();
    match order {
        CommandKind::Land => d.progress.landing || d.waiting.code == CompletesLanding,
        // Landing and take-off have ended with the drone under our control, or a waiting order has ended.
        CommandKind::Abort | CommandKind::Hold => {
            let landing = matches!(state.phase(), Phase::Follow | Phase::Landing) || state == State::Search;
            let stops = !landing || d.waiting.code == CompletesLanding;
            let anothers = matches!(
                s.flight,
                ControlState::OtherControl(_) | ControlState::SetPointsLost | ControlState::Unknown
            );
            let nothing = state == State::Idle && anothers && !before.landing && order == CommandKind::Hold;
            stops && !d.progress.landing && !nothing
        }
        CommandKind::TakeOff => state.is_take_off(),
        CommandKind::Ready => d.progress.cycles.ready,
        CommandKind::Station(_) => d.phase.station().is_some(),
    }
}

#[test]
fn every_order_in_every_state() {
    let mut wrong = Vec::new();
    for phase in phases() {
        for flight in FLIGHTS {
            for order in ORDERS {
                for takeoff in [false, true] {
                    let c = MissionConfig { takeoff, ..config() };
                    let s = with(|s| s.flight = flight);
                    let waits = phase.waits_for_operator() || phase.stands() || phase.takes_off();
                    let idles = matches!(phase, MissionPhase::Idle | MissionPhase::GaveUp { .. });
                    let rests = matches!(phase, MissionPhase::Landed { .. });
                    let progress = if waits || idles || rests {
                        MissionProgress::default()
                    } else {
                        wanted()
                    };
                    let d = decide(phase, progress, Some(order), &s, &c);
                    let rejected = d.progress.rejected.and_then(|r| r.shown(s.now));
                    let done = is_done(order, &progress, &d, &s);
                    if !done && rejected.is_none() {
                        wrong.push(format!(
                            "{order:?} in {:?}, {flight:?}: {:?}",
                            phase.state(),
                            d.phase
                        ));
                    }
                    if let Some(why) = rejected {
                        assert!(!why.to_string().is_empty());
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} answers: {}", wrong.len(), wrong.join("\n"));
}

#[test]
fn orders_that_are_rejected_with_their_reason() {
    type Case = (MissionPhase, ControlState, CommandKind, ReasonCode);
    let pilot = ControlState::OtherControl(AutopilotMode::Other);
    let spins = MissionPhase::SpinUp {
        since: at(9.0),
        armed: None,
    };
    let cases: [Case; 6] = [
        // The autopilot's own mission or a pilot flies the drone.
        (MissionPhase::Idle, pilot, CommandKind::Hold, NotInControl),
        (
            MissionPhase::Idle,
            ControlState::SetPointsLost,
            CommandKind::Hold,
            NotInControl,
        ),
        (
            MissionPhase::STANDS,
            ControlState::Disarmed,
            CommandKind::Land,
            OnDeck,
        ),
        (spins, ControlState::Disarmed, CommandKind::Land, DuringTakeOff),
        (
            MissionPhase::LANDED,
            ControlState::OnGround,
            CommandKind::TakeOff,
            StillArmed,
        ),
        (
            MissionPhase::STANDS,
            ControlState::Disarmed,
            CommandKind::TakeOff,
            TakeOffOff,
        ),
    ];
    for (phase, flight, order, why) in cases {
        let s = with(|s| s.flight = flight);
        let d = decide(phase, MissionProgress::default(), Some(order), &s, &config());
        let rejected = d.progress.rejected.and_then(|r| r.shown(s.now));
        assert_eq!(rejected.map(|r| r.code), Some(why), "{order:?} in {phase:?}");
    }
    let s = with(|s| s.flight = pilot);
    let d = decide(
        MissionPhase::Idle,
        wanted(),
        Some(CommandKind::Abort),
        &s,
        &config(),
    );
    assert!(d.progress.rejected.is_none() && !d.progress.landing);
}

/// A beacon that moves ahead of the drone leads it no further than the configured distance.
#[test]
fn beacon_that_leads_away() {
    let c = MissionConfig {
        beacon_max_way_m: 300.0,
        ..config()
    };
    let led = |north_m: f64| {
        with(|s| {
            s.own.as_mut().unwrap().position = Vector3::new(north_m, 0.0, -16.3);
            let deck = s.deck.as_mut().unwrap();
            (deck.radio_age_s, deck.vision_age_s) = (f64::INFINITY, f64::INFINITY);
            (deck.beacon, deck.distance_m) = (Some([5.0, 0.8]), 50.0);
        })
    };
    let begun = decide(MissionPhase::Idle, wanted(), None, &led(0.0), &c);
    goes(&begun, State::GetAltitude, KnownByBeacon);
    let mut d = begun;
    for north_m in [0.0, 100.0, 200.0, 299.0] {
        d = decide(d.phase, d.progress, None, &led(north_m), &c);
        assert_ne!(d.phase.state(), State::GaveUp, "{north_m}");
    }
    d = decide(d.phase, d.progress, None, &led(301.0), &c);
    goes(&d, State::GaveUp, VesselTooFar);
    // Even on low battery the drone does not follow the beacon further.
    let low = Situation {
        battery: Some(0.15),
        ..led(301.0)
    };
    d = decide(d.phase, d.progress, None, &low, &c);
    assert_ne!(
        d.progress.low_battery,
        Some(alight_shared::msg::BatteryPlace::Deck)
    );
    // A vessel that is received may lead the drone anywhere.
    let mut d = begun;
    for north_m in [0.0, 200.0, 400.0, 600.0] {
        let s = Situation {
            deck: led(north_m).deck.map(|deck| Deck {
                radio_age_s: 0.1,
                ..deck
            }),
            ..led(north_m)
        };
        d = decide(d.phase, d.progress, None, &s, &c);
        assert_ne!(d.phase.state(), State::GaveUp, "{north_m}");
    }
}
