//! Starts the processes, starts again what died, ends them all.
//!
//! Every process holds the reading end of a pipe as its standard input and ends when that closes,
//! so that none survives_pause a supervisor that was killed.

use std::fs::OpenOptions;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::process::ProcessKind;

use crate::exit::CliError;

/// First pause before a process is started again; doubles with each failure.
const INITIAL_BACKOFF_NS: i64 = 100_000_000;
/// Longest pause.
const MAX_BACKOFF_NS: i64 = 2_000_000_000;
/// A process that ran this long had a good start: the pause begins anew.
const STABLE_RUN_NS: i64 = 5_000_000_000;
/// Processes that were told to end have this long.
const GRACE_NS: i64 = 800_000_000;

/// Flight goes before whatever else the computer does: the priority (niceness) that is asked for.
/// Without the permission a process runs at the usual one. Measured on two cores with twenty other
/// busy processes: ticks of the world up to 6 s late without it.
const NICENESS: &str = "-10";

/// One process under supervision.
struct ManagedProcess {
    kind: ProcessKind,
    config: PathBuf,
    /// What stands before its command: the way into its network namespace.
    enter: Vec<String>,
    child: Option<Child>,
    started_ns: i64,
    backoff_ns: i64,
    start_at_ns: i64,
    starts: u32,
}

/// The supervisor.
pub struct Supervisor {
    processes: Vec<ManagedProcess>,
    directory: PathBuf,
    log: Option<PathBuf>,
    /// Processes write errors where the supervisor does, not into files.
    inherit_stderr: bool,
    /// Processes run at the supervisor's own priority.
    at_own_priority: bool,
    lines: (Sender<String>, Receiver<String>),
}

/// What happened to a process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// It ended; it is started again unless it is the world.
    Ended(ProcessKind, String),
}

impl Supervisor {
    /// Nobody yet; `directory` takes what processes write to standard error.
    pub fn new(directory: PathBuf, log: Option<PathBuf>) -> Supervisor {
        Supervisor {
            processes: Vec::new(),
            directory,
            log,
            inherit_stderr: false,
            at_own_priority: false,
            lines: channel(),
        }
    }
    /// Processes write errors where the supervisor does: a service's journal keeps and rotates them.
    pub fn inheriting_stderr(mut self) -> Supervisor {
        self.inherit_stderr = true;
        self
    }
    /// Processes run at the supervisor's own priority: it has the one that they want.
    pub fn at_own_priority(mut self) -> Supervisor {
        self.at_own_priority = true;
        self
    }
    /// Starts a process; `enter` stands before its command.
    pub fn start(&mut self, kind: ProcessKind, config: PathBuf, enter: Vec<String>) -> Result<(), CliError> {
        let mut managed = ManagedProcess {
            kind,
            config,
            enter,
            child: None,
            started_ns: 0,
            backoff_ns: INITIAL_BACKOFF_NS,
            start_at_ns: 0,
            starts: 0,
        };
        self.spawn(&mut managed)?;
        self.processes.push(managed);
        Ok(())
    }

    fn spawn(&self, managed: &mut ManagedProcess) -> Result<(), CliError> {
        let name = managed.kind.name();
        let doing = || format!("starting the process {name}");
        let program = own_program().map_err(|e| CliError::because(doing(), e))?;
        let errors = if self.inherit_stderr {
            Stdio::inherit()
        } else {
            OpenOptions::new()
                .create(true)
                .append(true)
                .open(self.directory.join(format!("{name}.err")))
                .map_err(|e| CliError::because(doing(), e))?
                .into()
        };
        let nice: &[&str] = if self.at_own_priority {
            &[]
        } else {
            &["nice", "-n", NICENESS]
        };
        let before = managed
            .enter
            .iter()
            .map(String::as_str)
            .chain(nice.iter().copied());
        let mut arguments = before.map(Path::new).chain([program.as_path()]);
        let mut command = Command::new(arguments.next().unwrap_or(&program));
        command
            .args(arguments)
            .arg(name)
            .arg("--config")
            .arg(&managed.config)
            .arg("--supervised");
        if let Some(log) = self.log.as_ref().filter(|_| managed.kind != ProcessKind::Link) {
            command.arg("--log").arg(log);
        }
        // A group of its own: the terminal's Ctrl-C reaches the supervisor only, which ends all.
        command
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(errors);
        let mut child = command.spawn().map_err(|e| CliError::because(doing(), e))?;
        if let Some(output) = child.stdout.take() {
            let sender = self.lines.0.clone();
            std::thread::spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        break;
                    }
                }
            });
        }
        managed.child = Some(child);
        managed.started_ns = steady_ns();
        managed.starts += 1;
        Ok(())
    }

    /// Looks after all: what ended is started again after a pause.
    pub fn poll(&mut self) -> Result<Vec<Event>, CliError> {
        let mut events = Vec::new();
        let mut failed = None;
        let now = steady_ns();
        let mut processes = std::mem::take(&mut self.processes);
        for managed in &mut processes {
            if let Some(child) = &mut managed.child
                && let Ok(Some(status)) = child.try_wait()
            {
                managed.child = None;
                if now - managed.started_ns > STABLE_RUN_NS {
                    managed.backoff_ns = INITIAL_BACKOFF_NS;
                }
                managed.start_at_ns = now + managed.backoff_ns;
                managed.backoff_ns = (2 * managed.backoff_ns).min(MAX_BACKOFF_NS);
                events.push(Event::Ended(managed.kind, format!("{status}")));
            }
            // A world that ended has lost the truth: nothing starts it again.
            if managed.child.is_none() && managed.kind != ProcessKind::World && now >= managed.start_at_ns {
                failed = self.spawn(managed).err().or(failed);
            }
        }
        self.processes = processes;
        failed.map_or(Ok(events), Err)
    }
    /// Lines that processes wrote to standard output since the last call.
    pub fn output_lines(&self) -> Vec<String> {
        self.lines.1.try_iter().collect()
    }
    /// Waits for a line that is still under way from a process that ended.
    pub fn remaining_lines(&self) -> Vec<String> {
        self.lines
            .1
            .recv_timeout(Duration::from_millis(500))
            .into_iter()
            .chain(self.lines.1.try_iter())
            .collect()
    }
    /// Tells a process something on its standard input.
    pub fn write_line(&mut self, kind: ProcessKind, line: &str) {
        let child = self
            .processes
            .iter_mut()
            .find(|w| w.kind == kind)
            .and_then(|w| w.child.as_mut());
        if let Some(input) = child.and_then(|c| c.stdin.as_mut()) {
            // One that is gone is started again, and has missed it.
            let _unsent = writeln!(input, "{line}").and_then(|()| input.flush());
        }
    }
    /// When a process that lives began, on the steady clock, ns.
    pub fn started_ns(&self, kind: ProcessKind) -> Option<i64> {
        let managed = self.processes.iter().find(|w| w.kind == kind)?;
        managed.child.as_ref().map(|_| managed.started_ns)
    }
    /// The number of a process that lives.
    pub fn pid(&self, kind: ProcessKind) -> Option<u32> {
        let managed = self.processes.iter().find(|w| w.kind == kind)?;
        managed.child.as_ref().map(Child::id)
    }
    /// Kills a process; looking after it starts it again.
    pub fn kill(&mut self, kind: ProcessKind) {
        let managed = self.processes.iter_mut().find(|w| w.kind == kind);
        if let Some(child) = managed.and_then(|w| w.child.as_mut()) {
            // One that is gone meanwhile needs no killing.
            let _gone = child.kill();
        }
    }
    /// Starts beyond the first, of all processes.
    pub fn restarts(&self) -> u32 {
        self.processes.iter().map(|w| w.starts.saturating_sub(1)).sum()
    }
    /// The last thing that a process wrote to standard error.
    pub fn last_error_line(&self, kind: ProcessKind) -> Option<String> {
        let text = std::fs::read_to_string(self.directory.join(format!("{}.err", kind.name()))).ok()?;
        text.lines()
            .rev()
            .find(|l| !l.trim().is_empty())
            .map(str::to_string)
    }

    /// Ends all: asks by closing their standard input, and after its grace does not ask any more.
    pub fn stop(&mut self, pause: impl Fn(Duration)) {
        for managed in &mut self.processes {
            if let Some(child) = &mut managed.child {
                drop(child.stdin.take());
            }
        }
        let deadline_ns = steady_ns() + GRACE_NS;
        loop {
            for managed in &mut self.processes {
                if let Some(child) = &mut managed.child
                    && matches!(child.try_wait(), Ok(Some(_)) | Err(_))
                {
                    managed.child = None;
                }
            }
            if self.processes.iter().all(|w| w.child.is_none()) {
                return;
            }
            if steady_ns() > deadline_ns {
                break;
            }
            pause(Duration::from_millis(10));
        }
        for managed in &mut self.processes {
            if let Some(mut child) = managed.child.take() {
                // A process that is gone meanwhile needs no killing.
                let _gone = child.kill();
                let _status = child.wait();
            }
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop(pause);
    }
}

/// This process's own program, whatever has become of its file. An upgrade puts a new file in its place:
/// the processes of one supervisor stay of one version, and the kernel keeps the old one for as long as it runs.
fn own_program() -> std::io::Result<PathBuf> {
    let file = std::env::current_exe()?;
    Ok(if file.exists() {
        file
    } else {
        format!("/proc/{}/exe", std::process::id()).into()
    })
}

/// A moment's pause of the supervisor.
#[allow(clippy::disallowed_methods)]
pub fn pause(span: Duration) {
    std::thread::sleep(span);
}
