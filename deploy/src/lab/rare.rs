//! `alight rare`: how often a landing is unsafe where that is rare, by splitting.

use std::sync::atomic::{AtomicUsize, Ordering};

use alight_shared::transport::wake::end_requested;
use alight_sim::studies::splitting::{Estimate, Run, land, split};
use clap::Args;
use indicatif::ProgressBar;

use super::args::SceneArgs;
use super::scene::Scene;
use crate::exit::{CliError, Doing, Exit};
use crate::terminal;

/// Arguments of `alight rare`.
#[derive(Args, Debug)]
#[command(
    after_help = "Keeps the quarter of a population of landings that came nearest to a limit, draws some of their random\n\
  streams anew, and so on until landings beyond a limit are no longer rare.\n\n  \
  alight rare --sea moderate --wind 10 --population 60 --runs 4\n\n\
Exit codes: 0 estimated, 1 interrupted, 2 bad input."
)]
pub struct RareArgs {
    /// The scene.
    #[command(flatten)]
    scene: SceneArgs,
    /// Landings in a population
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(8..=10_000))]
    population: u16,
    /// Runs that know nothing of each other; their spread gives the interval
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=10))]
    runs: u8,
    /// Seed of the first run
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed0: u64,
    /// Print a JSON object.
    #[arg(long)]
    json: bool,
}

/// Estimates, reports.
pub fn run(args: &RareArgs) -> Result<Exit, CliError> {
    if end_requested() {
        return Ok(Exit::Failed);
    }
    let scene = Scene::of(&args.scene)?;
    let (progress, flown) = (ProgressBar::new_spinner(), AtomicUsize::new(0));
    let near = |streams: &_| -> Result<f64, Option<CliError>> {
        if end_requested() {
            return Err(None);
        }
        let landed = land(&scene.scenario, &scene.nodes, streams).doing("setting up a landing");
        let n = flown.fetch_add(1, Ordering::Relaxed) + 1;
        progress.set_message(format!("{n} landings"));
        progress.tick();
        landed.map_err(Some)
    };
    let mut runs: Vec<Run> = Vec::new();
    for k in 0..u64::from(args.runs) {
        match split(usize::from(args.population), args.seed0.wrapping_add(k), near) {
            Ok(run) => runs.push(run),
            Err(None) => return Ok(Exit::Failed),
            Err(Some(error)) => return Err(error),
        }
    }
    progress.finish_and_clear();
    let Some(estimate) = Estimate::of(runs) else {
        return Ok(Exit::Failed);
    };
    if args.json {
        terminal::json(&estimate)?;
    } else {
        terminal::line(text(&estimate));
    }
    Ok(Exit::Success)
}

fn text(estimate: &Estimate) -> String {
    let [low, high] = estimate.interval.map(|p| 100.0 * p);
    let levels = estimate.runs.iter().map(|r| r.levels.len()).max();
    format!(
        "unsafe: {:.3} % of landings ({low:.3} to {high:.3} % with 95 %)\n\
         {} landings in {} runs, up to {} levels",
        100.0 * estimate.probability,
        estimate.landings,
        estimate.runs.len(),
        levels.unwrap_or(0)
    )
}
