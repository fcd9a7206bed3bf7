//! Log of a flight in lock-step: the directory that processes would have written.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use alight_bridge::BridgeConfig;
use alight_computer::config::{DroneComputerConfig, VesselComputerConfig};
use alight_computer::exit::{CliError, Doing};
use alight_computer::record::flight::recorder::{PartHeader, SimulatedRecorder};
use alight_shared::frames::{DroneBody, VesselBody};
use alight_shared::process::ProcessKind;
use alight_shared::step::Step;
use alight_shared::time::{Time, TrueTime};
use alight_sim::harness::physics::{BOOT, DRONE_ID, VESSEL_ID};
use alight_sim::harness::scenario::NodeConfigs;
use alight_sim::harness::tap::Tap;
use alight_sim::physics::body::RigidState;
use nalgebra::Vector3;

use crate::live::truth::TruthSample;

/// Writes each step to the files of its start.
pub struct LockStepLog {
    directory: Scratch,
    starts: BTreeMap<(ProcessKind, u32), SimulatedRecorder>,
    /// Configurations of the vessel's and the drone's computer.
    configs: [String; 2],
}

impl LockStepLog {
    /// Begins a log in a directory of its own.
    pub fn begin(nodes: &NodeConfigs) -> Result<LockStepLog, CliError> {
        let vessel = VesselComputerConfig {
            vessel_id: VESSEL_ID,
            deck: nodes.deck.clone(),
            vessel: nodes.vessel.clone(),
            ..VesselComputerConfig::default()
        };
        let drone = DroneComputerConfig {
            bridge: BridgeConfig {
                drone_id: DRONE_ID,
                ..nodes.bridge.clone()
            },
            drone: nodes.settings(),
            autopilot: nodes.autopilot.clone(),
            ..DroneComputerConfig::default()
        };
        Ok(LockStepLog {
            directory: Scratch::new()?,
            starts: BTreeMap::new(),
            configs: [
                toml::to_string(&vessel).doing("writing the vessel's configuration")?,
                toml::to_string(&drone).doing("writing the drone's configuration")?,
            ],
        })
    }
    /// Ends the log; its directory is removed when the returned value is dropped.
    pub fn finish(self) -> Result<Scratch, CliError> {
        let missing: u64 = self.starts.into_values().map(SimulatedRecorder::finish).sum();
        match missing {
            0 => Ok(self.directory),
            n => Err(CliError(format!(
                "recording into {}: {n} steps could not be written; free space there, or set TMPDIR",
                self.directory.path().display()
            ))),
        }
    }
}

impl Tap for LockStepLog {
    fn truth(
        &mut self,
        t: Time<TrueTime>,
        vessel: &RigidState<VesselBody>,
        drone: Option<&(RigidState<DroneBody>, Vector3<f64>)>,
    ) {
        let step = Step {
            process: ProcessKind::World,
            boot: BOOT,
            now_ns: t.nanos(),
            input: &TruthSample::of(vessel, drone),
            output: &(),
        };
        self.step(t, &step);
    }
    fn step(&mut self, t: Time<TrueTime>, step: &Step<'_>) {
        let (directory, [vessel, drone]) = (self.directory.path(), &self.configs);
        let begin = || {
            let header = PartHeader {
                process: step.process.name().into(),
                boot: step.boot,
                began_ns: t.nanos(),
                config: if step.process == ProcessKind::Vessel {
                    vessel
                } else {
                    drone
                }
                .clone(),
                ..PartHeader::default()
            };
            SimulatedRecorder::begin(directory, header, t.nanos())
        };
        let start = self.starts.entry((step.process, step.boot)).or_insert_with(begin);
        start.step(t.nanos(), step.now_ns, (step.input, step.output));
    }
}

/// Directory that is removed when dropped.
pub struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Result<Scratch, CliError> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("alight-steps-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).doing(format_args!("making the directory {}", path.display()))?;
        Ok(Scratch(path))
    }
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A directory that cannot be removed stays among temporary files.
        let _left = std::fs::remove_dir_all(&self.0);
    }
}
