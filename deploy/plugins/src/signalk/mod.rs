//! State of a computer as deltas for a Signal K server: values below `alight`, and findings as notifications.
//!
//! Each path belongs to one computer, which its `$source` names: `alight.deck`, `alight.helm` and the paths below
//! `alight.vessel` to the vessel, those below `alight.drones.N` to drone N. `alight.landing` is the worse of both;
//! the vessel's computer writes it because it receives the drone's status by radio.
//!
//! The vessel's sensors read none of these paths (`alight_usv::sensors`), so a server cannot return one as a
//! measurement. Messages from a server never count as orders.

pub mod command;

use alight_shared::msg::{ComputerReport, DroneContact, VesselStatus};
use std::collections::{BTreeMap, BTreeSet};

use alight_shared::frames::{DroneNed, Vector};
use serde_json::{Value, json};

use alight_people::status::{
    LOST_CONTACT_S, Status,
    finding::{Finding, FindingLevel},
    go::Go,
    vessel::own_go,
};

/// Minimum time between updates of a text whose numbers change, ns.
const TEXT_NS: i64 = 10_000_000_000;
const ROOT: &str = "alight";
/// Units of a coordinate per degree: a resolution of 1 cm.
const PLACE: f64 = 1e7;

type SentValue = (Value, i64);

#[derive(Debug, Default)]
pub struct Deltas {
    sent: BTreeMap<String, SentValue>,
    /// Topics that have had a finding other than fine; they are reported as normal afterwards.
    topics: BTreeSet<&'static str>,
    /// Paths whose unit and description the server already has.
    described: BTreeSet<String>,
}

impl Deltas {
    /// Discards the server's known values, after a reconnection.
    pub fn forget(&mut self) {
        self.sent.clear();
        self.described.clear();
    }
    pub fn delta(&mut self, status: &Status, now_ns: i64) -> Option<String> {
        let own = own(&status.situation.known);
        let mut all = values(status, &own);
        let bad = status.findings.iter().filter(|f| f.level > FindingLevel::Fine);
        self.topics.extend(bad.map(|f| f.topic));
        for topic in &self.topics {
            let path = format!("notifications.{ROOT}.{own}.{topic}");
            all.insert(path, notification(&status.findings, topic));
        }
        // A value that is no longer known becomes null once.
        let unknown = self.sent.keys().filter(|path| !all.contains_key(*path));
        let unknown: BTreeSet<String> = unknown.cloned().collect();
        all.extend(unknown.iter().map(|path| (path.clone(), Value::Null)));
        all.retain(|path, value| self.sent.get(path).is_none_or(|sent| is_due(sent, value, now_ns)));
        self.sent.retain(|path, _| !unknown.contains(path));
        if all.is_empty() {
            return None;
        }
        let pair = |(path, value): (&String, &Value)| json!({"path": path, "value": value});
        let values: Vec<Value> = all.iter().map(pair).collect();
        let source = format!("{ROOT}.{own}");
        let mut updates = vec![json!({"$source": source, "values": values})];
        let meta = self.meta(all.keys());
        if !meta.is_empty() {
            updates.push(json!({"$source": source, "meta": meta}));
        }
        all.retain(|path, _| !unknown.contains(path));
        self.sent
            .extend(all.into_iter().map(|(path, value)| (path, (value, now_ns))));
        Some(json!({"context": "vessels.self", "updates": updates}).to_string())
    }
    /// Units and descriptions of the `paths` that the server does not have yet.
    fn meta<'a>(&mut self, paths: impl Iterator<Item = &'a String>) -> Vec<Value> {
        let mut new = Vec::new();
        for path in paths.filter(|path| !self.described.contains(*path)) {
            new.extend(meaning(path).map(|value| json!({"path": path, "value": value})));
        }
        let described = new.iter().filter_map(|m| m.get("path")?.as_str());
        self.described.extend(described.map(str::to_owned));
        new
    }
}

/// Description and unit of a path with numbers; None for other paths.
fn meaning(path: &str) -> Option<Value> {
    let (of, name) = path.strip_prefix(ROOT)?.rsplit_once('.')?;
    match (of, name) {
        (".deck", "drone") => Some(
            json!({"description": "number of the drone that has the deck; it is a name, without a unit"}),
        ),
        (_, "battery") => Some(json!({"units": "ratio", "description": "remaining battery of the drone"})),
        (_, "deckDistance") => Some(json!({
            "units": "m",
            "description": "horizontal distance of the drone from the deck's centre",
        })),
        (_, "position") => Some(json!({
            "description": "position of the drone by its autopilot",
            "properties": {
                "latitude": {"type": "number", "units": "deg"},
                "longitude": {"type": "number", "units": "deg"},
                "altitude": {"type": "number", "units": "m", "description": "above the ellipsoid"},
            },
        })),
        (_, _) => None,
    }
}

fn own(known: &ComputerReport) -> String {
    match (&known.vessel, known.drone_id) {
        (Some(_), _) => "vessel".into(),
        (None, Some(number)) => format!("drones.{number}"),
        (None, None) => "drone".into(),
    }
}

/// Whether a value has to replace the one on the server. Only the state of a notification alerts the crew.
fn is_due((sent, at_ns): &SentValue, value: &Value, now_ns: i64) -> bool {
    let of = |v: &Value| v.get("state").cloned();
    let is_text = of(value).is_some() && of(value) == of(sent);
    value != sent && (!is_text || now_ns.saturating_sub(*at_ns) >= TEXT_NS)
}

fn notification(findings: &[Finding], topic: &str) -> Value {
    let all = || findings.iter().filter(|f| f.topic == topic);
    let worst = all().map(|f| f.level).max().unwrap_or_default();
    let (state, method): (_, &[&str]) = match worst {
        FindingLevel::Fine => ("normal", &[]),
        FindingLevel::Warning => ("warn", &["visual"]),
        FindingLevel::Broken => ("alarm", &["visual", "sound"]),
    };
    let text = |f: &Finding| {
        if f.remedy.is_empty() {
            f.found.clone()
        } else {
            format!("{} ({})", f.found, f.remedy)
        }
    };
    let texts: Vec<String> = all().filter(|f| f.level == worst).map(text).collect();
    let message = if texts.is_empty() {
        "as it should be".into()
    } else {
        texts.join("; ")
    };
    json!({"state": state, "method": method, "message": message})
}

fn values(status: &Status, own: &str) -> BTreeMap<String, Value> {
    let s = &status.situation;
    let vessel = s.vessel().filter(|_| status.running);
    let go = vessel.map_or_else(
        || status.go.clone(),
        |(_, vessel)| own_go(&status.findings, vessel),
    );
    let mut all = vec![(format!("{own}.running"), json!(status.running))];
    all.extend(landing(&format!("{own}.landing"), &go));
    if s.known.vessel.is_some() {
        // A drone receives neither other drones nor whether the vessel writes this path.
        all.extend(landing("landing", &status.go));
    }
    match vessel {
        Some((_, vessel)) => of_vessel(own, vessel, &mut all),
        None if status.running && s.known.vessel.is_none() => of_drone(own, status, &mut all),
        None => {}
    }
    let path = |(name, value)| (format!("{ROOT}.{name}"), value);
    all.into_iter().map(path).collect()
}

fn landing(path: &str, go: &Go) -> [(String, Value); 2] {
    [
        (format!("{path}.go"), json!(go.go)),
        (format!("{path}.why"), json!(go.why)),
    ]
}

fn of_vessel(own: &str, vessel: &VesselStatus, all: &mut Vec<(String, Value)>) {
    all.extend([
        ("deck.closed".into(), json!(vessel.deck.closed.is_some())),
        ("deck.occupied".into(), json!(vessel.occupied)),
        ("deck.drone".into(), json!(vessel.deck_owner)),
        ("helm.keepCourse".into(), json!(vessel.deck.wants_steady)),
    ]);
    for DroneContact { age_s, status } in vessel.drones.iter() {
        let is_received = *age_s <= LOST_CONTACT_S;
        let distance = status.deck_distance_m.map(|d| rounded(d.into(), 10.0));
        let battery = status.battery.map(|b| rounded(b, 100.0));
        let of = |name: &str, value| (format!("{own}.drones.{}.{name}", status.header.drone), value);
        all.extend([
            of("received", json!(is_received)),
            of("state", json!(status.state.name())),
            of("armed", json!(status.armed)),
            of("battery", json!(battery)),
            of("deckDistance", json!(distance)),
        ]);
    }
}

fn of_drone(own: &str, status: &Status, all: &mut Vec<(String, Value)>) {
    let s = &status.situation;
    let autopilot = s.snapshot.autopilot.fresh(s.now_ns);
    let place = s.snapshot.drone.fresh(s.now_ns).map(|d| {
        let place = d
            .datum
            .at(&Vector::<DroneNed>::from(d.position() - d.datum_offset()));
        json!({
            "latitude": rounded(place.latitude_deg, PLACE),
            "longitude": rounded(place.longitude_deg, PLACE),
            "altitude": rounded(place.height_m, 100.0),
        })
    });
    let state = status.state.as_ref().filter(|s| !s.stale).map(|s| &s.name);
    let battery = autopilot.and_then(|a| a.battery).map(|b| rounded(b, 100.0));
    let of = |name: &str, value| (format!("{own}.{name}"), value);
    all.extend([
        of("state", json!(state)),
        of("armed", json!(autopilot.map(|a| a.armed))),
        of("battery", json!(battery)),
        of("position", json!(place)),
    ]);
}

fn rounded(x: f64, steps: f64) -> f64 {
    (x * steps).round() / steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_computer::{
        config::{DroneComputerConfig, VesselComputerConfig},
        process::{facts::Facts, snapshot::Snapshot},
        situation::ObservedSituation,
    };
    use alight_people::status::finding::FindingTopic;
    use alight_shared::{
        msg::{AutopilotState, DroneState, DroneStatus, Header, Seq},
        time::Time,
    };

    const S: i64 = 1_000_000_000;

    fn with_findings(findings: Vec<Finding>) -> Status {
        Status {
            running: true,
            findings,
            ..Status::default()
        }
    }
    fn contact(age_s: f64) -> DroneContact {
        DroneContact {
            age_s,
            status: DroneStatus {
                header: Header::new(1, 3, 1, 0, Time::EPOCH),
                battery: Some(0.777),
                deck_distance_m: Some(12.34),
                ..DroneStatus::default()
            },
        }
    }
    fn judged(known: ComputerReport, go: Go) -> Status {
        let mut snapshot = Snapshot {
            computer: known.into(),
            ..Snapshot::default()
        };
        let mut hers = VesselStatus {
            deck_owner: Some(3),
            drones: Seq::filled([contact(1.0)]),
            ..VesselStatus::default()
        };
        hers.estimator.waves = Some([0.9, 0.8]);
        snapshot.vessel.set(0, known.vessel.is_some().then_some(hers));
        if known.vessel.is_none() {
            snapshot.drone.set(0, Some(DroneState::default()));
            let autopilot = AutopilotState {
                battery: Some(0.5),
                ..AutopilotState::default()
            };
            snapshot.autopilot.set(0, Some(autopilot));
        }
        Status {
            go,
            situation: ObservedSituation::of(&snapshot, 0),
            ..with_findings(vec![FindingTopic("processes").warning("late", "look")])
        }
    }
    fn vessel() -> ComputerReport {
        Facts::vessel(&VesselComputerConfig::default()).report
    }
    fn drone() -> ComputerReport {
        ComputerReport {
            drone_id: Some(3),
            ..Facts::drone(&DroneComputerConfig::default()).report
        }
    }
    fn parsed(delta: Option<String>) -> Value {
        serde_json::from_str(&delta.unwrap()).unwrap()
    }

    #[test]
    fn paths_of_two_computers() {
        let computers = [
            judged(vessel(), Go::barred("drone 3: Landed")),
            judged(drone(), Go::of(&[], None)),
        ];
        let deltas = computers.map(|status| Deltas::default().delta(&status, 0));
        let source = |delta: &Option<String>| parsed(delta.clone())["updates"][0]["$source"].clone();
        assert_eq!(
            deltas.each_ref().map(source),
            [json!("alight.vessel"), json!("alight.drones.3")]
        );
        let [hers, its] = deltas.map(sent);
        let both: Vec<&String> = hers.keys().filter(|path| its.contains_key(*path)).collect();
        assert!(both.is_empty(), "{both:?}");
        assert_eq!(hers["alight.vessel.landing.go"], true);
        assert_eq!(hers["alight.landing.go"], false);
        assert_eq!(hers["alight.landing.why"], "drone 3: Landed");
        assert_eq!(its["alight.drones.3.landing.go"], true);
        assert!(hers.contains_key("notifications.alight.vessel.processes"));
        assert!(its.contains_key("notifications.alight.drones.3.processes"));
    }

    #[test]
    fn units_of_every_number() {
        for known in [vessel(), drone()] {
            let mut deltas = Deltas::default();
            let status = judged(known, Go::default());
            let delta = parsed(deltas.delta(&status, 0));
            let list = |update: usize, of: &str| delta["updates"][update][of].as_array().unwrap().clone();
            let meta: BTreeMap<String, Value> = (list(1, "meta").iter())
                .map(|m| (m["path"].as_str().unwrap().to_owned(), m["value"].clone()))
                .collect();
            let mut numbers = 0;
            for value in list(0, "values") {
                let path = value["path"].as_str().unwrap();
                if value["value"].is_number() {
                    numbers += 1;
                    // A drone's number is a name, so it has no unit.
                    let is_name = path == "alight.deck.drone";
                    assert!(meta[path]["units"].is_string() != is_name, "{path}: {meta:?}");
                }
                for (name, part) in value["value"].as_object().into_iter().flatten() {
                    let units = |m: &Value| m["properties"][name]["units"].is_string();
                    let has = meta.get(path).is_some_and(units);
                    assert!(has || !part.is_number(), "{path}.{name}");
                }
            }
            assert!(numbers > 0);
            let mut other = status.clone();
            other.running = false;
            assert_eq!(
                parsed(deltas.delta(&other, S))["updates"]
                    .as_array()
                    .unwrap()
                    .len(),
                1
            );
            deltas.forget();
            assert_eq!(
                parsed(deltas.delta(&status, 2 * S))["updates"]
                    .as_array()
                    .unwrap()
                    .len(),
                2
            );
        }
    }
    fn sent(delta: Option<String>) -> BTreeMap<String, Value> {
        let Some(delta) = delta else {
            return BTreeMap::new();
        };
        let delta: Value = serde_json::from_str(&delta).unwrap();
        assert_eq!(delta["context"], "vessels.self");
        let values = delta["updates"][0]["values"].as_array().unwrap();
        let pair = |v: &Value| (v["path"].as_str().unwrap().to_owned(), v["value"].clone());
        values.iter().map(pair).collect()
    }

    #[test]
    fn notifications_by_their_state() {
        let mut deltas = Deltas::default();
        let link = FindingTopic("link");
        let old = |age: &str| {
            with_findings(vec![
                link.warning(format!("{age} old"), "antenna"),
                link.fine("3 % lost"),
            ])
        };
        let first = sent(deltas.delta(&old("1 s"), 0));
        let at = |all: &BTreeMap<String, Value>| all.get("notifications.alight.drone.link").cloned();
        assert_eq!(
            at(&first),
            Some(json!({"state": "warn", "method": ["visual"], "message": "1 s old (antenna)"}))
        );
        // The same text again, a different text at once, and a different text later.
        assert_eq!(deltas.delta(&old("1 s"), S), None);
        assert_eq!(deltas.delta(&old("2 s"), 2 * S), None);
        assert!(at(&sent(deltas.delta(&old("9 s"), 11 * S))).is_some());
        // Another state is sent at once; a topic that is fine from the start is not sent.
        let broken = with_findings(vec![link.broken("none", ""), FindingTopic("deck").fine("free")]);
        let worse = sent(deltas.delta(&broken, 12 * S));
        assert_eq!(
            worse.keys().collect::<Vec<_>>(),
            ["notifications.alight.drone.link"]
        );
        assert_eq!(at(&worse).unwrap()["method"], json!(["visual", "sound"]));
        let fine = at(&sent(deltas.delta(&with_findings(Vec::new()), 13 * S))).unwrap();
        assert_eq!(
            (&fine["state"], &fine["message"]),
            (&json!("normal"), &json!("as it should be"))
        );
        deltas.forget();
        assert!(at(&sent(deltas.delta(&with_findings(Vec::new()), 14 * S))).is_some());
    }

    #[test]
    fn values_of_a_vessel_and_what_is_not_known_any_more() {
        let reported = Facts::vessel(&VesselComputerConfig::default()).report;
        let status = |drones: &[DroneContact]| {
            let mut snapshot = Snapshot {
                computer: reported.into(),
                ..Snapshot::default()
            };
            snapshot.vessel.set(
                0,
                Some(VesselStatus {
                    deck_owner: Some(3),
                    drones: Seq::filled(drones.iter().copied()),
                    ..VesselStatus::default()
                }),
            );
            Status::of(ObservedSituation::of(&snapshot, 0))
        };
        let mut deltas = Deltas::default();
        let all = sent(deltas.delta(&status(&[contact(1.0)]), 0));
        assert_eq!(all["alight.deck.drone"], 3);
        assert_eq!(all["alight.vessel.drones.3.battery"], 0.78);
        assert_eq!(all["alight.vessel.drones.3.deckDistance"], 12.3);
        let lost = sent(deltas.delta(&status(&[contact(9.0)]), S));
        assert_eq!(lost["alight.vessel.drones.3.received"], false);
        let gone = sent(deltas.delta(&status(&[]), 2 * S));
        assert_eq!(gone["alight.vessel.drones.3.battery"], Value::Null);
        // Null is sent once, and the path is then discarded.
        assert!(deltas.sent.keys().all(|p| !p.contains("drones.3")));
        let later = sent(deltas.delta(&status(&[]), 3 * S));
        assert!(later.keys().all(|p| !p.contains("drones.3")), "{later:?}");
        assert!(
            deltas
                .sent
                .keys()
                .all(|p| p.starts_with("alight.") || p.starts_with("notifications.alight."))
        );
    }
}
