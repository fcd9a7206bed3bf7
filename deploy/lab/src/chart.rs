//! Charts of a landing as SVG.

use std::{ffi::OsStr, path::Path};

use alight_computer::exit::{CliError, Doing};
use alight_sim::{chart, harness::trace::Trace};

/// Checks before the flight whether a plot can be written to `path`, which must name an SVG.
pub fn can_write(path: &Path) -> Result<(), CliError> {
    let is_svg = |e: &OsStr| e.eq_ignore_ascii_case("svg");
    if !path.extension().is_some_and(is_svg) {
        return Err(CliError(format!(
            "--plot {}: plots are written as SVG only; choose a name that ends in .svg",
            path.display()
        )));
    }
    let opened = std::fs::OpenOptions::new().create(true).append(true).open(path);
    opened.map(|_| ()).map_err(|e| {
        CliError::because(
            format!("writing the plot {}", path.display()),
            format!("{e}; choose a path that can be written"),
        )
    })
}

/// Draws the last landing of a trace to `path`.
pub fn landing(trace: &Trace, title: &str, path: &Path) -> Result<(), CliError> {
    chart::landing::write(trace, title, path).doing(format_args!("writing the plot {}", path.display()))
}
