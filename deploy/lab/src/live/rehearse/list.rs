//! Results of each step of deploy/docs/install.md.

use alight_computer::terminal::note;
use serde::Serialize;

pub const CERTIFICATES: u8 = 3;
pub const CONFIGURATIONS: u8 = 5;
pub const CHECK: u8 = 6;
pub const VESSEL: u8 = 8;
pub const DRONE: u8 = 9;
pub const LADDER: u8 = 10;

/// Width of the first column, which aligns the values.
const WHAT: usize = 25;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckRow {
    /// Number of the step in install.md.
    pub step: u8,
    pub what: String,
    pub ok: bool,
    pub figure: String,
}

#[derive(Debug, Default)]
pub struct CheckList {
    alone: bool,
    rows: Vec<CheckRow>,
}

impl CheckList {
    /// Check list on standard output, or on standard error if standard output carries a result for programs.
    pub fn new(alone: bool) -> CheckList {
        CheckList {
            alone,
            rows: Vec::new(),
        }
    }
    pub fn add(&mut self, step: u8, what: impl Into<String>, ok: bool, figure: impl Into<String>) {
        let row = CheckRow {
            step,
            what: what.into(),
            ok,
            figure: figure.into(),
        };
        self.print(line(&row));
        self.rows.push(row);
    }
    pub fn print(&self, text: impl std::fmt::Display) {
        note(self.alone, text);
    }
    pub fn ok(&self) -> bool {
        self.rows.iter().all(|r| r.ok)
    }
    pub fn rows(&self) -> &[CheckRow] {
        &self.rows
    }
}

fn line(row: &CheckRow) -> String {
    let mark = if row.ok { "OK" } else { "NOT OK" };
    format!("{mark:<6} {:>2}  {:<WHAT$} {}", row.step, row.what, row.figure)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rehearsal_steps_of_the_instructions() {
        let text = include_str!("../../../../docs/install.md");
        for (step, begins) in [
            (
                CERTIFICATES,
                "On a computer that stays ashore, make the authority",
            ),
            (CONFIGURATIONS, "Edit `/etc/alight/vessel.toml`"),
            (CHECK, "Run `sudo -u alight alight check`"),
            (VESSEL, "Vessel moored"),
            (DRONE, "Drone on the ground"),
            (LADDER, "Climb the ladder"),
        ] {
            assert!(text.contains(&format!("\n{step}. {begins}")), "{step}: {begins}");
        }
    }

    #[test]
    fn rehearsal_with_a_failed_step() {
        let mut list = CheckList::new(true);
        list.add(CERTIFICATES, "certificates", true, "vessel-1, drone-1");
        assert!(list.ok());
        list.add(LADDER, "landed", false, "in the water");
        assert!(!list.ok());
        assert_eq!(
            line(&list.rows()[1]),
            "NOT OK 10  landed                    in the water"
        );
    }
}
