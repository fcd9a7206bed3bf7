//! Advice to the helm on courses with less deck motion.

use alight_shared::{
    apparent_slope::{ApparentSlope, RATE_HZ},
    msg::SLOPE_STEP,
    node::Node,
};
use alight_sim::{
    harness::{
        physics::{Physics, TICK},
        scenario::{NodeConfigs, Scenario},
    },
    physics::vessel::{VesselCourse, response::HULLS},
};
use alight_usv::{CourseOutlook, VesselNode};
use nalgebra::Vector3;

/// Headings flown, deg; the waves travel towards 0 deg.
const FLOWN_DEG: [f64; 6] = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0];

/// Hull on a straight course, in a sea whose waves travel north.
fn under_way(hull: &str, sea: &str, speed_mps: f64) -> (Scenario, NodeConfigs) {
    let mut scenario = Scenario::default();
    let mut nodes = NodeConfigs::default();
    scenario.sea = sea.parse().unwrap();
    scenario.sea.mean_direction_deg = Some(0.0);
    scenario.install_hull(&mut nodes, hull).unwrap();
    scenario.vessel.course = VesselCourse::Straight;
    scenario.vessel.speed_mps = speed_mps;
    (scenario, nodes)
}

fn on_heading(scenario: &Scenario, heading_deg: f64) -> Scenario {
    let mut scenario = scenario.clone();
    scenario.vessel.heading_deg = Some(heading_deg);
    scenario
}

fn node_after(
    scenario: &Scenario,
    nodes: &NodeConfigs,
    heading_deg: f64,
    seed: u64,
    seconds: f64,
) -> VesselNode {
    let mut physics = Physics::new(&on_heading(scenario, heading_deg), seed).unwrap();
    let mut node = VesselNode::new(&nodes.vessel, 1, 1);
    for _ in 0..(seconds / TICK.secs()) as usize {
        let now = physics.vessel_now();
        node.step(now, &physics.vessel_readings().into());
        physics.advance();
    }
    node
}

/// Deck motion on one heading in three minutes: standard deviations of tilt (rad) and vertical speed (m/s),
/// and root mean square of the maximum apparent slopes in intervals of two seconds.
fn deck_on(scenario: &Scenario, heading_deg: f64, seed: u64) -> [f64; 3] {
    let mut physics = Physics::new(&on_heading(scenario, heading_deg), seed).unwrap();
    let mut slope = ApparentSlope::default();
    let every = (1.0 / RATE_HZ / TICK.secs()) as usize;
    let mut samples: Vec<Vector3<f64>> = Vec::new();
    for k in 0..(180.0 / TICK.secs()) as usize {
        physics.advance();
        let deck = physics.deck();
        if k % every == 0 {
            slope.push(physics.now(), &deck.attitude.0, deck.velocity.0);
            let (roll, pitch, _) = deck.attitude.euler();
            samples.push(Vector3::new(roll, pitch, deck.velocity.0.z));
        }
    }
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<Vector3<f64>>() / n;
    let [roll, pitch, sink]: [f64; 3] = (samples
        .iter()
        .map(|f| (f - mean).component_mul(&(f - mean)))
        .sum::<Vector3<f64>>()
        / n)
        .into();
    let steepest = slope.slopes(physics.now());
    let squares: f64 = steepest
        .iter()
        .map(|s| (f64::from(*s) * SLOPE_STEP).powi(2))
        .sum();
    [
        (roll + pitch).sqrt(),
        sink.sqrt(),
        (squares / steepest.len() as f64).sqrt(),
    ]
}

/// Outlook at the current speed for the nearest heading.
fn outlook_on(node: &VesselNode, heading_deg: f64) -> CourseOutlook {
    let all = node.advisor().outlooks();
    let off = |c: &CourseOutlook| 1.0 - (c.heading_rad - heading_deg.to_radians()).cos();
    let present = all.iter().filter(|c| c.speed_mps == all[0].speed_mps);
    *present.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
}

#[test]
fn deck_motion_on_other_headings() {
    for hull in HULLS {
        let (scenario, nodes) = under_way(hull, "jonswap:1,5", 3.0);
        let node = node_after(&scenario, &nodes, 60.0, 1, 150.0);
        let waves_to = node.advisor().waves_to_rad().unwrap().to_degrees();
        assert!(
            waves_to.abs() < 20.0,
            "{hull}: waves run to 0 deg, found {waves_to:.0}"
        );
        for heading in FLOWN_DEG {
            let [tilt, sink, steep] = deck_on(&scenario, heading, 1);
            let predicted = outlook_on(&node, heading);
            println!(
                "{hull} {heading:3.0} deg: tilt {:.2} predicted {:.2} deg, sink {sink:.2} predicted {:.2} m/s, steepest slopes \
                 {steep:.3}, predicted deviation {:.3}, likelihood {:.3}",
                tilt.to_degrees(),
                predicted.tilt_rad().to_degrees(),
                predicted.heave_rate_sd_mps,
                predicted.slope_sd,
                predicted.likelihood
            );
            assert!(
                (predicted.heave_rate_sd_mps / sink).ln().abs() < 0.5,
                "{hull}, {heading} deg: {sink:.2} m/s, predicted {predicted:?}"
            );
            assert!(
                (predicted.tilt_rad() / tilt).ln().abs() < 0.6,
                "{hull}, {heading} deg: {tilt:.3} rad, predicted {predicted:?}"
            );
        }
    }
}
