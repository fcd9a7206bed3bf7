//! What a computer knows as deltas for a Signal K server: values below `alight`, and findings as notifications.
//!
//! Nothing of it is a path that the vessel's sensors read (`alight_usv::sensors`): a server gives none of it back as a
//! measurement. What a server sends is no order.

use std::collections::{BTreeMap, BTreeSet};

use alight_computer::situation::Situation;
use alight_shared::frames::{DroneNed, Vector};
use alight_shared::msg::{DroneContact, VesselStatus};
use serde_json::{Value, json};

use crate::status::Status;
use crate::status::finding::{Finding, Level};
use crate::status::vessel::LOST_CONTACT_S;

/// A text that changes, ages in it, is sent again no more often than this, ns.
const TEXT_NS: i64 = 10_000_000_000;
/// The name of what is sent.
const SOURCE: &str = "alight";
/// Decimals of a coordinate in degrees: 1 cm.
const PLACE: f64 = 1e7;

/// What a server has of a path, and since when, ns.
type Sent = (Value, i64);

/// The deltas of a computer.
#[derive(Debug, Default)]
pub struct Deltas {
    sent: BTreeMap<String, Sent>,
    /// Topics of findings that were not fine once: those are reported as normal afterwards.
    topics: BTreeSet<&'static str>,
}

impl Deltas {
    /// The server has nothing any more.
    pub fn forget(&mut self) {
        self.sent.clear();
    }
    /// The delta of what is new at `now_ns`; None without any.
    pub fn delta(&mut self, status: &Status, now_ns: i64) -> Option<String> {
        let mut all = values(status);
        let bad = status.findings.iter().filter(|f| f.level > Level::Fine);
        self.topics.extend(bad.map(|f| f.topic));
        for topic in &self.topics {
            let path = format!("notifications.{SOURCE}.{topic}");
            all.insert(path, notification(&status.findings, topic));
        }
        // What is not known any more: null once, and forgotten.
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
        all.retain(|path, _| !unknown.contains(path));
        self.sent
            .extend(all.into_iter().map(|(path, value)| (path, (value, now_ns))));
        let update = json!({"$source": SOURCE, "values": values});
        Some(json!({"context": "vessels.self", "updates": [update]}).to_string())
    }
}

/// Whether a value is to be sent over the one that a server has. Of a notification its state is what calls people.
fn is_due((sent, at_ns): &Sent, value: &Value, now_ns: i64) -> bool {
    let of = |v: &Value| v.get("state").cloned();
    let is_text = of(value).is_some() && of(value) == of(sent);
    value != sent && (!is_text || now_ns.saturating_sub(*at_ns) >= TEXT_NS)
}

/// The worst findings about a topic.
fn notification(findings: &[Finding], topic: &str) -> Value {
    let all = || findings.iter().filter(|f| f.topic == topic);
    let worst = all().map(|f| f.level).max().unwrap_or_default();
    let (state, method): (_, &[&str]) = match worst {
        Level::Fine => ("normal", &[]),
        Level::Warning => ("warn", &["visual"]),
        Level::Broken => ("alarm", &["visual", "sound"]),
    };
    let text = |f: &Finding| match f.remedy.is_empty() {
        true => f.found.clone(),
        false => format!("{} ({})", f.found, f.remedy),
    };
    let texts: Vec<String> = all().filter(|f| f.level == worst).map(text).collect();
    let message = match texts.is_empty() {
        true => "as it should be".into(),
        false => texts.join("; "),
    };
    json!({"state": state, "method": method, "message": message})
}

/// The values by their paths.
fn values(status: &Status) -> BTreeMap<String, Value> {
    let s = &status.situation;
    let mut all = vec![
        ("running".to_owned(), json!(status.running)),
        ("landing.go".into(), json!(status.go.go)),
        ("landing.why".into(), json!(status.go.why)),
    ];
    if status.running {
        match s.vessel() {
            Some((_, vessel)) => of_vessel(vessel, &mut all),
            None => of_drone(status, s, &mut all),
        }
    }
    let path = |(name, value)| (format!("{SOURCE}.{name}"), value);
    all.into_iter().map(path).collect()
}

fn of_vessel(vessel: &VesselStatus, all: &mut Vec<(String, Value)>) {
    all.extend([
        ("deck.closed".into(), json!(vessel.deck.closed.is_some())),
        ("deck.occupied".into(), json!(vessel.occupied)),
        ("deck.drone".into(), json!(vessel.deck_owner)),
        ("helm.keepCourse".into(), json!(vessel.deck.wants_steady)),
    ]);
    for DroneContact { age_s, status } in vessel.drones.iter() {
        let is_received = *age_s <= LOST_CONTACT_S;
        let distance = status.deck_distance_m.map(|d| rounded(d.into(), 10.0));
        all.extend([
            of(status.header.drone, "received", json!(is_received)),
            of(status.header.drone, "state", json!(status.state.name())),
            of(status.header.drone, "armed", json!(status.armed)),
            of(
                status.header.drone,
                "battery",
                json!(status.battery.map(|b| rounded(b, 100.0))),
            ),
            of(status.header.drone, "deckDistance", json!(distance)),
        ]);
    }
}

fn of_drone(status: &Status, s: &Situation, all: &mut Vec<(String, Value)>) {
    let Some(number) = s.known.drone_id else { return };
    let autopilot = s.seen.autopilot.fresh(s.now_ns);
    let place = s.seen.drone.fresh(s.now_ns).map(|d| {
        let place = d
            .datum
            .at(&Vector::<DroneNed>::from(d.position() - d.datum_offset()));
        json!({
            "latitude": rounded(place.latitude_deg, PLACE),
            "longitude": rounded(place.longitude_deg, PLACE),
            "altitude": rounded(place.height_m, 100.0),
        })
    });
    all.extend([
        of(
            number,
            "state",
            json!(status.state.as_ref().filter(|s| !s.stale).map(|s| &s.name)),
        ),
        of(number, "armed", json!(autopilot.map(|a| a.armed))),
        of(
            number,
            "battery",
            json!(autopilot.and_then(|a| a.battery).map(|b| rounded(b, 100.0))),
        ),
        of(number, "position", json!(place)),
    ]);
}

/// A value of a drone.
fn of(drone: u32, name: &str, value: Value) -> (String, Value) {
    (format!("drones.{drone}.{name}"), value)
}
fn rounded(x: f64, steps: f64) -> f64 {
    (x * steps).round() / steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::finding::Topic;
    use alight_computer::config::VesselComputer;
    use alight_computer::process::facts::Facts;
    use alight_computer::process::snapshot::Snapshot;
    use alight_shared::msg::{DroneStatus, Header, Seq};
    use alight_shared::time::Time;

    const S: i64 = 1_000_000_000;

    fn with_findings(findings: Vec<Finding>) -> Status {
        Status {
            running: true,
            findings,
            ..Status::default()
        }
    }
    /// Paths and values of a delta.
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
        let link = Topic("link");
        let old = |age: &str| {
            with_findings(vec![
                link.warning(format!("{age} old"), "antenna"),
                link.fine("3 % lost"),
            ])
        };
        let first = sent(deltas.delta(&old("1 s"), 0));
        let at = |all: &BTreeMap<String, Value>| all.get("notifications.alight.link").cloned();
        assert_eq!(
            at(&first),
            Some(json!({"state": "warn", "method": ["visual"], "message": "1 s old (antenna)"}))
        );
        // The same again, another text at once, and later.
        assert_eq!(deltas.delta(&old("1 s"), S), None);
        assert_eq!(deltas.delta(&old("2 s"), 2 * S), None);
        assert!(at(&sent(deltas.delta(&old("9 s"), 11 * S))).is_some());
        // Another state at once; what is fine from the start is not sent.
        let broken = with_findings(vec![link.broken("none", ""), Topic("deck").fine("free")]);
        let worse = sent(deltas.delta(&broken, 12 * S));
        assert_eq!(worse.keys().collect::<Vec<_>>(), ["notifications.alight.link"]);
        assert_eq!(at(&worse).unwrap()["method"], json!(["visual", "sound"]));
        let fine = at(&sent(deltas.delta(&with_findings(Vec::new()), 13 * S))).unwrap();
        assert_eq!(
            (&fine["state"], &fine["message"]),
            (&json!("normal"), &json!("as it should be"))
        );
        // A server that was restarted gets all.
        deltas.forget();
        assert!(at(&sent(deltas.delta(&with_findings(Vec::new()), 14 * S))).is_some());
    }

    #[test]
    fn values_of_a_vessel_and_what_is_not_known_any_more() {
        let told = Facts::vessel(&VesselComputer::default()).report;
        let contact = |age_s| DroneContact {
            age_s,
            status: DroneStatus {
                header: Header::new(1, 3, 1, 0, Time::EPOCH),
                battery: Some(0.777),
                deck_distance_m: Some(12.34),
                ..DroneStatus::default()
            },
        };
        let status = |drones: &[DroneContact]| {
            let mut seen = Snapshot {
                computer: told.into(),
                ..Snapshot::default()
            };
            seen.vessel.set(
                0,
                Some(VesselStatus {
                    deck_owner: Some(3),
                    drones: Seq::filled(drones.iter().copied()),
                    ..VesselStatus::default()
                }),
            );
            Status::of(Situation::of(&seen, 0))
        };
        let mut deltas = Deltas::default();
        let all = sent(deltas.delta(&status(&[contact(1.0)]), 0));
        assert_eq!(all["alight.deck.drone"], 3);
        assert_eq!(all["alight.drones.3.battery"], 0.78);
        assert_eq!(all["alight.drones.3.deckDistance"], 12.3);
        let lost = sent(deltas.delta(&status(&[contact(9.0)]), S));
        assert_eq!(lost["alight.drones.3.received"], false);
        let gone = sent(deltas.delta(&status(&[]), 2 * S));
        assert_eq!(gone["alight.drones.3.battery"], Value::Null);
        // It is said once, and kept no longer.
        assert!(deltas.sent.keys().all(|p| !p.contains("drones.3")));
        let later = sent(deltas.delta(&status(&[]), 3 * S));
        assert!(later.keys().all(|p| !p.contains("drones.3")), "{later:?}");
        // No path is one that a sensor is read from.
        assert!(
            deltas
                .sent
                .keys()
                .all(|p| p.starts_with("alight.") || p.starts_with("notifications.alight."))
        );
    }
}
