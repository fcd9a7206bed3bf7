//! Picture of the page: a complete JSON object, so that a viewer that missed some pictures shows the newest.

use serde::Serialize;

use crate::status::Status;

/// Position relative to the deck's centre at the same time: forward along the vessel's mean heading, to starboard,
/// up, m.
pub type DeckPoint = [f64; 3];

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DroneView {
    pub at: DeckPoint,
    /// Rate at which the height above the deck's centre decreases, m/s.
    pub closing_mps: f64,
    /// Roll, pitch, and heading relative to the vessel's mean heading, deg.
    pub euler_deg: [f64; 3],
    pub stale: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContactView {
    pub in_s: f64,
    /// Roll and pitch of the deck at the contact, deg; None if the forecast ends before the contact.
    pub tilt_deg: Option<[f64; 2]>,
    /// Height of the deck at the contact minus its present height, m; None if the forecast ends before the contact.
    pub rise_m: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneView {
    pub size_m: Option<[f64; 2]>,
    /// Roll and pitch of the deck, and its heading relative to the mean heading, deg.
    pub euler_deg: [f64; 3],
    pub heading_deg: f64,
    /// Mean velocity of the vessel over ground, forward and to starboard, m/s.
    pub way_mps: [f64; 2],
    /// Depth of the foot plane below the drone's centre of mass, m, if known.
    pub feet_m: Option<f64>,
    /// Height of the deck's centre above the water at rest, m, if known.
    pub freeboard_m: Option<f64>,
    /// Clearance of the feet at which the flare begins, m, once the mission has reported it.
    pub flare_m: Option<f64>,
    /// Greatest inclination of a deck to land on, deg, if known.
    pub limit_deg: Option<f64>,
    pub contact: Option<ContactView>,
    pub forecast_stale: bool,
    /// Planned positions of the drone's centre of mass, until the planned contact.
    pub plan: Vec<DeckPoint>,
    pub plan_stale: bool,
    pub drone: Option<DroneView>,
}

/// Recent motion of the deck, oldest first; None if unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MotionView {
    pub step_s: f64,
    pub roll_deg: Vec<Option<f64>>,
    pub pitch_deg: Vec<Option<f64>>,
    /// Heave above the mean, m.
    pub heave_m: Vec<Option<f64>>,
}

/// Positions of drone and deck over ground every two seconds, oldest first: metres to north and east of the deck's
/// newest position; None if unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TrackView {
    pub drone: Vec<Option<[f64; 2]>>,
    pub deck: Vec<Option<[f64; 2]>>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogLine {
    pub ago_s: f64,
    pub text: String,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResultView {
    pub ago_s: f64,
    /// Landed or gave up.
    pub outcome: &'static str,
    pub text: String,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightLine {
    /// Time since its end, or the date.
    pub when: String,
    pub outcome: String,
    pub text: String,
}

/// Newest image of the drone's camera. The page requests the image separately and computes its age.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraView {
    /// Number that changes with each image.
    pub number: i64,
    /// Time since the middle of its exposure, s.
    pub age_s: f64,
    pub text: String,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OrderView {
    /// Text of the button; None if the page may not give the order.
    pub label: Option<&'static str>,
    /// Names of further orders, each with a separate button.
    pub others: &'static [&'static str],
    /// Result of the newest order; empty without an order.
    pub answer: String,
}

/// The object of `alight status --json`, extended by the parts that only the page has.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Picture {
    /// Time of sending on a steady clock, s, from which a page that shows the picture late computes its age.
    pub clock_s: f64,
    #[serde(flatten)]
    pub status: Status,
    pub scene: Option<SceneView>,
    pub camera: Option<CameraView>,
    pub motion: MotionView,
    pub track: TrackView,
    pub log: Vec<LogLine>,
    pub flights: Vec<FlightLine>,
    /// Newest flight that ended while the server was running.
    pub result: Option<ResultView>,
    pub order: OrderView,
    /// Text at the end of a simulation or recording, after which no data arrive.
    pub over: Option<&'static str>,
    pub begins_in_s: Option<f64>,
}
