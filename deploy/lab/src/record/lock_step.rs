use alight_bridge::BridgeConfig;
use alight_computer::{
    config::{DroneComputerConfig, VesselComputerConfig},
    exit::{CliError, Doing},
    playback::Viewer,
    record::{entry::PartHeader, observer::StepObserver},
};
use alight_shared::{
    frames::{DroneBody, VesselBody},
    step::Step,
    time::WorldTime,
};
use alight_sim::{
    harness::{
        observer::WorldObserver,
        physics::{DRONE_ID, VESSEL_ID},
        vessel_computer::sources,
    },
    physics::body::RigidState,
    sensors::bytes::boat::RECEIVER,
};
use alight_usv::computer::PROCESSES;
use nalgebra::Vector3;

use super::{FlightRecorder, RecordingScene};

pub struct LockStepObservers<'a> {
    pub recorder: Option<FlightRecorder>,
    observer: Option<&'a mut (dyn Viewer + 'static)>,
    configs: [String; 2],
}

impl<'a> LockStepObservers<'a> {
    pub fn new(
        subject: &RecordingScene<'_>,
        recorder: Option<FlightRecorder>,
        observer: Option<&'a mut (dyn Viewer + 'static)>,
    ) -> Result<LockStepObservers<'a>, CliError> {
        let nodes = subject.nodes;
        let mut vessel = VesselComputerConfig {
            vessel_id: VESSEL_ID,
            sensor: sources(subject.scenario, nodes),
            deck: nodes.deck.clone(),
            vessel: nodes.vessel.clone(),
            ..VesselComputerConfig::default()
        };
        for source in &mut vessel.sensor.sources {
            source.connect = "simulation".into();
        }
        let drone = DroneComputerConfig {
            bridge: BridgeConfig {
                drone_id: DRONE_ID,
                ..nodes.bridge.clone()
            },
            drone: nodes.settings(),
            autopilot: subject.scenario.sensors.wired(&nodes.autopilot, RECEIVER),
            ..DroneComputerConfig::default()
        };
        Ok(LockStepObservers {
            recorder,
            observer,
            configs: [
                toml::to_string(&vessel).doing("writing the vessel's configuration")?,
                toml::to_string(&drone).doing("writing the drone's configuration")?,
            ],
        })
    }
}

impl WorldObserver for LockStepObservers<'_> {
    fn truth(
        &mut self,
        t: WorldTime,
        vessel: &RigidState<VesselBody>,
        drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        if let Some(recorder) = &mut self.recorder {
            recorder.truth(t, vessel, drone.copied());
        }
    }
    fn step(&mut self, t: WorldTime, step: &Step<'_>) {
        if let Some(recorder) = &mut self.recorder {
            if !recorder.has(step.process, step.boot) {
                let [vessel, drone] = &self.configs;
                let of_vessel = PROCESSES.contains(&step.process);
                recorder.begin(PartHeader {
                    process: step.process.name().into(),
                    boot: step.boot,
                    began_ns: t.nanos(),
                    config: if of_vessel { vessel } else { drone }.clone(),
                    ..PartHeader::default()
                });
            }
            recorder.step(t, step);
        }
        if let Some(observer) = &mut self.observer {
            observer.step(t, step);
        }
    }
}
