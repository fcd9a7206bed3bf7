//! `alight attach`: a process of vessel or drone as it flies, with what a bench puts between it and its
//! messages: an impaired radio, a baseline as the planner.

use std::path::PathBuf;
use std::sync::OnceLock;

use alight_computer::config::DroneComputer;
use alight_computer::drone::bridge;
use alight_computer::drone::planner::PlannerShell;
use alight_computer::exit::{CliError, Exit};
use alight_computer::process::args::ProcessArgs;
use alight_computer::process::shell::{self, Shell};
use alight_computer::vessel::estimator;
use alight_shared::config;
use alight_shared::process::ProcessKind;
use alight_sim::baselines::Baseline;
use alight_sim::radio::Direction;
use alight_transport::memory::Instance;
use alight_transport::observe::receive_through;
use alight_uav::planner::Planner;
use clap::{Args, ValueEnum};

use super::config::Attachments;
use super::impairment::{Impaired, Inbound};

/// Processes with attachments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AttachedProcess {
    /// The vessel's.
    Vessel,
    /// The drone's end of the radio.
    Bridge,
    /// The trajectory.
    Planner,
}

/// A process and its attachments.
#[derive(Args, Debug)]
pub struct AttachArgs {
    /// Which process
    #[arg(value_enum)]
    pub process: AttachedProcess,
    /// The attachments (TOML)
    #[arg(long, value_name = "FILE")]
    pub attachments: PathBuf,
    /// What every process has
    #[command(flatten)]
    pub args: ProcessArgs,
}

/// Attaches, then runs the process.
pub fn run(attach: &AttachArgs) -> Result<Exit, CliError> {
    let Attachments { impairment, baseline } = config::load(&attach.attachments)?;
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
                let computer: DroneComputer = config::load(&args.config)?;
                impaired.follow_mission(Instance::new(&computer.instance)?);
                receive_through(Box::new(Inbound::new(impaired)));
            }
            bridge::run(args)
        }
        AttachedProcess::Planner => match baseline {
            None => shell::run::<PlannerShell>(args),
            Some(baseline) => {
                let _first = BASELINE.set(baseline);
                shell::run::<BaselineShell>(args)
            }
        },
    }
}

/// The baseline that this process flies.
static BASELINE: OnceLock<Baseline> = OnceLock::new();

/// The planner's process with a baseline in the drone's planner's place.
#[derive(Default)]
struct BaselineShell;

impl Shell for BaselineShell {
    type Node = Planner;
    const KIND: ProcessKind = ProcessKind::Planner;

    fn node(computer: &DroneComputer, boot: u32) -> Planner {
        let (planner, airframe, deck) = (
            &computer.drone.planner,
            &computer.drone.airframe,
            &computer.drone.deck,
        );
        match BASELINE.get() {
            None => PlannerShell::node(computer, boot),
            Some(b) => Planner::with_law(b.law(planner, airframe), planner, airframe, deck, boot),
        }
    }
}
