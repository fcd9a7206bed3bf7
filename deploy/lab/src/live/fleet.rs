//! Many live landings, each a set of processes under a name of its own, some side by side.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use alight_computer::exit::{CliError, Doing};
use alight_transport::memory::Instance;

use crate::live::report::LiveOutcome;

/// One landing to fly.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its instance.
    pub instance: String,
    /// Flags of `alight land`.
    pub flags: Vec<String>,
}

/// One landing that was flown.
#[derive(Clone, Debug, Default)]
pub struct Done {
    /// What it says, if it ended with an outcome.
    pub landed: Option<LiveOutcome>,
    /// What it wrote to standard error.
    pub output: String,
    /// Files and processes that it left behind.
    pub leftovers: Vec<String>,
}

/// Flies all jobs, `side_by_side` at a time; `done` hears of each as it ends. In the order of jobs.
pub fn fly(
    jobs: &[Job],
    side_by_side: usize,
    done: impl Fn(usize, &Done) + Sync,
) -> Result<Vec<Done>, CliError> {
    let next = AtomicUsize::new(0);
    let all: Mutex<Vec<Option<Result<Done, CliError>>>> = Mutex::new(jobs.iter().map(|_| None).collect());
    std::thread::scope(|scope| {
        for _ in 0..side_by_side.clamp(1, jobs.len().max(1)) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(job) = jobs.get(index) else { break };
                    let result = one(job);
                    if let Ok(d) = &result {
                        done(index, d);
                    }
                    let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some(slot) = all.get_mut(index) {
                        *slot = Some(result);
                    }
                }
            });
        }
    });
    all.into_inner()
        .unwrap_or_else(PoisonError::into_inner)
        .into_iter()
        .flatten()
        .collect()
}

fn one(job: &Job) -> Result<Done, CliError> {
    let doing = format_args!("starting the landing {}", job.instance);
    let program = std::env::current_exe().doing(doing)?;
    let mut child = Command::new(program)
        .args(["land", "--json", "--supervised", "--instance", &job.instance])
        .args(&job.flags)
        // It ends when this program does.
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .doing(doing)?;
    let lifeline = child.stdin.take();
    let out = child.wait_with_output().doing(doing)?;
    drop(lifeline);
    let output = String::from_utf8_lossy(&out.stderr).into_owned();
    if out.status.code() == Some(2) {
        let last = output.lines().last().unwrap_or_default();
        return Err(CliError::because(format!("the landing {}", job.instance), last));
    }
    let text = String::from_utf8_lossy(&out.stdout);
    Ok(Done {
        landed: text.lines().last().and_then(|l| serde_json::from_str(l).ok()),
        output,
        leftovers: leftovers(&Instance::new(&job.instance)?),
    })
}

/// What an instance that ended has left on this computer.
fn leftovers(instance: &Instance) -> Vec<String> {
    let prefix = instance.prefix();
    let mut found = Vec::new();
    for place in ["/dev/shm", "/tmp"] {
        for entry in std::fs::read_dir(place).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                found.push(entry.path().display().to_string());
            }
        }
    }
    let directory = instance.directory();
    if directory.exists() {
        found.push(directory.display().to_string());
    }
    let file = format!("{}/", directory.display());
    for entry in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
        let command = command_line(&entry.path());
        if command.contains(&file) {
            found.push(format!(
                "process {}: {command}",
                entry.file_name().to_string_lossy()
            ));
        }
    }
    found
}

/// The command line of a process, empty for one that is gone or of another kind.
fn command_line(process: &Path) -> String {
    std::fs::read(process.join("cmdline"))
        .map(|bytes| String::from_utf8_lossy(&bytes).replace('\0', " "))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_of_an_instance() {
        let instance = Instance::new(&format!("left-{}", std::process::id())).unwrap();
        assert!(leftovers(&instance).is_empty());
        std::fs::create_dir_all(instance.directory()).unwrap();
        let file = Path::new("/tmp").join(format!("{}x", instance.prefix()));
        std::fs::write(&file, "").unwrap();
        let found = leftovers(&instance);
        std::fs::remove_file(&file).unwrap();
        std::fs::remove_dir(instance.directory()).unwrap();
        assert_eq!(found.len(), 2, "{found:?}");
    }
}
