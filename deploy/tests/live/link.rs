//! Link emulator between network namespaces, and a landing over it.

use std::{
    process::{Command, Output},
    time::Duration,
};

use serde_json::Value;

use crate::common::{errors, printed, signal, started};

fn ip(arguments: &str) -> Output {
    let mut command = Command::new("ip");
    command
        .args(arguments.split_whitespace())
        .output()
        .expect("ip runs")
}

fn spaces(name: &str) -> Vec<String> {
    let prefix = format!("alight-{name}-");
    let text = printed(&ip("netns list"));
    text.lines()
        .filter(|l| l.starts_with(&prefix))
        .map(String::from)
        .collect()
}

fn wait_for(mut wanted: impl FnMut() -> bool) {
    for _ in 0..300 {
        if wanted() {
            return;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    panic!("timed out");
}

#[test]
#[ignore = "needs root: network namespaces and TUN devices"]
fn landing_over_the_emulated_storm() {
    let name = format!("storm-{}", std::process::id());
    let child = started(format!(
        "land --json --sea calm --warm-up 20 --link storm --emulate always --verbose --instance {name}"
    ));
    let out = child.wait_with_output().expect("ends");
    let output = printed(&out);
    let errors = errors(&out);
    let outcome: Value = serde_json::from_str(output.lines().last().unwrap_or_default()).expect("an outcome");
    assert_eq!(outcome["outcome"], "success", "{outcome}\n{errors}");
    // More than a thousand packets at 30 %: the standard error is 1.5 %.
    let line = errors
        .lines()
        .find(|l| l.contains("radio to the drone"))
        .expect("counts");
    let lost = line
        .split(',')
        .find(|part| part.contains("lost"))
        .expect("a fraction");
    let fraction: f64 = lost
        .trim()
        .trim_end_matches("% lost")
        .trim()
        .parse()
        .expect("a number");
    assert!((24.0..36.0).contains(&fraction), "{line}");
    assert!(spaces(&name).is_empty());
}

#[test]
#[ignore = "needs root: network namespaces and TUN devices"]
fn namespaces_of_a_killed_emulator() {
    let name = format!("left-{}", std::process::id());
    let arguments = format!("rehearse link --profile wifi-near --name {name}");
    let reaches = || {
        let route = ip(&format!("netns exec alight-{name}-drone ip route get 10.77.0.1"));
        route.status.success()
    };
    let mut first = started(&arguments);
    wait_for(reaches);
    signal(u64::from(first.id()), "-KILL");
    first.wait().expect("ends");
    assert_eq!(spaces(&name).len(), 2);
    let mut second = started(&arguments);
    std::thread::sleep(Duration::from_millis(200));
    wait_for(reaches);
    signal(u64::from(second.id()), "-INT");
    assert_eq!(second.wait().expect("ends").code(), Some(0));
    assert!(spaces(&name).is_empty());
}
