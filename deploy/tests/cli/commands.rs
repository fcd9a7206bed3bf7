//! Commands: exit codes, errors, JSON, determinism.
use std::{
    fs,
    io::Write,
    process::{Command, Stdio},
};

use crate::program::{alight, assert_rejected, file, json, scratch, stderr, stdout, succeeds};

#[test]
fn bad_input_exit_code_2() {
    let bad_key = file("bad-key.toml", "[sea]\nheight = 3\n");
    let bad_range = file("bad-range.toml", "solve_delay_s = 7.5\n");
    let not_finite = file("not-finite.toml", "solve_delay_s = nan\n");
    let bad_row = file("bad-row.csv", "t_s,roll_deg,pitch_deg\n0.0,1,1\n0.1,x,1\n");
    let no_file = "/nonexistent/scene.toml";
    let hull = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/hulls/mono-5m.toml");
    assert_rejected(&[
        ("trial --no-such-flag".into(), "--no-such-flag"),
        ("trial --sea stormy".into(), "stormy"),
        ("trial --sea -1,5".into(), "amplitude_m"),
        ("trial --sea nan,5".into(), "nan"),
        ("trial --seed -3".into(), "-3"),
        ("trial --seed 1.5".into(), "a whole number is needed"),
        ("trial --trials 1e3".into(), "a whole number from"),
        ("keys vessel one".into(), "a whole number is needed"),
        ("trial --wind nan".into(), "NaN"),
        ("trial --wind 300".into(), "300"),
        ("trial --speed -2 --vessel straight".into(), "-2"),
        ("trial --speed 5".into(), "--vessel"),
        ("trial --planner magic".into(), "magic"),
        ("trial --planner exec:".into(), "exec:python3 mine.py"),
        ("land --planner exec:true --log x".into(), "alight trial --record"),
        (format!("trial --scenario {no_file}"), no_file),
        (format!("trial --scenario {bad_key}"), "height"),
        (format!("trial --scenario {bad_range}"), "solve_delay_s"),
        (format!("trial --scenario {not_finite}"), "solve_delay_s"),
        (format!("trial --drone-config {bad_key}"), "sea"),
        (format!("trial --drone-config {hull}"), "--hull"),
        (format!("trial --deck-motion {no_file}"), no_file),
        (format!("trial --deck-motion {bad_row}"), "line 3"),
        ("trial --motion-scale 2".into(), "--deck-motion"),
        (format!("trial --plot {no_file}"), no_file),
        ("trial --plot landing.png".into(), ".svg"),
        ("land --plot landing.png".into(), ".svg"),
        ("land --ground-station nowhere".into(), "nowhere"),
        ("study nothing".into(), "table2"),
        (format!("study {bad_key}"), "title"),
        ("study envelope --winds 4,x".into(), "`x`"),
        ("study envelope --winds 40".into(), "`40`"),
        ("study envelope --sea-states 6".into(), "from 1 to 5"),
        ("study envelope --rate 100".into(), "50 to 99"),
        ("study envelope --sea moderate".into(), "--sea-states"),
        ("study envelope --hull no-such-hull".into(), "no-such-hull"),
        ("trial --trials 0".into(), "from 1 to 1000000"),
        ("trial --trials 2 --jobs 0".into(), "from 1 to 1024"),
        (
            "trial --seed 18446744073709551615 --trials 2".into(),
            "18446744073709551615",
        ),
        (format!("trial --trials 2 --rows {no_file}"), no_file),
        (
            "config schema estimat".into(),
            "no topic estimat: there are estimate, wave",
        ),
        ("ros2 --domain 233".into(), "from 0 to 232"),
        ("ros2 --instance none --namespace 1a".into(), "namespace"),
    ]);
}

#[test]
fn wrong_input_with_the_remedy() {
    let unclosed = file("unclosed.toml", "[sea\n");
    assert_rejected(&[
        ("trial --sae moderate".into(), "'--sea'"),
        ("land --warm-pu 20".into(), "'--warm-up'"),
        ("trial --wind 15mph".into(), "kn"),
        ("trial --outage-duration 5miles --outage-at descent".into(), "min"),
        (
            "trial --sea-state 6".into(),
            "'6' for '--sea-state <1..5>': a whole number from 1 to 5",
        ),
        ("view --listen 7450".into(), "ADDRESS:PORT is needed"),
        ("trial --record landing.txt".into(), "ends in .mcap"),
        ("land --record landing.txt".into(), "ends in .mcap"),
        ("land --trials 3".into(), "alight trial --trials N"),
        ("trial --rows rows.csv".into(), "--trials"),
        ("trial --trials 2 --plot landing.svg".into(), "--plot"),
        ("rehearse --warm-up 9s".into(), "from 10 to 600 s"),
        ("study --trials 3".into(), "STUDY"),
        ("scene".into(), "alight help scene"),
        ("trial --sea 3".into(), "--sea-state"),
        ("keys show --dir /nonexistent".into(), "alight keys init"),
        ("example nigth.toml".into(), "night.toml"),
        (format!("trial --scenario {unclosed}"), "1 | [sea\n  |     ^"),
    ]);
}

#[test]
fn processes_with_files_that_cannot_be() {
    let of = |verb: &str, flag: &str, cases: &[(&str, &'static str)]| {
        for (k, (text, part)) in cases.iter().enumerate() {
            let name = file(&format!("{verb}-{k}.toml"), text);
            assert_rejected(&[(format!("{verb} {flag} {name}"), part)]);
        }
    };
    let sources = [
        ("", "[[sensor.sources]]"),
        ("[[sensor.sources]]\nconnect = \"nmea://mast\"\n", "nmea://mast"),
        ("[[sensor.sources]]\nformat = \"seatalk\"\n", "seatalk"),
        ("[[sensor.sources]]\nlatency_s = 9.0\n", "latency_s"),
        (
            "[[sensor.sources]]\n[sensor.sources.mount]\nantenna_m = [0, 0, -900]\n",
            "antenna_m",
        ),
    ];
    of("sensors", "--config", &sources);
    let autopilot = [("", "serial:///dev/ttyACM0:921600")];
    for url in ["udp://:14540", "serial:ttyACM0"] {
        of("autopilot", &format!("--connect {url} --config"), &autopilot);
    }
    of("camera", "--print --config", &[("", "set source in [camera]")]);
    let cameras = [
        ("", "set source in [uvdar]"),
        ("[uvdar]\nsource = \"simulation\"\n", "uvdar.source"),
        ("[uvdar]\nformat = \"MJPG\"\n", "uvdar.format"),
        ("[uvdar]\nsource = \"/nowhere\"\n", "/nowhere"),
    ];
    of("uvdar", "--print --config", &cameras);
    let rehearsed = [
        ("nonsense = 1\n", "nonsense"),
        ("[[sensor.sources]]\nformat = \"nmea\"\n", "format = \"mavlink\""),
    ];
    of("rehearse", "--vessel-config", &rehearsed);
}

#[test]
fn flags_of_a_scene_shown_once() {
    let scene = stdout(&alight("help scene"));
    for flag in ["--sea-state", "--hull", "--motion-stride"] {
        assert_eq!(scene.contains(flag), flag != "--motion-stride", "{scene}");
    }
    for command in ["trial", "land", "study", "study envelope", "study rare"] {
        let text = stdout(&alight(format!("{command} --help")));
        assert!(
            !text.contains("--sea-state <") && text.contains("alight help scene"),
            "{text}"
        );
    }
}

#[test]
fn help_of_every_page() {
    let docs = crate::book::root().join("deploy/docs");
    for page in crate::book::files(&docs, &[".md"]) {
        let name = page.file_stem().unwrap().to_str().unwrap();
        let text = crate::book::read(&page);
        if name != "SUMMARY" {
            assert_eq!(
                stdout(&alight(format!("help {name}"))).trim_end(),
                text.trim_end()
            );
        }
    }
}

#[test]
fn examples_written_once() {
    let out = scratch("examples");
    fs::create_dir_all(&out).unwrap();
    let write = || alight(format!("example night.toml boat.csv --out {}", out.display()));
    let o = write();
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    let shipped = crate::book::root().join("deploy/scenarios/night.toml");
    assert_eq!(
        fs::read(out.join("night.toml")).unwrap(),
        fs::read(shipped).unwrap()
    );
    let again = write();
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("is not replaced"), "{}", stderr(&again));
    assert!(stdout(&alight("example")).contains("foxglove-layout.json"));
}

#[test]
fn completions_and_manual_pages_with_values() {
    let script = stdout(&alight("config completions zsh"));
    for value in ["very-rough", "twin-5m", "table2", "mpc-faa", "wifi-far"] {
        assert!(script.contains(value), "{value}");
    }
    let pages = scratch("pages");
    fs::create_dir_all(&pages).unwrap();
    succeeds(format!("manual {}", pages.display()));
    let page = fs::read_to_string(pages.join("alight-trial.1")).unwrap();
    for text in [r"[\fB\-\-trials\fR \fIN\fR]", r"very\-rough"] {
        assert!(page.contains(text), "{text}: {page}");
    }
}

#[test]
fn trial_json_and_plot() {
    let plot = scratch("landing.svg");
    let o = succeeds(format!("trial --seed 3 --json --plot {}", plot.display()));
    assert_eq!(stdout(&o).lines().count(), 1);
    let v = json(&o);
    for key in [
        "outcome",
        "success",
        "reason",
        "seed",
        "sea",
        "planner",
        "attempts",
        "unsafe_contacts",
        "position_error_m",
        "rest_position_error_m",
        "touchdown_speed_mps",
        "tangential_speed_mps",
        "tilt_error_deg",
        "roll_error_deg",
        "pitch_error_deg",
        "yaw_error_deg",
        "landing_time_s",
        "over_deck_time_s",
        "sim_time_s",
        "wall_time_s",
    ] {
        assert!(v.get(key).is_some(), "{key} is missing in {v}");
    }
    assert_eq!(v["sea"], "moderate");
    let svg = fs::read_to_string(&plot).unwrap();
    assert!(
        svg.starts_with("<svg") && svg.contains("touchdown") && svg.contains("roll and pitch difference")
    );
}

#[test]
fn csv_of_rows() {
    let rows = scratch("kept.csv");
    let o = succeeds(format!(
        "trial --trials 2 --seed 40 --csv --rows {}",
        rows.display()
    ));
    let printed = stdout(&o);
    let kept = fs::read_to_string(rows).unwrap();
    assert_eq!(printed.lines().next(), kept.lines().next());
    assert_eq!(printed.lines().count(), 3, "{printed}");
    // Nested values have dotted names; a quantity has the column of its name.
    let study = stdout(&alight("study wind --trials 1 --row 1 --csv"));
    let mut reader = csv::Reader::from_reader(study.as_bytes());
    let heads = reader.headers().unwrap().clone();
    let row = reader.records().next().unwrap().unwrap();
    assert_eq!((&heads[0], &heads[1]), ("scenario", "planner"), "{study}");
    let at = heads
        .iter()
        .position(|h| h == "position_error_m.mean")
        .expect(&study);
    assert!(row[at].parse::<f64>().is_ok_and(|v| v < 1.0), "{study}");
    assert_rejected(&[("study wind --csv --json".into(), "--json")]);
}

#[test]
fn trials_with_one_or_two_jobs() {
    let digests = |jobs: &str, name: &str| {
        let rows = scratch(name);
        let o = alight(format!(
            "trial --trials 3 --seed 40 --jobs {jobs} --json --rows {}",
            rows.display()
        ));
        assert!(o.status.code() != Some(2), "{}", stderr(&o));
        assert_eq!(json(&o)["trials"], 3);
        let text = fs::read_to_string(rows).unwrap();
        text.lines()
            .map(|l| l.rsplit(',').next().unwrap().to_string())
            .collect::<Vec<_>>()
    };
    let one = digests("1", "one.csv");
    let two = digests("2", "two.csv");
    assert_eq!(one.len(), 4);
    assert_eq!(one, two);
}

#[test]
fn printed_configurations() {
    let drone = file("drone.toml", alight("config drone --all").stdout);
    let scenario = file("scenario.toml", alight("config scenario").stdout);
    succeeds(format!(
        "trial --drone-config {drone} --scenario {scenario} --json --seed 5"
    ));
}

#[test]
fn match_that_succeeds() {
    let mode = "[drone.mission]\nmode = \"match\"\nlowest_clearance_m = 2.0\n";
    let drone = file("match.toml", mode);
    let o = succeeds(format!("trial --sea calm --drone-config {drone}"));
    let text = stdout(&o);
    for part in [
        "matched: matched the deck at 2.0 m",
        ", 1 attempt, 0 unsafe contacts",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn interrupted_trials() {
    let child = Command::new(env!("CARGO_BIN_EXE_alight"))
        .args("trial --trials 100000 --jobs 1 --sea calm".split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    // Longer than a landing takes, even on a busy computer.
    #[allow(clippy::disallowed_methods, reason = "a test may wait")]
    std::thread::sleep(std::time::Duration::from_secs(4));
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .expect("kill runs")
            .success()
    );
    let o = child.wait_with_output().expect("ends");
    assert_eq!(o.status.code(), Some(1), "{}", stderr(&o));
    let text = stdout(&o);
    assert!(
        text.contains("interrupted after") && text.contains("landed"),
        "{text}"
    );
}

#[test]
fn errors_to_a_reader_that_went_away() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_alight"))
        .args(["tag", "--pdf", "/nonexistent/x.pdf"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    drop(child.stderr.take());
    assert_eq!(child.wait().expect("ends").code(), Some(2));
}

#[test]
fn init_writes_both_files_once() {
    let dir = scratch("init");
    let init = |answers: &str| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_alight"))
            .args(["init", "--out"])
            .arg(&dir)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        // A program that has ended reads no input.
        let _ended = child.stdin.take().unwrap().write_all(answers.as_bytes());
        child.wait_with_output().expect("ends")
    };
    let o = init("7\n");
    assert_eq!(o.status.code(), Some(2), "{}", stdout(&o));
    assert!(stderr(&o).contains("the answers end before") && !dir.join("vessel.toml").exists());
    // All answers but the vessel's number keep the shipped values; certificates do not exist yet.
    let o = init(&format!("7\n{}", "\n".repeat(40)));
    assert_eq!(o.status.code(), Some(2), "{}", stderr(&o));
    let text = stdout(&o);
    assert!(
        text.contains("BROKEN   certificate") && text.contains("alight keys vessel 7"),
        "{text}"
    );
    let drone = fs::read_to_string(dir.join("drone.toml")).unwrap();
    assert!(
        drone.contains("vessel_id = 7")
            && drone.contains("\"vessel-7\"")
            && drone.contains("mode = \"shadow\""),
        "{drone}"
    );
    let o = init("");
    assert!(
        o.status.code() == Some(2) && stderr(&o).contains("is not replaced"),
        "{}",
        stderr(&o)
    );
}

#[test]
fn version_with_its_commit() {
    let text = stdout(&alight("--version"));
    assert!(
        text.starts_with(concat!("alight ", env!("CARGO_PKG_VERSION"))),
        "{text}"
    );
}

#[test]
fn command_without_an_installed_file() {
    // The second is the former name.
    for order in ["order", "command"] {
        let o = alight(format!("{order} abort --instance nothing-of-that-name"));
        assert_eq!(o.status.code(), Some(2));
        let text = stderr(&o);
        assert!(
            text.contains("no running drone computer found (instance \"nothing-of-that-name\")"),
            "{text}"
        );
    }
}

#[test]
fn help_on_first_commands() {
    let o = alight("--help");
    let text = stdout(&o);
    assert!(text.contains("alight trial") && text.contains("Exit codes"));
    for side in ["vessel", "drone"] {
        let text = stdout(&alight(format!("{side} --help")));
        assert!(text.contains(&format!("/etc/alight/{side}.toml]")), "{text}");
    }
    assert!(
        text.lines().all(|l| l.chars().count() <= 80),
        "wider than 80 columns"
    );
}

#[test]
fn help_of_one_order() {
    let o = succeeds("order takeoff --help");
    let text = stdout(&o);
    for part in [
        "Take off from the deck",
        "alight order takeoff [OPTIONS]",
        "--drone",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(
        !text.contains("--height") && !text.contains("--standing"),
        "{text}"
    );
    assert!(stdout(&alight("order --help")).contains("--height"));
}

#[test]
fn study_shards_and_resumption() {
    let dir = |name: &str| scratch(name).to_string_lossy().into_owned();
    let whole = dir("whole");
    let one = dir("shard-1");
    let two = dir("shard-2");
    let all = dir("all");
    let own = file(
        "own.toml",
        "title = \"Ours\"\n[[row]]\nname = \"slight\"\nsea = \"slight\"\n",
    );
    let study = |out: &str, more: &str| {
        let o = succeeds(format!(
            "study {own} --trials 3 --seed0 60 --json --out {out} {more}"
        ));
        json(&o)
    };
    let at_once = study(&whole, "");
    study(&one, "--shard 1/2");
    study(&two, "--shard 2/2");
    let o = succeeds(format!("study merge --json --out {all} {one} {two}"));
    for key in ["position_error_m", "mean_95", "success_rate_95", "worst_seeds"] {
        assert_eq!(json(&o)["rows"][0][key], at_once["rows"][0][key], "{key}");
    }
    // The directory of a shard has a part of the trials; without --shard the rest is flown, and no trial twice.
    assert_eq!(
        study(&one, "")["rows"][0]["tilt_error_deg"],
        at_once["rows"][0]["tilt_error_deg"]
    );
    let rows = fs::read_to_string(scratch("shard-1").join("rows.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 3);
    assert_eq!(alight("study wind --shard 3/2").status.code(), Some(2));
}

#[test]
fn envelope_resumption_with_more_landings() {
    let out = scratch("envelope");
    let envelope = |trials: u32| {
        let arguments = "study envelope --winds 4 --directions 1 --sea-states 2 --json --trials";
        let o = succeeds(format!("{arguments} {trials} --out {}", out.display()));
        (json(&o), fs::read_to_string(out.join("rows.csv")).unwrap())
    };
    let (_, first) = envelope(1);
    let (value, both) = envelope(2);
    assert!(both.starts_with(&first) && both.lines().count() == 3, "{both}");
    assert_eq!(value["cells"][0]["trials"], 2);
    let written = fs::read_to_string(out.join("envelope.json")).unwrap();
    assert_eq!(
        serde_json::from_str::<serde_json::Value>(&written).unwrap(),
        value
    );
}

#[test]
fn study_of_paired_planners() {
    let out = scratch("paired");
    let study = |more: &str| {
        let arguments = "study table2 --trials 1 --seed0 70 --planners alight,mpc --json --out";
        alight(format!("{arguments} {} {more}", out.display()))
    };
    let value = json(&study(""));
    let rows = value["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 20);
    for row in rows {
        for key in ["trials", "successes", "unsafe_contacts", "water_contacts"] {
            assert!(row[key].is_u64(), "{key} in {row}");
        }
        for part in ["mean", "sd", "p95", "max"] {
            assert!(row["tilt_error_deg"][part].is_f64(), "{part} in {row}");
        }
        assert!(row["published"]["landing_time_s"].is_f64());
        assert_eq!(row["against"].is_object(), row["planner"] == "mpc", "{row}");
        assert_eq!(row["worst_seeds"][0], 70);
    }
    let against = &rows[1]["against"];
    assert_eq!(
        (&against["first"], &against["pairs"]),
        (&"alight".into(), &1.into())
    );
    let all = &value["pooled"][1];
    assert_eq!(
        (&all["scenario"], &all["against"]["pairs"]),
        (&"all".into(), &10.into())
    );
    let scene = out.join("scenarios").join("0-0.toml");
    let replay = format!("alight trial --scenario '{}' --planner mpc", scene.display());
    assert_eq!(rows[1]["replay"], replay);
    let other = out.join("other.toml");
    fs::write(&other, "[drone.planner]\npress_m = 0.2\n").unwrap();
    let o = study(&format!("--tuning {}", other.display()));
    assert_eq!(o.status.code(), Some(2));
    assert!(stderr(&o).contains("another configuration"), "{}", stderr(&o));
    let o = alight(format!("study wind --trials 1 --out {}", out.display()));
    assert_eq!(o.status.code(), Some(2), "{}", stderr(&o));
}
