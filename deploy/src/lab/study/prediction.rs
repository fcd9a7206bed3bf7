//! `alight study prediction`: how well the deck is predicted, by sea and horizon.

use std::collections::BTreeMap;
use std::path::Path;

use alight_sim::harness::scenario::{Scenario, SetupError};
use alight_sim::studies::prediction::{self as pred, HORIZONS_S, Quantity, Scores, Source, Tally};
use serde::Serialize;
use serde_json::{Value, json};

use super::changes;
use super::grid::{self, TABLE2};
use super::reference;
use super::run::configuration_hash;
use super::variant::StudyScene;
use crate::cells;
use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::report::chart::{self, Curve};
use crate::lab::report::document::{Block, Chart, Document, write_files};
use crate::lab::scene::Scene;
use crate::lab::trials::{in_parallel, seeds};
use crate::table::{Cell, Table};
use crate::terminal::note;

/// Length of one run of the vessel after the warm-up, s.
const VESSEL_S: f64 = 60.0;
/// Time that the drone follows, s.
const FOLLOW_S: f64 = 20.0;
/// Index of 1 s in [`HORIZONS_S`].
const ONE_SECOND: usize = 4;
/// Indices of 0.5, 1 and 2 s in [`HORIZONS_S`].
const SHOWN_HORIZONS: [usize; 3] = [2, ONE_SECOND, 7];
/// Greatest RMSE of the heave 1 s ahead that is required, m.
const REQUIRED_HEAVE_M: f64 = 0.05;
/// Required coverage of a 95 % ellipsoid, per cent.
const REQUIRED_COVERAGE: [f64; 2] = [90.0, 99.0];

/// One sea.
struct PredictionRow {
    name: String,
    /// The wavelength scale where it is not drawn.
    scale: Option<f64>,
    world: Scenario,
    /// Scores per seed.
    scores: Vec<Scores>,
}

impl PredictionRow {
    /// A quantity of all seeds together.
    fn of(&self, source: Source, quantity: Quantity, horizon: usize) -> Tally {
        self.each(source, quantity, horizon)
            .into_iter()
            .fold(Tally::default(), Tally::and)
    }
    fn each(&self, source: Source, quantity: Quantity, horizon: usize) -> Vec<Tally> {
        let get = |s: &Scores| s.get(&(source, quantity, horizon)).copied();
        self.scores.iter().map(|s| get(s).unwrap_or_default()).collect()
    }
    /// The same, where there was anything to score.
    fn scored(&self, source: Source, quantity: Quantity, horizon: usize) -> Option<Tally> {
        Some(self.of(source, quantity, horizon)).filter(|t| t.count > 0)
    }
    /// RMSE and coverage.
    fn rmse_cell(&self, source: Source, quantity: Quantity, horizon: usize, scale: f64) -> Cell {
        self.scored(source, quantity, horizon).map_or("-".into(), |t| {
            Cell::number(scale * t.rmse(), 3).note(format_args!("{:.0} %", 100.0 * t.inside()))
        })
    }
}

/// Everything of one seed in one sea.
fn one(scene: &Scene, world: &Scenario, seed: u64) -> Result<Scores, SetupError> {
    let mut all = Scores::new();
    all.extend(pred::vessel(world, &scene.nodes.vessel, seed, VESSEL_S)?);
    for span in [Some(FOLLOW_S), None] {
        all.extend(pred::drone(world, &scene.nodes, seed, span)?);
    }
    Ok(all)
}

/// The seas: `--sea` alone where given, else Table II, each with the drawn and the least
/// wavelength scale.
fn rows(args: &StudyArgs, scene: &Scene) -> Result<Vec<PredictionRow>, CliError> {
    // A hull's or a recording's motion is judged beside the reference alone.
    if scene.scenario.hull.is_some() || scene.scenario.deck_motion.is_some() {
        return Ok(Vec::new());
    }
    let row = |name: String, scale: Option<f64>, world: Scenario| PredictionRow {
        name,
        scale,
        world,
        scores: Vec::new(),
    };
    if args.scene.sea.is_some() || args.scene.sea_state.is_some() || args.scene.scenario.is_some() {
        return Ok(vec![row(scene.sea.clone(), None, scene.scenario.clone())]);
    }
    let mut rows = Vec::new();
    for scale in [None, Some(1.1)] {
        for (name, ..) in TABLE2 {
            let mut world = scene.scenario.clone();
            world.sea = name.parse().map_err(CliError)?;
            world.sea.wavelength_scale = scale;
            match scale {
                None => rows.push(row(name.into(), scale, world)),
                // A calm sea has no wavelengths.
                Some(s) if world.sea.kind != alight_sim::physics::sea::SeaKind::Calm => {
                    rows.push(row(format!("{name} scale {s}"), scale, world));
                }
                Some(_) => {}
            }
        }
    }
    Ok(rows)
}

/// What is judged beside the reference: the scene that is named, else all hulls in all seas.
fn decks(args: &StudyArgs, scene: &Scene) -> Result<Vec<StudyScene>, CliError> {
    let flags = &args.scene;
    let sea_is_named = flags.sea.is_some() || flags.sea_state.is_some() || flags.scenario.is_some();
    if scene.scenario.deck_motion.is_none() && (flags.hull.is_some() || !sea_is_named) {
        return grid::hulls(flags, scene);
    }
    Ok(vec![StudyScene {
        name: flags
            .deck_motion
            .as_ref()
            .map_or(scene.sea.clone(), |file| file.display().to_string()),
        world: scene.scenario.clone(),
        nodes: scene.nodes.clone(),
    }])
}

/// The study.
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    let scene = Scene::of(&args.scene)?;
    let seeds = seeds(args.seed0, args.trials)?;
    let mut rows = if args.changes {
        Vec::new()
    } else {
        rows(args, &scene)?
    };
    for row in &mut rows {
        row.scores = in_parallel(args.jobs, &row.name, &seeds, |seed| {
            one(&scene, &row.world, *seed)
                .map_err(|e| CliError::because(format!("setting up the run of seed {seed}"), e))
        })?;
    }
    let hash = configuration_hash(&scene.nodes);
    if !rows.is_empty() {
        note_one_second_ahead(args, &rows);
    }
    let decks = if args.changes {
        Vec::new()
    } else {
        decks(args, &scene)?
    };
    let (mut blocks, beside) = if decks.is_empty() {
        Default::default()
    } else {
        reference::run(args, &decks, &seeds)?
    };
    let mut after = Vec::new();
    // A recording has no course to change.
    if scene.scenario.deck_motion.is_none() {
        let (more, values) = changes::run(args, &scene, &seeds)?;
        blocks.extend(more);
        after = values;
    }
    // One object per sea, one per deck, then one per change, time since it and quantity.
    let value = Value::Array([summary(&rows, &hash), beside, after].concat());
    if let Some(out) = &args.out {
        let mut document = document(args, &rows, &hash);
        if rows.is_empty() {
            document.blocks.clear();
        }
        document.blocks.extend(blocks);
        write_files(
            out,
            &[
                ("report.html", document.html()),
                ("summary.md", document.markdown()),
                ("summary.json", value.to_string()),
            ],
        )?;
        write_rows(out, &rows, &seeds).map_err(|e| CliError::because("writing rows.csv", e))?;
        note(
            args.json,
            format_args!("written: {}", out.join("report.html").display()),
        );
    }
    Ok(value)
}

/// Prints what is asked of every sea.
fn note_one_second_ahead(args: &StudyArgs, rows: &[PredictionRow]) {
    note(
        args.json,
        format_args!(
            "1 s ahead, {} seeds from {} on; RMSE (fraction of truths in the 95 % interval). Heave is against \
             the mean water level; required at most {} m at 0.5,5. \
             `coverage`: ellipsoid of heave, roll and pitch, required {} to {} %\n{}",
            args.trials,
            args.seed0,
            REQUIRED_HEAVE_M,
            REQUIRED_COVERAGE[0],
            REQUIRED_COVERAGE[1],
            one_second_ahead(rows).text()
        ),
    );
}

/// Every sea 1 s ahead.
fn one_second_ahead(rows: &[PredictionRow]) -> Table {
    let mut table = Table::new(
        1..,
        [
            "sea",
            "heave m",
            "coverage %",
            "GNSS height m",
            "drone follows m",
            "drone descends m",
            "vessel's tilt deg",
            "drone's tilt deg",
        ],
    );
    for row in rows {
        let rmse = |source, quantity| row.of(source, quantity, ONE_SECOND).rmse();
        let height = |source| row.rmse_cell(source, Quantity::Height, ONE_SECOND, 1.0);
        let tilt = |source| Cell::number(rmse(source, Quantity::Tilt).to_degrees(), 2);
        let inside = row.of(Source::Vessel, Quantity::Deck, ONE_SECOND).inside();
        table.row(
            cells![
                row.name,
                format_args!("{:.3}", rmse(Source::Vessel, Quantity::Heave)),
            ]
            .into_iter()
            .chain([
                Cell::number(100.0 * inside, 0),
                height(Source::Vessel),
                height(Source::DroneFollowing),
                height(Source::DroneDescending),
                tilt(Source::Vessel),
                tilt(Source::DroneDescending),
            ]),
        );
    }
    table
}

/// The vessel's prediction by sea and horizon.
fn by_horizon<'a>(rows: impl Iterator<Item = &'a PredictionRow>) -> Table {
    let mut table = Table::new(
        1..,
        [
            "sea",
            "horizon s",
            "heave m",
            "roll deg",
            "pitch deg",
            "horizontal m",
            "coverage %",
        ],
    );
    for (row, h) in rows.flat_map(|r| SHOWN_HORIZONS.map(|h| (r, h))) {
        let rmse = |quantity| row.of(Source::Vessel, quantity, h).rmse();
        let coverage = row
            .scored(Source::Vessel, Quantity::Deck, h)
            .map(|t| 100.0 * t.inside());
        let mut coverage_cell = Cell::number(coverage, 1);
        // Required at 1 s, of the value as it is shown.
        if let (Some(c), ONE_SECOND) = (coverage, h) {
            let [least, most] = REQUIRED_COVERAGE;
            coverage_cell = coverage_cell.judged((least..=most).contains(&((10.0 * c).round() / 10.0)));
        }
        table.row([
            row.name.as_str().into(),
            HORIZONS_S.get(h).map_or("-".into(), Cell::from),
            Cell::number(rmse(Quantity::Heave), 3),
            Cell::number(rmse(Quantity::Roll).to_degrees(), 2),
            Cell::number(rmse(Quantity::Pitch).to_degrees(), 2),
            Cell::number(rmse(Quantity::Place), 3),
            coverage_cell,
        ]);
    }
    table
}

/// A score as the JSON summary and the rows have it.
#[derive(Serialize)]
struct Score {
    source: &'static str,
    quantity: &'static str,
    horizon_s: f64,
    count: u64,
    rmse: f64,
    inside_95: f64,
    nees_per_component: f64,
}

impl Score {
    fn of((source, quantity, h): (Source, Quantity, usize), t: &Tally) -> Score {
        Score {
            source: source.name(),
            quantity: quantity.name(),
            horizon_s: HORIZONS_S.get(h).copied().unwrap_or_default(),
            count: t.count,
            rmse: t.rmse(),
            inside_95: t.inside(),
            nees_per_component: t.nees(),
        }
    }
}

fn summary(rows: &[PredictionRow], hash: &str) -> Vec<Value> {
    let of_row = |row: &PredictionRow| {
        let mut sum: BTreeMap<(Source, Quantity, usize), Tally> = BTreeMap::new();
        for (key, tally) in row.scores.iter().flatten() {
            let held = sum.entry(*key).or_default();
            *held = held.and(*tally);
        }
        let scores: Vec<Score> = sum.iter().map(|(key, t)| Score::of(*key, t)).collect();
        json!({
            "sea": row.name, "wavelength_scale": row.scale, "configuration": hash, "seeds": row.scores.len(),
            "scores": scores,
        })
    };
    rows.iter().map(of_row).collect()
}

/// Every score of every seed.
fn write_rows(out: &Path, rows: &[PredictionRow], seeds: &[u64]) -> Result<(), csv::Error> {
    let mut csv = csv::WriterBuilder::new()
        .has_headers(false)
        .from_path(out.join("rows.csv"))?;
    csv.write_record([
        "sea",
        "seed",
        "source",
        "quantity",
        "horizon_s",
        "count",
        "rmse",
        "inside_95",
        "nees_per_component",
    ])?;
    for row in rows {
        for (seed, scores) in seeds.iter().zip(&row.scores) {
            for (key, tally) in scores {
                csv.serialize((&row.name, seed, Score::of(*key, tally)))?;
            }
        }
    }
    Ok(csv.flush()?)
}

/// What is plotted over the horizon: caption, source, quantity, factor on the RMSE; without a factor the
/// coverage in per cent.
const CURVES: [(&str, Source, Quantity, Option<f64>); 4] = [
    ("heave, m, RMSE", Source::Vessel, Quantity::Heave, Some(1.0)),
    (
        "roll and pitch together, deg, RMSE",
        Source::Vessel,
        Quantity::Tilt,
        Some(1.0_f64.to_degrees()),
    ),
    (
        "coverage of the 95 % ellipsoid of heave, roll and pitch, %",
        Source::Vessel,
        Quantity::Deck,
        None,
    ),
    (
        "height as the landing drone predicts it in its last 3 s, m, RMSE",
        Source::DroneDescending,
        Quantity::Height,
        Some(1.0),
    ),
];

/// Tables over the horizon: source, quantity, factor.
const TABLES: [(Source, Quantity, f64); 10] = [
    (Source::Vessel, Quantity::Heave, 1.0),
    (Source::Vessel, Quantity::Height, 1.0),
    (Source::Vessel, Quantity::Tilt, 1f64.to_degrees()),
    (Source::Vessel, Quantity::Place, 1.0),
    (Source::DroneFollowing, Quantity::Height, 1.0),
    (Source::DroneFollowing, Quantity::Tilt, 1f64.to_degrees()),
    (Source::DroneDescending, Quantity::Height, 1.0),
    (Source::DroneDescending, Quantity::VerticalSpeed, 1.0),
    (Source::DroneDescending, Quantity::Place, 1.0),
    (Source::DroneDescending, Quantity::Tilt, 1f64.to_degrees()),
];

/// The report as Markdown and as a page.
fn document(args: &StudyArgs, rows: &[PredictionRow], hash: &str) -> Document {
    let mut blocks = vec![
        Block::Text(format!(
            "Configuration {hash}, {} seeds from {} on. The vessel's broadcast prediction against the truth. Heave: \
             height against the mean water level. GNSS height: heave and the receiver's slow bias, which no filter \
             knows better than 0.09 m here. Drone: height in its own NED while it sees the tag. In brackets the \
             fraction of truths in the 95 % interval (required: {} to {} %). Known waves: RMSE over that of the \
             same filter that knows the waves' frequencies and directions, with its 95 % bootstrap interval over \
             seeds. Coverage: ellipsoid of heave, roll and pitch together.",
            args.trials, args.seed0, REQUIRED_COVERAGE[0], REQUIRED_COVERAGE[1]
        )),
        Block::Heading("1 s ahead".into()),
        Block::Table(one_second_ahead(rows)),
    ];
    let labels: Vec<String> = HORIZONS_S.iter().map(f64::to_string).collect();
    for (title, scaled) in [("drawn wavelengths", false), ("wavelengths scaled by 1.1", true)] {
        let these = || rows.iter().filter(|r| r.scale.is_some() == scaled);
        if these().next().is_none() {
            continue;
        }
        blocks.push(Block::Heading(format!("By sea and horizon, {title}")));
        blocks.push(Block::Table(by_horizon(these())));
        for (caption, source, quantity, factor) in CURVES {
            let value = |t: Tally| factor.map_or(100.0 * t.inside(), |f| f * t.rmse());
            let curve = |row: &PredictionRow| Curve {
                name: row.name.clone(),
                points: (0..HORIZONS_S.len())
                    .map(|h| row.scored(source, quantity, h).map(value))
                    .collect(),
            };
            blocks.push(Block::Chart(Chart {
                caption: format!("{caption}, over the horizon, s"),
                svg: chart::curves(&labels, &these().map(curve).collect::<Vec<_>>()),
            }));
        }
    }
    for (source, quantity, scale) in TABLES {
        let name = quantity.name().replace("rad", "deg");
        blocks.push(Block::Heading(format!(
            "{name}, {}, against horizon",
            source.name()
        )));
        let heads = core::iter::once("sea".to_string()).chain(labels.iter().map(|l| format!("{l} s")));
        let mut table = Table::new(1.., heads);
        for row in rows {
            let cells = (0..HORIZONS_S.len()).map(|h| row.rmse_cell(source, quantity, h, scale));
            table.row(core::iter::once(Cell::from(&row.name)).chain(cells));
        }
        blocks.push(Block::Table(table));
    }
    Document {
        title: "Study prediction".into(),
        blocks,
    }
}
