//! The live system: the nodes as processes that talk over zenoh and iceoryx2, the simulated
//! vehicles as a process in real time, and the supervisor of them all (`alight land`).
//!
//! Read in this order: [`config`] (one file per computer), [`process`] (what every process does
//! beside its node), the processes in the order of the data ([`world`], [`vessel`], [`bridge`], then
//! [`shell`] for [`predictor`], [`mission`], [`planner`], [`pilot`]), then [`land`] and [`supervisor`],
//! and [`lands`] and [`faults`] for many landings. [`autopilot`] is the way to a real one, [`sources`] to a
//! vessel's sensors. What a drone installs: [`drone`], [`check`], [`calibrate`], [`command`]. What lies
//! between the computers in a trial: [`air`], [`profile`], [`link`] (inside the processes), [`emulator`]
//! (between network namespaces).

#[cfg(feature = "live")]
mod air;
pub mod args;
mod autopilot;
mod bridge;
mod byte_link;
mod calibrate;
mod camera;
mod camera_source;
mod check;
mod command;
#[cfg(feature = "live")]
pub mod compare;
pub mod config;
mod display;
mod drone;
mod drone_monitor;
#[cfg(feature = "live")]
pub mod emulator;
#[cfg(feature = "live")]
mod fault;
#[cfg(feature = "live")]
mod faults;
mod figures;
#[cfg(feature = "live")]
mod fleet;
#[cfg(feature = "live")]
mod follow;
mod instance;
mod interface;
pub mod keys;
#[cfg(feature = "live")]
mod land;
#[cfg(feature = "live")]
mod lands;
#[cfg(feature = "live")]
pub mod latency;
mod link;
mod link_url;
mod mission;
#[cfg(feature = "live")]
mod namespaces;
mod node_log;
mod notify;
#[cfg(feature = "live")]
mod packets;
mod pilot;
mod planner;
#[cfg(feature = "live")]
mod plant;
mod predictor;
mod process;
#[cfg(feature = "live")]
mod profile;
mod radio_rates;
#[cfg(all(feature = "live", feature = "record"))]
mod recording;
mod relay;
#[cfg(feature = "live")]
mod render_thread;
#[cfg(feature = "live")]
pub mod replay;
#[cfg(feature = "live")]
mod report;
mod sensor_supervisor;
mod shell;
mod sources;
mod status;
mod supervisor;
#[cfg(feature = "live")]
mod truth;
#[cfg(feature = "live")]
mod usage;
mod vessel;
mod vessel_status;
mod vessel_status_file;
#[cfg(feature = "live")]
mod world;

use alight_shared::transport::TransportError;
use alight_shared::transport::process::ProcessKind;

use crate::{CliError, Exit};
use args::LiveVerb;

impl From<TransportError> for CliError {
    fn from(e: TransportError) -> Self {
        CliError(e.to_string())
    }
}

/// Runs a command of the live system.
pub fn run(verb: &LiveVerb) -> Result<Exit, CliError> {
    match verb {
        #[cfg(feature = "live")]
        LiveVerb::Land(a) => land::run(a),
        #[cfg(feature = "live")]
        LiveVerb::Lands(a) => lands::run(a),
        #[cfg(feature = "live")]
        LiveVerb::Faults(a) => faults::run(a),
        LiveVerb::Status(a) => status::run(a),
        #[cfg(all(feature = "live", not(feature = "record")))]
        LiveVerb::Replay(a) => replay::run(&a.path),
        LiveVerb::Vessel(a) => vessel::run(a),
        LiveVerb::Bridge(a) => bridge::run(a),
        LiveVerb::Predictor(a) => shell::run::<predictor::PredictorShell>(a),
        LiveVerb::Mission(a) => shell::run::<mission::MissionShell>(a),
        LiveVerb::Planner(a) => shell::run::<planner::PlannerShell>(a),
        LiveVerb::Pilot(a) => shell::run::<pilot::PilotShell>(a),
        LiveVerb::Autopilot(a) => autopilot::run(a),
        LiveVerb::Sensors(a) => sources::run(a),
        LiveVerb::Camera(a) => camera::run(a, ProcessKind::Camera),
        LiveVerb::Uvdar(a) => camera::run(a, ProcessKind::Uvdar),
        #[cfg(feature = "live")]
        LiveVerb::World(a) => world::run(a),
        #[cfg(feature = "live")]
        LiveVerb::Link(a) => emulator::run(a),
        #[cfg(feature = "live")]
        LiveVerb::Latency(a) => latency::run(a),
        LiveVerb::Keys(a) => keys::run(a),
        LiveVerb::Check(a) => check::run(a),
        LiveVerb::Calibrate(a) => calibrate::run(a),
        LiveVerb::Drone(a) => drone::run(a),
        LiveVerb::Command(a) => command::run(a),
    }
}
