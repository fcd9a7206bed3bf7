use alight_shared::msg::{
    AutopilotMode, BatteryPlace, CommandKind, OwnMission,
    ReasonCode::{
        ArmedAgain, ArmingRejected, BatteryHome, BatteryWaits, DoesNotRise, ForecastStale, HandOverRejected,
        HandsOver, HardContact, MissionDone, NoMoment, NotCleared, NotOnDeck, NotReady, Operator,
        OrderedBack, SeeksVessel, SortieBegins, SortiesDone, TakeOffTilted,
    },
};
use nalgebra::Vector2;

use super::{
    cycles::Cycles,
    situation::SilentVessel,
    take_off_tests::{permits, standing},
    tests::{at, with},
    *,
};
const LANDED: MissionPhase = MissionPhase::STANDS;

fn cycling() -> MissionProgress {
    MissionProgress {
        started: at(9.0),
        cycles: Cycles {
            on: true,
            sorties: 1,
            ..Cycles::default()
        },
        ..MissionProgress::default()
    }
}
fn step(
    phase: MissionPhase,
    progress: MissionProgress,
    command: Option<CommandKind>,
    s: &Situation,
) -> Decision {
    let c = MissionConfig {
        sorties_max: 3,
        ..permits()
    };
    decide(phase, progress, command, s, &c)
}
fn hold() -> MissionPhase {
    MissionPhase::Hold {
        cause: phase::HoldCause::Operator,
        at: nalgebra::Vector3::new(0.0, 0.0, -16.3),
        yaw: 0.0,
        fresh: None,
    }
}

#[test]
fn next_sortie_by_charge_or_by_order() {
    // The charge has been sufficient for 30 s.
    let d = step(LANDED, cycling(), None, &standing(|_| {}));
    assert_eq!((d.phase, d.waiting.code), (LANDED, NotReady));
    let later = standing(|s| s.now = at(39.0));
    assert_eq!(step(LANDED, d.progress, None, &later).waiting.code, NotReady);
    let later = standing(|s| s.now = at(41.0));
    let d = step(LANDED, d.progress, None, &later);
    assert_eq!(
        (d.phase, d.entered.unwrap().code),
        (MissionPhase::Preparing, SortieBegins)
    );
    assert_eq!((d.progress.started, d.progress.cycles.on), (at(41.0), true));
    // The order makes the drone ready once the crew has cleared the deck.
    let low = |s: &mut Situation| (s.battery, s.not_cleared) = (Some(0.5), Some(NotCleared.into()));
    let d = step(LANDED, cycling(), Some(CommandKind::Ready), &standing(low));
    assert_eq!(d.waiting.code, NotCleared);
    let cleared = standing(|s| s.battery = Some(0.5));
    let d = step(LANDED, d.progress, None, &cleared);
    assert_eq!(d.entered.unwrap().code, SortieBegins);
    let d = step(
        LANDED,
        MissionProgress::default(),
        Some(CommandKind::Ready),
        &standing(|_| {}),
    );
    assert_eq!(d.phase, LANDED);
    assert_eq!(d.progress.rejected.map(|order| order.why.code), Some(SortiesDone));
    let armed = standing(|s| s.flight = ControlState::OnGround);
    let d = step(LANDED, cycling(), Some(CommandKind::Ready), &armed);
    assert!(d.progress.rejected.is_some() && !d.progress.cycles.ready, "{d:?}");
}

#[test]
fn preparation_of_the_next_sortie() {
    let waits = |s: &Situation| {
        let d = step(MissionPhase::Preparing, cycling(), None, s);
        (
            d.phase.state(),
            d.entered.unwrap_or(d.waiting).code,
            d.progress.cycles.ended,
        )
    };
    let s = standing(|s| s.not_cleared = Some(NotCleared.into()));
    assert_eq!(waits(&s), (State::Landed, NotCleared, None));
    // The mission waits indefinitely for calmer waves, but not for permanent conditions.
    let steep = |s: &mut Situation| {
        s.now = at(500.0);
        s.leaving.lift_off.iter_mut().for_each(|m| m.now.along = 0.4);
    };
    assert_eq!(waits(&standing(steep)), (State::Preparing, TakeOffTilted, None));
    let slid = |s: &mut Situation| {
        s.now = at(500.0);
        s.deck.iter_mut().for_each(|d| d.distance_m = 6.0);
    };
    let (state, why, ended) = waits(&standing(slid));
    assert_eq!(
        (state, why, ended.unwrap().code),
        (State::Idle, NotOnDeck, NotOnDeck)
    );
}

#[test]
fn endings_of_unattended_cycles() {
    let away = ControlState::OtherControl(AutopilotMode::Other);
    let on_sortie = MissionProgress {
        sortie: true,
        ..cycling()
    };
    let third = MissionProgress {
        cycles: Cycles {
            sorties: 3,
            ..cycling().cycles
        },
        ..cycling()
    };
    let spins = MissionPhase::SpinUp {
        since: at(-1.0),
        armed: None,
    };
    let handed = MissionProgress {
        started: at(1.0),
        ..on_sortie
    };
    let leaves = MissionPhase::TakeOff {
        since: at(-1.0),
        left: false,
    };
    let abort = Some(CommandKind::Abort);
    let flight = |f: ControlState| standing(|s| s.flight = f);
    let hard = with(|s| (s.motors_stopped, s.hard_contact_mps) = (true, Some(2.0)));
    for (phase, progress, command, s, expected) in [
        (LANDED, cycling(), abort, standing(|_| {}), Operator),
        (
            MissionPhase::Preparing,
            cycling(),
            abort,
            standing(|_| {}),
            Operator,
        ),
        (MissionPhase::Idle, on_sortie, abort, flight(away), Operator),
        (
            LANDED,
            cycling(),
            None,
            flight(ControlState::OnGround),
            ArmedAgain,
        ),
        (LANDED, third, None, standing(|_| {}), SortiesDone),
        (MissionPhase::Idle, on_sortie, None, standing(|_| {}), NotOnDeck),
        (spins, cycling(), None, standing(|_| {}), ArmingRejected),
        (MissionPhase::DESCENT, on_sortie, None, hard, HardContact),
        (hold(), handed, None, with(|_| {}), HandOverRejected),
        (
            leaves,
            cycling(),
            None,
            flight(ControlState::OnGround),
            DoesNotRise,
        ),
    ] {
        let d = step(phase, progress, command, &s);
        let ended = d.progress.cycles.ended.map(|why| why.code);
        assert_eq!(
            (d.progress.cycles.on, ended),
            (false, Some(expected)),
            "{phase:?}"
        );
    }
    // The drone lands if its own mission does not start after the handover.
    let d = step(hold(), handed, None, &with(|_| {}));
    assert!(d.progress.landing && d.phase.state() == State::Hold);
    let soon = with(|s| s.now = at(3.0));
    assert_eq!(step(hold(), handed, None, &soon).waiting.code, HandsOver);
}

#[test]
fn unattended_cycles_without_a_moment() {
    let spins = MissionPhase::SpinUp {
        since: at(-1.0),
        armed: Some(at(0.0)),
    };
    let none = standing(|s| {
        s.flight = ControlState::OnGround;
        s.leaving.lift_off.iter_mut().for_each(|m| m.now.along = 0.4);
    });
    let mut progress = cycling();
    for tries in 1..=4 {
        let d = step(spins, progress, None, &none);
        assert_eq!(d.entered.unwrap().code, NoMoment);
        assert_eq!(d.progress.cycles.on, tries <= 3);
        progress = d.progress;
    }
}

#[test]
fn mission_restarted_while_it_hands_over() {
    let m = MissionCheckpoint {
        state: MissionState {
            state: State::Hold,
            sorties: [1, 3],
            ..MissionState::default()
        },
        started: at(1.0),
        sortie: true,
        cycling: true,
        ..MissionCheckpoint::default()
    };
    for (now_s, expected) in [(3.0, HandsOver), (10.0, HandOverRejected)] {
        let s = with(|s| s.now = at(now_s));
        let (phase, _) = checkpoint::restored(&m, true, &s, &permits());
        let d = step(phase, checkpoint::progress(&m), None, &s);
        assert_eq!(d.entered.unwrap_or(d.waiting).code, expected);
    }
}

/// A mission that starts long after its predecessor, or after a reboot, knows the purpose of the flight: a drone that
/// hovers 60 m away returns when its battery requires it. A disarmed drone is not on a sortie.
#[test]
fn purpose_of_an_aged_checkpoint() {
    let kept = |sortie, deck_declined| {
        let header = Header::new(1, 1, 5, 9, at(1.0));
        let m = MissionCheckpoint {
            header,
            state: MissionState {
                header,
                state: State::Hold,
                sorties: [2, 3],
                ..MissionState::default()
            },
            armed: true,
            sortie,
            deck_declined,
            cycling: true,
            ..MissionCheckpoint::default()
        };
        [Some(m), m.lasting()]
    };
    let flown = |checkpoint, armed| {
        let (drone, deck) = (DroneGeometry::default(), DeckGeometry::default());
        let mut m = MissionNode::new(&permits(), &drone, &deck, 1, 2).as_successor();
        for k in 0..130_u32 {
            let t = at(60.0 + 0.1 * f64::from(k));
            let mut input = super::node_tests::fresh_input(k, t, [60.0, 0.0, -16.3]);
            if let Some(a) = &mut input.autopilot {
                (a.armed, a.battery) = (armed, Some(if k < 60 { 0.9 } else { 0.25 }));
            }
            m.step(t, &MissionIn { checkpoint, ..input });
        }
        m
    };
    for checkpoint in kept(true, false) {
        let m = flown(checkpoint, true);
        assert!(m.progress.sortie && m.progress.landing, "{:?}", m.phase);
        let cycles = m.progress.cycles;
        let ended = cycles.ended.map(|why| why.code);
        assert_eq!(
            (cycles.on, cycles.sorties, ended),
            (false, 2, Some(ReasonCode::Restarted))
        );
        assert!(!flown(checkpoint, false).progress.sortie);
    }
    for checkpoint in kept(false, false).into_iter().chain(kept(true, true)) {
        assert_eq!(flown(checkpoint, true).phase, MissionPhase::Idle);
    }
}

#[test]
fn sortie_that_ends_by_its_mission_or_an_order() {
    let on_sortie = MissionProgress {
        sortie: true,
        ..cycling()
    };
    let flown = |own_mission| {
        with(|s| {
            s.flight = ControlState::OtherControl(AutopilotMode::Other);
            s.sortie.own_mission = own_mission;
        })
    };
    let d = step(MissionPhase::Idle, on_sortie, None, &flown(OwnMission::Done));
    assert_eq!((d.entered.unwrap().code, d.progress.landing), (MissionDone, true));
    let d = step(MissionPhase::Idle, d.progress, None, &flown(OwnMission::Done));
    assert_eq!(d.waiting.code, MissionDone);
    // A pilot has control, so Alight does not request control.
    let d = step(MissionPhase::Idle, d.progress, None, &flown(OwnMission::None));
    assert_eq!(d.waiting.code, ReasonCode::NotFlying);
    // A drone that is not on a sortie does not return.
    let d = step(
        MissionPhase::Idle,
        MissionProgress::default(),
        None,
        &flown(OwnMission::Done),
    );
    assert_eq!((d.entered, d.progress.landing), (None, false));
    // In cycles an order ends the autopilot's own mission; in a single sortie the pilot selects the mode.
    let land = Some(CommandKind::Land);
    for (progress, expected) in [
        (on_sortie, OrderedBack),
        (
            MissionProgress {
                cycles: Cycles::default(),
                ..on_sortie
            },
            ReasonCode::NotFlying,
        ),
    ] {
        let d = step(MissionPhase::Idle, progress, land, &flown(OwnMission::Flies));
        assert_eq!(d.waiting.code, expected);
    }
}

#[test]
fn way_to_a_vessel_that_is_not_received() {
    let seeks = SilentVessel {
        offset: Vector2::new(600.0, -200.0),
        silent_s: 90.0,
    };
    let silent = |change: fn(&mut Situation)| {
        let mut s = with(|s| {
            (s.forecast_age_s, s.sortie.seeks) = (90.0, Some(seeks));
            s.sortie.turns_back = Some(Reason::new(ReasonCode::TurnsBack, 0.3, 0.31));
        });
        change(&mut s);
        s
    };
    let called = MissionProgress {
        sortie: true,
        landing: true,
        started: at(9.0),
        ..MissionProgress::default()
    };
    let others = silent(|s| s.flight = ControlState::OtherControl(AutopilotMode::Other));
    assert_eq!(
        step(MissionPhase::Idle, called, None, &others).waiting.code,
        ReasonCode::TurnsBack
    );
    for phase in [MissionPhase::Idle, hold()] {
        let d = step(phase, called, None, &silent(|_| {}));
        assert_eq!(
            (d.phase, d.entered.unwrap().code),
            (MissionPhase::Seek, SeeksVessel)
        );
    }
    // Flies towards the place at the approach height.
    let place = Waypoint::of(MissionPhase::Seek, &silent(|_| {}), &permits());
    assert!((place.at - nalgebra::Vector3::new(600.0, -200.0, -16.3)).norm() < 1e-9);
    assert!((place.yaw - (-200.0_f64).atan2(600.0)).abs() < 1e-9);
    // Without reception the drone seeks the vessel until the last moment for home; with reception it lands as usual.
    let d = step(MissionPhase::Seek, called, None, &silent(|_| {}));
    assert_eq!((d.phase, d.waiting.code), (MissionPhase::Seek, SeeksVessel));
    let d = step(
        MissionPhase::Seek,
        called,
        None,
        &silent(|s| s.battery = Some(0.19)),
    );
    assert_eq!(
        (d.phase, d.entered.unwrap().code),
        (MissionPhase::Seek, BatteryWaits)
    );
    let last = silent(|s| (s.battery, s.now) = (Some(0.06), at(40.0)));
    let d = step(d.phase, d.progress, None, &last);
    assert_eq!(
        (d.entered.unwrap().code, d.progress.low_battery),
        (BatteryHome, Some(BatteryPlace::Home))
    );
    let d = step(MissionPhase::Seek, called, None, &with(|_| {}));
    assert_eq!(d.phase.state(), State::GetAltitude);
    // A drone that is not on a sortie seeks a vessel only if it is near enough and the charge requires it.
    let stays = MissionProgress {
        sortie: false,
        ..called
    };
    let lasts = silent(|s| s.sortie.turns_back = None);
    let d = step(MissionPhase::Idle, stays, None, &lasts);
    assert_eq!(d.waiting.code, ForecastStale);
    let d = step(MissionPhase::Idle, stays, None, &silent(|_| {}));
    assert_eq!(d.phase, MissionPhase::Seek);
    let far = silent(|s| s.sortie.seeks.iter_mut().for_each(|k| k.offset.x = 6e3));
    assert_eq!(
        step(MissionPhase::Idle, called, None, &far).waiting.code,
        ForecastStale
    );
}
