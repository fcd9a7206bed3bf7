//! `alight study airborne`: hours in the air near the deck, and motors that stopped there.

use alight_sim::studies::airborne::{AirborneReport, fly_session};
use serde_json::{Value, json};

use crate::cells;
use crate::exit::CliError;
use crate::lab::args::{SceneArgs, SeaArg, StudyArgs};
use crate::lab::scene::Scene;
use crate::lab::trials::{in_parallel, seeds};
use crate::table::Table;
use crate::terminal::note;

/// Seas of the study.
const SEAS: [&str; 5] = ["calm", "slight", "moderate", "rough", "very-rough"];
/// One session, s.
const SESSION_S: f64 = 600.0;

/// The study.
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    let seeds = seeds(args.seed0, args.trials)?;
    let mut table = Table::new(
        1..,
        [
            "sea",
            "h in the air",
            "false stops",
            "aborts",
            "contacts",
            "in water",
            "lowest m",
        ],
    );
    let mut add = |name: &str, r: &AirborneReport| {
        table.row(cells![
            name,
            format_args!("{:.2}", r.hours),
            r.false_stops,
            r.aborts,
            r.contacts,
            r.water,
            format_args!("{:.2}", r.lowest_m),
        ]);
    };
    let mut rows = Vec::new();
    let mut total = AirborneReport {
        lowest_m: f64::INFINITY,
        ..AirborneReport::default()
    };
    for name in SEAS {
        let scene = Scene::of(&SceneArgs {
            sea: Some(name.parse::<SeaArg>().map_err(CliError)?),
            ..args.scene.clone()
        })?;
        let reports = in_parallel(args.jobs, name, &seeds, |seed| {
            fly_session(&scene.scenario, &scene.nodes, *seed, SESSION_S)
                .map(|report| (*seed, report))
                .map_err(|e| CliError::because(format!("setting up the session of seed {seed}"), e))
        })?;
        // By their seeds they can be flown again.
        let of = |bad: fn(&AirborneReport) -> bool| -> Vec<u64> {
            let bad = reports.iter().filter(|(_, r)| bad(r));
            bad.map(|(seed, _)| *seed).collect()
        };
        let (stopped, in_water) = (of(|r| r.false_stops > 0), of(|r| r.water > 0));
        let all = reports.iter().map(|(_, report)| *report);
        let sum = all.reduce(AirborneReport::and).unwrap_or_default();
        if !stopped.is_empty() || !in_water.is_empty() {
            note(
                args.json,
                format_args!("{name}: stopped in the air: seeds {stopped:?}; in water: seeds {in_water:?}"),
            );
        }
        add(name, &sum);
        rows.push(json!({ "sea": name, "report": sum, "stopped": stopped, "in_water": in_water }));
        total = total.and(sum);
    }
    add("total", &total);
    note(args.json, table.text());
    Ok(json!({ "seas": rows, "total": total }))
}
