//! Messages between the processes of the vessel's computer: its deck, its sensors, the crew's orders.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    AttitudeFix, Course, CourseAdvice, DroneStatus, GnssFix, Header, HeadingFix, ImuSample, Seq, Text,
};
use crate::time::VesselClock;

/// Real sensors of a vessel, at most: each source of bytes may be two of measurements ([`super::MAX_SOURCES`]).
pub const MAX_DEVICES: usize = super::MAX_SOURCES / 2;
/// Drones that a status names, at most.
pub const MAX_NAMED: usize = 16;
/// The crew's newest orders that a status names.
pub const MAX_ORDERS: usize = 8;
/// A text for the crew in a status.
pub type Line = Text<240>;

/// A clearance for a take-off lasts so long, s: its checks, the countdown and the wait for the moment.
pub const TAKE_OFF_CLEARANCE_S: f64 = 120.0;
/// A standing one lasts for so long of each stay of its drone on a deck at which neither a switch nor a sensor shows who comes, s: who
/// gave it still has it in mind. Chosen.
pub const TAKE_OFF_STANDING_S: f64 = 600.0;
/// No standing one lasts longer, s: a watch on board.
pub const TAKE_OFF_WATCH_S: f64 = 14_400.0;

/// The crew's order about the deck, or about the vessel's course under a drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(C, u8)]
pub enum DeckOrder {
    /// No drone descends.
    Closed,
    /// Nothing lies on it: it is free except for drones that report from it now, or may be coming down in silence.
    Open,
    /// Nothing lies on it, and this drone is neither there nor above it.
    Clear(u32),
    /// No crew and nothing else is near this drone on the deck, nor tied to it: it may take off within
    /// [`TAKE_OFF_CLEARANCE_S`].
    TakeOff(u32),
    /// Clearance for each take-off of this drone, until somebody has been at the deck, and for [`TAKE_OFF_WATCH_S`] at
    /// most: whoever gives it sees to it for so long.
    TakeOffStanding(u32),
    /// Course and speed are kept for so many seconds; 0: nothing is stated any more.
    Steady(u32),
    /// The vessel turns or may turn, until another order about her course.
    Turning,
}

/// Why the deck is closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Closure {
    /// The crew closed it.
    Crew,
    /// The deck's checkpoint is damaged: who stands on it is not known.
    CheckpointDamaged,
    /// The crew's switch is closed, or cannot be read.
    Switch,
    /// By its sensor something lies on it that is no drone, or the sensor cannot be read.
    Sensor,
    /// There is no checkpoint: who stands on it is not known.
    CheckpointMissing,
    /// The deck's checkpoint cannot be written, so that what was found may be older than what happened.
    CheckpointUnwritable,
}

/// The owner is silent for longer than a landing takes while another drone waits for the deck with a low battery.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Starved {
    /// The owner.
    pub owner: u32,
    /// Since its newest status, s.
    pub silent_s: f64,
    /// The one that waits; of several the one with the lowest battery.
    pub waiting: u32,
    /// Battery of that drone, 0 to 1.
    pub battery: f64,
}

impl fmt::Display for Starved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "drone {} has the deck and is silent for {:.0} s, and drone {} waits for it with {:.0} % of its battery",
            self.owner,
            self.silent_s,
            self.waiting,
            100.0 * self.battery
        )
    }
}

/// A silent drone that may be on its way down.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Unheard {
    /// Number of the drone.
    pub drone: u32,
    /// Since its newest status, s.
    pub silent_s: f64,
    /// After so long whatever it had begun has ended, s.
    pub remaining_s: f64,
}

impl fmt::Display for Unheard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "drone {} is silent for {:.0} s and may be on its way down: it keeps the deck",
            self.drone, self.silent_s
        )
    }
}

/// A drone that listens to another computer with this vessel's identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct FollowsAnother {
    /// Number of the drone.
    pub drone: u32,
    /// The other computer's boot id.
    pub boot: u32,
}

/// An order of the crew under way to the vessel's process. Its boot id is the order's: repetitions bear the same.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CrewOrder {
    /// Identity, and when it was given.
    pub header: Header<VesselClock>,
    /// The order.
    pub order: DeckOrder,
}

/// Measurements that arrived together.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SensorReadings {
    /// Identity, and when they were passed on.
    pub header: Header<VesselClock>,
    /// Inertial samples.
    pub imu: Seq<ImuSample, 4>,
    /// GNSS fixes.
    pub gnss: Seq<GnssFix, 4>,
    /// Headings.
    pub heading: Seq<HeadingFix, 4>,
    /// Attitudes.
    pub attitude: Seq<AttitudeFix, 4>,
}

/// Statistics of a decoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Decoded {
    /// Whole messages of a kind that is used.
    pub good: u64,
    /// Damaged: a checksum, a length, a number that is NaN.
    pub corrupted: u64,
    /// Whole messages of other kinds.
    pub ignored: u64,
    /// Whole messages of a kind that is used, without a measurement: no fix, simulated, empty, of another system.
    pub left_out: u64,
    /// Measurements without a time of their source.
    pub undated: u64,
    /// Measurements whose time is their arrival, because their source gives them none.
    pub by_arrival: u64,
    /// Measurements of a recording that are spread evenly between two times of their source.
    pub spread: u64,
    /// Time pulses announced (UBX TIM-TP).
    pub pulses: u64,
    /// Fixes of those, at a time that cannot be the next pulse's after the last fix: another time base.
    pub mismatched_pulses: u64,
}

/// Statistics of a real sensor's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceStatus {
    /// Messages, as its decoder counts them.
    pub decoded: Decoded,
    /// Measurements passed on: inertial samples, fixes, headings, attitudes.
    pub given: [u64; 4],
    /// Measurements of the same time as the last of their kind.
    pub duplicated: u64,
    /// Older than the last of their kind.
    pub out_of_order: u64,
    /// Measurements of an implausible time.
    pub implausible_time: u64,
    /// Restarts and steps of its clock, and by how much it changed at the newest, s, forward positive.
    pub restarts: u64,
    /// See `restarts`.
    pub step_s: f64,
    /// Bytes lost because too many came at once.
    pub lost_bytes: u64,
    /// Newest measurement, s of the vessel's clock.
    pub newest_s: Option<f64>,
}

/// Remarks on a source's bytes for the crew, in addition to the counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceRemark {
    /// The finding, with its values.
    pub text: Line,
    /// Remedy; None: the finding is as it should be.
    pub remedy: Option<Line>,
}

/// A real sensor, by the process that reads its bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceReport {
    /// Identity.
    pub header: Header<VesselClock>,
    /// Number of the source in the configuration.
    pub number: u32,
    /// Counts of its bytes and messages.
    pub status: SourceStatus,
    /// Why its link is down, if it is.
    pub why: Option<Line>,
    /// Further remarks on its bytes.
    pub remarks: Seq<SourceRemark, 6>,
}

/// Use that the estimator made of a real sensor's measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceUse {
    /// Given to the filter.
    pub used: u64,
    /// Measurements of those outside the gates.
    pub gated: u64,
    /// Older than the one before.
    pub out_of_order: u64,
    /// Rejected before the gates: too old, from the future, absurd.
    pub rejected: u64,
    /// Samples of those of an inertial sensor that repeats one for ever.
    pub stuck: u64,
    /// It does so now.
    pub is_stuck: bool,
    /// Used and refused (rejected or gated) since some seconds ago.
    pub lately: [u64; 2],
}

/// The estimator's health.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct EstimatorStatus {
    /// Since the newest sample of inertial or attitude sensor, GNSS and heading, s; None before the first.
    pub sensor_age_s: [Option<f64>; 3],
    /// Since the newest estimate that it published, s; None before the first.
    pub estimate_age_s: Option<f64>,
    /// Standard deviations of that estimate: horizontal position (m), height (m), tilt (rad), heading (rad).
    pub sd: [f64; 4],
    /// Roll, pitch (rad) and height (m, upwards) since the status before, at about 10 Hz, oldest first.
    pub motion: Seq<[f64; 3], 16>,
    /// Course and speed over ground without the waves' motion: velocity to north and east, m/s; None before the first estimate.
    pub mean_velocity: Option<[f64; 2]>,
    /// Significant wave height, m, and how far the waves' identification is trusted, 0 to 1.
    pub waves: Option<[f64; 2]>,
    /// Advice for the helm, where the waves' directions are known.
    pub advice: Option<CourseAdvice>,
    /// Measurements outside its chi-square gates: inertial, GNSS, heading.
    pub gated: [u64; 3],
    /// Starts from scratch.
    pub restarts: u64,
    /// Inputs rejected before its gates.
    pub rejected: u64,
}

/// The deck, and the commands that concern it.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckStatus {
    /// Why it is closed, if it is.
    pub closed: Option<Closure>,
    /// Since the owner's newest status, s.
    pub owner_age_s: Option<f64>,
    /// Numbers that two drones have.
    pub doubles: Seq<u32, MAX_NAMED>,
    /// Drones that were switched on without a position.
    pub unplaced: Seq<u32, MAX_NAMED>,
    /// A drone with a low battery waits for a silent owner.
    pub starved: Option<Starved>,
    /// Silent drones that may be on their way down.
    pub unheard: Seq<Unheard, MAX_NAMED>,
    /// A drone that listens to another computer with this vessel's identity.
    pub follows_another: Option<FollowsAnother>,
    /// Drones that have not acknowledged an abort.
    pub aborts: Seq<u32, MAX_NAMED>,
    /// Why its state would not outlive the process, if it would not.
    pub file_error: Option<Line>,
    /// Digital inputs that cannot be read, and why.
    pub input_errors: Seq<Line, 3>,
    /// Why the lamp at the helm cannot be driven, if it cannot.
    pub lamp_error: Option<Line>,
    /// Course that the helm intends.
    pub course: Course,
    /// A drone wants the vessel to keep course and speed.
    pub wants_steady: bool,
}

/// A drone that was received.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DroneContact {
    /// Since its newest status, s.
    pub age_s: f64,
    /// That status.
    pub status: DroneStatus,
}

/// State of the vessel's process, for the crew and for its supervisor.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct VesselStatus {
    /// Identity.
    pub header: Header<VesselClock>,
    /// The drone that the deck is reserved for.
    pub deck_owner: Option<u32>,
    /// A drone stands on it, or its sensor reports something.
    pub occupied: bool,
    /// Further state of the deck.
    pub deck: DeckStatus,
    /// Boot ids of the crew's newest orders that were taken.
    pub orders: Seq<u32, MAX_ORDERS>,
    /// Drones that were received.
    pub drones: Seq<DroneContact, MAX_NAMED>,
    /// The estimator.
    pub estimator: EstimatorStatus,
    /// Use that it made of each real sensor's measurements, in the order of the configuration.
    pub uses: [SourceUse; MAX_DEVICES],
}
