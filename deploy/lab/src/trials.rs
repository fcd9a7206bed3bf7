//! `alight trial --trials N`: many landings, distributed over the cores.

use std::path::Path;

use alight_computer::{
    exit::{CliError, Doing, Exit},
    terminal::{self, note, wrapped},
};
use alight_shared::{estimation::quantile, step::Step, time::WorldTime};
use alight_sim::{
    harness::{
        observer::WorldObserver,
        outcome::Outcome,
        scenario::{NodeConfigs, Scenario},
        trial::{Watch, fly_with},
    },
    studies::statistics::Summary,
};
use alight_transport::{clock::steady_ns, wake::end_requested};
use alight_uav::planner::PlannerOut;
use indicatif::{ParallelProgressIterator, ProgressBar, ProgressStyle};
use rayon::prelude::*;

use super::{
    args::TrialArgs,
    outcome_table,
    scene::{Scene, stopwatch},
};

/// Maps `items` by `run` on `jobs` threads (all cores if None) behind a progress bar, which is hidden unless standard
/// error is a terminal. Results are in the order of the items, and incomplete if the end is requested.
pub fn in_parallel<T: Sync, R: Send>(
    jobs: Option<u16>,
    what: &str,
    items: &[T],
    run: impl Fn(&T) -> Result<R, CliError> + Sync + Send,
) -> Result<Vec<R>, CliError> {
    let style = ProgressStyle::with_template("{msg} {bar:40} {pos}/{len} {elapsed} elapsed, {eta} left");
    let progress = ProgressBar::new(items.len() as u64)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        .with_message(what.to_string());
    let unless_ended = |item| (!end_requested()).then(|| run(item)).transpose();
    let results: Result<Vec<Option<R>>, CliError> = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.map_or(0, usize::from))
        .build()
        .doing("starting the worker threads")?
        .install(|| {
            let items = items.par_iter().progress_with(progress.clone());
            items.map(unless_ended).collect()
        });
    progress.finish_and_clear();
    Ok(results?.into_iter().flatten().collect())
}

/// Durations of the planner's steps with a plan, by this computer's clock.
#[derive(Default)]
struct SolveTimes {
    since_ns: i64,
    took_ms: Vec<f64>,
}

impl WorldObserver for SolveTimes {
    fn step(&mut self, _t: WorldTime, step: &Step<'_>) {
        let now_ns = steady_ns();
        if step.output::<PlannerOut>().is_some_and(|out| out.plan.is_some()) {
            self.took_ms.push((now_ns - self.since_ns) as f64 * 1e-6);
        }
        self.since_ns = now_ns;
    }
}

/// Flies one landing without a viewer, measuring the elapsed time and, if `timed`, the planner's solve times.
pub fn fly_seed(
    (scenario, nodes): (&Scenario, &NodeConfigs),
    seed: u64,
    sea: &str,
    timed: bool,
) -> Result<Outcome, CliError> {
    let elapsed = stopwatch();
    let mut times = SolveTimes::default();
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    let flown = fly_with(scenario, nodes, seed, sea, watch, &mut times)
        .doing(format_args!("setting up the trial of seed {seed} at sea {sea}"))?;
    Ok(Outcome {
        wall_time_s: elapsed(),
        solve_p99_ms: quantile(&mut times.took_ms, 0.99).filter(|_| timed),
        ..flown.outcome
    })
}

pub fn seeds(seed0: u64, n: u32) -> Result<Vec<u64>, CliError> {
    let end = seed0.checked_add(u64::from(n)).ok_or_else(|| {
        CliError(format!(
            "the seed {seed0} with {n} trials leaves the range of 64-bit seeds; choose a smaller one"
        ))
    })?;
    Ok((seed0..end).collect())
}

pub fn run(args: &TrialArgs, count: u32) -> Result<Exit, CliError> {
    let scene = Scene::of(&args.scene)?;
    // The first call installs the handler, so that from here on a signal ends the study with the landings flown so
    // far.
    if end_requested() {
        return Ok(Exit::Failed);
    }
    let seeds = seeds(args.seed, count)?;
    let rows = args.rows.as_deref().map(rows_writer).transpose()?;
    let motion = scene.scenario.deck_motion.as_ref();
    let facts = motion.map_or(Ok(None), |m| m.facts(0.0));
    let facts = facts.map_err(|e| CliError(e.to_string()))?;
    let recording_s = facts.map(|f| f.duration_s);
    let motion_start = |seed: u64| {
        let stride = args.motion_stride?;
        let motion = scene.scenario.deck_motion.as_ref()?;
        let start = motion.start_s + stride * (seed - args.seed) as f64;
        // At its end the recording starts over.
        Some(start % recording_s.unwrap_or(f64::INFINITY))
    };
    let outcomes = in_parallel(args.jobs, "landings", &seeds, |seed| {
        let mut scenario = scene.scenario.clone();
        if let (Some(start_s), Some(motion)) = (motion_start(*seed), scenario.deck_motion.as_mut()) {
            motion.start_s = start_s;
        }
        fly_seed((&scenario, &scene.nodes), *seed, &scene.sea, false)
    })?;
    let interrupted = outcomes.len() < seeds.len();
    if interrupted {
        let flown = outcomes.len();
        let all = seeds.len();
        note(
            args.form.alone(),
            format_args!("interrupted after {flown} of {all} landings; repeated, it begins again"),
        );
    }
    if outcomes.is_empty() {
        return Ok(Exit::Failed);
    }
    if let Some(mut rows) = rows {
        let mut written = outcomes.iter().map(|o| rows.serialize(o));
        let written = written.try_for_each(|r| r);
        written.doing("writing the rows")?;
    }
    let summary = Summary::of(&outcomes.iter().collect::<Vec<_>>());
    for o in outcomes.iter().filter(|o| !o.success) {
        let start = motion_start(o.seed).map_or_else(String::new, |s| format!(" --motion-start {s}"));
        let ended = wrapped(&format!("seed {}: {} ({})", o.seed, o.outcome.name(), o.reason));
        note(
            args.form.alone(),
            format_args!(
                "{ended}\n  replay: alight trial --seed {0} {1}{start} --plot seed-{0}.svg",
                o.seed, scene.flags
            ),
        );
    }
    if !args
        .form
        .print(&outcome_table::summary_json(&summary), &outcomes)?
    {
        terminal::line(outcome_table::summary(&summary));
        terminal::line(outcome_table::committed_odds(&summary));
        if scene.scenario.begin_anyway {
            terminal::line(outcome_table::odds(&summary));
        }
    }
    Ok(Exit::of(!interrupted && summary.successes == summary.trials))
}

fn rows_writer(path: &Path) -> Result<csv::Writer<std::fs::File>, CliError> {
    csv::Writer::from_path(path).map_err(|e| {
        CliError::because(
            format!("writing the rows {}", path.display()),
            format!("{e}; choose another path"),
        )
    })
}
