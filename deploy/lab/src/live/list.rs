//! A storm's list on real processes (`alight land --faults`): its scene, and the faults that can be applied to
//! processes, to the radio or as orders.

use std::path::Path;

use alight_computer::exit::CliError;
use alight_sim::harness::storm::{Fault, FaultKind, Moment, Storm};

use crate::{
    live::fault::{LiveFault, ORDERS},
    scene::Scene,
    storm::read_list,
};

const IN_LOCK_STEP: &str = "; fly it in lock-step, by `alight study storm --list` or `alight trial`";

/// Reads a list of faults for one drone that real processes can fly.
pub fn read(path: &Path) -> Result<Storm, CliError> {
    let storm = read_list(path)?;
    if storm.drones == 1 {
        return Ok(storm);
    }
    let doing = format!("reading the list {}", path.display());
    let why = format!("{} drones: `alight land` flies one{IN_LOCK_STEP}", storm.drones);
    Err(CliError::because(doing, why))
}

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

/// Faults of a scene that can be applied to real processes, without those of the radio.
#[derive(Default)]
pub struct LiveFaults {
    /// Faults of processes, and orders. The supervisor restarts a killed process regardless of `lasts_s`.
    pub faults: Vec<LiveFault>,
    radio_lost: bool,
}

impl LiveFaults {
    /// Selects the faults; a fault that is possible only in lock-step is an error.
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
                "{}: real processes have faults at first entries only",
                kind.name()
            ));
        }
        if kind.process().is_some() {
            if !kind.freezes() && fault.size != 0.0 {
                return Err(format!(
                    "{}, size {}: a killed process always keeps its checkpoint",
                    kind.name(),
                    fault.size
                ));
            }
            self.faults.push(LiveFault::of(fault));
            return Ok(());
        }
        let Moment::In(_) = fault.moment else {
            return Err(format!(
                "{} at the contact: only a process can fail there",
                kind.name()
            ));
        };
        if ORDERS.iter().any(|(k, _)| *k == kind) {
            self.faults.push(LiveFault::of(fault));
        } else if kind == FaultKind::RadioLost && !self.radio_lost {
            self.radio_lost = true;
        } else {
            let of_processes = FaultKind::ALL.iter().copied().filter(|k| k.process().is_some());
            let possible = of_processes.chain(ORDERS.map(|(kind, _)| kind));
            let names: Vec<&str> = possible.map(FaultKind::name).collect();
            return Err(format!(
                "{} is not possible on real processes: choose from {}, or radio-lost once",
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
    use alight_shared::msg::State;

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
                .starts_with("range-stuck is not possible")
        );
    }
}
