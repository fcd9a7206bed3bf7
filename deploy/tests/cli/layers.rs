//! Order of the layers, by the imports in the sources.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Modules of each library, lowest first: each imports only those before it.
const LAYERS: [(&str, &[&str]); 2] = [
    (
        "deploy/computer",
        &[
            "exit",
            "quantity",
            "terminal",
            "table",
            "config",
            "certificates",
            "io",
            "record",
            "process",
            "vessel",
            "drone",
            "subject",
            "situation",
            "playback",
        ],
    ),
    ("deploy/people", &["explain", "status", "view", "tools"]),
];

const PACKAGES: [&str; 11] = [
    "shared",
    "shared/transport",
    "usv-side",
    "bridge",
    "uav-side",
    "tests",
    "deploy/computer",
    "deploy/people",
    "deploy/plugins",
    "deploy/lab",
    "deploy",
];

/// Packages that a package must not depend on, not even indirectly.
const APART: [(&str, &[&str]); 3] = [
    ("deploy/people", &["alight-lab", "alight-sim", "alight-plugins"]),
    ("deploy/plugins", &["alight-lab", "alight-sim"]),
    ("deploy/lab", &["alight-people", "alight-plugins"]),
];

/// Module of each file of a package, and the other modules that it imports.
type Imports = BTreeMap<String, BTreeSet<String>>;

fn sources(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found
}

/// Module of a file: `a::b` for `src/a/b.rs` and `src/a/b/mod.rs`; empty for the root.
fn module(src: &Path, file: &Path) -> String {
    let relative = file.strip_prefix(src).unwrap().with_extension("");
    let mut parts: Vec<&str> = relative.iter().filter_map(|p| p.to_str()).collect();
    if parts.last().is_some_and(|p| ["mod", "lib", "main"].contains(p)) {
        parts.pop();
    }
    parts.join("::")
}

/// Paths that begin at `text`, including those of a group in braces.
fn paths(text: &str) -> Vec<String> {
    let end = text.find(|c: char| !(c.is_alphanumeric() || "_:".contains(c)));
    let (head, rest) = text.split_at(end.unwrap_or(text.len()));
    let Some(group) = rest.strip_prefix('{').filter(|_| head.ends_with("::")) else {
        return vec![head.into()];
    };
    let (mut depth, mut start, mut found) = (0, 0, Vec::new());
    for (k, c) in group.char_indices() {
        if depth == 0 && (c == ',' || c == '}') {
            let inner = paths(group[start..k].trim_start());
            found.extend(inner.into_iter().map(|p| format!("{head}{p}")));
            start = k + 1;
        }
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            _ => {}
        }
    }
    found
}

/// Module to which `path` leads, relative to the module `from`.
fn target(path: &str, from: &str, modules: &BTreeSet<String>) -> String {
    let mut at: Vec<&str> = from.split("::").filter(|p| !p.is_empty()).collect();
    for part in path.split("::") {
        match part {
            "crate" => at.clear(),
            "super" => drop(at.pop()),
            "self" => {}
            part => at.push(part),
        }
    }
    while !at.is_empty() && !modules.contains(&at.join("::")) {
        at.pop();
    }
    at.join("::")
}

/// Imports of a package, except those of tests and those of a parent or a child.
fn imports(src: &Path) -> Imports {
    let files: Vec<(String, PathBuf)> = sources(src).into_iter().map(|f| (module(src, &f), f)).collect();
    let modules: BTreeSet<String> = files.iter().map(|(m, _)| m.clone()).collect();
    let mut all = Imports::new();
    for (own, file) in &files {
        let text = std::fs::read_to_string(file).unwrap();
        let text = text.split("\n#[cfg(test)]\nmod ").next().unwrap();
        let code: String = text
            .lines()
            .filter(|l| !l.trim_start().starts_with("//"))
            .flat_map(|l| [l, "\n"])
            .collect();
        let imported = all.entry(own.clone()).or_default();
        for start in ["crate::", "super::"] {
            for (k, _) in code.match_indices(start) {
                let before = code[..k].chars().next_back();
                if before.is_some_and(|c| c.is_alphanumeric() || "_:".contains(c)) {
                    continue;
                }
                for path in paths(&code[k..]) {
                    let to = target(&path, own, &modules);
                    let family = |a: &str, b: &str| a.is_empty() || b.starts_with(&format!("{a}::"));
                    if to != *own && !family(own, &to) && !family(&to, own) {
                        imported.insert(to);
                    }
                }
            }
        }
    }
    all
}

fn reached(from: &str, all: &Imports) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut waiting = vec![from.to_owned()];
    while let Some(next) = waiting.pop() {
        for to in all.get(&next).into_iter().flatten() {
            if found.insert(to.clone()) {
                waiting.push(to.clone());
            }
        }
    }
    found
}

fn package(name: &str) -> Imports {
    imports(
        &Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("..")
            .join(name)
            .join("src"),
    )
}

#[test]
fn import_loops() {
    let mut looped = Vec::new();
    for name in PACKAGES {
        let all = package(name);
        let own = all.keys().filter(|m| reached(m, &all).contains(*m));
        looped.extend(own.map(|m| format!("{name}: {m}")));
    }
    assert!(
        looped.is_empty(),
        "files that import each other in a loop: {looped:#?}"
    );
}

#[test]
fn module_layers() {
    let mut upward = Vec::new();
    for (name, layers) in LAYERS {
        let rank = |module: &str| {
            let top = module.split("::").next().unwrap_or_default();
            let at = layers.iter().position(|l| *l == top);
            at.unwrap_or_else(|| panic!("{name}: {top} is in no layer"))
        };
        for (own, imported) in package(name).iter().filter(|(m, _)| !m.is_empty()) {
            let higher = imported.iter().filter(|to| rank(to) > rank(own));
            upward.extend(higher.map(|to| format!("{name}: {own} imports {to}")));
        }
    }
    assert!(upward.is_empty(), "{upward:#?}");
}

/// Dependencies of a package by its manifest, except those that only its tests need.
fn dependencies(name: &str) -> String {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .join(name)
        .join("Cargo.toml");
    let text = std::fs::read_to_string(manifest).unwrap();
    let (_, rest) = text.split_once("\n[dependencies]\n").unwrap();
    rest.split("\n[").next().unwrap_or_default().to_owned()
}

#[test]
fn packages_that_must_not_know_each_other() {
    for (name, others) in APART {
        // The project's packages reach others only through the computer's processes.
        let text = dependencies(name) + &dependencies("deploy/computer");
        assert!(text.contains("alight-shared"), "{name}: {text}");
        for other in others {
            assert!(!text.contains(other), "{name} depends on {other}");
        }
    }
}

/// Modules of a package that are nodes: shared parts are separate modules.
const NODES: [(&str, &[&str]); 2] = [
    (
        "uav-side",
        &["autopilot", "camera", "mission", "pilot", "planner", "predictor"],
    ),
    ("usv-side", &["deck", "estimator", "sensors"]),
];

#[test]
fn nodes_that_import_each_other() {
    let mut across = Vec::new();
    for (name, nodes) in NODES {
        let node = |module: &str| nodes.iter().find(|n| module.split("::").next() == Some(n));
        for (own, imported) in package(name) {
            let Some(own_node) = node(&own) else { continue };
            let others = imported
                .iter()
                .filter(|to| node(to).is_some_and(|n| n != own_node));
            across.extend(others.map(|to| format!("{name}: {own} imports {to}")));
        }
    }
    assert!(across.is_empty(), "{across:#?}");
}
