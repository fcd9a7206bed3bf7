//! What the processes use over time, one line a minute, to see that nothing grows.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use alight_shared::transport::memory::Instance;
use alight_shared::transport::process::ProcessKind;

use crate::exit::{CliError, Doing};
use crate::process::life::usage;
use crate::process::snapshot::Snapshot;

/// Time between two lines, ns.
const PERIOD_NS: i64 = 60_000_000_000;

/// Writes the file.
pub struct UsageLog {
    file: File,
    path: PathBuf,
    instance: Instance,
    began_ns: Option<i64>,
    next_ns: i64,
}

impl UsageLog {
    /// Begins the file with the names of its columns.
    pub fn create(path: &Path, instance: &Instance) -> Result<UsageLog, CliError> {
        let doing = format_args!("writing the usage to {}", path.display());
        let mut file = File::create(path).doing(doing)?;
        let mut head = String::from("t_s,supervisor_kb,supervisor_cpu_s");
        for kind in ProcessKind::ALL {
            head.push_str(&format!(",{0}_kb,{0}_cpu_s", kind.name()));
        }
        head.push_str(",shm_files,shm_kb,own_files,own_kb");
        writeln!(file, "{head}").doing(doing)?;
        Ok(UsageLog {
            file,
            path: path.into(),
            instance: instance.clone(),
            began_ns: None,
            next_ns: i64::MIN,
        })
    }
    /// Writes a line when it is time.
    pub fn note(&mut self, now_ns: i64, snapshot: &Snapshot) -> Result<(), CliError> {
        if now_ns < self.next_ns || snapshot.processes.len() < ProcessKind::ALL.len() {
            return Ok(());
        }
        self.next_ns = now_ns + PERIOD_NS;
        let began = *self.began_ns.get_or_insert(now_ns);
        let (cpu_s, bytes) = usage();
        let mut line = format!(
            "{:.0},{},{cpu_s:.2}",
            (now_ns - began) as f64 * 1e-9,
            bytes / 1000
        );
        for kind in ProcessKind::ALL {
            let (bytes, cpu_s) = snapshot
                .processes
                .get(&kind)
                .map_or((0, 0.0), |p| (p.resident_bytes, p.cpu_s));
            line.push_str(&format!(",{},{cpu_s:.2}", bytes / 1000));
        }
        let prefix = self.instance.prefix();
        let shared = sum(Path::new("/dev/shm"), &|name| name.starts_with(&prefix));
        let own = sum(&self.instance.directory(), &|_| true);
        line.push_str(&format!(
            ",{},{},{},{}",
            shared.0,
            shared.1 / 1000,
            own.0,
            own.1 / 1000
        ));
        writeln!(self.file, "{line}").doing(format_args!("writing the usage to {}", self.path.display()))
    }
}

/// How many files of these names, and their bytes, with those in directories below.
fn sum(directory: &Path, counts: &dyn Fn(&str) -> bool) -> (u64, u64) {
    let mut all = (0, 0);
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        if !counts(&entry.file_name().to_string_lossy()) {
            continue;
        }
        let Ok(found) = entry.metadata() else { continue };
        let (files, bytes) = if found.is_dir() {
            sum(&entry.path(), &|_| true)
        } else {
            (1, found.len())
        };
        all = (all.0 + files, all.1 + bytes);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usage_of_files_with_a_prefix() {
        let directory = std::env::temp_dir().join(format!("alight-usage-{}", std::process::id()));
        std::fs::create_dir_all(directory.join("mine-below")).unwrap();
        std::fs::write(directory.join("mine-1"), [0; 10]).unwrap();
        std::fs::write(directory.join("mine-below/any"), [0; 5]).unwrap();
        std::fs::write(directory.join("other"), [0; 100]).unwrap();
        let got = sum(&directory, &|name| name.starts_with("mine"));
        std::fs::remove_dir_all(&directory).unwrap();
        assert_eq!(got, (2, 15));
    }
}
