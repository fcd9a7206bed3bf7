//! Simulation and experiments: trials and studies in lock-step, landings in real time with simulated vehicles,
//! faults, the link emulator. Computers of vessels and drones do not install this library.

pub mod args;
pub mod chart;
pub mod exec;
pub mod live;
pub mod outcome_table;
pub mod rare;
pub mod record;
pub mod replay_plot;
pub mod scene;
pub mod storm;
pub mod study;
pub mod trial;
pub mod trials;

use clap::{Args, Subcommand};

use alight_computer::{
    exit::{CliError, Exit},
    playback::StartViewer,
};
use args::{EnvelopeArgs, SceneArgs, StudyArgs, TrialArgs};
use live::{
    args::{LandArgs, WorldArgs},
    attach::AttachArgs,
    emulator::LinkArgs,
    rehearse::args::RehearseArgs,
};
use rare::RareArgs;
use storm::StormArgs;

#[derive(Subcommand, Debug)]
pub enum LabCommand {
    /// Fly one landing or many, faster than real time.
    Trial(Box<TrialArgs>),
    /// Measure one quantity over many seeds.
    Study(Box<StudiesArgs>),
    /// Land once in real time on simulated vehicles.
    Land(Box<LandArgs>),
    /// Rehearse an installation on simulated vehicles.
    Rehearse(Box<RehearsalArgs>),
    /// Flags of the scene of trial, study and land: boat, drone, sea and wind.
    #[command(hide = true)]
    Scene(Box<SceneArgs>),
    /// A process of vessel or drone with the attachments of a bench.
    #[command(hide = true)]
    Attach(AttachArgs),
    #[command(hide = true)]
    /// Process of the simulation: both vehicles, in real time.
    World(WorldArgs),
}

/// Study by name, or one with its own flags.
#[derive(Args, Debug)]
#[command(
    args_conflicts_with_subcommands = true,
    arg_required_else_help = true,
    after_help = "`alight help study` describes the studies. A flag that an axis or\n\
every row sets keeps only the matching rows, or overrides them."
)]
pub struct StudiesArgs {
    #[command(flatten)]
    pub study: StudyArgs,
    #[command(subcommand)]
    pub other: Option<OtherStudy>,
}

/// Studies with their own flags.
#[derive(Subcommand, Debug)]
pub enum OtherStudy {
    /// Fly landings with several faults each; print broken rules.
    Storm(StormArgs),
    /// Find the winds and seas in which a drone lands on a boat.
    Envelope(Box<EnvelopeArgs>),
    /// Estimate how often a landing is unsafe, by splitting.
    Rare(Box<RareArgs>),
}

/// Rehearsal, or a part of its equipment.
#[derive(Args, Debug)]
#[command(args_conflicts_with_subcommands = true)]
pub struct RehearsalArgs {
    #[command(flatten)]
    pub rehearsal: RehearseArgs,
    /// Part of its equipment
    #[command(subcommand)]
    pub part: Option<RehearsalPart>,
}

/// Equipment of a rehearsal, on its own.
#[derive(Subcommand, Debug)]
pub enum RehearsalPart {
    /// Emulate a bad link between two network namespaces (needs root).
    Link(LinkArgs),
}

impl LabCommand {
    /// Runs the command to completion; `program` is version and commit, `viewer` shows a simulated flight.
    pub fn run(&self, program: &str, viewer: StartViewer<'_>) -> Result<Exit, CliError> {
        match self {
            LabCommand::Trial(a) => match a.trials {
                Some(count) => trials::run(a, count),
                None => trial::run(a, viewer),
            },
            LabCommand::Study(a) => match &a.other {
                Some(OtherStudy::Storm(a)) => storm::run(a),
                Some(OtherStudy::Envelope(a)) => study::envelope::run(a, program),
                Some(OtherStudy::Rare(a)) => rare::run(a),
                None => study::run(&a.study, program),
            },
            LabCommand::Land(a) if a.trials.is_some() => Err(CliError(
                "land flies one landing in real time; many: alight trial --trials N, or alight study".into(),
            )),
            LabCommand::Land(a) => live::land::run(a),
            LabCommand::Rehearse(a) => match &a.part {
                Some(RehearsalPart::Link(a)) => live::emulator::run(a),
                None => live::rehearse::run(&a.rehearsal),
            },
            LabCommand::Scene(_) => Err(CliError(
                "scene is not a command: its flags are for trial, study and land; alight help scene prints them".into(),
            )),
            LabCommand::Attach(a) => live::attach::run(a),
            LabCommand::World(a) => live::world::run(a),
        }
    }
}
