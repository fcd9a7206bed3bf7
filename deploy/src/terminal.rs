//! Lines for a person and for machines. A reader that went away (`| head`) ends the program
//! quietly instead of with a panic.

use std::fmt::Display;
use std::io::{ErrorKind, Write};

use serde::Serialize;

use crate::exit::{CliError, Doing};

/// A line on standard output.
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

/// A value on standard output, as JSON on one line.
pub fn json(value: &impl Serialize) -> Result<(), CliError> {
    line(serde_json::to_string(value).doing("writing JSON")?);
    Ok(())
}

/// A line for a person: on standard error when standard output carries the JSON object.
pub fn note(json: bool, text: impl Display) {
    if !json {
        return line(text);
    }
    // Nobody reads standard error: nothing is lost that the object does not hold.
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
