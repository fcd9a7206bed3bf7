//! Charts as SVG.

pub mod landing;

use std::{error::Error, ops::Range};

use plotters::{coord::Shift, prelude::*};

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
/// Colour of marks that are no measurement.
const MARK: RGBColor = RGBColor(120, 120, 120);
/// Dimensions of a legend, px: length of a sample, height of a row, width of a letter.
const SAMPLE: i32 = 22;
const ROW: i32 = 16;
const LETTER: i32 = 7;

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
}

/// Writes the legend above a chart, in as many rows as needed; returns the remaining area.
fn legend<'a>(area: &Area<'a>, lines: &[Line]) -> Result<Area<'a>, Box<dyn Error>> {
    const LEFT: i32 = 60;
    let width = i32::try_from(area.dim_in_pixel().0).unwrap_or(i32::MAX);
    let mut x = LEFT;
    let mut y = ROW / 2;
    for line in lines.iter().filter(|l| !l.name.is_empty()) {
        let letters = i32::try_from(line.name.chars().count()).unwrap_or_default();
        let wide = SAMPLE + LETTER * (letters + 3);
        if x > LEFT && x + wide > width {
            x = LEFT;
            y += ROW;
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
    chart
        .configure_mesh()
        .x_desc(axes.names[0])
        .y_desc(axes.names[1])
        .max_light_lines(1)
        .light_line_style(WHITE)
        .draw()?;
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
    }
    Ok(())
}

fn range_of(values: impl Iterator<Item = f64>) -> Range<f64> {
    let mut low = f64::INFINITY;
    let mut high = f64::NEG_INFINITY;
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
