//! `alight status` on the vessel: the status of its process, judged.

use std::path::{Path, PathBuf};
use std::time::Duration;

use alight_shared::msg::{Charge, Closure, Course, DeckStatus, DroneContact, HeadingAdvice, still_armed};
use alight_shared::transport::clock::steady_ns;
use alight_shared::transport::metrics::MetricName;
use alight_shared::transport::wake::end_requested;
use serde_json::json;

use crate::certificates::RENEWAL_DAYS;
use crate::config::VesselComputer;
use crate::exit::{CliError, Exit};
use crate::process::lateness;
use crate::process::observer::Follower;
use crate::process::snapshot::time;
use crate::process::supervisor::pause;
use crate::terminal;
use crate::tools::check;
use crate::tools::check::finding::{Finding, Level, Topic};
use crate::tools::status::page::View;
use crate::tools::status::vessel::page;
use crate::tools::status::watch;
use crate::tools::vessel_sources::{estimator, remark, source};
use crate::vessel::status::{CertificateStatus, STALE_S, Situation};
use crate::vessel::{deck_inputs, helm_lamp};

/// A drone reports at 2 Hz; without a report for this long it is out of reach, s.
pub const LOST_CONTACT_S: f64 = 5.0;
/// A turn that takes less than a tenth of the tilt away is not worth it.
const WORTH_TURNING: f64 = 0.9;
/// Shown again this often.
const WATCH_PERIOD: Duration = Duration::from_secs(1);
/// Reports are looked for so often, at most ...
const MAX_LOOKS: u32 = 40;
/// ... with this pause: in all four times the period of the reports.
const LOOK_PAUSE: Duration = Duration::from_millis(50);

/// Shows once, or until stopped.
pub fn run(path: &Path, computer: &VesselComputer, view: View, watched: bool) -> Result<Exit, CliError> {
    let mut worst = Level::Fine;
    let mut aboard = Follower::of(&computer.instance, "status")?;
    if watched && view == View::Page && aboard.poll().is_some() {
        let mut is_first = true;
        watch::run(|span| {
            if !is_first {
                pause(span);
            }
            is_first = false;
            let status = read(computer, &mut aboard)?.filter(|_| !end_requested());
            Ok(status.map(|status| {
                let findings = judge(&status, steady_ns());
                worst = Level::worst(&findings);
                page(&status, &findings)
            }))
        })?;
        return Ok(worst.exit());
    }
    loop {
        let Some(status) = read(computer, &mut aboard)? else {
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

/// What is known of this computer's vessel once its processes have reported; None: it runs not.
fn read(computer: &VesselComputer, aboard: &mut Follower) -> Result<Option<Situation>, CliError> {
    let certificate = CertificateStatus::of(computer);
    for look in 0..MAX_LOOKS {
        let Some((_, seen)) = aboard.poll() else {
            return Ok(None);
        };
        let situation = Situation::of(computer, &certificate, seen, steady_ns());
        let all = |s: &Situation| s.sources.len() == computer.sensor.sources.len();
        if situation
            .as_ref()
            .is_some_and(|s| all(s) || look + 1 == MAX_LOOKS)
        {
            return Ok(situation);
        }
        pause(LOOK_PAUSE);
    }
    Err(CliError(
        "the vessel's process does not report; its journal says why: journalctl -u alight-vessel".into(),
    ))
}

fn title(status: &Situation) -> String {
    format!(
        "vessel {}, process {}, up {}, a step takes {} / {} (p50/p99)",
        status.vessel,
        status.process.pid,
        time((status.process.at_ns - status.process.began_ns) as f64 * 1e-9),
        time(status.process.step_p50_s),
        time(status.process.step_p99_s),
    )
}

/// What the status means at `now_ns` of the steady clock.
pub fn judge(status: &Situation, now_ns: i64) -> Vec<Finding> {
    let mut all = vec![process(status, now_ns)];
    all.extend(status.edited.iter().map(|said| {
        Topic("configuration").warning(
            said.clone(),
            "when nothing flies: systemctl restart alight-vessel",
        )
    }));
    all.extend(recorder(status));
    all.extend(late(status));
    for s in &status.sources {
        all.push(source(s));
        all.extend(s.report.remarks.iter().map(|r| remark(&s.name, r)));
    }
    all.extend(estimator(&status.status.estimator, &status.sources));
    all.push(certificate(&status.certificate));
    all.push(unauthorised_peers(status));
    all.extend(deck(status));
    all.extend(course(&status.status.deck));
    all.extend(status.status.estimator.heading.as_ref().map(quiet_heading));
    all.extend(drones(status));
    all
}

fn process(status: &Situation, now_ns: i64) -> Finding {
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
        status.process.count(MetricName::BytesSent) as f64 * 1e-6,
        status.process.count(MetricName::PacketsDropped)
    ))
}

/// A recorder that the disk refused.
fn recorder(status: &Situation) -> Option<Finding> {
    let steps = status.process.count(MetricName::StepsUnrecorded);
    (steps > 0).then(|| {
        Topic("recorder").warning(
            format!("{steps} steps not recorded"),
            "the process goes on without; its journal names file and error: free space, or make it writable",
        )
    })
}

/// A computer that does not keep up.
fn late(status: &Situation) -> Option<Finding> {
    let found = lateness::finding(&status.process)?;
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

fn unauthorised_peers(status: &Situation) -> Finding {
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

fn deck(status: &Situation) -> Vec<Finding> {
    const TOPIC: Topic = Topic("deck");
    let status = &status.status;
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
            .map(|e| TOPIC.warning(e.as_str(), deck_inputs::REMEDY)),
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
            .map(|e| TOPIC.warning(e.as_str(), helm_lamp::REMEDY)),
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

fn drones(status: &Situation) -> Vec<Finding> {
    const TOPIC: Topic = Topic("drones");
    let drones = &status.status.drones;
    if drones.is_empty() {
        return vec![TOPIC.warning(
            "none received",
            "is one switched on, in reach, and in radio.tls.peers?",
        )];
    }
    drones
        .iter()
        .map(|DroneContact { age_s, status: d }| {
            let (age_s, mission_age_s) = (*age_s, f64::from(d.mission_age_s));
            let (drone, state) = (d.header.drone, d.state.name());
            let found = format!(
                "drone {drone}: {state}: {}; {}, battery {}, {} ago",
                d.entered,
                if d.armed { "armed" } else { "disarmed" },
                Charge(d.battery),
                time(age_s)
            );
            if let Some(for_s) = d.still_armed_s {
                // Also of a drone that is silent since: whoever goes there has to know.
                let found = format!("drone {drone}: {}", still_armed(for_s));
                TOPIC.broken(
                    found,
                    format!("keep clear of its rotors; reported {} ago", time(age_s)),
                )
            } else if age_s > LOST_CONTACT_S {
                TOPIC.warning(found, "it is out of reach or switched off")
            } else if mission_age_s > LOST_CONTACT_S {
                TOPIC.broken(
                    format!(
                        "drone {drone}: its mission is silent for {}; before: {state}",
                        time(mission_age_s)
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
    use alight_shared::msg::{
        DroneStatus, EstimatorStatus, FollowsAnother, Header, Seq, SourceUse, Starved, State, VesselStatus,
    };
    use alight_shared::transport::metrics::Metric;
    use alight_shared::transport::process::{ProcessKind, ProcessState};

    use crate::vessel::status::SourceHealth;

    fn status() -> Situation {
        let drone = DroneStatus {
            header: Header::new(1, 1, 7, 1, alight_shared::time::Time::EPOCH),
            state: State::Descent,
            mission_age_s: 0.02,
            battery: Some(0.8),
            armed: true,
            ..DroneStatus::default()
        };
        Situation {
            vessel: 1,
            process: ProcessState {
                kind: ProcessKind::Vessel,
                at_ns: 100_000_000_000,
                ..ProcessState::default()
            },
            listen: vec!["tls/0.0.0.0:7447".into()],
            peers: vec!["drone-1".into()],
            certificate: CertificateStatus::Held {
                name: "vessel-1".into(),
                days_left: 300,
            },
            rejected: Vec::new(),
            rejected_last: None,
            edited: None,
            sensors_pid: Some(7),
            sources: vec![SourceHealth {
                name: "receiver".into(),
                age_s: Some(0.1),
                uses: SourceUse {
                    used: 880,
                    ..SourceUse::default()
                },
                ..SourceHealth::default()
            }],
            status: VesselStatus {
                deck_owner: Some(1),
                drones: Seq::filled([DroneContact {
                    age_s: 0.3,
                    status: drone,
                }]),
                estimator: EstimatorStatus {
                    sensor_age_s: [Some(0.01), Some(0.1), Some(0.1)],
                    estimate_age_s: Some(0.03),
                    sd: [0.5, 0.1, 0.005, 0.01],
                    waves: Some([0.9, 1.0]),
                    ..EstimatorStatus::default()
                },
                ..VesselStatus::default()
            },
        }
    }
    fn measured(w: &mut Situation, metrics: &[Metric]) {
        w.process.metrics = Seq::filled(metrics.iter().copied());
    }

    type Change<'a> = &'a dyn Fn(&mut Situation);

    fn worst(status: &Situation, now_s: i64) -> (Level, Vec<&'static str>) {
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
            (
                &|w| w.status.deck.closed = Some(Closure::Crew),
                Level::Warning,
                "deck",
            ),
            (
                &|w| w.status.deck.closed = Some(Closure::Sensor),
                Level::Warning,
                "deck",
            ),
            (
                &|w| w.status.deck.input_errors = Seq::filled(["gone".into()]),
                Level::Warning,
                "deck",
            ),
            (
                &|w| w.status.deck.owner_age_s = Some(60.0),
                Level::Warning,
                "deck",
            ),
            (
                &|w| w.status.deck.doubles = Seq::filled([1]),
                Level::Broken,
                "deck",
            ),
            (
                &|w| w.status.deck.aborts = Seq::filled([1]),
                Level::Warning,
                "deck",
            ),
            (
                &|w| w.status.deck.follows_another = Some(FollowsAnother { drone: 1, boot: 7 }),
                Level::Broken,
                "deck",
            ),
            (
                &|w| w.status.drones[0].status.mission_age_s = 60.0,
                Level::Broken,
                "drones",
            ),
            (
                &|w| w.status.deck.unplaced = Seq::filled([2]),
                Level::Warning,
                "deck",
            ),
            (
                &|w| {
                    w.status.deck.starved = Some(Starved {
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
                &|w| w.status.deck.file_error = Some("full".into()),
                Level::Warning,
                "deck",
            ),
            (
                &|w| measured(w, &[MetricName::StepsUnrecorded.count(9_u32)]),
                Level::Warning,
                "recorder",
            ),
            (
                &|w| {
                    measured(
                        w,
                        &[
                            MetricName::LateSteps.count(1_u32),
                            MetricName::LongestStep.seconds(2.0),
                        ],
                    )
                },
                Level::Warning,
                "computer",
            ),
            (
                &|w| w.edited = Some("edited".into()),
                Level::Warning,
                "configuration",
            ),
            (
                &|w| w.status.estimator.sensor_age_s[1] = Some(9.0),
                Level::Broken,
                "sensors",
            ),
            (&|w| w.sources[0].age_s = Some(4.0), Level::Warning, "source"),
            (
                &|w| (w.sources[0].age_s, w.sources[0].report.why) = (None, Some("no such device".into())),
                Level::Warning,
                "source",
            ),
            (&|w| w.sources[0].uses.is_stuck = true, Level::Broken, "source"),
            (
                &|w| w.sources[0].report.status.decoded.mismatched_pulses = 1,
                Level::Warning,
                "source",
            ),
            (
                &|w| w.status.estimator.estimate_age_s = None,
                Level::Broken,
                "estimator",
            ),
            (&|w| w.certificate = held(-2), Level::Broken, "certificate"),
            (&|w| w.certificate = held(10), Level::Warning, "certificate"),
            (
                &|w| w.rejected = vec![("no TLS".into(), 3)],
                Level::Warning,
                "peers",
            ),
            (&|w| w.status.drones = Seq::new(), Level::Warning, "drones"),
            (&|w| w.status.drones[0].age_s = 60.0, Level::Warning, "drones"),
            (
                &|w| w.status.drones[0].status.still_armed_s = Some(14.0),
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
        let lines = |status: &Situation| -> Vec<String> {
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
        wrong.status.drones[0].status.still_armed_s = Some(14.0);
        wrong.status.deck.closed = Some(Closure::Crew);
        wrong.status.estimator.estimate_age_s = None;
        wrong.certificate = CertificateStatus::None;
        wrong.rejected = vec![("no TLS".into(), 3)];
        wrong.sources[0].uses.is_stuck = true;
        wrong.status.deck.doubles = Seq::filled([1, 2, 3]);
        let lines = lines(&wrong);
        assert!(
            lines.len() <= 20 && lines.iter().all(|l| l.chars().count() <= 80),
            "{lines:?}"
        );
        assert!(lines[0].contains("BROKEN"), "{lines:?}");
        assert!(lines.iter().any(|l| l.contains("still ARMED")), "{lines:?}");
    }
}
