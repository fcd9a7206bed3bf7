//! `alight estimate`: reports of readable recordings; exit code 2 and a reason for others.
use crate::program::{alight, assert_rejected, file, json, scratch, stderr, stdout, succeeds};

/// Two minutes of a boat in a swell of 5 s, as a motion sensor and a receiver measure it at 5 Hz.
fn nmea() -> String {
    let sentence = |body: String| {
        let sum = body.bytes().fold(0_u8, |a, b| a ^ b);
        format!("${body}*{sum:02X}\r\n")
    };
    let mut text = String::new();
    for k in 0..900_u32 {
        let t = 0.2 * f64::from(k);
        let w = core::f64::consts::TAU / 5.0 * t;
        let time = format!("12{:02}{:02}.{}0", k / 300, (k / 5) % 60, 2 * (k % 5));
        text += &sentence(format!(
            "PASHR,{time},10.0,T,{:.2},{:.2},{:.3},0.1,0.1,0.3,2,1",
            3.0 * w.sin(),
            2.0 * w.cos(),
            0.4 * (w + 0.4).sin()
        ));
        text += &sentence(format!(
            "GPGGA,{time},5000.0000,N,01430.0000,E,4,12,0.8,{:.3},M,45.0,M,1.0,0001",
            210.0 + 0.4 * (w + 0.4).sin()
        ));
        text += &sentence("GPVTG,10.0,T,,M,0.0,N,0.0,K,D".into());
    }
    text
}

#[test]
fn estimate_of_an_nmea_log() {
    let name = file("boat.nmea", nmea() + "$GPGGA,12");
    let o = succeeds(format!("estimate {name}"));
    let text = stdout(&o);
    for part in ["NMEA 0183, 179.8 s", "attitude 0", "Hs", "mean NIS", "0.5 s"] {
        assert!(text.contains(part), "{part} is missing in:\n{text}");
    }
    assert!(text.lines().all(|l| l.chars().count() <= 100), "{text}");
    let o = alight(format!("estimate {name} --json"));
    let v = json(&o);
    assert_eq!(
        (&v["decoded"]["good"], &v["decoded"]["corrupted"]),
        (&2700.into(), &1.into())
    );
    let period = v["sea"]["peak_period_s"].as_f64().unwrap();
    assert!((period - 5.0).abs() < 0.1, "{period}");
    let height = v["sea"]["significant_height_m"].as_f64().unwrap();
    assert!(
        (height / (4.0 * 0.4 / 2.0_f64.sqrt()) - 1.0).abs() < 0.2,
        "{height}"
    );
    let roll = v["predictions"]
        .as_array()
        .unwrap()
        .iter()
        .find(|p| p["what"] == "roll")
        .unwrap();
    assert!(roll["rms"][2].as_f64() < roll["hold_rms"][2].as_f64(), "{roll}");
    assert!(
        roll["ridge_rms"][2].as_f64() < roll["hold_rms"][2].as_f64(),
        "{roll}"
    );
    assert!(text.contains("ridge"), "{text}");
}

#[test]
fn estimate_and_calibration_of_a_table() {
    let rows = (0..900).map(|k| {
        let t = 0.1 * f64::from(k);
        let wave = 1.2 * t;
        let cells = [t, 5.0 * wave.sin(), 1.5 + 0.5 * wave.cos(), 0.4 * wave.cos()];
        cells.map(|cell| format!("\"{cell:.4}\"")).join(",") + "\n"
    });
    let text = "t_s,roll_deg,pitch_deg,heave_m\n".to_owned() + &rows.collect::<String>();
    let name = file("table.csv", text);
    let o = alight(format!("estimate {name} --json"));
    assert_eq!(
        (o.status.code(), &json(&o)["decoded"]["good"]),
        (Some(0), &900.into())
    );
    let o = alight(format!("calibrate vessel {name}"));
    assert!(stdout(&o).contains("90 s recorded"), "{}", stdout(&o));
}

#[test]
fn estimate_of_an_alight_recording() {
    let scenario = file("own.toml", "[start]\nwarm_up_s = 40.0\n");
    let name = scratch("own.mcap").display().to_string();
    let o = alight(format!(
        "trial --seed 104 --json --scenario {scenario} --record {name}"
    ));
    assert!(o.status.code().is_some_and(|c| c < 2), "{}", stderr(&o));
    let o = succeeds(format!("estimate {name} --json"));
    let v = json(&o);
    assert_eq!((&v["format"], &v["restarts"]), (&"MCAP".into(), &0.into()));
    assert_eq!(v["innovations"][0]["channel"], "gyro");
    assert!(v["estimates"].as_u64().unwrap() > 1000);
}

#[test]
fn estimate_of_an_unreadable_file() {
    let half = nmea().into_bytes();
    let good = file("good.nmea", &half);
    let config = file("bad-vessel.toml", "[sensor]\nsauces = []\n");
    let sources = file("sources.toml", "[[sensor.sources]]\nname = \"mast\"\n");
    let rows: String = (0..=10).map(|t| format!("{t},1\n")).collect();
    let logs: [(&str, &[u8], &str); 6] = [
        ("empty.log", b"", "empty"),
        ("noise.bin", &[7; 5000], "no known recording format"),
        ("bad-rows.csv", b"t_s,roll_deg,pitch_deg\n0,x,1\n", "line 2"),
        ("short.nmea", &half[..2000], "too few"),
        ("cut-off.mcap", b"\x89MCAP0\r\n\x01", "cut off"),
        (
            "still.csv",
            &[b"t_s,heading_deg\n", rows.as_bytes()].concat(),
            "never started",
        ),
    ];
    let of_log = |(name, bytes, part): (&str, &[u8], _)| (format!("estimate {}", file(name, bytes)), part);
    assert_rejected(&logs.map(of_log));
    assert_rejected(&[
        ("estimate /nonexistent/boat.csv".into(), "/nonexistent/boat.csv"),
        (format!("estimate {good} --config {config}"), "sauces"),
        (
            format!("estimate {good} --config {sources} --source keel"),
            "mast",
        ),
    ]);
}
