//! `alight land`: one landing in real time, with every process of vessel and drone on this computer and the simulated
//! world as the vehicles.

use std::{
    io::{IsTerminal, Write},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use alight_computer::{
    exit::{CliError, Doing, Exit},
    process::{
        checkpoints::PersistentCheckpoints,
        facts::{Facts, Reporter},
        instance::OwnedInstance,
        life::{draw_boot, end_with_supervisor},
        observer::Observer,
        scheduling,
        supervision::SupervisorLimits,
        supervisor::{Supervisor, SupervisorEvent},
    },
    record::flight::{recorder, summary::PhaseEntry},
    terminal::{self, note},
    vessel::deck_file,
};
use alight_shared::{
    msg::{Command, CommandKind, Header, ReasonCode, State},
    process::ProcessKind,
    time::{DroneTime, TrueTime},
};
use alight_transport::{
    clock::{ProcessClock, steady_ns},
    memory::{Memory, Publisher, Services},
    signal::{Signal, signal},
    wake::end_requested,
};

use crate::{
    chart,
    live::{
        air::RadioWatch,
        args::LandArgs,
        config::{AT_SEA, AutopilotKind},
        fault::{FaultInput, LiveAct, LiveFault},
        landing_setup::LandingSetup,
        list::{self, LiveFaults},
        report::{LiveOutcome, LiveReport},
        world::{CONTACT, GOES_ON, WorldReport},
    },
    outcome_table,
    record::{self, RecordingScene},
    scene::Scene,
};

const SUPERVISION_PERIOD: Duration = Duration::from_millis(20);
/// Time after the landing within which messages of a faulted process must resume, ns.
const RECOVERY_TIMEOUT_NS: i64 = 10_000_000_000;
/// Silence after which a process is killed, s: longer than a start takes on a busy computer.
const SILENCE_TIMEOUT_S: f64 = 5.0;
const MAX_FAILURES: u32 = 8;
const BRIEF_ROWS: usize = 5;
/// Period of the status line, ns: slow enough to read.
const STATUS_PERIOD_NS: i64 = 500_000_000;
/// Maximum number of entries of mission states that are kept.
const MAX_PHASES: usize = 1000;
/// Delay after which a command without effect is repeated, s.
const COMMAND_REPEAT_S: f64 = 1.0;

/// Time for which a viewed landing continues after its end, s: an abort's climb and hold, or the drone on the deck.
const VIEWED_S: f64 = 20.0;

pub fn scene(args: &LandArgs) -> Result<Scene, CliError> {
    Ok(with_flags(args, Scene::of(&args.scene)?))
}

fn with_flags(args: &LandArgs, mut scene: Scene) -> Scene {
    if let Some(warm_up_s) = args.warm_up {
        scene.scenario.start.warm_up_s = warm_up_s;
        scene.scenario.start.hover_s = scene.scenario.start.hover_s.min(warm_up_s);
    }
    if args.view.view.is_some() && args.scene.stay.is_none() {
        scene.scenario.stay_s = VIEWED_S;
    }
    // An external firmware and simulated devices need a position on Earth.
    let among = &mut scene.scenario.place.among;
    if args.flown_by() != AutopilotKind::Internal || among.is_empty() {
        *among = vec![AT_SEA];
    }
    scene
}

pub fn run(args: &LandArgs) -> Result<Exit, CliError> {
    let list = args.faults.as_deref().map(list::read).transpose()?;
    let scene = match &list {
        Some(list) => with_flags(args, list::scene(list)),
        None => scene(args)?,
    };
    let faults = LiveFaults::of(&scene.scenario.faults)?;
    let args = &LandArgs {
        seed: list.map_or(args.seed, |list| list.seed),
        ..args.clone()
    };
    if scene.nodes.own.is_some() && (args.log.is_some() || args.record.is_some()) {
        return Err(CliError(
            "--planner exec: a landing of all processes records no plans of another program: leave out --log and --record, \
             or record with alight trial --record"
                .into(),
        ));
    }
    if scene.nodes.predictor.is_some() {
        return Err(CliError(
            "--predictor: land flies the drone's own predictor; fly yours by alight trial or alight study"
                .into(),
        ));
    }
    if let Some(path) = &args.plot {
        chart::can_write(path)?;
    }
    if i64::try_from(args.seed).is_err() {
        return Err(CliError(format!(
            "--seed {}: at most {}; choose a smaller one",
            args.seed,
            i64::MAX
        )));
    }
    // The first call installs the handler, so that from here on a signal stops the processes.
    if end_requested() {
        return Ok(Exit::Failed);
    }
    scheduling::raise();
    // An external firmware flies in another session, which must also run in real time.
    if !args.external {
        scheduling::raise_sessions();
    }
    let owned = OwnedInstance::take(&args.instance)?;
    let memory = Memory::join(owned.instance(), "supervisor")?;
    let services = Services::create(&memory)?;
    owned.ready()?;
    let plan = LandingSetup::of(&scene, args, &owned)?;
    if let Some(flight) = &plan.flight {
        recorder::can_write(flight)?;
    }
    let landing = match Landing::begin(args, faults, &memory, &plan, &owned) {
        // A signal can interrupt a start, which is not an input error.
        Err(_) if !memory.wait(Duration::from_millis(1)) => {
            note(true, format_args!("stopped"));
            return Ok(Exit::Failed);
        }
        begun => begun?,
    };
    let ended = landing.run(&memory);
    let recorded = match &ended {
        Ok(Some(ending)) => record(args, &scene, &plan, ending),
        Ok(None) | Err(_) => Ok(()),
    };
    drop((services, memory, owned));
    match ended? {
        // A failed recording does not discard the landing's result.
        Some(ending) => ending.show(args).and_then(|exit| recorded.map(|()| exit)),
        None => {
            note(true, format_args!("stopped"));
            Ok(Exit::Failed)
        }
    }
}

/// Summarises the landing if its processes recorded, and writes the recording of `--record`.
fn record(args: &LandArgs, scene: &Scene, plan: &LandingSetup, ending: &Ending) -> Result<(), CliError> {
    let (Some(flight), WorldReport::Landed(landed)) = (&plan.flight, &ending.result) else {
        return Ok(());
    };
    let summary = ending.report.summary(&landed.outcome).write(flight);
    summary.doing(format_args!("writing the summary into {}", flight.display()))?;
    let Some(path) = &args.record else {
        return Ok(());
    };
    let subject = RecordingScene {
        scenario: &scene.scenario,
        nodes: &scene.nodes,
        seed: args.seed,
        sea: &scene.sea,
        live: true,
    };
    record::export(flight, &subject, &landed.outcome, path)?;
    note(args.form.alone(), format!("recording: {}", path.display()));
    Ok(())
}

struct Ending {
    result: WorldReport,
    usage: String,
    report: LiveReport,
}

impl Ending {
    fn show(self, args: &LandArgs) -> Result<Exit, CliError> {
        let report = if args.verbose {
            format!("{}{}", self.usage, self.report.text())
        } else {
            self.report.faults()
        };
        let landed = match self.result {
            WorldReport::Landed(landed) => landed,
            WorldReport::TooSlow(too_slow) => {
                note(true, format_args!("alight: {too_slow}"));
                let report = WorldReport::TooSlow(too_slow);
                args.form.print(&report, &[&report])?;
                return Ok(Exit::TooSlow);
            }
        };
        let outcome = landed.outcome;
        let exit = Exit::of(outcome.success || self.report.matched().is_some());
        if args.form.alone() {
            note(true, report);
            let live = LiveReport {
                first_contact_s: landed.first_contact_s,
                motors_on_deck_s: landed.motors_on_deck_s,
                ..self.report
            };
            let landed = LiveOutcome { outcome, live };
            args.form.print(&landed, &[&landed])?;
        } else {
            let rows = if args.verbose { usize::MAX } else { BRIEF_ROWS };
            let table = outcome_table::outcome(&outcome, self.report.matched(), rows);
            terminal::line(format!("\n{table}\n{report}").trim_end());
            if let Some(path) = &args.plot {
                terminal::line(format_args!("plot: {}", path.display()));
            }
        }
        Ok(exit)
    }
}

fn verdict(lines: &[String]) -> Option<WorldReport> {
    lines.iter().find_map(|line| serde_json::from_str(line).ok())
}

struct Landing<'a> {
    args: &'a LandArgs,
    plan: &'a LandingSetup,
    supervisor: Supervisor,
    observer: Observer,
    reporter: Reporter,
    checkpoints: PersistentCheckpoints,
    commands: Publisher<Command>,
    boot: u32,
    sequence: u32,
    commanded_s: f64,
    /// The mission has left its idle state for the landing.
    begun: bool,
    state: State,
    shown_ns: i64,
    phases: Vec<PhaseEntry>,
    faults: Vec<LiveFault>,
    contact: bool,
    stop_requested: Arc<AtomicBool>,
    watch: RadioWatch,
}

impl<'a> Landing<'a> {
    fn begin(
        args: &'a LandArgs,
        faults: LiveFaults,
        memory: &Memory,
        plan: &'a LandingSetup,
        owned: &OwnedInstance,
    ) -> Result<Landing<'a>, CliError> {
        let observer = Observer::join(memory)?;
        let checkpoints = PersistentCheckpoints::join(memory)?;
        let commands = memory.publisher()?;
        let limits = SupervisorLimits {
            silence_timeout_s: Some(SILENCE_TIMEOUT_S),
            max_failures: Some(MAX_FAILURES),
        };
        let directory = owned.instance().directory();
        let mut supervisor = Supervisor::new(directory.clone(), plan.flight.clone(), limits)?;
        supervisor = supervisor.keeping_state_in(directory);
        // A simulated deck is empty before the first landing.
        deck_file::write_first(&owned.instance().directory(), &plan.vessel).map_err(CliError)?;
        plan.air.start(&mut supervisor)?;
        let mut kinds = vec![ProcessKind::World];
        kinds.extend(plan.vessel.processes());
        kinds.extend(plan.drone.processes());
        for kind in kinds {
            supervisor.start(kind, plan.arguments(kind), plan.air.enter(kind))?;
        }
        if let Some(view) = args.view.over(&plan.drone.view) {
            // Viewers run outside the namespaces of the emulated radio.
            let lines = supervisor.start_view(&plan.drone_file, &view)?;
            for line in lines {
                note(args.form.alone(), line);
            }
            terminal::open_browser(&format!("http://{}", view.listen));
        }
        let of_flag = args.fault.and_then(|spec| LiveFault::new(spec, args.seed));
        Ok(Landing {
            faults: of_flag.into_iter().chain(faults.faults).collect(),
            args,
            plan,
            supervisor,
            observer,
            reporter: Reporter::join(memory, Facts::drone(&plan.drone))?,
            checkpoints,
            commands,
            boot: draw_boot(),
            sequence: 0,
            commanded_s: f64::NEG_INFINITY,
            begun: false,
            state: State::Idle,
            shown_ns: 0,
            phases: Vec::new(),
            contact: false,
            stop_requested: end_with_supervisor(args.supervised),
            watch: RadioWatch::default(),
        })
    }

    fn run(mut self, memory: &Memory) -> Result<Option<Ending>, CliError> {
        let shown = std::io::stderr().is_terminal();
        loop {
            if !memory.wait(SUPERVISION_PERIOD) || self.stop_requested.load(Ordering::Relaxed) {
                self.supervisor.stop();
                return Ok(None);
            }
            let now: DroneTime = self.plan.clock.now();
            self.observer.poll();
            self.reporter.poll(steady_ns(), || None);
            self.checkpoints.poll(now);
            let t_s = self.t_s();
            self.phase(t_s, shown);
            self.command(now, t_s);
            self.poll_faults(now)?;
            let output = self.supervisor.output_lines();
            self.contact |= output.iter().any(|line| line == CONTACT);
            if output.iter().any(|line| line == GOES_ON) {
                let text = "not landed: goes on until the next landing, for at most 5 min (Ctrl+C ends it)";
                note(self.args.form.alone(), format_args!("{t_s:>7.2} s  {text}"));
            }
            let state = self.observer.snapshot.mission.map(|m| m.state);
            let ages_s = std::mem::take(&mut self.observer.ages_s);
            self.watch
                .observe(&self.plan.air, &output, &ages_s, state, &mut self.supervisor);
            if let Some(outcome) = verdict(&output) {
                self.await_recovery(memory)?;
                return Ok(Some(self.finish(outcome)));
            }
            let reports = &self.observer.snapshot.processes;
            for event in self.supervisor.poll(|kind| reports.get(&kind).map(|p| p.at_ns))? {
                let (kind, status) = match event {
                    SupervisorEvent::Ended(kind, status) => (kind, status),
                    SupervisorEvent::Silent(..) | SupervisorEvent::NotStarted(..) => {
                        note(true, format_args!("{event}"));
                        continue;
                    }
                };
                memory.reap();
                if kind == ProcessKind::World
                    && let Some(outcome) = verdict(&self.supervisor.remaining_lines())
                {
                    self.await_recovery(memory)?;
                    return Ok(Some(self.finish(outcome)));
                }
                self.on_exit(kind, &status)?;
            }
        }
    }

    fn t_s(&self) -> f64 {
        let clock = ProcessClock {
            epoch_ns: self.plan.clock.epoch_ns,
            ..ProcessClock::default()
        };
        clock.now::<TrueTime>().secs() - self.plan.warm_up_s
    }

    /// Handles the end of a process: an error unless it was expected.
    fn on_exit(&mut self, kind: ProcessKind, status: &str) -> Result<(), CliError> {
        let why = self.supervisor.last_error_line(kind).unwrap_or_default();
        if kind == ProcessKind::World {
            return Err(CliError(format!("the simulated world ended ({status}): {why}")));
        }
        note(
            true,
            format_args!("{} ended ({status}) and is started again; {why}", kind.name()),
        );
        Ok(())
    }

    fn poll_faults(&mut self, now: DroneTime) -> Result<(), CliError> {
        let t_s = self.t_s();
        let snapshot = &self.observer.snapshot;
        let alone = self.args.form.alone();
        let mut orders = Vec::new();
        for fault in &mut self.faults {
            let process = fault.process();
            let input = FaultInput {
                t_s,
                mission: *snapshot.mission,
                process: process.and_then(|kind| snapshot.processes.get(&kind).copied()),
                contact: self.contact,
            };
            match fault.poll(steady_ns(), &input) {
                Some(LiveAct::Signal(pid, what)) => {
                    let name = &fault.report.fault;
                    signal(pid, what).doing(format_args!("the fault {name}"))?;
                    if what != Signal::Continue {
                        note(alone, format!("{t_s:>7.2} s  fault {name}"));
                    }
                }
                Some(LiveAct::Order(kind)) => orders.push(kind),
                None => {}
            }
        }
        for kind in orders {
            note(alone, format!("{t_s:>7.2} s  order: {kind:?}"));
            self.send(now, kind);
        }
        Ok(())
    }
    fn send(&mut self, now: DroneTime, kind: CommandKind) {
        self.sequence += 1;
        let (vessel, drone) = self.plan.ids;
        let header = Header::new(vessel, drone, self.boot, self.sequence, now);
        self.commands.send(&Command { header, kind });
    }

    /// After the landing, waits briefly for a faulted process whose messages have not resumed.
    fn await_recovery(&mut self, memory: &Memory) -> Result<(), CliError> {
        let until = steady_ns() + RECOVERY_TIMEOUT_NS;
        while self.faults.iter().any(LiveFault::is_under_way) && steady_ns() < until {
            if !memory.wait(SUPERVISION_PERIOD) {
                break;
            }
            self.observer.poll();
            self.poll_faults(self.plan.clock.now())?;
            self.supervisor.poll(|_| Some(steady_ns()))?;
        }
        Ok(())
    }

    fn phase(&mut self, t_s: f64, shown: bool) {
        let clear = || {
            if shown {
                eprint!("\r\x1b[K");
            }
        };
        if let Some(m) = *self.observer.snapshot.mission
            && m.state != self.state
        {
            self.state = m.state;
            clear();
            note(
                self.args.form.alone(),
                format!("{t_s:>7.2} s  {:<16} {}", m.state.named(&m.entered), m.entered),
            );
            if self.phases.len() < MAX_PHASES {
                self.phases.push(PhaseEntry {
                    t_s,
                    state: m.state.name().into(),
                    reason: m.entered.to_string(),
                });
            }
        }
        if shown && steady_ns() - self.shown_ns > STATUS_PERIOD_NS {
            self.shown_ns = steady_ns();
            clear();
            eprint!("{t_s:>7.1} s  {}", self.observer.snapshot.line(steady_ns()));
            let _ignored = std::io::stderr().flush();
        }
    }

    /// Commands the landing when it is due, until the mission begins it; a restarted mission restores the landing by
    /// itself.
    fn command(&mut self, now: DroneTime, t_s: f64) {
        let waits =
            self.observer.snapshot.mission.is_some_and(|m| {
                m.state == State::Idle && matches!(m.waiting.code, ReasonCode::NotCommanded)
            });
        let first = self.sequence == 0;
        self.begun |= !first && self.state != State::Idle;
        if t_s < 0.0 || self.begun || !(first || waits && t_s > self.commanded_s + COMMAND_REPEAT_S) {
            return;
        }
        self.commanded_s = t_s;
        self.send(now, CommandKind::Land);
    }

    /// Combines the world's report with the resource usage of the processes.
    fn finish(mut self, result: WorldReport) -> Ending {
        let snapshot = &self.observer.snapshot;
        let ending = Ending {
            result,
            usage: [snapshot.usage(steady_ns()), snapshot.stages(), snapshot.radio()].concat(),
            report: LiveReport {
                phases: std::mem::take(&mut self.phases),
                faults: (self.faults.drain(..).filter(|f| f.process().is_some()))
                    .map(|f| f.report)
                    .collect(),
                radio: self
                    .watch
                    .report((steady_ns() - self.plan.clock.epoch_ns) as f64 * 1e-9),
                ..LiveReport::of(snapshot, self.supervisor.restarts())
            },
        };
        self.supervisor.stop();
        ending
    }
}
