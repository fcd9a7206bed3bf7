//! The vessel's estimator against the truth of the simulated sea, vessel and sensors (which share no
//! model with it), in the vessel's own GNSS frame: truth plus the receiver's bias at that instant.

use alight_shared::frames::{euler_rates, wrap_angle};
use alight_shared::geometry::{DeckGeometry, DroneGeometry};
use alight_shared::msg::{VesselEstimate, VesselPrediction};
use alight_shared::node::Node;
use alight_shared::time::{Time, TrueTime, VesselClock};
use alight_sim::sea::{Sea, SeaConfig};
use alight_sim::sensors::{SensorConfig, Sensors};
use alight_sim::streams::Streams;
use alight_sim::vessel::{Course, Vessel, VesselConfig};
use alight_usv::{VesselIn, VesselNode, VesselNodeConfig};

/// `eta` and its derivative in the order of [`VesselEstimate`].
#[derive(Clone, Copy)]
struct Truth {
    eta: [f64; 6],
    dot: [f64; 6],
}

struct Run {
    truth: Vec<Truth>,
    /// (tick, estimate)
    estimates: Vec<(usize, VesselEstimate<VesselClock>)>,
    /// (tick of the first stage, prediction)
    predictions: Vec<(f64, VesselPrediction<VesselClock>)>,
    confidence: f32,
}

const WARM_UP_S: usize = 60;

/// Runs vessel, sensors and node for the warm-up and `span_s` more seconds.
fn run(seed: u64, sea: &str, course: Course, span_s: usize) -> Run {
    let streams = Streams::new(seed);
    let sea = Sea::new(&sea.parse::<SeaConfig>().unwrap(), &streams);
    let config = VesselConfig {
        course,
        ..VesselConfig::default()
    };
    let mut vessel = Vessel::new(&config, &sea, &streams);
    let mut sensors = Sensors::new(
        &SensorConfig::default(),
        &DroneGeometry::default(),
        &DeckGeometry::default(),
        &streams,
    );
    let mut node = VesselNode::new(&VesselNodeConfig::default(), 1, 1);
    let mut out = Run {
        truth: Vec::new(),
        estimates: Vec::new(),
        predictions: Vec::new(),
        confidence: 0.0,
    };
    let ticks = (WARM_UP_S + span_s) * 100;
    for k in 0..ticks + 300 {
        let t = Time::<TrueTime>::from_nanos(k as i64 * 10_000_000);
        let state = vessel.state();
        let readings = sensors.vessel(t, &state);
        let now = sensors.clocks.vessel_time(t);
        let p = state.position.0 + sensors.vessel_gnss_bias();
        let (roll, pitch, yaw) = state.attitude.euler();
        let rates = euler_rates(roll, pitch, state.rates.0);
        let v = state.velocity.0;
        out.truth.push(Truth {
            eta: [p.x, p.y, p.z, roll, pitch, yaw],
            dot: [v.x, v.y, v.z, rates.x, rates.y, rates.z],
        });
        let said = node.step(
            now,
            &VesselIn {
                imu: readings.imu,
                gnss: readings.gnss,
                heading: readings.heading,
                time_requests: Vec::new(),
            },
        );
        if (WARM_UP_S * 100..ticks).contains(&k) {
            out.estimates.extend(said.estimate.map(|e| (k, e)));
            if let Some(p) = said.prediction {
                out.predictions
                    .push((k as f64 - 100.0 * (now - p.header.at).secs(), p));
            }
            out.confidence = said.wave.map_or(out.confidence, |w| w.confidence);
        }
        vessel.step(t, 0.01, &sea);
    }
    out
}

fn difference(dof: usize, a: f64, b: f64) -> f64 {
    if dof < 3 { a - b } else { wrap_angle(a - b) }
}
fn rms(squares: &[f64]) -> f64 {
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn the_estimate_meets_the_papers_figures_and_its_own_covariance() {
    let runs: Vec<Run> = (0..3).map(|s| run(s, "moderate", Course::Drift, 60)).collect();
    // Squared errors of position, attitude, velocity, rates; NEES of each (eta, eta_dot) pair.
    let (mut squares, mut nees) = (vec![Vec::new(); 4], vec![Vec::new(); 6]);
    for r in &runs {
        assert!(r.estimates.len() > 1700, "30 Hz for 60 s");
        assert!(r.confidence > 0.5, "the sea is identified: {}", r.confidence);
        for (k, e) in &r.estimates {
            let truth = r.truth[*k];
            for d in 0..6 {
                let a = difference(d, e.eta[d], truth.eta[d]);
                let b = f64::from(e.eta_dot[d]) - truth.dot[d];
                squares[d / 3].push(a * a);
                squares[2 + d / 3].push(b * b);
                let [p, c, q] = e.covariance[d].map(f64::from);
                nees[d].push((q * a * a - 2.0 * c * a * b + p * b * b) / (p * q - c * c));
            }
        }
    }
    // Per axis, beside Procházka 2024. Position is at the sensor's own limit: a bias of 1 m with
    // 300 s wanders by 0.08 m a second under 0.3 m of white noise at 10 Hz, sqrt(q r) = 0.088 m.
    let names = ["position", "attitude", "velocity", "rates"];
    for ((s, limit), name) in squares.iter().zip([0.116, 0.017, 0.201, 0.004]).zip(names) {
        let e = rms(s);
        println!("{name}: {e:.4} (limit {limit})");
        assert!(e <= limit, "{name}: {e}");
    }
    for (d, n) in nees.iter().enumerate() {
        let mean = n.iter().sum::<f64>() / n.len() as f64;
        println!("NEES of degree of freedom {d}: {mean:.2} (ideal 2)");
        assert!((0.5..=4.0).contains(&mean), "{d}: {mean}");
    }
}

/// Errors at stage `stage` in degree of freedom `dof`: (prediction, hold, constant velocity).
fn prediction_errors(runs: &[Run], dof: usize, stage: usize) -> [f64; 3] {
    let mut squares = [const { Vec::new() }; 3];
    for r in runs {
        for (start, p) in &r.predictions {
            let h = f64::from(p.step_s) * stage as f64;
            let at = start + 100.0 * h;
            let (i, f) = (at.floor() as usize, at.fract());
            let (a, b) = (r.truth[i].eta[dof], r.truth[i + 1].eta[dof]);
            let truth = a + f * difference(dof, b, a);
            let origin = if dof < 3 { p.origin[dof] } else { 0.0 };
            let first = &p.stages[0];
            let now = origin + f64::from(first.eta[dof]);
            let said = [
                origin + f64::from(p.stages[stage].eta[dof]),
                now,
                now + h * f64::from(first.eta_dot[dof]),
            ];
            for (s, v) in squares.iter_mut().zip(said) {
                s.push(difference(dof, v, truth).powi(2));
            }
        }
    }
    squares.map(|s| rms(&s))
}

#[test]
fn the_prediction_beats_holding_and_constant_velocity() {
    let runs: Vec<Run> = (10..13).map(|s| run(s, "moderate", Course::Drift, 60)).collect();
    // Heave, roll, pitch at 0.6, 1 and 2 s. Heave carries the 0.09 m of the receiver's wander.
    for dof in [2, 3, 4] {
        for stage in [3, 5, 10] {
            let [model, hold, velocity] = prediction_errors(&runs, dof, stage);
            println!(
                "{dof} at {:.1} s: {model:.4} {hold:.4} {velocity:.4}",
                0.2 * stage as f64
            );
            assert!(model < 0.8 * hold && model < 0.8 * velocity, "{dof} {stage}");
            let limit = if dof == 2 { 0.25 } else { 0.0175 };
            assert!(model < limit, "{dof} {stage}: {model}");
        }
    }
}

#[test]
fn a_square_course_at_2_mps_keeps_state_and_prediction() {
    let runs = [run(20, "moderate", Course::Square, 60)];
    let mut tilt = Vec::new();
    for (k, e) in &runs[0].estimates {
        for d in [3, 4] {
            tilt.push(difference(d, e.eta[d], runs[0].truth[*k].eta[d]).powi(2));
        }
    }
    assert!(rms(&tilt) < 0.017, "{}", rms(&tilt));
    for dof in [3, 4] {
        let [model, hold, velocity] = prediction_errors(&runs, dof, 5);
        println!("{dof}: {model:.4} {hold:.4} {velocity:.4}");
        assert!(model < hold && model < velocity, "{dof}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let (a, b) = (
        run(5, "moderate", Course::Drift, 2),
        run(5, "moderate", Course::Drift, 2),
    );
    assert_eq!(a.estimates, b.estimates);
    assert_eq!(a.predictions, b.predictions);
}
