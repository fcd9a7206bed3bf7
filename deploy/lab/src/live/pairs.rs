//! `alight land --trials N`: live landings of many seeds, beside the lock-step landings of the same seeds.

use alight_computer::cells;
use alight_computer::exit::{CliError, Doing, Exit};
use alight_computer::process::snapshot::time;
use alight_computer::table::{Cell, Table};
use alight_computer::terminal::{Form, note};
use alight_shared::estimation;
use alight_sim::harness::age::AgeTap;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::trial::{Watch, fly_with};
use serde::Serialize;

use super::args::{LandArgs, LandsArgs, land_flags};
use super::fleet::{self, Job};
use super::report::{LiveReport, ProcessUsage};
use super::{air, land, profile};
use crate::study::pooled::aborts;

/// The median; no number without any.
fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    estimation::median(values).unwrap_or(f64::NAN)
}

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

/// What the landings of one way have in common.
#[derive(Clone, Debug, Serialize)]
pub struct Side {
    /// That landed.
    pub landed: usize,
    /// Of all that landed, median.
    pub position_error_m: f64,
    /// The same.
    pub landing_time_s: f64,
    /// Aborted descents, mean.
    pub aborts: f64,
    /// Age of the vessel's newest state at the drone: median over the seeds of median and 95th
    /// percentile, s.
    pub age_s: [f64; 2],
    /// Greatest age of the vessel's state at touchdown, s; null without any.
    pub touchdown_age_s: Option<f64>,
}

impl Side {
    fn of<'a>(outcomes: impl Iterator<Item = &'a Outcome> + Clone, age_s: [f64; 2]) -> Side {
        let landed = outcomes.clone().filter(|o| o.success);
        let descents: Vec<f64> = outcomes.clone().map(aborts).collect();
        Side {
            landed: landed.clone().count(),
            position_error_m: median(landed.clone().filter_map(|o| o.position_error_m)),
            landing_time_s: median(landed.filter_map(|o| o.landing_time_s)),
            aborts: descents.iter().sum::<f64>() / descents.len().max(1) as f64,
            age_s,
            touchdown_age_s: outcomes.filter_map(|o| o.radio_age_s).max_by(f64::total_cmp),
        }
    }
}

/// All pairs together.
#[derive(Clone, Debug, Serialize)]
pub struct PairedSummary {
    /// Seeds.
    pub trials: usize,
    /// Live.
    pub unsafe_contacts: u32,
    /// The live landings.
    pub live: Side,
    /// Those in lock-step.
    pub lock_step: Side,
    /// Live minus lock-step, medians over the seeds that landed both ways.
    position_error_difference_m: f64,
    landing_time_difference_s: f64,
    pairs: Vec<LandingPair>,
}

/// What is flown, both ways.
pub struct PairPlan {
    /// How many seeds.
    pub trials: u32,
    /// The first.
    pub seed0: u64,
    /// How many live at a time.
    pub jobs: u16,
    /// Names of the sets of processes begin with this.
    pub instance: String,
    /// Flags of `alight land`.
    pub flags: Vec<String>,
}

/// `alight land --trials N`: the other flags of the command line go to each landing.
pub fn run(args: &LandArgs, trials: u32) -> Result<Exit, CliError> {
    let plan = PairPlan {
        trials,
        seed0: args.seed,
        jobs: args.jobs,
        instance: args.instance.clone(),
        flags: flags_of_each(std::env::args().skip(2)),
    };
    fly_pairs(args, &plan)?.show(args.form)
}

/// `alight lands`, the former name.
pub fn run_lands(args: &LandsArgs) -> Result<Exit, CliError> {
    let plan = PairPlan {
        trials: args.trials,
        seed0: args.seed0,
        jobs: args.jobs,
        instance: args.instance.clone(),
        flags: args.land.clone(),
    };
    fly_pairs(&land_flags(&plan.flags)?, &plan)?.show(args.form)
}

/// The flags of a command line that each of its landings gets, too: not those that differ among them.
fn flags_of_each(mut all: impl Iterator<Item = String>) -> Vec<String> {
    let mut flags = Vec::new();
    while let Some(flag) = all.next() {
        match flag.as_str() {
            "--json" | "--csv" => {}
            "--trials" | "--seed" | "--jobs" | "--instance" => {
                all.next();
            }
            f if ["--trials=", "--seed=", "--jobs=", "--instance="]
                .iter()
                .any(|p| f.starts_with(p)) => {}
            _ => flags.push(flag),
        }
    }
    flags
}

/// Flies all seeds live, then in lock-step. `args` are the plan's flags as they were read.
pub fn fly_pairs(args: &LandArgs, plan: &PairPlan) -> Result<PairedSummary, CliError> {
    let seeds: Vec<u64> = (plan.seed0..).take(plan.trials as usize).collect();
    let jobs: Vec<Job> = seeds
        .iter()
        .map(|seed| Job {
            instance: format!("{}-{seed}", plan.instance),
            flags: ["--seed".to_string(), seed.to_string()]
                .into_iter()
                .chain(plan.flags.clone())
                .collect(),
        })
        .collect();
    let done = fleet::fly(&jobs, usize::from(plan.jobs), |k, d| {
        let text = d.landed.as_ref().map_or_else(
            || format!("no outcome: {}", d.output.lines().last().unwrap_or_default()),
            |l| format!("{}: {}", l.outcome.outcome.name(), l.outcome.reason),
        );
        let seed = seeds.get(k).copied().unwrap_or(0);
        note(true, format_args!("seed {seed}: {text}"));
    })?;
    let mut pairs = Vec::new();
    for (seed, d) in seeds.iter().zip(done) {
        let (live, report) = d.landed.map(|l| (l.outcome, l.live)).unzip();
        let (lock_step, age_lock_step_s) = fly_lock_step(args, *seed)?;
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

/// The same seed in lock-step.
fn fly_lock_step(args: &LandArgs, seed: u64) -> Result<(Outcome, [f64; 2]), CliError> {
    let mut scene = land::scene(args)?;
    if args.link != "scenario" {
        scene.scenario.radio = profile::load(&args.link)?;
    }
    scene.scenario.radio.transport = args.transport();
    scene.scenario.radio.congestion = air::congestion();
    let watch = Watch {
        on_event: &mut |_| {},
        trace_step_s: None,
    };
    let mut ages = AgeTap::from(WARM_UP_S);
    fly_with(&scene.scenario, &scene.nodes, seed, &scene.sea, watch, &mut ages)
        .map(|flown| (flown.outcome, [0.5, 0.95].map(|q| ages.quantile(q))))
        .doing(format_args!("setting up the trial of seed {seed}"))
}

impl PairedSummary {
    fn of(pairs: Vec<LandingPair>) -> PairedSummary {
        let live = pairs.iter().filter_map(|p| p.live.as_ref());
        let reports = || pairs.iter().filter_map(|p| p.report.as_ref()).map(|r| &r.radio);
        let difference = |metric: fn(&Outcome) -> Option<f64>| {
            median(pairs.iter().filter_map(|p| {
                let live = p.live.as_ref().filter(|l| l.success && p.lock_step.success)?;
                Some(metric(live)? - metric(&p.lock_step)?)
            }))
        };
        PairedSummary {
            trials: pairs.len(),
            unsafe_contacts: live.clone().map(|l| l.unsafe_contacts).sum(),
            live: Side::of(
                live,
                [
                    median(reports().map(|r| r.age_p50_s)),
                    median(reports().map(|r| r.age_p95_s)),
                ],
            ),
            lock_step: Side::of(
                pairs.iter().map(|p| &p.lock_step),
                [0, 1].map(|k: usize| median(pairs.iter().map(|p| p.age_lock_step_s[k]))),
            ),
            position_error_difference_m: difference(|o| o.position_error_m),
            landing_time_difference_s: difference(|o| o.landing_time_s),
            pairs,
        }
    }
    /// Prints the tables or, for machines, the summary or the pairs.
    pub fn show(&self, form: Form) -> Result<Exit, CliError> {
        note(form.alone(), self.text());
        form.print(self, &self.pairs)?;
        Ok(Exit::of(self.live.landed == self.trials))
    }
    fn text(&self) -> String {
        let side = ["error m", "speed m/s", "time s"];
        let heads = ["seed", "live"].into_iter().chain(side);
        let heads = heads.chain(["lock-step"]).chain(side).chain(["worst tick"]);
        let mut table = Table::new(.., heads);
        for p in &self.pairs {
            let side = |o: Option<&Outcome>| {
                [
                    o.map_or("none", |o| o.outcome.name()).into(),
                    Cell::number(o.and_then(|o| o.position_error_m), 3),
                    Cell::number(o.and_then(|o| o.touchdown_speed_mps), 2),
                    Cell::number(o.and_then(|o| o.landing_time_s), 1),
                ]
            };
            let late = p
                .report
                .as_ref()
                .map_or_else(|| "-".into(), |r| time(r.world_late_s));
            let cells = core::iter::once(p.seed.into()).chain(side(p.live.as_ref()));
            table.row(cells.chain(side(Some(&p.lock_step))).chain([late.into()]));
        }
        let (live, model) = (&self.live, &self.lock_step);
        let [a, b] = live.age_s.map(time);
        let [c, d] = model.age_s.map(time);
        let mut out = format!(
            "\n{}\n{} of {} landed live, {} in lock-step; {} unsafe contacts live; median {:.3} m, {:.1} s; live \
             minus lock-step (paired medians) {:+.3} m, {:+.1} s; age of the vessel's state (p50, p95) {a}, {b} live, \
             {c}, {d} in lock-step\n\n{}",
            table.text(),
            live.landed,
            self.trials,
            model.landed,
            self.unsafe_contacts,
            live.position_error_m,
            live.landing_time_s,
            self.position_error_difference_m,
            self.landing_time_difference_s,
            self.usage().text(),
        );
        let leftovers: Vec<&String> = self.pairs.iter().flat_map(|p| &p.leftovers).collect();
        if !leftovers.is_empty() {
            out.push_str(&format!("left behind: {leftovers:?}\n"));
        }
        out
    }
    /// Medians over the landings of what each process used.
    fn usage(&self) -> Table {
        let mut table = Table::new(
            1..,
            [
                "process",
                "CPU, % of a core",
                "memory, MB",
                "step p50",
                "step p99",
            ],
        );
        let reports: Vec<&LiveReport> = self.pairs.iter().filter_map(|p| p.report.as_ref()).collect();
        for process in reports.first().into_iter().flat_map(|r| &r.processes) {
            let of = |metric: fn(&ProcessUsage) -> f64| {
                let same = reports.iter().flat_map(|r| &r.processes);
                median(same.filter(|p| p.process == process.process).map(metric))
            };
            table.row(cells![
                process.process,
                format_args!("{:.1}", of(|p| p.cpu_percent)),
                format_args!("{:.1}", of(|p| p.memory_mb)),
                time(of(|p| p.step_p50_s)),
                time(of(|p| p.step_p99_s)),
            ]);
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn common_flags_of_paired_landings() {
        let words = "--trials 3 --sea calm --seed=7 --jobs 2 --json --link storm --instance=a";
        let flags = flags_of_each(words.split(' ').map(String::from));
        assert_eq!(flags.join(" "), "--sea calm --link storm");
        assert_eq!(land_flags(&flags).unwrap().link, "storm");
    }
}
