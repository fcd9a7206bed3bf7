//! `alight attach`: runs a process of vessel or drone with the attachments of a bench: an impaired radio, or
//! a baseline or another program as the planner.

use std::path::PathBuf;

use alight_computer::{
    config::DroneComputerConfig,
    drone::bridge,
    exit::{CliError, Exit},
    process::{args::ProcessArgs, run},
    vessel::estimator,
};
use alight_shared::config;
use alight_sim::{baselines::own::OwnReport, harness::scenario::NodeConfigs, radio::Direction};
use alight_transport::{memory::Instance, observe::receive_through};
use alight_uav::computer::DroneNodes;
use clap::{Args, ValueEnum};

use super::{
    config::Attachments,
    impairment::{Impaired, Inbound},
};
use crate::exec;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AttachedProcess {
    /// Process of the vessel.
    Vessel,
    /// Drone's end of the radio.
    Bridge,
    /// Planner of the drone.
    Planner,
}

/// Process and its attachments.
#[derive(Args, Debug)]
pub struct AttachArgs {
    /// Process to run
    #[arg(value_enum)]
    pub process: AttachedProcess,
    /// Attachments (TOML)
    #[arg(long, value_name = "FILE")]
    pub attachments: PathBuf,
    /// Flags of every process
    #[command(flatten)]
    pub args: ProcessArgs,
}

pub fn run(attach: &AttachArgs) -> Result<Exit, CliError> {
    let Attachments {
        impairment,
        baseline,
        exec,
    } = config::load(&attach.attachments)?;
    let args = &attach.args;
    let impaired = |direction| impairment.as_ref().map(|i| Impaired::new(i, direction));
    match attach.process {
        AttachedProcess::Vessel => {
            if let Some(impaired) = impaired(Direction::ToVessel) {
                receive_through(Box::new(Inbound::new(impaired)));
            }
            estimator::run(args)
        }
        AttachedProcess::Bridge => {
            if let Some(mut impaired) = impaired(Direction::ToDrone) {
                let computer: DroneComputerConfig = config::load(&args.config)?;
                impaired.follow_mission(Instance::new(&computer.instance)?);
                receive_through(Box::new(Inbound::new(impaired)));
            }
            bridge::run(args)
        }
        AttachedProcess::Planner => {
            let make = |nodes: &DroneNodes, boot| {
                let configs = NodeConfigs {
                    drone: nodes.drone.clone(),
                    baseline,
                    own: exec.as_deref().map(exec::planner),
                    ..NodeConfigs::default()
                };
                configs.planner(boot, &OwnReport::default())
            };
            run::run(args, make, ())
        }
    }
}
