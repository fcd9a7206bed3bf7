//! The status of a vessel on one page.

use super::page::Page;
use crate::process::snapshot::time;
use crate::tools::check::finding::{Finding, Level};
use crate::vessel::status::Situation;

/// What the crew has to know: deck and drones, what is fine in one line each, and each finding that is not as an alarm.
pub fn page(seen: &Situation, findings: &[Finding]) -> Page {
    let state = match Level::worst(findings) {
        Level::Fine => "works",
        Level::Warning => "works, with warnings",
        Level::Broken => "BROKEN",
    };
    let status = &seen.status;
    let up_s = (seen.process.at_ns - seen.process.began_ns) as f64 * 1e-9;
    let drones: Vec<(u32, &str, bool)> = status
        .drones
        .iter()
        .map(|d| &d.status)
        .map(|d| (d.header.drone, d.state.name(), d.armed))
        .collect();
    let deck = (status.deck_owner, status.occupied, status.deck.closed);
    let title = format!("vessel {}: {state}, up {}", seen.vessel, time(up_s));
    let mut page = Page::new(title, format!("{deck:?} {drones:?}"));
    let owner = status.deck_owner;
    let owner = owner.map_or_else(|| "free".to_owned(), |id| format!("reserved for drone {id}"));
    let occupied = if status.occupied { ", occupied" } else { "" };
    let closed = if status.deck.closed.is_some() {
        "closed, "
    } else {
        ""
    };
    page.state_entry("deck", format!("{closed}{owner}{occupied}"));
    for topic in ["drones", "course", "heading", "estimator", "peers", "certificate"] {
        let fine = |f: &&Finding| f.topic == topic && f.level == Level::Fine;
        for finding in findings.iter().filter(fine) {
            if topic == "drones" {
                page.state_entry(finding.topic, &finding.found);
            } else {
                page.entry(finding.topic, &finding.found);
            }
        }
    }
    let sources = || findings.iter().filter(|f| f.topic == "source");
    let working = sources().filter(|f| f.level == Level::Fine).count();
    if sources().count() > 0 {
        page.entry("sources", format!("{working} of {} work", sources().count()));
    }
    let mut processes = format!("vessel {}", seen.process.pid);
    if let Some(pid) = seen.sensors_pid {
        processes.push_str(&format!(", sensors {pid}"));
    }
    page.entry("processes", processes);
    for f in findings.iter().filter(|f| f.level != Level::Fine) {
        page.alarm(
            f.level,
            f.topic,
            format!("{}: {} -> {}", f.topic, f.found, f.remedy),
        );
    }
    page
}
