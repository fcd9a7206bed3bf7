//! `alight study --forecasts`: errors of the drones' forecasts of the deck in a study's scenes.

use alight_computer::{
    exit::{CliError, Doing},
    terminal::{Form, line},
};
use alight_people::tools::estimate::show;
use alight_sim::{
    harness::{
        scenario::NodeConfigs,
        trial::{Watch, fly_with},
    },
    studies::forecasts::ForecastErrors,
};
use alight_usv::review::{PredictionReview, Predictions};
use serde::Serialize;

use super::{rows::StudyRow, run::GridRun};
use crate::trials::{in_parallel, seeds};

/// Name of the drone's own predictor.
const OWN: &str = "own";

#[derive(Serialize)]
struct ForecastRow<'a> {
    scenario: &'a str,
    planner: &'a str,
    predictor: &'a str,
    #[serde(flatten)]
    errors: PredictionReview,
}

/// Errors in the trials of a row with these nodes.
fn compared(
    run: &GridRun<'_>,
    row: &StudyRow,
    nodes: &NodeConfigs,
) -> Result<Vec<PredictionReview>, CliError> {
    let work = seeds(run.seed0, run.trials)?;
    let flown = in_parallel(run.jobs, "trials", &work, |seed| {
        let mut errors = ForecastErrors::of(&row.world, *seed);
        let watch = Watch {
            on_event: &mut |_| {},
            trace_step_s: None,
        };
        fly_with(&row.world, nodes, *seed, &row.scenario, watch, &mut errors).doing(format_args!(
            "setting up the trial of seed {seed} at {}",
            row.scenario
        ))?;
        Ok(errors.compared)
    })?;
    let mut pooled = Predictions::default();
    flown.iter().for_each(|one| pooled.add(one));
    Ok(pooled.reviews(true))
}

pub fn fly(form: Form, run: &GridRun<'_>, rows: &[StudyRow]) -> Result<(), CliError> {
    let mut printed = Vec::new();
    for row in rows {
        let own = NodeConfigs {
            predictor: None,
            ..row.nodes.clone()
        };
        let given = row.nodes.predictor.as_ref().map(|p| (p.name(), &row.nodes));
        for (predictor, nodes) in [(OWN, &own)].into_iter().chain(given) {
            let errors = compared(run, row, nodes)?;
            if !form.alone() {
                line(format_args!(
                    "{} of {}, predictor {predictor}",
                    row.scenario, row.planner
                ));
                line(show::predictions("forecast", &errors).text());
            }
            printed.extend(errors.into_iter().map(|errors| ForecastRow {
                scenario: &row.scenario,
                planner: &row.planner,
                predictor,
                errors,
            }));
        }
    }
    form.print(&printed, &printed)?;
    Ok(())
}
