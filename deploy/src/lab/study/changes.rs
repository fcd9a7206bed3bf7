//! The vessel's prediction 1 s ahead after a turn, a change of speed or a gap of its inertial sensor, and in a
//! following sea.

use alight_sim::physics::vessel::response::HULLS;
use alight_sim::studies::changes::{self as study, Change, Errors, QUANTITIES, RunErrors, SINCE_S};
use serde_json::{Value, json};

use super::variant::on_hull;
use crate::cells;
use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::report::document::Block;
use crate::lab::scene::Scene;
use crate::lab::trials::in_parallel;
use crate::table::{Cell, Table};
use crate::terminal::note;

/// Range of the normalised squared error that is required from two seconds after the change on.
const REQUIRED_NEES: [f64; 2] = [0.5, 2.6];
/// Where that begins, s.
const REQUIRED_FROM_S: f64 = 2.0;

/// Runs every change with every seed on a hull (`--hull`, else mono-5m) in a sea (`--sea`, else JONSWAP 1 m, 5 s); prints
/// the table, gives blocks of the report and the JSON.
pub fn run(args: &StudyArgs, base: &Scene, seeds: &[u64]) -> Result<(Vec<Block>, Vec<Value>), CliError> {
    let hull = args.scene.hull.as_deref().unwrap_or(HULLS[1]);
    let sea = match &args.scene.sea {
        Some(sea) => sea.config.clone(),
        None => "jonswap:1,5".parse().map_err(CliError)?,
    };
    let scene = on_hull(&args.scene, base, Some(hull), &sea)?;
    let heads = [
        "change",
        "s since",
        "quantity",
        "node",
        "reference",
        "motion",
        "NEES",
    ];
    let (mut table, mut values) = (Table::new(3.., heads), Vec::new());
    for change in Change::ALL {
        let runs = in_parallel(args.jobs, &change.name(), seeds, |seed| {
            study::run(&scene.world, &scene.nodes.vessel, change, *seed)
                .map_err(|e| CliError::because(format!("setting up the run of seed {seed}"), e))
        })?;
        rows(change, &runs, &mut table, &mut values);
    }
    let text = format!(
        "Prediction 1 s ahead on {hull}, {} seeds from {} on, by the time since the change: RMSE of the vessel's \
         broadcast and of the ridge regression on its published estimates, RMS of the motion, and the normalised \
         squared error, required {} to {} from {REQUIRED_FROM_S} s on.",
        seeds.len(),
        args.seed0,
        REQUIRED_NEES[0],
        REQUIRED_NEES[1],
    );
    note(args.json, format_args!("{text}\n{}", table.text()));
    let blocks = vec![
        Block::Heading("After a change".into()),
        Block::Text(text),
        Block::Table(table),
    ];
    Ok((blocks, values))
}

fn rows(change: Change, runs: &[RunErrors], table: &mut Table, values: &mut Vec<Value>) {
    for (bin, [from, to]) in SINCE_S.into_iter().enumerate() {
        for (q, quantity) in QUANTITIES.into_iter().enumerate() {
            let all = runs
                .iter()
                .map(|r| r[bin][q])
                .fold(Errors::default(), Errors::and);
            let Some([node, reference, motion, nees]) = all.scores() else {
                continue;
            };
            let since = if from < 0.0 {
                "before".into()
            } else {
                format!("{from}-{to}")
            };
            let mut cells = cells![change.name(), since, quantity].to_vec();
            cells.extend([node, reference, motion].map(|v| Cell::number(v, 4)));
            let [least, most] = REQUIRED_NEES;
            let nees_cell = Cell::number(nees, 2);
            let required = from >= REQUIRED_FROM_S || matches!(change, Change::FollowingSea(_));
            cells.push(if required {
                nees_cell.judged((least..=most).contains(&nees))
            } else {
                nees_cell
            });
            table.row(cells);
            values.push(json!({
                "change": change.name(), "since_s": [from, to], "quantity": quantity, "count": all.count,
                "rmse": node, "reference_rmse": reference, "motion_rms": motion, "nees": nees,
            }));
        }
    }
}
