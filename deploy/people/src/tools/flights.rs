//! `alight flights`: flights that a computer recorded, with their outcomes.

use std::path::{Path, PathBuf};

use alight_computer::{
    cells,
    exit::{CliError, Exit},
    record::{
        flight::{
            mend::{Repair, mend},
            store::{self, StoredFlight},
            summary::FlightSummary,
        },
        reading::contained,
    },
    table::{Cell, Table},
    terminal::{self, Form, note},
};
use clap::Args;
use serde::Serialize;

use crate::view::picture::FlightLine;

const MAX_ON_PAGE: usize = 8;

/// Flights to list.
#[derive(Args, Debug)]
pub struct FlightsArgs {
    /// Directory of the flights (recorder.directory)
    #[arg(value_name = "DIR", default_value = "/var/lib/alight/flights")]
    pub directory: PathBuf,
    /// Repair files left without an end by a kill or a power cut, for viewers
    #[arg(long)]
    pub mend: bool,
    /// Output format.
    #[command(flatten)]
    pub form: Form,
}

#[derive(Debug, Serialize)]
struct Row {
    path: PathBuf,
    begun: String,
    /// State of the files: complete, running, cut off, or damaged.
    files: &'static str,
    /// Number of files, and number of files without an end.
    parts: usize,
    cut: usize,
    bytes: u64,
    #[serde(flatten)]
    summary: FlightSummary,
}

pub fn run(args: &FlightsArgs) -> Result<Exit, CliError> {
    let flights = flights(&args.directory)?;
    if args.mend {
        for flight in flights.iter().filter(|f| !f.is_running()) {
            let done = contained(&flight.path, || mend(&flight.path))?;
            if done != Repair::default() {
                note(args.form.alone(), repaired(&flight.path, &done));
            }
        }
    }
    let rows: Vec<Row> = flights.iter().map(Row::of).collect();
    if args.form.print(&serde_json::json!({ "flights": rows }), &rows)? {
        return Ok(Exit::Success);
    }
    if rows.is_empty() {
        terminal::line(format_args!("no flight in {}", args.directory.display()));
    } else {
        terminal::line(table(&rows).trim_end());
    }
    Ok(Exit::Success)
}

fn flights(directory: &Path) -> Result<Vec<StoredFlight>, CliError> {
    let below = store::flights(directory).map_err(|e| {
        CliError(format!(
            "reading the flights in {}: {e}; name the directory of recorder.directory in this computer's file",
            directory.display()
        ))
    })?;
    if !below.is_empty() || !store::is_flight(directory) {
        return Ok(below);
    }
    // Flights of `land --log` have no name.
    let own = StoredFlight::of(directory).unwrap_or_else(|| StoredFlight {
        path: directory.into(),
        number: 0,
        begun: String::new(),
    });
    Ok(vec![own])
}

fn repaired(path: &Path, done: &Repair) -> String {
    format!(
        "{}: files repaired: {}, steps: {}{}",
        path.display(),
        done.parts,
        done.steps,
        match done.empty {
            0 => String::new(),
            n => format!("; removed without a step: {n}"),
        }
    )
}

/// Newest completed flights in a recorder's directory, for the page.
pub fn earlier(directory: &str) -> Vec<FlightLine> {
    // Without a recorder no flight is recorded; `alight flights` reports a directory that cannot be read.
    let all = store::flights(Path::new(directory)).unwrap_or_default();
    let ended = all.iter().rev().filter(|f| !f.is_running());
    ended
        .take(MAX_ON_PAGE)
        .map(Row::of)
        .map(|row| FlightLine {
            text: format!("{}; {}", row.summary.reason, row.metrics()),
            outcome: row.summary.outcome,
            when: row.begun,
        })
        .collect()
}

impl Row {
    fn of(flight: &StoredFlight) -> Row {
        let (parts, cut) = flight.parts();
        let (running, summary) = (flight.is_running(), flight.summary());
        let files = match (&summary, running) {
            (_, true) => "running",
            _ if cut > 0 => "cut off",
            (Some(s), false) if !s.ended => "cut off",
            (None, false) => "no summary",
            (Some(_), false) => "complete",
        };
        Row {
            path: flight.path.clone(),
            begun: flight.begun.clone(),
            files,
            parts,
            cut,
            bytes: flight.bytes(),
            summary: summary.unwrap_or_default(),
        }
    }
    fn metrics(&self) -> String {
        let of = |name: &str| self.summary.figures.get(name).copied();
        let counted = |name: &str, one: &str, more: &str| {
            of(name)
                .filter(|n| *n >= 1.0)
                .map(|n| format!("{n:.0} {}", if n == 1.0 { one } else { more }))
        };
        let parts = [
            counted("landed", "landing", "landings"),
            counted("gave_up", "given up", "given up"),
            of("landing_s").map(|s| format!("in {s:.0} s")),
            of("off_centre_m").map(|m| format!("{m:.2} m off centre")),
            counted("descents", "descent", "descents"),
            of("battery").map(|b| format!("battery {:.0} %", 100.0 * b)),
            of("link_age_max_s").map(|s| format!("link {s:.1} s old at most")),
            of("wave_height_m").map(|m| format!("waves {m:.1} m")),
            counted("restarts", "restart", "restarts"),
        ];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

fn length(s: f64) -> String {
    let s = s.max(0.0).round() as u64;
    match s / 3600 {
        0 => format!("{}:{:02}", s / 60, s % 60),
        hours => format!("{hours}:{:02}:{:02}", s / 60 % 60, s % 60),
    }
}

fn table(rows: &[Row]) -> String {
    let heads = [
        "flight (UTC)",
        "length",
        "MB",
        "files",
        "computer",
        "outcome",
        "metrics",
    ];
    let mut table = Table::new(1..3, heads);
    for row in rows {
        let name = row.path.file_name().unwrap_or(row.path.as_os_str());
        let mut outcome = Cell::from(&row.summary.outcome);
        if !row.summary.reason.is_empty() {
            outcome = outcome.note(&row.summary.reason);
        }
        table.row(cells![
            name.to_string_lossy(),
            length(row.summary.length_s),
            Cell::number(row.bytes as f64 / 1e6, 1),
            row.files,
            row.summary.computer,
            outcome,
            row.metrics(),
        ]);
    }
    table.text()
}
