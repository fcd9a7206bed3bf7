//! `alight study` and `alight rao`: one thing measured over many seeds.

mod ablation;
mod aborts;
mod airborne;
mod camera;
mod changes;
pub mod envelope;
mod equipment;
mod estimator;
mod fleet;
mod grid;
pub mod link;
mod moving;
mod prediction;
mod reference;
mod report;
pub mod run;
mod search;
mod variant;

use alight_sim::baselines::{Baseline, BenchPlanner};
use alight_sim::harness::outcome::Outcome;
use alight_sim::physics::vessel::VesselConfig;
use alight_sim::studies::rao::{RaoConfig, rao as compute_rao};
use alight_uav::planner::PlannerKind;
use clap::ValueEnum;
use serde_json::Value;

use super::args::{RaoArgs, SceneArgs, Study, StudyArgs};
use super::live::compare;
use super::report::chart;
use super::report::document::write_files;
use super::scene::Scene;
use crate::exit::{CliError, Exit};
use crate::terminal::{self, note};
use variant::PlannerVariant;

/// Runs a study.
pub fn run(args: &StudyArgs) -> Result<Exit, CliError> {
    if !args.dirs.is_empty() && args.name != Study::Merge {
        return Err(CliError("directories are given to `study merge` only".into()));
    }
    let value = match (args.name, args.live) {
        (Study::Link, Some(n)) => compare::run(args, n)?,
        (Study::Aborts, _) => aborts::run(args)?,
        (Study::Airborne, _) => airborne::run(args)?,
        (Study::Camera, _) => camera::run(args)?,
        (Study::Estimator, _) => estimator::run(args)?,
        (Study::Fleet, _) => fleet::run(args)?,
        (Study::Prediction, _) => prediction::run(args)?,
        (Study::Merge, _) => merge(args)?,
        (Study::Search, _) => search::run(args)?,
        (
            Study::Table1
            | Study::Table2
            | Study::Coupling
            | Study::Faa
            | Study::Ablation
            | Study::Approach
            | Study::Moving
            | Study::Seas
            | Study::Rocking
            | Study::Wind
            | Study::Sensors
            | Study::Size
            | Study::Link,
            _,
        ) => grid_study(args)?,
    };
    if args.json {
        terminal::line(value);
    }
    Ok(Exit::Success)
}

fn planners(args: &StudyArgs, base: &Scene) -> Vec<PlannerVariant> {
    let kinds: Vec<BenchPlanner> = match (&args.planners[..], args.name) {
        ([], Study::Faa) => vec![
            BenchPlanner::Flight(PlannerKind::MpcFaa),
            BenchPlanner::Baseline(Baseline::Mpc),
        ],
        ([], _) => vec![base.nodes.bench_planner()],
        (given, _) => given.iter().map(|p| p.kind()).collect(),
    };
    let mut variants: Vec<PlannerVariant> = Vec::new();
    for variant in kinds.into_iter().map(PlannerVariant::from) {
        if variants.iter().all(|v| v.name != variant.name) {
            variants.push(variant);
        }
    }
    variants
}

fn grid_study(args: &StudyArgs) -> Result<Value, CliError> {
    // The courses of `study moving` are its rows'.
    let speed = args.scene.speed.filter(|_| args.name != Study::Moving);
    let base = Scene::of(&SceneArgs {
        speed,
        ..args.scene.clone()
    })?;
    let scenes = grid::rows(args.name, &args.scene, &base)?;
    let planners = match args.name {
        Study::Ablation if args.planners.is_empty() => ablation::planners(&base.nodes).map_err(CliError)?,
        _ => planners(args, &base),
    };
    let outcomes = run::fly_grid(&args.grid(), &scenes, &planners)?;
    let hash = run::configuration_hash(&base.nodes);
    let is_link = args.name == Study::Link;
    let charts = if is_link {
        link::charts(&planners, &outcomes)
    } else {
        Vec::new()
    };
    if let (true, Some(out)) = (is_link, &args.out) {
        write_files(out, &[("link.svg", chart::sheet(&charts))])?;
    }
    let name = args.name.to_possible_value();
    let title = format!("Study {}", name.as_ref().map_or("", |v| v.get_name()));
    let value = report::publish(args, &title, &hash, &planners, &outcomes, charts)?;
    if is_link {
        note(args.json, link::table(&planners, &scenes, &outcomes).text());
    }
    if args.name == Study::Moving {
        return pooled_by_course(args, &planners, &outcomes, value);
    }
    Ok(value)
}

/// Prints the outcomes of `study moving` pooled by course, and adds them to its summary.
fn pooled_by_course(
    args: &StudyArgs,
    planners: &[PlannerVariant],
    outcomes: &[Outcome],
    rows: Value,
) -> Result<Value, CliError> {
    let pooled = moving::pool(&args.scene, planners, outcomes);
    let table = moving::table(&pooled);
    note(args.json, table.text());
    if let Some(out) = &args.out {
        write_files(out, &[("courses.md", table.markdown())])?;
    }
    let pooled: Vec<Value> = pooled.iter().map(moving::Pooled::json).collect();
    Ok(serde_json::json!({ "rows": rows, "courses": pooled }))
}

/// Joins the rows of shards into `--out`.
fn merge(args: &StudyArgs) -> Result<Value, CliError> {
    let Some(out) = &args.out else {
        return Err(CliError(
            "study merge: give the directory for the joined rows with --out".into(),
        ));
    };
    if args.dirs.is_empty() {
        return Err(CliError("study merge: name the directories of the shards".into()));
    }
    let (outcomes, hash) = run::join(&args.dirs, out)?;
    let mut planners: Vec<PlannerVariant> = args
        .planners
        .iter()
        .map(|p| PlannerVariant::from(p.kind()))
        .collect();
    for o in &outcomes {
        if !planners.iter().any(|p| p.name == o.planner) {
            planners.push(PlannerVariant::named(&o.planner));
        }
    }
    report::publish(args, "Merged study", &hash, &planners, &outcomes, Vec::new())
}

/// The response amplitude operators of the simulated vessel.
pub fn rao(args: &RaoArgs) -> Result<Exit, CliError> {
    let table = compute_rao(&VesselConfig::default(), &RaoConfig::default());
    if args.json {
        terminal::json(&table)?;
    } else {
        terminal::line(table);
    }
    Ok(Exit::Success)
}
