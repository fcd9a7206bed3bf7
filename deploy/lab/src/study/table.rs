//! Table of a study: a row for each scene and planner, and for each pool of scenes, with intervals and paired
//! differences from the first planner.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use alight_computer::{
    cells,
    exit::CliError,
    table::{Cell, Table},
    terminal::{note, wrapped},
};
use alight_sim::{
    harness::outcome::{MAX_CONTACT_MPS, MAX_TILT_ERROR_RAD, Outcome},
    studies::{
        paired::{self, COMPARED, Comparison},
        statistics::{METRICS, Summary, at_most_95, bootstrap_mean, wilson},
    },
};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::{
    definition::{Definition, PublishedResult},
    result::{StudyResult, write_files},
    rows::{Rows, StudyRow},
    run,
};
use crate::{
    args::StudyArgs,
    outcome_table::{committed_odds, summary_json},
    scene::written,
};

const MAX_FAILURES: usize = 12;
const WORST_COUNT: usize = 3;
/// Maximum number of rows for which the terminal shows worst and best trials.
const MAX_ROWS_WITH_EXTREMES: usize = 20;
/// Position error equivalent to the limits of speed and tilt, m: half the deck's width minus half of the feet's span.
const POSITION_LIMIT_M: f64 = 0.65;
/// Number of perfect landings that one unsafe trial outweighs.
const UNSAFE_COST: f64 = 10.0;
/// Pool of all scenes.
const ALL: &str = "all";

struct Column {
    metric: &'static str,
    head: &'static str,
    digits: usize,
}

const fn column(metric: &'static str, head: &'static str, digits: usize) -> Column {
    Column { metric, head, digits }
}

/// Metrics of the table, each with mean and 95th percentile.
const COLUMNS: [Column; 7] = [
    column("position_error_m", "position m", 3),
    column("touchdown_speed_mps", "normal m/s", 2),
    column("tangential_speed_mps", "tangential m/s", 2),
    column("tilt_error_deg", "tilt deg", 2),
    column("landing_time_s", "landing s", 1),
    column("over_deck_time_s", "over deck s", 1),
    column("solve_p99_ms", "solve p99 ms", 2),
];

#[derive(Serialize)]
struct TableRow {
    /// Name of the scene, or of a pool of scenes.
    scenario: String,
    planner: String,
    #[serde(flatten)]
    values: Map<String, Value>,
    /// 95 % bootstrap interval of each metric's mean.
    mean_95: BTreeMap<&'static str, [f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    /// 95 % bootstrap interval of the score.
    #[serde(skip_serializing_if = "Option::is_none")]
    score_95: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    published: Option<PublishedResult>,
    /// Worst first, by the fraction of a success limit.
    worst_seeds: Vec<u64>,
    best_seed: u64,
    /// Replay command of the trials, without `--seed`; None if the study kept no scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    replay: Option<String>,
    /// Comparison of this planner with the first one.
    #[serde(skip_serializing_if = "Option::is_none")]
    against: Option<Comparison>,
    #[serde(skip)]
    summary: Summary,
}

pub struct Study<'a> {
    pub args: &'a StudyArgs,
    pub program: &'a str,
    pub definition: &'a Definition,
    pub rows: &'a Rows,
    pub result: &'a StudyResult,
    /// In the order of the rows.
    pub outcomes: &'a [Outcome],
}

/// Outcomes of a scene or pool and a planner.
struct Set<'a> {
    name: &'a str,
    planner: &'a str,
    outcomes: Vec<&'a Outcome>,
}

impl Study<'_> {
    /// One row for each name that `pool` gives to outcomes, and each planner.
    fn rows_by<'s>(&'s self, pool: impl Fn(&'s Outcome) -> &'s str) -> Vec<TableRow> {
        let mut sets: Vec<Set<'s>> = Vec::new();
        let mut places = BTreeMap::new();
        for o in self.outcomes {
            let name = pool(o);
            let planner = o.planner.as_str();
            let place = *places.entry((name, planner)).or_insert(sets.len());
            match sets.get_mut(place) {
                Some(set) => set.outcomes.push(o),
                None => sets.push(Set {
                    name,
                    planner,
                    outcomes: vec![o],
                }),
            }
        }
        let first = self.outcomes.first().map_or("", |o| &o.planner);
        let compared = |set: &Set<'s>| {
            if set.planner == first {
                return None;
            }
            let with = places.get(&(set.name, first)).and_then(|k| sets.get(*k))?;
            paired::compare(&with.outcomes, &set.outcomes)
        };
        sets.iter()
            .map(|set| TableRow {
                against: compared(set),
                ..self.row(set)
            })
            .collect()
    }

    fn row(&self, set: &Set<'_>) -> TableRow {
        let mut sorted = set.outcomes.clone();
        sorted.sort_by(|a, b| {
            let by_limit = worst_limit_fraction(b).total_cmp(&worst_limit_fraction(a));
            by_limit.then(a.seed.cmp(&b.seed))
        });
        let seeds: Vec<u64> = sorted.iter().map(|o| o.seed).collect();
        let others = seeds.len().saturating_sub(1).clamp(1, WORST_COUNT);
        let interval = |column: &Column| {
            let (name, metric) = METRICS.iter().find(|(name, _)| *name == column.metric)?;
            let values: Vec<f64> = set.outcomes.iter().filter_map(|o| metric(o)).collect();
            Some((*name, bootstrap_mean(&values)?))
        };
        let flown = self.rows.rows.iter().find(|r| r.scenario == set.name);
        let flown_alike = self
            .rows
            .rows
            .iter()
            .find(|r| r.scenario == set.name && r.planner == set.planner);
        let published = flown.and_then(|r| {
            let own = r.published.get(set.planner);
            own.or(r.published.get(&self.definition.beat)).copied()
        });
        let replay = match (&self.args.out, flown_alike) {
            (Some(out), Some(row)) => replay_command(out, row),
            _ => None,
        };
        let summary = Summary::of(&set.outcomes);
        let score = self.definition.version.and_then(|_| score(&set.outcomes));
        TableRow {
            scenario: set.name.into(),
            planner: set.planner.into(),
            values: summary_json(&summary),
            mean_95: COLUMNS.iter().filter_map(interval).collect(),
            score: score.map(|(mean, _)| mean),
            score_95: score.map(|(_, interval)| interval),
            published,
            worst_seeds: seeds.iter().take(others).copied().collect(),
            best_seed: seeds.last().copied().unwrap_or_default(),
            replay,
            against: None,
            summary,
        }
    }

    /// Differences between these rows and the complete study without overrides.
    fn remarks(&self) -> Vec<String> {
        self.result.remarks(self.outcomes, self.rows.scenes)
    }

    /// Pools of the scenes: by the study's axis, and all together.
    fn pools(&self) -> Vec<TableRow> {
        let rows = self.rows.rows.iter();
        let groups: BTreeMap<&str, &str> = rows.map(|r| (r.scenario.as_str(), r.group.as_str())).collect();
        let mut pools = match self.definition.pooled_by {
            Some(_) => self.rows_by(|o| groups.get(o.sea.as_str()).copied().unwrap_or(&o.sea)),
            None => Vec::new(),
        };
        let has_several = self
            .outcomes
            .iter()
            .any(|o| Some(&o.sea) != self.outcomes.first().map(|o| &o.sea));
        if !has_several && self.definition.version.is_none() {
            return pools;
        }
        pools.extend(self.rows_by(|_| ALL));
        pools
    }

    /// Rows with intervals; a metric's note has the 95th percentile and the published mean.
    fn table(&self, rows: &[TableRow]) -> Table {
        let columns: Vec<&Column> = COLUMNS
            .iter()
            .filter(|c| rows.iter().any(|r| r.summary.metric(c.metric).is_some()))
            .collect();
        let mut heads = vec![
            "scene", "planner", "landed", "95 %", "rejected", "unsafe", "at most",
        ];
        heads.extend(columns.iter().map(|c| c.head));
        let has_scores = rows.iter().any(|r| r.score.is_some());
        if has_scores {
            heads.push("score");
        }
        let mut table = Table::new(2.., heads);
        for row in rows {
            let s = &row.summary;
            let (low, high) = wilson(s.successes, s.trials);
            let contacts = match s.unsafe_contacts {
                0 => String::new(),
                1 => "1 contact".into(),
                n => format!("{n} contacts"),
            };
            let most = 100.0 * at_most_95(s.unsafe_trials, s.trials);
            let mut cells = cells![
                row.scenario,
                row.planner,
                Cell::from(format_args!("{}/{}", s.successes, s.trials)).note(self.published_landed(row)),
                format_args!("{:.1}-{:.1} %", 100.0 * low, 100.0 * high),
                s.rejected,
                Cell::from(s.unsafe_trials).note(contacts),
                format_args!("{most:.1} %")
            ]
            .to_vec();
            for column in &columns {
                let digits = column.digits;
                let statistics = s.metric(column.metric);
                let p95 = statistics.map(|f| format!("{:.digits$}", f.p95));
                let published = row.published.and_then(|p| p.metric(column.metric));
                let published = published.map(|v| format!("published {v}"));
                let notes: Vec<String> = p95.into_iter().chain(published).collect();
                cells.push(Cell::number(statistics.map(|f| f.mean), digits).note(notes.join("; ")));
            }
            if has_scores {
                let interval = row.score_95.map(|[low, high]| format!("{low:.2} to {high:.2}"));
                cells.push(Cell::number(row.score, 2).note(interval.unwrap_or_default()));
            }
            table.row(cells);
        }
        table
    }

    fn published_landed(&self, row: &TableRow) -> String {
        let published = self.definition.published_landed.get(&row.planner);
        match published {
            Some([landed, of]) if row.scenario == ALL && self.rows.whole => {
                format!("published {landed}/{of}")
            }
            Some(_) | None => String::new(),
        }
    }

    fn console(&self, rows: &[TableRow], pools: &[TableRow]) -> Vec<String> {
        let mut title = self.definition.title.clone();
        if self.definition.version.is_some() {
            title = self
                .remarks()
                .into_iter()
                .fold(title, |title, remark| title + ", " + &remark);
        }
        let mut out = vec![wrapped(&format!(
            "{title}, configuration {}; mean (95th percentile)",
            self.result.configuration()
        ))];
        if self.definition.version.is_none() {
            out.push(self.table(rows).text());
        }
        if !pools.is_empty() {
            out.push(self.table(pools).text());
        }
        let differences = differences(if pools.is_empty() { rows } else { pools });
        if !differences.is_empty() {
            out.push("paired differences from the first planner, mean and 95 % interval".into());
            out.push(differences.text());
        }
        let all: Vec<&Outcome> = self.outcomes.iter().collect();
        out.push(committed_odds(&Summary::of(&all)));
        out.extend(failures(self.outcomes).iter().map(|text| wrapped(text)));
        if rows.len() <= MAX_ROWS_WITH_EXTREMES {
            out.push(extremes(rows).text());
            out.extend(rows.iter().filter_map(|row| {
                let replay = row.replay.as_ref()?;
                let worst = row.worst_seeds.first()?;
                Some(format!("{replay} --seed {worst}"))
            }));
        }
        out
    }

    /// Prints the table, and writes it as `summary.json`.
    pub fn publish(&self) -> Result<(), CliError> {
        let form = &self.args.form;
        let rows = self.rows_by(|o| &o.sea);
        let pools = self.pools();
        for text in self.console(&rows, &pools) {
            note(form.alone(), text);
        }
        let seeds = self.outcomes.iter().map(|o| o.seed);
        let value = json!({
            "title": self.definition.title, "benchmark": self.definition.version, "remarks": self.remarks(),
            "program": self.program, "machines": self.result.machines, "configuration": self.result.configuration(),
            "seeds": [seeds.clone().min(), seeds.max()],
            "rows": rows, "pooled": pools,
        });
        if let Some(out) = &self.args.out {
            write_files(out, &[("summary.json", value.to_string())])?;
            note(
                form.alone(),
                format_args!("written: {}", out.join("summary.json").display()),
            );
        }
        let printed = if self.definition.version.is_some() {
            &pools
        } else {
            &rows
        };
        form.print(&value, printed)?;
        Ok(())
    }
}

/// Score of a trial: 1 - r / 2 for a landing, where r is the largest ratio of a contact's speed or angle to its limit;
/// 0 without a landing; below that for an unsafe trial.
fn trial_score(o: &Outcome) -> f64 {
    if o.success {
        1.0 - 0.5 * o.limit_ratio
    } else if o.is_unsafe() {
        -UNSAFE_COST
    } else {
        0.0
    }
}

/// Mean score of the trials and its 95 % interval; None for a planner that has never touched the deck.
fn score(outcomes: &[&Outcome]) -> Option<(f64, [f64; 2])> {
    if outcomes.iter().all(|o| o.is_rejected()) {
        return None;
    }
    let scores: Vec<f64> = outcomes.iter().map(|o| trial_score(o)).collect();
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    Some((mean, bootstrap_mean(&scores)?))
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
    Some(
        format!(
            "alight trial{scene}{}{}{} {}",
            flag("vessel-config", vessel).unwrap_or_default(),
            flag("drone-config", drone).unwrap_or_default(),
            flag("tuning", tuning).unwrap_or_default(),
            written("planner", row.kind())
        ) + &row.nodes.predictor.as_ref().map_or_else(String::new, |own| {
            format!(" {}", written("predictor", own.name()))
        }),
    )
}

fn failures(outcomes: &[Outcome]) -> Vec<String> {
    let failed = || outcomes.iter().filter(|o| !o.success);
    let line = |o: &Outcome| {
        let ending = o.outcome.name();
        format!("{} {} seed {}: {ending} ({})", o.sea, o.planner, o.seed, o.reason)
    };
    let mut lines: Vec<String> = failed().take(MAX_FAILURES).map(line).collect();
    let more = failed().count() - lines.len();
    if more > 0 {
        lines.push(format!("and {more} more failures in rows.csv"));
    }
    lines
}

fn differences(rows: &[TableRow]) -> Table {
    let heads = [
        "scene",
        "planner",
        "minus",
        "pairs",
        "only it",
        "only the other",
        "landed %",
    ];
    let mut table = Table::new(3.., heads.into_iter().chain(COMPARED.iter().map(|c| c.0)));
    let cell = |mean: f64, [low, high]: [f64; 2], digits: usize| {
        Cell::from(format_args!("{mean:+.digits$}")).note(format_args!("{low:+.digits$} to {high:+.digits$}"))
    };
    for row in rows {
        let Some(c) = &row.against else { continue };
        let r = &c.rates;
        let mut cells = cells![row.scenario, row.planner, c.first, c.pairs, r.only[1], r.only[0]].to_vec();
        cells.push(cell(100.0 * r.difference, r.interval.map(|v| 100.0 * v), 1));
        for (name, _) in COMPARED {
            let digits = if name.ends_with("_m") { 3 } else { 2 };
            let difference = c.differences.iter().find(|d| d.metric == name);
            cells.push(difference.map_or("-".into(), |d| cell(d.mean, d.interval, digits)));
        }
        table.row(cells);
    }
    table
}

fn extremes(rows: &[TableRow]) -> Table {
    let mut table = Table::new(3.., ["scene", "planner", "worst seeds", "best seed"]);
    for row in rows {
        let worst: Vec<String> = row.worst_seeds.iter().map(u64::to_string).collect();
        table.row(cells![row.scenario, row.planner, worst.join(", "), row.best_seed]);
    }
    table
}

#[cfg(test)]
mod tests {
    use alight_shared::wire;

    use super::{
        super::{
            definition::{parse, text},
            rows::expand,
        },
        *,
    };
    use crate::args::typed;
    use alight_sim::harness::outcome::{Ending, Judge};

    #[test]
    fn benchmark_of_twelve_frozen_scenes() {
        let definition = parse(&text("benchmark").unwrap(), "benchmark").unwrap();
        let rows = expand(&definition, &typed(["study", "benchmark"])).unwrap();
        let mut scenes: Vec<&str> = rows.rows.iter().map(|r| r.group.as_str()).collect();
        scenes.dedup();
        assert_eq!((scenes.len(), rows.rows.len()), (12, 34), "{scenes:?}");
        let world = |r: &StudyRow| format!("{}\n{}", r.scenario, toml::to_string(&r.world).unwrap());
        let worlds: Vec<String> = rows.rows.iter().map(world).collect();
        let hash = format!("{:016x}", wire::hash_record(&worlds.concat()).unwrap());
        assert_eq!(
            hash, "b4bcbdeddc07520f",
            "the worlds of the benchmark have changed: raise its version, or restore the worlds"
        );
    }

    fn flown(scenario: &str, planner: &str, seed: u64, ending: Ending) -> Outcome {
        Outcome {
            outcome: ending,
            success: ending == Ending::Success,
            reason: "not at rest on the deck".into(),
            unsafe_contacts: u32::from(ending == Ending::Hard),
            position_error_m: Some(0.1 * seed as f64),
            touchdown_speed_mps: Some(0.0),
            tangential_speed_mps: Some(0.0),
            tilt_error_deg: Some(0.0),
            ..Judge::default().outcome(seed, scenario, planner, 1.0)
        }
    }
    fn published(name: &str, outcomes: &[Outcome]) -> (Vec<TableRow>, Vec<TableRow>, String) {
        let definition = parse(&text(name).unwrap(), name).unwrap();
        let args: StudyArgs = typed(["study", name]);
        let study = Study {
            args: &args,
            program: "",
            definition: &definition,
            rows: &expand(&definition, &args).unwrap(),
            result: &StudyResult::default(),
            outcomes,
        };
        let rows = study.rows_by(|o| &o.sea);
        let pools = study.pools();
        let text = study.console(&rows, &pools).concat();
        (rows, pools, text)
    }

    #[test]
    fn score_of_landings_and_unsafe_trials() {
        let half = |planner: &str, seed, ending| Outcome {
            limit_ratio: 0.5,
            ..flown("moderate", planner, seed, ending)
        };
        let landed = |planner: &'static str| (0..9).map(move |k| half(planner, k, Ending::Success));
        let mut outcomes: Vec<Outcome> = landed("waits").chain(landed("hits")).collect();
        outcomes.push(half("waits", 9, Ending::GaveUp));
        outcomes.push(half("hits", 9, Ending::Hard));
        outcomes.push(half("never flies", 9, Ending::GaveUp));
        let (_, pools, text) = published("benchmark", &outcomes);
        let score = |planner: &str| {
            let row = pools.iter().find(|p| p.scenario == "all" && p.planner == planner);
            row.unwrap().score
        };
        assert_eq!(score("never flies"), None);
        let [waits, hits] = ["waits", "hits"].map(|planner| score(planner).unwrap());
        assert!(
            (waits - 0.9 * 0.75).abs() < 1e-12 && (hits - (waits - 1.0)).abs() < 1e-12,
            "{waits} {hits}"
        );
        let [low, high] = pools[0].score_95.unwrap();
        assert!(low < waits && waits < high, "{low} {high}");
        assert!(
            text.split_whitespace()
                .collect::<Vec<_>>()
                .join(" ")
                .contains("partial: 1 of 34 rows"),
            "{text}"
        );
    }

    #[test]
    fn rows_of_two_planners_with_their_differences() {
        let mut outcomes = Vec::new();
        for sea in ["0,0", "0.2,5"] {
            for planner in ["alight", "mpc-faa"] {
                let seeds = if planner == "alight" { 0..6 } else { 3..9 };
                outcomes.extend(seeds.map(|seed| flown(sea, planner, seed, Ending::Success)));
            }
        }
        let (rows, pools, text) = published("table2", &outcomes);
        let names: Vec<(&str, &str)> = rows
            .iter()
            .map(|r| (r.scenario.as_str(), r.planner.as_str()))
            .collect();
        assert_eq!(
            names,
            [
                ("0,0", "alight"),
                ("0,0", "mpc-faa"),
                ("0.2,5", "alight"),
                ("0.2,5", "mpc-faa")
            ]
        );
        assert_eq!(
            (rows[0].worst_seeds.as_slice(), rows[0].best_seed),
            (&[5, 4, 3][..], 0)
        );
        let [low, high] = rows[0].mean_95["position_error_m"];
        assert!(low < 0.25 && high > 0.25, "{low} {high}");
        assert!(rows[0].against.is_none());
        let against = rows[3].against.as_ref().unwrap();
        assert_eq!((against.first.as_str(), against.pairs), ("alight", 3));
        assert_eq!((pools.len(), pools[1].against.as_ref().unwrap().pairs), (2, 6));
        for part in [
            "12/12 (published 995/1000)",
            "61.0-100.0 %",
            "published 0.1",
            "39.3 %",
        ] {
            assert!(text.contains(part), "{part} is missing in {text}");
        }
    }
}
