//! `alight study link`: what a bad link costs, as rows, a table and plots.

use alight_shared::msg::State;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::scenario::StateOutage;
use alight_sim::studies::statistics::SampleStatistics;

use super::variant::{MakeScene, PlannerVariant, StudyScene};
use crate::cells;
use crate::lab::report::chart::{self, Curve};
use crate::lab::report::document::Chart;
use crate::table::{Cell, Table};

/// Fractions of packets that are lost.
const LOSSES: [f64; 5] = [0.0, 0.1, 0.3, 0.5, 0.8];
/// Delays, s.
const DELAYS_S: [f64; 5] = [0.0, 0.1, 0.3, 0.6, 1.0];
/// Lengths of an outage, s: for as long as it takes to notice, to come back, and for good.
const OUTAGES_S: [f64; 5] = [1.0, 2.0, 5.0, 10.0, f64::INFINITY];
/// States at whose first entry an outage begins.
const STATES: [State; 6] = [
    State::GetAltitude,
    State::Approach,
    State::Tracking,
    State::TrackingStable,
    State::Descent,
    State::Flare,
];

fn sweep_name(loss: f64, delay_s: f64) -> String {
    format!("loss {loss}, delay {delay_s} s")
}

fn outage_name(state: State, duration_s: f64) -> String {
    let lasts = if duration_s.is_finite() {
        format!("{duration_s} s")
    } else {
        "for good".into()
    };
    format!("outage from {} on, {lasts}", state.name())
}

/// The rows of the study.
pub fn rows(row: MakeScene<'_>) -> Vec<StudyScene> {
    let mut rows = Vec::new();
    for loss in LOSSES {
        for delay_s in DELAYS_S {
            rows.push(row(&sweep_name(loss, delay_s), &|w| {
                w.radio.loss = loss;
                w.radio.delay_s = delay_s;
                // A link without delay is a cable; 30 ms of jitter on the others.
                w.radio.delay_sd_s = if delay_s > 0.0 { 0.03 } else { 0.0 };
                w.radio.delay_min_s = w.radio.delay_min_s.min(delay_s);
            }));
        }
    }
    for state in STATES {
        for duration_s in OUTAGES_S {
            rows.push(row(&outage_name(state, duration_s), &|w| {
                w.radio_outage = Some(StateOutage {
                    state,
                    after_s: 0.0,
                    duration_s,
                });
            }));
        }
    }
    rows
}

/// A metric of a set of landings with one scenario and planner.
type Metric = fn(&[&Outcome]) -> Option<f64>;

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    SampleStatistics::of(values).map(|s| s.mean)
}

/// What is plotted and shown: caption, column, decimals.
const METRICS: [(&str, &str, usize, Metric); 5] = [
    ("landed, %", "landed %", 0, |set| {
        mean(set.iter().map(|o| 100.0 * f64::from(u8::from(o.success))))
    }),
    ("position error, m, mean", "error m", 3, |set| {
        mean(set.iter().filter_map(|o| o.position_error_m))
    }),
    ("first descent to contact, s, mean", "time s", 1, |set| {
        mean(set.iter().filter_map(|o| o.landing_time_s))
    }),
    ("aborted descents, mean", "aborts", 2, |set| {
        mean(set.iter().map(|o| aborts(o)))
    }),
    (
        "greatest age of the vessel's state at touchdown, s",
        "greatest age at touchdown s",
        2,
        |set| set.iter().filter_map(|o| o.radio_age_s).max_by(f64::total_cmp),
    ),
];

/// Aborted descents.
pub fn aborts(o: &Outcome) -> f64 {
    f64::from(o.attempts.saturating_sub(u32::from(o.position_error_m.is_some())))
}

fn landings<'a>(outcomes: &'a [Outcome], planner: &PlannerVariant, scenario: &str) -> Vec<&'a Outcome> {
    let is_one = |o: &&Outcome| o.planner == planner.name && o.sea == scenario;
    outcomes.iter().filter(is_one).collect()
}

/// What the link costs each planner, over loss, delay and outage.
pub fn charts(planners: &[PlannerVariant], outcomes: &[Outcome]) -> Vec<Chart> {
    let labels = |v: &[f64]| -> Vec<String> {
        let label = |x: &f64| {
            if x.is_finite() {
                x.to_string()
            } else {
                "ever".into()
            }
        };
        v.iter().map(label).collect()
    };
    let mut out = Vec::new();
    for planner in planners {
        let of = if planners.len() > 1 {
            format!(", {}", planner.name)
        } else {
            String::new()
        };
        for (caption, _, _, metric) in METRICS {
            let point = |scenario: String| {
                let set = landings(outcomes, planner, &scenario);
                (!set.is_empty()).then(|| metric(&set)).flatten()
            };
            let curve = |name: String, scenarios: Vec<String>| Curve {
                name,
                points: scenarios.into_iter().map(point).collect(),
            };
            let over_loss =
                DELAYS_S.map(|d| curve(format!("{d} s"), LOSSES.map(|l| sweep_name(l, d)).to_vec()));
            let over_delay = LOSSES.map(|l| {
                curve(
                    format!("{:.0} %", 100.0 * l),
                    DELAYS_S.map(|d| sweep_name(l, d)).to_vec(),
                )
            });
            let over_outage =
                STATES.map(|s| curve(s.name().into(), OUTAGES_S.map(|x| outage_name(s, x)).to_vec()));
            for (against, places, curves) in [
                ("fraction lost, by delay", &LOSSES, &over_loss[..]),
                ("delay, s, by fraction lost", &DELAYS_S, &over_delay[..]),
                (
                    "duration of the outage, s, by the state it begins in",
                    &OUTAGES_S,
                    &over_outage[..],
                ),
            ] {
                if curves.iter().any(|c| c.points.iter().any(Option::is_some)) {
                    out.push(Chart {
                        caption: format!("{caption} over {against}{of}"),
                        svg: chart::curves(&labels(places), curves),
                    });
                }
            }
        }
    }
    out
}

/// What the link costs, scene by scene.
pub fn table(planners: &[PlannerVariant], scenes: &[StudyScene], outcomes: &[Outcome]) -> Table {
    let heads = ["link", "planner", "trials", "unsafe"];
    let mut table = Table::new(2.., heads.into_iter().chain(METRICS.iter().map(|m| m.1)));
    for scene in scenes {
        for planner in planners {
            let set = landings(outcomes, planner, &scene.name);
            let contacts: u32 = set.iter().map(|o| o.unsafe_contacts).sum();
            let metrics = METRICS
                .iter()
                .map(|(.., digits, metric)| Cell::number(metric(&set), *digits));
            table.row(
                cells![scene.name, planner.name, set.len(), contacts]
                    .into_iter()
                    .chain(metrics),
            );
        }
    }
    table
}
