//! The page of `alight study prediction`: sea by horizon, and curves over the horizon.

use std::fmt::Write as _;

use alight_sim::studies::prediction::{HORIZONS_S, Quantity, Source};

use crate::lab::study::link::{Curve, chart};
use crate::lab::study::prediction::PredictionRow;
use crate::lab::study::report::{STYLE, escape};

/// Indices of 0.5, 1 and 2 s in [`HORIZONS_S`].
const SHOWN: [usize; 3] = [2, 4, 7];
/// The share that a 95 % ellipse is asked to hold, per cent.
const REQUIRED: [f64; 2] = [90.0, 99.0];

const HEADS: [&str; 8] = [
    "sea",
    "horizon s",
    "heave m",
    "roll deg",
    "pitch deg",
    "horizontal m",
    "heave to told",
    "in 95 % ellipse",
];

/// One line: a sea at a horizon. The last cell is the share in per cent as a number, for colour.
fn cells(row: &PredictionRow, horizon: usize) -> ([String; 8], f64) {
    let rmse = |figure| row.of(Source::Vessel, figure, horizon).rmse();
    let deck = row.of(Source::Vessel, Quantity::Deck, horizon);
    // As it is shown.
    let coverage = (1000.0 * deck.inside()).round() / 10.0;
    let ratio = row.ratio(horizon);
    let cells = [
        row.name.clone(),
        HORIZONS_S.get(horizon).map_or_else(String::new, f64::to_string),
        format!("{:.3}", rmse(Quantity::Heave)),
        format!("{:.2}", rmse(Quantity::Roll).to_degrees()),
        format!("{:.2}", rmse(Quantity::Pitch).to_degrees()),
        format!("{:.3}", rmse(Quantity::Place)),
        ratio.map_or_else(|| "-".into(), |(r, [a, b])| format!("{r:.2} ({a:.2} to {b:.2})")),
        if deck.count == 0 {
            "-".into()
        } else {
            format!("{coverage:.1} %")
        },
    ];
    (cells, coverage)
}

fn of(rows: &[PredictionRow], scaled: bool) -> impl Iterator<Item = &PredictionRow> {
    rows.iter().filter(move |r| r.scale.is_some() == scaled)
}

/// The table as Markdown; nothing where no sea belongs to it.
pub fn markdown(title: &str, rows: &[PredictionRow], scaled: bool) -> String {
    let mut out = String::new();
    if of(rows, scaled).next().is_none() {
        return out;
    }
    let _ = writeln!(
        out,
        "\n## By sea and horizon, {title}\n\n| {} |\n|{}",
        HEADS.join(" | "),
        "---|".repeat(HEADS.len())
    );
    for row in of(rows, scaled) {
        for h in SHOWN {
            let _ = writeln!(out, "| {} |", cells(row, h).0.join(" | "));
        }
    }
    out
}

fn table(out: &mut String, rows: &[PredictionRow], scaled: bool) {
    out.push_str("<div class=\"wide\"><table><tr>");
    for (k, head) in HEADS.iter().enumerate() {
        let class = if k == 0 { " class=\"text\"" } else { "" };
        let _ = write!(out, "<th{class}>{head}");
    }
    out.push_str("</tr>");
    for row in of(rows, scaled) {
        for (k, h) in SHOWN.iter().enumerate() {
            let (cells, coverage) = cells(row, *h);
            out.push_str(if k == 0 { "<tr class=\"new\">" } else { "<tr>" });
            let last = cells.len() - 1;
            for (c, text) in cells.iter().enumerate() {
                let [least, most] = REQUIRED;
                let class = match c {
                    0 => " class=\"text\"",
                    // Asked at 1 s.
                    c if c == last && k == 1 && !(least..=most).contains(&coverage) => " class=\"bad\"",
                    c if c == last && k == 1 => " class=\"good\"",
                    _ => "",
                };
                let _ = write!(out, "<td{class}>{}", escape(text));
            }
            out.push_str("</tr>");
        }
    }
    out.push_str("</table></div>");
}

/// A figure of a sea at an index of [`HORIZONS_S`].
type Measure = fn(&PredictionRow, usize) -> Option<f64>;

fn known(t: alight_sim::studies::prediction::Tally, value: f64) -> Option<f64> {
    (t.count > 0).then_some(value)
}

const MEASURES: [(&str, Measure); 5] = [
    ("heave, m, RMSE", |r, h| {
        let t = r.of(Source::Vessel, Quantity::Heave, h);
        known(t, t.rmse())
    }),
    ("heave, m, RMSE of the same filter told the waves", |r, h| {
        let t = r.of(Source::VesselKnownWaves, Quantity::Heave, h);
        known(t, t.rmse())
    }),
    ("roll and pitch together, deg, RMSE", |r, h| {
        let t = r.of(Source::Vessel, Quantity::Tilt, h);
        known(t, t.rmse().to_degrees())
    }),
    ("share in the 95 % ellipse of heave, roll and pitch, %", |r, h| {
        let t = r.of(Source::Vessel, Quantity::Deck, h);
        known(t, 100.0 * t.inside())
    }),
    (
        "height as the landing drone forecasts it in its last 3 s, m, RMSE",
        |r, h| {
            let t = r.of(Source::DroneDescending, Quantity::Height, h);
            known(t, t.rmse())
        },
    ),
];

/// The page.
pub fn html(rows: &[PredictionRow], hash: &str, seeds: &str) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>Study prediction</title><style>{STYLE}</style><h1>Study prediction</h1>\
         <p>Configuration <code>{}</code>, {}. The vessel's broadcast prediction against the truth: heave \
         about the mean water level; horizontal position in the vessel's own NED. <i>Heave to told</i>: RMSE \
         over that of the same filter told the waves' frequencies and directions, with its 95 % bootstrap \
         interval over seeds. <i>Ellipse</i>: heave, roll and pitch together, asked at 1 s: {} to {} %.</p>",
        escape(hash),
        escape(seeds),
        REQUIRED[0],
        REQUIRED[1],
    );
    let labels: Vec<String> = HORIZONS_S.iter().map(f64::to_string).collect();
    for (title, scaled) in [("Seas", false), ("The same with wavelengths scaled by 1.1", true)] {
        if of(rows, scaled).next().is_none() {
            continue;
        }
        let _ = write!(out, "<h2>{title}</h2>");
        table(&mut out, rows, scaled);
        for (caption, measure) in MEASURES {
            let curves: Vec<Curve> = of(rows, scaled)
                .map(|r| Curve {
                    name: r.name.clone(),
                    points: (0..HORIZONS_S.len()).map(|h| measure(r, h)).collect(),
                })
                .collect();
            let _ = write!(
                out,
                "<h2>{} over the horizon, s</h2><div class=\"wide\">{}</div>",
                escape(caption),
                chart(&labels, &curves)
            );
        }
    }
    out.push_str("</html>\n");
    out
}
