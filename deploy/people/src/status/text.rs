//! A status as text: headline, then labelled lines, at most 20 of 80 columns; and everything of it.

use alight_computer::process::{metrics, snapshot::time};

use super::finding::Level;
use super::{Figure, Status};

/// Lines of a status on standard output.
const HEIGHT: usize = 20;
/// Columns of a status on standard output.
const WIDTH: usize = 80;
/// Columns of a label.
const LABEL: usize = 11;
/// Lines of one entry.
const MAX_LINES: usize = 3;
/// Figures whose change is one of the state.
const STATE: [&str; 3] = ["deck", "drones", "autopilot"];

/// One line as it fits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Its text.
    pub text: String,
    /// How bad it is.
    pub level: Level,
}

impl Line {
    /// A line below the first of an entry has no label, and no colour.
    fn coloured(&self) -> String {
        if self.text.starts_with(' ') {
            return self.text.clone();
        }
        self.level.coloured(&self.text)
    }
}

impl Figure {
    /// Value and note; None: nothing to print.
    fn text(&self) -> Option<String> {
        let value = self.value.as_deref().unwrap_or("unknown");
        let text = match (self.note.as_str(), &self.value) {
            ("", None) => return None,
            ("", Some(_)) => value.into(),
            (note, _) => format!("{value}, {note}"),
        };
        Some(if self.stale { format!("{text} (old)") } else { text })
    }
}

/// A text without its figures and units, which change all the time.
fn without_figures(text: &str) -> String {
    let is_word = |w: &&str| w.len() > 3 && !w.contains(|c: char| c.is_ascii_digit());
    text.split_whitespace()
        .filter(is_word)
        .collect::<Vec<_>>()
        .join(" ")
}

impl Status {
    /// What the status is about: the same until something changes that people have to know.
    pub fn key(&self) -> String {
        let state = self
            .state
            .as_ref()
            .map(|s| (s.name.as_str(), without_figures(&s.waiting)));
        let figures = self.figures.iter().filter(|f| STATE.contains(&f.name));
        let figures: Vec<_> = figures
            .map(|f| (f.value.as_deref(), without_figures(&f.note)))
            .collect();
        let alarms = self.alarms();
        let alarms: Vec<_> = alarms
            .iter()
            .map(|f| (f.level, f.topic, without_figures(&f.found)))
            .collect();
        format!("{state:?} {figures:?} {alarms:?}")
    }
    /// Title and headline.
    fn title(&self) -> String {
        format!("{}: {}", self.title, self.headline)
    }
    /// What the state waits for.
    fn waiting(&self) -> Option<(&'static str, String)> {
        let state = self.state.as_ref()?;
        let waiting = state.waiting.as_str();
        let mut text = if waiting.is_empty() { "nothing" } else { waiting }.to_owned();
        if self.situation.known.vessel.is_some() {
            text = format!("{}: {text}", state.name);
        }
        if state.stale {
            text += " (old)";
        }
        Some(("waits for", text))
    }
    /// Labelled texts of the figures.
    fn entries(&self) -> impl Iterator<Item = (&'static str, String)> {
        self.figures.iter().filter_map(|f| Some((f.name, f.text()?)))
    }
    /// One line of what is now: headline, state, alarms.
    pub fn line(&self) -> String {
        let states = self.entries().filter(|(name, _)| STATE.contains(name));
        let states = self.waiting().into_iter().chain(states);
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
    /// The lines that fit into so many rows and columns: the worst alarms first, for what is at the end may be missing.
    pub fn lines(&self, width: usize, height: usize) -> Vec<Line> {
        let alarms = self.alarms();
        let mut lines = wrapped("", &self.title(), Level::Fine, 0, width);
        for f in &alarms {
            lines.extend(wrapped(label(f.level), &f.to_string(), f.level, LABEL, width));
        }
        let none = alarms.is_empty().then(|| ("alarms", "none".into()));
        for (label, text) in self.waiting().into_iter().chain(self.entries()).chain(none) {
            lines.extend(wrapped(label, &text, Level::Fine, LABEL, width));
        }
        if lines.len() > height {
            let more = lines.len() - height.saturating_sub(1);
            lines.truncate(height.saturating_sub(1));
            let text = format!("{more} lines more: alight status --all");
            lines.push(Line {
                text: cut(&text, width),
                level: Level::Warning,
            });
            lines.truncate(height);
        }
        lines
    }
    /// As it is printed: on a terminal with the labels of alarms in their colours.
    pub fn text(&self) -> String {
        let lines = self.lines(WIDTH, HEIGHT);
        let texts: Vec<String> = lines.iter().map(Line::coloured).collect();
        texts.join("\n")
    }
    /// Everything: each finding, what each process reports of itself, and each topic as each process reads it.
    pub fn all(&self) -> String {
        let seen = &self.situation.seen;
        let mut lines = vec![self.title()];
        lines.extend(self.findings.iter().map(|f| f.level.coloured(&f.lines())));
        lines.push(String::new());
        let entries = self.waiting().into_iter().chain(self.entries());
        lines.extend(entries.map(|(label, text)| format!("{label:<LABEL$}{text}")));
        lines.extend(seen.link.map(|l| {
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
            seen.plan
                .map(|p| format!("{:<LABEL$}{} iterations", "plan", p.iterations)),
        );
        let counts = seen.processes.values().map(|p| (p.kind.name(), metrics::text(p)));
        let counts = counts.filter(|(_, text)| !text.is_empty());
        lines.extend(counts.map(|(name, text)| format!("{name:<LABEL$}{text}")));
        let tables = [
            seen.usage(self.situation.now_ns),
            seen.stages(),
            seen.topics(),
            seen.radio(),
        ];
        format!("{}\n\n{}", lines.join("\n"), tables.join("\n"))
    }
}

/// Label of an alarm.
fn label(level: Level) -> &'static str {
    match level {
        Level::Broken => "ALARM",
        Level::Warning | Level::Fine => "warning",
    }
}

/// An entry's lines: words, at most [`MAX_LINES`] lines, all but the first below its text.
fn wrapped(label: &str, text: &str, level: Level, indent: usize, width: usize) -> Vec<Line> {
    let mut first = format!("{label:<indent$}");
    if first.ends_with(|c: char| !c.is_whitespace()) {
        // A label that fills its column.
        first.push(' ');
    }
    let mut lines = vec![first];
    let mut begun = false;
    for word in text.split_whitespace() {
        let (used, length) = (
            lines.last().map_or(0, |l| l.chars().count()),
            word.chars().count(),
        );
        let fits = used + usize::from(begun) + length <= width;
        let is_last = lines.len() == MAX_LINES;
        match lines.last_mut() {
            Some(line) if fits || !begun => {
                if begun {
                    line.push(' ');
                }
                line.push_str(word);
                begun = true;
            }
            _ if is_last => {
                if let Some(line) = lines.last_mut() {
                    line.push_str(" ...");
                }
                break;
            }
            _ => lines.push(format!("{:indent$}{word}", "")),
        }
    }
    lines
        .into_iter()
        .map(|line| Line {
            text: cut(line.trim_end(), width),
            level,
        })
        .collect()
}

/// As many characters as fit.
fn cut(text: &str, width: usize) -> String {
    text.chars().take(width).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::Topic;

    fn status() -> Status {
        Status {
            title: "land".into(),
            headline: "Tracking since 4.2 s: reached".into(),
            figures: vec![Figure::of("link", "62.0 ms old", "0.4 % lost")],
            ..Status::default()
        }
    }

    #[test]
    fn status_text_without_alarms() {
        assert_eq!(
            status().text(),
            "land: Tracking since 4.2 s: reached\nlink       62.0 ms old, 0.4 % lost\nalarms     none"
        );
    }

    #[test]
    fn status_label_as_wide_as_its_column() {
        let line = wrapped("certificate", "12 days left", Level::Fine, LABEL, WIDTH).swap_remove(0);
        assert_eq!(line.text, "certificate 12 days left");
    }

    #[test]
    fn status_text_of_many_long_alarms() {
        let mut full = status();
        for k in 0..30 {
            let found = format!("warning {k} {}", "word ".repeat(60));
            full.findings.push(Topic("words").warning(found, "none"));
        }
        full.findings
            .push(Topic("armed").broken("landed and still ARMED", "keep clear"));
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
        assert!(
            lines[19].text.contains("more: alight status --all"),
            "{:?}",
            lines[19]
        );
        assert_eq!(full.line().lines().count(), 1);
    }
}
