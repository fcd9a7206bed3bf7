//! Messages between the processes of the vessel's computer: state of the deck, sensor data, crew orders.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    AttitudeFix, Course, CourseAdvice, DroneStatus, GnssFix, Header, HeadingFix, ImuSample, Seq, Text,
    VesselEstimate,
};
use crate::time::VesselClock;

/// Maximum number of real sensors on a vessel; one byte stream can be two sources of measurements ([`super::MAX_SOURCES`]).
pub const MAX_DEVICES: usize = super::MAX_SOURCES / 2;
/// Maximum number of drones named in one status.
pub const MAX_NAMED: usize = 16;
/// Number of newest crew orders listed in a status.
pub const MAX_ORDERS: usize = 8;
/// Text for the crew in a status.
pub type Line = Text<240>;

/// Validity of a take-off clearance, s: covers checks, countdown, and the wait for a suitable moment.
pub const TAKE_OFF_CLEARANCE_S: f64 = 120.0;
/// Validity of a standing clearance during each stay of its drone on the deck, s, without a switch or sensor
/// that detects visitors. Chosen: a time over which the crew remembers the clearance.
pub const TAKE_OFF_STANDING_S: f64 = 600.0;
/// Maximum validity of a standing clearance, s: one watch on board.
pub const TAKE_OFF_WATCH_S: f64 = 14_400.0;

/// Crew order about the deck, or about the vessel's course while a drone is near.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(C, u8)]
pub enum DeckOrder {
    /// No drone may descend.
    Closed,
    /// The deck is clear and open, except for drones that report from it or may be descending without radio contact.
    Open,
    /// The deck is clear, and this drone is neither on it nor above it.
    Clear(u32),
    /// Crew and objects are clear of this drone on the deck, and it is not tied down: it may take off within
    /// [`TAKE_OFF_CLEARANCE_S`].
    TakeOff(u32),
    /// Clears every take-off of this drone until the crew steps on the deck, for at most
    /// [`TAKE_OFF_WATCH_S`], while the crew keeps the deck clear.
    TakeOffStanding(u32),
    /// The vessel keeps course and speed for this number of seconds; 0 withdraws the statement.
    Steady(u32),
    /// The vessel turns or may turn until the next order about the course.
    Turning,
}

/// Reason why the deck is closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Closure {
    /// The crew closed it.
    Crew,
    /// The deck's checkpoint is damaged, so its occupants are unknown.
    CheckpointDamaged,
    /// The crew's switch is closed or cannot be read.
    Switch,
    /// The deck sensor detects an object other than a drone, or cannot be read.
    Sensor,
    /// The deck has no checkpoint, so its occupants are unknown.
    CheckpointMissing,
    /// The deck's checkpoint cannot be written, so the file may be out of date.
    CheckpointUnwritable,
}

/// The owner stands on the deck, or has been silent for longer than a landing takes, while a drone with a low battery
/// waits.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct Starved {
    /// Number of the owner.
    pub owner: u32,
    /// Time since the owner's newest status, s.
    pub silent_s: f64,
    /// Number of the waiting drone; if several wait, the one with the lowest battery.
    pub waiting: u32,
    /// Battery of the waiting drone, 0 to 1.
    pub battery: f64,
}

impl fmt::Display for Starved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "drone {} has the deck and ", self.owner)?;
        if self.silent_s <= crate::topics::DRONE_STATUS.stale_after.secs() {
            f.write_str("stands on it")?;
        } else {
            write!(f, "has been silent for {:.0} s", self.silent_s)?;
        }
        write!(
            f,
            ", and drone {} waits for it with a battery of {:.0} %",
            self.waiting,
            100.0 * self.battery
        )
    }
}

/// Silent drone that may be descending.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SilentDrone {
    /// Number of the drone.
    pub drone: u32,
    /// Time since its newest status, s.
    pub silent_s: f64,
    /// Time until any descent that it may have begun has ended, s.
    pub remaining_s: f64,
}

impl fmt::Display for SilentDrone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "drone {} is silent for {:.0} s and may be on its way down: it keeps the deck",
            self.drone, self.silent_s
        )
    }
}

/// Drone that follows another computer with this vessel's identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct FollowsAnother {
    /// Number of the drone.
    pub drone: u32,
    /// Boot id of the other computer.
    pub boot: u32,
}

/// Crew order on its way to the vessel's process; repetitions carry the boot id of the first.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct CrewOrder {
    /// Identity and time of the order.
    pub header: Header<VesselClock>,
    /// The order.
    pub order: DeckOrder,
}

/// Measurements that arrived together.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SensorReadings {
    /// Identity and time of forwarding.
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
    /// Complete messages of a supported kind.
    pub good: u64,
    /// Damaged messages: wrong checksum, wrong length or NaN.
    pub corrupted: u64,
    /// Complete messages of other kinds.
    pub ignored: u64,
    /// Complete messages of a supported kind without a usable measurement: no fix, simulated, empty, from another system.
    pub left_out: u64,
    /// Measurements without a time stamp from their source.
    pub undated: u64,
    /// Measurements stamped on arrival because their source states no time.
    pub by_arrival: u64,
    /// Recorded measurements spread evenly between two times stated by their source.
    pub spread: u64,
    /// Time pulses announced (UBX TIM-TP).
    pub pulses: u64,
    /// Announced pulses that do not match the time of their fix, because the two have different time bases.
    pub mismatched_pulses: u64,
}

/// Statistics of a real sensor's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceStatus {
    /// Counts of the decoder.
    pub decoded: Decoded,
    /// Forwarded measurements: inertial samples, fixes, headings, attitudes.
    pub given: [u64; 4],
    /// Measurements with the same time as the previous one of their kind.
    pub duplicated: u64,
    /// Measurements older than the previous one of their kind.
    pub out_of_order: u64,
    /// Measurements with an implausible time.
    pub implausible_time: u64,
    /// Restarts and steps of the source's clock.
    pub restarts: u64,
    /// Newest step of the source's clock, s, positive forward.
    pub step_s: f64,
    /// Delay of all measurements beyond the usual one, s; zero if it is small.
    pub delay_s: f64,
    /// Bytes lost because too many arrived at once.
    pub lost_bytes: u64,
    /// Time of the newest measurement on the vessel's clock, s.
    pub newest_s: Option<f64>,
}

/// Remark for the crew on a source's bytes, in addition to the counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceRemark {
    /// Finding with its values.
    pub text: Line,
    /// Remedy; None: no action is needed.
    pub remedy: Option<Line>,
}

/// Report on a real sensor by the process that reads its bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceReport {
    /// Identity.
    pub header: Header<VesselClock>,
    /// Number of the source in the configuration.
    pub number: u32,
    /// Counts of its bytes and messages.
    pub status: SourceStatus,
    /// Reason why the link is down; None: it is up.
    pub why: Option<Line>,
    /// Further remarks on its bytes.
    pub remarks: Seq<SourceRemark, 6>,
}

/// Use of a real sensor's measurements by the estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct SourceUse {
    /// Measurements passed to the filter.
    pub used: u64,
    /// Passed measurements outside the chi-square gates.
    pub outliers: u64,
    /// Measurements older than the previous one.
    pub out_of_order: u64,
    /// Measurements rejected before the gates: too old, from the future, or absurd.
    pub rejected: u64,
    /// Samples rejected because the inertial sensor repeats one value.
    pub stuck: u64,
    /// The sensor repeats one value now.
    pub is_stuck: bool,
    /// Measurements used, and measurements rejected (before or by the gates), within the last seconds.
    pub lately: [u64; 2],
}

/// State of the estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct EstimatorStatus {
    /// Age of the newest inertial or attitude sample, GNSS fix and heading, s; None before the first.
    pub sensor_age_s: [Option<f64>; 3],
    /// Age of the newest published estimate, s; None before the first.
    pub estimate_age_s: Option<f64>,
    /// Standard deviations of that estimate: horizontal position (m), height (m), tilt (rad), heading (rad).
    pub sd: [f64; 4],
    /// Roll, pitch (rad) and height (m, upwards) since the previous status, at about 10 Hz, oldest first.
    pub motion: Seq<[f64; 3], 16>,
    /// Course and speed over ground without wave motion: velocity north and east, m/s; None before the first estimate.
    pub mean_velocity: Option<[f64; 2]>,
    /// Motion of the last 10 to 20 minutes.
    pub greatest: DeckMotion,
    /// Heading without wave motion, rad; None before the first estimate.
    pub heading: Option<f32>,
    /// Significant wave height, m, and confidence in the identified waves, 0 to 1.
    pub waves: Option<[f64; 2]>,
    /// Advice for the helm, once the wave directions are known.
    pub advice: Option<CourseAdvice>,
    /// Measurements outside their chi-square gates: inertial, GNSS, heading.
    pub outliers: [u64; 3],
    /// Restarts of the filter from scratch.
    pub restarts: u64,
    /// Inputs rejected before the gates.
    pub rejected: u64,
}

/// Motion of the deck in the last 10 to 20 minutes, as helideck monitoring states it (CAP 437).
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckMotion {
    /// Number of estimates.
    pub samples: u32,
    /// Greatest absolute roll, rad.
    pub roll: f64,
    /// Greatest absolute pitch, rad.
    pub pitch: f64,
    /// Greatest inclination, rad.
    pub inclination: f64,
    /// Significant heave rate: twice the root mean square of the vertical speed, m/s.
    pub heave_rate: f64,
}

impl DeckMotion {
    /// Motion at the time of one estimate.
    pub fn of(e: &VesselEstimate<VesselClock>) -> DeckMotion {
        let [_, _, _, roll, pitch, _] = e.eta;
        DeckMotion {
            samples: 1,
            roll: roll.abs(),
            pitch: pitch.abs(),
            inclination: (roll.cos() * pitch.cos()).acos(),
            heave_rate: 2.0 * f64::from(e.eta_dot[2].abs()),
        }
    }
    /// Motion of two spans together.
    pub fn and(self, other: DeckMotion) -> DeckMotion {
        let [n, more] = [self, other].map(|m| f64::from(m.samples));
        let squares = n * self.heave_rate.powi(2) + more * other.heave_rate.powi(2);
        DeckMotion {
            samples: self.samples + other.samples,
            roll: self.roll.max(other.roll),
            pitch: self.pitch.max(other.pitch),
            inclination: self.inclination.max(other.inclination),
            heave_rate: (squares / (n + more).max(1.0)).sqrt(),
        }
    }
}

/// State of the deck and of the commands about it.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DeckStatus {
    /// Reason why the deck is closed; None: it is open.
    pub closed: Option<Closure>,
    /// Time since the owner's newest status, s.
    pub owner_age_s: Option<f64>,
    /// Drone numbers used by two drones.
    pub doubles: Seq<u32, MAX_NAMED>,
    /// Drones switched on without a position.
    pub unplaced: Seq<u32, MAX_NAMED>,
    /// Drone with a low battery that waits for a silent owner.
    pub starved: Option<Starved>,
    /// Silent drones that may be descending.
    pub silent_drones: Seq<SilentDrone, MAX_NAMED>,
    /// Drone that follows another computer with this vessel's identity.
    pub follows_another: Option<FollowsAnother>,
    /// Drones that have not acknowledged an abort.
    pub aborts: Seq<u32, MAX_NAMED>,
    /// Reason why the deck's state would be lost with the process; None: it is saved.
    pub file_error: Option<Line>,
    /// Digital inputs that cannot be read, with the reason.
    pub input_errors: Seq<Line, 3>,
    /// Reason why the lamp at the helm cannot be driven; None: it works.
    pub lamp_error: Option<Line>,
    /// Course that the helm intends.
    pub course: Course,
    /// A drone asks the vessel to keep course and speed.
    pub wants_steady: bool,
}

/// Drone from which a status has been received.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct DroneContact {
    /// Time since its newest status, s.
    pub age_s: f64,
    /// Newest status.
    pub status: DroneStatus,
}

/// State of the vessel's process, for the crew and for the supervisor.
#[derive(Clone, Copy, Debug, Default, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
pub struct VesselStatus {
    /// Identity.
    pub header: Header<VesselClock>,
    /// Drone that has reserved the deck.
    pub deck_owner: Option<u32>,
    /// A drone stands on the deck, or the deck sensor detects an object.
    pub occupied: bool,
    /// Further state of the deck.
    pub deck: DeckStatus,
    /// Boot ids of the newest accepted crew orders.
    pub orders: Seq<u32, MAX_ORDERS>,
    /// Drones from which a status has been received.
    pub drones: Seq<DroneContact, MAX_NAMED>,
    /// State of the estimator.
    pub estimator: EstimatorStatus,
    /// Use of each real sensor's measurements by the estimator, in the order of the configuration.
    pub uses: [SourceUse; MAX_DEVICES],
}
