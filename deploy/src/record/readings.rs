//! What the vessel's node was given in a recording, for `alight estimate`.

use std::path::Path;

use alight_shared::wire;
use alight_usv::log::{LogError, MAX_MEASUREMENTS, Recording};
use alight_usv::sensors::{Decoded, Measurement};
use alight_usv::{ComputerIn, VesselNodeConfig};

use crate::exit::CliError;
use crate::record::entry::Entry;
use crate::record::reading::{self, contained};
use crate::record::{NODES, VESSEL_FILE};

/// The first bytes of the format.
const MAGIC: &[u8] = b"\x89MCAP";

/// It is an MCAP file.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The vessel's measurements and configuration.
pub fn read(path: &Path) -> Result<(Recording, VesselNodeConfig), CliError> {
    contained(path, || read_sound(path))
}

fn read_sound(path: &Path) -> Result<(Recording, VesselNodeConfig), CliError> {
    let recording = reading::Recording::open(path)?;
    let origin = recording.origin();
    let vessel = NODES.iter().position(|n| *n == "vessel");
    let config = recording.configuration(VESSEL_FILE)?;
    let mut measurements = Vec::new();
    let mut decoded = Decoded::default();
    recording.steps(|node, _, bytes| {
        if Some(node) != vessel || measurements.len() > MAX_MEASUREMENTS {
            return Ok(());
        }
        let entry: Entry<ComputerIn> = wire::decode_record(bytes)?;
        let i = entry.input.vessel;
        decoded.good += 1;
        measurements.extend(i.imu.into_iter().map(Measurement::Imu));
        measurements.extend(i.attitude.into_iter().map(Measurement::Attitude));
        measurements.extend(i.gnss.into_iter().map(Measurement::Gnss));
        measurements.extend(i.heading.into_iter().map(Measurement::Heading));
        Ok(())
    })?;
    let whole = |message: String| CliError(LogError::new(origin, message).to_string());
    if measurements.is_empty() {
        return Err(whole("holds no measurement of a vessel".into()));
    }
    if measurements.len() > MAX_MEASUREMENTS {
        return Err(whole(format!("more than {MAX_MEASUREMENTS} measurements")));
    }
    let recorded = Recording {
        format: "MCAP",
        measurements,
        decoded,
        notes: Vec::new(),
    };
    Ok((recorded, config))
}
