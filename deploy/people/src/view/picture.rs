//! Picture of the page: a JSON object that needs none before it, so that a viewer that missed some shows the newest.

use serde::Serialize;

use crate::status::Status;

/// Something on a path or a body: forward of the deck's centre at the same time along the vessel's mean heading, to
/// starboard, up, m.
pub type DeckPoint = [f64; 3];

/// The drone next to the deck.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DroneView {
    /// The centre of mass.
    pub at: DeckPoint,
    /// The speed at which its height above the deck's centre shrinks, m/s.
    pub closing_mps: f64,
    /// Roll, pitch, and heading against the vessel's mean heading, deg.
    pub euler_deg: [f64; 3],
    /// Whether its odometry is old.
    pub stale: bool,
}

/// The contact that is planned.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContactView {
    /// Until then, s.
    pub in_s: f64,
    /// Roll and pitch of the deck then, deg; None: the forecast ends before.
    pub tilt_deg: Option<[f64; 2]>,
    /// The deck's height then less its height now, m; None: the forecast ends before.
    pub rise_m: Option<f64>,
}

/// The deck from above and from the side.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneView {
    /// Length and width of the deck, m, where they are known.
    pub size_m: Option<[f64; 2]>,
    /// Roll and pitch of the deck, and its heading against its mean heading, deg.
    pub euler_deg: [f64; 3],
    /// The vessel's mean heading, deg.
    pub heading_deg: f64,
    /// The vessel's mean velocity over ground, forward and to starboard, m/s.
    pub way_mps: [f64; 2],
    /// The foot plane below the drone's centre of mass, m, where it is known.
    pub feet_m: Option<f64>,
    /// The deck's centre above the water at rest, m, where it is known.
    pub freeboard_m: Option<f64>,
    /// The feet's clearance at which the flare begins, m, once the mission has named it.
    pub flare_m: Option<f64>,
    /// The planned contact, while a plan means to touch.
    pub contact: Option<ContactView>,
    /// No forecast came recently.
    pub forecast_stale: bool,
    /// Planned places of the drone's centre of mass, until the planned contact.
    pub plan: Vec<DeckPoint>,
    /// No plan came recently.
    pub plan_stale: bool,
    pub drone: Option<DroneView>,
}

/// The deck's recent motion, oldest first; None where nothing was known.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MotionView {
    /// Time between two samples, s.
    pub step_s: f64,
    /// Roll, deg.
    pub roll_deg: Vec<Option<f64>>,
    /// Pitch, deg.
    pub pitch_deg: Vec<Option<f64>>,
    /// Upwards against the mean, m.
    pub heave_m: Vec<Option<f64>>,
}

/// Places of drone and deck over ground, one sample every two seconds, oldest first: metres to north and east of the newest
/// place of the deck; None where it was not known.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TrackView {
    pub drone: Vec<Option<[f64; 2]>>,
    /// The deck's centre.
    pub deck: Vec<Option<[f64; 2]>>,
}

/// A line of what happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogLine {
    /// So long ago, s.
    pub ago_s: f64,
    pub text: String,
}

/// The flight that ended last.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResultView {
    /// So long ago, s.
    pub ago_s: f64,
    /// Outcome: landed, gave up.
    pub outcome: &'static str,
    /// Why, and its figures.
    pub text: String,
}

/// A flight that ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlightLine {
    /// When it ended: so long ago, or a date.
    pub when: String,
    /// Outcome: landed, gave up.
    pub outcome: String,
    /// Why, and its figures.
    pub text: String,
}

/// The newest image of the drone's camera, which the page asks for by itself, and whose age the page computes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraView {
    /// It differs from that of the image before.
    pub number: i64,
    /// Since the middle of its exposure, s.
    pub age_s: f64,
    /// Detections in it.
    pub text: String,
}

/// The one order that the page can give.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OrderView {
    /// Text of the button; None: it may not be given from here.
    pub label: Option<&'static str>,
    /// Result of the newest order; empty: none was given.
    pub answer: String,
}

/// All of it: the object of `alight status --json`, and what only the page knows.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Picture {
    /// When it was sent, on a steady clock, s: a page that shows it late computes its age.
    pub clock_s: f64,
    #[serde(flatten)]
    pub status: Status,
    /// Deck and drone; None: not known.
    pub scene: Option<SceneView>,
    /// Image of the drone's camera; None: it has none, or none that runs.
    pub camera: Option<CameraView>,
    /// The deck's motion.
    pub motion: MotionView,
    /// Over ground.
    pub track: TrackView,
    /// Events of this run, the newest first.
    pub log: Vec<LogLine>,
    /// Flights that ended, the newest first.
    pub flights: Vec<FlightLine>,
    /// The newest flight that ended while the server was looking on.
    pub result: Option<ResultView>,
    /// The order that the page may give.
    pub order: OrderView,
}
