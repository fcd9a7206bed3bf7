//! Findings of `alight status` as ROS diagnostics: one status per topic of findings, and a summary.
//!
//! A viewer of diagnostics keeps the last status of each name. A topic without findings is therefore reported as OK,
//! and every topic is STALE while no process runs, the mission is silent or a process has ended.

use std::collections::BTreeSet;

use crate::ros2::messages::{DiagnosticArray, DiagnosticStatus, KeyValue, RosHeader, RosTime, level};
use alight_people::status::{
    Status,
    finding::{Finding, FindingLevel},
};

pub struct Diagnostics {
    node: String,
    /// Topics of all findings so far.
    topics: BTreeSet<&'static str>,
}

const fn number(found: FindingLevel) -> u8 {
    match found {
        FindingLevel::Fine => level::OK,
        FindingLevel::Warning => level::WARN,
        FindingLevel::Broken => level::ERROR,
    }
}

fn value(key: &str, value: impl Into<String>) -> KeyValue {
    KeyValue {
        key: key.into(),
        value: value.into(),
    }
}

impl Diagnostics {
    pub fn of(node: &str) -> Diagnostics {
        Diagnostics {
            node: node.into(),
            topics: BTreeSet::new(),
        }
    }
    pub fn array(&mut self, status: &Status, stamp: RosTime) -> DiagnosticArray {
        if status.running {
            self.topics.extend(status.findings.iter().map(|f| f.topic));
        }
        let topics = self.topics.iter().map(|topic| self.topic(status, topic));
        DiagnosticArray {
            header: RosHeader {
                stamp,
                frame_id: String::new(),
            },
            status: core::iter::once(self.summary(status)).chain(topics).collect(),
        }
    }
    fn status(&self, name: &str, level: u8, message: String, status: &Status) -> DiagnosticStatus {
        DiagnosticStatus {
            level,
            name: format!("{}: {name}", self.node),
            message,
            hardware_id: status.title.clone(),
            values: Vec::new(),
        }
    }
    fn summary(&self, status: &Status) -> DiagnosticStatus {
        let is_stale = !status.running || status.state.as_ref().is_some_and(|s| s.stale);
        let level = if is_stale {
            level::STALE
        } else {
            number(status.worst)
        };
        let go = &status.go;
        let mut values = vec![value("landing", go.verdict), value("why", go.why.as_str())];
        values.extend(status.state.iter().flat_map(|s| {
            [
                value("state", s.name.as_str()),
                value("waiting", s.waiting.as_str()),
            ]
        }));
        DiagnosticStatus {
            values,
            ..self.status("summary", level, status.headline.clone(), status)
        }
    }
    /// Status of a topic: the message is the worst finding, the values are the remedies.
    fn topic(&self, status: &Status, topic: &str) -> DiagnosticStatus {
        // A silent computer has no findings, but this does not mean that it is fine.
        let ended = |f: &Finding| f.topic == "processes" && f.level == FindingLevel::Broken;
        let old = status.state.as_ref().is_some_and(|s| s.stale);
        let is_silent = topic != "processes" && (old || status.findings.iter().any(ended));
        if !status.running || is_silent {
            return self.status(topic, level::STALE, status.headline.clone(), status);
        }
        let all: Vec<&Finding> = status.findings.iter().filter(|f| f.topic == topic).collect();
        let worst = all.iter().map(|f| f.level).max().unwrap_or_default();
        let worst_ones = || all.iter().filter(|f| f.level == worst);
        let found: Vec<&str> = worst_ones().map(|f| f.found.as_str()).collect();
        let message = match found.as_slice() {
            [] => "as it should be".to_owned(),
            found => found.join("; "),
        };
        let remedies = worst_ones().filter(|f| !f.remedy.is_empty());
        DiagnosticStatus {
            values: remedies.map(|f| value("remedy", f.remedy.as_str())).collect(),
            ..self.status(topic, number(worst), message, status)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_people::status::{StateView, finding::FindingTopic};

    fn status(findings: Vec<Finding>) -> Status {
        Status {
            title: "drone 1, test".into(),
            running: true,
            headline: "Tracking".into(),
            worst: FindingLevel::worst(&findings),
            findings,
            state: Some(StateView {
                name: "Tracking".into(),
                ..StateView::default()
            }),
            ..Status::default()
        }
    }
    fn rows(all: &DiagnosticArray) -> Vec<(u8, &str, &str)> {
        let row = |s: &'_ DiagnosticStatus| s.level;
        let levels = all.status.iter().map(row);
        let texts = all.status.iter().map(|s| (s.name.as_str(), s.message.as_str()));
        levels.zip(texts).map(|(l, (n, m))| (l, n, m)).collect()
    }

    #[test]
    fn diagnostics_of_findings() {
        let mut judge = Diagnostics::of("drone_1");
        let link = FindingTopic("link");
        let found = vec![
            link.warning("0.4 s old", "antenna"),
            link.fine("3 % lost"),
            FindingTopic("deck").broken("no deck", "wait"),
            link.warning("late", ""),
        ];
        let all = judge.array(&status(found), RosTime::default());
        assert_eq!(
            rows(&all),
            [
                (level::ERROR, "drone_1: summary", "Tracking"),
                (level::ERROR, "drone_1: deck", "no deck"),
                (level::WARN, "drone_1: link", "0.4 s old; late"),
            ]
        );
        assert_eq!(all.status[2].values, [value("remedy", "antenna")]);
        let fine = judge.array(&status(Vec::new()), RosTime::default());
        assert_eq!(rows(&fine)[2], (level::OK, "drone_1: link", "as it should be"));
        let absent = Status::absent(&status(Vec::new()).situation.known);
        let stale = judge.array(&absent, RosTime::default());
        assert_eq!(stale.status.len(), 3);
        assert!(stale.status.iter().all(|s| s.level == level::STALE), "{stale:?}");
    }

    #[test]
    fn diagnostics_of_a_silent_mission() {
        let mut silent = status(Vec::new());
        silent.state.as_mut().unwrap().stale = true;
        let all = Diagnostics::of("drone_1").array(&silent, RosTime::default());
        assert_eq!(all.status[0].level, level::STALE);
    }
}
