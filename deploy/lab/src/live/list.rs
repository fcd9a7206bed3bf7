//! A storm's list on real processes (`alight land --faults`): its scene, and those of its faults that can be done to
//! processes, to the radio and by orders.

use std::path::Path;

use alight_computer::exit::CliError;
use alight_shared::msg::{CommandKind, MissionState, State};
use alight_sim::harness::scenario::{NodeConfigs, Scenario, StateOutage};
use alight_sim::harness::storm::{Fault, Kind, Moment, Storm};

use crate::scene::Scene;
use crate::storm::read_list;

/// What is ordered.
const ORDERS: [(Kind, CommandKind); 3] = [
    (Kind::Abort, CommandKind::Abort),
    (Kind::Hold, CommandKind::Hold),
    (Kind::OrderedAgain, CommandKind::Land),
];

/// An order that is given when the mission has been in a state for so long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// What is ordered.
    pub kind: CommandKind,
    state: State,
    after_s: f64,
    /// When the state was first seen, s.
    entered_s: Option<f64>,
    given: bool,
}

impl Order {
    /// What is to be ordered now, once.
    pub fn poll(&mut self, t_s: f64, mission: Option<&MissionState>) -> Option<CommandKind> {
        if mission.is_some_and(|m| m.state == self.state) {
            self.entered_s.get_or_insert(t_s);
        }
        let due = !self.given && self.entered_s.is_some_and(|at| t_s >= at + self.after_s);
        self.given |= due;
        due.then_some(self.kind)
    }
}

/// A list as real processes fly it.
pub struct LiveList {
    storm: Storm,
    /// Of processes. A killed one is started again by its supervisor, not after `lasts_s`.
    pub processes: Vec<Fault>,
    /// Orders.
    pub orders: Vec<Order>,
    outage: Option<StateOutage>,
}

impl LiveList {
    /// Reads one; a fault that only lock-step can bring about is an error that names it.
    pub fn read(path: &Path) -> Result<LiveList, CliError> {
        let storm = read_list(path)?;
        let mut list = LiveList {
            processes: Vec::new(),
            orders: Vec::new(),
            outage: None,
            storm: storm.clone(),
        };
        let refuse = |what: String| {
            let doing = format!("reading the list {}", path.display());
            CliError::because(doing, format!("{what}; fly it by `alight storm --list`"))
        };
        if storm.drones > 1 {
            return Err(refuse(format!(
                "{} drones: `alight land` flies one",
                storm.drones
            )));
        }
        for fault in &storm.faults {
            list.add(fault).map_err(&refuse)?;
        }
        Ok(list)
    }

    fn add(&mut self, fault: &Fault) -> Result<(), String> {
        let kind = fault.kind;
        if kind.process().is_some() {
            if !kind.freezes() && fault.size != 0.0 {
                return Err(format!(
                    "{}, size {}: a process that was killed has its checkpoint here",
                    kind.name(),
                    fault.size
                ));
            }
            self.processes.push(*fault);
            return Ok(());
        }
        let Moment::In(state) = fault.moment else {
            return Err(format!(
                "{} at the contact: a process alone fails there",
                kind.name()
            ));
        };
        if let Some((_, order)) = ORDERS.iter().find(|(k, _)| *k == kind) {
            self.orders.push(Order {
                kind: *order,
                state,
                after_s: fault.after_s,
                entered_s: None,
                given: false,
            });
        } else if kind == Kind::RadioLost && self.outage.is_none() {
            self.outage = Some(StateOutage {
                state,
                after_s: fault.after_s,
                duration_s: fault.lasts_s,
            });
        } else {
            let of_processes = Kind::ALL.iter().copied().filter(|k| k.process().is_some());
            let possible = of_processes.chain(ORDERS.map(|(kind, _)| kind));
            let names: Vec<&str> = possible.map(Kind::name).collect();
            return Err(format!(
                "{}: real processes have {} and radio-lost once",
                kind.name(),
                names.join(", ")
            ));
        }
        Ok(())
    }

    /// Its seed.
    pub fn seed(&self) -> u64 {
        self.storm.seed
    }
    /// Its scene.
    pub fn scene(&self) -> Scene {
        let (mut scenario, nodes): (Scenario, NodeConfigs) = self.storm.scene();
        scenario.radio_outage = self.outage;
        let [amplitude_m, period_s] = self.storm.sea;
        Scene {
            scenario,
            nodes,
            sea: format!("{amplitude_m},{period_s}"),
            flags: String::new(),
            remarks: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(kind: Kind, size: f64) -> Result<(), String> {
        let mut list = LiveList {
            storm: Storm::drawn(1, 0),
            processes: Vec::new(),
            orders: Vec::new(),
            outage: None,
        };
        list.add(&Fault {
            kind,
            moment: Moment::In(State::Descent),
            entry: 1,
            after_s: 0.5,
            size,
            lasts_s: 1.0,
        })
    }

    #[test]
    fn faults_of_a_list_that_processes_can_have() {
        let possible = Kind::ALL.iter().filter(|k| with(**k, 0.0).is_ok());
        let of_processes = Kind::ALL.iter().filter(|k| k.process().is_some());
        assert_eq!(possible.count(), of_processes.count() + ORDERS.len() + 1);
        assert!(with(Kind::MissionKilled, 1.0).unwrap_err().contains("checkpoint"));
        assert!(
            with(Kind::RangeStuck, 0.0)
                .unwrap_err()
                .starts_with("range-stuck:")
        );
    }

    #[test]
    fn order_once_after_its_state() {
        let mut order = Order {
            kind: CommandKind::Abort,
            state: State::Descent,
            after_s: 0.5,
            entered_s: None,
            given: false,
        };
        let state = |state| MissionState {
            state,
            ..MissionState::default()
        };
        let (tracking, descent) = (state(State::Tracking), state(State::Descent));
        assert_eq!(order.poll(1.0, Some(&tracking)), None);
        assert_eq!(order.poll(2.0, Some(&descent)), None);
        assert_eq!(order.poll(2.6, Some(&tracking)), Some(CommandKind::Abort));
        assert_eq!(order.poll(2.7, Some(&descent)), None);
    }
}
