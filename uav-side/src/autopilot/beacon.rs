//! The vessel's place by MAVLink, of the one system that is configured for it: `GLOBAL_POSITION_INT` of a tracker or of
//! the boat's own autopilot, `FOLLOW_TARGET` of a ground station or a phone. They come over the autopilot's link, as routed.
//!
//! Their clocks are nobody's: a report counts from its arrival, and what it is late is in the error that it is given.

use alight_shared::msg::{BeaconSource, DeckBeacon, MAX_BEACON_MPS, MIN_BEACON_SD_M, Message as _};

use super::message::{Frame, Message};
use super::{AutopilotLink, DroneTime, Output};

/// A place is off by this where the message does not say, standard deviation of each axis, m: a receiver without corrections,
/// and a second on its way at 2 m/s.
const PLACE_SD_M: f64 = 5.0;
/// The velocity of one that reports it, m/s, and of one that does not.
const VELOCITY_SD_MPS: f64 = 0.3;
const UNKNOWN_VELOCITY_SD_MPS: f64 = 2.0;
/// A report counts for so long, s: ten of the usual 1 Hz.
const LASTS_S: f64 = 10.0;

impl AutopilotLink {
    /// The beacon that a frame is, where it comes from the configured system, and not from the drone's own.
    pub(super) fn beacon(&mut self, now: DroneTime, frame: &Frame) -> Option<DeckBeacon> {
        let (source, report) = if let Message::GlobalPosition(report) = &frame.message {
            (BeaconSource::GlobalPosition, report)
        } else if let Message::FollowTarget(report) = &frame.message {
            (BeaconSource::FollowTarget, report)
        } else {
            return None;
        };
        let system = frame.from.system;
        let own = self.peer.as_ref().is_some_and(|p| p.address.system == system);
        if system == 0 || system != self.config.beacon_system || own {
            return None;
        }
        let beacon = DeckBeacon {
            header: self.header(Output::Beacon, now),
            source,
            latitude_deg: report.latitude_deg,
            longitude_deg: report.longitude_deg,
            velocity: report.velocity.unwrap_or_default(),
            place_sd_m: report.error_m.unwrap_or(0.0).max(PLACE_SD_M).max(MIN_BEACON_SD_M),
            velocity_sd_mps: match report.velocity {
                Some(_) => VELOCITY_SD_MPS,
                None => UNKNOWN_VELOCITY_SD_MPS.min(MAX_BEACON_MPS),
            },
            lasts_s: LASTS_S,
        };
        // Receivers without a fix report 0, 0.
        let fixed = report.latitude_deg != 0.0 || report.longitude_deg != 0.0;
        (fixed && beacon.check().is_ok()).then_some(beacon)
    }
}

#[cfg(test)]
mod tests {
    use super::super::AutopilotLinkConfig;
    use super::super::message::Address;
    use super::super::place_report::PlaceReport;
    use super::super::wire::{Decoder, Encoder};
    use super::*;
    use crate::odometry::OdometryConfig;
    use alight_shared::geometry::DroneGeometry;
    use alight_shared::time::Time;

    fn link(beacon_system: u8) -> AutopilotLink {
        let config = AutopilotLinkConfig {
            beacon_system,
            ..AutopilotLinkConfig::default()
        };
        let (odometry, geometry) = (OdometryConfig::default(), DroneGeometry::default());
        AutopilotLink::new(&config, &odometry, &geometry, false, 1, 1)
    }
    /// Through the bytes of a link.
    fn received(link: &mut AutopilotLink, system: u8, message: &Message) -> Option<DeckBeacon> {
        let bytes = Encoder::default()
            .frame(Address::new(system, 1), message)
            .unwrap();
        let mut decoder = Decoder::default();
        decoder.push(&bytes);
        let frame = decoder.next_frame().unwrap();
        link.beacon(Time::from_secs(3.0), &frame)
    }

    #[test]
    fn beacon_of_the_configured_system_alone() {
        let report = PlaceReport {
            latitude_deg: 59.345_678_9,
            longitude_deg: -18.1,
            velocity: Some([1.5, -2.0]),
            error_m: None,
        };
        let mut link = link(42);
        let tracker = Message::GlobalPosition(report);
        let m = received(&mut link, 42, &tracker).unwrap();
        assert_eq!(
            (m.header.at, m.source),
            (Time::from_secs(3.0), BeaconSource::GlobalPosition)
        );
        assert!((m.latitude_deg - report.latitude_deg).abs() < 1e-6 && m.velocity == [1.5, -2.0]);
        assert_eq!(m.place_sd_m, PLACE_SD_M);
        assert_eq!(received(&mut link, 41, &tracker), None);
        assert_eq!(received(&mut self::link(0), 42, &tracker), None);
        // A phone that does not know its speed, with an error that it states.
        let phone = Message::FollowTarget(PlaceReport {
            velocity: None,
            error_m: Some(12.0),
            ..report
        });
        let m = received(&mut link, 42, &phone).unwrap();
        assert_eq!((m.source, m.place_sd_m), (BeaconSource::FollowTarget, 12.0));
        assert_eq!(m.velocity_sd_mps, UNKNOWN_VELOCITY_SD_MPS);
        // One without a fix.
        let none = Message::GlobalPosition(PlaceReport {
            latitude_deg: 0.0,
            longitude_deg: 0.0,
            ..report
        });
        assert_eq!(received(&mut link, 42, &none), None);
    }
}
