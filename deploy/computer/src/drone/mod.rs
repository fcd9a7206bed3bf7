//! `alight drone`: the processes of the drone's computer, as its service runs them.

pub mod autopilot;
pub mod bridge;
pub mod camera;
pub mod camera_source;
pub mod exposure;
pub mod mission;
pub mod pilot;

use alight_shared::process::ProcessKind;

use crate::{
    config::{DroneComputerConfig, supervision::Supervision},
    exit::{CliError, Exit},
    io::mavlink_key,
    process::{
        args::{Scheduling, ServiceArgs},
        facts::Facts,
        sealed::SealedConfig,
        service::{self, ComputerService},
    },
};

impl Supervision {
    fn scheduling(&self, kind: ProcessKind) -> Scheduling {
        // Set-points depend on these processes, so they do not wait for other programs; the pilot waits for none of them.
        let between = self.pilot_priority.midpoint(self.planner_priority);
        let priorities = [
            (ProcessKind::Pilot, self.pilot_priority),
            (ProcessKind::Autopilot, self.pilot_priority),
            (ProcessKind::Predictor, between),
            (ProcessKind::Mission, between),
            (ProcessKind::Planner, self.planner_priority),
        ];
        let Some((_, priority)) = priorities.into_iter().find(|(k, _)| *k == kind) else {
            return Scheduling::default();
        };
        Scheduling {
            realtime: (priority > 0).then_some(priority),
            processors: self.processors.clone(),
        }
    }
}

pub fn run(args: &ServiceArgs) -> Result<Exit, CliError> {
    let (computer, sealed) = SealedConfig::begin::<DroneComputerConfig>(&args.process.config)?;
    let supervision = &computer.supervision;
    if supervision.autopilot {
        // An invalid key is rejected here; the processes would restart again and again.
        mavlink_key::read("autopilot.signing_key", &computer.autopilot.signing_key)?;
    }
    computer.radio.check_zenoh()?;
    let kinds = computer.processes().into_iter();
    let service = ComputerService {
        instance: &computer.instance,
        facts: Facts::drone(&computer),
        computer: format!("drone-{}", computer.bridge.drone_id),
        recorder: &computer.recorder,
        silence_timeout_s: supervision.silent_s,
        nodes: kinds.map(|kind| (kind, supervision.scheduling(kind))).collect(),
        view: args.view.over(&computer.view),
        checkpoints: Some(computer.clock),
    };
    service::run(&args.process, service, sealed)
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
        let flags = |kind, permitted| {
            let scheduling = supervision.scheduling(kind).where_permitted(permitted);
            scheduling.flags().join(" ")
        };
        assert_eq!(flags(ProcessKind::Pilot, true), "--realtime 30 --processors 2,3");
        assert_eq!(flags(ProcessKind::Pilot, false), "--processors 2,3");
        assert_eq!(flags(ProcessKind::Planner, true), "--processors 2,3");
        assert_eq!(
            flags(ProcessKind::Predictor, true),
            "--realtime 15 --processors 2,3"
        );
        assert_eq!(flags(ProcessKind::Bridge, true), "");
        let usual = Supervision::default()
            .scheduling(ProcessKind::Pilot)
            .where_permitted(false);
        assert_eq!(usual, Scheduling::default());
    }
}
