//! Installed files: configurations with every default, and units that systemd accepts.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use toml::{Table, Value};

use alight_sim::studies::statistics::wilson;

use crate::program::{alight, assert_rejected, file, json, stdout};

/// Keys whose shipped values differ from the program's defaults, and the reasons.
const OTHERWISE: [(&str, &str); 10] = [
    (
        "drone.deck.tags",
        "tags that suit the default deck, listed for the crew that lays them",
    ),
    ("drone.mission.mode", "first flights begin with the first step"),
    (
        "drone.mission.reservation_required",
        "a vessel may have several drones",
    ),
    ("radio.listen", "TLS"),
    ("radio.connect", "TLS"),
    (
        "radio.tls.authority",
        "where the packages' users put their certificates",
    ),
    ("radio.tls.certificate", "the same"),
    ("radio.tls.key", "the same"),
    ("radio.tls.peers", "the first drone, the first vessel"),
    ("recorder.directory", "where the packages' services may write"),
];

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn printed(arguments: &str) -> String {
    let out = alight(arguments);
    assert!(out.status.success(), "{arguments}: {out:?}");
    stdout(&out)
}

fn flat(table: &Table, at: &str, out: &mut BTreeMap<String, Value>) {
    for (key, value) in table {
        let name = format!("{at}{key}");
        match value {
            Value::Table(inner) => flat(inner, &format!("{name}."), out),
            other => {
                out.insert(name, other.clone());
            }
        }
    }
}

fn keys(text: &str) -> BTreeMap<String, Value> {
    let mut all = BTreeMap::new();
    flat(&text.parse().expect("TOML"), "", &mut all);
    all
}

fn assert_explained(side: &str, text: &str) {
    let mut before = "";
    for line in text.lines() {
        let is_key = line.starts_with(|c: char| c.is_ascii_lowercase());
        assert!(
            !is_key || before.starts_with('#'),
            "{side}.toml: {line} is not explained"
        );
        before = line;
    }
}

#[test]
fn shipped_configurations() {
    for side in ["vessel", "drone"] {
        let text = printed(&format!("config {side}"));
        let file = fs::read_to_string(shipped(&format!("{side}/{side}.toml")));
        assert_eq!(text.trim_end(), file.expect("the shipped file").trim_end());
        assert_explained(side, &text);
        let here = keys(&text);
        let all = keys(&printed(&format!("config {side} --all")));
        for (key, value) in &here {
            let otherwise = OTHERWISE.iter().any(|(k, _)| k == key);
            let default = all.get(key);
            assert!(
                default.is_some() && (otherwise || default == Some(value)),
                "deploy/{side}/{side}.toml: {key} is {value}, the default {default:?}"
            );
        }
    }
}

/// Arguments of the instruction `name` in the container's file, one list per line.
fn instructions(text: &str, name: &str) -> Vec<Vec<String>> {
    let lines = text
        .lines()
        .filter_map(|l| l.strip_prefix(name)?.strip_prefix(' '));
    lines
        .map(|l| l.split_whitespace().map(String::from).collect())
        .collect()
}

#[test]
fn container_copies_what_there_is() {
    let text = fs::read_to_string(shipped("Containerfile")).expect("the container's file");
    let known = [
        "ARG",
        "FROM",
        "RUN",
        "WORKDIR",
        "COPY",
        "USER",
        "ENTRYPOINT",
        "CMD",
        "#",
        "",
    ];
    for line in text.lines() {
        let first = line.split(' ').next().unwrap_or_default();
        assert!(known.contains(&first), "{line}");
    }
    // Images are named without a registry, so the computer's own default is used.
    let images = instructions(&text, "ARG");
    assert_eq!(images.len(), instructions(&text, "FROM").len());
    for image in images.iter().flatten() {
        assert!(image.contains('=') && !image.contains('/'), "{image}");
    }
    for arguments in instructions(&text, "COPY") {
        let (source, from_stage) = match arguments.first() {
            Some(stage) if stage.starts_with("--from=") => (&arguments[1], true),
            Some(source) => (source, false),
            None => panic!("COPY of nothing"),
        };
        // The first stage builds into its target folder.
        let is_there = if from_stage {
            source.ends_with("/target/release/alight")
        } else {
            shipped("..").join(source).exists()
        };
        assert!(is_there, "COPY {}", arguments.join(" "));
    }
    assert_eq!(instructions(&text, "USER"), [["alight"]]);
}

/// Number of printed keys of each side: those that `alight init` writes, all that a file may set, and the method's. A
/// new key changes a number here; the two files of `alight init` together have at most 60.
const PRINTED: [(&str, [usize; 3]); 2] = [("vessel", [20, 61, 20]), ("drone", [40, 145, 209])];

#[test]
fn explanations_and_number_of_keys() {
    for (side, numbers) in PRINTED {
        let found = ["", " --all", " --tuning"].map(|which| {
            let text = printed(&format!("config {side}{which}"));
            assert_explained(side, &text);
            keys(&text).len()
        });
        assert_eq!(found, numbers, "{side}");
    }
    assert!(PRINTED.iter().map(|(_, numbers)| numbers[0]).sum::<usize>() <= 60);
}

#[test]
fn helm_in_a_file_of_a_former_version() {
    let old = file(
        "helm.toml",
        "[vessel.helm]\noutput = \"mavlink\"\nheading_change_deg = 60.0\n",
    );
    let message = "helm.toml: [vessel.helm]: the computer no longer steers the boat";
    for command in [
        "vessel --config",
        "trial --vessel-config",
        "order turning --config",
    ] {
        assert_rejected(&[(format!("{command} {old}"), message)]);
    }
}

/// A flight uses the printed configuration of the method; a computer's file rejects it.
#[test]
fn method_in_a_file_of_its_own() {
    let both = ["vessel", "drone"].map(|side| printed(&format!("config {side} --tuning")));
    let tuning = file("tuning.toml", both.concat());
    let changed = file(
        "method.toml",
        "[drone.planner.rendezvous.touchdown_time]\nwindow_s = 0\n",
    );
    let flown = |more: &str| json(&alight(format!("trial --seed 6 --json {more}")))["digest"].clone();
    let plain = flown("");
    assert_eq!(plain, flown(&format!("--tuning {tuning}")));
    assert_ne!(plain, flown(&format!("--tuning {changed}")));
    let rejected = "window_s belongs to the method and is not set in a flight";
    assert_rejected(&[(format!("drone --config {changed}"), rejected)]);
    let check = alight(format!("check --config {changed}"));
    assert_eq!(check.status.code(), Some(2));
    let check = stdout(&check);
    let parts: Vec<&str> = check.split_whitespace().collect();
    assert!(parts.join(" ").contains(rejected), "{check}");
}

/// Shipped unit of one side, with the program under test instead of the installed one.
fn unit(side: &str) -> String {
    let unit = shipped(&format!("{side}/alight-{side}.service"));
    let text = fs::read_to_string(unit).expect("the unit");
    text.replace("/usr/bin/alight", env!("CARGO_BIN_EXE_alight"))
}

#[test]
fn systemd_units_with_the_installed_configuration() {
    for side in ["vessel", "drone"] {
        let program = env!("CARGO_BIN_EXE_alight");
        let line = format!("ExecStart={program} {side} --config /etc/alight/{side}.toml");
        assert!(unit(side).lines().any(|l| l == line), "{side}");
    }
}

fn analyze(args: &[&str], unit: &Path) -> (bool, String) {
    let mut command = Command::new("systemd-analyze");
    let out = command.args(args).arg(unit).output().expect("it is installed");
    let text = [out.stdout, out.stderr].concat();
    (out.status.success(), String::from_utf8_lossy(&text).into_owned())
}

#[test]
#[ignore = "needs systemd-analyze"]
fn systemd_units_verification_and_exposure() {
    let directory = std::env::temp_dir().join(format!("alight-units-{}", std::process::id()));
    fs::create_dir_all(&directory).expect("a directory");
    for side in ["vessel", "drone"] {
        let name = format!("alight-{side}.service");
        let path = directory.join(&name);
        fs::write(&path, unit(side)).expect("written");
        let (clean, text) = analyze(&["verify", "--man=no"], &path);
        assert!(clean && !text.contains(&name), "{text}");
        let (_, text) = analyze(&["security", "--offline=true", "--no-pager"], &path);
        let exposure = text
            .split("exposure level for ")
            .nth(1)
            .and_then(|rest| rest.split_whitespace().nth(1))
            .and_then(|n| n.parse::<f64>().ok());
        assert!(exposure.is_some_and(|e| e < 2.5), "{text}");
    }
    fs::remove_dir_all(&directory).expect("removed");
}

fn sources(directory: &Path, out: &mut String) {
    for entry in fs::read_dir(directory).expect("a directory").flatten() {
        let path = entry.path();
        let name = entry.file_name();
        if path.is_dir() && name != "target" && !name.to_string_lossy().starts_with('.') {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push_str(&fs::read_to_string(&path).expect("read"));
        }
    }
}

#[test]
fn hazards_with_their_tests_and_rates() {
    let page = fs::read_to_string(shipped("docs/hazards.md")).expect("hazards.md");
    let mut all = String::new();
    sources(&shipped(".."), &mut all);
    let mut shows = 0;
    let mut rates = 0;
    for row in page
        .lines()
        .filter(|l| l.starts_with("| ") && !l.starts_with("| hazard"))
    {
        let columns: Vec<&str> = row.split('|').map(str::trim).collect();
        let [_, hazard, _, _, shown, rate, _, _] = columns[..] else {
            panic!("six columns: {row}");
        };
        let before = (shows, rates);
        for list in shown.split(", ").filter(|l| l.ends_with(".toml")) {
            assert!(shipped("../tests/storm").join(list).exists(), "{list}");
            shows += 1;
        }
        for test in shown.split('`').skip(1).step_by(2) {
            assert!(all.contains(&format!("fn {test}() {{")), "{test}");
            shows += 1;
        }
        assert!(
            shows > before.0 || hazard.starts_with("**open**"),
            "no test: {row}"
        );
        // `k of n (a to b %)`, with Wilson's interval, and the source at the end.
        let words: Vec<&str> = rate.split(' ').collect();
        for w in words.windows(7).filter(|w| w[1] == "of" && w[4] == "to") {
            let count = |k: usize| w[k].parse().expect("a count");
            let (from, to) = wilson(count(0), count(2));
            let interval = format!("({:.0} to {:.0} %)", 100.0 * from, 100.0 * to);
            assert!(w[3..].join(" ").starts_with(&interval), "{interval}: {rate}");
            rates += 1;
        }
        let measured = rates > before.1 && rate.ends_with(')');
        assert!(measured || rate == "not measured", "no source: {rate}");
    }
    assert!(
        shows >= 45 && rates >= 10,
        "{shows} tests and lists, {rates} rates"
    );
}
