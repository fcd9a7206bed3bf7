//! Status page: a line of state and reason, then labelled lines, at most 20 of 80 columns.

use crate::tools::check::finding::Level;

/// Lines of a page on standard output.
pub const HEIGHT: usize = 20;
/// Columns of a page on standard output.
pub const WIDTH: usize = 80;
/// Columns of an entry's word.
const LABEL: usize = 11;
/// Lines of one entry.
const MAX_LINES: usize = 3;

/// How a status is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum View {
    /// A page.
    #[default]
    Page,
    /// Everything.
    All,
    /// One JSON object.
    Json,
}

/// One line of a page as it fits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Its text.
    pub text: String,
    /// How bad it is.
    pub level: Level,
}

/// A text under its word.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Entry {
    label: &'static str,
    text: String,
    level: Level,
    /// It belongs to the one line of what is now.
    is_state: bool,
}

/// A status in a few lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    /// What it is about, and how it is.
    title: String,
    entries: Vec<Entry>,
    alarms: Vec<Alarm>,
    /// What its state is, without figures that change all the time.
    state: String,
}

/// Something that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Alarm {
    level: Level,
    /// What it is about, without figures.
    about: String,
    text: String,
}

impl Page {
    /// A page with this first line. `state`: what it is about, without figures that change all the time.
    pub fn new(title: String, state: String) -> Page {
        Page {
            title,
            entries: Vec::new(),
            alarms: Vec::new(),
            state,
        }
    }
    /// One more entry.
    pub fn entry(&mut self, label: &'static str, text: impl Into<String>) {
        self.entries.push(Entry {
            label,
            text: text.into(),
            level: Level::Fine,
            is_state: false,
        });
    }
    /// The same of the state, whose change is one of the page.
    pub fn state_entry(&mut self, label: &'static str, text: impl Into<String>) {
        self.entry(label, text);
        self.entries
            .iter_mut()
            .last()
            .into_iter()
            .for_each(|e| e.is_state = true);
    }
    /// One more alarm, in these words about this.
    pub fn alarm(&mut self, level: Level, about: impl Into<String>, text: String) {
        self.alarms.push(Alarm {
            level,
            about: about.into(),
            text,
        });
    }
    /// The same until something changes that a person has to know.
    pub fn key(&self) -> String {
        let alarms: Vec<(Level, &str)> = self.alarms.iter().map(|a| (a.level, a.about.as_str())).collect();
        format!("{} {alarms:?}", self.state)
    }
    /// One line of what is now: title, state, alarms.
    pub fn line(&self) -> String {
        let states = self.entries.iter().filter(|e| e.is_state);
        let states = states.map(|e| format!("{}: {}", e.label, e.text));
        let alarms = self
            .alarms
            .iter()
            .map(|a| format!("{}: {}", word(a.level), a.text));
        let parts: Vec<String> = core::iter::once(self.title.clone())
            .chain(states)
            .chain(alarms)
            .collect();
        parts.join("; ")
    }
    /// The lines that fit into so many rows and columns: the worst alarms first, for what is at the end may be missing.
    pub fn lines(&self, width: usize, height: usize) -> Vec<Line> {
        let mut alarms: Vec<Entry> = self
            .alarms
            .iter()
            .map(|a| Entry {
                label: word(a.level),
                text: a.text.clone(),
                level: a.level,
                is_state: true,
            })
            .collect();
        alarms.sort_by_key(|e| core::cmp::Reverse(e.level));
        let none = Entry {
            label: "alarms",
            text: "none".into(),
            level: Level::Fine,
            is_state: false,
        };
        let last = if alarms.is_empty() { Some(&none) } else { None };
        let mut lines = wrapped("", &self.title, Level::Fine, 0, width);
        for e in alarms.iter().chain(&self.entries).chain(last) {
            lines.extend(wrapped(e.label, &e.text, e.level, LABEL, width));
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
    /// As it is printed.
    pub fn text(&self) -> String {
        let lines = self.lines(WIDTH, HEIGHT);
        let texts: Vec<String> = lines.into_iter().map(|l| l.text).collect();
        texts.join("\n")
    }
}

/// The word of an alarm.
fn word(level: Level) -> &'static str {
    match level {
        Level::Broken => "ALARM",
        Level::Warning | Level::Fine => "warning",
    }
}

/// An entry's lines: words, at most [`MAX_LINES`] lines, all but the first below its text.
fn wrapped(label: &str, text: &str, level: Level, indent: usize, width: usize) -> Vec<Line> {
    let mut lines = vec![format!("{label:<indent$}")];
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

    fn page() -> Page {
        let mut page = Page::new("land: Tracking since 4.2 s: reached".into(), "Tracking".into());
        page.entry("link", "state 62.0 ms old, 0.4 % lost");
        page
    }

    #[test]
    fn status_page_without_alarms() {
        assert_eq!(
            page().text(),
            "land: Tracking since 4.2 s: reached\nlink       state 62.0 ms old, 0.4 % lost\nalarms     none"
        );
    }

    #[test]
    fn status_page_of_many_long_alarms() {
        let mut full = page();
        for k in 0..30 {
            full.alarm(
                Level::Warning,
                "words",
                format!("warning {k} {}", "word ".repeat(60)),
            );
        }
        full.alarm(Level::Broken, "armed", "landed and still ARMED".into());
        for (width, height) in [(WIDTH, HEIGHT), (40, 8), (12, 3), (1, 1), (200, 60), (80, 0)] {
            let lines = full.lines(width, height);
            assert!(lines.len() <= height, "{width} x {height}: {}", lines.len());
            let long = lines.iter().find(|l| l.text.chars().count() > width);
            assert_eq!(long, None, "{width} x {height}");
        }
        let lines = full.lines(WIDTH, HEIGHT);
        assert_eq!(lines[1].text, "ALARM      landed and still ARMED");
        assert!(
            lines[19].text.contains("more: alight status --all"),
            "{:?}",
            lines[19]
        );
        assert_eq!(full.line().lines().count(), 1);
    }
}
