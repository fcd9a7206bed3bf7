//! What a study says: a table, the JSON summary, Markdown, and the page.

use std::fmt::Write as _;
use std::path::PathBuf;

use alight_sim::harness::outcome::{MAX_CONTACT_MPS, MAX_TILT_ERROR_RAD, Outcome};
use alight_sim::studies::paired::{self, Comparison};
use alight_sim::studies::statistics::{METRICS, Summary, bootstrap_mean, wilson};
use alight_uav::planner::PlannerKind;
use serde_json::{Value, json};

use crate::exit::CliError;
use crate::lab::args::{Study, StudyArgs};
use crate::lab::study::flown::PlannerVariant;
use crate::lab::study::grid;
use crate::lab::study::grid::{TABLE2, TABLE2_FAILURES};
use crate::lab::study::report;
use crate::lab::study::report::{Page, ReportRow, Total};
use crate::lab::study::run;
use crate::lab::table;
use crate::terminal::note;

/// Failures that a report names with their reasons.
const MAX_FAILURES: usize = 12;
/// Worst trials that a report names per row.
const WORST_COUNT: usize = 3;
/// Position error that counts as the limits of speed and tilt do, m: half the deck's width less half
/// of the feet's span.
const POSITION_LIMIT_M: f64 = 0.65;

/// Best and worst of a row.
pub struct Extremes {
    /// Scenario.
    pub scenario: String,
    /// Planner.
    pub planner: String,
    /// Seeds, worst first.
    pub worst: Vec<u64>,
    /// The seed of the best.
    pub best: u64,
    /// Flies a trial again, without `--seed`; None where the study kept no scene.
    pub command: Option<String>,
}

/// Table, JSON, Markdown and page of a set of rows. `planners` in the order of the table, the one
/// that all others are compared with first; `charts` go into the page as they are.
pub fn publish(
    args: &StudyArgs,
    title: &str,
    hash: &str,
    planners: &[PlannerVariant],
    outcomes: &[Outcome],
    charts: Vec<(String, String)>,
) -> Result<Value, CliError> {
    let say = |line: &str| note(args.json, line);
    let mut keys: Vec<(&str, &str)> = Vec::new();
    for o in outcomes {
        if keys.last() != Some(&(o.sea.as_str(), o.planner.as_str())) {
            keys.push((&o.sea, &o.planner));
        }
    }
    let lines: Vec<ReportRow> = keys.iter().map(|(s, p)| line(outcomes, s, p)).collect();
    let comparisons = comparisons(planners, &keys, outcomes);
    let faa = faa_ratio(args, planners, outcomes);
    let extremes: Vec<Extremes> = keys
        .iter()
        .filter_map(|(s, p)| extremes(args, planners, outcomes, s, p))
        .collect();
    let page = Page {
        title: title.into(),
        hash: hash.into(),
        seeds: seeds_of(outcomes),
        totals: totals(planners, outcomes),
        lines,
        remarks: faa.iter().map(|f| f.text.clone()).collect(),
        comparisons,
        extremes,
        charts,
        failures: failures(outcomes),
    };
    for text in console(&page) {
        say(&text);
    }

    let mut values = Vec::new();
    for l in &page.lines {
        let mut value = table::summary_json(&l.summary);
        value.insert("scenario".into(), l.scenario.clone().into());
        value.insert("planner".into(), l.planner.clone().into());
        value.insert("configuration".into(), hash.into());
        if let Some([position, time, speed]) = l.published {
            let published = json!({
                "position_error_m": position, "landing_time_s": time, "touchdown_speed_mps": speed,
            });
            value.insert("published".into(), published);
        }
        if let Some(e) = page
            .extremes
            .iter()
            .find(|e| (&e.scenario, &e.planner) == (&l.scenario, &l.planner))
        {
            value.insert("worst_seeds".into(), json!(e.worst));
            value.insert("best_seed".into(), e.best.into());
        }
        if let Some(c) = page
            .comparisons
            .iter()
            .find(|c| c.scenario.as_ref() == Some(&l.scenario) && c.other == l.planner)
        {
            value.insert("against".into(), json!(c));
        }
        if let Some(f) = faa.as_ref().filter(|f| f.other == l.planner) {
            value.insert("tilt_error_p95_ratio".into(), f.value.clone());
        }
        values.push(Value::Object(value));
    }
    let value = Value::Array(values);
    if let Some(out) = &args.out {
        for (name, text) in [
            ("report.html", report::html(&page)),
            ("summary.md", markdown(&page)),
            ("summary.json", value.to_string()),
            ("paired.json", json!(page.comparisons).to_string()),
        ] {
            let path = out.join(name);
            std::fs::write(&path, text)
                .map_err(|e| CliError::because(format!("writing {}", path.display()), e))?;
        }
        say(&format!("written: {}", out.join("report.html").display()));
    }
    Ok(value)
}

fn line(outcomes: &[Outcome], scenario: &str, planner: &str) -> ReportRow {
    let set: Vec<Outcome> = outcomes
        .iter()
        .filter(|o| o.sea == scenario && o.planner == planner)
        .cloned()
        .collect();
    let intervals = METRICS
        .iter()
        .map(|(name, f)| {
            let values: Vec<f64> = set.iter().filter_map(f).collect();
            (*name, bootstrap_mean(&values))
        })
        .collect();
    ReportRow {
        scenario: scenario.into(),
        planner: planner.into(),
        summary: Summary::of(&set),
        intervals,
        published: grid::published(scenario, planner),
    }
}

fn seeds_of(outcomes: &[Outcome]) -> String {
    let seeds = || outcomes.iter().map(|o| o.seed);
    match (seeds().min(), seeds().max()) {
        (Some(a), Some(b)) => format!("seeds {a} to {b}"),
        _ => "no trials".into(),
    }
}

/// Each planner over all scenarios.
fn totals(planners: &[PlannerVariant], outcomes: &[Outcome]) -> Vec<Total> {
    let all_of_table2 = TABLE2
        .iter()
        .all(|(name, ..)| outcomes.iter().any(|o| o.sea == *name));
    planners
        .iter()
        .filter_map(|p| {
            let set: Vec<Outcome> = outcomes.iter().filter(|o| o.planner == p.name).cloned().collect();
            let ([faa, ne], of) = TABLE2_FAILURES;
            let failures = match p.kind {
                PlannerKind::MpcFaa => Some(faa),
                PlannerKind::MpcNe => Some(ne),
                PlannerKind::Mpc
                | PlannerKind::Alight
                | PlannerKind::WaitCalm
                | PlannerKind::PrecisionLand
                | PlannerKind::GnssRadio => None,
            };
            (!set.is_empty()).then(|| Total {
                planner: p.name.clone(),
                summary: Summary::of(&set),
                published: failures
                    .filter(|_| all_of_table2)
                    .map(|f| format!("{}/{of}", of - f)),
            })
        })
        .collect()
}

/// The first planner against each other one: scenario by scenario, and over all.
fn comparisons(planners: &[PlannerVariant], keys: &[(&str, &str)], outcomes: &[Outcome]) -> Vec<Comparison> {
    let Some((first, others)) = planners.split_first() else {
        return Vec::new();
    };
    let mut scenarios: Vec<Option<&str>> = vec![None];
    for (scenario, _) in keys {
        if !scenarios.contains(&Some(scenario)) {
            scenarios.push(Some(scenario));
        }
    }
    others
        .iter()
        .flat_map(|other| {
            scenarios
                .iter()
                .filter_map(|s| paired::compare(outcomes, *s, &first.name, &other.name))
        })
        .collect()
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

/// The share of a limit of success that the worst of a trial's figures takes; failures above all.
fn worst_limit_fraction(o: &Outcome) -> f64 {
    let fraction = |value: Option<f64>, limit: f64| value.map_or(f64::INFINITY, |v| v / limit);
    let most = fraction(o.position_error_m, POSITION_LIMIT_M)
        .max(fraction(o.touchdown_speed_mps, MAX_CONTACT_MPS))
        .max(fraction(o.tangential_speed_mps, MAX_CONTACT_MPS))
        .max(fraction(o.tilt_error_deg, MAX_TILT_ERROR_RAD.to_degrees()));
    most + if o.success { 0.0 } else { 1e6 }
}

fn extremes(
    args: &StudyArgs,
    planners: &[PlannerVariant],
    outcomes: &[Outcome],
    scenario: &str,
    planner: &str,
) -> Option<Extremes> {
    let mut set: Vec<&Outcome> = outcomes
        .iter()
        .filter(|o| o.sea == scenario && o.planner == planner)
        .collect();
    set.sort_by(|a, b| {
        worst_limit_fraction(b)
            .total_cmp(&worst_limit_fraction(a))
            .then(a.seed.cmp(&b.seed))
    });
    let kind = planners.iter().find(|p| p.name == planner).map(|p| p.kind);
    let command = args.out.as_ref().zip(kind).and_then(|(out, kind)| {
        let scene = run::scenario_file(out, scenario);
        let there = |path: &PathBuf| path.exists();
        let mut command = format!(
            "alight trial --scenario '{}'",
            there(&scene).then(|| scene.display())?
        );
        for (flag, path) in ["vessel", "drone"]
            .iter()
            .zip(run::config_files(out, scenario, planner))
        {
            if there(&path) {
                let _ = write!(command, " --{flag}-config '{}'", path.display());
            }
        }
        let _ = write!(command, " --planner {}", kind.name());
        Some(command)
    });
    Some(Extremes {
        scenario: scenario.into(),
        planner: planner.into(),
        worst: set.iter().take(WORST_COUNT).map(|o| o.seed).collect(),
        best: set.last()?.seed,
        command,
    })
}

/// Failures with their reasons, a bounded number.
fn failures(outcomes: &[Outcome]) -> Vec<String> {
    let all: Vec<&Outcome> = outcomes.iter().filter(|o| !o.success).collect();
    let mut lines: Vec<String> = all
        .iter()
        .take(MAX_FAILURES)
        .map(|o| {
            format!(
                "{} {} seed {}: {} ({})",
                o.sea,
                o.planner,
                o.seed,
                o.outcome.name(),
                o.reason
            )
        })
        .collect();
    if all.len() > MAX_FAILURES {
        lines.push(format!(
            "and {} more failures in rows.csv",
            all.len() - MAX_FAILURES
        ));
    }
    lines
}

/// The table of a terminal.
fn console(page: &Page) -> Vec<String> {
    let widest = |f: &dyn Fn(&ReportRow) -> usize, most: usize| {
        page.lines.iter().map(f).max().unwrap_or(0).clamp(8, most) + 1
    };
    let (a, b) = (
        widest(&|l| l.scenario.chars().count(), 28),
        widest(&|l| l.planner.chars().count(), 34),
    );
    let short = |text: &str, width: usize| text.chars().take(width - 1).collect::<String>();
    let mut out = vec![
        format!("{}, configuration {}", page.title, page.hash),
        format!(
            "{:<a$}{:<b$}{:>9}{:>5}{:>4}{:>4} {:>6}{:>6} {:>5}{:>5}{:>5} {:>5}{:>5} {:>6}",
            "scenario",
            "planner",
            "landed",
            "uns",
            "h2o",
            ">2",
            "pos m",
            "p95",
            "m/s",
            "p95",
            "tang",
            "tilt",
            "p95",
            "land s"
        ),
    ];
    for l in &page.lines {
        let s = &l.summary;
        let f = |name: &str| s.metric(name).unwrap_or_default();
        out.push(format!(
            "{:<a$}{:<b$}{:>9}{:>5}{:>4}{:>4} {:>6.3}{:>6.3} {:>5.2}{:>5.2}{:>5.2} {:>5.2}{:>5.2} {:>6.1}",
            short(&l.scenario, a),
            short(&l.planner, b),
            format!("{}/{}", s.successes, s.trials),
            s.unsafe_contacts,
            s.water_contacts,
            s.contacts_above_2_mps,
            f("position_error_m").mean,
            f("position_error_m").p95,
            f("touchdown_speed_mps").mean,
            f("touchdown_speed_mps").p95,
            f("tangential_speed_mps").p95,
            f("tilt_error_deg").mean,
            f("tilt_error_deg").p95,
            f("landing_time_s").mean,
        ));
    }
    if page.lines.len() > page.totals.len() {
        out.extend(page.totals.iter().map(total));
    }
    for c in page.comparisons.iter().filter(|c| c.scenario.is_none()) {
        out.push(format!(
            "{} minus {}, {} pairs of the same scenario and seed (95 % interval)",
            c.other, c.first, c.pairs
        ));
        let r = &c.rates;
        out.push(format!(
            "  {:<24}{:>8.1} % ({:.1} to {:.1}); only {} {}, only {} {}",
            "landed",
            100.0 * r.difference,
            100.0 * r.interval[0],
            100.0 * r.interval[1],
            c.first,
            r.only[0],
            c.other,
            r.only[1],
        ));
        for d in &c.differences {
            out.push(format!(
                "  {:<24}{:>+8.3}   ({:+.3} to {:+.3})",
                d.metric, d.mean, d.interval[0], d.interval[1]
            ));
        }
    }
    out.extend(page.remarks.iter().cloned());
    out.extend(page.failures.iter().cloned());
    for e in page.extremes.iter().filter(|_| page.extremes.len() <= 20) {
        let command = e.command.as_deref().unwrap_or_default();
        out.push(format!(
            "{} {}: worst seeds {}, best {}  {command}",
            e.scenario,
            e.planner,
            seed_list(&e.worst),
            e.best
        ));
    }
    out
}

/// `1, 2, 3`.
pub fn seed_list(seeds: &[u64]) -> String {
    let texts: Vec<String> = seeds.iter().map(u64::to_string).collect();
    texts.join(", ")
}

/// A planner over all scenarios, in words.
pub fn total(t: &Total) -> String {
    let s = &t.summary;
    let (lo, hi) = wilson(s.successes, s.trials);
    let published = t
        .published
        .as_ref()
        .map_or_else(String::new, |p| format!(" (published {p})"));
    format!(
        "{} over all: {}/{} landed{published}, 95 % interval {:.2} to {:.2} %; {} unsafe contacts, {} with water, {} above 2 m/s",
        t.planner,
        s.successes,
        s.trials,
        100.0 * lo,
        100.0 * hi,
        s.unsafe_contacts,
        s.water_contacts,
        s.contacts_above_2_mps
    )
}

fn markdown(page: &Page) -> String {
    let mut out = format!(
        "# {}\n\nConfiguration `{}`, {}.\nRates with Wilson's 95 % interval. Published: of MPC-NE in the rows \
         of mpc-ne, else of\nMPC-FAA (Procházka et al.).\n\n",
        page.title, page.hash, page.seeds,
    );
    // Two tables, each of them readable as text, too.
    out.push_str(
        "| scenario | planner | landed | 95 % | unsafe | water | > 2 m/s |\n|---|---|---|---|---|---|---|\n",
    );
    for l in &page.lines {
        let s = &l.summary;
        let (lo, hi) = wilson(s.successes, s.trials);
        let _ = writeln!(
            out,
            "| {} | {} | {}/{} | {:.1}-{:.1} % | {} | {} | {} |",
            l.scenario,
            l.planner,
            s.successes,
            s.trials,
            100.0 * lo,
            100.0 * hi,
            s.unsafe_contacts,
            s.water_contacts,
            s.contacts_above_2_mps,
        );
    }
    let _ = write!(
        out,
        "\nMeans, in brackets the 95th percentile; after a slash what is published.\n\n\
         | scenario | planner | position m | normal m/s | tang. p95 | tilt deg | landing s | over deck s |\n\
         |{}\n",
        "---|".repeat(8),
    );
    for l in &page.lines {
        let f = |name: &str| l.summary.metric(name).unwrap_or_default();
        let known = |i: usize| {
            l.published
                .and_then(|p| p.get(i).copied())
                .map_or_else(String::new, |v| format!(" / {v}"))
        };
        let _ = writeln!(
            out,
            "| {} | {} | {:.3} ({:.3}){} | {:.2} ({:.2}){} | {:.2} | {:.2} ({:.2}) | {:.1}{} | {:.1} |",
            l.scenario,
            l.planner,
            f("position_error_m").mean,
            f("position_error_m").p95,
            known(0),
            f("touchdown_speed_mps").mean,
            f("touchdown_speed_mps").p95,
            known(2),
            f("tangential_speed_mps").p95,
            f("tilt_error_deg").mean,
            f("tilt_error_deg").p95,
            f("landing_time_s").mean,
            known(1),
            f("over_deck_time_s").mean,
        );
    }
    out.push('\n');
    for t in &page.totals {
        let _ = writeln!(out, "- {}", total(t));
    }
    for r in &page.remarks {
        let _ = writeln!(out, "- {r}");
    }
    if !page.comparisons.is_empty() {
        let _ = write!(
            out,
            "\n## Paired differences\n\nThe planner minus the first one on the same scenario and seed, mean and \
             95 % bootstrap interval.\n\n| scenario | planner | pairs | landed % |{}\n|---|---|---|---|{}\n",
            paired::COMPARED
                .iter()
                .map(|(name, _)| format!(" {name} |"))
                .collect::<String>(),
            "---|".repeat(paired::COMPARED.len()),
        );
    }
    for c in &page.comparisons {
        let r = &c.rates;
        let _ = write!(
            out,
            "| {} | {} minus {} | {} | {:+.1} ({:+.1} to {:+.1}) |",
            c.scenario.as_deref().unwrap_or("all"),
            c.other,
            c.first,
            c.pairs,
            100.0 * r.difference,
            100.0 * r.interval[0],
            100.0 * r.interval[1]
        );
        for (name, _) in paired::COMPARED {
            let _ = match c.differences.iter().find(|d| d.metric == name) {
                Some(d) => write!(
                    out,
                    " {:+.3} ({:+.3} to {:+.3}) |",
                    d.mean, d.interval[0], d.interval[1]
                ),
                None => write!(out, " - |"),
            };
        }
        out.push('\n');
    }
    out.push_str(
        "\n## Worst and best\n\nBy the greatest share of a limit of success; add `--seed` to the command.\n\n\
         | scenario | planner | worst seeds | best seed | command |\n|---|---|---|---|---|\n",
    );
    for e in &page.extremes {
        let command = e
            .command
            .as_ref()
            .map_or_else(|| "-".into(), |c| format!("`{c}`"));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {command} |",
            e.scenario,
            e.planner,
            seed_list(&e.worst),
            e.best
        );
    }
    if !page.failures.is_empty() {
        let _ = write!(out, "\n## Failures\n\n```\n{}\n```\n", page.failures.join("\n"));
    }
    out
}
