//! Facts that `alight check` judges: plain data, so that the rules can be tested on any computer.

use std::path::PathBuf;

use alight_computer::situation::SourceHealth;
use alight_computer::subject::Computer;
use alight_shared::autopilot_parameters::Parameter;
use alight_shared::geodesy::Datum;
use alight_shared::mavlink::Signatures;
use alight_shared::msg::{Certificate, DeckDimensions, Reason, RelativeState, SourceStatus};
use alight_uav::autopilot::receiver::RelativeReport;
use alight_uav::camera::metering::Setting;
use alight_uav::camera::strangers::Stranger;
use alight_usv::sensors::Remark;

use crate::tools::check::received::SensorStatistics;

/// The three files of the radio's tls section.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    /// Whom we trust, or why it cannot be read.
    pub authority: Result<Certificate, String>,
    /// Who we are.
    pub own: Result<Certificate, String>,
    /// Whether the key is readable, or why not.
    pub key: Result<(), String>,
    /// The key's permission bits; None when it is not there.
    pub key_mode: Option<u32>,
    /// The key belongs to the certificate; None when one of them cannot be read.
    pub key_fits: Option<bool>,
    /// The authority made the certificate, by the key identifiers in both; None when one lacks it.
    pub of_authority: Option<bool>,
}

/// Synchronisation of the system's clock.
#[derive(Clone, Debug, PartialEq)]
pub struct ClockSync {
    /// The program that reports it.
    pub source: &'static str,
    /// In step with a reference.
    pub synchronised: bool,
    /// Estimated error, s.
    pub error_s: Option<f64>,
}

/// An address that the program will listen on.
#[derive(Clone, Debug, PartialEq)]
pub struct Port {
    /// The key in the configuration.
    pub key: &'static str,
    /// The endpoint or address as it stands there.
    pub address: String,
    /// Result of trying it.
    pub state: PortState,
}

/// Result of trying an address.
#[derive(Clone, Debug, PartialEq)]
pub enum PortState {
    Free,
    /// Somebody listens there.
    Busy,
    /// The system rejects it; its error.
    Unavailable(String),
    /// Not an address that can be tried here.
    Untried,
}

/// Whether the other end answers.
#[derive(Clone, Debug, PartialEq)]
pub enum Reach {
    /// It took a connection.
    Answers,
    /// It did not; the system's error.
    Unreachable(String),
    /// Datagrams: no answer before the session; there is a route.
    Routed,
}

/// A real sensor, listened to.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceCheck {
    pub name: String,
    pub connect: String,
    /// Bytes that came and what became of them, or why none can come.
    pub received: Result<(usize, SourceStatus), String>,
    /// Remarks on its bytes.
    pub remarks: Vec<Remark>,
}

/// A digital input of the vessel's deck.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeckInputCheck {
    /// The key in the configuration.
    pub key: &'static str,
    pub path: String,
    /// Whether it is active, or why that cannot be known.
    pub level: Result<bool, String>,
}

/// The drone's own GNSS receiver, whose moving base is the vessel's.
#[derive(Clone, Debug, PartialEq)]
pub struct ReceiverCheck {
    pub connect: String,
    pub report: ReceiverReport,
}

/// Report of the drone's own GNSS receiver.
#[derive(Clone, Debug, PartialEq)]
pub enum ReceiverReport {
    /// Nothing can come from it; the reason.
    Unreachable(String),
    /// It was listened to.
    Received {
        /// Bytes that came.
        bytes: usize,
        /// Newest report among them.
        newest: Option<RelativeReport>,
    },
    /// The process that runs has it.
    Held {
        /// Frames of RTCM that were passed on to it.
        rtcm: u64,
        /// State of the relative place in the forecast.
        state: Option<RelativeState>,
    },
}

/// Report of an autopilot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutopilotReport {
    /// Parameters that a landing relies on and that do not suit or were not reported, with the reason.
    pub parameters: Vec<(&'static Parameter, Reason)>,
    /// Origin of its NED, the height above the sea.
    pub origin: Option<Datum>,
    /// Height of the sea above the ellipsoid by its receiver, m.
    pub geoid_m: Option<f64>,
    /// The system and another vehicle's, whose autopilot is received while none is configured.
    pub several: Option<[u8; 2]>,
}

/// Signing of the autopilot's link.
#[derive(Clone, Debug, PartialEq)]
pub struct SigningCheck {
    /// The file with its key, as configured; empty: none.
    pub path: String,
    /// Permissions of that file, or why it holds no key.
    pub key: Result<u32, String>,
    /// Frames received by their signatures.
    pub received: Signatures,
    /// The autopilot's are admitted.
    pub admitted: bool,
}

/// The place for shared memory.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedMemory {
    /// Free, bytes; None when the system does not report it.
    pub free_bytes: Option<u64>,
    /// Whether a file can be made there, or why not.
    pub writable: Result<(), String>,
    /// Whether the instance's directory can be used by this user, or why not.
    pub directory: Result<PathBuf, String>,
}

/// Image of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraImages {
    pub images: u64,
    /// The setting that exposes, or why the device's own automatic does; None where nothing is asked of it.
    pub exposure: Option<Result<Setting, String>>,
    /// Contrast and saturation of the tag, 0 to 1; None when it was not detected.
    pub tag: Option<[f64; 2]>,
    /// Too dark for a tag to be detected: the image's mean, grey levels.
    pub dark: Option<f64>,
    /// A tag of another deck, where none of this deck's was detected.
    pub stranger: Option<Stranger>,
}

/// One of the drone's cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraCheck {
    /// The table in the configuration.
    pub key: &'static str,
    /// The table of its lens.
    pub lens: &'static str,
    /// The source as configured.
    pub source: String,
    /// Whether that can be read.
    pub there: Result<(), String>,
    /// Whether the lens was calibrated.
    pub calibrated: bool,
    /// The image, or why it is missing; None where that cannot be looked at.
    pub view: Option<Result<CameraImages, String>>,
}

/// Everything that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckFacts {
    /// The configuration's file.
    pub config: PathBuf,
    /// The content, or why it was rejected.
    pub computer: Result<Computer, String>,
    /// Alight runs here already.
    pub running: bool,
    /// Certificates; None when the configuration names none.
    pub identity: Option<Identity>,
    /// Why the file of Zenoh's own configuration cannot be used, if it cannot.
    pub zenoh: Option<String>,
    /// The system's clock, s since 1970.
    pub clock_s: i64,
    /// The synchronisation; None when no program reports it.
    pub sync: Option<ClockSync>,
    /// Shared memory; the drone's processes need it.
    pub memory: Option<SharedMemory>,
    /// Addresses to listen on.
    pub ports: Vec<Port>,
    /// Addresses to dial, and whether they answer.
    pub dialled: Vec<(String, Reach)>,
    /// The autopilot's link as configured, and whether it can be had; None where none is.
    pub autopilot: Option<(String, Result<Reach, String>)>,
    /// MAVLink's signing; None where no autopilot is configured.
    pub signing: Option<SigningCheck>,
    /// Report of the autopilot, None when no heartbeat of one came; None when the link is another's or cannot be had.
    pub reported: Option<Option<AutopilotReport>>,
    /// The drone's own GNSS receiver; None where none is configured.
    pub receiver: Option<ReceiverCheck>,
    /// Origin of the frame of a running drone, and the distance of the deck, m; None while nothing runs or is known.
    pub frame: Option<(Datum, Option<f64>)>,
    /// Dead time and time constant of the attitude that the newest flight with a response identified, s; None without one.
    pub flown: Option<[f64; 2]>,
    /// Dimensions of the deck as the vessel states them to running processes; None: not received.
    pub vessel_deck: Option<DeckDimensions>,
    /// Each camera that is configured.
    pub cameras: Vec<CameraCheck>,
    /// The vessel's real sensors that were listened to.
    pub sources: Vec<SourceCheck>,
    /// Statistics of all those.
    pub measured: SensorStatistics,
    /// Those that the running process has, as it reports them.
    pub held_sources: Vec<SourceHealth>,
    /// The deck's digital inputs that are configured.
    pub deck_inputs: Vec<DeckInputCheck>,
    /// Frequency governor of each processor; empty without frequency scaling.
    pub governors: Vec<String>,
    /// This user may ask for real-time priority.
    pub realtime: bool,
    pub processors: usize,
}
