//! Services as systemd runs them: started, notified of readiness, restarted when they end (Restart=always,
//! RestartSec=100ms), asked to end, killed.

use std::{
    ffi::{OsStr, OsString},
    fs,
    os::unix::{net::UnixDatagram, process::CommandExt},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, sync_channel},
    time::Duration,
};

use alight_computer::{
    exit::{CliError, Doing},
    process::{
        start::{MAX_LINES, ProcessSurroundings, start},
        supervisor::pause,
    },
};
use alight_transport::{
    clock::steady_ns,
    signal::{Signal, signal},
};

const RESTART_NS: i64 = 100_000_000;
const STOP_NS: i64 = 5_000_000_000;
pub const READY_S: f64 = 60.0;
const POLL: Duration = Duration::from_millis(10);
const LAST_LINES: usize = 5;

pub fn command(program: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(program);
    // A separate process group: the terminal's Ctrl-C reaches only the rehearsal, which ends all services.
    command
        .args(arguments)
        .process_group(0)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

pub struct Service {
    name: &'static str,
    arguments: Vec<OsString>,
    directory: PathBuf,
    notified: UnixDatagram,
    child: Option<Child>,
    lines: Option<Receiver<String>>,
    started_ns: i64,
    ended_ns: Option<i64>,
    ready_s: Option<f64>,
}

impl Service {
    /// Starts `PROGRAM NAME --config NAME.toml MORE` with the file in `directory`, which also receives its state and
    /// its output. `program` may include a prefix.
    pub fn start<W: AsRef<OsStr>>(
        name: &'static str,
        program: &[W],
        directory: &Path,
        more: &[&str],
    ) -> Result<Service, CliError> {
        let socket = socket(directory, name);
        let config = directory.join(format!("{name}.toml"));
        let _none = fs::remove_file(&socket);
        let notified = UnixDatagram::bind(&socket).and_then(|s| s.set_nonblocking(true).map(|()| s));
        let own = [OsStr::new(name), OsStr::new("--config"), config.as_os_str()];
        let arguments = program.iter().map(W::as_ref).chain(own);
        let arguments = arguments.chain(more.iter().map(OsStr::new));
        let mut service = Service {
            name,
            arguments: arguments.map(OsStr::to_owned).collect(),
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
        let socket = self.socket();
        let errors = self.errors_file();
        let around = ProcessSurroundings {
            errors: Some(&errors),
            state: Some(&self.directory),
            notified: Some(&socket),
        };
        let (sender, lines) = sync_channel(MAX_LINES);
        let arguments = self.arguments.join(OsStr::new(" "));
        let child = start(&self.arguments, around, sender);
        let child = child.doing(format_args!("starting {}", arguments.display()))?;
        self.child = Some(child);
        self.lines = Some(lines);
        self.started_ns = steady_ns();
        self.ended_ns = None;
        self.ready_s = None;
        Ok(())
    }
    pub fn socket(&self) -> PathBuf {
        socket(&self.directory, self.name)
    }
    fn errors_file(&self) -> PathBuf {
        self.directory.join(format!("{}.err", self.name))
    }
    pub fn id(&self) -> Option<u32> {
        self.child.as_ref().map(Child::id)
    }
    /// Time from its last start to its report of readiness, s.
    pub fn ready_s(&self) -> Option<f64> {
        self.ready_s
    }
    pub fn output(&self) -> Vec<String> {
        self.lines.iter().flat_map(Receiver::try_iter).collect()
    }
    pub fn lines(&self) -> impl Iterator<Item = String> {
        self.lines.iter().flatten()
    }
    pub fn complaints(&self) -> String {
        let text = fs::read_to_string(self.errors_file()).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        let from = lines.len().saturating_sub(LAST_LINES);
        lines.get(from..).unwrap_or_default().join("\n")
    }
    pub fn poll(&mut self) -> bool {
        let mut buffer = [0; 512];
        while let Ok(n) = self.notified.recv(&mut buffer) {
            if buffer.get(..n).is_some_and(|b| b.starts_with(b"READY=1")) {
                self.ready_s = Some((steady_ns() - self.started_ns) as f64 * 1e-9);
            }
        }
        let ended = |c: &mut Child| matches!(c.try_wait(), Ok(Some(_)));
        if self.child.as_mut().is_some_and(ended) {
            self.child = None;
            self.ended_ns = Some(steady_ns());
        }
        self.child.is_some()
    }
    pub fn keep(&mut self) -> Result<(), CliError> {
        if !self.poll() && self.ended_ns.is_some_and(|t| steady_ns() - t >= RESTART_NS) {
            self.spawn()?;
        }
        Ok(())
    }
    pub fn await_ready(&mut self) -> Result<(), CliError> {
        let deadline_ns = steady_ns() + (READY_S * 1e9) as i64;
        while self.poll() && self.ready_s.is_none() && steady_ns() < deadline_ns {
            pause(POLL);
        }
        let doing = format!("waiting until {} is ready", self.name);
        match self.ready_s {
            Some(_) => Ok(()),
            None => Err(CliError::because(doing, self.complaints())),
        }
    }
    /// Kills the service and its child processes, as systemd does, and waits for their end.
    pub fn kill(&mut self) {
        let Some(child) = &mut self.child else { return };
        let mut left = children(child.id());
        let _gone = child.kill();
        let deadline_ns = steady_ns() + STOP_NS;
        while (self.poll() || !left.is_empty()) && steady_ns() < deadline_ns {
            left.retain(|pid| runs(*pid));
            for pid in &left {
                let _gone = signal(*pid, Signal::Kill);
            }
            pause(POLL);
        }
    }
    pub fn ask_to_end(&mut self) {
        if let Some(child) = &mut self.child {
            drop(child.stdin.take());
        }
    }
    /// Asks the service to end, and kills it after a timeout; true if it ended by itself.
    pub fn stop(&mut self) -> bool {
        self.ask_to_end();
        let deadline_ns = steady_ns() + STOP_NS;
        while self.poll() && steady_ns() < deadline_ns {
            pause(POLL);
        }
        let ended = self.child.is_none();
        self.kill();
        ended
    }
}

fn socket(directory: &Path, name: &str) -> PathBuf {
    directory.join(format!("{name}.notify"))
}

/// Whether the process `pid` runs; a zombie does not count.
pub fn runs(pid: u32) -> bool {
    fs::read_link(format!("/proc/{pid}/exe")).is_ok()
}

fn children(pid: u32) -> Vec<u32> {
    let parent = |of: u32| {
        let stat = fs::read_to_string(format!("/proc/{of}/stat")).ok()?;
        // Fields are counted after the command name, which is in parentheses and may contain spaces.
        let fields = stat.rsplit(')').next()?;
        fields.split_whitespace().nth(1)?.parse::<u32>().ok()
    };
    let all = fs::read_dir("/proc").into_iter().flatten().flatten();
    let all = all.filter_map(|e| e.file_name().to_str()?.parse().ok());
    all.filter(|of| parent(*of) == Some(pid)).collect()
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ended = self.stop();
    }
}
