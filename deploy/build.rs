//! The commit and its date for `alight --version`, if this is built in a clone.

use std::{path::Path, process::Command};

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn main() {
    let version = env!("CARGO_PKG_VERSION");
    // Sources unpacked inside another clone do not belong to it.
    let own = git(&["ls-files", "--error-unmatch", "build.rs"]);
    let commit = own.and_then(|_| git(&["log", "-1", "--format=%h %cs"]));
    let version = commit.map_or_else(|| version.to_owned(), |c| format!("{version} ({c})"));
    println!("cargo::rustc-env=ALIGHT_VERSION={version}");
    println!("cargo::rerun-if-changed=build.rs");
    // Every commit and every checkout adds a line to the log of HEAD; a clone may keep no log.
    let file = |name: &str| {
        let path = git(&["rev-parse", "--path-format=absolute", "--git-path", name])?;
        Path::new(&path).exists().then_some(path)
    };
    let branch = git(&["symbolic-ref", "--quiet", "HEAD"]);
    let files = match file("logs/HEAD") {
        Some(log) => vec![log],
        None => [Some("HEAD"), branch.as_deref(), Some("packed-refs")]
            .into_iter()
            .flatten()
            .filter_map(file)
            .collect(),
    };
    for path in files {
        println!("cargo::rerun-if-changed={path}");
    }
}
