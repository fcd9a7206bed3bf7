//! `report.html`: one file, tables with intervals and plots, readable on a wide and a narrow screen.

use std::fmt::Write as _;

use alight_sim::studies::paired::{COMPARED, Comparison};
use alight_sim::studies::statistics::{SampleStatistics, Summary, wilson};

use crate::lab::study::grid::Published;
use crate::lab::study::publish;
use crate::lab::study::publish::Extremes;

/// One line of the report.
pub struct ReportRow {
    /// Scenario.
    pub scenario: String,
    /// Planner.
    pub planner: String,
    /// Its figures.
    pub summary: Summary,
    /// 95 % bootstrap intervals of the means, by the summary's figures.
    pub intervals: Vec<(&'static str, Option<[f64; 2]>)>,
    /// Published for this scenario.
    pub published: Option<Published>,
}

/// A planner over all scenarios.
pub struct Total {
    /// Planner.
    pub planner: String,
    /// Its figures.
    pub summary: Summary,
    /// Published successes, `995/1000`.
    pub published: Option<String>,
}

/// Everything that a study says.
pub struct Page {
    /// Heading.
    pub title: String,
    /// Hash of the configuration.
    pub hash: String,
    /// Which seeds.
    pub seeds: String,
    /// Scenario by scenario.
    pub lines: Vec<ReportRow>,
    /// Planner by planner.
    pub totals: Vec<Total>,
    /// What else the study found.
    pub remarks: Vec<String>,
    /// The first planner against the others.
    pub comparisons: Vec<Comparison>,
    /// Best and worst trials.
    pub extremes: Vec<Extremes>,
    /// What the study draws beside: captions and SVG.
    pub charts: Vec<(String, String)>,
    /// Failed trials.
    pub failures: Vec<String>,
}

const SHOWN: [(&str, &str, f64); 5] = [
    ("position_error_m", "position error at first contact, m", 0.02),
    ("touchdown_speed_mps", "speed along the deck's normal, m/s", 0.05),
    ("tangential_speed_mps", "speed along the deck, m/s", 0.05),
    ("tilt_error_deg", "angle between the normals, deg", 0.5),
    ("landing_time_s", "first descent to first contact, s", 1.0),
];
/// Of curves and dots, in their order.
pub const COLOURS: [&str; 10] = [
    "#1f6fb4", "#d66020", "#469650", "#8a4fbf", "#b8326a", "#5b5b5b", "#998800", "#008c8c", "#7c4a1e",
    "#2b2b80",
];

/// Text that a page shows as it is.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

fn cell(f: Option<SampleStatistics>, digits: usize) -> String {
    f.map_or_else(
        || "–".into(),
        |f| format!("{:.digits$} <small>p95 {:.digits$}</small>", f.mean, f.p95),
    )
}

/// How a page looks.
pub const STYLE: &str = "\
    *{box-sizing:border-box}\
    body{font:15px/1.45 system-ui,sans-serif;margin:1.2rem auto;max-width:100rem;padding:0 .8rem;color:#222}\
    h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}\
    .wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}\
    th,td{padding:.25rem .6rem;border-bottom:1px solid #ddd;text-align:right;white-space:nowrap;vertical-align:top}\
    th{border-bottom:2px solid #999}\
    .text{text-align:left}.new td{border-top:2px solid #bbb}.bad{color:#a02020;font-weight:600}\
    .good{color:#1c6b34}small{color:#666}code{font-size:.9em;overflow-wrap:anywhere}\
    svg{display:block;width:100%;max-width:60rem}\
    td:first-child,th:first-child{position:sticky;left:0;background:#fff}\
    pre{overflow-x:auto;background:#f6f6f6;padding:.6rem}";

/// The whole page.
pub fn html(page: &Page) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>{0}</title><style>{STYLE}</style><h1>{0}</h1>\
         <p>Configuration <code>{1}</code>, {2}. Rates with Wilson's 95 % interval, \
         means with 95 % bootstrap intervals in the plots. Published (grey): of MPC-NE in the rows of mpc-ne, \
         else of MPC-FAA, by Procházka et al.</p>",
        escape(&page.title),
        escape(&page.hash),
        escape(&page.seeds),
    );
    if page.lines.len() > page.totals.len() || page.totals.iter().any(|t| t.published.is_some()) {
        items(&mut out, page.totals.iter().map(publish::total));
    }
    items(&mut out, page.remarks.iter().cloned());
    table(&mut out, page);
    for (k, (name, caption, _)) in SHOWN.iter().enumerate() {
        let bar = if page.lines.iter().any(|l| published(l, k).is_some()) {
            " Grey bar: published."
        } else {
            ""
        };
        let _ = write!(
            out,
            "<h2>{}</h2><div class=\"wide\">{}</div>\
             <p><small>Filled: mean with interval. Open: 95th percentile.{bar}</small></p>",
            escape(caption),
            dots(&page.lines, name, k)
        );
    }
    for (caption, svg) in &page.charts {
        let _ = write!(out, "<h2>{}</h2><div class=\"wide\">{svg}</div>", escape(caption));
    }
    differences(&mut out, &page.comparisons);
    extremes(&mut out, &page.extremes);
    if !page.failures.is_empty() {
        out.push_str("<h2>Failures</h2><pre>");
        for f in &page.failures {
            let _ = writeln!(out, "{}", escape(f));
        }
        out.push_str("</pre>");
    }
    out.push_str("</html>\n");
    out
}

fn items(out: &mut String, texts: impl Iterator<Item = String>) {
    out.push_str("<ul>");
    for text in texts {
        let _ = write!(out, "<li>{}</li>", escape(&text));
    }
    out.push_str("</ul>");
}

fn table(out: &mut String, page: &Page) {
    out.push_str(
        "<div class=\"wide\"><table><tr><th class=\"text\">scenario<th class=\"text\">planner<th>landed<th>95 %\
         <th>unsafe<br>contacts<th>in<br>water<th>above<br>2 m/s\
         <th>position m<th>normal m/s<th>tangential m/s<th>tilt deg<th>landing s<th>over deck s</tr>",
    );
    let mut before = "";
    for l in &page.lines {
        let s = &l.summary;
        let (lo, hi) = wilson(s.successes, s.trials);
        let published = |i: usize| {
            l.published
                .and_then(|p| p.get(i).copied())
                .map_or_else(String::new, |v| format!("<br><small>published {v}</small>"))
        };
        let count = |n: u32| match n {
            0 => "<td>0".to_string(),
            n => format!("<td class=\"bad\">{n}"),
        };
        let _ = write!(
            out,
            "<tr{}><td class=\"text\">{}<td class=\"text\">{}<td>{}/{}<td>{:.1}–{:.1} %{}{}{}\
             <td>{}{}<td>{}{}<td>{}<td>{}<td>{}{}<td>{}</tr>",
            if before == l.scenario {
                ""
            } else {
                " class=\"new\""
            },
            escape(&l.scenario),
            escape(&l.planner),
            s.successes,
            s.trials,
            100.0 * lo,
            100.0 * hi,
            count(s.unsafe_contacts),
            count(s.water_contacts),
            count(s.contacts_above_2_mps),
            cell(s.metric("position_error_m"), 3),
            published(0),
            cell(s.metric("touchdown_speed_mps"), 2),
            published(2),
            cell(s.metric("tangential_speed_mps"), 2),
            cell(s.metric("tilt_error_deg"), 2),
            cell(s.metric("landing_time_s"), 1),
            published(1),
            cell(s.metric("over_deck_time_s"), 1),
        );
        before = &l.scenario;
    }
    out.push_str("</table></div>");
}

/// The table of paired differences. Coloured where the interval leaves out zero: less is better
/// everywhere but in the rate of landings.
fn differences(out: &mut String, comparisons: &[Comparison]) {
    if comparisons.is_empty() {
        return;
    }
    out.push_str(
        "<h2>Paired differences</h2><p>The planner minus the first one on the same scenario and seed: mean \
         and 95 % bootstrap interval, red where it is worse beyond it, green where better.</p>\
         <div class=\"wide\"><table><tr><th class=\"text\">scenario<th class=\"text\">planner<th>pairs<th>landed %",
    );
    for (name, _) in COMPARED {
        let _ = write!(out, "<th>{}", heading(name));
    }
    out.push_str("</tr>");
    let mut before = "";
    for c in comparisons {
        let cell = |mean: f64, [lo, hi]: [f64; 2], digits: usize, more_is_better: bool| {
            let class = match (lo > 0.0, hi < 0.0) {
                (true, _) => {
                    if more_is_better {
                        "good"
                    } else {
                        "bad"
                    }
                }
                (_, true) => {
                    if more_is_better {
                        "bad"
                    } else {
                        "good"
                    }
                }
                _ => "",
            };
            format!(
                "<td class=\"{class}\">{mean:+.digits$}<br><small>{lo:+.digits$} to {hi:+.digits$}</small>"
            )
        };
        let r = &c.rates;
        let mut row = format!(
            "<tr{}><td class=\"text\">{}<td class=\"text\">{}<br><small>minus {}</small><td>{}{}",
            if before == c.other { "" } else { " class=\"new\"" },
            escape(c.scenario.as_deref().unwrap_or("all")),
            escape(&c.other),
            escape(&c.first),
            c.pairs,
            cell(100.0 * r.difference, r.interval.map(|v| 100.0 * v), 1, true),
        );
        for (name, _) in COMPARED {
            let digits = if name.ends_with("_m") { 3 } else { 2 };
            row.push_str(&match c.differences.iter().find(|d| d.metric == name) {
                Some(d) => cell(d.mean, d.interval, digits, false),
                None => "<td>–".into(),
            });
        }
        row.push_str("</tr>");
        out.push_str(&row);
        before = &c.other;
    }
    out.push_str("</table></div>");
}

/// `position_error_m` as a heading.
fn heading(figure: &str) -> String {
    match figure.rsplit_once('_') {
        Some((name, unit)) => {
            let unit = if unit == "mps" { "m/s" } else { unit };
            format!("{}<br><small>{unit}</small>", name.replace('_', " "))
        }
        None => figure.into(),
    }
}

fn extremes(out: &mut String, extremes: &[Extremes]) {
    out.push_str(
        "<h2>Worst and best trials</h2><p>By the greatest share of a limit of success. Any of them is flown \
         again by the command with <code>--seed</code>.</p><div class=\"wide\"><table>\
         <tr><th class=\"text\">scenario<th class=\"text\">planner<th>worst seeds<th>best seed\
         <th class=\"text\">command</tr>",
    );
    for e in extremes {
        let _ = write!(
            out,
            "<tr><td class=\"text\">{}<td class=\"text\">{}<td>{}<td>{}<td class=\"text\"><code>{}</code></tr>",
            escape(&e.scenario),
            escape(&e.planner),
            publish::seed_list(&e.worst),
            e.best,
            escape(e.command.as_deref().unwrap_or("–")),
        );
    }
    out.push_str("</table></div>");
}

/// What is published of the figure in the `shown`th plot.
fn published(l: &ReportRow, shown: usize) -> Option<f64> {
    match shown {
        0 => l.published.map(|p| p[0]),
        1 => l.published.map(|p| p[2]),
        4 => l.published.map(|p| p[1]),
        _ => None,
    }
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

/// Means with intervals, one line per scenario and planner.
fn dots(lines: &[ReportRow], figure: &str, shown: usize) -> String {
    let least = SHOWN.get(shown).map_or(1.0, |s| s.2);
    let top = lines
        .iter()
        .flat_map(|l| [l.summary.metric(figure).map(|f| f.p95), published(l, shown)])
        .flatten()
        .fold(least, f64::max);
    let (top, decimals) = round_axis(top);
    // Lengths across in percent: the plot fits any screen, its text keeps its size.
    let row = 32.0_f64;
    let x = |v: f64| 1.0 + 97.0 * (v / top).clamp(0.0, 1.0);
    let height = row * lines.len() as f64 + 30.0;
    let mut out = format!("<svg height=\"{height:.0}\" role=\"img\" font-size=\"12\">");
    for k in 0..=4 {
        let v = top * f64::from(k) / 4.0;
        let anchor = match k {
            0 => "start",
            4 => "end",
            _ => "middle",
        };
        let _ = write!(
            out,
            "<line x1=\"{0:.2}%\" x2=\"{0:.2}%\" y1=\"4\" y2=\"{1:.0}\" stroke=\"#e4e4e4\"/>\
             <text x=\"{0:.2}%\" y=\"{2:.0}\" text-anchor=\"{anchor}\" fill=\"#666\">{v:.decimals$}</text>",
            x(v),
            height - 20.0,
            height - 5.0
        );
    }
    let mut planners: Vec<&str> = Vec::new();
    for (i, l) in lines.iter().enumerate() {
        let y = row * i as f64 + 24.0;
        let index = planners.iter().position(|p| *p == l.planner).unwrap_or_else(|| {
            planners.push(&l.planner);
            planners.len() - 1
        });
        let colour = COLOURS.get(index % COLOURS.len()).copied().unwrap_or("#000");
        let _ = write!(
            out,
            "<text x=\"1%\" y=\"{:.0}\">{} · {}</text>",
            y - 9.0,
            escape(&l.scenario),
            escape(&l.planner)
        );
        if let Some(p) = published(l, shown) {
            let _ = write!(
                out,
                "<line x1=\"{0:.2}%\" x2=\"{0:.2}%\" y1=\"{1:.1}\" y2=\"{2:.1}\" stroke=\"#888\" stroke-width=\"3\"/>",
                x(p),
                y - 6.0,
                y + 6.0
            );
        }
        if let Some(f) = l.summary.metric(figure) {
            let interval = l
                .intervals
                .iter()
                .find(|(n, _)| *n == figure)
                .and_then(|(_, i)| *i);
            let [lo, hi] = interval.unwrap_or([f.mean, f.mean]);
            let _ = write!(
                out,
                "<line x1=\"{:.2}%\" x2=\"{:.2}%\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>\
                 <circle cx=\"{:.2}%\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"><title>mean {:.3}, p95 {:.3}, max {:.3}</title></circle>\
                 <circle cx=\"{:.2}%\" cy=\"{y:.1}\" r=\"2.5\" fill=\"none\" stroke=\"{colour}\"/>",
                x(lo),
                x(hi),
                x(f.mean),
                f.mean,
                f.p95,
                f.max,
                x(f.p95)
            );
        }
    }
    out.push_str("</svg>");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axis_ends_at_a_round_number_near_the_largest_value() {
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
