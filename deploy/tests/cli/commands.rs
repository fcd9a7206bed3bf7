//! The program as a person meets it: exit codes, errors that help, JSON, determinism.
use std::path::PathBuf;

use crate::program::{alight, json, scratch, stderr};

#[test]
fn bad_input_exits_with_code_2_and_names_the_input() {
    let bad_key = scratch("bad-key.toml");
    std::fs::write(&bad_key, "[sea]\nheight = 3\n").unwrap();
    let bad_range = scratch("bad-range.toml");
    std::fs::write(&bad_range, "solve_delay_s = 7.5\n").unwrap();
    let not_finite = scratch("not-finite.toml");
    std::fs::write(&not_finite, "solve_delay_s = nan\n").unwrap();
    let bad_row = scratch("bad-row.csv");
    std::fs::write(&bad_row, "t_s,roll_deg,pitch_deg\n0.0,1,1\n0.1,x,1\n").unwrap();
    let path = |p: &PathBuf| p.to_string_lossy().into_owned();
    let cases: &[(&[&str], &str)] = &[
        (&["trial", "--no-such-flag"], "--no-such-flag"),
        (&["trial", "--sea", "stormy"], "stormy"),
        (&["trial", "--sea", "-1,5"], "amplitude_m"),
        (&["trial", "--sea", "nan,5"], "nan"),
        (&["trial", "--seed", "-3"], "-3"),
        (&["trial", "--wind", "nan"], "NaN"),
        (&["trial", "--wind", "300"], "300"),
        (&["trial", "--speed", "-2", "--vessel", "straight"], "-2"),
        (&["trial", "--planner", "magic"], "magic"),
        (
            &["trial", "--scenario", "/nonexistent/scene.toml"],
            "/nonexistent/scene.toml",
        ),
        (&["trial", "--scenario", &path(&bad_key)], "height"),
        (&["trial", "--scenario", &path(&bad_range)], "solve_delay_s"),
        (&["trial", "--scenario", &path(&not_finite)], "solve_delay_s"),
        (&["trial", "--drone-config", &path(&bad_key)], "sea"),
        (
            &["trial", "--deck-motion", "/nonexistent/motion.csv"],
            "/nonexistent/motion.csv",
        ),
        (&["trial", "--deck-motion", &path(&bad_row)], "line 3"),
        (&["trial", "--motion-scale", "2"], "--deck-motion"),
        (
            &["trial", "--plot", "/nonexistent/landing.svg"],
            "/nonexistent/landing.svg",
        ),
        (&["trials", "--trials", "0"], "0"),
        (&["trials", "--jobs", "0"], "0"),
        (
            &["trials", "--seed0", "18446744073709551615", "--trials", "2"],
            "18446744073709551615",
        ),
        (
            &["trials", "--rows", "/nonexistent/rows.csv"],
            "/nonexistent/rows.csv",
        ),
    ];
    for (args, names) in cases {
        let o = alight(args);
        assert_eq!(o.status.code(), Some(2), "{args:?}: {}", stderr(&o));
        assert!(
            stderr(&o).contains(names),
            "{args:?} does not name {names}: {}",
            stderr(&o)
        );
        assert!(!stderr(&o).contains("panicked"), "{args:?}");
    }
}

#[test]
fn trial_prints_one_json_object_and_writes_a_plot() {
    let plot = scratch("landing.svg");
    let o = alight(&[
        "trial",
        "--seed",
        "3",
        "--json",
        "--plot",
        &plot.to_string_lossy(),
    ]);
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    assert_eq!(String::from_utf8_lossy(&o.stdout).lines().count(), 1);
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
    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("touchdown") && svg.contains("Roll"));
}

#[test]
fn trials_are_bit_identical_for_one_or_two_jobs_and_across_processes() {
    let digests = |jobs: &str, name: &str| {
        let rows = scratch(name);
        let o = alight(&[
            "trials",
            "--trials",
            "3",
            "--seed0",
            "40",
            "--jobs",
            jobs,
            "--json",
            "--rows",
            &rows.to_string_lossy(),
        ]);
        assert!(o.status.code() != Some(2), "{}", stderr(&o));
        assert_eq!(json(&o)["trials"], 3);
        let text = std::fs::read_to_string(rows).unwrap();
        text.lines()
            .map(|l| l.rsplit(',').next().unwrap().to_string())
            .collect::<Vec<_>>()
    };
    let (one, two) = (digests("1", "one.csv"), digests("2", "two.csv"));
    assert_eq!(one.len(), 4);
    assert_eq!(one, two);
}

#[test]
fn config_prints_configurations_that_are_accepted() {
    let drone = scratch("drone.toml");
    std::fs::write(&drone, alight(&["config", "drone", "--all"]).stdout).unwrap();
    let scenario = scratch("scenario.toml");
    std::fs::write(&scenario, alight(&["config", "scenario"]).stdout).unwrap();
    let o = alight(&[
        "trial",
        "--drone-config",
        &drone.to_string_lossy(),
        "--scenario",
        &scenario.to_string_lossy(),
        "--json",
        "--seed",
        "5",
    ]);
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
}

#[test]
fn help_names_the_first_commands() {
    let o = alight(&["--help"]);
    let text = String::from_utf8_lossy(&o.stdout).into_owned();
    assert!(text.contains("alight trial") && text.contains("Exit codes"));
    assert!(
        text.lines().all(|l| l.chars().count() <= 100),
        "wider than 100 columns"
    );
}

#[test]
fn study_shards_merge_to_the_same_rows_and_an_interrupted_study_resumes() {
    let dir = |name: &str| scratch(name).to_string_lossy().into_owned();
    let (whole, one, two, all) = (dir("whole"), dir("shard-1"), dir("shard-2"), dir("all"));
    let study = |out: &str, more: &[&str]| {
        let mut args = vec![
            "study", "table1", "--trials", "3", "--seed0", "60", "--json", "--out", out,
        ];
        args.extend(more);
        let o = alight(&args);
        assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
        json(&o)
    };
    let at_once = study(&whole, &[]);
    study(&one, &["--shard", "1/2"]);
    study(&two, &["--shard", "2/2"]);
    let o = alight(&["study", "merge", "--json", "--out", &all, &one, &two]);
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    assert_eq!(json(&o)[0]["position_error_m"], at_once[0]["position_error_m"]);
    // A shard's directory holds a part; without --shard the rest is flown and nothing twice.
    assert_eq!(
        study(&one, &[])[0]["tilt_error_deg"],
        at_once[0]["tilt_error_deg"]
    );
    let rows = std::fs::read_to_string(scratch("shard-1").join("rows.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 3);
    assert!(
        std::fs::read_to_string(scratch("whole").join("report.html"))
            .unwrap()
            .contains("<svg")
    );
    assert_eq!(
        alight(&["study", "table1", "--shard", "3/2"]).status.code(),
        Some(2)
    );
}

#[test]
fn study_pairs_two_planners_and_prints_replays_of_the_worst_seeds() {
    let out = scratch("paired");
    let dir = out.to_string_lossy().into_owned();
    let study = |seed0: &str, more: &[&str]| {
        let mut args = vec![
            "study",
            "table2",
            "--trials",
            "1",
            "--seed0",
            seed0,
            "--planners",
            "alight,mpc",
            "--json",
            "--out",
            &dir,
        ];
        args.extend(more);
        alight(&args)
    };
    let rows = json(&study("70", &[]));
    let rows = rows.as_array().unwrap();
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
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    let scene = out.join("scenarios").join("0-0.toml");
    assert!(page.contains(&format!("--scenario '{}' --planner mpc", scene.display())));
    // Rows of another configuration do not mix with these.
    let other = out.join("other.toml");
    std::fs::write(&other, "[drone.planner]\npress_m = 0.2\n").unwrap();
    let o = study("70", &["--drone-config", &other.to_string_lossy()]);
    assert_eq!(o.status.code(), Some(2));
    assert!(stderr(&o).contains("another configuration"), "{}", stderr(&o));
}
