//! `alight study link --live N`: a few bad links live across the link emulator, beside lock-step.

use serde::Serialize;
use serde_json::{Value, json};

use super::args::land_flags;
use super::pairs::{self, PairPlan, PairedSummary, Side};
use crate::cells;
use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::report::chart::{self, Curve};
use crate::lab::report::document::{Block, Chart, Document, write_files};
use crate::process::snapshot::time;
use crate::table::{Cell, Table};
use crate::terminal::note;

/// The links: name, short name for a chart, and flags of `alight land`.
const LINKS: [(&str, &str, &str); 5] = [
    ("wifi-near", "wifi-near", "--link wifi-near"),
    ("wifi-far", "wifi-far", "--link wifi-far"),
    ("storm", "storm", "--link storm"),
    (
        "storm, 2 s of outage from the flare",
        "storm, 2 s",
        "--link storm --outage-at flare --outage-duration 2",
    ),
    (
        "radio-mesh, 10 s of outage from tracking",
        "mesh, 10 s",
        "--link radio-mesh --outage-at tracking --outage-duration 10",
    ),
];

/// The transports: datagrams and a stream.
const TRANSPORTS: [&str; 2] = ["udp", "quic"];

/// Lock-step models the link well when its ages, median and 95th percentile, are those of the live
/// landings times this: single streams at 30 % loss differ among themselves by 1.2 and 2.
const BANDS: [[f64; 2]; 2] = [[0.67, 1.5], [0.5, 2.0]];

/// A link over a transport.
#[derive(Serialize)]
struct LinkRow {
    link: &'static str,
    transport: &'static str,
    agrees: bool,
    summary: PairedSummary,
}

/// Lock-step over live, median and 95th percentile of the age.
fn ratios(s: &PairedSummary) -> [f64; 2] {
    [0, 1].map(|k: usize| s.lock_step.age_s[k] / s.live.age_s[k])
}

fn table(rows: &[LinkRow]) -> Table {
    let mut table = Table::new(
        2..,
        [
            "link",
            "transport",
            "landed live / in lock-step",
            "unsafe live",
            "error, m",
            "time, s",
            "aborts",
            "greatest age at touchdown",
            "age p50",
            "age p95",
            "lock-step over live",
        ],
    );
    for row in rows {
        let (live, model) = (&row.summary.live, &row.summary.lock_step);
        let pair = |value: fn(&Side) -> String| format!("{} / {}", value(live), value(model));
        let [p50, p95] = ratios(&row.summary);
        table.row(
            cells![
                row.link,
                row.transport,
                format_args!("{} / {} of {}", live.landed, model.landed, row.summary.trials),
                row.summary.unsafe_contacts,
                pair(|s| format!("{:.3}", s.position_error_m)),
                pair(|s| format!("{:.1}", s.landing_time_s)),
                pair(|s| format!("{:.2}", s.aborts)),
                pair(|s| s.touchdown_age_s.map_or_else(|| "-".into(), time)),
                pair(|s| time(s.age_s[0])),
                pair(|s| time(s.age_s[1])),
            ]
            .into_iter()
            .chain([Cell::from(format!("{p50:.2}, {p95:.2}")).judged(row.agrees)]),
        );
    }
    table
}

/// Flies `n` seeds of every link over UDP and over QUIC.
pub fn run(args: &StudyArgs, n: u32) -> Result<Value, CliError> {
    let certificates = args.certificates.as_ref().map(|d| d.display().to_string());
    let mut rows = Vec::new();
    for (link, _, flags) in LINKS {
        for transport in TRANSPORTS {
            let words = format!("{flags} --emulate always --transport {transport}");
            let mut land: Vec<String> = words.split_whitespace().map(String::from).collect();
            if let Some(directory) = &certificates {
                land.extend(["--certificates".into(), directory.clone()]);
            }
            land.extend(args.land.iter().cloned());
            let plan = PairPlan {
                trials: n,
                seed0: args.seed0,
                jobs: 1,
                instance: "study".into(),
                flags: land,
            };
            let summary = pairs::fly_pairs(&land_flags(&plan.flags)?, &plan)?;
            let inside = |(ratio, [low, high]): (f64, [f64; 2])| (low..=high).contains(&ratio);
            let agrees = ratios(&summary).into_iter().zip(BANDS).all(inside);
            note(
                args.json,
                format_args!("{link} over {transport}: {} of {n} landed", summary.live.landed),
            );
            rows.push(LinkRow {
                link,
                transport,
                agrees,
                summary,
            });
        }
    }
    let verdict = format!(
        "lock-step's ages are {}-{} (median) and {}-{} (95th percentile) times the live ones in {} of {} rows",
        BANDS[0][0],
        BANDS[0][1],
        BANDS[1][0],
        BANDS[1][1],
        rows.iter().filter(|r| r.agrees).count(),
        rows.len()
    );
    note(args.json, format_args!("{}{verdict}", table(&rows).text()));
    let value = json!({ "rows": rows });
    if let Some(out) = &args.out {
        let document = Document {
            title: "Links, live beside lock-step".into(),
            blocks: vec![
                Block::Table(table(&rows)),
                Block::Text(format!("{verdict}.")),
                Block::Text("![live beside lock-step](live.svg)".into()),
            ],
        };
        write_files(
            out,
            &[
                ("live.md", document.markdown()),
                ("live.json", value.to_string()),
                ("live.svg", chart::sheet(&charts(&rows))),
            ],
        )?;
        note(
            args.json,
            format_args!("written: {}", out.join("live.md").display()),
        );
    }
    Ok(value)
}

/// What is drawn of each side, of so many trials.
type Drawn = fn(&Side, f64) -> Option<f64>;

const DRAWN: [(&str, Drawn); 6] = [
    ("landed, fraction", |s, trials| Some(s.landed as f64 / trials)),
    ("position error, m, median", |s, _| Some(s.position_error_m)),
    ("first descent to contact, s, median", |s, _| {
        Some(s.landing_time_s)
    }),
    ("aborted descents, mean", |s, _| Some(s.aborts)),
    ("greatest age of the vessel's state at touchdown, s", |s, _| {
        s.touchdown_age_s
    }),
    ("age of the vessel's state, s, 95th percentile", |s, _| {
        Some(s.age_s[1])
    }),
];

fn charts(rows: &[LinkRow]) -> Vec<Chart> {
    let labels = LINKS.map(|(_, short, _)| short.to_string());
    let chart = |(caption, drawn): (&str, Drawn)| {
        let curve = |transport: &str, name: &str, side: fn(&PairedSummary) -> &Side| {
            let point = |(link, ..): &(&str, &str, &str)| {
                let row = rows
                    .iter()
                    .find(|r| r.link == *link && r.transport == transport)?;
                drawn(side(&row.summary), row.summary.trials as f64).filter(|v| v.is_finite())
            };
            Curve {
                name: format!("{transport} {name}"),
                points: LINKS.iter().map(point).collect(),
            }
        };
        let curves: Vec<Curve> = TRANSPORTS
            .into_iter()
            .flat_map(|t| {
                [
                    curve(t, "live", |s| &s.live),
                    curve(t, "lock-step", |s| &s.lock_step),
                ]
            })
            .collect();
        Chart {
            caption: format!("{caption}, links in the table's order"),
            svg: chart::curves(&labels, &curves),
        }
    };
    DRAWN.map(chart).into()
}
