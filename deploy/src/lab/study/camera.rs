//! `alight study camera`: what the camera node sees in rendered images, beside the measurement model of
//! lock-step.

use alight_sim::studies::camera::{CameraBench, CameraRow, Condition, ModelFit};
use alight_sim::studies::false_detections::{FalseDetectionBench, FalseDetectionRow, SceneKind};
use alight_sim::studies::uvdar;
use serde_json::{Value, json};

use crate::exit::CliError;
use crate::lab::args::StudyArgs;
use crate::lab::scene::{Scene, stopwatch};
use crate::terminal::note;

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
pub fn run(args: &StudyArgs) -> Result<Value, CliError> {
    let scene = Scene::of(&args.scene)?;
    let images = args.trials as usize;
    let (sensors, settings) = (&scene.scenario.sensors, &scene.nodes.drone.camera);
    let mut bench = CameraBench::new(sensors, settings, &scene.scenario.deck, args.seed0);
    let say = |line: String| note(args.json, line);
    let cell = Condition::default();
    say(format!(
        "{images} rendered images a row, seed {}; in brackets the measurement model of lock-step",
        args.seed0
    ));
    let mut table = |title: &str, conditions: Vec<Condition>| -> Vec<CameraRow> {
        say(title.into());
        say(format!(
            "  {:>5}{:>5}{:>5}{:>6} {:>10} {:>12} {:>5} {:>13} {:>8} {:>14}",
            "m", "deg", "px", "glare", "seen %", "position mm", "p95", "attitude deg", "NEES", "corner px"
        ));
        conditions
            .iter()
            .map(|c| {
                let row = bench.row(c, images);
                say(line(&row));
                row
            })
            .collect()
    };
    let range = table(
        "Range, incidence 20 deg",
        RANGES_M.map(|range_m| Condition { range_m, ..cell }).to_vec(),
    );
    let across = |ranges: &[f64], each: &dyn Fn(f64) -> Vec<Condition>| -> Vec<Condition> {
        ranges.iter().flat_map(|r| each(*r)).collect()
    };
    let incidence = table(
        "Incidence",
        across(&INCIDENCE_RANGES_M, &|range_m| {
            let at = |incidence_deg| Condition {
                range_m,
                incidence_deg,
                ..cell
            };
            INCIDENCES_DEG.map(at).to_vec()
        }),
    );
    let blur = table(
        "Motion during the exposure",
        across(&BLUR_RANGES_M, &|range_m| {
            let at = |blur_px| Condition {
                range_m,
                blur_px,
                ..cell
            };
            BLURS_PX.map(at).to_vec()
        }),
    );
    let glare = table(
        "Glare near the tag",
        GLARES.map(|glare| Condition { glare, ..cell }).to_vec(),
    );
    let misfit = ModelFit::of(&[&range[..], &incidence, &blur].concat());
    say(format!(
        "Misfit of the model without glare: {:.0} points of the share seen (root mean square); over {} rows where \
         both see it, corner noise {:.2} x that of the images (spread x/{:.2}), mean position error {:.2} x (x/{:.2})",
        100.0 * misfit.rate,
        misfit.rows,
        misfit.corner,
        misfit.corner_spread,
        misfit.position,
        misfit.position_spread,
    ));
    let empty = without_a_tag(&scene, args, &say);
    let glints = sensors.render.glints as usize;
    let flights = images.div_ceil(10);
    say(format!(
        "UV markers, {flights} flights of 3 s a row, {glints} glints an image; in brackets the model"
    ));
    let markers = with_markers(&scene, flights, args.seed0, &say);
    let dark: Vec<Value> = UV_GLINTS
        .iter()
        .map(|glints| {
            let (seen, fixes) = uvdar::without_markers(&settings.uvdar, *glints, images, args.seed0);
            say(format!(
                "Without a marker, {glints} glints an image: {fixes} fixes in {seen} images"
            ));
            json!({"glints": glints, "images": seen, "fixes": fixes})
        })
        .collect();
    let (drawn_ms, looked_ms) = times(&mut bench, images.clamp(20, 300));
    say(format!(
        "Time of an image on one core, mean and p99: drawn in {:.1} and {:.1} ms, searched in {:.1} and {:.1} ms \
         (limit 15: {:.2} of it)",
        drawn_ms[0],
        drawn_ms[1],
        looked_ms[0],
        looked_ms[1],
        looked_ms[0] / 15.0
    ));
    Ok(json!({
        "range": range, "incidence": incidence, "blur": blur, "glare": glare,
        "misfit": misfit,
        "markers": markers, "without_markers": dark, "empty": empty,
        "draw_ms": drawn_ms, "search_ms": looked_ms,
    }))
}

/// The ultraviolet camera's rows: range, then incidence.
fn with_markers(scene: &Scene, flights: usize, seed: u64, say: &dyn Fn(String)) -> Vec<uvdar::UvdarRow> {
    let sensors = &scene.scenario.sensors;
    let fast = (&scene.nodes.drone.camera.uvdar, &sensors.uvdar);
    say(format!(
        "  {:>5}{:>5}{:>11}{:>14}{:>16}{:>9}{:>7}{:>7}",
        "m", "deg", "fixes %", "bearing deg", "distance", "bias", "NEES", "wild"
    ));
    let aslant = UV_INCIDENCES_DEG.map(|deg| (UV_INCIDENCE_M, Some(deg)));
    UV_RANGES_M
        .map(|range_m| (range_m, None))
        .into_iter()
        .chain(aslant)
        .map(|place| {
            let row = uvdar::row(fast, place, sensors.render.glints as usize, flights, seed);
            say(format!(
                "  {:>5.1}{:>5}{:>11}{:>14}{:>16}{:>9.3}{:>7.2}{:>7}",
                row.range_m,
                row.incidence_deg.map_or(String::new(), |deg| format!("{deg:.0}")),
                both(100.0 * row.rate, 100.0 * row.model_rate, 0),
                both(row.bearing_deg, row.model_bearing_deg, 2),
                both(row.distance, row.model_distance, 3),
                row.distance_bias,
                row.nees,
                row.outliers
            ));
            row
        })
        .collect()
}

/// Images in which the deck's tag is not, or not whole: the last row is all of them.
fn without_a_tag(scene: &Scene, args: &StudyArgs, say: &dyn Fn(String)) -> Vec<FalseDetectionRow> {
    let (sensors, settings) = (&scene.scenario.sensors, &scene.nodes.drone.camera);
    let mut bench = FalseDetectionBench::new(sensors, settings, &scene.scenario.deck, args.seed0);
    say("Without the deck's whole tag: others read, the deck's number reported, false sightings behind the gates".into());
    say(format!(
        "  {:<12}{:>8}{:>9}{:>10}{:>7}   {}",
        "shown", "images", "others", "reported", "false", "an hour at 30 Hz, 95 % interval"
    ));
    let mut rows: Vec<FalseDetectionRow> = Vec::new();
    let mut show = |row: FalseDetectionRow| {
        let kind = row.kind.map_or("all".into(), |k| format!("{k:?}"));
        let [low, high] = row.share_95.map(|s| s * FRAMES_PER_HOUR);
        say(format!(
            "  {kind:<12}{:>8}{:>9}{:>10}{:>7}   {low:.1} to {high:.1}",
            row.images, row.other_tags, row.reported, row.detections
        ));
        rows.push(row);
    };
    let kinds: Vec<FalseDetectionRow> = SceneKind::ALL
        .iter()
        .map(|kind| bench.row(*kind, args.trials as usize * EMPTY_PER_TRIAL))
        .inspect(|row| show(*row))
        .collect();
    show(FalseDetectionRow::total(&kinds));
    rows
}

/// Images and, in brackets, the model.
fn both(a: f64, b: f64, digits: usize) -> String {
    format!("{a:.digits$} ({b:.digits$})")
}

fn line(row: &CameraRow) -> String {
    let (c, p, m) = (&row.condition, &row.pixels, &row.model);
    format!(
        "  {:>5.1}{:>5.0}{:>5.1}{:>6.1} {:>10} {:>12} {:>5.0} {:>13} {:>8} {:>14}",
        c.range_m,
        c.incidence_deg,
        c.blur_px,
        c.glare,
        both(100.0 * p.rate, 100.0 * row.model_rate, 0),
        both(1e3 * p.position_m, 1e3 * m.position_m, 0),
        1e3 * p.position_p95_m,
        both(p.attitude_deg, m.attitude_deg, 1),
        format!("{:.1} {:.1}", p.nees_position, p.nees_attitude),
        both(row.corner_rms_px, row.model_corner_px, 3),
    )
}

/// Mean and 99 % quantile of the time to draw an image and to search it, ms.
fn times(bench: &mut CameraBench, images: usize) -> ([f64; 2], [f64; 2]) {
    let (mut drawn, mut looked) = (Vec::new(), Vec::new());
    for k in 0..images {
        let range_m = 1.5 + 13.5 * k as f64 / images as f64;
        let shot = bench.shot(&Condition {
            range_m,
            ..Condition::default()
        });
        let watch = stopwatch();
        let Some(image) = bench.image(&shot) else { continue };
        drawn.push(1e3 * watch());
        let watch = stopwatch();
        let _pose = bench.node().detect(&image);
        looked.push(1e3 * watch());
    }
    let figures = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        let mean = v.iter().sum::<f64>() / v.len().max(1) as f64;
        let last = (0.99 * v.len() as f64) as usize;
        [
            mean,
            v.get(last.min(v.len().saturating_sub(1))).copied().unwrap_or(0.0),
        ]
    };
    (figures(drawn), figures(looked))
}
