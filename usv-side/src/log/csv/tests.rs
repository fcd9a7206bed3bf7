use super::*;

fn table(rows: usize) -> String {
    let mut text = String::from("t_s,roll_deg,pitch_deg,heading_deg,heave_m,surge_m,sway_m\n");
    for k in 0..rows {
        text += &format!("{:.1},1,2,90,0.5,3,4\n", 0.1 * k as f64);
    }
    text
}
fn parse(text: &str) -> Result<SensorRecording, LogError> {
    read(text.as_bytes(), "t", &Mount::default())
}

#[test]
fn csv_column_groups() {
    let r = parse(&table(60)).unwrap();
    let [
        Measurement::Attitude(a),
        Measurement::Gnss(g),
        Measurement::Heading(h),
    ] = r.measurements[..3]
    else {
        panic!("{:?}", &r.measurements[..3]);
    };
    assert!((a.tilt[0] - 1_f64.to_radians()).abs() < 1e-12 && (a.tilt[1] - 2_f64.to_radians()).abs() < 1e-12);
    assert_eq!(a.heave, Some(-0.5), "down");
    assert!((h.heading - 90_f64.to_radians()).abs() < 1e-12);
    // Forward is east.
    assert!(
        (g.position[1] - 3.0).abs() < 1e-9 && (g.position[0] + 4.0).abs() < 1e-9,
        "{g:?}"
    );
    assert_eq!((r.measurements.len(), r.decoded.good), (180, 60));
    let commented = format!("# a logger's line\n{}", table(60));
    let same = crate::log::read(commented.as_bytes(), "t", &Mount::default()).unwrap();
    assert!(same.measurements == r.measurements);
    assert!(r.notes.is_empty(), "{:?}", r.notes);
}

#[test]
fn csv_bad_rows_and_headers() {
    let mut text = table(60);
    text += "6.0,x,2,90,0,3,4\n\n6.1,1,2\n6.2,1,NaN,90,0,3,4\n";
    let r = parse(&text).unwrap();
    assert_eq!((r.decoded.good, r.decoded.corrupted), (60, 3));
    assert!(
        r.notes[0].contains("line 62") && r.notes[0].contains("roll_deg"),
        "{:?}",
        r.notes
    );
    for (bad, message) in [
        ("t_s,roll_deg\n0,1\n", "pitch_deg"),
        ("t_s,roll\n0,1\n", "unknown column `roll`"),
        ("roll_deg,pitch_deg\n0,1\n", "t_s"),
        ("t_s,t_s\n0,1\n", "twice"),
        ("t_s,rol_deg\n0,1\n", "rol_deg"),
        ("t_s,roll_deg,pitch_deg\n0,a,1\n", "line 2"),
        ("t_s,roll_deg,pitch_deg\n0,1,1\n", "too few"),
        ("t_s,heave_m\n0,1\n", "without `roll_deg`"),
        (
            "t_s,gyro_x_radps,gyro_y_radps,gyro_z_radps\n0,1,1,1\n",
            "rates alone",
        ),
    ] {
        let e = parse(bad).unwrap_err().to_string();
        assert!(e.contains(message), "{bad}: {e}");
    }
}

/// Attitude, rates, heave, position and velocity on separate rows.
fn bus() -> String {
    let mut rows = Vec::new();
    for k in 0..600 {
        let t = 0.1 * f64::from(k);
        let roll = 10.0 * (0.8 * t).sin();
        rows.push((t, format!("{t:.3},{roll:.4},1,,,,,,,,")));
        let t = t + 0.013;
        let rate = 8.0_f64.to_radians() * (0.8 * t).cos();
        rows.push((t, format!("{t:.3},,,,{rate:.6},0,0,,,,")));
    }
    for k in 0..59 {
        let t = f64::from(k) + 0.452;
        rows.push((t, format!("{t:.3},,,{:.4},,,,,,,", 0.3 * (0.8 * t).cos())));
    }
    for k in 0..240 {
        let t = 0.25 * f64::from(k) + 0.031;
        rows.push((t, format!("{t:.3},,,,,,,50,{:.7},,", 14.0 + 1e-6 * t)));
        rows.push((t + 0.1, format!("{:.3},,,,,,,,,3.5,-0.5", t + 0.1)));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let head = "t_s,roll_deg,pitch_deg,heave_m,gyro_x_radps,gyro_y_radps,gyro_z_radps,latitude_deg,\
                longitude_deg,north_mps,east_mps\n";
    head.to_owned() + &rows.into_iter().map(|(_, r)| r + "\n").collect::<String>()
}

#[test]
fn csv_fixes_of_a_receiver_without_a_fix() {
    let row = |k: u32| {
        let place = if k < 60 { "0,0" } else { "50,14" };
        let t = 0.2 * f64::from(k);
        format!("{t:.1},{:.3},1,{place},3\n", 5.0 * t.sin())
    };
    let rows: String = (0..300).map(row).collect();
    let r = parse(&("t_s,roll_deg,pitch_deg,latitude_deg,longitude_deg,altitude_m\n".to_owned() + &rows))
        .unwrap();
    let fixes = r.measurements.iter().filter(|m| m.kind() == 1).count();
    assert_eq!(fixes, 240);
    assert!(
        r.notes.iter().any(|n| n.starts_with("60 fixes at 0 N 0 E")),
        "{:?}",
        r.notes
    );
}

#[test]
fn csv_quantities_on_rows_of_their_own() {
    let r = parse(&bus()).unwrap();
    let mut counts = [0; 4];
    for m in &r.measurements {
        counts[m.kind()] += 1;
    }
    assert_eq!(counts, [0, 480, 0, 659]);
    let mut rated = 0;
    let mut heaved = 0;
    for m in &r.measurements {
        let t = m.at().secs();
        match m {
            Measurement::Attitude(a) => {
                assert!(
                    (a.tilt[0].to_degrees() - 10.0 * (0.8 * t).sin()).abs() < 0.02,
                    "{t}: {a:?}"
                );
                if let Some(rates) = a.rates {
                    rated += 1;
                    assert!(
                        (rates[0].to_degrees() - 8.0 * (0.8 * t).cos()).abs() < 0.02,
                        "{t}: {a:?}"
                    );
                }
                if let Some(heave) = a.heave {
                    heaved += 1;
                    assert!((heave + 0.3 * (0.8 * t).cos()).abs() < 1e-3, "{t}: {a:?}");
                }
            }
            Measurement::Gnss(g) if g.velocity_sd[0] < NOT_MEASURED_SD => {
                assert_eq!((g.velocity[0], g.position_sd[0]), (3.5, NOT_MEASURED_SD));
                assert!((g.datum.latitude_deg - 50.0).abs() < 1e-9 && g.datum.longitude_deg > 13.9);
            }
            Measurement::Gnss(g) => {
                assert!(
                    g.position_sd[0] < 1.0 && g.position_sd[2] == NOT_MEASURED_SD,
                    "{g:?}"
                );
            }
            Measurement::Imu(_) | Measurement::Heading(_) => panic!("{m:?}"),
        }
    }
    assert_eq!((heaved, rated), (59, 658));
    let notes = r.notes.join("\n");
    for what in [
        "no accelerations",
        "heave on 59 rows",
        "240 velocities",
        "no altitude",
    ] {
        assert!(notes.contains(what), "{what}: {notes}");
    }
}

#[test]
fn csv_of_unusable_content() {
    let rows = |line: &str| -> String { (0..60).map(|k| line.replace('T', &format!("{k}"))).collect() };
    let inertial = "t_s,gyro_x_radps,gyro_y_radps,gyro_z_radps,accel_x_mps2,accel_y_mps2,accel_z_mps2\n";
    let coarse: String = (0..600).map(|k| format!("{},1,2\n", k / 10)).collect();
    for (text, messages) in [
        (
            "time,roll_deg,pitch_deg\n".to_owned() + &rows("T,0,3\n"),
            ["column `t_s` is missing", "python -m alight.convert FILE"],
        ),
        (
            "t_s;roll_deg;pitch_deg\n".to_owned() + &rows("T;0,5;3,5\n"),
            ["column `t_s` is missing", "python -m alight.convert FILE"],
        ),
        (
            "t_s,Roll [deg],pitch_deg\n".to_owned() + &rows("T,0,3\n"),
            [
                "line 1: unknown column `Roll [deg]`",
                "python -m alight.convert FILE",
            ],
        ),
        (
            "t_s,roll_deg,pitch_deg\n".to_owned() + &rows("T,0,5,3,5\n"),
            ["line 2: 5 values for 3 columns", "decimal point"],
        ),
        (
            "t_s,roll_deg,pitch_deg\n".to_owned() + &rows("12:00:T,0,3\n"),
            ["line 2: t_s is `12:00:0`", "not a number"],
        ),
        (
            "t_s,roll_deg,pitch_deg\n".to_owned() + &coarse,
            ["line 3: 540 of 600 rows", "python -m alight.convert FILE"],
        ),
        (
            inertial.to_owned() + &rows("T,0,0,0,0,0,0.1\n"),
            ["gravity", "m/s²"],
        ),
        (
            inertial.to_owned() + &rows("T,0,0,0,0,0,9.8\n"),
            ["[180, 0, 0]", "m/s²"],
        ),
    ] {
        let e = crate::log::read(text.as_bytes(), "t", &Mount::default())
            .unwrap_err()
            .to_string();
        assert!(messages.iter().all(|m| e.contains(m)), "{messages:?}: {e}");
    }
}
