//! `alight study` and `alight response`: one thing measured over many seeds.

use alight_sim::outcome::Outcome;
use alight_sim::response::{self, ResponseConfig};
use alight_sim::scenario::Scenario;
use alight_sim::statistics::Summary;
use alight_sim::studies::airborne::{self, Airborne};
use alight_sim::studies::estimator as est;
use alight_sim::vessel::{Course, VesselConfig};
use alight_uav::planner::PlannerKind;
use indicatif::ParallelProgressIterator;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::args::{Planner, ResponseArgs, SceneArgs, SeaArg, Study, StudyArgs};
use crate::scene::Scene;
use crate::trials::{bar, fly_all, pool, seeds};
use crate::{End, Refused, table};

/// Table II of Procházka et al.: sea, then precision (m), duration (s) and touchdown speed (m/s) of
/// their MPC-FAA.
const TABLE2: [(&str, f64, f64, f64); 10] = [
    ("0,0", 0.0, 11.8, 0.2),
    ("0.2,5", 0.1, 25.3, 0.3),
    ("0.3,5", 0.1, 18.7, 0.3),
    ("0.4,5", 0.2, 18.3, 0.4),
    ("0.4,4", 0.3, 24.6, 0.5),
    ("0.5,5", 0.1, 17.7, 0.4),
    ("0.6,6", 0.1, 15.4, 0.4),
    ("0.7,7", 0.2, 15.4, 0.5),
    ("0.8,5", 0.2, 45.1, 0.4),
    ("0.8,8", 0.4, 18.2, 0.6),
];

/// Runs a study.
pub fn run(args: &StudyArgs) -> Result<End, Refused> {
    let value = match args.name {
        Study::Table2 => table2(args)?,
        Study::Faa => faa(args)?,
        Study::Airborne => airborne_hours(args)?,
        Study::Estimator => estimator(args)?,
    };
    if args.json {
        println!("{value}");
    }
    Ok(End::Success)
}

fn sea(args: &SceneArgs, text: &str) -> Result<SceneArgs, Refused> {
    let sea: SeaArg = text.parse().map_err(Refused)?;
    Ok(SceneArgs {
        sea: Some(sea),
        ..args.clone()
    })
}

fn table2(args: &StudyArgs) -> Result<Value, Refused> {
    let say = |line: String| {
        if args.json {
            eprintln!("{line}")
        } else {
            println!("{line}")
        }
    };
    say(format!(
        "{:<7}{:>9}{:>8} | {:^23} | {:^19} | {:^19}",
        "", "", "unsafe", "position m", "landing s", "speed m/s"
    ));
    say(format!(
        "{:<7}{:>9}{:>8} | {:>7}{:>8}{:>8} | {:>9}{:>10} | {:>9}{:>10}",
        "A, T", "landed", "cont.", "mean", "p95", "publ.", "mean", "publ.", "mean", "publ."
    ));
    let mut rows = Vec::new();
    for (name, position, duration, speed) in TABLE2 {
        let scene = Scene::of(&sea(&args.scene, name)?)?;
        let outcomes = fly_all(&scene, &seeds(args.seed0, args.trials)?, None, args.jobs, name)?;
        let s = Summary::of(&outcomes);
        let f = |name: &str| s.figure(name).unwrap_or_default();
        say(format!(
            "{name:<7}{:>9}{:>8} | {:>7.3}{:>8.3}{position:>8.1} | {:>9.1}{duration:>10.1} | {:>9.2}{speed:>10.1}",
            format!("{}/{}", s.successes, s.trials),
            s.unsafe_contacts,
            f("position_error_m").mean,
            f("position_error_m").p95,
            f("landing_time_s").mean,
            f("touchdown_speed_mps").mean,
        ));
        for o in outcomes.iter().filter(|o| !o.success) {
            say(format!(
                "        seed {}: {} ({})",
                o.seed,
                o.outcome.name(),
                o.reason
            ));
        }
        let mut row = table::summary_json(&s);
        row.insert("scenario".into(), name.into());
        row.insert("planner".into(), scene.nodes.drone.planner.kind.name().into());
        rows.push(Value::Object(row));
    }
    Ok(Value::Array(rows))
}

/// Mean and 95 % interval of paired differences `b - a`.
fn paired(a: &[Outcome], b: &[Outcome], f: fn(&Outcome) -> Option<f64>) -> (f64, f64, usize) {
    let d: Vec<f64> = a.iter().zip(b).filter_map(|(x, y)| Some(f(y)? - f(x)?)).collect();
    let n = d.len().max(1) as f64;
    let mean = d.iter().sum::<f64>() / n;
    let var = d.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, 1.96 * (var / n).sqrt(), d.len())
}

fn faa(args: &StudyArgs) -> Result<Value, Refused> {
    let say = |line: String| {
        if args.json {
            eprintln!("{line}")
        } else {
            println!("{line}")
        }
    };
    let seeds = seeds(args.seed0, args.trials)?;
    let fly = |planner: Planner| {
        let scene = Scene::of(&SceneArgs {
            planner: Some(planner),
            ..args.scene.clone()
        })?;
        let name = scene.nodes.drone.planner.kind.name();
        fly_all(&scene, &seeds, None, args.jobs, name)
    };
    let (with, without) = (fly(Planner::MpcFaa)?, fly(Planner::Mpc)?);
    for (name, o) in [
        (PlannerKind::MpcFaa.name(), &with),
        (PlannerKind::Mpc.name(), &without),
    ] {
        say(format!("{name}\n{}", table::summary(&Summary::of(o))));
    }
    type Row = (&'static str, fn(&Outcome) -> Option<f64>);
    let rows: [Row; 5] = [
        ("tilt_error_deg", |o| o.tilt_error_deg),
        ("position_error_m", |o| o.position_error_m),
        ("tangential_speed_mps", |o| o.tangential_speed_mps),
        ("touchdown_speed_mps", |o| o.touchdown_speed_mps),
        ("landing_time_s", |o| o.landing_time_s),
    ];
    say("without FAA minus with FAA, same seeds (mean, 95 % interval)".into());
    let mut differences = serde_json::Map::new();
    for (name, f) in rows {
        let (mean, half, n) = paired(&with, &without, f);
        say(format!("  {name:<24}{mean:>10.3} +- {half:.3}  ({n} pairs)"));
        differences.insert(
            name.into(),
            json!({ "mean": mean, "half_width_95": half, "pairs": n }),
        );
    }
    Ok(json!({
        "mpc-faa": table::summary_json(&Summary::of(&with)),
        "mpc": table::summary_json(&Summary::of(&without)),
        "difference": differences,
    }))
}

/// Seas of the airborne study.
const AIRBORNE_SEAS: [&str; 5] = ["calm", "slight", "moderate", "rough", "very-rough"];
/// One session of the airborne study, s.
const SESSION_S: f64 = 600.0;

fn airborne_hours(args: &StudyArgs) -> Result<Value, Refused> {
    let say = |line: String| {
        if args.json {
            eprintln!("{line}")
        } else {
            println!("{line}")
        }
    };
    let seeds = seeds(args.seed0, args.trials)?;
    let mut rows = Vec::new();
    let mut total = Airborne {
        lowest_m: f64::INFINITY,
        ..Airborne::default()
    };
    for name in AIRBORNE_SEAS {
        let scene = Scene::of(&sea(&args.scene, name)?)?;
        let progress = bar(seeds.len() as u64, name);
        let reports: Result<Vec<Airborne>, Refused> = pool(args.jobs)?.install(|| {
            seeds
                .par_iter()
                .progress_with(progress.clone())
                .map(|&seed| {
                    airborne::session(&scene.scenario, &scene.nodes, seed, SESSION_S)
                        .map_err(|e| Refused::because(format!("setting up the session of seed {seed}"), e))
                })
                .collect()
        });
        progress.finish_and_clear();
        let sum = reports?.into_iter().reduce(Airborne::and).unwrap_or_default();
        say(format!(
            "{name:<12}{:>7.2} h in the air, {} false stops, {} aborts, {} contacts, {} in water, lowest {:.2} m",
            sum.hours, sum.false_stops, sum.aborts, sum.contacts, sum.water, sum.lowest_m
        ));
        rows.push(json!({ "sea": name, "report": sum }));
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

fn estimator(args: &StudyArgs) -> Result<Value, Refused> {
    let say = |line: String| {
        if args.json {
            eprintln!("{line}")
        } else {
            println!("{line}")
        }
    };
    let scene = Scene::of(&args.scene)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let fly = |scenario: &Scenario, span_s: f64, what: &str| -> Result<Vec<est::Run>, Refused> {
        let progress = bar(seeds.len() as u64, what);
        let runs = pool(args.jobs)?.install(|| {
            seeds
                .par_iter()
                .progress_with(progress.clone())
                .map(|&seed| {
                    est::run(scenario, &scene.nodes.vessel, seed, span_s)
                        .map_err(|e| Refused::because(format!("setting up the run of seed {seed}"), e))
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
pub fn response(args: &ResponseArgs) -> Result<End, Refused> {
    let table = response::response(&VesselConfig::default(), &ResponseConfig::default());
    if args.json {
        println!(
            "{}",
            serde_json::to_string(&table).map_err(|e| Refused::because("writing JSON", e))?
        );
    } else {
        println!("{table}");
    }
    Ok(End::Success)
}
