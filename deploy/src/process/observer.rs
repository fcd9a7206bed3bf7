//! Observer of the reports of an instance's processes.

use alight_shared::msg::{AutopilotState, DeckForecast, DroneState, LinkState, MissionState, Plan, SetPoint};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::memory::{Memory, Subscriber};
use alight_shared::transport::process::ProcessState;

use crate::exit::CliError;
use crate::process::snapshot::Snapshot;

/// Receives the reports of an instance's processes.
pub struct Observer {
    processes: Subscriber<ProcessState>,
    mission: Subscriber<MissionState>,
    autopilot: Subscriber<AutopilotState>,
    drone: Subscriber<DroneState>,
    forecast: Subscriber<DeckForecast>,
    link: Subscriber<LinkState>,
    plan: Subscriber<Plan>,
    set_point: Subscriber<SetPoint>,
    /// What was seen.
    pub snapshot: Snapshot,
    /// Ages of the vessel's newest state since they were taken last, s.
    pub ages_s: Vec<f64>,
}

impl Observer {
    /// Looks on.
    pub fn join(memory: &Memory) -> Result<Observer, CliError> {
        Ok(Observer {
            processes: memory.subscriber()?,
            mission: memory.subscriber()?,
            autopilot: memory.subscriber()?,
            drone: memory.subscriber()?,
            forecast: memory.subscriber()?,
            link: memory.subscriber()?,
            plan: memory.subscriber()?,
            set_point: memory.subscriber()?,
            snapshot: Snapshot::default(),
            ages_s: Vec::new(),
        })
    }
    /// Takes in what is new; the drone's clock reads `drone_ns`, if it is known.
    pub fn poll(&mut self, drone_ns: Option<i64>) {
        let now = steady_ns();
        for state in self.processes.all(now) {
            self.snapshot.processes.insert(state.kind, state);
        }
        let t = drone_ns.unwrap_or(now);
        self.snapshot.mission = self.mission.newest(t).or(self.snapshot.mission);
        self.snapshot.autopilot = self.autopilot.newest(t).or(self.snapshot.autopilot);
        self.snapshot.drone = self.drone.newest(t).or(self.snapshot.drone);
        self.snapshot.forecast = self.forecast.newest(t).or(self.snapshot.forecast);
        let newest = self.set_point.newest(t).map(|s| s.response);
        self.snapshot.response = newest.or(self.snapshot.response);
        let links = self.link.all(t);
        // Who does not take them does not keep them.
        self.ages_s.truncate(64);
        self.ages_s.extend(links.iter().map(|l| l.age_s));
        self.snapshot.link = links.last().copied().or(self.snapshot.link);
        // Without the drone's clock the mission's newest stamp stands for now.
        let now_ns = drone_ns.or(self.snapshot.mission.map(|m| m.header.at.nanos()));
        if let Some(plan) = self.plan.newest(t) {
            self.snapshot.plan = Some((plan, f64::INFINITY));
        }
        if let (Some((plan, age_s)), Some(now_ns)) = (&mut self.snapshot.plan, now_ns) {
            *age_s = (now_ns - plan.header.at.nanos()).max(0) as f64 * 1e-9;
        }
    }
}
