//! Two measurements of the deck contradict each other: no descent begins, a descent at height is aborted, and
//! the reason is reported.

use alight_shared::msg::{ReasonCode, State};
use alight_sim::harness::{
    failing::Failing,
    outcome::Outcome,
    rig::Rig,
    scenario::{NodeConfigs, Scenario},
};

use crate::judged;

/// Outcome, maximum disagreement about height during the descent, and reported reasons that concern the two
/// measurements.
struct Flown {
    outcome: Outcome,
    height_sd: f64,
    reported: Vec<ReasonCode>,
}

fn flown(scenario: &Scenario, seed: u64, limit_s: f64, mislead: impl Fn(&mut Rig)) -> Flown {
    let mut rig = Rig::landing(scenario, &NodeConfigs::default(), seed).unwrap();
    mislead(&mut rig);
    let mut height_sd = 0.0_f64;
    let outcome = judged(&mut rig, seed, limit_s, |rig| {
        if matches!(
            rig.state(0),
            State::TrackingStable | State::Descent | State::Flare
        ) {
            let newest = rig.world.drones()[0].forecast.and_then(|f| f.height_nis);
            height_sd = height_sd.max(newest.unwrap_or(0.0).sqrt());
        }
    });
    let both = [ReasonCode::DeckElsewhere, ReasonCode::HeightContradicted];
    Flown {
        outcome,
        height_sd,
        reported: rig
            .reasons
            .into_iter()
            .filter(|code| both.contains(code))
            .collect(),
    }
}

#[test]
fn witnesses_that_agree_in_a_sound_world() {
    for seed in 300..302 {
        let f = flown(&Scenario::default(), seed, 200.0, |_| {});
        println!("sound {seed}: {:.2} sd", f.height_sd);
        assert!(f.outcome.success, "{seed}: {}", f.outcome.reason);
        assert_eq!(f.reported, []);
    }
}

/// Images arrive 0.3 s late, stamped 0.25 s after their exposure: no contact may be hard.
#[test]
fn images_stamped_late() {
    let mut scenario = Scenario::default();
    (scenario.sensors.tag.latency_s, scenario.sensors.uvdar.latency_s) = (0.3, 0.3);
    for seed in 320..322 {
        let f = flown(&scenario, seed, 90.0, |rig| {
            let mut failing = Failing::default();
            failing.drone.images_late_s = 0.25;
            rig.world.fail(&failing);
        });
        println!(
            "late {seed}: {:.2} sd, {:?}, {:?} at {:?}",
            f.height_sd, f.reported, f.outcome.outcome, f.outcome.touchdown_speed_mps
        );
        assert!(
            f.outcome.touchdown_speed_mps.is_none_or(|v| v <= 1.0),
            "{:?}",
            f.outcome
        );
    }
}

#[test]
fn deck_of_a_neighbour() {
    for (seed, offset_m) in [(331, [0.0, 9.0, 0.0]), (332, [-8.0, 6.0, 0.0])] {
        let f = flown(&Scenario::default(), seed, 60.0, |rig| {
            let mut failing = Failing::default();
            failing.drone.neighbour_offset_m = offset_m;
            rig.world.fail(&failing);
        });
        let touched = f.outcome.touchdown_speed_mps.is_some() || f.outcome.water_contacts > 0;
        assert!(!touched && f.outcome.attempts == 0, "{seed}: {:?}", f.outcome);
        assert_eq!(f.reported, [ReasonCode::DeckElsewhere], "{seed}");
    }
}
