//! `alight study link`: what a bad link costs, as rows, a table and plots.

use std::fmt::Write as _;

use alight_shared::msg::State;
use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::scenario::StateOutage;

use crate::lab::study::flown::PlannerVariant;
use crate::lab::study::grid::{MakeScene, StudyScene};
use crate::lab::study::report::{COLOURS, escape};

/// Shares of packets that are lost.
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

/// What is plotted: caption, and the figure of a set of landings with one scenario and planner.
type Measure = (&'static str, fn(&[&Outcome]) -> Option<f64>);

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = values.collect();
    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
}

const MEASURES: [Measure; 5] = [
    ("landed, %", |set| {
        mean(set.iter().map(|o| 100.0 * f64::from(u8::from(o.success))))
    }),
    ("position error, m, mean", |set| {
        mean(set.iter().filter_map(|o| o.position_error_m))
    }),
    ("first descent to contact, s, mean", |set| {
        mean(set.iter().filter_map(|o| o.landing_time_s))
    }),
    ("aborted descents, mean", |set| {
        mean(set.iter().map(|o| aborts(o)))
    }),
    ("worst age of the vessel's state at touchdown, s", |set| {
        set.iter().filter_map(|o| o.radio_age_s).max_by(f64::total_cmp)
    }),
];

/// Descents that were given up.
pub fn aborts(o: &Outcome) -> f64 {
    f64::from(o.attempts.saturating_sub(u32::from(o.position_error_m.is_some())))
}

/// A curve: its name and its points; none where nothing was measured.
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Its points, one for each place.
    pub points: Vec<Option<f64>>,
}

/// The figures of a planner's landings: captions and SVG drawings.
pub fn charts(planners: &[PlannerVariant], outcomes: &[Outcome]) -> Vec<(String, String)> {
    let mut out = Vec::new();
    for planner in planners {
        let figure = |scenario: &str, measure: fn(&[&Outcome]) -> Option<f64>| {
            let set: Vec<&Outcome> = outcomes
                .iter()
                .filter(|o| o.planner == planner.name && o.sea == scenario)
                .collect();
            (!set.is_empty()).then(|| measure(&set)).flatten()
        };
        let of = if planners.len() > 1 {
            format!(", {}", planner.name)
        } else {
            String::new()
        };
        for (caption, measure) in MEASURES {
            let over_loss: Vec<Curve> = DELAYS_S
                .iter()
                .map(|d| Curve {
                    name: format!("{d} s"),
                    points: LOSSES
                        .iter()
                        .map(|l| figure(&sweep_name(*l, *d), measure))
                        .collect(),
                })
                .collect();
            let over_delay: Vec<Curve> = LOSSES
                .iter()
                .map(|l| Curve {
                    name: format!("{:.0} %", 100.0 * l),
                    points: DELAYS_S
                        .iter()
                        .map(|d| figure(&sweep_name(*l, *d), measure))
                        .collect(),
                })
                .collect();
            let over_outage: Vec<Curve> = STATES
                .iter()
                .map(|s| Curve {
                    name: s.name().into(),
                    points: OUTAGES_S
                        .iter()
                        .map(|x| figure(&outage_name(*s, *x), measure))
                        .collect(),
                })
                .collect();
            let ticks = |v: &[f64]| -> Vec<String> {
                v.iter()
                    .map(|x| {
                        if x.is_finite() {
                            x.to_string()
                        } else {
                            "ever".into()
                        }
                    })
                    .collect()
            };
            for (against, labels, curves) in [
                ("share lost, by delay", ticks(&LOSSES), over_loss),
                ("delay, s, by share lost", ticks(&DELAYS_S), over_delay),
                (
                    "length of the outage, s, by the state it begins in",
                    ticks(&OUTAGES_S),
                    over_outage,
                ),
            ] {
                if curves.iter().any(|c| c.points.iter().any(Option::is_some)) {
                    out.push((format!("{caption} over {against}{of}"), chart(&labels, &curves)));
                }
            }
        }
    }
    out
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 260.0;

/// Curves over named places on the horizontal axis.
pub fn chart(labels: &[String], curves: &[Curve]) -> String {
    let top = curves
        .iter()
        .flat_map(|c| c.points.iter().flatten())
        .fold(0.0_f64, |a, b| a.max(*b));
    let top = if top > 0.0 { 1.05 * top } else { 1.0 };
    let digits = if top < 0.2 { 3 } else { 2 };
    let (left, right, base) = (48.0, WIDTH - 130.0, HEIGHT - 28.0);
    let x = |k: usize| left + (right - left) * k as f64 / (labels.len().max(2) - 1) as f64;
    let y = |v: f64| base - (base - 12.0) * v / top;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         font-family=\"sans-serif\" font-size=\"12\">"
    );
    for k in 0..=4 {
        let v = top * f64::from(k) / 4.0;
        let _ = write!(
            out,
            "<line x1=\"{left}\" x2=\"{right}\" y1=\"{0:.1}\" y2=\"{0:.1}\" stroke=\"#e4e4e4\"/>\
             <text x=\"{1}\" y=\"{2:.1}\" text-anchor=\"end\" fill=\"#666\">{v:.digits$}</text>",
            y(v),
            left - 6.0,
            y(v) + 4.0
        );
    }
    for (k, label) in labels.iter().enumerate() {
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#666\">{}</text>",
            x(k),
            HEIGHT - 8.0,
            escape(label)
        );
    }
    for (i, curve) in curves.iter().enumerate() {
        let colour = COLOURS.get(i % COLOURS.len()).copied().unwrap_or("#000");
        let points: Vec<(f64, f64, f64)> = curve
            .points
            .iter()
            .enumerate()
            .filter_map(|(k, v)| v.map(|v| (x(k), y(v), v)))
            .collect();
        let line: Vec<String> = points.iter().map(|(x, y, _)| format!("{x:.1},{y:.1}")).collect();
        let _ = write!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            line.join(" ")
        );
        for (x, y, v) in points {
            let _ = write!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{colour}\"><title>{}: {v:.3}</title></circle>",
                escape(&curve.name)
            );
        }
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{:.0}\" fill=\"{colour}\">{}</text>",
            right + 10.0,
            18.0 + 16.0 * i as f64,
            escape(&curve.name)
        );
    }
    out.push_str("</svg>");
    out
}

/// All figures as one picture, one below the other.
pub fn chart_sheet(charts: &[(String, String)]) -> String {
    let cell = HEIGHT + 30.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{0}\" viewBox=\"0 0 {WIDTH} {0}\" \
         font-family=\"sans-serif\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
        cell * charts.len() as f64
    );
    for (k, (caption, svg)) in charts.iter().enumerate() {
        let top = cell * k as f64;
        let _ = write!(
            out,
            "<text x=\"8\" y=\"{:.0}\" font-size=\"14\">{}</text>{}",
            top + 20.0,
            escape(caption),
            svg.replacen(
                "<svg ",
                &format!(
                    "<svg y=\"{:.0}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" ",
                    top + 28.0
                ),
                1
            )
        );
    }
    out.push_str("</svg>\n");
    out
}

/// The study's own table: what the link costs, row by row.
pub fn table(planners: &[PlannerVariant], rows: &[StudyScene], outcomes: &[Outcome]) -> Vec<String> {
    let mut out = vec![
        "| link | planner | landed | unsafe | error, m | time, s | aborts | worst age at touchdown, s |"
            .into(),
        "|---|---|---|---|---|---|---|---|".into(),
    ];
    for row in rows {
        for planner in planners {
            let set: Vec<&Outcome> = outcomes
                .iter()
                .filter(|o| o.sea == row.name && o.planner == planner.name)
                .collect();
            let cell = |k: usize, digits: usize| {
                let value = MEASURES.get(k).and_then(|(_, measure)| measure(&set));
                value.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"))
            };
            out.push(format!(
                "| {} | {} | {} of {} | {} | {} | {} | {} | {} |",
                row.name,
                planner.name,
                set.iter().filter(|o| o.success).count(),
                set.len(),
                set.iter().map(|o| o.unsafe_contacts).sum::<u32>(),
                cell(1, 3),
                cell(2, 1),
                cell(3, 2),
                cell(4, 2),
            ));
        }
    }
    out
}
