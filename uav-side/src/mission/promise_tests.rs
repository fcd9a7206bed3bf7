//! A steady course that the vessel's helm promises.

use alight_shared::msg::ReasonCode::{Descending, HelmTurns, LikelySlides, Permitted};
use alight_shared::msg::{Course, DeckGrant, Header, HelmState, HelmStatus};

use State::{Descent, TrackingStable};

use super::reservation::Promise;
use super::tests::Does::{Enter, Stay};
use super::tests::*;
use super::*;

#[test]
fn turn_to_a_promised_course() {
    let turning = |steady_in_s: f64, odds: f64| {
        with(|s| {
            s.course = Course::Turning;
            s.promise = Some(Promise {
                heading_rad: 0.7,
                steady_in_s,
                likelihood: 0.98,
            });
            s.odds.as_mut().unwrap().slides = odds;
            s.worth_waiting = 0.0;
        })
    };
    let stays = |why| Stay(TrackingStable, why);
    let rows = [
        (turning(12.0, 0.95), stays(HelmTurns)),
        // Better now than in a minute.
        (turning(60.0, 0.96), Enter(Descent, Permitted)),
        (turning(12.0, 0.99), Enter(Descent, Permitted)),
        // Not likely enough either way.
        (turning(60.0, 0.9), stays(LikelySlides)),
    ];
    table(MissionPhase::TrackingStable, rows.map(|(s, does)| (s, 0.0, does)));
    let why = step(MissionPhase::TrackingStable, &turning(12.0, 0.95)).waiting;
    assert_eq!(
        why.to_string(),
        "waits for the vessel to be steady on 040 deg, 12 s"
    );
    // A descent that began is not broken off by the turn: the helm keeps the course.
    let descent = MissionPhase::Descent {
        violated: None,
        paused: None,
    };
    waits(&step(descent, &turning(12.0, 0.99)), Descent, Descending);
}

#[test]
fn promise_in_silence() {
    let of = |state, age_s: f64| {
        let helm = HelmStatus {
            state,
            steady_in_s: 12.0,
            ..HelmStatus::default()
        };
        let grant = DeckGrant {
            header: Header::new(1, 0, 1, 1, at(0.0)),
            helm,
            ..DeckGrant::default()
        };
        Promise::of(Some(&grant), at(age_s)).map(|p| p.steady_in_s)
    };
    assert_eq!(of(HelmState::Agreed, 1.5), Some(10.5));
    assert_eq!(of(HelmState::Agreed, 3.0), None);
    for state in [HelmState::Asked, HelmState::Steady, HelmState::Withdrawn] {
        assert_eq!(of(state, 0.0), None, "{state:?}");
    }
}
