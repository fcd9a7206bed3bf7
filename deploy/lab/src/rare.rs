//! `alight study rare`: estimates the rate of rare unsafe landings by splitting.

use std::sync::atomic::{AtomicUsize, Ordering};

use alight_computer::{
    exit::{CliError, Doing, Exit},
    quantity::whole,
    terminal::{self, Form},
};
use alight_sim::studies::splitting::{End, SplittingEstimate, SplittingRun, land, split};
use alight_transport::wake::end_requested;
use clap::Args;
use indicatif::ProgressBar;

use super::{args::SceneArgs, scene::Scene};

/// Arguments of `alight study rare`.
#[derive(Args, Debug)]
#[command(
    after_help = "Keeps the quarter of a population of landings that came nearest to a limit, moves their random\n\
  numbers, and so on until landings beyond a limit are no longer rare.\n\n  \
  alight study rare --sea moderate --wind 10 --population 60 --runs 4\n\n\
Exit codes: 0 estimated, 1 interrupted, 2 bad input."
)]
pub struct RareArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Landings in a population
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = whole::<u16>(8..=10_000))]
    population: u16,
    /// Independent runs, whose spread gives the interval
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = whole::<u8>(1..=10))]
    runs: u8,
    /// Seed of the first run
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed0: u64,
    /// Output format.
    #[command(flatten)]
    form: Form,
}

pub fn run(args: &RareArgs) -> Result<Exit, CliError> {
    if end_requested() {
        return Ok(Exit::Failed);
    }
    let scene = Scene::of(&args.scene)?;
    let progress = ProgressBar::new_spinner();
    let flown = AtomicUsize::new(0);
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
    let mut runs: Vec<SplittingRun> = Vec::new();
    let population = usize::from(args.population);
    for k in 0..u64::from(args.runs) {
        let run = split(population, args.seed0.wrapping_add(k), near);
        progress.finish_and_clear();
        match run {
            Ok(run) => runs.push(run),
            Err(None) => {
                let text = "none is kept; a smaller --population ends earlier";
                terminal::note(true, format!("interrupted after {flown:?} landings: {text}"));
                return Ok(Exit::Failed);
            }
            Err(Some(error)) => return Err(error),
        }
    }
    let Some(estimate) = SplittingEstimate::of(runs, population) else {
        return Ok(Exit::Failed);
    };
    if !args.form.print(&estimate, &estimate.runs)? {
        terminal::line(text(&estimate));
    }
    Ok(Exit::Success)
}

fn text(estimate: &SplittingEstimate) -> String {
    let [low, high] = estimate.interval.map(|p| percent(100.0 * p));
    let rate = if estimate.probability > 0.0 {
        let mean = percent(100.0 * estimate.probability);
        format!("{mean} % of landings ({low} to {high} % with 95 %)")
    } else {
        format!("at most {high} % of landings with 95 %")
    };
    let runs = estimate.runs.len();
    let flat = estimate.runs.iter().filter(|r| r.end == End::Plateau).count();
    let plateau = if flat > 0 {
        format!("; in {flat} of them no landing came nearer than the others: a larger population may")
    } else {
        String::new()
    };
    let rarer = estimate.runs.iter().filter(|r| r.end == End::Levels).count();
    let levels = if rarer > 0 {
        format!("; in {rarer} of them it is rarer than ten levels reach")
    } else {
        String::new()
    };
    let landings = format!("{} landings in {runs} runs{plateau}{levels}", estimate.landings);
    format!("unsafe: {rate}\n{}", terminal::wrapped(&landings))
}

fn percent(p: f64) -> String {
    let digits = if p > 0.0 {
        (1.0 - p.log10().floor()).clamp(0.0, 9.0)
    } else {
        0.0
    };
    format!("{p:.*}", digits as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_with_two_digits() {
        let of = [12.24, 4.078, 0.0123, 0.0, 100.0].map(percent);
        assert_eq!(of, ["12", "4.1", "0.012", "0", "100"]);
    }
}
