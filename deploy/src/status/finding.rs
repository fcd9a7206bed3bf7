//! Findings: topic, severity, remedy.

use core::fmt;

use serde::Serialize;

use crate::exit::Exit;

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
    /// In the lines of `alight check`.
    pub fn lines(&self) -> String {
        let mark = match self.level {
            Level::Fine => "fine",
            Level::Warning => "WARNING",
            Level::Broken => "BROKEN",
        };
        let mut text = format!("{mark:<8} {:<14} {}", self.topic, self.found);
        if !self.remedy.is_empty() {
            text += &format!("\n{:<8} {:<14} -> {}", "", "", self.remedy);
        }
        text
    }
}

/// What is looked at, as it is named in a finding.
#[derive(Clone, Copy)]
pub struct Topic(pub &'static str);

impl Topic {
    fn finding(self, level: Level, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        Finding {
            topic: self.0,
            level,
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
    /// Does not work.
    pub fn broken(self, found: impl Into<String>, remedy: impl Into<String>) -> Finding {
        self.finding(Level::Broken, found, remedy)
    }
}
