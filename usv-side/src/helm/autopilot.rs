//! The boat's autopilot, whichever it is: what it is to do, and what it reports.

use alight_shared::mavlink::Signing;
use alight_shared::time::{Time, VesselClock};

use super::config::{HelmConfig, HelmOutput};
use super::mavlink::MavlinkHelm;
use super::nmea::NmeaHelm;

/// What it is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Command {
    Nothing,
    Steer { heading_rad: f64, speed_mps: f64 },
    GiveBack { mode: Option<u32> },
}

/// What it reports.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ReadBack {
    /// It is there.
    pub present: bool,
    /// Its mode, where it reports one.
    pub mode: Option<u32>,
    /// When it did last.
    pub reported: Option<Time<VesselClock>>,
    /// It takes our commands in that mode.
    pub is_ours: bool,
    /// It denied the mode.
    pub denied: bool,
    /// It reports a hand on the helm.
    pub by_hand: bool,
}

impl ReadBack {
    /// It reports the mode in which it takes set-points: ours, or somebody else's.
    pub(super) fn is_steered(&self) -> bool {
        self.present && self.is_ours && self.mode.is_some()
    }
}

/// The link to it.
#[derive(Debug)]
pub(super) enum Autopilot {
    None,
    Mavlink(Box<MavlinkHelm>),
    Nmea(NmeaHelm),
}

impl Autopilot {
    pub(super) fn new(config: &HelmConfig) -> Autopilot {
        match config.output {
            HelmOutput::None => Autopilot::None,
            HelmOutput::Mavlink => Autopilot::Mavlink(Box::default()),
            HelmOutput::Nmea0183 => Autopilot::Nmea(NmeaHelm::default()),
        }
    }
    pub(super) fn sign(&mut self, key: Signing) {
        match self {
            Autopilot::Mavlink(link) => link.sign(key),
            Autopilot::None | Autopilot::Nmea(_) => {}
        }
    }
    /// Takes what came at `now`; None: the link is not open.
    pub(super) fn receive(&mut self, now: Time<VesselClock>, bytes: Option<&[u8]>) {
        match self {
            Autopilot::None => {}
            // Its heartbeats show whether it is there.
            Autopilot::Mavlink(link) => link.receive(now, bytes.unwrap_or_default()),
            Autopilot::Nmea(link) => link.receive(now, bytes),
        }
    }
    pub(super) fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        match self {
            Autopilot::None => ReadBack::default(),
            Autopilot::Mavlink(link) => link.read_back(now),
            Autopilot::Nmea(link) => link.read_back(now),
        }
    }
    /// The bytes that are due at `now` for a command.
    pub(super) fn send(&mut self, now: Time<VesselClock>, command: &Command) -> Vec<u8> {
        match self {
            Autopilot::None => Vec::new(),
            Autopilot::Mavlink(link) => link.send(now, command),
            Autopilot::Nmea(link) => link.send(now, command),
        }
    }
    pub(super) fn steers_speed(&self) -> bool {
        match self {
            Autopilot::None | Autopilot::Nmea(_) => false,
            Autopilot::Mavlink(_) => true,
        }
    }
}
