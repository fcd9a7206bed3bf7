//! Test certificates.

use std::path::{Path, PathBuf};
use std::process::Command;

/// An authority with a vessel 1 and a drone 1, made by the program itself; its directory.
pub fn certificates(name: &str) -> PathBuf {
    let directory = std::env::temp_dir().join(format!("alight-certificates-{name}-{}", std::process::id()));
    let _none = std::fs::remove_dir_all(&directory);
    let made: [&[&str]; 3] = [
        &["init", "--days", "2"],
        &["vessel", "1", "--address", "127.0.0.1"],
        &["drone", "1"],
    ];
    for what in made {
        keys(&directory, what);
    }
    directory
}

/// `alight keys WHAT --dir DIRECTORY`.
pub fn keys(directory: &Path, what: &[&str]) {
    let out = Command::new(env!("CARGO_BIN_EXE_alight"))
        .arg("keys")
        .args(what)
        .arg("--dir")
        .arg(directory)
        .output()
        .expect("the program runs");
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "alight keys {what:?}: {said}");
}
