//! Findings on a vessel's sensors and estimate: rejections, decoding remarks, and whether the estimate is good enough
//! for a landing.

use alight_computer::{process::snapshot::time, situation::SourceHealth};
use alight_shared::{
    estimation::JITTER_S,
    msg::{EstimatorStatus, Line},
};

use super::finding::{Finding, FindingTopic};

/// Age above which a sensor or an estimate counts as missing, s.
pub const MISSING_S: f64 = 2.0;
/// Maximum standard deviations of an estimate for a landing. Chosen: within these, the drone finds the deck's tags
/// from about 10 m above the deck, with a field of view of about 5 m.
const MAX_PLACE_M: f64 = 5.0;
const MAX_HEIGHT_M: f64 = 5.0;
const MAX_TILT_DEG: f64 = 2.0;
const MAX_HEADING_DEG: f64 = 5.0;
const MIN_RECENT: u64 = 5;

/// Finding on one source. A missing source is a warning because another of the same kind may replace it;
/// [`estimator`] reports a kind without any source.
pub fn source(s: &SourceHealth) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("source");
    let (r, d, uses) = (&s.report, &s.report.status.decoded, &s.uses);
    let undated = d.undated + r.status.implausible_time;
    let counts = format!(
        "{}: {} good, {} corrupted, {undated} undated, {} out of order; {} used, {} outliers, {} rejected",
        s.name,
        d.good,
        d.corrupted,
        r.status.out_of_order + uses.out_of_order,
        uses.used,
        uses.outliers,
        uses.rejected
    );
    let silent = match (s.age_s, &r.why) {
        (Some(age_s), _) if age_s - r.status.delay_s <= MISSING_S => None,
        (_, Some(why)) => Some(why.to_string()),
        (Some(age_s), None) => Some(format!("nothing for {age_s:.0} s")),
        (None, None) => Some("no measurement yet".into()),
    };
    if uses.is_stuck {
        return TOPIC.broken(
            format!("{counts}; STUCK: it repeats one sample, {} rejected", uses.stuck),
            "its output is not a measurement: power it off and on, then check its cable and its driver",
        );
    }
    match silent {
        Some(why) => TOPIC.warning(
            format!("{counts}; {why}"),
            "check its power, its cable, and its rate and format in vessel.toml; run alight check with the service stopped",
        ),
        None if d.mismatched_pulses > 0 => TOPIC.warning(
            format!(
                "{counts}; {} time pulses in a different time base than its fixes",
                d.mismatched_pulses
            ),
            "set the receiver's time pulse to GNSS time (CFG-TP): a clock kept by the pulse would be seconds wrong",
        ),
        None if r.status.delay_s > JITTER_S => TOPIC.stopping(
            format!("{counts}; LATE: {} old", time(r.status.delay_s)),
            "read the finding on its line below",
        ),
        None => match rejection(s) {
            Some(rejections) => TOPIC.warning(
                format!("{counts}; {rejections}"),
                "if its data are too old or from the future, check its clock, latency_s and line; if another sensor contradicts it, its mount",
            ),
            None => TOPIC.fine(format!("{counts}; {} old", time(s.age_s.unwrap_or_default()))),
        },
    }
}

pub fn of(s: &SourceHealth) -> impl Iterator<Item = Finding> {
    let remarks = s.report.remarks.iter().map(|r| {
        let remedy = r.remedy.as_ref().map(Line::as_str);
        remark(&s.name, r.text.as_str(), remedy)
    });
    core::iter::once(source(s)).chain(remarks)
}

/// Decoding remark on a source, in addition to its counts.
pub fn remark(name: &str, text: &str, remedy: Option<&str>) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("sensors");
    let found = format!("{name}: {text}");
    match remedy {
        Some(remedy) => TOPIC.warning(found, remedy),
        None => TOPIC.fine(found),
    }
}

/// Text for a source whose recent measurements were mostly rejected.
fn rejection(s: &SourceHealth) -> Option<String> {
    let [used, rejections] = s.uses.lately;
    let all = used + rejections;
    (all >= MIN_RECENT && rejections > used).then(|| {
        format!(
            "{rejections} of the last {all} measurements of {} rejected",
            s.name
        )
    })
}

fn uncertain(sd: [f64; 4]) -> Vec<String> {
    let [place, height, tilt, heading] = sd;
    let deg = f64::to_degrees;
    [
        ("position", place, MAX_PLACE_M, "m"),
        ("height", height, MAX_HEIGHT_M, "m"),
        ("tilt", deg(tilt), MAX_TILT_DEG, "deg"),
        ("heading", deg(heading), MAX_HEADING_DEG, "deg"),
    ]
    .into_iter()
    .filter(|(_, is, most, _)| is > most)
    .map(|(what, is, most, unit)| format!("{what} +- {is:.1} {unit} (a landing needs {most} {unit})"))
    .collect()
}

/// Findings on gaps of the estimate and on whether it is good enough for a landing.
pub fn estimator(e: &EstimatorStatus, sources: &[SourceHealth]) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("estimator");
    let mut all = Vec::new();
    for (k, name) in ["inertial or attitude sensor", "GNSS", "heading"]
        .iter()
        .enumerate()
    {
        let found = match e.sensor_age_s.get(k).copied().flatten() {
            Some(s) if s <= MISSING_S => continue,
            Some(s) => format!("{name}: nothing for {s:.0} s"),
            None => format!("{name}: nothing yet"),
        };
        all.push(
            FindingTopic("sensors").broken(found, "check the sensor and [[sensor.sources]] in vessel.toml"),
        );
    }
    let [horizontal, height, tilt, heading] = e.sd;
    let rejections: Vec<String> = sources.iter().filter_map(rejection).collect();
    let cause = if rejections.is_empty() {
        String::new()
    } else {
        format!("; {}", rejections.join("; "))
    };
    let worse = uncertain(e.sd);
    all.push(match e.estimate_age_s {
        Some(s) if s <= MISSING_S && !worse.is_empty() => TOPIC.warning(
            format!("{}{cause}", worse.join(", ")),
            if cause.is_empty() {
                "no sensor measures it better: read the findings of the sources above"
            } else {
                "repair the source that is rejected"
            },
        ),
        Some(s) if s <= MISSING_S => TOPIC.fine(format!(
            "position +- {horizontal:.2} m, height {height:.2} m, tilt {:.2} deg, heading {:.1} deg; {}; {} inputs \
             rejected, {:?} outliers (inertial, GNSS, heading), {} restarts of the filter",
            tilt.to_degrees(),
            heading.to_degrees(),
            e.waves.map_or_else(
                || "no waves yet".into(),
                |[h, c]| format!("waves of {h:.1} m, trusted to {:.0} %", 100.0 * c)
            ),
            e.rejected,
            e.outliers,
            e.restarts,
        )),
        Some(s) => TOPIC.broken(
            format!("no estimate for {s:.0} s{cause}"),
            "drones receive no estimate: repair the sensor of the alarm; without one, calibrate the accelerometer",
        ),
        None => TOPIC.broken(
            format!("no estimate yet{cause}"),
            if e.sensor_age_s.iter().all(|age| age.is_some_and(|s| s <= MISSING_S)) {
                "wait for some seconds; if it stays, hold the inertial sensor level: z has to be within 0.3 m/s2 of \
                 9.81, else calibrate it"
            } else {
                "it needs inertial sensor, GNSS and heading for some seconds"
            },
        ),
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::FindingLevel;
    use alight_shared::msg::SourceUse;

    fn receiver() -> SourceHealth {
        SourceHealth {
            name: "receiver".into(),
            age_s: Some(0.1),
            uses: SourceUse {
                used: 880,
                ..SourceUse::default()
            },
            ..SourceHealth::default()
        }
    }
    fn sound() -> EstimatorStatus {
        EstimatorStatus {
            sensor_age_s: [Some(0.01), Some(0.1), Some(0.1)],
            estimate_age_s: Some(0.03),
            sd: [0.5, 0.1, 0.005, 0.01],
            ..EstimatorStatus::default()
        }
    }

    #[test]
    fn vessel_status_of_an_estimate_that_is_too_uncertain() {
        // The receiver's clock fell back: every fix is rejected, and the position drifts.
        let rejecting = |lately| {
            let mut source = receiver();
            source.uses.lately = lately;
            source
        };
        let lost = rejecting([0, 63]);
        let drifted = EstimatorStatus {
            sd: [70.0, 0.4, 0.005, 0.17],
            ..sound()
        };
        let finding = source(&lost);
        assert_eq!(finding.level, FindingLevel::Warning);
        assert!(
            finding
                .found
                .contains("63 of the last 63 measurements of receiver rejected")
        );
        // A full line is no silence.
        let mut late = lost.clone();
        late.age_s = Some(3.4);
        late.report.status.delay_s = 3.3;
        let finding = source(&late);
        assert!(
            finding.stops && finding.found.ends_with("; LATE: 3.3 s old"),
            "{finding}"
        );
        let all = estimator(&drifted, &[lost]);
        let worse = &all[0];
        assert!(all.len() == 1 && worse.level == FindingLevel::Warning, "{all:?}");
        for part in [
            "position +- 70.0 m (a landing needs 5 m)",
            "heading +- 9.7 deg",
            "63 of the last 63",
        ] {
            assert!(worse.found.contains(part), "{worse:?}");
        }
        // Occasional rejections are reported only as the reason for a missing estimate.
        let now_and_then = rejecting([60, 3]);
        assert_eq!(source(&now_and_then).level, FindingLevel::Fine);
        assert_eq!(estimator(&sound(), &[now_and_then])[0].level, FindingLevel::Fine);
        let none = EstimatorStatus {
            estimate_age_s: None,
            ..sound()
        };
        let rejections = rejecting([0, 40]);
        let first = &estimator(&none, &[rejections])[0];
        assert!(
            first.found.starts_with("no estimate yet; 40 of the last 40"),
            "{first}"
        );
        assert!(first.remedy.contains("9.81"), "{first}");
    }

    #[test]
    fn remarks_on_a_source() {
        let found = remark("receiver", "height: by EGM96", Some("let it state its own"));
        assert_eq!(
            (found.level, found.found.as_str()),
            (FindingLevel::Warning, "receiver: height: by EGM96")
        );
        assert_eq!(
            remark("receiver", "left out: 5 AIVDM", None).level,
            FindingLevel::Fine
        );
    }
}
