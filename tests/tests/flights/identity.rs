//! Another boat with the same tags is alongside: the drone lands on its own deck, or waits and reports why.

use alight_sim::{
    harness::{
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

/// Whether the drone lands on its own deck at this distance between the boats; it may not descend to the other deck.
fn lands(neighbour_m: f64, seed: u64) -> bool {
    let scenario = with_neighbour(neighbour_m);
    let mut rig = Rig::landing(&scenario, &NodeConfigs::default(), seed).unwrap();
    let mut over_other_m = f64::INFINITY;
    let o = judged(&mut rig, seed, 240.0, |rig| {
        let physics = rig.world.physics();
        if let (Some(other), Some(drone)) = (physics.neighbour_deck(), physics.drone(0)) {
            let from = drone.position.0 - other.position.0;
            if from.xy().norm() < scenario.deck.width_m / 2.0 {
                over_other_m = over_other_m.min(-from.z);
            }
        }
    });
    println!(
        "{neighbour_m} m, {seed}: {over_other_m:.1} m over the other, {:?}",
        rig.reasons
    );
    assert!(
        over_other_m > 2.5 && o.unsafe_contacts == 0 && o.water_contacts == 0,
        "{seed}: {o:?}"
    );
    o.success
}

#[test]
fn own_deck_near_another_with_its_tags() {
    // The distance is smaller than both receivers' errors: the drone may wait for long, but must never
    // descend to the other deck.
    lands(3.0, 801);
    assert!(lands(10.0, 802));
}
