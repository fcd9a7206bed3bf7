use std::{
    path::PathBuf,
    process::{Command, Output},
};

pub fn alight(arguments: impl AsRef<str>) -> Output {
    Command::new(env!("CARGO_BIN_EXE_alight"))
        .args(arguments.as_ref().split_whitespace())
        .output()
        .expect("the program runs")
}

/// Runs a command that succeeds.
#[track_caller]
pub fn succeeds(arguments: impl AsRef<str>) -> Output {
    let o = alight(arguments);
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    o
}

pub fn scratch(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("alight-test-{}", std::process::id()));
    std::fs::create_dir_all(&dir).expect("a directory for temporary files");
    dir.join(name)
}

/// Writes a temporary file of this test process and returns its name.
pub fn file(name: &str, content: impl AsRef<[u8]>) -> String {
    let path = scratch(name);
    std::fs::write(&path, content).expect("written");
    path.display().to_string()
}

pub fn stdout(o: &Output) -> String {
    String::from_utf8_lossy(&o.stdout).into_owned()
}

pub fn stderr(o: &Output) -> String {
    String::from_utf8_lossy(&o.stderr).into_owned()
}

pub fn json(o: &Output) -> serde_json::Value {
    serde_json::from_str(stdout(o).lines().last().expect("a line")).expect("JSON")
}

/// Asserts that each of these commands exits with code 2, names the invalid part, and does not panic.
pub fn assert_rejected(cases: &[(String, &str)]) {
    for (arguments, names) in cases {
        let o = alight(arguments);
        let errors = stderr(&o);
        assert_eq!(o.status.code(), Some(2), "{arguments}: {errors}");
        assert!(
            errors.contains(names),
            "{arguments} does not name {names}: {errors}"
        );
        assert!(!errors.contains("panicked"), "{arguments}");
    }
}
