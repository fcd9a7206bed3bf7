//! `alight lands`: live landings of many seeds, beside the lock-step landings of the same seeds.

use alight_sim::harness::age::AgeTap;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::trial::{Watch, fly_with};
use clap::Parser;
use serde::Serialize;

use crate::cli::{Cli, Command};
use crate::exit::{CliError, Exit};
use crate::lab::LabCommand;
use crate::lab::live::args::{LandArgs, LandsArgs};
use crate::lab::live::fleet;
use crate::lab::live::fleet::{Job, median};
use crate::lab::live::report::LiveReport;
use crate::lab::live::{air, land, profile};
use crate::lab::study::link::aborts;
use crate::process::snapshot::time;
use crate::terminal;
use crate::terminal::note;

/// Before this time of a trial clocks and sessions settle: ages are not counted, s.
const WARM_UP_S: f64 = 5.0;

/// One seed, both ways.
#[derive(Clone, Debug, Serialize)]
struct LandingPair {
    seed: u64,
    live: Option<Outcome>,
    lock_step: Outcome,
    age_lock_step_s: [f64; 2],
    report: Option<LiveReport>,
    leftovers: Vec<String>,
}

/// All pairs in figures.
#[derive(Clone, Debug, Serialize)]
pub struct PairedSummary {
    /// Seeds.
    pub trials: usize,
    /// That landed live.
    pub landed: usize,
    /// That landed in lock-step.
    pub landed_lock_step: usize,
    /// Live.
    pub unsafe_contacts: u32,
    /// Age of the vessel's newest state at the drone: median over the seeds of median and 95th
    /// percentile, live, s.
    pub age_s: [f64; 2],
    /// The same in lock-step.
    pub age_lock_step_s: [f64; 2],
    /// Of all that landed in lock-step.
    pub landing_time_lock_step_s: f64,
    /// Live minus lock-step, medians over the seeds that landed both ways.
    position_error_difference_m: f64,
    landing_time_difference_s: f64,
    /// Of all that landed live.
    pub position_error_m: f64,
    /// The same.
    pub landing_time_s: f64,
    /// Descents given up, mean, live and in lock-step.
    pub aborts: [f64; 2],
    /// Worst age of the vessel's state at touchdown, live and in lock-step, s; null without any.
    pub touchdown_age_s: [Option<f64>; 2],
    /// Of all that landed in lock-step.
    pub position_error_lock_step_m: f64,
    pairs: Vec<LandingPair>,
}

/// What is flown, both ways.
pub struct Plan {
    /// How many seeds.
    pub trials: u32,
    /// The first.
    pub seed0: u64,
    /// How many live at a time.
    pub jobs: u16,
    /// Names of the sets of processes begin with this.
    pub instance: String,
    /// Flags of `alight land`.
    pub land: Vec<String>,
}

/// Flies all seeds and shows the table.
pub fn run(args: &LandsArgs) -> Result<Exit, CliError> {
    let summary = fly_pairs(&Plan {
        trials: args.trials,
        seed0: args.seed0,
        jobs: args.jobs,
        instance: args.instance.clone(),
        land: args.land.clone(),
    })?;
    note(args.json, summary.table());
    if args.json {
        terminal::line(serde_json::to_string(&summary).map_err(|e| CliError::because("writing JSON", e))?);
    }
    Ok(if summary.landed == summary.trials {
        Exit::Success
    } else {
        Exit::Failed
    })
}

/// Flies all seeds live, then in lock-step.
pub fn fly_pairs(args: &Plan) -> Result<PairedSummary, CliError> {
    let flags = land_flags(&args.land)?;
    let seeds: Vec<u64> = (args.seed0..).take(args.trials as usize).collect();
    let jobs: Vec<Job> = seeds
        .iter()
        .map(|seed| Job {
            instance: format!("{}-{seed}", args.instance),
            flags: ["--seed".to_string(), seed.to_string()]
                .into_iter()
                .chain(args.land.clone())
                .collect(),
        })
        .collect();
    let done = fleet::fly(&jobs, usize::from(args.jobs), |k, d| {
        let text = d.landed.as_ref().map_or_else(
            || format!("no outcome: {}", d.output.lines().last().unwrap_or_default()),
            |l| {
                format!(
                    "{}: {}, {} m, {} s",
                    l.outcome.outcome.name(),
                    l.outcome.reason,
                    figure(l.outcome.position_error_m, 3),
                    figure(l.outcome.landing_time_s, 1)
                )
            },
        );
        note(
            true,
            format!("seed {}: {text}", seeds.get(k).copied().unwrap_or(0)),
        );
    })?;
    let mut pairs = Vec::new();
    for (seed, d) in seeds.iter().zip(done) {
        let (live, report) = d.landed.map(|l| (l.outcome, l.live)).unzip();
        let (lock_step, age_lock_step_s) = lock_step(&flags, *seed)?;
        pairs.push(LandingPair {
            seed: *seed,
            live,
            lock_step,
            age_lock_step_s,
            report,
            leftovers: d.leftovers,
        });
    }
    Ok(PairedSummary::of(pairs))
}

/// The flags after `--`, read as those of `alight land`.
fn land_flags(flags: &[String]) -> Result<Box<LandArgs>, CliError> {
    let words = ["alight", "land"].map(str::to_string);
    let cli = Cli::try_parse_from(words.iter().chain(flags))
        .map_err(|e| CliError::because("the flags after --", e))?;
    if let Command::Lab(command) = cli.command
        && let LabCommand::Land(args) = *command
    {
        return Ok(args);
    }
    Err(CliError(
        "the flags after -- are not those of `alight land`".into(),
    ))
}

/// The same seed in lock-step.
fn lock_step(args: &LandArgs, seed: u64) -> Result<(Outcome, [f64; 2]), CliError> {
    let mut scene = land::scene(args)?;
    if args.link != "scenario" {
        scene.scenario.radio = profile::load(&args.link)?;
    }
    scene.scenario.radio.transport = args.transport();
    scene.scenario.radio.congestion = air::congestion();
    let mut quiet = |_: &_| {};
    let watch = Watch {
        on_event: &mut quiet,
        trace_step_s: None,
    };
    let mut ages = AgeTap::from(WARM_UP_S);
    fly_with(&scene.scenario, &scene.nodes, seed, &scene.sea, watch, &mut ages)
        .map(|flight| (flight.outcome, [0.5, 0.95].map(|q| ages.quantile(q))))
        .map_err(|e| CliError::because(format!("setting up the trial of seed {seed}"), e))
}

fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"))
}

impl PairedSummary {
    fn of(pairs: Vec<LandingPair>) -> PairedSummary {
        let live = || pairs.iter().filter_map(|p| p.live.as_ref());
        let both = |f: fn(&Outcome) -> Option<f64>| {
            median(pairs.iter().filter_map(|p| {
                let live = p.live.as_ref().filter(|l| l.success)?;
                (p.lock_step.success).then_some(f(live)? - f(&p.lock_step)?)
            }))
        };
        let landed = |f: fn(&Outcome) -> Option<f64>| median(live().filter(|l| l.success).filter_map(f));
        let locked = || pairs.iter().map(|p| &p.lock_step);
        let worst = |ages: Vec<f64>| ages.into_iter().max_by(f64::total_cmp);
        let mean = |all: Vec<f64>| all.iter().sum::<f64>() / all.len().max(1) as f64;
        PairedSummary {
            aborts: [
                mean(live().map(aborts).collect()),
                mean(locked().map(aborts).collect()),
            ],
            touchdown_age_s: [
                worst(live().filter_map(|o| o.radio_age_s).collect()),
                worst(locked().filter_map(|o| o.radio_age_s).collect()),
            ],
            position_error_lock_step_m: median(locked().filter_map(|o| o.position_error_m)),
            trials: pairs.len(),
            landed: live().filter(|l| l.success).count(),
            landed_lock_step: pairs.iter().filter(|p| p.lock_step.success).count(),
            age_s: [
                median(
                    pairs
                        .iter()
                        .filter_map(|p| Some(p.report.as_ref()?.radio.age_p50_s)),
                ),
                median(
                    pairs
                        .iter()
                        .filter_map(|p| Some(p.report.as_ref()?.radio.age_p95_s)),
                ),
            ],
            age_lock_step_s: [0, 1]
                .map(|k: usize| median(pairs.iter().filter_map(|p| p.age_lock_step_s.get(k).copied()))),
            landing_time_lock_step_s: median(pairs.iter().filter_map(|p| p.lock_step.landing_time_s)),
            unsafe_contacts: live().map(|l| l.unsafe_contacts).sum(),
            position_error_difference_m: both(|o| o.position_error_m),
            landing_time_difference_s: both(|o| o.landing_time_s),
            position_error_m: landed(|o| o.position_error_m),
            landing_time_s: landed(|o| o.landing_time_s),
            pairs,
        }
    }
    fn table(&self) -> String {
        let mut out = String::from(
            "\n| seed | live | error, m | speed, m/s | time, s | lock-step | error, m | speed, m/s | time, s | worst tick |\n\
             |---|---|---|---|---|---|---|---|---|---|\n",
        );
        for p in &self.pairs {
            let side = |o: Option<&Outcome>| {
                format!(
                    "{} | {} | {} | {}",
                    o.map_or("none", |o| o.outcome.name()),
                    figure(o.and_then(|o| o.position_error_m), 3),
                    figure(o.and_then(|o| o.touchdown_speed_mps), 2),
                    figure(o.and_then(|o| o.landing_time_s), 1)
                )
            };
            let late = p
                .report
                .as_ref()
                .map_or_else(|| "-".into(), |r| crate::process::snapshot::time(r.world_late_s));
            out.push_str(&format!(
                "| {} | {} | {} | {late} |\n",
                p.seed,
                side(p.live.as_ref()),
                side(Some(&p.lock_step))
            ));
        }
        out.push_str(&format!(
            "\n{} of {} landed live, {} in lock-step; {} unsafe contacts live; median {:.3} m, {:.1} s; \
             live minus lock-step (paired medians) {:+.3} m, {:+.1} s; age of the vessel's state (p50, p95) {}, {} \
             live, {}, {} in lock-step\n{}",
            self.landed,
            self.trials,
            self.landed_lock_step,
            self.unsafe_contacts,
            self.position_error_m,
            self.landing_time_s,
            self.position_error_difference_m,
            self.landing_time_difference_s,
            time(self.age_s[0]),
            time(self.age_s[1]),
            time(self.age_lock_step_s[0]),
            time(self.age_lock_step_s[1]),
            self.used(),
        ));
        let leftovers: Vec<&String> = self.pairs.iter().flat_map(|p| &p.leftovers).collect();
        if !leftovers.is_empty() {
            out.push_str(&format!("left behind: {leftovers:?}\n"));
        }
        out
    }
    /// Medians over the landings of what each process used.
    fn used(&self) -> String {
        let mut out = String::from(
            "\n| process | CPU, % of a core | memory, MB | step p50 | step p99 |\n|---|---|---|---|---|\n",
        );
        let reports: Vec<&LiveReport> = self.pairs.iter().filter_map(|p| p.report.as_ref()).collect();
        let Some(first) = reports.first() else {
            return String::new();
        };
        for process in &first.processes {
            let of = |f: fn(&crate::lab::live::report::ProcessUsage) -> f64| {
                median(
                    reports
                        .iter()
                        .filter_map(|r| r.processes.iter().find(|p| p.process == process.process))
                        .map(f),
                )
            };
            out.push_str(&format!(
                "| {} | {:.1} | {:.1} | {} | {} |\n",
                process.process,
                of(|p| p.cpu_percent),
                of(|p| p.memory_mb),
                crate::process::snapshot::time(of(|p| p.step_p50_s)),
                crate::process::snapshot::time(of(|p| p.step_p99_s)),
            ));
        }
        out
    }
}
