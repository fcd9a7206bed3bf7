//! The drone's own GNSS receiver, whose moving base is the vessel's receiver: as a running process reports it, or as
//! received here.

use alight_computer::{
    config::{DroneComputerConfig, link_url::LinkUrl},
    io::{byte_link::ByteLink, runtime},
    process::snapshot::Snapshot,
};
use alight_shared::{metrics::MetricName, msg::CarrierSolution, process::ProcessKind};
use alight_uav::autopilot::receiver::ReceiverDecoder;
use tokio::time::{Duration, Instant, timeout_at};

use crate::{
    status::finding::{Finding, FindingTopic},
    tools::check::facts::{ReceiverCheck, ReceiverReport},
};

/// Time for which the receiver is read: two periods at 1 Hz, with a margin for a link that opens late.
const LISTEN: Duration = Duration::from_millis(2500);
const NO_RELATIVE: &str = "switch UBX-NAV-RELPOSNED on at that port, and RTCM 3 as its input (u-blox F9 with firmware 1.13 or later)";

/// Facts about the receiver; None if none is configured or a process owns it without reporting.
pub fn of(d: &DroneComputerConfig, is_running: bool, snapshot: Option<&Snapshot>) -> Option<ReceiverCheck> {
    let connect = d.autopilot.receiver.clone();
    let report = match (is_running, snapshot) {
        _ if connect.is_empty() => return None,
        (true, None) => return None,
        (_, Some(snapshot)) => {
            let link = snapshot.processes.get(&ProcessKind::Autopilot)?;
            ReceiverReport::Held {
                rtcm: link.count(MetricName::RtcmPassedOn),
                state: (*snapshot.forecast).and_then(|f| f.relative),
            }
        }
        (false, None) => {
            let listened = runtime::block_on(async { Ok(listened(&connect).await) });
            listened.unwrap_or_else(|e| ReceiverReport::Unreachable(e.to_string()))
        }
    };
    Some(ReceiverCheck { connect, report })
}

async fn listened(connect: &str) -> ReceiverReport {
    let url = match LinkUrl::of_receiver(connect) {
        Ok(url) => url,
        Err(why) => return ReceiverReport::Unreachable(why),
    };
    let mut link = match ByteLink::with_peer(url, None).await {
        Ok(link) => link,
        Err(e) => return ReceiverReport::Unreachable(e.to_string()),
    };
    let (mut decoder, mut bytes, mut newest) = (ReceiverDecoder::default(), 0, None);
    let end = Instant::now() + LISTEN;
    while Instant::now() < end {
        let mut take = |part: &[u8]| {
            bytes += part.len();
            decoder.push(part);
        };
        if timeout_at(end, link.read(&mut take)).await.is_err() {
            break;
        }
        while let Some(report) = decoder.next_report() {
            newest = report.solution.map(|_| report).or(newest);
        }
    }
    match link.last_error() {
        Some(why) if bytes == 0 => ReceiverReport::Unreachable(why),
        Some(_) | None => ReceiverReport::Received { bytes, newest },
    }
}

pub fn judge(found: &ReceiverCheck) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("receiver");
    let at = &found.connect;
    match &found.report {
        ReceiverReport::Unreachable(why) => TOPIC.broken(
            format!("the drone's GNSS receiver at {at}: {why}"),
            "check its address in autopilot.receiver, its power and its cable",
        ),
        ReceiverReport::Received { bytes: 0, .. } => TOPIC.broken(
            format!("no bytes from the drone's GNSS receiver at {at}"),
            "check its power, its cable, and the rate in autopilot.receiver",
        ),
        ReceiverReport::Received { bytes, newest: None } => TOPIC.broken(
            format!("{bytes} bytes from the drone's GNSS receiver at {at}, none with a relative position"),
            NO_RELATIVE,
        ),
        ReceiverReport::Received { newest: Some(r), .. } => match r.fixed_base_m() {
            Some(base_m) => TOPIC.warning(
                format!(
                    "the drone's GNSS receiver has a base that does not move, station {}, {:.1} km away: not the vessel's",
                    r.station.unwrap_or_default(),
                    1e-3 * base_m
                ),
                "end the corrections of a caster at that receiver: its base is the vessel's receiver",
            ),
            None => TOPIC.fine(format!(
                "the drone's GNSS receiver at {at} reports; it is sent RTCM while the drone's processes run"
            )),
        },
        ReceiverReport::Held { rtcm: 0, .. } => TOPIC.warning(
            "no RTCM from the vessel: its receiver is not the moving base of the drone's",
            "is it in radio reach, and does its receiver send RTCM 3? (alight help autopilots, moving base)",
        ),
        ReceiverReport::Held { rtcm, state: None } => TOPIC.warning(
            format!("{rtcm} frames of RTCM passed on to the drone's GNSS receiver at {at}, no relative position used"),
            NO_RELATIVE,
        ),
        ReceiverReport::Held { rtcm, state: Some(r) } => {
            let sent = format!("{rtcm} frames of RTCM passed on to the drone's GNSS receiver");
            match r.solution {
                CarrierSolution::Fixed => TOPIC.fine(format!("{sent}: fixed, {:.0} cm", 100.0 * r.sd_m)),
                CarrierSolution::Float => TOPIC.fine(format!("{sent}: float, {:.0} cm", 100.0 * r.sd_m)),
                CarrierSolution::None => TOPIC.warning(
                    format!("{sent}, and no carrier solution"),
                    "wait some minutes with a free sky over both antennas; does she send observations (MSM 4 or 7) and 4072.0?",
                ),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::FindingLevel;
    use alight_shared::msg::RelativeState;
    use alight_uav::autopilot::receiver::RelativeReport;

    #[test]
    fn findings_on_the_receiver() {
        let state = |solution| {
            Some(RelativeState {
                solution,
                sd_m: 0.02,
                ..RelativeState::default()
            })
        };
        let (broken, warning) = (FindingLevel::Broken, FindingLevel::Warning);
        let received = |bytes, newest| ReceiverReport::Received { bytes, newest };
        let of_base = |is_moving_base| {
            let report = RelativeReport {
                of_week_ns: 0,
                station: Some(1042),
                place: Some([[2400.0, -2100.0, -9.0], [0.01; 3]]),
                solution: Some(CarrierSolution::Fixed),
                is_moving_base,
            };
            received(700, Some(report))
        };
        for (report, level, part) in [
            (ReceiverReport::Unreachable("denied".into()), broken, "denied"),
            (received(0, None), broken, "no bytes"),
            (received(700, None), broken, "700 bytes"),
            (
                of_base(false),
                warning,
                "station 1042, 3.2 km away: not the vessel's",
            ),
            (of_base(true), FindingLevel::Fine, "reports"),
            (
                ReceiverReport::Held { rtcm: 0, state: None },
                warning,
                "no RTCM from the vessel",
            ),
            (
                ReceiverReport::Held { rtcm: 9, state: None },
                warning,
                "no relative position used",
            ),
            (
                ReceiverReport::Held {
                    rtcm: 9,
                    state: state(CarrierSolution::None),
                },
                warning,
                "no carrier solution",
            ),
            (
                ReceiverReport::Held {
                    rtcm: 9,
                    state: state(CarrierSolution::Fixed),
                },
                FindingLevel::Fine,
                "fixed, 2 cm",
            ),
        ] {
            let finding = judge(&ReceiverCheck {
                connect: "serial:///dev/ttyACM0:115200".into(),
                report,
            });
            assert_eq!(finding.level, level, "{finding}");
            assert!(finding.found.contains(part), "{finding}");
        }
    }

    #[test]
    fn receiver_that_is_not_configured_or_unreachable() {
        let mut d = DroneComputerConfig::default();
        assert_eq!(of(&d, false, None), None);
        d.autopilot.receiver = "can://can0".into();
        let report = of(&d, false, None).map(|r| r.report);
        assert!(
            matches!(report, Some(ReceiverReport::Unreachable(_))),
            "{report:?}"
        );
    }
}
