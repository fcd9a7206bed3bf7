//! Text of the report, within 100 columns.

use alight_computer::{
    cells,
    table::{Cell, Table, number},
    terminal::wrap,
};
use alight_shared::frames::wrap_angle;
use alight_usv::{
    CourseOutlook,
    review::{HORIZONS_S, PredictionReview, Review},
};

fn courses(here: &CourseOutlook, all: &[CourseOutlook]) -> Table {
    let heads = [
        "course",
        "from now deg",
        "tilt deg",
        "heave m/s",
        "slope",
        "landing %",
    ];
    let mut table = Table::new(1.., heads);
    let alike = all.iter().filter(|c| c.speed_mps == here.speed_mps);
    for c in alike.step_by(3) {
        let turn = wrap_angle(c.heading_rad - here.heading_rad).to_degrees();
        table.row(cells![
            format_args!(
                "{:03.0} deg, {:.1} m/s",
                c.heading_rad.to_degrees().rem_euclid(360.0),
                c.speed_mps
            ),
            Cell::number(turn, 0),
            Cell::number(c.tilt_rad().to_degrees(), 1),
            Cell::number(c.heave_rate_sd_mps, 2),
            Cell::number(c.slope_sd, 3),
            Cell::number(100.0 * c.likelihood, 0)
        ]);
    }
    table
}

fn sources(r: &Review) -> Table {
    let heads = [
        "source",
        "samples",
        "Hz",
        "gaps",
        "longest s",
        "used",
        "outliers",
        "order",
        "rejected",
        "spare",
    ];
    let mut table = Table::new(1.., heads);
    for s in &r.sources {
        table.row(cells![
            format_args!("{} {}", s.kind, s.source),
            s.samples,
            Cell::number(s.rate_hz, 2),
            s.gaps,
            Cell::number(s.longest_gap_s, 3),
            s.counts.taken,
            s.counts.outliers,
            s.counts.out_of_order,
            s.counts.rejected,
            s.counts.spare
        ]);
    }
    table
}

fn modes(r: &Review) -> Table {
    let heads = ["modes at the end", "period s", "damping", "heave m", "tilt deg"];
    let mut table = Table::new(1.., heads);
    for (k, m) in r.sea.modes.iter().enumerate() {
        table.row(cells![
            k + 1,
            Cell::number(m.period_s, 2),
            Cell::number(m.damping_ratio, 3),
            Cell::number(m.heave_m, 3),
            Cell::number(m.tilt_deg, 2)
        ]);
    }
    table
}

fn innovations(r: &Review) -> Table {
    let heads = ["innovations", "fused", "rejected", "mean NIS (1)", "in 95 % (95)"];
    let mut table = Table::new(1.., heads);
    for f in &r.innovations {
        table.row(cells![
            f.channel.name(),
            f.fused,
            f.rejected,
            Cell::number(f.nis_mean, 2),
            format_args!("{:.1} %", 100.0 * f.inside_95)
        ]);
    }
    table
}

/// RMS errors of predictions by `model` at each horizon, next to those of reference methods.
pub fn predictions(model: &str, reviews: &[PredictionReview]) -> Table {
    let heads = ["prediction", "", "by"].map(String::from);
    let heads = heads.into_iter().chain(HORIZONS_S.map(|h| format!("{h} s")));
    let mut table = Table::new(3.., heads.chain(["in 95 % (95)".into()]));
    for p in reviews {
        let digits = if p.unit == "m" { 3 } else { 2 };
        let cell = |v: Option<f64>| Cell::number(v, digits);
        let inside = p.inside_95.map(|v| format!("{:.0}", 100.0 * v)).join(" ");
        let inside = Cell::from(format_args!("{inside} %"));
        let errors = p.rms.map(|v| cell(Some(v)));
        table.row(
            cells![p.what, p.unit, model]
                .into_iter()
                .chain(errors)
                .chain([inside]),
        );
        let references = [("ridge", p.ridge_rms), ("held", p.hold_rms.map(Some))];
        for (by, errors) in references
            .into_iter()
            .filter(|(_, e)| e.iter().any(Option::is_some))
        {
            let row = cells!["", "", by].into_iter().chain(errors.map(cell));
            table.row(row.chain([Cell::default()]));
        }
    }
    table
}

fn prediction_notes(r: &Review) -> Vec<String> {
    let mut lines = match r.predictions.first() {
        Some(p) => vec![
            format!(
                "  rms against the later estimate, {} predictions; modes: as broadcast; ridge: regression on two",
                p.count
            ),
            "  minutes of estimates; held: the last estimate, unchanged".into(),
        ],
        None => vec!["  too short for a prediction to be compared".into()],
    };
    let worse = r
        .predictions
        .iter()
        .filter(|p| p.rms.iter().zip(&p.hold_rms).any(|(a, b)| a > b));
    let worse: Vec<String> = worse.map(|p| p.what.to_string()).collect();
    if !worse.is_empty() {
        lines.push(format!(
            "  worse than the last estimate, unchanged: {}",
            worse.join(", ")
        ));
    }
    lines
}

pub fn table(origin: &str, r: &Review) -> String {
    let mut out = String::new();
    let mut line = |text: String| {
        out.push_str(text.trim_end());
        out.push('\n');
    };
    line(format!("{origin}: {}, {:.1} s", r.format, r.duration_s));
    let d = &r.decoded;
    line(format!(
        "  {} read, {} corrupted, {} of other kinds, {} without a time, {} dated far ahead",
        d.good, d.corrupted, d.ignored, d.undated, r.outliers_in_time
    ));
    for note in &r.notes {
        let mut text = String::from(" ");
        wrap(&mut text, 4, 98, note);
        line(text);
    }
    line(String::new());
    line(sources(r).text());
    line(String::new());
    let [heave, roll, pitch] = r.motion_sd;
    line(format!(
        "motion (sd)   heave {} m   roll {} deg   pitch {} deg   {} estimates, {} restarts",
        number(heave, 3),
        number(roll, 2),
        number(pitch, 2),
        r.estimates,
        r.restarts
    ));
    let sea = &r.sea;
    line(format!(
        "sea state   Hs {} m   peak period {} s   identified {:.0} % of the time, confidence {:.2}",
        number(sea.significant_height_m, 2),
        number(sea.peak_period_s, 2),
        100.0 * sea.identified_fraction,
        sea.confidence
    ));
    line(String::new());
    line(modes(r).text());
    if sea.modes.is_empty() {
        line("none identified".into());
    }
    line(String::new());
    if let Some(here) = r.courses.first() {
        line(courses(here, &r.courses).text());
        line(String::new());
    }
    line(format!("from {:.0} s on:", r.evaluated_from_s));
    line(innovations(r).text());
    line(String::new());
    line(predictions("modes", &r.predictions).text());
    prediction_notes(r).into_iter().for_each(line);
    out
}
