//! The report for a person, within 100 columns.

use alight_computer::cells;
use alight_computer::table::{Cell, Table, number};
use alight_shared::frames::wrap_angle;
use alight_usv::CourseOutlook;
use alight_usv::review::{HORIZONS_S, Review};

/// The courses at the speed of the last one, 45 deg apart.
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

/// The report.
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
        wrapped(note, &mut line);
    }
    line(String::new());
    let heads = [
        "source",
        "samples",
        "Hz",
        "gaps",
        "longest s",
        "used",
        "gated",
        "order",
        "refused",
        "spare",
    ];
    let mut sources = Table::new(1.., heads);
    for s in &r.sources {
        sources.row(cells![
            format_args!("{} {}", s.kind, s.source),
            s.samples,
            Cell::number(s.rate_hz, 2),
            s.gaps,
            Cell::number(s.longest_gap_s, 3),
            s.counts.taken,
            s.counts.gated,
            s.counts.out_of_order,
            s.counts.rejected,
            s.counts.spare
        ]);
    }
    line(sources.text());
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
    let heads = ["modes at the end", "period s", "damping", "heave m", "tilt deg"];
    let mut modes = Table::new(1.., heads);
    for (k, m) in sea.modes.iter().enumerate() {
        modes.row(cells![
            k + 1,
            Cell::number(m.period_s, 2),
            Cell::number(m.damping_ratio, 3),
            Cell::number(m.heave_m, 3),
            Cell::number(m.tilt_deg, 2)
        ]);
    }
    line(modes.text());
    if sea.modes.is_empty() {
        line("none identified".into());
    }
    line(String::new());
    if let Some(here) = r.courses.first() {
        line(courses(here, &r.courses).text());
        line(String::new());
    }
    line(format!("from {:.0} s on:", r.evaluated_from_s));
    let mut innovations = Table::new(
        1..,
        ["innovations", "fused", "gated", "mean NIS (1)", "in 95 % (95)"],
    );
    for f in &r.innovations {
        innovations.row(cells![
            f.channel.name(),
            f.fused,
            f.gated,
            Cell::number(f.nis_mean, 2),
            format_args!("{:.1} %", 100.0 * f.inside_95)
        ]);
    }
    line(innovations.text());
    line(String::new());
    let heads = ["prediction", "", "by"].map(String::from);
    let heads = heads.into_iter().chain(HORIZONS_S.map(|h| format!("{h} s")));
    let mut predictions = Table::new(3.., heads.chain(["in 95 % (95)".into()]));
    for p in &r.predictions {
        let digits = if p.unit == "m" { 3 } else { 2 };
        let cell = |v: Option<f64>| Cell::number(v, digits);
        let [x, y, z] = p.inside_95.map(|v| 100.0 * v);
        let inside = Cell::from(format_args!("{x:.0} {y:.0} {z:.0} %"));
        let errors = p.rms.map(|v| cell(Some(v)));
        predictions.row(
            cells![p.what, p.unit, "modes"]
                .into_iter()
                .chain(errors)
                .chain([inside]),
        );
        let beside = [("ridge", p.ridge_rms), ("held", p.hold_rms.map(Some))];
        for (by, errors) in beside.into_iter().filter(|(_, e)| e.iter().any(Option::is_some)) {
            let row = cells!["", "", by].into_iter().chain(errors.map(cell));
            predictions.row(row.chain([Cell::default()]));
        }
    }
    line(predictions.text());
    if let Some(p) = r.predictions.first() {
        line(format!(
            "  rms against the later estimate, {} predictions; modes: as broadcast; ridge: regression on two",
            p.count
        ));
        line("  minutes of estimates; held: the last estimate stands still".into());
    } else {
        line("  too short for a prediction to be compared".into());
    }
    let worse = r
        .predictions
        .iter()
        .filter(|p| p.rms.iter().zip(&p.hold_rms).any(|(a, b)| a > b));
    let worse: Vec<String> = worse.map(|p| p.what.to_string()).collect();
    if !worse.is_empty() {
        line(format!(
            "  worse than the last estimate held: {}",
            worse.join(", ")
        ));
    }
    out
}

/// A note over lines of at most 98 columns.
fn wrapped(note: &str, line: &mut impl FnMut(String)) {
    let mut text = String::from(" ");
    for word in note.split_whitespace() {
        if text.len() + word.len() > 97 {
            line(core::mem::replace(&mut text, String::from("   ")));
        }
        text.push(' ');
        text.push_str(word);
    }
    line(text);
}
