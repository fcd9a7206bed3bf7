//! Simulation and experiments: trials and studies in lock-step, landings in real time with simulated vehicles,
//! faults, the link emulator. No part of what a vessel and a drone install.

pub mod args;
pub mod chart;
pub mod live;
pub mod outcome_table;
pub mod rare;
pub mod record;
pub mod replay_plot;
pub mod report;
pub mod scene;
pub mod storm;
pub mod study;
pub mod trial;
pub mod trials;

use clap::Subcommand;

use alight_computer::exit::{CliError, Exit};
use alight_computer::playback::StartViewer;
use args::{EnvelopeArgs, RaoArgs, StudyArgs, TrialArgs, TrialsArgs};
use live::args::{LandArgs, LandsArgs, WorldArgs};
use live::attach::AttachArgs;
use live::emulator::LinkArgs;
use live::rehearse::args::RehearseArgs;
use rare::RareArgs;
use storm::StormArgs;

/// Commands of the laboratory.
#[derive(Subcommand, Debug)]
pub enum LabCommand {
    /// Fly one landing in the simulated world and print the outcome.
    Trial(TrialArgs),
    /// Fly many landings and print the success rate with its interval.
    Trials(TrialsArgs),
    /// Fly landings with several faults each; print what broke a rule.
    Storm(StormArgs),
    /// Estimate how often a landing is unsafe, by splitting.
    Rare(Box<RareArgs>),
    /// Measure one thing over many seeds.
    Study(StudyArgs),
    /// Draw in which relative wind and sea a drone lands on a boat.
    Envelope(EnvelopeArgs),
    /// Print the simulated vessel's response to waves (RAO).
    #[command(alias = "response")]
    Rao(RaoArgs),
    /// Land once in real time: all processes, on simulated vehicles.
    Land(Box<LandArgs>),
    /// Rehearse an installation on simulated vehicles.
    Rehearse(Box<RehearseArgs>),
    /// The former name of `land --trials N`.
    #[command(hide = true)]
    Lands(LandsArgs),
    /// A process of vessel or drone with what a bench puts between it and its messages.
    #[command(hide = true)]
    Attach(AttachArgs),
    #[command(hide = true)]
    /// Process of the simulation: both vehicles, in real time.
    World(WorldArgs),
    /// Emulate a bad link between two network namespaces (needs root).
    Link(LinkArgs),
}

impl LabCommand {
    /// Runs it to its end; `viewer` shows a flight that is computed.
    pub fn run(&self, viewer: StartViewer<'_>) -> Result<Exit, CliError> {
        match self {
            LabCommand::Trial(a) => trial::run(a, viewer),
            LabCommand::Trials(a) => trials::run(a),
            LabCommand::Storm(a) => storm::run(a),
            LabCommand::Rare(a) => rare::run(a),
            LabCommand::Study(a) => study::run(a),
            LabCommand::Envelope(a) => study::envelope::run(a),
            LabCommand::Rao(a) => study::rao(a),
            LabCommand::Land(a) => match a.trials {
                Some(trials) => live::pairs::run(a, trials),
                None => live::land::run(a),
            },
            LabCommand::Rehearse(a) => live::rehearse::run(a),
            LabCommand::Attach(a) => live::attach::run(a),
            LabCommand::Lands(a) => live::pairs::run_lands(a),
            LabCommand::World(a) => live::world::run(a),
            LabCommand::Link(a) => live::emulator::run(a),
        }
    }
}
