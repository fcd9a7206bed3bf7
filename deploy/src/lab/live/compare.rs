//! `alight study link --live N`: a few bad links live across the link emulator, beside lock-step.

use std::path::Path;

use serde_json::{Value, json};

use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::live::lands;
use crate::lab::live::lands::{PairedSummary, Plan};
use crate::lab::study::link::{Curve, chart, chart_sheet};
use crate::process::snapshot::time;
use crate::terminal::note;

/// The links: name, and flags of `alight land`.
const LINKS: [(&str, &[&str]); 5] = [
    ("wifi-near", &["--link", "wifi-near"]),
    ("wifi-far", &["--link", "wifi-far"]),
    ("storm", &["--link", "storm"]),
    (
        "storm, 2 s of silence from the flare",
        &["--link", "storm", "--radio-lost", "flare", "--radio-back", "2"],
    ),
    (
        "radio-mesh, 10 s of silence from tracking",
        &[
            "--link",
            "radio-mesh",
            "--radio-lost",
            "tracking",
            "--radio-back",
            "10",
        ],
    ),
];

/// Lock-step models the link well when its ages, median and 95th percentile, are those of the live
/// landings times this: single streams at 30 % loss differ among themselves by 1.2 and 2.
const BANDS: [[f64; 2]; 2] = [[0.67, 1.5], [0.5, 2.0]];

/// A link over a transport.
struct LinkRow {
    link: &'static str,
    transport: &'static str,
    n: u32,
    summary: PairedSummary,
}

impl LinkRow {
    /// Lock-step over live, median and 95th percentile of the age.
    fn ratios(&self) -> [f64; 2] {
        let (live, model) = (self.summary.age_s, self.summary.age_lock_step_s);
        [model[0] / live[0], model[1] / live[1]]
    }
    fn agrees(&self) -> bool {
        let inside = |(ratio, [low, high]): (f64, [f64; 2])| (low..=high).contains(&ratio);
        self.ratios().into_iter().zip(BANDS).all(inside)
    }
    fn line(&self) -> String {
        let (s, n) = (&self.summary, self.n);
        let pair = |live: f64, model: f64, digits: usize| format!("{live:.digits$} / {model:.digits$}");
        let age = |k: usize| format!("{} / {}", time(s.age_s[k]), time(s.age_lock_step_s[k]));
        let [worst, worst_model] = s.touchdown_age_s.map(|a| a.map_or_else(|| "-".into(), time));
        let [p50, p95] = self.ratios();
        format!(
            "| {} | {} | {} / {} of {n} | {} | {} | {} | {} | {worst} / {worst_model} | {} | {} | {p50:.2}, {p95:.2}{} |",
            self.link,
            self.transport,
            s.landed,
            s.landed_lock_step,
            s.unsafe_contacts,
            pair(s.position_error_m, s.position_error_lock_step_m, 3),
            pair(s.landing_time_s, s.landing_time_lock_step_s, 1),
            pair(s.aborts[0], s.aborts[1], 2),
            age(0),
            age(1),
            if self.agrees() { "" } else { " outside" },
        )
    }
}

const HEAD: [&str; 2] = [
    "| link | transport | landed live / in lock-step | unsafe live | error, m | time, s | aborts | worst age at \
     touchdown | age p50 | age p95 | lock-step over live |",
    "|---|---|---|---|---|---|---|---|---|---|---|",
];

/// Flies `n` seeds of every link over UDP and over QUIC.
pub fn run(args: &StudyArgs, n: u32) -> Result<Value, CliError> {
    let say = |line: String| note(args.json, line);
    let certificates = args.certificates.as_ref().map(|d| d.display().to_string());
    let stream = "quic";
    HEAD.iter().for_each(|line| say((*line).into()));
    let mut rows = Vec::new();
    for (link, flags) in LINKS {
        for transport in ["udp", stream] {
            let mut land: Vec<String> = flags.iter().map(|f| (*f).to_string()).collect();
            land.extend(["--emulate", "always", "--transport", transport].map(String::from));
            if let Some(directory) = &certificates {
                land.extend(["--certificates".into(), directory.clone()]);
            }
            land.extend(args.land.iter().cloned());
            let summary = lands::fly_pairs(&Plan {
                trials: n,
                seed0: args.seed0,
                jobs: 1,
                instance: "study".into(),
                land,
            })?;
            let row = LinkRow {
                link,
                transport,
                n,
                summary,
            };
            say(row.line());
            rows.push(row);
        }
    }
    let agreed = rows.iter().filter(|r| r.agrees()).count();
    let verdict = format!(
        "lock-step's ages are {}-{} (median) and {}-{} (95th percentile) times the live ones in {agreed} of {} rows",
        BANDS[0][0],
        BANDS[0][1],
        BANDS[1][0],
        BANDS[1][1],
        rows.len()
    );
    say(verdict.clone());
    let values: Vec<Value> = rows
        .iter()
        .map(|r| json!({ "link": r.link, "transport": r.transport, "agrees": r.agrees(), "summary": r.summary }))
        .collect();
    let value = json!({ "rows": values });
    if let Some(out) = &args.out {
        write(out, &rows, &verdict, &value, stream)?;
        say(format!("written: {}", out.join("live.md").display()));
    }
    Ok(value)
}

fn write(out: &Path, rows: &[LinkRow], verdict: &str, value: &Value, stream: &str) -> Result<(), CliError> {
    let mut table: Vec<String> = HEAD.iter().map(|l| (*l).to_string()).collect();
    table.extend(rows.iter().map(LinkRow::line));
    let text = format!(
        "# Links, live beside lock-step\n\n{}\n\n{verdict}.\n\n![live beside lock-step](live.svg)\n",
        table.join("\n")
    );
    std::fs::create_dir_all(out).map_err(|e| CliError::because(format!("making {}", out.display()), e))?;
    for (name, text) in [
        ("live.md", text),
        ("live.json", value.to_string()),
        ("live.svg", chart_sheet(&charts(rows, stream))),
    ] {
        let path = out.join(name);
        std::fs::write(&path, text)
            .map_err(|e| CliError::because(format!("writing {}", path.display()), e))?;
    }
    Ok(())
}

/// What is drawn: caption, the figure live, the figure in lock-step.
type Drawn = (
    &'static str,
    fn(&PairedSummary) -> Option<f64>,
    fn(&PairedSummary) -> Option<f64>,
);

const DRAWN: [Drawn; 6] = [
    (
        "landed, share",
        |s| Some(s.landed as f64 / s.trials as f64),
        |s| Some(s.landed_lock_step as f64 / s.trials as f64),
    ),
    (
        "position error, m, median",
        |s| Some(s.position_error_m),
        |s| Some(s.position_error_lock_step_m),
    ),
    (
        "first descent to contact, s, median",
        |s| Some(s.landing_time_s),
        |s| Some(s.landing_time_lock_step_s),
    ),
    (
        "aborted descents, mean",
        |s| Some(s.aborts[0]),
        |s| Some(s.aborts[1]),
    ),
    (
        "worst age of the vessel's state at touchdown, s",
        |s| s.touchdown_age_s[0],
        |s| s.touchdown_age_s[1],
    ),
    (
        "age of the vessel's state, s, 95th percentile",
        |s| Some(s.age_s[1]),
        |s| Some(s.age_lock_step_s[1]),
    ),
];

fn charts(rows: &[LinkRow], stream: &str) -> Vec<(String, String)> {
    // Short, so that they stand side by side; the table has the names.
    let labels = ["wifi-near", "wifi-far", "storm", "storm, 2 s", "mesh, 10 s"].map(String::from);
    DRAWN
        .iter()
        .map(|(caption, live, model)| {
            let curve = |transport: &str, name: &str, f: &fn(&PairedSummary) -> Option<f64>| Curve {
                name: format!("{transport} {name}"),
                points: LINKS
                    .iter()
                    .map(|(link, _)| {
                        let row = rows
                            .iter()
                            .find(|r| r.link == *link && r.transport == transport)?;
                        f(&row.summary).filter(|v| v.is_finite())
                    })
                    .collect(),
            };
            let curves: Vec<Curve> = ["udp", stream]
                .into_iter()
                .flat_map(|t| [curve(t, "live", live), curve(t, "lock-step", model)])
                .collect();
            (
                format!("{caption}, links in the table's order"),
                chart(&labels, &curves),
            )
        })
        .collect()
}
