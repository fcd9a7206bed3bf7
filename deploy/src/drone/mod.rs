//! `alight drone`: the processes of the drone's computer, as its service runs them.
//!
//! One service and not one per process: the services of shared memory have to be created by one
//! process before any other opens them, and what a killed process left has to be cleaned up while none
//! lives. The supervisor restarts a process that ended, at once after a long run, and kills one that reports
//! nothing for too long, so that it is restarted too; systemd watches the supervisor.

pub mod autopilot;
pub mod bridge;
pub mod camera;
pub mod camera_source;
pub mod exposure;
pub mod mission;
pub mod pilot;
pub mod planner;
pub mod predictor;

use std::time::Duration;

use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Memory, Services};
use alight_shared::transport::process::ProcessKind;
use alight_shared::transport::wake::end_requested;
use tracing::{info, warn};

use crate::config::DroneComputer;
use crate::config::supervision::Supervision;
use crate::exit::{CliError, Exit};
use crate::process::args::{Scheduling, ServiceArgs};
use crate::process::flight::Flight;
use crate::process::instance::{CHECKPOINTS_FILE, EDITED_FILE, OwnedInstance};
use crate::process::keeper::CheckpointKeeper;
use crate::process::life::end_with_supervisor;
use crate::process::notify::Notify;
use crate::process::observer::Observer;
use crate::process::scheduling;
use crate::process::sealed::SealedConfig;
use crate::process::supervision::Limits;
use crate::process::supervisor::{self, Event, Supervisor};

/// Time between two looks of the supervisor.
const POLL_PERIOD: Duration = Duration::from_millis(20);

impl Supervision {
    /// The scheduling of `kind`; `permitted` says whether the system permits real-time priorities.
    fn scheduling(&self, kind: ProcessKind, permitted: bool) -> Scheduling {
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
            | ProcessKind::Sensors
            | ProcessKind::View => return Scheduling::default(),
        };
        Scheduling {
            realtime: (permitted && priority > 0).then_some(priority),
            processors: self.processors.clone(),
        }
    }
    /// The processes to run, in the order of their start.
    fn processes(&self) -> Vec<ProcessKind> {
        let link = self.autopilot.then_some(ProcessKind::Autopilot);
        ProcessKind::DRONE.into_iter().chain(link).collect()
    }
}

/// Runs the drone's processes until it is asked to end.
pub fn run(args: &ServiceArgs) -> Result<Exit, CliError> {
    let ServiceArgs { process: args, view } = args;
    let (computer, mut sealed) = SealedConfig::begin::<DroneComputer>(&args.config)?;
    // Everything is checked before anything starts. The first question installs the signal handler.
    let told_to_end = end_with_supervisor(args.supervised);
    if end_requested() {
        return Ok(Exit::Success);
    }
    scheduling::raise();
    let realtime = scheduling::real_time_permitted();
    let owned = OwnedInstance::take(&computer.instance)?;
    let memory = Memory::join(owned.instance(), "supervisor")?;
    let services = Services::create(&memory)?;
    owned.ready()?;
    let mut observer = Observer::join(&memory)?;
    let checkpoints = owned.file(CHECKPOINTS_FILE);
    let mut keeper = CheckpointKeeper::join(&memory)?.in_file(checkpoints, computer.clock.now());
    let limits = Limits {
        silence_timeout_s: Some(computer.supervision.silent_s),
        max_failures: None,
    };
    let directory = owned.instance().directory();
    let name = format!("drone-{}", computer.bridge.drone_id);
    let mut flight = Flight::begin(&computer.recorder, args, &name, steady_ns());
    let recorded = args.flight.clone().or(flight.as_ref().map(Flight::path));
    let mut supervisor = Supervisor::new(directory, recorded, limits)?.inheriting_stderr();
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
        let mut arguments = supervisor::arguments(kind, sealed.path());
        arguments.extend(computer.supervision.scheduling(kind, realtime).flags());
        supervisor.start(kind, arguments, Vec::new())?;
    }
    if let Some(view) = view.over(&computer.view) {
        supervisor.start_view(sealed.path(), &view)?;
    }
    if !realtime {
        warn!("no real-time priority for pilot and planner: the system does not permit it (ulimit -r)");
    }
    let mut notify = Notify::default();
    while memory.wait(POLL_PERIOD) && !told_to_end.load(std::sync::atomic::Ordering::Relaxed) {
        observer.poll(None);
        sealed.poll(steady_ns());
        owned.say(EDITED_FILE, sealed.edited());
        // Before what a dead process left is cleaned up.
        keeper.poll(computer.clock.now());
        for line in supervisor.output_lines() {
            info!("{line}");
        }
        let reports = &observer.snapshot.processes;
        for event in supervisor.poll(|kind| reports.get(&kind).map(|p| p.at_ns))? {
            if matches!(event, Event::Ended(..)) {
                memory.reap();
            }
            warn!("{event}");
        }
        let all = |k: &ProcessKind| observer.snapshot.processes.contains_key(k);
        if kinds.iter().all(all) {
            notify.ready();
        }
        if let Some(flight) = &mut flight {
            let restarts = supervisor.restarts();
            flight.log().observe(steady_ns(), &observer.snapshot, restarts);
            flight.poll(steady_ns());
        }
        notify.alive(steady_ns(), || observer.snapshot.line());
    }
    notify.stopping();
    supervisor.stop();
    if let Some(flight) = flight {
        flight.end(steady_ns());
    }
    keeper.forget();
    sealed.end();
    drop(services);
    drop(memory);
    drop(owned);
    Ok(Exit::Success)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_time_priority_of_pilot_and_planner() {
        let supervision = Supervision {
            processors: vec![2, 3],
            planner_priority: 0,
            ..Supervision::default()
        };
        let flags = |kind, permitted| supervision.scheduling(kind, permitted).flags().join(" ");
        assert_eq!(flags(ProcessKind::Pilot, true), "--realtime 30 --processors 2,3");
        assert_eq!(flags(ProcessKind::Pilot, false), "--processors 2,3");
        assert_eq!(flags(ProcessKind::Planner, true), "--processors 2,3");
        assert_eq!(flags(ProcessKind::Bridge, true), "");
        let usual = Supervision::default().scheduling(ProcessKind::Pilot, false);
        assert_eq!(usual, Scheduling::default());
    }
}
