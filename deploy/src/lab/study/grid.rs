//! The rows of each study: which scenes are flown.

use alight_sim::harness::scenario::Scenario;
use alight_sim::physics::deck_motion::DeckMotionConfig;
use alight_sim::physics::deck_motion::rocking::RockingConfig;
use alight_sim::physics::sea::{SeaConfig, SeaKind};
use alight_sim::physics::vessel::Course;
use alight_sim::physics::vessel::response::HULLS;
use serde::Serialize;

use super::ablation;
use super::equipment;
use super::link;
use super::moving;
use super::variant::{MakeScene, StudyScene, on_hull, seas};
use crate::exit::CliError;
use crate::lab::args::{SceneArgs, Study};
use crate::lab::scene::Scene;

/// What is published of a scenario.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Published {
    position_error_m: f64,
    landing_time_s: f64,
    touchdown_speed_mps: f64,
}

impl Published {
    const fn of([position_error_m, landing_time_s, touchdown_speed_mps]: [f64; 3]) -> Published {
        Published {
            position_error_m,
            landing_time_s,
            touchdown_speed_mps,
        }
    }
    /// The metric of that name.
    pub fn metric(&self, name: &str) -> Option<f64> {
        match name {
            "position_error_m" => Some(self.position_error_m),
            "landing_time_s" => Some(self.landing_time_s),
            "touchdown_speed_mps" => Some(self.touchdown_speed_mps),
            _ => None,
        }
    }
}

/// A row of a published table: sea, then MPC-FAA and MPC-NE with position error (m), landing time (s) and
/// touchdown speed (m/s).
type PublishedRow = (&'static str, [f64; 3], [f64; 3]);

/// Table II of Procházka et al.: sea, their MPC-FAA, and MPC-NE as they flew it.
pub const TABLE2: [PublishedRow; 10] = [
    ("0,0", [0.0, 11.8, 0.2], [0.0, 50.8, 0.1]),
    ("0.2,5", [0.1, 25.3, 0.3], [0.2, 43.3, 0.3]),
    ("0.3,5", [0.1, 18.7, 0.3], [0.3, 43.9, 0.4]),
    ("0.4,5", [0.2, 18.3, 0.4], [0.3, 44.5, 0.5]),
    ("0.4,4", [0.3, 24.6, 0.5], [0.4, 43.1, 0.4]),
    ("0.5,5", [0.1, 17.7, 0.4], [0.5, 34.5, 0.7]),
    ("0.6,6", [0.1, 15.4, 0.4], [0.8, 37.9, 0.8]),
    ("0.7,7", [0.2, 15.4, 0.5], [0.3, 33.2, 0.5]),
    ("0.8,5", [0.2, 45.1, 0.4], [0.7, 47.2, 0.9]),
    ("0.8,8", [0.4, 18.2, 0.6], [0.5, 41.9, 0.4]),
];

/// Table I of the same: Moderate; the speeds are the greatest of 100 landings.
pub const TABLE1: PublishedRow = ("moderate", [0.10, 17.0, 1.0], [0.5, 34.0, 2.0]);

/// Failures that are published for Table II: of MPC-FAA and of MPC-NE, in this many landings.
pub const TABLE2_FAILURES: ([u32; 2], u32) = ([5, 30], 1000);

/// What is published for a scenario of Table I or II: of MPC-NE for `mpc-ne`, else of MPC-FAA, the
/// figures to beat.
pub fn published(scenario: &str, planner: &str) -> Option<Published> {
    core::iter::once(&TABLE1)
        .chain(&TABLE2)
        .find(|(name, ..)| *name == scenario)
        .map(|(_, faa, ne)| Published::of(if planner == "mpc-ne" { *ne } else { *faa }))
}

/// The rows of `study` with the scene's settings as the base.
pub fn rows(study: Study, args: &SceneArgs, base: &Scene) -> Result<Vec<StudyScene>, CliError> {
    let row = |name: &str, change: &dyn Fn(&mut Scenario)| {
        let mut world = base.scenario.clone();
        change(&mut world);
        StudyScene {
            name: name.into(),
            world,
            nodes: base.nodes.clone(),
        }
    };
    let paper = |text: &str| text.parse::<SeaConfig>().map_err(CliError);
    let in_seas = |names: &[&str]| -> Result<Vec<StudyScene>, CliError> {
        let in_sea = |name: &&str| {
            let sea = paper(name)?;
            Ok(row(name, &|w| w.sea = sea.clone()))
        };
        names.iter().map(in_sea).collect()
    };
    let rows = match study {
        Study::Table1 => in_seas(&[TABLE1.0])?,
        Study::Table2 => in_seas(&TABLE2.map(|(name, ..)| name))?,
        Study::Coupling => {
            let mut rows = Vec::new();
            for name in ["0.5,5", "0.8,5"] {
                let sea = paper(name)?;
                for coupling in [0.0, 1.0] {
                    rows.push(row(&format!("{name} coupling {coupling}"), &|w| {
                        w.sea = sea.clone();
                        w.vessel.sideways_coupling = coupling;
                    }));
                }
            }
            rows
        }
        Study::Ablation => in_seas(&ablation::SEAS)?,
        Study::Faa => vec![row(&base.sea, &|_| {})],
        Study::Approach => vec![row("90 m, turning, gusts", &|w| {
            // Pitch to 8 and roll to 6 deg or more: the greatest of 40 s on this course are, in the
            // median of 30 vessels, 7.3 and 8.0 deg at 0.4 m, 9.4 and 10.1 deg at 0.5 m.
            w.sea = SeaConfig::paper(0.45, 5.0);
            w.start.distance_m = [90.0, 90.0];
            w.vessel.course = Course::Square;
            w.vessel.speed_mps = 1.0;
            // Gusts to 17 km/h = 4.7 m/s over a mean of 2.5 m/s.
            w.drone.wind.mean_mps = 2.5;
        })],
        Study::Moving => moving::rows(args, base)?,
        Study::Seas => hulls(args, base)?,
        Study::Rocking => rocking(&row),
        Study::Wind => [0.0, 2.0, 5.0, 8.0, 10.0, 12.0, 15.0]
            .iter()
            .map(|v| row(&format!("{v} m/s"), &|w| w.drone.wind.mean_mps = *v))
            .collect(),
        Study::Sensors => equipment::sensors(&row),
        Study::Size => equipment::size(&row),
        Study::Link => link::rows(&row),
        Study::Camera
        | Study::Estimator
        | Study::Fleet
        | Study::Prediction
        | Study::Aborts
        | Study::Airborne
        | Study::Merge
        | Study::Search => Vec::new(),
    };
    Ok(rows)
}

/// The seas of `study seas`: name, and systems as on the command line.
pub const SEAS: [(&str, &str); 6] = [
    ("Hs 0.5 m, Tp 4 s", "jonswap:0.5,4"),
    ("Hs 1 m, Tp 5 s", "jonswap:1,5"),
    ("Hs 1.5 m, Tp 6 s", "jonswap:1.5,6"),
    ("Hs 2 m, Tp 7 s", "jonswap:2,7"),
    ("Hs 2.5 m, Tp 7 s", "jonswap:2.5,7"),
    ("cross 0.8/4.5 + 1/8", "jonswap:0.8,4.5+jonswap:1,8@90"),
];

/// Hulls times seas: those that are named, else all.
pub fn hulls(args: &SceneArgs, base: &Scene) -> Result<Vec<StudyScene>, CliError> {
    let seas = seas(args, base, &SEAS)?;
    let hulls: Vec<&str> = match &args.hull {
        Some(hull) => vec![hull],
        None => HULLS.to_vec(),
    };
    let mut rows = Vec::new();
    for hull in hulls {
        for (name, sea) in &seas {
            rows.push(StudyScene {
                name: format!("{hull} {name}"),
                ..on_hull(args, base, Some(hull), sea)?
            });
        }
    }
    Ok(rows)
}

fn rocking(row: MakeScene<'_>) -> Vec<StudyScene> {
    let mut rows = Vec::new();
    for (height, peak) in [(0.5, 4.0), (1.0, 5.0), (1.5, 5.5), (2.0, 6.5), (3.0, 8.0)] {
        rows.push(row(&format!("JONSWAP Hs {height} m, Tp {peak} s"), &|w| {
            w.sea = SeaConfig {
                kind: SeaKind::Jonswap,
                significant_height_m: height,
                peak_period_s: peak,
                ..SeaConfig::default()
            };
        }));
    }
    rows.push(row("Pierson-Moskowitz Hs 1 m, Tp 5 s", &|w| {
        w.sea = SeaConfig {
            kind: SeaKind::PiersonMoskowitz,
            significant_height_m: 1.0,
            peak_period_s: 5.0,
            ..SeaConfig::default()
        };
    }));
    rows.push(row("cross sea 0.5,5 (1.5 rad apart)", &|w| {
        w.sea = SeaConfig {
            direction_step_rad: 1.5,
            ..SeaConfig::paper(0.5, 5.0)
        };
    }));
    rows.push(row("very rough 1.0,6", &|w| w.sea = SeaConfig::paper(1.0, 6.0)));
    // Small decks that rock fast, in the heave of a slight sea.
    let tilts = |frequency_hz: f64| [0.1, 0.2, 0.4].map(|tilt_rad| (frequency_hz, tilt_rad));
    for (frequency_hz, tilt_rad) in [0.5, 0.7, 0.95].into_iter().flat_map(tilts) {
        rows.push(row(&format!("rocking {frequency_hz} Hz, {tilt_rad} rad"), &|w| {
            w.sea = SeaConfig::paper(0.2, 5.0);
            w.deck_motion = Some(DeckMotionConfig {
                rocking: Some(RockingConfig {
                    roll_rad: tilt_rad,
                    pitch_rad: 0.5 * tilt_rad,
                    frequency_hz,
                }),
                ..DeckMotionConfig::default()
            });
        }));
    }
    rows
}
