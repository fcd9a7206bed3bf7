//! Charts of a report as SVG: curves over named places, and means with their intervals.

use std::fmt::Write as _;

use alight_sim::studies::statistics::SampleStatistics;

use super::document::Chart;
use crate::table::escape;

/// Of curves and dots, in their order.
const COLOURS: [&str; 10] = [
    "#1f6fb4", "#d66020", "#469650", "#8a4fbf", "#b8326a", "#5b5b5b", "#998800", "#008c8c", "#7c4a1e",
    "#2b2b80",
];
const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 260.0;

/// The colour of the curve or group with this number.
fn colour(index: usize) -> &'static str {
    COLOURS.get(index % COLOURS.len()).copied().unwrap_or("#000")
}

/// A curve: its name and a point for each place; none where nothing was measured.
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Its points.
    pub points: Vec<Option<f64>>,
}

/// Curves over named places on the horizontal axis.
pub fn curves(labels: &[String], curves: &[Curve]) -> String {
    let top = curves
        .iter()
        .flat_map(|c| c.points.iter().flatten())
        .fold(0.0_f64, |a, b| a.max(*b));
    let top = if top > 0.0 { 1.05 * top } else { 1.0 };
    let digits = if top < 0.2 { 3 } else { 2 };
    let (left, right, base) = (48.0, WIDTH - 130.0, HEIGHT - 28.0);
    let x = |k: usize| left + (right - left) * k as f64 / (labels.len().max(2) - 1) as f64;
    let y = |v: f64| base - (base - 12.0) * v / top;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         font-family=\"sans-serif\" font-size=\"12\">"
    );
    for k in 0..=4 {
        let v = top * f64::from(k) / 4.0;
        let _ = write!(
            out,
            "<line x1=\"{left}\" x2=\"{right}\" y1=\"{0:.1}\" y2=\"{0:.1}\" stroke=\"#e4e4e4\"/>\
             <text x=\"{1}\" y=\"{2:.1}\" text-anchor=\"end\" fill=\"#666\">{v:.digits$}</text>",
            y(v),
            left - 6.0,
            y(v) + 4.0
        );
    }
    for (k, label) in labels.iter().enumerate() {
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#666\">{}</text>",
            x(k),
            HEIGHT - 8.0,
            escape(label)
        );
    }
    for (i, curve) in curves.iter().enumerate() {
        let colour = colour(i);
        let points: Vec<(f64, f64, f64)> = curve
            .points
            .iter()
            .enumerate()
            .filter_map(|(k, v)| v.map(|v| (x(k), y(v), v)))
            .collect();
        let line: Vec<String> = points.iter().map(|(x, y, _)| format!("{x:.1},{y:.1}")).collect();
        let _ = write!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            line.join(" ")
        );
        let name = escape(&curve.name);
        for (x, y, v) in points {
            let _ = write!(
                out,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{colour}\"><title>{name}: {v:.3}</title></circle>"
            );
        }
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{:.0}\" fill=\"{colour}\">{name}</text>",
            right + 10.0,
            18.0 + 16.0 * i as f64
        );
    }
    out.push_str("</svg>");
    out
}

/// All charts as one picture, one below the other.
pub fn sheet(charts: &[Chart]) -> String {
    let cell = HEIGHT + 30.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{0}\" viewBox=\"0 0 {WIDTH} {0}\" \
         font-family=\"sans-serif\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>",
        cell * charts.len() as f64
    );
    for (k, chart) in charts.iter().enumerate() {
        let top = cell * k as f64;
        let place = format!(
            "<svg y=\"{:.0}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" ",
            top + 28.0
        );
        let _ = write!(
            out,
            "<text x=\"8\" y=\"{:.0}\" font-size=\"14\">{}</text>{}",
            top + 20.0,
            escape(&chart.caption),
            chart.svg.replacen("<svg ", &place, 1)
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
pub fn dots(lines: &[Dot], least: f64) -> String {
    let top = lines
        .iter()
        .flat_map(|l| [l.measured.map(|(s, _)| s.p95), l.published])
        .flatten()
        .fold(least, f64::max);
    let (top, decimals) = round_axis(top);
    // Lengths across in percent: the plot fits any screen, its text keeps its size.
    let row = 32.0_f64;
    let x = |v: f64| 1.0 + 97.0 * (v / top).clamp(0.0, 1.0);
    let height = row * lines.len() as f64 + 30.0;
    let mut out = format!("<svg height=\"{height:.0}\" role=\"img\" font-size=\"12\">");
    for (k, anchor) in ["start", "middle", "middle", "middle", "end"].iter().enumerate() {
        let v = top * k as f64 / 4.0;
        let _ = write!(
            out,
            "<line x1=\"{0:.2}%\" x2=\"{0:.2}%\" y1=\"4\" y2=\"{1:.0}\" stroke=\"#e4e4e4\"/>\
             <text x=\"{0:.2}%\" y=\"{2:.0}\" text-anchor=\"{anchor}\" fill=\"#666\">{v:.decimals$}</text>",
            x(v),
            height - 20.0,
            height - 5.0
        );
    }
    for (i, line) in lines.iter().enumerate() {
        let y = row * i as f64 + 24.0;
        let colour = colour(line.group);
        let _ = write!(
            out,
            "<text x=\"1%\" y=\"{:.0}\">{}</text>",
            y - 9.0,
            escape(&line.label)
        );
        if let Some(p) = line.published {
            let _ = write!(
                out,
                "<line x1=\"{0:.2}%\" x2=\"{0:.2}%\" y1=\"{1:.1}\" y2=\"{2:.1}\" stroke=\"#888\" stroke-width=\"3\"/>",
                x(p),
                y - 6.0,
                y + 6.0
            );
        }
        if let Some((s, [lo, hi])) = line.measured {
            let _ = write!(
                out,
                "<line x1=\"{:.2}%\" x2=\"{:.2}%\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>\
                 <circle cx=\"{:.2}%\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"><title>mean {:.3}, p95 {:.3}, max {:.3}</title></circle>\
                 <circle cx=\"{:.2}%\" cy=\"{y:.1}\" r=\"2.5\" fill=\"none\" stroke=\"{colour}\"/>",
                x(lo),
                x(hi),
                x(s.mean),
                s.mean,
                s.p95,
                s.max,
                x(s.p95)
            );
        }
    }
    out.push_str("</svg>");
    out
}

/// The end of an axis of four even steps that reaches `top`, and the decimals that its steps need: each
/// step is 1, 2, 2.5 or 5 times a power of ten.
fn round_axis(top: f64) -> (f64, usize) {
    let step = (top / 4.0).max(1e-6);
    let power = step.log10().floor() as i32;
    let unit = 10.0_f64.powi(power);
    let factor = [1.0, 2.0, 2.5, 5.0]
        .into_iter()
        .find(|f| f * unit >= step * (1.0 - 1e-9))
        .unwrap_or(10.0);
    let digits = i32::from(factor == 2.5) - power - i32::from(factor == 10.0);
    (4.0 * factor * unit, digits.max(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axis_end_near_the_largest_value() {
        for (top, end, decimals) in [
            (0.17, 0.2, 2),
            (0.4, 0.4, 1),
            (45.1, 80.0, 0),
            (0.69, 0.8, 1),
            (9.7, 10.0, 1),
            (3.9, 4.0, 0),
        ] {
            let (e, d) = round_axis(top);
            assert!((e - end).abs() < 1e-9 && d == decimals, "{top}: {e}, {d}");
        }
    }
}
