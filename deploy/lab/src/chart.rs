//! Charts as SVG: a landing, curves over named positions, means with their intervals.

pub mod landing;

use std::error::Error;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;

use alight_computer::exit::{CliError, Doing};
use alight_computer::table::escape;
use alight_sim::studies::statistics::SampleStatistics;
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::report::document::Chart;

/// Colours of lines and groups, in order; the first two are drone and deck. The first six are from Okabe and Ito, in
/// the order of the Python module's plots.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(124, 74, 30),
    RGBColor(90, 60, 160),
];
const MARK: RGBColor = RGBColor(120, 120, 120);
/// Dimensions of a legend, px: length of a sample, height of a row, width of a letter.
const SAMPLE: i32 = 22;
const ROW: i32 = 16;
const LETTER: i32 = 7;
const CURVES: (u32, u32) = (640, 300);
/// Width of a chart of means, and height of one of its lines, px.
const DOTS: (u32, u32) = (900, 32);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn Error>>;

fn colour(index: usize) -> RGBColor {
    COLOURS.get(index % COLOURS.len()).copied().unwrap_or(BLACK)
}

/// Line of a chart; a single point is drawn as a mark.
struct Line {
    /// Empty: the line is not in the legend.
    name: String,
    colour: RGBColor,
    /// Length of strokes and gaps, px; None: solid.
    dash: Option<(i32, i32)>,
    points: Vec<(f64, f64)>,
}

struct Axes<'a> {
    caption: &'a str,
    names: [&'a str; 2],
    /// The chart below shows the numbers of the horizontal axis.
    shared: bool,
    across: Range<f64>,
    up: Range<f64>,
    /// Labels instead of the numbers 0, 1, 2 on the horizontal axis.
    places: Option<&'a [String]>,
}

/// Writes the legend above a chart, in as many rows as needed; returns the remaining area.
fn legend<'a>(area: &Area<'a>, lines: &[Line]) -> Result<Area<'a>, Box<dyn Error>> {
    const LEFT: i32 = 60;
    let width = i32::try_from(area.dim_in_pixel().0).unwrap_or(i32::MAX);
    let (mut x, mut y) = (LEFT, ROW / 2);
    for line in lines.iter().filter(|l| !l.name.is_empty()) {
        let letters = i32::try_from(line.name.chars().count()).unwrap_or_default();
        let wide = SAMPLE + LETTER * (letters + 3);
        if x > LEFT && x + wide > width {
            (x, y) = (LEFT, y + ROW);
        }
        if line.points.len() == 1 {
            area.draw(&Circle::new((x + SAMPLE / 2, y), 4, line.colour.filled()))?;
        } else {
            let (stroke, gap) = line.dash.unwrap_or((SAMPLE, 0));
            for from in (0..SAMPLE).step_by((stroke + gap).max(1) as usize) {
                let ends = [(x + from, y), (x + (from + stroke).min(SAMPLE), y)];
                area.draw(&PathElement::new(ends, line.colour.stroke_width(2)))?;
            }
        }
        area.draw(&Text::new(
            line.name.clone(),
            (x + SAMPLE + 6, y - 6),
            ("sans-serif", 12),
        ))?;
        x += wide;
    }
    Ok(area.split_vertically(y + ROW / 2).1)
}

fn lines(area: &Area<'_>, axes: &Axes<'_>, lines: &[Line]) -> Drawn {
    let area = legend(area, lines)?;
    let mut builder = ChartBuilder::on(&area);
    builder.margin(8).y_label_area_size(52);
    if !axes.shared {
        builder.x_label_area_size(32);
    }
    if !axes.caption.is_empty() {
        builder.caption(axes.caption, ("sans-serif", 16));
    }
    let mut chart = builder.build_cartesian_2d(axes.across.clone(), axes.up.clone())?;
    let place = |x: &f64| {
        let places = axes.places.unwrap_or_default();
        let is_place = (x - x.round()).abs() < 1e-6 && *x > -0.5;
        let name = places.get(x.round() as usize).filter(|_| is_place);
        name.cloned().unwrap_or_default()
    };
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(axes.names[0])
        .y_desc(axes.names[1])
        .max_light_lines(1)
        .light_line_style(WHITE);
    if axes.places.is_some() {
        mesh.x_labels(20).x_label_formatter(&place).disable_x_mesh();
    }
    mesh.draw()?;
    for line in lines {
        let colour = line.colour;
        let style = colour.stroke_width(2);
        let points = line.points.iter().copied();
        match (line.points.as_slice(), line.dash) {
            ([mark], _) => chart.draw_series([Circle::new(*mark, 5, colour.filled())])?,
            (_, Some((stroke, gap))) => {
                chart.draw_series(DashedLineSeries::new(points, stroke, gap, style))?
            }
            (_, None) => chart.draw_series(LineSeries::new(points, style))?,
        };
        if axes.places.is_some() {
            let dots = line.points.iter().map(|p| Circle::new(*p, 3, colour.filled()));
            chart.draw_series(dots)?;
        }
    }
    Ok(())
}

/// Checks before the flight whether a plot can be written to `path`, which must name an SVG.
pub fn can_write(path: &Path) -> Result<(), CliError> {
    let is_svg = |e: &OsStr| e.eq_ignore_ascii_case("svg");
    if !path.extension().is_some_and(is_svg) {
        return Err(CliError(format!(
            "--plot {}: plots are written as SVG only; choose a name that ends in .svg",
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

fn range_of(values: impl Iterator<Item = f64>) -> Range<f64> {
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

/// Curve with one point for each position; None if nothing was measured there.
pub struct Curve {
    pub name: String,
    pub points: Vec<Option<f64>>,
}

pub fn curves(caption: &str, places: &[String], curves: &[Curve]) -> Result<Chart, CliError> {
    let line = |(k, curve): (usize, &Curve)| Line {
        name: curve.name.clone(),
        colour: colour(k),
        dash: None,
        points: curve
            .points
            .iter()
            .enumerate()
            .filter_map(|(x, y)| Some((x as f64, (*y)?)))
            .collect(),
    };
    let drawn: Vec<Line> = curves.iter().enumerate().map(line).collect();
    let top = drawn
        .iter()
        .flat_map(|l| &l.points)
        .fold(0.0_f64, |top, p| top.max(p.1));
    let last = places.len().max(2) as f64 - 1.0;
    let axes = Axes {
        caption: "",
        names: ["", ""],
        shared: false,
        across: -0.1..last + 0.1,
        up: 0.0..if top > 0.0 { 1.05 * top } else { 1.0 },
        places: Some(places),
    };
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, CURVES).into_drawing_area();
    let ended = lines(&root, &axes, &drawn).and_then(|()| Ok(root.present()?));
    drop(root);
    ended.doing(format_args!("drawing {caption}"))?;
    Ok(Chart {
        caption: caption.into(),
        svg,
    })
}

pub fn sheet(charts: &[Chart]) -> String {
    let (width, height) = CURVES;
    let cell = height + 30;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{0}\" viewBox=\"0 0 {width} {0}\" \
         font-family=\"sans-serif\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
        cell * charts.len() as u32
    );
    for (k, chart) in (0..).zip(charts) {
        let top = cell * k;
        let _ = write!(
            out,
            "<text x=\"8\" y=\"{}\" font-size=\"14\">{}</text>{}",
            top + 20,
            escape(&chart.caption),
            chart
                .svg
                .replacen("<svg ", &format!("<svg y=\"{}\" ", top + 28), 1)
        );
    }
    out.push_str("</svg>\n");
    out
}

pub struct Dot {
    pub label: String,
    /// Groups have one colour each.
    pub group: usize,
    pub measured: Option<(SampleStatistics, [f64; 2])>,
    pub published: Option<f64>,
}

/// Means with intervals, one per line; the axis extends to at least `min_side`.
pub fn dots(caption: &str, dots: &[Dot], min_side: f64) -> Result<Chart, CliError> {
    let mut svg = String::new();
    let size = (DOTS.0, DOTS.1 * dots.len() as u32 + 40);
    draw_dots(dots, min_side, SVGBackend::with_string(&mut svg, size))
        .doing(format_args!("drawing {caption}"))?;
    Ok(Chart {
        caption: caption.into(),
        svg,
    })
}

fn draw_dots(dots: &[Dot], min_side: f64, backend: SVGBackend<'_>) -> Drawn {
    let largest = dots
        .iter()
        .flat_map(|l| [l.measured.map(|(s, _)| s.p95), l.published])
        .flatten()
        .fold(min_side, f64::max);
    let root = backend.into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(8)
        .x_label_area_size(24)
        .build_cartesian_2d(0.0..1.05 * largest, dots.len() as f64..0.0)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .disable_y_axis()
        .light_line_style(WHITE)
        .draw()?;
    for (y, dot) in (0..).map(f64::from).zip(dots) {
        let (middle, colour) = (y + 0.7, colour(dot.group));
        let across = |from: f64, to: f64, half: f64| [(from, middle - half), (to, middle + half)];
        chart.draw_series([Text::new(dot.label.clone(), (0.0, y + 0.05), ("sans-serif", 12))])?;
        if let Some(p) = dot.published {
            chart.draw_series([PathElement::new(across(p, p, 0.2), MARK.stroke_width(3))])?;
        }
        if let Some((s, [lo, hi])) = dot.measured {
            chart.draw_series([PathElement::new(across(lo, hi, 0.0), colour.stroke_width(2))])?;
            chart.draw_series([
                Circle::new((s.mean, middle), 4, colour.filled()),
                Circle::new((s.p95, middle), 3, colour.stroke_width(1)),
            ])?;
        }
    }
    drop(chart);
    root.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_name_curves_and_means() {
        let names = ["none", "half <lost>"].map(String::from);
        let curve = Curve {
            name: "1 s late".into(),
            points: vec![Some(0.1), None],
        };
        let chart = curves("position", &names, &[curve]).unwrap();
        let page = sheet(&[chart.clone(), chart]);
        assert!(
            page.contains("1 s late") && page.contains("half &lt;lost&gt;"),
            "{page}"
        );
        let dot = Dot {
            label: "rough · mpc".into(),
            group: 0,
            measured: SampleStatistics::of([0.1, 0.2]).map(|s| (s, [0.1, 0.2])),
            published: Some(0.3),
        };
        let svg = dots("position", &[dot], 0.02).unwrap().svg;
        assert!(svg.starts_with("<svg") && svg.contains("rough · mpc"), "{svg}");
    }
}
