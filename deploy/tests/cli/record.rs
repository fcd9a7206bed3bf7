use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use crate::program::{alight, assert_rejected, file, json, scratch, stderr, stdout, succeeds};
use mcap::{Compression, MessageStream, Summary, WriteOptions};

/// Recording and outcome of a landing after a short warm-up, flown once.
fn recorded() -> &'static (PathBuf, serde_json::Value) {
    static FLOWN: OnceLock<(PathBuf, serde_json::Value)> = OnceLock::new();
    FLOWN.get_or_init(|| {
        let start = "[start]\nwarm_up_s = 15.0\nhover_s = 1.0\ndistance_m = [8.0, 10.0]\n";
        let trial = format!("trial --scenario {} --seed 5 --json", file("short.toml", start));
        let recording = scratch("flight.mcap");
        let flown = alight(format!("{trial} --record {}", recording.display()));
        let outcome = json(&flown);
        assert_eq!(
            outcome["digest"],
            json(&alight(trial))["digest"],
            "recording changed the flight"
        );
        (recording, outcome)
    })
}

/// Copies the recording with `change` applied to every message (topic, number in its topic, bytes).
fn changed(from: &Path, to: &Path, change: impl Fn(&str, u32, &mut Vec<u8>)) {
    let bytes = fs::read(from).unwrap();
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let file = std::io::BufWriter::new(std::fs::File::create(to).unwrap());
    let mut writer = WriteOptions::new()
        .compression(Some(Compression::Lz4))
        .create(file)
        .unwrap();
    for index in &summary.metadata_indexes {
        writer
            .write_metadata(&mcap::read::metadata(&bytes, index).unwrap())
            .unwrap();
    }
    for index in &summary.attachment_indexes {
        writer
            .attach(&mcap::read::attachment(&bytes, index).unwrap())
            .unwrap();
    }
    for message in MessageStream::new(&bytes).unwrap() {
        let mut message = message.unwrap();
        let topic = message.channel.topic.clone();
        let number = message.sequence;
        change(&topic, number, message.data.to_mut());
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn replay_of_a_recording() {
    let (file, _) = recorded();
    let replay = succeeds(format!("replay {} --json", file.display()));
    let output = json(&replay);
    assert_eq!(output["identical"], true, "{output}");
    for node in output["nodes"].as_array().unwrap() {
        assert!(node["steps"].as_u64().unwrap() > 300, "{node}");
    }
}

#[test]
fn replay_of_a_planner_that_is_another_program() {
    let program = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/pd_descent.py");
    let trial = |more: &str| {
        let o = succeeds(format!(
            "trial --sea calm --planner exec:python3${{IFS}}{program} --json {more}"
        ));
        json(&o)
    };
    let file = scratch("another-program.mcap");
    let recorded = trial(&format!("--record {}", file.display()));
    assert_eq!(
        recorded["digest"],
        trial("")["digest"],
        "its solve time is stated"
    );
    let replay = json(&alight(format!("replay {} --json", file.display())));
    assert_eq!(replay["identical"], true, "{replay}");
    let planner = |n: &serde_json::Value| n["node"] == "planner" && n["steps"].as_u64() > Some(1000);
    assert!(
        replay["nodes"].as_array().unwrap().iter().any(planner),
        "{replay}"
    );
}

#[test]
fn replay_of_processes_that_were_killed() {
    let kill = |kind: &str, state: &str| {
        format!("[[fault]]\nkind = \"{kind}\"\nstate = \"{state}\"\nafter_s = 0.1\nlasts_s = 0.15\n")
    };
    let faults = kill("predictor-killed", "Descent")
        + &kill("mission-killed", "Flare")
        + &kill("link-killed", "Approach");
    let start = "[start]\nwarm_up_s = 15.0\nhover_s = 1.0\ndistance_m = [8.0, 10.0]\n";
    let scene = file("killed.toml", faults + start);
    let recording = scratch("killed.mcap");
    succeeds(format!(
        "trial --scenario {scene} --seed 5 --record {}",
        recording.display()
    ));
    let replay = json(&alight(format!("replay {} --json", recording.display())));
    assert_eq!(replay["identical"], true, "{replay}");
    let starts = replay["nodes"].as_array().unwrap().len();
    assert_eq!(starts, 11, "eight rows, three of them twice: {replay}");
}

#[test]
fn plot_of_a_recording() {
    let (file, _) = recorded();
    let plot = scratch("belief.svg");
    let other = scratch("belief.png");
    let replay = |to: &Path| alight(format!("replay {} --plot {}", file.display(), to.display()));
    let o = replay(&plot);
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    let svg = fs::read_to_string(&plot).unwrap();
    for text in ["own estimate", "time to touchdown, s", "yaw difference, deg"] {
        assert!(svg.contains(text), "{text}");
    }
    let o = replay(&other);
    assert_eq!(o.status.code(), Some(2), "{}", stdout(&o));
    assert!(stderr(&o).contains(".svg") && !other.exists());
}

#[test]
fn replay_with_a_flipped_input_byte() {
    let (file, _) = recorded();
    for (topic, node, offset) in [
        // Time (8), number of inertial samples (8), header (26), then the first gyro rate.
        ("/node/vessel", "vessel", 8 + 8 + 26 + 6),
        // Time (8), plan (1), the mission's state and the previous state (4 each) after its header (1 + 26).
        ("/node/pilot", "pilot", 8 + 1 + 1 + 26),
    ] {
        let other = scratch(&format!("changed-{node}.mcap"));
        // The pilot requests the state only in the descent, which begins at about step 570.
        let steps = if node == "vessel" { 900..902 } else { 600..1000 };
        changed(file, &other, |t, number, bytes| {
            // Not every input contains the pilot's forecast and plan.
            if t == topic && steps.contains(&number) {
                let i = offset.min(bytes.len() - 9);
                bytes[i] ^= 1;
            }
        });
        let replay = alight(format!("replay {}", other.display()));
        let output = stdout(&replay);
        assert_ne!(
            replay.status.code(),
            Some(0),
            "{node}: the change went unnoticed: {output}"
        );
        if replay.status.code() == Some(1) {
            assert!(output.contains(&format!("first difference: {node}")), "{output}");
        }
    }
}

#[test]
fn replay_with_a_changed_output() {
    let (file, _) = recorded();
    let other = scratch("output.mcap");
    changed(file, &other, |topic, number, bytes| {
        if topic == "/node/planner" && number == 150 {
            *bytes.last_mut().unwrap() ^= 0x10;
        }
    });
    let replay = alight(format!("replay {} --json", other.display()));
    assert_eq!(replay.status.code(), Some(1));
    let output = json(&replay);
    // The drone appears at 14 s; without a message the planner steps every 20 ms.
    assert_eq!(
        output["verdict"], "first difference: planner at 17.00 s of the recording",
        "{output}"
    );
    let differing = output["nodes"].as_array().unwrap().iter();
    assert_eq!(differing.filter(|n| !n["differs_at_s"].is_null()).count(), 1);
}

#[test]
fn replay_of_damaged_foreign_and_missing_files() {
    let good = fs::read(&recorded().0).unwrap();
    // Changes one byte in every 4 kB of the middle, so that some are in chunks, which have checksums, and not only in
    // the index records between them, which a replay does not need.
    let mut flipped = good.clone();
    for i in (good.len() / 4..3 * good.len() / 4).step_by(4096) {
        flipped[i] ^= 0x20;
    }
    let cases = [
        ("cut.mcap", good[..good.len() / 2].to_vec()),
        ("flipped.mcap", flipped),
        ("empty.mcap", Vec::new()),
        ("text.mcap", b"not a recording".repeat(100)),
    ];
    assert_rejected(&cases.map(|(name, bytes)| (format!("replay {}", file(name, bytes)), name)));
    let foreign = scratch("foreign.mcap");
    let writer = std::io::BufWriter::new(std::fs::File::create(&foreign).unwrap());
    let mut writer = WriteOptions::new().compression(None).create(writer).unwrap();
    writer.finish().unwrap();
    let foreign = foreign.display().to_string();
    let none = "/nonexistent/flight.mcap";
    assert_rejected(&[
        (format!("replay {foreign}"), &foreign),
        (format!("replay {none}"), none),
        (format!("trial --record {none}"), none),
    ]);
}

#[test]
fn invalid_directories_of_flights() {
    let empty = scratch("no-flight");
    fs::create_dir_all(&empty).unwrap();
    let empty = empty.display().to_string();
    let none = "/nonexistent/flights";
    let listed = alight(format!("flights {empty}"));
    assert!(listed.status.success() && stdout(&listed).contains("no flight in"));
    let part = file("pilot-00000007-001.mcap", &b"\x89MCAP0\r\n"[..]);
    assert_rejected(&[
        (format!("flights {none}"), none),
        (format!("replay {none}"), none),
        (format!("replay {empty}"), &empty),
        (format!("replay {part}"), &part),
        (
            format!("replay {} --record {none}", recorded().0.display()),
            "is not a flight's directory",
        ),
        (
            format!("calibrate vessel {empty}"),
            "holds no step of the vessel's process",
        ),
    ]);
}

#[test]
fn displayed_topics_of_a_recording() {
    let (file, outcome) = recorded();
    let bytes = fs::read(file).unwrap();
    let summary = Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.as_ref().unwrap();
    // Topics that were announced also have messages.
    let topics: BTreeSet<(String, String)> = summary
        .channels
        .values()
        .filter(|c| stats.channel_message_counts.get(&c.id).is_some_and(|n| *n > 0))
        .filter_map(|c| Some((c.topic.clone(), c.schema.as_ref()?.name.clone())))
        .collect();
    for (topic, schema) in [
        ("/tf", "foxglove.FrameTransforms"),
        ("/scene", "foxglove.SceneUpdate"),
        ("/deck/forecast/path", "foxglove.PosesInFrame"),
        ("/deck/forecast", "forecast.Forecast"),
        ("/plan/path", "foxglove.PosesInFrame"),
        ("/log", "foxglove.Log"),
        ("/sensor/tag", "foxglove.PoseInFrame"),
        ("/vessel/odometry", "foxglove.Odometry"),
        ("/mission", "mission.Mission"),
        ("/link", "link.Link"),
        ("/plan", "solver.Solver"),
    ] {
        assert!(
            topics.contains(&(topic.into(), schema.into())),
            "{topic} {schema} in {topics:?}"
        );
    }
    let statistics = summary.stats.as_ref().unwrap();
    for channel in summary.channels.values() {
        let count = statistics.channel_message_counts.get(&channel.id);
        assert!(count.is_some_and(|n| *n > 0), "{} is empty", channel.topic);
    }
    let flown_s = statistics.message_end_time as f64 * 1e-9;
    assert!((flown_s - outcome["sim_time_s"].as_f64().unwrap()).abs() < 0.02);
    // 60 s of flight in at most 30 MB.
    assert!((bytes.len() as f64) < 0.5e6 * flown_s, "{} bytes", bytes.len());
    let end = summary.metadata_indexes.iter().find(|m| m.name == "outcome");
    let end = mcap::read::metadata(&bytes, end.unwrap()).unwrap();
    assert_eq!(outcome["digest"], end.metadata["digest"]);
}

#[test]
fn deck_calibration_of_a_recording() {
    let rejected = format!("calibrate deck {}", recorded().0.display());
    assert_rejected(&[(rejected, "leave the drone on the deck")]);
    // From the drone's position on the deck no part of a tag of 1 m is visible.
    let stays = "stay_s = 40.0\n[deck]\ntag_side_m = 1.0\n[start]\nwarm_up_s = 40.0\nhover_s = 1.0\ndistance_m = [8.0, 10.0]\n";
    let drone = file("one-tag.toml", "[drone.deck]\ntag_side_m = 1.0\n");
    let scene = file("stays.toml", stays);
    let recording = scratch("stays.mcap").display().to_string();
    succeeds(format!(
        "trial --sea slight --scenario {scene} --drone-config {drone} --seed 5 --record {recording}"
    ));
    let deck = alight(format!("calibrate deck {recording} --json"));
    let found = json(&deck);
    let centre = found["centre_m"].as_array().unwrap();
    for (axis, truth) in centre.iter().zip([0.0, 0.0, -1.3]) {
        let [value, sd] = ["value", "sd"].map(|k| axis[k].as_f64().unwrap());
        // Receivers a metre apart, without a flag for the drone's position on the deck.
        assert!(sd > 0.05 && (value - truth).abs() < 3.0 * sd + 0.15, "{found}");
    }
    assert!(
        found["mount"].is_null() && found["seconds"].as_f64() > Some(30.0),
        "{found}"
    );
    let lines = alight(format!("calibrate deck {recording}"));
    let output = stdout(&lines);
    assert!(
        output.contains("[vessel.deck]\ncentre_m = [") && output.contains("[drone.deck]"),
        "{output}"
    );

    // In waves the antenna's position is observable, the hull's parameters are not.
    let vessel = alight(format!("calibrate vessel {recording}"));
    let output = stdout(&vessel);
    assert!(
        output.contains("roll   not observable") && output.contains("GNSS antenna"),
        "{output}"
    );
    // A weight recorded in waves does not make the hull observable either.
    let loaded = format!("calibrate vessel {recording} --loaded-log {recording} --weight");
    let vessel = alight(format!("{loaded} 60,1.4,0.9"));
    let output = stdout(&vessel);
    assert!(
        output.contains("roll   under the weight: heels by 0.00"),
        "{output}"
    );
    assert_rejected(&["60,1.4", "0,1,1", "60,x,1,2", "-5,1,1"].map(|w| (format!("{loaded} {w}"), w)));
    let nothing = file("poses.csv", "t_s,roll_deg\n0,1\n1,x\n");
    assert_rejected(&[
        (
            format!("calibrate vessel {nothing}"),
            "line 3: roll_deg is `x`, not a number",
        ),
        ("calibrate vessel poses.txt".into(), "neither FILE.mcap"),
    ]);
}
