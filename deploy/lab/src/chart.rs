//! Charts as SVG: a landing, curves over named places, means with their intervals.

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

/// Of lines and groups, in their order; the first two are drone and deck.
const COLOURS: [RGBColor; 8] = [
    RGBColor(31, 111, 180),
    RGBColor(214, 96, 32),
    RGBColor(70, 150, 80),
    RGBColor(138, 79, 191),
    RGBColor(184, 50, 106),
    RGBColor(153, 136, 0),
    RGBColor(0, 140, 140),
    RGBColor(124, 74, 30),
];
const MARK: RGBColor = RGBColor(120, 120, 120);
/// Size of a chart of curves, px.
const CURVES: (u32, u32) = (640, 300);
/// Width of a chart of means, and height of one of its lines, px.
const DOTS: (u32, u32) = (900, 32);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn Error>>;

fn colour(index: usize) -> RGBColor {
    COLOURS.get(index % COLOURS.len()).copied().unwrap_or(BLACK)
}

/// A line with its name.
struct Line {
    name: String,
    colour: RGBColor,
    dashed: bool,
    points: Vec<(f64, f64)>,
}

/// What a chart of lines has around them.
struct Axes<'a> {
    caption: &'a str,
    /// Meaning of the axes.
    names: [&'a str; 2],
    across: Range<f64>,
    up: Range<f64>,
    /// In the place of the numbers 0, 1, 2 across.
    places: Option<&'a [String]>,
}

fn lines(area: &Area<'_>, axes: &Axes<'_>, lines: &[Line]) -> Drawn {
    let mut chart = ChartBuilder::on(area)
        .caption(axes.caption, ("sans-serif", 18))
        .margin(8)
        .x_label_area_size(32)
        .y_label_area_size(52)
        .build_cartesian_2d(axes.across.clone(), axes.up.clone())?;
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
        let drawn = if line.dashed {
            chart.draw_series(DashedLineSeries::new(points, 5, 4, style))?
        } else {
            chart.draw_series(LineSeries::new(points, style))?
        };
        let length = if line.dashed { 9 } else { 18 };
        drawn
            .label(&line.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + length, y)], style));
        if axes.places.is_some() {
            let dots = line.points.iter().map(|p| Circle::new(*p, 3, colour.filled()));
            chart.draw_series(dots)?;
        }
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    Ok(())
}

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

/// A curve: its name and a point for each place; none where nothing was measured.
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Its points.
    pub points: Vec<Option<f64>>,
}

/// Curves over named places on the horizontal axis.
pub fn curves(caption: &str, places: &[String], curves: &[Curve]) -> Result<Chart, CliError> {
    let line = |(k, curve): (usize, &Curve)| Line {
        name: curve.name.clone(),
        colour: colour(k),
        dashed: false,
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
        // Room for the names of the curves.
        across: -0.1..1.4 * last,
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

/// All charts of curves as one picture, one below the other.
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

/// A line of [`dots`].
pub struct Dot {
    /// Its name.
    pub label: String,
    /// Number of the group that shares a colour.
    pub group: usize,
    /// The statistics, and the interval of the mean.
    pub measured: Option<(SampleStatistics, [f64; 2])>,
    /// The published value.
    pub published: Option<f64>,
}

/// Means with intervals, a line each; the axis reaches `least` at least.
pub fn dots(caption: &str, dots: &[Dot], least: f64) -> Result<Chart, CliError> {
    let mut svg = String::new();
    let size = (DOTS.0, DOTS.1 * dots.len() as u32 + 40);
    draw_dots(dots, least, SVGBackend::with_string(&mut svg, size))
        .doing(format_args!("drawing {caption}"))?;
    Ok(Chart {
        caption: caption.into(),
        svg,
    })
}

fn draw_dots(dots: &[Dot], least: f64, backend: SVGBackend<'_>) -> Drawn {
    let largest = dots
        .iter()
        .flat_map(|l| [l.measured.map(|(s, _)| s.p95), l.published])
        .flatten()
        .fold(least, f64::max);
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
