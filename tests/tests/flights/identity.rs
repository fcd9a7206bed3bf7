//! Another boat with the same tags is alongside: the drone lands on its own deck, or waits and reports why.

use alight_shared::msg::ReasonCode;
use alight_sim::{
    harness::{
        outcome::Outcome,
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
    },
    sensors::noise::Windows,
};

use crate::{at_sea, judged};

fn with_neighbour(neighbour_m: f64) -> Scenario {
    let mut scenario = at_sea("0.5,5");
    scenario.neighbour_m = Some(neighbour_m);
    // Ultraviolet markers on one boat would distinguish the two.
    scenario.sensors.uvdar.outages_s = Windows(vec![[0.0, 1e9]]);
    scenario
}

/// Outcome, minimum height above the other deck along its normal, and reported reasons.
struct Flown {
    outcome: Outcome,
    over_other_m: f64,
    reasons: Vec<ReasonCode>,
}

fn flown(scenario: &Scenario, nodes: &NodeConfigs, seed: u64, limit_s: f64) -> Flown {
    let mut rig = Rig::landing(scenario, nodes, seed).unwrap();
    let mut over_other_m = f64::INFINITY;
    let mut reasons = Vec::new();
    let outcome = judged(&mut rig, seed, limit_s, |rig| {
        let m = *rig.mission(0);
        for code in [m.entered.code, m.waiting.code] {
            if !reasons.contains(&code) {
                reasons.push(code);
            }
        }
        let physics = rig.world.physics();
        if let (Some(other), Some(drone)) = (physics.neighbour_deck(), physics.drone(0)) {
            let from = drone.position.0 - other.position.0;
            if from.xy().norm() < scenario.deck.width_m / 2.0 {
                over_other_m = over_other_m.min(-from.z);
            }
        }
    });
    Flown {
        outcome,
        over_other_m,
        reasons,
    }
}

/// Number of landings on the drone's own deck at this distance between the boats; none may descend to the other deck.
fn landed(neighbour_m: f64, seeds: core::ops::Range<u64>) -> u32 {
    let mut landed = 0;
    for seed in seeds {
        let f = flown(&with_neighbour(neighbour_m), &NodeConfigs::default(), seed, 240.0);
        let o = &f.outcome;
        println!(
            "{neighbour_m} m, {seed}: {:?} {}, {:.1} m over the other, ambiguous {}, elsewhere {}",
            o.outcome,
            o.reason,
            f.over_other_m,
            f.reasons.contains(&ReasonCode::SeveralDecks),
            f.reasons.contains(&ReasonCode::DeckElsewhere),
        );
        assert!(
            f.over_other_m > 2.5 && o.unsafe_contacts == 0 && o.water_contacts == 0,
            "{seed}: {o:?}"
        );
        landed += u32::from(o.success);
    }
    landed
}

#[test]
fn own_deck_near_another_with_its_tags() {
    // The distance is smaller than both receivers' errors: the drone may wait for long, but must never
    // descend to the other deck.
    landed(3.0, 801..802);
    assert_eq!(landed(10.0, 802..803), 1);
}
