//! Landings on vessels moved by a response table.

use alight_sim::{
    harness::{
        outcome::Outcome,
        physics::Physics,
        scenario::{NodeConfigs, Scenario},
        trial,
    },
    physics::{
        deck_motion::DeckMotionConfig,
        vessel::{VesselCourse, response::HULLS},
    },
};

fn flown(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Outcome {
    trial::outcome(scenario, nodes, seed, "hull").unwrap()
}

fn world(hull: &str, sea: &str) -> (Scenario, NodeConfigs) {
    let mut scenario = Scenario::default();
    let mut nodes = NodeConfigs::default();
    scenario.sea = sea.parse().unwrap();
    scenario.install_hull(&mut nodes, hull).unwrap();
    (scenario, nodes)
}

#[test]
fn hull_as_an_installer_measured_it() {
    let (scenario, nodes) = world("work-12m", "jonswap:1,5");
    assert_eq!(nodes.vessel.deck, scenario.deck);
    assert_eq!(nodes.drone.deck, scenario.deck);
    assert_eq!(scenario.deck.centre_m, [-3.8, 0.0, -1.9]);
    assert_eq!((scenario.deck.length_m, scenario.deck.width_m), (3.0, 3.0));
    assert_eq!(nodes.vessel.gnss.antenna_m, [2.0, 0.6, -5.2]);
    assert_eq!(nodes.vessel.imu.lever_arm_m, [0.5, 0.0, -0.9]);
    // A scenario with a hull must not change when written and read.
    let text = toml::to_string(&scenario).unwrap();
    assert_eq!(
        alight_shared::config::parse::<Scenario>(&text, "test").unwrap(),
        scenario
    );
    let mut both = scenario;
    both.deck_motion = Some(DeckMotionConfig {
        file: "deck.csv".into(),
        ..DeckMotionConfig::default()
    });
    assert!(Physics::new(&both, 1).is_err());
}

#[test]
fn landing_on_every_hull() {
    for hull in HULLS {
        let (scenario, nodes) = world(hull, "jonswap:0.5,4");
        let o = flown(&scenario, &nodes, 3);
        assert!(o.success, "{hull}: {}", o.reason);
        if hull == HULLS[0] {
            assert_eq!(flown(&scenario, &nodes, 3).digest, o.digest);
            assert_ne!(flown(&scenario, &nodes, 4).digest, o.digest);
        }
    }
}

#[test]
fn landing_with_a_hardly_damped_attitude_loop() {
    let (mut scenario, nodes) = world("mono-5m", "jonswap:1.5,6");
    // A fast attitude loop with slow rotors oscillates; PX4's mixer then reduces the torque at low thrust.
    scenario.drone.autopilot.attitude_lag_s = Some(0.083);
    scenario.drone.airframe.rotor_lag_s = 0.05;
    let o = flown(&scenario, &nodes, 112);
    assert!(o.success && o.water_contacts == 0, "{}", o.reason);
}

#[test]
fn hull_trim_on_calm_water() {
    let (mut scenario, _) = world("mono-5m", "calm");
    scenario.vessel.course = VesselCourse::Straight;
    let mut physics = Physics::new(&scenario, 1).unwrap();
    for _ in 0..500 {
        physics.advance();
    }
    let (roll, pitch, _) = physics.vessel().attitude.euler();
    assert!((roll.to_degrees() - 0.3).abs() < 1e-9 && (pitch.to_degrees() - 2.0).abs() < 1e-9);
    assert!((physics.vessel().velocity.0.norm() - 2.0).abs() < 1e-9);
    scenario.hull.as_mut().unwrap().trim_pitch_deg = Some(-3.0);
    let physics = Physics::new(&scenario, 1).unwrap();
    assert!((physics.vessel().attitude.euler().1.to_degrees() + 3.0).abs() < 1e-9);
}
