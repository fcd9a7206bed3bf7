//! What a grid study reports: on the terminal, as JSON, as Markdown and as a page.

use std::path::{Path, PathBuf};

use alight_sim::harness::outcome::{MAX_CONTACT_MPS, MAX_TILT_ERROR_RAD, Outcome};
use alight_sim::studies::paired::{self, COMPARED, Comparison};
use alight_sim::studies::statistics::{METRICS, Summary, bootstrap_mean, wilson};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::grid::{self, Published, TABLE2, TABLE2_FAILURES};
use super::run;
use super::variant::PlannerVariant;
use crate::cells;
use crate::exit::CliError;
use crate::lab::args::{Study, StudyArgs};
use crate::lab::outcome_table::summary_json;
use crate::lab::report::chart::{self, Dot};
use crate::lab::report::document::{Block, Chart, Document, write_files};
use crate::table::{Cell, Table};
use crate::terminal::note;

/// Failures that a report names with their reasons.
const MAX_FAILURES: usize = 12;
/// Worst trials that a report names per row.
const WORST_COUNT: usize = 3;
/// Rows up to which the terminal shows worst and best trials.
const MAX_ROWS_WITH_EXTREMES: usize = 20;
/// Position error that counts as the limits of speed and tilt do, m: half the deck's width less half
/// of the feet's span.
const POSITION_LIMIT_M: f64 = 0.65;

/// A metric of the report: its name, its column, its chart's caption, the least end of the chart's axis,
/// decimals.
type Shown = (&'static str, &'static str, &'static str, f64, usize);

const SHOWN: [Shown; 6] = [
    (
        "position_error_m",
        "position m",
        "position error at first contact, m",
        0.02,
        3,
    ),
    (
        "touchdown_speed_mps",
        "normal m/s",
        "speed along the deck's normal, m/s",
        0.05,
        2,
    ),
    (
        "tangential_speed_mps",
        "tangential m/s",
        "speed along the deck, m/s",
        0.05,
        2,
    ),
    (
        "tilt_error_deg",
        "tilt deg",
        "angle between the normals, deg",
        0.5,
        2,
    ),
    (
        "landing_time_s",
        "landing s",
        "first descent to first contact, s",
        1.0,
        1,
    ),
    (
        "over_deck_time_s",
        "over deck s",
        "first within 2 m to first contact, s",
        1.0,
        1,
    ),
];

/// A scenario flown by one planner.
#[derive(Serialize)]
struct ReportRow {
    scenario: String,
    planner: String,
    #[serde(flatten)]
    summary_values: Map<String, Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    published: Option<Published>,
    /// Worst first, by the fraction of a limit of success.
    worst_seeds: Vec<u64>,
    best_seed: u64,
    #[serde(skip)]
    summary: Summary,
    /// 95 % bootstrap interval of the mean of each of [`SHOWN`].
    #[serde(skip)]
    intervals: Vec<Option<[f64; 2]>>,
    /// Flies a trial again, without `--seed`; None where the study kept no scene.
    #[serde(skip)]
    command: Option<String>,
}

impl ReportRow {
    fn new(args: &StudyArgs, planners: &[PlannerVariant], set: &[&Outcome]) -> Option<ReportRow> {
        let first = set.first()?;
        let (scenario, planner) = (first.sea.clone(), first.planner.clone());
        let mut sorted = set.to_vec();
        sorted.sort_by(|a, b| {
            worst_limit_fraction(b)
                .total_cmp(&worst_limit_fraction(a))
                .then(a.seed.cmp(&b.seed))
        });
        let seeds: Vec<u64> = sorted.iter().map(|o| o.seed).collect();
        let others = seeds.len().saturating_sub(1).clamp(1, WORST_COUNT);
        let all: Vec<Outcome> = set.iter().map(|o| (*o).clone()).collect();
        let summary = Summary::of(&all);
        let interval = |(name, ..): &Shown| {
            let (_, metric) = METRICS.iter().find(|(n, _)| n == name)?;
            bootstrap_mean(&all.iter().filter_map(metric).collect::<Vec<f64>>())
        };
        Some(ReportRow {
            published: grid::published(&scenario, &planner),
            command: (args.out.as_ref())
                .zip(planners.iter().find(|p| p.name == planner))
                .and_then(|(out, planner)| replay_command(out, planner, &scenario)),
            intervals: SHOWN.iter().map(interval).collect(),
            summary_values: summary_json(&summary),
            worst_seeds: seeds.iter().take(others).copied().collect(),
            best_seed: *seeds.last()?,
            scenario,
            planner,
            summary,
        })
    }
    fn seeds(&self) -> String {
        let worst: Vec<String> = self.worst_seeds.iter().map(u64::to_string).collect();
        worst.join(", ")
    }
}

/// The fraction of a limit of success that a trial takes at worst; failures above all.
fn worst_limit_fraction(o: &Outcome) -> f64 {
    let fraction = |value: Option<f64>, limit: f64| value.map_or(f64::INFINITY, |v| v / limit);
    let worst = fraction(o.position_error_m, POSITION_LIMIT_M)
        .max(fraction(o.touchdown_speed_mps, MAX_CONTACT_MPS))
        .max(fraction(o.tangential_speed_mps, MAX_CONTACT_MPS))
        .max(fraction(o.tilt_error_deg, MAX_TILT_ERROR_RAD.to_degrees()));
    worst + if o.success { 0.0 } else { 1e6 }
}

/// The command that flies a trial of the study again, from the files that the study keeps.
pub fn replay_command(out: &Path, planner: &PlannerVariant, scenario: &str) -> Option<String> {
    let flag = |name: &str, path: PathBuf| path.exists().then(|| format!(" --{name} '{}'", path.display()));
    let scene = flag("scenario", run::scenario_file(out, scenario))?;
    let [vessel, drone] = run::config_files(out, scenario, &planner.name);
    Some(format!(
        "alight trial{scene}{}{} --planner {}",
        flag("vessel-config", vessel).unwrap_or_default(),
        flag("drone-config", drone).unwrap_or_default(),
        planner.kind.name()
    ))
}

/// Everything that a study found.
struct Report {
    rows: Vec<ReportRow>,
    /// Each planner over all scenarios, and what else the study found.
    remarks: Vec<String>,
    /// The first planner against each other one: over all, then scenario by scenario.
    comparisons: Vec<Comparison>,
    failures: Vec<String>,
}

/// Reports a set of rows. `planners` in the order of the table, the one that all others are compared with
/// first; `charts` go into the page as they are.
pub fn publish(
    args: &StudyArgs,
    title: &str,
    hash: &str,
    planners: &[PlannerVariant],
    outcomes: &[Outcome],
    charts: Vec<Chart>,
) -> Result<Value, CliError> {
    let mut sets: Vec<Vec<&Outcome>> = Vec::new();
    for o in outcomes {
        match sets.last_mut() {
            Some(set)
                if set
                    .first()
                    .is_some_and(|f| (&f.sea, &f.planner) == (&o.sea, &o.planner)) =>
            {
                set.push(o);
            }
            Some(_) | None => sets.push(vec![o]),
        }
    }
    let rows: Vec<ReportRow> = sets
        .iter()
        .filter_map(|set| ReportRow::new(args, planners, set))
        .collect();
    let faa = faa_ratio(args, planners, outcomes);
    let mut remarks = totals(planners, outcomes, rows.len());
    remarks.extend(faa.iter().map(|f| f.text.clone()));
    let report = Report {
        comparisons: comparisons(planners, &rows, outcomes),
        failures: failures(outcomes),
        remarks,
        rows,
    };
    for text in report.console(title, hash) {
        note(args.json, text);
    }
    let mut values = Vec::new();
    for row in &report.rows {
        let mut value = json!(row);
        value["configuration"] = hash.into();
        let is_row = |c: &&Comparison| c.scenario.as_ref() == Some(&row.scenario) && c.other == row.planner;
        if let Some(comparison) = report.comparisons.iter().find(is_row) {
            value["against"] = json!(comparison);
        }
        if let Some(faa) = faa.as_ref().filter(|f| f.other == row.planner) {
            value["tilt_error_p95_ratio"] = faa.value.clone();
        }
        values.push(value);
    }
    let value = Value::Array(values);
    if let Some(out) = &args.out {
        let comparisons = json!(report.comparisons).to_string();
        let document = report.document(title, hash, &seeds_of(outcomes), charts);
        write_files(
            out,
            &[
                ("report.html", document.html()),
                ("summary.md", document.markdown()),
                ("summary.json", value.to_string()),
                ("paired.json", comparisons),
            ],
        )?;
        note(
            args.json,
            format_args!("written: {}", out.join("report.html").display()),
        );
    }
    Ok(value)
}

fn seeds_of(outcomes: &[Outcome]) -> String {
    let seeds = || outcomes.iter().map(|o| o.seed);
    match (seeds().min(), seeds().max()) {
        (Some(a), Some(b)) => format!("seeds {a} to {b}"),
        _ => "no trials".into(),
    }
}

/// Each planner over all scenarios, where there are several of them.
fn totals(planners: &[PlannerVariant], outcomes: &[Outcome], rows: usize) -> Vec<String> {
    let flown = |p: &&PlannerVariant| outcomes.iter().any(|o| o.planner == p.name);
    if rows <= planners.iter().filter(flown).count() {
        return Vec::new();
    }
    let all_of_table2 = TABLE2
        .iter()
        .all(|(name, ..)| outcomes.iter().any(|o| o.sea == *name));
    let total = |p: &PlannerVariant| {
        let set: Vec<Outcome> = outcomes.iter().filter(|o| o.planner == p.name).cloned().collect();
        let ([faa, ne], of) = TABLE2_FAILURES;
        let failures = match p.kind.name() {
            "mpc-faa" => Some(faa),
            "mpc-ne" => Some(ne),
            _ => None,
        };
        let published = failures
            .filter(|_| all_of_table2)
            .map_or_else(String::new, |f| format!(" (published {}/{of})", of - f));
        let s = Summary::of(&set);
        let (lo, hi) = wilson(s.successes, s.trials);
        format!(
            "{} over all: {}/{} landed{published}, 95 % interval {:.2} to {:.2} %; {} unsafe contacts, {} with \
             water, {} above 2 m/s",
            p.name,
            s.successes,
            s.trials,
            100.0 * lo,
            100.0 * hi,
            s.unsafe_contacts,
            s.water_contacts,
            s.contacts_above_2_mps
        )
    };
    planners.iter().filter(flown).map(total).collect()
}

/// The first planner against each other one: over all, then scenario by scenario.
fn comparisons(planners: &[PlannerVariant], rows: &[ReportRow], outcomes: &[Outcome]) -> Vec<Comparison> {
    let Some((first, others)) = planners.split_first() else {
        return Vec::new();
    };
    let mut scenarios: Vec<Option<&str>> = vec![None];
    for row in rows {
        if !scenarios.contains(&Some(&row.scenario)) {
            scenarios.push(Some(&row.scenario));
        }
    }
    let compare = |other: &PlannerVariant| {
        scenarios
            .iter()
            .filter_map(|s| paired::compare(outcomes, *s, &first.name, &other.name))
            .collect::<Vec<_>>()
    };
    others.iter().flat_map(compare).collect()
}

struct FaaRatio {
    other: String,
    text: String,
    value: Value,
}

/// What attitude alignment is worth and what it costs (figure 3 of the paper).
fn faa_ratio(args: &StudyArgs, planners: &[PlannerVariant], outcomes: &[Outcome]) -> Option<FaaRatio> {
    let [with, without] = planners else {
        return None;
    };
    if args.name != Study::Faa {
        return None;
    }
    let (ratio, [lo, hi]) = paired::p95_ratio(outcomes, &with.name, &without.name, |o| o.tilt_error_deg)?;
    let comparison = paired::compare(outcomes, None, &with.name, &without.name)?;
    let cost = comparison
        .differences
        .iter()
        .find(|d| d.metric == "position_error_m")?;
    Some(FaaRatio {
        other: without.name.clone(),
        text: format!(
            "p95 of tilt_error: {ratio:.2} times smaller with {} than with {} (95 % interval {lo:.2} to \
             {hi:.2}); it costs {:.1} cm of position ({:.1} to {:.1}; published 1 to 1.5 cm)",
            with.name,
            without.name,
            -100.0 * cost.mean,
            -100.0 * cost.interval[1],
            -100.0 * cost.interval[0],
        ),
        value: json!({ "ratio": ratio, "interval": [lo, hi] }),
    })
}

/// Failures with their reasons, a bounded number.
fn failures(outcomes: &[Outcome]) -> Vec<String> {
    let failed = || outcomes.iter().filter(|o| !o.success);
    let line = |o: &Outcome| {
        format!(
            "{} {} seed {}: {} ({})",
            o.sea,
            o.planner,
            o.seed,
            o.outcome.name(),
            o.reason
        )
    };
    let mut lines: Vec<String> = failed().take(MAX_FAILURES).map(line).collect();
    let more = failed().count() - lines.len();
    if more > 0 {
        lines.push(format!("and {more} more failures in rows.csv"));
    }
    lines
}

impl Report {
    /// The rows; with intervals, what is published and all metrics, or as a terminal has room for them.
    fn summary(&self, full: bool) -> Table {
        let metrics = || SHOWN.iter().filter(|s| full || s.0 != "tangential_speed_mps");
        let mut heads = vec!["scenario", "planner", "landed"];
        heads.extend(full.then_some("95 %"));
        heads.extend(["descents well", "unsafe", "water", "> 2 m/s"]);
        heads.extend(metrics().map(|m| m.1));
        let mut table = Table::new(2.., heads);
        for row in &self.rows {
            let s = &row.summary;
            let (lo, hi) = wilson(s.successes, s.trials);
            let count = |n: u32| {
                if n == 0 {
                    Cell::from(n)
                } else {
                    Cell::from(n).judged(false)
                }
            };
            let mut cells = cells![
                row.scenario,
                row.planner,
                format_args!("{}/{}", s.successes, s.trials)
            ]
            .to_vec();
            if full {
                cells.push(format!("{:.1}-{:.1} %", 100.0 * lo, 100.0 * hi).into());
            }
            let [begun, badly] = s.descents;
            let well = Cell::from(format_args!("{}/{begun}", begun - badly));
            cells.push(if badly == 0 { well } else { well.judged(false) });
            cells.extend([s.unsafe_contacts, s.water_contacts, s.contacts_above_2_mps].map(count));
            for (name, .., digits) in metrics() {
                let digits = *digits;
                let published = row.published.filter(|_| full).and_then(|p| p.metric(name));
                let published = published.map(|v| format!("published {v}"));
                let statistics = s.metric(name);
                let p95 = statistics.map(|f| format!("{:.digits$}", f.p95));
                let notes: Vec<String> = p95.into_iter().chain(published).collect();
                cells.push(Cell::number(statistics.map(|f| f.mean), digits).note(notes.join("; ")));
            }
            table.row(cells);
        }
        table
    }
    /// Paired differences: better and worse where the interval leaves out zero. Less is better everywhere
    /// but in the rate of landings.
    fn differences(&self, is_shown: impl Fn(&Comparison) -> bool) -> Table {
        let heads = [
            "scenario",
            "planner",
            "minus",
            "pairs",
            "only it",
            "only the other",
            "landed %",
        ];
        let mut table = Table::new(3.., heads.into_iter().chain(COMPARED.iter().map(|c| c.0)));
        let cell = |mean: f64, [lo, hi]: [f64; 2], digits: usize, sign: f64| {
            let cell = Cell::signed(mean, digits).note(format_args!("{lo:+.digits$} to {hi:+.digits$}"));
            if lo <= 0.0 && hi >= 0.0 {
                return cell;
            }
            cell.judged(mean * sign > 0.0)
        };
        for c in self.comparisons.iter().filter(|c| is_shown(c)) {
            let r = &c.rates;
            let scenario = c.scenario.as_deref().unwrap_or("all");
            let mut cells = cells![scenario, c.other, c.first, c.pairs, r.only[1], r.only[0]].to_vec();
            cells.push(cell(100.0 * r.difference, r.interval.map(|v| 100.0 * v), 1, 1.0));
            for (name, _) in COMPARED {
                let digits = if name.ends_with("_m") { 3 } else { 2 };
                let difference = c.differences.iter().find(|d| d.metric == name);
                cells.push(difference.map_or("-".into(), |d| cell(d.mean, d.interval, digits, -1.0)));
            }
            table.row(cells);
        }
        table
    }
    fn extremes(&self) -> Table {
        let mut table = Table::new(
            5..,
            [
                "scenario",
                "planner",
                "worst seeds",
                "best seed",
                "replay of the worst",
            ],
        );
        for row in &self.rows {
            let seed = row.worst_seeds.first().copied().unwrap_or_default();
            let command = row.command.as_ref().map(|c| format!("{c} --seed {seed}"));
            table.row(cells![
                row.scenario,
                row.planner,
                row.seeds(),
                row.best_seed,
                command.unwrap_or_else(|| "-".into())
            ]);
        }
        table
    }
    /// For a terminal.
    fn console(&self, title: &str, hash: &str) -> Vec<String> {
        let mut out = vec![
            format!("{title}, configuration {hash}; mean, in brackets the 95th percentile"),
            self.summary(false).text(),
        ];
        out.extend(self.remarks.iter().cloned());
        let overall = self.differences(|c| c.scenario.is_none());
        if !overall.is_empty() {
            out.push("paired differences, mean and 95 % interval".into());
            out.push(overall.text());
        }
        out.extend(self.failures.iter().cloned());
        if self.rows.len() <= MAX_ROWS_WITH_EXTREMES {
            out.push(self.extremes().text());
        }
        out
    }
    /// For Markdown and the page.
    fn document(&self, title: &str, hash: &str, seeds: &str, charts: Vec<Chart>) -> Document {
        let mut blocks = vec![Block::Text(format!(
            "Configuration {hash}, {seeds}. Rates with Wilson's 95 % interval; descents begun, and how many of them \
             ended at rest on the deck or were broken off without a contact; means, in brackets the 95th \
             percentile and what is published: of MPC-NE in the rows of mpc-ne, else of MPC-FAA (Procházka et \
             al.). In the charts, filled: mean with its 95 % bootstrap interval; open: 95th percentile; grey bar: \
             published."
        ))];
        if !self.remarks.is_empty() {
            blocks.push(Block::Items(self.remarks.clone()));
        }
        blocks.push(Block::Table(self.summary(true)));
        blocks.extend(self.charts().into_iter().chain(charts).map(Block::Chart));
        if !self.comparisons.is_empty() {
            blocks.push(Block::Heading("Paired differences".into()));
            blocks.push(Block::Text(
                "The planner minus the first one on the same scenario and seed: mean and 95 % bootstrap interval, \
                 red where it is worse beyond the interval, green where it is better."
                    .into(),
            ));
            blocks.push(Block::Table(self.differences(|_| true)));
        }
        blocks.push(Block::Heading("Worst and best trials".into()));
        blocks.push(Block::Text(
            "By the greatest fraction of a limit of success. Another seed in the command flies another trial.".into(),
        ));
        blocks.push(Block::Table(self.extremes()));
        if !self.failures.is_empty() {
            blocks.push(Block::Heading("Failures".into()));
            blocks.push(Block::Lines(self.failures.clone()));
        }
        Document {
            title: title.into(),
            blocks,
        }
    }
    /// Means with intervals, a chart for each metric.
    fn charts(&self) -> Vec<Chart> {
        let mut planners: Vec<&str> = self.rows.iter().map(|r| r.planner.as_str()).collect();
        planners.sort_unstable();
        planners.dedup();
        let chart = |(k, (name, _, caption, least, _)): (usize, &Shown)| {
            let dot = |row: &ReportRow| Dot {
                label: format!("{} · {}", row.scenario, row.planner),
                group: planners.iter().position(|p| *p == row.planner).unwrap_or(0),
                measured: row.summary.metric(name).map(|s| {
                    let interval = row.intervals.get(k).copied().flatten();
                    (s, interval.unwrap_or([s.mean; 2]))
                }),
                published: row.published.and_then(|p| p.metric(name)),
            };
            Chart {
                caption: (*caption).into(),
                svg: chart::dots(&self.rows.iter().map(dot).collect::<Vec<_>>(), *least),
            }
        };
        SHOWN.iter().enumerate().map(chart).collect()
    }
}
