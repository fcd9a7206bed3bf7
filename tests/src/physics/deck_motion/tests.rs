use proptest::prelude::*;

use super::*;
use crate::physics::sea::SeaConfig;
use alight_shared::config::{Check, Keys};

fn calm() -> Sea {
    Sea::from_components(Vec::new())
}
fn play(text: &str, config: &DeckMotionConfig, sea: &Sea) -> Result<RecordedMotion, DeckMotionError> {
    let recording = Recording::parse(text.as_bytes(), "test.csv")?;
    RecordedMotion::new(config, recording, &DeckGeometry::default(), sea, &Streams::new(1))
}
fn rejection(text: &str) -> String {
    play(text, &DeckMotionConfig::default(), &calm())
        .err()
        .map(|e| e.to_string())
        .unwrap_or_default()
}
/// 30 s of swell at 10 Hz with every column; the heading turns through south.
fn full() -> String {
    let mut text = String::from("t_s,roll_deg,pitch_deg,heave_m,heading_deg,surge_m,sway_m\n");
    for i in 0..300 {
        let t = 0.1 * f64::from(i) + 0.01 * f64::from(i % 3);
        let heading = (178.0 + 10.0 * (0.3 * t).sin() + 180.0).rem_euclid(360.0) - 180.0;
        text += &format!(
            "{t},{},{},{},{heading},{},{}\n",
            9.0 + 5.0 * (1.1 * t).sin(),
            3.0 * (1.3 * t).cos() - 2.0,
            0.3 * (0.9 * t).sin(),
            0.5 * (0.8 * t).cos(),
            0.2 * (0.7 * t).sin()
        );
    }
    text
}
fn assert_consistent(motion: &RecordedMotion, sea: &Sea, seconds: f64) {
    let h = 1e-3;
    let n = (seconds / 0.037) as i32;
    for i in 1..n {
        let t = 0.037 * f64::from(i);
        let at = |t: f64| motion.state_at(Time::from_secs(t), sea);
        let a = at(t - h);
        let b = at(t);
        let c = at(t + h);
        let v = (c.position.0 - a.position.0) / (2.0 * h);
        assert!((v - b.velocity.0).norm() < 2e-3, "{t}: {v} {}", b.velocity.0);
        let acc = (c.velocity.0 - a.velocity.0) / (2.0 * h);
        assert!(
            (acc - b.acceleration.0).norm() < 0.05 * (1.0 + b.acceleration.norm()),
            "{t}: {acc} {}",
            b.acceleration.0
        );
        let w = (a.attitude.0.inverse() * c.attitude.0).scaled_axis() / (2.0 * h);
        assert!((w - b.rates.0).norm() < 2e-3, "{t}: {w} {}", b.rates.0);
        let dw = (c.rates.0 - a.rates.0) / (2.0 * h);
        let scale = 1.0 + b.angular_acceleration.0.norm();
        assert!((dw - b.angular_acceleration.0).norm() < 0.05 * scale, "{t}: {dw}");
    }
}

#[test]
fn recorded_motion_derivatives_past_its_end() {
    let sea = calm();
    let motion = play(&full(), &DeckMotionConfig::default(), &sea).unwrap();
    assert_consistent(&motion, &sea, 80.0);
    let fast = DeckMotionConfig {
        speed: 1.7,
        scale: 1.5,
        start_s: 11.0,
        ..DeckMotionConfig::default()
    };
    assert_consistent(&play(&full(), &fast, &sea).unwrap(), &sea, 40.0);
}

#[test]
fn rocking_deck_amplitude_and_frequency() {
    let sea = calm();
    let rocking = RockingConfig {
        roll_rad: 0.4,
        pitch_rad: 0.2,
        frequency_hz: 0.9,
    };
    let config = DeckMotionConfig {
        rocking: Some(rocking),
        scale: 0.5,
        ..DeckMotionConfig::default()
    };
    let motion = RecordedMotion::rocking(
        &config,
        &rocking,
        &DeckGeometry::default(),
        &sea,
        &Streams::new(3),
    );
    assert_consistent(&motion, &sea, 20.0);
    let mut peak = [0.0_f64; 2];
    let mut crossings = 0;
    let mut before = 0.0;
    for k in 0..4000 {
        let (roll, pitch, _) = motion
            .state_at(Time::from_secs(0.01 * f64::from(k)), &sea)
            .attitude
            .0
            .euler_angles();
        peak = [peak[0].max(roll.abs()), peak[1].max(pitch.abs())];
        crossings += i32::from(before < 0.0 && roll >= 0.0);
        before = roll;
    }
    assert!(
        (peak[0] - 0.2).abs() < 1e-3 && (peak[1] - 0.1).abs() < 1e-3,
        "{peak:?}"
    );
    assert!((35..=37).contains(&crossings), "{crossings} in 40 s at 0.9 Hz");
    let rejected = |c: &DeckMotionConfig| c.check(&Keys::ROOT).is_err();
    assert!(!rejected(&config));
    let both = DeckMotionConfig {
        file: "both.csv".into(),
        ..config.clone()
    };
    let steep = DeckMotionConfig { scale: 3.0, ..config };
    assert!(rejected(&both) && rejected(&steep) && rejected(&DeckMotionConfig::default()));
}

#[test]
fn recorded_motion_signs() {
    let text = "t_s,roll_deg,pitch_deg,heave_m,heading_deg,surge_m,sway_m\n";
    let rows: String = (0..40)
        .map(|i| {
            let x = (0.3 * f64::from(i)).sin();
            format!(
                "{},{x},{},{},90,{},{}\n",
                0.25 * f64::from(i),
                2.0 * x,
                0.1 * x,
                0.2 * x,
                0.3 * x
            )
        })
        .collect();
    let sea = calm();
    let keep = DeckMotionConfig {
        keep_mean: true,
        ..DeckMotionConfig::default()
    };
    let motion = play(&(text.to_owned() + &rows), &keep, &sea).unwrap();
    let a = motion.state_at(Time::from_secs(0.0), &sea);
    let b = motion.state_at(Time::from_secs(1.25), &sea);
    let x = 1.5_f64.sin();
    let e = b.euler();
    assert!((e.x.to_degrees() - x).abs() < 1e-9 && (e.y.to_degrees() - 2.0 * x).abs() < 1e-9);
    // The recording describes the deck centre.
    let deck = |s: &RigidState<VesselBody>| s.at::<Deck>(DeckGeometry::default().centre()).position.0;
    let moved = deck(&b) - deck(&a);
    assert!((deck(&a).z + 1.3).abs() < 0.2 && (b.position.0 - a.position.0 - moved).norm() > 0.005);
    // Heading east: surge is east, sway (to starboard) south, heave up.
    assert!(
        (moved - Vector3::new(-0.3 * x, 0.2 * x, -0.1 * x)).norm() < 1e-9,
        "{moved}"
    );
    let starboard = b.attitude * Vector::<VesselBody>::new(0.0, 1.0, 0.0);
    let bow = b.attitude * Vector::<VesselBody>::new(1.0, 0.0, 0.0);
    assert!(starboard.0.z > 0.0 && bow.0.z < 0.0, "starboard down, bow up");
}

#[test]
fn recorded_motion_mean_tilt_and_scale() {
    let sea = calm();
    let mean = |config: &DeckMotionConfig| {
        let m = play(&full(), config, &sea).unwrap();
        let states = (0..1200).map(|i| m.state_at(Time::from_secs(0.02 * f64::from(i)), &sea));
        let mut sum = 0.0;
        let mut square = 0.0;
        for s in states {
            let roll = s.euler().x.to_degrees();
            sum += roll / 1200.0;
            square += roll * roll / 1200.0;
        }
        (sum, (square - sum * sum).sqrt())
    };
    let (plain, sd) = mean(&DeckMotionConfig::default());
    let (kept, _) = mean(&DeckMotionConfig {
        keep_mean: true,
        ..DeckMotionConfig::default()
    });
    let (twice, sd2) = mean(&DeckMotionConfig {
        scale: 2.0,
        ..DeckMotionConfig::default()
    });
    assert!(
        plain.abs() < 0.5 && (kept - plain - 9.0).abs() < 0.3,
        "{plain} {kept}"
    );
    assert!(twice.abs() < 1.0 && (sd2 / sd - 2.0).abs() < 1e-6, "{sd} {sd2}");
}

#[test]
fn recorded_heading_through_south() {
    let sea = calm();
    let motion = play(&full(), &DeckMotionConfig::default(), &sea).unwrap();
    for i in 0..3000 {
        let s = motion.state_at(Time::from_secs(0.01 * f64::from(i)), &sea);
        assert!(s.rates.0.z.abs() < 0.1, "{}", s.rates.0.z);
    }
}

#[test]
fn recorded_motion_with_repeated_stamps_and_gaps() {
    let mut text = String::from("t_s,roll_deg,pitch_deg\n");
    for i in 0..600 {
        let t = 0.1 * f64::from(i);
        if (20.0..27.0).contains(&t) || (40.0..41.0).contains(&t) {
            continue;
        }
        text += &format!("{t},{},{}\n", 5.0 * (1.5 * t).sin(), 3.0 * (1.1 * t).sin());
        if i % 7 == 0 {
            // A repeated stamp, and one shortly after it, with different values.
            text += &format!("{t},{},{}\n", 5.0 * (1.5 * t).sin() + 0.2, 3.0 * (1.1 * t).sin());
            text += &format!(
                "{},{},{}\n",
                t + 0.001,
                5.0 * (1.5 * t).sin() - 0.2,
                3.0 * (1.1 * t).sin()
            );
        }
    }
    let recording = Recording::parse(text.as_bytes(), "test.csv").unwrap();
    assert_eq!(recording.gaps, 2);
    let sea = calm();
    let motion = play(&text, &DeckMotionConfig::default(), &sea).unwrap();
    for i in 0..12_000 {
        let s = motion.state_at(Time::from_secs(0.01 * f64::from(i)), &sea);
        let e = s.euler();
        assert!(
            e.x.abs().to_degrees() < 5.8 && e.y.abs().to_degrees() < 3.5,
            "{e}"
        );
        assert!(s.rates.norm().to_degrees() < 16.0, "{}", s.rates.norm());
    }
    assert_consistent(&motion, &sea, 60.0);
}

#[test]
fn recorded_motion_without_heave() {
    let sea = Sea::new(&SeaConfig::paper(0.2, 5.0), &Streams::new(4));
    let text: String = full()
        .lines()
        .map(|l| {
            let mut v: Vec<&str> = l.split(',').collect();
            v.remove(3);
            v.join(",") + "\n"
        })
        .collect();
    let motion = play(&text, &DeckMotionConfig::default(), &sea).unwrap();
    let mut range = 0.0_f64;
    for i in 0..500 {
        let t = Time::from_secs(0.1 * f64::from(i));
        let s = motion.state_at(t, &sea);
        let deck = s.at::<Deck>(DeckGeometry::default().centre()).position.0;
        let up = sea.elevation(t, deck.x, deck.y);
        assert!((deck.z + 1.3 + up).abs() < 1e-9);
        range = range.max(up.abs());
    }
    assert!(range > 0.2);
    assert_consistent(&motion, &sea, 60.0);
}

#[test]
fn recording_with_a_bad_row() {
    let good = "t_s,roll_deg,pitch_deg\n0,1,2\n1,1,2\n2,2,1\n";
    for (row, why) in [
        ("3,x,2", "not a number"),
        ("3,nan,2", "allowed"),
        ("3,inf,2", "allowed"),
        ("3,1", "2 values for 3 columns"),
        ("3,1,2,3", "4 values for 3 columns"),
        ("3,,2", "not a number"),
        ("1.5,1,2", "earlier"),
        ("3,95,2", "allowed"),
    ] {
        let e = rejection(&format!("{good}{row}\n4,1,1\n"));
        assert!(e.contains("test.csv, line 5") && e.contains(why), "{row}: {e}");
    }
    // Line numbers include empty lines.
    let e = rejection("t_s,roll_deg,pitch_deg\n\n0,1,2\n\n1,bad,2\n");
    assert!(e.contains("line 5"), "{e}");
}

#[test]
fn recording_with_a_bad_header_or_too_few_rows() {
    assert!(rejection("").contains("t_s"));
    assert!(rejection("t_s,roll_deg\n0,1\n").contains("pitch_deg` is missing"));
    assert!(rejection("t_s,roll_deg,pitch_deg,roll_deg\n").contains("twice"));
    assert!(rejection("t_s,roll_deg,pitch_deg\n0,1,1\n1,1,1\n").contains("too few"));
    assert!(rejection("t_s,roll_deg,pitch_deg\n1,1,1\n1,2,1\n1,1,1\n1,1,2\n1,1,2\n").contains("too few"));
    let steep = DeckMotionConfig {
        scale: 15.0,
        ..DeckMotionConfig::default()
    };
    let e = play(&full(), &steep, &calm()).err().unwrap().to_string();
    assert!(e.contains("allowed is 60"), "{e}");
    let missing = DeckMotionConfig {
        file: "no/such/file.csv".into(),
        ..DeckMotionConfig::default()
    };
    let e = DeckCarrier::new(
        &VesselConfig::default(),
        Some(&missing),
        &DeckGeometry::default(),
        &calm(),
        &Streams::new(1),
    )
    .err()
    .unwrap()
    .to_string();
    assert!(e.contains("no/such/file.csv"), "{e}");
}

/// Real recording, not in the repository.
fn tank() -> Recording {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/tank-platform.csv");
    Recording::load(&path).unwrap()
}

#[test]
#[ignore = "needs ../shared/data/tank-platform.csv"]
fn tank_recording_at_twice_its_size() {
    let recording = tank();
    assert_eq!(recording.gaps, 0);
    assert!(
        (recording.mean[ROLL].to_degrees() - 4.08).abs() < 0.02,
        "{:?}",
        recording.mean
    );
    let sea = Sea::new(&SeaConfig::paper(0.2, 5.0), &Streams::new(4));
    let config = DeckMotionConfig {
        scale: 2.0,
        ..DeckMotionConfig::default()
    };
    let motion = RecordedMotion::new(
        &config,
        recording,
        &DeckGeometry::default(),
        &sea,
        &Streams::new(1),
    )
    .unwrap();
    let mut sum = Vector3::zeros();
    let mut tilt = 0.0_f64;
    let mut rate = 0.0_f64;
    let n = 70_000;
    for i in 0..n {
        let s = motion.state_at(Time::from_nanos(10_000_000 * i), &sea);
        let e = s.euler();
        sum += e / n as f64;
        tilt = tilt.max(e.xy().amax());
        rate = rate.max(s.rates.norm());
        assert!(s.acceleration.0.iter().all(|x| x.is_finite()));
    }
    assert!(sum.xy().norm().to_degrees() < 0.1, "{sum}");
    assert!((4.0..9.0).contains(&tilt.to_degrees()), "{}", tilt.to_degrees());
    assert!(rate < 2.0, "{rate} rad/s");
    assert_consistent(&motion, &sea, 20.0);
}

proptest! {
    #[test]
    fn recording_of_any_text(text in "(t_s|roll_deg|pitch_deg|heave_m|[0-9.,eE+-]|\n|,|nan){0,80}") {
        if let Err(e) = play(&text, &DeckMotionConfig::default(), &calm()) {
            prop_assert!(!e.to_string().is_empty());
        }
    }

    #[test]
    fn recording_of_any_numbers(
        rows in prop::collection::vec((0.0..3.0_f64, -80.0..80.0_f64, -50.0..50.0_f64), 2..40),
        start in 0.0..60.0_f64,
    ) {
        let mut text = String::from("t_s,roll_deg,pitch_deg\n");
        let mut t = 0.0;
        for (dt, r, p) in rows {
            t += dt * dt * dt;
            text += &format!("{t},{r},{p}\n");
        }
        let config = DeckMotionConfig { start_s: start, ..DeckMotionConfig::default() };
        let sea = calm();
        if let Ok(motion) = play(&text, &config, &sea) {
            for i in 0..200 {
                let s = motion.state_at(Time::from_secs(0.37 * f64::from(i)), &sea);
                prop_assert!(s.rates.norm().is_finite() && s.angular_acceleration.norm().is_finite());
                prop_assert!(s.position.0.norm() < 2.7);
            }
        }
    }
}

#[test]
fn recording_start_behind_its_end() {
    let late = DeckMotionConfig {
        start_s: 500.0,
        ..DeckMotionConfig::default()
    };
    let e = play(&full(), &late, &calm()).err().unwrap().to_string();
    assert!(e.contains("500 s is after its end (29.9 s)"), "{e}");
    let file = std::env::temp_dir().join(format!("alight-facts-{}.csv", std::process::id()));
    std::fs::write(&file, full()).unwrap();
    let config = DeckMotionConfig {
        file: file.clone(),
        ..DeckMotionConfig::default()
    };
    let facts = |trial_s: f64| config.facts(trial_s).unwrap().unwrap();
    assert!(facts(20.0).remarks.is_empty() && facts(20.0).heave);
    let long = facts(240.0).remarks;
    assert!(long.len() == 1 && long[0].contains("it starts over"), "{long:?}");
    std::fs::remove_file(file).unwrap();
}

#[test]
fn water_with_a_recorded_heave() {
    let sea = calm();
    for (follows, rises) in [(false, false), (true, true)] {
        let config = DeckMotionConfig {
            water_follows: follows,
            scale: 1.5,
            ..DeckMotionConfig::default()
        };
        let mut motion = play(&full(), &config, &sea).unwrap();
        let mut most = 0.0_f64;
        let rest = DeckGeometry::default().centre().z;
        for k in 0..2000 {
            motion.step(Time::from_secs(0.01 * f64::from(k)), 0.01, &sea);
            let deck = motion.state().at::<Deck>(DeckGeometry::default().centre());
            most = most.max(motion.water_lift);
            if rises {
                assert!((deck.position.0.z + motion.water_lift - rest).abs() < 1e-9);
            }
        }
        assert_eq!(most > 0.3, rises);
    }
}

#[test]
fn recording_with_whole_second_stamps() {
    let rows = |stamp: fn(u32) -> u32| -> String {
        let rows = (0..900_u32).map(|k| {
            let t = 0.1 * f64::from(k);
            format!(
                "{},{:.3},{:.3}\n",
                f64::from(stamp(k)) / 10.0,
                10.0 * (2.4 * t).sin(),
                5.0 * (1.3 * t).cos()
            )
        });
        "t_s,roll_deg,pitch_deg\n".to_owned() + &rows.collect::<String>()
    };
    let parse = |text: String| Recording::parse(text.as_bytes(), "test.csv").unwrap();
    let truth = parse(rows(|k| k));
    assert!(truth.remarks.is_empty(), "{:?}", truth.remarks);
    let coarse = rejection(&rows(|k| k / 10 * 10));
    assert!(coarse.contains("line 3: 810 of 900 rows"), "{coarse}");
    // Few rows per second and repeated stamps are accepted with remarks.
    let slow = parse(full().lines().step_by(3).map(|l| l.to_owned() + "\n").collect());
    assert!(
        slow.remarks.iter().any(|r| r.contains("fewer than 5")),
        "{:?}",
        slow.remarks
    );
    let twice = rows(|k| if k % 50 == 1 { k - 1 } else { k });
    assert!(
        parse(twice).remarks[0].starts_with("18 rows"),
        "a few repeated stamps"
    );
}

/// Satellite compass and motion sensor of a boat: 100 s of a figure of eight, with attitude and rates at 10
/// Hz, heave at 1 Hz, position at 5 Hz and velocity at 4 Hz in separate rows. Source: canboat/canboat,
/// samples/ (Apache-2.0), with the longitude shifted by 100 deg.
const UNDER_WAY: &str = include_str!("../../../tests/flights/data/figure-of-eight.csv");

#[test]
fn recording_of_quantities_on_rows_of_their_own() {
    let recording = Recording::parse(UNDER_WAY.as_bytes(), "under-way.csv").unwrap();
    let remarks = recording.remarks.join("\n");
    for expected in [
        "heave_m has separate rows at 1.0 Hz",
        "ignored columns, which are not deck motion: gyro_x_radps",
        "north_mps",
    ] {
        assert!(remarks.contains(expected), "{expected}: {remarks}");
    }
    assert_eq!(recording.has, [true, true, true, true, false, false]);
    assert!(
        (990..=1000).contains(&recording.t.len()) && recording.gaps == 0,
        "{}",
        recording.t.len()
    );
    assert!(
        (recording.mean[ROLL].to_degrees() - 3.33).abs() < 0.05,
        "{:?}",
        recording.mean
    );
    // The boat turns by 108 deg and then back by half of that; the heading does not jump.
    let heading = || recording.y.iter().map(|y| y[HEADING].to_degrees());
    let turned = heading().fold(f64::MIN, f64::max) - heading().fold(f64::MAX, f64::min);
    assert!((100.0..115.0).contains(&turned), "{turned}");
    assert!(
        recording
            .y
            .windows(2)
            .all(|w| (w[1][HEADING] - w[0][HEADING]).abs() < 0.05)
    );
    let sea = calm();
    let motion = play(UNDER_WAY, &DeckMotionConfig::default(), &sea).unwrap();
    for i in 0..9000 {
        let s = motion.state_at(Time::from_secs(0.01 * f64::from(i)), &sea);
        assert!(
            s.rates.norm() < 0.3 && s.acceleration.norm() < 3.0,
            "{i}: {}",
            s.acceleration.norm()
        );
    }
}
