//! Messages: fixed-size plain data, the same on the wire and in shared memory, but for the vessel's estimate and wave
//! model, which travel over the radio in the forms of [`update`].
//!
//! Every message begins with a [`Header`]: who, which boot, which sequence number and when the
//! content was valid. `C` is the clock of that time: messages of the vessel carry `VesselClock`
//! until the bridge has converted them to `DroneClock`.

/// Implements [`Message`]: its clock, its header, and conditions in order, each with the field to blame.
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
/// A message with its time of validity on another clock.
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
pub mod vessel;

pub use aboard::{
    Closure, CrewOrder, DeckOrder, DeckStatus, Decoded, DroneContact, EstimatorStatus, FollowsAnother, Line,
    MAX_DEVICES, MAX_NAMED, MAX_ORDERS, SensorReadings, SourceRemark, SourceReport, SourceStatus, SourceUse,
    Starved, TAKE_OFF_CLEARANCE_S, TAKE_OFF_STANDING_S, TAKE_OFF_WATCH_S, Unheard, VesselStatus,
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
    PLAN_STAGES, Plan, PlanStage, PredictorCheckpoint, SetPoint, SetPointKind, ShadowComparison, Solve,
};
pub use grant::{
    Course, DECK_CLOSED, DeckDimensions, DeckGrant, MAX_STEADY_S, OWNER_ONLY_M, PLACES, STATION_APART_M,
    WAITING_DISTANCE_M, WaitingPlace,
};
/// Numbers of which three digits suffice.
pub use half::f16;
pub use link_checkpoint::{LinkCheckpoint, WindCheckpoint};
pub use mission::{
    BatteryPlace, Charge, DroneStatus, KnownBattery, LandingMode, LastVessel, MissionCheckpoint,
    MissionSettings, MissionState, SettingsOrder, VesselLevel, Wind, still_armed,
};
pub use reason::{Reason, ReasonCode};
pub use rtcm::{CarrierSolution, RelativePlace, RelativeState, RtcmFrames};
pub use sensors::{AttitudeFix, GnssFix, HeadingFix, ImuSample, MAX_SOURCES, NOT_MEASURED_SD};
pub use seq::Seq;
pub use state::{Phase, State};
pub use station::{KeptStation, MAX_STATION_HEIGHT_M, MAX_STATION_M, MAX_STATION_MIN, Station};
pub use text::Text;
pub use update::{EstimateRest, EstimateUpdate, UpdateReceiver, WaveSender, WaveUpdate};
pub use vessel::{
    CourseAdvice, MAX_MODES, PREDICTION_STAGES, PredictedStage, SLOPE_STEP, SLOPE_WINDOW_S, SLOPE_WINDOWS,
    TimeReply, TimeRequest, VesselEstimate, VesselPrediction, VesselSurroundings, WaveMode, WaveModel,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{Clock, Time};

/// Version of every message's layout; a receiver rejects any other.
pub const MESSAGE_VERSION: u16 = 31;

/// Identity, order and time of validity of a message.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct Header<C: Clock> {
    /// Time of validity.
    pub at: Time<C>,
    /// Random number of each start of the sender: distinguishes a restart from a late message.
    pub boot: u32,
    /// Counts up by one with each message of this kind since boot.
    pub sequence: u32,
    /// Which vessel it is about.
    pub vessel: u32,
    /// Which drone it is about; 0 when the message is for any drone.
    pub drone: u32,
    /// [`MESSAGE_VERSION`] of the sender.
    pub version: u16,
}

impl<C: Clock> Header<C> {
    /// A header of this version.
    pub const fn new(vessel: u32, drone: u32, boot: u32, sequence: u32, at: Time<C>) -> Self {
        Header {
            at,
            boot,
            sequence,
            vessel,
            drone,
            version: MESSAGE_VERSION,
        }
    }
    /// It comes after `last` of the same sender: a higher sequence number, or another boot.
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
    /// A header of this sender, at a time older than any that counts: a day before its clock began.
    pub const fn outdated(&self) -> Header<C> {
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
    /// The message's header.
    fn header(&self) -> &Header<Self::Clock>;
    /// Every number in it is finite and inside what physics allows; else the name of the first
    /// field that is not.
    fn check(&self) -> Result<(), &'static str>;
}

/// `Err(field)` unless `sound`.
pub(crate) fn ensure(sound: bool, field: &'static str) -> Result<(), &'static str> {
    if sound { Ok(()) } else { Err(field) }
}
/// All components finite and no larger than `limit`.
pub(crate) fn within<'a, T: Copy + Into<f64> + 'a>(
    values: impl IntoIterator<Item = &'a T>,
    limit: f64,
) -> bool {
    // NaN compares false.
    values.into_iter().all(|v| (*v).into().abs() <= limit)
}

/// Every one of these lists is not negative and at most `limit`: standard deviations.
pub(crate) fn deviations<const N: usize>(lists: [&[f64]; N], limit: f64) -> bool {
    lists
        .iter()
        .all(|list| list.iter().all(|v| (0.0..=limit).contains(v)))
}
/// Every one is above zero and below `limit`.
pub(crate) fn positive<'a>(values: impl IntoIterator<Item = &'a f64>, limit: f64) -> bool {
    values.into_iter().all(|v| *v > 0.0 && *v < limit)
}
/// A charge or a thrust as autopilots report it: rounding and a boost allowed.
pub(crate) const FRACTION: core::ops::RangeInclusive<f64> = -0.01..=1.5;
/// Largest angle that a message may carry, rad.
pub(crate) const MAX_ANGLE_RAD: f64 = 7.0;
/// Largest tilt that a surface vessel's message may carry, rad: beyond it, it has capsized.
pub(crate) const MAX_TILT_RAD: f64 = 1.3;
/// Largest coordinate that a message may carry, m: a tangent plane is meaningless further out.
pub const MAX_POSITION_M: f64 = 1.0e5;
/// Largest speed that a message may carry, m/s.
pub const MAX_SPEED_MPS: f64 = 100.0;
/// Largest acceleration that a message may carry, m/s².
pub const MAX_ACCELERATION_MPS2: f64 = 200.0;
/// Largest angular rate that a message may carry, rad/s.
pub const MAX_RATE_RPS: f64 = 50.0;
