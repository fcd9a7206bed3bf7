//! Landings on vessels that are moved by a response table.

use alight_shared::node::Node;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::physics::{Physics, TICK};
use alight_sim::harness::scenario::{NodeConfigs, Scenario};
use alight_sim::harness::trial;
use alight_sim::physics::deck_motion::DeckMotionConfig;
use alight_sim::physics::vessel::VesselCourse;
use alight_sim::physics::vessel::response::HULLS;
use alight_usv::VesselNode;

fn flown(scenario: &Scenario, nodes: &NodeConfigs, seed: u64) -> Outcome {
    trial::outcome(scenario, nodes, seed, "hull").unwrap()
}

fn world(hull: &str, sea: &str) -> (Scenario, NodeConfigs) {
    let (mut scenario, mut nodes) = (Scenario::default(), NodeConfigs::default());
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
    // A scenario with a hull survives its file.
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
    // A quick attitude loop above slow rotors oscillates; at little thrust PX4's mixer then cuts its torque.
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

/// RMS tilt of the vessel about its mean over two minutes on this heading, deg.
fn tilt_on(scenario: &Scenario, heading_deg: f64, seed: u64) -> f64 {
    let mut scenario = scenario.clone();
    scenario.vessel.heading_deg = Some(heading_deg);
    let mut physics = Physics::new(&scenario, seed).unwrap();
    let tilts: Vec<[f64; 2]> = (0..(120.0 / TICK.secs()) as usize)
        .map(|_| {
            physics.advance();
            let (roll, pitch, _) = physics.vessel().attitude.euler();
            [roll, pitch]
        })
        .collect();
    let n = tilts.len() as f64;
    let variance = |k: usize| {
        let mean = tilts.iter().map(|t| t[k]).sum::<f64>() / n;
        tilts.iter().map(|t| (t[k] - mean).powi(2)).sum::<f64>() / n
    };
    (variance(0) + variance(1)).sqrt().to_degrees()
}

#[test]
fn deck_tilt_on_the_quietest_heading() {
    for (hull, heading_deg) in [("mono-5m", 60.0), ("work-12m", 110.0)] {
        let (mut scenario, nodes) = world(hull, "jonswap:1,5");
        scenario.sea.mean_direction_deg = Some(0.0);
        scenario.vessel.heading_deg = Some(heading_deg);
        let mut physics = Physics::new(&scenario, 1).unwrap();
        let mut node = VesselNode::new(&nodes.vessel, 1, 1);
        for _ in 0..(150.0 / TICK.secs()) as usize {
            let now = physics.vessel_now();
            node.step(now, &physics.vessel_readings().into());
            physics.advance();
        }
        let advisor = node.advisor();
        let waves_to = advisor.waves_to_rad().unwrap().to_degrees();
        assert!(
            waves_to.abs() < 15.0,
            "{hull}: waves run to 0 deg, found {waves_to:.0}"
        );
        let quiet = advisor.outlooks().iter();
        let quiet = quiet
            .min_by(|a, b| a.tilt_rad().total_cmp(&b.tilt_rad()))
            .unwrap();
        let there = tilt_on(&scenario, quiet.heading_rad.to_degrees(), 1);
        let now = tilt_on(&scenario, heading_deg, 1);
        assert!(there < 0.85 * now, "{hull}: {there:.2} deg of tilt, now {now:.2}");
        let smallest = (0..6).map(|k| tilt_on(&scenario, 30.0 * f64::from(k), 1));
        let smallest = smallest.fold(f64::INFINITY, f64::min);
        assert!(
            there < 1.05 * smallest,
            "{hull}: {there:.2} deg of tilt, elsewhere {smallest:.2}"
        );
    }
}
