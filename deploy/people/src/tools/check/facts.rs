//! Facts that `alight check` judges, as plain data, so that the rules can be tested on any computer.

use std::path::PathBuf;

use alight_computer::{situation::SourceHealth, subject::Computer};
use alight_shared::{
    autopilot_parameters::Parameter,
    geodesy::Datum,
    mavlink::Signatures,
    msg::{Certificate, DeckDimensions, Reason, RelativeState, SourceStatus},
    tags::ForeignTag,
};
use alight_uav::{autopilot::receiver::RelativeReport, camera::metering::Setting};
use alight_usv::sensors::Remark;

use crate::tools::check::received::SensorStatistics;

#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    pub authority: Result<Certificate, String>,
    pub own: Result<Certificate, String>,
    pub key: Result<(), String>,
    /// Permission bits; None if the key is missing.
    pub key_mode: Option<u32>,
    /// Whether key and certificate match; None if either cannot be read.
    pub key_fits: Option<bool>,
    /// Whether the authority issued the certificate, by the key identifiers in both; None if either has none.
    pub of_authority: Option<bool>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ClockSync {
    pub source: &'static str,
    pub synchronised: bool,
    pub error_s: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Port {
    pub key: &'static str,
    pub address: String,
    pub state: PortState,
}

#[derive(Clone, Debug, PartialEq)]
pub enum PortState {
    Free,
    Busy,
    Unavailable(String),
    /// The address cannot be tried here.
    Untried,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Reach {
    Answers,
    Unreachable(String),
    /// Datagrams: a route exists; the peer does not reply before the session.
    Routed,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SourceCheck {
    pub name: String,
    pub connect: String,
    /// Number of bytes received and their decoding status, or the reason why nothing can be received.
    pub received: Result<(usize, SourceStatus), String>,
    pub remarks: Vec<Remark>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeckInputCheck {
    pub key: &'static str,
    pub path: String,
    pub level: Result<bool, String>,
}

/// The drone's own GNSS receiver; the vessel's receiver is its moving base.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceiverCheck {
    pub connect: String,
    pub report: ReceiverReport,
}

#[derive(Clone, Debug, PartialEq)]
pub enum ReceiverReport {
    Unreachable(String),
    Received {
        bytes: usize,
        newest: Option<RelativeReport>,
    },
    /// A running process owns the receiver.
    Held {
        rtcm: u64,
        /// State of the relative position in the forecast.
        state: Option<RelativeState>,
    },
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutopilotReport {
    /// Parameters that a landing needs and that are unsuitable or unreported, with the reason.
    pub parameters: Vec<(&'static Parameter, Reason)>,
    /// Origin of its NED frame, with the height above the sea.
    pub origin: Option<Datum>,
    /// Height of the sea above the ellipsoid by its receiver, m.
    pub geoid_m: Option<f64>,
    /// It answers TIMESYNC, so that its samples have a time.
    pub dates: bool,
    /// System ids of two vehicles whose autopilots are both received while no vehicle is configured.
    pub several: Option<[u8; 2]>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SigningCheck {
    pub path: String,
    /// Permissions of the key file, or the reason why it contains no key.
    pub key: Result<u32, String>,
    pub received: Signatures,
    pub admitted: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SharedMemory {
    /// Free space, bytes; None if the system does not report it.
    pub free_bytes: Option<u64>,
    pub writable: Result<(), String>,
    /// The instance's directory, or the reason why this user cannot use it.
    pub directory: Result<PathBuf, String>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraImages {
    pub images: u64,
    /// Exposure setting, or the reason why the device's automatic exposure is in use; None if the exposure is not
    /// controlled.
    pub exposure: Option<Result<Setting, String>>,
    /// Contrast and saturation of the tag, 0 to 1; None if no tag was detected.
    pub tag: Option<[f64; 2]>,
    /// Mean grey level of an image that is too dark for detecting tags.
    pub dark: Option<f64>,
    /// Foreign tag in the image, if none of the deck's was detected.
    pub foreign_tag: Option<ForeignTag>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct CameraCheck {
    pub key: &'static str,
    pub lens: &'static str,
    pub source: String,
    pub there: Result<(), String>,
    pub calibrated: bool,
    pub view: Option<Result<CameraImages, String>>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct CheckFacts {
    pub config: PathBuf,
    pub computer: Result<Computer, String>,
    pub running: bool,
    pub identity: Option<Identity>,
    pub zenoh: Option<String>,
    pub clock_s: i64,
    pub sync: Option<ClockSync>,
    pub memory: Option<SharedMemory>,
    pub ports: Vec<Port>,
    /// Addresses to dial, and whether they answer.
    pub dialled: Vec<(String, Reach)>,
    /// Configured address of the autopilot's link, and whether it can be opened; None if not configured.
    pub autopilot: Option<(String, Result<Reach, String>)>,
    pub signing: Option<SigningCheck>,
    /// Report on the autopilot, None without its heartbeat; outer None if another program owns the link or it cannot
    /// be opened.
    pub reported: Option<Option<AutopilotReport>>,
    pub receiver: Option<ReceiverCheck>,
    /// Origin of a running drone's frame and distance to the deck, m; None if no process runs or they are unknown.
    pub frame: Option<(Datum, Option<f64>)>,
    /// Dead time and time constant of the attitude response, s, from the newest flight that identified them; None
    /// without such a flight.
    pub flown: Option<[f64; 2]>,
    pub vessel_deck: Option<DeckDimensions>,
    pub cameras: Vec<CameraCheck>,
    /// Real sensors of the vessel that this command received.
    pub sources: Vec<SourceCheck>,
    pub measured: SensorStatistics,
    /// Sensors owned by the running process, as it reports them.
    pub held_sources: Vec<SourceHealth>,
    pub deck_inputs: Vec<DeckInputCheck>,
    /// Frequency governor of each processor; empty without frequency scaling.
    pub governors: Vec<String>,
    /// Whether this user may request real-time priority.
    pub realtime: bool,
    pub processors: usize,
}
