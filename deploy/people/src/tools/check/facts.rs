//! Facts that `alight check` judges: plain data, so that the rules can be tested on any computer.

use std::path::PathBuf;

use alight_computer::situation::SourceHealth;
use alight_computer::subject::Computer;
use alight_shared::autopilot_parameters::Parameter;
use alight_shared::geodesy::Datum;
use alight_shared::mavlink::Signatures;
use alight_shared::msg::{Certificate, Reason, SourceStatus};
use alight_uav::camera::metering::Setting;
use alight_uav::camera::strangers::Stranger;
use alight_usv::helm::HelmBearings;
use alight_usv::sensors::Remark;

use crate::tools::check::received::Measured;

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

/// How the system's clock is kept.
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
    /// What trying it gave.
    pub state: PortState,
}

/// What trying an address gave.
#[derive(Clone, Debug, PartialEq)]
pub enum PortState {
    /// Free.
    Free,
    /// Somebody listens there.
    Busy,
    /// The system refuses it; its error.
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
    /// Its name.
    pub name: String,
    /// Where it is.
    pub connect: String,
    /// Bytes that came and what became of them, or why none can come.
    pub received: Result<(usize, SourceStatus), String>,
    /// What else is to be said of its bytes.
    pub remarks: Vec<Remark>,
}

/// A digital input of the vessel's deck.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeckInputCheck {
    /// Its key in the configuration.
    pub key: &'static str,
    /// Its file.
    pub path: String,
    /// Whether it is active, or why that cannot be known.
    pub level: Result<bool, String>,
}

/// The boat's autopilot that the vessel's computer may steer by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HelmCheck {
    /// Where it is.
    pub connect: String,
    /// What it reports, or why it cannot be steered.
    pub report: Result<HelmReport, String>,
}

/// What is known of a boat's autopilot without steering by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HelmReport {
    /// Its heartbeats come.
    Answers,
    /// They come, in the mode in which it takes set-points.
    SteeredAlready,
    /// Its link is open, and it need not report anything; it is sent these bearings.
    Open(HelmBearings),
    /// The process that runs has it.
    Held,
}

/// What an autopilot reported.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutopilotReport {
    /// Of the parameters that a landing relies on those that do not suit or were not reported, with the reason.
    pub parameters: Vec<(&'static Parameter, Reason)>,
    /// Where its NED begins, the height above the sea.
    pub origin: Option<Datum>,
    /// Height of the sea above the ellipsoid by its receiver, m.
    pub geoid_m: Option<f64>,
    /// Its system and another vehicle's, whose autopilot is received while none is configured.
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

/// What a camera shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraView {
    /// Images.
    pub images: u64,
    /// What exposes: the setting, or why the device's own automatic does; None where nothing is asked of it.
    pub exposure: Option<Result<Setting, String>>,
    /// Contrast and saturation of the tag, 0 to 1; None when it was not detected.
    pub tag: Option<[f64; 2]>,
    /// Too dark for a tag to be detected: the image's mean, grey levels.
    pub dark: Option<f64>,
    /// A tag that is none of the deck's, where none of these was detected.
    pub stranger: Option<Stranger>,
}

/// One of the drone's cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraCheck {
    /// Its table in the configuration.
    pub key: &'static str,
    /// The table of its lens.
    pub lens: &'static str,
    /// Its source as configured.
    pub source: String,
    /// Whether that can be read.
    pub there: Result<(), String>,
    /// Whether the lens was calibrated.
    pub calibrated: bool,
    /// What it shows, or why nothing; None where that cannot be looked at.
    pub view: Option<Result<CameraView, String>>,
}

/// Everything that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// The configuration's file.
    pub config: PathBuf,
    /// Its content, or why it was refused.
    pub computer: Result<Computer, String>,
    /// Alight runs here already.
    pub running: bool,
    /// Certificates; None when the configuration names none.
    pub identity: Option<Identity>,
    /// Why the file of Zenoh's own configuration cannot be used, if it cannot.
    pub zenoh: Option<String>,
    /// The system's clock, s since 1970.
    pub clock_s: i64,
    /// How it is kept; None when no program reports it.
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
    /// What the autopilot reported, None when no heartbeat of one came; None when the link is another's or cannot be had.
    pub reported: Option<Option<AutopilotReport>>,
    /// Where the frame of a running drone begins, and how far away the deck is, m; None while nothing runs or is known.
    pub frame: Option<(Datum, Option<f64>)>,
    /// Dead time and time constant of the attitude that the newest flight with a response identified, s; None without one.
    pub flown: Option<[f64; 2]>,
    /// Each camera that is configured.
    pub cameras: Vec<CameraCheck>,
    /// The vessel's real sensors that were listened to.
    pub sources: Vec<SourceCheck>,
    /// What all of those gave, in figures.
    pub measured: Measured,
    /// Those that the running process has, as it reports them.
    pub held_sources: Vec<SourceHealth>,
    /// The deck's digital inputs that are configured.
    pub deck_inputs: Vec<DeckInputCheck>,
    /// The boat's autopilot; None where no helm is configured.
    pub helm: Option<HelmCheck>,
    /// How the frequency of each processor is chosen; empty without frequency scaling.
    pub governors: Vec<String>,
    /// This user may ask for real-time priority.
    pub realtime: bool,
    /// Processors.
    pub processors: usize,
}
