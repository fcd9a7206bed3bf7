//! `alight study fleet`: two and three drones above one deck.

use alight_sim::studies::fleet::{FleetReport, fly};
use serde_json::{Value, json};

use crate::cells;
use crate::exit::{CliError, Doing};
use crate::lab::args::StudyArgs;
use crate::lab::scene::Scene;
use crate::lab::trials::{in_parallel, seeds};
use crate::table::Table;
use crate::terminal::note;

/// The study: each seed once with two and once with three drones.
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    let scene = Scene::of(&args.scene)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let mut table = Table::new(
        1..,
        [
            "drones",
            "trials",
            "landings",
            "descents",
            "aborts, holds",
            "outages",
            "closures",
            "two below",
            "on occupied",
            "on closed",
            "collisions",
            "in water",
            "nearest m",
        ],
    );
    let mut rows = Vec::new();
    for drones in [2, 3] {
        let flown = in_parallel(args.jobs, &format!("{drones} drones"), &seeds, |seed| {
            fly(&scene.scenario, &scene.nodes, *seed, drones)
                .map(|report| (*seed, report))
                .doing(format_args!("setting up the trial of seed {seed}"))
        })?;
        let sum = flown
            .iter()
            .map(|(_, r)| *r)
            .reduce(FleetReport::and)
            .unwrap_or_default();
        table.row(cells![
            drones,
            flown.len(),
            sum.landings,
            sum.descents,
            sum.stops,
            sum.outages,
            sum.closures,
            sum.two_below,
            sum.on_occupied,
            sum.on_closed,
            sum.collisions,
            sum.in_water,
            format_args!("{:.1}", sum.nearest_m),
        ]);
        // By these they can be flown again.
        let wrong: Vec<Value> = flown
            .iter()
            .filter(|(_, r)| !r.safe())
            .map(|(seed, report)| json!({ "seed": seed, "report": report }))
            .collect();
        rows.push(json!({ "drones": drones, "trials": flown.len(), "sum": sum, "wrong": wrong }));
    }
    note(args.json, table.text());
    for row in &rows {
        for wrong in row["wrong"].as_array().into_iter().flatten() {
            note(args.json, format_args!("{} drones, {wrong}", row["drones"]));
        }
    }
    Ok(json!({ "rows": rows }))
}
