use core::fmt;

use alight_computer::{
    exit::Exit,
    table::Colour,
    terminal::{WIDTH, wrap},
};
use serde::Serialize;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FindingLevel {
    #[default]
    Fine,
    Warning,
    Broken,
}

impl FindingLevel {
    pub fn worst(findings: &[Finding]) -> FindingLevel {
        findings
            .iter()
            .map(|f| f.level)
            .max()
            .unwrap_or(FindingLevel::Fine)
    }
    /// Text for a terminal: the first part is bold red or yellow unless the level is fine.
    pub fn coloured(self, text: &str) -> String {
        let colour = match self {
            FindingLevel::Fine => return text.into(),
            FindingLevel::Warning => Colour::Yellow,
            FindingLevel::Broken => Colour::Red,
        };
        let (first, rest) = text.split_at(text.find(' ').unwrap_or(text.len()));
        colour.bold(first) + rest
    }
    /// Exit code of a command whose worst finding has this level.
    pub const fn exit(self) -> Exit {
        match self {
            FindingLevel::Fine => Exit::Success,
            FindingLevel::Warning => Exit::Failed,
            FindingLevel::Broken => Exit::Broken,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    pub topic: &'static str,
    pub level: FindingLevel,
    pub stops: bool,
    pub found: String,
    /// Action that removes the cause; empty if the level is fine.
    pub remedy: String,
}

impl fmt::Display for Finding {
    /// One line: topic, text, remedy.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.topic, self.found)?;
        if self.remedy.is_empty() {
            return Ok(());
        }
        write!(f, " -> {}", self.remedy)
    }
}

impl Finding {
    /// Lines of `alight check`, at most [`WIDTH`] columns wide unless a term is longer.
    pub fn lines(&self) -> String {
        let mark = match self.level {
            FindingLevel::Fine => "fine",
            FindingLevel::Warning => "WARNING",
            FindingLevel::Broken => "BROKEN",
        };
        let mut text = format!("{mark:<8} {:<14}", self.topic);
        wrap(&mut text, INDENT, WIDTH, &self.found);
        if !self.remedy.is_empty() {
            text += &format!("\n{:INDENT$}->", "");
            wrap(&mut text, INDENT, WIDTH, &self.remedy);
        }
        text
    }
}

const INDENT: usize = 24;

#[derive(Clone, Copy)]
pub struct FindingTopic(pub &'static str);

impl FindingTopic {
    fn finding(self, level: FindingLevel, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            topic: self.0,
            level,
            stops: level == FindingLevel::Broken,
            found: found.into(),
            remedy: remedy.into(),
        }
    }
    pub fn fine(self, found: impl Into<String>) -> Finding {
        self.finding(FindingLevel::Fine, found, "")
    }
    pub fn warning(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        self.finding(FindingLevel::Warning, found, remedy)
    }
    pub fn stopping(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            stops: true,
            ..self.warning(found, remedy)
        }
    }
    pub fn broken(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        self.finding(FindingLevel::Broken, found, remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finding_in_80_columns() {
        let found =
            "reading /etc/alight/keys/authority.pem (alight keys makes it): No such file or directory";
        let lines = FindingTopic("certificate")
            .broken(found, "part ".repeat(40))
            .lines();
        assert!(lines.lines().all(|l| l.chars().count() <= WIDTH), "{lines}");
        assert!(
            lines.lines().skip(1).all(|l| l.starts_with(&" ".repeat(INDENT))),
            "{lines}"
        );
        let pieces = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        assert!(pieces(&lines).join(" ").contains(found), "{lines}");
        let long = "x".repeat(100);
        assert!(FindingTopic("key").warning(&*long, "").lines().contains(&long));
    }
}
