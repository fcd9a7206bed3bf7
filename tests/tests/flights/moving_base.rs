//! The vessel's receiver as moving base: a position accurate to centimetres before a tag is in view and after
//! it is lost, and false fixes.

use alight_shared::msg::State;
use alight_sim::{
    harness::{
        outcome::{Outcome, TIME_LIMIT_S},
        rig::Rig,
        scenario::{NodeConfigs, Scenario},
        storm::FaultKind,
        trial,
    },
    sensors::{moving_base::MovingBaseConfig, noise::Windows},
};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::judged;

const HOVERS_S: f64 = 40.0;
/// Height at which the tags are permanently lost, m.
const BLIND_M: f64 = 3.0;

/// Moving base with which the drone soon has a lasting fix.
fn fixed() -> MovingBaseConfig {
    MovingBaseConfig {
        time_to_fix_s: 2.0,
        fix_lost_every_s: 1e6,
        ..MovingBaseConfig::default()
    }
}
fn at_sea(moving_base: Option<MovingBaseConfig>) -> Scenario {
    let mut scenario = crate::at_sea("moderate");
    scenario.sensors.moving_base = moving_base;
    scenario
}

/// Error of the forecast's current deck position relative to the drone, m.
fn error_m(rig: &Rig) -> Option<f64> {
    let physics = rig.world.physics();
    let computer = rig.world.drones().first()?;
    let now = physics.drone_now(0);
    let odometry = computer.odometry.as_ref()?;
    let deck = Vector3::from(computer.forecast.as_ref()?.at(now)?.position);
    let drone = odometry.position() + odometry.velocity() * (now - odometry.header.at).secs();
    let truth = physics.deck().position.0 - physics.drone(0)?.position.0;
    Some((deck - drone - truth).norm())
}
/// Mean [`error_m`] over the last 10 s of a hover at 10 m without a detection, m.
fn hovered_error_m(moving_base: Option<MovingBaseConfig>, seed: u64) -> f64 {
    let mut scenario = at_sea(moving_base);
    scenario.start.distance_m = [0.0; 2];
    scenario.start.height_m = [10.0; 2];
    scenario.sensors.tag.outages_s = Windows(vec![[0.0, 1e3]]);
    scenario.sensors.uvdar.max_range_m = 0.0;
    let mut rig = Rig::new(&scenario, &NodeConfigs::default(), seed).unwrap();
    rig.run(HOVERS_S - 10.0);
    let errors = (0..100).filter_map(|_| {
        rig.run(0.1);
        error_m(&rig)
    });
    let errors: Vec<f64> = errors.collect();
    assert!(errors.len() > 90, "{} forecasts", errors.len());
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn forecast_at_10_m_before_a_tag_is_in_view() {
    let [with, without] = [Some(fixed()), None].map(|base| hovered_error_m(base, 4100));
    println!("with a moving base {with:.3} m, without {without:.3} m");
    assert!(with < 0.1 && without > 0.3, "{with} {without}");
}

fn blinded(moving_base: Option<MovingBaseConfig>, seed: u64) -> Outcome {
    let mut rig = Rig::landing(&at_sea(moving_base), &NodeConfigs::default(), seed).unwrap();
    let mut blind = false;
    judged(&mut rig, seed, TIME_LIMIT_S, |rig| {
        let low = rig.state(0) == State::Descent && rig.world.observation().feet_height_m() < BLIND_M;
        if low && !blind {
            blind = true;
            rig.begin(FaultKind::Blind, 0.0);
        }
    })
}

#[test]
fn tags_lost_for_good_low_over_the_deck() {
    let places_m = |moving_base: Option<MovingBaseConfig>| -> Vec<f64> {
        let seeds = (4110..4114_u64).into_par_iter();
        let landed = seeds.map(|seed| {
            let o = blinded(moving_base, seed);
            assert!(!o.is_unsafe(), "{seed}: {}", o.reason);
            o.position_error_m.filter(|_| o.success).unwrap_or(f64::INFINITY)
        });
        landed.collect()
    };
    let means = [Some(fixed()), None].map(|base| {
        let all = places_m(base);
        println!(
            "from the centre, with a moving base {}: {all:.2?} m",
            base.is_some()
        );
        all.iter().sum::<f64>() / all.len() as f64
    });
    // The flare has no vision: with the moving base a position arrives every quarter of a second, without it none.
    let [with, without] = means;
    assert!(with < 0.25 && with < 0.8 * without, "{means:?}");
}

/// All fixes are wrong by 0.5 m, and no landing may be unsafe.
#[test]
fn false_fixes_without_an_unsafe_contact() {
    let config = MovingBaseConfig {
        false_fix_m: 0.5,
        ..fixed()
    };
    (4120..4122_u64).into_par_iter().for_each(|seed| {
        let o = trial::outcome(&at_sea(Some(config)), &NodeConfigs::default(), seed, "moderate").unwrap();
        assert!(!o.is_unsafe() && o.unsafe_contacts == 0, "{seed}: {}", o.reason);
    });
}
