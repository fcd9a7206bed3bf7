use alight_shared::{
    landing::{Slopes, Staying, SupportPolygon, WindPush},
    msg::{DeckForecast, DeckStage},
};

use super::MissionConfig;
use crate::odometry::wind::WindMonitor;

fn likely(p: f64) -> bool {
    p >= MissionConfig::default().min_probability
}
fn of(predicted: &[i8], measured: &[u8], wind_mps2: f64) -> f64 {
    let mut f = DeckForecast::default();
    for s in predicted {
        // The slope acts in the wind's direction.
        f.predicted_slopes.push([-*s, 0]).unwrap();
    }
    measured.iter().for_each(|s| f.slopes.push(*s).unwrap());
    let stage = DeckStage {
        euler_sd: [0.02; 3],
        ..DeckStage::default()
    };
    f.stages.push(stage).unwrap();
    let support = SupportPolygon {
        friction: 0.4,
        edge_m: 0.65,
    };
    let wind = WindPush::of(&WindMonitor::steady(wind_mps2));
    Staying::of(&Slopes::of(Some(&f), &wind), &support).probability
}

fn waves(s: i8) -> [i8; 48] {
    core::array::from_fn(|k| (f64::from(s) * (core::f64::consts::TAU * k as f64 / 16.0).sin()).round() as i8)
}

#[test]
fn probability_of_staying_by_slope_and_wind() {
    assert!(of(&[], &[], 0.0) > 0.999);
    assert!(likely(of(&waves(10), &[10; 60], 0.5)));
    assert!(!likely(of(&waves(26), &[10; 60], 0.0)));
    let mut late = waves(10);
    late[45] = 60;
    assert!(likely(of(&late, &[10; 60], 0.0)));
    // Slope and wind are acceptable alone, but not together.
    assert!(!likely(of(&waves(22), &[10; 60], 2.0)));
    assert!(likely(of(&waves(22), &[10; 60], 0.0)) && likely(of(&waves(2), &[2; 60], 2.0)));
    assert!(!likely(of(&[], &[], 7.0)));
}

#[test]
fn slope_measured_a_moment_ago() {
    let mut measured = [10; 60];
    measured[1] = 45;
    assert!(!likely(of(&waves(10), &measured, 0.0)));
    measured.swap(1, 10);
    assert!(likely(of(&waves(10), &measured, 0.0)));
}

#[test]
fn drift_by_waves_and_wind_together() {
    // Waves that move the drone in both directions, and the apparent wind of a vessel at 8 m/s.
    let mut steep = [22; 60];
    (steep[0], steep[1]) = (5, 5);
    assert!(likely(of(&[0; 48], &steep, 0.0)));
    assert!(!likely(of(&[0; 48], &steep, 2.0)) && likely(of(&[0; 48], &[10; 60], 2.0)));
    // Trim and heel act like wind.
    assert!(!likely(of(&[8; 48], &steep, 0.0)));
}

#[test]
fn probability_that_is_no_number() {
    let support = SupportPolygon {
        friction: f64::NAN,
        edge_m: 0.65,
    };
    let p = Staying::of(&Slopes::of(None, &WindPush::default()), &support).probability;
    assert!(!likely(p));
}
