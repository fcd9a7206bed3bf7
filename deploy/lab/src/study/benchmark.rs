//! Scores of a benchmark: one line for each scene and planner, with hulls pooled.

use alight_computer::cells;
use alight_computer::table::{Cell, Table};
use alight_shared::estimation::quantile;
use alight_sim::harness::outcome::Outcome;
use alight_sim::studies::statistics::{Summary, at_most_95, wilson};
use serde_json::{Value, json};

use super::rows::Rows;

/// Number of landings that one unsafe trial outweighs.
const UNSAFE_COST: f64 = 10.0;
const ALL: &str = "all";

pub struct Score {
    scene: String,
    planner: String,
    summary: Summary,
    /// Median and 95th percentile.
    position_m: [Option<f64>; 2],
    contact_mps: [Option<f64>; 2],
    over_deck_s: [Option<f64>; 2],
    /// Mean over the trials of each trial's 99th percentile.
    solve_p99_ms: Option<f64>,
    /// Landings within the time limit minus ten times unsafe trials, per trial; for all scenes, the mean of the
    /// scenes.
    score: Option<f64>,
}

fn percentiles(set: &[&Outcome], metric: fn(&Outcome) -> Option<f64>) -> [Option<f64>; 2] {
    let mut values: Vec<f64> = set.iter().filter_map(|o| metric(o)).collect();
    [0.5, 0.95].map(|p| quantile(&mut values, p))
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

impl Score {
    fn of(scene: &str, planner: &str, set: &[&Outcome]) -> Score {
        let summary = Summary::of(&set.iter().map(|o| (*o).clone()).collect::<Vec<_>>());
        let solves: Vec<f64> = set.iter().filter_map(|o| o.solve_p99_ms).collect();
        let points = summary.successes as f64 - UNSAFE_COST * summary.unsafe_trials as f64;
        Score {
            scene: scene.into(),
            planner: planner.into(),
            position_m: percentiles(set, |o| o.position_error_m),
            contact_mps: percentiles(set, |o| o.touchdown_speed_mps),
            over_deck_s: percentiles(set, |o| o.over_deck_time_s),
            solve_p99_ms: mean(&solves),
            score: (summary.trials > 0).then(|| points / summary.trials as f64),
            summary,
        }
    }
}

/// Scores by scene, then by planner; those over all scenes come last.
pub fn scores(rows: &Rows, planners: &[&str], outcomes: &[Outcome]) -> Vec<Score> {
    let mut scenes: Vec<&str> = Vec::new();
    for row in &rows.rows {
        if !scenes.contains(&row.group.as_str()) {
            scenes.push(&row.group);
        }
    }
    let set = |scene: Option<&str>, planner: &str| -> Vec<&Outcome> {
        let of_scene = |o: &Outcome| {
            rows.rows
                .iter()
                .any(|r| Some(r.group.as_str()) == scene && r.scenario == o.sea)
        };
        let all = outcomes.iter().filter(|o| o.planner == planner);
        all.filter(|o| scene.is_none() || of_scene(o)).collect()
    };
    let pairs = scenes.iter().flat_map(|s| planners.iter().map(move |p| (s, p)));
    let scored = pairs.map(|(scene, planner)| Score::of(scene, planner, &set(Some(scene), planner)));
    let mut scores: Vec<Score> = scored.filter(|s| s.summary.trials > 0).collect();
    for planner in planners {
        let own = scores.iter().filter(|s| s.planner == *planner);
        let score = mean(&own.filter_map(|s| s.score).collect::<Vec<_>>());
        scores.push(Score {
            score,
            ..Score::of(ALL, planner, &set(None, planner))
        });
    }
    scores
}

pub fn table(scores: &[Score]) -> Table {
    let heads = [
        "scene",
        "planner",
        "landed",
        "95 %",
        "unsafe",
        "at most",
        "position m",
        "contact m/s",
        "over deck s",
        "solve p99 ms",
        "score",
    ];
    let mut table = Table::new(2.., heads);
    for s in scores {
        let (lo, hi) = wilson(s.summary.successes, s.summary.trials);
        let pair = |[p50, p95]: [Option<f64>; 2], digits: usize| {
            let note = p95.map_or_else(String::new, |v| format!("{v:.digits$}"));
            Cell::number(p50, digits).note(note)
        };
        table.row(cells![
            s.scene,
            s.planner,
            format_args!("{}/{}", s.summary.successes, s.summary.trials),
            format_args!("{:.0}-{:.0} %", 100.0 * lo, 100.0 * hi),
            s.summary.unsafe_trials,
            format_args!(
                "{:.1} %",
                100.0 * at_most_95(s.summary.unsafe_trials, s.summary.trials)
            ),
            pair(s.position_m, 3),
            pair(s.contact_mps, 2),
            pair(s.over_deck_s, 1),
            Cell::number(s.solve_p99_ms, 2),
            Cell::number(s.score, 2)
        ]);
    }
    table
}

fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text
        .lines()
        .find_map(|l| l.strip_prefix("model name")?.split_once(": "));
    let threads = std::thread::available_parallelism().map_or(0, usize::from);
    format!(
        "{}, {threads} threads",
        model.map_or("unknown processor", |(_, name)| name)
    )
}

pub fn json(scores: &[Score], outcomes: &[Outcome]) -> Value {
    let pair = |[p50, p95]: [Option<f64>; 2]| json!({ "p50": p50, "p95": p95 });
    let line = |s: &Score| {
        let (landed, failed, trials) = (s.summary.successes, s.summary.unsafe_trials, s.summary.trials);
        json!({
            "scene": s.scene, "planner": s.planner, "trials": trials, "landed": landed,
            "landed_95": wilson(landed, trials), "unsafe": failed, "unsafe_at_most_95": at_most_95(failed, trials),
            "position_error_m": pair(s.position_m), "touchdown_speed_mps": pair(s.contact_mps),
            "over_deck_time_s": pair(s.over_deck_s), "solve_p99_ms": s.solve_p99_ms, "score": s.score,
        })
    };
    let seeds = outcomes.iter().map(|o| o.seed);
    json!({
        "machine": machine(), "seeds": [seeds.clone().min(), seeds.max()],
        "scores": scores.iter().map(line).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use alight_shared::wire;

    use super::super::definition::{parse, text};
    use super::super::rows::{StudyRow, expand};
    use super::*;
    use crate::args::typed;
    use alight_sim::harness::outcome::{Ending, Judge};

    fn rows() -> Rows {
        let definition = parse(&text("benchmark").unwrap(), "benchmark").unwrap();
        expand(&definition, &typed(["study", "benchmark"])).unwrap()
    }

    #[test]
    fn benchmark_of_twelve_frozen_scenes() {
        let rows = rows();
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

    #[test]
    fn score_of_landings_and_unsafe_trials() {
        let rows = rows();
        let flown = |scenario: &str, seed: u64, ending: Ending| Outcome {
            outcome: ending,
            success: ending == Ending::Success,
            reason: "not at rest on the deck".into(),
            unsafe_contacts: u32::from(ending == Ending::Hard),
            position_error_m: Some(0.1 * seed as f64),
            ..Judge::default().outcome(seed, scenario, "a", 1.0)
        };
        let mut outcomes: Vec<Outcome> = (0..9).map(|k| flown("moderate", k, Ending::Success)).collect();
        outcomes.push(flown("moderate", 9, Ending::Timeout));
        for (k, hull) in ["twin-5m", "mono-5m"].iter().enumerate() {
            let ending = [Ending::Success, Ending::Hard][k];
            outcomes.push(flown(&format!("night, {hull}"), k as u64, ending));
        }
        let scores = scores(&rows, &["a"], &outcomes);
        let of = |k: usize| {
            (
                scores[k].scene.as_str(),
                scores[k].summary.trials,
                scores[k].score.unwrap(),
            )
        };
        assert_eq!([of(0), of(1)], [("moderate", 10, 0.9), ("night", 2, -4.5)]);
        assert_eq!((of(2).0, of(2).1), ("all", 12));
        assert!((of(2).2 + 1.8).abs() < 1e-12 && scores.len() == 3);
        assert_eq!(scores[0].position_m, [Some(0.4), Some(0.9)]);
    }
}
