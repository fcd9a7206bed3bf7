//! The drone's forecast above a real boat under way: a recording whose heel moves with her turns, in nearly flat water.

use std::path::Path;

use alight_shared::estimation::moments;
use alight_shared::frames::wrap_angle;
use alight_shared::time::Span;
use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::deck_motion::DeckMotionConfig;
use alight_sim::physics::sea::SeaConfig;
use nalgebra::Vector3;

use crate::predictor::{PredictorFlight, fly_above};

/// Time above her, s; of it the first part is not judged: the filters begin.
const FLOWN_S: f64 = 38.0;
const BEGINS_S: f64 = 10.0;

/// Above the boat of the recording, kept level with her by truth.
fn above_the_boat(start_s: f64, seed: u64) -> PredictorFlight {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/flights/data/figure-of-eight.csv");
    let mut scenario = Scenario {
        sea: SeaConfig::paper(0.0, 5.0),
        deck_motion: Some(DeckMotionConfig {
            file,
            start_s,
            keep_mean: true,
            ..DeckMotionConfig::default()
        }),
        ..Scenario::default()
    };
    // Past half of it she heels to the other side, and the recording has 100 s.
    scenario.start.warm_up_s = 60.0;
    fly_above(scenario, [FLOWN_S, f64::INFINITY], seed, |deck| {
        (
            deck.position.0,
            Vector3::new(deck.velocity.0.x, deck.velocity.0.y, 0.0),
        )
    })
}

/// Standard deviation of the forecasts' roll and pitch errors, so far ahead (s), deg: an error that stays is the
/// trim of its inertial unit, which is not measured.
fn errors_deg(flight: &PredictorFlight, ahead_s: f64) -> [f64; 2] {
    let mut errors = [Vec::new(), Vec::new()];
    for s in &flight.samples {
        let then = flight.truth.get(s.t + (100.0 * ahead_s).round() as usize);
        let stage = s.forecast.at(s.forecast.header.at + Span::from_secs(ahead_s));
        let begun = (s.t as f64 - flight.began as f64) * 0.01 >= BEGINS_S;
        let (Some(deck), Some(stage), true) = (then, stage, begun) else {
            continue;
        };
        let error = Vector3::from(stage.euler) - deck.euler();
        errors[0].push(error.x.to_degrees());
        errors[1].push(error.y.to_degrees());
    }
    assert!(errors[0].len() > 500, "{} forecasts", errors[0].len());
    errors.map(|e| moments(&e).1)
}

/// Root mean square by which roll and pitch of a forecast differ from the vessel's estimate of the same time, deg.
fn beginning_deg(flight: &PredictorFlight) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for e in &flight.estimates {
        let i = flight
            .samples
            .partition_point(|s| s.forecast.header.at <= e.header.at);
        let Some(s) = i.checked_sub(1).and_then(|i| flight.samples.get(i)) else {
            continue;
        };
        if (s.t as f64 - flight.began as f64) * 0.01 < BEGINS_S {
            continue;
        }
        let Some(stage) = s.forecast.at(e.header.at) else {
            continue;
        };
        n += 1.0;
        sum += wrap_angle(stage.euler[0] - e.eta[3]).powi(2) + wrap_angle(stage.euler[1] - e.eta[4]).powi(2);
    }
    assert!(n > 100.0, "{n} estimates");
    (sum / (2.0 * n)).sqrt().to_degrees()
}

#[test]
fn forecast_over_a_boat_that_turns() {
    let flight = above_the_boat(0.0, 100);
    let begins = beginning_deg(&flight);
    let errors = [0.0, 0.5, 1.0, 2.0].map(|ahead| errors_deg(&flight, ahead));
    println!("begins {begins:.3} deg from the estimate; roll, pitch {errors:.3?} deg");
    assert!(begins < 0.2, "{begins} deg from the estimate");
    let [_, half, one, _] = errors;
    assert!(
        half.iter().all(|e| *e < 0.25) && one.iter().all(|e| *e < 0.45),
        "{errors:?}"
    );
}
