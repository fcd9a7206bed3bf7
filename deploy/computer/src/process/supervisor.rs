//! Executes the decisions of [`SupervisorNode`]: starts ([`start`]), kills and ends processes.

use std::{
    ffi::OsStr,
    fmt,
    io::Write,
    path::{Path, PathBuf},
    process::Child,
    sync::mpsc::{Receiver, SyncSender, sync_channel},
    time::Duration,
};

use alight_shared::{node::Node, process::ProcessKind, time::Time};
use alight_transport::clock::steady_ns;

use crate::{
    config::view::ViewConfig,
    exit::{CliError, Doing},
    process::{
        life::draw_boot,
        start::{MAX_LINES, ProcessSurroundings, start},
        supervision::{Observed, SupervisorAction, SupervisorLimits, SupervisorNode},
    },
    record::flight::recorder::{NodeRecorder, PartHeader},
};

/// Process name under which the supervisor's steps are recorded.
pub const SUPERVISOR: &str = "supervisor";
/// Time that processes have to end when asked, ns; `TimeoutStopSec` of the services is longer.
const GRACE_NS: i64 = 4_000_000_000;

struct ManagedProcess {
    kind: ProcessKind,
    /// Command prefix that enters the network namespace of the processes.
    prefix: Vec<String>,
    arguments: Vec<String>,
    child: Option<Child>,
}

pub struct Supervisor {
    node: SupervisorNode,
    recorder: Option<NodeRecorder>,
    processes: Vec<ManagedProcess>,
    directory: PathBuf,
    flight: Option<PathBuf>,
    /// State directory, which outlives the processes; None: the one that the service manager names.
    state: Option<PathBuf>,
    /// Processes write errors to the supervisor's standard error, not to files.
    inherit_stderr: bool,
    lines: (SyncSender<String>, Receiver<String>),
    /// As in flight, a process that cannot start does not end the others.
    keeps_others: bool,
    /// Events of a process's first start, returned by the next poll.
    events: Vec<SupervisorEvent>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum SupervisorEvent {
    /// The process ended, and is restarted unless it is the world.
    Ended(ProcessKind, String),
    /// The process was silent for this time, s, and is killed.
    Silent(ProcessKind, f64),
    NotStarted(ProcessKind, String),
}

impl fmt::Display for SupervisorEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SupervisorEvent::Ended(kind, status) => {
                write!(f, "{} ended ({status}) and is started again", kind.name())
            }
            SupervisorEvent::Silent(kind, silence_s) => {
                write!(
                    f,
                    "{} reported nothing for {silence_s:.1} s and is killed",
                    kind.name()
                )
            }
            SupervisorEvent::NotStarted(kind, error) => {
                write!(f, "{} could not start, retrying: {error}", kind.name())
            }
        }
    }
}

impl Supervisor {
    /// Supervisor without processes. Errors of its processes go to files in `directory`, the record of its decisions
    /// to `flight`.
    pub fn new(
        directory: PathBuf,
        flight: Option<PathBuf>,
        limits: SupervisorLimits,
    ) -> Result<Supervisor, CliError> {
        let recorder = match &flight {
            Some(flight) => {
                let header = PartHeader {
                    process: SUPERVISOR.into(),
                    boot: draw_boot(),
                    began_ns: steady_ns(),
                    first_step: 0,
                    config: toml::to_string(&limits).doing("writing limits")?,
                };
                Some(NodeRecorder::begin(flight, header))
            }
            None => None,
        };
        Ok(Supervisor {
            keeps_others: limits.max_failures.is_none(),
            events: Vec::new(),
            node: SupervisorNode::new(limits),
            recorder,
            processes: Vec::new(),
            directory,
            flight,
            state: None,
            inherit_stderr: false,
            lines: sync_channel(MAX_LINES),
        })
    }
    /// Processes write errors to the supervisor's standard error: a service's journal keeps and rotates them.
    pub fn inheriting_stderr(mut self) -> Supervisor {
        self.inherit_stderr = true;
        self
    }
    pub fn keeping_state_in(mut self, directory: PathBuf) -> Supervisor {
        self.state = Some(directory);
        self
    }
    /// Starts a process with these program arguments, after the command `prefix`.
    pub fn start(
        &mut self,
        kind: ProcessKind,
        arguments: Vec<String>,
        prefix: Vec<String>,
    ) -> Result<(), CliError> {
        let mut arguments = arguments;
        let records = !matches!(kind, ProcessKind::Link | ProcessKind::View);
        if let (Some(flight), true) = (&self.flight, records) {
            arguments.extend(["--flight".into(), flight.display().to_string()]);
        }
        self.processes.push(ManagedProcess {
            kind,
            prefix,
            arguments,
            child: None,
        });
        self.events = self.poll(|_| None)?;
        Ok(())
    }

    /// Starts the viewers' server for the computer with this configuration; returns its addresses as text.
    pub fn start_view(&mut self, config: &Path, view: &ViewConfig) -> Result<Vec<String>, CliError> {
        let mut pieces = arguments(ProcessKind::View, config);
        pieces.extend(["--listen".into(), view.listen.clone()]);
        let mut lines = vec![format!("page: http://{}", view.listen)];
        if !view.foxglove.is_empty() {
            pieces.push(format!("--foxglove={}", view.foxglove));
            lines.push(format!("Foxglove: ws://{}", view.foxglove));
        }
        self.start(ProcessKind::View, pieces, Vec::new())?;
        Ok(lines)
    }

    fn spawn(&mut self, kind: ProcessKind) -> Result<(), CliError> {
        let name = kind.name();
        let fail = |e| CliError::because(format!("starting the process {name}"), e);
        let program = own_program().map_err(fail)?;
        let errors = self.directory.join(format!("{name}.err"));
        let around = ProcessSurroundings {
            errors: (!self.inherit_stderr).then_some(errors.as_path()),
            state: self.state.as_deref(),
            notified: None,
        };
        let Some(managed) = self.processes.iter_mut().find(|p| p.kind == kind) else {
            return Ok(());
        };
        let pieces = managed.prefix.iter().map(OsStr::new).chain([program.as_os_str()]);
        let pieces = pieces.chain(managed.arguments.iter().map(OsStr::new));
        let child = start(pieces, around, self.lines.0.clone()).map_err(fail)?;
        managed.child = Some(child);
        Ok(())
    }

    /// Restarts ended processes after a delay, and kills silent ones. `reported` returns the time of a process's
    /// newest report on the steady clock, ns.
    pub fn poll(
        &mut self,
        reported: impl Fn(ProcessKind) -> Option<i64>,
    ) -> Result<Vec<SupervisorEvent>, CliError> {
        let mut events = core::mem::take(&mut self.events);
        let mut observed = Vec::new();
        let now_ns = steady_ns();
        for managed in &mut self.processes {
            if let Some(child) = &mut managed.child
                && let Ok(Some(status)) = child.try_wait()
            {
                managed.child = None;
                events.push(SupervisorEvent::Ended(managed.kind, status.to_string()));
            }
            observed.push(Observed {
                kind: managed.kind,
                running: managed.child.is_some(),
                reported: reported(managed.kind).map(Time::from_nanos),
            });
        }
        let now = Time::from_nanos(now_ns);
        let actions = self.node.step(now, &observed);
        if let Some(recorder) = &mut self.recorder {
            recorder.step(now.nanos(), now.nanos(), &observed, &actions);
        }
        for action in actions {
            match action {
                SupervisorAction::Start(kind) => match self.spawn(kind) {
                    Err(e) if self.keeps_others || kind == ProcessKind::View => {
                        events.push(SupervisorEvent::NotStarted(kind, e.to_string()))
                    }
                    started => started?,
                },
                SupervisorAction::Kill(kind, silence_s) => {
                    self.kill(kind);
                    events.push(SupervisorEvent::Silent(kind, silence_s));
                }
                SupervisorAction::GiveUp(kind) => {
                    let error = self.last_error_line(kind).unwrap_or_default();
                    return Err(CliError(format!(
                        "the process {} ended repeatedly: {error}",
                        kind.name()
                    )));
                }
            }
        }
        Ok(events)
    }
    /// Lines that processes wrote to standard output since the last call.
    pub fn output_lines(&self) -> Vec<String> {
        self.lines.1.try_iter().collect()
    }
    pub fn remaining_lines(&self) -> Vec<String> {
        let first = self.lines.1.recv_timeout(Duration::from_millis(500));
        first.into_iter().chain(self.lines.1.try_iter()).collect()
    }
    fn child_mut(&mut self, kind: ProcessKind) -> Option<&mut Child> {
        let managed = self.processes.iter_mut().find(|p| p.kind == kind)?;
        managed.child.as_mut()
    }
    pub fn write_line(&mut self, kind: ProcessKind, line: &str) {
        if let Some(input) = self.child_mut(kind).and_then(|c| c.stdin.as_mut()) {
            // A process that has ended is restarted and misses the line.
            let _unsent = writeln!(input, "{line}").and_then(|()| input.flush());
        }
    }
    fn kill(&mut self, kind: ProcessKind) {
        if let Some(child) = self.child_mut(kind) {
            let _gone = child.kill();
        }
    }
    pub fn restarts(&self) -> u32 {
        self.node.restarts()
    }
    pub fn last_error_line(&self, kind: ProcessKind) -> Option<String> {
        let text = std::fs::read_to_string(self.directory.join(format!("{}.err", kind.name()))).ok()?;
        let last = text.lines().rev().find(|l| !l.trim().is_empty());
        last.map(str::to_string)
    }

    /// Ends all processes: closes their standard input, and kills the remaining ones after the grace time.
    pub fn stop(&mut self) {
        let mut children: Vec<Child> = self.processes.iter_mut().filter_map(|p| p.child.take()).collect();
        for child in &mut children {
            drop(child.stdin.take());
        }
        let deadline_ns = steady_ns() + GRACE_NS;
        while !children.is_empty() && steady_ns() <= deadline_ns {
            children.retain_mut(|child| matches!(child.try_wait(), Ok(None)));
            pause(Duration::from_millis(10));
        }
        for mut child in children {
            let _gone = child.kill();
            let _status = child.wait();
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop();
    }
}

pub fn arguments(kind: ProcessKind, config: &Path) -> Vec<String> {
    vec![
        kind.subcommand().into(),
        "--config".into(),
        config.display().to_string(),
    ]
}

/// This process's own program, even if an upgrade has replaced its file: the kernel keeps the old file while it runs,
/// so all processes of a supervisor have the same version.
fn own_program() -> std::io::Result<PathBuf> {
    let file = std::env::current_exe()?;
    Ok(if file.exists() {
        file
    } else {
        format!("/proc/{}/exe", std::process::id()).into()
    })
}

#[allow(clippy::disallowed_methods)]
pub fn pause(span: Duration) {
    std::thread::sleep(span);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn missing(kind: ProcessKind, limits: SupervisorLimits) -> (Supervisor, Result<(), CliError>) {
        let mut supervisor = Supervisor::new(std::env::temp_dir(), None, limits)
            .unwrap()
            .inheriting_stderr();
        let prefix = vec!["/nonexistent/program".into()];
        let started = supervisor.start(kind, Vec::new(), prefix);
        (supervisor, started)
    }

    #[test]
    fn supervisor_in_flight_without_a_program() {
        let (mut supervisor, started) = missing(ProcessKind::Camera, SupervisorLimits::default());
        started.unwrap();
        let not_started = |events: &[SupervisorEvent]| {
            let of_camera =
                |e: &SupervisorEvent| matches!(e, SupervisorEvent::NotStarted(ProcessKind::Camera, _));
            events.iter().filter(|e| of_camera(e)).count()
        };
        assert_eq!(not_started(&supervisor.poll(|_| None).unwrap()), 1);
        assert!(supervisor.child_mut(ProcessKind::Camera).is_none());
        let mut again = 0;
        for _ in 0..50 {
            pause(Duration::from_millis(20));
            again += not_started(&supervisor.poll(|_| None).unwrap());
        }
        assert!(again > 0);
    }

    #[test]
    fn supervisor_of_a_trial_without_a_program() {
        let limits = SupervisorLimits {
            silence_timeout_s: None,
            max_failures: Some(3),
        };
        let (_, started) = missing(ProcessKind::Camera, limits);
        assert!(started.unwrap_err().to_string().contains("camera"));
        assert!(missing(ProcessKind::View, limits).1.is_ok());
    }
}
