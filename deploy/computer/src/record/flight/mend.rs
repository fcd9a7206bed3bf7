//! Repair of a part without an end, after a kill or a power cut: adds an index, so that viewers can open the part.

use std::{fs::File, path::Path};

use mcap::McapError;

use super::parts::PartWriter;
use crate::{
    exit::{CliError, Doing},
    record::{
        entry::PartHeader,
        reading::{LogFile, is_whole, parts, read_header},
        sink::why,
    },
};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repair {
    pub parts: usize,
    pub steps: usize,
    /// Removed parts, which were cut off before their first step.
    pub empty: usize,
}

pub fn mend(directory: &Path) -> Result<Repair, CliError> {
    let mut repaired = Repair::default();
    for path in parts(directory)?.iter().filter(|p| !is_whole(p)) {
        match read_header(path)? {
            None => {
                std::fs::remove_file(path).doing(format_args!("removing {}", path.display()))?;
                repaired.empty += 1;
            }
            Some(header) => {
                repaired.steps += rewrite(path, &header)?;
                repaired.parts += 1;
            }
        }
    }
    Ok(repaired)
}

/// Rewrites the part to a new file, which then replaces it; returns the number of steps.
fn rewrite(path: &Path, header: &PartHeader) -> Result<usize, CliError> {
    let doing = format_args!("mending {}", path.display());
    let part = LogFile::open(path)?;
    let new = path.with_extension("repaired");
    let _none = std::fs::remove_file(&new);
    let copied = copy(&part, &new, header).map_err(|e| CliError::because(doing, why(&e)));
    if copied.is_err() {
        // A full disk may have cut off the new file.
        let _none = std::fs::remove_file(&new);
    }
    copied?;
    // The time of the last write counts as the end of the flight.
    let written = std::fs::metadata(path).and_then(|m| m.modified()).doing(doing)?;
    let file = File::options().write(true).open(&new).doing(doing)?;
    file.set_modified(written).doing(doing)?;
    std::fs::rename(&new, path).doing(doing)?;
    Ok(part.steps())
}

fn copy(part: &LogFile, to: &Path, header: &PartHeader) -> Result<(), McapError> {
    let mut writer = PartWriter::create(to, header, 0)?;
    for step in (0..part.steps()).filter_map(|k| part.step(k)) {
        writer.write(step.number, (0, step.log_ns), step.bytes)?;
    }
    writer.finish()
}
