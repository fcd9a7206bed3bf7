//! Findings, state and figures of the vessel's computer.

use alight_computer::{
    process::snapshot::time,
    situation::ObservedSituation,
    vessel::{deck_inputs, helm_lamp},
};
use alight_shared::{
    metrics::MetricName,
    msg::{
        CertificateState, Charge, Closure, Course, CourseAdvice, DeckMotion, DeckStatus, DroneContact,
        DroneStatus, EstimatorStatus, State, TwoDigits, VesselReport, VesselStatus, still_armed,
    },
    process::ProcessKind,
};
use alight_usv::sensors::UNWITNESSED;

use super::{
    ARMED_REMEDY, Figure, LOST_CONTACT_S, StateView, certificate, compass, course,
    finding::{Finding, FindingLevel, FindingTopic},
    go,
    go::Go,
    processes,
    sources::{self, MISSING_S, estimator, source},
};

pub fn findings(s: &ObservedSituation, known: &VesselReport, status: &VesselStatus) -> Vec<Finding> {
    let sources = s.sources();
    let mut all = vec![radio(s, known)];
    all.extend(sources.iter().flat_map(sources::of));
    all.extend(estimator(&status.estimator, &sources));
    all.push(match &known.certificate {
        CertificateState::Absent => certificate::none(endpoints(known)),
        CertificateState::Read(certificate) => certificate::judge(Ok(certificate)),
        CertificateState::Unreadable(why) => certificate::judge(Err(why.as_str())),
    });
    all.push(unauthorised_peers(s, known));
    all.extend(deck(status));
    all.extend(beyond_limits(&status.estimator.greatest, &known.limits));
    all.extend(course_findings(&status.deck));
    all.extend(compass::advised_aboard(status).map(|a| advised_course(&a, s.known.knots)));
    all.extend(drones(status));
    all
}

/// Endpoints of the radio. An endpoint that did not fit into the report counts as reachable from outside, the worst
/// case.
fn endpoints(known: &VesselReport) -> impl Iterator<Item = &str> + Clone {
    let is_whole = known.listen.left_out == 0 && known.connect.left_out == 0;
    let reported = known.listen.iter().chain(known.connect.iter());
    reported.chain((!is_whole).then_some("left out"))
}

fn radio(s: &ObservedSituation, known: &VesselReport) -> Finding {
    let count = |name| s.process(ProcessKind::Vessel).map_or(0, |p| p.count(name));
    FindingTopic("radio").fine(format!(
        "listens on {}, {:.1} MB sent, {} packets dropped",
        known.listen,
        count(MetricName::BytesSent) as f64 * 1e-6,
        count(MetricName::PacketsDropped)
    ))
}

fn unauthorised_peers(s: &ObservedSituation, known: &VesselReport) -> Finding {
    let rejected = s.rejected();
    if rejected.is_empty() {
        return FindingTopic("peers").fine(format!("none rejected; admitted: {}", known.peers));
    }
    let each: Vec<String> = rejected.iter().map(|(why, n)| format!("{n} for {why}")).collect();
    FindingTopic("peers").warning(
        format!(
            "rejected: {}; the last for {}",
            each.join(", "),
            s.rejected_last().unwrap_or("-")
        ),
        "a peer without an admitted certificate is in reach: a drone that is not in radio.tls.peers, or an intruder",
    )
}

fn owner(status: &VesselStatus) -> String {
    let owner = status.deck_owner;
    let owner = owner.map_or_else(|| "free".to_owned(), |id| format!("reserved for drone {id}"));
    let on = if status.occupied { ", occupied" } else { "" };
    format!("{owner}{on}")
}

const DECK: FindingTopic = FindingTopic("deck");
const OPEN_DECK: &str = "alight order deck open";

fn deck_access(status: &VesselStatus) -> Finding {
    let found = owner(status);
    let deck = &status.deck;
    match (deck.closed, deck.owner_age_s) {
        (Some(Closure::Crew), _) => DECK.stopping(format!("closed by the crew; {found}"), OPEN_DECK),
        (Some(Closure::CheckpointDamaged), _) => DECK.stopping(
            "closed: the file of the drones on it is damaged",
            format!("look at the deck; once it is empty: {OPEN_DECK}"),
        ),
        (Some(Closure::CheckpointMissing), _) => DECK.stopping(
            "closed: the file of the drones on it is missing",
            format!("look at the deck; once it is empty: {OPEN_DECK}"),
        ),
        (Some(Closure::CheckpointUnwritable), _) => DECK.stopping(
            format!("closed: the file of the drones on it cannot be written, and may be old; {found}"),
            format!("free space, or make it writable; look at the deck, and once it is empty: {OPEN_DECK}"),
        ),
        (Some(Closure::Switch), _) => DECK.stopping(
            format!("closed by the crew's switch; {found}"),
            "open it at the switch (deck.crew_switch)",
        ),
        (Some(Closure::Sensor), _) => DECK.stopping(
            format!("closed: its sensor detects an object that is not a drone; {found}"),
            "look at the deck, and remove the object (deck.occupancy_sensor)",
        ),
        (None, Some(age_s)) if age_s > LOST_CONTACT_S => DECK.stopping(
            format!("{found}, silent for {}", time(age_s)),
            format!("it may be on the deck; once it has left: {OPEN_DECK}"),
        ),
        (None, _) => DECK.fine(found),
    }
}

fn deck(status: &VesselStatus) -> Vec<Finding> {
    let deck = &status.deck;
    let mut all = vec![deck_access(status)];
    all.extend(deck.doubles.iter().map(|id| {
        DECK.broken(
            format!("two drones have the number {id}: neither is given the deck"),
            "change bridge.drone_id of one of them",
        )
    }));
    all.extend(deck.starved.iter().map(|s| {
        DECK.broken(
            s.to_string(),
            format!(
                "look at the deck now; once drone {} is not on it: {OPEN_DECK}",
                s.owner
            ),
        )
    }));
    all.extend(deck.follows_another.iter().map(|f| {
        DECK.broken(
            format!(
                "drone {} listens to a second computer with this vessel's certificate (boot {:08x})",
                f.drone, f.boot
            ),
            "switch one of the two off: each reserves the deck on its own",
        )
    }));
    all.extend(deck.unplaced.iter().map(|id| {
        DECK.stopping(
            format!(
                "drone {id} is switched on without a position: it may be on the deck, which is given to no other drone"
            ),
            format!("wait for its position; or look, and once it is not on the deck: {OPEN_DECK}"),
        )
    }));
    all.extend(deck.aborts.iter().map(|id| {
        DECK.stopping(
            format!("drone {id} has not acknowledged an abort"),
            "it is repeated until it does",
        )
    }));
    all.extend(
        deck.input_errors
            .iter()
            .map(|e| DECK.warning(e.as_str(), deck_inputs::REMEDY)),
    );
    all.extend(deck.file_error.iter().map(|e| {
        DECK.warning(
            format!("its state cannot be saved for a restart: {e}"),
            "free space, or make it writable",
        )
    }));
    all
}

fn course_findings(deck: &DeckStatus) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("course");
    let stated = course(deck.course);
    let turns = deck.wants_steady && deck.course == Course::Turning;
    let mut all = vec![if turns {
        TOPIC.stopping(
            format!("{stated}; a drone waits for a steady course, or aborts its descent"),
            "keep course and speed, and confirm: the helm's switch, or alight order steady",
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

fn advised_course(a: &CourseAdvice, knots: bool) -> Finding {
    FindingTopic("heading").fine(compass::advice(a, knots))
}

/// Name of the drones' figures, each of which has a separate level.
pub const DRONES: &str = "drones";

pub fn drone(d: &DroneStatus) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("drones");
    let number = d.header.drone;
    if let Some(for_s) = d.still_armed_s {
        return TOPIC.broken(format!("drone {number}: {}", still_armed(for_s)), ARMED_REMEDY);
    }
    if !d.is_current() {
        return TOPIC.broken(
            format!(
                "drone {number}: its mission is silent for {}; before: {}",
                time(d.mission_age_s.into()),
                d.state.name()
            ),
            "the deck stays reserved for it; abort is relayed: alight order abort --drone, or take manual control",
        );
    }
    let armed = if d.armed { "armed" } else { "disarmed" };
    let state = d.state.because(&d.entered);
    let found = format!("drone {number}: {state}; {armed}, battery {}", Charge(d.battery));
    if d.state == State::StandDown {
        return TOPIC.warning(
            found,
            "stand clear; if it stays armed, disarm it by remote control",
        );
    }
    if d.state.starts_motors() {
        return TOPIC.warning(found, "stand clear; alight order abort stops it");
    }
    TOPIC.fine(found)
}

fn drones(status: &VesselStatus) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("drones");
    if status.drones.is_empty() {
        let remedy = "check that it is switched on, in radio reach and in radio.tls.peers";
        return vec![TOPIC.warning("none received", remedy)];
    }
    status.drones.iter().map(contact_finding).collect()
}

fn contact_finding(c: &DroneContact) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("drones");
    let found = drone(&c.status);
    let lost = c.age_s > LOST_CONTACT_S;
    // A silent armed drone remains an alarm for anyone who approaches it.
    let found = match c.status.still_armed_s {
        None if lost => TOPIC.warning(found.found, "it is out of reach or switched off"),
        None | Some(_) => found,
    };
    Finding {
        found: format!("{}, {} ago", found.found, time(c.age_s)),
        ..found
    }
}

/// Drone that owns the deck, otherwise the drone received last.
fn foremost(status: &VesselStatus) -> Option<&DroneContact> {
    let owner = status
        .drones
        .iter()
        .find(|d| Some(d.status.header.drone) == status.deck_owner);
    let newest = status.drones.iter().min_by(|a, b| a.age_s.total_cmp(&b.age_s));
    owner.or(newest)
}

/// Whether a landing may be ordered according to the vessel's own state.
pub fn own_go(findings: &[Finding], status: &VesselStatus) -> Go {
    let own = findings.iter().filter(|f| f.topic != DRONES);
    let own: Vec<Finding> = own.cloned().collect();
    Go::of(&own, no_waves(status))
}

/// Judgement of a descent or of its end by the foremost drone's report; before a descent, the worse of the vessel's
/// own judgement and the drone's.
pub fn go(findings: &[Finding], status: &VesselStatus) -> Go {
    let foremost = foremost(status).filter(|d| d.age_s <= LOST_CONTACT_S);
    if let Some(d) = foremost.map(|d| d.status) {
        let acts = |f: &&Finding| f.stops && ["course", DRONES].contains(&f.topic);
        let alarm = findings.iter().find(acts);
        let number = d.header.drone;
        let course = go::descends(d.state).then(|| "keep course and speed".into());
        if let Some(answer) = Go::answer(&d, alarm, course) {
            let why = match answer.verdict {
                "ACT" => answer.why,
                _ => format!("drone {number}: {}", answer.why),
            };
            return Go { why, ..answer };
        }
    }
    Go::of(findings, no_waves(status)).worse(foremost_go(status))
}

fn no_waves(status: &VesselStatus) -> Option<&'static str> {
    match status.estimator.waves {
        Some([_, quality]) => go::no_forecast(quality),
        None => Some("the waves are not known yet"),
    }
}

/// Judgement by the foremost drone's report; None if nothing in it forbids an order.
fn foremost_go(status: &VesselStatus) -> Option<Go> {
    let Some(d) = foremost(status) else {
        return Some(Go::unknown("no drone is received"));
    };
    let number = d.status.header.drone;
    if d.age_s > LOST_CONTACT_S {
        let ago = time(d.age_s);
        return Some(Go::unknown(format!("drone {number} was received {ago} ago")));
    }
    if let Some(why) = go::barred(d.status.state, &d.status.entered) {
        return Some(Go::barred(format!("drone {number}: {why}")));
    }
    let windless = d.status.wind.is_none();
    windless.then(|| Go::unknown(format!("drone {number}: {}", go::NO_WIND)))
}

/// Wind, north and east, and gust that the foremost drone reports, m/s.
pub fn blowing(status: &VesselStatus) -> Option<([f64; 2], Option<f64>)> {
    let newest = foremost(status).filter(|d| d.age_s <= LOST_CONTACT_S)?.status;
    Some((newest.wind?.map(f64::from), newest.gust_mps.map(f64::from)))
}

pub fn state(s: &ObservedSituation, status: &VesselStatus) -> Option<StateView> {
    let d = foremost(status)?;
    let name = d.status.state.named(&d.status.entered);
    let name = format!("Drone {}: {name}", d.status.header.drone);
    let stale = !s.reports(ProcessKind::Vessel) || d.age_s > LOST_CONTACT_S;
    Some(go::view(&d.status, name, 0.0, stale))
}

pub fn headline(s: &ObservedSituation, worst: FindingLevel) -> String {
    let state = match worst {
        FindingLevel::Fine => "works",
        FindingLevel::Warning => "works, with warnings",
        FindingLevel::Broken => "BROKEN",
    };
    let up = s.process(ProcessKind::Vessel);
    let up = up.map_or("-".into(), |p| time((p.at_ns - p.began_ns) as f64 * 1e-9));
    format!("{state}, up {up}")
}

pub fn figures(s: &ObservedSituation, known: &VesselReport, status: &VesselStatus) -> Vec<Figure> {
    let mut all = vec![if status.deck.closed.is_some() {
        Figure::of("deck", "CLOSED", owner(status))
    } else {
        Figure::of("deck", owner(status), "")
    }];
    all.extend(status.drones.iter().map(contact));
    let keep = if status.deck.wants_steady {
        "KEEP COURSE AND SPEED"
    } else {
        ""
    };
    all.push(Figure::of("course", course(status.deck.course), keep));
    all.extend(compass::advised_aboard(status).map(|a| compass::figure(&a, s.known.knots)));
    all.push(speed(&status.estimator, s.known.knots));
    all.extend(motion(&status.estimator));
    all.extend(greatest(&status.estimator));
    let sources = s.sources();
    if !sources.is_empty() {
        let working = sources.iter().filter(|s| source(s).level == FindingLevel::Fine);
        let value = format!("{} of {} work", working.count(), sources.len());
        let mut remarks = sources.iter().flat_map(|s| s.report.remarks.iter());
        let unwitnessed = remarks.find(|r| r.text.as_str().contains(UNWITNESSED));
        all.push(Figure::of(
            "source",
            value,
            unwitnessed.map_or("", |r| r.text.as_str()),
        ));
    }
    if let Some(c) = known.certificate.read() {
        let value = format!("{} days left", c.days_left);
        all.push(Figure::of("certificate", value, c.name.as_str()));
    }
    all.extend(processes(s));
    let old = !s.reports(ProcessKind::Vessel);
    all.into_iter()
        .map(|f| Figure {
            stale: f.stale || old,
            ..f
        })
        .collect()
}

fn contact(d: &DroneContact) -> Figure {
    let status = &d.status;
    let armed = if status.armed { "armed" } else { "disarmed" };
    let value = format!(
        "drone {}: {}",
        status.header.drone,
        status.state.named(&status.entered)
    );
    let away = status
        .deck_distance_m
        .map(|m| format!("{} m from the deck, ", TwoDigits(m.into())));
    let note = format!(
        "{}{armed}, battery {}, {} ago",
        away.unwrap_or_default(),
        Charge(status.battery),
        time(d.age_s)
    );
    Figure {
        level: contact_finding(d).level,
        ..Figure::of(DRONES, value, note)
    }
    .stale(d.age_s > LOST_CONTACT_S)
}

fn speed(e: &EstimatorStatus, knots: bool) -> Figure {
    let known = e.mean_velocity.filter(|_| is_recent(e));
    known.map_or(Figure::unknown("speed"), |velocity| {
        let (speed, course) = compass::speed(velocity, knots);
        let note = course.map_or("no course over ground".to_owned(), |deg| {
            format!("course over ground {deg:03.0} deg")
        });
        Figure::of("speed", speed, note)
    })
}

/// First of the crew's limits that the deck's motion of the last 20 minutes exceeds.
fn beyond_limits(m: &DeckMotion, limits: &DeckMotion) -> Option<Finding> {
    let deg = 1f64.to_radians();
    let rows = [
        ("roll", m.roll, limits.roll, deg, "deg"),
        ("pitch", m.pitch, limits.pitch, deg, "deg"),
        ("inclination", m.inclination, limits.inclination, deg, "deg"),
        (
            "significant heave rate",
            m.heave_rate,
            limits.heave_rate,
            1.0,
            "m/s",
        ),
    ];
    let mut beyond = rows.iter().filter(|(_, value, limit, ..)| value > limit);
    let (name, value, limit, scale, unit) = beyond.next()?;
    Some(FindingTopic("greatest").stopping(
        format!(
            "{name} {:.1} {unit} in the last 20 min, limit {:.1}",
            value / scale,
            limit / scale
        ),
        "wait for less motion, or take the advised course; the crew's limits are in [limits]",
    ))
}

fn greatest(e: &EstimatorStatus) -> Option<Figure> {
    let m = &e.greatest;
    if m.samples == 0 {
        return None;
    }
    let [roll, pitch, inclination] = [m.roll, m.pitch, m.inclination].map(f64::to_degrees);
    let note = format!(
        "inclination {inclination:.1}°, significant heave rate {:.1} m/s",
        m.heave_rate
    );
    Some(Figure::of(
        "greatest",
        format!("roll {roll:.1}°, pitch {pitch:.1}°"),
        note,
    ))
}

fn is_recent(e: &EstimatorStatus) -> bool {
    e.estimate_age_s.is_some_and(|s| s <= MISSING_S)
}

fn motion(e: &EstimatorStatus) -> [Figure; 2] {
    let waves = e.waves.map(|[height_m, quality]| {
        let note = format!("forecast quality {:.0} %", 100.0 * quality);
        Figure::of("waves", format!("{height_m:.1} m"), note)
    });
    let estimate = e.estimate_age_s.filter(|_| is_recent(e)).map(|age_s| {
        let [place, height, ..] = e.sd;
        let note = format!("position +- {place:.1} m, height {height:.1} m");
        Figure::of("estimator", format!("{} old", time(age_s)), note)
    });
    [
        waves.unwrap_or(Figure::unknown("waves")),
        estimate.unwrap_or(Figure::unknown("estimator")),
    ]
}

#[cfg(test)]
mod tests;
