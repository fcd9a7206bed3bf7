//! Vessel position from a beacon, accepted from one configured source:
//! - by MAVLink on the autopilot's link, from one system number: `GLOBAL_POSITION_INT` of a tracker or of the
//!   boat's autopilot, `FOLLOW_TARGET` of a ground station or a phone;
//! - by AIS, from one MMSI: `AIS_VESSEL` of the autopilot, or NMEA sentences of an AIS receiver.
//!
//! The sources' clocks are unknown, so a report is dated at its arrival and its delay counts as error.

use alight_shared::{
    msg::{BeaconSource, DeckBeacon, Header, MAX_BEACON_MPS, MIN_BEACON_SD_M, Message as _},
    time::Span,
};

use super::{
    DroneTime, Output, OutputHeaders,
    config::AutopilotLinkConfig,
    message::{MavMessage as M, MavlinkFrame, MavlinkMessage},
    place_report::{AisReport, PlaceReport},
};

/// Default standard deviation of the position, each axis, m: no GNSS corrections, and 1 s of delay at 2 m/s.
const PLACE_SD_M: f64 = 5.0;
/// Standard deviation of a reported velocity, and of an unknown one, m/s.
const VELOCITY_SD_MPS: f64 = 0.3;
const UNKNOWN_VELOCITY_SD_MPS: f64 = 2.0;
/// Validity of a report, s: ten periods of the usual 1 Hz.
const LASTS_S: f64 = 10.0;

/// Standard deviation of an AIS position, each axis, m (antenna off the deck), and delay of a report, s.
const AIS_SD_M: f64 = 8.0;
const AIS_LATE_S: f64 = 2.0;
const AIS_VELOCITY_SD_MPS: f64 = 0.3;
/// Validity of an AIS report, s: a class B vessel below 2 kn reports every three minutes.
const AIS_LASTS_S: f64 = 200.0;
/// Age up to which a repeated AIS report is accepted, s.
const AIS_REPEATED_S: f64 = 2.0;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OtherSystems {
    /// Time and system number of the last heartbeat from another vehicle's autopilot.
    pub(super) autopilot: Option<(DroneTime, u8)>,
    ais: Option<PlaceReport>,
}

impl OtherSystems {
    /// Accepts a report from the configured system (other than the drone itself) or about the configured
    /// vessel.
    pub(super) fn beacon(
        &mut self,
        now: DroneTime,
        frame: &MavlinkFrame,
        own: Option<u8>,
        c: &AutopilotLinkConfig,
        headers: &mut OutputHeaders,
    ) -> Option<DeckBeacon> {
        let system = frame.from.system;
        let counts = system != 0 && system == c.beacon_system && own != Some(system);
        let mut beacon = match &frame.message {
            MavlinkMessage::Common(M::GLOBAL_POSITION_INT(d)) if counts => {
                beacon_of(now, BeaconSource::GlobalPosition, &d.into())
            }
            MavlinkMessage::Common(M::FOLLOW_TARGET(d)) if counts => {
                beacon_of(now, BeaconSource::FollowTarget, &d.into())
            }
            MavlinkMessage::Common(M::AIS_VESSEL(d)) => self.beacon_by_ais(now, &d.into(), c.beacon_mmsi)?,
            MavlinkMessage::Ais(report) => self.beacon_by_ais(now, report, c.beacon_mmsi)?,
            _ => return None,
        };
        beacon.header = headers.next(Output::Beacon, beacon.header.at);
        // Receivers without a fix report 0, 0.
        let fixed = beacon.latitude_deg != 0.0 || beacon.longitude_deg != 0.0;
        (fixed && beacon.check().is_ok()).then_some(beacon)
    }
    /// Accepts an AIS report of the configured vessel, dated at reception; an old repetition is rejected.
    fn beacon_by_ais(&mut self, now: DroneTime, report: &AisReport, mmsi: u32) -> Option<DeckBeacon> {
        let wanted = report.mmsi != 0 && report.mmsi == mmsi;
        let old = !(report.age_s <= AIS_LASTS_S);
        let repeated = report.age_s > AIS_REPEATED_S && self.ais == Some(report.place);
        if !wanted || old || repeated {
            return None;
        }
        self.ais = Some(report.place);
        let [north, east] = report.place.velocity.unwrap_or_default();
        Some(DeckBeacon {
            header: Header::new(0, 0, 0, 0, now - Span::from_secs(report.age_s)),
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

fn beacon_of(now: DroneTime, source: BeaconSource, report: &PlaceReport) -> DeckBeacon {
    DeckBeacon {
        header: Header::new(0, 0, 0, 0, now),
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
    }
}

#[cfg(test)]
mod tests {
    use super::{super::message::Address, *};
    use alight_shared::{mavlink::dialect as m, time::Time};

    type Link = (OtherSystems, AutopilotLinkConfig);

    fn link(beacon_system: u8, beacon_mmsi: u32) -> Link {
        let config = AutopilotLinkConfig {
            beacon_system,
            beacon_mmsi,
            ..AutopilotLinkConfig::default()
        };
        (OtherSystems::default(), config)
    }
    fn received(
        (others, c): &mut Link,
        system: u8,
        message: impl Into<MavlinkMessage>,
    ) -> Option<DeckBeacon> {
        let frame = MavlinkFrame {
            from: Address::new(system, 1),
            message: message.into(),
        };
        let headers = &mut OutputHeaders::default();
        others.beacon(Time::from_secs(3.0), &frame, None, c, headers)
    }
    fn tracker(lat: i32, lon: i32) -> M {
        M::GLOBAL_POSITION_INT(m::GLOBAL_POSITION_INT_DATA {
            lat,
            lon,
            vx: 150,
            vy: -200,
            ..m::GLOBAL_POSITION_INT_DATA::DEFAULT
        })
    }

    #[test]
    fn beacon_of_the_configured_system_alone() {
        let mut link = link(42, 0);
        let tracker_at = || tracker(593_456_789, -181_000_000);
        let m = received(&mut link, 42, tracker_at()).unwrap();
        assert_eq!(
            (m.header.at, m.source),
            (Time::from_secs(3.0), BeaconSource::GlobalPosition)
        );
        assert!((m.latitude_deg - 59.345_678_9).abs() < 1e-6 && m.velocity == [1.5, -2.0]);
        assert_eq!(m.place_sd_m, PLACE_SD_M);
        assert_eq!(received(&mut link, 41, tracker_at()), None);
        assert_eq!(received(&mut self::link(0, 0), 42, tracker_at()), None);
        let phone = PlaceReport {
            latitude_deg: 59.0,
            longitude_deg: -18.0,
            velocity: None,
            error_m: Some(12.0),
        };
        let m = received(&mut link, 42, phone.follow_target()).unwrap();
        assert_eq!((m.source, m.place_sd_m), (BeaconSource::FollowTarget, 12.0));
        assert_eq!(m.velocity_sd_mps, UNKNOWN_VELOCITY_SD_MPS);
        // A tracker without a fix.
        assert_eq!(received(&mut link, 42, tracker(0, 0)), None);
    }
    #[test]
    fn beacon_by_ais_of_the_configured_vessel() {
        let mut link = link(0, 338_087_471);
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
        let valid = m::AisFlags::AIS_FLAGS_VALID_COG | m::AisFlags::AIS_FLAGS_VALID_VELOCITY;
        let by_autopilot = |flags| {
            M::AIS_VESSEL(m::AIS_VESSEL_DATA {
                MMSI: report.mmsi,
                lat: 406_845_400,
                lon: -740_721_310,
                tslc: 1,
                velocity: 500,
                COG: 30_687,
                flags,
                ..m::AIS_VESSEL_DATA::DEFAULT
            })
        };
        let m = received(&mut link, 1, by_autopilot(valid)).unwrap();
        assert_eq!((m.source, m.header.at), (BeaconSource::Ais, Time::from_secs(2.0)));
        assert!((m.velocity[0] - 3.0).abs() < 0.01 && (m.velocity[1] + 4.0).abs() < 0.01);
        // The error includes the distance that a fast vessel travels during the delay.
        assert!(
            (m.place_sd_m - 8.0_f64.hypot(10.0)).abs() < 0.05,
            "{}",
            m.place_sd_m
        );
        assert!(received(&mut link, 1, MavlinkMessage::Ais(report)).is_some());
        // A repetition, another vessel, a report without a fix, and any report without a configured MMSI are
        // rejected.
        let changed = |change: fn(&mut AisReport)| {
            let mut r = report;
            change(&mut r);
            MavlinkMessage::Ais(r)
        };
        for wrong in [
            changed(|r| r.age_s = 3.0),
            changed(|r| r.mmsi = 338_087_472),
            changed(|r| (r.place.latitude_deg, r.place.longitude_deg) = (0.0, 0.0)),
            changed(|r| (r.place.latitude_deg, r.age_s) = (41.0, 300.0)),
            changed(|r| r.place.velocity = Some([60.0, 0.0])),
        ] {
            assert_eq!(received(&mut link, 1, wrong.clone()), None, "{wrong:?}");
        }
        assert!(received(&mut link, 1, by_autopilot(m::AisFlags::empty())).is_some());
        assert_eq!(
            received(&mut self::link(42, 0), 42, MavlinkMessage::Ais(report)),
            None
        );
    }
}
