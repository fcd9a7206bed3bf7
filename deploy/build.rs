//! The commit and its date for `alight --version`, where this is built in a clone.

use std::process::Command;

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn main() {
    let version = env!("CARGO_PKG_VERSION");
    let commit = git(&["log", "-1", "--format=%h %cs"]);
    let version = commit.map_or_else(|| version.to_owned(), |c| format!("{version} ({c})"));
    println!("cargo::rustc-env=ALIGHT_VERSION={version}");
    println!("cargo::rerun-if-changed=build.rs");
    // Every commit and every checkout adds a line to it. Without a clone nothing changes.
    let moves = git(&["rev-parse", "--path-format=absolute", "--git-path", "logs/HEAD"]);
    if let Some(moves) = moves.filter(|m| std::path::Path::new(m).exists()) {
        println!("cargo::rerun-if-changed={moves}");
    }
}
