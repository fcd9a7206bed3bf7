//! Findings, state and figures of the drone's computer.

use alight_computer::{
    io::mavlink_key,
    process::snapshot::{minutes, time},
    situation::ObservedSituation,
};
use alight_shared::{
    geodesy::Datum,
    geometry::GRAVITY,
    metrics::MetricName,
    msg::{
        AttitudeResponse, AutopilotState, CarrierSolution, DECK_CLOSED, DeckStage, DroneStatus, LandedState,
        LandingMode, MissionState, ReasonCode, ShadowComparison, State, TwoDigits, VesselLevel, Wind,
        still_armed,
    },
    process::{ProcessKind, ProcessState},
    time::Time,
    topics,
};
use alight_uav::mission::MAX_VESSEL_DISTANCE_M;

use crate::explain::advice;

use super::{
    ARMED_REMEDY, Figure, StateView, compass, course,
    finding::{Finding, FindingLevel, FindingTopic},
    go,
    go::Go,
    processes,
};

/// Age of the vessel's estimate above which a warning is given, as a fraction of its topic's limit.
const OLD_LINK: f64 = 0.5;
/// Maximum age of a detection whose tags count as in view, s.
const FRESH_TAGS_S: f64 = 1.0;

pub fn findings(s: &ObservedSituation) -> Vec<Finding> {
    let mut all = Vec::new();
    if let Some(for_s) = s.still_armed_s() {
        all.push(FindingTopic("armed").broken(still_armed(for_s as f32), ARMED_REMEDY));
    }
    all.extend(
        s.snapshot
            .mission
            .as_ref()
            .into_iter()
            .flat_map(|m| mission(s, m)),
    );
    let autopilot = s.snapshot.autopilot.fresh(s.now_ns);
    if let Some(a) = autopilot {
        const TOPIC: FindingTopic = FindingTopic("autopilot");
        if a.rejection.code != ReasonCode::None {
            let found = format!("no landing: {}", a.rejection);
            all.push(TOPIC.stopping(found, advice(a.rejection.code)));
        }
    }
    if let Some(p) = s.process(ProcessKind::Autopilot)
        && let Some((signatures, remedy_of_signatures)) =
            mavlink_key::counts(&p.metrics).finding(autopilot.is_some())
    {
        all.push(FindingTopic("signatures").warning(signatures, remedy_of_signatures));
    }
    if let Some(tag) = s.process(ProcessKind::Camera).and_then(ProcessState::foreign_tag) {
        all.push(FindingTopic("camera").warning(tag.to_string(), tag.remedy()));
    }
    all.extend(parked(s));
    all.extend(link(s));
    all.extend(battery_low(s));
    if s.snapshot
        .grant
        .fresh(s.now_ns)
        .is_some_and(|g| g.owner == DECK_CLOSED)
    {
        let remedy = "its crew opens it: alight order deck open";
        all.push(FindingTopic("deck").stopping("closed by the vessel: no drone may descend", remedy));
    }
    let vessel = (*s.snapshot.grant).and_then(|g| g.dimensions);
    if let Some(why) = s.known.deck.and_then(|own| own.differs_from(&vessel?)) {
        let found = format!("no descent: {why}");
        all.push(FindingTopic("deck").stopping(found, advice(why.code)));
    }
    let relative = s.snapshot.forecast.fresh(s.now_ns).and_then(|f| f.relative);
    if let Some(m) = relative.and_then(|r| r.contradicted_m) {
        let found = format!("the moving-base position differs from the tags by {m:.2} m and is not used");
        let remedy =
            "if this persists, check drone.airframe.gnss_antenna_m and the mount of the vessel's receiver";
        all.push(FindingTopic("relative").warning(found, remedy));
    }
    // Known since the start, so what has just been lost comes first.
    if let Some(a) = autopilot
        && a.warning.code != ReasonCode::None
    {
        all.push(FindingTopic("autopilot").warning(a.warning.to_string(), advice(a.warning.code)));
    }
    all.extend(s.snapshot.frame().map(frame));
    all
}

/// Finding on a mission that is silent, has ended, was aborted, or waits for its operator.
fn mission(s: &ObservedSituation, m: &MissionState) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("mission");
    if s.snapshot.mission.is_old(s.now_ns) {
        let age = minutes(s.snapshot.mission.age_s(s.now_ns));
        let found = format!("no message from the mission for {age}");
        return vec![TOPIC.broken(found, "it restarts by itself; otherwise take manual control")];
    }
    let mut all = Vec::new();
    let entered = format!("the drone is in state {}", m.state.because(&m.entered));
    let failed = m.state.named(&m.entered) == State::GaveUp.name();
    if failed {
        all.push(TOPIC.broken(entered, advice(m.entered.code)));
    } else if m.state == State::GaveUp && m.entered.code == ReasonCode::Matched {
        // A completed match is a success.
    } else if m.was_entered_in_trouble() {
        all.push(TOPIC.stopping(entered, advice(m.entered.code)));
    }
    if m.waits_in_trouble() {
        let found = format!("the mission waits: {}", m.waiting);
        all.push(TOPIC.stopping(found, advice(m.waiting.code)));
    }
    all
}

fn link(s: &ObservedSituation) -> Vec<Finding> {
    const TOPIC: FindingTopic = FindingTopic("link");
    let (Some(l), Some(age_s)) = (*s.snapshot.link, s.link_age_s()) else {
        return Vec::new();
    };
    let limit_s = topics::ESTIMATE.stale_after.secs();
    let found = format!("the vessel's newest estimate is {} old", time(age_s));
    let remedy = "is alight-vessel running, its radio in reach, its certificate admitted?";
    let otherwise = known_otherwise(s);
    let mut all = vec![if let (true, Some(by)) = (age_s.is_infinite(), otherwise) {
        TOPIC.warning(
            format!("no vessel received yet: it is located by its {by} alone"),
            remedy,
        )
    } else if age_s.is_infinite() {
        TOPIC.stopping("no vessel received yet", remedy)
    } else if let (true, Some(by)) = (age_s > limit_s, otherwise) {
        TOPIC.warning(format!("{found}: it is located by its {by} alone"), remedy)
    } else if age_s > limit_s && landing_without_radio(s) {
        TOPIC.warning(found, remedy)
    } else if age_s > limit_s {
        TOPIC.broken(found, remedy)
    } else if age_s > OLD_LINK * limit_s {
        TOPIC.warning(found, remedy)
    } else {
        TOPIC.fine(found)
    }];
    let bridge = s.snapshot.processes.get(&ProcessKind::Bridge);
    let has_session = bridge.is_some_and(|p| p.count(MetricName::VesselSession) > 0);
    if age_s > limit_s && has_session {
        let remedy = "run alight status on its computer: does its estimator run?";
        all.push(TOPIC.warning(
            "the vessel's Zenoh session is up, only its estimates are missing",
            remedy,
        ));
    }
    all.extend(l.second_sender.map(|boot| {
        let found =
            format!("a SECOND COMPUTER sends as the vessel (boot {boot:08x}); its messages are rejected");
        TOPIC.broken(found, "switch one off")
    }));
    all
}

/// Whether the mission continues or breaks off a landing by itself without the radio; after a landing it needs no
/// radio.
fn landing_without_radio(s: &ObservedSituation) -> bool {
    let mission = s.snapshot.mission.fresh(s.now_ns);
    mission.is_some_and(|m| m.state == State::Landed || m.state.is_landing() && m.state != State::Hold)
}

/// Age of the vessel's newest estimate, s, if it is too old for a landing by radio.
fn radio_lost_s(s: &ObservedSituation) -> Option<f64> {
    s.link_age_s()
        .filter(|age_s| *age_s > topics::ESTIMATE.stale_after.secs())
}

fn sees_deck(s: &ObservedSituation) -> bool {
    let forecast = s.snapshot.forecast.fresh(s.now_ns);
    forecast.is_some_and(|f| f.vision_age_s < FRESH_TAGS_S)
}

/// Source that the landing continues with, and the lost source; None if no source is lost.
fn goes_on(s: &ObservedSituation) -> Option<String> {
    let lost = |name: &str, age_s: f64| match age_s.is_finite() {
        true => format!("{name} lost {}", minutes(age_s)),
        false => format!("no {name}"),
    };
    match radio_lost_s(s) {
        Some(age_s) if sees_deck(s) => Some(format!("goes on by camera; {}", lost("radio", age_s))),
        Some(age_s) => Some(format!("goes on by the forecast; {}", lost("radio", age_s))),
        None if sees_deck(s) => None,
        None => {
            let age_s = s.snapshot.forecast.map_or(f64::INFINITY, |f| f.vision_age_s);
            Some(format!("goes on by radio; {}", lost("camera", age_s)))
        }
    }
}

/// Source that locates a vessel without its estimates: its tags or its beacon.
fn known_otherwise(s: &ObservedSituation) -> Option<&'static str> {
    let forecast = s.snapshot.forecast.fresh(s.now_ns)?;
    let min_level = s.snapshot.mission.as_ref()?.min_vessel;
    let beacon = forecast.beacon.is_some() && min_level <= VesselLevel::Beacon;
    let tags = forecast.vision_age_s < FRESH_TAGS_S && (beacon || min_level == VesselLevel::Tag);
    if tags {
        Some("tags")
    } else {
        beacon.then_some("beacon")
    }
}

/// Displayed minus usable charge, as a fraction of a full battery, above which the gauge is not trusted.
const DOUBTED: f64 = 0.02;
/// Finding on a battery that is too low for the flight to the deck and one attempt.
/// Alarm if deck and wind pull a landed drone along the deck with more than its feet hold.
fn parked(s: &ObservedSituation) -> Option<Finding> {
    if s.snapshot.mission.is_none_or(|m| m.state != State::Landed) {
        return None;
    }
    let forecast = s.snapshot.forecast.fresh(s.now_ns)?;
    let holds = s.known.parked_friction?;
    let slope = |stage: &DeckStage| stage.euler[0].tan().hypot(stage.euler[1].tan());
    let steepest = forecast.stages.iter().map(slope).fold(0.0, f64::max);
    let wind = s.snapshot.drone.map_or([0.0; 2], |d| d.wind_push);
    let pull = steepest + wind[0].hypot(wind[1]) / GRAVITY;
    let found = format!(
        "slope and wind pull the parked drone with {:.0} % of its weight; its feet hold {:.0} %",
        100.0 * pull,
        100.0 * holds
    );
    if pull <= holds {
        return None;
    }
    Some(FindingTopic("deck").broken(found, "lash it down, or turn the boat into the waves"))
}

fn battery_low(s: &ObservedSituation) -> Option<Finding> {
    let mission = s.snapshot.mission.as_ref()?;
    let reserve = mission.battery_reserve;
    let shown = s.snapshot.autopilot.as_ref()?.battery;
    let charge = shown.into_iter().chain(mission.battery).reduce(f64::min);
    let charge = charge.filter(|b| *b < reserve)?;
    let found = format!(
        "battery at {:.0} %, the deck and one attempt need {:.0} %",
        100.0 * charge,
        100.0 * reserve
    );
    Some(FindingTopic("battery").broken(found, "land now, or replace the battery"))
}

/// Finding on the origin of a running drone's frame and the vessel's distance from it.
pub fn frame((origin, deck_m): (Datum, Option<f64>)) -> Finding {
    const TOPIC: FindingTopic = FindingTopic("origin");
    let begins = format!(
        "the origin of the drone's frame is at {:.6}, {:.6}, {:.1} m above the ellipsoid",
        origin.latitude_deg, origin.longitude_deg, origin.height_m
    );
    match deck_m {
        Some(m) if m > MAX_VESSEL_DISTANCE_M => TOPIC.stopping(
            format!("{begins}, the vessel is {m:.0} m away"),
            "the mission does not fly to a vessel beyond 5 km: compare the positions of the autopilot and of her receiver with a chart",
        ),
        Some(m) => TOPIC.fine(format!("{begins}, the vessel is {m:.0} m away")),
        None => TOPIC.fine(format!("{begins}; no vessel is known")),
    }
}

/// The mission's report as its vessel receives it; without an autopilot, the motors count as armed.
fn reported(s: &ObservedSituation, m: &MissionState) -> DroneStatus {
    let autopilot = s.snapshot.autopilot.as_ref();
    DroneStatus {
        armed: autopilot.is_none_or(|a| a.armed),
        ..DroneStatus::of(m.header, m, autopilot, None)
    }
}

pub fn go(s: &ObservedSituation, findings: &[Finding]) -> Go {
    let Some(m) = s.snapshot.mission.as_ref() else {
        return Go::of(findings, unknown(s));
    };
    let acts = m.waits_in_trouble() && !go::descends(m.state);
    let alarm = findings.iter().find(|f| match f.topic {
        "mission" => f.level == FindingLevel::Broken || acts && f.found.ends_with(&m.waiting.to_string()),
        topic => topic == "armed",
    });
    let lost_s = radio_lost_s(s).filter(|s| s.is_finite());
    let how = if go::descends(m.state) || lost_s.is_some() && landing_without_radio(s) {
        goes_on(s)
    } else {
        None
    };
    if let Some(answer) = Go::answer(&reported(s, m), alarm, how) {
        return answer;
    }
    let barred = go::barred(m.state, &m.entered).filter(|_| !s.snapshot.mission.is_old(s.now_ns));
    Go::of(findings, unknown(s)).worse(barred.map(Go::barred))
}

fn unknown(s: &ObservedSituation) -> Option<&'static str> {
    let snapshot = &s.snapshot;
    let Some(mission) = snapshot.mission.fresh(s.now_ns) else {
        return Some("no mission reports");
    };
    if snapshot.autopilot.fresh(s.now_ns).is_none() {
        Some("no message of the autopilot")
    } else if snapshot.forecast.fresh(s.now_ns).is_none() {
        Some("no forecast of the deck")
    } else if let Some(missing) = no_waves(s, mission) {
        Some(missing)
    } else {
        let wind = snapshot.drone.and_then(|d| d.wind);
        wind.is_none().then_some(go::NO_WIND)
    }
}

/// Text for unknown waves, if a landing needs the vessel's computer.
fn no_waves(s: &ObservedSituation, mission: &MissionState) -> Option<&'static str> {
    match (mission.min_vessel, s.snapshot.wave.fresh(s.now_ns)) {
        (VesselLevel::Tag | VesselLevel::Beacon, _) => None,
        (VesselLevel::Computer, None) => Some("the vessel's waves are not known yet"),
        (VesselLevel::Computer, Some(wave)) => go::no_forecast(wave.confidence.into()),
    }
}

pub fn state(s: &ObservedSituation) -> Option<StateView> {
    let m = s.snapshot.mission.as_ref()?;
    let since_s = if m.since == Time::EPOCH {
        0.0
    } else {
        (m.header.at - m.since).secs() + s.snapshot.mission.age_s(s.now_ns)
    };
    let name = m.state.named(&m.entered).into();
    let stale = s.snapshot.mission.is_old(s.now_ns);
    Some(go::view(&reported(s, m), name, since_s, stale))
}

pub fn headline(state: Option<&StateView>) -> String {
    let Some(state) = state else {
        return "no mission reports".into();
    };
    let mut text = state.name.clone();
    if state.since_s > 0.0 {
        text += &format!(" since {:.1} s", state.since_s);
    }
    if !state.entered.is_empty() {
        text += &format!(": {}", state.entered);
    }
    if state.stale { text + " (old)" } else { text }
}

pub fn figures(s: &ObservedSituation) -> Vec<Figure> {
    let mut all = vec![
        distance(s),
        link_figure(s),
        battery(s),
        deck(s),
        wind(s),
        waves(s),
        autopilot(s),
    ];
    all.extend(
        s.snapshot
            .mission
            .as_ref()
            .and_then(|m| mode(m, s.snapshot.autopilot.as_ref()))
            .map(|f| f.stale(s.snapshot.mission.is_old(s.now_ns))),
    );
    all.extend(probability(s));
    all.extend(relative(s));
    all.extend(compass::advised(s).map(|a| compass::figure(&a, s.known.knots)));
    all.extend(s.snapshot.response.as_ref().map(response));
    all.extend(processes(s));
    all
}

/// Distance from the deck's centre below which no bearing is given, m.
const NEAR_M: f64 = 1.0;

/// Drone minus deck by the newest forecast and state: north, east, down, m.
fn offset(s: &ObservedSituation) -> Option<[f64; 3]> {
    let deck = s.snapshot.forecast.and_then(|f| f.stages.first().copied())?;
    let drone = (*s.snapshot.drone)?;
    Some(core::array::from_fn(|k| drone.position[k] - deck.position[k]))
}

/// Horizontal distance from the deck, with bearing from the bow and height.
fn distance(s: &ObservedSituation) -> Figure {
    const NAME: &str = "distance";
    let (Some([north, east, down]), Some(forecast)) = (offset(s), *s.snapshot.forecast) else {
        let note = "no forecast of the deck".into();
        return Figure {
            note,
            ..Figure::unknown(NAME)
        };
    };
    let level = match forecast.vessel_level() {
        VesselLevel::Computer => "",
        VesselLevel::Tag => ", by tags alone",
        VesselLevel::Beacon => "",
    };
    let known_by =
        if let (VesselLevel::Beacon, Some([sd_m, age_s])) = (forecast.vessel_level(), forecast.beacon) {
            format!("vessel known by beacon, {sd_m:.0} m, {age_s:.1} s old")
        } else if forecast.vision_age_s.is_finite() {
            format!("detected {} ago{level}", time(forecast.vision_age_s))
        } else {
            "not detected yet".into()
        };
    let old = s.snapshot.forecast.is_old(s.now_ns) || s.snapshot.drone.is_old(s.now_ns);
    let away_m = f64::hypot(north, east);
    let bearing = (away_m > NEAR_M).then(|| {
        compass::bow_text(compass::from_bow(
            east.atan2(north).to_degrees(),
            forecast.mean_heading.to_degrees(),
        )) + ", "
    });
    let note = format!(
        "{}{} m above the deck, {known_by}",
        bearing.unwrap_or_default(),
        TwoDigits(-down)
    );
    Figure::of(NAME, format!("{} m", TwoDigits(away_m)), note).stale(old)
}

fn link_figure(s: &ObservedSituation) -> Figure {
    const NAME: &str = "link";
    let (Some(l), Some(age_s)) = (*s.snapshot.link, s.link_age_s()) else {
        let note = "no report of the bridge".into();
        return Figure {
            note,
            ..Figure::unknown(NAME)
        };
    };
    if age_s.is_infinite() {
        return Figure::unknown(NAME);
    }
    // A lost radio has no present loss and latency, and its age is true.
    let note = if age_s > topics::ESTIMATE.stale_after.secs() {
        "radio lost".into()
    } else {
        format!(
            "{:.1} % lost, latency {} / {} (p50/p99), clocks +- {}",
            100.0 * l.loss,
            time(l.latency_p50_s),
            time(l.latency_p99_s),
            time(l.clock_offset_sd_s)
        )
    };
    Figure::of(NAME, format!("{} old", time(age_s)), note)
}

/// Battery, with the charge needed for the flight to the deck and one attempt.
fn battery(s: &ObservedSituation) -> Figure {
    const NAME: &str = "battery";
    let Some(a) = *s.snapshot.autopilot else {
        return Figure::unknown(NAME);
    };
    let note: Vec<String> = [
        s.snapshot
            .mission
            .map(|m| format!("needs {:.0} %", 100.0 * m.battery_reserve)),
        s.snapshot
            .mission
            .and_then(|m| m.turns_in_s)
            .map(|t| format!("turns back in {:.0} min", (t / 60.0).floor())),
        s.battery_left_s
            .map(|t| format!("{:.0} min to the reserve", (t / 60.0).floor())),
        (s.snapshot.mission.map(|m| m.sorties))
            .filter(|[_, most]| *most > 0)
            .map(|[begun, most]| format!("sortie {begun} of {most}")),
        (s.snapshot.mission.and_then(|m| m.battery))
            .filter(|counts| a.battery.is_none_or(|shown| shown > counts + DOUBTED))
            .map(|counts| format!("counts as {:.0} %", 100.0 * counts)),
        a.battery_v.map(|v| format!("{v:.1} V")),
        a.battery_a.map(|i| format!("{i:.1} A")),
    ]
    .into_iter()
    .flatten()
    .collect();
    Figure {
        value: a.battery.map(|b| format!("{:.0} %", 100.0 * b)),
        note: note.join(", "),
        stale: s.snapshot.autopilot.is_old(s.now_ns),
        ..Figure::unknown(NAME)
    }
}

fn deck(s: &ObservedSituation) -> Figure {
    const NAME: &str = "deck";
    let Some(g) = *s.snapshot.grant else {
        return Figure::unknown(NAME);
    };
    let own = s.snapshot.mission.map_or(g.header.drone, |m| m.header.drone);
    let owner = match g.owner {
        DECK_CLOSED => "CLOSED".into(),
        0 => "free".into(),
        owner if owner == own => "ours".into(),
        owner => format!("drone {owner}'s"),
    };
    let course = course(g.course.after(s.snapshot.grant.age_s(s.now_ns)));
    let occupied = if g.occupied { "occupied, " } else { "" };
    let note = format!("{occupied}course {course}");
    Figure::of(NAME, owner, note).stale(s.snapshot.grant.is_old(s.now_ns))
}

fn wind(s: &ObservedSituation) -> Figure {
    const NAME: &str = "wind";
    match s
        .snapshot
        .drone
        .and_then(|d| Some((d.wind?, d.wind_sd_mps, d.gust_mps)))
    {
        None => Figure::unknown(NAME),
        Some((wind, sd_mps, gust_mps)) => {
            let wind = Wind::towards(wind);
            let gust = compass::gust(gust_mps, wind.speed_mps, s.known.knots);
            let text = compass::wind(wind, s.known.knots) + &gust;
            let note = sd_mps.map_or(String::new(), |sd| compass::known_to(sd, s.known.knots));
            Figure::of(NAME, text, note).stale(s.snapshot.drone.is_old(s.now_ns))
        }
    }
}

fn waves(s: &ObservedSituation) -> Figure {
    const NAME: &str = "waves";
    match *s.snapshot.wave {
        None => Figure::unknown(NAME),
        Some(w) => Figure::of(
            NAME,
            format!("{:.1} m", w.significant_height_m),
            format!("forecast quality {:.0} %", 100.0 * w.confidence),
        )
        .stale(s.snapshot.wave.is_old(s.now_ns)),
    }
}

fn autopilot(s: &ObservedSituation) -> Figure {
    const NAME: &str = "autopilot";
    let Some(AutopilotState {
        mode, armed, landed, ..
    }) = *s.snapshot.autopilot
    else {
        return Figure::unknown(NAME);
    };
    let landed = match landed {
        LandedState::Unknown => "",
        LandedState::OnGround => ", on the ground",
        LandedState::InAir => ", in the air",
    };
    let armed = if armed { "armed" } else { "disarmed" };
    let old = s.snapshot.autopilot.is_old(s.now_ns);
    Figure::of(NAME, format!("{mode:?}"), format!("{armed}{landed}")).stale(old)
}

/// Probability of a landing from here, in the states in which it decides: over the deck, before the flare.
fn probability(s: &ObservedSituation) -> Option<Figure> {
    const NAME: &str = "probability";
    let m = (*s.snapshot.mission)?;
    let decides = matches!(m.state, State::Tracking | State::TrackingStable | State::Descent);
    let away_m = offset(s).map(|[north, east, _]| f64::hypot(north, east));
    let reach_m = s.known.deck.map_or(f64::INFINITY, |deck| {
        let [.., length, width] = deck.all_m();
        f64::hypot(length, width) / 2.0
    });
    let landing = m
        .likelihood
        .filter(|_| decides && away_m.is_some_and(|m| m < reach_m));
    let Some(landing) = landing else {
        return Some(Figure::unknown(NAME));
    };
    let harm = m.harm.map(|p| format!("unsafe contact {:.1} %", 100.0 * p));
    let figure = Figure::of(
        NAME,
        format!("{:.0} %", (100.0 * landing).floor()),
        harm.unwrap_or_default(),
    );
    Some(figure.stale(s.snapshot.mission.is_old(s.now_ns)))
}

fn relative(s: &ObservedSituation) -> Option<Figure> {
    let r = (*s.snapshot.forecast)?.relative?;
    let value = match r.solution {
        CarrierSolution::Fixed => format!("fixed, {:.0} cm", 100.0 * r.sd_m),
        CarrierSolution::Float => format!("float, {:.0} cm", 100.0 * r.sd_m),
        CarrierSolution::None => "none".into(),
    };
    let by_tags = match r.contradicted_m {
        Some(m) => format!("contradicted by the tags by {m:.2} m, not used"),
        None if r.confirmed => "confirmed by the tags".into(),
        None => "not confirmed by the tags yet".into(),
    };
    let stale = s.snapshot.forecast.is_old(s.now_ns) || r.age_s > topics::RELATIVE.stale_after.secs();
    let note = format!("moving-base position, {by_tags}");
    Some(Figure::of("relative", value, note).stale(stale))
}

fn response(r: &AttitudeResponse) -> Figure {
    let [roll, pitch] = r.lag_s;
    let source = if r.identified {
        "identified in flight"
    } else {
        "as configured, not flown yet"
    };
    let (dead, roll, pitch) = (time(r.dead_time_s), time(roll), time(pitch));
    let value = format!("{dead} dead time");
    Figure::of(
        "response",
        value,
        format!("then roll {roll}, pitch {pitch}; {source}"),
    )
}

/// Mode of a landing that does not end on the deck.
fn mode(m: &MissionState, a: Option<&AutopilotState>) -> Option<Figure> {
    match m.settings.mode {
        LandingMode::Land => None,
        LandingMode::Match => {
            let lowest_m = m.lowest_clearance_m.unwrap_or_default();
            let note = "follows the deck there and climbs";
            Some(Figure::of(
                "match",
                format!("{lowest_m:.1} m above the deck"),
                note,
            ))
        }
        LandingMode::Shadow => Some(match a.and_then(|a| a.shadow) {
            None => Figure::of("shadow", "a pilot flies", "nothing to compare yet"),
            Some(s) => shadow(&s),
        }),
    }
}

fn shadow(s: &ShadowComparison) -> Figure {
    let [roll, pitch] = s.tilt.map(f64::to_degrees);
    let motors = if s.stops { "; would stop the motors" } else { "" };
    let value = format!(
        "would command roll {roll:.1} pitch {pitch:.1} deg, thrust {:.2}",
        s.thrust
    );
    let apart = format!(
        "apart by {:.1} deg, {:.2} m/s{motors}",
        s.apart_rad.to_degrees(),
        s.apart_mps
    );
    Figure::of("shadow", value, apart)
}

#[cfg(test)]
mod tests;
