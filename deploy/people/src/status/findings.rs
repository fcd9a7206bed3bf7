//! Findings on a situation: thresholds and texts of `alight status` and of the page.

use alight_computer::{
    process::{lateness, snapshot::minutes},
    situation::ObservedSituation,
};
use alight_shared::metrics::MetricName;

use super::{
    drone,
    finding::{Finding, FindingTopic},
    vessel,
};

pub fn judge(s: &ObservedSituation) -> Vec<Finding> {
    let mut all = processes(s);
    all.extend(match s.vessel() {
        Some((known, status)) => vessel::findings(s, known, status),
        None => drone::findings(s),
    });
    all
}

fn unit(s: &ObservedSituation) -> &'static str {
    if s.known.vessel.is_some() {
        "alight-vessel"
    } else {
        "alight-drone"
    }
}

fn processes(s: &ObservedSituation) -> Vec<Finding> {
    let mut all = Vec::new();
    let silent: Vec<String> = s
        .silent()
        .into_iter()
        .map(|(kind, for_s)| match for_s {
            Some(for_s) => format!("{} for {}", kind.name(), minutes(for_s)),
            None => kind.name().into(),
        })
        .collect();
    if !silent.is_empty() {
        all.push(FindingTopic("processes").broken(
            format!("no report of {}", silent.join(", ")),
            format!("it ended or is frozen: systemctl status {}", unit(s)),
        ));
    }
    if let Some(for_s) = s.unreported_s() {
        all.push(FindingTopic("processes").broken(
            format!("no report of the service for {}", minutes(for_s)),
            format!(
                "it ended or is frozen, and restarts no process: systemctl status {}",
                unit(s)
            ),
        ));
    }
    let late = lateness::finding(s.snapshot.processes.values());
    all.extend(late.map(|late| FindingTopic("computer").warning(late, lateness::REMEDY)));
    for p in s.snapshot.processes.values() {
        let steps = p.count(MetricName::StepsUnrecorded);
        if steps > 0 {
            all.push(FindingTopic("recorder").warning(
                format!("{steps} steps not recorded by {}", p.kind.name()),
                "the process continues without recording; its journal names file and error: free space, or make it writable",
            ));
        }
    }
    all.extend(s.known.edited.iter().map(|edited| {
        let remedy = format!("when nothing flies: systemctl restart {}", unit(s));
        FindingTopic("configuration").warning(edited.as_str(), remedy)
    }));
    all
}
