//! The vessel's place by MAVLink, of the one system that is configured for it: `GLOBAL_POSITION_INT` of a tracker or of
//! the boat's own autopilot, `FOLLOW_TARGET` of a ground station or a phone. They come over the autopilot's link, as routed.
//! The same by AIS, of the one vessel (MMSI) that is configured: `AIS_VESSEL` of the autopilot, or a receiver's sentences.
//!
//! Their clocks are unknown: a report counts from its arrival, and its delay is part of the error that it is given.

use alight_shared::msg::{BeaconSource, DeckBeacon, MAX_BEACON_MPS, MIN_BEACON_SD_M, Message as _};

use alight_shared::time::Span;

use super::message::{MavlinkFrame, MavlinkMessage};
use super::place_report::{AisReport, PlaceReport};
use super::{AutopilotLink, DroneTime, Output};

/// A place is off by this where the message does not state it, standard deviation of each axis, m: a receiver without
/// corrections, and a second on its way at 2 m/s.
const PLACE_SD_M: f64 = 5.0;
/// The velocity of one that reports it, m/s, and of one that does not.
const VELOCITY_SD_MPS: f64 = 0.3;
const UNKNOWN_VELOCITY_SD_MPS: f64 = 2.0;
/// A report counts for so long, s: ten of the usual 1 Hz.
const LASTS_S: f64 = 10.0;

/// An AIS report's place is off by this, standard deviation of each axis, m: a receiver without corrections, and its antenna some
/// metres from the deck; and it is on its way for so long, s.
const AIS_SD_M: f64 = 8.0;
const AIS_LATE_S: f64 = 2.0;
const AIS_VELOCITY_SD_MPS: f64 = 0.3;
/// It counts for so long, s: class B of a vessel below 2 kn reports every three minutes. Its place grows vague meanwhile.
const AIS_LASTS_S: f64 = 200.0;
/// A repeated report is not taken, unless it was received so recently, s.
const AIS_REPEATED_S: f64 = 2.0;

impl AutopilotLink {
    /// The beacon that a frame is, where it comes from the configured system and not from the drone's own, or is of the
    /// configured vessel.
    pub(super) fn beacon(&mut self, now: DroneTime, frame: &MavlinkFrame) -> Option<DeckBeacon> {
        let beacon = if let MavlinkMessage::GlobalPosition(report) = &frame.message {
            self.beacon_of(now, frame, BeaconSource::GlobalPosition, report)
        } else if let MavlinkMessage::FollowTarget(report) = &frame.message {
            self.beacon_of(now, frame, BeaconSource::FollowTarget, report)
        } else if let MavlinkMessage::Ais(report) = &frame.message {
            self.beacon_by_ais(now, report)
        } else {
            None
        }?;
        // Receivers without a fix report 0, 0.
        let fixed = beacon.latitude_deg != 0.0 || beacon.longitude_deg != 0.0;
        (fixed && beacon.check().is_ok()).then_some(beacon)
    }
    fn beacon_of(
        &mut self,
        now: DroneTime,
        frame: &MavlinkFrame,
        source: BeaconSource,
        report: &PlaceReport,
    ) -> Option<DeckBeacon> {
        let system = frame.from.system;
        let own = self.peer.as_ref().is_some_and(|p| p.address.system == system);
        if system == 0 || system != self.config.beacon_system || own {
            return None;
        }
        Some(DeckBeacon {
            header: self.headers.next(Output::Beacon, now),
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
        })
    }
    /// A report of the configured vessel by AIS, of the time at which it was received. An autopilot repeats what it has received.
    fn beacon_by_ais(&mut self, now: DroneTime, report: &AisReport) -> Option<DeckBeacon> {
        let wanted = report.mmsi != 0 && report.mmsi == self.config.beacon_mmsi;
        let old = !(report.age_s <= AIS_LASTS_S);
        let repeated = report.age_s > AIS_REPEATED_S && self.ais == Some(report.place);
        if !wanted || old || repeated {
            return None;
        }
        self.ais = Some(report.place);
        let [north, east] = report.place.velocity.unwrap_or_default();
        Some(DeckBeacon {
            header: self
                .headers
                .next(Output::Beacon, now - Span::from_secs(report.age_s)),
            source: BeaconSource::Ais,
            latitude_deg: report.place.latitude_deg,
            longitude_deg: report.place.longitude_deg,
            velocity: [north, east],
            place_sd_m: AIS_SD_M.hypot(AIS_LATE_S * north.hypot(east)),
            velocity_sd_mps: match report.place.velocity {
                Some(_) => AIS_VELOCITY_SD_MPS,
                None => UNKNOWN_VELOCITY_SD_MPS.min(MAX_BEACON_MPS),
            },
            lasts_s: AIS_LASTS_S,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::AutopilotLinkConfig;
    use super::super::message::Address;
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
    fn received(link: &mut AutopilotLink, system: u8, message: &MavlinkMessage) -> Option<DeckBeacon> {
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
        let tracker = MavlinkMessage::GlobalPosition(report);
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
        let phone = MavlinkMessage::FollowTarget(PlaceReport {
            velocity: None,
            error_m: Some(12.0),
            ..report
        });
        let m = received(&mut link, 42, &phone).unwrap();
        assert_eq!((m.source, m.place_sd_m), (BeaconSource::FollowTarget, 12.0));
        assert_eq!(m.velocity_sd_mps, UNKNOWN_VELOCITY_SD_MPS);
        // One without a fix.
        let none = MavlinkMessage::GlobalPosition(PlaceReport {
            latitude_deg: 0.0,
            longitude_deg: 0.0,
            ..report
        });
        assert_eq!(received(&mut link, 42, &none), None);
    }
    #[test]
    fn beacon_by_ais_of_the_configured_vessel() {
        let config = AutopilotLinkConfig {
            beacon_mmsi: 338_087_471,
            ..AutopilotLinkConfig::default()
        };
        let (odometry, geometry) = (OdometryConfig::default(), DroneGeometry::default());
        let mut link = AutopilotLink::new(&config, &odometry, &geometry, false, 1, 1);
        let report = AisReport {
            mmsi: 338_087_471,
            place: PlaceReport {
                latitude_deg: 40.684_54,
                longitude_deg: -74.072_131,
                velocity: Some([3.0, -4.0]),
                error_m: None,
            },
            age_s: 1.0,
        };
        // Over the autopilot's own link, by its own number.
        let m = received(&mut link, 1, &MavlinkMessage::Ais(report)).unwrap();
        assert_eq!((m.source, m.header.at), (BeaconSource::Ais, Time::from_secs(2.0)));
        assert!((m.velocity[0] - 3.0).abs() < 0.01 && (m.velocity[1] + 4.0).abs() < 0.01);
        // It errs by what a fast vessel goes on its way, too.
        assert!(
            (m.place_sd_m - 8.0_f64.hypot(10.0)).abs() < 0.05,
            "{}",
            m.place_sd_m
        );
        // What the autopilot repeats, another vessel, one without a fix, or none configured.
        let of = |change: fn(&mut AisReport)| {
            let mut r = report;
            change(&mut r);
            MavlinkMessage::Ais(r)
        };
        for wrong in [
            of(|r| r.age_s = 3.0),
            of(|r| r.mmsi = 338_087_472),
            of(|r| (r.place.latitude_deg, r.place.longitude_deg) = (0.0, 0.0)),
            of(|r| (r.place.latitude_deg, r.age_s) = (41.0, 300.0)),
            of(|r| r.place.velocity = Some([60.0, 0.0])),
        ] {
            assert_eq!(received(&mut link, 1, &wrong), None, "{wrong:?}");
        }
        assert!(received(&mut link, 1, &of(|r| r.place.velocity = None)).is_some());
        assert_eq!(
            received(&mut self::link(42), 42, &MavlinkMessage::Ais(report)),
            None
        );
    }
}
