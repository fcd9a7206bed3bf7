//! Services as systemd runs them: started, notified of readiness, started again when they end (Restart=always,
//! RestartSec=100ms), told to end.

use std::ffi::OsStr;
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use alight_computer::exit::{CliError, Doing};
use alight_computer::process::start::{Surroundings, start};
use alight_computer::process::supervisor::pause;
use alight_transport::clock::steady_ns;
use alight_transport::signal::{Signal, signal};

/// RestartSec of the units, ns.
const RESTART_NS: i64 = 100_000_000;
/// TimeoutStopSec of the units, ns.
const STOP_NS: i64 = 5_000_000_000;
/// Lines at the end of what a service wrote that a person is shown.
const LAST_LINES: usize = 5;

/// `program` with these words.
pub fn command(program: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(program);
    // A group of its own: the terminal's Ctrl-C reaches the rehearsal only, which ends all.
    command
        .args(words)
        .process_group(0)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// One service.
pub struct Service {
    name: &'static str,
    program: PathBuf,
    config: PathBuf,
    directory: PathBuf,
    notified: UnixDatagram,
    child: Option<Child>,
    lines: Option<Receiver<String>>,
    started_ns: i64,
    ended_ns: Option<i64>,
    ready_s: Option<f64>,
}

impl Service {
    /// Starts `program NAME --config NAME.toml` with the file in `directory`, which is its state directory and takes
    /// what it writes.
    pub fn start(name: &'static str, program: &Path, directory: &Path) -> Result<Service, CliError> {
        let socket = socket(directory, name);
        let notified = UnixDatagram::bind(&socket).and_then(|s| s.set_nonblocking(true).map(|()| s));
        let mut service = Service {
            name,
            program: program.into(),
            config: directory.join(format!("{name}.toml")),
            directory: directory.into(),
            notified: notified.doing(format_args!(
                "receiving the reports of {name} at {}",
                socket.display()
            ))?,
            child: None,
            lines: None,
            started_ns: 0,
            ended_ns: None,
            ready_s: None,
        };
        service.spawn()?;
        Ok(service)
    }

    fn spawn(&mut self) -> Result<(), CliError> {
        let name = self.name;
        let doing = format_args!("starting {} {name}", self.program.display());
        let (socket, errors) = (self.socket(), self.errors_file());
        let around = Surroundings {
            errors: Some(&errors),
            state: Some(&self.directory),
            notified: Some(&socket),
        };
        let words = [self.program.as_os_str(), OsStr::new(name), OsStr::new("--config")];
        let words = words.into_iter().chain([self.config.as_os_str()]);
        let (sender, lines) = channel();
        let child = start(words, around, sender).doing(doing)?;
        (self.child, self.lines) = (Some(child), Some(lines));
        (self.started_ns, self.ended_ns, self.ready_s) = (steady_ns(), None, None);
        Ok(())
    }
    fn socket(&self) -> PathBuf {
        socket(&self.directory, self.name)
    }
    fn errors_file(&self) -> PathBuf {
        self.directory.join(format!("{}.err", self.name))
    }
    /// From its newest start until it reported that it is ready, s.
    pub fn ready_s(&self) -> Option<f64> {
        self.ready_s
    }
    /// What it wrote to standard output since the last call.
    pub fn output(&self) -> Vec<String> {
        self.lines
            .as_ref()
            .map(|l| l.try_iter().collect())
            .unwrap_or_default()
    }
    /// The end of what it wrote to standard error.
    pub fn complaints(&self) -> String {
        let text = std::fs::read_to_string(self.errors_file()).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        let from = lines.len().saturating_sub(LAST_LINES);
        lines.get(from..).unwrap_or_default().join("\n")
    }
    /// Takes in what it reports; true while it lives.
    pub fn poll(&mut self) -> bool {
        let mut buffer = [0; 512];
        while let Ok(n) = self.notified.recv(&mut buffer) {
            if buffer.get(..n).is_some_and(|b| b.starts_with(b"READY=1")) {
                self.ready_s = Some((steady_ns() - self.started_ns) as f64 * 1e-9);
            }
        }
        let ended = |c: &mut Child| matches!(c.try_wait(), Ok(Some(_)));
        if self.child.as_mut().is_some_and(ended) {
            (self.child, self.ended_ns) = (None, Some(steady_ns()));
        }
        self.child.is_some()
    }
    /// The same, and starts it again when it ended.
    pub fn keep(&mut self) -> Result<(), CliError> {
        if !self.poll() && self.ended_ns.is_some_and(|t| steady_ns() - t >= RESTART_NS) {
            self.spawn()?;
        }
        Ok(())
    }
    /// Kills it, and as its manager does what it started.
    pub fn kill(&mut self) {
        if let Some(child) = &mut self.child {
            let started = children(child.id());
            // One that is gone meanwhile needs no killing.
            let _gone = child.kill();
            for pid in started {
                let _gone = signal(pid, Signal::Kill);
            }
        }
    }
    /// Asks it to end.
    pub fn ask_to_end(&mut self) {
        if let Some(child) = &mut self.child {
            drop(child.stdin.take());
        }
    }
}

/// Where a service reports to.
fn socket(directory: &Path, name: &str) -> PathBuf {
    directory.join(format!("{name}.notify"))
}

/// The processes that the process `pid` started.
fn children(pid: u32) -> Vec<u32> {
    let parent = |of: u32| {
        let stat = std::fs::read_to_string(format!("/proc/{of}/stat")).ok()?;
        // Fields are counted after the command's name, which is in parentheses and may hold blanks.
        let fields = stat.rsplit(')').next()?;
        fields.split_whitespace().nth(1)?.parse::<u32>().ok()
    };
    let all = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let all = all.filter_map(|e| e.file_name().to_str()?.parse().ok());
    all.filter(|of| parent(*of) == Some(pid)).collect()
}

impl Drop for Service {
    fn drop(&mut self) {
        self.ask_to_end();
        let deadline_ns = steady_ns() + STOP_NS;
        while self.poll() && steady_ns() < deadline_ns {
            pause(Duration::from_millis(10));
        }
        if let Some(mut child) = self.child.take() {
            let _gone = child.kill();
            let _status = child.wait();
        }
    }
}
