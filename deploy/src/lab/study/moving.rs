//! `alight study moving`: hulls under way, moored and drifting in irregular seas, pooled by course.

use alight_sim::harness::outcome::Outcome;
use alight_sim::physics::vessel::Course;
use alight_sim::physics::vessel::response::HULLS;
use alight_sim::studies::statistics::{Summary, wilson};
use clap::ValueEnum;
use serde_json::{Value, json};

use super::variant::{PlannerVariant, StudyScene, on_hull, seas};
use crate::cells;
use crate::exit::CliError;
use crate::lab::args::{self, SceneArgs};
use crate::lab::scene::Scene;
use crate::table::{Cell, Table};

/// Courses and their speeds, m/s.
const COURSES: [(args::Course, f64); 9] = [
    (args::Course::Straight, 2.0),
    (args::Course::Straight, 5.0),
    (args::Course::Square, 2.0),
    (args::Course::Zigzag, 3.0),
    (args::Course::Turn, 3.0),
    (args::Course::StationKeeping, 0.0),
    (args::Course::Anchored, 0.0),
    (args::Course::Straight, 7.0),
    (args::Course::Square, 5.0),
];
/// Seas: name, and systems as on the command line.
const SEAS: [(&str, &str); 2] = [
    ("Hs 1 m, Tp 5 s", "jonswap:1,5"),
    ("Hs 1.5 m, Tp 6 s", "jonswap:1.5,6"),
];
/// The hull of sections, which no table moves.
const SIMULATED: &str = "simulated";
/// A deck that stands this far forward of where a hull's file has it, m: 2.4 m aft of amidships on mono-5m.
const DECK_SHIFT_M: f64 = -1.2;

/// A course by the name that rows and the pooled table have.
fn course_name(course: args::Course, speed_mps: f64) -> String {
    let value = course.to_possible_value();
    let name = value.as_ref().map_or("", |v| v.get_name());
    if Course::from(course).is_under_way() {
        format!("{name} {speed_mps} m/s")
    } else {
        name.into()
    }
}

/// The courses, narrowed by `--vessel` and `--speed`; one that is not among them is flown all the same.
fn courses(args: &SceneArgs) -> Vec<(args::Course, f64)> {
    let wanted = |(course, speed): &(args::Course, f64)| {
        args.vessel.is_none_or(|v| v == *course) && args.speed.is_none_or(|s| s == *speed)
    };
    let mut courses: Vec<_> = COURSES.into_iter().filter(wanted).collect();
    if courses.is_empty() {
        courses.push((
            args.vessel.unwrap_or(args::Course::Straight),
            args.speed.unwrap_or(2.0),
        ));
    }
    courses
}

/// Hulls times seas: the three by their tables, one of them with its deck further aft, the simulated one.
fn hulls(args: &SceneArgs, base: &Scene) -> Result<Vec<StudyScene>, CliError> {
    let seas = seas(args, base, &SEAS)?;
    let hulls: Vec<(&str, f64)> = match &args.hull {
        Some(hull) => vec![(hull, 0.0)],
        None => HULLS
            .iter()
            .map(|hull| (*hull, 0.0))
            .chain([("mono-5m", DECK_SHIFT_M), (SIMULATED, 0.0)])
            .collect(),
    };
    let mut rows = Vec::new();
    for (hull, shift) in hulls {
        for (name, sea) in &seas {
            let table = (hull != SIMULATED).then_some(hull);
            let mut scene = on_hull(args, base, table, sea)?;
            scene.name = format!("{hull} {name}");
            if shift != 0.0 {
                scene.name = format!("{hull}, deck {} m further aft, {name}", -shift);
                for deck in [
                    &mut scene.world.deck,
                    &mut scene.nodes.vessel.deck,
                    &mut scene.nodes.drone.deck,
                ] {
                    deck.centre_m[0] += shift;
                }
            }
            rows.push(scene);
        }
    }
    Ok(rows)
}

/// The rows of the study.
pub fn rows(args: &SceneArgs, base: &Scene) -> Result<Vec<StudyScene>, CliError> {
    let mut rows = Vec::new();
    for (course, speed) in courses(args) {
        for mut scene in hulls(args, base)? {
            scene.name = format!("{}, {}", course_name(course, speed), scene.name);
            let vessel = &mut scene.world.vessel;
            vessel.course = course.into();
            vessel.speed_mps = speed;
            // Up by half as well.
            let most = if vessel.course == Course::SpeedChange {
                1.5
            } else {
                1.0
            };
            vessel.power_for(most * speed);
            rows.push(scene);
        }
    }
    Ok(rows)
}

/// What was flown on one course by one planner, on all hulls in all seas.
pub struct Pooled {
    course: String,
    planner: String,
    summary: Summary,
    /// No landing in time, and no contact beyond its limits.
    refused: usize,
}

/// Pools the outcomes by course.
pub fn pool(args: &SceneArgs, planners: &[PlannerVariant], outcomes: &[Outcome]) -> Vec<Pooled> {
    let mut pooled = Vec::new();
    for (course, speed) in courses(args) {
        let course = course_name(course, speed);
        let prefix = format!("{course}, ");
        for planner in planners {
            let is_one = |o: &&Outcome| o.planner == planner.name && o.sea.starts_with(&prefix);
            let set: Vec<Outcome> = outcomes.iter().filter(is_one).cloned().collect();
            pooled.push(Pooled {
                course: course.clone(),
                planner: planner.name.clone(),
                refused: set.iter().filter(|o| o.is_refused()).count(),
                summary: Summary::of(&set),
            });
        }
    }
    pooled
}

impl Pooled {
    fn position(&self) -> Option<f64> {
        self.summary.metric("position_error_m").map(|s| s.mean)
    }
    /// As JSON.
    pub fn json(&self) -> Value {
        let s = &self.summary;
        json!({
            "course": self.course, "planner": self.planner, "trials": s.trials, "landed": s.successes,
            "landed_interval": wilson(s.successes, s.trials), "unsafe_contacts": s.unsafe_contacts,
            "refused": self.refused, "position_error_m": self.position(),
        })
    }
}

/// All hulls and seas together, a row per course: landed within 180 s, unsafe contacts, neither.
pub fn table(pooled: &[Pooled]) -> Table {
    let heads = [
        "course, all hulls and seas",
        "planner",
        "landed",
        "95 %",
        "unsafe",
        "refused",
        "position m",
    ];
    let mut table = Table::new(2.., heads);
    for row in pooled {
        let s = &row.summary;
        let (lo, hi) = wilson(s.successes, s.trials);
        let mut cells = cells![
            row.course,
            row.planner,
            format_args!("{}/{}", s.successes, s.trials),
            format_args!("{:.1}-{:.1} %", 100.0 * lo, 100.0 * hi),
            s.unsafe_contacts,
            row.refused
        ]
        .to_vec();
        cells.push(Cell::number(row.position(), 3));
        table.row(cells);
    }
    table
}
