//! Records, all in MCAP: the flight recorder's files, which every process writes by itself ([`flight`]),
//! and recordings, a flight in one file, to look at and to compute again.
//!
//! A recording holds, with the world's time as log time,
//! - `/node/*`: each step of each node, bit for bit ([`entry`]); the configurations are
//!   attachments. [`replay`] feeds them to new nodes and compares every output.
//! - everything else: Foxglove's well-known schemas where there is one and messages of numbers
//!   ([`schema`]) where there is none, at display rates ([`views`]).

pub mod cloud;
pub mod entry;
pub mod flight;
pub mod geometry;
pub mod onlooker;
mod outline;
pub mod reading;
pub mod readings;
mod recorder;
pub mod replay;
pub mod schema;
pub mod shapes;
pub mod sink;
pub mod views;

pub use recorder::Recorder;

/// The nodes in data-flow order.
pub const NODES: [&str; 6] = ["vessel", "bridge", "predictor", "mission", "planner", "pilot"];
/// Name of the metadata that says what was recorded.
const RECORDING: &str = "recording";
/// Name of the attached configuration of the vessel's side.
pub const VESSEL_FILE: &str = "vessel.toml";
/// Name of the attached configuration of the deck arbiter.
pub const DECK_FILE: &str = "deck.toml";
/// Name of the attached configuration of the drone's side.
pub const DRONE_FILE: &str = "drone.toml";
/// Metadata: 1 when the mission was a process, which begins by waiting for a predecessor's checkpoint.
pub const LIVE: &str = "live";

/// Name of a node's boot id.
fn boot(node: &str) -> String {
    format!("boot_{node}")
}
/// Where a node's steps are.
fn topic(node: &str) -> String {
    format!("/node/{node}")
}
