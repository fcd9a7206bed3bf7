//! Messages of a Signal K server, and an update's values. Paths, units and signs: specification 1.7.

use serde::Deserialize;
use serde_json::Value;

use crate::sensors::bus::{Content, GnssReport};

/// The server's greeting, or a delta.
#[derive(Debug, Deserialize)]
pub(super) struct DeltaMessage {
    /// Own vessel of the server, in its greeting.
    #[serde(rename = "self")]
    pub(super) own: Option<String>,
    /// Vessel of the values; None: the server's own.
    pub(super) context: Option<String>,
    /// Each update is parsed separately ([`DeltaUpdate::read`]), so that a malformed one affects no other.
    #[serde(default)]
    pub(super) updates: Vec<Value>,
}

/// Values from one source at one time.
#[derive(Debug, Deserialize)]
pub(super) struct DeltaUpdate {
    #[serde(rename = "$source")]
    source: Option<String>,
    /// Source in parts, as sent by servers that do not name their sources.
    #[serde(rename = "source")]
    parts: Option<Parts>,
    pub(super) timestamp: Option<String>,
    /// None if the update only describes paths (metadata).
    #[serde(default)]
    pub(super) values: Vec<PathValue>,
}

#[derive(Debug, Deserialize)]
struct Parts {
    label: Option<String>,
    /// Address on NMEA 2000, or talker on NMEA 0183.
    src: Option<Value>,
    talker: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct PathValue {
    pub(super) path: String,
    #[serde(default)]
    value: Value,
}

impl PathValue {
    /// Whether the device reports a null value now.
    pub(super) fn is_missing(&self) -> bool {
        READ.contains(&self.path.as_str()) && self.value.is_null()
    }
}

impl DeltaUpdate {
    /// Parses an update; None if malformed.
    pub(super) fn read(update: &Value) -> Option<DeltaUpdate> {
        DeltaUpdate::deserialize(update).ok()
    }
    pub(super) fn source(&self) -> String {
        let parts = || {
            let parts = self.parts.as_ref()?;
            let src = parts.src.as_ref().map(Value::to_string);
            let of = src.or_else(|| parts.talker.clone()).unwrap_or_default();
            Some(format!("{}.{of}", parts.label.as_deref().unwrap_or_default()))
        };
        self.source.clone().or_else(parts).unwrap_or_default()
    }
    fn value(&self, path: &str) -> Option<&Value> {
        self.values.iter().find(|v| v.path == path).map(|v| &v.value)
    }
    fn number(&self, path: &str) -> Option<f64> {
        self.value(path)?.as_f64()
    }
    /// Speed over ground (m/s), and course, if any (rad, and whether it is magnetic).
    pub(super) fn over_ground(&self) -> (Option<f64>, Option<(f64, bool)>) {
        let course = |path, magnetic| self.number(path).map(|course| (course, magnetic));
        let of_north = course("navigation.courseOverGroundTrue", false);
        let of_magnetic = || course("navigation.courseOverGroundMagnetic", true);
        let speed = self.number("navigation.speedOverGround");
        (speed, of_north.or_else(of_magnetic))
    }
    /// Contents of the delta with names for remarks, without the velocity.
    pub(super) fn contents(&self) -> Vec<(&'static str, Content)> {
        // Contents needed by others come first.
        let all = [
            (
                "magneticVariation",
                self.number("navigation.magneticVariation")
                    .map(Content::Variation),
            ),
            (
                "rateOfTurn",
                self.number("navigation.rateOfTurn").map(Content::Rate),
            ),
            ("heave", self.number("environment.heave").map(Content::Heave)),
            ("attitude", self.attitude()),
            ("heading", self.heading()),
            ("position", self.position()),
        ];
        all.into_iter()
            .filter_map(|(name, content)| Some((name, content?)))
            .collect()
    }
    fn attitude(&self) -> Option<Content> {
        let value = self.value("navigation.attitude")?;
        let angle = |name| value.get(name)?.as_f64();
        Some(Content::Attitude([angle("roll")?, angle("pitch")?]))
    }
    fn heading(&self) -> Option<Content> {
        let of_north = self.number("navigation.headingTrue");
        // A magnetic heading already includes the compass's deviation.
        let heading = of_north.or_else(|| self.number("navigation.headingMagnetic"))?;
        Some(Content::Heading {
            heading,
            variation: self.number("navigation.magneticVariation"),
            deviation: None,
            magnetic: of_north.is_none(),
        })
    }
    fn position(&self) -> Option<Content> {
        let value = self.value("navigation.position")?;
        let number = |name| value.get(name)?.as_f64();
        let place = [number("latitude")?, number("longitude")?];
        let of_receiver = |name: &str| self.value(&format!("navigation.gnss.{name}"));
        let receiver_number = |name| of_receiver(name)?.as_f64();
        let quality = of_receiver("methodQuality").and_then(Value::as_str).map(quality);
        let altitude_m = receiver_number("antennaAltitude").or(number("altitude"));
        let hdop = receiver_number("horizontalDilution");
        let integrity = of_receiver("integrity").and_then(Value::as_str);
        let caution = integrity.is_some_and(|i| i.eq_ignore_ascii_case("caution"));
        if quality.is_none() && altitude_m.is_none() && hdop.is_none() && !caution {
            return Some(Content::Position(place));
        }
        Some(Content::Gnss(GnssReport {
            place,
            altitude_m,
            separation_m: receiver_number("geoidalSeparation"),
            quality: quality.unwrap_or(1),
            hdop,
            caution,
        }))
    }
}

/// Paths read besides those of `navigation.gnss`.
const READ: [&str; 11] = [
    "navigation.position",
    "navigation.speedOverGround",
    "navigation.courseOverGroundTrue",
    "navigation.courseOverGroundMagnetic",
    "navigation.headingTrue",
    "navigation.headingMagnetic",
    "navigation.magneticVariation",
    "navigation.attitude",
    "navigation.rateOfTurn",
    "navigation.gnss",
    "environment.heave",
];

pub(super) fn is_read(path: &str) -> bool {
    READ.contains(&path) || path.starts_with("navigation.gnss.")
}

/// Quality as in GGA from its name in Signal K; an unknown name is not a fix.
fn quality(name: &str) -> u8 {
    match name.to_ascii_lowercase().as_str() {
        "gnss fix" => 1,
        "dgnss fix" => 2,
        "precise gnss" => 3,
        "rtk fixed integer" => 4,
        "rtk float" => 5,
        "estimated (dr) mode" => 6,
        "manual input" => 7,
        "simulator mode" => 8,
        _ => 0,
    }
}
