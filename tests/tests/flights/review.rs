use std::path::Path;

use alight_shared::{
    estimation::moments,
    frames::wrap_angle,
    msg::{AttitudeFix, GnssFix, Header, HeadingFix, NOT_MEASURED_SD},
};
use alight_sim::harness::physics::Physics;
use alight_usv::{
    VesselNodeConfig,
    estimator::InnovationChannel,
    log::{self, SensorRecording},
    review::{Review, review},
    sensors::{Measurement, Mount},
};

use crate::at_sea;

/// Recordings at 10 Hz of the vessel's sensors and of a motion sensor; standard deviations of true heave (m),
/// roll and pitch (rad); period of the highest wave (s).
fn recorded(sea: &str, seed: u64, seconds: usize) -> (SensorRecording, SensorRecording, [f64; 4]) {
    let scenario = at_sea(sea);
    let mut physics = Physics::new(&scenario, seed).unwrap();
    let mut real = SensorRecording::default();
    let mut motion = SensorRecording::default();
    let mut truth = Vec::new();
    for k in 0..100 * seconds {
        let state = physics.vessel();
        let readings = physics.vessel_readings();
        let all = &mut real.measurements;
        all.extend(readings.imu.into_iter().map(Measurement::Imu));
        all.extend(readings.gnss.into_iter().map(Measurement::Gnss));
        all.extend(readings.heading.into_iter().map(Measurement::Heading));
        let (roll, pitch, yaw) = state.attitude.euler();
        truth.push([state.position.0.z, roll, pitch]);
        if k % 10 == 0 {
            let header = Header::new(1, 0, 1, k as u32, physics.vessel_now());
            // A reproducible error of the configured size.
            let error = |n: f64| (0.7 * n * k as f64).sin() * 2.0_f64.sqrt();
            let sd = 0.003;
            motion.measurements.push(Measurement::Attitude(AttitudeFix {
                header,
                tilt: [roll + sd * error(1.1), pitch + sd * error(1.7)],
                tilt_sd: sd,
                heave: Some(state.position.0.z + 0.03 * error(2.3)),
                heave_sd: 0.03,
                ..AttitudeFix::default()
            }));
            motion.measurements.push(Measurement::Gnss(GnssFix {
                header,
                position: state.position.0.into(),
                position_sd: [0.3, 0.3, NOT_MEASURED_SD],
                velocity_sd: [NOT_MEASURED_SD; 3],
                lever_arm: Some([0.0; 3]),
                ..GnssFix::default()
            }));
            motion.measurements.push(Measurement::Heading(HeadingFix {
                header,
                heading: wrap_angle(yaw),
                heading_sd: 0.01,
                ..HeadingFix::default()
            }));
        }
        physics.advance();
    }
    let sd = [0, 1, 2].map(|c| {
        let of_one: Vec<f64> = truth.iter().map(|v| v[c]).collect();
        moments(&of_one).1
    });
    let highest = physics
        .sea()
        .components()
        .iter()
        .max_by(|a, b| a.amplitude_m.total_cmp(&b.amplitude_m))
        .unwrap();
    let period = core::f64::consts::TAU / highest.frequency;
    (real, motion, [sd[0], sd[1], sd[2], period])
}

fn assert_near(what: &str, got: f64, want: f64, fraction: f64) {
    assert!((got / want - 1.0).abs() < fraction, "{what}: {got}, not {want}");
}

fn assert_sea(r: &Review, sd: [f64; 4]) {
    let tilt = r.motion_sd[1].unwrap().hypot(r.motion_sd[2].unwrap());
    assert_near("heave", r.motion_sd[0].unwrap(), sd[0], 0.25);
    assert_near("tilt", tilt, sd[1].hypot(sd[2]).to_degrees(), 0.15);
    assert_near("Hs", r.sea.significant_height_m.unwrap(), 4.0 * sd[0], 0.25);
    assert_near("peak period", r.sea.peak_period_s.unwrap(), sd[3], 0.1);
    assert!(r.sea.identified_fraction > 0.8, "{}", r.sea.identified_fraction);
    for p in r
        .predictions
        .iter()
        .filter(|p| ["heave", "roll", "pitch"].contains(&p.what))
    {
        // 2 s is 0.4 of a period, where a constant estimate has its largest error.
        assert!(
            p.rms[2] < 0.35 * p.hold_rms[2],
            "{}: {:?} {:?}",
            p.what,
            p.rms,
            p.hold_rms
        );
        assert!(p.count > 150, "{}", p.count);
    }
}

#[test]
fn review_of_a_simulated_recording() {
    let (real, motion, sd) = recorded("0.5,5", 101, 240);
    let config = VesselNodeConfig::default();
    let r = review(&config, &real);
    assert_sea(&r, sd);
    for f in &r.innovations {
        assert!(f.nis_mean < 2.5 && f.inside_95 > 0.85, "{f:?}");
    }
    assert_eq!((r.restarts, r.notes.len()), (0, 0));

    // A motion sensor without an IMU.
    let r = review(&config, &motion);
    assert_sea(&r, sd);
    let channels: Vec<InnovationChannel> = r.innovations.iter().map(|f| f.channel).collect();
    assert_eq!(
        channels,
        [
            InnovationChannel::Position,
            InnovationChannel::Heading,
            InnovationChannel::Tilt,
            InnovationChannel::Heave
        ]
    );
}

#[test]
fn review_of_reordered_and_far_dated_measurements() {
    let (real, _, _) = recorded("0.5,5", 103, 150);
    let config = VesselNodeConfig::default();
    let clean = review(&config, &real);
    let mut bad = real.clone();
    bad.measurements.clear();
    for (k, m) in real.measurements.iter().enumerate() {
        bad.measurements.push(*m);
        if k % 50 == 7 {
            bad.measurements.push(*m);
        }
        if k % 400 == 11 {
            let ahead = m.at() + alight_shared::time::Span::from_secs(86_400.0);
            bad.measurements.push(m.of(m.source(), ahead));
        }
    }
    for k in (100..bad.measurements.len() - 1).step_by(97) {
        bad.measurements.swap(k, k + 1);
    }
    let r = review(&config, &bad);
    let counted: u64 = r.sources.iter().map(|s| s.counts.out_of_order).sum();
    assert!(counted as usize >= real.measurements.len() / 50, "{counted}");
    assert!(
        r.outliers_in_time as usize >= real.measurements.len() / 400 - 2,
        "{}",
        r.outliers_in_time
    );
    assert_eq!(r.restarts, 0);
    for (a, b) in r.predictions.iter().zip(&clean.predictions) {
        assert!(
            a.rms[1] < 1.5 * b.rms[1] + 1e-3,
            "{}: {:?} {:?}",
            a.what,
            a.rms,
            b.rms
        );
    }
}

#[test]
#[ignore = "needs ../shared/data/tank-platform.csv"]
fn review_of_a_recorded_platform() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/tank-platform.csv");
    let bytes = std::fs::read(&file).unwrap();
    let recorded = log::read(&bytes, "tank", &Mount::default()).unwrap();
    assert_eq!((recorded.decoded.good, recorded.decoded.corrupted), (6461, 0));
    let r = review(&VesselNodeConfig::default(), &recorded);
    assert_eq!(r.restarts, 0);
    assert!(r.sea.significant_height_m.is_none(), "it has no heave");
    let [roll, pitch] = ["roll", "pitch"].map(|w| r.predictions.iter().find(|p| p.what == w).unwrap());
    for p in [roll, pitch] {
        // The deck rocks at 1.4 Hz, faster than any wave: the prediction is of little use, as its reported error shows.
        assert!(p.rms[1] < p.hold_rms[1], "{p:?}");
        assert!(p.inside_95[1] > 0.9 && p.inside_95[2] > 0.9, "{p:?}");
    }
}

#[test]
fn review_of_quantities_on_rows_of_their_own() {
    // A boat in a figure of eight for 100 s, from canboat/canboat, samples/ (Apache-2.0), with shifted longitude.
    let recorded = log::read(
        include_bytes!("data/figure-of-eight.csv"),
        "eight",
        &Mount::default(),
    )
    .unwrap();
    assert_eq!((recorded.decoded.good, recorded.decoded.corrupted), (3000, 0));
    let attitudes = || recorded.measurements.iter().filter_map(Measurement::attitude);
    // Every fix that has a row must be kept.
    let fixes = recorded.measurements.iter().filter(|m| m.kind() == 1).count();
    let rated = attitudes().filter(|a| a.rates.is_some());
    let heaved = attitudes().filter(|a| a.heave.is_some());
    assert!(
        rated.count() > 950 && heaved.count() >= 95 && fixes > 850,
        "{fixes}"
    );
    let r = review(&VesselNodeConfig::default(), &recorded);
    assert_eq!(r.restarts, 0);
    assert!(
        r.notes.iter().any(|n| n.contains("no accelerations")),
        "{:?}",
        r.notes
    );
    for channel in [
        InnovationChannel::Position,
        InnovationChannel::Velocity,
        InnovationChannel::Heading,
        InnovationChannel::Tilt,
        InnovationChannel::Heave,
        InnovationChannel::Rate,
    ] {
        let fit = r.innovations.iter().find(|f| f.channel == channel);
        assert!(
            fit.is_some_and(|f| f.fused > 20 && f.inside_95 > 0.8),
            "{channel:?}: {fit:?}"
        );
    }
    let [heave, roll, pitch] = r.motion_sd.map(Option::unwrap);
    assert!(heave < 0.1 && roll < 2.5 && pitch < 1.5, "{heave} {roll} {pitch}");
}
