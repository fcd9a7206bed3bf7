//! Report of a grid study: on the terminal, as JSON, as Markdown and as a page.

use std::path::{Path, PathBuf};

use alight_computer::cells;
use alight_computer::exit::CliError;
use alight_computer::table::{Cell, Table};
use alight_computer::terminal::{note, wrapped};
use alight_sim::harness::outcome::{MAX_CONTACT_MPS, MAX_TILT_ERROR_RAD, Outcome};
use alight_sim::studies::paired::{self, COMPARED, Comparison};
use alight_sim::studies::statistics::{METRICS, Summary, bootstrap_mean, wilson};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::benchmark;
use super::definition::{Definition, PublishedResult};
use super::pooled;
use super::rows::{Rows, StudyRow};
use super::run;
use crate::args::StudyArgs;
use crate::chart::{self, Dot};
use crate::outcome_table::summary_json;
use crate::report::document::{Block, Chart, Document, write_files};
use crate::scene::written;

const MAX_FAILURES: usize = 12;
const WORST_COUNT: usize = 3;
/// Maximum number of rows for which the terminal shows worst and best trials.
const MAX_ROWS_WITH_EXTREMES: usize = 20;
/// Position error equivalent to the limits of speed and tilt, m: half the deck's width minus half of the feet's span.
const POSITION_LIMIT_M: f64 = 0.65;

/// Metric of the report: name, column, chart caption, minimum end of the chart's axis, and decimals.
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

#[derive(Serialize)]
struct ReportRow {
    scenario: String,
    planner: String,
    #[serde(flatten)]
    summary_values: Map<String, Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    published: Option<PublishedResult>,
    /// Worst first, by the fraction of a success limit.
    worst_seeds: Vec<u64>,
    best_seed: u64,
    #[serde(skip)]
    summary: Summary,
    /// 95 % bootstrap interval of the mean of each metric in [`SHOWN`].
    #[serde(skip)]
    intervals: Vec<Option<[f64; 2]>>,
    /// Replay command of a trial, without `--seed`; None if the study kept no scene.
    #[serde(skip)]
    command: Option<String>,
}

impl ReportRow {
    fn new(args: &StudyArgs, study: &Study<'_>, set: &[&Outcome]) -> Option<ReportRow> {
        let first = set.first()?;
        let (scenario, planner) = (first.sea.clone(), first.planner.clone());
        let rows = &study.rows.rows;
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
            published: rows.iter().find(|r| r.scenario == scenario).and_then(|r| {
                let known = &r.published;
                known.get(&planner).or(known.get(&study.definition.beat)).copied()
            }),
            command: (args.out.as_ref())
                .zip(rows.iter().find(|r| r.is_of(first)))
                .and_then(|(out, row)| replay_command(out, row)),
            intervals: SHOWN.iter().map(interval).collect(),
            summary_values: summary_json(&summary),
            worst_seeds: seeds.iter().take(others).copied().collect(),
            best_seed: *seeds.last()?,
            scenario,
            planner,
            summary,
        })
    }
    fn replay_of_worst(&self) -> Option<String> {
        let seed = self.worst_seeds.first()?;
        Some(format!("{} --seed {seed}", self.command.as_ref()?))
    }
    fn seeds(&self) -> String {
        let worst: Vec<String> = self.worst_seeds.iter().map(u64::to_string).collect();
        worst.join(", ")
    }
}

/// Largest fraction of a success limit that a trial reaches; failures rank above all successes.
fn worst_limit_fraction(o: &Outcome) -> f64 {
    let fraction = |value: Option<f64>, limit: f64| value.map_or(f64::INFINITY, |v| v / limit);
    let worst = fraction(o.position_error_m, POSITION_LIMIT_M)
        .max(fraction(o.touchdown_speed_mps, MAX_CONTACT_MPS))
        .max(fraction(o.tangential_speed_mps, MAX_CONTACT_MPS))
        .max(fraction(o.tilt_error_deg, MAX_TILT_ERROR_RAD.to_degrees()));
    worst + if o.success { 0.0 } else { 1e6 }
}

/// Replay command of a row's trials, with the files that the study keeps.
pub fn replay_command(out: &Path, row: &StudyRow) -> Option<String> {
    let flag = |name: &str, path: PathBuf| path.exists().then(|| format!(" --{name} '{}'", path.display()));
    let scene = flag("scenario", run::scenario_file(out, &row.scenario))?;
    let [vessel, drone, tuning] = run::config_files(out, row);
    Some(format!(
        "alight trial{scene}{}{}{} {}",
        flag("vessel-config", vessel).unwrap_or_default(),
        flag("drone-config", drone).unwrap_or_default(),
        flag("tuning", tuning).unwrap_or_default(),
        written("planner", row.kind())
    ))
}

pub struct Study<'a> {
    pub title: &'a str,
    pub program: &'a str,
    pub definition: &'a Definition,
    pub rows: &'a Rows,
    pub hash: &'a str,
    pub outcomes: &'a [Outcome],
}

impl Study<'_> {
    fn planners(&self) -> Vec<&str> {
        let mut all: Vec<&str> = Vec::new();
        let rows = self.rows.rows.iter().map(|r| r.planner.as_str());
        for name in rows.chain(self.outcomes.iter().map(|o| o.planner.as_str())) {
            if !all.contains(&name) && self.outcomes.iter().any(|o| o.planner == name) {
                all.push(name);
            }
        }
        all
    }
}

struct Report {
    rows: Vec<ReportRow>,
    /// Results of each planner over all scenarios, and further results.
    remarks: Vec<String>,
    /// Comparisons of the first planner with every other planner: over all scenarios, then by scenario.
    comparisons: Vec<Comparison>,
    failures: Vec<String>,
}

#[derive(Serialize)]
struct PrintedRow<'a> {
    #[serde(flatten)]
    row: &'a ReportRow,
    configuration: &'a str,
    /// Comparison of the first planner with this row's.
    #[serde(skip_serializing_if = "Option::is_none")]
    against: Option<&'a Comparison>,
}

pub fn publish(args: &StudyArgs, study: &Study<'_>) -> Result<(), CliError> {
    let outcomes: Vec<&Outcome> = study.outcomes.iter().collect();
    let rows: Vec<ReportRow> = outcomes
        .chunk_by(|a, b| (&a.sea, &a.planner) == (&b.sea, &b.planner))
        .filter_map(|set| ReportRow::new(args, study, set))
        .collect();
    let planners = study.planners();
    let report = Report {
        comparisons: comparisons(&planners, &rows, study.outcomes),
        failures: failures(study.outcomes),
        remarks: totals(study, &planners, rows.len()),
        rows,
    };
    let (title, hash) = (study.title, study.hash);
    let printed = report.printed(hash);
    let mut value = json!(printed);
    let pooled = if let Some(version) = study.definition.version {
        let scores = benchmark::scores(study.rows, &planners, study.outcomes);
        value = benchmark::json(&scores, study.outcomes);
        value["benchmark"] = json!(version);
        value["program"] = json!(study.program);
        value["configuration"] = json!(hash);
        note(args.form.alone(), title);
        Some(benchmark::table(&scores))
    } else {
        for text in report.console(title, hash) {
            note(args.form.alone(), text);
        }
        study.definition.pooled_by.as_ref().map(|by| {
            let pools = pooled::of(study.rows, &planners, study.outcomes);
            let json: Vec<Value> = pools.iter().map(pooled::Pool::json).collect();
            value = json!({ "rows": value, "pooled": json });
            pooled::table(by, &pools)
        })
    };
    if let Some(table) = &pooled {
        note(args.form.alone(), table.text());
    }
    if let Some(out) = &args.out {
        let comparisons = json!(report.comparisons).to_string();
        let curves = pooled::curves(&study.rows.curves, &planners, study.outcomes)?;
        if !curves.is_empty() {
            write_files(out, &[("curves.svg", chart::sheet(&curves))])?;
        }
        let document = report.document(study, pooled, curves)?;
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
            args.form.alone(),
            format_args!("written: {}", out.join("report.html").display()),
        );
    }
    match value["scores"].as_array() {
        Some(scores) => args.form.print(&value, scores)?,
        None => args.form.print(&value, &printed)?,
    };
    Ok(())
}

fn seeds_of(outcomes: &[Outcome]) -> String {
    let seeds = || outcomes.iter().map(|o| o.seed);
    match (seeds().min(), seeds().max()) {
        (Some(a), Some(b)) => format!("seeds {a} to {b}"),
        _ => "no trials".into(),
    }
}

/// Results of each planner over all scenarios; empty for a single scenario.
fn totals(study: &Study<'_>, planners: &[&str], rows: usize) -> Vec<String> {
    if rows <= planners.len() {
        return Vec::new();
    }
    let total = |planner: &&str| {
        let of = study.outcomes.iter().filter(|o| o.planner == *planner);
        let s = Summary::of(&of.cloned().collect::<Vec<_>>());
        let published = &study.definition.published_landed;
        let published = published.get(*planner).filter(|_| study.rows.whole);
        let published = published.map_or_else(String::new, |[n, of]| format!(" (published {n}/{of})"));
        let (lo, hi) = wilson(s.successes, s.trials);
        format!(
            "{planner} over all: {}/{} landed{published}, 95 % interval {:.2} to {:.2} %; {} unsafe contacts, {} with \
             water, {} above 2 m/s",
            s.successes,
            s.trials,
            100.0 * lo,
            100.0 * hi,
            s.unsafe_contacts,
            s.water_contacts,
            s.contacts_above_2_mps
        )
    };
    planners.iter().map(total).collect()
}

/// Compares the first planner with every other planner: over all scenarios, then by scenario.
fn comparisons(planners: &[&str], rows: &[ReportRow], outcomes: &[Outcome]) -> Vec<Comparison> {
    let Some((first, others)) = planners.split_first() else {
        return Vec::new();
    };
    let mut scenarios: Vec<Option<&str>> = vec![None];
    for row in rows {
        if !scenarios.contains(&Some(&row.scenario)) {
            scenarios.push(Some(&row.scenario));
        }
    }
    let compare = |other: &&str| {
        scenarios
            .iter()
            .filter_map(|s| paired::compare(outcomes, *s, first, other))
            .collect::<Vec<_>>()
    };
    others.iter().flat_map(compare).collect()
}

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
    /// Rows in machine-readable form; `hash` is that of the configuration.
    fn printed<'a>(&'a self, hash: &'a str) -> Vec<PrintedRow<'a>> {
        let printed = |row: &'a ReportRow| {
            let is_row =
                |c: &&Comparison| c.scenario.as_ref() == Some(&row.scenario) && c.other == row.planner;
            PrintedRow {
                row,
                configuration: hash,
                against: self.comparisons.iter().find(is_row),
            }
        };
        self.rows.iter().map(printed).collect()
    }
    /// Table of the rows: with intervals, published values and all metrics if `full`, otherwise as wide as a
    /// terminal.
    fn summary(&self, full: bool) -> Table {
        let metrics = || SHOWN.iter().filter(|s| full || s.0 != "tangential_speed_mps");
        let mut heads = vec!["scenario", "planner", "landed"];
        heads.extend(full.then_some("95 %"));
        heads.extend(["descents well", "unsafe contacts", "water", "> 2 m/s"]);
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
    /// Paired differences: better or worse if the interval excludes zero. Lower values are better, except for the
    /// landing rate.
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
    /// Worst and best seeds; the fifth column is the command that replays the worst.
    fn extremes(&self, columns: usize) -> Table {
        let heads = [
            "scenario",
            "planner",
            "worst seeds",
            "best seed",
            "replay of the worst",
        ];
        let mut table = Table::new(3..4, heads.into_iter().take(columns));
        for row in &self.rows {
            let replay = row.replay_of_worst().unwrap_or_else(|| "-".into());
            let cells = cells![row.scenario, row.planner, row.seeds(), row.best_seed, replay];
            table.row(cells.into_iter().take(columns));
        }
        table
    }
    fn console(&self, title: &str, hash: &str) -> Vec<String> {
        let mut out = vec![
            wrapped(&format!("{title}, configuration {hash}; mean (95th percentile)")),
            self.summary(false).text(),
        ];
        out.extend(self.remarks.iter().map(|text| wrapped(text)));
        let overall = self.differences(|c| c.scenario.is_none());
        if !overall.is_empty() {
            out.push("paired differences, mean and 95 % interval".into());
            out.push(overall.text());
        }
        out.extend(self.failures.iter().map(|text| wrapped(text)));
        if self.rows.len() <= MAX_ROWS_WITH_EXTREMES {
            out.push(self.extremes(4).text());
            out.extend(self.rows.iter().filter_map(ReportRow::replay_of_worst));
        }
        out
    }
    fn document(
        &self,
        study: &Study<'_>,
        pooled: Option<Table>,
        curves: Vec<Chart>,
    ) -> Result<Document, CliError> {
        let (hash, seeds) = (study.hash, seeds_of(study.outcomes));
        let mut blocks = vec![Block::Text(format!(
            "Configuration {hash}, {seeds}. Rates with Wilson's 95 % interval; descents begun, and how many of them \
             ended at rest on the deck or were broken off without a contact; means, in brackets the 95th \
             percentile and the published value of the planner, otherwise of the one to beat. In the charts, filled: mean with its 95 % bootstrap interval; open: 95th percentile; grey bar: \
             published."
        ))];
        if !self.remarks.is_empty() {
            blocks.push(Block::Items(self.remarks.clone()));
        }
        blocks.push(Block::Table(self.summary(true)));
        blocks.extend(pooled.map(Block::Table));
        blocks.extend(self.charts()?.into_iter().chain(curves).map(Block::Chart));
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
            "By the largest fraction of a limit of success. Another seed in the command flies another trial."
                .into(),
        ));
        blocks.push(Block::Table(self.extremes(5)));
        if !self.failures.is_empty() {
            blocks.push(Block::Heading("Failures".into()));
            blocks.push(Block::Lines(self.failures.clone()));
        }
        Ok(Document {
            title: study.title.into(),
            blocks,
        })
    }
    fn charts(&self) -> Result<Vec<Chart>, CliError> {
        let mut planners: Vec<&str> = self.rows.iter().map(|r| r.planner.as_str()).collect();
        planners.sort_unstable();
        planners.dedup();
        let chart = |(k, (name, _, caption, min_side, _)): (usize, &Shown)| {
            let dot = |row: &ReportRow| Dot {
                label: format!("{} · {}", row.scenario, row.planner),
                group: planners.iter().position(|p| *p == row.planner).unwrap_or(0),
                measured: row.summary.metric(name).map(|s| {
                    let interval = row.intervals.get(k).copied().flatten();
                    (s, interval.unwrap_or([s.mean; 2]))
                }),
                published: row.published.and_then(|p| p.metric(name)),
            };
            let lines: Vec<Dot> = self.rows.iter().map(dot).collect();
            chart::dots(caption, &lines, *min_side)
        };
        SHOWN.iter().enumerate().map(chart).collect()
    }
}
