//! `alight drone`: the processes of the drone's computer, as its service runs them.
//!
//! One service and not one per process: the services of shared memory have to be created by one
//! process before any other opens them, and what a killed process left has to be cleaned up while none
//! lives. The supervisor starts a process that ended again within 0.1 s at first, and kills one that
//! has been silent for too long so that it is started again too; its own life is watched by systemd.

pub mod autopilot;
pub mod bridge;
pub mod camera;
pub mod camera_source;
pub mod mission;
pub mod pilot;
pub mod planner;
pub mod predictor;

use std::collections::BTreeMap;
use std::process::{Command, Stdio};
use std::time::Duration;

use alight_shared::config;
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Memory, Services};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::wake::end_requested;

use crate::config::DroneComputer;
use crate::config::supervision::Supervision;
use crate::exit::{CliError, Exit};
use crate::process::args::ProcessArgs;
use crate::process::instance::OwnedInstance;
use crate::process::life::end_with_supervisor;
use crate::process::notify::Notify;
use crate::process::observer::Observer;
use crate::process::supervisor::{Event, Supervisor, pause};

/// The supervisor looks after things this often.
const POLL_PERIOD: Duration = Duration::from_millis(50);
/// Succeeds where the system permits real-time priorities.
pub const REALTIME: [&str; 4] = ["chrt", "-f", "1", "true"];
impl Supervision {
    /// What stands before the command of `kind`; `realtime` says that the system permits priorities.
    fn before(&self, kind: ProcessKind, realtime: bool) -> Vec<String> {
        let priority = match kind {
            ProcessKind::Pilot | ProcessKind::Autopilot => self.pilot_priority,
            ProcessKind::Planner => self.planner_priority,
            ProcessKind::World
            | ProcessKind::Vessel
            | ProcessKind::Bridge
            | ProcessKind::Predictor
            | ProcessKind::Mission
            | ProcessKind::Camera
            | ProcessKind::Uvdar
            | ProcessKind::Link
            | ProcessKind::Sensors => return Vec::new(),
        };
        let mut words = Vec::new();
        if !self.processors.is_empty() {
            let list: Vec<String> = self.processors.iter().map(u16::to_string).collect();
            words.extend(["taskset".into(), "-c".into(), list.join(",")]);
        }
        if realtime && priority > 0 {
            words.extend(["chrt".into(), "-f".into(), priority.to_string()]);
        }
        words
    }
}

impl Supervision {
    /// The processes to run, in the order of their start.
    fn processes(&self) -> Vec<ProcessKind> {
        let link = self.autopilot.then_some(ProcessKind::Autopilot);
        ProcessKind::DRONE.into_iter().chain(link).collect()
    }
}

/// Whether the program `words` runs and says yes.
pub fn permitted(words: &[&str]) -> bool {
    let mut command = Command::new(words.first().copied().unwrap_or("false"));
    command.args(words.iter().skip(1));
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|s| s.success())
}

/// Runs the drone's processes until told to end.
pub fn run(args: &ProcessArgs) -> Result<Exit, CliError> {
    let computer: DroneComputer = config::load(&args.config).map_err(|e| CliError(e.to_string()))?;
    // Everything is refused before anything is started. The first question puts the signals' handler
    // in place.
    let told_to_end = end_with_supervisor(args.supervised);
    if end_requested() {
        return Ok(Exit::Success);
    }
    let realtime = permitted(&REALTIME);
    let owned = OwnedInstance::take(&computer.instance)?;
    let memory = Memory::join(owned.instance(), "supervisor")?;
    let services = Services::create(&memory)?;
    owned.ready()?;
    let mut observer = Observer::join(&memory)?;
    let mut supervisor = Supervisor::new(owned.instance().directory(), args.log.clone()).inheriting_stderr();
    let mut kinds = computer.supervision.processes();
    let cameras = [
        (ProcessKind::Camera, computer.camera.clone()),
        (ProcessKind::Uvdar, computer.ultraviolet()),
    ];
    kinds.extend(
        cameras
            .iter()
            .filter(|(_, source)| source.is_there())
            .map(|(kind, _)| *kind),
    );
    for &kind in &kinds {
        let before = computer.supervision.before(kind, realtime);
        supervisor.start(kind, args.config.clone(), before)?;
    }
    if !realtime {
        eprintln!("no real-time priority for pilot and planner: the system does not permit it (ulimit -r)");
    }
    let mut notify = Notify::from_environment();
    let mut killed: BTreeMap<ProcessKind, i64> = BTreeMap::new();
    while memory.wait(POLL_PERIOD) && !told_to_end.load(std::sync::atomic::Ordering::Relaxed) {
        observer.poll(None);
        for line in supervisor.output_lines() {
            eprintln!("{line}");
        }
        for Event::Ended(kind, status) in supervisor.poll()? {
            memory.reap();
            eprintln!("{} ended ({status}) and is started again", kind.name());
        }
        let now = steady_ns();
        for &kind in &kinds {
            let heard = observer.snapshot.processes.get(&kind).map(|p| p.at_ns);
            let began = supervisor.started_ns(kind);
            let sign = [heard, began, killed.get(&kind).copied()];
            let last = sign.into_iter().flatten().max().unwrap_or(now);
            let silent_s = (now - last) as f64 * 1e-9;
            if began.is_some() && silent_s > computer.supervision.silent_s {
                eprintln!("{} was silent for {silent_s:.1} s and is killed", kind.name());
                supervisor.kill(kind);
                killed.insert(kind, now);
            }
        }
        let all = |k: &ProcessKind| observer.snapshot.processes.contains_key(k);
        if kinds.iter().all(all) {
            notify.ready();
        }
        notify.alive(now, || observer.snapshot.line());
    }
    notify.stopping();
    supervisor.stop(pause);
    drop(services);
    drop(memory);
    drop(owned);
    Ok(Exit::Success)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn supervision_raises_only_pilot_and_planner_and_only_where_permitted() {
        let supervision = Supervision {
            processors: vec![2, 3],
            planner_priority: 0,
            ..Supervision::default()
        };
        let words = |kind, realtime| supervision.before(kind, realtime).join(" ");
        assert_eq!(words(ProcessKind::Pilot, true), "taskset -c 2,3 chrt -f 30");
        assert_eq!(words(ProcessKind::Pilot, false), "taskset -c 2,3");
        assert_eq!(words(ProcessKind::Planner, true), "taskset -c 2,3");
        assert_eq!(words(ProcessKind::Bridge, true), "");
        assert!(
            Supervision::default()
                .before(ProcessKind::Pilot, false)
                .is_empty()
        );
    }
}
