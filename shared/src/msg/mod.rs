//! Messages: plain data of fixed size with one layout on the wire and in shared memory. The vessel's estimate
//! and wave model have compact forms for the radio ([`update`]).
//!
//! Every message begins with a [`Header`]: sender, boot, sequence number and time of validity on the clock
//! `C`. The vessel's messages carry `VesselClock` until the bridge converts them to `DroneClock`.

/// Implements [`Message`] from a clock, a header and ordered conditions, each with the name of the invalid field.
macro_rules! message {
    ($(@$c:ident)? $name:ty, $clock:ty, |$m:ident| { $($sound:expr => $field:literal,)* }) => {
        impl$(<$c: $crate::time::Clock>)? $crate::msg::Message for $name {
            type Clock = $clock;
            fn header(&self) -> &$crate::msg::Header<$clock> {
                &self.header
            }
            fn check(&self) -> Result<(), &'static str> {
                let $m = self;
                $($crate::msg::ensure($sound, $field)?;)*
                let _sound = $m;
                Ok(())
            }
        }
    };
}
/// Implements conversion of a message to another clock.
macro_rules! restamped {
    ($name:ident { $($field:ident),* }) => {
        impl<C: Clock> $name<C> {
            /// This message with its time of validity on another clock.
            pub fn restamped<D: Clock>(&self, at: Time<D>) -> $name<D> {
                $name { header: self.header.restamped(at), $($field: self.$field),* }
            }
        }
    };
}

mod aboard;
mod beacon;
mod command;
mod computer;
mod deck;
mod drone;
mod drone_status;
pub use drone_status::still_armed_s;
mod grant;
mod link_checkpoint;
mod mission;
mod reason;
mod rtcm;
mod sensors;
mod seq;
mod state;
mod station;
mod text;
pub mod update;
mod version;
pub mod vessel;

pub use aboard::{
    Closure, CrewOrder, DeckMotion, DeckOrder, DeckStatus, Decoded, DroneContact, EstimatorStatus,
    FollowsAnother, Line, MAX_DEVICES, MAX_NAMED, MAX_ORDERS, SensorReadings, SilentDrone, SourceRemark,
    SourceReport, SourceStatus, SourceUse, Starved, TAKE_OFF_CLEARANCE_S, TAKE_OFF_STANDING_S,
    TAKE_OFF_WATCH_S, VesselStatus,
};
pub use beacon::{BeaconSource, DeckBeacon, MAX_BEACON_LASTS_S, MAX_BEACON_MPS, MIN_BEACON_SD_M};
pub use command::{Command, CommandKind, CommandProgress, CommandReceipt, OperatorCommand};
pub use computer::{
    Certificate, CertificateState, ComputerReport, MAX_ENDPOINTS, MAX_PEERS, MAX_PROCESSES, Name, Names,
    VesselReport,
};
pub use deck::{
    CameraLight, DeckForecast, DeckStage, FORECAST_STAGES, LinkState, MIN_GLARE, PREDICTED_SLOPE_STEP_S,
    PREDICTED_SLOPES, RangeSample, SILENT_S, Source, TagPose, UvdarFix,
};
pub use drone::{
    AttitudeResponse, AutopilotMode, AutopilotState, DroneState, LandedState, Motors, OwnMission,
    PLAN_STAGES, Plan, PlanCheck, PlanRefusal, PlanStage, PredictorCheckpoint, SetPoint, SetPointKind,
    ShadowComparison, Solve,
};
pub use grant::{
    Course, DECK_CLOSED, DeckDimensions, DeckGrant, MAX_STEADY_S, OWNER_ONLY_M, PLACES, STATION_APART_M,
    WAITING_DISTANCE_M, WaitingPlace,
};
/// Numbers for which three significant digits suffice.
pub use half::f16;
pub use link_checkpoint::{LinkCheckpoint, WindCheckpoint};
pub use mission::{
    BatteryPlace, Charge, DroneStatus, KnownBattery, LandingMode, LastResort, LastVessel, MissionCheckpoint,
    MissionSettings, MissionState, SettingsOrder, VesselLevel, Wind, still_armed,
};
pub use reason::{Reason, ReasonCode, TwoDigits, WaitingTimes};
pub use rtcm::{CarrierSolution, RelativePlace, RelativeState, RtcmFrames};
pub use sensors::{AttitudeFix, GnssFix, HeadingFix, ImuSample, MAX_SOURCES, NOT_MEASURED_SD};
pub use seq::Seq;
pub use state::{Phase, State};
pub use station::{KeptStation, MAX_STATION_HEIGHT_M, MAX_STATION_M, MAX_STATION_MIN, Station};
pub use text::Text;
pub use update::{EstimateRest, EstimateUpdate, UpdateReceiver, WaveSender, WaveUpdate};
pub use version::message_version;
pub use vessel::{
    CourseAdvice, MAX_MODES, PREDICTION_STAGES, PredictedStage, SLOPE_STEP, SLOPE_WINDOW_S, SLOPE_WINDOWS,
    TimeReply, TimeRequest, VesselEstimate, VesselPrediction, VesselSurroundings, WaveMode, WaveModel,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{Clock, Time};

/// Identity, order and time of validity of a message.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct Header<C: Clock> {
    /// Time of validity.
    pub at: Time<C>,
    /// Random number drawn at each start of the sender, to distinguish a restart from a late message.
    pub boot: u32,
    /// Number of this message among those of its kind since boot.
    pub sequence: u32,
    /// Number of the vessel concerned.
    pub vessel: u32,
    /// Number of the drone concerned; 0: any drone.
    pub drone: u32,
    /// [`message_version`] of the sender.
    pub version: u16,
}

impl<C: Clock> Header<C> {
    /// Header with the current version.
    pub fn new(vessel: u32, drone: u32, boot: u32, sequence: u32, at: Time<C>) -> Self {
        Header {
            at,
            boot,
            sequence,
            vessel,
            drone,
            version: message_version(),
        }
    }
    /// Whether it follows `last` of the same sender: a higher sequence number, or another boot.
    pub fn follows(&self, last: &Header<C>) -> bool {
        self.boot != last.boot || self.sequence > last.sequence
    }
    /// This header with its time expressed on another clock.
    pub const fn restamped<D: Clock>(&self, at: Time<D>) -> Header<D> {
        Header {
            at,
            boot: self.boot,
            sequence: self.sequence,
            vessel: self.vessel,
            drone: self.drone,
            version: self.version,
        }
    }
    /// Header of this sender with a time that counts as outdated: one day before its clock began.
    pub fn outdated(&self) -> Header<C> {
        let at = Time::from_nanos(-86_400_000_000_000);
        Header::new(self.vessel, self.drone, self.boot, 0, at)
    }
}
impl<C: Clock> Default for Header<C> {
    fn default() -> Self {
        Header::new(0, 0, 0, 0, Time::EPOCH)
    }
}

/// Interface of every message.
pub trait Message {
    /// The clock of its time of validity.
    type Clock: Clock;
    /// Header of the message.
    fn header(&self) -> &Header<Self::Clock>;
    /// Checks that every number is finite and physically plausible; `Err` names the first invalid field.
    fn check(&self) -> Result<(), &'static str>;
}

pub(crate) fn ensure(sound: bool, field: &'static str) -> Result<(), &'static str> {
    if sound { Ok(()) } else { Err(field) }
}
/// Whether all components are finite and at most `limit` in magnitude.
pub(crate) fn within<'a, T: Copy + Into<f64> + 'a>(
    values: impl IntoIterator<Item = &'a T>,
    limit: f64,
) -> bool {
    // NaN compares false.
    values.into_iter().all(|v| (*v).into().abs() <= limit)
}

/// Whether all standard deviations are within 0 and `limit`.
pub(crate) fn deviations<const N: usize>(lists: [&[f64]; N], limit: f64) -> bool {
    lists
        .iter()
        .all(|list| list.iter().all(|v| (0.0..=limit).contains(v)))
}
/// Whether all values are above zero and below `limit`.
pub(crate) fn positive<'a>(values: impl IntoIterator<Item = &'a f64>, limit: f64) -> bool {
    values.into_iter().all(|v| *v > 0.0 && *v < limit)
}
/// Charge or thrust as autopilots report it, with tolerance for rounding and boost.
pub(crate) const FRACTION: core::ops::RangeInclusive<f64> = -0.01..=1.5;
/// Maximum angle in a message, rad.
pub(crate) const MAX_ANGLE_RAD: f64 = 7.0;
/// Maximum tilt in a surface vessel's message, rad; beyond it, the vessel has capsized.
pub(crate) const MAX_TILT_RAD: f64 = 1.3;
/// Maximum coordinate in a message, m; further out a tangent plane is meaningless.
pub const MAX_POSITION_M: f64 = 1.0e5;
/// Maximum speed in a message, m/s.
pub const MAX_SPEED_MPS: f64 = 100.0;
/// Maximum acceleration in a message, m/s².
pub const MAX_ACCELERATION_MPS2: f64 = 200.0;
/// Maximum angular rate in a message, rad/s.
pub const MAX_RATE_RPS: f64 = 50.0;
