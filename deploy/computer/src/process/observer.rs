use alight_shared::{
    bus::readers,
    msg::{
        AutopilotState, ComputerReport, DeckForecast, DeckGrant, DroneState, LinkState, MissionState, Plan,
        SetPoint, SourceReport, VesselStatus, WaveModel,
    },
    process::ProcessState,
    time::DroneClock,
};
use alight_transport::{
    clock::steady_ns,
    memory::{Instance, Memory},
};

use crate::{
    exit::CliError,
    process::{
        instance::{is_running, owner},
        snapshot::Snapshot,
    },
};

readers! {
    struct Reports {
        processes: ProcessState,
        mission: MissionState,
        autopilot: AutopilotState,
        drone: DroneState,
        forecast: DeckForecast,
        link: LinkState,
        plan: Plan,
        grant: DeckGrant<DroneClock>,
        wave: WaveModel<DroneClock>,
        set_point: SetPoint,
        vessel: VesselStatus,
        sources: SourceReport,
        computer: ComputerReport,
    }
}

pub struct Observer {
    reports: Reports<Memory>,
    pub snapshot: Snapshot,
    /// Ages of the vessel's newest state since the list was last read, s.
    pub ages_s: Vec<f64>,
}

impl Observer {
    pub fn join(memory: &Memory) -> Result<Observer, CliError> {
        Ok(Observer {
            reports: Reports::join(memory)?,
            snapshot: Snapshot {
                since_ns: steady_ns(),
                ..Snapshot::default()
            },
            ages_s: Vec::new(),
        })
    }
    pub fn poll(&mut self) {
        let now = steady_ns();
        let snapshot = &mut self.snapshot;
        let of = &mut self.reports;
        for state in of.processes.all(now) {
            snapshot.processes.insert(state.kind, state);
        }
        snapshot.computer.set(now, of.computer.newest(now));
        snapshot.vessel.set(now, of.vessel.newest(now));
        snapshot
            .sources
            .extend(of.sources.all(now).into_iter().map(|s| (s.number, s)));
        snapshot.mission.set(now, of.mission.newest(now));
        snapshot.autopilot.set(now, of.autopilot.newest(now));
        snapshot.drone.set(now, of.drone.newest(now));
        snapshot.forecast.set(now, of.forecast.newest(now));
        snapshot.plan.set(now, of.plan.newest(now));
        snapshot.grant.set(now, of.grant.newest(now));
        snapshot.wave.set(now, of.wave.newest(now));
        let newest = of.set_point.newest(now).map(|s| s.response);
        snapshot.response = newest.or(snapshot.response);
        let links = of.link.all(now);
        // Limits the list if its reader does not drain it.
        self.ages_s.truncate(64);
        self.ages_s.extend(links.iter().map(|l| l.age_s));
        snapshot.link.set(now, links.last().copied());
    }
}

/// Access of an outside process to an instance's memory, which it joins again after a restart of the service.
pub struct Rejoined<T> {
    instance: Instance,
    owner: Option<u32>,
    looked_ns: i64,
    pub ports: Option<T>,
}

/// Period of the check for a restart of the service, ns.
const LOOK_NS: i64 = 100_000_000;

impl<T> Rejoined<T> {
    pub fn of(instance: &str) -> Result<Rejoined<T>, CliError> {
        Ok(Rejoined {
            instance: Instance::new(instance)?,
            owner: None,
            looked_ns: 0,
            ports: None,
        })
    }
    pub fn join(&mut self, join: impl FnOnce(&Instance) -> Result<T, CliError>) -> Result<(), CliError> {
        self.owner = owner(&self.instance);
        let new = join(&self.instance)?;
        // The new memory has the same names by now: dropping the old ports would remove them.
        core::mem::forget(self.ports.replace(new));
        Ok(())
    }
    /// Joins the instance if it has restarted; true while it runs.
    pub fn poll(&mut self, join: impl FnOnce(&Instance) -> Result<T, CliError>) -> bool {
        let now = steady_ns();
        if now - self.looked_ns >= LOOK_NS {
            self.looked_ns = now;
            let owner = owner(&self.instance).filter(|_| is_running(&self.instance));
            let another = owner.is_some() && (self.ports.is_none() || self.owner != owner);
            self.owner = owner;
            if another && self.join(join).is_err() {
                // An instance may still be starting, so the next call tries again.
                self.owner = None;
            }
        }
        self.owner.is_some()
    }
}

pub struct InstanceFollower {
    joined: Rejoined<(Memory, Observer)>,
    name: &'static str,
}

impl InstanceFollower {
    /// Observes the instance `instance` as the process `name`.
    pub fn of(instance: &str, name: &'static str) -> Result<InstanceFollower, CliError> {
        let joined = Rejoined::of(instance)?;
        Ok(InstanceFollower { joined, name })
    }
    /// Stops observing; call this before the memory is removed.
    pub fn leave(&mut self) {
        self.joined.ports = None;
    }
    /// The newest messages and their memory; None while the instance does not run.
    pub fn poll(&mut self) -> Option<(&Memory, &Snapshot)> {
        let name = self.name;
        let join = |instance: &Instance| {
            let memory = Memory::join(instance, name)?;
            let observer = Observer::join(&memory)?;
            Ok((memory, observer))
        };
        let ports = self.joined.poll(join).then_some(self.joined.ports.as_mut());
        let (memory, observer) = ports.flatten()?;
        observer.poll();
        Some((memory, &observer.snapshot))
    }
}
