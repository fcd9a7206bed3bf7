//! Inputs of the vessel's node in a recording, for `alight estimate`.

use std::path::Path;

use alight_shared::{config, wire};
use alight_usv::log::{LogError, MAX_MEASUREMENTS, Recording};
use alight_usv::sensors::{Decoded, Measurement};
use alight_usv::{ComputerIn, VesselNodeConfig};

use crate::config::VesselComputer;
use crate::exit::{CliError, Doing};
use crate::record::entry::Entry;
use crate::record::flight::reading::{Part, is_part};
use crate::record::reading::{self, contained};
use crate::record::{NODES, VESSEL_FILE};

/// The first bytes of the format.
const MAGIC: &[u8] = b"\x89MCAP";

/// It is an MCAP file.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The vessel's measurements and configuration: of a recording, or of a part of the vessel's flight recorder.
pub fn read(path: &Path) -> Result<(Recording, VesselNodeConfig), CliError> {
    contained(path, || {
        let mut read = Measurements::default();
        let config = if is_part(path) {
            read.part(path)?
        } else {
            read.recording(path)?
        };
        Ok((read.whole(path)?, config))
    })
}

#[derive(Default)]
struct Measurements {
    all: Vec<Measurement>,
    decoded: Decoded,
}

impl Measurements {
    fn recording(&mut self, path: &Path) -> Result<VesselNodeConfig, CliError> {
        let recording = reading::Recording::open(path)?;
        let vessel = NODES.iter().position(|n| *n == "vessel");
        let config = recording.configuration(VESSEL_FILE)?;
        recording.steps(|node, _, bytes| {
            if Some(node) == vessel {
                self.add(wire::decode_record(bytes)?);
            }
            Ok(())
        })?;
        Ok(config)
    }
    fn part(&mut self, path: &Path) -> Result<VesselNodeConfig, CliError> {
        let part = Part::open(path)?;
        if part.header.process != "vessel" {
            let (origin, process) = (path.display(), &part.header.process);
            return Err(CliError(format!(
                "{origin}: the steps of the process `{process}`; the vessel's are in vessel-*.mcap"
            )));
        }
        for step in (0..part.len()).filter_map(|k| part.step(k)) {
            let doing = format_args!("reading step {} in {}", step.number, path.display());
            self.add(wire::decode_record(step.bytes).doing(doing)?);
        }
        let origin = format!("{}, its configuration", path.display());
        Ok(config::parse::<VesselComputer>(&part.header.config, &origin)?.vessel)
    }
    fn add(&mut self, entry: Entry<ComputerIn>) {
        if self.all.len() > MAX_MEASUREMENTS {
            return;
        }
        let i = entry.input.vessel;
        self.decoded.good += 1;
        self.all.extend(i.imu.into_iter().map(Measurement::Imu));
        self.all.extend(i.attitude.into_iter().map(Measurement::Attitude));
        self.all.extend(i.gnss.into_iter().map(Measurement::Gnss));
        self.all.extend(i.heading.into_iter().map(Measurement::Heading));
    }
    fn whole(self, path: &Path) -> Result<Recording, CliError> {
        let error =
            |message: String| CliError(LogError::new(&path.display().to_string(), message).to_string());
        if self.all.is_empty() {
            return Err(error("holds no measurement of a vessel".into()));
        }
        if self.all.len() > MAX_MEASUREMENTS {
            return Err(error(format!("more than {MAX_MEASUREMENTS} measurements")));
        }
        Ok(Recording {
            format: "MCAP",
            measurements: self.all,
            decoded: self.decoded,
            notes: Vec::new(),
        })
    }
}
