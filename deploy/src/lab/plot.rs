//! What the paper's figures 3 and 4 show, as an SVG: paths, relative position, speeds, and roll,
//! pitch and yaw of drone and deck with touchdown marked.

use std::error::Error;
use std::ffi::OsStr;
use std::path::Path;

use alight_sim::harness::outcome::Outcome;
use alight_sim::harness::trace::{Trace, TracePoint};
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::exit::{CliError, Doing};

const DRONE: RGBColor = RGBColor(31, 111, 180);
const DECK: RGBColor = RGBColor(214, 96, 32);
const THIRD: RGBColor = RGBColor(70, 150, 80);
const MARK: RGBColor = RGBColor(120, 120, 120);

type Path3 = (&'static str, RGBColor, fn(&TracePoint) -> [f64; 3]);
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Series<'s> = (&'s str, RGBColor, Box<dyn Fn(&TracePoint) -> f64 + 's>);

/// Whether a plot can be written to `path`, found out before the flight, not after it: as SVG, by its name.
pub fn can_write(path: &Path) -> Result<(), CliError> {
    let is_svg = |e: &OsStr| e.eq_ignore_ascii_case("svg");
    if !path.extension().is_some_and(is_svg) {
        return Err(CliError(format!(
            "--plot {}: plots are written as SVG and in no other format; choose a name that ends in .svg",
            path.display()
        )));
    }
    let opened = std::fs::OpenOptions::new().create(true).append(true).open(path);
    opened.map(|_| ()).map_err(|e| {
        CliError::because(
            format!("writing the plot {}", path.display()),
            format!("{e}; choose a path that can be written"),
        )
    })
}

/// Draws the trace of a landing to `path`.
pub fn landing(trace: &Trace, outcome: &Outcome, path: &Path) -> Result<(), CliError> {
    let title = format!(
        "Landing at sea {}, seed {}, planner {}: {}",
        outcome.sea,
        outcome.seed,
        outcome.planner,
        outcome.outcome.name()
    );
    draw(trace, &title, path).doing(format_args!("writing the plot {}", path.display()))
}

/// Draws `trace` to `path`; `title` is the first line.
fn draw(trace: &Trace, title: &str, path: &Path) -> Result<(), Box<dyn Error>> {
    // Plotters writes the file only at the end and swallows some errors: ask the file system first.
    std::fs::File::create(path)?;
    let root = SVGBackend::new(path, (1200, 1400)).into_drawing_area();
    root.fill(&WHITE)?;
    let root = root.titled(title, ("sans-serif", 24))?;
    let rows = root.split_evenly((4, 2));
    let from = trace.points.first().map_or(0.0, |p| p.t_s);
    let until = trace.points.last().map_or(1.0, |p| p.t_s).max(from + 1.0);
    let touchdown = trace.touchdown_s;
    let late = touchdown.map_or(from, |t| (t - 15.0).max(from));
    let end = touchdown.map_or(until, |t| (t + 5.0).min(until));

    paths(&rows[0], trace)?;
    let height = |name, colour, f: fn(&TracePoint) -> f64| -> Series<'static> { (name, colour, Box::new(f)) };
    let chart = |area: &Area<'_>, caption: &str, unit: &str, span: (f64, f64), series: &[Series<'_>]| {
        over_time(area, trace, caption, unit, span, series)
    };
    chart(
        &rows[1],
        "Height",
        "m",
        (from, until),
        &[
            height("drone", DRONE, |p| -p.drone[2]),
            height("deck", DECK, |p| -p.deck[2]),
        ],
    )?;
    chart(
        &rows[2],
        "Drone relative to deck centre",
        "m",
        (late, end),
        &[
            height("north", DRONE, |p| p.drone[0] - p.deck[0]),
            height("east", DECK, |p| p.drone[1] - p.deck[1]),
            height("clearance", THIRD, |p| p.clearance_m),
        ],
    )?;
    chart(
        &rows[3],
        "Horizontal speed",
        "m/s",
        (from, until),
        &[
            height("drone", DRONE, |p| p.drone_velocity[0].hypot(p.drone_velocity[1])),
            height("deck", DECK, |p| p.deck_velocity[0].hypot(p.deck_velocity[1])),
        ],
    )?;
    chart(
        &rows[4],
        "Vertical speed (up)",
        "m/s",
        (late, end),
        &[
            height("drone", DRONE, |p| -p.drone_velocity[2]),
            height("deck", DECK, |p| -p.deck_velocity[2]),
        ],
    )?;
    for (i, name) in ["Roll", "Pitch", "Yaw"].into_iter().enumerate() {
        let unwrap =
            |reference: f64, angle: f64| reference + alight_shared::frames::wrap_angle(angle - reference);
        let middle = trace.points.last().map_or(0.0, |p| p.deck_euler[i]);
        chart(
            &rows[5 + i],
            name,
            "deg",
            (late, end),
            &[
                (
                    "drone",
                    DRONE,
                    Box::new(move |p| unwrap(middle, p.drone_euler[i]).to_degrees()),
                ),
                (
                    "deck",
                    DECK,
                    Box::new(move |p| unwrap(middle, p.deck_euler[i]).to_degrees()),
                ),
            ],
        )?;
    }
    root.present()?;
    Ok(())
}

fn range_of(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values.filter(|v| v.is_finite()) {
        low = low.min(v);
        high = high.max(v);
    }
    if low > high {
        return 0.0..1.0;
    }
    let margin = (0.05 * (high - low)).max(0.05);
    low - margin..high + margin
}

fn over_time(
    area: &Area<'_>,
    trace: &Trace,
    caption: &str,
    unit: &str,
    (from, until): (f64, f64),
    series: &[Series<'_>],
) -> Result<(), Box<dyn Error>> {
    let inside: Vec<&TracePoint> = trace
        .points
        .iter()
        .filter(|p| (from..=until).contains(&p.t_s))
        .collect();
    let range = range_of(
        series
            .iter()
            .flat_map(|(_, _, f)| inside.iter().map(move |p| f(p))),
    );
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", 18))
        .margin(8)
        .x_label_area_size(32)
        .y_label_area_size(52)
        .build_cartesian_2d(from..until + 0.2 * (until - from), range.clone())?;
    chart
        .configure_mesh()
        .x_desc("time since start, s")
        .y_desc(unit)
        .light_line_style(WHITE)
        .draw()?;
    for (name, colour, f) in series {
        let colour = *colour;
        chart
            .draw_series(LineSeries::new(
                inside.iter().map(|p| (p.t_s, f(p))),
                colour.stroke_width(2),
            ))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    if let Some(t) = trace.touchdown_s.filter(|t| (from..=until).contains(t)) {
        chart
            .draw_series(LineSeries::new([(t, range.start), (t, range.end)], MARK))?
            .label("touchdown")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], MARK));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    Ok(())
}

fn paths(area: &Area<'_>, trace: &Trace) -> Result<(), Box<dyn Error>> {
    let ends = || trace.points.iter().flat_map(|p| [p.drone, p.deck]);
    let (east, north) = (range_of(ends().map(|p| p[1])), range_of(ends().map(|p| p[0])));
    // One scale for both axes, so that a circle is a circle.
    let half = ((east.end - east.start).max(north.end - north.start)) / 2.0;
    let (ce, cn) = ((east.end + east.start) / 2.0, (north.end + north.start) / 2.0);
    let (w, h) = area.dim_in_pixel();
    let stretch = f64::from(w.saturating_sub(70)) / f64::from(h.saturating_sub(70).max(1));
    let mut chart = ChartBuilder::on(area)
        .caption("Paths from above", ("sans-serif", 18))
        .margin(8)
        .x_label_area_size(32)
        .y_label_area_size(52)
        .build_cartesian_2d(ce - half * stretch..ce + half * stretch, cn - half..cn + half)?;
    chart
        .configure_mesh()
        .x_desc("east, m")
        .y_desc("north, m")
        .light_line_style(WHITE)
        .draw()?;
    let lines: [Path3; 2] = [("drone", DRONE, |p| p.drone), ("deck", DECK, |p| p.deck)];
    for (name, colour, f) in lines {
        chart
            .draw_series(LineSeries::new(
                trace.points.iter().map(|p| (f(p)[1], f(p)[0])),
                colour.stroke_width(2),
            ))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    Ok(())
}
