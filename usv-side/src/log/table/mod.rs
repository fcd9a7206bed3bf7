//! Tables of text (CSV and its kin), as loggers and spreadsheets write them: rows of quantities at a time.
//!
//! Cells are separated by commas, semicolons, tabs, bars or spaces, may be quoted, and have a decimal point or comma.
//! The header may follow other lines; remarks begin with `#`, `%` or `//`. An empty cell, or NaN, was not measured; a
//! quantity may have rows of its own. Times are seconds from anywhere, counts since 1970, or clocks, with or without a
//! date.
//!
//! What is not certain is not read: a column without a unit, dates that may begin with their day or their month, two
//! kinds of decimals. What is left out or was done to a table is in its notes.

mod column;
mod columns;
mod reading;
mod spread;
mod stamp;
mod text;

use thiserror::Error;

use self::column::KNOWN;
use self::columns::Columns;
use self::reading::Reading;

/// Beginnings of packed files, their formats, and what to do first.
const PACKED: [(&[u8], &str, &str); 5] = [
    (b"\x1f\x8b", "gzip", "gunzip it"),
    (b"PK\x03\x04", "zip", "unzip it, or save a spreadsheet as CSV"),
    (b"\x28\xb5\x2f\xfd", "zstd", "unzstd it"),
    (b"\xfd7zXZ\x00", "xz", "unxz it"),
    (b"BZh", "bzip2", "bunzip2 it"),
];

/// What a unit is one of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Dimension {
    Angle,
    Length,
    Rate,
    Acceleration,
    Speed,
}

/// What a column may hold, in the unit of its own name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Starboard down, deg.
    Roll,
    /// Bow up, deg.
    Pitch,
    /// From true north towards east, deg.
    Heading,
    /// Up, m.
    Heave,
    /// Forward along the mean heading, m.
    Surge,
    /// To starboard of the mean heading, m.
    Sway,
    /// Angular rate about the sensor's first axis, rad/s.
    GyroX,
    /// About its second.
    GyroY,
    /// About its third.
    GyroZ,
    /// Specific force along the sensor's first axis, m/s².
    ForceX,
    /// Along its second.
    ForceY,
    /// Along its third.
    ForceZ,
    /// WGS-84, deg.
    Latitude,
    /// WGS-84, deg.
    Longitude,
    /// m.
    Altitude,
    /// Velocity north, m/s.
    North,
    /// East, m/s.
    East,
    /// Down, m/s.
    Down,
    /// Over ground, m/s.
    Speed,
    /// Over ground, from true north towards east, deg.
    Course,
}

impl Quantity {
    /// How many there are.
    pub const COUNT: usize = 20;
    /// All of them, in their order.
    pub const ALL: [Quantity; Quantity::COUNT] = [
        Quantity::Roll,
        Quantity::Pitch,
        Quantity::Heading,
        Quantity::Heave,
        Quantity::Surge,
        Quantity::Sway,
        Quantity::GyroX,
        Quantity::GyroY,
        Quantity::GyroZ,
        Quantity::ForceX,
        Quantity::ForceY,
        Quantity::ForceZ,
        Quantity::Latitude,
        Quantity::Longitude,
        Quantity::Altitude,
        Quantity::North,
        Quantity::East,
        Quantity::Down,
        Quantity::Speed,
        Quantity::Course,
    ];
    /// Name of its column.
    pub fn name(self) -> &'static str {
        KNOWN.get(self as usize).map_or("", |k| k.name)
    }
}

/// A row: what was measured at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its line in the file, counted from 1.
    pub line: u64,
    /// s.
    pub t: f64,
    cells: [Option<f64>; Quantity::COUNT],
}

impl Row {
    fn new(line: u64, t: f64) -> Self {
        Row {
            line,
            t,
            cells: [None; Quantity::COUNT],
        }
    }
    /// What it holds of a quantity, in the unit of the quantity's name.
    pub fn get(&self, q: Quantity) -> Option<f64> {
        self.cells.get(q as usize).copied().flatten()
    }
    /// All of these quantities, or none.
    pub fn all<const N: usize>(&self, of: [Quantity; N]) -> Option<[f64; N]> {
        let mut all = [0.0; N];
        for (to, q) in all.iter_mut().zip(of) {
            *to = self.get(q)?;
        }
        Some(all)
    }
    /// A bit for each quantity that is there.
    fn mask(&self) -> u32 {
        let bits = self.cells.iter().enumerate();
        bits.fold(0, |m, (k, cell)| m | (u32::from(cell.is_some()) << k))
    }
}

/// Rows that cannot be used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bad {
    /// How many.
    pub count: u64,
    /// The first: its line, and what is wrong with it.
    pub first: Option<(u64, String)>,
}

impl Bad {
    fn push(&mut self, line: u64, message: String) {
        self.count += 1;
        self.first.get_or_insert((line, message));
    }
}

/// Why a table cannot be read.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TableError {
    /// Its columns do not say what is needed.
    #[error("line {line}: {message}")]
    Header {
        /// The header's line, counted from 1.
        line: u64,
        /// What is wrong.
        message: String,
    },
    /// A row makes it unusable.
    #[error("line {line}: {message}")]
    Row {
        /// Its line, counted from 1.
        line: u64,
        /// What is wrong.
        message: String,
    },
}

/// A table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Its rows in their order, on the clock of the file.
    pub rows: Vec<Row>,
    /// How many rows of the file are in them.
    pub read: u64,
    /// Rows that are left out.
    pub bad: Bad,
    /// The first row whose time lies before that of the row above: its line and time.
    pub backwards: Option<(u64, f64)>,
    /// What was assumed, done and left out.
    pub notes: Vec<String>,
    /// The header's line.
    line: u64,
    has: [bool; Quantity::COUNT],
}

/// The error about a packed file, with what to do; None of any other.
pub(super) fn packed(bytes: &[u8]) -> Option<String> {
    let (_, name, tool) = PACKED.iter().find(|(begin, _, _)| bytes.starts_with(begin))?;
    Some(format!("the file is packed ({name}): first {tool}"))
}

/// It is text in columns with a time and something that is read.
pub fn is_table(head: &[u8]) -> bool {
    text::has_header(&text::decode(head).0)
}

/// It is text in columns, of whatever.
pub fn has_columns(head: &[u8]) -> bool {
    let (text, _) = text::decode(head);
    let is_text = text
        .chars()
        .take(2000)
        .all(|c| !c.is_control() || c.is_whitespace());
    is_text && text::layout(&text).names.len() > 1
}

impl Table {
    /// Reads a table.
    pub fn read(bytes: &[u8]) -> Result<Table, TableError> {
        if let Some(message) = packed(bytes) {
            return Err(TableError::Header { line: 1, message });
        }
        let (text, note) = text::decode(bytes);
        let mut layout = text::layout(&text);
        layout.notes.extend(note.map(String::from));
        let columns = Columns::of(&mut layout)?;
        let body = text.get(layout.body.0..).unwrap_or_default();
        let body = layout.delimiter.prepared(body);
        let mut reading = Reading::of(&columns, &layout);
        reading.read(&body)?;
        reading.finish()
    }

    /// It has a column of this quantity.
    pub fn has(&self, q: Quantity) -> bool {
        self.has.get(q as usize).copied().unwrap_or(false)
    }
    /// Some row has this quantity.
    pub fn any(&self, q: Quantity) -> bool {
        self.rows.iter().any(|r| r.get(q).is_some())
    }
    /// Its quantities that are none of `used`.
    pub fn unused(&self, used: &[Quantity]) -> Vec<Quantity> {
        let all = Quantity::ALL.into_iter();
        all.filter(|q| self.has(*q) && !used.contains(q)).collect()
    }
    /// An error about its columns.
    pub fn header_error(&self, message: String) -> TableError {
        TableError::Header {
            line: self.line,
            message,
        }
    }

    /// Quantities that mean nothing without each other: a table has columns of all or none, and where some row has all
    /// of them, one that has only some is bad.
    pub fn require_together(&mut self, groups: &[&[Quantity]]) -> Result<(), TableError> {
        for group in groups {
            let there = group.iter().find(|q| self.has(**q));
            let missing = group.iter().find(|q| !self.has(**q));
            if let (Some(there), Some(missing)) = (there, missing) {
                let message = format!("column `{}` is there without `{}`", there.name(), missing.name());
                return Err(self.header_error(message));
            }
            let count = |row: &Row| group.iter().filter(|q| row.get(**q).is_some()).count();
            if !self.rows.iter().any(|r| count(r) == group.len()) {
                continue;
            }
            let (read, bad) = (&mut self.read, &mut self.bad);
            self.rows.retain(|row| {
                let whole = [0, group.len()].contains(&count(row));
                if let (false, Some(q)) = (whole, group.iter().find(|q| row.get(**q).is_none())) {
                    let limit = KNOWN.get(*q as usize).map_or(0.0, |k| k.limit);
                    let name = q.name();
                    *read = read.saturating_sub(1);
                    bad.push(
                        row.line,
                        format!(
                            "{name} is empty, not a number, beside others of its kind; allowed is -{limit} to {limit}"
                        ),
                    );
                }
                whole
            });
        }
        Ok(())
    }
}
