//! Findings: topic, severity, remedy.

use core::fmt;

use alight_computer::exit::Exit;
use alight_computer::table::Colour;
use alight_computer::terminal::wrap;
use serde::Serialize;

/// How bad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// As it should be.
    #[default]
    Fine,
    /// Works, but not as it should.
    Warning,
    /// Does not work.
    Broken,
}

impl Level {
    /// The worst of what was found.
    pub fn worst(findings: &[Finding]) -> Level {
        findings.iter().map(|f| f.level).max().unwrap_or(Level::Fine)
    }
    /// The text as a terminal shows it: its first word bold red or yellow where something is not fine.
    pub fn coloured(self, text: &str) -> String {
        let colour = match self {
            Level::Fine => return text.into(),
            Level::Warning => Colour::Yellow,
            Level::Broken => Colour::Red,
        };
        let (word, rest) = text.split_at(text.find(' ').unwrap_or(text.len()));
        colour.bold(word) + rest
    }
    /// How a command ends that found nothing worse.
    pub const fn exit(self) -> Exit {
        match self {
            Level::Fine => Exit::Success,
            Level::Warning => Exit::Failed,
            Level::Broken => Exit::Broken,
        }
    }
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub topic: &'static str,
    /// How bad.
    pub level: Level,
    /// No landing goes on while it stands.
    pub stops: bool,
    /// What was found.
    pub found: String,
    /// What to do; empty when fine.
    pub remedy: String,
}

impl fmt::Display for Finding {
    /// In one line: what was looked at, what was found, what to do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.topic, self.found)?;
        if self.remedy.is_empty() {
            return Ok(());
        }
        write!(f, " -> {}", self.remedy)
    }
}

impl Finding {
    /// In the lines of `alight check`, of at most [`alight_computer::terminal::WIDTH`] columns where no single word is longer.
    pub fn lines(&self) -> String {
        let mark = match self.level {
            Level::Fine => "fine",
            Level::Warning => "WARNING",
            Level::Broken => "BROKEN",
        };
        let mut text = format!("{mark:<8} {:<14}", self.topic);
        wrap(&mut text, INDENT, &self.found);
        if !self.remedy.is_empty() {
            text += &format!("\n{:INDENT$}->", "");
            wrap(&mut text, INDENT, &self.remedy);
        }
        text
    }
}

/// Columns before a finding's text.
const INDENT: usize = 24;

/// What is looked at, as it is named in a finding.
#[derive(Clone, Copy)]
pub struct Topic(pub &'static str);

impl Topic {
    fn finding(self, level: Level, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            topic: self.0,
            level,
            stops: level == Level::Broken,
            found: found.into(),
            remedy: remedy.into(),
        }
    }
    /// As it should be.
    pub fn fine(self, found: impl Into<String>) -> Finding {
        self.finding(Level::Fine, found, "")
    }
    /// Works, but not as it should.
    pub fn warning(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        self.finding(Level::Warning, found, remedy)
    }
    /// A warning that no landing goes on with.
    pub fn stopping(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            stops: true,
            ..self.warning(found, remedy)
        }
    }
    /// Does not work.
    pub fn broken(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        self.finding(Level::Broken, found, remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finding_in_80_columns() {
        let found =
            "reading /etc/alight/keys/authority.pem (alight keys makes it): No such file or directory";
        let lines = Topic("certificate").broken(found, "word ".repeat(40)).lines();
        assert!(
            lines
                .lines()
                .all(|l| l.chars().count() <= alight_computer::terminal::WIDTH),
            "{lines}"
        );
        assert!(
            lines.lines().skip(1).all(|l| l.starts_with(&" ".repeat(INDENT))),
            "{lines}"
        );
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert!(words(&lines).join(" ").contains(found), "{lines}");
        // A word that is longer than a line stays whole.
        let long = "x".repeat(100);
        assert!(Topic("key").warning(&*long, "").lines().contains(&long));
    }
}
