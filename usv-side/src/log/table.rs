//! Alight's table (CSV): a header line of known columns, then one row per line with comma-separated cells.
//!
//! An empty cell, or NaN, means that the quantity was not measured. A quantity may have separate rows.
//! Columns: `deploy/docs/sensors.md`; tables of other programs: `deploy/docs/recordings.md`.

use csv::{Position, ReaderBuilder, StringRecord, Trim};
use thiserror::Error;

/// Conversion command for other programs' recordings, for errors.
pub(super) const CONVERT: &str = "`python -m alight.convert FILE` converts it";
const TIME: &str = "t_s";
/// Beginning of a line before the header that is passed over.
const COMMENT: &str = "#";
const MAX_TIME_S: f64 = 1e10;
const MAX_ROWS: usize = 2_000_000;
/// Maximum fraction of rows with the time of the previous row; above it, the times are too coarse.
const COARSE: f64 = 0.2;
/// Cell without a value, like an empty one.
const NAN: &str = "nan";

/// Signatures of packed files, their formats, and remedies.
const PACKED: [(&[u8], &str, &str); 5] = [
    (b"\x1f\x8b", "gzip", "gunzip it"),
    (b"PK\x03\x04", "zip", "unzip it, or save a spreadsheet as CSV"),
    (b"\x28\xb5\x2f\xfd", "zstd", "unzstd it"),
    (b"\xfd7zXZ\x00", "xz", "unxz it"),
    (b"BZh", "bzip2", "bunzip2 it"),
];

/// Quantity of a column, in the unit of the column's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Roll, starboard down, deg.
    Roll,
    /// Pitch, bow up, deg.
    Pitch,
    /// Heading from true north towards east, deg.
    Heading,
    /// Heave, up, m.
    Heave,
    /// Surge, forward along the mean heading, m.
    Surge,
    /// Sway, to starboard of the mean heading, m.
    Sway,
    /// Angular rate about the sensor's first axis, rad/s.
    GyroX,
    /// Angular rate about the second axis, rad/s.
    GyroY,
    /// Angular rate about the third axis, rad/s.
    GyroZ,
    /// Specific force along the sensor's first axis, m/s².
    ForceX,
    /// Specific force along the second axis, m/s².
    ForceY,
    /// Specific force along the third axis, m/s².
    ForceZ,
    /// WGS-84, deg.
    Latitude,
    /// WGS-84, deg.
    Longitude,
    Altitude,
    /// Velocity north, m/s.
    North,
    /// Velocity east, m/s.
    East,
    /// Velocity down, m/s.
    Down,
}

impl Quantity {
    pub const COUNT: usize = 18;
    /// All quantities in order, with their column names and maximum magnitudes.
    const KNOWN: [(Quantity, &'static str, f64); Quantity::COUNT] = [
        (Quantity::Roll, "roll_deg", 75.0),
        (Quantity::Pitch, "pitch_deg", 75.0),
        (Quantity::Heading, "heading_deg", 1e5),
        (Quantity::Heave, "heave_m", 50.0),
        (Quantity::Surge, "surge_m", 1e5),
        (Quantity::Sway, "sway_m", 1e5),
        (Quantity::GyroX, "gyro_x_radps", 50.0),
        (Quantity::GyroY, "gyro_y_radps", 50.0),
        (Quantity::GyroZ, "gyro_z_radps", 50.0),
        (Quantity::ForceX, "accel_x_mps2", 500.0),
        (Quantity::ForceY, "accel_y_mps2", 500.0),
        (Quantity::ForceZ, "accel_z_mps2", 500.0),
        (Quantity::Latitude, "latitude_deg", 90.0),
        (Quantity::Longitude, "longitude_deg", 360.0),
        (Quantity::Altitude, "altitude_m", 1e4),
        (Quantity::North, "north_mps", 100.0),
        (Quantity::East, "east_mps", 100.0),
        (Quantity::Down, "down_mps", 100.0),
    ];
    pub fn name(self) -> &'static str {
        Quantity::KNOWN.get(self as usize).map_or("", |known| known.1)
    }
    fn limit(self) -> f64 {
        Quantity::KNOWN.get(self as usize).map_or(0.0, |known| known.2)
    }
    fn named(name: &str) -> Option<Quantity> {
        let known = Quantity::KNOWN.iter().find(|known| known.1 == name);
        known.map(|known| known.0)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct CsvRow {
    /// Line in the file, counted from 1.
    pub line: u64,
    pub t: f64,
    cells: [Option<f64>; Quantity::COUNT],
}

impl CsvRow {
    pub fn get(&self, q: Quantity) -> Option<f64> {
        self.cells.get(q as usize).copied().flatten()
    }
    /// Values of these quantities, if all are present.
    pub fn all<const N: usize>(&self, quantities: [Quantity; N]) -> Option<[f64; N]> {
        let mut all = [0.0; N];
        for (to, q) in all.iter_mut().zip(quantities) {
            *to = self.get(q)?;
        }
        Some(all)
    }
    fn is_empty(&self) -> bool {
        self.cells.iter().all(Option::is_none)
    }
    fn overlaps(&self, other: &CsvRow) -> bool {
        let mut pairs = self.cells.iter().zip(&other.cells);
        pairs.any(|(a, b)| a.is_some() && b.is_some())
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bad {
    pub count: u64,
    /// Line and fault of the first bad row.
    pub first: Option<(u64, String)>,
}

impl Bad {
    fn push(&mut self, line: u64, message: String) {
        self.count += 1;
        self.first.get_or_insert((line, message));
    }
}

#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TableError {
    /// Required columns are missing.
    #[error("line {line}: {message}")]
    Header { line: u64, message: String },
    #[error("line {line}: {message}")]
    Row { line: u64, message: String },
}

#[derive(Clone, Debug, PartialEq)]
pub struct CsvTable {
    /// Rows in order, on the clock of the file.
    pub rows: Vec<CsvRow>,
    /// Number of rows in the file that were merged into `rows`.
    pub read: u64,
    pub bad: Bad,
    /// First row whose time precedes that of the previous row: line and time.
    pub backwards: Option<(u64, f64)>,
    line: u64,
    has: [bool; Quantity::COUNT],
}

/// Error for a packed file with its remedy; None for other files.
pub(super) fn packed(bytes: &[u8]) -> Option<String> {
    let (_, name, tool) = PACKED.iter().find(|(begin, _, _)| bytes.starts_with(begin))?;
    Some(format!("the file is packed ({name}): first {tool}"))
}

/// Lines with content, without the byte order mark.
fn lines(head: &[u8]) -> impl Iterator<Item = &[u8]> {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let lines = head.split(|b| matches!(b, b'\n' | b'\r'));
    lines.filter(|l| !l.trim_ascii().is_empty())
}

pub fn is_table(head: &[u8]) -> bool {
    let is_time = |cell: &[u8]| {
        let cell = cell.trim_ascii();
        let bare = cell.strip_prefix(b"\"").and_then(|c| c.strip_suffix(b"\""));
        bare.unwrap_or(cell) == TIME.as_bytes()
    };
    let first = lines(head).find(|l| !l.starts_with(COMMENT.as_bytes()));
    first.is_some_and(|l| l.split(|b| *b == b',').any(is_time))
}

pub fn has_columns(head: &[u8]) -> bool {
    let is_text = |b: &u8| !b.is_ascii_control() || b.is_ascii_whitespace();
    head.iter().all(is_text)
        && lines(head)
            .next()
            .is_some_and(|l| l.iter().any(|b| b",;\t|".contains(b)))
}

/// Line numbers of records by byte offset: the reader's own count stops at skipped empty lines.
struct Lines<'a> {
    bytes: &'a [u8],
    counted: usize,
    line: u64,
}

impl Lines<'_> {
    fn at(&mut self, byte: u64) -> u64 {
        let begin = usize::try_from(byte).map_or(self.bytes.len(), |b| b.min(self.bytes.len()));
        let rest = self.bytes.get(begin..).unwrap_or_default();
        let empty = rest.iter().take_while(|b| matches!(b, b'\n' | b'\r')).count();
        let passed = self.bytes.get(self.counted..begin + empty).unwrap_or_default();
        self.line += passed.iter().filter(|b| **b == b'\n').count() as u64;
        self.counted = self.counted.max(begin + empty);
        self.line
    }
}

/// Quantities of the header's columns; None is the time.
fn columns(header: &StringRecord, line: u64) -> Result<Vec<Option<Quantity>>, TableError> {
    let error = |message: String| TableError::Header {
        line,
        message: format!("{message}; if another program wrote the table, {CONVERT}"),
    };
    if !header.iter().any(|name| name == TIME) {
        return Err(error(format!("column `{TIME}` is missing")));
    }
    let mut columns = Vec::with_capacity(header.len());
    for name in header {
        let quantity = match name {
            TIME => None,
            name => {
                let quantity = Quantity::named(name);
                Some(quantity.ok_or_else(|| error(format!("unknown column `{name}`: rename or remove it")))?)
            }
        };
        if columns.contains(&quantity) {
            return Err(error(format!("column `{name}` appears twice")));
        }
        columns.push(quantity);
    }
    if columns.len() == 1 {
        return Err(error(format!("`{TIME}` is the only column")));
    }
    Ok(columns)
}

fn number(name: &str, text: &str, limit: f64) -> Result<f64, String> {
    let value = text.parse::<f64>();
    let value = value.map_err(|_| format!("{name} is `{text}`, not a number"))?;
    // NaN fails.
    if value.abs() <= limit {
        Ok(value)
    } else {
        Err(format!("{name} is {text}; allowed: -{limit} to {limit}"))
    }
}

fn row(record: &StringRecord, columns: &[Option<Quantity>], line: u64) -> Result<CsvRow, String> {
    if record.len() != columns.len() {
        let values = record.len();
        let columns = columns.len();
        return Err(format!(
            "{values} values for {columns} columns; cells are separated by commas and have a decimal point"
        ));
    }
    let mut row = CsvRow {
        line,
        t: 0.0,
        cells: [None; Quantity::COUNT],
    };
    for (text, column) in record.iter().zip(columns) {
        let Some(q) = column else {
            row.t = number(TIME, text, MAX_TIME_S)?;
            continue;
        };
        if text.is_empty() || text.eq_ignore_ascii_case(NAN) {
            continue;
        }
        let value = number(q.name(), text, q.limit())?;
        if let Some(cell) = row.cells.get_mut(*q as usize) {
            *cell = Some(value);
        }
    }
    Ok(row)
}

impl CsvTable {
    pub fn read(bytes: &[u8]) -> Result<CsvTable, TableError> {
        if let Some(message) = packed(bytes) {
            return Err(TableError::Header { line: 1, message });
        }
        let mut reader = ReaderBuilder::new()
            .has_headers(false)
            .trim(Trim::All)
            .flexible(true)
            .from_reader(bytes);
        let mut lines = Lines {
            bytes,
            counted: 0,
            line: 1,
        };
        let mut record = StringRecord::new();
        let mut rows = Vec::new();
        let mut bad = Bad::default();
        let mut header: Option<(u64, Vec<Option<Quantity>>)> = None;
        loop {
            let coming = reader.position().byte();
            let read = reader.read_record(&mut record);
            let begin = match &read {
                Ok(true) => record.position().map_or(coming, Position::byte),
                Ok(false) => break,
                Err(e) => e.position().map_or(coming, Position::byte),
            };
            let line = lines.at(begin);
            let is_comment = record.get(0).is_some_and(|cell| cell.starts_with(COMMENT));
            if header.is_none() && is_comment {
                continue;
            }
            let Some((_, columns)) = &header else {
                header = Some((line, self::columns(&record, line)?));
                continue;
            };
            // A spreadsheet may leave lines that contain only commas.
            if read.is_ok() && record.iter().all(str::is_empty) {
                continue;
            }
            match read
                .map_err(|e| e.to_string())
                .and_then(|_| row(&record, columns, line))
            {
                Ok(row) => rows.push(row),
                Err(message) => bad.push(line, message),
            }
            if rows.len() > MAX_ROWS {
                let message = format!("more than {MAX_ROWS} rows; cut the table into parts");
                return Err(TableError::Row { line, message });
            }
        }
        let (line, columns) = match header {
            Some(header) => header,
            None => (1, self::columns(&StringRecord::new(), 1)?),
        };
        CsvTable::of(rows, bad, line, &columns)
    }

    fn of(
        mut rows: Vec<CsvRow>,
        bad: Bad,
        line: u64,
        columns: &[Option<Quantity>],
    ) -> Result<CsvTable, TableError> {
        let back = rows.windows(2).find(|w| w[1].t < w[0].t);
        let backwards = back.map(|w| (w[1].line, w[1].t));
        rows.retain(|r| !r.is_empty());
        let read = rows.len() as u64;
        let rows = joined(rows);
        let repeated = || rows.windows(2).filter(|w| w[1].t == w[0].t);
        let count = repeated().count();
        let total = rows.len();
        if total - count >= 3
            && count as f64 >= COARSE * total as f64
            && let Some([_, first]) = repeated().next()
        {
            let message = format!(
                "{count} of {total} rows have the time of the row above: the times are coarser than the rows, and {CONVERT} \
                 to times that are spread evenly; or record times with fractions of a second"
            );
            return Err(TableError::Row {
                line: first.line,
                message,
            });
        }
        let mut has = [false; Quantity::COUNT];
        for q in columns.iter().flatten() {
            has[*q as usize] = true;
        }
        Ok(CsvTable {
            rows,
            read,
            bad,
            backwards,
            line,
            has,
        })
    }

    pub fn has(&self, q: Quantity) -> bool {
        self.has.get(q as usize).copied().unwrap_or(false)
    }
    pub fn any(&self, q: Quantity) -> bool {
        self.rows.iter().any(|r| r.get(q).is_some())
    }
    /// Quantities of its columns that are not in `used`.
    pub fn unused(&self, used: &[Quantity]) -> Vec<Quantity> {
        let all = Quantity::KNOWN.iter().map(|known| known.0);
        all.filter(|q| self.has(*q) && !used.contains(q)).collect()
    }
    pub fn header_error(&self, message: String) -> TableError {
        TableError::Header {
            line: self.line,
            message,
        }
    }

    /// Requires the columns of each group together. A row with only part of a group is bad if another row
    /// has all of it.
    pub fn require_together(&mut self, groups: &[&[Quantity]]) -> Result<(), TableError> {
        for group in groups {
            let there = group.iter().find(|q| self.has(**q));
            let missing = group.iter().find(|q| !self.has(**q));
            if let (Some(there), Some(missing)) = (there, missing) {
                let message = format!(
                    "column `{}` is present without `{}`",
                    there.name(),
                    missing.name()
                );
                return Err(self.header_error(message));
            }
            let count = |row: &CsvRow| group.iter().filter(|q| row.get(**q).is_some()).count();
            if !self.rows.iter().any(|r| count(r) == group.len()) {
                continue;
            }
            let read = &mut self.read;
            let bad = &mut self.bad;
            self.rows.retain(|row| {
                let whole = [0, group.len()].contains(&count(row));
                if let (false, Some(q)) = (whole, group.iter().find(|q| row.get(**q).is_none())) {
                    let name = q.name();
                    let limit = q.limit();
                    *read = read.saturating_sub(1);
                    bad.push(
                        row.line,
                        format!(
                            "{name} is empty, not a number, but related columns have values; allowed: -{limit} to \
                             {limit}"
                        ),
                    );
                }
                whole
            });
        }
        Ok(())
    }
}

/// Merges rows with one time and different quantities.
fn joined(rows: Vec<CsvRow>) -> Vec<CsvRow> {
    let mut out: Vec<CsvRow> = Vec::with_capacity(rows.len());
    for row in rows {
        match out.last_mut() {
            Some(last) if last.t == row.t && !last.overlaps(&row) => {
                let cells = last.cells.iter_mut().zip(row.cells);
                for (to, from) in cells {
                    *to = to.or(from);
                }
            }
            Some(_) | None => out.push(row),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_cells_in_quotes_and_line_counts() {
        let text = "\n\"t_s\",\"roll_deg\",\"pitch_deg\"\r\n\"0\",\"1.5\",\"-2\"\r\n\r\n,,\r\n1, 2 ,nan\r\n2,x,1\r\n";
        let table = CsvTable::read(text.as_bytes()).unwrap();
        let values: Vec<_> = table
            .rows
            .iter()
            .map(|r| (r.line, r.t, r.get(Quantity::Roll), r.get(Quantity::Pitch)))
            .collect();
        assert_eq!(
            values,
            [(3, 0.0, Some(1.5), Some(-2.0)), (6, 1.0, Some(2.0), None)]
        );
        let (line, message) = table.bad.first.unwrap();
        assert!(
            line == 7 && message.contains("roll_deg is `x`, not a number"),
            "{line}: {message}"
        );
    }

    #[test]
    fn table_with_times_coarser_than_its_rows() {
        let rows = |repeat: u32| -> String {
            let rows = (0..100).map(|k| format!("{},1,2\n", k / repeat * repeat));
            "t_s,roll_deg,pitch_deg\n".to_owned() + &rows.collect::<String>()
        };
        assert_eq!(CsvTable::read(rows(1).as_bytes()).unwrap().rows.len(), 100);
        let e = CsvTable::read(rows(10).as_bytes()).unwrap_err().to_string();
        for part in [
            "line 3: 90 of 100 rows",
            "python -m alight.convert FILE",
            "fractions",
        ] {
            assert!(e.contains(part), "{part}: {e}");
        }
        // Roll and heave at one time are from two sensors.
        let two: String = (0..100).map(|k| format!("{k},1,2,\n{k},,,3\n")).collect();
        let table =
            CsvTable::read(("t_s,roll_deg,pitch_deg,heave_m\n".to_owned() + &two).as_bytes()).unwrap();
        assert_eq!((table.read, table.rows.len()), (200, 100));
    }

    #[test]
    fn quantities_by_their_numbers() {
        for (k, known) in Quantity::KNOWN.iter().enumerate() {
            assert_eq!((known.0 as usize, known.0.name()), (k, known.1));
            assert_eq!(Quantity::named(known.1), Some(known.0));
        }
    }
}
