//! `alight study estimator`: the vessel's estimator against the truth.

use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::vessel::Course;
use alight_sim::studies::estimator as est;
use serde_json::{Value, json};

use crate::cells;
use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::scene::Scene;
use crate::lab::trials::{in_parallel, seeds};
use crate::table::{Cell, Table};
use crate::terminal::note;

/// RMSE of the authors' estimator at Moderate (Procházka 2024).
const PUBLISHED_RMSE: [(&str, f64); 4] = [
    ("position m", 0.116),
    ("attitude rad", 0.017),
    ("velocity m/s", 0.201),
    ("rates rad/s", 0.004),
];
/// Length of one run after the warm-up, s.
const ESTIMATOR_S: f64 = 60.0;
/// Length of one run on a square course, s.
const TURNS_S: f64 = 180.0;
/// Degrees of freedom that are predicted, by their index.
const PREDICTED: [(usize, &str); 3] = [(2, "heave m"), (3, "roll rad"), (4, "pitch rad")];

/// The study.
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    let scene = Scene::of(&args.scene)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let fly = |scenario: &Scenario, span_s: f64, what: &str| {
        in_parallel(args.jobs, what, &seeds, |seed| {
            est::run(scenario, &scene.nodes.vessel, *seed, span_s)
                .map_err(|e| CliError::because(format!("setting up the run of seed {seed}"), e))
        })
    };
    let runs = fly(&scene.scenario, ESTIMATOR_S, "estimator")?;
    let state = est::state_errors(&runs);
    let mut errors = Table::new(1.., ["RMSE", "per axis", "3-D norm", "published"]);
    for (i, (name, published)) in PUBLISHED_RMSE.into_iter().enumerate() {
        let cells = [(state.per_axis[i], 4), (state.norm[i], 4), (published, 3)];
        let cells = cells.map(|(value, digits)| Cell::number(value, digits));
        errors.row(core::iter::once(name.into()).chain(cells));
    }
    let nees: Vec<String> = state.nees.iter().map(|n| format!("{n:.2}")).collect();
    note(
        args.json,
        format_args!(
            "{} seeds x {ESTIMATOR_S} s, sea {}, in the vessel's own GNSS frame\n{}  NEES per degree of freedom (2 \
             when consistent): {}",
            seeds.len(),
            scene.sea,
            errors.text(),
            nees.join("  ")
        ),
    );

    let mut table = Table::new(1.., ["prediction RMSE", "model", "hold", "const. vel.", "growth"]);
    let mut predictions = Vec::new();
    for (dof, name) in PREDICTED {
        for horizon in [0.5, 1.0, 2.0] {
            let e = est::prediction_error(&runs, dof, horizon, |_, _| true);
            let label = format!("{name}, {horizon} s ahead").into();
            let cells = [e.model, e.hold, e.velocity, e.growth].map(|v| Cell::number(v, 4));
            table.row(core::iter::once(label).chain(cells));
            predictions.push(json!({ "dof": name, "horizon_s": horizon, "error": e }));
        }
    }
    note(args.json, table.text());

    let mut square = scene.scenario.clone();
    square.vessel.course = Course::Square;
    square.vessel.speed_mps = 2.0;
    // Legs long enough to be steady again before the next turn.
    square.vessel.side_m = 80.0;
    let mut straight = square.clone();
    straight.vessel.course = Course::Straight;
    let (turning, steady) = (
        fly(&square, TURNS_S, "turns")?,
        fly(&straight, ESTIMATOR_S, "straight")?,
    );
    let mut table = Table::new(
        1..,
        [
            "1 s ahead at 2 m/s",
            "8 to 12 s after a 90 deg turn",
            "later",
            "straight",
            "after turn / later",
        ],
    );
    let mut turns = Vec::new();
    for (dof, name) in PREDICTED {
        let after = est::prediction_error(&turning, dof, 1.0, |r, t| est::after_turn(r, t, 8.0, 12.0));
        let later = est::prediction_error(&turning, dof, 1.0, |r, t| est::after_turn(r, t, 25.0, 40.0));
        let line = est::prediction_error(&steady, dof, 1.0, |_, _| true);
        table.row(cells![
            name,
            format_args!("{:.4}", after.model),
            format_args!("{:.4}", later.model),
            format_args!("{:.4}", line.model),
            format_args!("{:.2}", after.model / later.model),
        ]);
        turns.push(json!({ "dof": name, "after_turn": after, "later": later, "straight": line }));
    }
    note(args.json, table.text());
    Ok(json!({ "state": state, "prediction": predictions, "turns": turns }))
}
