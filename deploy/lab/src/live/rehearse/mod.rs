//! `alight rehearse`: runs the contents of the two packages against the simulated world in real time, and prints the
//! check list of deploy/docs/install.md with results.
//!
//! Services, configurations, certificates, commands and devices are those of a vessel and a drone: bytes of receiver,
//! compass and inertial sensor on serial lines, raw images in a pipe, MAVLink over UDP. Only the vehicles are
//! simulated.

pub mod args;
mod checked;
pub mod files;
mod flights;
mod list;
mod observations;

use std::{
    path::PathBuf,
    process::{Child, Output},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use alight_computer::{
    exit::{CliError, Doing, Exit},
    process::{
        instance::is_running,
        life::end_with_supervisor,
        observer::{InstanceFollower, Observer},
        scheduling,
        supervisor::pause,
    },
    situation::ObservedSituation,
    terminal,
    vessel::deck_file,
};
use alight_shared::{
    msg::{ReasonCode, State},
    process::ProcessKind,
};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory},
    signal::{Signal, signal},
    wake::end_requested,
};
use serde::Serialize;

use self::{
    args::RehearseArgs,
    files::RehearsalPlan,
    list::{CheckList, CheckRow},
};
use crate::live::{
    fault::{FaultInput, LiveAct, LiveFault},
    service::{READY_S, Service, command},
    world::{CONTACT, Landed, SENSING, TooSlow, WorldReport},
};

const POLL: Duration = Duration::from_millis(20);
/// Time limit after the world's start for the simulated sensors' first data, s.
const WORLD_S: f64 = 20.0;
/// Time limit after the warm-up for link, clocks and sensors to meet the conditions of install.md, s.
const KNOWN_S: f64 = 30.0;
/// Conditions of install.md before a landing: age of the link, s, and error of the clocks, s.
const LINK_AGE_S: f64 = 0.2;
const CLOCK_SD_S: f64 = 0.01;
/// Additional time for the world's verdict, s: the world waits for the drone to come to rest.
const VERDICT_S: f64 = 5.0;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Waited {
    Met,
    TooLong,
    Stopped,
    TooSlow,
}

#[derive(Serialize)]
struct Rehearsed<'a> {
    ok: bool,
    steps: &'a [CheckRow],
    states: &'a [(f64, &'static str, String)],
    landed: Option<&'a Landed>,
}

pub fn run(args: &RehearseArgs) -> Result<Exit, CliError> {
    // The first call installs the handler, so that from here on a signal ends the rehearsal in an orderly way.
    if end_requested() {
        return Ok(Exit::Failed);
    }
    scheduling::raise();
    // An external firmware flies in another session, which must also run in real time.
    if args.autopilot_at.is_none() {
        scheduling::raise_sessions();
    }
    let plan = RehearsalPlan::of(args)?;
    let mut list = CheckList::new(args.form.alone());
    let names = match plan.certificates.as_slice() {
        [] => "not needed by these files".into(),
        names => names.join(", "),
    };
    list.add(list::CERTIFICATES, "certificates", true, names);
    let alike = plan.contradictions.join("; ");
    let both = if alike.is_empty() {
        "both read, and consistent".into()
    } else {
        alike
    };
    list.add(
        list::CONFIGURATIONS,
        "configurations",
        plan.contradictions.is_empty(),
        both,
    );
    let mut rehearsal = Rehearsal::begin(args, plan)?;
    let whole = rehearsal.run(&mut list)?;
    if let Some(too_slow) = rehearsal.too_slow {
        terminal::note(true, format_args!("alight: {too_slow}"));
        let report = WorldReport::TooSlow(too_slow);
        args.form.print(&report, &[&report])?;
        return Ok(Exit::TooSlow);
    }
    if whole == Waited::Stopped {
        terminal::note(true, format_args!("stopped"));
        return Ok(Exit::Failed);
    }
    if !list.ok() {
        rehearsal.complain(&list);
    }
    let rehearsed = Rehearsed {
        ok: list.ok(),
        steps: list.rows(),
        states: &rehearsal.states,
        landed: rehearsal.landed.as_ref(),
    };
    args.form.print(&rehearsed, list.rows())?;
    Ok(Exit::of(list.ok()))
}

/// Rehearsal in progress. Fields are dropped in order.
struct Rehearsal<'a> {
    args: &'a RehearseArgs,
    program: PathBuf,
    observer: Option<(Memory, Observer)>,
    drone: Option<Service>,
    vessel: Option<Service>,
    world: Service,
    aboard: InstanceFollower,
    sensing: bool,
    stop: Arc<AtomicBool>,
    state: State,
    /// Time since the command, s; state; reason for entering the state.
    states: Vec<(f64, &'static str, String)>,
    commanded_ns: i64,
    armed: Option<bool>,
    landed: Option<Landed>,
    too_slow: Option<TooSlow>,
    fault: Option<LiveFault>,
    contact: bool,
    plan: RehearsalPlan,
}

impl<'a> Rehearsal<'a> {
    fn begin(args: &'a RehearseArgs, plan: RehearsalPlan) -> Result<Rehearsal<'a>, CliError> {
        let own = || std::env::current_exe().doing("looking for this program");
        let directory = plan.directory.path();
        Ok(Rehearsal {
            args,
            program: args.program.clone().map_or_else(own, Ok)?,
            observer: None,
            drone: None,
            vessel: None,
            world: Service::start("world", &[own()?], directory, &[])?,
            aboard: InstanceFollower::of(&plan.vessel.instance, "rehearse")?,
            sensing: false,
            stop: end_with_supervisor(args.supervised),
            state: State::Idle,
            states: Vec::new(),
            commanded_ns: 0,
            armed: None,
            landed: None,
            too_slow: None,
            fault: args.fault.and_then(|spec| LiveFault::new(spec, args.seed)),
            contact: false,
            plan,
        })
    }

    /// Runs the steps in order; Met if every wait succeeded.
    fn run(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        for step in [
            Rehearsal::await_sensors,
            Rehearsal::check_vessel,
            Rehearsal::start_vessel,
            Rehearsal::check_drone,
            Rehearsal::start_drone,
            Rehearsal::know,
            Rehearsal::land,
        ] {
            let waited = step(self, list)?;
            // The next step depends on this one.
            if waited != Waited::Met {
                return Ok(waited);
            }
        }
        Ok(Waited::Met)
    }

    fn receive_report(&mut self) {
        for line in self.world.output() {
            self.sensing |= line == SENSING;
            self.contact |= line == CONTACT;
            match serde_json::from_str(&line) {
                Ok(WorldReport::Landed(landed)) => self.landed = Some(*landed),
                Ok(WorldReport::TooSlow(too_slow)) => self.too_slow = Some(too_slow),
                Err(_) => {}
            }
        }
    }
    fn has_verdict(&self) -> bool {
        self.landed.is_some() || self.too_slow.is_some()
    }
    fn poll(&mut self, list: &CheckList) -> Result<(), CliError> {
        self.receive_report();
        if !self.world.poll() && !self.has_verdict() {
            // The last line of the ended service may still be in transit.
            pause(10 * POLL);
            self.receive_report();
            if !self.has_verdict() {
                let why = self.world.complaints();
                return Err(CliError(format!("the simulated world ended: {why}")));
            }
        }
        for service in [&mut self.vessel, &mut self.drone].into_iter().flatten() {
            service.keep()?;
        }
        // The newest reports are read by later calls.
        let _none = self.aboard.poll();
        if let Some((_, observer)) = &mut self.observer {
            observer.poll();
            observer.ages_s.clear();
            self.armed = observer.snapshot.autopilot.map(|a| a.armed).or(self.armed);
            if let Some(m) = *observer.snapshot.mission
                && m.state != self.state
            {
                self.state = m.state;
                let t_s = (steady_ns() - self.commanded_ns) as f64 * 1e-9;
                list.print(format_args!("{t_s:>9.2} s  {:<16} {}", m.state.name(), m.entered));
                self.states.push((t_s, m.state.name(), m.entered.to_string()));
            }
        }
        self.poll_fault(list)
    }
    fn poll_fault(&mut self, list: &CheckList) -> Result<(), CliError> {
        let (Some(fault), Some((_, observer))) = (&mut self.fault, &self.observer) else {
            return Ok(());
        };
        let (Some(process), now_ns) = (fault.process(), steady_ns()) else {
            return Ok(());
        };
        let aboard = self.aboard.poll().map(|(_, snapshot)| snapshot);
        let of_vessel = process == ProcessKind::Vessel;
        let of_computer = if of_vessel {
            aboard
        } else {
            Some(&observer.snapshot)
        };
        let input = FaultInput {
            t_s: (now_ns - self.commanded_ns) as f64 * 1e-9,
            mission: *observer.snapshot.mission,
            process: of_computer.and_then(|s| s.processes.get(&process).copied()),
            contact: self.contact,
        };
        let Some(LiveAct::Signal(pid, what)) = fault.poll(now_ns, &input) else {
            return Ok(());
        };
        let name = &fault.report.fault;
        match (&mut self.vessel, what) {
            (Some(vessel), Signal::Kill) if of_vessel => vessel.kill(),
            _ => signal(pid, what).doing(format_args!("the fault {name}"))?,
        }
        if what != Signal::Continue {
            list.print(format_args!("{:>9.2} s  fault {name}", input.t_s));
        }
        Ok(())
    }
    fn until(
        &mut self,
        list: &CheckList,
        timeout_s: f64,
        mut met: impl FnMut(&mut Self) -> bool,
    ) -> Result<Waited, CliError> {
        let deadline_ns = steady_ns() + (timeout_s * 1e9) as i64;
        loop {
            if end_requested() || self.stop.load(Ordering::Relaxed) {
                return Ok(Waited::Stopped);
            }
            self.poll(list)?;
            if self.too_slow.is_some() {
                return Ok(Waited::TooSlow);
            }
            if met(self) {
                return Ok(Waited::Met);
            }
            if steady_ns() >= deadline_ns {
                return Ok(Waited::TooLong);
            }
            pause(POLL);
        }
    }
    fn world_s(&self) -> f64 {
        (steady_ns() - self.plan.world.epoch_ns) as f64 * 1e-9 - self.args.warm_up_s()
    }
    fn file(&self, name: &str) -> String {
        self.plan.directory.file(name).display().to_string()
    }

    fn await_sensors(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        let waited = self.until(list, WORLD_S, |r| r.sensing)?;
        if waited != Waited::Met {
            list.add(list::CHECK, "simulated vehicles", false, self.world.complaints());
        }
        Ok(waited)
    }
    /// Runs `alight check` on the vessel before its service starts; the check receives the sensors.
    fn check_vessel(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        self.check("vessel", list)
    }
    /// Runs `alight check` on the drone; the check tests whether the vessel answers.
    fn check_drone(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        self.check("drone", list)
    }
    fn check(&mut self, side: &str, list: &mut CheckList) -> Result<Waited, CliError> {
        let config = self.file(&format!("{side}.toml"));
        let Some(output) = self.ask(list, &["check", "--json", "--config", &config])? else {
            return Ok(Waited::Stopped);
        };
        let firmware = self.args.autopilot_at.is_some();
        let findings = checked::findings(&output.stdout, firmware);
        let of = |level: &'static str| findings.iter().filter(move |f| f["level"] == level);
        let (ok, figure) = checked::judge(&findings, firmware);
        list.add(list::CHECK, format!("alight check, {side}"), ok, figure);
        for (mark, level) in [("BROKEN", "broken"), ("WARNING", "warning")] {
            for finding in of(level) {
                let text = |key: &str| finding[key].as_str().unwrap_or_default().to_owned();
                list.print(format_args!("{mark:>18}  {}: {}", text("topic"), text("found")));
            }
        }
        Ok(Waited::Met)
    }
    /// Runs a command of the program to completion; None if the rehearsal is stopped meanwhile.
    fn ask(&mut self, list: &CheckList, arguments: &[&str]) -> Result<Option<Output>, CliError> {
        let doing = format!("running {} {}", self.program.display(), arguments.join(" "));
        let mut child: Child = command(&self.program, arguments).spawn().doing(&doing)?;
        let mut ended = |_: &mut Self| !matches!(child.try_wait(), Ok(None));
        match self.until(list, READY_S, &mut ended)? {
            Waited::Met => child.wait_with_output().doing(doing).map(Some),
            Waited::TooLong | Waited::Stopped | Waited::TooSlow => {
                let _gone = child.kill().and_then(|()| child.wait());
                Ok(None)
            }
        }
    }

    fn start_vessel(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        let directory = self.plan.directory.path();
        // State after the package's installation, with a deck that the crew has found free.
        deck_file::write_first(directory, &self.plan.vessel).map_err(CliError)?;
        self.vessel = Some(Service::start("vessel", &[&self.program], directory, &[])?);
        self.await_ready(list, list::VESSEL, "alight-vessel", |r| r.vessel.as_ref())
    }
    fn start_drone(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        let directory = self.plan.directory.path();
        self.drone = Some(Service::start("drone", &[&self.program], directory, &[])?);
        let waited = self.await_ready(list, list::DRONE, "alight-drone", |r| r.drone.as_ref())?;
        let instance = Instance::new(&self.plan.drone.instance)?;
        if waited == Waited::Met && is_running(&instance) {
            let memory = Memory::join(&instance, "rehearse")?;
            let observer = Observer::join(&memory)?;
            self.observer = Some((memory, observer));
        }
        Ok(waited)
    }
    fn await_ready(
        &mut self,
        list: &mut CheckList,
        step: u8,
        what: &str,
        which: impl Fn(&Self) -> Option<&Service>,
    ) -> Result<Waited, CliError> {
        let waited = self.until(list, READY_S, |r| which(r).is_some_and(|s| s.ready_s().is_some()))?;
        let figure = match which(self).and_then(Service::ready_s) {
            Some(ready_s) => format!("ready after {ready_s:.2} s"),
            None => format!("not ready within {READY_S:.0} s"),
        };
        list.add(step, what, waited == Waited::Met, figure);
        Ok(waited)
    }

    /// Waits for the conditions of install.md before a landing: sensors, link, clocks.
    fn know(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        let first = self.vessel_status();
        let left_s = (-self.world_s()).max(0.0) + KNOWN_S;
        let waited = self.until(list, left_s, |r| r.world_s() >= 0.0 && r.is_known())?;
        if matches!(waited, Waited::Stopped | Waited::TooSlow) {
            return Ok(waited);
        }
        let now = self.vessel_status();
        self.show_sources(list, first, now);
        let link = self.observer.as_ref().and_then(|(_, o)| *o.snapshot.link);
        let ms = |s: f64| {
            if s.is_finite() {
                format!("{:.0} ms", 1e3 * s)
            } else {
                "unknown".into()
            }
        };
        let age_s = link.map_or(f64::INFINITY, |l| l.age_s);
        let loss = link.map_or(0.0, |l| 100.0 * l.loss);
        let figure = format!("{} old, {loss:.0} % lost", ms(age_s));
        list.add(
            list::DRONE,
            "link, younger than 0.2 s",
            age_s < LINK_AGE_S,
            figure,
        );
        let (offset_s, sd_s) = link.map_or((0.0, f64::INFINITY), |l| (l.clock_offset_s, l.clock_offset_sd_s));
        let figure = if sd_s.is_finite() {
            format!(
                "{:.1} ms apart, known to {:.1} ms",
                1e3 * offset_s.abs(),
                1e3 * sd_s
            )
        } else {
            "unknown".into()
        };
        list.add(list::DRONE, "clocks, known to 10 ms", sd_s < CLOCK_SD_S, figure);
        if self.args.autopilot_at.is_some() {
            let autopilot = self.observer.as_ref().and_then(|(_, o)| *o.snapshot.autopilot);
            let rejection = autopilot.map(|a| match a.rejection {
                suits if suits.code == ReasonCode::None => String::new(),
                rejection => rejection.to_string(),
            });
            let (ok, figure) = checked::fitness(rejection.as_deref());
            list.add(list::CHECK, "firmware, fit to land", ok, figure);
        }
        Ok(waited)
    }
    fn is_known(&self) -> bool {
        let link = self.observer.as_ref().and_then(|(_, o)| *o.snapshot.link);
        link.is_some_and(|l| l.age_s < LINK_AGE_S && l.clock_offset_sd_s < CLOCK_SD_S)
    }
    fn vessel_status(&mut self) -> Option<ObservedSituation> {
        let (_, snapshot) = self.aboard.poll()?;
        Some(ObservedSituation::of(snapshot, steady_ns())).filter(|s| s.vessel().is_some())
    }

    fn land(&mut self, list: &mut CheckList) -> Result<Waited, CliError> {
        self.commanded_ns = steady_ns();
        let config = self.file("drone.toml");
        let Some(output) = self.ask(list, &["order", "land", "--config", &config])? else {
            return Ok(Waited::Stopped);
        };
        let printed = [output.stdout, output.stderr].concat();
        let answer = String::from_utf8_lossy(&printed);
        let answer = answer.lines().next().unwrap_or_default();
        list.add(list::LADDER, "alight order land", output.status.success(), answer);
        if !output.status.success() {
            return Ok(Waited::Met);
        }
        let limit_s = f64::from(self.args.time_limit) + VERDICT_S;
        let waited = self.until(list, limit_s, |r| r.landed.is_some())?;
        if matches!(waited, Waited::Stopped | Waited::TooSlow) {
            return Ok(waited);
        }
        self.show_vision(list);
        self.show_contact(list);
        self.show_fault(list);
        self.show_verdict(list);
        Ok(Waited::Met)
    }

    fn complain(&self, list: &CheckList) {
        let services = [self.vessel.as_ref(), self.drone.as_ref(), Some(&self.world)];
        for printed in services.into_iter().flatten().map(Service::complaints) {
            if !printed.is_empty() {
                list.print(printed);
            }
        }
    }
}

impl Drop for Rehearsal<'_> {
    fn drop(&mut self) {
        // The observer ends before the drone's memory. Every service is asked to end before any is awaited.
        self.observer = None;
        self.aboard.leave();
        for service in [&mut self.drone, &mut self.vessel].into_iter().flatten() {
            service.ask_to_end();
        }
        self.world.ask_to_end();
    }
}
