//! The program as a person runs it.

use std::path::PathBuf;
use std::process::{Command, Output};

/// `alight ARGS`, to its end.
pub fn alight(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alight"))
        .args(args)
        .output()
        .expect("the program runs")
}

/// A file of this test process.
pub fn scratch(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("alight-test-{}", std::process::id()));
    std::fs::create_dir_all(&dir).expect("a directory for temporary files");
    dir.join(name)
}

/// What it said to a person.
pub fn stderr(o: &Output) -> String {
    String::from_utf8_lossy(&o.stderr).into_owned()
}

/// The JSON object of its last line.
pub fn json(o: &Output) -> serde_json::Value {
    let text = String::from_utf8_lossy(&o.stdout);
    serde_json::from_str(text.lines().last().expect("a line")).expect("JSON")
}
