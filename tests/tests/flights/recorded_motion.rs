//! Deck motion that is not caused by waves: a platform rocks fast about its deck, 1.3 m above the vessel's
//! sensors, and heaves with an unrelated sea.

use std::{
    fs,
    path::{Path, PathBuf},
};

use alight_sim::{
    harness::scenario::Scenario,
    physics::{deck_motion::DeckMotionConfig, sea::SeaConfig},
    studies::estimator::{run, state_errors},
};
use alight_usv::VesselNodeConfig;

use crate::assert_lands;

fn scene(file: PathBuf, scale: f64, start_s: f64) -> Scenario {
    Scenario {
        sea: SeaConfig::paper(0.2, 5.0),
        deck_motion: Some(DeckMotionConfig {
            file,
            scale,
            start_s,
            ..DeckMotionConfig::default()
        }),
        ..Scenario::default()
    }
}

/// Roll and pitch with an amplitude of 1.5 deg at 1.1 to 1.4 Hz, superimposed on a slower rocking at 0.47 Hz;
/// 10 rows per second.
fn platform(name: &str) -> PathBuf {
    let mut csv = String::from("t_s,roll_deg,pitch_deg\n");
    for k in 0..1500 {
        let t = 0.1 * f64::from(k);
        let w = |hz: f64| (core::f64::consts::TAU * hz * t).sin();
        let roll = w(0.47) + 1.5 * w(1.13);
        let pitch = 0.3 * w(0.47) + 1.5 * w(1.37);
        csv += &format!("{t:.1},{roll:.4},{pitch:.4}\n");
    }
    let path = std::env::temp_dir().join(format!("alight-{name}-{}.csv", std::process::id()));
    fs::write(&path, csv).unwrap();
    path
}

#[test]
fn estimated_tilt_under_horizontal_acceleration() {
    let file = platform("estimator");
    let scenario = scene(file.clone(), 1.0, 0.0);
    let runs: Vec<_> = (0..2)
        .map(|seed| run(&scenario, &VesselNodeConfig::default(), seed, 60.0).unwrap())
        .collect();
    fs::remove_file(file).unwrap();
    // Errors of position, attitude, velocity and rates. An accelerometer bias of 0.1 m/s² corresponds to 0.01
    // rad of tilt. The error is 0.1 rad if force fluctuations are used to separate tilt from bias.
    let e = state_errors(&runs).per_axis;
    assert!(e[1] < 0.025, "attitude {} rad", e[1]);
    assert!(e[2] < 0.1, "velocity {} m/s", e[2]);
}

#[test]
fn landing_on_a_fast_rocking_platform() {
    let file = platform("landing");
    for seed in [1, 2] {
        let scenario = scene(file.clone(), 1.0, 7.0 * seed as f64);
        assert_lands_level(&scenario, seed);
    }
    fs::remove_file(file).unwrap();
}

#[test]
#[ignore = "needs ../shared/data/tank-platform.csv"]
fn landing_on_the_recorded_platform() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/tank-platform.csv");
    for (scale, seed) in [(1.0, 101), (1.0, 107), (2.0, 103), (2.0, 109)] {
        assert_lands_level(&scene(file.clone(), scale, 29.0 * (seed - 100) as f64), seed);
    }
}

fn assert_lands_level(scenario: &Scenario, seed: u64) {
    let o = assert_lands(scenario, seed);
    assert!(
        o.unsafe_contacts == 0 && o.tilt_error_deg < Some(6.0),
        "seed {seed}: {o:?}"
    );
}
