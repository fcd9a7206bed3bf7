//! The boat's autopilot, whichever it is: what it is to do, and what it reports.

use alight_shared::mavlink::Signing;
use alight_shared::time::{Span, Time, VesselClock};

use super::BoatPlace;
use super::command::{Command, ReadBack};
use super::config::{HelmConfig, HelmOutput};
use super::mavlink::MavlinkHelm;
use super::nmea::NmeaHelm;
use super::signalk::SignalKHelm;

/// The link to it.
#[derive(Debug)]
pub(super) enum Autopilot {
    None,
    Mavlink(Box<MavlinkHelm>),
    Nmea(NmeaHelm),
    SignalK(SignalKHelm),
}

impl Autopilot {
    pub(super) fn new(config: &HelmConfig) -> Autopilot {
        match config.output {
            HelmOutput::None => Autopilot::None,
            HelmOutput::Mavlink => Autopilot::Mavlink(Box::default()),
            HelmOutput::Nmea0183 => Autopilot::Nmea(NmeaHelm::new(config)),
            HelmOutput::SignalK => Autopilot::SignalK(SignalKHelm::new(config)),
        }
    }
    pub(super) fn sign(&mut self, key: Signing) {
        match self {
            Autopilot::Mavlink(link) => link.sign(key),
            Autopilot::None | Autopilot::Nmea(_) | Autopilot::SignalK(_) => {}
        }
    }
    /// Takes what came at `now`; None: the link is not open.
    pub(super) fn receive(&mut self, now: Time<VesselClock>, bytes: Option<&[u8]>) {
        match self {
            Autopilot::None => {}
            // Its heartbeats show whether it is there.
            Autopilot::Mavlink(link) => link.receive(now, bytes.unwrap_or_default()),
            Autopilot::Nmea(link) => link.receive(now, bytes),
            // So do the answers of its server.
            Autopilot::SignalK(link) => link.receive(now, bytes.unwrap_or_default()),
        }
    }
    pub(super) fn read_back(&self, now: Time<VesselClock>) -> ReadBack {
        match self {
            Autopilot::None => ReadBack::default(),
            Autopilot::Mavlink(link) => link.read_back(now),
            Autopilot::Nmea(link) => link.read_back(now),
            Autopilot::SignalK(link) => link.read_back(now),
        }
    }
    /// The bytes that are due at `now` for a command, from where the boat is.
    pub(super) fn send(
        &mut self,
        now: Time<VesselClock>,
        command: &Command,
        boat: Option<&BoatPlace>,
    ) -> Vec<u8> {
        match self {
            Autopilot::None => Vec::new(),
            Autopilot::Mavlink(link) => link.send(now, command),
            Autopilot::Nmea(link) => link.send(now, command, boat),
            Autopilot::SignalK(link) => link.send(now, command),
        }
    }
    /// It takes the mode within this, or denies it: by itself, or by the hand of a skipper who has just agreed.
    pub(super) fn engages_within(&self) -> Span {
        match self {
            Autopilot::None | Autopilot::Mavlink(_) => Span::from_millis(6000),
            // Its server answers once the autopilot on the boat's bus has.
            Autopilot::SignalK(_) => Span::from_millis(12_000),
            Autopilot::Nmea(_) => Span::from_millis(20_000),
        }
    }
    pub(super) fn steers_speed(&self) -> bool {
        match self {
            Autopilot::None | Autopilot::Nmea(_) | Autopilot::SignalK(_) => false,
            Autopilot::Mavlink(_) => true,
        }
    }
}
