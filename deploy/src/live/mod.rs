//! The live system: the nodes as processes that talk over zenoh and iceoryx2, the simulated
//! vehicles as a process in real time, and the supervisor of them all (`alight land`).
//!
//! Read in this order: [`config`] (one file per computer), [`process`] (what every process does
//! beside its node), the processes in the order of the data ([`world`], [`vessel`], [`bridge`], then
//! [`shell`] for [`predictor`], [`mission`], [`planner`], [`pilot`]), then [`land`] and [`supervisor`],
//! and [`lands`] and [`faults`] for many landings. [`autopilot`] is the way to a real one. What lies between the computers in a trial:
//! [`air`], [`profile`], [`link`] (inside the processes), [`emulator`] (between network namespaces).

mod air;
pub mod args;
mod autopilot;
mod autopilot_url;
mod autopilot_wire;
mod bridge;
pub mod compare;
mod config;
mod display;
pub mod emulator;
mod fault;
mod faults;
mod figures;
mod fleet;
mod flows;
mod follow;
mod heard_drone;
mod instance;
mod interface;
pub mod keys;
mod land;
mod lands;
pub mod latency;
mod link;
mod mission;
mod namespaces;
mod packets;
mod pilot;
mod planner;
mod plant;
mod predictor;
mod process;
mod profile;
mod record;
#[cfg(feature = "record")]
mod recording;
mod relay;
pub mod replay;
mod report;
mod shell;
mod status;
mod supervisor;
mod truth;
mod usage;
mod vessel;
mod world;

use alight_shared::transport::TransportError;

use crate::{End, Refused};
use args::LiveVerb;

impl From<TransportError> for Refused {
    fn from(e: TransportError) -> Self {
        Refused(e.to_string())
    }
}

/// Runs a command of the live system.
pub fn run(verb: &LiveVerb) -> Result<End, Refused> {
    match verb {
        LiveVerb::Land(a) => land::run(a),
        LiveVerb::Lands(a) => lands::run(a),
        LiveVerb::Faults(a) => faults::run(a),
        LiveVerb::Status(a) => status::run(a),
        #[cfg(not(feature = "record"))]
        LiveVerb::Replay(a) => replay::run(&a.path),
        LiveVerb::Vessel(a) => vessel::run(a),
        LiveVerb::Bridge(a) => bridge::run(a),
        LiveVerb::Predictor(a) => shell::run::<predictor::PredictorShell>(a),
        LiveVerb::Mission(a) => shell::run::<mission::MissionShell>(a),
        LiveVerb::Planner(a) => shell::run::<planner::PlannerShell>(a),
        LiveVerb::Pilot(a) => shell::run::<pilot::PilotShell>(a),
        LiveVerb::Autopilot(a) => autopilot::run(a),
        LiveVerb::World(a) => world::run(a),
        LiveVerb::Link(a) => emulator::run(a),
        LiveVerb::Latency(a) => latency::run(a),
        LiveVerb::Keys(a) => keys::run(a),
    }
}
