use alight_shared::msg::AutopilotMode;
use nalgebra::Vector3;

use super::{
    concerns::{AFTER_ORDERS, BEFORE_ORDERS},
    phase::{HoldCause, Search},
    situation::Deck,
    tests::*,
    *,
};

pub(super) fn states() -> Vec<(MissionPhase, MissionProgress)> {
    let (at, yaw) = (Vector3::new(0.0, 0.0, -16.3), 0.0);
    let hold = |cause| MissionPhase::Hold {
        cause,
        at,
        yaw,
        fresh: None,
    };
    let since = super::tests::at(9.5);
    let none = MissionProgress::default();
    let sortie = MissionProgress { sortie: true, ..none };
    vec![
        (
            MissionPhase::Idle,
            MissionProgress {
                low_since: Some(since),
                ..none
            },
        ),
        (MissionPhase::GetAltitude { from: [0.0; 2] }, wanted()),
        (MissionPhase::APPROACH, wanted()),
        (MissionPhase::Search(Search::default()), wanted()),
        (
            MissionPhase::Seek,
            MissionProgress {
                sortie: true,
                ..wanted()
            },
        ),
        (TRACKING, wanted()),
        (MissionPhase::TrackingStable, wanted()),
        (DESCENT, attempt()),
        (COMMITTED, attempt()),
        (MissionPhase::STANDS, none),
        (hold(HoldCause::Data), wanted()),
        (hold(HoldCause::Operator), sortie),
        (MissionPhase::GaveUp { at, yaw }, none),
        (MissionPhase::Preparing, none),
        (MissionPhase::Countdown { since }, none),
        (MissionPhase::SpinUp { since, armed: None }, none),
        (MissionPhase::TakeOff { since, left: true }, sortie),
        (
            MissionPhase::ClimbOut {
                since,
                at,
                yaw,
                stopped: false,
            },
            sortie,
        ),
        (MissionPhase::StandDown { since, unarmed: None }, none),
    ]
}

/// Condition of a row, states in which it acts, and resulting state for each initial state.
type Row = (
    &'static str,
    fn(&mut Situation),
    fn(MissionPhase) -> bool,
    fn(MissionPhase) -> State,
);

fn rows() -> Vec<Row> {
    let under_way = |p: MissionPhase| {
        use State::{Approach, GetAltitude, Hold, Search, Tracking, TrackingStable};
        let on_the_way = [GetAltitude, Approach, Search, Tracking, TrackingStable, Hold].contains(&p.state());
        on_the_way && !p.waits_for_operator()
    };
    vec![
        (
            "touchdown",
            |s| s.motors_stopped = true,
            |p| p.flies(),
            |_| State::Landed,
        ),
        (
            "return",
            |s| s.sortie.turns_back = Some(ReasonCode::TurnsBack.into()),
            |p| p.waits_for_operator(),
            |_| State::Hold,
        ),
        (
            "control",
            |s| s.flight = ControlState::OtherControl(AutopilotMode::Other),
            |p| p.flies(),
            |_| State::Idle,
        ),
        (
            "report",
            |s| s.flight = ControlState::Unknown,
            |p| p.needs_data(),
            |_| State::Hold,
        ),
        (
            "data",
            |s| s.forecast_age_s = 0.4,
            |p| p.needs_data(),
            |_| State::Hold,
        ),
        (
            "charge",
            |s| s.battery = Some(0.1),
            |p| p.flies() && !p.takes_off() || p == MissionPhase::Idle,
            |p| match p.state() {
                State::Descent | State::Flare => p.state(),
                _ => State::Tracking,
            },
        ),
        (
            "rest",
            |s| {
                s.own.as_mut().unwrap().position.z = -1.5;
                (s.deck, s.mean_deck_z) = (
                    s.deck.map(|d| Deck {
                        distance_m: 30.0,
                        ..d
                    }),
                    Some(-1.3),
                );
                s.now = super::tests::at(20.0);
            },
            |p| p == MissionPhase::Idle,
            |_| State::Hold,
        ),
        (
            "time",
            |s| s.now = super::tests::at(700.0),
            under_way,
            |_| State::GaveUp,
        ),
    ]
}

#[test]
fn rows_in_every_state() {
    for (name, counts, acts, leads_to) in rows() {
        for (phase, progress) in states() {
            let s = with(counts);
            let mut at = (phase, progress);
            for round in 1..=2 {
                let d = decide(at.0, at.1, None, &s, &config());
                let acted = d.entered.is_some() && d.phase.state() == leads_to(phase);
                assert!(acted || !acts(phase), "{name} in {phase:?}, round {round}: {d:?}");
                let kept = d.progress.landing == progress.landing;
                assert!(acts(phase) || kept, "{name} in {phase:?}: {d:?}");
                at = (
                    phase,
                    MissionProgress {
                        low_battery: None,
                        ..progress
                    },
                );
            }
        }
    }
    // The rows for an unobserved contact and for the distance led by a beacon have separate tests.
    assert_eq!(BEFORE_ORDERS.len() + AFTER_ORDERS.len(), rows().len() + 2);
}

/// The state resumes after a condition that neither pilot nor operator has caused.
#[test]
fn rows_that_are_over() {
    for (name, counts, _, _) in rows() {
        let back = match name {
            "touchdown" | "report" | "data" | "charge" => true,
            "control" | "time" => false,
            "rest" => continue,
            "return" => continue,
            _ => panic!("{name}: is the state restored?"),
        };
        for phase in [MissionPhase::APPROACH, TRACKING, MissionPhase::TrackingStable] {
            let d = step(phase, &with(counts));
            let mut s = fair();
            let mut d = d;
            for _ in 0..200 {
                s.now += Span::from_millis(10);
                d = step(&d, &s);
            }
            let resumed = d.phase.state().is_landing() && d.progress.landing;
            assert_eq!(resumed, back, "{name}: {d:?}");
        }
    }
}
