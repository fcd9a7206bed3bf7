//! The status of a drone's processes on one page, and with all its tables.

use alight_shared::msg::{
    AttitudeResponse, AutopilotState, LandedState, LandingMode, MissionState, ReasonCode, ShadowComparison,
    Wind, still_armed,
};
use alight_shared::topics;
use alight_shared::transport::process::ProcessKind;
use alight_uav::autopilot::config::DisarmConfig;

use super::page::Page;
use crate::io::mavlink_key;
use crate::process::snapshot::{Snapshot, time};
use crate::process::{lateness, metrics};
use crate::tools::check::finding::Level;

/// A vessel's estimate older than this is a warning, s: above the limit of go and no-go.
const OLD_LINK_S: f64 = 0.5;

/// What a person has to know of the set of processes `name` when the steady clock reads `now_ns`.
pub fn page(name: &str, snapshot: &Snapshot, disarm: &DisarmConfig, now_ns: i64) -> Page {
    let waiting = snapshot.mission.map(|m| (m.state, m.waiting.code));
    let armed = snapshot.autopilot.map(|a| (a.armed, a.mode, a.landed));
    let title = title(name, snapshot.mission.as_ref());
    let mut page = Page::new(title, format!("{waiting:?} {armed:?}"));
    if let Some(m) = &snapshot.mission {
        page.state_entry("waits for", waits_for(m));
        if let Some(text) = mode(m, snapshot.autopilot.as_ref()) {
            page.entry(text.0, text.1);
        }
    }
    page.entry("deck", deck(snapshot));
    if let Some(wind) = snapshot.mission.and_then(|m| m.wind) {
        page.entry("wind", Wind::towards(wind).to_string());
    }
    page.entry("link", link(snapshot));
    if let Some(a) = &snapshot.autopilot {
        page.entry("battery", battery(a, snapshot.mission.as_ref()));
        page.state_entry("autopilot", autopilot(a));
    }
    if let Some(r) = &snapshot.response {
        page.entry("response", response(r));
    }
    let silent = silent(snapshot, now_ns);
    let running: Vec<&str> = snapshot
        .processes
        .keys()
        .filter(|kind| !silent.contains(kind))
        .map(|kind| kind.name())
        .collect();
    page.entry(
        "processes",
        format!("{} run: {}", running.len(), running.join(", ")),
    );
    alarms(&mut page, snapshot, disarm, &silent);
    page
}

fn title(name: &str, mission: Option<&MissionState>) -> String {
    let Some(m) = mission else {
        return format!("{name}: no mission reports");
    };
    let (since_s, entered) = ((m.header.at - m.since).secs(), m.entered.to_string());
    let reason = if entered.is_empty() {
        String::new()
    } else {
        format!(": {entered}")
    };
    format!("{name}: {} since {since_s:.1} s{reason}", m.state.name())
}

fn waits_for(m: &MissionState) -> String {
    let waiting = m.waiting.to_string();
    if waiting.is_empty() {
        "nothing".into()
    } else {
        waiting
    }
}

fn deck(snapshot: &Snapshot) -> String {
    let apart = snapshot.frame().and_then(|(_, apart)| apart);
    let apart = apart.map_or("no forecast of the deck".into(), |m| format!("{m:.1} m away"));
    let seen = snapshot.forecast.map(|f| f.vision_age_s);
    let seen = seen.map_or(String::new(), |s| {
        if s.is_finite() {
            format!(", seen {} ago", time(s))
        } else {
            ", not seen yet".into()
        }
    });
    let plan = snapshot.plan.as_ref();
    let plan = plan.map_or(String::new(), |(_, age_s)| format!("; plan {} old", time(*age_s)));
    format!("{apart}{seen}{plan}")
}

fn link(snapshot: &Snapshot) -> String {
    snapshot.link.map_or("no report of the bridge".into(), |l| {
        format!(
            "state {} old, {:.1} % lost, latency {} / {} (p50/p99), clocks +- {}",
            time(l.age_s),
            100.0 * l.loss,
            time(l.latency_p50_s),
            time(l.latency_p99_s),
            time(l.clock_offset_sd_s)
        )
    })
}

fn autopilot(a: &AutopilotState) -> String {
    let landed = match a.landed {
        LandedState::Unknown => "",
        LandedState::OnGround => ", on the ground",
        LandedState::InAir => ", in the air",
    };
    let armed = if a.armed { "armed" } else { "disarmed" };
    format!("mode {:?}, {armed}{landed}", a.mode)
}

/// How the attitude answers set-points.
fn response(r: &AttitudeResponse) -> String {
    let [roll, pitch] = r.lag_s;
    let source = if r.identified {
        "identified in flight"
    } else {
        "as configured, not flown yet"
    };
    let (dead, roll, pitch) = (time(r.dead_time_s), time(roll), time(pitch));
    format!("dead time {dead}, then roll {roll}, pitch {pitch}; {source}")
}

/// Processes of a drone without a report, and such as report no more.
fn silent(snapshot: &Snapshot, now_ns: i64) -> Vec<ProcessKind> {
    let stale_s = topics::PROCESS.stale_after.secs();
    let missing = ProcessKind::DRONE
        .into_iter()
        .filter(|kind| !snapshot.processes.contains_key(kind));
    let old = snapshot
        .processes
        .values()
        .filter(|p| (now_ns - p.at_ns) as f64 * 1e-9 > stale_s);
    missing.chain(old.map(|p| p.kind)).collect()
}

fn alarms(page: &mut Page, snapshot: &Snapshot, disarm: &DisarmConfig, silent: &[ProcessKind]) {
    if let Some(s) = snapshot.still_armed_s(disarm) {
        page.alarm(Level::Broken, "armed", still_armed(s as f32));
    }
    if !silent.is_empty() {
        let names: Vec<&str> = silent.iter().map(|kind| kind.name()).collect();
        let text = format!("no report of {}", names.join(", "));
        page.alarm(Level::Broken, text.clone(), text);
    }
    for (kind, text) in snapshot
        .processes
        .values()
        .filter_map(|p| Some((p.kind, lateness::finding(p)?)))
    {
        page.alarm(
            Level::Warning,
            format!("{} late", kind.name()),
            format!("{text}; {}", lateness::REMEDY),
        );
    }
    if let Some(a) = &snapshot.autopilot
        && a.rejection.code != ReasonCode::None
    {
        let about = format!("{:?}", a.rejection.code);
        page.alarm(Level::Warning, about, format!("no landing: {}", a.rejection));
    }
    if let Some(p) = snapshot.processes.get(&ProcessKind::Autopilot)
        && let Some((found, remedy)) = mavlink_key::counts(&p.metrics).finding()
    {
        page.alarm(Level::Warning, "signatures", format!("{found}: {remedy}"));
    }
    if let Some(l) = &snapshot.link
        && !(l.age_s <= OLD_LINK_S)
    {
        let text = format!("the vessel's newest estimate is {} old", time(l.age_s));
        page.alarm(Level::Warning, "link", text);
    }
    if let Some(said) = &snapshot.edited {
        page.alarm(Level::Warning, "configuration", said.clone());
    }
    if let Some(boot) = snapshot.link.and_then(|l| l.second_sender) {
        let text = format!(
            "a SECOND COMPUTER speaks as the vessel (boot {boot:08x}); it is not listened to: switch one off"
        );
        page.alarm(Level::Broken, "second computer", text);
    }
    if let (Some(m), Some(a)) = (&snapshot.mission, &snapshot.autopilot)
        && let Some(charge) = a.battery.filter(|b| *b < m.battery_reserve)
    {
        let (charge, needs) = (100.0 * charge, 100.0 * m.battery_reserve);
        page.alarm(
            Level::Warning,
            "battery",
            format!("battery at {charge:.0} %, the deck and one attempt need {needs:.0} %"),
        );
    }
}

/// The battery, and what the way to the deck and one attempt cost of it.
fn battery(a: &AutopilotState, mission: Option<&MissionState>) -> String {
    let charge = a.battery.map_or("charge not reported".into(), |b| {
        let needs = mission.map_or(String::new(), |m| {
            format!(" (needs {:.0} %)", 100.0 * m.battery_reserve)
        });
        format!("{:.0} %{needs}", 100.0 * b)
    });
    let volts = a.battery_v.map_or(String::new(), |v| format!(", {v:.1} V"));
    let amps = a.battery_a.map_or(String::new(), |i| format!(", {i:.1} A"));
    format!("{charge}{volts}{amps}")
}

/// How far the landing goes, when not onto the deck.
fn mode(m: &MissionState, a: Option<&AutopilotState>) -> Option<(&'static str, String)> {
    match m.mode {
        LandingMode::Land => None,
        LandingMode::Match => {
            let lowest_m = m.lowest_clearance_m.unwrap_or_default();
            let text = format!("follows the deck {lowest_m:.1} m above it and climbs");
            Some(("match", text))
        }
        LandingMode::Shadow => Some(match a.and_then(|a| a.shadow) {
            None => ("shadow", "a person flies; nothing to compare yet".into()),
            Some(s) => ("shadow", shadow(&s)),
        }),
    }
}

/// What would be commanded beside what is flown.
fn shadow(s: &ShadowComparison) -> String {
    let [roll, pitch] = s.tilt.map(f64::to_degrees);
    let motors = if s.stops { "; would stop the motors" } else { "" };
    format!(
        "would command roll {roll:.1} pitch {pitch:.1} deg, thrust {:.2}; apart by {:.1} deg, {:.2} m/s{motors}",
        s.thrust,
        s.apart_rad.to_degrees(),
        s.apart_mps
    )
}

/// Everything: what each process reports of itself, and each topic as each process reads it.
pub fn tables(name: &str, snapshot: &Snapshot, disarm: &DisarmConfig, now_ns: i64) -> String {
    let mut lines = vec![format!("instance {name}\n")];
    if let Some(m) = &snapshot.mission {
        let title = title("", Some(m));
        lines.push(format!("  mission   {}", title.trim_start_matches(": ")));
        lines.push(format!("  waiting   {}", m.waiting));
    }
    if let Some(s) = snapshot.still_armed_s(disarm) {
        lines.push(format!("  ALARM     {}", still_armed(s as f32)));
    }
    if let Some(a) = &snapshot.autopilot {
        if a.rejection.code != ReasonCode::None {
            lines.push(format!("  autopilot no landing: {}", a.rejection));
        }
        lines.push(format!("  battery   {}", battery(a, snapshot.mission.as_ref())));
    }
    if let Some((label, text)) = snapshot
        .mission
        .as_ref()
        .and_then(|m| mode(m, snapshot.autopilot.as_ref()))
    {
        lines.push(format!("  {label:<9} {text}"));
    }
    if let Some((origin, apart)) = snapshot.frame() {
        let deck = apart.map_or("no forecast of the deck".into(), |m| {
            format!("deck {m:.0} m away")
        });
        lines.push(format!(
            "  frame     begins at {:.6}, {:.6}, {:.1} m above the ellipsoid; {deck}",
            origin.latitude_deg, origin.longitude_deg, origin.height_m
        ));
    }
    if let Some(l) = &snapshot.link {
        lines.push(format!(
            "  link      state {} old, {:.1} % lost, {:.1} % out of order (datagrams may overtake each other), latency \
             {} / {} (p50/p99), {} rejected (late or repeated ones are normal)",
            time(l.age_s),
            100.0 * l.loss,
            100.0 * l.out_of_order,
            time(l.latency_p50_s),
            time(l.latency_p99_s),
            l.rejected
        ));
        lines.push(format!(
            "  clocks    drone minus vessel {:.4} s +- {}",
            l.clock_offset_s,
            time(l.clock_offset_sd_s)
        ));
    }
    if let Some(r) = &snapshot.response {
        lines.push(format!("  response  {}", response(r)));
    }
    if let Some((plan, age_s)) = &snapshot.plan {
        lines.push(format!(
            "  plan      {} old, {:?}, {} iterations",
            time(*age_s),
            plan.solve,
            plan.iterations
        ));
    }
    for p in snapshot.processes.values() {
        let text = metrics::text(p);
        if !text.is_empty() {
            lines.push(format!("  {:<9} {text}", p.kind.name()));
        }
    }
    format!(
        "{}\n\n{}\n{}\n{}\n{}",
        lines.join("\n"),
        snapshot.usage(now_ns),
        snapshot.stages(),
        snapshot.topics(),
        snapshot.radio()
    )
}

#[cfg(test)]
mod tests {
    use super::super::page::{HEIGHT, WIDTH};
    use super::*;
    use alight_shared::msg::{Header, LinkState, Reason, State};
    use alight_shared::time::Time;
    use alight_shared::transport::process::ProcessState;

    const NOW_NS: i64 = 100_000_000_000;

    fn mission(state: State, waiting: ReasonCode) -> MissionState {
        MissionState {
            header: Header::new(0, 1, 1, 1, Time::from_secs(20.0)),
            state,
            since: Time::from_secs(12.0),
            entered: ReasonCode::InSight.into(),
            waiting: Reason::new(waiting, 0.31, 0.2),
            battery_reserve: 0.34,
            ..MissionState::default()
        }
    }
    fn flying() -> Snapshot {
        let report = |kind| ProcessState {
            kind,
            at_ns: NOW_NS,
            ..ProcessState::default()
        };
        Snapshot {
            processes: ProcessKind::DRONE.into_iter().map(|k| (k, report(k))).collect(),
            mission: Some(mission(State::Tracking, ReasonCode::TooSteep)),
            autopilot: Some(AutopilotState {
                armed: true,
                battery: Some(0.8),
                ..AutopilotState::default()
            }),
            link: Some(LinkState {
                age_s: 0.06,
                ..LinkState::default()
            }),
            ..Snapshot::default()
        }
    }
    fn texts(snapshot: &Snapshot) -> Vec<String> {
        let page = page("default", snapshot, &DisarmConfig::default(), NOW_NS);
        page.text().lines().map(str::to_owned).collect()
    }

    #[test]
    fn status_page_of_a_flying_drone() {
        let lines = texts(&flying());
        assert_eq!(lines[0], "default: Tracking since 8.0 s: the deck is in sight");
        for (label, part) in [
            ("waits for", "deck tilts 17.8 deg (limit 11.5)"),
            ("deck", "no forecast"),
            ("link", "60.0 ms old"),
            ("battery", "80 % (needs 34 %)"),
            ("autopilot", "armed"),
            ("processes", "5 run: bridge"),
            ("alarms", "none"),
        ] {
            let line = lines.iter().find(|l| l.starts_with(label));
            assert!(line.is_some_and(|l| l.contains(part)), "{label}: {lines:?}");
        }
    }

    #[test]
    fn status_page_with_every_alarm() {
        let mut s = flying();
        s.processes.clear();
        s.edited = Some("drone.toml was edited since the start".into());
        s.mission = Some(MissionState {
            mode: LandingMode::Shadow,
            waiting: Reason::new(ReasonCode::AutopilotParameterUnknown, 10.0, 0.0),
            ..mission(State::Landed, ReasonCode::None)
        });
        s.autopilot = Some(AutopilotState {
            armed: true,
            battery: Some(0.1),
            rejection: Reason::new(ReasonCode::AutopilotParameterUnknown, 10.0, 0.0),
            shadow: Some(ShadowComparison::default()),
            ..AutopilotState::default()
        });
        s.link = Some(LinkState {
            age_s: f64::INFINITY,
            second_sender: Some(7),
            ..LinkState::default()
        });
        let lines = texts(&s);
        assert!(
            lines.len() <= HEIGHT && lines.iter().all(|l| l.chars().count() <= WIDTH),
            "{lines:?}"
        );
        let has = |part: &str| lines.iter().any(|l| l.contains(part));
        for part in [
            "still ARMED",
            "no report of bridge",
            "no landing:",
            "battery at 10 %",
            "a SECOND COMPUTER",
            "was edited",
            "estimate is - old",
        ] {
            assert!(has(part), "{part}: {lines:?}");
        }
    }

    #[test]
    fn status_page_key() {
        let key = |s: &Snapshot, now_ns| page("land", s, &DisarmConfig::default(), now_ns).key();
        let mut other = flying();
        let before = key(&other, NOW_NS);
        other.link = Some(LinkState {
            age_s: 0.09,
            ..LinkState::default()
        });
        other.mission = Some(MissionState {
            waiting: Reason::new(ReasonCode::TooSteep, 0.4, 0.2),
            ..mission(State::Tracking, ReasonCode::TooSteep)
        });
        assert_eq!(key(&other, NOW_NS), before);
        assert_ne!(key(&other, NOW_NS + 60_000_000_000), before, "silent processes");
        other.mission = Some(mission(State::Descent, ReasonCode::TooSteep));
        assert_ne!(key(&other, NOW_NS), before);
    }

    #[test]
    fn status_page_shadow_line() {
        let s = ShadowComparison {
            tilt: [0.1, -0.05],
            thrust: 0.41,
            apart_rad: 0.02,
            apart_mps: 0.3,
            ..ShadowComparison::default()
        };
        assert_eq!(
            shadow(&s),
            "would command roll 5.7 pitch -2.9 deg, thrust 0.41; apart by 1.1 deg, 0.30 m/s"
        );
    }
}
