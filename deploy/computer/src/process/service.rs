//! The service of a computer: its processes over one shared memory, under one supervisor.
//!
//! There is one service, not one per process: one process must create the services of shared memory before any other
//! opens them, and the remains of a killed process must be cleaned up while no process lives. The supervisor restarts
//! a process that ended (at once after a long run), and kills and restarts a silent one; systemd watches the
//! supervisor.

use std::{path::PathBuf, sync::atomic::Ordering, time::Duration};

use alight_shared::process::ProcessKind;
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    memory::{Memory, Services},
    wake::end_requested,
};
use tracing::{info, warn};

use crate::{
    config::{recorder::RecorderConfig, view::ViewConfig},
    exit::{CliError, Exit},
    io::store::state_directory,
    process::{
        args::{ProcessArgs, Scheduling},
        checkpoints::PersistentCheckpoints,
        facts::{Facts, Reporter},
        flight::CurrentFlight,
        instance::{CHECKPOINTS_FILE, OwnedInstance},
        life::end_with_supervisor,
        notify::Notify,
        observer::Observer,
        scheduling,
        sealed::SealedConfig,
        supervision::SupervisorLimits,
        supervisor::{self, Supervisor, SupervisorEvent},
    },
};

const POLL_PERIOD: Duration = Duration::from_millis(20);

pub struct ComputerService<'a> {
    pub instance: &'a str,
    pub facts: Facts,
    pub computer: String,
    pub recorder: &'a RecorderConfig,
    pub silence_timeout_s: f64,
    /// Processes in start order, each with a scheduling that the system may not permit.
    pub nodes: Vec<(ProcessKind, Scheduling)>,
    pub view: Option<ViewConfig>,
    /// Clock of the checkpoints that the supervisor keeps; None if each process keeps its own.
    pub checkpoints: Option<ProcessClock>,
}

pub fn run(
    args: &ProcessArgs,
    service: ComputerService<'_>,
    mut sealed: SealedConfig,
) -> Result<Exit, CliError> {
    // Everything is checked before any process starts. The first call installs the signal handler.
    let stop_requested = end_with_supervisor(args.supervised);
    if end_requested() {
        return Ok(Exit::Success);
    }
    scheduling::raise();
    let owned = OwnedInstance::take(service.instance)?;
    let memory = Memory::join(owned.instance(), "supervisor")?;
    let services = Services::create(&memory)?;
    owned.ready()?;
    let mut observer = Observer::join(&memory)?;
    let mut reporter = Reporter::join(&memory, service.facts.clone())?;
    let mut checkpoints = match service.checkpoints {
        Some(clock) => {
            let kept =
                PersistentCheckpoints::join(&memory)?.on_disk(lasting_path(service.instance), clock.now());
            Some((clock, kept.in_file(owned.file(CHECKPOINTS_FILE), clock.now())))
        }
        None => None,
    };
    let mut flight = CurrentFlight::begin(service.recorder, args, &service.computer, steady_ns());
    let recorded = args.flight.clone().or(flight.as_ref().map(CurrentFlight::path));
    let mut supervisor = start(&service, &owned, recorded, &sealed)?;
    let mut notify = Notify::default();
    while memory.wait(POLL_PERIOD) && !stop_requested.load(Ordering::Relaxed) {
        observer.poll();
        sealed.poll(steady_ns());
        reporter.poll(steady_ns(), || sealed.edited());
        // Checkpoints are taken before the remains of a dead process are cleaned up.
        if let Some((clock, checkpoints)) = &mut checkpoints {
            checkpoints.poll(clock.now());
        }
        for line in supervisor.output_lines() {
            info!("{line}");
        }
        let reports = &observer.snapshot.processes;
        for event in supervisor.poll(|kind| reports.get(&kind).map(|p| p.at_ns))? {
            if matches!(event, SupervisorEvent::Ended(..)) {
                memory.reap();
            }
            warn!("{event}");
        }
        let reported = |(kind, _): &(ProcessKind, _)| observer.snapshot.processes.contains_key(kind);
        if service.nodes.iter().all(reported) {
            notify.ready();
        }
        if let Some(flight) = &mut flight {
            let restarts = supervisor.restarts();
            flight.log().observe(steady_ns(), &observer.snapshot, restarts);
            flight.poll(steady_ns());
        }
        notify.alive(steady_ns(), || observer.snapshot.line(steady_ns()));
    }
    notify.stopping();
    supervisor.stop();
    if let Some(flight) = flight {
        flight.end(steady_ns());
    }
    if let Some((_, checkpoints)) = checkpoints {
        checkpoints.forget();
    }
    sealed.end();
    drop(reporter);
    drop(services);
    drop(memory);
    drop(owned);
    Ok(Exit::Success)
}

/// File of the state that survives a reboot; None if the service has no state directory.
fn lasting_path(instance: &str) -> Option<PathBuf> {
    Some(state_directory()?.join(format!("alight-{instance}.flight")))
}

/// Starts the processes, which record into the flight's directory.
fn start(
    service: &ComputerService<'_>,
    owned: &OwnedInstance,
    flight: Option<std::path::PathBuf>,
    sealed: &SealedConfig,
) -> Result<Supervisor, CliError> {
    let limits = SupervisorLimits {
        silence_timeout_s: Some(service.silence_timeout_s),
        max_failures: None,
    };
    let directory = owned.instance().directory();
    let mut supervisor = Supervisor::new(directory, flight, limits)?.inheriting_stderr();
    let permitted = scheduling::real_time_permitted();
    for (kind, scheduling) in &service.nodes {
        let mut arguments = supervisor::arguments(*kind, sealed.path());
        arguments.extend(scheduling.where_permitted(permitted).flags());
        supervisor.start(*kind, arguments, Vec::new())?;
    }
    if let Some(view) = &service.view {
        supervisor.start_view(sealed.path(), view)?;
    }
    if !permitted && service.nodes.iter().any(|(_, s)| s.realtime.is_some()) {
        warn!("no real-time priority for pilot and planner: the system does not permit it (ulimit -r)");
    }
    Ok(supervisor)
}
