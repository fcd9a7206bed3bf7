//! Text of a status: headline and labelled lines, at most 20 lines of 80 columns, or the full report.

use alight_computer::{
    process::{metrics, snapshot::time},
    terminal::{WIDTH, wrap},
};

use super::{Figure, Status, finding::FindingLevel};

const HEIGHT: usize = 20;
const LABEL: usize = 11;
const STATE: [&str; 3] = ["deck", "drones", "autopilot"];

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusLine {
    pub text: String,
    pub level: FindingLevel,
}

impl StatusLine {
    fn coloured(&self) -> String {
        if self.text.starts_with(' ') {
            return self.text.clone();
        }
        self.level.coloured(&self.text)
    }
}

impl Figure {
    pub(super) fn text(&self) -> Option<String> {
        let value = self.value.as_deref().unwrap_or("unknown");
        let text = match (self.note.as_str(), &self.value) {
            ("", None) => return None,
            ("", Some(_)) => value.into(),
            (note, _) => format!("{value}, {note}"),
        };
        Some(if self.stale { format!("{text} (old)") } else { text })
    }
}

/// Text without numbers and units, which change with every reading.
fn without_numbers(text: &str) -> String {
    let is_term = |t: &&str| t.len() > 3 && !t.contains(|c: char| c.is_ascii_digit());
    text.split_whitespace()
        .filter(is_term)
        .collect::<Vec<_>>()
        .join(" ")
}

impl Status {
    /// Key of the status, which changes only if the operator needs to know.
    pub fn key(&self) -> String {
        let state = self
            .state
            .as_ref()
            .map(|s| (s.name.as_str(), without_numbers(&s.waiting)));
        let figures = self.figures.iter().filter(|f| STATE.contains(&f.name));
        let figures: Vec<_> = figures
            .map(|f| (f.value.as_deref(), without_numbers(&f.note)))
            .collect();
        let alarms = self.alarms();
        let alarms: Vec<_> = alarms
            .iter()
            .map(|f| (f.level, f.topic, without_numbers(&f.found)))
            .collect();
        format!("{state:?} {figures:?} {alarms:?}")
    }
    fn title(&self) -> String {
        format!("{}: {}", self.title, self.headline)
    }
    fn mission(&self) -> Option<(&'static str, String)> {
        let state = self.state.as_ref()?;
        let waiting = state.waiting.as_str();
        let mut text = if waiting.is_empty() { state.does } else { waiting }.to_owned();
        if self.situation.known.vessel.is_some() {
            text = format!("{}: {text}", state.name);
        }
        if state.stale {
            text += " (old)";
        }
        if !state.rejected.is_empty() {
            text += &format!("; order rejected: {}", state.rejected);
        }
        Some(("mission", text))
    }
    fn entries(&self) -> impl Iterator<Item = (&'static str, String)> {
        self.figures.iter().filter_map(|f| Some((f.name, f.text()?)))
    }
    pub fn line(&self) -> String {
        let states = self.entries().filter(|(name, _)| STATE.contains(name));
        let states = self.mission().into_iter().chain(states);
        let states = states.map(|(label, text)| format!("{label}: {text}"));
        let alarms = self
            .alarms()
            .into_iter()
            .map(|f| format!("{}: {f}", label(f.level)));
        let parts: Vec<String> = core::iter::once(self.title())
            .chain(states)
            .chain(alarms)
            .collect();
        parts.join("; ")
    }
    /// Lines that fit into `width` columns and `height` rows, worst alarms first because the end may be cut off.
    pub fn lines(&self, width: usize, height: usize) -> Vec<StatusLine> {
        let alarms = self.alarms();
        let mut lines = wrapped("", &self.title(), FindingLevel::Fine, 0, width);
        for f in &alarms {
            lines.extend(wrapped(label(f.level), &f.to_string(), f.level, LABEL, width));
        }
        let none = alarms.is_empty().then(|| ("alarms", "none".into()));
        for (label, text) in self.mission().into_iter().chain(self.entries()).chain(none) {
            lines.extend(wrapped(label, &text, FindingLevel::Fine, LABEL, width));
        }
        if lines.len() > height {
            let more = lines.len() - height.saturating_sub(1);
            lines.truncate(height.saturating_sub(1));
            let text = format!("{more} more lines: alight status --all");
            lines.push(StatusLine {
                text: cut(&text, width),
                level: FindingLevel::Warning,
            });
            lines.truncate(height);
        }
        lines
    }
    /// Printed text; on a terminal the labels of alarms are coloured.
    pub fn text(&self) -> String {
        let lines = self.lines(WIDTH, HEIGHT);
        let texts: Vec<String> = lines.iter().map(StatusLine::coloured).collect();
        texts.join("\n")
    }
    /// Full report: each finding, each process, and each topic as each process reads it.
    pub fn all(&self) -> String {
        let snapshot = &self.situation.snapshot;
        let mut lines = vec![self.title()];
        lines.extend(self.findings.iter().map(|f| f.level.coloured(&f.lines())));
        lines.push(String::new());
        let entries = self.mission().into_iter().chain(self.entries());
        lines.extend(entries.map(|(label, text)| format!("{label:<LABEL$}{text}")));
        lines.extend(snapshot.link.map(|l| {
            format!(
                "{:<LABEL$}drone minus vessel {:.4} s +- {}; {:.1} % out of order (datagrams may overtake each other), \
                 {} rejected (late or repeated ones are normal)",
                "clocks",
                l.clock_offset_s,
                time(l.clock_offset_sd_s),
                100.0 * l.out_of_order,
                l.rejected
            )
        }));
        lines.extend(
            snapshot
                .plan
                .map(|p| format!("{:<LABEL$}{} iterations", "plan", p.iterations)),
        );
        let counts = snapshot
            .processes
            .values()
            .map(|p| (p.kind.name(), metrics::text(p)));
        let counts = counts.filter(|(_, text)| !text.is_empty());
        lines.extend(counts.map(|(name, text)| format!("{name:<LABEL$}{text}")));
        let tables = [
            snapshot.usage(self.situation.now_ns),
            snapshot.stages(),
            snapshot.topics(),
            snapshot.radio(),
        ];
        format!("{}\n\n{}", lines.join("\n"), tables.join("\n"))
    }
}

fn label(level: FindingLevel) -> &'static str {
    match level {
        FindingLevel::Broken => "ALARM",
        FindingLevel::Warning | FindingLevel::Fine => "warning",
    }
}

fn wrapped(label: &str, text: &str, level: FindingLevel, indent: usize, width: usize) -> Vec<StatusLine> {
    let mut entry = format!("{label:<0$}", indent.saturating_sub(1));
    wrap(&mut entry, indent, width, text);
    let lines = entry.lines().map(|line| StatusLine {
        text: cut(line, width),
        level,
    });
    lines.collect()
}

fn cut(text: &str, width: usize) -> String {
    text.chars().take(width).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::FindingTopic;

    fn status() -> Status {
        Status {
            title: "land".into(),
            headline: "Tracking since 4.2 s: reached".into(),
            figures: vec![Figure::of("link", "62 ms old", "0.4 % lost")],
            ..Status::default()
        }
    }

    #[test]
    fn status_text_without_alarms() {
        assert_eq!(
            status().text(),
            "land: Tracking since 4.2 s: reached\nlink       62 ms old, 0.4 % lost\nalarms     none"
        );
    }

    #[test]
    fn status_label_as_wide_as_its_column() {
        let line = wrapped("certificate", "12 days left", FindingLevel::Fine, LABEL, WIDTH).swap_remove(0);
        assert_eq!(line.text, "certificate 12 days left");
    }

    #[test]
    fn status_text_of_many_long_alarms() {
        let mut full = status();
        for k in 0..30 {
            let found = format!("warning {k} {}", "part ".repeat(60));
            full.findings.push(FindingTopic("parts").warning(found, "none"));
        }
        full.findings
            .push(FindingTopic("armed").broken("landed and still ARMED", "keep clear"));
        for (width, height) in [(WIDTH, HEIGHT), (40, 8), (12, 3), (1, 1), (200, 60), (80, 0)] {
            let lines = full.lines(width, height);
            assert!(lines.len() <= height, "{width} x {height}: {}", lines.len());
            let long = lines.iter().find(|l| l.text.chars().count() > width);
            assert_eq!(long, None, "{width} x {height}");
        }
        let lines = full.lines(WIDTH, HEIGHT);
        assert_eq!(
            lines[1].text,
            "ALARM      armed: landed and still ARMED -> keep clear"
        );
        assert!(lines[2].text.contains("warning 0") && lines[6].text.ends_with("-> none"));
        assert!(
            lines[19].text.contains("more lines: alight status --all"),
            "{:?}",
            lines[19]
        );
        assert_eq!(full.line().lines().count(), 1);
    }
}
