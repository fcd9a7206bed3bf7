//! The report for a person, within 100 columns.

use alight_usv::review::{HORIZONS_S, Review};

fn cell(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"))
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
    line(format!(
        "{:<14}{:>9}{:>8}{:>7}{:>11}{:>9}{:>8}{:>9}{:>9}{:>8}",
        "source", "samples", "Hz", "gaps", "longest s", "used", "gated", "order", "refused", "spare"
    ));
    for s in &r.sources {
        line(format!(
            "{:<14}{:>9}{:>8.2}{:>7}{:>11.3}{:>9}{:>8}{:>9}{:>9}{:>8}",
            format!("{} {}", s.kind, s.source),
            s.samples,
            s.rate_hz,
            s.gaps,
            s.longest_gap_s,
            s.counts.taken,
            s.counts.gated,
            s.counts.out_of_order,
            s.counts.rejected,
            s.counts.spare
        ));
    }
    line(String::new());
    let [heave, roll, pitch] = r.motion_sd;
    line(format!(
        "motion (sd)   heave {} m   roll {} deg   pitch {} deg   {} estimates, {} restarts",
        cell(heave, 3),
        cell(roll, 2),
        cell(pitch, 2),
        r.estimates,
        r.restarts
    ));
    let sea = &r.sea;
    line(format!(
        "sea state   Hs {} m   peak period {} s   identified {:.0} % of the time, confidence {:.2}",
        cell(sea.significant_height_m, 2),
        cell(sea.peak_period_s, 2),
        100.0 * sea.identified_fraction,
        sea.confidence
    ));
    line(String::new());
    line(format!(
        "{:<20}{:>10}{:>14}{:>16}{:>12}{:>11}",
        "waves at the end", "period s", "encountered s", "towards deg", "heave m", "tilt deg"
    ));
    for (k, c) in sea.components.iter().enumerate() {
        line(format!(
            "{:<20}{:>10.2}{:>14.2}{:>16}{:>12}{:>11.2}",
            k + 1,
            c.period_s,
            c.encounter_period_s,
            cell(c.direction_deg, 0),
            cell(c.heave_m, 3),
            c.tilt_deg
        ));
    }
    if sea.components.is_empty() {
        line("none identified".into());
    }
    line(String::new());
    line(format!("from {:.0} s on:", r.evaluated_from_s));
    line(format!(
        "{:<20}{:>10}{:>10}{:>14}{:>16}",
        "innovations", "fused", "gated", "mean NIS (1)", "in 95 % (95)"
    ));
    for f in &r.innovations {
        line(format!(
            "{:<20}{:>10}{:>10}{:>14.2}{:>14.1} %",
            f.channel.name(),
            f.fused,
            f.gated,
            f.nis_mean,
            100.0 * f.inside_95
        ));
    }
    line(String::new());
    let heads = |what: &str| HORIZONS_S.map(|h| format!("{what} {h} s"));
    let [a, b, c] = heads("at");
    let [d, e, f] = heads("held");
    line(format!(
        "{:<14}{:>6}{:>9}{:>9}{:>9}{:>11}{:>9}{:>9}   {}",
        "prediction", "", a, b, c, d, e, f, "in 95 % (95)"
    ));
    for p in &r.predictions {
        let digits = if p.unit == "m" { 3 } else { 2 };
        let [a, b, c] = p.rms.map(|v| format!("{v:.digits$}"));
        let [d, e, f] = p.hold_rms.map(|v| format!("{v:.digits$}"));
        let [x, y, z] = p.inside_95.map(|v| format!("{:.0}", 100.0 * v));
        line(format!(
            "{:<14}{:<6}{a:>9}{b:>9}{c:>9}{d:>11}{e:>9}{f:>9}   {x:>3} {y:>3} {z:>3} %",
            p.what, p.unit
        ));
    }
    if let Some(p) = r.predictions.first() {
        line(format!(
            "  rms against the later estimate, {} predictions; held: the last estimate stands still",
            p.count
        ));
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
