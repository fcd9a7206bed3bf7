//! The boat's autopilot, whichever it is: what it is to do, and what it reports.

use alight_shared::mavlink::Signing;
use alight_shared::time::{Span, Time, VesselClock};

use super::BoatPlace;
use super::command::{HelmCommand, ReadBack};
use super::config::{HelmConfig, HelmOutput};
use super::mavlink::MavlinkHelm;
use super::nmea::NmeaHelm;
use super::signalk::SignalKHelm;

/// The link to it.
#[derive(Debug)]
pub(super) enum HelmDriver {
    None,
    Mavlink(Box<MavlinkHelm>),
    Nmea(NmeaHelm),
    SignalK(SignalKHelm),
}

impl HelmDriver {
    pub(super) fn new(config: &HelmConfig) -> HelmDriver {
        match config.output {
            HelmOutput::None => HelmDriver::None,
            HelmOutput::Mavlink => HelmDriver::Mavlink(Box::default()),
            HelmOutput::Nmea0183 => HelmDriver::Nmea(NmeaHelm::new(config)),
            HelmOutput::SignalK => HelmDriver::SignalK(SignalKHelm::new(config)),
        }
    }
    pub(super) fn sign(&mut self, key: Signing) {
        match self {
            HelmDriver::Mavlink(link) => link.sign(key),
            HelmDriver::None | HelmDriver::Nmea(_) | HelmDriver::SignalK(_) => {}
        }
    }
    /// Takes what came at `now`; None: the link is not open.
    pub(super) fn receive(&mut self, now: Time<VesselClock>, bytes: Option<&[u8]>) {
        match self {
            HelmDriver::None => {}
            // Its heartbeats show whether it is there.
            HelmDriver::Mavlink(link) => link.receive(now, bytes.unwrap_or_default()),
            HelmDriver::Nmea(link) => link.receive(now, bytes),
            // So do the answers of its server.
            HelmDriver::SignalK(link) => link.receive(now, bytes.unwrap_or_default()),
        }
    }
    pub(super) fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        match self {
            HelmDriver::None => ReadBack::default(),
            HelmDriver::Mavlink(link) => link.read_back(now),
            HelmDriver::Nmea(link) => link.read_back(now),
            HelmDriver::SignalK(link) => link.read_back(now),
        }
    }
    /// The bytes that are due at `now` for a command, from where the boat is.
    pub(super) fn send(
        &mut self,
        now: Time<VesselClock>,
        command: &HelmCommand,
        boat: Option<&BoatPlace>,
    ) -> Vec<u8> {
        match self {
            HelmDriver::None => Vec::new(),
            HelmDriver::Mavlink(link) => link.send(now, command),
            HelmDriver::Nmea(link) => link.send(now, command, boat),
            HelmDriver::SignalK(link) => link.send(now, command),
        }
    }
    /// It takes the mode within this, or denies it: by itself, or by the hand of a skipper who has just agreed.
    pub(super) fn engages_within(&self) -> Span {
        match self {
            HelmDriver::None | HelmDriver::Mavlink(_) => Span::from_millis(6000),
            // Its server answers once the autopilot on the boat's bus has.
            HelmDriver::SignalK(_) => Span::from_millis(12_000),
            HelmDriver::Nmea(_) => Span::from_millis(20_000),
        }
    }
    pub(super) fn steers_speed(&self) -> bool {
        match self {
            HelmDriver::None | HelmDriver::Nmea(_) | HelmDriver::SignalK(_) => false,
            HelmDriver::Mavlink(_) => true,
        }
    }
}
