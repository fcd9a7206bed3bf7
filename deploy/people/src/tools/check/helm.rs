//! The boat's autopilot that the vessel's computer may steer by: as a running process reports it, or listened to. It is sent
//! heartbeats and nothing else, and its server is asked for its state.

use alight_computer::config::VesselComputerConfig;
use alight_computer::io::runtime;
use alight_computer::process::snapshot::Snapshot;
use alight_computer::vessel::helm::{HelmLink, REMEDY, signing_key};
use alight_shared::node::Node;
use alight_transport::clock::steady_ns;
use alight_usv::helm::{HelmBearings, HelmIn, HelmNode, HelmOutput};
use tokio::time::{Duration, Instant, sleep};

use crate::status::finding::{Finding, FindingTopic};
use crate::tools::check::facts::{HelmCheck, HelmReport};

/// Listened to for so long: three usual periods of an autopilot's heartbeat.
const LISTEN: Duration = Duration::from_millis(3200);
/// Time between two looks at the link.
const ROUND: Duration = Duration::from_millis(20);

/// Facts about the boat's autopilot; None where no helm is configured. Next to a process that runs, as that reports it:
/// its link is not another reader's.
pub fn of(v: &VesselComputerConfig, snapshot: Option<&Snapshot>) -> Option<HelmCheck> {
    let helm = &v.vessel.helm;
    let report = match (helm.output, snapshot) {
        (HelmOutput::None, _) => return None,
        (_, Some(snapshot)) => {
            let status = (*snapshot.vessel)?;
            status
                .deck
                .helm_error
                .map_or(Ok(HelmReport::Held), |e| Err(e.as_str().to_owned()))
        }
        (_, None) => runtime::block_on(listened(v)).map_err(|e| e.to_string()),
    };
    Some(HelmCheck {
        connect: helm.connect.clone(),
        report,
    })
}

async fn listened(v: &VesselComputerConfig) -> Result<HelmReport, alight_computer::exit::CliError> {
    let mut node = HelmNode::new(&v.vessel.helm);
    signing_key(v)?.into_iter().for_each(|key| node.sign(key));
    let mut link = HelmLink::open(v).await?;
    let end = Instant::now() + LISTEN;
    loop {
        let now = v.clock.read(steady_ns());
        let bytes = link.received();
        let out = node.step(
            now,
            &HelmIn {
                bytes,
                ..HelmIn::default()
            },
        );
        link.send(&out.bytes);
        let silent = node.is_silent(now);
        let has_reports = match v.vessel.helm.output {
            HelmOutput::Mavlink | HelmOutput::SignalK => true,
            HelmOutput::Nmea0183 | HelmOutput::None => false,
        };
        let reports = has_reports && !silent;
        if reports || Instant::now() > end {
            return match link.error(silent) {
                Some(why) => Err(alight_computer::exit::CliError(why)),
                None if node.is_steered(now) => Ok(HelmReport::SteeredAlready),
                None if reports => Ok(HelmReport::Answers),
                None => Ok(HelmReport::Open(v.vessel.helm.bearings)),
            };
        }
        sleep(ROUND).await;
    }
}

/// The finding about it.
pub fn judge(found: &HelmCheck) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("helm");
    let at = &found.connect;
    match &found.report {
        Err(why) => TOPIC.warning(why.as_str(), REMEDY),
        Ok(HelmReport::SteeredAlready) => TOPIC.warning(
            format!(
                "{at}: the boat's autopilot is in GUIDED or OFFBOARD already: another computer steers by it"
            ),
            "set the mode that it is to be given back to; until then the skipper is not asked (docs/helm.md)",
        ),
        Ok(HelmReport::Answers) => TOPIC.fine(format!("{at}: the boat's autopilot answers")),
        Ok(HelmReport::Held) => TOPIC.fine(format!("{at}: the vessel's process has the boat's autopilot")),
        Ok(HelmReport::Open(bearings)) => TOPIC.fine(format!(
            "{at}: the link is open; whether an autopilot takes its sentences only a turn under way shows. {}",
            takers(*bearings)
        )),
    }
}

/// Autopilots that take the sentences, as far as their makers' manuals and public threads go (docs/helm.md).
const fn takers(bearings: HelmBearings) -> &'static str {
    match bearings {
        HelmBearings::True => {
            "By their manuals Furuno's NAVpilot and B&G's Network Pilot take APB with RMB or BWC, Garmin's GHP RMB and BWC; \
             pypilot takes APB with the true bearings that are sent. Raymarine's want magnetic ones, or the variation from \
             another device (bearings = \"magnetic\", docs/helm.md)"
        }
        HelmBearings::Magnetic => {
            "By their manuals Raymarine's take APB, RMB and BWC, Furuno's NAVpilot and B&G's Network Pilot APB with RMB or BWC, \
             Garmin's GHP RMB and BWC; pypilot takes no APB with the magnetic bearings that are sent (docs/helm.md)"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::FindingLevel;
    use alight_shared::msg::VesselStatus;
    use alight_shared::time::Time;
    use alight_sim::autopilots::boat::{self, BoatAutopilot};
    use std::sync::mpsc::RecvTimeoutError;

    fn computer(output: HelmOutput, connect: &str) -> VesselComputerConfig {
        let mut v = VesselComputerConfig::default();
        (v.vessel.helm.output, v.vessel.helm.connect) = (output, connect.into());
        v
    }

    #[test]
    fn helm_check_of_links_that_are_silent() {
        assert_eq!(of(&computer(HelmOutput::None, ""), None), None);
        let nowhere = of(
            &computer(HelmOutput::Nmea0183, "serial:///nowhere/ttyUSB1:4800"),
            None,
        )
        .unwrap();
        assert_eq!(judge(&nowhere).level, FindingLevel::Warning);
        assert!(
            judge(&nowhere).found.contains("/nowhere/ttyUSB1"),
            "{:?}",
            judge(&nowhere)
        );
        let silent = of(&computer(HelmOutput::Mavlink, "udpin://127.0.0.1:0"), None);
        // Port 0 is no port of an address; one that is free now is.
        assert!(silent.unwrap().report.is_err());
        let free = std::net::UdpSocket::bind("127.0.0.1:0")
            .and_then(|s| s.local_addr())
            .unwrap();
        let silent = of(&computer(HelmOutput::Mavlink, &format!("udpin://{free}")), None).unwrap();
        assert!(
            judge(&silent).found.contains("no heartbeat"),
            "{:?}",
            judge(&silent)
        );
    }

    #[test]
    fn pilots_that_take_the_helms_sentences() {
        let found = |bearings| {
            let check = HelmCheck {
                connect: "serial:///dev/ttyUSB1:4800".into(),
                report: Ok(HelmReport::Open(bearings)),
            };
            judge(&check).found
        };
        let (geographic, magnetic) = (found(HelmBearings::True), found(HelmBearings::Magnetic));
        assert!(geographic.contains("bearings = \"magnetic\""), "{geographic}");
        assert!(magnetic.contains("pypilot takes no APB"), "{magnetic}");
        // A server that is not there is named with what is wrong.
        let silent = of(&computer(HelmOutput::SignalK, "ws://127.0.0.1:9"), None).unwrap();
        assert!(
            judge(&silent).found.contains("127.0.0.1:9"),
            "{:?}",
            judge(&silent)
        );
    }

    #[test]
    fn helm_check_of_a_boat_that_answers() {
        for (mode, report) in [
            (boat::AUTO, HelmReport::Answers),
            (boat::GUIDED, HelmReport::SteeredAlready),
        ] {
            let boat = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
            let free = std::net::UdpSocket::bind("127.0.0.1:0")
                .and_then(|s| s.local_addr())
                .unwrap();
            let (over, ends) = std::sync::mpsc::channel::<()>();
            let steered = std::thread::spawn(move || {
                let mut autopilot = BoatAutopilot::default();
                autopilot.mode = mode;
                for k in 0..1000 {
                    // The link may not be open yet.
                    let _undelivered =
                        boat.send_to(&autopilot.sent(Time::from_secs(0.05 * f64::from(k))), free);
                    if ends.recv_timeout(Duration::from_millis(10)) != Err(RecvTimeoutError::Timeout) {
                        break;
                    }
                }
            });
            let found = of(&computer(HelmOutput::Mavlink, &format!("udpin://{free}")), None).unwrap();
            drop(over);
            steered.join().unwrap();
            assert_eq!(found.report, Ok(report), "mode {mode}");
        }
    }

    #[test]
    fn helm_check_next_to_a_running_vessel() {
        let v = computer(HelmOutput::Mavlink, "serial:///dev/ttyUSB1:57600");
        let mut snapshot = Snapshot::default();
        assert_eq!(of(&v, Some(&snapshot)), None, "nothing is reported yet");
        snapshot.vessel = VesselStatus::default().into();
        assert_eq!(of(&v, Some(&snapshot)).unwrap().report, Ok(HelmReport::Held));
        let mut status = VesselStatus::default();
        status.deck.helm_error = Some("no heartbeat of a boat's autopilot comes".into());
        snapshot.vessel = status.into();
        assert!(
            judge(&of(&v, Some(&snapshot)).unwrap())
                .found
                .contains("no heartbeat")
        );
    }
}
