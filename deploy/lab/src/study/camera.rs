//! `alight study camera`: detections of the camera node in rendered images, next to the measurement model of
//! lock-step.

use alight_computer::cells;
use alight_computer::exit::CliError;
use alight_computer::table::{Cell, Table};
use alight_computer::terminal::note;
use alight_sim::studies::camera::{CameraBench, CameraRow, Condition, ModelFit};
use alight_sim::studies::false_detections::{FalseDetectionBench, FalseDetectionRow, SceneKind};
use alight_sim::studies::uvdar;
use serde::Serialize;
use serde_json::{Value, json};

use crate::args::StudyArgs;
use crate::scene::Scene;

const RANGES_M: [f64; 14] = [
    0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 13.0, 16.0, 20.0, 23.0, 26.0, 30.0,
];
const INCIDENCES_DEG: [f64; 7] = [0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 75.0];
const INCIDENCE_RANGES_M: [f64; 3] = [3.0, 7.0, 13.0];
const BLURS_PX: [f64; 7] = [0.0, 1.0, 2.0, 4.0, 6.0, 9.0, 13.0];
const BLUR_RANGES_M: [f64; 2] = [4.0, 10.0];
const GLARES: [f64; 6] = [0.0, 0.3, 1.0, 3.0, 10.0, 30.0];
const UV_RANGES_M: [f64; 9] = [1.5, 3.0, 5.0, 8.0, 12.0, 16.0, 22.0, 28.0, 34.0];
const UV_INCIDENCES_DEG: [f64; 6] = [5.0, 30.0, 45.0, 60.0, 70.0, 80.0];
const UV_INCIDENCE_M: f64 = 12.0;
const UV_GLINTS: [usize; 3] = [10, 30, 60];
/// Images of each kind without the deck's whole tag for each trial asked for: 40 trials are 24 000 images.
const EMPTY_PER_TRIAL: usize = 100;
/// Frames of an hour at 30 Hz.
const FRAMES_PER_HOUR: f64 = 108_000.0;

/// Runs it: `--trials` images a cell.
pub fn run(args: &StudyArgs) -> Result<(), CliError> {
    let scene = Scene::of(&args.scene)?;
    let images = args.trials as usize;
    let (sensors, settings) = (&scene.scenario.sensors, &scene.nodes.drone.camera);
    let mut bench = CameraBench::new(sensors, settings, &scene.scenario.deck, args.seed0);
    let print = |line: String| note(args.form.alone(), line);
    print(format!(
        "{images} rendered images a row, seed {}; in brackets the measurement model of lock-step",
        args.seed0
    ));
    let [range, incidence, blur, glare] = varied_conditions().map(|(title, conditions)| {
        let rows: Vec<CameraRow> = conditions.iter().map(|c| bench.row(c, images)).collect();
        print(format!("{title}\n{}", condition_table(&rows).text()));
        rows
    });
    let misfit = ModelFit::of(&[&range[..], &incidence, &blur].concat());
    print(format!(
        "Misfit of the model without glare: {:.0} points of the fraction detected (root mean square); over {} rows \
         where both detect it, corner noise {:.2} x that of the images (spread x/{:.2}), mean position error {:.2} x \
         (x/{:.2})",
        100.0 * misfit.rate,
        misfit.rows,
        misfit.corner,
        misfit.corner_spread,
        misfit.position,
        misfit.position_spread,
    ));
    let empty = without_a_tag(&scene, args);
    let glints = sensors.render.glints as usize;
    let flights = images.div_ceil(10);
    print(format!(
        "UV markers, {flights} flights of 3 s a row, {glints} glints an image; in brackets the model"
    ));
    let markers = with_markers(&scene, flights, args);
    let dark: Vec<Value> = UV_GLINTS
        .iter()
        .map(|glints| {
            let (rendered, fixes) = uvdar::without_markers(&settings.uvdar, *glints, images, args.seed0);
            print(format!(
                "Without a marker, {glints} glints an image: {fixes} fixes in {rendered} images"
            ));
            json!({"glints": glints, "images": rendered, "fixes": fixes})
        })
        .collect();
    let value = json!({
        "range": range, "incidence": incidence, "blur": blur, "glare": glare,
        "misfit": misfit,
        "markers": markers, "without_markers": dark, "empty": empty,
    });
    let varied = [
        ("range", range),
        ("incidence", incidence),
        ("blur", blur),
        ("glare", glare),
    ];
    let varied = varied.into_iter();
    let rows = varied.flat_map(|(varied, rows)| rows.into_iter().map(move |row| VariedRow { varied, row }));
    args.form.print(&value, &rows.collect::<Vec<_>>())?;
    Ok(())
}

/// Titles and conditions of the tag's tables: range, incidence, blur, glare.
fn varied_conditions() -> [(&'static str, Vec<Condition>); 4] {
    let cell = Condition::default();
    let incidence = INCIDENCE_RANGES_M.iter().flat_map(|range_m| {
        INCIDENCES_DEG.map(|incidence_deg| Condition {
            range_m: *range_m,
            incidence_deg,
            ..cell
        })
    });
    let blur = BLUR_RANGES_M.iter().flat_map(|range_m| {
        BLURS_PX.map(|blur_px| Condition {
            range_m: *range_m,
            blur_px,
            ..cell
        })
    });
    [
        (
            "Range, incidence 20 deg",
            RANGES_M.map(|range_m| Condition { range_m, ..cell }).to_vec(),
        ),
        ("Incidence", incidence.collect()),
        ("Motion during the exposure", blur.collect()),
        (
            "Glare near the tag",
            GLARES.map(|glare| Condition { glare, ..cell }).to_vec(),
        ),
    ]
}

/// A row of the tag's tables: what is varied, and what of it.
#[derive(Serialize)]
struct VariedRow {
    varied: &'static str,
    #[serde(flatten)]
    row: CameraRow,
}

/// The ultraviolet camera's rows: range, then incidence.
fn with_markers(scene: &Scene, flights: usize, args: &StudyArgs) -> Vec<uvdar::UvdarRow> {
    let sensors = &scene.scenario.sensors;
    let fast = (&scene.nodes.drone.camera.uvdar, &sensors.uvdar);
    let aslant = UV_INCIDENCES_DEG.map(|deg| (UV_INCIDENCE_M, Some(deg)));
    let glints = sensors.render.glints as usize;
    let rows: Vec<uvdar::UvdarRow> = UV_RANGES_M
        .map(|range_m| (range_m, None))
        .into_iter()
        .chain(aslant)
        .map(|place| uvdar::row(fast, place, glints, flights, args.seed0))
        .collect();
    let mut table = Table::new(
        0..,
        [
            "m",
            "deg",
            "fixes %",
            "bearing deg",
            "distance",
            "bias",
            "NEES",
            "outliers",
        ],
    );
    for row in &rows {
        table.row([
            Cell::number(row.range_m, 1),
            Cell::number(row.incidence_deg, 0),
            both(100.0 * row.rate, 100.0 * row.model_rate, 0),
            both(row.bearing_deg, row.model_bearing_deg, 2),
            both(row.distance, row.model_distance, 3),
            Cell::number(row.distance_bias, 3),
            Cell::number(row.nees, 2),
            row.outliers.into(),
        ]);
    }
    note(args.form.alone(), table.text());
    rows
}

/// Images in which the deck's tag is not, or not whole: the last row is all of them.
fn without_a_tag(scene: &Scene, args: &StudyArgs) -> Vec<FalseDetectionRow> {
    let (sensors, settings) = (&scene.scenario.sensors, &scene.nodes.drone.camera);
    let mut bench = FalseDetectionBench::new(sensors, settings, &scene.scenario.deck, args.seed0);
    let images = args.trials as usize * EMPTY_PER_TRIAL;
    let mut rows: Vec<FalseDetectionRow> = SceneKind::ALL
        .iter()
        .map(|kind| bench.row(*kind, images))
        .collect();
    rows.push(FalseDetectionRow::total(&rows));
    let mut table = Table::new(
        1..,
        [
            "shown",
            "images",
            "other tags read",
            "deck's number reported",
            "false detections behind the gates",
            "an hour at 30 Hz, 95 % interval",
        ],
    );
    for row in &rows {
        let [low, high] = row.share_95.map(|s| s * FRAMES_PER_HOUR);
        table.row(cells![
            row.kind.map_or("all".into(), |k| format!("{k:?}")),
            row.images,
            row.other_tags,
            row.reported,
            row.detections,
            format_args!("{low:.1} to {high:.1}"),
        ]);
    }
    note(
        args.form.alone(),
        format_args!("Without the deck's whole tag\n{}", table.text()),
    );
    rows
}

/// Images and, in brackets, the model.
fn both(images: f64, model: f64, digits: usize) -> Cell {
    Cell::number(images, digits).note(format_args!("{model:.digits$}"))
}

fn condition_table(rows: &[CameraRow]) -> Table {
    let mut table = Table::new(
        0..,
        [
            "m",
            "deg",
            "px",
            "glare",
            "detected %",
            "position mm",
            "p95",
            "attitude deg",
            "NEES position",
            "attitude",
            "corner px",
        ],
    );
    for row in rows {
        let (c, p, m) = (&row.condition, &row.pixels, &row.model);
        table.row([
            Cell::number(c.range_m, 1),
            Cell::number(c.incidence_deg, 0),
            Cell::number(c.blur_px, 1),
            Cell::number(c.glare, 1),
            both(100.0 * p.rate, 100.0 * row.model_rate, 0),
            both(1e3 * p.position_m, 1e3 * m.position_m, 0),
            Cell::number(1e3 * p.position_p95_m, 0),
            both(p.attitude_deg, m.attitude_deg, 1),
            Cell::number(p.nees_position, 1),
            Cell::number(p.nees_attitude, 1),
            both(row.corner_rms_px, row.model_corner_px, 3),
        ]);
    }
    table
}
