use alight_computer::{
    cells,
    table::{Cell, Table, verdict},
    terminal::wrapped,
};
use alight_sim::{
    harness::outcome::{Ending, Outcome},
    studies::statistics::{OddsBin, Summary, at_most_95, wilson},
};
use serde_json::{Map, Value, json};

type MetricRow = (&'static str, Option<f64>, usize, &'static str);

/// Metrics of one trial; None for metrics that the landing did not reach.
fn metrics(o: &Outcome) -> [MetricRow; 13] {
    [
        (
            "position error, m",
            o.position_error_m,
            3,
            "deck centre to centre of feet at first contact",
        ),
        (
            "position at rest, m",
            o.rest_position_error_m,
            3,
            "the same distance once the drone is at rest",
        ),
        (
            "touchdown speed, m/s",
            o.touchdown_speed_mps,
            2,
            "along the deck's normal, limit 1.0",
        ),
        (
            "tangential speed, m/s",
            o.tangential_speed_mps,
            2,
            "along the deck, limit 1.0",
        ),
        (
            "tilt error, deg",
            o.tilt_error_deg,
            2,
            "between the normals, limit 10",
        ),
        ("roll error, deg", o.roll_error_deg, 2, "drone minus deck"),
        ("pitch error, deg", o.pitch_error_deg, 2, "drone minus deck"),
        ("yaw error, deg", o.yaw_error_deg, 2, "drone minus deck"),
        (
            "landing time, s",
            o.landing_time_s,
            1,
            "first descent to first contact",
        ),
        (
            "over deck, s",
            o.over_deck_time_s,
            1,
            "first within 2 m to first contact",
        ),
        (
            "motors stopped, s",
            o.stop_time_s,
            2,
            "after first contact, limit 2",
        ),
        (
            "simulated, s",
            Some(o.sim_time_s),
            1,
            "warm-up of the vessel's estimator included",
        ),
        ("computed in, s", Some(o.wall_time_s), 2, ""),
    ]
}

/// Outcome of one trial with at most `rows` metrics; with `mode = "match"`, the reason of a successful match, which
/// is not a landing.
pub fn outcome(o: &Outcome, matched: Option<&str>, rows: usize) -> String {
    let mut table = Table::new(1..2, ["metric", "value", "meaning"]);
    // A landing that did not begin has few of these metrics.
    for (name, value, digits, meaning) in metrics(o).into_iter().filter(|row| row.1.is_some()).take(rows) {
        table.row(cells![name, Cell::number(value, digits), meaning]);
    }
    let broken_off = matches!(o.outcome, Ending::GaveUp | Ending::Timeout) && o.unsafe_contacts == 0;
    let name = if matched.is_some() {
        "matched".to_owned()
    } else if o.success || broken_off {
        o.outcome.name().to_owned()
    } else {
        format!("UNSAFE, {}", o.outcome.name())
    };
    format!(
        "{}: {}\nseed {}, sea {}, planner {}, {}, {}\n{}",
        verdict(&name, o.success || matched.is_some()),
        matched.unwrap_or(&o.reason),
        o.seed,
        o.sea,
        o.planner,
        plural(o.attempts, "attempt"),
        plural(o.unsafe_contacts, "unsafe contact"),
        table.text()
    )
}

fn plural(n: u32, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

pub fn summary(s: &Summary) -> String {
    let (lo, hi) = wilson(s.successes, s.trials);
    let mut table = Table::new(1.., ["metric", "mean", "sd", "p95", "max"]);
    for (name, statistics) in &s.metrics {
        if let Some(f) = statistics {
            let columns = [f.mean, f.sd, f.p95, f.max].map(|v| Cell::number(v, 3));
            table.row(core::iter::once(Cell::from(name)).chain(columns));
        }
    }
    let collisions = s.keep_out_collisions.map_or(String::new(), |n| {
        format!(", {}", plural(n, "keep-out collision"))
    });
    let flown = s.trials;
    let percent = 100.0 * s.successes as f64 / s.trials.max(1) as f64;
    let landed = format!(
        "{} of {flown} landed ({percent:.1} %, 95 % interval {:.1} to {:.1} %), {}{collisions}",
        s.successes,
        100.0 * lo,
        100.0 * hi,
        plural(s.unsafe_contacts, "unsafe contact"),
    );
    // One landing may have several such contacts, or none if the drone toppled or its motors stayed on.
    let by = match (s.unsafe_trials, s.unsafe_contacts) {
        (0, _) => String::new(),
        (_, contacts) => format!(" (by {})", plural(contacts, "contact")),
    };
    let bad = s.unsafe_trials;
    let most = 100.0 * at_most_95(s.unsafe_trials, flown);
    let bound = format!("unsafe: {bad} of {flown} landings{by}; with 95 % confidence at most {most:.1} %");
    format!("{}\n{}\n{}", wrapped(&landed), wrapped(&bound), table.text())
}

/// Table of predicted probabilities with the observed frequencies.
fn calibration(name: &str, came: &str, digits: usize, bins: &[OddsBin]) -> String {
    let mut table = Table::new(1.., [name, "descents", "predicted", came, "95 % interval"]);
    for b in bins {
        let [from, to] = b.between;
        table.row(cells![
            format!("{from:.digits$} to {to:.digits$}"),
            b.descents,
            Cell::number(Some(b.predicted), 3),
            Cell::number(Some(b.came as f64 / b.descents.max(1) as f64), 3),
            format!("{:.3} to {:.3}", b.interval.0, b.interval.1)
        ]);
    }
    table.text()
}

/// Predicted probabilities of a landing and of an unsafe contact at the start of a descent, with the observed
/// frequencies.
pub fn odds(s: &Summary) -> String {
    let landed = calibration("likelihood", "landed", 2, &s.likelihood);
    format!("{landed}\n{}", calibration("harm", "unsafe", 3, &s.harm))
}

/// Predicted probabilities of an unsafe contact at the commitment, with the observed frequencies.
pub fn committed_odds(s: &Summary) -> String {
    calibration("harm at commitment", "unsafe", 3, &s.committed_harm)
}

pub fn summary_json(s: &Summary) -> Map<String, Value> {
    let (lo, hi) = wilson(s.successes, s.trials);
    let mut map = Map::new();
    for (name, value) in [
        ("trials", json!(s.trials)),
        ("successes", json!(s.successes)),
        ("success_rate_95", json!([lo, hi])),
        ("descents", json!(s.descents[0])),
        ("descents_ended_badly", json!(s.descents[1])),
        ("rejected", json!(s.rejected)),
        ("unsafe", json!(s.unsafe_trials)),
        ("unsafe_at_most_95", json!(at_most_95(s.unsafe_trials, s.trials))),
        ("unsafe_contacts", json!(s.unsafe_contacts)),
        ("water_contacts", json!(s.water_contacts)),
        ("contacts_above_2_mps", json!(s.contacts_above_2_mps)),
        ("failures", json!(s.failures)),
        ("likelihood", json!(s.likelihood)),
        ("harm", json!(s.harm)),
        ("committed_harm", json!(s.committed_harm)),
    ] {
        map.insert(name.into(), value);
    }
    if let Some(collisions) = s.keep_out_collisions {
        map.insert("keep_out_collisions".into(), json!(collisions));
    }
    map.extend(
        s.metrics
            .iter()
            .map(|(name, statistics)| ((*name).into(), json!(statistics))),
    );
    map
}
