//! `alight status` on the vessel: the status of its process, judged.

use std::path::{Path, PathBuf};
use std::time::Duration;

use alight_shared::msg::{Charge, Course, still_armed};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::wake::end_requested;
use alight_usv::deck::Closure;
use serde_json::json;

use crate::certificates::RENEWAL_DAYS;
use crate::config::VesselComputer;
use crate::exit::{CliError, Exit};
use crate::process::lateness;
use crate::process::snapshot::time;
use crate::process::supervisor::pause;
use crate::terminal;
use crate::tools::check;
use crate::tools::check::finding::{Finding, Level, Topic};
use crate::tools::status::page::View;
use crate::tools::status::vessel::page;
use crate::tools::status::watch;
use crate::tools::vessel_sources::{estimator, remark, source, strange_datagrams};
use crate::vessel::status_file::{self, CertificateStatus, DeckStatus, HeadingAdvice, VesselStatus};
use crate::vessel::{deck_inputs, helm_lamp};

/// A status older than this is a dead or a frozen process's, s: six of its periods.
pub const STALE_S: f64 = 3.0;
/// A drone reports at 2 Hz; without a report for this long it is out of reach, s.
pub const LOST_CONTACT_S: f64 = 5.0;
/// A turn that takes less than a tenth of the tilt away is not worth it.
const WORTH_TURNING: f64 = 0.9;
/// Shown again this often.
const WATCH_PERIOD: Duration = Duration::from_secs(1);

/// Shows once, or until stopped.
pub fn run(path: &Path, computer: &VesselComputer, view: View, watched: bool) -> Result<Exit, CliError> {
    let mut worst = Level::Fine;
    if watched && view == View::Page && status_file::read(computer).is_some() {
        let mut is_first = true;
        watch::run(|span| {
            if !is_first {
                pause(span);
            }
            is_first = false;
            let status = read(computer)?.filter(|_| !end_requested());
            Ok(status.map(|status| {
                let findings = judge(&status, steady_ns());
                worst = Level::worst(&findings);
                page(&status, &findings)
            }))
        })?;
        return Ok(worst.exit());
    }
    loop {
        let Some(status) = read(computer)? else {
            if view == View::Json {
                terminal::line(json!({ "config": path, "running": false }));
            } else {
                let what = "no vessel's process runs on this computer, or this user may not see it";
                terminal::line(format_args!(
                    "{what}: systemctl status alight-vessel, and sudo -u alight"
                ));
            }
            return Ok(Exit::Failed);
        };
        let findings = judge(&status, steady_ns());
        worst = Level::worst(&findings);
        match view {
            View::Page => terminal::line(page(&status, &findings).text()),
            View::All => {
                terminal::line(title(&status));
                findings.iter().for_each(check::show);
            }
            View::Json => {
                let config: PathBuf = path.into();
                terminal::line(json!({
                    "config": config, "running": true, "worst": worst, "findings": findings, "status": status,
                }));
            }
        }
        if !watched || end_requested() {
            return Ok(worst.exit());
        }
        pause(WATCH_PERIOD);
    }
}

/// The status of this computer's vessel; None: it runs not.
fn read(computer: &VesselComputer) -> Result<Option<VesselStatus>, CliError> {
    let status = status_file::read(computer).transpose();
    status.map_err(|e| CliError(format!("{e}; restart the vessel's process")))
}

fn title(status: &VesselStatus) -> String {
    format!(
        "vessel {}, process {}, up {}, a step takes {} / {} (p50/p99)",
        status.vessel,
        status.process.pid,
        time((status.process.at_ns - status.process.began_ns) as f64 * 1e-9),
        time(status.process.step_s[0]),
        time(status.process.step_s[1]),
    )
}

/// What the status means at `now_ns` of the steady clock.
pub fn judge(status: &VesselStatus, now_ns: i64) -> Vec<Finding> {
    let mut all = vec![process(status, now_ns)];
    all.extend(status.edited.iter().map(|said| {
        Topic("configuration").warning(
            said.clone(),
            "when nothing flies: systemctl restart alight-vessel",
        )
    }));
    all.extend(recorder(status));
    all.extend(late(status));
    all.extend(strange_datagrams(status));
    for s in &status.sources {
        all.push(source(s));
        all.extend(s.remarks.iter().map(|r| remark(&s.name, r)));
    }
    all.extend(estimator(&status.estimator, &status.sources));
    all.push(certificate(&status.certificate));
    all.push(unauthorised_peers(status));
    all.extend(deck(status));
    all.extend(course(&status.deck));
    all.extend(status.estimator.heading.as_ref().map(quiet_heading));
    all.extend(drones(status));
    all
}

fn process(status: &VesselStatus, now_ns: i64) -> Finding {
    let age_s = (now_ns - status.process.at_ns) as f64 * 1e-9;
    if age_s > STALE_S {
        return Topic("process").broken(
            format!("no report for {age_s:.0} s"),
            "it ended or is frozen: systemctl status alight-vessel",
        );
    }
    Topic("process").fine(format!(
        "listens on {}, {:.1} MB sent, {} packets dropped",
        status.listen.join(", "),
        status.process.sent_bytes as f64 * 1e-6,
        status.process.dropped
    ))
}

/// A recorder that the disk refused.
fn recorder(status: &VesselStatus) -> Option<Finding> {
    let steps = status.process.unrecorded;
    (steps > 0).then(|| {
        Topic("recorder").warning(
            format!("{steps} steps not recorded"),
            "the process goes on without; its journal names file and error: free space, or make it writable",
        )
    })
}

/// A computer that does not keep up.
fn late(status: &VesselStatus) -> Option<Finding> {
    let found = status.process.late.clone()?;
    Some(Topic("computer").warning(found, lateness::REMEDY))
}

fn certificate(c: &CertificateStatus) -> Finding {
    const TOPIC: Topic = Topic("certificate");
    match c {
        CertificateStatus::None => TOPIC.warning(
            "none: any peer in reach is accepted",
            "make some with alight keys (docs/radio.md), unless the radio is inside WireGuard",
        ),
        CertificateStatus::Unreadable(e) => TOPIC.broken(e.clone(), "alight check says what to do"),
        CertificateStatus::Held { name, days_left } if *days_left < 0 => TOPIC.broken(
            format!("{name}'s expired {} days ago", -days_left),
            "alight keys vessel NUMBER, copy it here, restart",
        ),
        CertificateStatus::Held { name, days_left } if *days_left < RENEWAL_DAYS => TOPIC.warning(
            format!("{name}'s expires in {days_left} days"),
            "alight keys vessel NUMBER, copy it here, restart",
        ),
        CertificateStatus::Held { name, days_left } => TOPIC.fine(format!("{name}'s, {days_left} days left")),
    }
}

fn unauthorised_peers(status: &VesselStatus) -> Finding {
    if status.rejected.is_empty() {
        return Topic("peers").fine(format!("none rejected; admitted: {}", status.peers.join(", ")));
    }
    let each: Vec<String> = status
        .rejected
        .iter()
        .map(|(why, n)| format!("{n} for {why}"))
        .collect();
    Topic("peers").warning(
        format!(
            "rejected: {}; the last for {}",
            each.join(", "),
            status.rejected_last.as_deref().unwrap_or("-")
        ),
        "a peer without an admitted certificate is in reach: a drone that is not in radio.tls.peers, or an intruder",
    )
}

fn deck(status: &VesselStatus) -> Vec<Finding> {
    const TOPIC: Topic = Topic("deck");
    let deck_owner = status
        .deck_owner
        .map_or_else(|| "free".to_owned(), |id| format!("reserved for drone {id}"));
    let on = if status.occupied { ", occupied" } else { "" };
    let found = format!("{deck_owner}{on}");
    let deck = &status.deck;
    const OPEN: &str = "alight command deck open";
    let mut all = match (deck.closed, deck.owner_age_s) {
        (Some(Closure::Crew), _) => vec![TOPIC.warning(format!("closed by the crew; {found}"), OPEN)],
        (Some(Closure::CheckpointDamaged), _) => vec![TOPIC.warning(
            "closed: the file of who stands on it was damaged",
            format!("look, and once it is empty: {OPEN}"),
        )],
        (Some(Closure::CheckpointMissing), _) => vec![TOPIC.warning(
            "closed: there is no file of who stands on it",
            format!("look, and once it is empty: {OPEN}"),
        )],
        (Some(Closure::CheckpointUnwritable), _) => vec![TOPIC.warning(
            format!("closed: the file of who stands on it cannot be written, and may be old; {found}"),
            format!("free space, or make it writable; look, and once it is empty: {OPEN}"),
        )],
        (Some(Closure::Switch), _) => vec![TOPIC.warning(
            format!("closed by the crew's switch; {found}"),
            "open it at the switch (deck.crew_switch)",
        )],
        (Some(Closure::Sensor), _) => vec![TOPIC.warning(
            format!("closed: by its sensor something lies on it that is no drone; {found}"),
            "look, and take it away (deck.occupancy_sensor)",
        )],
        (None, Some(age_s)) if age_s > LOST_CONTACT_S => vec![TOPIC.warning(
            format!("{found}, silent for {}", time(age_s)),
            format!("it may stand there; once it does not: {OPEN}"),
        )],
        (None, _) => vec![TOPIC.fine(found)],
    };
    all.extend(deck.doubles.iter().map(|id| {
        TOPIC.broken(
            format!("two drones have the number {id}: neither is given the deck"),
            "change bridge.drone_id of one of them",
        )
    }));
    all.extend(deck.starved.iter().map(|s| {
        TOPIC.broken(
            s.to_string(),
            format!("look now: once drone {} is not there: {OPEN}", s.owner),
        )
    }));
    all.extend(deck.follows_another.iter().map(|f| {
        TOPIC.broken(
            format!(
                "drone {} listens to a second computer with this vessel's certificate (boot {:08x})",
                f.drone, f.boot
            ),
            "switch one of the two off: each gives away a deck of its own",
        )
    }));
    all.extend(deck.unplaced.iter().map(|id| {
        TOPIC.warning(
            format!(
                "drone {id} is switched on without a position: it may stand there, and no other is given it"
            ),
            format!("wait for its position; or look, and once it is not there: {OPEN}"),
        )
    }));
    all.extend(deck.aborts.iter().map(|id| {
        TOPIC.warning(
            format!("drone {id} has not acknowledged an abort"),
            "it is repeated until it does",
        )
    }));
    all.extend(
        deck.input_errors
            .iter()
            .map(|e| TOPIC.warning(e, deck_inputs::REMEDY)),
    );
    all.extend(deck.file_error.iter().map(|e| {
        TOPIC.warning(
            format!("its state would not outlive the process: {e}"),
            "free space, or make it writable",
        )
    }));
    all
}

/// What the helm states, and what it is asked for.
fn course(deck: &DeckStatus) -> Vec<Finding> {
    const TOPIC: Topic = Topic("course");
    let stated = match deck.course {
        Course::Unknown => "nothing stated".to_owned(),
        Course::Steady(for_s) => format!("steady for {for_s:.0} s"),
        Course::Turning => "turning".to_owned(),
    };
    let asks = deck.wants_steady && deck.course == Course::Turning;
    let mut all = vec![if asks {
        TOPIC.warning(
            format!("{stated}; a drone waits for a steady course, or breaks its descent off"),
            "keep course and speed, and say so: the helm's switch, or alight command steady",
        )
    } else if deck.wants_steady {
        TOPIC.fine(format!("{stated}; a drone descends: KEEP COURSE AND SPEED"))
    } else {
        TOPIC.fine(stated)
    }];
    all.extend(
        deck.lamp_error
            .iter()
            .map(|e| TOPIC.warning(e, helm_lamp::REMEDY)),
    );
    all
}

/// The heading that the helm may choose before a landing.
fn quiet_heading(h: &HeadingAdvice) -> Finding {
    const TOPIC: Topic = Topic("heading");
    let [now, there] = h.tilt_deg;
    let from = format!("waves from {:03.0} deg", h.waves_from_deg);
    TOPIC.fine(if there < WORTH_TURNING * now {
        format!(
            "{from}; on {:03.0} deg the deck tilts {there:.1} deg, now {now:.1} deg: turn before the landing",
            h.quietest_deg
        )
    } else {
        format!(
            "{from}; {:03.0} deg is as quiet as any, the deck tilts {now:.1} deg",
            h.now_deg
        )
    })
}

fn drones(status: &VesselStatus) -> Vec<Finding> {
    const TOPIC: Topic = Topic("drones");
    if status.drones.is_empty() {
        return vec![TOPIC.warning(
            "none received",
            "is one switched on, in reach, and in radio.tls.peers?",
        )];
    }
    status
        .drones
        .iter()
        .map(|d| {
            let found = format!(
                "drone {}: {}: {}; {}, battery {}, {} ago",
                d.drone,
                d.state,
                d.entered,
                if d.armed { "armed" } else { "disarmed" },
                Charge(d.battery),
                time(d.age_s)
            );
            if let Some(for_s) = d.still_armed_s {
                // Also of a drone that is silent since: whoever goes there has to know.
                let found = format!("drone {}: {}", d.drone, still_armed(for_s));
                TOPIC.broken(
                    found,
                    format!("keep clear of its rotors; reported {} ago", time(d.age_s)),
                )
            } else if d.age_s > LOST_CONTACT_S {
                TOPIC.warning(found, "it is out of reach or switched off")
            } else if d.mission_age_s > LOST_CONTACT_S {
                TOPIC.broken(
                    format!(
                        "drone {}: its mission is silent for {}; before: {}",
                        d.drone,
                        time(d.mission_age_s),
                        d.state
                    ),
                    "its deck stays its own; abort is relayed: alight command abort --drone, or take it over",
                )
            } else {
                TOPIC.fine(found)
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_usv::deck::Starved;
    use alight_usv::followed::FollowsAnother;

    use crate::vessel::status_file::{DroneContact, EstimatorStatus, ProcessStatus, SourceHealth};

    fn status() -> VesselStatus {
        VesselStatus {
            vessel: 1,
            process: ProcessStatus {
                at_ns: 100_000_000_000,
                ..ProcessStatus::default()
            },
            listen: vec!["tls/0.0.0.0:7447".into()],
            peers: vec!["drone-1".into()],
            certificate: CertificateStatus::Held {
                name: "vessel-1".into(),
                days_left: 300,
            },
            rejected: Vec::new(),
            rejected_last: None,
            deck_owner: Some(1),
            occupied: false,
            deck: DeckStatus::default(),
            edited: None,
            drones: vec![DroneContact {
                drone: 1,
                age_s: 0.3,
                state: "Descent".into(),
                entered: "the deck is calm".into(),
                waiting: String::new(),
                mission_age_s: 0.02,
                battery: Some(0.8),
                armed: true,
                still_armed_s: None,
            }],
            estimator: EstimatorStatus {
                sensor_age_s: [Some(0.01), Some(0.1), Some(0.1)],
                estimate_age_s: Some(0.03),
                sd: [0.5, 0.1, 0.005, 0.01],
                motion: vec![[0.1, -0.05, 0.3]],
                waves: Some([0.9, 1.0]),
                heading: None,
                gated: [0; 3],
                restarts: 0,
                rejected: 0,
            },
            sensors_pid: Some(7),
            sources: vec![SourceHealth {
                name: "receiver".into(),
                age_s: Some(0.1),
                good: 900,
                used: 880,
                ..SourceHealth::default()
            }],
        }
    }

    type Change<'a> = &'a dyn Fn(&mut VesselStatus);

    fn worst(status: &VesselStatus, now_s: i64) -> (Level, Vec<&'static str>) {
        let all = judge(status, now_s * 1_000_000_000);
        let worst = all.iter().map(|f| f.level).max().unwrap();
        let at = all.iter().filter(|f| f.level == worst).map(|f| f.topic);
        (worst, at.collect())
    }

    #[test]
    fn vessel_status_of_each_fault() {
        assert_eq!(worst(&status(), 100).0, Level::Fine);
        assert_eq!(worst(&status(), 110), (Level::Broken, vec!["process"]));
        let case = |change: Change<'_>| {
            let mut w = status();
            change(&mut w);
            worst(&w, 100)
        };
        let held = |days_left| CertificateStatus::Held {
            name: "vessel-1".into(),
            days_left,
        };
        let cases: [(Change<'_>, Level, &str); 26] = [
            (&|w| w.deck.closed = Some(Closure::Crew), Level::Warning, "deck"),
            (&|w| w.deck.closed = Some(Closure::Sensor), Level::Warning, "deck"),
            (
                &|w| w.deck.input_errors = vec!["gone".into()],
                Level::Warning,
                "deck",
            ),
            (&|w| w.deck.owner_age_s = Some(60.0), Level::Warning, "deck"),
            (&|w| w.deck.doubles = vec![1], Level::Broken, "deck"),
            (&|w| w.deck.aborts = vec![1], Level::Warning, "deck"),
            (
                &|w| w.deck.follows_another = Some(FollowsAnother { drone: 1, boot: 7 }),
                Level::Broken,
                "deck",
            ),
            (&|w| w.drones[0].mission_age_s = 60.0, Level::Broken, "drones"),
            (&|w| w.deck.unplaced = vec![2], Level::Warning, "deck"),
            (
                &|w| {
                    w.deck.starved = Some(Starved {
                        owner: 1,
                        silent_s: 75.0,
                        waiting: 2,
                        battery: 0.22,
                    });
                },
                Level::Broken,
                "deck",
            ),
            (
                &|w| w.deck.file_error = Some("full".into()),
                Level::Warning,
                "deck",
            ),
            (&|w| w.process.unrecorded = 9, Level::Warning, "recorder"),
            (
                &|w| w.process.late = Some("late".into()),
                Level::Warning,
                "computer",
            ),
            (
                &|w| w.edited = Some("edited".into()),
                Level::Warning,
                "configuration",
            ),
            (
                &|w| w.estimator.sensor_age_s[1] = Some(9.0),
                Level::Broken,
                "sensors",
            ),
            (&|w| w.sources[0].age_s = Some(4.0), Level::Warning, "source"),
            (
                &|w| (w.sources[0].age_s, w.sources[0].why) = (None, Some("no such device".into())),
                Level::Warning,
                "source",
            ),
            (&|w| w.sources[0].is_stuck = true, Level::Broken, "source"),
            (&|w| w.sources[0].mismatched_pulses = 1, Level::Warning, "source"),
            (&|w| w.estimator.estimate_age_s = None, Level::Broken, "estimator"),
            (&|w| w.certificate = held(-2), Level::Broken, "certificate"),
            (&|w| w.certificate = held(10), Level::Warning, "certificate"),
            (
                &|w| w.rejected = vec![("no TLS".into(), 3)],
                Level::Warning,
                "peers",
            ),
            (&|w| w.drones.clear(), Level::Warning, "drones"),
            (&|w| w.drones[0].age_s = 60.0, Level::Warning, "drones"),
            (
                &|w| w.drones[0].still_armed_s = Some(14.0),
                Level::Broken,
                "drones",
            ),
        ];
        for (change, level, topic) in cases {
            assert_eq!(case(change), (level, vec![topic]), "{topic}");
        }
    }

    #[test]
    fn vessel_page_with_each_fault() {
        let lines = |status: &VesselStatus| -> Vec<String> {
            let findings = judge(status, 100 * 1_000_000_000);
            page(status, &findings)
                .text()
                .lines()
                .map(str::to_owned)
                .collect()
        };
        let fine = lines(&status());
        assert_eq!(fine[0], "vessel 1: works, up 100.0 s");
        for part in [
            "deck       reserved for drone 1",
            "drones     drone 1: Descent",
            "alarms     none",
        ] {
            assert!(fine.iter().any(|l| l.starts_with(part)), "{part}: {fine:?}");
        }
        let mut wrong = status();
        wrong.drones[0].still_armed_s = Some(14.0);
        wrong.deck.closed = Some(Closure::Crew);
        wrong.estimator.estimate_age_s = None;
        wrong.certificate = CertificateStatus::None;
        wrong.rejected = vec![("no TLS".into(), 3)];
        wrong.sources[0].is_stuck = true;
        wrong.deck.doubles = vec![1, 2, 3];
        let lines = lines(&wrong);
        assert!(
            lines.len() <= 20 && lines.iter().all(|l| l.chars().count() <= 80),
            "{lines:?}"
        );
        assert!(lines[0].contains("BROKEN"), "{lines:?}");
        assert!(lines.iter().any(|l| l.contains("still ARMED")), "{lines:?}");
    }

    #[test]
    fn vessel_status_file_round_trip() {
        let text = serde_json::to_string(&status()).unwrap();
        assert_eq!(serde_json::from_str::<VesselStatus>(&text).unwrap(), status());
    }
}
