//! Tables for a person: at most 100 columns, colours only on a terminal.

use std::io::IsTerminal;

use alight_sim::harness::outcome::Outcome;
use alight_sim::studies::statistics::{Summary, wilson};

/// Bold green or red on a terminal, plain elsewhere.
pub fn verdict(text: &str, good: bool) -> String {
    if std::io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none() {
        let colour = if good { 32 } else { 31 };
        format!("\x1b[1;{colour}m{text}\x1b[0m")
    } else {
        text.into()
    }
}

fn cell(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"))
}

/// The outcome of one trial.
pub fn outcome(o: &Outcome) -> String {
    let rows: [(&str, Option<f64>, usize, &str, &str); 13] = [
        (
            "position error",
            o.position_error_m,
            3,
            "m",
            "deck centre to the feet's centroid at first contact",
        ),
        (
            "position at rest",
            o.rest_position_error_m,
            3,
            "m",
            "the same when all is still",
        ),
        (
            "touchdown speed",
            o.touchdown_speed_mps,
            2,
            "m/s",
            "along the deck's normal, limit 1.0",
        ),
        (
            "tangential speed",
            o.tangential_speed_mps,
            2,
            "m/s",
            "along the deck, limit 1.0",
        ),
        (
            "tilt error",
            o.tilt_error_deg,
            2,
            "deg",
            "between the normals, limit 10",
        ),
        ("roll error", o.roll_error_deg, 2, "deg", "drone minus deck"),
        ("pitch error", o.pitch_error_deg, 2, "deg", "drone minus deck"),
        ("yaw error", o.yaw_error_deg, 2, "deg", "drone minus deck"),
        (
            "landing time",
            o.landing_time_s,
            1,
            "s",
            "first descent to first contact",
        ),
        (
            "over deck",
            o.over_deck_time_s,
            1,
            "s",
            "first within 2 m to first contact",
        ),
        (
            "motors stopped",
            o.stop_time_s,
            2,
            "s",
            "after first contact, limit 2",
        ),
        (
            "simulated",
            Some(o.sim_time_s),
            1,
            "s",
            "warm-up of the vessel's estimator included",
        ),
        ("computed in", Some(o.wall_time_s), 2, "s", ""),
    ];
    let mut out = format!(
        "{}: {}\nseed {}, sea {}, planner {}, {} attempt{}, {} unsafe contact{}\n",
        verdict(o.outcome.name(), o.success),
        o.reason,
        o.seed,
        o.sea,
        o.planner,
        o.attempts,
        if o.attempts == 1 { "" } else { "s" },
        o.unsafe_contacts,
        if o.unsafe_contacts == 1 { "" } else { "s" },
    );
    for (name, value, digits, unit, note) in rows {
        let line = format!("  {name:<18}{:>9} {unit:<5}{note}", cell(value, digits));
        out.push_str(line.trim_end());
        out.push('\n');
    }
    out
}

/// The summary of many trials.
pub fn summary(s: &Summary) -> String {
    let (lo, hi) = wilson(s.successes, s.trials);
    let mut out = format!(
        "{} of {} landed ({:.1} %, 95 % interval {:.1} to {:.1} %), {} unsafe contacts\n",
        s.successes,
        s.trials,
        100.0 * s.successes as f64 / s.trials.max(1) as f64,
        100.0 * lo,
        100.0 * hi,
        s.unsafe_contacts
    );
    out.push_str(&format!(
        "  {:<24}{:>10}{:>10}{:>10}{:>10}\n",
        "", "mean", "sd", "p95", "max"
    ));
    for (name, figure) in &s.metrics {
        let cells = match figure {
            Some(f) => format!("{:>10.3}{:>10.3}{:>10.3}{:>10.3}", f.mean, f.sd, f.p95, f.max),
            None => format!("{:>10}{:>10}{:>10}{:>10}", "-", "-", "-", "-"),
        };
        out.push_str(&format!("  {name:<24}{cells}\n"));
    }
    out
}

/// The summary as the JSON object of `trials --json`.
pub fn summary_json(s: &Summary) -> serde_json::Map<String, serde_json::Value> {
    let (lo, hi) = wilson(s.successes, s.trials);
    let mut map = serde_json::Map::new();
    map.insert("trials".into(), s.trials.into());
    map.insert("successes".into(), s.successes.into());
    map.insert("success_rate_95".into(), serde_json::json!([lo, hi]));
    map.insert("unsafe_contacts".into(), s.unsafe_contacts.into());
    map.insert("water_contacts".into(), s.water_contacts.into());
    map.insert("contacts_above_2_mps".into(), s.contacts_above_2_mps.into());
    for (name, figure) in &s.metrics {
        map.insert(
            (*name).into(),
            serde_json::to_value(figure).unwrap_or(serde_json::Value::Null),
        );
    }
    map
}
