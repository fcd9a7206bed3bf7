//! Runs a grid of scenes and planners: resumable, sharded, every trial a row in a CSV.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use alight_sim::outcome::Outcome;
use alight_sim::scenario::NodeConfigs;
use alight_sim::statistics::{FIGURES, Summary, bootstrap_mean, wilson};
use alight_sim::trial::{Watch, fly};
use alight_uav::planner::PlannerKind;
use indicatif::ParallelProgressIterator;
use rayon::prelude::*;
use serde_json::Value;

use super::grid::Row;
use super::report::{self, Line};
use crate::Refused;
use crate::args::StudyArgs;
use crate::configs::DroneFile;
use crate::say::note;
use crate::scene::stopwatch;
use crate::table;
use crate::trials::{bar, pool, seeds};

/// Worst trials that a report names.
const WORST: usize = 12;

/// Hash of the nodes' configuration, the planner's kind left out: the same for all rows of a table.
pub fn configuration_hash(nodes: &NodeConfigs) -> String {
    let mut drone = DroneFile {
        bridge: nodes.bridge.clone(),
        drone: nodes.drone.clone(),
    };
    drone.drone.planner.kind = PlannerKind::default();
    let text = [toml::to_string(&nodes.vessel), toml::to_string(&drone)]
        .map(Result::unwrap_or_default)
        .concat();
    // FNV-1a.
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
        (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("{hash:016x}")
}

/// Part `index` of `count`.
#[derive(Clone, Copy, Debug)]
pub struct Shard {
    /// From 1 on.
    pub index: u64,
    /// How many.
    pub count: u64,
}

impl std::str::FromStr for Shard {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is no shard: give I/N with 1 <= I <= N <= 100000, e.g. 2/8");
        let (i, n) = text.split_once('/').ok_or_else(wrong)?;
        let (index, count) = (i.parse().map_err(|_| wrong())?, n.parse().map_err(|_| wrong())?);
        if !(1..=100_000).contains(&count) || !(1..=count).contains(&index) {
            return Err(wrong());
        }
        Ok(Shard { index, count })
    }
}

fn rows_file(out: &Path) -> PathBuf {
    out.join("rows.csv")
}

/// The rows that `dir` already holds.
pub fn read_rows(dir: &Path) -> Result<Vec<Outcome>, Refused> {
    let path = rows_file(dir);
    let reading = |e: csv::Error| Refused::because(format!("reading the rows {}", path.display()), e);
    let mut reader = csv::Reader::from_path(&path).map_err(reading)?;
    reader.deserialize().map(|r| r.map_err(reading)).collect()
}

/// One file per scenario, so that a trial can be flown again.
fn write_scenarios(out: &Path, rows: &[Row]) -> Result<(), Refused> {
    let dir = out.join("scenarios");
    let doing = || format!("writing the scenarios into {}", dir.display());
    std::fs::create_dir_all(&dir).map_err(|e| Refused::because(doing(), e))?;
    for row in rows {
        let text = toml::to_string(&row.world).map_err(|e| Refused::because(doing(), e))?;
        std::fs::write(dir.join(file_name(&row.name)), text).map_err(|e| Refused::because(doing(), e))?;
    }
    Ok(())
}

fn file_name(scenario: &str) -> String {
    let safe: String = scenario
        .chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() || c == '.' {
                c
            } else {
                '-'
            }
        })
        .collect();
    format!("{safe}.toml")
}

/// Flies what is not flown yet; all rows in the order of scenario, planner and seed.
pub fn fly_grid(args: &StudyArgs, rows: &[Row], planners: &[PlannerKind]) -> Result<Vec<Outcome>, Refused> {
    let seeds = seeds(args.seed0, args.trials)?;
    let mut done = Vec::new();
    if let Some(out) = &args.out {
        write_scenarios(out, rows)?;
        if rows_file(out).exists() {
            done = read_rows(out)?;
        }
    }
    let known: BTreeSet<(String, String, u64)> = done
        .iter()
        .map(|o| (o.sea.clone(), o.planner.clone(), o.seed))
        .collect();
    let mut work = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        for &kind in planners {
            for &seed in &seeds {
                work.push((i, row, kind, seed));
            }
        }
    }
    let wanted: BTreeSet<(String, String, u64)> = work
        .iter()
        .map(|(_, r, k, s)| (r.name.clone(), k.name().to_string(), *s))
        .collect();
    let mut number = 0;
    work.retain(|(_, row, kind, seed)| {
        number += 1;
        args.shard.is_none_or(|s| (number - 1) % s.count == s.index - 1)
            && !known.contains(&(row.name.clone(), kind.name().to_string(), *seed))
    });
    let writer = match &args.out {
        Some(out) => {
            let path = rows_file(out);
            let fresh = !path.exists();
            let file = OpenOptions::new()
                .create(true)
                .append(true)
                .open(&path)
                .map_err(|e| Refused::because(format!("writing the rows {}", path.display()), e))?;
            Some(Mutex::new(
                csv::WriterBuilder::new().has_headers(fresh).from_writer(file),
            ))
        }
        None => None,
    };
    let progress = bar(work.len() as u64, "trials");
    let flown: Result<Vec<Outcome>, Refused> = pool(args.jobs)?.install(|| {
        work.par_iter()
            .progress_with(progress.clone())
            .map(|(_, row, kind, seed)| {
                let mut nodes = row.nodes.clone();
                nodes.drone.planner.kind = *kind;
                let elapsed = stopwatch();
                let mut quiet = |_: &_| {};
                let watch = Watch {
                    on_event: &mut quiet,
                    trace_step_s: None,
                };
                let flight = fly(&row.world, &nodes, *seed, &row.name, watch)
                    .map_err(|e| Refused::because(format!("setting up `{}`, seed {seed}", row.name), e))?;
                let outcome = Outcome {
                    wall_time_s: elapsed(),
                    ..flight.outcome
                };
                if let Some(Ok(mut writer)) = writer.as_ref().map(Mutex::lock) {
                    writer
                        .serialize(&outcome)
                        .and_then(|()| writer.flush().map_err(Into::into))
                        .map_err(|e| Refused::because("writing a row", e))?;
                }
                Ok(outcome)
            })
            .collect()
    });
    progress.finish_and_clear();
    done.extend(flown?);
    done.retain(|o| wanted.contains(&(o.sea.clone(), o.planner.clone(), o.seed)));
    let order = |o: &Outcome| {
        let scenario = rows.iter().position(|r| r.name == o.sea).unwrap_or(usize::MAX);
        let planner = planners
            .iter()
            .position(|p| p.name() == o.planner)
            .unwrap_or(usize::MAX);
        (scenario, planner, o.seed)
    };
    done.sort_by_key(order);
    #[cfg(feature = "record")]
    if let Some(out) = &args.out {
        record_failed(args, out, (rows, planners), &done)?;
    }
    Ok(done)
}

/// Failed trials that are flown again and recorded.
#[cfg(feature = "record")]
const RECORDED: usize = 5;

/// Flies the first failed trials again, with a recording of each.
#[cfg(feature = "record")]
fn record_failed(
    args: &StudyArgs,
    out: &Path,
    (rows, planners): (&[Row], &[PlannerKind]),
    done: &[Outcome],
) -> Result<(), Refused> {
    let dir = out.join("failed");
    for o in done.iter().filter(|o| !o.success).take(RECORDED) {
        let Some(row) = rows.iter().find(|r| r.name == o.sea) else {
            continue;
        };
        let Some(&kind) = planners.iter().find(|k| k.name() == o.planner) else {
            continue;
        };
        let name = file_name(&format!("{} {}", o.sea, o.planner)).replace(".toml", "");
        let path = dir.join(format!("{name}-{}.mcap", o.seed));
        if path.exists() {
            continue;
        }
        std::fs::create_dir_all(&dir)
            .map_err(|e| Refused::because(format!("making {}", dir.display()), e))?;
        let mut nodes = row.nodes.clone();
        nodes.drone.planner.kind = kind;
        let subject = crate::record::Subject {
            scenario: &row.world,
            nodes: &nodes,
            seed: o.seed,
            sea: &row.name,
            boots: crate::record::LOCK_STEP_BOOTS,
        };
        let watch = Watch {
            on_event: &mut |_| {},
            trace_step_s: None,
        };
        crate::record::fly(&path, &subject, watch)?;
        note(args.json, format_args!("recorded: {}", path.display()));
    }
    Ok(())
}

/// Table, JSON, Markdown and page of a set of rows.
pub fn publish(
    args: &StudyArgs,
    title: &str,
    hash: &str,
    rows: &[Row],
    outcomes: &[Outcome],
) -> Result<Value, Refused> {
    let say = |line: &str| note(args.json, line);
    let mut keys: Vec<(&str, &str)> = Vec::new();
    for o in outcomes {
        if keys.last() != Some(&(o.sea.as_str(), o.planner.as_str())) {
            keys.push((&o.sea, &o.planner));
        }
    }
    say(&format!("{title}, configuration {hash}"));
    let head = format!(
        "{:<26}{:<14}{:>9}{:>5} {:>6}{:>6} {:>5}{:>5}{:>5} {:>5}{:>5} {:>6}",
        "scenario", "planner", "landed", "uns", "pos m", "p95", "m/s", "p95", "tang", "tilt", "p95", "land s"
    );
    say(&head);
    let mut markdown = format!(
        "# {title}\n\nConfiguration `{hash}`, seeds {} to {}.\n\n\
         | scenario | planner | landed | 95 % | unsafe | position m (p95) | published | normal m/s (p95) | tangential p95 | \
         tilt deg (p95) | landing s | published | over deck s |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        args.seed0,
        args.seed0 + u64::from(args.trials) - 1,
    );
    let (mut lines, mut values) = (Vec::new(), Vec::new());
    for (scenario, planner) in keys {
        let set: Vec<Outcome> = outcomes
            .iter()
            .filter(|o| o.sea == scenario && o.planner == planner)
            .cloned()
            .collect();
        let s = Summary::of(&set);
        let f = |name: &str| s.figure(name).unwrap_or_default();
        let published = rows.iter().find(|r| r.name == scenario).and_then(|r| r.published);
        let short: String = scenario.chars().take(25).collect();
        say(&format!(
            "{short:<26}{planner:<14}{:>9}{:>5} {:>6.3}{:>6.3} {:>5.2}{:>5.2}{:>5.2} {:>5.2}{:>5.2} {:>6.1}",
            format!("{}/{}", s.successes, s.trials),
            s.unsafe_contacts,
            f("position_error_m").mean,
            f("position_error_m").p95,
            f("touchdown_speed_mps").mean,
            f("touchdown_speed_mps").p95,
            f("tangential_speed_mps").p95,
            f("tilt_error_deg").mean,
            f("tilt_error_deg").p95,
            f("landing_time_s").mean,
        ));
        let (lo, hi) = wilson(s.successes, s.trials);
        let known = |i: usize| published.map_or_else(|| "-".into(), |p: [f64; 3]| p[i].to_string());
        let _ = writeln!(
            markdown,
            "| {scenario} | {planner} | {}/{} | {:.1}-{:.1} % | {} | {:.3} ({:.3}) | {} | {:.2} ({:.2}) | {:.2} | {:.2} ({:.2}) | {:.1} | {} | {:.1} |",
            s.successes,
            s.trials,
            100.0 * lo,
            100.0 * hi,
            s.unsafe_contacts,
            f("position_error_m").mean,
            f("position_error_m").p95,
            known(0),
            f("touchdown_speed_mps").mean,
            f("touchdown_speed_mps").p95,
            f("tangential_speed_mps").p95,
            f("tilt_error_deg").mean,
            f("tilt_error_deg").p95,
            f("landing_time_s").mean,
            known(1),
            f("over_deck_time_s").mean,
        );
        let mut value = table::summary_json(&s);
        value.insert("scenario".into(), scenario.into());
        value.insert("planner".into(), planner.into());
        value.insert("configuration".into(), hash.into());
        values.push(Value::Object(value));
        let intervals = FIGURES
            .iter()
            .map(|(name, f)| (*name, bootstrap_mean(set.iter().filter_map(f).collect())))
            .collect();
        lines.push(Line {
            scenario: scenario.into(),
            planner: planner.into(),
            summary: s,
            intervals,
            published,
        });
    }
    let worst = worst(args, outcomes);
    for line in &worst {
        say(line);
    }
    let value = Value::Array(values);
    if let Some(out) = &args.out {
        let seeds = format!(
            "seeds {} to {}",
            args.seed0,
            args.seed0 + u64::from(args.trials) - 1
        );
        let _ = write!(
            markdown,
            "\nWorst trials and failures:\n\n```\n{}\n```\n",
            worst.join("\n")
        );
        let page = report::html(title, hash, &seeds, &lines, &worst);
        for (name, text) in [
            ("report.html", page),
            ("summary.md", markdown),
            ("summary.json", value.to_string()),
        ] {
            let path = out.join(name);
            std::fs::write(&path, text)
                .map_err(|e| Refused::because(format!("writing {}", path.display()), e))?;
        }
        say(&format!("written: {}", out.join("report.html").display()));
    }
    Ok(value)
}

/// Failures first, then the largest position errors, each with the command that flies it again.
fn worst(args: &StudyArgs, outcomes: &[Outcome]) -> Vec<String> {
    let mut order: Vec<&Outcome> = outcomes.iter().collect();
    order.sort_by(|a, b| {
        let bad = |o: &Outcome| o.position_error_m.unwrap_or(f64::INFINITY);
        a.success.cmp(&b.success).then(bad(b).total_cmp(&bad(a)))
    });
    let failures = order.iter().filter(|o| !o.success).count();
    let mut lines = Vec::new();
    for o in order.iter().take(failures.clamp(WORST / 4, WORST)) {
        lines.push(format!(
            "{} {} seed {}: {} ({})",
            o.sea,
            o.planner,
            o.seed,
            o.outcome.name(),
            o.reason
        ));
        if let Some(out) = &args.out {
            lines.push(format!(
                "  alight trial --scenario '{}' --planner {} --seed {}",
                out.join("scenarios").join(file_name(&o.sea)).display(),
                o.planner,
                o.seed
            ));
        }
    }
    if failures > WORST {
        lines.push(format!("and {} more failures in rows.csv", failures - WORST));
    }
    lines
}
