//! Output for users and for programs. If the reader closes the pipe (`| head`), the program ends quietly instead of
//! with a panic.

use std::{
    collections::BTreeMap,
    fmt::{self, Display},
    io::{ErrorKind, Write},
    process::{Command, Stdio},
};

use clap::Args;
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{MapAccess, Visitor},
};
use serde_json::Value;

use crate::exit::{CliError, Doing};

/// Form of a command's result: for users by default, or for programs.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct Form {
    /// Print the result as one JSON object, the last line
    #[arg(long)]
    pub json: bool,
    /// Print the rows of the result as CSV
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
}

impl Form {
    /// Whether standard output contains only the result; lines for users then go to standard error.
    pub const fn alone(self) -> bool {
        self.json || self.csv
    }
    /// Prints the result as JSON or its rows as CSV, if requested; false if the result is for users. Without rows
    /// nothing is printed.
    pub fn print(self, result: &impl Serialize, rows: &[impl Serialize]) -> Result<bool, CliError> {
        if self.json {
            json(result)?;
        } else if self.csv {
            csv_lines(rows)?.iter().for_each(line);
        }
        Ok(self.alone())
    }
}

pub fn line(text: impl Display) {
    let Err(e) = writeln!(std::io::stdout().lock(), "{text}") else {
        return;
    };
    if e.kind() == ErrorKind::BrokenPipe {
        std::process::exit(0);
    }
    note(true, format_args!("alight: writing to standard output: {e}"));
    std::process::exit(2);
}

pub fn json(value: &impl Serialize) -> Result<(), CliError> {
    line(serde_json::to_string(value).doing("writing JSON")?);
    Ok(())
}

/// Prints a line for users, on standard error if `alone`.
pub fn note(alone: bool, text: impl Display) {
    if !alone {
        return line(text);
    }
    // Without a reader of standard error, the result still contains everything.
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Opens a page in a browser, if this session has one.
pub fn open_browser(page: &str) {
    let displays = ["DISPLAY", "WAYLAND_DISPLAY"];
    if displays.iter().any(|name| std::env::var_os(name).is_some()) {
        let mut command = Command::new("xdg-open");
        command
            .arg(page)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        // Without the program the printed address remains.
        let _absent = command.spawn();
    }
}

/// Value of a field: the fields of an inner object, or a plain value.
#[derive(Deserialize)]
#[serde(untagged)]
enum Field {
    Inner(Fields),
    Value(Value),
}

/// Fields of an object in the order in which they were written.
struct Fields(Vec<(String, Field)>);

impl<'de> Deserialize<'de> for Fields {
    fn deserialize<D: Deserializer<'de>>(object: D) -> Result<Fields, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Fields;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }
            fn visit_map<M: MapAccess<'de>>(self, mut object: M) -> Result<Fields, M::Error> {
                let mut fields = Vec::new();
                while let Some(field) = object.next_entry()? {
                    fields.push(field);
                }
                Ok(Fields(fields))
            }
        }
        object.deserialize_map(InOrder)
    }
}

#[derive(Default)]
struct Cells {
    names: Vec<String>,
    rows: Vec<BTreeMap<String, String>>,
}

impl Cells {
    /// Adds the fields of a row, those of inner objects as `outer.inner`; `after` is the position of the next new
    /// column.
    fn add(&mut self, row: &mut BTreeMap<String, String>, outer: &str, fields: Fields, after: &mut usize) {
        for (name, field) in fields.0 {
            let name = format!("{outer}{name}");
            let cell = match field {
                Field::Inner(inner) => {
                    self.add(row, &format!("{name}."), inner, after);
                    continue;
                }
                Field::Value(Value::Null) => String::new(),
                Field::Value(Value::String(text)) => text,
                Field::Value(value) => value.to_string(),
            };
            let known = self.names.iter().position(|n| *n == name);
            if known.is_none() {
                self.names.insert(*after, name.clone());
            }
            *after = known.unwrap_or(*after) + 1;
            row.insert(name, cell);
        }
    }
    /// Drops empty columns of objects that some rows lack; the fields of these objects have separate columns.
    fn without_missing_objects(&mut self) {
        let all = self.names.clone();
        self.names.retain(|name| {
            let has_fields = || {
                all.iter()
                    .any(|n| n.strip_prefix(name.as_str()).is_some_and(|n| n.starts_with('.')))
            };
            let is_empty = self.rows.iter().all(|r| r.get(name).is_none_or(String::is_empty));
            !is_empty || !has_fields()
        });
    }
}

/// Rows as CSV with one column for each field of their JSON, in order: fields of an inner object as `outer.inner`, a
/// list as JSON in one cell, unknown values empty. Without rows the text is empty.
fn csv(rows: &[impl Serialize]) -> Result<String, CliError> {
    let doing = "writing CSV";
    let mut cells = Cells::default();
    for row in rows {
        let object = serde_json::to_string(row).doing(doing)?;
        let mut cells_of_row = BTreeMap::new();
        cells.add(
            &mut cells_of_row,
            "",
            serde_json::from_str(&object).doing(doing)?,
            &mut 0,
        );
        cells.rows.push(cells_of_row);
    }
    cells.without_missing_objects();
    if cells.rows.is_empty() {
        return Ok(String::new());
    }
    let mut lines = csv::Writer::from_writer(Vec::new());
    lines.write_record(&cells.names).doing(doing)?;
    for row in &cells.rows {
        let record = cells
            .names
            .iter()
            .map(|name| row.get(name).map_or("", String::as_str));
        lines.write_record(record).doing(doing)?;
    }
    String::from_utf8(lines.into_inner().doing(doing)?).doing(doing)
}

/// CSV without the final line end, which printing adds; None without rows.
fn csv_lines(rows: &[impl Serialize]) -> Result<Option<String>, CliError> {
    Ok(csv(rows)?.strip_suffix('\n').map(str::to_owned))
}

pub const WIDTH: usize = 80;

/// Appends the terms `more`, each after a space; a term that does not fit begins an indented line.
pub fn wrap(text: &mut String, indent: usize, width: usize, more: &str) {
    for piece in more.split_whitespace() {
        let used = text.rsplit('\n').next().map_or(0, |line| line.chars().count());
        if used > indent && used + 1 + piece.chars().count() > width {
            *text += &format!("\n{:indent$}", "");
        } else if !text.is_empty() {
            text.push(' ');
        }
        text.push_str(piece);
    }
}

pub fn wrapped(text: &str) -> String {
    let mut out = String::new();
    wrap(&mut out, 2, WIDTH, text);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Error {
        mean: f64,
        max: f64,
    }

    #[derive(Serialize)]
    struct Row {
        scene: &'static str,
        error: Option<Error>,
        seeds: Vec<u32>,
        aborts: Option<u32>,
    }

    #[test]
    fn csv_of_nested_and_missing_fields() {
        let row = |scene, error: Option<[f64; 2]>| Row {
            scene,
            error: error.map(|[mean, max]| Error { mean, max }),
            seeds: vec![7, 8],
            aborts: None,
        };
        let rows = [row("0.8,5", None), row("a \"b\"", Some([0.25, f64::NAN]))];
        assert_eq!(
            csv(&rows).unwrap(),
            "scene,error.mean,error.max,seeds,aborts\n\"0.8,5\",,,\"[7,8]\",\n\"a \"\"b\"\"\",0.25,,\"[7,8]\",\n"
        );
        assert_eq!(csv_lines(&[] as &[Row]).unwrap(), None);
        let spaces = BTreeMap::from([("a", "b \t ")]);
        let lines = csv_lines(&[spaces]).unwrap().unwrap();
        assert!(lines.starts_with("a\n") && lines.contains("b \t "), "{lines:?}");
    }
}
