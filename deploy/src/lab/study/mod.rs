//! `alight study` and `alight response`: one thing measured over many seeds.

mod ablation;
mod camera;
mod flown;
mod grid;
pub mod link;
mod prediction;
mod prediction_report;
mod publish;
mod report;
pub mod run;
mod search;

use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::vessel::{Course, VesselConfig};
use alight_sim::studies::airborne::{self, AirborneReport};
use alight_sim::studies::estimator as est;
use alight_sim::studies::rao::{self, RaoConfig};
use alight_uav::planner::PlannerKind;
use indicatif::ParallelProgressIterator;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::exit::{CliError, Exit};
use crate::lab::args::{ResponseArgs, SceneArgs, SeaArg, Study, StudyArgs};
use crate::lab::scene::Scene;
use crate::lab::trials::{bar, pool, seeds};
use crate::terminal;
use crate::terminal::note;
use flown::PlannerVariant;

/// Runs a study.
pub fn run(args: &StudyArgs) -> Result<Exit, CliError> {
    if !args.dirs.is_empty() && args.name != Study::Merge {
        return Err(CliError("directories are given to `study merge` only".into()));
    }
    if let (Study::Link, Some(n)) = (args.name, args.live) {
        let value = crate::lab::live::compare::run(args, n)?;
        if args.json {
            terminal::line(value);
        }
        return Ok(Exit::Success);
    }
    let value = match args.name {
        Study::Airborne => airborne_hours(args)?,
        Study::Camera => camera::run(args)?,
        Study::Estimator => estimator(args)?,
        Study::Prediction => prediction::run(args)?,
        Study::Merge => merge(args)?,
        Study::Search => search::run(args)?,
        Study::Table1
        | Study::Table2
        | Study::Coupling
        | Study::Faa
        | Study::Ablation
        | Study::Approach
        | Study::Moving
        | Study::Seas
        | Study::Wind
        | Study::Sensors
        | Study::Link => grid_study(args)?,
    };
    if args.json {
        terminal::line(value);
    }
    Ok(Exit::Success)
}

fn planners(args: &StudyArgs, base: &Scene) -> Vec<PlannerVariant> {
    let mut kinds: Vec<PlannerKind> = match (&args.planners[..], args.name) {
        ([], Study::Faa) => vec![PlannerKind::MpcFaa, PlannerKind::Mpc],
        ([], _) => vec![base.nodes.drone.planner.kind],
        (given, _) => given.iter().map(|p| p.kind()).collect(),
    };
    let mut seen = Vec::new();
    kinds.retain(|k| {
        !seen.contains(k) && {
            seen.push(*k);
            true
        }
    });
    kinds.into_iter().map(PlannerVariant::from).collect()
}

fn title(study: Study) -> String {
    use clap::ValueEnum;
    format!(
        "Study {}",
        study
            .to_possible_value()
            .map_or_else(String::new, |v| v.get_name().to_string())
    )
}

fn grid_study(args: &StudyArgs) -> Result<Value, CliError> {
    let base = Scene::of(&args.scene)?;
    let rows = grid::rows(args.name, &base)?;
    let planners = match args.name {
        Study::Ablation if args.planners.is_empty() => ablation::planners(&base.nodes).map_err(CliError)?,
        _ => planners(args, &base),
    };
    let outcomes = run::fly_grid(args, &rows, &planners)?;
    let hash = run::configuration_hash(&base.nodes);
    let charts = match args.name {
        Study::Link => link::charts(&planners, &outcomes),
        _ => Vec::new(),
    };
    if let (Study::Link, Some(out)) = (args.name, &args.out) {
        let path = out.join("link.svg");
        std::fs::write(&path, link::chart_sheet(&charts))
            .map_err(|e| CliError::because(format!("writing {}", path.display()), e))?;
    }
    let value = publish::publish(args, &title(args.name), &hash, &planners, &outcomes, charts)?;
    if args.name == Study::Link {
        for line in link::table(&planners, &rows, &outcomes) {
            note(args.json, line);
        }
    }
    for line in grid::answer(args.name, &rows, &planners, &outcomes) {
        note(args.json, line);
    }
    Ok(value)
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
    publish::publish(args, "Merged study", &hash, &planners, &outcomes, Vec::new())
}

fn sea(args: &SceneArgs, text: &str) -> Result<SceneArgs, CliError> {
    let sea: SeaArg = text.parse().map_err(CliError)?;
    Ok(SceneArgs {
        sea: Some(sea),
        ..args.clone()
    })
}

/// Seas of the airborne study.
const AIRBORNE_SEAS: [&str; 5] = ["calm", "slight", "moderate", "rough", "very-rough"];
/// One session of the airborne study, s.
const SESSION_S: f64 = 600.0;

fn airborne_hours(args: &StudyArgs) -> Result<Value, CliError> {
    let say = |line: String| note(args.json, line);
    let seeds = seeds(args.seed0, args.trials)?;
    let mut rows = Vec::new();
    let mut total = AirborneReport {
        lowest_m: f64::INFINITY,
        ..AirborneReport::default()
    };
    for name in AIRBORNE_SEAS {
        let scene = Scene::of(&sea(&args.scene, name)?)?;
        let progress = bar(seeds.len() as u64, name);
        let reports: Result<Vec<(u64, AirborneReport)>, CliError> = pool(args.jobs)?.install(|| {
            seeds
                .par_iter()
                .progress_with(progress.clone())
                .map(|&seed| {
                    airborne::fly_session(&scene.scenario, &scene.nodes, seed, SESSION_S)
                        .map(|report| (seed, report))
                        .map_err(|e| CliError::because(format!("setting up the session of seed {seed}"), e))
                })
                .collect()
        });
        progress.finish_and_clear();
        let reports = reports?;
        // By their seeds they can be flown again.
        let of = |bad: fn(&AirborneReport) -> bool| -> Vec<u64> {
            reports
                .iter()
                .filter(|(_, r)| bad(r))
                .map(|(seed, _)| *seed)
                .collect()
        };
        let (stopped, drowned) = (of(|r| r.false_stops > 0), of(|r| r.water > 0));
        let all = reports.iter().map(|(_, report)| *report);
        let sum = all.reduce(AirborneReport::and).unwrap_or_default();
        say(format!(
            "{name:<12}{:>7.2} h in the air, {} false stops, {} aborts, {} contacts, {} in water, lowest {:.2} m",
            sum.hours, sum.false_stops, sum.aborts, sum.contacts, sum.water, sum.lowest_m
        ));
        if !stopped.is_empty() || !drowned.is_empty() {
            say(format!(
                "  stopped in the air: seeds {stopped:?}; in water: seeds {drowned:?}"
            ));
        }
        rows.push(json!({ "sea": name, "report": sum, "stopped": stopped, "in_water": drowned }));
        total = total.and(sum);
    }
    say(format!(
        "total       {:>7.2} h in the air, {} false stops",
        total.hours, total.false_stops
    ));
    Ok(json!({ "seas": rows, "total": total }))
}

/// RMSE of the authors' estimator at Moderate (Procházka 2024): position m, attitude rad, velocity
/// m/s, rates rad/s.
const PUBLISHED_RMSE: [f64; 4] = [0.116, 0.017, 0.201, 0.004];
/// Length of one run after the warm-up, s.
const ESTIMATOR_S: f64 = 60.0;
/// Length of one run on a square course, s.
const TURNS_S: f64 = 180.0;

fn estimator(args: &StudyArgs) -> Result<Value, CliError> {
    let say = |line: String| note(args.json, line);
    let scene = Scene::of(&args.scene)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let fly = |scenario: &Scenario, span_s: f64, what: &str| -> Result<Vec<est::Run>, CliError> {
        let progress = bar(seeds.len() as u64, what);
        let runs = pool(args.jobs)?.install(|| {
            seeds
                .par_iter()
                .progress_with(progress.clone())
                .map(|&seed| {
                    est::run(scenario, &scene.nodes.vessel, seed, span_s)
                        .map_err(|e| CliError::because(format!("setting up the run of seed {seed}"), e))
                })
                .collect()
        });
        progress.finish_and_clear();
        runs
    };
    let runs = fly(&scene.scenario, ESTIMATOR_S, "estimator")?;
    let state = est::state_errors(&runs);
    say(format!(
        "{} seeds x {ESTIMATOR_S} s, sea {}, in the vessel's own GNSS frame",
        seeds.len(),
        scene.sea
    ));
    say(format!(
        "  {:<12}{:>12}{:>12}{:>12}",
        "RMSE", "per axis", "3-D norm", "published"
    ));
    let names = ["position m", "attitude rad", "velocity m/s", "rates rad/s"];
    for (i, name) in names.into_iter().enumerate() {
        say(format!(
            "  {name:<12}{:>12.4}{:>12.4}{:>12.3}",
            state.per_axis[i], state.norm[i], PUBLISHED_RMSE[i]
        ));
    }
    let nees: Vec<String> = state.nees.iter().map(|n| format!("{n:.2}")).collect();
    say(format!(
        "  NEES per degree of freedom (2 when consistent): {}",
        nees.join("  ")
    ));
    say(format!(
        "  {:<24}{:>10}{:>10}{:>12}{:>10}",
        "prediction RMSE", "model", "hold", "const. vel.", "growth"
    ));
    let mut predictions = Vec::new();
    for (dof, name) in [(2, "heave m"), (3, "roll rad"), (4, "pitch rad")] {
        for horizon in [0.5, 1.0, 2.0] {
            let e = est::prediction_error(&runs, dof, horizon, |_, _| true);
            say(format!(
                "  {:<24}{:>10.4}{:>10.4}{:>12.4}{:>10.4}",
                format!("{name}, {horizon} s ahead"),
                e.model,
                e.hold,
                e.velocity,
                e.growth
            ));
            predictions.push(json!({ "dof": name, "horizon_s": horizon, "error": e }));
        }
    }

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
    say("  1 s ahead at 2 m/s: 8 to 12 s after a 90 deg turn, later on the same course, straight".into());
    let mut turns = Vec::new();
    for (dof, name) in [(2, "heave m"), (3, "roll rad"), (4, "pitch rad")] {
        let after = est::prediction_error(&turning, dof, 1.0, |r, t| est::after_turn(r, t, 8.0, 12.0));
        let later = est::prediction_error(&turning, dof, 1.0, |r, t| est::after_turn(r, t, 25.0, 40.0));
        let line = est::prediction_error(&steady, dof, 1.0, |_, _| true);
        let ratio = after.model / later.model;
        say(format!(
            "  {name:<24}{:>10.4}{:>10.4}{:>12.4}   ratio after turn / later {ratio:.2}",
            after.model, later.model, line.model
        ));
        turns.push(json!({ "dof": name, "after_turn": after, "later": later, "straight": line }));
    }
    Ok(json!({ "state": state, "prediction": predictions, "turns": turns }))
}

/// The response table.
pub fn response(args: &ResponseArgs) -> Result<Exit, CliError> {
    let table = rao::rao(&VesselConfig::default(), &RaoConfig::default());
    if args.json {
        terminal::line(serde_json::to_string(&table).map_err(|e| CliError::because("writing JSON", e))?);
    } else {
        terminal::line(table);
    }
    Ok(Exit::Success)
}
