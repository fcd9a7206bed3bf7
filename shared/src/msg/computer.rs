//! Report of a computer about its own configuration and processes.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{DeckDimensions, DeckMotion, Header, Line, MAX_DEVICES, Seq, Text};
use crate::{
    process::ProcessKind,
    time::{SteadyClock, VesselTime},
};

/// Maximum number of processes on one computer.
pub const MAX_PROCESSES: usize = 16;
/// Maximum number of endpoints of one kind in a report.
pub const MAX_ENDPOINTS: usize = 8;
/// Maximum number of peers that a radio admits by name.
pub const MAX_PEERS: usize = 64;
/// Human-readable name.
pub type Name = Text<96>;

/// Human-readable names, and the number of names left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Names<const N: usize> {
    /// Names that fit.
    pub names: Seq<Name, N>,
    /// Number of names left out.
    pub left_out: u32,
}

impl<const N: usize> Names<N> {
    /// Takes the first names that fit.
    pub fn of(all: &[String]) -> Names<N> {
        Names {
            names: Seq::filled(all.iter().map(|name| Name::from(name.as_str()))),
            left_out: u32::try_from(all.len().saturating_sub(N)).unwrap_or(u32::MAX),
        }
    }
    /// Iterator over the names that fit.
    pub fn iter(&self) -> impl Iterator<Item = &str> + Clone {
        self.names.iter().map(|name| name.as_str())
    }
}

impl<const N: usize> fmt::Display for Names<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, name) in self.iter().enumerate() {
            let before = if k == 0 { "" } else { ", " };
            write!(f, "{before}{name}")?;
        }
        match self.left_out {
            0 => Ok(()),
            more => write!(f, ", and {more} more"),
        }
    }
}

/// File of a certificate.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Certificate {
    /// Path of the file.
    pub path: Line,
    /// Days until expiry, negative when expired.
    pub days_left: i64,
    /// The certificate is not valid yet by the computer's clock.
    pub in_future: bool,
    /// Name in the certificate.
    pub name: Name,
}

/// State of a radio's certificate.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C, u8)]
pub enum CertificateState {
    /// The radio has no certificate.
    #[default]
    Absent,
    /// Content of the certificate file.
    Read(Certificate),
    /// Reason why the file cannot be read.
    Unreadable(Line),
}

impl CertificateState {
    /// The certificate, if it could be read.
    pub fn read(&self) -> Option<&Certificate> {
        match self {
            CertificateState::Read(certificate) => Some(certificate),
            CertificateState::Absent | CertificateState::Unreadable(_) => None,
        }
    }
}

/// Additional report of a vessel's computer.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct VesselReport {
    /// The vessel's clock at the time of the report.
    pub clock: VesselTime,
    /// Endpoints on which the radio listens.
    pub listen: Names<MAX_ENDPOINTS>,
    /// Endpoints to which the radio connects.
    pub connect: Names<MAX_ENDPOINTS>,
    /// Names of admitted peers.
    pub peers: Names<MAX_PEERS>,
    /// Names of the real sensors, in the order of the configuration.
    pub sources: Seq<Name, MAX_DEVICES>,
    /// The crew's limits of the deck's motion.
    pub limits: DeckMotion,
    /// Certificate of the radio; its file is read once a minute.
    pub certificate: CertificateState,
}

/// Report of a computer about itself, with its configuration at the start, so that observers need no files.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ComputerReport {
    /// Identity and time of the report.
    pub header: Header<SteadyClock>,
    /// Name of the drone or vessel.
    pub title: Line,
    /// Number of the drone; None: a vessel's computer.
    pub drone_id: Option<u32>,
    /// Deck dimensions in the drone's configuration; None: unknown.
    pub deck: Option<DeckDimensions>,
    /// Maximum duration of a disarm on the deck, s; None: unknown.
    pub disarm_s: Option<f64>,
    /// Greatest tilt of a deck to land on, rad; None on a vessel.
    pub deck_tilt_rad: Option<f64>,
    /// Force along the deck, as a fraction of the weight, that a parked drone withstands; None on a vessel.
    pub parked_friction: Option<f64>,
    /// Processes that run and report.
    pub processes: Seq<ProcessKind, MAX_PROCESSES>,
    /// Remark that the configuration was edited after the start.
    pub edited: Option<Line>,
    /// Display wind and vessel speed in knots.
    pub knots: bool,
    /// Additional report of a vessel's computer.
    pub vessel: Option<VesselReport>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_names_than_find_a_place() {
        let all = ["a", "b", "c"].map(String::from);
        assert_eq!(Names::<3>::of(&all).to_string(), "a, b, c");
        let two = Names::<2>::of(&all);
        assert_eq!((two.to_string().as_str(), two.left_out), ("a, b, and 1 more", 1));
        assert_eq!(two.iter().collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!(Names::<2>::default().to_string(), "");
    }
}
