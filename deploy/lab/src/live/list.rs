//! A storm's list on real processes (`alight land --faults`): its scene, and those of a scene's faults that can be done to
//! processes, to the radio and by orders.

use std::path::Path;

use alight_computer::exit::CliError;
use alight_shared::msg::{CommandKind, MissionState, State};
use alight_sim::harness::storm::{Fault, FaultKind, Moment, Storm};

use crate::scene::Scene;
use crate::storm::read_list;

const ORDERS: [(FaultKind, CommandKind); 3] = [
    (FaultKind::Abort, CommandKind::Abort),
    (FaultKind::Hold, CommandKind::Hold),
    (FaultKind::OrderedAgain, CommandKind::Land),
];

/// Command that flies the others.
const IN_LOCK_STEP: &str = "; fly it in lock-step, by `alight study storm --list` or `alight trial`";

/// An order that is given when the mission has been in a state for so long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScheduledOrder {
    pub kind: CommandKind,
    state: State,
    after_s: f64,
    /// First time of the state, s.
    entered_s: Option<f64>,
    given: bool,
}

impl ScheduledOrder {
    /// The order to give now, once.
    pub fn poll(&mut self, t_s: f64, mission: Option<&MissionState>) -> Option<CommandKind> {
        if mission.is_some_and(|m| m.state == self.state) {
            self.entered_s.get_or_insert(t_s);
        }
        let due = !self.given && self.entered_s.is_some_and(|at| t_s >= at + self.after_s);
        self.given |= due;
        due.then_some(self.kind)
    }
}

/// Reads a list that real processes can fly, of one drone.
pub fn read(path: &Path) -> Result<Storm, CliError> {
    let storm = read_list(path)?;
    if storm.drones == 1 {
        return Ok(storm);
    }
    let doing = format!("reading the list {}", path.display());
    let why = format!("{} drones: `alight land` flies one{IN_LOCK_STEP}", storm.drones);
    Err(CliError::because(doing, why))
}

/// A list's scene.
pub fn scene(storm: &Storm) -> Scene {
    let (scenario, nodes) = storm.scene();
    let [amplitude_m, period_s] = storm.sea;
    Scene {
        scenario,
        nodes,
        sea: format!("{amplitude_m},{period_s}"),
        flags: String::new(),
        remarks: Vec::new(),
        knots: false,
    }
}

/// The faults of a scene as real processes have them, without the radio's.
#[derive(Default)]
pub struct LiveFaults {
    /// A fault of processes. A killed one is started again by its supervisor, not after `lasts_s`.
    pub processes: Vec<Fault>,
    pub orders: Vec<ScheduledOrder>,
    radio_lost: bool,
}

impl LiveFaults {
    /// A fault that only lock-step can bring about is an error that names it.
    pub fn of(faults: &[Fault]) -> Result<LiveFaults, CliError> {
        let mut live = LiveFaults::default();
        for fault in faults {
            let added = live.add(fault);
            added.map_err(|what| CliError::because("the faults", format!("{what}{IN_LOCK_STEP}")))?;
        }
        Ok(live)
    }

    fn add(&mut self, fault: &Fault) -> Result<(), String> {
        let kind = fault.kind;
        if fault.entry != 1 {
            return Err(format!(
                "{}: real processes have faults at first entries",
                kind.name()
            ));
        }
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
            self.orders.push(ScheduledOrder {
                kind: *order,
                state,
                after_s: fault.after_s,
                entered_s: None,
                given: false,
            });
        } else if kind == FaultKind::RadioLost && !self.radio_lost {
            self.radio_lost = true;
        } else {
            let of_processes = FaultKind::ALL.iter().copied().filter(|k| k.process().is_some());
            let possible = of_processes.chain(ORDERS.map(|(kind, _)| kind));
            let names: Vec<&str> = possible.map(FaultKind::name).collect();
            return Err(format!(
                "{}: real processes have {} and radio-lost once",
                kind.name(),
                names.join(", ")
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(kind: FaultKind, size: f64) -> Result<(), String> {
        let moment = Moment::In(State::Descent);
        LiveFaults::default().add(&Fault {
            size,
            ..Fault::new(kind, moment, 0.5, 1.0)
        })
    }

    #[test]
    fn faults_of_a_list_that_processes_can_have() {
        let possible = FaultKind::ALL.iter().filter(|k| with(**k, 0.0).is_ok());
        let of_processes = FaultKind::ALL.iter().filter(|k| k.process().is_some());
        assert_eq!(possible.count(), of_processes.count() + ORDERS.len() + 1);
        assert!(
            with(FaultKind::MissionKilled, 1.0)
                .unwrap_err()
                .contains("checkpoint")
        );
        assert!(
            with(FaultKind::RangeStuck, 0.0)
                .unwrap_err()
                .starts_with("range-stuck:")
        );
    }

    #[test]
    fn order_once_after_its_state() {
        let mut order = ScheduledOrder {
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
