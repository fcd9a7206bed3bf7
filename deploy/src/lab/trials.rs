//! `alight trials`: many landings, spread over the cores.

use std::io::Write;

use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::trial::{Watch, fly};
use alight_sim::studies::statistics::Summary;
use indicatif::{ParallelProgressIterator, ProgressBar, ProgressStyle};
use rayon::prelude::*;

use crate::exit::{CliError, Exit};
use crate::lab::args::TrialsArgs;
use crate::lab::scene::{Scene, stopwatch};
use crate::lab::table;
use crate::terminal;
use crate::terminal::note;

/// A thread pool of `jobs` threads (all cores when None).
pub fn pool(jobs: Option<u16>) -> Result<rayon::ThreadPool, CliError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.map_or(0, usize::from))
        .build()
        .map_err(|e| CliError::because("starting the worker threads", e))
}

/// A progress bar with time left; hidden where standard error is no terminal.
pub fn bar(length: u64, what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} {bar:40} {pos}/{len} {elapsed} elapsed, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(length)
        .with_style(style)
        .with_message(what.to_string())
}

/// Flies seeds `seed0..seed0 + n`; outcomes in the order of the seeds whatever the threads.
pub fn fly_all(
    scene: &Scene,
    seeds: &[u64],
    stride_s: Option<f64>,
    jobs: Option<u16>,
    what: &str,
) -> Result<Vec<Outcome>, CliError> {
    let progress = bar(seeds.len() as u64, what);
    let outcomes: Result<Vec<Outcome>, CliError> = pool(jobs)?.install(|| {
        seeds
            .par_iter()
            .enumerate()
            .progress_with(progress.clone())
            .map(|(i, &seed)| {
                let mut scenario = scene.scenario.clone();
                if let (Some(stride), Some(motion)) = (stride_s, scenario.deck_motion.as_mut()) {
                    motion.start_s += stride * i as f64;
                }
                let elapsed = stopwatch();
                let mut quiet = |_: &_| {};
                let watch = Watch {
                    on_event: &mut quiet,
                    trace_step_s: None,
                };
                let flight = fly(&scenario, &scene.nodes, seed, &scene.sea, watch)
                    .map_err(|e| CliError::because(format!("setting up the trial of seed {seed}"), e))?;
                Ok(Outcome {
                    wall_time_s: elapsed(),
                    ..flight.outcome
                })
            })
            .collect()
    });
    progress.finish_and_clear();
    outcomes
}

/// The seeds from `seed0` on.
pub fn seeds(seed0: u64, n: u32) -> Result<Vec<u64>, CliError> {
    let end = seed0.checked_add(u64::from(n)).ok_or_else(|| {
        CliError(format!(
            "--seed0 {seed0} with {n} trials leaves the range of 64-bit seeds; choose a smaller one"
        ))
    })?;
    Ok((seed0..end).collect())
}

/// Flies and sums up.
pub fn run(args: &TrialsArgs) -> Result<Exit, CliError> {
    let scene = Scene::of(&args.scene)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let mut rows = match &args.rows {
        Some(path) => Some(std::fs::File::create(path).map_err(|e| {
            CliError::because(
                format!("writing the rows {}", path.display()),
                format!("{e}; choose another path"),
            )
        })?),
        None => None,
    };
    let outcomes = fly_all(&scene, &seeds, args.motion_stride, args.jobs, "landings")?;
    if let Some(file) = rows.as_mut() {
        write_rows(file, &outcomes).map_err(|e| CliError::because("writing the rows", e))?;
    }
    let summary = Summary::of(&outcomes);
    let say = |line: String| note(args.json, line);
    for o in outcomes.iter().filter(|o| !o.success) {
        let mut flags = scene.flags.clone();
        if let (Some(stride), Some(motion)) = (args.motion_stride, &scene.scenario.deck_motion) {
            let start = motion.start_s + stride * (o.seed - args.seed0) as f64;
            flags.push_str(&format!(" --motion-start {start}"));
        }
        say(format!("seed {}: {} ({})", o.seed, o.outcome.name(), o.reason));
        say(format!(
            "  replay: alight trial --seed {} {flags} --plot seed-{}.svg",
            o.seed, o.seed
        ));
    }
    if args.json {
        terminal::line(serde_json::Value::Object(table::summary_json(&summary)));
    } else {
        terminal::line(table::summary(&summary));
    }
    Ok(if summary.successes == summary.trials {
        Exit::Success
    } else {
        Exit::Failed
    })
}

fn write_rows(file: &mut std::fs::File, outcomes: &[Outcome]) -> std::io::Result<()> {
    use alight_sim::studies::statistics::METRICS;
    let names: Vec<&str> = METRICS.iter().map(|(n, _)| *n).collect();
    writeln!(
        file,
        "seed,outcome,unsafe_contacts,water_contacts,contacts_above_2_mps,{},digest",
        names.join(",")
    )?;
    for o in outcomes {
        let cells: Vec<String> = METRICS
            .iter()
            .map(|(_, f)| f(o).map_or_else(String::new, |v| format!("{v:.6}")))
            .collect();
        writeln!(
            file,
            "{},{},{},{},{},{},{}",
            o.seed,
            o.outcome.name(),
            o.unsafe_contacts,
            o.water_contacts,
            o.contacts_above_2_mps,
            cells.join(","),
            o.digest
        )?;
    }
    Ok(())
}
