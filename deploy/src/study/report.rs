//! `report.html`: one file, tables with intervals and plots, readable on a wide and a narrow screen.

use std::fmt::Write as _;

use alight_sim::statistics::{Figure, Summary, wilson};

/// One line of the report.
pub struct Line {
    /// Scenario.
    pub scenario: String,
    /// Planner.
    pub planner: String,
    /// Its figures.
    pub summary: Summary,
    /// 95 % bootstrap intervals of the means, by the summary's figures.
    pub intervals: Vec<(&'static str, Option<[f64; 2]>)>,
    /// The paper's figures.
    pub published: Option<[f64; 3]>,
}

const SHOWN: [(&str, &str, f64); 5] = [
    ("position_error_m", "position error at first contact, m", 0.02),
    ("touchdown_speed_mps", "speed along the deck's normal, m/s", 0.05),
    ("tangential_speed_mps", "speed along the deck, m/s", 0.05),
    ("tilt_error_deg", "angle between the normals, deg", 0.5),
    ("landing_time_s", "first descent to first contact, s", 1.0),
];
const COLOURS: [&str; 8] = [
    "#1f6fb4", "#d66020", "#469650", "#8a4fbf", "#b8326a", "#5b5b5b", "#998800", "#008c8c",
];

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

fn cell(f: Option<Figure>, digits: usize) -> String {
    f.map_or_else(
        || "–".into(),
        |f| format!("{:.digits$} <small>p95 {:.digits$}</small>", f.mean, f.p95),
    )
}

/// The whole page.
pub fn html(title: &str, hash: &str, seeds: &str, lines: &[Line], worst: &[String]) -> String {
    let mut out = String::new();
    let _ = write!(
        out,
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>{0}</title><style>\
         body{{font:15px/1.45 system-ui,sans-serif;margin:1.2rem auto;max-width:88rem;padding:0 .8rem;color:#222}}\
         .wide{{overflow-x:auto}} table{{border-collapse:collapse;font-variant-numeric:tabular-nums}}\
         th,td{{padding:.25rem .6rem;border-bottom:1px solid #ddd;text-align:right;white-space:nowrap}}\
         th:first-child,td:first-child,th:nth-child(2),td:nth-child(2){{text-align:left}}\
         small{{color:#666}} svg{{width:100%;height:auto;max-width:60rem;min-width:42rem}} pre{{overflow-x:auto;background:#f6f6f6;padding:.6rem}}\
         </style><h1>{0}</h1><p>Configuration <code>{hash}</code>, {seeds}. Rates with Wilson's 95 % interval, \
         means with 95 % bootstrap intervals in the plots. Grey ticks: published by Procházka et al.</p>",
        escape(title)
    );
    out.push_str(
        "<div class=\"wide\"><table><tr><th>scenario<th>planner<th>landed<th>95 %<th>unsafe contacts\
         <th>position m<th>normal m/s<th>tangential m/s<th>tilt deg<th>landing s<th>over deck s</tr>",
    );
    for l in lines {
        let s = &l.summary;
        let (lo, hi) = wilson(s.successes, s.trials);
        let _ = write!(
            out,
            "<tr><td>{}<td>{}<td>{}/{}<td>{:.1}–{:.1} %<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            escape(&l.scenario),
            escape(&l.planner),
            s.successes,
            s.trials,
            100.0 * lo,
            100.0 * hi,
            s.unsafe_contacts,
            cell(s.figure("position_error_m"), 3),
            cell(s.figure("touchdown_speed_mps"), 2),
            cell(s.figure("tangential_speed_mps"), 2),
            cell(s.figure("tilt_error_deg"), 2),
            cell(s.figure("landing_time_s"), 1),
            cell(s.figure("over_deck_time_s"), 1),
        );
    }
    out.push_str("</table></div>");
    for (k, (name, caption, _)) in SHOWN.iter().enumerate() {
        let _ = write!(
            out,
            "<h2>{}</h2><div class=\"wide\">{}</div>",
            escape(caption),
            dots(lines, name, k)
        );
    }
    if !worst.is_empty() {
        out.push_str("<h2>Worst trials and failures</h2><pre>");
        for w in worst {
            let _ = writeln!(out, "{}", escape(w));
        }
        out.push_str("</pre>");
    }
    out.push_str("</html>\n");
    out
}

/// Means with intervals, one line per scenario and planner.
fn dots(lines: &[Line], figure: &str, shown: usize) -> String {
    let published = |l: &Line| match shown {
        0 => l.published.map(|p| p[0]),
        1 => l.published.map(|p| p[2]),
        4 => l.published.map(|p| p[1]),
        _ => None,
    };
    let least = SHOWN.get(shown).map_or(1.0, |s| s.2);
    let top = lines
        .iter()
        .flat_map(|l| [l.summary.figure(figure).map(|f| f.p95), published(l)])
        .flatten()
        .fold(least, f64::max);
    let (left, width, row) = (260.0, 680.0, 20.0);
    let x = |v: f64| left + width * (v / top).clamp(0.0, 1.0);
    let height = row * lines.len() as f64 + 34.0;
    let mut out = format!("<svg viewBox=\"0 0 960 {height:.0}\" role=\"img\" font-size=\"12\">");
    for k in 0..=4 {
        let v = top * f64::from(k) / 4.0;
        let _ = write!(
            out,
            "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"4\" y2=\"{1:.0}\" stroke=\"#e4e4e4\"/>\
             <text x=\"{0:.1}\" y=\"{2:.0}\" text-anchor=\"middle\" fill=\"#666\">{v:.2}</text>",
            x(v),
            height - 24.0,
            height - 8.0
        );
    }
    let mut planners: Vec<&str> = Vec::new();
    for (i, l) in lines.iter().enumerate() {
        let y = row * (i as f64 + 0.5) + 6.0;
        let index = planners.iter().position(|p| *p == l.planner).unwrap_or_else(|| {
            planners.push(&l.planner);
            planners.len() - 1
        });
        let colour = COLOURS.get(index % COLOURS.len()).copied().unwrap_or("#000");
        let _ = write!(
            out,
            "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{} · {}</text>",
            left - 8.0,
            y + 4.0,
            escape(&l.scenario),
            escape(&l.planner)
        );
        if let Some(p) = published(l) {
            let _ = write!(
                out,
                "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{1:.1}\" y2=\"{2:.1}\" stroke=\"#888\" stroke-width=\"3\"/>",
                x(p),
                y - 7.0,
                y + 7.0
            );
        }
        if let Some(f) = l.summary.figure(figure) {
            let interval = l
                .intervals
                .iter()
                .find(|(n, _)| *n == figure)
                .and_then(|(_, i)| *i);
            let [lo, hi] = interval.unwrap_or([f.mean, f.mean]);
            let _ = write!(
                out,
                "<line x1=\"{:.1}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>\
                 <circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{colour}\"><title>mean {:.3}, p95 {:.3}, max {:.3}</title></circle>\
                 <circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"2.5\" fill=\"none\" stroke=\"{colour}\"/>",
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
    out.push_str("</svg><p><small>Filled: mean with interval. Open: 95th percentile.</small></p>");
    out
}
