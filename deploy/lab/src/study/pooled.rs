//! Outcomes pooled by an axis of a study, as a table, as JSON and as curves over an axis.

use alight_computer::cells;
use alight_computer::exit::CliError;
use alight_computer::table::{Cell, Table};
use alight_sim::harness::outcome::Outcome;
use alight_sim::studies::statistics::{SampleStatistics, Summary, wilson};
use serde_json::{Value, json};

use super::rows::{CurveAxes, Rows, joined};
use crate::chart::{self, Curve};
use crate::report::document::Chart;

/// Metric of a set of trials: name, column, chart caption, decimals, and value.
type Metric = (
    &'static str,
    &'static str,
    &'static str,
    usize,
    fn(&[&Outcome]) -> Option<f64>,
);

const METRICS: [Metric; 8] = [
    ("landed_percent", "landed %", "landed, %", 0, |set| {
        mean(set.iter().map(|o| 100.0 * f64::from(u8::from(o.success))))
    }),
    (
        "position_error_m",
        "position m",
        "position error, m, mean",
        3,
        |set| mean(set.iter().filter_map(|o| o.position_error_m)),
    ),
    (
        "position_error_p95_m",
        "position p95 m",
        "position error, m, 95 % of the trials below",
        3,
        |set| SampleStatistics::of(set.iter().filter_map(|o| o.position_error_m)).map(|s| s.p95),
    ),
    (
        "touchdown_speed_mps",
        "onto deck m/s",
        "speed onto the deck at first contact, m/s, mean",
        2,
        |set| mean(set.iter().filter_map(|o| o.touchdown_speed_mps)),
    ),
    (
        "tilt_error_deg",
        "tilt deg",
        "angle between drone and deck at first contact, deg, mean",
        1,
        |set| mean(set.iter().filter_map(|o| o.tilt_error_deg)),
    ),
    (
        "landing_time_s",
        "landing s",
        "first descent to contact, s, mean",
        1,
        |set| mean(set.iter().filter_map(|o| o.landing_time_s)),
    ),
    ("aborts", "aborts", "aborted descents, mean", 2, |set| {
        mean(set.iter().map(|o| aborts(o)))
    }),
    (
        "radio_age_s",
        "maximum age at touchdown s",
        "maximum age of the vessel's state at touchdown, s",
        2,
        |set| set.iter().filter_map(|o| o.radio_age_s).max_by(f64::total_cmp),
    ),
];

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    SampleStatistics::of(values).map(|s| s.mean)
}

pub fn aborts(o: &Outcome) -> f64 {
    f64::from(o.attempts.saturating_sub(u32::from(o.position_error_m.is_some())))
}

pub struct Pool {
    group: String,
    planner: String,
    summary: Summary,
    /// Trials without a landing in time and without a contact beyond its limits.
    rejected: usize,
    metrics: [Option<f64>; METRICS.len()],
}

pub fn of(rows: &Rows, planners: &[&str], outcomes: &[Outcome]) -> Vec<Pool> {
    let mut groups: Vec<&str> = Vec::new();
    for row in &rows.rows {
        if !groups.contains(&row.group.as_str()) {
            groups.push(&row.group);
        }
    }
    let pool = |group: &str, planner: &str| {
        let scenes: Vec<&str> = rows
            .rows
            .iter()
            .filter(|r| r.group == group)
            .map(|r| r.scenario.as_str())
            .collect();
        let is_one = |o: &&Outcome| o.planner == planner && scenes.contains(&o.sea.as_str());
        let set: Vec<&Outcome> = outcomes.iter().filter(is_one).collect();
        Pool {
            group: group.into(),
            planner: planner.into(),
            summary: Summary::of(&set.iter().map(|o| (*o).clone()).collect::<Vec<_>>()),
            rejected: set.iter().filter(|o| o.is_rejected()).count(),
            metrics: METRICS.map(|(.., metric)| metric(&set)),
        }
    };
    groups
        .iter()
        .flat_map(|g| planners.iter().map(move |p| (g, p)))
        .map(|(g, p)| pool(g, p))
        .collect()
}

impl Pool {
    pub fn json(&self) -> Value {
        let s = &self.summary;
        let mut value = json!({
            "group": self.group, "planner": self.planner, "trials": s.trials, "landed": s.successes,
            "landed_interval": wilson(s.successes, s.trials), "unsafe_contacts": s.unsafe_contacts,
            "rejected": self.rejected,
        });
        for ((name, ..), metric) in METRICS.iter().zip(self.metrics).skip(1) {
            value[*name] = json!(metric);
        }
        value
    }
}

/// One row per group and planner: landed, unsafe contacts, neither.
pub fn table(by: &str, pools: &[Pool]) -> Table {
    let heads = [by, "planner", "landed", "95 %", "unsafe contacts", "rejected"];
    let mut table = Table::new(2.., heads.into_iter().chain(METRICS.iter().skip(1).map(|m| m.1)));
    for pool in pools {
        let s = &pool.summary;
        let (lo, hi) = wilson(s.successes, s.trials);
        let counts = cells![
            pool.group,
            pool.planner,
            format_args!("{}/{}", s.successes, s.trials),
            format_args!("{:.1}-{:.1} %", 100.0 * lo, 100.0 * hi),
            s.unsafe_contacts,
            pool.rejected
        ];
        let metrics = METRICS.iter().zip(pool.metrics).skip(1);
        let metrics = metrics.map(|((.., digits, _), value)| Cell::number(value, *digits));
        table.row(counts.into_iter().chain(metrics));
    }
    table
}

/// Every metric over each axis of the grids, with a curve for each choice of the other axis.
pub fn curves(grids: &[CurveAxes], planners: &[&str], outcomes: &[Outcome]) -> Result<Vec<Chart>, CliError> {
    let mut out = Vec::new();
    for (planner, (_, _, caption, _, metric)) in
        planners.iter().flat_map(|p| METRICS.iter().map(move |m| (p, m)))
    {
        for (CurveAxes(axes), over) in grids.iter().flat_map(|g| [(g, 0), (g, 1)]) {
            let [(over_name, places), (by_name, lines)] = if over == 0 {
                axes.each_ref()
            } else {
                let [a, b] = axes.each_ref();
                [b, a]
            };
            let point = |place: &str, line: &str| {
                let names = if over == 0 { [place, line] } else { [line, place] };
                let scene = joined(names);
                let is_one = |o: &&Outcome| o.planner == *planner && o.sea == scene;
                let set: Vec<&Outcome> = outcomes.iter().filter(is_one).collect();
                (!set.is_empty()).then(|| metric(&set)).flatten()
            };
            let curve = |line: &String| Curve {
                name: line.clone(),
                points: places.iter().map(|place| point(place, line)).collect(),
            };
            let drawn: Vec<Curve> = lines.iter().map(curve).collect();
            if drawn.iter().any(|c| c.points.iter().any(Option::is_some)) {
                let caption = format!("{planner}: {caption} over {over_name}, by {by_name}");
                out.push(chart::curves(&caption, places, &drawn)?);
            }
        }
    }
    Ok(out)
}
