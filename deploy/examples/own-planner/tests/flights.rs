//! Landings in the simulated world.

use alight_sim::{
    baselines::own::OwnLaw,
    harness::{
        scenario::{NodeConfigs, Scenario},
        trial,
    },
};
use own_planner::Ride;

#[test]
fn landings_in_calm_water() {
    let nodes = NodeConfigs {
        own: Some(OwnLaw::new("ride", |_, _| Box::new(Ride::default()))),
        ..NodeConfigs::default()
    };
    let scenario = Scenario {
        sea: "calm".parse().unwrap(),
        ..Scenario::default()
    };
    for seed in 1..=3 {
        let outcome = trial::outcome(&scenario, &nodes, seed, "calm").unwrap();
        assert!(outcome.success, "{outcome:#?}");
    }
}
