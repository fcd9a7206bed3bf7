//! Temporary files of this crate's tests.

use std::path::PathBuf;

/// Path of a temporary file or directory that only this test process uses; what an earlier process left there is
/// removed.
pub fn scratch(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("alight-{name}-{}", std::process::id()));
    let _none = std::fs::remove_dir_all(&path);
    path
}
