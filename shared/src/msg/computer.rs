//! Report of a computer about itself: the facts by which its processes run.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{DeckDimensions, Header, Line, MAX_DEVICES, Seq, Text};
use crate::process::ProcessKind;
use crate::time::{SteadyClock, Time, VesselClock};

/// Processes of one computer, at most.
pub const MAX_PROCESSES: usize = 16;
/// Endpoints of a kind that a report names.
pub const MAX_ENDPOINTS: usize = 8;
/// Peers that a radio admits by their names, at most.
pub const MAX_PEERS: usize = 64;
/// A name for people.
pub type Name = Text<96>;

/// Names for people, and how many more there are than find a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Names<const N: usize> {
    /// The first of them.
    pub names: Seq<Name, N>,
    /// So many more are left out.
    pub left_out: u32,
}

impl<const N: usize> Names<N> {
    /// As many of these as find a place.
    pub fn of(all: &[String]) -> Names<N> {
        Names {
            names: Seq::filled(all.iter().map(|name| Name::from(name.as_str()))),
            left_out: u32::try_from(all.len().saturating_sub(N)).unwrap_or(u32::MAX),
        }
    }
    /// Those that found a place.
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

/// A certificate's file.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Certificate {
    /// Path of the record.
    pub path: Line,
    /// Days until it expires, negative when it has.
    pub days_left: i64,
    /// It holds from a time that the computer's clock has not reached.
    pub in_future: bool,
    /// The name in it.
    pub name: Name,
}

/// State of a radio's certificate.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C, u8)]
pub enum CertificateState {
    /// The radio has none.
    #[default]
    Absent,
    /// Content of the certificate's file.
    Read(Certificate),
    /// Why its file cannot be read.
    Unreadable(Line),
}

impl CertificateState {
    /// The certificate, where it can be read.
    pub fn read(&self) -> Option<&Certificate> {
        match self {
            CertificateState::Read(certificate) => Some(certificate),
            CertificateState::Absent | CertificateState::Unreadable(_) => None,
        }
    }
}

/// The part of a vessel's computer.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct VesselReport {
    /// The vessel's clock when this was written.
    pub clock: Time<VesselClock>,
    /// Endpoints that its radio listens on.
    pub listen: Names<MAX_ENDPOINTS>,
    /// Endpoints that its radio connects to.
    pub connect: Names<MAX_ENDPOINTS>,
    /// Names that are admitted.
    pub peers: Names<MAX_PEERS>,
    /// Names of the real sensors, in the order of the configuration.
    pub sources: Seq<Name, MAX_DEVICES>,
    /// The radio's certificate; its file is read once a minute.
    pub certificate: CertificateState,
}

/// Report of a computer about itself, by the configuration with which its processes began: who looks on reads no file.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct ComputerReport {
    /// Identity, and when this was written.
    pub header: Header<SteadyClock>,
    /// Whose computer it is.
    pub title: Line,
    /// Number of the drone whose computer it is; None: a vessel's.
    pub drone_id: Option<u32>,
    /// Dimensions of the deck by a drone's configuration; None: not known.
    pub deck: Option<DeckDimensions>,
    /// The longest time that a disarm on the deck takes, s; None: not known.
    pub disarm_s: Option<f64>,
    /// Processes that report while it runs.
    pub processes: Seq<ProcessKind, MAX_PROCESSES>,
    /// Remark on a configuration that was edited since the start.
    pub edited: Option<Line>,
    /// People read winds and the vessel's speed in knots.
    pub knots: bool,
    /// Report of a vessel's computer.
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
