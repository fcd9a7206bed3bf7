//! Messages: fixed-size plain data, the same on the wire and in shared memory.
//!
//! Every message begins with a [`Header`]: who, which boot, which sequence number and when the
//! content was valid. `C` is the clock of that time: messages of the vessel carry `VesselClock`
//! until the bridge has converted them to `DroneClock`.

mod deck;
mod drone;
mod grant;
mod mission;
mod sensors;
pub mod vessel;

pub use deck::{
    DeckForecast, DeckStage, FORECAST_STAGES, LinkState, PREDICTED_SLOPE_STEP_S, PREDICTED_SLOPES,
    RangeSample, Source, TagPose, UvdarFix,
};
pub use drone::{
    AutopilotMode, AutopilotState, DroneState, LandedState, Motors, PLAN_STAGES, Plan, PlanStage, SetPoint,
    SetPointKind, Solve,
};
pub use grant::DeckGrant;
pub use mission::{
    Command, CommandKind, DroneStatus, MissionState, OperatorCommand, Phase, Reason, ReasonCode, State,
};
pub use sensors::{AttitudeFix, GnssFix, HeadingFix, ImuSample, MAX_SOURCES, NOT_MEASURED_SD};
pub use vessel::{
    MAX_COMPONENTS, PREDICTION_STAGES, PredictedStage, SLOPE_STEP, SLOPE_WINDOW_S, SLOPE_WINDOWS, TimeReply,
    TimeRequest, VesselEstimate, VesselPrediction, WaveComponent, WaveModel,
};

use serde::{Deserialize, Serialize};

use crate::time::{Clock, Time};

/// Version of every message's layout; a receiver refuses any other.
pub const MESSAGE_VERSION: u16 = 6;

/// Identity, order and time of validity of a message.
#[derive(Debug, Serialize, Deserialize)]
#[repr(C)]
#[serde(bound = "")]
pub struct Header<C: Clock> {
    /// Time of validity.
    pub at: Time<C>,
    /// Drawn anew at each start of the sender: tells a restart from a late message.
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
    /// The same header with its time expressed on another clock.
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
}
impl<C: Clock> Clone for Header<C> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<C: Clock> Copy for Header<C> {}
impl<C: Clock> Default for Header<C> {
    fn default() -> Self {
        Header::new(0, 0, 0, 0, Time::EPOCH)
    }
}
impl<C: Clock> PartialEq for Header<C> {
    fn eq(&self, o: &Self) -> bool {
        (
            self.at,
            self.boot,
            self.sequence,
            self.vessel,
            self.drone,
            self.version,
        ) == (o.at, o.boot, o.sequence, o.vessel, o.drone, o.version)
    }
}

/// What every message can say about itself.
pub trait Message {
    /// The clock of its time of validity.
    type Clock: Clock;
    /// Its header.
    fn header(&self) -> &Header<Self::Clock>;
    /// Every number in it is finite and inside what physics allows; else the name of the first
    /// field that is not.
    fn check(&self) -> Result<(), &'static str>;
}

/// All components finite and no larger than `limit`.
pub(crate) fn within<'a>(values: impl IntoIterator<Item = &'a f64>, limit: f64) -> bool {
    // NaN compares false.
    values.into_iter().all(|v| v.abs() <= limit)
}
/// All components finite and no larger than `limit`.
pub(crate) fn within32<'a>(values: impl IntoIterator<Item = &'a f32>, limit: f32) -> bool {
    values.into_iter().all(|v| v.abs() <= limit)
}

/// Largest coordinate that a message may carry, m: a tangent plane is meaningless further out.
pub const MAX_POSITION_M: f64 = 1.0e5;
/// Largest speed that a message may carry, m/s.
pub const MAX_SPEED_MPS: f64 = 100.0;
/// Largest acceleration that a message may carry, m/s².
pub const MAX_ACCELERATION_MPS2: f64 = 200.0;
/// Largest angular rate that a message may carry, rad/s.
pub const MAX_RATE_RPS: f64 = 50.0;
