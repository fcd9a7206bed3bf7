//! The rows of a table.

use csv::{Position, StringRecord};

use super::column::KNOWN;
use super::columns::Columns;
use super::stamp::{self, Stamp};
use super::text::{self, Layout};
use super::{Bad, Quantity, Row, Table, TableError, spread};

/// The largest time, s.
const MAX_TIME_S: f64 = 1e10;
/// Most rows.
const MAX_ROWS: usize = 2_000_000;
/// Slower than this a course is not needed, m/s.
const STILL_MPS: f64 = 0.3;
/// What stands for no value.
const MISSING: [&str; 9] = ["", "nan", "na", "n/a", "null", "none", "-", "--", "nan(ind)"];

/// A table while it is read.
pub(super) struct Reading<'a> {
    columns: &'a Columns,
    layout: &'a Layout,
    rows: Vec<Row>,
    stamps: Vec<Stamp>,
    bad: Bad,
    /// Lines of the first numbers with a comma and with a point.
    comma: Option<u64>,
    point: Option<u64>,
    remarks: u64,
    headers: u64,
    /// Unit of a count since 1970.
    epoch: Option<f64>,
}

impl<'a> Reading<'a> {
    pub(super) fn of(columns: &'a Columns, layout: &'a Layout) -> Self {
        Reading {
            columns,
            layout,
            rows: Vec::new(),
            stamps: Vec::new(),
            bad: Bad::default(),
            comma: None,
            point: None,
            remarks: 0,
            headers: 0,
            epoch: None,
        }
    }
    /// Takes the rows of `body`.
    pub(super) fn read(&mut self, body: &str) -> Result<(), TableError> {
        let mut reader = self.layout.delimiter.reader(body);
        let mut record = StringRecord::new();
        // Lines up to a byte: the reader's own count stays at the empty lines that it skips.
        let (mut counted, mut line) = (0, self.layout.body.1 + 1);
        loop {
            let coming = reader.position().byte();
            let read = reader.read_record(&mut record);
            let place = match &read {
                Ok(true) => record.position().map_or(coming, Position::byte),
                Ok(false) => return Ok(()),
                Err(e) => e.position().map_or(coming, Position::byte),
            };
            let place = usize::try_from(place).unwrap_or(usize::MAX).min(body.len());
            let rest = body.as_bytes().get(place..).unwrap_or_default();
            let empty = rest.iter().take_while(|b| matches!(b, b'\n' | b'\r')).count();
            let passed = body.as_bytes().get(counted..place + empty).unwrap_or_default();
            line += passed.iter().filter(|b| **b == b'\n').count() as u64;
            counted = counted.max(place + empty);
            match read
                .map_err(|e| e.to_string())
                .and_then(|_| self.row(&record, line))
            {
                Ok(()) => {}
                Err(message) => self.bad.push(line, message),
            }
            if let (Some(comma), Some(point)) = (self.comma, self.point) {
                let message = format!(
                    "numbers have a decimal comma in line {comma} and a decimal point in line {point}; write all of \
                     them in one way"
                );
                let line = comma.max(point);
                return Err(TableError::Row { line, message });
            }
            if self.rows.len() > MAX_ROWS {
                let message = format!("more than {MAX_ROWS} rows; cut the table into parts");
                return Err(TableError::Row { line, message });
            }
        }
    }

    fn row(&mut self, record: &StringRecord, line: u64) -> Result<(), String> {
        let names = &self.layout.names;
        // A line of nothing but separators, as a spreadsheet leaves them, is empty.
        if record.iter().all(str::is_empty) {
            return Ok(());
        }
        let first = record.get(0).unwrap_or_default();
        if text::comment(first).is_some() {
            self.remarks += 1;
            return Ok(());
        }
        if record
            .iter()
            .take(names.len())
            .eq(names.iter().map(String::as_str))
        {
            self.headers += 1;
            return Ok(());
        }
        let beyond = record.iter().skip(names.len()).any(|c| !c.is_empty());
        if record.len() < names.len() || beyond {
            let comma = match self.layout.delimiter {
                text::Delimiter::Comma if beyond => "; numbers with a decimal comma need quotes here",
                text::Delimiter::Comma
                | text::Delimiter::Semicolon
                | text::Delimiter::Tab
                | text::Delimiter::Bar
                | text::Delimiter::Spaces => "",
            };
            return Err(format!(
                "{} values for {} columns{comma}",
                record.len(),
                names.len()
            ));
        }
        let columns = self.columns;
        let (time, unit) = columns.time;
        let stamp = self.stamp(record.get(time).unwrap_or_default(), unit, line)?;
        let mut row = Row::new(line, 0.0);
        for (text, column) in record.iter().zip(&columns.quantities) {
            let Some((q, factor)) = column else { continue };
            let Some(known) = KNOWN.get(*q) else { continue };
            if is_missing(text) {
                continue;
            }
            let value = self.number(known.name, text, line)? * factor;
            // A NaN is not within.
            if !(value.abs() <= known.limit) {
                let limit = known.limit;
                return Err(format!(
                    "{} is {text}, allowed is -{limit} to {limit}",
                    known.name
                ));
            }
            if let Some(cell) = row.cells.get_mut(*q) {
                *cell = Some(value);
            }
        }
        self.rows.push(row);
        self.stamps.push(stamp);
        Ok(())
    }

    fn stamp(&mut self, text: &str, unit: Option<f64>, line: u64) -> Result<Stamp, String> {
        if text.contains(':') {
            return stamp::clock(text).ok_or_else(|| {
                format!("t_s is `{text}`, no time; 2026-05-20T12:00:00.1Z and 12:00:00.1 are read")
            });
        }
        let value = self.number("t_s", text, line)?;
        let unit = match unit.or(self.epoch) {
            Some(unit) => unit,
            None => {
                let unit = stamp::epoch_unit(value).ok_or_else(|| {
                    let name = self.layout.names.get(self.columns.time.0).map_or("", String::as_str);
                    format!(
                        "the unit of the time {text} is not stated: call the column `{name}` t_s, {name}_ms or \
                         {name}_us where it is that"
                    )
                })?;
                *self.epoch.insert(unit)
            }
        };
        let t = value * unit;
        if !(t.abs() <= MAX_TIME_S) {
            return Err(format!("t_s is {text}, allowed is -{MAX_TIME_S} to {MAX_TIME_S}"));
        }
        Ok(Stamp::Seconds(t))
    }

    /// A number with a decimal point or comma.
    fn number(&mut self, name: &str, text: &str, line: u64) -> Result<f64, String> {
        let wrong = || format!("{name} is `{text}`, not a number");
        let (comma, point) = (text.contains(','), text.contains('.'));
        let value = match (comma, point) {
            (true, true) => return Err(wrong()),
            (true, false) => text.replacen(',', ".", 1).parse().map_err(|_| wrong())?,
            (false, _) => text.parse().map_err(|_| wrong())?,
        };
        if comma {
            self.comma.get_or_insert(line);
        }
        if point {
            self.point.get_or_insert(line);
        }
        Ok(value)
    }

    /// The table.
    pub(super) fn finish(self) -> Result<Table, TableError> {
        let Reading {
            columns,
            layout,
            mut rows,
            stamps,
            bad,
            ..
        } = self;
        let mut notes = layout.notes.clone();
        // Nothing but times whose unit is not stated: the columns are at fault.
        if rows.is_empty()
            && columns.time.1.is_none()
            && let Some((_, message)) = bad.first.as_ref().filter(|(_, m)| m.starts_with("the unit of"))
        {
            return Err(TableError::Header {
                line: layout.line,
                message: format!(
                    "column `t_s` is missing: {message} (cells separated by {})",
                    layout.delimiter.name()
                ),
            });
        }
        let times = stamp::resolve(&stamps).map_err(|(k, message)| TableError::Row {
            line: rows.get(k).map_or(layout.line, |r| r.line),
            message,
        })?;
        rows.iter_mut().zip(times).for_each(|(row, t)| row.t = t);
        let backwards = rows
            .windows(2)
            .find_map(|w| w.last().zip(w.first()).filter(|(b, a)| b.t < a.t))
            .map(|(b, _)| (b.line, b.t));
        if self.comma.is_some() {
            notes.push("numbers have a decimal comma".into());
        }
        if self.remarks > 0 {
            notes.push(format!("{} remarks between the rows passed over", self.remarks));
        }
        if self.headers > 0 {
            notes.push(format!(
                "the header comes again {} times between the rows",
                self.headers
            ));
        }
        if let Some(unit) = self.epoch {
            let unit = match unit {
                1.0 => "seconds",
                1e-3 => "milliseconds",
                1e-6 => "microseconds",
                _ => "nanoseconds",
            };
            notes.push(format!("the times are {unit} since 1970, as their size says"));
        }
        let without_course = rows.iter_mut().filter_map(speed_and_course).count();
        if without_course > 0 {
            notes.push(format!(
                "{without_course} speeds or courses over ground without the other are left out"
            ));
        }
        let mut has = columns.has;
        let made = rows.iter().any(|r| r.get(Quantity::North).is_some());
        if made {
            [Quantity::North, Quantity::East]
                .iter()
                .for_each(|q| has[*q as usize] = true);
        }
        [Quantity::Speed, Quantity::Course]
            .iter()
            .for_each(|q| has[*q as usize] = false);
        let before = rows.len();
        rows.retain(|r| r.mask() != 0);
        if rows.len() < before {
            notes.push(format!("{} rows hold nothing that is read", before - rows.len()));
        }
        let read = rows.len() as u64;
        let spread =
            spread::spread(&mut rows).map_err(|(line, message)| TableError::Row { line, message })?;
        notes.extend(spread);
        Ok(Table {
            rows: joined(rows),
            read,
            bad,
            backwards,
            notes,
            line: layout.line,
            has,
        })
    }
}

fn is_missing(text: &str) -> bool {
    MISSING.iter().any(|m| m.eq_ignore_ascii_case(text))
}

/// Velocity north and east of speed and course; a speed or course that is without the other.
fn speed_and_course(row: &mut Row) -> Option<f64> {
    let (speed, course) = (row.get(Quantity::Speed), row.get(Quantity::Course));
    row.cells[Quantity::Speed as usize] = None;
    row.cells[Quantity::Course as usize] = None;
    if row.get(Quantity::North).is_some() || row.get(Quantity::East).is_some() {
        return None;
    }
    let (speed, course) = match (speed, course) {
        (Some(speed), Some(course)) => (speed, course.to_radians()),
        (Some(speed), None) if speed < STILL_MPS => (speed, 0.0),
        (one, other) => return one.or(other),
    };
    row.cells[Quantity::North as usize] = Some(speed * course.cos());
    row.cells[Quantity::East as usize] = Some(speed * course.sin());
    None
}

/// Rows of one time that have different quantities are one row.
fn joined(rows: Vec<Row>) -> Vec<Row> {
    let mut out: Vec<Row> = Vec::with_capacity(rows.len());
    for row in rows {
        match out.last_mut() {
            Some(last) if last.t == row.t && last.mask() & row.mask() == 0 => {
                let cells = last.cells.iter_mut().zip(row.cells);
                cells.for_each(|(to, from)| *to = to.or(from));
            }
            Some(_) | None => out.push(row),
        }
    }
    out
}
